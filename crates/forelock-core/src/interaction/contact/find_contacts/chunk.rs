//! The segments of a time slice, chunk by chunk.

use super::cells::{Cells, SoaCells};
use super::marks::Marks;
use super::pairs::{ACTIVE, Entry, Test};
use super::{Slice, keep_fastest};
use crate::interaction::contact::displacements::Place;
use crate::interaction::contact::{Contact, Displacements, Histogram};
use crate::lane::{LANES, Real, widest};
use crate::scratch::fill;
use crate::strands::Model;
use glam::Vec3;
use std::ops::Range;

/// Number of chunks of blocks. It is fixed, so that results do not depend on the number of threads.
const CHUNKS: usize = 64;
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

/// The motion of the hair in a slice.
#[derive(Clone, Copy, Debug)]
pub(super) struct Motion<'a> {
    pub displacements: &'a Displacements,
    pub slice: &'a Slice,
    /// The cells of active segments, and of those near them.
    pub cells: &'a [Cells; 2],
    /// See [`search_edge`](super::search_edge).
    pub edge: f32,
}

/// Entries, and their order by layer.
#[derive(Debug, Default)]
pub(crate) struct Entries {
    list: Vec<Entry>,
    /// Largest radius, metres.
    pub widest: f32,
    /// Whether some segments are split into pieces.
    pub in_pieces: bool,
    /// Indices of the entries sorted by layer, and the start of each layer, `[layers + 1]`.
    order: Vec<u32>,
    starts: Vec<u32>,
}

impl Entries {
    fn bytes(&self) -> usize {
        self.list.capacity() * size_of::<Entry>() + 4 * (self.order.capacity() + self.starts.capacity())
    }

    fn clear(&mut self) {
        self.list.clear();
        self.widest = 0.0;
    }

    /// Sorts the entries by layer.
    fn sort(&mut self, cells: &Cells) {
        self.in_pieces = self.list.windows(2).any(|pair| pair[0].segment == pair[1].segment);
        fill(&mut self.starts, cells.layers() + 1, 0);
        for entry in &self.list {
            self.starts[cells.layer_of(entry.middle) + 1] += 1;
        }
        for k in 1..self.starts.len() {
            self.starts[k] += self.starts[k - 1];
        }
        fill(&mut self.order, self.list.len(), 0);
        for (entry, number) in self.list.iter().zip(0..) {
            let next = &mut self.starts[cells.layer_of(entry.middle)];
            self.order[*next as usize] = number;
            *next += 1;
        }
        // Each entry now holds the start of the next layer.
        self.starts.rotate_right(1);
        self.starts[0] = 0;
    }

    /// The entries of layer `k`.
    pub fn layer(&self, k: usize) -> impl ExactSizeIterator<Item = &Entry> {
        let own = self.starts[k] as usize..self.starts[k + 1] as usize;
        self.order[own].iter().map(|&number| &self.list[number as usize])
    }
}

/// A range of blocks, and the entries of their segments.
#[derive(Debug)]
pub(crate) struct Chunk {
    blocks: Range<usize>,
    /// The active segments.
    pub active: Entries,
    /// The other segments near active ones.
    pub others: Entries,
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
        active: Entries::default(),
        others: Entries::default(),
        near: Vec::new(),
        found: Vec::new(),
        approaches: Histogram::default(),
    };
    model.parts(CHUNKS).map(chunk).collect()
}

impl Chunk {
    pub fn bytes(&self) -> usize {
        self.active.bytes()
            + self.others.bytes()
            + self.found.capacity() * size_of::<Contact>()
            + self.approaches.bytes()
            + 4 * self.near.capacity()
    }

    /// Inserts the active segments, sorted by layer.
    pub fn insert_active<T: Real>(&mut self, model: &Model<T>, motion: &Motion<'_>) {
        self.active.clear();
        for (place, live) in places(model, self.blocks.clone()) {
            for lane in lanes(fast_lanes(motion, place, live)) {
                let segment = LANES * place + lane;
                if is_active(motion, segment) {
                    insert(&mut self.active, motion, segment, |_, _| true);
                }
            }
        }
        self.active.sort(&motion.cells[0]);
    }

    /// Marks the regions in which the middle of an entry of radius `widest_other` can be whose ball
    /// touches an active segment.
    pub fn mark(&self, widest_other: f32, marks: &Marks) {
        for entry in &self.active.list {
            marks.mark(entry.middle, entry.half, entry.reach + widest_other);
        }
    }

    /// Whether the chunk has no active segments.
    pub fn has_no_active(&self) -> bool {
        self.active.list.is_empty()
    }

    /// Inserts the other segments that are near active ones, sorted by layer. Segments longer than
    /// `longest` are looked at piece by piece, and those of a radius above `widest_other` count as
    /// near.
    pub fn insert_others<T: Real>(
        &mut self,
        model: &Model<T>,
        motion: &Motion<'_>,
        marks: &Marks,
        [longest, widest_other]: [f32; 2],
    ) {
        self.others.clear();
        let middle = motion.slice.middle();
        for block in &model.blocks[self.blocks.clone()] {
            let mut lower = motion.displacements.place_at(block.first, middle);
            for place in block.first..block.first + block.particles - 1 {
                let ([near, long], upper) = widest(
                    #[inline(always)]
                    || {
                        let upper = motion.displacements.place_at(place + 1, middle);
                        (near_lanes(marks, &lower, &upper, longest), upper)
                    },
                );
                lower = upper;
                let live = u32::MAX >> (32 - block.live);
                let fast = fast_lanes(motion, place, block.live);
                for lane in lanes((near | long) & live) {
                    let segment = LANES * place + lane;
                    if fast >> lane & 1 != 0 && is_active(motion, segment) {
                        continue;
                    }
                    let is_long = long >> lane & 1 != 0;
                    insert(&mut self.others, motion, segment, |middle, radius| {
                        !is_long || radius > widest_other || marks.has(middle)
                    });
                }
            }
        }
        self.others.sort(&motion.cells[1]);
    }

    /// Finds the contacts of the active segments with each other and with the others, which are in
    /// `cells`. For each pair that passes `test` with `limits`, `follow` returns the contact, if
    /// there is one. Where more than `2 * most` contacts are found, only the `most` with the
    /// largest approach are kept.
    pub fn search(
        &mut self,
        cells: &[SoaCells; 2],
        test: Test,
        limits: [f32; 2],
        most: usize,
        follow: impl Fn([u32; 2]) -> Option<Contact>,
    ) {
        self.found.clear();
        for pieces in self.active.list.chunk_by(|a, b| a.segment == b.segment) {
            self.near.clear();
            for (entry, cells) in pieces.iter().flat_map(|entry| cells.iter().map(move |own| (entry, own))) {
                // SAFETY: `test_for` returns only functions that the processor supports.
                unsafe { test(cells, entry, limits, &mut self.near) };
            }
            if pieces.len() > 1 || cells.iter().any(|own| own.has_pieces) {
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
fn fast_lanes(motion: &Motion<'_>, place: usize, live: usize) -> u32 {
    let floor = motion.slice.active.floor();
    let rows = &motion.displacements.residual_motion[LANES * place..LANES * (place + 2)];
    let (lower, upper) = rows.split_at(LANES);
    let mut is_fast = [false; LANES];
    for lane in 0..LANES {
        is_fast[lane] = lower[lane].max(upper[lane]) >= floor;
    }
    if is_fast == [false; LANES] { 0 } else { bits(is_fast) & u32::MAX >> (32 - live) }
}

/// The lanes whose segments have their middles in marked cells, and those longer than `longest`.
#[inline(always)]
fn near_lanes(marks: &Marks, lower: &Place, upper: &Place, longest: f32) -> [u32; 2] {
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
fn is_active(motion: &Motion<'_>, a: usize) -> bool {
    let residual_motion = &motion.displacements.residual_motion;
    motion.slice.active.includes(a, residual_motion[a].max(residual_motion[a + LANES]))
}

/// Inserts segment `a` at its position in the middle of the slice, split into pieces if it is long.
/// Skips pieces that are outside the grid of cells and pieces for whose ball, its centre and its
/// radius, `is_near` is false.
#[inline]
fn insert(entries: &mut Entries, motion: &Motion<'_>, a: usize, is_near: impl Fn(Vec3, f32) -> bool) {
    let Motion { displacements, slice, cells, edge } = *motion;
    let (lower, upper) = (displacements.at(a, slice.middle()), displacements.at(a + LANES, slice.middle()));
    let along = upper - lower;
    let length = along.length();
    let pieces = (length / (PIECE * edge)).ceil().clamp(1.0, PIECES);
    let half = along * (0.5 / pieces);
    let active = is_active(motion, a);
    let cells = &cells[usize::from(!active)];
    let residual_motion = displacements.residual_motion[a].max(displacements.residual_motion[a + LANES]);
    let reach = slice.reach(residual_motion, active, edge);
    let radius = 0.5 * length / pieces + reach;
    for piece in 0..pieces as usize {
        let middle = lower + (2 * piece + 1) as f32 * half;
        if !(cells.holds(middle) && is_near(middle, radius)) {
            continue;
        }
        let (displacement, next) =
            (slice.length() * displacements.of(a), slice.length() * displacements.of(a + LANES));
        entries.widest = entries.widest.max(radius);
        entries.list.push(Entry {
            segment: a as u32 | if active { ACTIVE } else { 0 },
            middle,
            half,
            inverse: 1.0 / half.length_squared().max(1e-20),
            radius,
            reach,
            displacement: 0.5 * (displacement + next),
            spread: 0.5 * displacement.distance(next),
        });
    }
}
