//! One step of dynamic follow the leader with preserved shape (Sánchez-Banderas et al. 2015, Sec.
//! 3.1).
//!
//! # Theory
//! With X the rest positions in the head's frame, (R, p) the head's pose at the step's end, F_i the
//! frame of particle i ([`StrandFrame`]), r_i = F_{i−1}⁻¹ (X_i − X_{i−1}) at rest, and l_i = |r_i|:
//!
//! ```text
//! x*_i = x_i + h v_i + h² a_i                                                          (1)
//! for i = 1 … n−1
//!     Δg = s_g (R X_i + p − x*_i)                 x*_i += Δg   global shape             (11)
//!     Δl = s_l (x*_{i−1} + F_{i−1} r_i − x*_i)    x*_i += Δl   local shape              (12)
//!     e  = x*_{i−1} − x*_i                        Δx = (1 − l_i/|e|) e,  x*_i += Δx     (13)
//!     collisions; `recheck` times: lengths (13), collisions; if `recheck` > 0: lengths
//!     F_i = F_{i−1} turned to x*_i − x*_{i−1}
//! v_i = (x*_i − x_i)/h − (s_d/h) (Δg + Δl + Δx)_{i+1} ;   the tip: no correction         (14)
//! ```
//!
//! Equation (14) subtracts the follower's correction from the leader's velocity, because within a
//! step followers do not move their leaders (Müller, Kim, Chentanez 2012). So v is not zero at
//! rest: it holds the load of the followers. The velocity of the motion is u = (x − x_previous)/h;
//! drag and SPH use u.
//!
//! The collisions between the levels are the paper's (`level_collisions`). By default none come
//! there: [`resolve_solids`](crate::collide::resolve_solids) follows the step, sweeps particles and
//! edges and lays strands along solids, and the velocities get the motion of the new positions.
//!
//! At a contact, Coulomb friction reduces the tangential motion relative to the solid, as in
//! [`resolve_solids`](crate::collide::resolve_solids). Friction changes the position too, since the
//! velocity is derived from it. Between levels with `recheck` > 0 the lengths are restored last:
//! edges are exact, and single particles may end slightly inside a solid. With 0, as in the paper,
//! collisions are resolved last.
//!
//! # Practice
//! A strand is a lane. One pass from root to tip predicts and corrects each particle and writes the
//! velocity of the particle before it, so that the state is read and written once. Frames are not
//! stored: each step transports them from root to tip again.
//!
//! # Limitations
//! Followers do not pull their leaders within a step, which dissipates energy in the swings of long
//! strands (`damping`). Followers move alike whatever their masses, which count for drag only. All
//! steps need the same length, because the load in the velocities and the
//! previous positions refer to the length of the step before.

use crate::collide::resolve_solids::{LevelSolids, SolidContacts};
use crate::frame::RestMotion;
use crate::lane::{Lane, Mat3, V3};
use crate::params::STATED_STEP_SECS;
use crate::solver::DftlParams;
use crate::strands::{BlockView, LaneGroup, StrandFrame};
use glam::DVec3;

/// The stage's name in reports.
pub const STAGE: &str = "follow_leader";
/// WGSL of the fused schedule: one thread steps its strand from root to tip.
pub const WGSL: &str = include_str!("kernel.wgsl");
/// WGSL of one level, which all schedules share.
pub const LEVEL_WGSL: &str = include_str!("level.wgsl");
/// WGSL of the schedules that predict particles first.
pub const SCHEDULES_WGSL: &str = include_str!("schedules.wgsl");
/// WGSL that applies the drag of a wind field before the stage.
pub const WIND_WGSL: &str = include_str!("wind.wgsl");

/// Coefficients of a step, in float64.
#[derive(Clone, Copy, Debug)]
pub struct FollowTerms {
    /// Step, seconds.
    pub h: f64,
    /// Clamped particles from the root.
    pub clamped: usize,
    /// Shares by which a step restores the global and the local shape, at the root.
    pub shape: [f64; 2],
    /// Both shares at the tip over those at the root.
    pub tip_scales: [f64; 2],
    /// Share of a correction that the leader's velocity takes (s_d).
    pub damping: f64,
    /// Drag rate, s⁻¹.
    pub drag: f64,
    /// Collision queries after the first.
    pub recheck: u32,
    /// Whether the weight at rest is compensated.
    pub sag_free: bool,
}

impl FollowTerms {
    /// The terms of `params` for steps of `h` seconds.
    pub fn new(params: &DftlParams, h: f64) -> Self {
        let share =
            |s: f64| if h == STATED_STEP_SECS { s } else { 1.0 - (1.0 - s).powf(h / STATED_STEP_SECS) };
        Self {
            h,
            clamped: params.clamped as usize,
            shape: [params.shape_global, params.shape_local].map(share),
            tip_scales: [params.tip_scale_global, params.tip_scale_local],
            damping: params.damping,
            drag: params.drag,
            recheck: params.recheck,
            sag_free: params.sag_free,
        }
    }

    /// Shares for particle `i` of `n`, for strands of relative `stiffness`.
    #[inline(always)]
    fn shares<L: Lane>(&self, i: usize, n: usize, stiffness: L) -> [L; 2] {
        #[expect(clippy::cast_precision_loss, reason = "particle numbers are small")]
        let fraction = i as f64 / (n - 1) as f64;
        let [global, local] = self.shape;
        let [global_tip, local_tip] = self.tip_scales;
        let share = |s: f64, tip: f64| L::from_f64(s * (1.0 + (tip - 1.0) * fraction));
        [
            (share(global, global_tip) * stiffness).min(L::one()),
            (share(local, local_tip) * stiffness).min(L::one()),
        ]
    }
}

/// Inputs of a step that are the same for all lanes.
#[derive(Clone, Copy, Debug)]
pub struct FollowStep<L> {
    /// Maps rest positions to their positions at the step's end.
    ghost: (Mat3<L>, V3<L>),
    gravity: V3<L>,
    air: V3<L>,
    /// Added to stored positions and to stored previous positions.
    shift: [V3<L>; 2],
}

impl<L: Lane> FollowStep<L> {
    /// The inputs of a step at whose end the rest shape is at `end`. `shift` moves stored
    /// positions and stored previous positions to the step's origin.
    #[inline(always)]
    pub fn new(end: &RestMotion<L>, gravity: V3<L>, air: DVec3, shift: [DVec3; 2]) -> Self {
        Self {
            ghost: end.map,
            gravity,
            air: V3::splat(air),
            shift: [V3::splat(shift[0]), V3::splat(shift[1])],
        }
    }
}

/// Advances the lanes in `group` by a step. Uses the wind in `view.wind` if it is not empty.
#[inline(always)]
pub fn advance<L: Lane>(
    terms: &FollowTerms,
    step: &FollowStep<L>,
    mut solids: Option<LevelSolids<'_, L::Scalar>>,
    view: &mut BlockView<'_, L::Scalar>,
    group: LaneGroup,
) -> SolidContacts {
    let first = group.first;
    let n = view.particles;
    let (h, inverse_h) = (L::from_f64(terms.h), L::from_f64(1.0 / terms.h));
    let (h2, leader_share) = (L::from_f64(terms.h * terms.h), L::from_f64(-terms.damping / terms.h));
    let stiffness = L::load(view.stiffness, first);
    let rest = [V3::<L>::load(view.rest, 0, first), V3::load(view.rest, 1, first)];
    let (_, tangent) = follow(rest[0], rest[1], L::one());
    let mut frame = StrandFrame {
        tangent: step.ghost.0.mul(tangent),
        normal: step.ghost.0.mul(V3::load(view.local, 0, first)),
    };
    // The particle before: its position now and at the step's start.
    let mut leader = step.ghost.1.add_mul(&step.ghost.0, rest[0]);
    let mut leader_was = V3::load(view.positions, 0, first) + step.shift[0];
    leader.store(view.positions, 0, first);
    for i in 1..n {
        let was = V3::<L>::load(view.positions, i, first) + step.shift[0];
        let ghost = step.ghost.1.add_mul(&step.ghost.0, V3::load(view.rest, i, first));
        let length = L::load(&view.rest_lengths[3 * (i - 1)], first);
        let (mut x, mut correction) = (ghost, V3::zero());
        let (_, mut direction) = follow(leader, ghost, length);
        if i >= terms.clamped {
            let a = acceleration(terms, step, view, i, first, was);
            // (1)
            let predicted = was.add_scaled(h, V3::load(view.velocities, i, first)).add_scaled(h2, a);
            let [global, local] = terms.shares(i, n, stiffness);
            x = predicted.add_scaled(global, ghost - predicted); // (11)
            let bound = leader + frame.world(V3::load(view.local, i, first));
            x = x.add_scaled(local, bound - x); // (12)
            (x, direction) = follow(leader, x, length); // (13)
            correction = x - predicted;
            if let Some(solids) = &mut solids {
                x.store(view.positions, i, first);
                (x - was).scale(inverse_h).store(view.velocities, i, first);
                let hit = solids.resolve(i, was, view, group);
                if L::bits(hit) != 0 {
                    for _ in 0..terms.recheck {
                        let back = follow(leader, V3::load(view.positions, i, first), length).0;
                        solids.move_to(i, back, hit, view, first);
                        solids.resolve_again::<L>(i, hit, view, first);
                    }
                    x = V3::load(view.positions, i, first);
                    let (back, turned) = follow(leader, x, length);
                    direction = V3::select(hit, turned, direction);
                    if terms.recheck > 0 {
                        solids.move_to(i, back, hit, view, first);
                        x = V3::load(view.positions, i, first);
                    }
                }
            }
        }
        frame = frame.turned_to(direction);
        let v = (leader - leader_was).scale(inverse_h).add_scaled(leader_share, correction); // (14)
        v.store(view.velocities, i - 1, first);
        leader_was.store(view.previous, i - 1, first);
        x.store(view.positions, i, first);
        (leader, leader_was) = (x, was);
    }
    (leader - leader_was).scale(inverse_h).store(view.velocities, n - 1, first);
    leader_was.store(view.previous, n - 1, first);
    solids.map_or_else(SolidContacts::default, |solids| solids.contacts)
}

/// The acceleration of particle `i`, which is at `was`: gravity and drag.
#[inline(always)]
fn acceleration<L: Lane>(
    terms: &FollowTerms,
    step: &FollowStep<L>,
    view: &BlockView<'_, L::Scalar>,
    i: usize,
    first: usize,
    was: V3<L>,
) -> V3<L> {
    if terms.drag == 0.0 {
        return step.gravity;
    }
    let before = V3::<L>::load(view.previous, i, first) + step.shift[1];
    let air = if view.wind.is_empty() { step.air } else { V3::load(view.wind, i, first) };
    let slip = air.add_scaled(L::from_f64(-1.0 / terms.h), was - before);
    // Not above 1/h: the particle then moves with the air.
    let drag = (L::from_f64(terms.drag) * view.inverse_mass::<L>(i, first)).min(L::from_f64(1.0 / terms.h));
    step.gravity.add_scaled(drag, slip)
}

/// The point at distance `length` from `leader` in the direction of `x`, and that direction.
#[inline(always)]
fn follow<L: Lane>(leader: V3<L>, x: V3<L>, length: L) -> (V3<L>, V3<L>) {
    let edge = x - leader;
    let direction = edge.scale(L::one() / edge.dot(edge).max(L::from_f64(1e-24)).sqrt());
    (leader.add_scaled(length, direction), direction)
}
