//! What a block of strands needs to know of the frame it is stepped through.

use super::rules::FrameRules;
use crate::air::sample_air::AirTerms;
use crate::body::ColliderFrame;
use crate::collide::resolve_solids::{SolidPose, Solids};
use crate::lane::Real;
use crate::lane::Simd;
use crate::pose::Pose;
use crate::strands::number;
use glam::DVec3;

/// All that blocks share in a frame.
#[derive(Debug)]
pub struct FrameContext<'a, T> {
    /// What the shared stages need to know of the solver.
    pub rules: FrameRules,
    /// The instruction set (supported, not `Auto`).
    pub(crate) simd: Simd,
    /// Length of the frame, seconds.
    pub dt_secs: f64,
    /// Number of substeps, M.
    pub substeps: u32,
    /// Substep, seconds.
    pub h: f64,
    /// Head poses at the substeps' ends, M + 1, from the model's centre to the frame's origin.
    pub poses: &'a [Pose],
    /// Gravity, m/s².
    pub gravity: DVec3,
    /// Gravity that the rest shape carries, in the head's rest frame, m/s².
    pub rest_gravity: DVec3,
    /// Velocity of the air, m/s.
    pub air_velocity: DVec3,
    /// The air where it is not the same everywhere; then `air_velocity` is in it.
    pub air: Option<AirTerms<'a, T>>,
    /// To be added to stored positions, which are relative to the last frame's origin.
    pub shift: DVec3,
    /// Colliders of the frame.
    pub solids: &'a [ColliderFrame<'a>],
    /// Their poses, M × colliders.
    pub solid_poses: &'a [SolidPose<T>],
}

impl<T: Real> FrameContext<'_, T> {
    /// The colliders as substep `substep` queries them, in which a particle that was inside comes
    /// out by at most `max_push_out` metres.
    pub fn colliders(&self, substep: usize, max_push_out: f64) -> Solids<'_, T> {
        let solids = self.solids.len();
        Solids {
            solids: self.solids,
            poses: &self.solid_poses[substep * solids..(substep + 1) * solids],
            thickness: number(self.rules.skin_thickness),
            max_push_out: number(max_push_out),
            h: number(self.h),
            clamped: self.rules.clamped,
            friction_moves: false,
            slow_edges: number(1.0 / f64::from(self.substeps)),
            max_edge_push: number(self.max_push_out()),
        }
    }

    /// Maximum distance by which a particle that starts a substep inside a collider is pushed out
    /// in that substep, metres.
    pub fn max_push_out(&self) -> f64 {
        self.rules.depenetration_speed * self.h
    }
}

/// A substep of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Substep {
    /// Its number from 0.
    pub index: usize,
    /// Whether it is the first since the air was sampled.
    pub air_is_new: bool,
}
