//! Contributions to a row from the particle's mass, the air and the ghost rest shape: Eqs. 1 and 2
//! of AMS and their Jacobians.

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

/// The row of a particle in the system: its diagonal block and its right side.
#[derive(Debug)]
pub struct Row<'a, L> {
    /// Diagonal block.
    pub diagonal: &'a mut Sym3<L>,
    /// Right side.
    pub rhs: &'a mut V3<L>,
}

/// The edge that an angular tie turns.
#[derive(Clone, Copy, Debug)]
pub struct TiedEdge<L> {
    /// From the inner to the outer particle.
    pub d: V3<L>,
    /// One over the rest length.
    pub inverse_rest: L,
    /// One over the length.
    pub inverse_length: L,
}

/// (m + h c) on the diagonal; m v + h m g + h c u on the right.
#[inline(always)]
pub fn inertia<L: Lane>(
    substep: &SubstepTerms<L>,
    mass: L,
    v: V3<L>,
    drag: L,
    air: V3<L>,
    row: &mut Row<'_, L>,
) {
    *row.diagonal = row.diagonal.add_identity(mass + drag);
    *row.rhs += v.add_scaled(substep.h, substep.gravity).scale(mass).add_scaled(drag, air);
}

/// Integrity tie with intact share s: s κ_I (y − x) − s m R g_head explicitly, s κ_I implicitly.
#[inline(always)]
pub fn integrity<L: Lane>(
    frame: &FrameTerms,
    substep: &SubstepTerms<L>,
    terms: &RowTerms<L>,
    ghost: &Ghost<L>,
    x: V3<L>,
    intact: L,
    row: &mut Row<'_, L>,
) {
    let pull = ghost.y - x;
    let kappa = terms.integrity * intact;
    *row.rhs = row.rhs.add_scaled(substep.h * kappa, pull);
    let mut direction = pull;
    if frame.sag_free {
        *row.rhs = row.rhs.add_scaled(-(substep.h * intact * terms.mass), substep.carried_weight);
        if frame.directional {
            // The force is that of a tie to a ghost raised by m g/κ_I, so the tie points to that
            // ghost.
            let raised = terms.mass / terms.integrity.max(L::from_f64(1e-24));
            direction = pull.add_scaled(-raised, substep.carried_weight);
        }
    }
    implicit_tie(frame, substep, kappa, direction, ghost.w, row);
}

/// h² κ I (or h² κ D with D along `pull`, as printed) on the diagonal, and the same block times w
/// on the right.
#[inline(always)]
fn implicit_tie<L: Lane>(
    frame: &FrameTerms,
    substep: &SubstepTerms<L>,
    kappa: L,
    pull: V3<L>,
    w: V3<L>,
    row: &mut Row<'_, L>,
) {
    let h2k = substep.h2 * kappa;
    if frame.directional {
        let tie = Sym3::outer_plus_identity(h2k / pull.dot(pull).max(substep.tiny), pull, L::zero());
        *row.diagonal += tie;
        *row.rhs += tie.mul(w);
    } else {
        *row.diagonal = row.diagonal.add_identity(h2k);
        *row.rhs = row.rhs.add_scaled(h2k, w);
    }
}

/// The tie's intact share after this substep's deflection e = |x − y|/L: s = min(s, ψ(e)), healed
/// first where e is small. ψ is 1 up to the elastic limit e₀, and [e − (e − e₀)²/(2 (e_b − e₀))]/e
/// up to the breaking point e_b, where the tension e ψ has its maximum. Then ψ falls linearly from
/// (e_b + e₀)/(2 e_b) to 0.
#[inline(always)]
pub fn damage<L: Lane>(frame: &FrameTerms, intact: L, deflection: V3<L>, strand_length: L) -> L {
    let Some(curve) = frame.non_hookean else { return intact };
    let (one, zero) = (L::one(), L::zero());
    let e = deflection.dot(deflection).sqrt() / strand_length;
    let over = (e - L::from_f64(curve.elastic_limit)).max(zero);
    let (e0, e1) = (curve.elastic_limit, curve.breaking_point);
    let softened = one - over * over * L::from_f64((0.5 / (e1 - e0)).min(1e30)) / e.max(L::from_f64(1e-12));
    let at_break = L::from_f64(0.5 * (e1 + e0) / e1);
    let past = (e - L::from_f64(curve.breaking_point)) / L::from_f64(curve.breaking_width);
    let broken = (at_break * (one - past)).max(zero);
    let psi = L::select(past.lt(zero), softened, broken);
    let healed = (one - intact).mul_add(L::from_f64(curve.healing), intact);
    let intact = L::select(e.lt(L::from_f64(curve.healing_limit)), healed, intact);
    intact.min(psi)
}

/// Contribution of the couple on an edge: h² a to the stiffness, and h a Δ + h² a (w_j − w_i) as
/// impulse on the outer particle.
#[derive(Clone, Copy, Debug)]
pub struct Couple<L> {
    /// h² a, times the identity.
    pub stiffness: L,
    /// On the outer particle; the opposite on the inner.
    pub impulse: V3<L>,
}

/// Angular tie of the edge e to the ghost edge g: the couple a Δ, Δ = g − e, with
/// a = (κ_α/l) (θ/2)/sin(θ/2), θ the angle between them.
#[inline(always)]
pub fn angular_edge<L: Lane>(
    substep: &SubstepTerms<L>,
    kappa: L,
    edge: TiedEdge<L>,
    ghosts: [&Ghost<L>; 2],
) -> Couple<L> {
    let TiedEdge { d, inverse_rest, inverse_length } = edge;
    let g = ghosts[1].y - ghosts[0].y;
    let half = L::from_f64(0.5);
    // sin²(θ/2) = (1 − cos θ)/2; where this cancels, the ratio is 1 up to rounding.
    let cosine = g.dot(d) * inverse_rest * inverse_length;
    let square = cosine.neg_mul_add(half, half).max(L::zero()).min(L::one());
    let a = kappa * inverse_rest * L::asin_ratio(square);
    let ha = substep.h * a;
    let stiffness = substep.h * ha;
    let impulse = (g - d).scale(ha).add_scaled(stiffness, ghosts[1].w - ghosts[0].w);
    Couple { stiffness, impulse }
}

/// The paper's angular tie: θ at x_{i−1} between the rays to y_i and to x_i; the force a (y_i −
/// x_i) on i alone, a = κ_α θ/max(|y_i − x_i|, 1e-8 l). `points` are x_{i−1} and x_i.
#[inline(always)]
pub fn angular_paper<L: Lane>(
    frame: &FrameTerms,
    substep: &SubstepTerms<L>,
    kappa: L,
    ghost: &Ghost<L>,
    points: [V3<L>; 2],
    rest_length: L,
    row: &mut Row<'_, L>,
) {
    let [previous, x] = points;
    let pull = ghost.y - x;
    let (to_ghost, to_particle) = (ghost.y - previous, x - previous);
    let cross = to_ghost.cross(to_particle);
    let theta = L::atan2(cross.dot(cross).sqrt(), to_ghost.dot(to_particle));
    let a = kappa * theta / pull.dot(pull).sqrt().max(rest_length * L::from_f64(1e-8));
    *row.rhs = row.rhs.add_scaled(substep.h * a, pull);
    implicit_tie(frame, substep, a, pull, ghost.w, row);
}
