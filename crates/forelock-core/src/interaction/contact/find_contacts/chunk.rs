//! The segments of a time slice, chunk by chunk.

use super::cells::Cells;
use super::follow::{Follower, Paths};
use super::marks::{CellRows, Marks};
use super::pairs::{ACTIVE, Entry, Test};
use super::tree::Tree;
use super::{Slice, keep_fastest};
use crate::interaction::contact::displacements::{ORIGIN, Place, square};
use crate::interaction::contact::{Contact, Displacements, Histogram};
use crate::lane::{LANES, Lane, Real, Row, Simd, V3, on};
use crate::strands::Model;
use glam::Vec3;
use std::ops::Range;

/// Number of chunks of blocks. It is fixed, so that results do not depend on the number of threads.
pub(super) const CHUNKS: usize = 64;
/// Number of pairs that are collected before they are followed.
const PAIRS: usize = 256;
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
    /// The cells that hold the hair.
    pub cells: &'a Cells,
    /// See [`search_edge`](super::search_edge).
    pub edge: f32,
}

/// A range of blocks, and the entries of their segments.
#[derive(Debug)]
pub(crate) struct Chunk {
    blocks: Range<usize>,
    /// The active segments.
    pub active: Vec<Entry>,
    /// The other segments near active ones.
    pub others: Vec<Entry>,
    /// Whether some segments are split into pieces.
    pub has_pieces: bool,
    /// Candidates of one segment.
    near: Vec<u32>,
    /// Pairs of segments that are not followed yet.
    pairs: Vec<[u32; 2]>,
    /// Contacts of the active segments.
    pub found: Vec<Contact>,
    approaches: Histogram,
}

/// Splits the blocks of `model` into chunks, whose number does not depend on the number of threads.
pub(super) fn chunks<T: Real>(model: &Model<T>) -> Vec<Chunk> {
    let chunk = |blocks| Chunk {
        blocks,
        active: Vec::new(),
        others: Vec::new(),
        has_pieces: false,
        near: Vec::new(),
        pairs: Vec::new(),
        found: Vec::new(),
        approaches: Histogram::default(),
    };
    model.parts(CHUNKS).map(chunk).collect()
}

impl Chunk {
    pub fn bytes(&self) -> usize {
        (self.active.capacity() + self.others.capacity()) * size_of::<Entry>()
            + self.found.capacity() * size_of::<Contact>()
            + self.approaches.bytes()
            + 4 * self.near.capacity()
            + 8 * self.pairs.capacity()
    }

    /// Inserts the active segments.
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
    }

    /// Marks the regions in which the middle of an entry of radius `widest_other` can be whose ball
    /// touches an active segment.
    pub fn mark(&self, widest_other: f32, marks: &Marks) {
        for entry in &self.active {
            marks.mark(entry.middle, entry.half, entry.reach + widest_other);
        }
    }

    /// Whether the chunk has no active segments.
    pub fn has_no_active(&self) -> bool {
        self.active.is_empty()
    }

    /// Inserts the other segments that are near active ones. Segments longer than
    /// `longest` are looked at piece by piece, and those of a radius above `widest_other` count as
    /// near.
    pub fn insert_others<T: Real>(
        &mut self,
        model: &Model<T>,
        motion: &Motion<'_>,
        marks: &Marks,
        [longest, widest_other]: [f32; 2],
        near_rows: NearRows,
    ) {
        self.others.clear();
        let mut rows = EntryRows::default();
        for block in &model.blocks[self.blocks.clone()] {
            let live = u32::MAX >> (32 - block.live);
            for place in block.first..block.first + block.particles - 1 {
                let at = Segments { place, live, longest };
                // SAFETY: `near_rows_for` returns only functions that the processor supports.
                let [near, long] = unsafe { near_rows(motion, marks, at, &mut rows) };
                if (near | long) & live == 0 {
                    continue;
                }
                let fast = fast_lanes(motion, place, block.live);
                for lane in lanes((near | long) & live) {
                    let segment = LANES * place + lane;
                    if fast >> lane & 1 != 0 && is_active(motion, segment) {
                        continue;
                    }
                    if long >> lane & 1 == 0 {
                        if motion.cells.holds(rows.middle(lane)) {
                            self.others.push(rows.entry(place, lane));
                        }
                    } else {
                        insert(&mut self.others, motion, segment, |middle, radius| {
                            radius > widest_other || marks.has(middle)
                        });
                    }
                }
            }
        }
        let lists = [&self.active, &self.others];
        let is_split = |list: &Vec<Entry>| list.windows(2).any(|pair| pair[0].segment == pair[1].segment);
        self.has_pieces = lists.into_iter().any(is_split);
    }

    /// Finds the contacts of the active segments with each other and with the others, which are in
    /// `tree`. Pairs that pass `test` with `limits` are followed. If segments are in pieces,
    /// `has_pieces`, a pair can pass more than once. Where more than `2 * most` contacts are found,
    /// only the `most` with the largest approach are kept.
    pub fn search<T: Real>(
        &mut self,
        tree: &Tree,
        has_pieces: bool,
        test: Test,
        limits: [f32; 2],
        most: usize,
        follower: &Follower<'_, T>,
    ) {
        self.found.clear();
        self.pairs.clear();
        let mut paths = Paths::default();
        for pieces in self.active.chunk_by(|a, b| a.segment == b.segment) {
            self.near.clear();
            for entry in pieces {
                // SAFETY: `test_for` returns only functions that the processor supports.
                unsafe { test(tree, entry, limits, &mut self.near) };
            }
            if has_pieces {
                self.near.sort_unstable();
                self.near.dedup();
            }
            let own = pieces[0].segment & !ACTIVE;
            let others = self.near.iter().filter(|&&other| !follower.is_one_strand(own, other));
            self.pairs.extend(others.map(|&other| [own.min(other), own.max(other)]));
            if self.pairs.len() >= PAIRS {
                follower.follow(&self.pairs, &mut paths, &mut self.found);
                self.pairs.clear();
            }
            if self.found.len() > 2 * most {
                keep_fastest(&mut self.found, most, &mut self.approaches);
            }
        }
        follower.follow(&self.pairs, &mut paths, &mut self.found);
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
    let [lower, upper] = [place, place + 1].map(|place| &motion.displacements.residual_motion[place].0);
    let mut is_fast = [false; LANES];
    for lane in 0..LANES {
        is_fast[lane] = lower[lane].max(upper[lane]) >= floor;
    }
    if is_fast == [false; LANES] { 0 } else { bits(is_fast) & u32::MAX >> (32 - live) }
}

/// The entries of the segments of a place that are not active and in one piece, lane by lane.
#[derive(Debug)]
pub(super) struct EntryRows {
    middle: Place,
    half: Place,
    displacement: Place,
    radius: Row<f32>,
    inverse: Row<f32>,
    reach: Row<f32>,
    spread: Row<f32>,
}

impl Default for EntryRows {
    fn default() -> Self {
        let row = Row([0.0; LANES]);
        let (radius, inverse, reach, spread) = (row, row, row, row);
        Self { middle: ORIGIN, half: ORIGIN, displacement: ORIGIN, radius, inverse, reach, spread }
    }
}

/// The segments of a place.
#[derive(Clone, Copy, Debug)]
pub(super) struct Segments {
    /// Of their lower particles.
    place: usize,
    /// Bits of the lanes that hold a strand.
    live: u32,
    /// The longest that are not looked at piece by piece, metres.
    longest: f32,
}

/// Bits of the lanes whose segments have their middles in marked cells, and of those that are
/// longer than `longest`; if there are any, writes the entries of the place.
///
/// # Safety
/// The processor must support the instruction set of the function.
pub(super) type NearRows = unsafe fn(&Motion<'_>, &Marks, Segments, &mut EntryRows) -> [u32; 2];

/// The function for `simd`, or the portable one if `simd` is not supported.
#[inline(never)]
pub(super) fn near_rows_for(simd: Simd) -> NearRows {
    let simd = simd.resolve();
    let simd = if simd.is_supported() { simd } else { Simd::Portable };
    on!(simd, near_rows(motion: &Motion<'_>, marks: &Marks, at: Segments, rows: &mut EntryRows) -> [u32; 2])
}

#[inline(always)]
fn near_rows<L: Lane<Scalar = f32>>(
    motion: &Motion<'_>,
    marks: &Marks,
    at: Segments,
    rows: &mut EntryRows,
) -> [u32; 2] {
    let Motion { displacements, slice, edge, .. } = *motion;
    // No closures: the compiler does not inline instructions of other sets into them.
    let [from, to] = displacements.place(at.place);
    let [from_next, to_next] = displacements.place(at.place + 1);
    let (when, half) = (L::splat(slice.middle()), L::splat(0.5));
    let (mut cells, mut long) = (CellRows::default(), 0);
    for first in (0..LANES).step_by(L::WIDTH) {
        let lower = between(V3::<L>::load(from, 0, first), V3::load(to, 0, first), when);
        let upper = between(V3::<L>::load(from_next, 0, first), V3::load(to_next, 0, first), when);
        let middle = (lower + upper).scale(half);
        middle.store(&mut rows.middle, 0, first);
        (upper - lower).scale(half).store(&mut rows.half, 0, first);
        marks.locate(middle, first, &mut cells);
        long |= L::bits(L::splat(at.longest * at.longest).lt(square(upper - lower))) << first;
    }
    let near = marks.marked(&cells);
    if (near | long) & at.live == 0 {
        return [0; 2];
    }
    let dt = L::splat(0.5 * slice.length());
    let [base, slope, most] = slice.reach_terms(false, edge);
    let residual = &displacements.residual_motion;
    for first in (0..LANES).step_by(L::WIDTH) {
        let lower_moved = V3::<L>::load(to, 0, first) - V3::load(from, 0, first);
        let upper_moved = V3::<L>::load(to_next, 0, first) - V3::load(from_next, 0, first);
        (lower_moved + upper_moved).scale(dt).store(&mut rows.displacement, 0, first);
        square((upper_moved - lower_moved).scale(dt)).sqrt().store(&mut rows.spread, first);
        let half_squared = square(V3::<L>::load(&rows.half, 0, first));
        (L::one() / half_squared.max(L::splat(1e-20))).store(&mut rows.inverse, first);
        let residual = L::load(&residual[at.place], first).max(L::load(&residual[at.place + 1], first));
        let reach = (L::splat(base) + L::splat(slope) * residual).min(L::splat(most));
        reach.store(&mut rows.reach, first);
        (half_squared.sqrt() + reach).store(&mut rows.radius, first);
    }
    [near, long]
}

/// A position at the fraction `when` between two.
#[inline(always)]
fn between<L: Lane>(from: V3<L>, to: V3<L>, when: L) -> V3<L> {
    from + (to - from).scale(when)
}

impl EntryRows {
    fn middle(&self, lane: usize) -> Vec3 {
        Vec3::from_array(self.middle.map(|row| row.0[lane]))
    }

    fn entry(&self, place: usize, lane: usize) -> Entry {
        Entry {
            segment: (LANES * place + lane) as u32,
            middle: self.middle(lane),
            half: Vec3::from_array(self.half.map(|row| row.0[lane])),
            inverse: self.inverse.0[lane],
            reach: self.reach.0[lane],
            radius: self.radius.0[lane],
            displacement: Vec3::from_array(self.displacement.map(|row| row.0[lane])),
            spread: self.spread.0[lane],
        }
    }
}

/// Whether segment `a` is active.
#[inline]
fn is_active(motion: &Motion<'_>, a: usize) -> bool {
    motion.slice.active.includes(a, motion.displacements.residual_of_segment(a))
}

/// Inserts segment `a` at its position in the middle of the slice, split into pieces if it is long.
/// Skips pieces that are outside the grid of cells and pieces for whose ball, its centre and its
/// radius, `is_near` is false.
#[inline]
fn insert(entries: &mut Vec<Entry>, motion: &Motion<'_>, a: usize, is_near: impl Fn(Vec3, f32) -> bool) {
    let Motion { displacements, slice, cells, edge } = *motion;
    let (lower, upper) = (displacements.at(a, slice.middle()), displacements.at(a + LANES, slice.middle()));
    let along = upper - lower;
    let length = along.length();
    let pieces = (length / (PIECE * edge)).ceil().clamp(1.0, PIECES);
    let half = along * (0.5 / pieces);
    let active = is_active(motion, a);
    let reach = slice.reach(displacements.residual_of_segment(a), active, edge);
    let radius = 0.5 * length / pieces + reach;
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
            reach,
            displacement: 0.5 * (displacement + next),
            spread: 0.5 * displacement.distance(next),
        });
    }
}
