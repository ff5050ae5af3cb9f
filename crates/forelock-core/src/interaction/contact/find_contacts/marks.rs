//! Marks the regions near active segments, so that only segments near one are in the tree.

use super::cells::Cells;
use crate::interaction::contact::mean_motion::{MANTISSA, ROUNDER};
use crate::lane::{LANES, Lane, Row, V3};
use glam::Vec3;
use std::ops::Range;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

/// The cells of sixteen points: the words that hold their bits and the numbers of the bits, each in
/// the last bits of a float.
#[derive(Debug)]
pub(crate) struct CellRows {
    words: Row<f32>,
    bits: Row<f32>,
}

impl Default for CellRows {
    fn default() -> Self {
        Self { words: Row([0.0; LANES]), bits: Row([0.0; LANES]) }
    }
}

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

    /// Writes the cells of points, lanes from `first`.
    #[inline(always)]
    pub fn locate<L: Lane<Scalar = f32>>(&self, at: V3<L>, first: usize, cells: &mut CellRows) {
        let Cells { low, inverse, dims, .. } = self.cells;
        let (half, rounder) = (L::splat(0.5), L::splat(ROUNDER));
        let mut own = [L::zero(); 3];
        for c in 0..3 {
            let u = (at.0[c] - L::splat(low[c])) * L::splat(inverse) - half;
            // Rounded half a cell lower: the floor, except on a face, where it may be the cell on
            // either side. Both are marked, for what is marked has a margin.
            let u = u.max(L::zero()).min(L::splat((dims[c] - 1) as f32));
            own[c] = (u + rounder) - rounder;
        }
        let [x, y, z] = own;
        // ⌊x/32⌋, rounded 31/64 lower: x is whole, so nothing is halfway.
        let word = (x * L::splat(1.0 / 32.0) - L::splat(31.0 / 64.0)).max(L::zero()) + rounder - rounder;
        let row = y + L::splat(dims[1] as f32) * z;
        (row * L::splat(self.words as f32) + word + rounder).store(&mut cells.words, first);
        (x - L::splat(32.0) * word + rounder).store(&mut cells.bits, first);
    }

    /// Bits of the lanes whose cells are marked.
    #[inline(always)]
    pub fn marked(&self, cells: &CellRows) -> u32 {
        let mut marked = 0;
        for lane in 0..LANES {
            let [word, bit] = [cells.words.0[lane], cells.bits.0[lane]].map(|x| x.to_bits() & MANTISSA);
            marked |= (self.bits[word as usize].load(Relaxed) >> bit & 1) << lane;
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
