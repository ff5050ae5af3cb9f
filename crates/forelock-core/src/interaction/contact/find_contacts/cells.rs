//! Sorts the segments of a time slice into a grid of cells, for the search of contacts.

use super::pairs::{ACTIVE, Entry, FIELDS, Test};
use super::{Slice, keep_fastest};
use crate::interaction::contact::{Contact, Displacements, Histogram};
use crate::lane::{LANES, Real, Row};
use crate::scratch::{fill, resize};
use crate::strands::Model;
use glam::Vec3;
use std::ops::Range;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

/// Number of chunks of blocks. It is fixed, so that results do not depend on the number of threads.
const CHUNKS: usize = 64;
/// Maximum number of cells.
const CELLS: usize = 1 << 22;
/// Maximum number of layers of cells along z.
const LAYERS: usize = 1 << 12;
/// Maximum length of an entry, relative to [`search_edge`](super::search_edge). Longer segments are
/// split into pieces of equal length, with one entry each.
pub const PIECE: f32 = 1.25;
/// Maximum number of pieces of a segment.
pub const PIECES: f32 = 256.0;
/// Maximum margins of the bounding balls of active segments and of all others, relative to
/// [`search_edge`](super::search_edge). The margin is the difference between the radius and half
/// the length. A few active segments move farther than this bound; their contacts are found only
/// near their position in the middle of the slice. The second bound is smaller, because segments
/// that are not active have little residual motion, unless more segments move fast than the budget
/// allows.
pub const REACH: [f32; 2] = [1.25, 0.25];

/// The grid of cells.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Cells {
    low: Vec3,
    /// Side of a cell, metres.
    side: f32,
    dims: [usize; 3],
    /// Length scale of the search, metres.
    edge: f32,
}

impl Cells {
    /// Creates cells that cover the box from `low` to `high`. A cell is half of `edge` wide, or
    /// wider if that would take more than [`CELLS`] cells or [`LAYERS`] layers.
    pub fn around([low, high]: [Vec3; 2], edge: f32) -> Self {
        let size = high - low;
        let mut cells = Self { low, side: 0.5 * edge, dims: [1; 3], edge };
        loop {
            let counts =
                (size / cells.side).to_array().map(|count| count.clamp(0.0, CELLS as f32) as usize + 1);
            if counts.into_iter().fold(1, usize::saturating_mul) <= CELLS && counts[2] <= LAYERS {
                cells.dims = counts;
                return cells;
            }
            cells.side *= 1.25;
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

    /// Maximum distance between the centres of `entry` and of another entry whose ball touches its
    /// ball. Of the active entries, only those with a smaller radius than `entry` are considered;
    /// the radius of the others is bounded by [`PIECE`] and [`REACH`].
    #[inline]
    pub fn reach(&self, entry: &Entry) -> f32 {
        entry.radius + entry.radius.max((0.5 * PIECE + REACH[1]) * self.edge)
    }

    #[inline]
    fn index(&self, axis: usize, x: f32) -> usize {
        (((x - self.low[axis]) / self.side).max(0.0) as usize).min(self.dims[axis] - 1)
    }

    /// Indices of the cells within `reach` of `x`, along one axis.
    #[inline]
    pub fn span(&self, axis: usize, x: f32, reach: f32) -> Range<usize> {
        self.index(axis, x - reach)..self.index(axis, x + reach) + 1
    }

    /// Distance of `x` from cell `cell` along an axis, 0 inside the cell.
    #[inline]
    pub fn apart(&self, axis: usize, cell: usize, x: f32) -> f32 {
        let low = self.low[axis] + cell as f32 * self.side;
        (low - x).max(x - low - self.side).max(0.0)
    }

    fn holds(&self, at: Vec3) -> bool {
        let high = self.low + self.side * Vec3::from_array(self.dims.map(|count| count as f32));
        at.cmpge(self.low).all() && at.cmple(high).all()
    }
}

/// Number of bits of [`Marks`], a power of two.
const MARKS: usize = 1 << 20;
/// Side of a cell of [`Marks`], relative to the side of a cell of [`Cells`].
const COARSE: f32 = 3.0;

/// Marks the regions near active segments: a bit set of coarse cells, indexed by a hash of their
/// position. Hash collisions can mark regions that are not near any active segment.
#[derive(Debug, Default)]
pub(crate) struct Marks(Vec<AtomicU32>);

impl Marks {
    pub fn bytes(&self) -> usize {
        4 * self.0.capacity()
    }

    /// Clears all marks.
    pub fn clear(&mut self) {
        self.0.clear();
        self.0.resize_with(MARKS / 32, AtomicU32::default);
    }

    #[inline]
    fn index(cells: &Cells, at: Vec3) -> [usize; 3] {
        let most = Vec3::from_array(cells.dims.map(|count| count as f32)) / COARSE;
        let at = ((at - cells.low) / (COARSE * cells.side)).clamp(Vec3::ZERO, most);
        at.to_array().map(|x| x as usize)
    }

    #[inline]
    fn bit([x, y, z]: [usize; 3]) -> (usize, u32) {
        let place = (x ^ y << 7 ^ z << 14) % MARKS;
        (place / 32, 1 << (place % 32))
    }

    fn set(&self, cells: &Cells, at: Vec3, reach: f32) {
        let [low, high] = [at - reach, at + reach].map(|at| Self::index(cells, at));
        for z in low[2]..=high[2] {
            for y in low[1]..=high[1] {
                for x in low[0]..=high[0] {
                    let (word, bit) = Self::bit([x, y, z]);
                    if self.0[word].load(Relaxed) & bit == 0 {
                        self.0[word].fetch_or(bit, Relaxed);
                    }
                }
            }
        }
    }

    #[inline]
    fn has(&self, cells: &Cells, at: Vec3) -> bool {
        let (word, bit) = Self::bit(Self::index(cells, at));
        self.0[word].load(Relaxed) & bit != 0
    }
}

/// A range of blocks, and the entries of their segments.
#[derive(Debug)]
pub(crate) struct Chunk {
    blocks: Range<usize>,
    /// Entries, active ones first.
    entries: Vec<Entry>,
    active: usize,
    /// Whether some segments are split into pieces.
    in_pieces: bool,
    /// Indices of the entries sorted by layer, and the start of each layer, `[layers + 1]`.
    order: Vec<u32>,
    starts: Vec<u32>,
    /// Candidates of one segment.
    near: Vec<u32>,
    /// Contacts of the active segments.
    pub found: Vec<Contact>,
    approaches: Histogram,
}

/// Splits the blocks of `model` into chunks, whose number does not depend on the number of threads.
pub(super) fn chunks<T: Real>(model: &Model<T>) -> Vec<Chunk> {
    let chunk = |blocks| Chunk {
        blocks,
        entries: Vec::new(),
        active: 0,
        in_pieces: false,
        order: Vec::new(),
        starts: Vec::new(),
        near: Vec::new(),
        found: Vec::new(),
        approaches: Histogram::default(),
    };
    model.parts(CHUNKS).map(chunk).collect()
}

impl Chunk {
    pub fn bytes(&self) -> usize {
        self.entries.capacity() * size_of::<Entry>()
            + self.found.capacity() * size_of::<Contact>()
            + self.approaches.bytes()
            + 4 * (self.order.capacity() + self.starts.capacity() + self.near.capacity())
    }

    /// Inserts the active segments, and marks the regions near them.
    pub fn insert_active<T: Real>(
        &mut self,
        model: &Model<T>,
        displacements: &Displacements,
        slice: &Slice,
        cells: &Cells,
        marks: &Marks,
    ) {
        self.entries.clear();
        self.each_segment(model, |entries, a| {
            if is_active(displacements, slice, a) {
                let before = entries.len();
                insert(entries, displacements, slice, cells, a, |_| true);
                for entry in &entries[before..] {
                    marks.set(cells, entry.middle, cells.reach(entry));
                }
            }
        });
        self.active = self.entries.len();
    }

    /// Whether the chunk has no active segments.
    pub fn has_no_active(&self) -> bool {
        self.active == 0
    }

    /// Inserts the other segments that are near active ones, and sorts all entries by layer.
    pub fn insert_others<T: Real>(
        &mut self,
        model: &Model<T>,
        displacements: &Displacements,
        slice: &Slice,
        cells: &Cells,
        marks: &Marks,
    ) {
        self.each_segment(model, |entries, a| {
            if !is_active(displacements, slice, a) {
                insert(entries, displacements, slice, cells, a, |middle| marks.has(cells, middle));
            }
        });
        self.sort(cells);
    }

    fn each_segment<T: Real>(&mut self, model: &Model<T>, mut f: impl FnMut(&mut Vec<Entry>, usize)) {
        for block in &model.blocks[self.blocks.clone()] {
            for place in block.first..block.first + block.particles - 1 {
                for lane in 0..block.live {
                    f(&mut self.entries, LANES * place + lane);
                }
            }
        }
    }

    fn sort(&mut self, cells: &Cells) {
        self.in_pieces = self.entries.windows(2).any(|pair| pair[0].segment == pair[1].segment);
        let layer = |entry: &Entry| cells.index(2, entry.middle.z);
        fill(&mut self.starts, cells.layers() + 1, 0);
        for entry in &self.entries {
            self.starts[layer(entry) + 1] += 1;
        }
        for k in 1..self.starts.len() {
            self.starts[k] += self.starts[k - 1];
        }
        fill(&mut self.order, self.entries.len(), 0);
        for (entry, number) in self.entries.iter().zip(0..) {
            let next = &mut self.starts[layer(entry)];
            self.order[*next as usize] = number;
            *next += 1;
        }
        // Each entry now holds the start of the next layer.
        self.starts.rotate_right(1);
        self.starts[0] = 0;
    }

    fn layer(&self, k: usize) -> impl Iterator<Item = &Entry> {
        let own = self.starts[k] as usize..self.starts[k + 1] as usize;
        self.order[own].iter().map(|&number| &self.entries[number as usize])
    }

    /// Finds the contacts of the active segments. For each pair that passes `test`, `follow`
    /// returns the contact, if there is one. Where more than `2 * most` contacts are found, only
    /// the `most` with the largest approach are kept.
    pub fn search(
        &mut self,
        soa: &SoaCells,
        test: Test,
        distance: f32,
        most: usize,
        follow: impl Fn([u32; 2]) -> Option<Contact>,
    ) {
        self.found.clear();
        for pieces in self.entries[..self.active].chunk_by(|a, b| a.segment == b.segment) {
            self.near.clear();
            for entry in pieces {
                // SAFETY: `test_for` returns only functions that the processor supports.
                unsafe { test(soa, entry, distance, &mut self.near) };
            }
            if pieces.len() > 1 || soa.has_pieces {
                // A pair of segments that are split into pieces can appear more than once.
                self.near.sort_unstable();
                self.near.dedup();
            }
            let own = pieces[0].segment & !ACTIVE;
            self.found.extend(self.near.iter().filter_map(|&other| follow([own, other])));
            if self.found.len() > 2 * most {
                keep_fastest(&mut self.found, most, &mut self.approaches);
            }
        }
    }
}

/// Whether segment `a` is active.
#[inline]
fn is_active(displacements: &Displacements, slice: &Slice, a: usize) -> bool {
    slice.active.includes(a, displacements.residual_motion[a].max(displacements.residual_motion[a + LANES]))
}

/// Inserts segment `a` at its position in the middle of the slice, split into pieces if it is long.
/// Skips pieces that are outside the grid of cells and pieces for which `is_near` is false.
#[inline]
fn insert(
    entries: &mut Vec<Entry>,
    displacements: &Displacements,
    slice: &Slice,
    cells: &Cells,
    a: usize,
    is_near: impl Fn(Vec3) -> bool,
) {
    let (lower, upper) = (displacements.at(a, slice.middle()), displacements.at(a + LANES, slice.middle()));
    let edge = upper - lower;
    let length = edge.length();
    let pieces = (length / (PIECE * cells.edge)).ceil().clamp(1.0, PIECES);
    let half = edge * (0.5 / pieces);
    for piece in 0..pieces as usize {
        let middle = lower + (2 * piece + 1) as f32 * half;
        if !(cells.holds(middle) && is_near(middle)) {
            continue;
        }
        let active = is_active(displacements, slice, a);
        // The factor 1.25 is a margin: the mean motions of the two segments of a pair differ
        // slightly.
        let residual_motion =
            1.25 * displacements.residual_motion[a].max(displacements.residual_motion[a + LANES]);
        let most = REACH[usize::from(!active)] * cells.edge;
        let reach = (0.5 * (slice.distance + slice.length() * residual_motion)).min(most);
        let (displacement, next) =
            (slice.length() * displacements.of(a), slice.length() * displacements.of(a + LANES));
        entries.push(Entry {
            segment: a as u32 | if active { ACTIVE } else { 0 },
            middle,
            half,
            inverse: 1.0 / half.length_squared().max(1e-20),
            radius: 0.5 * length / pieces + reach,
            displacement: 0.5 * (displacement + next),
            spread: 0.5 * displacement.distance(next),
        });
    }
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
    has_pieces: bool,
}

/// The part of [`SoaCells`] that belongs to a layer.
struct Layer<'a> {
    starts: &'a mut [u32],
    segments: &'a mut [u32],
    rows: &'a mut [[Row<f32>; FIELDS]],
}

impl SoaCells {
    pub fn bytes(&self) -> usize {
        4 * (self.layers.capacity() + self.starts.capacity() + self.segments.capacity())
            + self.rows.capacity() * size_of::<[Row<f32>; FIELDS]>()
    }

    pub fn cells(&self) -> &Cells {
        &self.cells
    }

    /// Sorts the entries of all chunks by layer and cell. Entries of the same cell keep the order
    /// of the chunks.
    pub fn fill(&mut self, chunks: &[Chunk], cells: &Cells) {
        self.cells = *cells;
        fill(&mut self.layers, cells.layers() + 1, 0);
        for k in 0..cells.layers() {
            let count: u32 = chunks.iter().map(|chunk| chunk.starts[k + 1] - chunk.starts[k]).sum();
            self.layers[k + 1] = self.layers[k] + count.div_ceil(LANES as u32);
        }
        let groups = self.layers[cells.layers()] as usize;
        resize(&mut self.starts, cells.layers() * (cells.layer() + 1), 0);
        resize(&mut self.segments, LANES * groups, 0);
        resize(&mut self.rows, groups, [Row([0.0; LANES]); FIELDS]);
        self.has_pieces = chunks.iter().any(|chunk| chunk.in_pieces);
        let all = Layer { starts: &mut self.starts, segments: &mut self.segments, rows: &mut self.rows };
        each_layer(0..cells.layers(), &self.layers, all, &|k, layer| layer.fill(k, chunks, cells));
    }

    /// Finds the entries whose cells are within `reach` of `at`. They form runs of consecutive
    /// entries: calls `visit` with the index range of each run.
    #[inline(always)]
    pub fn runs(&self, at: Vec3, reach: f32, mut visit: impl FnMut(Range<usize>)) {
        let (cells, row, layer) = (&self.cells, self.cells.dims[0], self.cells.layer() + 1);
        for z in cells.span(2, at.z, reach) {
            let first = self.layers[z] as usize;
            if self.layers[z + 1] as usize == first {
                continue;
            }
            let left = reach * reach - cells.apart(2, z, at.z).powi(2);
            for y in cells.span(1, at.y, reach) {
                let left = left - cells.apart(1, y, at.y).powi(2);
                if left > 0.0 {
                    let x = cells.span(0, at.x, left.sqrt());
                    let starts = &self.starts[layer * z + row * y..layer * z + row * (y + 1) + 1];
                    let (from, to) = (starts[x.start] as usize, starts[x.end] as usize);
                    if from < to {
                        visit(LANES * first + from..LANES * first + to);
                    }
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
    /// Sorts the entries of all chunks in layer `k` by cell.
    fn fill(self, k: usize, chunks: &[Chunk], cells: &Cells) {
        let Self { starts, segments, rows } = self;
        if rows.is_empty() {
            return;
        }
        starts.fill(0);
        let cell =
            |entry: &Entry| cells.index(0, entry.middle.x) + cells.dims[0] * cells.index(1, entry.middle.y);
        for entry in chunks.iter().flat_map(|chunk| chunk.layer(k)) {
            starts[cell(entry) + 1] += 1;
        }
        for k in 1..starts.len() {
            starts[k] += starts[k - 1];
        }
        for entry in chunks.iter().flat_map(|chunk| chunk.layer(k)) {
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
