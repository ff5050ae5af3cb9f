//! Repulsion between strands: hair that is denser than at rest.
//!
//! # Theory
//! ```text
//! k_sc Σ_i max(ρ_i − ρ⁰_i, 0)³,   ρ_i = Σ_j W(|x_i − x_j|)   (with j = i)
//! W(r) = {4 − 6 s² + 3 s³, s < 1; (2 − s)³, s < 2; 0} / (4 π h³),  s = r/h
//! ```
//!
//! All particles of a set count, roots too, each with the mass 1. ρ⁰ is the density of the same set
//! at rest.
//!
//! # Practice
//! Pairs are found by cells of 2 h, so the cost is that of the pairs.

use super::adhesion::{Cells, distance};
use forelock_core::lane::Real;
use std::f64::consts::PI;

/// Coefficients of [`Repulsion`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RepulsionTerms {
    /// k_sc, in units that make the energy g cm² s⁻².
    pub stiffness: f64,
    /// h, cm: half the kernel's support.
    pub smoothing: f64,
}

impl Default for RepulsionTerms {
    fn default() -> Self {
        Self { stiffness: 5.0, smoothing: 0.6 }
    }
}

/// The cubic spline W(r), cm⁻³, and dW/dr.
pub fn kernel<T: Real>(r: T, h: f64) -> [T; 2] {
    let number = |x: f64| T::from(x).unwrap_or_else(T::zero);
    let (scale, h) = (number(0.25 / (PI * h * h * h)), number(h));
    let s = r / h;
    let [zero, one, two] = [0.0, 1.0, 2.0].map(number);
    if s < one {
        let value = number(4.0) - number(6.0) * s * s + number(3.0) * s * s * s;
        [scale * value, scale / h * (number(9.0) * s * s - number(12.0) * s)]
    } else if s < two {
        let left = two - s;
        [scale * left * left * left, -scale / h * number(3.0) * left * left]
    } else {
        [zero, zero]
    }
}

/// Repulsion within a set of particles.
#[derive(Clone, Debug)]
pub struct Repulsion<T> {
    terms: RepulsionTerms,
    /// ρ⁰, cm⁻³.
    at_rest: Vec<T>,
}

impl<T: Real> Repulsion<T> {
    /// Of particles that are at `rest`, cm, at rest.
    pub fn new(terms: RepulsionTerms, rest: &[[T; 3]]) -> Self {
        Self { terms, at_rest: densities(rest, terms.smoothing) }
    }

    /// The energy at `x`; its gradient is added to `gradient`, and to `stiffness` the trace of each
    /// particle's part of its second derivative where densities are linear. All have one entry a
    /// particle of the set.
    pub fn energy(&self, x: &[[T; 3]], gradient: &mut [[T; 3]], stiffness: &mut [T]) -> T {
        let h = self.terms.smoothing;
        let number = |x: f64| T::from(x).unwrap_or_else(T::zero);
        let k = number(self.terms.stiffness);
        let excess: Vec<T> =
            densities(x, h).iter().zip(&self.at_rest).map(|(a, b)| (*a - *b).max(T::zero())).collect();
        let energy = excess.iter().fold(T::zero(), |sum, e| sum + k * *e * *e * *e);
        let slopes: Vec<T> = excess.iter().map(|e| number(3.0) * k * *e * *e).collect();
        let curvatures: Vec<T> = excess.iter().map(|e| number(6.0) * k * *e).collect();
        // ∇ρ_i with respect to x_i.
        let mut own = vec![[T::zero(); 3]; x.len()];
        Cells::new(x, 2.0 * h).for_pairs(|i, j| {
            let r = distance(x[i], x[j]);
            // Coincident particles have no direction.
            if r > T::zero() {
                let slope = kernel(r, h)[1];
                let by_r = (slopes[i] + slopes[j]) * slope / r;
                stiffness[i] = stiffness[i] + curvatures[j] * slope * slope;
                stiffness[j] = stiffness[j] + curvatures[i] * slope * slope;
                for c in 0..3 {
                    let away = (x[i][c] - x[j][c]) / r;
                    own[i][c] = own[i][c] + slope * away;
                    own[j][c] = own[j][c] - slope * away;
                    let by = by_r * (x[i][c] - x[j][c]);
                    gradient[i][c] = gradient[i][c] + by;
                    gradient[j][c] = gradient[j][c] - by;
                }
            }
        });
        for ((stiffness, curvature), own) in stiffness.iter_mut().zip(&curvatures).zip(&own) {
            *stiffness = *stiffness + *curvature * own.iter().fold(T::zero(), |sum, g| sum + *g * *g);
        }
        energy
    }
}

/// ρ of every particle, cm⁻³.
pub fn densities<T: Real>(x: &[[T; 3]], smoothing: f64) -> Vec<T> {
    let mut densities = vec![kernel(T::zero(), smoothing)[0]; x.len()];
    Cells::new(x, 2.0 * smoothing).for_pairs(|i, j| {
        let w = kernel(distance(x[i], x[j]), smoothing)[0];
        densities[i] = densities[i] + w;
        densities[j] = densities[j] + w;
    });
    densities
}
