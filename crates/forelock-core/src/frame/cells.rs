//! The cells of a grid on which strands interact, for whoever shows them.

use crate::pose::Pose;

/// The cells of a grid that hold hair.
#[derive(Clone, Debug, PartialEq)]
pub struct GridCells {
    /// World from the axes of the grid, whose origin is a corner of the cell \[0, 0, 0\].
    pub pose: Pose,
    /// Side of a cell, metres.
    pub side: f64,
    /// The cells, each once.
    pub cells: Vec<GridCell>,
}

/// A cell of a grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GridCell {
    /// Its place along each axis, in cells from the origin.
    pub at: [i32; 3],
    /// Density of its hair before the solve, relative to that of the same hair at rest.
    pub density: f32,
    /// Whether a pressure kept its hair from being pressed together.
    pub is_pressed: bool,
}
