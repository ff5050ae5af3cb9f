//! Adhesion: neighbours at rest stay together.
//!
//! # Theory
//! ```text
//! k_a Σ_i Σ_{j ∈ N(i)} max(|x_i − x_j| − d⁰_ij, 0)²
//! ```
//!
//! N(i) are the five nearest particles at rest within r of other strands, none of them a root; of
//! equal distances the lower number. The paper has |x_i − x_j|² (Eq. 8), which collapses clumps to
//! lines: [`Adhesion::printed`].

use forelock_core::lane::Real;

/// Coefficients of [`Adhesion`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AdhesionTerms {
    /// k_a, g s⁻².
    pub stiffness: f64,
    /// Largest distance of neighbours at rest, cm.
    pub range: f64,
}

impl Default for AdhesionTerms {
    fn default() -> Self {
        Self { stiffness: 2.0, range: 0.25 }
    }
}

/// Neighbours of a particle.
pub const NEIGHBOURS: usize = 5;

/// Particle `i` and its neighbour `j`, which are `rest` apart at rest.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Bond<T> {
    i: usize,
    j: usize,
    rest: T,
}

/// Adhesion within a set of strands.
#[derive(Clone, Debug)]
pub struct Adhesion<T> {
    stiffness: T,
    bonds: Vec<Bond<T>>,
}

impl<T: Real> Adhesion<T> {
    /// Of strands of `particles` particles that are at `rest`, cm, at rest.
    pub fn new(terms: AdhesionTerms, rest: &[[T; 3]], particles: usize) -> Self {
        let range = T::from(terms.range).unwrap_or_else(T::zero);
        let mut near: Vec<Vec<(T, usize)>> = vec![Vec::new(); rest.len()];
        Cells::new(rest, terms.range).for_pairs(|i, j| {
            let is_root = i % particles == 0 || j % particles == 0;
            let apart = distance(rest[i], rest[j]);
            if !is_root && i / particles != j / particles && apart <= range {
                insert(&mut near[i], (apart, j));
                insert(&mut near[j], (apart, i));
            }
        });
        let mut bonds = Vec::new();
        for (i, near) in near.into_iter().enumerate() {
            bonds.extend(near.into_iter().map(|(rest, j)| Bond { i, j, rest }));
        }
        Self { stiffness: T::from(terms.stiffness).unwrap_or_else(T::zero), bonds }
    }

    /// The same with every distance at rest taken as zero: the paper's energy.
    pub fn printed(mut self) -> Self {
        self.bonds.iter_mut().for_each(|bond| bond.rest = T::zero());
        self
    }

    /// The bonds of neighbouring strands `first..first + count` of the set among each other, as a
    /// set of their own.
    pub fn of_strands(&self, first: usize, count: usize, particles: usize) -> Self {
        let own = first * particles..(first + count) * particles;
        let from = self.bonds.partition_point(|bond| bond.i < own.start);
        let to = self.bonds.partition_point(|bond| bond.i < own.end);
        let inner = self.bonds[from..to].iter().filter(|bond| own.contains(&bond.j));
        let bonds = inner.map(|bond| Bond { i: bond.i - own.start, j: bond.j - own.start, ..*bond });
        Self { stiffness: self.stiffness, bonds: bonds.collect() }
    }

    /// Neighbours of particle `i`, nearest first, with their distances at rest, cm.
    pub fn neighbours(&self, i: usize) -> impl Iterator<Item = (usize, T)> {
        self.bonds.iter().filter(move |bond| bond.i == i).map(|bond| (bond.j, bond.rest))
    }

    /// The energy at `x`; its gradient is added to `gradient`, and the stiffness that holds each
    /// particle to `stiffness`. All have one entry a particle of the set.
    pub fn energy(&self, x: &[[T; 3]], gradient: &mut [[T; 3]], stiffness: &mut [T]) -> T {
        let mut energy = T::zero();
        for &Bond { i, j, rest } in &self.bonds {
            let apart = distance(x[i], x[j]);
            let excess = apart - rest;
            if excess <= T::zero() || excess.is_nan() {
                continue;
            }
            energy = energy + self.stiffness * excess * excess;
            let twice = self.stiffness + self.stiffness;
            for end in [i, j] {
                stiffness[end] = stiffness[end] + twice;
            }
            let by = twice * excess / apart;
            for c in 0..3 {
                let by = by * (x[i][c] - x[j][c]);
                gradient[i][c] = gradient[i][c] + by;
                gradient[j][c] = gradient[j][c] - by;
            }
        }
        energy
    }
}

/// Adds a neighbour at its distance to the nearest ones, of which [`NEIGHBOURS`] are kept; of equal
/// distances the lower number comes first.
fn insert<T: Real>(near: &mut Vec<(T, usize)>, new: (T, usize)) {
    let place = near.partition_point(|own| own.0 < new.0 || (own.0 == new.0 && own.1 < new.1));
    if place < NEIGHBOURS {
        near.truncate(NEIGHBOURS - 1);
        near.insert(place, new);
    }
}

/// The distance of two points.
pub(super) fn distance<T: Real>(a: [T; 3], b: [T; 3]) -> T {
    let d = [0, 1, 2].map(|c| a[c] - b[c]);
    (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt()
}

/// Most cells of [`Cells`].
const MOST_CELLS: f64 = 1e6;

/// Particles in cubic cells.
pub(super) struct Cells {
    /// Cells along each axis.
    counts: [usize; 3],
    /// The cell of each particle.
    of: Vec<usize>,
    /// Where the particles of each cell begin in `sorted`, and where the last ones end.
    first: Vec<usize>,
    /// Particles cell by cell, in order.
    sorted: Vec<usize>,
}

impl Cells {
    /// Cells of at least `size`, cm, the largest distance of pairs.
    pub(super) fn new<T: Real>(x: &[[T; 3]], mut size: f64) -> Self {
        let wide = |x: &[T; 3]| x.map(|c| c.to_f64().filter(|c| c.is_finite()).unwrap_or(0.0));
        let mut bounds = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
        for x in x.iter().map(wide) {
            bounds[0] = std::array::from_fn(|c| bounds[0][c].min(x[c]));
            bounds[1] = std::array::from_fn(|c| bounds[1][c].max(x[c]));
        }
        let along =
            |size: f64| [0, 1, 2].map(|c| ((bounds[1][c] - bounds[0][c]) / size).max(0.0).floor() + 1.0);
        while along(size).iter().product::<f64>() > MOST_CELLS {
            size *= 2.0;
        }
        let counts = along(size).map(|count| count as usize);
        let of = x.iter().map(wide).map(|x| {
            let [i, j, k] = [0, 1, 2].map(|c| (((x[c] - bounds[0][c]) / size) as usize).min(counts[c] - 1));
            (k * counts[1] + j) * counts[0] + i
        });
        let of: Vec<usize> = of.collect();
        let mut first = vec![0; counts.iter().product::<usize>() + 1];
        of.iter().for_each(|cell| first[cell + 1] += 1);
        for cell in 1..first.len() {
            first[cell] += first[cell - 1];
        }
        let (mut next, mut sorted) = (first.clone(), vec![0; of.len()]);
        for (i, cell) in of.iter().enumerate() {
            sorted[next[*cell]] = i;
            next[*cell] += 1;
        }
        Self { counts, of, first, sorted }
    }

    /// Calls `f` for each pair i < j in the same cell or in adjacent ones, in an order that depends
    /// on the positions alone.
    pub(super) fn for_pairs(&self, mut f: impl FnMut(usize, usize)) {
        let [width, height, depth] = self.counts;
        let near = |at: usize, count: usize| at.saturating_sub(1)..count.min(at + 2);
        for (i, cell) in self.of.iter().enumerate() {
            let [x, y, z] = [cell % width, cell / width % height, cell / (width * height)];
            for z in near(z, depth) {
                for y in near(y, height) {
                    let row = (z * height + y) * width;
                    let columns = near(x, width);
                    let particles = self.first[row + columns.start]..self.first[row + columns.end];
                    for &j in &self.sorted[particles] {
                        if i < j {
                            f(i, j);
                        }
                    }
                }
            }
        }
    }
}
