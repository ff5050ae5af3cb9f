//! Sorts the segments of a time slice into a grid of cells, for the search of contacts.

use super::chunk::Entries;
use super::pairs::{Entry, FIELDS};
use crate::lane::{LANES, Row};
use crate::scratch::{fill, resize};
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

    /// Number of layers of cells along z.
    pub fn layers(&self) -> usize {
        self.dims[2]
    }

    /// Number of cells in a layer.
    fn layer(&self) -> usize {
        self.dims[0] * self.dims[1]
    }

    #[inline]
    fn index(&self, axis: usize, x: f32) -> usize {
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

    /// The layer of a point.
    #[inline]
    pub fn layer_of(&self, at: Vec3) -> usize {
        self.index(2, at.z)
    }

    pub fn holds(&self, at: Vec3) -> bool {
        let high = self.low + self.side * Vec3::from_array(self.dims.map(|count| count as f32));
        at.cmpge(self.low).all() && at.cmple(high).all()
    }
}

/// The part of a segment from `middle` − `half` to `middle` + `half`, given by fractions of `half`.
#[derive(Clone, Copy)]
struct Part {
    from: f32,
    to: f32,
}

impl Part {
    /// The part whose coordinate lies between `low` and `high`; `inverse` is that of `half`.
    #[inline(always)]
    fn clip(self, middle: f32, inverse: f32, [low, high]: [f32; 2]) -> Self {
        let ends = [(low - middle) * inverse, (high - middle) * inverse];
        Self { from: self.from.max(ends[0].min(ends[1])), to: self.to.min(ends[0].max(ends[1])) }
    }

    /// The range of a coordinate of the part.
    #[inline(always)]
    fn range(self, middle: f32, half: f32) -> [f32; 2] {
        let ends = [middle + half * self.from, middle + half * self.to];
        [ends[0].min(ends[1]), ends[0].max(ends[1])]
    }
}

/// The distance between two intervals; 0 if they overlap.
#[inline(always)]
fn gap(a: [f32; 2], b: [f32; 2]) -> f32 {
    (a[0] - b[1]).max(b[0] - a[1]).max(0.0)
}

/// Entries as a structure of arrays, sorted by layer, row and cell.
#[derive(Debug, Default)]
pub(crate) struct SoaCells {
    cells: Cells,
    /// Index of the first group of sixteen entries of each layer, `[layers + 1]`.
    layers: Vec<u32>,
    /// Start of each cell in its layer, `[layers × (cells of a layer + 1)]`; undefined for empty
    /// layers.
    starts: Vec<u32>,
    /// Numbers of the segments, with the flag [`ACTIVE`].
    pub segments: Vec<u32>,
    /// Groups of sixteen entries, field by field in the order of [`Entry::fields`].
    pub rows: Vec<[Row<f32>; FIELDS]>,
    /// Whether some segments are split into pieces.
    pub has_pieces: bool,
    /// Largest radius of an entry, metres.
    pub widest: f32,
    /// Whether the entries are the active ones.
    pub holds_active: bool,
}

/// The part of [`SoaCells`] that belongs to a layer.
struct Layer<'a> {
    starts: &'a mut [u32],
    segments: &'a mut [u32],
    rows: &'a mut [[Row<f32>; FIELDS]],
}

impl SoaCells {
    pub fn new(holds_active: bool) -> Self {
        Self { holds_active, ..Self::default() }
    }

    pub fn bytes(&self) -> usize {
        4 * (self.layers.capacity() + self.starts.capacity() + self.segments.capacity())
            + self.rows.capacity() * size_of::<[Row<f32>; FIELDS]>()
    }

    /// Sorts the entries of `lists` by layer and cell. Entries of the same cell keep the order of
    /// the lists.
    pub fn fill<'a>(&mut self, lists: impl Iterator<Item = &'a Entries> + Clone + Sync, cells: &Cells) {
        self.cells = *cells;
        fill(&mut self.layers, cells.layers() + 1, 0);
        for k in 0..cells.layers() {
            let count: usize = lists.clone().map(|own| own.layer(k).len()).sum();
            self.layers[k + 1] = self.layers[k] + count.div_ceil(LANES) as u32;
        }
        let groups = self.layers[cells.layers()] as usize;
        resize(&mut self.starts, cells.layers() * (cells.layer() + 1), 0);
        resize(&mut self.segments, LANES * groups, 0);
        resize(&mut self.rows, groups, [Row([0.0; LANES]); FIELDS]);
        self.has_pieces = lists.clone().any(|own| own.in_pieces);
        self.widest = lists.clone().map(|own| own.widest).fold(0.0, f32::max);
        let all = Layer { starts: &mut self.starts, segments: &mut self.segments, rows: &mut self.rows };
        each_layer(0..cells.layers(), &self.layers, all, &|k, layer| layer.fill(k, lists.clone(), cells));
    }

    /// Finds the entries whose cells are within `reach` of the segment from `middle` − `half` to
    /// `middle` + `half`. They form runs of consecutive entries: calls `visit` with the index range
    /// of each run.
    #[inline(always)]
    pub fn runs(&self, middle: Vec3, half: Vec3, reach: f32, mut visit: impl FnMut(Range<usize>)) {
        let (cells, row, layer) = (&self.cells, self.cells.dims[0], self.cells.layer() + 1);
        let widened = |[low, high]: [f32; 2]| [low - reach, high + reach];
        let inverse = half.to_array().map(|half| 1.0 / if half.abs() < 1e-12 { 1e-12 } else { half });
        let whole = Part { from: -1.0, to: 1.0 };
        for z in cells.span(2, middle.z, reach + half.z.abs()) {
            let first = self.layers[z] as usize;
            if self.layers[z + 1] as usize == first {
                continue;
            }
            let bounds_z = cells.bounds(2, z);
            let part = whole.clip(middle.z, inverse[2], widened(bounds_z));
            if part.from > part.to {
                continue;
            }
            let [low, high] = widened(part.range(middle.y, half.y));
            for y in cells.index(1, low)..cells.index(1, high) + 1 {
                let bounds_y = cells.bounds(1, y);
                let part = part.clip(middle.y, inverse[1], widened(bounds_y));
                let apart_z = gap(part.range(middle.z, half.z), bounds_z);
                let apart_y = gap(part.range(middle.y, half.y), bounds_y);
                let left = reach * reach - apart_z * apart_z - apart_y * apart_y;
                if part.from > part.to || left <= 0.0 {
                    continue;
                }
                let [low, high] = part.range(middle.x, half.x);
                let left = left.sqrt();
                let x = cells.index(0, low - left)..cells.index(0, high + left) + 1;
                let starts = &self.starts[layer * z + row * y..layer * z + row * (y + 1) + 1];
                let (from, to) = (starts[x.start] as usize, starts[x.end] as usize);
                if from < to {
                    visit(LANES * first + from..LANES * first + to);
                }
            }
        }
    }
}

/// Calls `f` for each layer of `range` and its part of `all`, in parallel.
fn each_layer(range: Range<usize>, firsts: &[u32], all: Layer<'_>, f: &(impl Fn(usize, Layer<'_>) + Sync)) {
    if range.len() <= 1 {
        return f(range.start, all);
    }
    let middle = range.start + range.len() / 2;
    let groups = (firsts[middle] - firsts[range.start]) as usize;
    let (starts, starts_right) =
        all.starts.split_at_mut(all.starts.len() / range.len() * (middle - range.start));
    let (segments, segments_right) = all.segments.split_at_mut(LANES * groups);
    let (rows, rows_right) = all.rows.split_at_mut(groups);
    rayon::join(
        || each_layer(range.start..middle, firsts, Layer { starts, segments, rows }, f),
        || {
            let right = Layer { starts: starts_right, segments: segments_right, rows: rows_right };
            each_layer(middle..range.end, firsts, right, f);
        },
    );
}

impl Layer<'_> {
    /// Sorts the entries of `lists` in layer `k` by cell.
    fn fill<'a>(self, k: usize, lists: impl Iterator<Item = &'a Entries> + Clone, cells: &Cells) {
        let Self { starts, segments, rows } = self;
        if rows.is_empty() {
            return;
        }
        starts.fill(0);
        let cell =
            |entry: &Entry| cells.index(0, entry.middle.x) + cells.dims[0] * cells.index(1, entry.middle.y);
        for entry in lists.clone().flat_map(|own| own.layer(k)) {
            starts[cell(entry) + 1] += 1;
        }
        for k in 1..starts.len() {
            starts[k] += starts[k - 1];
        }
        for entry in lists.flat_map(|own| own.layer(k)) {
            let next = &mut starts[cell(entry)];
            let place = *next as usize;
            *next += 1;
            segments[place] = entry.segment;
            for (row, value) in rows[place / LANES].iter_mut().zip(entry.fields()) {
                row.0[place % LANES] = value;
            }
        }
        // Each entry now holds the start of the next cell.
        starts.rotate_right(1);
        starts[0] = 0;
    }
}
