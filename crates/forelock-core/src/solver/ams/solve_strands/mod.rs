//! One implicit substep of a strand: assembly and exact solve in a single sweep.
//!
//! # Theory
//! Backward Euler on springs linearised about the start of the substep (Selle 2008; AMS Eq. 9),
//! multiplied by the mass so that the system is symmetric positive definite:
//!
//! ```text
//! A_ii = (m_i + h c_i) I + h² Σ_j K_ij + h² s_i κ_I I + angular
//! A_ij = −h² K_ij                                            0 < |i−j| ≤ 3
//! b_i  = m_i v_i + h (f_i + S_i) + h c_i u_i + h² s_i κ_I w_i + angular
//! ```
//!
//! with K from `springs`, the ghost's terms from `ghost`, and 3×3 blocks in a band of half-width 3.
//! The block LDLᵀ of `factor` solves the system exactly. Clamped particles have v = w; their
//! columns move to b.
//!
//! # Practice
//! Row `i` needs springs from rows `i−3..=i`, so one loop computes the three springs that start at
//! `i`, adds them to a ring of four rows, and eliminates row `i` at once. The matrix is never
//! stored: only the factors that the backward sweep needs are kept, 30 numbers per particle.
//!
//! # Limitations
//! In float32 the factors are accurate up to h² κ = 1e3; see
//! [`AmsParams::validate_step`](crate::solver::AmsParams::validate_step).

mod altitude;
mod factor;
mod ghost;
mod springs;
mod terms;

pub use factor::PIVOT_FLOOR;
pub use terms::{FrameTerms, RowTerms, SubstepTerms};

use crate::lane::{Lane, V3};
use crate::strands::{BlockView, Scratch};
use factor::{Link, Ring};
use ghost::{Ghost, TiedEdge};

/// The stage's name in reports.
pub const STAGE: &str = "solve_strands";
/// WGSL of the stage; it needs one of the two texts below.
pub const WGSL: &str = include_str!("kernel.wgsl");
/// WGSL that stores the factors in 32 bits.
pub const LINKS_WGSL: &str = include_str!("links.wgsl");
/// WGSL that stores the factors in 16 bits.
pub const LINKS_HALVED_WGSL: &str = include_str!("links_halved.wgsl");

/// Advances lanes `first..first + L::WIDTH` by a substep: the implicit solve gives velocities, then
/// x += h v. Clamped particles are placed at their ghosts.
#[inline(always)]
pub fn advance<L: Lane>(
    frame: &FrameTerms,
    substep: &SubstepTerms<L>,
    view: &mut BlockView<'_, L::Scalar>,
    first: usize,
    scratch: &mut Scratch<L::Scalar>,
) {
    let n = view.particles;
    let clamped = frame.clamped.min(n);
    let scratch = scratch.vectors::<L>();
    let (links, half_solved) = scratch.split_at_mut(9 * n);
    let links: &mut [Link<L>] = bytemuck::cast_slice_mut(links);
    eliminate(frame, substep, view, first, links, &mut *half_solved);

    // Backward sweep: v_i = D_i⁻¹ z_i − Σ_j L_jiᵀ v_j, with −L stored.
    let mut later = [V3::zero(); 3];
    for i in (0..n).rev() {
        let mut v = half_solved[i];
        if i >= clamped {
            for (reach, v_later) in later.iter().enumerate().take((n - 1 - i).min(3)) {
                v = v.add_transposed(&links[i + reach + 1][reach], *v_later);
            }
            let x = V3::load(view.positions, i, first).add_scaled(substep.h, v);
            x.store(view.positions, i, first);
        } else {
            let rest = V3::load(view.rest, i, first);
            substep.ghost_at_end(rest).store(view.positions, i, first);
        }
        v.store(view.velocities, i, first);
        later = [v, later[0], later[1]];
    }
}

/// Forward sweep: assembles and eliminates row after row. Writes −L to `links` and D⁻¹z to
/// `half_solved` (for clamped particles the ghost's velocity).
#[inline(always)]
#[expect(clippy::needless_range_loop, reason = "the equations are in terms of the row number")]
fn eliminate<L: Lane>(
    frame: &FrameTerms,
    substep: &SubstepTerms<L>,
    view: &mut BlockView<'_, L::Scalar>,
    first: usize,
    links: &mut [Link<L>],
    half_solved: &mut [V3<L>],
) {
    let n = view.particles;
    let clamped = frame.clamped.min(n);
    let stiffness = L::load(view.stiffness, first);
    let mut ring = Ring::new(frame.k_altitude > 0.0, view.least_mass);
    let mut ghost = Ghost::new(substep, V3::load(view.rest, 0, first));
    for i in 0..n {
        let terms = frame.row::<L>(i, n, stiffness, view.mass(i, first));
        ring.open(i);
        if i >= clamped {
            tie_to_ghost(frame, substep, view, Place { i, first }, &terms, &ghost, &mut ring);
        }
        let next = Ghost::new(substep, V3::load(view.rest, (i + 1).min(n - 1), first));
        let ghosts = [&ghost, &next];
        add_spring::<1, L>(frame, substep, view, Place { i, first }, &terms, ghosts, &mut ring);
        add_spring::<2, L>(frame, substep, view, Place { i, first }, &terms, ghosts, &mut ring);
        add_spring::<3, L>(frame, substep, view, Place { i, first }, &terms, ghosts, &mut ring);
        if frame.k_altitude > 0.0 && i + 3 < n {
            let tetrahedron = tetrahedron(substep, view, i, first);
            altitude::add(substep, &terms, &tetrahedron, i, clamped, &mut ring);
        }
        half_solved[i] = if i < clamped { ghost.w } else { ring.eliminate(i, clamped, links) };
        ghost = next;
    }
}

/// A particle of each lane of a group.
#[derive(Clone, Copy)]
struct Place {
    /// Number of the particle in its strand.
    i: usize,
    /// First lane of the group.
    first: usize,
}

/// The spring from `i` to `i + REACH`, with the angular tie if it is an edge.
#[inline(always)]
fn add_spring<const REACH: usize, L: Lane>(
    frame: &FrameTerms,
    substep: &SubstepTerms<L>,
    view: &BlockView<'_, L::Scalar>,
    place: Place,
    terms: &RowTerms<L>,
    ghosts: [&Ghost<L>; 2],
    ring: &mut Ring<L>,
) {
    let Place { i, first } = place;
    let j = i + REACH;
    if j >= view.particles || j < frame.clamped {
        return;
    }
    let d = V3::load(view.positions, j, first) - V3::load(view.positions, i, first);
    let rest_length = L::load(&view.rest_lengths[3 * i + REACH - 1], first);
    let mut spring = springs::spring(substep, terms.springs[REACH - 1], frame.tension, d, rest_length);
    if REACH == 1 && frame.angular_edge {
        let edge = TiedEdge {
            d,
            inverse_rest: L::load(&view.inverse_edges[i], first),
            inverse_length: spring.inverse_length,
        };
        let couple = ghost::angular_edge(substep, terms.angular, edge, ghosts);
        spring.stiffness = spring.stiffness.add_identity(couple.stiffness);
        spring.impulse -= couple.impulse;
    }
    ring.add_spring(i, j, frame.clamped, &spring, ghosts[0].w);
}

/// Mass, air and ghost ties of row `i`.
#[inline(always)]
fn tie_to_ghost<L: Lane>(
    frame: &FrameTerms,
    substep: &SubstepTerms<L>,
    view: &mut BlockView<'_, L::Scalar>,
    place: Place,
    terms: &RowTerms<L>,
    ghost: &Ghost<L>,
    ring: &mut Ring<L>,
) {
    let Place { i, first } = place;
    let x = V3::load(view.positions, i, first);
    let v = V3::load(view.velocities, i, first);
    let (drag, air) = if view.air.is_empty() {
        (terms.drag, substep.air)
    } else {
        (L::load(&view.drag[i], first), V3::load(view.air, i, first))
    };
    let (diagonal, rhs) = ring.row(i);
    let mut row = ghost::Row { diagonal, rhs };
    ghost::inertia(substep, terms.mass, v, drag, air, &mut row);
    if frame.k_integrity > 0.0 {
        let mut intact = L::load(&view.integrity[i], first);
        if frame.non_hookean.is_some() {
            intact = ghost::damage(frame, intact, x - ghost.y, L::load(view.strand_length, first));
            intact.store(&mut view.integrity[i], first);
        }
        ghost::integrity(frame, substep, terms, ghost, x, intact, &mut row);
    }
    if frame.angular_paper && i > 0 {
        let points = [V3::load(view.positions, i - 1, first), x];
        let rest_length = L::load(&view.rest_lengths[3 * (i - 1)], first);
        ghost::angular_paper(frame, substep, terms.angular, ghost, points, rest_length, &mut row);
    }
}

#[inline(always)]
fn tetrahedron<L: Lane>(
    substep: &SubstepTerms<L>,
    view: &BlockView<'_, L::Scalar>,
    i: usize,
    first: usize,
) -> altitude::Tetrahedron<L> {
    let rest = [0, 1, 2, 3].map(|k| V3::load(view.rest, i + k, first));
    altitude::Tetrahedron {
        positions: [0, 1, 2, 3].map(|k| V3::load(view.positions, i + k, first)),
        ghost_velocities: rest.map(|y0| Ghost::new(substep, y0).w),
        rest,
    }
}
