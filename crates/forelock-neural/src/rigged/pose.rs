//! The pose of head and torso that the network sees.

use super::vec3::{M, V, cross, finite, num};
use super::{INPUTS, RigError};
use crate::random::Random;
use forelock_core::lane::Real;
use glam::{DMat3, DQuat, DVec3, EulerRot};

/// The pose of the torso and the direction of gravity, in the axes of the head.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RigPose<T> {
    /// R_hᵀ(0, −1, 0), a unit vector.
    pub gravity: [T; 3],
    /// First and second column of R_hᵀR_torso.
    pub torso: [[T; 3]; 2],
}

impl<T: Real> RigPose<T> {
    /// The pose of a head and a torso with these orientations in the world, y up.
    pub fn new(head: DQuat, torso: DQuat) -> Self {
        let head_from_world = head.conjugate();
        let columns = DMat3::from_quat(head_from_world * torso);
        let narrow = |v: DVec3| v.to_array().map(num);
        Self {
            gravity: narrow(head_from_world * DVec3::NEG_Y),
            torso: [narrow(columns.x_axis), narrow(columns.y_axis)],
        }
    }

    /// The inputs of the network: gravity, then the columns.
    pub fn inputs(&self) -> [T; INPUTS] {
        let mut inputs = [T::zero(); INPUTS];
        inputs[..3].copy_from_slice(&self.gravity);
        inputs[3..].copy_from_slice(self.torso.as_flattened());
        inputs
    }

    /// R_hᵀR_torso, by columns.
    pub(super) fn head_from_torso(&self) -> M<T> {
        let [x, y]: [V<T>; 2] = self.torso;
        [x, y, cross(x, y)]
    }

    pub(super) fn check(&self, number: usize) -> Result<(), RigError> {
        let all = finite(self.gravity) && self.torso.into_iter().all(finite);
        if all { Ok(()) } else { Err(RigError::Pose(number)) }
    }
}

/// A range of random poses: greatest turns about y, x and z in radians, uniform and independent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseRange {
    /// Of the head on the torso: 0.9, 0.5, 0.3 by default.
    pub head: [f64; 3],
    /// Of the torso in the world: 0, 0.3, 0.2 by default (a turn about y changes nothing).
    pub torso: [f64; 3],
}

impl Default for PoseRange {
    fn default() -> Self {
        Self { head: [0.9, 0.5, 0.3], torso: [0.0, 0.3, 0.2] }
    }
}

impl PoseRange {
    /// Draws a pose.
    pub fn draw<T: Real>(&self, random: &mut Random) -> RigPose<T> {
        let mut turn = |most: [f64; 3]| {
            let [y, x, z] = most.map(|most| most * random.signed());
            DQuat::from_euler(EulerRot::YXZ, y, x, z)
        };
        let torso = turn(self.torso);
        RigPose::new(torso * turn(self.head), torso)
    }
}
