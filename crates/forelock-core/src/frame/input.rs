//! What a simulation is given for one frame.

use crate::body::ColliderFrame;
use crate::pose::Pose;
use crate::strands::Model;
use glam::DVec3;

/// The surroundings of one frame: where the head and the colliders are at its start and end, and
/// what accelerates hair.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a> {
    /// The head's pose at the frame's start and end.
    pub head: [Pose; 2],
    /// Colliders.
    pub colliders: &'a [ColliderFrame<'a>],
    /// Gravity, m/s².
    pub gravity: DVec3,
    /// Velocity of the air, m/s.
    pub air_velocity: DVec3,
    /// Length of the frame, seconds.
    pub dt_secs: f64,
}

impl Frame<'_> {
    /// The point of the world that positions are relative to in this frame: where the head's pose at
    /// the end takes the centre of `model`.
    pub fn origin<T>(&self, model: &Model<T>) -> DVec3 {
        self.head[1].transform_point(model.centre.into())
    }

    /// Maps from the rest shape to positions relative to `origin`, at the start of each substep and at
    /// the end of the last: `substeps + 1` poses.
    pub fn poses<T>(&self, model: &Model<T>, substeps: u32, origin: DVec3) -> impl Iterator<Item = Pose> {
        (0..=substeps).map(move |step| {
            let head = self.head[0].interpolate(&self.head[1], f64::from(step) / f64::from(substeps));
            model.about_centre(&head, origin)
        })
    }
}

/// Start and end of each substep as fractions of the frame.
pub fn fractions(substeps: u32) -> impl Iterator<Item = [f64; 2]> {
    (0..substeps).map(move |step| [step, step + 1].map(|step| f64::from(step) / f64::from(substeps)))
}
