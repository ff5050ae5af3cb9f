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
//! Samples are taken one after the other and not kept: what stays is the motion, and the remainder
//! where it is more than rounding. Each mesh has its own times. Meshes that move as one, at the
//! same times, share a joint. [`Room`] bounds the memory by the size of the file.
//!
//! # Limitations
//! A mesh that its transform stretches takes a blend shape a sample, as one that bends does.

mod rigid;
mod room;

use std::rc::Rc;

use forelock_core::body::TriMesh;
use forelock_core::body::character::{
    BlendShape, Bone, Character, CharacterParts, Clip, Group, Interpolation, Joint, Skeleton, Skin, Track,
    Transform, Values,
};
use glam::{DAffine3, DQuat, Vec3};

use rigid::{Placement, fit, middle, remainders};
pub(crate) use room::Room;

/// The name of the clip.
pub(crate) const CLIP: &str = "animation";
/// Bytes that a sample of a mesh takes: its placement, and its keys in the clip.
const SAMPLE_BYTES: usize = size_of::<Placement>() + 72;
/// Bytes that a vertex takes: at rest, bound and with its joint.
const VERTEX_BYTES: usize = 80;
/// Bytes that a blend shape takes, without its vertices, and its track.
const SHAPE_BYTES: usize = 256;
/// A remainder below this share of the largest coordinate is a rounding error.
const ROUNDING: f32 = 1e-6;

/// What to say of triangles that are left out, if there are any.
pub(crate) fn left_out(triangles: usize) -> Option<String> {
    (triangles > 0).then(|| format!("{triangles} triangles with a repeated corner are left out"))
}

/// The order of the corners of polygons.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Order {
    /// Whether they are clockwise as seen from outside.
    pub is_clockwise: bool,
    /// Whether the first corner, around which programs cut a polygon into triangles, is the last
    /// one in the file.
    pub is_backwards: bool,
}

/// A joint, and when it is where.
struct Moved {
    name: String,
    times: Rc<[f64]>,
    motion: Vec<Placement>,
}

/// The remainders of all meshes that have the same times, at each of them.
struct Bent {
    times: Rc<[f64]>,
    deltas: Vec<Vec<(u32, Vec3)>>,
}

/// The meshes of a file, which become a character.
pub(crate) struct Meshes {
    room: Room,
    joints: Vec<Moved>,
    bent: Vec<Bent>,
    positions: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
    /// The joint of each vertex.
    joint_of: Vec<usize>,
    groups: Vec<Group>,
}

/// A mesh while its samples are taken.
pub(crate) struct MovingMesh<'a> {
    all: &'a mut Meshes,
    name: String,
    times: Rc<[f64]>,
    triangles: Vec<[u32; 3]>,
    /// The vertices of the first sample and of this one, in the space of the file.
    first: Vec<Vec3>,
    now: Vec<Vec3>,
    motion: Vec<Placement>,
    /// The joints that this mesh has followed so far.
    followed: Vec<usize>,
    /// The remainders of each sample.
    deltas: Vec<Vec<(u32, Vec3)>>,
}

impl Meshes {
    /// None yet.
    pub fn new(room: Room) -> Self {
        Self {
            room,
            joints: Vec::new(),
            bent: Vec::new(),
            positions: Vec::new(),
            triangles: Vec::new(),
            joint_of: Vec::new(),
            groups: Vec::new(),
        }
    }

    /// Counts `bytes` that the meshes take.
    ///
    /// # Errors
    /// As [`Room::take`].
    pub fn take(&mut self, bytes: usize) -> Result<(), String> {
        self.room.take(bytes)
    }

    /// The next mesh, with samples at `times_secs`, which ascend: one at least.
    pub fn begin(&mut self, name: String, times_secs: &[f64]) -> MovingMesh<'_> {
        // Meshes of the same times share them.
        let same = self.joints.iter().map(|joint| &joint.times).find(|times| ***times == *times_secs);
        let times = same.map_or_else(|| times_secs.into(), Rc::clone);
        let followed = (0..self.joints.len()).filter(|&own| Rc::ptr_eq(&self.joints[own].times, &times));
        let followed = followed.collect();
        MovingMesh {
            all: self,
            name,
            times,
            triangles: Vec::new(),
            first: Vec::new(),
            now: Vec::new(),
            motion: Vec::new(),
            followed,
            deltas: Vec::new(),
        }
    }
}

impl MovingMesh<'_> {
    /// Takes the next sample: `vertices`, and their transform to the space of the file.
    ///
    /// # Errors
    /// What is wrong, in one sentence.
    pub fn push(&mut self, vertices: &[Vec3], world: &DAffine3) -> Result<(), String> {
        let (name, sample) = (&self.name, self.motion.len());
        if sample > 0 && self.first.is_empty() {
            return Ok(());
        }
        self.all.room.take(SAMPLE_BYTES)?;
        self.now.clear();
        if *world == DAffine3::IDENTITY {
            self.now.extend_from_slice(vertices);
        } else {
            let placed = vertices.iter().map(|p| world.transform_point3(p.as_dvec3()).as_vec3());
            self.now.extend(placed);
        }
        if let Some(vertex) = self.now.iter().position(|p| !p.is_finite()) {
            return Err(format!("vertex {vertex} of the mesh `{name}` is not finite in frame {sample}"));
        }
        if sample == 0 {
            self.all.room.take(VERTEX_BYTES.saturating_mul(vertices.len()))?;
            self.first = std::mem::take(&mut self.now);
            self.motion = Vec::with_capacity(self.times.len());
            self.motion.push((DQuat::IDENTITY, middle(&self.first)));
            self.deltas.push(Vec::new());
            return Ok(());
        }
        if self.now.len() != self.first.len() {
            let (before, now) = (self.first.len(), self.now.len());
            return Err(format!(
                "the mesh `{name}` has {before} vertices at first and {now} in frame {sample}; bodies \
                 whose vertices change in number cannot be read"
            ));
        }
        let (first, now) = (&self.first, &self.now);
        let most = |own: &[Vec3]| own.iter().fold(0.0f32, |most, p| most.max(p.abs().max_element()));
        let rounding = ROUNDING * most(first).max(most(now));
        let joints = &self.all.joints;
        self.followed.retain(|&joint| {
            let motion = &joints[joint].motion;
            let mut rest = remainders(first, now, motion[0].1, &motion[sample]);
            rest.all(|d| d.length() <= rounding)
        });
        let (turn, from) = (self.motion[sample - 1].0, self.motion[0].1);
        let own = fit(first, from, now, turn);
        let is_bent = |(d, _): &(Vec3, u32)| d.length() > rounding;
        let bent = || remainders(first, now, from, &own).zip(0..).filter(is_bent);
        let count = if self.followed.is_empty() { bent().count() } else { 0 };
        self.all.room.take(count * size_of::<(u32, Vec3)>())?;
        let mut deltas = Vec::with_capacity(count);
        if count > 0 {
            deltas.extend(bent().map(|(d, vertex)| (vertex, d)));
        }
        self.motion.push(own);
        self.deltas.push(deltas);
        Ok(())
    }

    /// Adds polygons of so many corners each, `counts`, whose vertices are `corners` in this
    /// `order`, as fans. Returns the number of triangles that are left out because a corner is
    /// repeated.
    ///
    /// # Errors
    /// What is wrong, in one sentence.
    pub fn add_polygons<T>(&mut self, counts: &[T], corners: &[T], order: Order) -> Result<usize, String>
    where
        T: Copy + TryInto<u32> + TryInto<usize>,
    {
        let wide = counts.iter().filter_map(|&count| TryInto::<usize>::try_into(count).ok());
        let fans = wide.fold(0usize, |sum, count| sum.saturating_add(count.saturating_sub(2)));
        let fans = fans.min(corners.len());
        // At rest and bound, beside those here.
        self.all.room.take(fans.saturating_mul(3 * size_of::<[u32; 3]>()))?;
        self.triangles.reserve_exact(fans);
        let name = &self.name;
        let fail = |words: &str| format!("the mesh `{name}` {words}");
        let (mut left_out, mut rest) = (0, corners);
        for &count in counts {
            let split = TryInto::<usize>::try_into(count).ok().and_then(|n| rest.split_at_checked(n));
            let (own, others) = split.ok_or_else(|| fail("has polygons with more corners than it has"))?;
            let own: Result<Vec<u32>, _> = own.iter().map(|&corner| corner.try_into()).collect();
            let mut own = own.map_err(|_| fail("has a corner that is no vertex"))?;
            if order.is_backwards && !own.is_empty() {
                own.rotate_right(1);
            }
            for k in 2..own.len() {
                let [a, b, c] = [own[0], own[k - 1], own[k]];
                if a == b || b == c || c == a {
                    left_out += 1;
                } else {
                    self.triangles.push(if order.is_clockwise { [a, c, b] } else { [a, b, c] });
                }
            }
            rest = others;
        }
        Ok(left_out)
    }

    /// Appends the mesh to the others.
    ///
    /// # Errors
    /// What is wrong, in one sentence.
    pub fn finish(self) -> Result<(), String> {
        let Self { all, name, times, triangles, first, motion, followed, deltas, .. } = self;
        let vertices = first.len();
        if vertices == 0 {
            return Ok(());
        }
        if let Some(corner) = triangles.iter().flatten().find(|&&corner| corner as usize >= vertices) {
            return Err(format!(
                "the mesh `{name}` has {vertices} vertices, but a corner at vertex {corner}"
            ));
        }
        let base = all.positions.len();
        if base + vertices > u32::MAX as usize {
            return Err("the meshes have over 2³² vertices".to_owned());
        }
        let joint = followed.first().copied().unwrap_or(all.joints.len());
        if followed.is_empty() {
            all.joints.push(Moved { name: name.clone(), times: Rc::clone(&times), motion });
            all.add_deltas(times, deltas, base as u32)?;
        } else {
            // The joint that it follows has its motion, and its times.
            all.room.give_back(SAMPLE_BYTES * motion.len() + size_of_val(&*times));
        }
        let from = all.triangles.len();
        all.positions.extend(first);
        all.joint_of.resize(all.positions.len(), joint);
        // Corners are below the number of vertices, which is below 2³² in all.
        all.triangles.extend(triangles.iter().map(|corners| corners.map(|v| v.saturating_add(base as u32))));
        all.groups.push(Group { name, triangles: from..all.triangles.len() });
        Ok(())
    }
}

impl Meshes {
    /// Appends the remainders at each of `times` of a mesh whose first vertex is `base`.
    fn add_deltas(
        &mut self,
        times: Rc<[f64]>,
        deltas: Vec<Vec<(u32, Vec3)>>,
        base: u32,
    ) -> Result<(), String> {
        if deltas.iter().all(Vec::is_empty) {
            return Ok(());
        }
        let known = self.bent.iter().position(|bent| Rc::ptr_eq(&bent.times, &times));
        let known = known.unwrap_or_else(|| {
            self.bent.push(Bent { deltas: vec![Vec::new(); times.len()], times });
            self.bent.len() - 1
        });
        for (all, own) in self.bent[known].deltas.iter_mut().zip(deltas) {
            if all.is_empty() && !own.is_empty() {
                self.room.take(SHAPE_BYTES)?;
            }
            let moved = own.into_iter().map(|(vertex, d)| (vertex.saturating_add(base), d));
            if all.is_empty() { *all = moved.collect() } else { all.extend(moved) }
        }
        Ok(())
    }

    /// The character that the meshes are. Its clip begins with the first of the samples of meshes
    /// that have several.
    ///
    /// # Errors
    /// What is wrong, in one sentence.
    pub fn finish(self) -> Result<Character, String> {
        let Self { joints, bent, positions, triangles, joint_of, groups, .. } = self;
        let starts = joints.iter().filter(|joint| joint.times.len() > 1).map(|joint| joint.times[0]);
        let start = starts.min_by(f64::total_cmp).unwrap_or(0.0);
        let since = |times: &[f64]| times.iter().map(|time| time - start).collect::<Vec<f64>>();
        let mut tracks = Vec::new();
        for (joint, Moved { motion, times, .. }) in joints.iter().enumerate() {
            if motion.iter().all(|own| *own == motion[0]) {
                continue;
            }
            let (turns, shifts) = motion.iter().copied().unzip();
            for values in [Values::Rotation(turns), Values::Translation(shifts)] {
                let times = since(times);
                tracks.push(Track { joint, times, interpolation: Interpolation::Linear, values });
            }
        }
        let mut shapes = Vec::new();
        for Bent { times, deltas } in bent {
            let times = since(&times);
            let bent = deltas.into_iter().enumerate().filter(|(_, deltas)| !deltas.is_empty());
            for (sample, deltas) in bent {
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
        }
        for track in &mut tracks {
            track.check().map_err(|error| format!("the animation cannot be played: {error}"))?;
        }
        let middle = |joint: &Moved| joint.motion[0].1;
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

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    fn ball() -> Vec<Vec3> {
        let point = |i: u16| {
            let i = f32::from(i);
            Vec3::new(i.sin() * 0.1, 1.6 + (1.7 * i).cos() * 0.12, (0.6 * i).sin() * 0.09)
        };
        (0..60).map(point).collect()
    }

    const ROOM: u64 = 1 << 20;

    /// Adds a mesh whose samples are at `times`.
    fn add(all: &mut Meshes, name: &str, samples: &[Vec<Vec3>], times: &[f64]) -> Result<(), String> {
        let mut mesh = all.begin(name.to_owned(), times);
        mesh.triangles = (0..58).map(|k| [k, k + 1, k + 2]).collect();
        for own in samples {
            mesh.push(own, &DAffine3::IDENTITY)?;
        }
        mesh.finish()
    }

    fn character(meshes: &[(&str, &[Vec<Vec3>])], times: &[f64]) -> Result<Character, String> {
        let mut all = Meshes::new(Room::new(ROOM, 1));
        for (name, samples) in meshes {
            add(&mut all, name, samples, times)?;
        }
        all.finish()
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
        let own = character(&[("head", &samples), ("eyes", &samples)], &times).unwrap();
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
        let own = character(&[("a", &samples), ("still", &still)], &times).unwrap();
        assert_eq!((own.skeleton().joints().len(), own.shapes().len()), (2, 4));
        for (sample, time) in samples.iter().zip(times) {
            let found = posed(&own, time);
            assert!(farthest(&found[..60], sample) < 1e-6, "{time}");
            assert!(farthest(&found[60..], &ball()) < 1e-6, "{time}");
        }
    }

    /// Meshes keep their own times; the clip begins with the first sample of what moves.
    #[test]
    fn meshes_have_their_own_times() {
        let at = |x: f32| -> Vec<Vec3> { ball().into_iter().map(|p| p + Vec3::X * x).collect() };
        let mut all = Meshes::new(Room::new(ROOM, 1));
        add(&mut all, "still", &[ball()], &[0.0]).unwrap();
        add(&mut all, "a", &[at(0.0), at(1.0)], &[5.0, 7.0]).unwrap();
        add(&mut all, "b", &[at(0.0), at(1.0), at(0.0)], &[6.0, 6.5, 8.0]).unwrap();
        let own = all.finish().unwrap();
        assert_eq!((own.skeleton().joints().len(), own.shapes().len()), (3, 0));
        for (secs, a, b) in [(0.0, 0.0, 0.0), (1.0, 0.5, 0.0), (1.5, 0.75, 1.0), (3.0, 1.0, 0.0)] {
            let found = posed(&own, secs);
            assert!(farthest(&found[..60], &ball()) < 2e-6, "{secs}");
            assert!(farthest(&found[60..120], &at(a)) < 2e-6, "{secs}");
            assert!(farthest(&found[120..], &at(b)) < 2e-6, "{secs}");
        }
    }

    /// Samples that take too much for the file, though it stores their points once.
    #[test]
    fn the_memory_of_samples_is_bounded() {
        let mut all = Meshes::new(Room::new(ROOM, 1));
        let times: Vec<f64> = (0..20_000u16).map(f64::from).collect();
        let mut mesh = all.begin("m".to_owned(), &times);
        let stretched = |k: usize| DAffine3::from_scale(DVec3::new(1.0 + k as f64, 1.0, 1.0));
        let done = (0..times.len()).try_for_each(|k| mesh.push(&ball(), &stretched(k)));
        assert!(done.unwrap_err().contains("over 1 times the bytes of the file"));
        // A shift takes no memory for points, and meshes that follow the first none for the shift:
        // each takes 2.7 MB of the 17.
        let mut all = Meshes::new(Room::new(ROOM, 1));
        for _ in 0..12 {
            let mut mesh = all.begin("m".to_owned(), &times);
            let shift = |k: usize| DAffine3::from_translation(DVec3::X * k as f64);
            (0..times.len()).for_each(|k| mesh.push(&ball()[..4], &shift(k)).unwrap());
            mesh.finish().unwrap();
        }
        assert_eq!(all.joints.len(), 1);
    }

    #[test]
    fn broken_meshes_are_refused() {
        let words = |samples: &[Vec<Vec3>]| character(&[("m", samples)], &[0.0, 1.0]).unwrap_err();
        assert!(words(&[ball(), vec![Vec3::ZERO; 3]]).contains("60 vertices at first and 3 in frame 1"));
        let mut broken = ball();
        broken[7].y = f32::NAN;
        assert!(words(&[ball(), broken]).contains("vertex 7 of the mesh `m` is not finite in frame 1"));
        // A corner must not reach the vertices of the next mesh.
        let mut all = Meshes::new(Room::new(ROOM, 1));
        let mut wrong = all.begin("m".to_owned(), &[0.0]);
        wrong.triangles = vec![[0, 60, 1]];
        wrong.push(&ball(), &DAffine3::IDENTITY).unwrap();
        let error = wrong.finish().unwrap_err();
        assert!(error.contains("`m` has 60 vertices, but a corner at vertex 60"), "{error}");
        assert!(character(&[], &[]).is_err());
    }

    #[test]
    fn polygons_become_fans() {
        let mut all = Meshes::new(Room::new(ROOM, 1));
        let mut mesh = all.begin("m".to_owned(), &[0.0]);
        let plain = Order::default();
        let clockwise = Order { is_clockwise: true, ..plain };
        assert_eq!(mesh.add_polygons(&[4], &[0, 1, 2, 3], plain), Ok(0));
        assert_eq!(mesh.add_polygons(&[4, 2], &[4i64, 5, 5, 6, 1, 2], clockwise), Ok(1));
        assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3], [4, 6, 5]]);
        mesh.triangles.clear();
        // The same polygon, from its last corner to the first.
        let order = Order { is_clockwise: true, is_backwards: true };
        assert_eq!(mesh.add_polygons(&[4, 0], &[3, 2, 1, 0], order), Ok(0));
        assert_eq!(mesh.triangles, [[0, 2, 3], [0, 1, 2]]);
        assert!(mesh.add_polygons(&[3], &[0, 1], plain).is_err());
        assert!(mesh.add_polygons(&[-1], &[0, 1], plain).is_err());
        assert!(mesh.add_polygons(&[3], &[0, 1, -1], plain).is_err());
    }
}
