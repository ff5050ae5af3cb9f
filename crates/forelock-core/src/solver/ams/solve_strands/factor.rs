//! Block LDLᵀ of a strand's band, row by row.
//!
//! ```text
//! W_ij = A_ij − Σ_{k<j} W_ik L_jkᵀ ;  L_ij = W_ij D_j⁻¹
//! D_i  = A_ii − Σ_j W_ij L_ijᵀ     ;  z_i = b_i − Σ_j L_ij z_j
//! ```
//!
//! The off-diagonal blocks of A are −h²K, so all W and L are stored negated and every update is an
//! addition.

use super::springs::Spring;
use crate::lane::{Lane, Mat3, Sym3, V3};

/// Smallest pivot, over the smallest mass. Exact pivots are not less than the smallest mass.
pub const PIVOT_FLOOR: f64 = 0.999;

/// −L of a row to its three earlier rows, nearest first.
pub type Link<L> = [Mat3<L>; 3];

/// The rows in work: four rows of A and b, and the factors of the last three eliminated rows.
#[derive(Debug)]
pub struct Ring<L> {
    /// Smallest pivot.
    floor: L,
    accumulate: bool,
    diagonal: [Sym3<L>; 4],
    rhs: [V3<L>; 4],
    /// h²K from a row to the next three rows. Without `accumulate` each is written once. Rows i − 3
    /// to i + 2 are in use.
    coupling: [[Sym3<L>; 3]; 8],
    inverse: [Sym3<L>; 4],
    z: [V3<L>; 4],
}

impl<L: Lane> Ring<L> {
    /// An empty ring. `accumulate` says that a coupling has further contributions besides its
    /// spring. No particle is lighter than `least_mass`.
    #[inline(always)]
    pub fn new(accumulate: bool, least_mass: f64) -> Self {
        Self {
            accumulate,
            floor: L::from_f64(PIVOT_FLOOR * least_mass),
            diagonal: [Sym3::zero(); 4],
            rhs: [V3::zero(); 4],
            coupling: [[Sym3::zero(); 3]; 8],
            inverse: [Sym3::zero(); 4],
            z: [V3::zero(); 4],
        }
    }

    /// Clears the row that springs from row `i` are the first to reach.
    #[inline(always)]
    pub fn open(&mut self, i: usize) {
        self.diagonal[(i + 3) & 3] = Sym3::zero();
        self.rhs[(i + 3) & 3] = V3::zero();
        if self.accumulate {
            self.coupling[(i + 2) & 7] = [Sym3::zero(); 3];
        }
    }

    /// Row `i` of A's diagonal and of b.
    #[inline(always)]
    pub fn row(&mut self, i: usize) -> (&mut Sym3<L>, &mut V3<L>) {
        (&mut self.diagonal[i & 3], &mut self.rhs[i & 3])
    }

    /// Adds `spring` from `i` to `j` (≥ `clamped`). The column of a clamped i moves to b with the
    /// velocity `w` of i.
    #[inline(always)]
    pub fn add_spring(&mut self, i: usize, j: usize, clamped: usize, spring: &Spring<L>, w: V3<L>) {
        self.diagonal[j & 3] += spring.stiffness;
        self.rhs[j & 3] -= spring.impulse;
        if i < clamped {
            self.rhs[j & 3] += spring.stiffness.mul(w);
        } else {
            self.diagonal[i & 3] += spring.stiffness;
            self.rhs[i & 3] += spring.impulse;
            let coupling = &mut self.coupling[i & 7][j - i - 1];
            if self.accumulate {
                *coupling += spring.stiffness;
            } else {
                *coupling = spring.stiffness;
            }
        }
    }

    /// Adds to b of row `i`.
    #[inline(always)]
    pub fn add_impulse(&mut self, i: usize, impulse: V3<L>) {
        self.rhs[i & 3] += impulse;
    }

    /// Adds `block` to A_ij and A_ji (i ≤ j, both free).
    #[inline(always)]
    pub fn add_block(&mut self, i: usize, j: usize, block: &Sym3<L>) {
        if i == j {
            self.diagonal[i & 3] += *block;
        } else {
            self.coupling[i & 7][j - i - 1] += block.scale(-L::one());
        }
    }

    /// Eliminates row `i` against the rows before it, writes its links, and returns D_i⁻¹ z_i.
    #[inline(always)]
    pub fn eliminate(&mut self, i: usize, clamped: usize, links: &mut [Link<L>]) -> V3<L> {
        match i - clamped {
            0 => self.eliminate_row::<0>(i, links),
            1 => self.eliminate_row::<1>(i, links),
            2 => self.eliminate_row::<2>(i, links),
            _ => self.eliminate_row::<3>(i, links),
        }
    }

    /// [`Self::eliminate`] for a row that is coupled to `REACH` free rows before it.
    #[inline(always)]
    fn eliminate_row<const REACH: usize>(&mut self, i: usize, links: &mut [Link<L>]) -> V3<L> {
        let (before, rest) = links.split_at_mut(i);
        let mut d = self.diagonal[i & 3];
        let mut z = self.rhs[i & 3];
        let mut w = [Mat3::zero(); 3];
        if REACH > 2 {
            w[2] = Mat3::from(self.coupling[(i - 3) & 7][2]);
        }
        if REACH > 1 {
            // W_ij −= W_ik L_jkᵀ, here and below
            w[1] = Mat3::from(self.coupling[(i - 2) & 7][1]);
            if REACH > 2 {
                w[1] = w[1].add_mul_transposed(&w[2], &before[i - 2][0]);
            }
        }
        if REACH > 0 {
            w[0] = Mat3::from(self.coupling[(i - 1) & 7][0]);
            if REACH > 2 {
                w[0] = w[0].add_mul_transposed(&w[2], &before[i - 1][1]);
            }
            if REACH > 1 {
                w[0] = w[0].add_mul_transposed(&w[1], &before[i - 1][0]);
            }
        }
        for reach in (0..REACH).rev() {
            let j = (i - reach - 1) & 3;
            let l = w[reach].mul_sym(&self.inverse[j]);
            d = d.sub_mul_transposed(&w[reach], &l);
            z = z.add_mul(&l, self.z[j]);
            rest[0][reach] = l;
        }
        let inverse = d.inverse(self.floor);
        self.inverse[i & 3] = inverse;
        self.z[i & 3] = z;
        inverse.mul(z)
    }
}
