//! Edge, bend and torsion springs: Eq. 5 of AMS, with the tension term that makes them stable at
//! any substep.

use super::SubstepTerms;
use crate::lane::{Lane, Sym3, V3};

/// Contribution to the system of a spring between particles i and j.
#[derive(Clone, Copy, Debug)]
pub struct Spring<L> {
    /// h² K.
    pub stiffness: Sym3<L>,
    /// h κ (l − l₀) d on i, and the opposite on j.
    pub impulse: V3<L>,
    /// 1/l.
    pub inverse_length: L,
}

/// The spring of stiffness `kappa` across `d` = x_j − x_i, of rest length `rest_length`:
/// K = κ [D + τ (I − D)], D = d dᵀ/l², τ = max(0, 1 − l₀/l) with `tension`, else 0 (the paper's).
#[inline(always)]
pub fn spring<L: Lane>(
    substep: &SubstepTerms<L>,
    kappa: L,
    tension: bool,
    d: V3<L>,
    rest_length: L,
) -> Spring<L> {
    let inverse_length = L::one() / d.dot(d).max(substep.tiny).sqrt();
    let stretch = rest_length.neg_mul_add(inverse_length, L::one()); // 1 − l₀/l
    let impulse = d.scale(kappa * substep.h * stretch); // h κ (l − l₀) d/l
    let h2k = kappa * substep.h2;
    let tau = if tension { stretch.max(L::zero()) } else { L::zero() };
    let along = h2k * (L::one() - tau) * inverse_length * inverse_length;
    let stiffness = Sym3::outer_plus_identity(along, d, h2k * tau);
    Spring { stiffness, impulse, inverse_length }
}
