//! The active segments of a time slice in a tree of boxes.

use super::follow::CLOSE;
use super::pairs::Entry;
use super::rows::{Bounds, join};
use crate::curve::{CURVE_BITS, hilbert};
use crate::lane::{LANES, Lane, Row};
use crate::scratch::resize;
use glam::Vec3;
use rayon::prelude::*;

/// Number of active segments near a row after which no more nodes of the tree are visited for it:
/// what lies at the lower end of the curve is left out.
pub const MOST_NEAR: usize = 1 << 14;
/// Maximum number of levels: 16⁸ entries.
const LEVELS: usize = 8;
/// Nodes that can wait while a tree is traversed.
const STACK: usize = LANES * LEVELS;

/// Bounds of sixteen nodes, axis by axis: of their positions in the middle of the slice, and of
/// their displacements in the slice, a row of lower bounds and one of upper bounds each; and their
/// largest reach.
#[derive(Clone, Copy, Debug)]
struct Boxes {
    positions: [[Row<f32>; 2]; 3],
    displacements: [[Row<f32>; 2]; 3],
    reach: Row<f32>,
}

/// Bounds that hold nothing.
const EMPTY: Boxes = {
    let none = [Row([f32::INFINITY; LANES]), Row([f32::NEG_INFINITY; LANES])];
    Boxes { positions: [none; 3], displacements: [none; 3], reach: Row([0.0; LANES]) }
};

impl Boxes {
    fn set(&mut self, lane: usize, [positions, displacements]: &Bounds, reach: f32) {
        self.reach.0[lane] = reach;
        for c in 0..3 {
            for side in 0..2 {
                self.positions[c][side].0[lane] = positions[side][c];
                self.displacements[c][side].0[lane] = displacements[side][c];
            }
        }
    }

    fn get(&self, lane: usize) -> Bounds {
        [&self.positions, &self.displacements]
            .map(|rows| [0, 1].map(|side| Vec3::from_array([0, 1, 2].map(|c: usize| rows[c][side].0[lane]))))
    }

    /// The bounds of all nodes, and their largest reach.
    fn join(&self) -> (Bounds, f32) {
        let bounds = (1..LANES).fold(self.get(0), |bounds, lane| join(&bounds, &self.get(lane)));
        (bounds, self.reach.0.into_iter().fold(0.0, f32::max))
    }
}

/// Active segments sorted along a [`hilbert`] curve, and a tree of boxes over them with sixteen
/// children a node.
#[derive(Debug, Default)]
pub(crate) struct Tree {
    /// Place on the curve and index of each segment, in this order of bits.
    order: Vec<u64>,
    /// The segments along the curve.
    pub entries: Vec<Entry>,
    /// Boxes of the segments, then those of sixteen nodes of the level before, up to a single node.
    levels: [Vec<Boxes>; LEVELS],
    /// How many levels are in use.
    depth: usize,
}

impl Tree {
    pub fn bytes(&self) -> usize {
        let levels: usize = self.levels.iter().map(Vec::capacity).sum();
        8 * self.order.capacity() + self.entries.capacity() * size_of::<Entry>() + levels * size_of::<Boxes>()
    }

    /// Builds the tree of the segments of all `lists`, which lie about in the box from `low` to
    /// `high`. `entries` is a buffer.
    pub fn build<'a>(
        &mut self,
        lists: impl Iterator<Item = &'a [Entry]>,
        [low, high]: [Vec3; 2],
        entries: &mut Vec<Entry>,
    ) {
        entries.clear();
        lists.for_each(|list| entries.extend_from_slice(list));
        let scale = ((1 << CURVE_BITS) as f32 - 1.0) / (high - low).max_element().max(f32::MIN_POSITIVE);
        self.order.clear();
        self.order.extend(entries.iter().zip(0u64..).map(|(entry, k)| {
            let most = ((1 << CURVE_BITS) - 1) as f32;
            let at = ((entry.middle - low) * scale).clamp(Vec3::ZERO, Vec3::splat(most)).to_array();
            u64::from(hilbert(at.map(|x| x as u32))) << 32 | k
        }));
        self.order.par_sort_unstable();
        self.entries.clear();
        self.entries.extend(self.order.iter().map(|&key| entries[key as u32 as usize]));
        let mut count = self.entries.len();
        let mut below: &[Boxes] = &[];
        self.depth = 0;
        for level in &mut self.levels {
            let is_first = self.depth == 0;
            resize(level, count.div_ceil(LANES), EMPTY);
            self.depth += 1;
            for (node, boxes) in level.iter_mut().enumerate() {
                *boxes = EMPTY;
                for lane in 0..LANES.min(count - LANES * node) {
                    if is_first {
                        let entry = &self.entries[LANES * node + lane];
                        boxes.set(lane, &entry.bounds(), entry.reach);
                    } else {
                        let (bounds, reach) = below[LANES * node + lane].join();
                        boxes.set(lane, &bounds, reach);
                    }
                }
            }
            count = level.len();
            below = level;
            if count <= 1 {
                break;
            }
        }
    }

    /// Collects the indices of the segments that may come within `distance` of others in the slice
    /// and approach them by more than `slip`, given the bounds of these and their largest reach; up
    /// to about [`MOST_NEAR`]. The order does not depend on the width of `L`.
    ///
    /// Along no axis are two points of segments farther apart when they touch than `distance`, and
    /// in the middle of the slice they were no farther apart than that and half of their relative
    /// displacement in it. Their reaches bound the same, up to differences of the mean motion and
    /// up to [`REACH`](super::REACH). If their relative displacement is shorter than `slip`, they
    /// approach by less.
    #[inline(always)]
    pub fn collect_near<L: Lane<Scalar = f32>>(
        &self,
        bounds: &Bounds,
        reach: f32,
        [distance, slip]: [f32; 2],
        near: &mut Vec<u32>,
    ) {
        near.clear();
        let mut own = [[[L::zero(); 3]; 2]; 2];
        for k in 0..2 {
            for side in 0..2 {
                for c in 0..3 {
                    own[k][side][c] = L::splat(bounds[k][side][c]);
                }
            }
        }
        let [positions, displacements] = own;
        // More, for rounding and for the tolerance of a contact.
        let wider = 1.0 + 2.0 * CLOSE;
        let (distance, half) = (L::splat(wider * distance), L::splat(0.5));
        let (wider, reach, slip) = (L::splat(wider), L::splat(reach), L::splat(slip * slip));
        let mut waiting = [(0u32, 0u32); STACK];
        waiting[0] = (self.depth as u32 - 1, 0);
        let mut count = 1;
        while count > 0 && near.len() < MOST_NEAR {
            count -= 1;
            let (level, node) = waiting[count];
            let boxes = &self.levels[level as usize][node as usize];
            for first in (0..LANES).step_by(L::WIDTH) {
                let both = wider * (reach + L::load(&boxes.reach, first));
                let (mut apart, mut square) = (0, L::zero());
                for c in 0..3 {
                    let [low, high] = &boxes.positions[c];
                    let below = L::load(low, first) - positions[1][c];
                    let gap = below.max(positions[0][c] - L::load(high, first));
                    let [low, high] = &boxes.displacements[c];
                    let faster = L::load(high, first) - displacements[0][c];
                    let relative = faster.max(displacements[1][c] - L::load(low, first));
                    apart |= L::bits(half.mul_add(relative, distance).min(both).lt(gap));
                    square = relative.mul_add(relative, square);
                }
                apart |= L::bits(square.lt(slip));
                let mut touching = !apart & u32::MAX >> (32 - L::WIDTH);
                while touching != 0 {
                    let child = LANES as u32 * node + first as u32 + touching.trailing_zeros();
                    touching &= touching - 1;
                    if level == 0 {
                        near.push(child);
                    } else {
                        // Never more than fifteen of each level wait when one is visited.
                        waiting[count] = (level - 1, child);
                        count += 1;
                    }
                }
            }
        }
    }
}
