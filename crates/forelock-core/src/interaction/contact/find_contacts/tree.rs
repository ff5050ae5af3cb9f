//! The segments of a time slice in a tree of boxes.

use super::chunk::CHUNKS;
use super::follow::CLOSE;
use super::pairs::{BALL, Entry, REST};
use crate::interaction::contact::RUN_SEGMENTS;
use crate::lane::{LANES, Lane, Row};
use crate::scratch::resize;
use glam::Vec3;
use rayon::prelude::*;

/// Number of groups after which no more nodes of the tree are visited for a segment: what lies at
/// the lower end of the curve is left out.
const MOST_GROUPS: usize = 8 * RUN_SEGMENTS / LANES;
/// Maximum number of lists.
const LISTS: usize = 2 * CHUNKS;
/// Bits of a coordinate in a place on the curve.
const CURVE_BITS: u32 = 10;
/// Maximum number of levels: 16⁸ entries.
const LEVELS: usize = 7;
/// Nodes that can wait while a tree is traversed.
const STACK: usize = LANES * LEVELS;
/// The ball of no entry: so far away that it touches nothing.
const NOWHERE: [Row<f32>; BALL] =
    [Row([1e18; LANES]), Row([1e18; LANES]), Row([1e18; LANES]), Row([0.0; LANES])];

/// Bounds of sixteen nodes, axis by axis: of their positions in the middle of the slice, and of
/// their displacements in the slice, a row of lower bounds and one of upper bounds each; and their
/// largest reach.
#[derive(Clone, Copy, Debug)]
struct Boxes {
    place: [[Row<f32>; 2]; 3],
    moved: [[Row<f32>; 2]; 3],
    reach: Row<f32>,
}

/// Bounds that hold nothing.
const EMPTY: Boxes = {
    let none = [Row([f32::INFINITY; LANES]), Row([f32::NEG_INFINITY; LANES])];
    Boxes { place: [none; 3], moved: [none; 3], reach: Row([0.0; LANES]) }
};

/// Bounds of positions and displacements, lower and upper.
type Bounds = [[Vec3; 2]; 2];

impl Boxes {
    #[inline(always)]
    fn set(&mut self, lane: usize, [place, moved]: Bounds, reach: f32) {
        self.reach.0[lane] = reach;
        for c in 0..3 {
            for side in 0..2 {
                self.place[c][side].0[lane] = place[side][c];
                self.moved[c][side].0[lane] = moved[side][c];
            }
        }
    }

    /// The bounds of all nodes.
    fn join(&self) -> Bounds {
        [&self.place, &self.moved].map(|rows| {
            let least = rows.each_ref().map(|row| row[0].0.into_iter().fold(f32::INFINITY, f32::min));
            let most = rows.each_ref().map(|row| row[1].0.into_iter().fold(f32::NEG_INFINITY, f32::max));
            [Vec3::from_array(least), Vec3::from_array(most)]
        })
    }
}

/// Entries sorted along a space-filling curve (Morton order) in groups of sixteen, and a tree of
/// boxes over the groups with sixteen children a node. As hair lies close and side by side, groups
/// are compact, and most of the tree is never visited.
#[derive(Debug, Default)]
pub(crate) struct Tree {
    /// Place on the curve, chunk and index of each entry, in this order of bits.
    order: Vec<u64>,
    /// A buffer for sorting.
    sorted: Vec<u64>,
    /// Numbers of the segments, with the flag [`ACTIVE`](super::pairs::ACTIVE).
    pub segments: Vec<[u32; LANES]>,
    /// Centres and radii, in the order of [`Entry::ball`]. They lie apart from the rest, since they
    /// rule out most candidates.
    pub balls: Vec<[Row<f32>; BALL]>,
    /// The other fields, in the order of [`Entry::rest`].
    pub rest: Vec<[Row<f32>; REST]>,
    /// Boxes of the groups, then those of sixteen nodes of the level before, up to a single node.
    levels: [Vec<Boxes>; LEVELS],
    /// How many levels are in use.
    depth: usize,
}

impl Tree {
    pub fn bytes(&self) -> usize {
        let levels: usize = self.levels.iter().map(Vec::capacity).sum();
        8 * (self.order.capacity() + self.sorted.capacity())
            + self.segments.capacity() * size_of::<[u32; LANES]>()
            + self.balls.capacity() * size_of::<[Row<f32>; BALL]>()
            + self.rest.capacity() * size_of::<[Row<f32>; REST]>()
            + levels * size_of::<Boxes>()
    }

    /// Builds the tree of all entries of `lists`, which lie in the box from `low` to `high`.
    pub fn build(&mut self, lists: &[&[Entry]; LISTS], [low, high]: [Vec3; 2]) {
        let scale = ((1 << CURVE_BITS) as f32 - 1.0) / (high - low).max_element().max(f32::MIN_POSITIVE);
        let count = lists.iter().map(|list| list.len()).sum();
        resize(&mut self.order, count, 0);
        let mut parts = [const { (0u64, [].as_slice(), [].as_mut_slice()) }; LISTS];
        let mut left = self.order.as_mut_slice();
        for ((part, list), number) in parts.iter_mut().zip(lists).zip(0u64..) {
            debug_assert!(list.len() < 1 << 24, "the index of an entry has 24 bits");
            let (own, rest) = left.split_at_mut(list.len());
            (*part, left) = ((number, *list, own), rest);
        }
        parts.par_iter_mut().for_each(|(number, list, order)| {
            for ((entry, key), k) in list.iter().zip(&mut **order).zip(0u64..) {
                let at = ((entry.middle - low) * scale).max(Vec3::ZERO).to_array();
                let place = spread(at[0] as u32) | spread(at[1] as u32) << 1 | spread(at[2] as u32) << 2;
                *key = u64::from(place) << 32 | *number << 24 | k;
            }
        });
        sort(&mut self.order, &mut self.sorted);
        let groups = self.order.len().div_ceil(LANES);
        resize(&mut self.segments, groups, [0; LANES]);
        resize(&mut self.balls, groups, NOWHERE);
        resize(&mut self.rest, groups, [Row([0.0; LANES]); REST]);
        let Self { order, segments, balls, rest, levels, depth, .. } = self;
        let mut count = groups.div_ceil(LANES);
        for (level, above) in levels.iter_mut().zip(1..) {
            resize(level, count, EMPTY);
            *depth = above;
            if count <= 1 {
                break;
            }
            count = count.div_ceil(LANES);
        }
        let orders = order.par_chunks(LANES * LANES);
        let parts = segments.par_chunks_mut(LANES).zip(balls.par_chunks_mut(LANES));
        let parts = parts.zip(rest.par_chunks_mut(LANES)).zip(&mut *levels[0]).zip(orders);
        parts.for_each(|((((segments, balls), rest), boxes), order)| {
            *boxes = EMPTY;
            for (group, order) in order.chunks(LANES).enumerate() {
                let entries =
                    order.iter().map(|&key| &lists[(key >> 24 & 0xff) as usize][key as usize & 0xff_ffff]);
                let mut reach = 0.0f32;
                let mut own = [[Vec3::INFINITY, Vec3::NEG_INFINITY]; 2];
                balls[group] = NOWHERE;
                let (balls, rest) = (&mut balls[group], &mut rest[group]);
                for (lane, entry) in entries.enumerate() {
                    segments[group][lane] = entry.segment;
                    // Loops over indices: calls of closures are not always inlined.
                    let (ball, others) = (entry.ball(), entry.rest());
                    for k in 0..BALL {
                        balls[k].0[lane] = ball[k];
                    }
                    for k in 0..REST {
                        rest[k].0[lane] = others[k];
                    }
                    reach = if entry.reach > reach { entry.reach } else { reach };
                    let bounds = entry.bounds();
                    for k in 0..2 {
                        own[k] = [own[k][0].min(bounds[k][0]), own[k][1].max(bounds[k][1])];
                    }
                }
                boxes.set(group, own, reach);
            }
        });
        for level in 1..*depth {
            let (below, above) = levels.split_at_mut(level);
            for (boxes, children) in above[0].iter_mut().zip(below[level - 1].chunks(LANES)) {
                *boxes = EMPTY;
                for (lane, child) in children.iter().enumerate() {
                    boxes.set(lane, child.join(), child.reach.0.into_iter().fold(0.0, f32::max));
                }
            }
        }
    }

    /// Calls `visit` with the groups that may come within `distance` of `entry` in the slice, up
    /// to about [`MOST_GROUPS`]. The order does not depend on the width of `L`.
    ///
    /// Along no axis are two points of segments farther apart when they touch than `distance`, and
    /// in the middle of the slice they were no farther apart than that and half of their relative
    /// displacement in it. Their reaches bound the same, up to differences of the mean motion and
    /// up to [`REACH`](super::REACH).
    #[inline(always)]
    pub fn groups<L: Lane<Scalar = f32>>(&self, entry: &Entry, distance: f32, mut visit: impl FnMut(usize)) {
        if self.segments.is_empty() {
            return;
        }
        let bounds = entry.bounds();
        let mut own = [[[L::zero(); 3]; 2]; 2];
        for (of, bounds) in own.iter_mut().zip(&bounds) {
            for side in 0..2 {
                for c in 0..3 {
                    of[side][c] = L::splat(bounds[side][c]);
                }
            }
        }
        let [place, moved] = own;
        // More, for rounding and for the tolerance of a contact.
        let wider = 1.0 + 2.0 * CLOSE;
        let (distance, half) = (L::splat(wider * distance), L::splat(0.5));
        let (wider, reach) = (L::splat(wider), L::splat(entry.reach));
        let mut waiting = [(0u32, 0u32); STACK];
        waiting[0] = (self.depth as u32 - 1, 0);
        let (mut count, mut visited) = (1, 0);
        while count > 0 && visited < MOST_GROUPS {
            count -= 1;
            let (level, node) = waiting[count];
            let boxes = &self.levels[level as usize][node as usize];
            for first in (0..LANES).step_by(L::WIDTH) {
                let both = wider * (reach + L::load(&boxes.reach, first));
                let mut apart = 0;
                for c in 0..3 {
                    let [low, high] = &boxes.place[c];
                    let gap = (L::load(low, first) - place[1][c]).max(place[0][c] - L::load(high, first));
                    let [low, high] = &boxes.moved[c];
                    let relative =
                        (L::load(high, first) - moved[0][c]).max(moved[1][c] - L::load(low, first));
                    apart |= L::bits(half.mul_add(relative, distance).min(both).lt(gap));
                }
                let mut touching = !apart & u32::MAX >> (32 - L::WIDTH);
                while touching != 0 {
                    let child = LANES * node as usize + first + touching.trailing_zeros() as usize;
                    touching &= touching - 1;
                    if level == 0 {
                        visited += 1;
                        visit(child);
                    } else if count < STACK {
                        waiting[count] = (level - 1, child as u32);
                        count += 1;
                    }
                }
            }
        }
    }
}

/// Sorts `order` by its places on the curve; equal ones keep their order. `sorted` is a buffer.
fn sort(order: &mut Vec<u64>, sorted: &mut Vec<u64>) {
    const DIGITS: usize = 1 << CURVE_BITS;
    let digit = |key: u64, c: u32| (key >> (32 + c * CURVE_BITS)) as usize % DIGITS;
    let mut firsts = [[0u32; DIGITS]; 3];
    for &key in &*order {
        for (c, counts) in (0..).zip(&mut firsts) {
            counts[digit(key, c)] += 1;
        }
    }
    resize(sorted, order.len(), 0);
    for (c, firsts) in (0..).zip(&mut firsts) {
        let mut sum = 0;
        for first in firsts.iter_mut() {
            sum += std::mem::replace(first, sum);
        }
        for &key in &*order {
            let to = &mut firsts[digit(key, c)];
            sorted[*to as usize] = key;
            *to += 1;
        }
        std::mem::swap(order, sorted);
    }
}

/// Spreads the lower ten bits of `x` to every third bit.
#[inline(always)]
fn spread(x: u32) -> u32 {
    let x = (x | x << 16) & 0x0300_00ff;
    let x = (x | x << 8) & 0x0300_f00f;
    let x = (x | x << 4) & 0x030c_30c3;
    (x | x << 2) & 0x0924_9249
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entries_are_sorted_by_place_and_keep_their_order() {
        let mut seed = 1u32;
        let mut order: Vec<u64> = (0..5000u64)
            .map(|k| {
                seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                // Few places at first, so that many are equal.
                let bits = if k < 1000 { 3 } else { 3 * CURVE_BITS };
                (u64::from(seed >> 2) % (1 << bits)) << 32 | k
            })
            .collect();
        let mut expected = order.clone();
        expected.sort_unstable();
        sort(&mut order, &mut Vec::new());
        assert_eq!(order, expected);
    }
}
