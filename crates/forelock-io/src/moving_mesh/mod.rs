//! Meshes whose vertices are given at each time, as characters.
//!
//! # Theory
//! At time t the vertices xᵢ(t) of a mesh are those of its first sample, xᵢ(0), moved by the rigid
//! motion that fits best, and what remains, in the space of the first sample. With the centroids
//! c(t):
//!
//! ```text
//! xᵢ(t) = R(t) (xᵢ(0) − c(0) + dᵢ(t)) + c(t) ,   R minimises Σᵢ |dᵢ(t)|²
//! ```
//!
//! The motion becomes that of a joint in the centroid, the remainder a blend shape of each sample,
//! whose weight is 1 at its time and 0 at the samples before and after it. So a head that only
//! turns has no blend shapes, and between two samples it turns about its centroid.
//!
//! R is the rotation that maximises tr(Rᵀ A), A = Σᵢ (xᵢ(t) − c(t)) (xᵢ(0) − c(0))ᵀ. It is iterated
//! from that of the sample before (Müller et al. 2016, "A robust method to extract the rotational
//! part of deformations").
//!
//! # Practice
//! Meshes that move as one share a joint.

use forelock_core::body::TriMesh;
use forelock_core::body::character::{
    BlendShape, Bone, Character, CharacterParts, Clip, Group, Interpolation, Joint, Skeleton, Skin, Track,
    Transform, Values,
};
use glam::{DAffine3, DMat3, DQuat, DVec3, Vec3};
use std::sync::Arc;

use crate::error::check_room;

/// The name of the clip.
pub(crate) const CLIP: &str = "animation";
/// Bytes that a sample of a mesh takes, without its vertices.
const SAMPLE_BYTES: usize = 128;
/// Bytes that a vertex of a sample takes, with its part of a blend shape.
const VERTEX_BYTES: usize = 28;
/// Bytes after which the free memory is looked at again.
const STEP: u64 = 64 << 20;
/// A remainder below this share of the largest coordinate is a rounding error.
const ROUNDING: f32 = 1e-6;
/// Maximum number of turns that lead from one rotation to the next.
const TURNS: u32 = 64;

/// A mesh of a file.
#[derive(Clone, Debug, Default)]
pub(crate) struct MovingMesh {
    pub name: String,
    pub triangles: Vec<[u32; 3]>,
    /// The vertices at each of the file's times, and their transform to the file's space.
    pub samples: Vec<(Arc<[Vec3]>, DAffine3)>,
}

impl MovingMesh {
    /// Adds a sample; vertices that are those of the sample before are held once. Returns the bytes
    /// that it takes.
    pub fn push(&mut self, vertices: Vec<Vec3>, world: DAffine3) -> usize {
        let before = self.samples.last().map(|own| &own.0).filter(|own| ***own == *vertices);
        let bytes = if before.is_some() { 0 } else { VERTEX_BYTES * vertices.len() };
        self.samples.push((before.map_or_else(|| vertices.into(), Arc::clone), world));
        bytes + SAMPLE_BYTES
    }

    /// The vertices of a sample in the file's space.
    fn places(&self, sample: usize) -> Vec<Vec3> {
        let (vertices, world) = &self.samples[sample];
        if *world == DAffine3::IDENTITY {
            return vertices.to_vec();
        }
        vertices.iter().map(|p| world.transform_point3(p.as_dvec3()).as_vec3()).collect()
    }

    /// The vertices of all samples, one after the other.
    fn each(&self) -> impl Iterator<Item = Vec<Vec3>> + '_ {
        (0..self.samples.len()).map(|sample| self.places(sample))
    }
}

impl MovingMesh {
    /// Adds polygons of so many corners each, `counts`, whose vertices are `corners`, as fans;
    /// `is_reversed` reverses their winding. Returns the number of triangles that are left out
    /// because a corner is repeated.
    ///
    /// # Errors
    /// What is wrong, to be put behind the name of the mesh.
    pub fn add_polygons<T>(&mut self, counts: &[T], corners: &[T], is_reversed: bool) -> Result<usize, String>
    where
        T: Copy + TryInto<u32> + TryInto<usize>,
    {
        let (mut left_out, mut rest) = (0, corners);
        for &count in counts {
            let split = TryInto::<usize>::try_into(count).ok().and_then(|n| rest.split_at_checked(n));
            let (own, others) = split.ok_or("has polygons with more corners than it has")?;
            let own: Result<Vec<u32>, _> = own.iter().map(|&corner| corner.try_into()).collect();
            let own = own.map_err(|_| "has a corner that is no vertex")?;
            for k in 2..own.len() {
                let [a, b, c] = [own[0], own[k - 1], own[k]];
                if a == b || b == c || c == a {
                    left_out += 1;
                } else {
                    self.triangles.push(if is_reversed { [a, c, b] } else { [a, b, c] });
                }
            }
            rest = others;
        }
        Ok(left_out)
    }
}

/// The memory that samples take.
#[derive(Debug, Default)]
pub(crate) struct Room {
    taken: u64,
    checked: u64,
}

impl Room {
    /// Counts `bytes` more.
    ///
    /// # Errors
    /// When there is not enough free memory to go on.
    pub fn take(&mut self, bytes: usize) -> std::io::Result<()> {
        self.taken += bytes as u64;
        while self.taken > self.checked {
            check_room(STEP)?;
            self.checked += STEP;
        }
        Ok(())
    }
}

/// What to say of triangles that are left out, if there are any.
pub(crate) fn left_out(triangles: usize) -> Option<String> {
    (triangles > 0).then(|| format!("{triangles} triangles with a repeated corner are left out"))
}

/// The character that `meshes` are, whose samples are at `times_secs`, which ascend.
///
/// # Errors
/// What is wrong, in one sentence.
pub(crate) fn character(meshes: Vec<MovingMesh>, times_secs: &[f64]) -> Result<Character, String> {
    let mut parts = Parts::default();
    for mesh in meshes {
        parts.add(mesh)?;
    }
    parts.finish(times_secs)
}

/// The rotation and the centroid of a mesh at each time, of the first sample no rotation.
type Motion = Vec<(DQuat, DVec3)>;

/// A joint.
struct Fitted {
    name: String,
    motion: Motion,
}

/// The parts of a character.
#[derive(Default)]
struct Parts {
    joints: Vec<Fitted>,
    positions: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
    /// The joint of each vertex.
    joint_of: Vec<usize>,
    /// The remainders at each time.
    deltas: Vec<Vec<(u32, Vec3)>>,
    groups: Vec<Group>,
}

impl Parts {
    fn add(&mut self, mesh: MovingMesh) -> Result<(), String> {
        let name = &mesh.name;
        let Some(first) = mesh.each().next().filter(|first| !first.is_empty()) else { return Ok(()) };
        for (sample, own) in mesh.each().enumerate() {
            if own.len() != first.len() {
                let (before, now) = (first.len(), own.len());
                return Err(format!(
                    "the mesh `{name}` has {before} vertices at first and {now} in frame {sample}; bodies \
                     whose vertices change in number cannot be read"
                ));
            }
            if let Some(vertex) = own.iter().position(|p| !p.is_finite()) {
                return Err(format!("vertex {vertex} of the mesh `{name}` is not finite in frame {sample}"));
            }
        }
        let vertices = first.len();
        if let Some(corner) = mesh.triangles.iter().flatten().find(|&&corner| corner as usize >= vertices) {
            return Err(format!(
                "the mesh `{name}` has {vertices} vertices, but a corner at vertex {corner}"
            ));
        }
        let base = self.positions.len();
        if base + first.len() > u32::MAX as usize {
            return Err("the meshes have over 2³² vertices".to_owned());
        }
        let largest = |own: &[Vec3]| own.iter().fold(0.0f32, |most, p| most.max(p.abs().max_element()));
        let rounding = ROUNDING * mesh.each().map(|own| largest(&own)).fold(0.0, f32::max);
        let shared = self.joints.iter().position(|Fitted { motion, .. }| {
            let mut pairs = mesh.each().zip(motion);
            let from = motion[0].1;
            pairs.all(|(own, now)| remainders(&first, &own, from, now).all(|d| d.length() <= rounding))
        });
        let joint = shared.unwrap_or_else(|| {
            self.joints.push(Fitted { name: name.clone(), motion: fit(&first, mesh.each()) });
            self.joints.len() - 1
        });
        self.deltas.resize_with(mesh.samples.len().max(self.deltas.len()), Vec::new);
        if shared.is_none() {
            let motion = &self.joints[joint].motion;
            for ((own, now), deltas) in mesh.each().zip(motion).zip(&mut self.deltas) {
                let all = remainders(&first, &own, motion[0].1, now).zip(base as u32..);
                deltas.extend(all.filter(|(d, _)| d.length() > rounding).map(|(d, vertex)| (vertex, d)));
            }
        }
        let from = self.triangles.len();
        self.positions.extend(first);
        self.joint_of.resize(self.positions.len(), joint);
        let triangles = mesh.triangles.iter();
        self.triangles.extend(triangles.map(|corners| corners.map(|v| v.saturating_add(base as u32))));
        self.groups.push(Group { name: mesh.name, triangles: from..self.triangles.len() });
        Ok(())
    }

    fn finish(self, times_secs: &[f64]) -> Result<Character, String> {
        let Self { joints, positions, triangles, joint_of, deltas, groups } = self;
        // The clip begins with the first sample.
        let start = times_secs.first().copied().unwrap_or(0.0);
        let times: Vec<f64> = times_secs.iter().map(|time| time - start).collect();
        let mut tracks = Vec::new();
        for (joint, Fitted { motion, .. }) in joints.iter().enumerate().filter(|_| times.len() > 1) {
            let moves = motion.iter().any(|own| *own != motion[0]);
            let (turns, shifts) = motion.iter().copied().unzip();
            for values in [Values::Rotation(turns), Values::Translation(shifts)] {
                let times = times.clone();
                if moves {
                    tracks.push(Track { joint, times, interpolation: Interpolation::Linear, values });
                }
            }
        }
        let mut shapes = Vec::new();
        for (sample, deltas) in deltas.into_iter().enumerate().filter(|(_, deltas)| !deltas.is_empty()) {
            let around = sample.saturating_sub(1)..(sample + 2).min(times.len());
            let weights = around.clone().map(|k| f64::from(u8::from(k == sample))).collect();
            tracks.push(Track {
                joint: 0,
                times: times[around].to_vec(),
                interpolation: Interpolation::Linear,
                values: Values::Shapes { first: shapes.len(), count: 1, weights },
            });
            shapes.push(BlendShape { name: format!("frame {sample}"), deltas, rest_weight: 0.0 });
        }
        for track in &mut tracks {
            track.check().map_err(|error| format!("the animation cannot be played: {error}"))?;
        }
        let middle = |joint: &Fitted| joint.motion[0].1;
        let bone = |(joint, own)| Bone { joint, inverse_bind: DAffine3::from_translation(-middle(own)) };
        let bones = joints.iter().enumerate().map(bone).collect();
        let (skin, _) = Skin::new(bones, joint_of.into_iter().map(|joint| vec![(joint, 1.0)]).collect());
        let joints = joints.into_iter().map(|own| {
            let rest = Transform { translation: middle(&own), ..Transform::IDENTITY };
            Joint { name: own.name, parent: None, rest }
        });
        let skeleton = Skeleton::new(joints.collect()).map_err(|error| error.to_string())?;
        let bound = TriMesh::new(positions, triangles).map_err(|error| error.to_string())?;
        let clips = if tracks.is_empty() { Vec::new() } else { vec![Clip { name: CLIP.to_owned(), tracks }] };
        Character::new(CharacterParts { skeleton, bound, skin, shapes, groups, clips })
            .map_err(|error| error.to_string())
    }
}

/// What the rigid motion `now` of the vertices `from`, whose joint is at `middle` at first, lacks
/// to `to`, in the space of `from`.
fn remainders<'a>(
    from: &'a [Vec3],
    to: &'a [Vec3],
    middle: DVec3,
    now: &(DQuat, DVec3),
) -> impl Iterator<Item = Vec3> + 'a {
    let (back, shift) = (DMat3::from_quat(now.0.inverse()), now.1);
    let lacks = move |from: &Vec3, to: &Vec3| back * (to.as_dvec3() - shift) - (from.as_dvec3() - middle);
    from.iter().zip(to).map(move |(from, to)| lacks(from, to).as_vec3())
}

/// The rigid motions that take `first` nearest to each of `samples`.
fn fit(first: &[Vec3], samples: impl Iterator<Item = Vec<Vec3>>) -> Motion {
    let middle = |own: &[Vec3]| own.iter().map(|p| p.as_dvec3()).sum::<DVec3>() / own.len() as f64;
    let from = middle(first);
    let mut turn = DQuat::IDENTITY;
    let motion = samples.map(|own| {
        if own == first {
            turn = DQuat::IDENTITY;
            return (turn, from);
        }
        let to = middle(&own);
        let mut product = DMat3::ZERO;
        for (a, b) in own.iter().zip(first) {
            let (a, b) = (a.as_dvec3() - to, b.as_dvec3() - from);
            product += DMat3::from_cols(a * b.x, a * b.y, a * b.z);
        }
        turn = rotation_of(&product, turn);
        (turn, to)
    });
    motion.collect()
}

/// The rotation nearest to `product`, found from `turn`.
fn rotation_of(product: &DMat3, mut turn: DQuat) -> DQuat {
    for _ in 0..TURNS {
        let own = DMat3::from_quat(turn);
        let axes = [(own.x_axis, product.x_axis), (own.y_axis, product.y_axis), (own.z_axis, product.z_axis)];
        let along: f64 = axes.iter().map(|(a, b)| a.dot(*b)).sum();
        let by = axes.iter().map(|(a, b)| a.cross(*b)).sum::<DVec3>() / (along.abs() + f64::MIN_POSITIVE);
        let angle = by.length();
        if angle <= 1e-14 || angle.is_nan() {
            break;
        }
        turn = (DQuat::from_axis_angle(by / angle, angle) * turn).normalize();
    }
    turn
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ball() -> Vec<Vec3> {
        let point = |i: u16| {
            let i = f32::from(i);
            Vec3::new(i.sin() * 0.1, 1.6 + (1.7 * i).cos() * 0.12, (0.6 * i).sin() * 0.09)
        };
        (0..60).map(point).collect()
    }

    fn mesh(name: &str, samples: Vec<Vec<Vec3>>) -> MovingMesh {
        let triangles = (0..58).map(|k| [k, k + 1, k + 2]).collect();
        let mut mesh = MovingMesh { name: name.to_owned(), triangles, samples: Vec::new() };
        for own in samples {
            mesh.push(own, DAffine3::IDENTITY);
        }
        mesh
    }

    fn posed(character: &Character, secs: f64) -> Vec<Vec3> {
        let mut locals = character.skeleton().rest();
        let mut weights: Vec<f64> = character.shapes().iter().map(|shape| shape.rest_weight).collect();
        if let Some(clip) = character.clips().first() {
            clip.sample(secs, &mut locals, &mut weights);
        }
        let (mut globals, mut pose, mut out) = (Vec::new(), Default::default(), Vec::new());
        character.skeleton().globals(&locals, &mut globals);
        character.pose(&globals, &weights, Default::default(), &mut pose);
        character.deform(&pose, &mut out);
        out
    }

    fn farthest(a: &[Vec3], b: &[Vec3]) -> f32 {
        assert_eq!(a.len(), b.len());
        a.iter().zip(b).map(|(a, b)| a.distance(*b)).fold(0.0, f32::max)
    }

    /// Two meshes that turn together, by up to 170 degrees: one joint, no shapes, and a turn about
    /// the centroid between two samples.
    #[test]
    fn what_only_turns_has_one_joint_and_no_shapes() {
        let turned = |by: f64| -> Vec<Vec3> {
            let turn = DQuat::from_rotation_y(by) * DQuat::from_rotation_x(0.3 * by);
            let move_ = |p: Vec3| (turn * p.as_dvec3() + DVec3::new(by, 0.0, 0.2)).as_vec3();
            ball().into_iter().map(move_).collect()
        };
        let samples: Vec<_> = [0.0, 1.0, 2.0, 2.9].map(turned).into();
        let times = [5.0, 5.5, 6.0, 6.5];
        let own =
            character(vec![mesh("head", samples.clone()), mesh("eyes", samples.clone())], &times).unwrap();
        assert_eq!((own.skeleton().joints().len(), own.shapes().len()), (1, 0));
        assert_eq!(own.groups().iter().map(|g| g.name.as_str()).collect::<Vec<_>>(), ["head", "eyes"]);
        for (secs, expected) in [(0.0, &samples[0]), (0.5, &samples[1]), (1.5, &samples[3])] {
            assert!(farthest(&posed(&own, secs)[..60], expected) < 2e-6, "{secs}");
        }
        let middle = posed(&own, 1.25);
        let centroid = |own: &[Vec3]| own.iter().sum::<Vec3>() / own.len() as f32;
        let expected = 0.5 * (centroid(&samples[2]) + centroid(&samples[3]));
        assert!(centroid(&middle[..60]).distance(expected) < 2e-6);
        let lengths = |own: &[Vec3]| own.windows(2).map(|pair| pair[0].distance(pair[1])).collect::<Vec<_>>();
        for (a, b) in lengths(&middle[..60]).iter().zip(lengths(&samples[0])) {
            assert!((a - b).abs() < 2e-6, "{a} {b}");
        }
    }

    /// A mesh that bends while it turns is where the file says, at each sample.
    #[test]
    fn what_bends_is_exact_at_each_sample() {
        let bent = |k: u8| -> Vec<Vec3> {
            let turn = DQuat::from_rotation_z(0.4 * f64::from(k));
            let bend = |p: Vec3| p + 0.02 * f32::from(k) * Vec3::new(0.0, (9.0 * p.x).sin(), p.z);
            ball().into_iter().map(|p| (turn * bend(p).as_dvec3()).as_vec3()).collect()
        };
        let samples: Vec<_> = (0..5).map(bent).collect();
        let times: Vec<f64> = (0..5u8).map(|k| f64::from(k) / 24.0).collect();
        let still = vec![ball(); 5];
        let own = character(vec![mesh("a", samples.clone()), mesh("still", still)], &times).unwrap();
        assert_eq!((own.skeleton().joints().len(), own.shapes().len()), (2, 4));
        for (sample, time) in samples.iter().zip(times) {
            let found = posed(&own, time);
            assert!(farthest(&found[..60], sample) < 1e-6, "{time}");
            assert!(farthest(&found[60..], &ball()) < 1e-6, "{time}");
        }
    }

    #[test]
    fn broken_meshes_are_refused() {
        let words = |samples: Vec<Vec<Vec3>>| character(vec![mesh("m", samples)], &[0.0, 1.0]).unwrap_err();
        assert!(words(vec![ball(), vec![Vec3::ZERO; 3]]).contains("60 vertices at first and 3 in frame 1"));
        let mut broken = ball();
        broken[7].y = f32::NAN;
        assert!(words(vec![ball(), broken]).contains("vertex 7 of the mesh `m` is not finite in frame 1"));
        // A corner must not reach the vertices of the next mesh.
        let mut wrong = mesh("m", vec![ball()]);
        wrong.triangles[3][1] = 60;
        let next = mesh("n", vec![ball()]);
        let error = character(vec![wrong, next], &[0.0]).unwrap_err();
        assert!(error.contains("`m` has 60 vertices, but a corner at vertex 60"), "{error}");
        assert!(character(Vec::new(), &[]).is_err());
    }

    #[test]
    fn polygons_become_fans() {
        let mut mesh = MovingMesh::default();
        assert_eq!(mesh.add_polygons(&[4], &[0, 1, 2, 3], false), Ok(0));
        assert_eq!(mesh.add_polygons(&[4, 2], &[4i64, 5, 5, 6, 1, 2], true), Ok(1));
        assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3], [4, 6, 5]]);
        assert!(mesh.add_polygons(&[3], &[0, 1], false).is_err());
        assert!(mesh.add_polygons(&[-1], &[0, 1], false).is_err());
        assert!(mesh.add_polygons(&[3], &[0, 1, -1], false).is_err());
    }
}
