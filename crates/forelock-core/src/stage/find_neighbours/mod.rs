//! The nearest neighbours of every particle, and how dense hair is there (Sánchez-Banderas et al. 2015, Algorithm 1, lines 1 to 8).
//!
//! # Theory
//! Space is cut into cells of side h. A cell (i, j, k) has the bucket ((i·73856093) ⊕ (j·19349663) ⊕ (k·83492791)) mod N, N a power of two, and particles are sorted by bucket, by counting. All
//! within h of a particle are in the 27 cells around it; of them the K nearest count, by (distance², number). The density
//!
//! ```text
//! ρ_i = m W(0) + Σ_j m W(|x_i − x_j|)
//! ```
//!
//! sums over these, in that order, and so does not depend on the order of particles in their buckets.
//!
//! # Practice
//! Particles of one cell share the list of what is near. Buckets that several of the 27 cells have in common are looked up once; what shares a bucket by chance is not within h. Lists hold places
//! in the sorted order, in which neighbours in space are neighbours in memory.
//!
//! # Limitations
//! Where more than K are within h the farther ones are left out: densities of hair that is denser than the lists saturate.

use crate::lane::Real;
use crate::scratch::{fill, resize};
use crate::sph::Fluid;
use rayon::prelude::*;
use std::sync::{Mutex, PoisonError};

/// A particle of the fluid.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Particle<T> {
    /// Where it is, metres.
    pub x: [T; 3],
    /// How fast it moves, m/s.
    pub u: [T; 3],
    /// Its number, which breaks ties, and its strand.
    pub number: u32,
    /// See `number`.
    pub strand: u32,
}

/// Factors of the hash of a cell.
pub const HASH: [u32; 3] = [73_856_093, 19_349_663, 83_492_791];
/// Buckets at least and at most.
const BUCKETS: [usize; 2] = [1 << 10, 1 << 20];
/// Particles that a thread takes at once.
pub(crate) const CHUNK: usize = 1024;

/// How far the farthest of K neighbours is: the square of its distance, and its number. Nothing within h is farther where there are fewer.
type Bound<T> = (T, u32);

/// Particles sorted by bucket, and what is near each.
#[derive(Debug)]
pub struct Neighbours<T> {
    /// The particles, in their sorted order.
    pub sorted: Vec<Particle<T>>,
    /// Where in that order each particle is, by number.
    pub slots: Vec<u32>,
    /// Places in that order of each one's neighbours, K each, of which `counts` are there; nearest first.
    pub lists: Vec<u32>,
    /// Neighbours of each.
    pub counts: Vec<u32>,
    /// Density at each.
    pub density: Vec<T>,
    /// See [`Bound`].
    bounds: Vec<Bound<T>>,
    /// Where each bucket begins, and its end.
    starts: Vec<u32>,
    buckets: Vec<u32>,
    scratch: Vec<Mutex<Near<T>>>,
}

/// What is near a cell, and what of it is near a particle.
#[derive(Debug)]
struct Near<T> {
    cell: [i32; 3],
    x: [Vec<T>; 3],
    slots: Vec<u32>,
    squares: Vec<T>,
    /// Square of the distance, number and slot.
    found: Vec<(T, u32, u32)>,
}

impl<T: Real> Default for Neighbours<T> {
    fn default() -> Self {
        let near = || Near {
            cell: [0; 3],
            x: [const { Vec::new() }; 3],
            slots: Vec::new(),
            squares: Vec::new(),
            found: Vec::new(),
        };
        Self {
            sorted: Vec::new(),
            slots: Vec::new(),
            lists: Vec::new(),
            counts: Vec::new(),
            density: Vec::new(),
            bounds: Vec::new(),
            starts: Vec::new(),
            buckets: Vec::new(),
            scratch: (0..rayon::current_num_threads().max(1)).map(|_| Mutex::new(near())).collect(),
        }
    }
}

/// The cell of a place, cells being `h` wide.
fn cell<T: Real>(x: &[T; 3], h: T) -> [i32; 3] {
    // What is far out or not a number is in some cell.
    x.map(|x| (x / h).floor().to_i32().unwrap_or(i32::MAX))
}

/// The bucket of a cell, of a power of two.
#[expect(clippy::cast_sign_loss, reason = "the hash is of the bits")]
fn bucket(cell: [i32; 3], buckets: usize) -> u32 {
    let hash = (0..3).fold(0, |hash, c| hash ^ (cell[c] as u32).wrapping_mul(HASH[c]));
    hash & (buckets as u32 - 1)
}

impl<T: Real> Neighbours<T> {
    /// Bytes held.
    pub fn bytes(&self) -> usize {
        let near = |near: &Mutex<Near<T>>| {
            let near = near.lock().unwrap_or_else(PoisonError::into_inner);
            near.slots.capacity() * (4 + 4 * size_of::<T>())
                + near.found.capacity() * size_of::<(T, u32, u32)>()
        };
        self.sorted.capacity() * size_of::<Particle<T>>()
            + 4 * (self.slots.capacity() + self.lists.capacity() + self.counts.capacity())
            + self.density.capacity() * size_of::<T>()
            + self.bounds.capacity() * size_of::<Bound<T>>()
            + 4 * (self.starts.capacity() + self.buckets.capacity())
            + self.scratch.iter().map(near).sum::<usize>()
    }

    /// Finds the neighbours of `particles`, which are in the order of their numbers, and the densities.
    pub fn find(&mut self, particles: &[Particle<T>], fluid: &Fluid<T>) {
        self.sort(particles, fluid.h);
        let (count, k) = (particles.len(), fluid.neighbours);
        resize(&mut self.lists, count * k, 0);
        resize(&mut self.counts, count, 0);
        resize(&mut self.density, count, T::zero());
        resize(&mut self.bounds, count, (T::zero(), 0));
        let Self { sorted, lists, counts, density, bounds, starts, scratch, .. } = self;
        let (sorted, starts, scratch) = (&*sorted, &*starts, &*scratch);
        let outputs = lists
            .par_chunks_mut(CHUNK * k)
            .zip(counts.par_chunks_mut(CHUNK))
            .zip(density.par_chunks_mut(CHUNK).zip(bounds.par_chunks_mut(CHUNK)));
        outputs.enumerate().for_each(|(chunk, ((lists, counts), (density, bounds)))| {
            let worker = rayon::current_thread_index().unwrap_or(0) % scratch.len();
            let mut near = scratch[worker].lock().unwrap_or_else(PoisonError::into_inner);
            near.slots.clear();
            let rows = lists.chunks_mut(k).zip(counts).zip(density.iter_mut().zip(bounds));
            for (slot, ((list, count), (density, bound))) in (chunk * CHUNK..).zip(rows) {
                (*count, *density, *bound) = near.of_particle((sorted, starts), slot, fluid, list);
            }
        });
    }

    /// Sorts `particles` by bucket, and within buckets by number.
    fn sort(&mut self, particles: &[Particle<T>], h: T) {
        let count = particles.len();
        let buckets = (2 * count).next_power_of_two().clamp(BUCKETS[0], BUCKETS[1]);
        resize(&mut self.buckets, count, 0);
        resize(&mut self.slots, count, 0);
        resize(&mut self.sorted, count, Particle::default());
        fill(&mut self.starts, buckets + 1, 0);
        let own = |(own, particle): (&mut u32, &Particle<T>)| *own = bucket(cell(&particle.x, h), buckets);
        self.buckets.par_iter_mut().zip(particles).with_min_len(CHUNK).for_each(own);
        self.buckets.iter().for_each(|&bucket| self.starts[bucket as usize] += 1);
        let mut sum = 0;
        for start in &mut self.starts {
            sum += *start;
            // The end, which filling from behind takes to the beginning.
            *start = sum;
        }
        for (number, &bucket) in self.buckets.iter().enumerate().rev() {
            let slot = &mut self.starts[bucket as usize];
            *slot -= 1;
            self.slots[number] = *slot;
            self.sorted[*slot as usize] = particles[number];
        }
    }

    /// The neighbours of the particle at `slot`, as slots.
    pub fn near(&self, slot: usize, fluid: &Fluid<T>) -> &[u32] {
        let from = slot * fluid.neighbours;
        &self.lists[from..from + self.counts[slot] as usize]
    }

    /// Whether the particle at `slot` counts one with `number` at the square `d2` of a distance, under h², among its neighbours.
    #[inline]
    pub fn counts_in(&self, slot: usize, (d2, number): (T, u32)) -> bool {
        let (farthest, last) = self.bounds[slot];
        d2 < farthest || (d2 == farthest && number <= last)
    }
}

impl<T: Real> Near<T> {
    /// Fills the `list` of the particle at `slot`; how many there are, how dense it is there, and how far the list goes.
    fn of_particle(
        &mut self,
        (sorted, starts): (&[Particle<T>], &[u32]),
        slot: usize,
        fluid: &Fluid<T>,
        list: &mut [u32],
    ) -> (u32, T, Bound<T>) {
        let own = &sorted[slot];
        let at = cell(&own.x, fluid.h);
        if self.slots.is_empty() || at != self.cell {
            self.gather((sorted, starts), at);
        }
        let [xs, ys, zs] = &self.x;
        let others = xs.iter().zip(ys).zip(zs);
        for (square, ((x, y), z)) in self.squares.iter_mut().zip(others) {
            let d = [*x - own.x[0], *y - own.x[1], *z - own.x[2]];
            *square = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
        }
        self.found.clear();
        for (&square, &other) in self.squares.iter().zip(&self.slots) {
            if square < fluid.h2 && other as usize != slot {
                let particle = &sorted[other as usize];
                if fluid.own_strand || particle.strand != own.strand {
                    self.found.push((square, particle.number, other));
                }
            }
        }
        let nearer = |a: &(T, u32, u32), b: &(T, u32, u32)| {
            a.0.partial_cmp(&b.0).unwrap_or(std::cmp::Ordering::Equal).then(a.1.cmp(&b.1))
        };
        let mut bound = (T::infinity(), 0);
        if self.found.len() > list.len() {
            self.found.select_nth_unstable_by(list.len() - 1, nearer);
            self.found.truncate(list.len());
            let (square, number, _) = self.found[list.len() - 1];
            bound = (square, number);
        }
        self.found.sort_unstable_by(nearer);
        let mut density = fluid.density(T::zero());
        for (place, (square, _, other)) in list.iter_mut().zip(&self.found) {
            *place = *other;
            density = density + fluid.density(*square);
        }
        #[expect(clippy::cast_possible_truncation, reason = "no more than fit into the list")]
        (self.found.len() as u32, density, bound)
    }

    /// Takes up what is in the cells around `at`.
    fn gather(&mut self, (sorted, starts): (&[Particle<T>], &[u32]), at: [i32; 3]) {
        self.cell = at;
        self.slots.clear();
        self.x.iter_mut().for_each(Vec::clear);
        let mut seen = [u32::MAX; 27];
        for n in 0..27usize {
            let step = [n % 3, n / 3 % 3, n / 9].map(|step| step as i32 - 1);
            let cell = [0, 1, 2].map(|c| at[c].wrapping_add(step[c]));
            let bucket = bucket(cell, starts.len() - 1);
            if seen[..n].contains(&bucket) {
                continue;
            }
            seen[n] = bucket;
            let [from, to] = [bucket, bucket + 1].map(|bucket| starts[bucket as usize]);
            for (slot, particle) in (from..to).zip(&sorted[from as usize..to as usize]) {
                self.slots.push(slot);
                for c in 0..3 {
                    self.x[c].push(particle.x[c]);
                }
            }
        }
        self.squares.resize(self.slots.len(), T::zero());
    }
}
