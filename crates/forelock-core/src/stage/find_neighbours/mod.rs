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
//! Particles of one cell share the buckets around it. Those that several of the 27 cells have in common are gone through once; what shares a bucket by chance is not within h. A particle begins with its own
//! cell; once its list is full it passes over what is farther than the last of it, and whole cells: so it is the spread of K particles that is searched, not that of h, which in locks holds a hundred times as
//! many. Places are gone through eight at a time, by the registers that the processor has; the bits are the same. Lists hold places in the sorted order, in which neighbours in space are neighbours in memory.
//!
//! # Limitations
//! Where more than K are within h the farther ones are left out: densities of hair that is denser than the lists saturate.

#![expect(clippy::needless_range_loop, reason = "one index for several arrays is what vectorises")]

use crate::lane::Real;
use crate::scratch::{fill, resize};
use crate::sph::Fluid;
use crate::state::number;
use rayon::prelude::*;
use std::ops::Range;

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
#[derive(Debug, Default)]
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
    /// Coordinates of the particles, in their sorted order, and their numbers and strands.
    x: [Vec<T>; 3],
    names: Vec<[u32; 2]>,
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
        self.sorted.capacity() * size_of::<Particle<T>>()
            + 4 * (self.slots.capacity() + self.lists.capacity() + self.counts.capacity())
            + (self.density.capacity() + 3 * self.x[0].capacity()) * size_of::<T>()
            + 8 * self.names.capacity()
            + self.bounds.capacity() * size_of::<Bound<T>>()
            + 4 * (self.starts.capacity() + self.buckets.capacity())
    }

    /// Finds the neighbours of `particles`, which are in the order of their numbers, and the densities.
    pub fn find(&mut self, particles: &[Particle<T>], fluid: &Fluid<T>) {
        self.sort(particles, fluid.h);
        let (count, k) = (particles.len(), fluid.neighbours);
        resize(&mut self.lists, count * k, 0);
        resize(&mut self.counts, count, 0);
        resize(&mut self.density, count, T::zero());
        resize(&mut self.bounds, count, (T::zero(), 0));
        let Self { lists, counts, density, bounds, starts, x, names, .. } = self;
        let search = Search { x: x.each_ref().map(Vec::as_slice), names, starts, fluid };
        let outputs = lists
            .par_chunks_mut(CHUNK * k)
            .zip(counts.par_chunks_mut(CHUNK))
            .zip(density.par_chunks_mut(CHUNK).zip(bounds.par_chunks_mut(CHUNK)));
        outputs.enumerate().for_each(|(chunk, ((lists, counts), (density, bounds)))| {
            search.chunk(chunk * CHUNK, Found { lists, counts, density, bounds });
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
        resize(&mut self.names, count, [0; 2]);
        let name = |(name, particle): (&mut [u32; 2], &Particle<T>)| {
            *name = [particle.number, particle.strand];
        };
        self.names.par_iter_mut().zip(&self.sorted).with_min_len(CHUNK).for_each(name);
        for (c, x) in self.x.iter_mut().enumerate() {
            resize(x, count, T::zero());
            let rows = x.par_iter_mut().zip(&self.sorted).with_min_len(CHUNK);
            rows.for_each(|(x, particle)| *x = particle.x[c]);
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

/// What is searched.
struct Search<'a, T> {
    x: [&'a [T]; 3],
    names: &'a [[u32; 2]],
    starts: &'a [u32],
    fluid: &'a Fluid<T>,
}

/// What is found of some particles.
struct Found<'a, T> {
    lists: &'a mut [u32],
    counts: &'a mut [u32],
    density: &'a mut [T],
    bounds: &'a mut [Bound<T>],
}

/// Neighbours at most.
pub const MOST_NEIGHBOURS: usize = 64;
/// Places that are gone through at once.
const ABREAST: usize = 8;
/// What rounding may make of a distance to a cell near the origin, as a share of its side; it grows with the cell's number.
const ROUNDING: f64 = 1e-4;

/// The nearest neighbours so far, nearest first.
struct Nearest<T> {
    squares: [T; MOST_NEIGHBOURS],
    numbers: [u32; MOST_NEIGHBOURS],
    slots: [u32; MOST_NEIGHBOURS],
    len: usize,
    most: usize,
    /// The square of the distance from which on nothing counts.
    bound: T,
}

impl<T: Real> Nearest<T> {
    #[inline(always)]
    fn insert(&mut self, square: T, number: u32, slot: u32) {
        let mut at = self.len;
        if at == self.most {
            at -= 1;
            if square == self.squares[at] && number > self.numbers[at] {
                return;
            }
        } else {
            self.len += 1;
        }
        while at > 0
            && (square < self.squares[at - 1]
                || (square == self.squares[at - 1] && number < self.numbers[at - 1]))
        {
            self.squares[at] = self.squares[at - 1];
            self.numbers[at] = self.numbers[at - 1];
            self.slots[at] = self.slots[at - 1];
            at -= 1;
        }
        (self.squares[at], self.numbers[at], self.slots[at]) = (square, number, slot);
        if self.len == self.most {
            self.bound = self.squares[self.most - 1];
        }
    }
}

impl<T: Real> Search<'_, T> {
    /// The neighbours of the particles from `first` on.
    fn chunk(&self, first: usize, found: Found<'_, T>) {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") {
            // SAFETY: it is there.
            return unsafe { self.chunk_avx2(first, found) };
        }
        self.chunk_of(first, found);
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn chunk_avx2(&self, first: usize, found: Found<'_, T>) {
        self.chunk_of(first, found);
    }

    #[inline(always)]
    fn chunk_of(&self, first: usize, found: Found<'_, T>) {
        let k = self.fluid.neighbours;
        let mut around = Around::default();
        let mut nearest = Nearest {
            squares: [T::zero(); MOST_NEIGHBOURS],
            numbers: [0; MOST_NEIGHBOURS],
            slots: [0; MOST_NEIGHBOURS],
            len: 0,
            most: k,
            bound: T::zero(),
        };
        let rows = found.lists.chunks_exact_mut(k).zip(found.counts);
        let rows = rows.zip(found.density.iter_mut().zip(found.bounds));
        for (slot, ((list, count), (density, bound))) in (first..).zip(rows) {
            (nearest.len, nearest.bound) = (0, self.fluid.h2);
            self.around(slot, &mut around, &mut nearest);
            *density = self.fluid.density(T::zero());
            for n in 0..nearest.len {
                list[n] = nearest.slots[n];
                *density = *density + self.fluid.density(nearest.squares[n]);
            }
            *count = nearest.len as u32;
            *bound = match nearest.len {
                len if len == k => (nearest.squares[k - 1], nearest.numbers[k - 1]),
                _ => (T::infinity(), 0),
            };
        }
    }

    /// Finds the nearest of the particle at `slot`.
    #[inline(always)]
    fn around(&self, slot: usize, around: &mut Around, nearest: &mut Nearest<T>) {
        let own = self.x.map(|x| x[slot]);
        let h = self.fluid.h;
        let at = cell(&own, h);
        if !around.is_of(at) {
            around.gather(at, self.starts);
        }
        // How far it is to the cell's lower faces and to its upper ones, a little less.
        let far = at.into_iter().fold(0.0, |far: f64, at| far.max(f64::from(at).abs()));
        let rounding = number::<T>(ROUNDING) + T::epsilon() * number(4.0 * far);
        let least = T::one() - rounding;
        let mut to_faces = [[T::zero(); 3]; 3];
        for c in 0..3 {
            let from_low = own[c] - number::<T>(f64::from(at[c])) * h;
            to_faces[0][c] = (from_low - h * rounding).max(T::zero()) * least;
            to_faces[2][c] = (h - from_low - h * rounding).max(T::zero()) * least;
        }
        for near in &around.near[..around.len] {
            let steps = near.steps.map(usize::from);
            let d = [0, 1, 2].map(|c| to_faces[steps[c]][c]);
            if d[0] * d[0] + d[1] * d[1] + d[2] * d[2] <= nearest.bound {
                self.scan((slot, own), near.from as usize..near.to as usize, nearest);
            }
        }
    }

    /// Takes up what is nearer of the slots `from..to`.
    #[inline(always)]
    fn scan(&self, (slot, own): (usize, [T; 3]), slots: Range<usize>, nearest: &mut Nearest<T>) {
        let own_strand = self.names[slot][1];
        let [xs, ys, zs] = self.x.map(|x| &x[slots.clone()]);
        let mut first = slots.start;
        let rows = xs.chunks(ABREAST).zip(ys.chunks(ABREAST)).zip(zs.chunks(ABREAST));
        for ((xs, ys), zs) in rows {
            let mut squares = [T::infinity(); ABREAST];
            if let (Ok(xs), Ok(ys), Ok(zs)) =
                (<&[T; ABREAST]>::try_from(xs), <&[T; ABREAST]>::try_from(ys), <&[T; ABREAST]>::try_from(zs))
            {
                for n in 0..ABREAST {
                    squares[n] = square([xs[n], ys[n], zs[n]], &own);
                }
            } else {
                for n in 0..xs.len() {
                    squares[n] = square([xs[n], ys[n], zs[n]], &own);
                }
            }
            let mut near = 0u32;
            for n in 0..ABREAST {
                near |= u32::from(squares[n] <= nearest.bound) << n;
            }
            while near != 0 {
                let n = near.trailing_zeros() as usize;
                near &= near - 1;
                // Not at h itself; a full list lets in what is as far as its last, and looks at numbers.
                if squares[n] <= nearest.bound && squares[n] < self.fluid.h2 && first + n != slot {
                    let [number, strand] = self.names[first + n];
                    if self.fluid.own_strand || strand != own_strand {
                        nearest.insert(squares[n], number, (first + n) as u32);
                    }
                }
            }
            first += ABREAST;
        }
    }
}

#[inline(always)]
fn square<T: Real>(x: [T; 3], own: &[T; 3]) -> T {
    let d = [x[0] - own[0], x[1] - own[1], x[2] - own[2]];
    d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
}

/// A cell beside one, or itself: which way it is along each axis (0 below, 1 level, 2 above), and the slots of its bucket.
#[derive(Clone, Copy, Debug, Default)]
struct Beside {
    steps: [u8; 3],
    from: u32,
    to: u32,
}

/// The cells around one, itself first, faces before edges before corners; empty buckets, and such that came before, are left out.
#[derive(Debug, Default)]
struct Around {
    cell: Option<[i32; 3]>,
    near: [Beside; 27],
    len: usize,
}

impl Around {
    #[inline(always)]
    fn is_of(&self, cell: [i32; 3]) -> bool {
        self.cell == Some(cell)
    }

    fn gather(&mut self, at: [i32; 3], starts: &[u32]) {
        (self.cell, self.len) = (Some(at), 0);
        let mut seen = [u32::MAX; 27];
        for (n, steps) in ORDER.into_iter().enumerate() {
            let cell = [0, 1, 2].map(|c| at[c].wrapping_add(i32::from(steps[c]) - 1));
            let bucket = bucket(cell, starts.len() - 1);
            if seen[..n].contains(&bucket) {
                // Two cells, of which the nearer one may be passed over: it must not be for both.
                self.near[..self.len]
                    .iter_mut()
                    .filter(|near| near.from == starts[bucket as usize])
                    .for_each(|near| near.steps = [1; 3]);
                continue;
            }
            seen[n] = bucket;
            let [from, to] = [bucket, bucket + 1].map(|bucket| starts[bucket as usize]);
            if from < to {
                self.near[self.len] = Beside { steps, from, to };
                self.len += 1;
            }
        }
    }
}

/// Steps to the cells around one, in the order in which they are gone through.
const ORDER: [[u8; 3]; 27] = order();

const fn order() -> [[u8; 3]; 27] {
    let mut all = [[1; 3]; 27];
    let (mut len, mut away) = (0, 0);
    while away <= 3 {
        let mut n = 0;
        while n < 27 {
            let steps = [n % 3, n / 3 % 3, n / 9];
            let sides = (steps[0] != 1) as u8 + (steps[1] != 1) as u8 + (steps[2] != 1) as u8;
            if sides == away {
                all[len] = steps;
                len += 1;
            }
            n += 1;
        }
        away += 1;
    }
    all
}
