//! Roots on a surface that bends: a rigid motion a strand.
//!
//! # Theory
//! A triangle's rotation takes its frame at rest, of its normal and an edge, to that of the bent
//! mesh, and turns in its plane by the rotation of the polar decomposition of its deformation. A
//! vertex has the mean rotation of the triangles around it, weighted by their areas at rest, and a
//! root that of the corners of its triangle, weighted by its barycentric coordinates: rotations are
//! continuous across edges. Quaternions are summed with the signs nearest to the first. The root
//! itself moves with the point of the triangle that it is bound to, and keeps its offset from it in
//! the rotated frame.
//!
//! Triangles that are next to degenerate at rest, or that collapse when the mesh bends, so that
//! rounding decides where they face, have no rotation and do not count. A
//! vertex without others has the mean of its neighbours that have one, and none at all the
//! identity.

use glam::{DMat3, DQuat, DVec3, Quat, Vec3};
use rayon::prelude::*;

use super::RootBinding;
use crate::body::TriMesh;

/// WGSL of the motions of roots at two poses.
pub const SURFACE_WGSL: &str = include_str!("surface.wgsl");
/// The same as [`SurfaceRoots::frames`] on a GPU, after the quaternions of `frame::ROOTS_WGSL` and
/// [`SURFACE_WGSL`].
pub const ROOT_FRAMES_WGSL: &str = include_str!("root_frames.wgsl");
/// Sine of a triangle's corner below which it has no frame.
pub const FLAT_TRIANGLE: f64 = 1e-6;
/// A triangle has no rotation if the longer of the two edges from its first corner shrinks to less
/// than this share of its rest length, or its area to less than this share of what the edge's
/// stretch squared would make of it.
pub const COLLAPSED_TRIANGLE: f64 = 1e-3;

/// The rigid motion of each strand from rest: x ↦ x₀ + d + R (x − x₀), with its root x₀ at rest.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RootFrames {
    /// R, a unit quaternion, `[S]`.
    pub rotations: Vec<Quat>,
    /// d, metres, `[S]`.
    pub shifts: Vec<Vec3>,
}

impl RootFrames {
    /// `count` strands that do not move.
    pub fn identity(count: usize) -> Self {
        Self { rotations: vec![Quat::IDENTITY; count], shifts: vec![Vec3::ZERO; count] }
    }

    /// Number of strands.
    pub fn len(&self) -> usize {
        self.rotations.len()
    }

    /// Whether there are no strands.
    pub fn is_empty(&self) -> bool {
        self.rotations.is_empty()
    }

    /// Where strand `strand` with its root at `root` takes the point `x`, metres.
    ///
    /// # Panics
    /// If there is no such strand.
    pub fn transform_point(&self, strand: usize, root: DVec3, x: DVec3) -> DVec3 {
        root + self.shifts[strand].as_dvec3() + self.rotations[strand].as_dquat() * (x - root)
    }
}

/// Roots bound to a mesh, and that mesh at rest.
#[derive(Clone, Debug)]
pub struct SurfaceRoots {
    /// Where the lists of `fans` begin: one for each corner of a root's triangle, and the end.
    fan_starts: Vec<u32>,
    /// For each corner the triangles around it, by their numbers in `triangles`.
    fans: Vec<u32>,
    /// Their corners, in the mesh.
    triangles: Vec<[u32; 3]>,
    /// Each at rest.
    rest: Vec<Option<Corner>>,
    /// Neighbours of each corner that are corners themselves.
    neighbours: Vec<Vec<u32>>,
    roots: Vec<SurfaceRoot>,
}

/// A root on its triangle.
#[derive(Clone, Copy, Debug)]
pub struct SurfaceRoot {
    /// The triangle's corners, by their numbers in the mesh.
    pub corners: [u32; 3],
    /// The same, by their numbers among the corners of all roots' triangles.
    pub own: [u32; 3],
    /// The point that it is bound to.
    pub barycentric: [f32; 3],
    /// The point on the triangle at rest.
    foot: DVec3,
    /// The root at rest, from that point, metres.
    pub offset: DVec3,
}

/// Buffers of [`SurfaceRoots::frames`].
#[derive(Clone, Debug, Default)]
pub struct FrameBuffers {
    turns: Vec<(DQuat, f64)>,
    of_vertices: Vec<Option<DQuat>>,
}

impl SurfaceRoots {
    /// The `roots` of strands (metres) bound to `mesh` at rest by `bindings`.
    ///
    /// # Panics
    /// If a binding is of another mesh.
    pub fn new(roots: &[Vec3], bindings: &[RootBinding], mesh: &TriMesh) -> Self {
        let mut number = vec![u32::MAX; mesh.positions.len()];
        let mut count = 0;
        for binding in bindings {
            for v in mesh.triangles[binding.triangle as usize] {
                if number[v as usize] == u32::MAX {
                    number[v as usize] = count;
                    count += 1;
                }
            }
        }
        let mut around: Vec<Vec<u32>> = vec![Vec::new(); count as usize];
        let mut neighbours: Vec<Vec<u32>> = vec![Vec::new(); count as usize];
        let mut triangles = Vec::new();
        for &corners in &mesh.triangles {
            let own = corners.map(|v| number[v as usize]);
            if own.iter().all(|&v| v == u32::MAX) {
                continue;
            }
            for v in own.into_iter().filter(|&v| v != u32::MAX) {
                around[v as usize].push(triangles.len() as u32);
                neighbours[v as usize].extend(own.into_iter().filter(|&w| w != u32::MAX && w != v));
            }
            triangles.push(corners);
        }
        for own in &mut neighbours {
            own.sort_unstable();
            own.dedup();
        }
        let mut fan_starts = vec![0];
        for own in &around {
            fan_starts.push(fan_starts[fan_starts.len() - 1] + own.len() as u32);
        }
        let at_rest =
            |corners: &[u32; 3]| Corner::new(corners.map(|v| mesh.positions[v as usize].as_dvec3()));
        let root = |(&root, binding): (&Vec3, &RootBinding)| {
            let corners = mesh.triangles[binding.triangle as usize];
            let foot = point(&mesh.positions, corners, binding.barycentric);
            SurfaceRoot {
                corners,
                own: corners.map(|v| number[v as usize]),
                barycentric: binding.barycentric,
                foot,
                offset: root.as_dvec3() - foot,
            }
        };
        Self {
            rest: triangles.iter().map(at_rest).collect(),
            roots: roots.iter().zip(bindings).map(root).collect(),
            fans: around.into_iter().flatten().collect(),
            fan_starts,
            triangles,
            neighbours,
        }
    }

    /// The roots, a strand each.
    pub fn roots(&self) -> &[SurfaceRoot] {
        &self.roots
    }

    /// The triangles around all corners of the roots' triangles: their corners in the mesh.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// For each corner of the roots' triangles those around it, by their numbers in
    /// [`SurfaceRoots::triangles`], in the order in which they are summed.
    pub fn fans(&self) -> impl ExactSizeIterator<Item = &[u32]> {
        self.fan_starts.windows(2).map(|own| &self.fans[own[0] as usize..own[1] as usize])
    }

    /// For each corner of the roots' triangles its neighbours among the corners.
    pub fn neighbours(&self) -> impl ExactSizeIterator<Item = &[u32]> {
        self.neighbours.iter().map(Vec::as_slice)
    }

    /// The roots' motion to the bent mesh with vertices at `positions`.
    ///
    /// # Panics
    /// If `positions` are fewer than the mesh's vertices.
    pub fn frames(&self, positions: &[Vec3], buffers: &mut FrameBuffers, frames: &mut RootFrames) {
        let FrameBuffers { turns, of_vertices } = buffers;
        let turn = |(corners, rest): (&[u32; 3], &Option<Corner>)| {
            let bent = Corner::new(corners.map(|v| positions[v as usize].as_dvec3()));
            let turn = rest.as_ref().zip(bent).and_then(|(rest, bent)| rest.turn_to(&bent));
            turn.map_or((DQuat::IDENTITY, 0.0), |turn| (turn, rest.map_or(0.0, |rest| rest.area())))
        };
        self.triangles.par_iter().zip(&self.rest).map(turn).collect_into_vec(turns);
        let of_vertex = |vertex: usize| {
            let fan = self.fan_starts[vertex] as usize..self.fan_starts[vertex + 1] as usize;
            mean(self.fans[fan].iter().map(|&triangle| turns[triangle as usize]))
        };
        (0..self.neighbours.len()).into_par_iter().map(of_vertex).collect_into_vec(of_vertices);
        let known = |vertex: u32| {
            of_vertices[vertex as usize].or_else(|| {
                let around = self.neighbours[vertex as usize].iter();
                mean(around.filter_map(|&other| Some((of_vertices[other as usize]?, 1.0))))
            })
        };
        let of_root = |root: &SurfaceRoot| {
            let own = root.own.iter().zip(root.barycentric);
            let turn = mean(own.filter_map(|(&vertex, share)| Some((known(vertex)?, share.into()))));
            let turn = turn.unwrap_or(DQuat::IDENTITY);
            let moved = point(positions, root.corners, root.barycentric) - root.foot;
            (turn.as_quat(), (moved + (turn * root.offset - root.offset)).as_vec3())
        };
        let RootFrames { rotations, shifts } = frames;
        self.roots.par_iter().map(of_root).unzip_into_vecs(rotations, shifts);
    }
}

/// The point of a triangle with `barycentric` coordinates.
fn point(positions: &[Vec3], corners: [u32; 3], barycentric: [f32; 3]) -> DVec3 {
    let corners = corners.map(|v| positions[v as usize].as_dvec3());
    corners.iter().zip(barycentric).map(|(corner, share)| *corner * f64::from(share)).sum()
}

/// A triangle from its first corner.
#[derive(Clone, Copy, Debug)]
struct Corner {
    /// Its first edge, the direction across that in its plane, and its normal.
    frame: DQuat,
    /// Length of the first edge.
    first: f64,
    /// The second edge, along the first and across it.
    second: [f64; 2],
}

impl Corner {
    /// None if the triangle is next to degenerate.
    fn new([a, b, c]: [DVec3; 3]) -> Option<Self> {
        let (edge, other) = (b - a, c - a);
        let normal = edge.cross(other);
        let is_flat = normal.length() <= FLAT_TRIANGLE * edge.length() * other.length();
        if is_flat || !normal.is_finite() {
            return None;
        }
        let (first, along, normal) = (edge.length(), edge.normalize(), normal.normalize());
        let across = normal.cross(along);
        let frame = DQuat::from_mat3(&DMat3::from_cols(along, across, normal));
        Some(Self { frame, first, second: [other.dot(along), other.dot(across)] })
    }

    fn area(&self) -> f64 {
        0.5 * self.first * self.second[1]
    }

    /// The square of the longer of the edges from the first corner.
    fn longest_squared(&self) -> f64 {
        let [along, across] = self.second;
        (self.first * self.first).max(along * along + across * across)
    }

    /// The rotation of the deformation to `bent`, whose gradient in the frames is F. None if the
    /// triangle collapses.
    fn turn_to(&self, bent: &Self) -> Option<DQuat> {
        let grown = bent.longest_squared() / self.longest_squared();
        let is_small = grown < COLLAPSED_TRIANGLE * COLLAPSED_TRIANGLE;
        if is_small || bent.area() < COLLAPSED_TRIANGLE * grown * self.area() {
            return None;
        }
        let stretch = bent.first / self.first;
        let shear = (bent.second[0] - stretch * self.second[0]) / self.second[1];
        // F = [[stretch, shear], [0, trace − stretch]].
        let trace = stretch + bent.second[1] / self.second[1];
        Some(bent.frame * DQuat::from_rotation_z((-shear).atan2(trace)) * self.frame.conjugate())
    }
}

/// The mean of rotations with weights; none if the weights are all zero.
fn mean(mut turns: impl Iterator<Item = (DQuat, f64)>) -> Option<DQuat> {
    let (first, weight) = turns.find(|own| own.1 > 0.0)?;
    let sum = turns.fold(first * weight, |sum, (turn, weight)| {
        sum + turn * if first.dot(turn) < 0.0 { -weight } else { weight }
    });
    Some(if sum.length_squared() > 1e-24 { sum.normalize() } else { first })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Columns of the strip.
    const COLUMNS: u32 = 12;

    /// A strip of squares of 1 cm along x, three wide along z, facing up.
    fn strip() -> TriMesh {
        let at = |i: u32, j: u32| i * 4 + j;
        let positions = (0..=COLUMNS).flat_map(|i| (0..4).map(move |j| (i, j)));
        let positions = positions.map(|(i, j)| Vec3::new(i as f32, 0.0, j as f32) * 0.01).collect();
        let squares = (0..COLUMNS).flat_map(|i| (0..3).map(move |j| (i, j)));
        let triangles = squares.flat_map(|(i, j)| {
            let [a, b, c, d] = [at(i, j), at(i, j + 1), at(i + 1, j + 1), at(i + 1, j)];
            [[a, b, c], [a, c, d]]
        });
        TriMesh::new(positions, triangles.collect()).unwrap()
    }

    /// Where the strip goes when it is bent by `angle` over its length, and by how much it turns.
    fn bent(p: Vec3, angle: f32) -> (Vec3, f32) {
        let (length, turn) = (0.01 * COLUMNS as f32, angle * p.x / (0.01 * COLUMNS as f32));
        let radius = length / angle;
        let (sin, cos) = turn.sin_cos();
        (Vec3::new(radius * sin, radius * (cos - 1.0), p.z), turn)
    }

    /// Roots along the middle of the strip, and their bindings.
    fn roots(mesh: &TriMesh) -> (Vec<Vec3>, SurfaceRoots) {
        let roots: Vec<Vec3> =
            (0..100).map(|i| Vec3::new(0.12 * (i as f32 + 0.5) / 100.0, 0.001, 0.0145)).collect();
        let groom = super::super::Groom::from_strands(roots.iter().map(|&p| [p, p + Vec3::Y])).unwrap();
        let (bindings, _) = super::super::bind_roots(&groom, mesh, &crate::body::ClosedMesh::new(mesh));
        let surface = SurfaceRoots::new(&roots, &bindings, mesh);
        (roots, surface)
    }

    /// How far two rotations are apart: half of the angle between them, radians.
    fn differs(a: Quat, b: Quat) -> f32 {
        (a * b.conjugate()).xyz().length()
    }

    fn frames(surface: &SurfaceRoots, positions: &[Vec3]) -> RootFrames {
        let mut frames = RootFrames::default();
        surface.frames(positions, &mut FrameBuffers::default(), &mut frames);
        frames
    }

    #[test]
    fn a_mesh_at_rest_moves_no_root() {
        let mesh = strip();
        let (roots, surface) = roots(&mesh);
        let frames = frames(&surface, &mesh.positions);
        assert_eq!(frames.len(), roots.len());
        assert!(frames.shifts.iter().all(|d| d.length() < 1e-15));
        assert!(frames.rotations.iter().all(|q| q.w == 1.0 && q.xyz().length() < 1e-15));
    }

    #[test]
    fn a_rigid_motion_moves_all_roots_alike() {
        let mesh = strip();
        let (roots, surface) = roots(&mesh);
        let turn = Quat::from_euler(glam::EulerRot::XYZ, 0.4, -2.0, 1.0);
        let shift = Vec3::new(0.3, 0.1, -0.2);
        let moved: Vec<Vec3> = mesh.positions.iter().map(|&p| turn * p + shift).collect();
        let frames = frames(&surface, &moved);
        for (strand, &root) in roots.iter().enumerate() {
            assert!(differs(frames.rotations[strand], turn) < 1e-6);
            let x = (root + Vec3::new(0.1, 0.2, 0.0)).as_dvec3();
            let expected = turn.as_dquat() * x + shift.as_dvec3();
            assert!(frames.transform_point(strand, root.into(), x).distance(expected) < 2e-6);
        }
    }

    #[test]
    fn roots_follow_a_bend_of_120_degrees_smoothly() {
        let mesh = strip();
        let (roots, surface) = roots(&mesh);
        let angle = 120f32.to_radians();
        for angle in [angle, -angle] {
            let positions: Vec<Vec3> = mesh.positions.iter().map(|&p| bent(p, angle).0).collect();
            let frames = frames(&surface, &positions);
            let turns: Vec<f32> = frames.rotations.iter().map(|q| -2.0 * q.z.atan2(q.w)).collect();
            for (root, &turn) in roots.iter().zip(&turns) {
                // A square turns by 10°: half of one at most, at the ends where there is none
                // beyond.
                assert!((turn - bent(*root, angle).1).abs() < 6f32.to_radians(), "{turn}");
            }
            let steps = turns.windows(2).map(|pair| (pair[1] - pair[0]) * angle.signum());
            // Without an average all of a square's 10° would be in one of its 8 steps.
            assert!(
                steps.clone().all(|step| (-1e-5..0.045).contains(&step)),
                "{:?}",
                steps.collect::<Vec<_>>()
            );
        }
    }

    #[test]
    fn degenerate_triangles_have_the_frames_of_their_neighbours() {
        let mesh = strip();
        let (_, surface) = roots(&mesh);
        let turn = Quat::from_rotation_x(0.7);
        let mut moved: Vec<Vec3> = mesh.positions.iter().map(|&p| turn * p).collect();
        // The sixth column falls onto the seventh, exactly and but for roundings.
        for by in [0.0, 3e-8, -2e-7] {
            for j in 0..4 {
                let noise = by * Vec3::new([1.0, -0.5][j % 2], 0.3 * j as f32, 0.7);
                moved[6 * 4 + j] = moved[7 * 4 + j] + noise;
            }
            let collapsed = frames(&surface, &moved);
            assert!(collapsed.rotations.iter().all(|q| differs(*q, turn) < 3e-5), "{by}");
        }
        // All of it shrinks: to 1 % it keeps its rotation, to a point it has none.
        let shrunk: Vec<Vec3> = mesh.positions.iter().map(|&p| turn * p * 0.01).collect();
        assert!(frames(&surface, &shrunk).rotations.iter().all(|q| differs(*q, turn) < 1e-6));
        let flat = vec![Vec3::X; moved.len()];
        let flat = frames(&surface, &flat);
        assert!(flat.rotations.iter().all(|q| *q == Quat::IDENTITY));
        assert!(flat.shifts.iter().all(|d| d.is_finite()));
    }
}
