//! Placement and motion of the grid and of the solids in it.

use crate::body::ColliderFrame;
use crate::interaction::grid::Bounds;
use crate::pose::Pose;
use glam::{DAffine3, DMat3, DVec3};

/// The frame of reference of the grid: its axes, and the velocity of its points.
///
/// Positions are relative to the origin of the simulated frame. The origin of the grid lies there.
#[derive(Clone, Copy, Debug)]
pub struct GridFrame {
    /// World axes from grid axes.
    pub rotation: DMat3,
    /// Velocity A x + b in the world of a point that moves with the grid.
    pub motion: DAffine3,
}

impl GridFrame {
    /// The frame of a grid that moved rigidly from `before` to `now` in a substep of `h` seconds.
    /// Both poses are relative to the origin of the frame.
    pub fn new(before: &Pose, now: &Pose, h: f64) -> Self {
        Self { rotation: now.matrix(), motion: motion(before, now, h) }
    }

    /// A grid at rest whose axes are those of the world.
    pub(crate) fn at_rest() -> Self {
        Self {
            rotation: DMat3::IDENTITY,
            motion: DAffine3 { matrix3: DMat3::ZERO, translation: DVec3::ZERO },
        }
    }
}

/// The velocity A x + b of points that move rigidly from `before` to `now` in `h` seconds. It is
/// the difference quotient that the solver uses for hair that follows the head, so such hair has
/// zero velocity on the grid.
fn motion(before: &Pose, now: &Pose, h: f64) -> DAffine3 {
    let back = before.after(&now.inverse());
    DAffine3 { matrix3: (DMat3::IDENTITY - back.matrix()) * (1.0 / h), translation: -back.translation / h }
}

/// Placement of the grid at the end of the last substep.
#[derive(Clone, Copy, Debug)]
pub struct GridPlacement<'a> {
    /// The frame of reference of the grid.
    pub frame: &'a GridFrame,
    /// Side of a cell, metres.
    pub cell: f64,
    /// World position of the origin of the frame.
    pub origin: DVec3,
    /// Start of the last substep, as a fraction of the frame.
    pub last_substep: f64,
    /// Length of the last substep, seconds.
    pub h: f64,
}

/// Affine maps M q + b of a solid at the end of the last substep; q is in cells from the origin of
/// the grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SolidMaps {
    /// To the local space of the solid, metres.
    pub local: DAffine3,
    /// To the velocity of the solid relative to the grid, along the axes of the grid, m/s.
    pub velocity: DAffine3,
}

impl SolidMaps {
    /// The maps of `solid` for a grid placed as `grid`.
    pub fn new(solid: &ColliderFrame<'_>, grid: &GridPlacement<'_>) -> Self {
        let GridPlacement { frame, cell, origin, last_substep, h } = *grid;
        let relative = |pose: Pose| Pose { translation: pose.translation - origin, ..pose };
        let (before, now) = (relative(solid.pose(last_substep)), relative(solid.pose(1.0)));
        let into = now.inverse();
        // x = R cell q.
        let world = frame.rotation * cell;
        let motion = motion(&before, &now, h);
        let a = motion.matrix3 - frame.motion.matrix3;
        let b = motion.translation - frame.motion.translation;
        let axes = frame.rotation.transpose();
        Self {
            local: DAffine3 { matrix3: into.matrix() * world, translation: into.translation },
            velocity: DAffine3 { matrix3: axes * a * world, translation: axes * b },
        }
    }
}

/// A solid on the grid: maps from cells of the box to the local space of the solid, and to its
/// velocity relative to the grid.
#[derive(Clone, Copy, Debug)]
pub struct GridSolid {
    /// Local space of the solid, metres.
    local: RowMap,
    /// Velocity relative to the grid, along the axes of the grid, m/s.
    velocity: RowMap,
}

impl GridSolid {
    /// `solid` in the box `bounds` of a grid placed as `grid`.
    pub(crate) fn new(solid: &ColliderFrame<'_>, grid: &GridPlacement<'_>, bounds: &Bounds) -> Self {
        let maps = SolidMaps::new(solid, grid);
        // Counts cells from the first of the box.
        let low = DVec3::from_array(bounds.low.map(f64::from));
        let [local, velocity] = [maps.local, maps.velocity]
            .map(|map| RowMap::new(map.matrix3, map.matrix3 * low + map.translation));
        Self { local, velocity }
    }

    /// Position of the point `q` (cells) in the local space of the solid, metres.
    #[inline]
    pub(crate) fn local(&self, q: [f32; 3]) -> [f32; 3] {
        self.local.apply(q)
    }

    /// Velocity along `axis` of the solid at the point `q` (cells), relative to the grid, m/s.
    #[inline]
    pub(crate) fn velocity(&self, axis: usize, q: [f32; 3]) -> f32 {
        self.velocity.apply(q)[axis]
    }
}

/// An affine map in single precision, by rows.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RowMap {
    pub rows: [[f32; 3]; 3],
    pub offset: [f32; 3],
}

impl RowMap {
    pub fn new(matrix: DMat3, offset: DVec3) -> Self {
        Self {
            rows: [0, 1, 2].map(|r| matrix.row(r).as_vec3().to_array()),
            offset: offset.as_vec3().to_array(),
        }
    }

    #[inline]
    pub fn apply(&self, q: [f32; 3]) -> [f32; 3] {
        let Self { rows, offset } = self;
        [0, 1, 2].map(|c| rows[c][0] * q[0] + rows[c][1] * q[1] + rows[c][2] * q[2] + offset[c])
    }
}
