//! Depths of edges inside a mesh.
//!
//! # Theory
//! A distance is 1-Lipschitz: an edge of length l between points at distances σ₁ + σ₂ > l is
//! outside. Lower bounds of σ come from the field: a sample v is at most the error bound e too
//! large in a brick, and at most √3 times too large in a coarse cell outside
//! ([`Sdf`](crate::body::Sdf)), so σ ≥ min(v − e, v/√3).
//!
//! # Practice
//! Most edges are ruled out by one read of a small table for each particle, others by a sample at
//! each particle, most of the rest by eight samples between them. What is left is cut by the
//! triangles ([`ClosedMesh::segment_depth`](crate::body::ClosedMesh::segment_depth)).

use std::ops::Range;

use glam::Vec3;

use super::{Depths, PACKET, ROUNDING_M};
use crate::lane::widest;

/// Half the diagonal of a cell over its side, with rounding.
const HALF_DIAGONAL: f32 = 0.867;

/// Particles of one range in the mesh's space, reused from range to range.
#[derive(Default)]
struct Local {
    /// Positions, metres.
    at: [Vec<f32>; 3],
    /// Lower bounds of their distances, metres.
    least: Vec<f32>,
}

impl Local {
    fn position(&self, i: usize) -> Vec3 {
        Vec3::new(self.at[0][i], self.at[1][i], self.at[2][i])
    }
}

/// An edge that may be inside.
struct NearEdge {
    /// Its first particle.
    particle: usize,
    /// Its ends in the mesh's space, metres.
    ends: [Vec3; 2],
}

impl Depths<'_> {
    /// Appends the edges that are inside the mesh to `inside`: the first particle of each, and its
    /// greatest depth in metres, up to [`SEGMENT_TOLERANCE_M`](super::super::SEGMENT_TOLERANCE_M).
    /// Edges are those between consecutive particles of each of `ranges` (indices into `positions`,
    /// which are in metres in world space).
    pub fn find_edges(&self, positions: &[Vec3], ranges: &[Range<usize>], inside: &mut Vec<(usize, f64)>) {
        let mut near = Vec::new();
        let mut local = Local::default();
        widest(
            #[inline(always)]
            || {
                for range in ranges.iter().filter(|range| range.len() > 1 && range.end <= positions.len()) {
                    self.enter(positions, range.clone(), &mut local);
                    self.find_near_edges(range.start, &local, &mut near);
                }
            },
        );
        let mut cuts = Vec::new();
        let is_outside = |p: Vec3| self.field.lower_bound(p) > ROUNDING_M;
        for NearEdge { particle, ends: [a, b] } in near {
            let depth = self.surface.depth_between(a, b, &mut cuts, is_outside);
            if depth > 0.0 {
                inside.push((particle, depth.into()));
            }
        }
    }

    /// Brings the particles of `range` into the mesh's space, with lower bounds of their distances.
    #[inline(always)]
    fn enter(&self, positions: &[Vec3], range: Range<usize>, local: &mut Local) {
        let in_block = self.field.cell() * HALF_DIAGONAL + ROUNDING_M;
        let edges = positions[range.clone()].windows(2);
        let longest = edges.map(|edge| edge[0].distance_squared(edge[1])).fold(0.0, f32::max).sqrt();
        local.at.iter_mut().for_each(Vec::clear);
        local.least.clear();
        for first in range.clone().step_by(PACKET) {
            let at = self.local(positions, first);
            let mut least = self.field.least_lanes(at).map(|least| least - in_block);
            // No edge of this range can reach the surface from farther away.
            if least.iter().any(|least| *least <= longest * 0.5) {
                least = self.lower_bounds(at);
            }
            let count = PACKET.min(range.end - first);
            for (all, own) in local.at.iter_mut().zip(&at) {
                all.extend_from_slice(&own[..count]);
            }
            local.least.extend_from_slice(&least[..count]);
        }
    }

    /// Lower bounds of the distances at a packet of points, metres.
    #[inline(always)]
    fn lower_bounds(&self, at: [[f32; PACKET]; 3]) -> [f32; PACKET] {
        let error = self.field.error_bound();
        let (samples, _) = self.field.sample_lanes(at);
        samples.map(|sample| (sample - error).min(sample * (1.0 / 3f32.sqrt())) - ROUNDING_M)
    }

    /// Appends the edges of the range that begins at particle `first` to `near`, but for those that
    /// the field proves to be outside.
    #[inline(always)]
    fn find_near_edges(&self, first: usize, local: &Local, near: &mut Vec<NearEdge>) {
        for i in 0..local.least.len() - 1 {
            let ends = [local.position(i), local.position(i + 1)];
            let along = ends[1] - ends[0];
            let length = along.length();
            if local.least[i] + local.least[i + 1] > length {
                continue;
            }
            // Each sample stands for the part of the edge around it.
            let mut at = [[0.0; PACKET]; 3];
            for (c, row) in at.iter_mut().enumerate() {
                for (k, value) in row.iter_mut().enumerate() {
                    *value = ends[0][c] + along[c] * ((k as f32 + 0.5) / PACKET as f32);
                }
            }
            let reach = length * (0.5 / PACKET as f32);
            if self.lower_bounds(at).iter().any(|bound| *bound <= reach) {
                near.push(NearEdge { particle: first + i, ends });
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::LazyLock;

    use glam::{DQuat, DVec3};

    use super::*;
    use crate::body::{ClosedMesh, Head, SEGMENT_TOLERANCE_M, Sdf};
    use crate::pose::Pose;

    static HEAD: LazyLock<ClosedMesh> = LazyLock::new(|| ClosedMesh::new(&Head::builtin().mesh));

    /// Strands of eight particles that lie along the skin, up to 3 mm above or 1 mm below it, with
    /// edges of 5 to 35 mm.
    fn strands() -> Vec<Vec3> {
        let mesh = &Head::builtin().mesh;
        let (low, high) = mesh.bounds();
        let mut points = Vec::new();
        for t in (0..mesh.triangles.len()).step_by(29) {
            let [a, b, c] = mesh.corners(t);
            let aside = (b - a).normalize_or_zero() * (0.005 + (t % 7) as f32 * 0.005);
            let mut at = (a + b + c) / 3.0;
            for i in 0..8 {
                let height = ((t * 7919 + i * 104_729) % 1000) as f32 * 4e-6 - 0.001;
                points.push(at + (at - (low + high) * 0.5).normalize_or_zero() * height);
                at = HEAD.nearest_from(at + aside, None).unwrap().point;
            }
        }
        points
    }

    #[test]
    fn edges_inside_are_those_of_all_that_are_measured_one_by_one() {
        let local = strands();
        let pose = Pose::new(DQuat::from_rotation_y(0.7), DVec3::new(0.3, -1.0, 2.0));
        let world: Vec<Vec3> = local.iter().map(|p| pose.transform_point(p.as_dvec3()).as_vec3()).collect();
        let ranges: Vec<_> = (0..local.len()).step_by(8).map(|first| first..first + 8).collect();
        let exact: Vec<f64> = (0..local.len())
            .map(|i| if i % 8 < 7 { HEAD.segment_depth(local[i], local[i + 1]).into() } else { 0.0 })
            .collect();
        let outside = |i: usize| !HEAD.contains(local[i]);
        let between = (0..local.len() - 1).filter(|&i| exact[i] > 1e-3 && outside(i) && outside(i + 1));
        assert!(between.count() > 20, "edges dip in between particles that are outside");
        for (nodes, near) in [(16, f32::INFINITY), (16, 6e-3)] {
            let field = Sdf::near(&HEAD, nodes, 0.02, near).unwrap();
            let mut found = Vec::new();
            Depths::new(&field, &HEAD, &pose).find_edges(&world, &ranges, &mut found);
            let mut depths = vec![0.0; local.len()];
            found.iter().for_each(|(edge, depth)| depths[*edge] = *depth);
            for (i, (found, exact)) in depths.iter().zip(&exact).enumerate() {
                let tolerance = 1.1 * f64::from(SEGMENT_TOLERANCE_M);
                assert!((found - exact).abs() < tolerance, "{nodes}, edge {i}: {found}, not {exact}");
            }
        }
    }
}
