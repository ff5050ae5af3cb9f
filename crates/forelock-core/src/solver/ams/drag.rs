//! Drag per particle: for wind fields, and for drag that depends on the hair's direction and speed.

use super::solve_strands::FrameTerms;
use crate::lane::{Lane, V3};
use crate::strands::BlockView;

/// Computes, from the wind at each particle, the air velocity towards which drag accelerates it in
/// this substep and the drag coefficient, and writes them to `view.air` and `view.drag`.
///
/// # Theory
/// On a strand of unit tangent t, air of velocity u exerts the force c (I − (1 − β) t tᵀ)(u − v)
/// per unit of mass, with c = c₀ + c₁ |u − v|. The drag of a slender body along its axis is about
/// half of that across it (β = ½; Cox 1970, "The motion of long slender bodies in a viscous
/// fluid"). This equals isotropic drag towards
///
/// ```text
/// u* = u − (1 − β) t t·(u − v)
/// ```
///
/// With v and c taken at the substep's start, the matrix keeps its isotropic diagonal m + h c, and
/// the speed along the strand becomes (v (1 + h c (1 − β)) + h c β u)/(1 + h c), a weighted mean of
/// v and u: stable for any h c, and exact in a steady state.
#[inline(always)]
pub fn towards_air<L: Lane>(frame: &FrameTerms, view: &mut BlockView<'_, L::Scalar>, first: usize) {
    let last = view.particles - 1;
    let (h, less) = (L::from_f64(frame.h), L::from_f64(frame.drag_along - 1.0));
    for i in 0..view.particles {
        let mut air = V3::<L>::load(view.wind, i, first);
        let mut drag = L::from_f64(frame.h * frame.drag);
        if frame.slender {
            let slip = air - V3::load(view.velocities, i, first);
            let (before, after) = (i.saturating_sub(1), (i + 1).min(last));
            let along = V3::load(view.positions, after, first) - V3::load(view.positions, before, first);
            let share = along.dot(slip) / along.dot(along).max(L::from_f64(1e-24));
            air = air.add_scaled(less * share, along);
            let speed = slip.dot(slip).sqrt();
            drag = h * speed.mul_add(L::from_f64(frame.drag_quadratic), L::from_f64(frame.drag));
        }
        air.store(view.air, i, first);
        drag.store(&mut view.drag[i], first);
    }
}
