//! The output head that rotates edges, so that a strand cannot stretch.
//!
//! # Theory
//! With the edges at rest v_i = X_{i+1} − X_i and the output o, `[24, 3]`:
//!
//! ```text
//! u = ½ B o
//! x_{i+1} = x_i + v_i + 2/(1 + |u_i|²) (u_i × v_i + u_i × (u_i × v_i))
//! ```
//!
//! This turns v_i about u_i by 2 atan |u_i|, for any u. B scales the modes of bending so that all
//! have the same share in the energy:
//!
//! ```text
//! B = 4 D₁ Φ λ^(−3/4) λ_min^(1/4),   Φ λ Φᵀ = k_bt D₂ᵀD₂ + (m/Δt²) I
//! D₁ = I − (shift down by one),   D₂ = D₁²
//! ```
//!
//! The paper's head adds displacements, s_i o_i with the arc length s_i; it hardly moves under the
//! paper's weights. [`displace`] is that one.

use crate::losses::Strand;
use crate::{EDGES, PARTICLES};
use forelock_core::lane::{Lane, V3};

/// B, `[24][24]`.
pub type Basis = [[f64; EDGES]; EDGES];

/// B for bending stiffness `bend_twist`, g cm³ s⁻², particles of `mass`, g, and frames of
/// `dt_secs`.
pub fn basis(bend_twist: f64, mass: f64, dt_secs: f64) -> Basis {
    // D₂ᵀD₂ of D₂ = D₁²: rows 1, −2, 1.
    let d2 = |r: usize, c: usize| match r.checked_sub(c) {
        Some(0 | 2) => 1.0,
        Some(1) => -2.0,
        _ => 0.0,
    };
    let mut matrix = [[0.0; EDGES]; EDGES];
    for (r, row) in matrix.iter_mut().enumerate() {
        for (c, entry) in row.iter_mut().enumerate() {
            *entry = bend_twist * (0..EDGES).map(|k| d2(k, r) * d2(k, c)).sum::<f64>();
            if r == c {
                *entry += mass / (dt_secs * dt_secs);
            }
        }
    }
    let (values, vectors) = eigen(matrix);
    let least = values.iter().copied().fold(f64::INFINITY, f64::min);
    let mut basis = [[0.0; EDGES]; EDGES];
    for (k, value) in values.iter().enumerate() {
        let scale = 4.0 * value.powf(-0.75) * least.powf(0.25);
        for i in 0..EDGES {
            let before = if i > 0 { vectors[i - 1][k] } else { 0.0 };
            basis[i][k] = scale * (vectors[i][k] - before);
        }
    }
    basis
}

/// Eigenvalues, ascending, and eigenvectors (columns) of a symmetric matrix: Jacobi's rotations.
fn eigen(mut a: Basis) -> ([f64; EDGES], Basis) {
    let mut vectors = [[0.0; EDGES]; EDGES];
    for (i, row) in vectors.iter_mut().enumerate() {
        row[i] = 1.0;
    }
    for _ in 0..60 {
        for p in 0..EDGES {
            for q in p + 1..EDGES {
                if a[p][q] == 0.0 {
                    continue;
                }
                let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
                let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
                let c = 1.0 / (t * t + 1.0).sqrt();
                let s = t * c;
                for row in a.iter_mut().chain(&mut vectors) {
                    let [x, y] = [row[p], row[q]];
                    [row[p], row[q]] = [c * x - s * y, s * x + c * y];
                }
                let [above, below] = [a[p], a[q]];
                a[p] = std::array::from_fn(|k| c * above[k] - s * below[k]);
                a[q] = std::array::from_fn(|k| s * above[k] + c * below[k]);
            }
        }
    }
    let mut order: [usize; EDGES] = std::array::from_fn(|i| i);
    order.sort_by(|i, j| a[*i][*i].total_cmp(&a[*j][*j]));
    let sorted = vectors.map(|row| order.map(|k| row[k]));
    (order.map(|k| a[k][k]), sorted)
}

/// Replaces three outputs an edge, o, by ½ B o.
pub(crate) fn fold(o: &mut [f32], basis: &Basis) {
    let mut u = [[0.0; 3]; EDGES];
    for (u, row) in u.iter_mut().zip(basis) {
        for (weight, o) in row.iter().zip(o.chunks_exact(3)) {
            for c in 0..3 {
                u[c] += 0.5 * weight * f64::from(o[c]);
            }
        }
    }
    for (o, u) in o.iter_mut().zip(u.as_flattened()) {
        *o = *u as f32;
    }
}

/// Particles from the rotations `u` of edges, which are half of B o.
#[inline(always)]
pub fn rotate<L: Lane>(root: V3<L>, edges: &[V3<L>; EDGES], u: &[V3<L>; EDGES]) -> Strand<L> {
    let mut x = [root; PARTICLES];
    for i in 0..EDGES {
        x[i + 1] = x[i] + edges[i] + turn(u[i], edges[i]);
    }
    x
}

/// 2/(1 + |u|²) (u × v + u × (u × v)).
#[inline(always)]
pub(super) fn turn<L: Lane>(u: V3<L>, v: V3<L>) -> V3<L> {
    let across = u.cross(v);
    (across + u.cross(across)).scale(L::from_f64(2.0) / (L::one() + u.dot(u)))
}

/// The gradient with respect to `u` of a function whose gradient with respect to the particles is
/// `by_x`.
#[inline(always)]
pub fn rotate_gradient<L: Lane>(
    edges: &[V3<L>; EDGES],
    u: &[V3<L>; EDGES],
    by_x: &Strand<L>,
) -> [V3<L>; EDGES] {
    let mut by_u = [V3::zero(); EDGES];
    // An edge moves all particles after it.
    let mut later = V3::zero();
    for i in (0..EDGES).rev() {
        later += by_x[i + 1];
        let (u, v) = (u[i], edges[i]);
        let factor = L::from_f64(2.0) / (L::one() + u.dot(u));
        let across = u.cross(v);
        let sum = across + u.cross(across);
        // With a = u × v: a·g and (u × a)·g, each by u.
        let by_across = later + later.cross(u);
        by_u[i] = (v.cross(by_across) + across.cross(later)).scale(factor);
        by_u[i] = by_u[i].add_scaled(-(factor * factor * sum.dot(later)), u);
    }
    by_u
}

/// The paper's head: particle i is displaced by s_i o_i, with the arc length s_i, cm.
#[inline(always)]
pub fn displace<L: Lane>(rest: &Strand<L>, arc_lengths: &[L; PARTICLES], o: &[V3<L>; EDGES]) -> Strand<L> {
    let mut x = *rest;
    for i in 0..EDGES {
        x[i + 1] = x[i + 1].add_scaled(arc_lengths[i + 1], o[i]);
    }
    x
}
