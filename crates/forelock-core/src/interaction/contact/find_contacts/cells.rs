//! Which segments are near which cells.

use super::pairs::{ACTIVE, Entry, FIELDS, Test};
use super::{Slice, keep_fastest};
use crate::interaction::contact::{Contact, Histogram, Ways};
use crate::lane::{LANES, Real, Row};
use crate::scratch::{fill, resize};
use crate::strands::Model;
use glam::Vec3;
use std::ops::Range;
use std::sync::atomic::{AtomicU32, Ordering::Relaxed};

/// Parts of the blocks: a fixed count, for results must not depend on threads.
const CHUNKS: usize = 64;
/// Cells at most, and layers of them.
const CELLS: usize = 1 << 22;
const LAYERS: usize = 1 << 12;
/// Longest piece of a segment over [`search_edge`](super::search_edge): longer segments are entered in pieces.
pub const PIECE: f32 = 1.25;
/// Pieces of a segment at most.
pub const PIECES: f32 = 256.0;
/// What an active segment and another one may reach beyond themselves, over [`search_edge`](super::search_edge), at most. The few that stray farther than slices are made for
/// are met only where they are near in the middle of a slice; others stray less than active ones, but where there are more of these than the budget has room for.
pub const REACH: [f32; 2] = [1.25, 0.25];

/// The box of cells.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Cells {
    low: Vec3,
    /// Side of a cell, metres.
    side: f32,
    dims: [usize; 3],
    /// The length that the search is made for, metres.
    edge: f32,
}

impl Cells {
    /// Cells that hold the box from `low` to `high`: half an edge wide, or wider where that would be more than [`CELLS`].
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

    /// Layers of cells along z.
    pub fn layers(&self) -> usize {
        self.dims[2]
    }

    /// Cells in a layer.
    fn layer(&self) -> usize {
        self.dims[0] * self.dims[1]
    }

    /// How far from the middle of `entry` the middles of those can be that it meets: of the active ones only those that reach no farther
    /// than it.
    #[inline]
    pub fn reach(&self, entry: &Entry) -> f32 {
        entry.radius + entry.radius.max((0.5 * PIECE + REACH[1]) * self.edge)
    }

    #[inline]
    fn index(&self, axis: usize, x: f32) -> usize {
        (((x - self.low[axis]) / self.side).max(0.0) as usize).min(self.dims[axis] - 1)
    }

    /// The cells along an axis within `reach` of `x`.
    #[inline]
    pub fn span(&self, axis: usize, x: f32, reach: f32) -> Range<usize> {
        self.index(axis, x - reach)..self.index(axis, x + reach) + 1
    }

    /// How far `x` is from cell `cell` along an axis.
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

/// Bits of [`Marks`], a power of two.
const MARKS: usize = 1 << 20;
/// Side of what is marked, over that of a cell.
const COARSE: f32 = 3.0;

/// Where active segments are, in cells [`COARSE`] times as wide, by a hash of their place: some others may seem to be marked.
#[derive(Debug, Default)]
pub(crate) struct Marks(Vec<AtomicU32>);

impl Marks {
    pub fn bytes(&self) -> usize {
        4 * self.0.capacity()
    }

    /// Takes all marks away.
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

/// Some blocks and their segments.
#[derive(Debug)]
pub(crate) struct Chunk {
    blocks: Range<usize>,
    /// Active ones first.
    entries: Vec<Entry>,
    active: usize,
    /// Whether some segment is there in pieces.
    in_pieces: bool,
    /// Entries by layer, and where each layer starts, `[layers + 1]`.
    order: Vec<u32>,
    starts: Vec<u32>,
    /// What is near one segment.
    near: Vec<u32>,
    /// What its active ones met.
    pub found: Vec<Contact>,
    approaches: Histogram,
}

/// The blocks of `model` in a number of chunks that does not depend on threads.
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

    /// Enters the active segments, and marks the cells near them.
    pub fn enter_active<T: Real>(
        &mut self,
        model: &Model<T>,
        ways: &Ways,
        slice: &Slice,
        (cells, marks): (&Cells, &Marks),
    ) {
        self.entries.clear();
        self.each_segment(model, |entries, a| {
            if is_active(ways, slice, a) {
                let before = entries.len();
                enter(entries, ways, slice, cells, a, |_| true);
                for entry in &entries[before..] {
                    marks.set(cells, entry.middle, cells.reach(entry));
                }
            }
        });
        self.active = self.entries.len();
    }

    /// Whether it has no active segments.
    pub fn is_quiet(&self) -> bool {
        self.active == 0
    }

    /// Enters those of the others that are near active ones, and sorts all by layer.
    pub fn enter_others<T: Real>(
        &mut self,
        model: &Model<T>,
        ways: &Ways,
        slice: &Slice,
        (cells, marks): (&Cells, &Marks),
    ) {
        self.each_segment(model, |entries, a| {
            if !is_active(ways, slice, a) {
                enter(entries, ways, slice, cells, a, |middle| marks.has(cells, middle));
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
        // Each start now stands where the next layer starts.
        self.starts.rotate_right(1);
        self.starts[0] = 0;
    }

    fn layer(&self, k: usize) -> impl Iterator<Item = &Entry> {
        let own = self.starts[k] as usize..self.starts[k + 1] as usize;
        self.order[own].iter().map(|&number| &self.entries[number as usize])
    }

    /// Lets the active segments meet what is near: `meet` says of the pairs that pass the test what becomes of them. Leaves no more than twice as many as `most`,
    /// those of the greatest approach.
    pub fn search(
        &mut self,
        shelf: &Shelf,
        (test, distance, most): (Test, f32, usize),
        meet: impl Fn([u32; 2]) -> Option<Contact>,
    ) {
        self.found.clear();
        for pieces in self.entries[..self.active].chunk_by(|a, b| a.segment == b.segment) {
            self.near.clear();
            for entry in pieces {
                // SAFETY: `test_for` gives only what the processor has.
                unsafe { test(shelf, entry, distance, &mut self.near) };
            }
            if pieces.len() > 1 || shelf.has_pieces {
                // In pieces a pair may come more than once.
                self.near.sort_unstable();
                self.near.dedup();
            }
            let own = pieces[0].segment & !ACTIVE;
            self.found.extend(self.near.iter().filter_map(|&other| meet([own, other])));
            if self.found.len() > 2 * most {
                keep_fastest(&mut self.found, most, &mut self.approaches);
            }
        }
    }
}

/// Whether contacts of segment `a` are sought.
#[inline]
fn is_active(ways: &Ways, slice: &Slice, a: usize) -> bool {
    slice.active.has(a, ways.stray[a].max(ways.stray[a + LANES]))
}

/// Enters segment `a` in the middle of the slice, a long one in pieces: those in the box of which `is_near` holds.
#[inline]
fn enter(
    entries: &mut Vec<Entry>,
    ways: &Ways,
    slice: &Slice,
    cells: &Cells,
    a: usize,
    is_near: impl Fn(Vec3) -> bool,
) {
    let (lower, upper) = (ways.at(a, slice.middle()), ways.at(a + LANES, slice.middle()));
    let edge = upper - lower;
    let length = edge.length();
    let pieces = (length / (PIECE * cells.edge)).ceil().clamp(1.0, PIECES);
    let half = edge * (0.5 / pieces);
    for piece in 0..pieces as usize {
        let middle = lower + (2 * piece + 1) as f32 * half;
        if !(cells.holds(middle) && is_near(middle)) {
            continue;
        }
        let active = is_active(ways, slice, a);
        // A quarter more, for the drift is not quite the same for both of a pair.
        let stray = 1.25 * ways.stray[a].max(ways.stray[a + LANES]);
        let most = REACH[usize::from(!active)] * cells.edge;
        let reach = (0.5 * (slice.distance + slice.length() * stray)).min(most);
        let (way, next) = (slice.length() * ways.way(a), slice.length() * ways.way(a + LANES));
        entries.push(Entry {
            segment: a as u32 | if active { ACTIVE } else { 0 },
            middle,
            half,
            inverse: 1.0 / half.length_squared().max(1e-20),
            radius: 0.5 * length / pieces + reach,
            way: 0.5 * (way + next),
            spread: 0.5 * way.distance(next),
        });
    }
}

/// What is entered, layer by layer, row by row, cell by cell.
#[derive(Debug, Default)]
pub(crate) struct Shelf {
    cells: Cells,
    /// The first sixteen of each layer, over sixteen, `[layers + 1]`.
    layers: Vec<u32>,
    /// Where each cell's segments start in its layer, `[layers × (cells of a layer + 1)]`; of layers with none, nothing.
    starts: Vec<u32>,
    /// Numbers of the segments, with [`ACTIVE`].
    pub segments: Vec<u32>,
    /// Sixteen segments each: field by field, as [`Entry::fields`] has them.
    pub rows: Vec<[Row<f32>; FIELDS]>,
    /// Whether some segment may be there in pieces.
    has_pieces: bool,
}

/// A layer's part of a shelf.
struct Layer<'a> {
    starts: &'a mut [u32],
    segments: &'a mut [u32],
    rows: &'a mut [[Row<f32>; FIELDS]],
}

impl Shelf {
    pub fn bytes(&self) -> usize {
        4 * (self.layers.capacity() + self.starts.capacity() + self.segments.capacity())
            + self.rows.capacity() * size_of::<[Row<f32>; FIELDS]>()
    }

    pub fn cells(&self) -> &Cells {
        &self.cells
    }

    /// Takes up what all chunks have, in their order.
    pub fn take(&mut self, chunks: &[Chunk], cells: &Cells) {
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
        each_layer(0..cells.layers(), &self.layers, all, &|k, layer| layer.take(k, chunks, cells));
    }

    /// Calls `visit` with each run of segments whose cells are within `reach` of `at`.
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

/// Calls `f` for each layer with its part, in parallel.
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
    /// Takes up what all chunks have in layer `k`, in their order.
    fn take(self, k: usize, chunks: &[Chunk], cells: &Cells) {
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
        // Each start now stands where the next cell starts.
        starts.rotate_right(1);
        starts[0] = 0;
    }
}
