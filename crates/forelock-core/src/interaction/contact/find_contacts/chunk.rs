//! The segments of a time slice, chunk by chunk.

use super::cells::Cells;
use super::follow::{Follower, Paths};
use super::marks::Marks;
use super::pairs::{ACTIVE, Entry, Test};
use super::tree::Tree;
use super::{Slice, keep_fastest};
use crate::interaction::contact::displacements::{ORIGIN, Place};
use crate::interaction::contact::{Contact, Displacements, Histogram};
use crate::lane::{LANES, Real, widest};
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
    ) {
        self.others.clear();
        for block in &model.blocks[self.blocks.clone()] {
            for place in block.first..block.first + block.particles - 1 {
                let (rows, near, long) = widest(
                    #[inline(always)]
                    || {
                        let rows = EntryRows::new(motion, place);
                        let mut is_long = [false; LANES];
                        is_long.iter_mut().zip(rows.length).for_each(|(is, l)| *is = l > longest);
                        let near = marks.marked(&rows.middle);
                        (rows, near, bits(is_long))
                    },
                );
                let live = u32::MAX >> (32 - block.live);
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
    let rows = &motion.displacements.residual_motion[LANES * place..LANES * (place + 2)];
    let (lower, upper) = rows.split_at(LANES);
    let mut is_fast = [false; LANES];
    for lane in 0..LANES {
        is_fast[lane] = lower[lane].max(upper[lane]) >= floor;
    }
    if is_fast == [false; LANES] { 0 } else { bits(is_fast) & u32::MAX >> (32 - live) }
}

/// The entries of the segments of a place that are not active and in one piece, lane by lane.
struct EntryRows {
    middle: Place,
    half: Place,
    displacement: Place,
    length: [f32; LANES],
    inverse: [f32; LANES],
    reach: [f32; LANES],
    spread: [f32; LANES],
}

impl EntryRows {
    #[inline(always)]
    fn new(motion: &Motion<'_>, place: usize) -> Self {
        let Motion { displacements, slice, edge, .. } = *motion;
        let ([from, to], [from_next, to_next]) = (displacements.place(place), displacements.place(place + 1));
        let (when, dt) = (slice.middle(), slice.length());
        let mut out = Self {
            middle: ORIGIN,
            half: ORIGIN,
            displacement: ORIGIN,
            length: [0.0; LANES],
            inverse: [0.0; LANES],
            reach: [0.0; LANES],
            spread: [0.0; LANES],
        };
        let (mut squares, mut spreads) = ([0.0; LANES], [0.0; LANES]);
        for c in 0..3 {
            for lane in 0..LANES {
                let lower_moved = to[c].0[lane] - from[c].0[lane];
                let upper_moved = to_next[c].0[lane] - from_next[c].0[lane];
                let lower = from[c].0[lane] + when * lower_moved;
                let upper = from_next[c].0[lane] + when * upper_moved;
                out.middle[c].0[lane] = 0.5 * (lower + upper);
                out.half[c].0[lane] = 0.5 * (upper - lower);
                out.displacement[c].0[lane] = 0.5 * dt * (lower_moved + upper_moved);
                let apart = 0.5 * dt * (upper_moved - lower_moved);
                spreads[lane] += apart * apart;
                squares[lane] += out.half[c].0[lane] * out.half[c].0[lane];
            }
        }
        let residual = &displacements.residual_motion[LANES * place..LANES * (place + 2)];
        for lane in 0..LANES {
            out.length[lane] = 2.0 * squares[lane].sqrt();
            out.inverse[lane] = 1.0 / squares[lane].max(1e-20);
            out.spread[lane] = spreads[lane].sqrt();
            out.reach[lane] = slice.reach(residual[lane].max(residual[LANES + lane]), false, edge);
        }
        out
    }

    fn middle(&self, lane: usize) -> Vec3 {
        Vec3::from_array(self.middle.map(|row| row.0[lane]))
    }

    fn entry(&self, place: usize, lane: usize) -> Entry {
        Entry {
            segment: (LANES * place + lane) as u32,
            middle: self.middle(lane),
            half: Vec3::from_array(self.half.map(|row| row.0[lane])),
            inverse: self.inverse[lane],
            reach: self.reach[lane],
            radius: 0.5 * self.length[lane] + self.reach[lane],
            displacement: Vec3::from_array(self.displacement.map(|row| row.0[lane])),
            spread: self.spread[lane],
        }
    }
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
fn insert(entries: &mut Vec<Entry>, motion: &Motion<'_>, a: usize, is_near: impl Fn(Vec3, f32) -> bool) {
    let Motion { displacements, slice, cells, edge } = *motion;
    let (lower, upper) = (displacements.at(a, slice.middle()), displacements.at(a + LANES, slice.middle()));
    let along = upper - lower;
    let length = along.length();
    let pieces = (length / (PIECE * edge)).ceil().clamp(1.0, PIECES);
    let half = along * (0.5 / pieces);
    let active = is_active(motion, a);
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
