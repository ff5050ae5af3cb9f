//! A grid of cells over the hair.

use glam::Vec3;
use std::ops::Range;

/// Maximum number of cells.
const CELLS: usize = 1 << 22;
/// Maximum number of layers of cells along z.
const LAYERS: usize = 1 << 12;
/// The grid of cells.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Cells {
    pub low: Vec3,
    /// Side of a cell, and its inverse, metres.
    pub side: f32,
    pub inverse: f32,
    pub dims: [usize; 3],
}

impl Cells {
    /// Creates cells that cover the box from `low` to `high`. A cell is `side` wide, or wider if
    /// that would take more than [`CELLS`] cells or [`LAYERS`] layers.
    pub fn around([low, high]: [Vec3; 2], side: f32) -> Self {
        let size = high - low;
        let mut cells = Self { low, side, inverse: 1.0 / side, dims: [1; 3] };
        loop {
            let counts =
                (size / cells.side).to_array().map(|count| count.clamp(0.0, CELLS as f32) as usize + 1);
            if counts.into_iter().fold(1, usize::saturating_mul) <= CELLS && counts[2] <= LAYERS {
                cells.dims = counts;
                return cells;
            }
            cells.side *= 1.25;
            cells.inverse = 1.0 / cells.side;
        }
    }

    #[inline]
    pub fn index(&self, axis: usize, x: f32) -> usize {
        (((x - self.low[axis]) * self.inverse).max(0.0) as usize).min(self.dims[axis] - 1)
    }

    /// Indices of the cells within `reach` of `x`, along one axis.
    #[inline]
    pub fn span(&self, axis: usize, x: f32, reach: f32) -> Range<usize> {
        self.index(axis, x - reach)..self.index(axis, x + reach) + 1
    }

    /// Bounds of cell `cell` along an axis.
    #[inline]
    fn bounds(&self, axis: usize, cell: usize) -> [f32; 2] {
        let low = self.low[axis] + cell as f32 * self.side;
        [low, low + self.side]
    }

    /// Distance of `x` from cell `cell` along an axis, 0 inside the cell.
    #[inline]
    pub fn apart(&self, axis: usize, cell: usize, x: f32) -> f32 {
        gap(self.bounds(axis, cell), [x, x])
    }

    pub fn holds(&self, at: Vec3) -> bool {
        let high = self.low + self.side * Vec3::from_array(self.dims.map(|count| count as f32));
        at.cmpge(self.low).all() && at.cmple(high).all()
    }
}

/// The distance between two intervals; 0 if they overlap.
#[inline(always)]
fn gap(a: [f32; 2], b: [f32; 2]) -> f32 {
    (a[0] - b[1]).max(b[0] - a[1]).max(0.0)
}
