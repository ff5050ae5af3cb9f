//! The nearest neighbours and the density of every particle (Sánchez-Banderas et al. 2015,
//! Algorithm 1, lines 1 to 8).
//!
//! # Theory
//! Space is divided into cells of side h. The bucket of a cell (i, j, k) is the number whose bits
//! are those of i, j and k interleaved from the lowest on (Morton order), modulo N, a power of two.
//! Particles are sorted by bucket, by counting. All particles within h of a particle are in the 27
//! cells around it; its neighbours are the K nearest of them, ordered by (distance², number). The
//! density
//!
//! ```text
//! ρ_i = m W(0) + Σ_j m W(|x_i − x_j|)
//! ```
//!
//! sums over the neighbours in that order, and so does not depend on the order of particles in
//! their buckets.
//!
//! # Practice
//! The hash of three primes of the paper scatters cells over memory. In Morton order cells that are
//! near in space are near in memory, the 27 cells never share a bucket, and other cells that share
//! a bucket with one of them are farther away than h.
//!
//! The particles of one cell share the 27 buckets around it. The search of a particle visits cells
//! of many particles first, beginning with the cell of the particle. Once it has more than K
//! candidates it skips particles and whole cells that are farther than the K-th. It therefore
//! searches the extent of K particles, not that of h, which in locks holds a hundred times as many.
//! The particles of cells with few particles are copied into one array, which is searched last.
//! Squared distances are computed one register at a time. Candidates are stored as integers made of
//! the bits of the squared distance and of the number, and are sorted from time to time by counting
//! the keys before each one, without branches. Lists hold slots of the sorted order. The results
//! are bitwise the same on all processors.
//!
//! # Limitations
//! If more than K particles are within h, the farther ones are ignored: the density of hair that
//! exceeds the capacity of the lists saturates.

use crate::curve::spread;
use crate::interaction::sph::Fluid;
use crate::lane::{LANES, Lane, Real, Row};
use crate::lane::{Simd, on};
use crate::scratch::{fill, resize};
use crate::strands::number;
use rayon::prelude::*;
use std::ops::Range;

/// WGSL of the neighbour search over all particles.
pub const WGSL: &str = include_str!("kernel.wgsl");
/// WGSL that inserts the particles strand by strand and applies their accelerations.
pub const STRANDS_WGSL: &str = include_str!("strands.wgsl");

/// Scalar types of the neighbour search.
pub trait SearchReal: Real {
    /// Sort key: a non-negative number and a name in one integer.
    type Key: Ord + Copy + Default + Send + Sync + std::fmt::Debug + 'static;

    /// Combines this non-negative number and `name` into a key, ordered by the number and then by
    /// the name.
    fn key(self, name: u32) -> Self::Key;
    /// The number and the name of a key.
    fn of_key(key: Self::Key) -> (Self, u32);
    /// The search function for `simd`, which must be supported and not `Auto`.
    fn search_fn(simd: Simd) -> SearchFn<Self>;
}

/// Finds the neighbours of the particles from a slot on.
///
/// # Safety
/// The processor must support the instruction set of the function.
pub type SearchFn<T> = unsafe fn(&Search<'_, T>, usize, Found<'_, T>);

impl SearchReal for f64 {
    type Key = i128;

    #[inline(always)]
    fn key(self, name: u32) -> i128 {
        i128::from(self.to_bits()) << 32 | i128::from(name)
    }

    #[inline(always)]
    #[expect(clippy::cast_sign_loss, clippy::cast_possible_truncation, reason = "one part, and the other")]
    fn of_key(key: i128) -> (Self, u32) {
        (Self::from_bits((key >> 32) as u64), key as u32)
    }

    #[inline(never)]
    fn search_fn(_: Simd) -> SearchFn<Self> {
        search::<Self>
    }
}

impl SearchReal for f32 {
    type Key = i64;

    #[inline(always)]
    fn key(self, name: u32) -> i64 {
        i64::from(self.to_bits()) << 32 | i64::from(name)
    }

    #[inline(always)]
    #[expect(clippy::cast_sign_loss, clippy::cast_possible_truncation, reason = "one half, and the other")]
    fn of_key(key: i64) -> (Self, u32) {
        (Self::from_bits((key >> 32) as u32), key as u32)
    }

    #[inline(never)]
    fn search_fn(simd: Simd) -> SearchFn<Self> {
        on!(simd, search(given: &Search<'_, f32>, first: usize, found: Found<'_, f32>))
    }
}

/// A particle of the fluid.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Particle<T> {
    /// Position, metres.
    pub x: [T; 3],
    /// Velocity, m/s.
    pub u: [T; 3],
    /// Number, which breaks ties.
    pub number: u32,
    /// Index of its strand.
    pub strand: u32,
}

/// Minimum number of buckets, so that each axis has three bits, and maximum number.
const BUCKETS: [usize; 2] = [1 << 10, 1 << 20];
/// Particles in a task.
pub(crate) const CHUNK: usize = 1024;

/// Particles sorted by bucket, and their neighbours.
#[derive(Debug, Default)]
pub struct Neighbours<T: SearchReal> {
    /// The particles, in their sorted order.
    pub sorted: Vec<Particle<T>>,
    /// Slot of each particle in the sorted order, by number.
    pub slots: Vec<u32>,
    /// Slots of the neighbours of each particle, nearest first: K entries for each, of which the
    /// first `counts` are valid.
    pub lists: Vec<u32>,
    /// Number of neighbours of each particle.
    pub counts: Vec<u32>,
    /// Density of each particle.
    pub density: Vec<T>,
    /// Key of the last neighbour of each particle with K neighbours; otherwise the smallest key at
    /// distance h.
    bounds: Vec<T::Key>,
    /// Start of each bucket, and the end of the last.
    starts: Vec<u32>,
    buckets: Vec<u32>,
    /// Coordinates of the particles in sorted order, and one row of padding.
    x: [Vec<Row<T>>; 3],
    /// Number and kin of each particle, with padding. Particles of the same kin are not neighbours;
    /// the kin is the strand, or the number.
    names: Vec<[u32; 2]>,
    simd: Simd,
}

/// The cell of a position, for cells of side `h`.
#[inline(always)]
fn cell<T: Real>(x: &[T; 3], h: T) -> [i32; 3] {
    // Positions that are out of range or not numbers get an arbitrary cell.
    let mut cell = [i32::MAX; 3];
    for c in 0..3 {
        if let Some(at) = (x[c] / h).floor().to_i32() {
            cell[c] = at;
        }
    }
    cell
}

/// The bucket of a cell; `buckets` is a power of two.
#[expect(clippy::cast_sign_loss, reason = "the order is of the bits")]
#[inline(always)]
fn bucket([x, y, z]: [i32; 3], buckets: usize) -> u32 {
    (spread(x as u32) | spread(y as u32) << 1 | spread(z as u32) << 2) & (buckets as u32 - 1)
}

impl<T: SearchReal> Neighbours<T> {
    /// Bytes held.
    pub fn bytes(&self) -> usize {
        self.sorted.capacity() * size_of::<Particle<T>>()
            + 4 * (self.slots.capacity() + self.lists.capacity() + self.counts.capacity())
            + self.density.capacity() * size_of::<T>()
            + 3 * self.x[0].capacity() * size_of::<Row<T>>()
            + self.bounds.capacity() * size_of::<T::Key>()
            + 4 * (self.starts.capacity() + self.buckets.capacity() + 2 * self.names.capacity())
    }

    /// Creates an empty search with the instruction set `simd`.
    pub fn on(simd: Simd) -> Self {
        Self { simd, ..Self::default() }
    }

    /// Finds the neighbours and densities of `particles`, which must be numbered from 0 in order.
    pub fn find(&mut self, particles: &[Particle<T>], fluid: &Fluid<T>) {
        debug_assert!((0..).zip(particles).all(|(number, particle)| particle.number == number));
        self.sort(particles, fluid);
        let (count, k) = (particles.len(), fluid.neighbours);
        resize(&mut self.lists, count * k, 0);
        resize(&mut self.counts, count, 0);
        resize(&mut self.density, count, T::zero());
        resize(&mut self.bounds, count, T::Key::default());
        let Self { slots, lists, counts, density, bounds, starts, x, names, .. } = self;
        let given = Search { x: x.each_ref().map(Vec::as_slice), names, slots, starts, fluid };
        let search = T::search_fn(self.simd.resolve());
        let outputs = lists
            .par_chunks_mut(CHUNK * k)
            .zip(counts.par_chunks_mut(CHUNK))
            .zip(density.par_chunks_mut(CHUNK).zip(bounds.par_chunks_mut(CHUNK)));
        outputs.enumerate().for_each(|(chunk, ((lists, counts), (density, bounds)))| {
            // SAFETY: `simd` is supported.
            unsafe { search(&given, chunk * CHUNK, Found { lists, counts, density, bounds }) };
        });
    }

    /// Sorts `particles` by bucket, and within buckets by number.
    fn sort(&mut self, particles: &[Particle<T>], fluid: &Fluid<T>) {
        let count = particles.len();
        let buckets = (2 * count).next_power_of_two().clamp(BUCKETS[0], BUCKETS[1]);
        resize(&mut self.buckets, count, 0);
        resize(&mut self.slots, count, 0);
        resize(&mut self.sorted, count, Particle::default());
        fill(&mut self.starts, buckets + 1, 0);
        let own =
            |(own, particle): (&mut u32, &Particle<T>)| *own = bucket(cell(&particle.x, fluid.h), buckets);
        self.buckets.par_iter_mut().zip(particles).with_min_len(CHUNK).for_each(own);
        self.buckets.iter().for_each(|&bucket| self.starts[bucket as usize] += 1);
        let mut sum = 0;
        for start in &mut self.starts {
            sum += *start;
            // The end of the bucket; filling it from the back moves this to its start.
            *start = sum;
        }
        for (number, &bucket) in self.buckets.iter().enumerate().rev() {
            let slot = &mut self.starts[bucket as usize];
            *slot -= 1;
            self.slots[number] = *slot;
            self.sorted[*slot as usize] = particles[number];
        }
        resize(&mut self.names, count + COPIED, [0; 2]);
        let name = |(name, particle): (&mut [u32; 2], &Particle<T>)| {
            *name = [particle.number, if fluid.own_strand { particle.number } else { particle.strand }];
        };
        self.names.par_iter_mut().zip(&self.sorted).with_min_len(CHUNK).for_each(name);
        for (c, x) in self.x.iter_mut().enumerate() {
            resize(x, count.div_ceil(LANES) + 1, Row([T::nan(); LANES]));
            let rows = x.par_iter_mut().zip(self.sorted.par_chunks(LANES)).with_min_len(CHUNK / LANES);
            rows.for_each(|(row, particles)| {
                row.0 = [T::nan(); LANES];
                row.0.iter_mut().zip(particles).for_each(|(x, particle)| *x = particle.x[c]);
            });
        }
    }

    /// The slots of the neighbours of the particle at `slot`.
    pub fn near(&self, slot: usize, fluid: &Fluid<T>) -> &[u32] {
        let from = slot * fluid.neighbours;
        &self.lists[from..from + self.counts[slot] as usize]
    }

    /// Whether a particle `number` at the squared distance `d2` < h² is among the neighbours of the
    /// particle at `slot`.
    #[inline]
    pub fn has_neighbour(&self, slot: usize, d2: T, number: u32) -> bool {
        d2.key(number) <= self.bounds[slot]
    }
}

/// The particle whose neighbours are searched.
#[derive(Clone, Copy)]
struct Seeker<T> {
    x: [T; 3],
    kin: u32,
}

/// Particles that a scan visits: coordinates, and number and kin of each.
#[derive(Clone, Copy)]
struct Places<'a, T> {
    x: [&'a [Row<T>]; 3],
    names: &'a [[u32; 2]],
}

/// Input of the search.
#[derive(Debug)]
pub struct Search<'a, T> {
    x: [&'a [Row<T>]; 3],
    names: &'a [[u32; 2]],
    slots: &'a [u32],
    starts: &'a [u32],
    fluid: &'a Fluid<T>,
}

/// Output of the search for a range of particles.
#[derive(Debug)]
pub struct Found<'a, T: SearchReal> {
    lists: &'a mut [u32],
    counts: &'a mut [u32],
    density: &'a mut [T],
    bounds: &'a mut [T::Key],
}

/// Maximum number of neighbours.
pub const MOST_NEIGHBOURS: usize = 64;
/// Number of keys that are ranked at the same time.
const ABREAST: usize = 8;
/// Bound of the rounding error of the distance to a cell near the origin, relative to its side; it
/// grows with the index of the cell.
const ROUNDING: f64 = 1e-4;

/// Number of keys beyond K that are collected before they are sorted.
const SORT_BATCH: usize = 12;
/// Capacity for keys: a row is always collected as a whole.
const ROOM: usize = MOST_NEIGHBOURS + SORT_BATCH + LANES + ABREAST;

/// Candidates: the keys of the nearest particles so far, and of some others.
struct Nearest<T: SearchReal> {
    keys: [T::Key; ROOM],
    sorted: [T::Key; ROOM],
    len: usize,
    most: usize,
    /// Squared distance of the K-th key at the last sort; farther particles are ignored.
    bound: T,
}

impl<T: SearchReal> Nearest<T> {
    /// Sorts the keys and keeps the K nearest. The place of a key is its rank, the number of keys
    /// before it; this needs no branches, and all keys are different.
    #[inline(always)]
    fn keep_nearest(&mut self) {
        for first in (0..self.len).step_by(ABREAST) {
            let mut own = [T::Key::default(); ABREAST];
            own.copy_from_slice(&self.keys[first..first + ABREAST]);
            let mut ranks = [0i64; ABREAST];
            for key in &self.keys[..self.len] {
                for n in 0..ABREAST {
                    ranks[n] += i64::from(*key < own[n]);
                }
            }
            for n in 0..ABREAST.min(self.len - first) {
                self.sorted[ranks[n] as usize] = own[n];
            }
        }
        self.len = self.len.min(self.most);
        for first in (0..self.len).step_by(ABREAST) {
            self.keys[first..first + ABREAST].copy_from_slice(&self.sorted[first..first + ABREAST]);
        }
        if self.len == self.most {
            self.bound = T::of_key(self.keys[self.most - 1]).0;
        }
    }
}

/// Finds the neighbours of the particles from `first` on.
#[inline(always)]
fn search<L: Lane<Scalar: SearchReal>>(
    given: &Search<'_, L::Scalar>,
    first: usize,
    found: Found<'_, L::Scalar>,
) {
    let (fluid, k) = (given.fluid, given.fluid.neighbours);
    let mut around = Around::new();
    let none = <L::Scalar as SearchReal>::Key::default();
    let mut nearest = Nearest { keys: [none; ROOM], sorted: [none; ROOM], len: 0, most: k, bound: fluid.h2 };
    let rows = found.lists.chunks_exact_mut(k).zip(found.counts);
    let rows = rows.zip(found.density.iter_mut().zip(found.bounds));
    for (slot, ((list, count), (density, bound))) in (first..).zip(rows) {
        (nearest.len, nearest.bound) = (0, fluid.h2);
        given.around::<L>(slot, &mut around, &mut nearest);
        nearest.keep_nearest();
        let keys = &nearest.keys[..nearest.len];
        *density = fluid.density(number(0.0));
        for (place, &key) in list.iter_mut().zip(keys) {
            let (square, number) = L::Scalar::of_key(key);
            *place = given.slots[number as usize];
            *density = *density + fluid.density(square);
        }
        *count = keys.len() as u32;
        *bound = if keys.len() == k { keys[k - 1] } else { fluid.h2.key(0) };
    }
}

impl<T: SearchReal> Search<'_, T> {
    /// Collects the nearest particles of the particle at `slot`.
    #[inline(always)]
    fn around<L: Lane<Scalar = T>>(&self, slot: usize, around: &mut Around<T>, nearest: &mut Nearest<T>) {
        let mut own = [T::zero(); 3];
        for (own, x) in own.iter_mut().zip(self.x) {
            *own = x[slot / LANES].0[slot % LANES];
        }
        let h = self.fluid.h;
        let at = cell(&own, h);
        if !around.is_of(at) {
            around.gather(at, self);
        }
        // Lower bounds of the distances to the lower and to the upper faces of the cell.
        let far = f64::from(at[0].unsigned_abs().max(at[1].unsigned_abs()).max(at[2].unsigned_abs()));
        let rounding = number::<T>(ROUNDING) + T::epsilon() * number(4.0 * far);
        let least = T::one() - rounding;
        let mut to_faces = [[T::zero(); 3]; 3];
        for c in 0..3 {
            let from_low = own[c] - number::<T>(f64::from(at[c])) * h;
            to_faces[0][c] = (from_low - h * rounding).max(T::zero()) * least;
            to_faces[2][c] = (h - from_low - h * rounding).max(T::zero()) * least;
        }
        let own = Seeker { x: own, kin: self.names[slot][1] };
        let all = Places { x: self.x, names: self.names };
        for near in &around.near[..around.len] {
            let mut square = T::zero();
            for c in 0..3 {
                let d = to_faces[usize::from(near.steps[c])][c];
                square = square + d * d;
            }
            if square <= nearest.bound {
                self.scan::<L>(own, all, near.from as usize..near.to as usize, nearest);
            }
        }
        let few = Places { x: [&around.x[0][..], &around.x[1][..], &around.x[2][..]], names: &around.names };
        self.scan::<L>(own, few, 0..around.few, nearest);
    }

    /// Collects the particles of `slots` that are nearer than the bound.
    #[inline(always)]
    fn scan<L: Lane<Scalar = T>>(
        &self,
        own: Seeker<T>,
        places: Places<'_, T>,
        slots: Range<usize>,
        nearest: &mut Nearest<T>,
    ) {
        let Places { x, names } = places;
        let Seeker { x: own, kin: own_kin } = own;
        let own = [L::splat(own[0]), L::splat(own[1]), L::splat(own[2])];
        let mut squares = Row([T::zero(); LANES]);
        let mut first = slots.start - slots.start % L::WIDTH;
        while first < slots.end {
            let mut d = own;
            for c in 0..3 {
                d[c] = L::load(&x[c][first / LANES], first % LANES) - own[c];
            }
            let square = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
            let farther = L::bits(L::splat(nearest.bound).lt(square));
            // Excludes other cells and squares that are not numbers.
            let here = u32::MAX << slots.start.saturating_sub(first)
                & u32::MAX >> (32 - (slots.end - first).min(L::WIDTH));
            let mut near = L::bits(square.lt(L::splat(self.fluid.h2))) & !farther & here;
            square.store(&mut squares, 0);
            while near != 0 {
                let n = near.trailing_zeros() as usize;
                near &= near - 1;
                let [number, kin] = names[first + n];
                nearest.keys[nearest.len] = squares.0[n].key(number);
                nearest.len += usize::from(kin != own_kin);
            }
            if nearest.len >= nearest.most + SORT_BATCH {
                nearest.keep_nearest();
            }
            first += L::WIDTH;
        }
    }
}

/// One of the 27 cells: its offset along each axis (0 below, 1 level, 2 above), and the slots of
/// its bucket.
#[derive(Clone, Copy, Debug, Default)]
struct Beside {
    steps: [u8; 3],
    from: u32,
    to: u32,
}

/// Number of particles from which on a cell is searched separately, and skipped if it is too far.
const MANY: usize = 16;
/// Number of particles that are copied at the same time.
const COPIED: usize = 8;
/// Rows for the particles of 27 cells that have fewer than [`MANY`] particles each.
const FEW_ROWS: usize = (27 * (MANY - 1) + COPIED).div_ceil(LANES);

/// The 27 cells around a cell: those of many particles (the cell itself first, then its neighbours
/// across faces, edges and corners), and the particles of all others.
struct Around<T> {
    cell: Option<[i32; 3]>,
    /// The cells with [`MANY`] particles or more.
    near: [Beside; 27],
    len: usize,
    /// The particles of all other cells, one after the other.
    x: [[Row<T>; FEW_ROWS]; 3],
    names: [[u32; 2]; FEW_ROWS * LANES],
    few: usize,
}

impl<T: Real> Around<T> {
    fn new() -> Self {
        Self {
            cell: None,
            near: [Beside::default(); 27],
            len: 0,
            x: [[Row([T::zero(); LANES]); FEW_ROWS]; 3],
            names: [[0; 2]; FEW_ROWS * LANES],
            few: 0,
        }
    }

    #[inline(always)]
    fn is_of(&self, cell: [i32; 3]) -> bool {
        self.cell == Some(cell)
    }

    #[inline(always)]
    fn gather(&mut self, at: [i32; 3], given: &Search<'_, T>) {
        (self.cell, self.len, self.few) = (Some(at), 0, 0);
        for steps in ORDER {
            let mut cell = at;
            for c in 0..3 {
                cell[c] = at[c].wrapping_add(i32::from(steps[c]) - 1);
            }
            let bucket = bucket(cell, given.starts.len() - 1) as usize;
            let [from, to] = [given.starts[bucket], given.starts[bucket + 1]];
            let count = (to - from) as usize;
            if count >= MANY {
                self.near[self.len] = Beside { steps, from, to };
                self.len += 1;
                continue;
            }
            for from in (from as usize..to as usize).step_by(COPIED) {
                let into = self.few + from - (to as usize - count);
                for c in 0..3 {
                    let x: &[T] = bytemuck::cast_slice(given.x[c]);
                    let few: &mut [T] = bytemuck::cast_slice_mut(&mut self.x[c]);
                    few[into..into + COPIED].copy_from_slice(&x[from..from + COPIED]);
                }
                self.names[into..into + COPIED].copy_from_slice(&given.names[from..from + COPIED]);
            }
            self.few += count;
        }
    }
}

/// Offsets of the 27 cells, in the order of the search.
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
