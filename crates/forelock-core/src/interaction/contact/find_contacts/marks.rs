//! Marks the regions near active segments, so that only segments near one are in the tree.

use super::cells::Cells;
use crate::interaction::contact::displacements::Place;
use crate::lane::LANES;
use glam::Vec3;
use std::ops::Range;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

/// A bit for each cell of a box: whether it is near an active segment.
#[derive(Debug, Default)]
pub(crate) struct Marks {
    cells: Cells,
    /// Words of a row of cells along x.
    words: usize,
    bits: Vec<AtomicU32>,
}

impl Marks {
    pub fn bytes(&self) -> usize {
        4 * self.bits.capacity()
    }

    /// Clears the marks and fits them to `cells`.
    pub fn fit(&mut self, cells: &Cells) {
        self.cells = *cells;
        let [nx, ny, nz] = cells.dims;
        self.words = nx.div_ceil(32);
        self.bits.clear();
        self.bits.resize_with(self.words * ny * nz, AtomicU32::default);
    }

    /// Marks all cells within `radius` of the segment from `middle` − `half` to `middle` + `half`,
    /// by balls along it.
    pub fn mark(&self, middle: Vec3, half: Vec3, radius: f32) {
        let cells = &self.cells;
        // Cells whose bounds are rounded must count as well.
        let radius = radius + 1e-3 * cells.side;
        let length = 2.0 * half.length();
        let steps = (length / radius).ceil().clamp(1.0, 64.0);
        let ball = (radius * radius + (0.5 * length / steps).powi(2)).sqrt();
        for k in 0..=steps as usize {
            let at = middle + half * (2.0 * k as f32 / steps - 1.0);
            for z in cells.span(2, at.z, ball) {
                let left = ball * ball - cells.apart(2, z, at.z).powi(2);
                for y in cells.span(1, at.y, ball) {
                    let left = left - cells.apart(1, y, at.y).powi(2);
                    if left > 0.0 {
                        let row = self.words * (y + cells.dims[1] * z);
                        self.mark_row(row, cells.span(0, at.x, left.sqrt()));
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

    /// Bits of the lanes whose points are in marked cells.
    #[inline(always)]
    pub fn marked(&self, at: &Place) -> u32 {
        let Cells { low, inverse, dims, .. } = self.cells;
        let mut cells = [[0i32; LANES]; 3];
        for ((cells, at), c) in cells.iter_mut().zip(at).zip(0..) {
            let (low, last) = (low[c], (dims[c] - 1) as f32);
            for (cell, x) in cells.iter_mut().zip(at.0) {
                // A cast of a positive number is the floor.
                *cell = ((x - low) * inverse).max(0.0).min(last) as i32;
            }
        }
        let [nx, ny] = [self.words as i32, dims[1] as i32];
        let mut words = [0i32; LANES];
        for lane in 0..LANES {
            words[lane] = nx * (cells[1][lane] + ny * cells[2][lane]) + (cells[0][lane] >> 5);
        }
        let mut marked = 0;
        for lane in 0..LANES {
            let word = self.bits[words[lane] as usize].load(Relaxed);
            marked |= (word >> (cells[0][lane] & 31) & 1) << lane;
        }
        marked
    }

    /// Whether a point is in a marked cell.
    pub fn has(&self, at: Vec3) -> bool {
        let [x, y, z] = [0, 1, 2].map(|c| self.cells.index(c, at[c]));
        let word = self.words * (y + self.cells.dims[1] * z) + x / 32;
        self.bits[word].load(Relaxed) >> (x % 32) & 1 != 0
    }
}
