//! The box of cells, and where samples find their nodes in it.

#![expect(clippy::needless_range_loop, reason = "one index for several arrays is what vectorises")]

use super::{Lanes, MARGIN};
use crate::lane::LANES;

/// Cells of a strip: cells side by side in a row, which are computed together. Strips without hair
/// are skipped.
pub(crate) const STRIP: usize = 16;

/// Distance from the faces of the box that samples keep, cells.
const START: f32 = 2.0;
const END: f32 = 2.5;

/// The box of cells. Its rows are stored as whole strips.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Bounds {
    /// The first cell, in cells from the grid's origin.
    pub low: [i32; 3],
    /// Cells along each axis.
    pub dims: [usize; 3],
    /// Cells at the start of each row that are not part of the box: with them strips begin at
    /// multiples of [`STRIP`] cells from the grid's origin.
    pad: usize,
}

/// The strips of a row of `cells`. Their number is odd, so that neighbours in other rows lie in
/// other sets of the caches.
pub(super) fn strips_of(cells: usize) -> usize {
    cells.div_ceil(STRIP) | 1
}

/// Ones in all bits if `is_set`.
#[inline(always)]
pub(super) fn mask(is_set: bool) -> u32 {
    0u32.wrapping_sub(u32::from(is_set))
}

/// `x`, or zero where the `mask` is zero.
#[inline(always)]
pub(super) fn masked(x: f32, mask: u32) -> f32 {
    f32::from_bits(x.to_bits() & mask)
}

impl Bounds {
    /// The box around hair that spans `extent` (metres along the axes of the grid). If it would
    /// exceed `most` cells, its longest sides are cut, on the side farther from the origin of the
    /// grid.
    pub fn around([low, high]: [[f32; 3]; 2], cell: f64, most: usize) -> Self {
        #[expect(clippy::cast_possible_truncation, reason = "clamped to what 16 bits hold")]
        let index = |x: f32| (f64::from(x) / cell).floor().clamp(-3e4, 3e4) as i32;
        let mut span: [[i32; 2]; 3] =
            [0, 1, 2].map(|c| [index(low[c]) - MARGIN, index(high[c]).max(index(low[c])) + 1 + MARGIN]);
        let count = |span: &[[i32; 2]; 3]| {
            span.iter().map(|s| i64::from(s[1] - s[0])).fold(1i64, i64::saturating_mul) as u64
        };
        while count(&span) > most as u64 {
            let longest = (0..3).max_by_key(|&c| span[c][1] - span[c][0]).unwrap_or(0);
            let side = &mut span[longest];
            if -side[0] > side[1] { side[0] += 1 } else { side[1] -= 1 }
        }
        let [mut low, mut dims] = [[0; 3]; 2];
        for c in 0..3 {
            (low[c], dims[c]) = (span[c][0], span[c][1] - span[c][0]);
        }
        let pad = low[0].rem_euclid(STRIP as i32);
        (low[0], dims[0]) = (low[0] - pad, dims[0] + pad);
        let [dims, pad] = [dims, [pad; 3]].map(|all| all.map(|cells| usize::try_from(cells).unwrap_or(1)));
        Self { low, dims, pad: pad[0] }
    }

    /// The smallest coordinate of samples along an axis, cells.
    #[inline(always)]
    fn start(&self, axis: usize) -> f32 {
        START + if axis == 0 { self.pad as f32 } else { 0.0 }
    }

    /// Strips of a row.
    pub fn strips(&self) -> usize {
        strips_of(self.dims[0])
    }

    /// Strips of a layer.
    pub fn layer_strips(&self) -> usize {
        self.strips() * self.dims[1]
    }

    /// Distances between neighbours along each axis, in cells as they are stored.
    pub fn strides(&self) -> [usize; 3] {
        [1, STRIP * self.strips(), STRIP * self.layer_strips()]
    }

    /// Cells of the box as they are stored.
    pub fn cells(&self) -> usize {
        self.strides()[2] * self.dims[2]
    }

    /// The place along each axis of a cell as it is stored.
    pub fn place(&self, cell: usize) -> [usize; 3] {
        let [_, row, layer] = self.strides();
        [cell % row, cell % layer / row, cell / layer]
    }

    /// Sets all bits of the lanes in which all nodes that a sample at `at` touches lie inside the
    /// box, and none in the others.
    #[inline(always)]
    pub fn hold(&self, at: &Lanes, inside: &mut [u32; LANES]) {
        *inside = [u32::MAX; LANES];
        for c in 0..3 {
            let (start, end) = (self.start(c), self.dims[c] as f32 - END);
            for lane in 0..LANES {
                inside[lane] &= mask((at[c][lane] >= start) & (at[c][lane] < end));
            }
        }
    }

    /// The nodes of the box.
    pub fn lattice(&self) -> Lattice {
        Lattice::new(
            [0, 1, 2].map(|c| self.start(c)),
            self.dims.map(|cells| cells as f32 - END),
            [0; 3],
            self.strides(),
        )
    }

    /// The part of the box that holds samples from `low` to `high`, metres along the axes of the
    /// grid: where they may be, cells.
    pub fn part(&self, [low, high]: [[f32; 3]; 2], cell: f64) -> [[f32; 3]; 2] {
        // More than the rounding of positions between two ends.
        const ROUNDING: f32 = 0.01;
        let most = self.dims.map(|cells| cells as f32 - END);
        let to_cells = |x: f32, c: usize| (f64::from(x) / cell - f64::from(self.low[c])) as f32;
        let from = [0, 1, 2].map(|c| (to_cells(low[c], c) - ROUNDING).max(self.start(c)).min(most[c]));
        let to = [0, 1, 2].map(|c| (to_cells(high[c], c) + ROUNDING).max(from[c]).min(most[c]));
        [from, to]
    }
}

/// The nodes of a box, or of a part of it, as samples find them.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Lattice {
    /// Smallest and largest coordinates of samples, cells of the box; others are moved there.
    start: [f32; 3],
    end: [f32; 3],
    /// The first node.
    low: [i32; 3],
    strides: [i32; 3],
}

impl Lattice {
    /// Nodes from `low` on for samples from `start` to `end`.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_possible_wrap,
        reason = "a grid has far fewer nodes than 31 bits count"
    )]
    pub fn new(start: [f32; 3], end: [f32; 3], low: [usize; 3], strides: [usize; 3]) -> Self {
        Self { start, end, low: low.map(|x| x as i32), strides: strides.map(|x| x as i32) }
    }

    /// Nodes from the first of a stencil to the first of each of its rows.
    #[expect(clippy::cast_sign_loss, reason = "strides are positive")]
    pub fn rows(&self) -> [usize; 4] {
        let [_, row, layer] = self.strides.map(|stride| stride as usize);
        [0, row, layer, layer + row]
    }
}

/// The trilinear stencils of one sample of each strand of a block. The nodes are the middles of the
/// cells.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Stencils {
    /// Index of the first node.
    pub first: [u32; LANES],
    /// Positions from the first node, cells.
    offset: Lanes,
    /// Weights of the four rows of two nodes, then those of the nodes of a row.
    pub weights: [[f32; LANES]; 6],
}

impl Stencils {
    /// Sets the stencils of samples at `at`, cells. Samples outside the lattice get those of the
    /// nearest point inside.
    #[inline(always)]
    #[expect(clippy::cast_sign_loss, reason = "the lattice holds the stencil")]
    pub fn set(&mut self, lattice: &Lattice, at: &Lanes) {
        let Self { first, offset, weights } = self;
        *first = [0; LANES];
        for c in 0..3 {
            let (start, end) = (lattice.start[c], lattice.end[c]);
            for k in 0..LANES {
                let x = at[c][k];
                // What is not a number goes to the start.
                let x = if x > start { x } else { start };
                let x = (if x < end { x } else { end }) - 0.5;
                // Coordinates are positive: a cast is the floor.
                // SAFETY: a number between those of the lattice, a few thousand at most.
                let low = unsafe { x.to_int_unchecked::<i32>() };
                offset[c][k] = x - low as f32;
                first[k] += (lattice.strides[c] * (low - lattice.low[c])) as u32;
            }
        }
        let [x, y, z] = &*offset;
        for k in 0..LANES {
            weights[0][k] = (1.0 - y[k]) * (1.0 - z[k]);
            weights[1][k] = y[k] * (1.0 - z[k]);
            weights[2][k] = (1.0 - y[k]) * z[k];
            weights[3][k] = y[k] * z[k];
            weights[4][k] = 1.0 - x[k];
            weights[5][k] = x[k];
        }
    }

    /// The nodes of a lane's stencil and their weights.
    pub fn nodes(&self, rows: [usize; 4], lane: usize) -> [(usize, f32); 8] {
        std::array::from_fn(|n| {
            let weight = self.weights[n >> 1][lane] * self.weights[4 + (n & 1)][lane];
            (self.first[lane] as usize + rows[n >> 1] + (n & 1), weight)
        })
    }
}
