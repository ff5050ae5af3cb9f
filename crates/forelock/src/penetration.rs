//! How much hair lies inside solids, measured on positions.
//!
//! # Practice
//! Depths are exact: those inside primitives in closed form, those inside meshes against their
//! triangles. The distance grid of a mesh only tells which particles need that, see [`Depths`].
//!
//! # Limitations
//! Edges between particles are not measured. A mesh that changes (`mesh_sequence`) is measured by
//! its grids, since between two meshes of the sequence there are no triangles.

use forelock_core::body::{ClosedMesh, ColliderFrame, Depths, Shape};
use forelock_core::pose::Pose;
use glam::Vec3;
use rayon::prelude::*;
use std::ops::Range;

/// Depth under a surface from which a particle counts as inside, metres.
const INSIDE_M: f64 = 1e-3;

/// Strands that a thread measures at once.
const STRANDS_AT_ONCE: usize = 256;

/// How particles are divided into strands.
#[derive(Clone, Copy, Debug)]
pub struct Layout<'a> {
    /// First particle of each strand, and the number of all particles, `[S + 1]`.
    pub strand_offsets: &'a [u32],
    /// Particles of each strand, from the root, that are fixed to the head.
    pub clamped: u32,
}

/// A solid at the end of its frame.
#[derive(Clone, Copy, Debug)]
pub struct MeasuredSolid<'a> {
    /// Its shape and pose.
    pub frame: ColliderFrame<'a>,
    /// The surface of which its shape is the distance grid, if there is one.
    pub surface: Option<&'a ClosedMesh>,
}

/// A solid in its own space.
enum Local<'a> {
    Mesh(Depths<'a>),
    Other { frame: ColliderFrame<'a>, local_from_world: Pose },
}

impl<'a> Local<'a> {
    fn new(solid: &MeasuredSolid<'a>) -> Self {
        let pose = solid.frame.pose(1.0);
        match (solid.frame.shape, solid.surface) {
            (Shape::Sdf(field), Some(surface)) => Self::Mesh(Depths::new(field, surface, &pose)),
            _ => Self::Other { frame: solid.frame, local_from_world: pose.inverse() },
        }
    }

    /// Appends those of `particles` that are inside to `inside`, with their depths in metres.
    fn find(&self, positions: &[Vec3], particles: &[Range<usize>], inside: &mut Vec<(usize, f64)>) {
        let (frame, local_from_world) = match self {
            Self::Mesh(depths) => return depths.find(positions, particles, inside),
            Self::Other { frame, local_from_world } => (frame, local_from_world),
        };
        for particle in particles.iter().cloned().flatten() {
            let p = local_from_world.transform_point(positions[particle].as_dvec3());
            let found = frame.shape.sample_near(p.to_array(), 0.0).filter(|(distance, _)| *distance < 0.0);
            inside.extend(found.map(|(distance, _)| (particle, -distance)));
        }
    }
}

/// What lies inside solids.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Penetration {
    /// Share of the particles that are more than 1 mm inside a solid. Clamped particles do not
    /// count.
    pub share_inside: f64,
    /// Depth of the deepest particle, metres.
    pub deepest_m: f64,
}

/// Sums over strands.
#[derive(Clone, Copy, Default)]
struct Tally {
    inside: usize,
    all: usize,
    deepest_m: f64,
}

impl Tally {
    fn merge(self, other: Self) -> Self {
        Self {
            inside: self.inside + other.inside,
            all: self.all + other.all,
            deepest_m: self.deepest_m.max(other.deepest_m),
        }
    }
}

impl Penetration {
    /// Measures `positions` (metres, world space) against `solids` at the end of their frame.
    pub fn measure(positions: &[Vec3], layout: Layout<'_>, solids: &[MeasuredSolid<'_>]) -> Self {
        let solids: Vec<_> = solids.iter().map(Local::new).collect();
        let ends = layout.strand_offsets.len().saturating_sub(1);
        let of_strands = |first: usize| {
            let ends = &layout.strand_offsets[first..=(first + STRANDS_AT_ONCE).min(ends)];
            let free = ends.windows(2).map(|ends| {
                let end = (ends[1] as usize).min(positions.len());
                (ends[0] + layout.clamped).min(ends[1]) as usize..end
            });
            let free: Vec<Range<usize>> = free.filter(|range| !range.is_empty()).collect();
            let mut inside = Vec::new();
            for solid in &solids {
                solid.find(positions, &free, &mut inside);
            }
            // A particle may be inside several solids.
            let mut deep: Vec<usize> =
                inside.iter().filter(|(_, depth)| *depth > INSIDE_M).map(|(particle, _)| *particle).collect();
            deep.sort_unstable();
            deep.dedup();
            Tally {
                inside: deep.len(),
                all: free.iter().map(Range::len).sum(),
                deepest_m: inside.iter().map(|(_, depth)| *depth).fold(0.0, f64::max),
            }
        };
        let parts = (0..ends).into_par_iter().step_by(STRANDS_AT_ONCE).map(of_strands);
        let sum = parts.reduce(Tally::default, Tally::merge);
        Self { share_inside: sum.inside as f64 / sum.all.max(1) as f64, deepest_m: sum.deepest_m }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use forelock_core::body::{Head, Sdf};
    use forelock_core::pose::Pose;
    use glam::{DQuat, DVec3};
    use std::sync::Arc;

    /// Points within 5 mm of the head's surface, in strands of eight of which two are clamped.
    fn points(closed: &ClosedMesh) -> Vec<Vec3> {
        let mesh = &Head::builtin().mesh;
        let near = |t: usize| {
            let [a, b, c] = mesh.corners(t);
            let normal = (b - a).cross(c - a).normalize_or_zero();
            (a + b + c) / 3.0 + normal * (((t * 7919) % 1000) as f32 * 1e-5 - 0.005)
        };
        let points: Vec<Vec3> = (0..mesh.triangles.len()).step_by(5).map(near).collect();
        assert!(points.iter().any(|p| closed.contains(*p)));
        points[..points.len() / 8 * 8].to_vec()
    }

    #[test]
    fn depths_are_those_under_the_mesh_whatever_the_field() {
        let closed = ClosedMesh::new(&Head::builtin().mesh);
        let local = points(&closed);
        let world_from_local = Pose::new(DQuat::from_rotation_y(0.7), DVec3::new(0.3, -1.0, 2.0));
        let world: Vec<Vec3> =
            local.iter().map(|p| world_from_local.transform_point(p.as_dvec3()).as_vec3()).collect();
        let strand_offsets: Vec<u32> = (0..=local.len() as u32).step_by(8).collect();
        let layout = Layout { strand_offsets: &strand_offsets, clamped: 2 };
        let depths = local.iter().enumerate().filter(|(i, _)| i % 8 >= 2);
        let depths: Vec<f64> = depths.map(|(_, p)| f64::from(-closed.signed_distance(*p)).max(0.0)).collect();
        let share = depths.iter().filter(|d| **d > INSIDE_M).count() as f64 / depths.len() as f64;
        let deepest = depths.iter().copied().fold(0.0, f64::max);
        assert!(share > 0.2 && deepest > 4e-3, "{share} {deepest}");
        for (nodes, near, is_exact) in [(16, f32::INFINITY, false), (16, 2e-3, true)] {
            let field = Sdf::near(&closed, nodes, 0.02, near).unwrap();
            assert_eq!(field.is_refined(), is_exact);
            let shape = Shape::Sdf(Arc::new(field));
            let frame = ColliderFrame {
                shape: &shape,
                local: Pose::IDENTITY,
                from: Pose::IDENTITY,
                to: world_from_local,
                friction: 0.0,
            };
            let measure = |surface| Penetration::measure(&world, layout, &[MeasuredSolid { frame, surface }]);
            let exact = measure(Some(&closed));
            // The world's positions are rounded to 0.2 µm.
            assert!((exact.share_inside - share).abs() < 2e-3, "{nodes}: {exact:?}, not {share}");
            assert!((exact.deepest_m - deepest).abs() < 1e-6, "{nodes}: {exact:?}, not {deepest}");
            // By a coarse field alone it is another measurement.
            let by_field = measure(None);
            assert!(is_exact || (by_field.share_inside - share).abs() > 0.02, "{by_field:?}");
        }
    }

    #[test]
    fn primitives_are_measured_in_closed_form() {
        let shape = Shape::Sphere { radius: 0.1 };
        let still = Pose::IDENTITY;
        let frame = ColliderFrame { shape: &shape, local: still, from: still, to: still, friction: 0.0 };
        let positions = [0.0, 0.2, 0.097, 0.0995].map(|x| Vec3::new(x, 0.0, 0.0));
        let layout = Layout { strand_offsets: &[0, 4], clamped: 1 };
        let found = Penetration::measure(&positions, layout, &[MeasuredSolid { frame, surface: None }]);
        assert_eq!(found.share_inside, 1.0 / 3.0);
        assert!((found.deepest_m - 3e-3).abs() < 1e-8, "{found:?}");
    }
}
