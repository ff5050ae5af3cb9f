//! Style: hair near the body keeps its rest shape.
//!
//! # Theory
//! ```text
//! k_h Σ_{i≥1} (1 − clamp(d_i/s_max, 0, 1)) |x_i − X_i|²
//! ```
//!
//! d is the signed distance from the body. The weight has no gradient: with one, hair could lower
//! the energy by moving away from the body.

use super::Strand;
use super::body::Body;
use crate::PARTICLES;
use forelock_core::lane::Lane;

/// Coefficients of [`style`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StyleTerms {
    /// k_h, g s⁻².
    pub stiffness: f64,
    /// s_max, cm: the distance at which it ends.
    pub range: f64,
}

impl Default for StyleTerms {
    fn default() -> Self {
        Self { stiffness: 3.0, range: 4.0 }
    }
}

/// The energy of style of a strand with rest positions `rest`. The stiffness that holds each
/// particle is added to `stiffness`.
#[inline(always)]
pub fn style<L: Lane, B: Body<L> + ?Sized>(
    terms: &StyleTerms,
    body: &B,
    [rest, x]: [&Strand<L>; 2],
    gradient: &mut Strand<L>,
    stiffness: &mut [L; PARTICLES],
) -> L {
    let [k, over_range, two] = [terms.stiffness, 1.0 / terms.range, 2.0].map(L::from_f64);
    let mut energy = L::zero();
    for (((rest, x), gradient), stiffness) in rest.iter().zip(x).zip(gradient).zip(stiffness).skip(1) {
        let share = (body.near(*x).distance * over_range).max(L::zero()).min(L::one());
        let weight = k * (L::one() - share);
        let u = *x - *rest;
        energy += weight * u.dot(u);
        *gradient = gradient.add_scaled(two * weight, u);
        *stiffness += two * weight;
    }
    energy
}
