//! Depths of particles and of the edges between them inside a mesh.
//!
//! # Theory
//! Depths are exact, against the mesh's triangles. Its distance field only tells which particles
//! need that. A block of cells whose smallest value is above the field's error bound
//! ([`Sdf::error_bound`]) is outside; of the particles in the others, so are those whose sample is
//! above that bound, and those that a node of the field proves to be outside
//! ([`Sdf::lower_bound`]). No other particle counts as outside before its winding number says so.
//!
//! # Practice
//! Most particles take one read of a small table, eight of them at once, and hair that rests on the
//! skin takes a sample and one cell of nodes.
//!
//! Edges are in [`edges`].

mod edges;

use std::ops::Range;

use glam::{DVec3, Mat3, Vec3};

use super::{ClosedMesh, PACKET, Sdf};
use crate::lane::widest;
use crate::pose::Pose;

/// Error of a position in the mesh's space that was computed in float32, metres: ample for solids
/// of some metres.
const ROUNDING_M: f32 = 1e-5;

/// Finds particles inside a mesh.
#[derive(Clone, Debug)]
pub struct Depths<'a> {
    field: &'a Sdf,
    surface: &'a ClosedMesh,
    local_from_world: Pose,
    /// The mesh's axes in world space, as rows.
    axes: Mat3,
    /// The mesh's origin in world space, in two parts: float32, and what is left of float64.
    origin: [Vec3; 2],
}

impl<'a> Depths<'a> {
    /// For a mesh with this `surface` and distance `field`, at the pose `world_from_local`.
    pub fn new(field: &'a Sdf, surface: &'a ClosedMesh, world_from_local: &Pose) -> Self {
        let origin = world_from_local.translation.as_vec3();
        let left: DVec3 = world_from_local.translation - origin.as_dvec3();
        Self {
            field,
            surface,
            local_from_world: world_from_local.inverse(),
            axes: world_from_local.matrix().as_mat3().transpose(),
            origin: [origin, left.as_vec3()],
        }
    }

    /// Appends those of `particles` (ranges of indices into `positions`, which are in metres in
    /// world space) that are inside the mesh to `inside`, with their depths in metres.
    pub fn find(&self, positions: &[Vec3], particles: &[Range<usize>], inside: &mut Vec<(usize, f64)>) {
        let mut near = Vec::new();
        widest(
            #[inline(always)]
            || {
                for range in particles {
                    self.find_near(positions, range.clone(), &mut near);
                }
                self.keep_within_bound(&mut near);
            },
        );
        for Near { particle, .. } in near {
            let p = self.local_from_world.transform_point(positions[particle].as_dvec3());
            let depth = self.surface.depth(p.as_vec3());
            if depth > 0.0 {
                inside.push((particle, depth.into()));
            }
        }
    }

    /// Appends those of `particles` to `near` that are in blocks of cells near the surface.
    #[inline(always)]
    fn find_near(&self, positions: &[Vec3], particles: Range<usize>, near: &mut Vec<Near>) {
        let reach = self.field.error_bound() + ROUNDING_M;
        let Some(positions) = positions.get(..particles.end) else { return };
        for first in particles.step_by(PACKET) {
            let at = self.local(positions, first);
            let mut lanes = 0u32;
            for (k, least) in self.field.least_lanes(at).iter().enumerate() {
                lanes |= u32::from(*least <= reach) << k;
            }
            while lanes != 0 {
                let k = lanes.trailing_zeros() as usize;
                lanes &= lanes - 1;
                if first + k < positions.len() {
                    near.push(Near { particle: first + k, at: [at[0][k], at[1][k], at[2][k]] });
                }
            }
        }
    }

    /// The packet of `positions` from `first` on in the mesh's space; the last one fills it up.
    #[inline(always)]
    fn local(&self, positions: &[Vec3], first: usize) -> [[f32; PACKET]; 3] {
        let rows = [self.axes.row(0), self.axes.row(1), self.axes.row(2)];
        let mut world = [[0.0; PACKET]; 3];
        for k in 0..PACKET {
            let p = positions[(first + k).min(positions.len() - 1)];
            for c in 0..3 {
                world[c][k] = p[c];
            }
        }
        let mut at = [[0.0; PACKET]; 3];
        for k in 0..PACKET {
            let [x, y, z] = [0, 1, 2].map(|c: usize| world[c][k] - self.origin[0][c] - self.origin[1][c]);
            for c in 0..3 {
                at[c][k] = rows[c].x * x + rows[c].y * y + rows[c].z * z;
            }
        }
        at
    }

    /// Keeps the particles of `near` that the field does not prove to be outside.
    #[inline(always)]
    fn keep_within_bound(&self, near: &mut Vec<Near>) {
        let reach = self.field.error_bound() + ROUNDING_M;
        let mut kept = 0;
        for first in (0..near.len()).step_by(PACKET) {
            let mut at = [[0.0; PACKET]; 3];
            for k in 0..PACKET {
                let p = near[(first + k).min(near.len() - 1)].at;
                for c in 0..3 {
                    at[c][k] = p[c];
                }
            }
            let (distances, slopes) = self.field.sample_lanes(at);
            for k in 0..PACKET.min(near.len() - first) {
                let particle = near[first + k];
                let slope = Vec3::new(slopes[0][k], slopes[1][k], slopes[2][k]);
                if distances[k] <= reach
                    && self.field.lower_bound_along(Vec3::from_array(particle.at), slope) <= ROUNDING_M
                {
                    near[kept] = particle;
                    kept += 1;
                }
            }
        }
        near.truncate(kept);
    }
}

/// A particle that may be inside.
#[derive(Clone, Copy, Debug)]
struct Near {
    particle: usize,
    /// Its position in the mesh's space, metres.
    at: [f32; 3],
}
