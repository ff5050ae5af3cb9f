//! Drag that differs from particle to particle.

use super::solve_strands::FrameTerms;
use crate::lane::{Lane, V3};
use crate::strands::BlockView;

/// What drag draws each particle to in this substep, and how strongly: from the wind at it into `view.air` and `view.drag`.
///
/// # Theory
/// Along a strand of unit tangent t air of velocity u exerts c (I − (1 − β) t tᵀ)(u − v) a unit of mass, with c = c₀ + c₁ |u − v|: a slender body's drag along its axis is
/// about half of that across it (β = ½; Cox 1970, "The motion of long slender bodies in a viscous fluid"). This is isotropic drag towards
///
/// ```text
/// u* = u − (1 − β) t t·(u − v)
/// ```
///
/// With v in u* and c that of the substep's start, the matrix keeps its isotropic diagonal m + h c, and the speed along the strand goes
/// to (v (1 + h c (1 − β)) + h c β u)/(1 + h c), a mean of v and u: stable for any h c, and exact where v rests.
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
