//! Marks the regions near active segments, so that only segments near one are sorted into cells.

use super::cells::Cells;
use crate::interaction::contact::displacements::Place;
use crate::lane::LANES;
use glam::Vec3;
use std::ops::Range;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

/// Maximum number of bits of [`Marks`].
const MARKS: usize = 1 << 23;
/// Marks the regions near active segments: a bit for each of the fine cells of the box.
#[derive(Debug, Default)]
pub(crate) struct Marks {
    low: Vec3,
    /// Side of a cell, and its inverse, metres.
    side: f32,
    inverse: f32,
    dims: [usize; 3],
    /// Words of a row of cells along x.
    words: usize,
    bits: Vec<AtomicU32>,
}

impl Marks {
    pub fn bytes(&self) -> usize {
        4 * self.bits.capacity()
    }

    /// Fits the marks to the box of `cells`, and clears them. A cell of the marks is `side` wide,
    /// or wider if that would take more than [`MARKS`] bits.
    pub fn fit(&mut self, cells: &Cells, side: f32) {
        let size = cells.size();
        self.low = cells.low();
        self.side = side;
        loop {
            self.inverse = 1.0 / self.side;
            self.dims = (size * self.inverse).to_array().map(|count| count as usize + 1);
            self.words = self.dims[0].div_ceil(32);
            if 32 * self.words * self.dims[1] * self.dims[2] <= MARKS {
                break;
            }
            self.side *= 1.25;
        }
        self.bits.clear();
        self.bits.resize_with(self.words * self.dims[1] * self.dims[2], AtomicU32::default);
    }

    /// The cells within `reach` of `x`, along one axis.
    #[inline(always)]
    fn span(&self, axis: usize, x: f32, reach: f32) -> Range<usize> {
        let index =
            |x: f32| (((x - self.low[axis]) * self.inverse).max(0.0) as usize).min(self.dims[axis] - 1);
        index(x - reach)..index(x + reach) + 1
    }

    /// Distance of `x` from cell `cell` along an axis, 0 inside the cell.
    #[inline(always)]
    fn apart(&self, axis: usize, cell: usize, x: f32) -> f32 {
        let low = self.low[axis] + cell as f32 * self.side;
        (low - x).max(x - low - self.side).max(0.0)
    }

    /// Marks all cells within `radius` of the segment from `middle` − `half` to `middle` + `half`,
    /// by balls along it.
    pub fn mark(&self, middle: Vec3, half: Vec3, radius: f32) {
        // Cells whose bounds are rounded must count as well.
        let radius = radius + 1e-3 * self.side;
        let length = 2.0 * half.length();
        let steps = (length / radius).ceil().clamp(1.0, 64.0);
        let ball = (radius * radius + (0.5 * length / steps).powi(2)).sqrt();
        for k in 0..=steps as usize {
            let at = middle + half * (2.0 * k as f32 / steps - 1.0);
            for z in self.span(2, at.z, ball) {
                let left = ball * ball - self.apart(2, z, at.z).powi(2);
                for y in self.span(1, at.y, ball) {
                    let left = left - self.apart(1, y, at.y).powi(2);
                    if left > 0.0 {
                        self.mark_row(self.words * (y + self.dims[1] * z), self.span(0, at.x, left.sqrt()));
                    }
                }
            }
        }
    }

    /// Marks the cells `span` of the row that begins at `first`.
    #[inline(always)]
    fn mark_row(&self, first: usize, span: Range<usize>) {
        let last = span.end - 1;
        for word in span.start / 32..=last / 32 {
            let from = span.start.max(32 * word) % 32;
            let to = last.min(32 * word + 31) % 32;
            let bits = (u32::MAX << from) & (u32::MAX >> (31 - to));
            let own = &self.bits[first + word];
            if own.load(Relaxed) & bits != bits {
                own.fetch_or(bits, Relaxed);
            }
        }
    }

    /// The lanes whose points are in marked cells.
    #[inline(always)]
    pub fn marked(&self, at: &Place) -> [bool; LANES] {
        let mut cells = [[0i32; LANES]; 3];
        for c in 0..3 {
            let last = (self.dims[c] - 1) as f32;
            for lane in 0..LANES {
                // A cast of a positive number is the floor.
                cells[c][lane] = ((at[c][lane] - self.low[c]) * self.inverse).max(0.0).min(last) as i32;
            }
        }
        let [nx, ny] = [self.words as i32, self.dims[1] as i32];
        let mut words = [0i32; LANES];
        for lane in 0..LANES {
            words[lane] = nx * (cells[1][lane] + ny * cells[2][lane]) + (cells[0][lane] >> 5);
        }
        std::array::from_fn(|lane| {
            let word = self.bits[words[lane] as usize].load(Relaxed);
            word >> (cells[0][lane] & 31) & 1 != 0
        })
    }

    pub fn has(&self, at: Vec3) -> bool {
        self.marked(&at.to_array().map(|x| [x; LANES]))[0]
    }
}
