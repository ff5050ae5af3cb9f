//! Block LDLᵀ of a strand's band, row by row.
//!
//! ```text
//! W_ij = A_ij − Σ_{k<j} W_ik L_jkᵀ ;  L_ij = W_ij D_j⁻¹
//! D_i  = A_ii − Σ_j W_ij L_ijᵀ     ;  z_i = b_i − Σ_j L_ij z_j
//! ```
//!
//! The off-diagonal blocks of A are −h²K, so all W and L are stored negated and every update is an addition.

use super::springs::Spring;
use crate::lane::{Lane, Mat3, Sym3, V3};

/// Smallest pivot, over the mass: exact ones are at least 1.
const PIVOT_FLOOR: f64 = 0.999;

/// −L of a row to its three earlier rows, nearest first: rows of three 3×3 matrices.
pub type Link<L> = [V3<L>; 9];

/// The 3×3 matrix of `link` towards the row `reach + 1` before.
#[inline(always)]
pub fn link<L: Lane>(link: &Link<L>, reach: usize) -> Mat3<L> {
    Mat3([link[3 * reach].0, link[3 * reach + 1].0, link[3 * reach + 2].0])
}

#[inline(always)]
fn store<L: Lane>(m: &Mat3<L>, link: &mut Link<L>, reach: usize) {
    for r in 0..3 {
        link[3 * reach + r] = V3(m.0[r]);
    }
}

/// The rows that are open at once: four of A and b, and what the last three eliminated rows left.
#[derive(Debug)]
pub struct Ring<L> {
    diagonal: [Sym3<L>; 4],
    rhs: [V3<L>; 4],
    /// h²K from a row to the next three: rows i − 3 to i + 2 are in use.
    coupling: [[Sym3<L>; 3]; 8],
    inverse: [Sym3<L>; 4],
    z: [V3<L>; 4],
}

impl<L: Lane> Ring<L> {
    /// An empty ring.
    #[inline(always)]
    pub fn new() -> Self {
        Self {
            diagonal: [Sym3::zero(); 4],
            rhs: [V3::zero(); 4],
            coupling: [[Sym3::zero(); 3]; 8],
            inverse: [Sym3::zero(); 4],
            z: [V3::zero(); 4],
        }
    }

    /// Makes room for the rows that springs from row `i` reach first.
    #[inline(always)]
    pub fn open(&mut self, i: usize) {
        self.diagonal[(i + 3) & 3] = Sym3::zero();
        self.rhs[(i + 3) & 3] = V3::zero();
        self.coupling[(i + 2) & 7] = [Sym3::zero(); 3];
    }

    /// Row `i` of A's diagonal and of b.
    #[inline(always)]
    pub fn row(&mut self, i: usize) -> (&mut Sym3<L>, &mut V3<L>) {
        (&mut self.diagonal[i & 3], &mut self.rhs[i & 3])
    }

    /// Adds `spring` from `i` to `j` (≥ `clamped`). If i is clamped its column moves to b with its velocity `w`.
    #[inline(always)]
    pub fn add_spring(&mut self, (i, j): (usize, usize), clamped: usize, spring: &Spring<L>, w: V3<L>) {
        self.diagonal[j & 3] += spring.stiffness;
        self.rhs[j & 3] -= spring.impulse;
        if i < clamped {
            self.rhs[j & 3] += spring.stiffness.mul(w);
        } else {
            self.diagonal[i & 3] += spring.stiffness;
            self.rhs[i & 3] += spring.impulse;
            self.coupling[i & 7][j - i - 1] += spring.stiffness;
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
        let free = i - clamped; // rows before this one
        let mut d = self.diagonal[i & 3];
        let mut z = self.rhs[i & 3];
        let mut w = [Mat3::zero(); 3];
        for reach in (0..3).rev() {
            if reach >= free {
                continue;
            }
            let j = i - reach - 1;
            let mut w_ij = Mat3::from(self.coupling[j & 7][reach]);
            for further in reach + 1..3.min(free) {
                // W_ij −= W_ik L_jkᵀ with k = i − further − 1
                w_ij = w_ij.add_mul_transposed(&w[further], &link(&links[j], further - reach - 1));
            }
            let l_ij = w_ij.mul_sym(&self.inverse[j & 3]);
            d = d.sub_mul_transposed(&w_ij, &l_ij);
            z = z.add_mul(&l_ij, self.z[j & 3]);
            store(&l_ij, &mut links[i], reach);
            w[reach] = w_ij;
        }
        let inverse = d.inverse(L::from_f64(PIVOT_FLOOR));
        self.inverse[i & 3] = inverse;
        self.z[i & 3] = z;
        inverse.mul(z)
    }
}
