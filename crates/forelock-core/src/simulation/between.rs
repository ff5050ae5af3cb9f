//! Interpolation of strands between two steps, for display at any rate.
//!
//! # Theory
//! A solver with a fixed step is ahead of the displayed time by less than a step. The displayed
//! strands are interpolated between the last two states relative to the head, so that roots stay on
//! the head. Directions and lengths of edges are interpolated, not positions, so that strands do
//! not shrink between steps.

use super::Simulation;
use crate::pose::Pose;
use glam::{Mat3, Vec3};

impl Simulation<f32> {
    /// Positions as [`Simulation::positions`], interpolated by `share` (0 to 1) between the step
    /// before and the last step. `heads` are the head's poses at these two steps, and `now` its
    /// pose at the displayed time. For solvers that do not store the step before, and for a share
    /// of 1, these are the positions of the last step; the head must have that step's pose then.
    pub fn positions_between(&self, share: f32, heads: [&Pose; 2], now: &Pose, out: &mut Vec<Vec3>) {
        if self.state.previous.is_empty() || self.model.every != 1 || share >= 1.0 {
            return self.positions(out);
        }
        out.resize(self.model.particle_count, Vec3::ZERO);
        let turn = |head: &Pose| Mat3::from_quat((now.rotation * head.rotation.conjugate()).as_quat());
        let [before, last] = heads.map(turn);
        let place = |rows, place, lane| Vec3::from_array(crate::strands::vector(rows, place, lane));
        for block in &self.model.blocks {
            for (lane, &strand) in block.strands[..block.live].iter().enumerate() {
                let from = self.model.offsets[strand as usize] as usize;
                let root = place(&self.model.rest, block.first, lane).as_dvec3();
                // Relative to the root, in single precision anywhere in the world.
                let root = now.transform_point(root + glam::DVec3::from_array(self.model.centre));
                let mut x = Vec3::ZERO;
                out[from] = root.as_vec3();
                for p in block.range().skip(1) {
                    let edge = |rows| place(rows, p, lane) - place(rows, p - 1, lane);
                    let (a, b) = (before * edge(&self.state.previous), last * edge(&self.state.positions));
                    let length = a.length() + (b.length() - a.length()) * share;
                    x += a.lerp(b, share).normalize_or_zero() * length;
                    out[from + p - block.first] = (root + x.as_dvec3()).as_vec3();
                }
            }
        }
    }
}
