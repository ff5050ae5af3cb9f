//! Sorts the segments of a time slice into a grid of cells, for the search of contacts.

#![expect(clippy::needless_range_loop, reason = "one index for several arrays is what vectorises")]

use super::pairs::{ACTIVE, Entry, FIELDS, Test};
use super::{Slice, keep_fastest};
use crate::interaction::contact::{Contact, Displacements, Histogram};
use crate::lane::{LANES, Real, Row, widest};
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
    /// Largest radius of the entries that are not active, metres.
    pub widest_other: f32,
}

impl Cells {
    /// Creates cells that cover the box from `low` to `high`. A cell is half of `edge` wide, or
    /// wider if that would take more than [`CELLS`] cells or [`LAYERS`] layers.
    pub fn around([low, high]: [Vec3; 2], edge: f32) -> Self {
        let size = high - low;
        let mut cells = Self { low, side: 0.5 * edge, dims: [1; 3], edge, widest_other: 0.0 };
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
    /// ball. Of the active entries, only those with a smaller radius than `entry` are considered.
    #[inline]
    pub fn reach(&self, entry: &Entry) -> f32 {
        entry.radius + entry.radius.max(self.widest_other)
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

/// Maximum number of bits of [`Marks`].
const MARKS: usize = 1 << 23;
/// Side of a cell of [`Marks`], relative to that of a cell of [`Cells`], if there are not too many.
const FINE: f32 = 0.5;

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

    /// Fits the marks to the box of `cells`, and clears them.
    pub fn fit(&mut self, cells: &Cells) {
        let size = cells.side * Vec3::from_array(cells.dims.map(|count| count as f32));
        self.low = cells.low;
        self.side = FINE * cells.side;
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
    fn mark(&self, middle: Vec3, half: Vec3, radius: f32) {
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
    fn marked(&self, at: &[[f32; LANES]; 3]) -> [bool; LANES] {
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

    fn has(&self, at: Vec3) -> bool {
        self.marked(&at.to_array().map(|x| [x; LANES]))[0]
    }
}

/// A range of blocks, and the entries of their segments.
#[derive(Debug)]
pub(crate) struct Chunk {
    blocks: Range<usize>,
    /// Entries, active ones first.
    entries: Vec<Entry>,
    active: usize,
    /// Largest radius of the entries that are not active, metres.
    pub widest_other: f32,
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
        widest_other: 0.0,
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

    /// Inserts the active segments.
    pub fn insert_active<T: Real>(
        &mut self,
        model: &Model<T>,
        displacements: &Displacements,
        slice: &Slice,
        cells: &Cells,
    ) {
        self.entries.clear();
        for (place, live) in places(model, self.blocks.clone()) {
            for lane in lanes(fast_lanes(displacements, slice, place, live)) {
                let segment = LANES * place + lane;
                if is_active(displacements, slice, segment) {
                    insert(&mut self.entries, displacements, slice, cells, segment, |_, _| true);
                }
            }
        }
        self.active = self.entries.len();
    }

    /// Marks the regions in which the middle of another entry can be whose ball touches an active
    /// segment.
    pub fn mark(&self, cells: &Cells, marks: &Marks) {
        for entry in &self.entries[..self.active] {
            let reach = entry.radius - entry.half.length();
            marks.mark(entry.middle, entry.half, reach + cells.widest_other);
        }
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
        let most = slice.other_reach(cells.edge);
        let longest = 2.0 * (cells.widest_other - most);
        for block in &model.blocks[self.blocks.clone()] {
            let middles = |place: usize| middles(displacements, place, slice.middle());
            let mut lower = middles(block.first);
            for place in block.first..block.first + block.particles - 1 {
                let upper = middles(place + 1);
                let [near, long] = widest(
                    #[inline(always)]
                    || near_lanes(marks, &lower, &upper, longest),
                );
                lower = upper;
                let live = u32::MAX >> (32 - block.live);
                let fast = fast_lanes(displacements, slice, place, block.live);
                for lane in lanes((near | long) & live) {
                    let segment = LANES * place + lane;
                    if fast >> lane & 1 != 0 && is_active(displacements, slice, segment) {
                        continue;
                    }
                    let is_long = long >> lane & 1 != 0;
                    insert(&mut self.entries, displacements, slice, cells, segment, |middle, radius| {
                        !is_long || radius > cells.widest_other || marks.has(middle)
                    });
                }
            }
        }
        self.widest_other = self.entries[self.active..].iter().map(|entry| entry.radius).fold(0.0, f32::max);
        self.sort(cells);
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

/// The places of the lower particles of all segments of `blocks`, each with the number of strands.
fn places<T: Real>(model: &Model<T>, blocks: Range<usize>) -> impl Iterator<Item = (usize, usize)> {
    model.blocks[blocks]
        .iter()
        .flat_map(|block| (block.first..block.first + block.particles - 1).map(|place| (place, block.live)))
}

/// The lanes whose bits are set.
fn lanes(mut bits: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let lane = bits.trailing_zeros() as usize;
        bits &= bits.wrapping_sub(1);
        (lane < 32).then_some(lane)
    })
}

/// Bits of the lanes for which `f` is true.
#[inline(always)]
fn bits(f: [bool; LANES]) -> u32 {
    f.iter().enumerate().fold(0, |bits, (lane, &own)| bits | u32::from(own) << lane)
}

/// The first `live` lanes whose segments may be active.
#[inline]
fn fast_lanes(displacements: &Displacements, slice: &Slice, place: usize, live: usize) -> u32 {
    let floor = slice.active.floor();
    let rows = &displacements.residual_motion[LANES * place..LANES * (place + 2)];
    let (lower, upper) = rows.split_at(LANES);
    let mut is_fast = [false; LANES];
    for lane in 0..LANES {
        is_fast[lane] = lower[lane].max(upper[lane]) >= floor;
    }
    if is_fast == [false; LANES] { 0 } else { bits(is_fast) & u32::MAX >> (32 - live) }
}

/// Positions of the particles of a place at a fraction of the frame.
#[inline(always)]
fn middles(displacements: &Displacements, place: usize, fraction: f32) -> [[f32; LANES]; 3] {
    let [start, end] = displacements.rows(place);
    let mut at = start;
    for c in 0..3 {
        for lane in 0..LANES {
            at[c][lane] += fraction * (end[c][lane] - start[c][lane]);
        }
    }
    at
}

/// The lanes whose segments have their middles in marked cells, and those longer than `longest`.
#[inline(always)]
fn near_lanes(marks: &Marks, lower: &[[f32; LANES]; 3], upper: &[[f32; LANES]; 3], longest: f32) -> [u32; 2] {
    let (mut middles, mut squares) = ([[0.0; LANES]; 3], [0.0f32; LANES]);
    for c in 0..3 {
        for lane in 0..LANES {
            middles[c][lane] = 0.5 * (lower[c][lane] + upper[c][lane]);
            squares[lane] += (upper[c][lane] - lower[c][lane]).powi(2);
        }
    }
    [bits(marks.marked(&middles)), bits(squares.map(|square| square > longest * longest))]
}

/// Whether segment `a` is active.
#[inline]
fn is_active(displacements: &Displacements, slice: &Slice, a: usize) -> bool {
    slice.active.includes(a, displacements.residual_motion[a].max(displacements.residual_motion[a + LANES]))
}

/// Inserts segment `a` at its position in the middle of the slice, split into pieces if it is long.
/// Skips pieces that are outside the grid of cells and pieces for whose ball, its centre and its
/// radius, `is_near` is false.
#[inline]
fn insert(
    entries: &mut Vec<Entry>,
    displacements: &Displacements,
    slice: &Slice,
    cells: &Cells,
    a: usize,
    is_near: impl Fn(Vec3, f32) -> bool,
) {
    let (lower, upper) = (displacements.at(a, slice.middle()), displacements.at(a + LANES, slice.middle()));
    let edge = upper - lower;
    let length = edge.length();
    let pieces = (length / (PIECE * cells.edge)).ceil().clamp(1.0, PIECES);
    let half = edge * (0.5 / pieces);
    let active = is_active(displacements, slice, a);
    let residual_motion = displacements.residual_motion[a].max(displacements.residual_motion[a + LANES]);
    let radius = 0.5 * length / pieces + slice.reach(residual_motion, active, cells.edge);
    for piece in 0..pieces as usize {
        let middle = lower + (2 * piece + 1) as f32 * half;
        if !(cells.holds(middle) && is_near(middle, radius)) {
            continue;
        }
        let (displacement, next) =
            (slice.length() * displacements.of(a), slice.length() * displacements.of(a + LANES));
        entries.push(Entry {
            segment: a as u32 | if active { ACTIVE } else { 0 },
            middle,
            half,
            inverse: 1.0 / half.length_squared().max(1e-20),
            radius,
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
