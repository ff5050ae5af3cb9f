//! Edges that may touch a solid.
//!
//! # Theory
//! Between ends of clearances c_a and c_b an edge of length l is free if c_a + c_b ≥ l. Where that
//! does not say so, the solids are sampled at its middle.
//!
//! # Practice
//! The edges of [`CHUNK`] particles of all lanes share packets of samples: those of one particle
//! seldom fill one.

use super::edges::distance;
use super::particle::lipschitz;
use super::{QueriedStrands, Solids, dot};
use crate::body::PACKET;
use crate::lane::{Lane, Real, V3};
use crate::strands::{BlockView, number, vector};

/// Particles whose edges are selected together.
pub(super) const CHUNK: usize = 8;

/// The choice of the edges that are tested.
pub(super) struct Nearby<'a, L: Lane> {
    queried: QueriedStrands,
    /// How far particles moved: the first component.
    moved: &'a [V3<L>],
    /// Motion up to which an edge is not tested in this query.
    slow: L::Scalar,
    /// The least thinness of a solid: an edge that moved farther may have passed through one.
    thinnest: L::Scalar,
}

impl<'a, L: Lane> Nearby<'a, L> {
    pub fn new(solids: &Solids<'_, L::Scalar>, moved: &'a [V3<L>], queried: QueriedStrands) -> Self {
        let thinnest = solids.solids.iter().map(|solid| solid.shape.thinness()).fold(f64::INFINITY, f64::min);
        let thinnest = number::<L::Scalar>(thinnest);
        Self { queried, moved, slow: thinnest * solids.slow_edges, thinnest }
    }

    /// The lanes whose edges to particles `start` to `start` + [`CHUNK`] may touch a solid.
    #[inline(always)]
    pub fn select(
        &self,
        solids: &Solids<'_, L::Scalar>,
        view: &BlockView<'_, L::Scalar>,
        start: usize,
    ) -> [u32; CHUNK] {
        let (mut tested, mut slow) = ([0; CHUNK], [0; CHUNK]);
        let mut last = self.end(solids, view, start - 1);
        for i in start..(start + CHUNK).min(view.particles) {
            let end = self.end(solids, view, i);
            [tested[i - start], slow[i - start]] = self.near(i, last, end);
            last = end;
        }
        if tested != [0; CHUNK] {
            let far = self.far_from_middle(solids, view, start, tested, slow);
            for (tested, far) in tested.iter_mut().zip(far) {
                *tested &= !far;
            }
        }
        tested
    }

    /// Those of `lanes` whose edge to particle `i` may touch a solid.
    #[inline(always)]
    pub fn select_again(
        &self,
        solids: &Solids<'_, L::Scalar>,
        view: &BlockView<'_, L::Scalar>,
        i: usize,
        lanes: u32,
    ) -> u32 {
        let ends = [i - 1, i].map(|i| self.end(solids, view, i));
        let [tested, slow] = self.near(i, ends[0], ends[1]).map(|own| own & lanes);
        if tested == 0 {
            return 0;
        }
        let (mut only, mut only_slow) = ([0; CHUNK], [0; CHUNK]);
        (only[0], only_slow[0]) = (tested, slow);
        tested & !self.far_from_middle(solids, view, i, only, only_slow)[0]
    }

    /// Position and clearance of particles `i`. Clamped ones are not queried: their clearance is
    /// not known.
    #[inline(always)]
    fn end(&self, solids: &Solids<'_, L::Scalar>, view: &BlockView<'_, L::Scalar>, i: usize) -> (V3<L>, L) {
        let first = self.queried.first;
        let clearance = if i < solids.clamped { L::zero() } else { L::load(&view.clearance[i], first) };
        (V3::load(view.positions, i, first), clearance)
    }

    /// The lanes whose edge to particle `i` is near a solid, and those among them in which it is
    /// too slow to have passed through one.
    #[inline(always)]
    fn near(&self, i: usize, last: (V3<L>, L), end: (V3<L>, L)) -> [u32; 2] {
        let ((a, near), (b, far)) = (last, end);
        let edge = b - a;
        let room = near + far;
        let moved = self.moved[i].0[0].max(self.moved[i - 1].0[0]);
        let is_near = L::bits((room * room).lt(edge.dot(edge))) & self.queried.lanes;
        // Particles that were inside are being pushed out.
        let is_inside = L::bits(near.min(far).lt(L::zero()));
        let tested = is_near & !is_inside & L::bits(L::splat(self.slow).lt(moved));
        [tested, tested & !L::bits(L::splat(self.thinnest).lt(moved))]
    }

    /// Those of the lanes in `edges`, an entry for each particle from `start` on, in which the
    /// solids are too far from the middle of the edge to touch it anywhere, nor on its path if it
    /// is not `slow`.
    #[inline(never)]
    fn far_from_middle(
        &self,
        solids: &Solids<'_, L::Scalar>,
        view: &BlockView<'_, L::Scalar>,
        start: usize,
        edges: [u32; CHUNK],
        slow: [u32; CHUNK],
    ) -> [u32; CHUNK] {
        let mut far = [0; CHUNK];
        let mut middles = Middles::new();
        for (k, mut lanes) in edges.into_iter().enumerate() {
            while lanes != 0 {
                let lane = lanes.trailing_zeros() as usize;
                lanes &= lanes - 1;
                let i = start + k;
                let slot = middles.push(solids, view, i, self.queried.first + lane);
                middles.at[slot] = (k, lane);
                if slow[k] >> lane & 1 == 0 {
                    middles.moved[slot] = self.moved[i].0[0].max(self.moved[i - 1].0[0]).get(lane);
                }
                if middles.count == PACKET {
                    middles.test(solids, &mut far);
                }
            }
        }
        if middles.count > 0 {
            middles.test(solids, &mut far);
        }
        far
    }
}

/// A packet of edges.
///
/// A field is taken to be no more curved than a ball of half the edge's length: from the middle to
/// a quarter of the edge the distance falls by less than by its slope and 1/16 of the length, to
/// its ends by twice the one and four times the other.
struct Middles<T> {
    count: usize,
    /// Entry and lane of each.
    at: [(usize, usize); PACKET],
    points: [[T; PACKET]; 3],
    edges: [[T; PACKET]; 3],
    half: [T; PACKET],
    /// How far primitives must be from the middle.
    reach: [T; PACKET],
    /// How far edges moved whose paths are tested too.
    moved: [T; PACKET],
}

impl<T: Real> Middles<T> {
    fn new() -> Self {
        let none = [T::zero(); PACKET];
        let (points, edges) = ([none; 3], [none; 3]);
        Self { count: 0, at: [(0, 0); PACKET], points, edges, half: none, reach: none, moved: none }
    }

    #[inline(always)]
    fn push(&mut self, solids: &Solids<'_, T>, view: &BlockView<'_, T>, i: usize, lane: usize) -> usize {
        let k = self.count;
        self.moved[k] = T::zero();
        let ends = [i - 1, i].map(|i| vector(view.positions, i, lane));
        let clearance = |i: usize| view.clearance[i].0[lane].max(T::zero());
        self.half[k] = distance(ends[0], ends[1]) * number(0.5);
        self.reach[k] =
            self.half[k] - if i <= solids.clamped { T::zero() } else { clearance(i - 1).min(clearance(i)) };
        for (c, (a, b)) in ends[0].into_iter().zip(ends[1]).enumerate() {
            self.points[c][k] = (a + b) * number(0.5);
            self.edges[c][k] = b - a;
        }
        self.count += 1;
        k
    }

    /// Tests the packet and empties it.
    #[inline(always)]
    fn test(&mut self, solids: &Solids<'_, T>, far: &mut [u32; CHUNK]) {
        let mut is_far = [true; PACKET];
        for (collider, pose) in solids.solids.iter().zip(solids.poses) {
            let point = |k: usize| [self.points[0][k], self.points[1][k], self.points[2][k]];
            // Outside the bounding ball nothing has to be sampled.
            let is_beyond = |k: usize| {
                pose.distance_bound_at(point(k)) - solids.thickness
                    > (self.half[k] + self.moved[k]) * number(1.001)
            };
            if solids.solids.len() > 1 && (0..self.count).all(is_beyond) {
                continue;
            }
            let is_field = collider.shape.cell().is_some();
            let (distances, gradients) =
                collider.shape.sample_packet(&pose.local_packet(1, &self.points), pose.fractions[1]);
            for k in 0..self.count {
                let fast = self.moved[k] > T::zero();
                let far_enough = if is_field {
                    let normal = pose.turn(1, [0, 1, 2].map(|c| gradients[c][k]));
                    let edge = [self.edges[0][k], self.edges[1][k], self.edges[2][k]];
                    let [slope, bend] = if fast { [0.5, 0.5] } else { [0.25, 0.125] }.map(number);
                    dot(normal, edge).abs() * slope + self.half[k] * bend
                } else if fast {
                    self.half[k]
                } else {
                    self.reach[k]
                };
                let far_enough = far_enough + self.moved[k] * (lipschitz::<T>(collider.shape) * number(1.01));
                is_far[k] &= distances[k] - solids.thickness > far_enough;
            }
        }
        for ((entry, lane), is_far) in self.at.into_iter().zip(is_far).take(self.count) {
            far[entry] |= u32::from(is_far) << lane;
        }
        self.count = 0;
    }
}
