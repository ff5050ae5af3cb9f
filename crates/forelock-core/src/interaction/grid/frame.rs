//! Where the grid and the solids in it are, and how they move.

use crate::body::{ColliderFrame, Shape};
use crate::interaction::grid::Bounds;
use crate::pose::Pose;
use glam::{DMat3, DVec3};

/// The frame that the grid moves with: axes, and the velocity that its points have.
///
/// Positions are relative to the frame's origin, in which the grid's own origin is zero.
#[derive(Clone, Copy, Debug)]
pub struct GridFrame {
    /// World axes from grid axes.
    pub rotation: DMat3,
    /// Velocity A x + b in the world of a point that moves with the grid.
    pub motion: (DMat3, DVec3),
}

impl GridFrame {
    /// The frame of a grid that was at `before` a substep of `h` seconds ago and is at `now`, both relative to the
    /// frame's origin.
    pub fn new(before: &Pose, now: &Pose, h: f64) -> Self {
        Self { rotation: now.matrix(), motion: motion(before, now, h) }
    }

    /// A grid that stands still, its axes the world's.
    pub(crate) fn at_rest() -> Self {
        Self { rotation: DMat3::IDENTITY, motion: (DMat3::ZERO, DVec3::ZERO) }
    }
}

/// The velocity A x + b of points that move from where `before` has them to where `now` has them, in `h` seconds: the
/// difference that the solver takes for what follows the head, so that such hair has none on the grid.
fn motion(before: &Pose, now: &Pose, h: f64) -> (DMat3, DVec3) {
    let back = before.after(&now.inverse());
    ((DMat3::IDENTITY - back.matrix()) * (1.0 / h), -back.translation / h)
}

/// Maps M q + b from cells, counted from the grid's origin, for a solid at the end of the last substep.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SolidMaps {
    /// To the solid's own space, metres.
    pub local: (DMat3, DVec3),
    /// To its velocity relative to the grid, along the grid's axes, m/s.
    pub velocity: (DMat3, DVec3),
}

impl SolidMaps {
    /// Of `solid` at the end of the last substep of `h` seconds, which began at `fraction` of the frame, for a grid of cells of side `cell`.
    pub fn new(
        solid: &ColliderFrame<'_>,
        (fraction, h): (f64, f64),
        origin: DVec3,
        (frame, cell): (&GridFrame, f64),
    ) -> Self {
        let relative = |pose: Pose| Pose { translation: pose.translation - origin, ..pose };
        let (before, now) = (relative(solid.pose(fraction)), relative(solid.pose(1.0)));
        let into = now.inverse();
        // x = R cell q.
        let world = frame.rotation * cell;
        let (a, b) = motion(&before, &now, h);
        let (a, b) = (a - frame.motion.0, b - frame.motion.1);
        let axes = frame.rotation.transpose();
        Self { local: (into.matrix() * world, into.translation), velocity: (axes * a * world, axes * b) }
    }
}

/// A solid as the grid sees it: maps from cells to the solid's own space, and its velocity relative to the grid.
#[derive(Clone, Copy, Debug)]
pub struct GridSolid<'a> {
    pub(crate) shape: &'a Shape,
    /// Solid's metres from cells.
    local: ([[f32; 3]; 3], [f32; 3]),
    /// Velocity relative to the grid, along its axes, from cells.
    velocity: ([[f32; 3]; 3], [f32; 3]),
}

impl<'a> GridSolid<'a> {
    /// `solid` at the end of the last substep of `h` seconds, which began at `fraction` of the frame.
    pub(crate) fn new(
        solid: &ColliderFrame<'a>,
        (fraction, h): (f64, f64),
        origin: DVec3,
        frame: &GridFrame,
        (bounds, cell): (&Bounds, f64),
    ) -> Self {
        let maps = SolidMaps::new(solid, (fraction, h), origin, (frame, cell));
        // From the box's first cell.
        let low = DVec3::from_array(bounds.low.map(f64::from));
        let [local, velocity] = [maps.local, maps.velocity].map(|(m, b)| (m, m * low + b));
        Self { shape: solid.shape, local: single(local), velocity: single(velocity) }
    }

    /// Where the point `q` (cells) is in the solid's space, metres.
    #[inline]
    pub(crate) fn local(&self, q: [f32; 3]) -> [f32; 3] {
        affine(&self.local, q)
    }

    /// Velocity along `axis` of the solid's point at `q` (cells), relative to the grid, m/s.
    #[inline]
    pub(crate) fn velocity(&self, axis: usize, q: [f32; 3]) -> f32 {
        affine(&self.velocity, q)[axis]
    }
}

#[inline]
fn affine((rows, offset): &([[f32; 3]; 3], [f32; 3]), q: [f32; 3]) -> [f32; 3] {
    [0, 1, 2].map(|c| rows[c][0] * q[0] + rows[c][1] * q[1] + rows[c][2] * q[2] + offset[c])
}

/// Rows and offset in single precision.
pub(crate) fn single((matrix, offset): (DMat3, DVec3)) -> ([[f32; 3]; 3], [f32; 3]) {
    ([0, 1, 2].map(|r| matrix.row(r).as_vec3().to_array()), offset.as_vec3().to_array())
}
