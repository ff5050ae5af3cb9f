//! What a simulation is given for one frame.

use super::acceleration::Acceleration;
use super::roots::Roots;
use crate::air::WindField;
use crate::body::ColliderFrame;
use crate::pose::Pose;
use crate::strands::Model;
use glam::DVec3;

/// The surroundings of one frame: where roots and colliders are at its start and end, and what
/// accelerates hair. The default is a head at rest in still air, without gravity, for 1/60 s.
#[derive(Clone, Copy, Debug)]
pub struct FrameInput<'a> {
    /// Motion of the roots, and with them of the rest shape.
    pub roots: Roots<'a>,
    /// Colliders.
    pub colliders: &'a [ColliderFrame<'a>],
    /// Gravity, m/s².
    pub gravity: DVec3,
    /// The air.
    pub air: Air<'a>,
    /// Acceleration in addition to gravity.
    pub acceleration: Acceleration<'a>,
    /// Length of the frame, seconds.
    pub dt_secs: f64,
}

impl Default for FrameInput<'_> {
    fn default() -> Self {
        Self {
            roots: Roots::Rigid([Pose::IDENTITY; 2]),
            colliders: &[],
            gravity: DVec3::ZERO,
            air: Air::default(),
            acceleration: Acceleration::None,
            dt_secs: 1.0 / 60.0,
        }
    }
}

/// The air during a frame.
#[derive(Clone, Copy, Debug, Default)]
pub struct Air<'a> {
    /// Velocity of all air, m/s.
    pub velocity: DVec3,
    /// A wind that differs from place to place; `velocity` is added to it.
    pub field: Option<&'a WindField>,
}

impl Air<'_> {
    /// Air that moves with one `velocity` everywhere, m/s.
    pub fn uniform(velocity: DVec3) -> Self {
        Self { velocity, field: None }
    }
}

impl FrameInput<'_> {
    /// The point of the world that positions are relative to in this frame: where the head's pose
    /// at the end takes the centre of `model`.
    pub fn origin<T>(&self, model: &Model<T>) -> DVec3 {
        self.roots.head()[1].transform_point(model.centre.into())
    }

    /// Maps from the rest shape to positions relative to `origin`, at the start of each substep and
    /// at the end of the last: `substeps + 1` poses.
    pub fn poses<T>(&self, model: &Model<T>, substeps: u32, origin: DVec3) -> impl Iterator<Item = Pose> {
        let [from, to] = *self.roots.head();
        (0..=substeps).map(move |step| {
            let head = from.interpolate(&to, f64::from(step) / f64::from(substeps));
            model.about_centre(&head, origin)
        })
    }
}

/// Start and end of each substep as fractions of the frame.
pub fn fractions(substeps: u32) -> impl Iterator<Item = [f64; 2]> {
    (0..substeps).map(move |step| [step, step + 1].map(|step| f64::from(step) / f64::from(substeps)))
}
