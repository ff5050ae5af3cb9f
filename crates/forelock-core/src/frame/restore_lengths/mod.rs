//! The pass that restores the rest length of every edge, once a frame (AMS, Algorithm 1, line 12).
//!
//! # Theory
//! With C_j = |x_{j+1} − x_j| − l_j, J its Jacobian and W the inverse masses (0 for clamped
//! particles), a Newton step is
//!
//! ```text
//! (J W Jᵀ) λ = −C ,   x += W Jᵀ λ
//! ```
//!
//! On a chain J W Jᵀ is tridiagonal: w_j + w_{j+1} on the diagonal, −w_{j+1} d_j·d_{j+1} off the
//! diagonal. Two steps leave an error of fourth order, which one follow-the-leader sweep reduces to
//! rounding. Velocities are projected with the same matrix: (J W Jᵀ) λ = −J v, v += W Jᵀ λ.
//!
//! The alternative is dynamic follow the leader (DFTL; Müller 2012). From root to tip, it moves
//! each particle (the follower) by a correction c onto the sphere with the rest length as radius
//! about the particle before it (the leader). It then adds c/dt to the velocity of the follower,
//! and subtracts `damping`·c/dt from the velocity of the leader.
//!
//! [`Inextensibility::Limit`] shortens edges longer than (1 + s) l_j to that length and leaves all
//! others alone: the same steps with rows for edges at their limit or beyond, those of the others
//! being zero. The sweep then leaves no edge over its limit. Velocities have rows for edges at
//! their limit whose ends move apart. This is a projection, so kinetic energy never grows. Selle
//! (2008) limits the strain after each implicit solve, from root to tip.
//!
//! # Limitations
//! Between two passes a strand that hangs at its limit falls by up to ½ g dt². Lifting it
//! stretches, up to the limit, a few edges that its weight alone would stretch less.
//!
//! Collisions are resolved afterwards and may stretch edges again where hair is pressed against a
//! solid.

use crate::lane::{Lane, Row, V3};
use crate::params::Inextensibility;
use crate::strands::{BlockView, inverse_mass};

/// WGSL of the stage.
pub const WGSL: &str = include_str!("kernel.wgsl");

/// Inputs of the pass.
#[derive(Clone, Copy, Debug)]
pub struct LengthTerms {
    /// Method that restores the lengths.
    pub kind: Inextensibility,
    /// Stretch to which [`Inextensibility::Limit`] shortens edges.
    pub max_stretch: f64,
    /// Fraction of a DFTL correction that is subtracted from the leader's velocity.
    pub damping: f64,
    /// Frame time, seconds.
    pub dt_secs: f64,
    /// Number of clamped particles of each strand, counted from the root.
    pub clamped: usize,
}

/// Number of Newton steps before the follow-the-leader sweep.
pub const NEWTON_STEPS: usize = 2;

/// Length, over the limit, from which an edge counts as being at its limit: rounding leaves it a
/// little shorter.
pub const AT_LIMIT: f64 = 0.9999;

/// Restores the edge lengths of the strands in lanes `first..first + L::WIDTH`. Returns the largest
/// |l/l₀ − 1| that is left in each lane. `work` is scratch memory of two vectors per particle.
#[inline(always)]
pub fn restore<L: Lane>(
    terms: &LengthTerms,
    view: &mut BlockView<'_, L::Scalar>,
    first: usize,
    work: &mut [V3<L>],
) -> L {
    let (directions, sweep) = work.split_at_mut(view.particles);
    // Index of the first edge with a free end. Edges between clamped particles keep their rest
    // length.
    let from = terms.clamped.min(view.particles).saturating_sub(1);
    match terms.kind {
        Inextensibility::Off => {}
        Inextensibility::Projection => project(view, first, from, None, directions, sweep),
        Inextensibility::Limit => {
            let limit = Some(L::from_f64(1.0 + terms.max_stretch));
            project(view, first, from, limit, directions, sweep);
        }
        Inextensibility::FollowTheLeader => {
            let inverse_dt = 1.0 / terms.dt_secs;
            let change = VelocityChange {
                follower: L::from_f64(inverse_dt),
                leader: L::from_f64(terms.damping * inverse_dt),
            };
            follow_the_leader(view, first, from, None, Some(change));
        }
    }
    largest_stretch(view, first)
}

/// Newton steps, the sweep and the projection of the velocities. With a `limit`, edges shorter than
/// that, over their rest length, are left alone.
#[inline(always)]
fn project<L: Lane>(
    view: &mut BlockView<'_, L::Scalar>,
    first: usize,
    from: usize,
    limit: Option<L>,
    directions: &mut [V3<L>],
    sweep: &mut [V3<L>],
) {
    for _ in 0..NEWTON_STEPS {
        measure(view, first, from, limit, directions, sweep);
        solve_chain(view, first, from, directions, sweep);
        push(view.positions, view.masses, first, from, directions, sweep);
    }
    follow_the_leader(view, first, from, limit, None);
    project_velocities(view, first, from, limit, directions, sweep);
}

/// Whether edges of the given `length` are at the limit `most`.
#[inline(always)]
fn is_at_limit<L: Lane>(length: L, most: L) -> L::Mask {
    (L::from_f64(AT_LIMIT) * most).lt(length)
}

/// Computes the constraints: `directions` receives the unit vectors of the edges, the third
/// component of `sweep` receives −C. With a `limit`, both are zero for edges that are not at it.
#[inline(always)]
fn measure<L: Lane>(
    view: &BlockView<'_, L::Scalar>,
    first: usize,
    from: usize,
    limit: Option<L>,
    directions: &mut [V3<L>],
    sweep: &mut [V3<L>],
) {
    for j in from..view.particles - 1 {
        let (mut direction, length) = edge(view, first, j);
        let rest_length = L::load(&view.rest_lengths[3 * j], first);
        let mut missing = rest_length - length;
        if let Some(limit) = limit {
            let most = limit * rest_length;
            missing = (most - length).min(L::zero());
            direction = V3::select(is_at_limit(length, most), direction, V3::zero());
        }
        directions[j] = direction;
        sweep[j].0[2] = missing;
    }
}

/// Unit vector and length of edge `j`.
#[inline(always)]
fn edge<L: Lane>(view: &BlockView<'_, L::Scalar>, first: usize, j: usize) -> (V3<L>, L) {
    let d = V3::<L>::load(view.positions, j + 1, first) - V3::load(view.positions, j, first);
    let length = d.dot(d).max(L::from_f64(1e-24)).sqrt();
    (d.scale(L::one() / length), length)
}

/// Solves J W Jᵀ λ = r with the Thomas algorithm. `sweep[j].0[2]` holds r before and λ afterwards.
#[inline(always)]
fn solve_chain<L: Lane>(
    view: &BlockView<'_, L::Scalar>,
    first: usize,
    from: usize,
    directions: &[V3<L>],
    sweep: &mut [V3<L>],
) {
    let particles = view.particles;
    // Inverse mass of the particle at the start of the edge. The first edge starts at a clamped
    // particle.
    let mut inner = L::zero();
    let (mut upper, mut partial) = (L::zero(), L::zero()); // c′ and r′ of the previous row
    let mut beside = L::zero(); // the off-diagonal entry between this row and the previous one
    for j in from..particles - 1 {
        let outer = view.inverse_mass::<L>(j + 1, first);
        let pivot = L::one() / beside.neg_mul_add(upper, inner + outer);
        partial = beside.neg_mul_add(partial, sweep[j].0[2]) * pivot;
        let next =
            if j + 2 < particles { -(directions[j].dot(directions[j + 1]) * outer) } else { L::zero() };
        upper = next * pivot;
        sweep[j].0[0] = upper;
        sweep[j].0[1] = partial;
        (beside, inner) = (next, outer);
    }
    let mut lambda = L::zero();
    for j in (from..particles - 1).rev() {
        lambda = sweep[j].0[0].neg_mul_add(lambda, sweep[j].0[1]);
        sweep[j].0[2] = lambda;
    }
}

/// Adds W Jᵀ λ to `rows`, which are positions or velocities.
#[inline(always)]
fn push<L: Lane>(
    rows: &mut [Row<L::Scalar>],
    masses: &[Row<L::Scalar>],
    first: usize,
    from: usize,
    directions: &[V3<L>],
    sweep: &[V3<L>],
) {
    let particles = directions.len();
    for i in from + 1..particles {
        let w: L = inverse_mass(masses, i, first);
        let mut value = V3::load(rows, i, first).add_scaled(sweep[i - 1].0[2] * w, directions[i - 1]);
        if i + 1 < particles {
            value = value.add_scaled(-sweep[i].0[2] * w, directions[i]);
        }
        value.store(rows, i, first);
    }
}

/// Factors by which a DFTL correction changes velocities, 1/s.
#[derive(Clone, Copy)]
struct VelocityChange<L> {
    /// 1/dt, for the particle that moves.
    follower: L,
    /// damping/dt, subtracted from the particle before it.
    leader: L,
}

/// Moves each particle along its edge to the rest length from the particle before it; with a
/// `limit` only those that are farther than that, and to it. With `change`, the corrections also
/// change the velocities, as in DFTL.
#[inline(always)]
fn follow_the_leader<L: Lane>(
    view: &mut BlockView<'_, L::Scalar>,
    first: usize,
    from: usize,
    limit: Option<L>,
    change: Option<VelocityChange<L>>,
) {
    for j in from..view.particles - 1 {
        let before = V3::load(view.positions, j + 1, first);
        let (direction, length) = edge(view, first, j);
        let rest_length = L::load(&view.rest_lengths[3 * j], first);
        let goal = limit.map_or(rest_length, |limit| limit * rest_length);
        let mut after = V3::<L>::load(view.positions, j, first).add_scaled(goal, direction);
        if limit.is_some() {
            after = V3::select(goal.lt(length), after, before);
        }
        after.store(view.positions, j + 1, first);
        if let Some(change) = change {
            let correction = after - before;
            let v = V3::load(view.velocities, j + 1, first).add_scaled(change.follower, correction);
            v.store(view.velocities, j + 1, first);
            if j > from {
                let leader = V3::load(view.velocities, j, first).add_scaled(-change.leader, correction);
                leader.store(view.velocities, j, first);
            }
        }
    }
}

/// Removes the component of the velocities that changes edge lengths; with a `limit`, the one that
/// stretches edges which are at it.
#[inline(always)]
fn project_velocities<L: Lane>(
    view: &mut BlockView<'_, L::Scalar>,
    first: usize,
    from: usize,
    limit: Option<L>,
    directions: &mut [V3<L>],
    sweep: &mut [V3<L>],
) {
    let mut v = V3::<L>::load(view.velocities, from, first);
    for j in from..view.particles - 1 {
        let next = V3::load(view.velocities, j + 1, first);
        let (mut direction, length) = edge(view, first, j);
        let mut closing = -direction.dot(next - v);
        if let Some(limit) = limit {
            let most = limit * L::load(&view.rest_lengths[3 * j], first);
            closing = L::select(is_at_limit(length, most), closing.min(L::zero()), L::zero());
            direction = V3::select(closing.lt(L::zero()), direction, V3::zero());
        }
        directions[j] = direction;
        sweep[j].0[2] = closing;
        v = next;
    }
    solve_chain(view, first, from, directions, sweep);
    push(view.velocities, view.masses, first, from, directions, sweep);
}

/// The largest |l/l₀ − 1| of the edges of each lane.
#[inline(always)]
pub fn largest_stretch<L: Lane>(view: &BlockView<'_, L::Scalar>, first: usize) -> L {
    let mut largest = L::zero();
    for j in 0..view.particles - 1 {
        let stretch = stretch::<L>(view, first, j);
        largest = stretch.max(-stretch).max(largest);
    }
    largest
}

/// The largest l/l₀ − 1 of the edges of each lane, at least 0: compressed edges do not count.
#[inline(always)]
pub fn largest_extension<L: Lane>(view: &BlockView<'_, L::Scalar>, first: usize) -> L {
    let mut largest = L::zero();
    for j in 0..view.particles - 1 {
        largest = stretch::<L>(view, first, j).max(largest);
    }
    largest
}

/// l/l₀ − 1 of edge `j`.
#[inline(always)]
fn stretch<L: Lane>(view: &BlockView<'_, L::Scalar>, first: usize, j: usize) -> L {
    edge::<L>(view, first, j).1 / L::load(&view.rest_lengths[3 * j], first) - L::one()
}
