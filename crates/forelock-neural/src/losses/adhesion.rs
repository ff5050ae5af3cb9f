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
use std::collections::HashMap;

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
                near[i].push((apart, j));
                near[j].push((apart, i));
            }
        });
        let mut bonds = Vec::new();
        for (i, mut near) in near.into_iter().enumerate() {
            near.sort_by(|a, b| {
                a.0.partial_cmp(&b.0).map_or(a.1.cmp(&b.1), |order| order.then(a.1.cmp(&b.1)))
            });
            bonds.extend(near.into_iter().take(NEIGHBOURS).map(|(rest, j)| Bond { i, j, rest }));
        }
        Self { stiffness: T::from(terms.stiffness).unwrap_or_else(T::zero), bonds }
    }

    /// The same with every distance at rest taken as zero: the paper's energy.
    pub fn printed(mut self) -> Self {
        self.bonds.iter_mut().for_each(|bond| bond.rest = T::zero());
        self
    }

    /// Neighbours of particle `i`, nearest first, with their distances at rest, cm.
    pub fn neighbours(&self, i: usize) -> impl Iterator<Item = (usize, T)> {
        self.bonds.iter().filter(move |bond| bond.i == i).map(|bond| (bond.j, bond.rest))
    }

    /// The energy at `x`; its gradient is added to `gradient`. Both have one entry a particle of
    /// the set.
    pub fn energy(&self, x: &[[T; 3]], gradient: &mut [[T; 3]]) -> T {
        let mut energy = T::zero();
        for &Bond { i, j, rest } in &self.bonds {
            let apart = distance(x[i], x[j]);
            let excess = apart - rest;
            if excess <= T::zero() || excess.is_nan() {
                continue;
            }
            energy = energy + self.stiffness * excess * excess;
            let by = (self.stiffness + self.stiffness) * excess / apart;
            for c in 0..3 {
                let by = by * (x[i][c] - x[j][c]);
                gradient[i][c] = gradient[i][c] + by;
                gradient[j][c] = gradient[j][c] - by;
            }
        }
        energy
    }
}

/// The distance of two points.
pub(super) fn distance<T: Real>(a: [T; 3], b: [T; 3]) -> T {
    let d = [0, 1, 2].map(|c| a[c] - b[c]);
    (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt()
}

/// Particles in cubic cells.
pub(super) struct Cells {
    /// The cell of each particle.
    of: Vec<[i64; 3]>,
    /// The particles of each cell, in order.
    cells: HashMap<[i64; 3], Vec<usize>>,
}

impl Cells {
    /// Cells of `size`, cm, the largest distance of pairs.
    pub(super) fn new<T: Real>(x: &[[T; 3]], size: f64) -> Self {
        let over = 1.0 / size;
        let of = x.iter().map(|x| x.map(|c| c.to_f64().map_or(0.0, |c| (c * over).floor()) as i64));
        let of: Vec<[i64; 3]> = of.collect();
        let mut cells: HashMap<[i64; 3], Vec<usize>> = HashMap::new();
        for (i, cell) in of.iter().enumerate() {
            cells.entry(*cell).or_default().push(i);
        }
        Self { of, cells }
    }

    /// Calls `f` for each pair i < j in the same cell or in adjacent ones, in an order that depends
    /// on the positions alone.
    pub(super) fn for_pairs(&self, mut f: impl FnMut(usize, usize)) {
        for (i, cell) in self.of.iter().enumerate() {
            for step in 0..27 {
                let step = [step % 3 - 1, step / 3 % 3 - 1, step / 9 - 1];
                let near = [0, 1, 2].map(|c| cell[c].saturating_add(step[c]));
                for &j in self.cells.get(&near).into_iter().flatten() {
                    if i < j {
                        f(i, j);
                    }
                }
            }
        }
    }
}
