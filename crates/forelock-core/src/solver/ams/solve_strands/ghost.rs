//! What a row gets from its own mass, the air and the ghost rest shape: Eqs. 1, 2 of AMS and their Jacobians.

use super::terms::{FrameTerms, RowTerms, SubstepTerms};
use crate::lane::{Lane, Sym3, V3};

/// A particle's counterpart in the rest shape.
#[derive(Clone, Copy, Debug)]
pub struct Ghost<L> {
    /// Position y at the start of the substep.
    pub y: V3<L>,
    /// Velocity w = (y^{n+1} − y^n)/h over the substep.
    pub w: V3<L>,
}

impl<L: Lane> Ghost<L> {
    /// The ghost of a particle at `rest` about the model's centre.
    #[inline(always)]
    pub fn new(substep: &SubstepTerms<L>, rest: V3<L>) -> Self {
        let y = substep.ghost_at_start(rest);
        Self { y, w: (substep.ghost_at_end(rest) - y).scale(substep.inverse_h) }
    }
}

/// (m + h c) on the diagonal; m v + h m g + h c u on the right.
#[inline(always)]
pub fn inertia<L: Lane>(
    substep: &SubstepTerms<L>,
    v: V3<L>,
    (drag, air): (L, V3<L>),
    diagonal: &mut Sym3<L>,
    rhs: &mut V3<L>,
) {
    *diagonal = diagonal.add_identity(L::one() + drag);
    *rhs += v.add_scaled(substep.h, substep.gravity).add_scaled(drag, air);
}

/// Integrity tie with intact share s: s κ_I (y − x) − s m R g_head explicitly, s κ_I implicitly.
#[inline(always)]
pub fn integrity<L: Lane>(
    frame: &FrameTerms,
    substep: &SubstepTerms<L>,
    terms: &RowTerms<L>,
    ghost: &Ghost<L>,
    (x, intact): (V3<L>, L),
    (diagonal, rhs): (&mut Sym3<L>, &mut V3<L>),
) {
    let pull = ghost.y - x;
    let kappa = terms.integrity * intact;
    *rhs = rhs.add_scaled(substep.h * kappa, pull);
    let mut direction = pull;
    if frame.sag_free {
        *rhs = rhs.add_scaled(-(substep.h * intact), substep.carried_weight);
        if frame.directional {
            // The same force as from a ghost raised by m g/κ_I: the tie points there.
            let raised = L::one() / terms.integrity.max(L::from_f64(1e-24));
            direction = pull.add_scaled(-raised, substep.carried_weight);
        }
    }
    implicit_tie(frame, substep, kappa, direction, ghost.w, (diagonal, rhs));
}

/// h² κ I (or κ D with D along `pull`, as printed) on the diagonal and times w on the right.
#[inline(always)]
fn implicit_tie<L: Lane>(
    frame: &FrameTerms,
    substep: &SubstepTerms<L>,
    kappa: L,
    pull: V3<L>,
    w: V3<L>,
    (diagonal, rhs): (&mut Sym3<L>, &mut V3<L>),
) {
    let h2k = substep.h2 * kappa;
    if frame.directional {
        let tie = Sym3::outer_plus_identity(h2k / pull.dot(pull).max(substep.tiny), pull, L::zero());
        *diagonal += tie;
        *rhs += tie.mul(w);
    } else {
        *diagonal = diagonal.add_identity(h2k);
        *rhs = rhs.add_scaled(h2k, w);
    }
}

/// The tie's intact share after this substep's deflection e = |x − y|/L: s = min(s, ψ(e)), healed first where e is
/// small. ψ is 1 to the elastic limit e₀, [e − (e − e₀)²]/e to the breaking point, then falls to 0 linearly.
#[inline(always)]
pub fn damage<L: Lane>(frame: &FrameTerms, intact: L, deflection: V3<L>, strand_length: L) -> L {
    let Some(curve) = frame.non_hookean else { return intact };
    let (one, zero) = (L::one(), L::zero());
    let e = deflection.dot(deflection).sqrt() / strand_length;
    let over = (e - L::from_f64(curve.elastic_limit)).max(zero);
    let softened = one - over * over / e.max(L::from_f64(1e-12));
    let at_break = {
        let (e0, e1) = (curve.elastic_limit, curve.breaking_point);
        L::from_f64(1.0 - (e1 - e0) * (e1 - e0) / e1)
    };
    let past = (e - L::from_f64(curve.breaking_point)) / L::from_f64(curve.breaking_width);
    let broken = (at_break * (one - past)).max(zero);
    let psi = L::select(past.lt(zero), softened, broken);
    let healed = (one - intact).mul_add(L::from_f64(curve.healing), intact);
    let intact = L::select(e.lt(L::from_f64(curve.healing_limit)), healed, intact);
    intact.min(psi)
}

/// What the couple on an edge adds: h² a, and h a Δ + h² a (w_j − w_i) on its outer particle.
#[derive(Clone, Copy, Debug)]
pub struct Couple<L> {
    /// h² a, times the identity.
    pub stiffness: L,
    /// On the outer particle; the opposite on the inner.
    pub impulse: V3<L>,
}

/// Angular tie of the edge e = `d` to the ghost edge g: the couple a Δ, Δ = g − e, with
/// a = (κ_α/l) (θ/2)/sin(θ/2), θ the angle between them.
#[inline(always)]
pub fn angular_edge<L: Lane>(
    substep: &SubstepTerms<L>,
    kappa: L,
    (d, inverse_rest, inverse_length): (V3<L>, L, L),
    ghosts: [&Ghost<L>; 2],
) -> Couple<L> {
    let g = ghosts[1].y - ghosts[0].y;
    let half = L::from_f64(0.5);
    // sin²(θ/2) = (1 − cos θ)/2; where this cancels, the ratio is 1 to rounding.
    let cosine = g.dot(d) * inverse_rest * inverse_length;
    let square = cosine.neg_mul_add(half, half).max(L::zero()).min(L::one());
    let a = kappa * inverse_rest * L::asin_ratio(square);
    let ha = substep.h * a;
    let stiffness = substep.h * ha;
    let impulse = (g - d).scale(ha).add_scaled(stiffness, ghosts[1].w - ghosts[0].w);
    Couple { stiffness, impulse }
}

/// The paper's angular tie: θ at x_{i−1} between the rays to y_i and to x_i; a (y_i − x_i) on i alone,
/// a = κ_α θ/max(|y_i − x_i|, 1e-8 l).
#[inline(always)]
pub fn angular_paper<L: Lane>(
    frame: &FrameTerms,
    substep: &SubstepTerms<L>,
    kappa: L,
    ghost: &Ghost<L>,
    ([previous, x], rest_length): ([V3<L>; 2], L),
    (diagonal, rhs): (&mut Sym3<L>, &mut V3<L>),
) {
    let pull = ghost.y - x;
    let (to_ghost, to_particle) = (ghost.y - previous, x - previous);
    let cross = to_ghost.cross(to_particle);
    let theta = L::atan2(cross.dot(cross).sqrt(), to_ghost.dot(to_particle));
    let a = kappa * theta / pull.dot(pull).sqrt().max(rest_length * L::from_f64(1e-8));
    *rhs = rhs.add_scaled(substep.h * a, pull);
    implicit_tie(frame, substep, a, pull, ghost.w, (diagonal, rhs));
}
