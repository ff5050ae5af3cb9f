//! Interpolation of strands between two steps, for display at any rate.
//!
//! # Theory
//! A solver with a fixed step is ahead of the displayed time by less than a step. The displayed
//! strands are interpolated between the last two states relative to the head, so that roots stay on
//! it. Directions and lengths of edges are interpolated, not positions, so that strands do
//! not shrink between steps.

use super::{Model, State, vector};
use crate::pose::Pose;
use glam::{Mat3, Vec3};

/// A moment between the last two steps of a simulation.
#[derive(Clone, Copy, Debug)]
pub struct Between {
    /// Fraction of the last step that has passed, 0 to 1.
    pub share: f32,
    /// The head's poses before and after the last step.
    pub heads: [Pose; 2],
    /// The head's pose at this moment.
    pub now: Pose,
}

impl State<f32> {
    /// Positions as [`State::world_positions`], interpolated between the step before and the last
    /// step. For solvers that do not store the step before, and for a share of 1, these are the
    /// positions of the last step; the head must have that step's pose then.
    pub fn positions_between(&self, model: &Model<f32>, moment: &Between, out: &mut Vec<Vec3>) {
        let Between { share, heads, now } = moment;
        if self.previous.is_empty() || model.every != 1 || *share >= 1.0 {
            return self.world_positions(model, out);
        }
        out.resize(model.particle_count, Vec3::ZERO);
        let turn = |head: Pose| Mat3::from_quat((now.rotation * head.rotation.conjugate()).as_quat());
        let [before, last] = heads.map(turn);
        let place = |rows, place, lane| Vec3::from_array(vector(rows, place, lane));
        let backs = heads.map(|head| head.inverse());
        for block in &model.blocks {
            for (lane, &strand) in block.strands[..block.live].iter().enumerate() {
                let from = model.offsets[strand as usize] as usize;
                // Relative to the root, in single precision anywhere in the world.
                let roots = [&self.previous, &self.positions].map(|rows| place(rows, block.first, lane));
                let [start, end] =
                    [0, 1].map(|end: usize| backs[end].transform_point(roots[end].as_dvec3() + self.origin));
                let root = now.transform_point(start.lerp(end, f64::from(*share)));
                let mut x = Vec3::ZERO;
                out[from] = root.as_vec3();
                for p in block.range().skip(1) {
                    let edge = |rows| place(rows, p, lane) - place(rows, p - 1, lane);
                    let (a, b) = (before * edge(&self.previous), last * edge(&self.positions));
                    let length = a.length() + (b.length() - a.length()) * share;
                    x += a.lerp(b, *share).normalize_or_zero() * length;
                    out[from + p - block.first] = (root + x.as_dvec3()).as_vec3();
                }
            }
        }
    }
}
