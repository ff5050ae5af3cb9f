//! The nearest neighbours of every particle, and how dense hair is there (Sánchez-Banderas et al. 2015, Algorithm 1, lines 1 to 8).
//!
//! # Theory
//! Space is cut into cells of side h. A cell (i, j, k) has the bucket whose bits are, from the lowest on, those of i, j and k in turn (Morton's order), modulo N, a power of two, and particles are sorted by bucket, by
//! counting. All within h of a particle are in the 27 cells around it; of them the K nearest count, by (distance², number). The density
//!
//! ```text
//! ρ_i = m W(0) + Σ_j m W(|x_i − x_j|)
//! ```
//!
//! sums over these, in that order, and so does not depend on the order of particles in their buckets.
//!
//! # Practice
//! The paper's hash of three primes scatters cells over memory; in Morton's order those near in space are near in memory, the 27 never share a bucket, and what shares one by chance is not within h.
//!
//! Particles of one cell share the buckets around it. A particle goes through cells of many particles first, its own before others; once it has more than K it passes over what is farther than the K-th, and whole cells: so it is
//! the spread of K particles that is searched, not that of h, which in locks holds a hundred times as many. The particles of small cells lie in one place by then, and are gone through last. Places are gone through a register at a time; what is near is gathered, as one integer of the square's bits and the number's, and sorted now and
//! then by counting what comes before each, without a branch. Lists hold places in the sorted order, and the bits are the same on any processor.
//!
//! # Limitations
//! Where more than K are within h the farther ones are left out: densities of hair that is denser than the lists saturate.

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

/// Numbers that neighbours are searched in.
pub trait SearchReal: Real {
    /// A number that is not negative, and a name, as one integer.
    type Key: Ord + Copy + Default + Send + Sync + std::fmt::Debug + 'static;

    /// This number, which is not negative, with `name`: ordered by the number, and by the name where numbers are the same.
    fn key(self, name: u32) -> Self::Key;
    /// What a key is of.
    fn of_key(key: Self::Key) -> (Self, u32);
    /// What searches for some particles, on `simd` (supported, not `Auto`).
    fn search_fn(simd: Simd) -> SearchFn<Self>;
}

/// Finds the neighbours of the particles from a slot on.
///
/// # Safety
/// The processor must have the instruction set that the function was made for.
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
    /// Where it is, metres.
    pub x: [T; 3],
    /// How fast it moves, m/s.
    pub u: [T; 3],
    /// Its number, which breaks ties, and its strand.
    pub number: u32,
    /// See `number`.
    pub strand: u32,
}

/// Buckets at least, so that each axis has three bits, and at most.
const BUCKETS: [usize; 2] = [1 << 10, 1 << 20];
/// Particles that a thread takes at once.
pub(crate) const CHUNK: usize = 1024;

/// Particles sorted by bucket, and what is near each.
#[derive(Debug, Default)]
pub struct Neighbours<T: SearchReal> {
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
    /// The key of each one's last neighbour, where it has K; else one that nothing within h comes after.
    bounds: Vec<T::Key>,
    /// Where each bucket begins, and its end.
    starts: Vec<u32>,
    buckets: Vec<u32>,
    /// Coordinates of the particles, in their sorted order, and a row beyond.
    x: [Vec<Row<T>>; 3],
    /// Their numbers, and what is not a neighbour of what has the same: the strand, or the number. Some beyond.
    names: Vec<[u32; 2]>,
    simd: Simd,
}

/// The cell of a place, cells being `h` wide.
#[inline(always)]
fn cell<T: Real>(x: &[T; 3], h: T) -> [i32; 3] {
    // What is far out or not a number is in some cell.
    let mut cell = [i32::MAX; 3];
    for c in 0..3 {
        if let Some(at) = (x[c] / h).floor().to_i32() {
            cell[c] = at;
        }
    }
    cell
}

/// The bucket of a cell, of a power of two.
#[expect(clippy::cast_sign_loss, reason = "the order is of the bits")]
#[inline(always)]
fn bucket([x, y, z]: [i32; 3], buckets: usize) -> u32 {
    (spread(x as u32) | spread(y as u32) << 1 | spread(z as u32) << 2) & (buckets as u32 - 1)
}

/// The lowest ten bits of a number, each in the place of every third.
#[inline(always)]
const fn spread(number: u32) -> u32 {
    let mut bits = number & 0x3ff;
    bits = (bits | bits << 16) & 0x0300_00ff;
    bits = (bits | bits << 8) & 0x0300_f00f;
    bits = (bits | bits << 4) & 0x030c_30c3;
    (bits | bits << 2) & 0x0924_9249
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

    /// Those that search on `simd`.
    pub fn on(simd: Simd) -> Self {
        Self { simd, ..Self::default() }
    }

    /// Finds the neighbours of `particles`, of which the first has the number 0, the next 1 and so on, and the densities.
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
            // The end, which filling from behind takes to the beginning.
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

    /// The neighbours of the particle at `slot`, as slots.
    pub fn near(&self, slot: usize, fluid: &Fluid<T>) -> &[u32] {
        let from = slot * fluid.neighbours;
        &self.lists[from..from + self.counts[slot] as usize]
    }

    /// Whether the particle at `slot` counts one with `number` at the square `d2` of a distance, under h², among its neighbours.
    #[inline]
    pub fn counts_in(&self, slot: usize, (d2, number): (T, u32)) -> bool {
        d2.key(number) <= self.bounds[slot]
    }
}

/// What is searched.
#[derive(Debug)]
pub struct Search<'a, T> {
    x: [&'a [Row<T>]; 3],
    names: &'a [[u32; 2]],
    slots: &'a [u32],
    starts: &'a [u32],
    fluid: &'a Fluid<T>,
}

/// What is found of some particles.
#[derive(Debug)]
pub struct Found<'a, T: SearchReal> {
    lists: &'a mut [u32],
    counts: &'a mut [u32],
    density: &'a mut [T],
    bounds: &'a mut [T::Key],
}

/// Neighbours at most.
pub const MOST_NEIGHBOURS: usize = 64;
/// Keys whose ranks are counted at once.
const ABREAST: usize = 8;
/// What rounding may make of a distance to a cell near the origin, as a share of its side; it grows with the cell's number.
const ROUNDING: f64 = 1e-4;

/// Keys that are gathered beyond K before they are sorted.
const LATE: usize = 12;
/// Room for keys: a row that is begun is gathered whole.
const ROOM: usize = MOST_NEIGHBOURS + LATE + LANES + ABREAST;

/// The keys of the nearest so far, and of some that are not.
struct Nearest<T: SearchReal> {
    keys: [T::Key; ROOM],
    sorted: [T::Key; ROOM],
    len: usize,
    most: usize,
    /// The square of the distance of the K-th when keys were sorted; what is farther does not count.
    bound: T,
}

impl<T: SearchReal> Nearest<T> {
    /// Sorts the keys, and leaves the K nearest: each goes where its rank is, the count of those before it. There are no branches to guess, and no two keys are the same.
    #[inline(always)]
    fn settle(&mut self) {
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

/// The neighbours of the particles from `first` on.
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
        nearest.settle();
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
    /// Finds the nearest of the particle at `slot`.
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
        // How far it is to the cell's lower faces and to its upper ones, a little less.
        let far = f64::from(at[0].unsigned_abs().max(at[1].unsigned_abs()).max(at[2].unsigned_abs()));
        let rounding = number::<T>(ROUNDING) + T::epsilon() * number(4.0 * far);
        let least = T::one() - rounding;
        let mut to_faces = [[T::zero(); 3]; 3];
        for c in 0..3 {
            let from_low = own[c] - number::<T>(f64::from(at[c])) * h;
            to_faces[0][c] = (from_low - h * rounding).max(T::zero()) * least;
            to_faces[2][c] = (h - from_low - h * rounding).max(T::zero()) * least;
        }
        let own = (own, self.names[slot][1]);
        for near in &around.near[..around.len] {
            let mut square = T::zero();
            for c in 0..3 {
                let d = to_faces[usize::from(near.steps[c])][c];
                square = square + d * d;
            }
            if square <= nearest.bound {
                self.scan::<L>(own, (self.x, self.names), near.from as usize..near.to as usize, nearest);
            }
        }
        let few = [&around.x[0][..], &around.x[1][..], &around.x[2][..]];
        self.scan::<L>(own, (few, &around.names), 0..around.few, nearest);
    }

    /// Takes up what is nearer of `slots` of some rows.
    #[inline(always)]
    fn scan<L: Lane<Scalar = T>>(
        &self,
        (own, own_kin): ([T; 3], u32),
        (x, names): ([&[Row<T>]; 3], &[[u32; 2]]),
        slots: Range<usize>,
        nearest: &mut Nearest<T>,
    ) {
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
            // Neither what is in other cells nor what is no number.
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
            if nearest.len >= nearest.most + LATE {
                nearest.settle();
            }
            first += L::WIDTH;
        }
    }
}

/// A cell beside one, or itself: which way it is along each axis (0 below, 1 level, 2 above), and the slots of its bucket.
#[derive(Clone, Copy, Debug, Default)]
struct Beside {
    steps: [u8; 3],
    from: u32,
    to: u32,
}

/// Particles from which on a cell is gone through by itself, and passed over where it is farther than the last that counts.
const MANY: usize = 16;
/// Particles that are copied at once.
const COPIED: usize = 8;
/// Rows for the particles of 27 cells that have fewer than [`MANY`].
const FEW_ROWS: usize = (27 * (MANY - 1) + COPIED).div_ceil(LANES);

/// The cells around one: those with many particles by themselves, itself first, faces before edges before corners, and the particles of all others.
struct Around<T> {
    cell: Option<[i32; 3]>,
    /// Those with [`MANY`] particles or more.
    near: [Beside; 27],
    len: usize,
    /// The particles of all others, one after the other.
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
