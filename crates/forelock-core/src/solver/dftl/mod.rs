//! Dynamic follow the leader with preserved shape: one pass a strand and step.

pub mod follow_leader;
mod params;

pub use crate::params::STATED_STEP_SECS;
pub use params::{DftlParams, Schedule};

use crate::collide::resolve_solids::{EXACT, LevelSolids, SolidContacts};
use crate::frame::{Channels, FrameContext, FrameRules, LaneGroup, LaneSolver, StepRate, Substep};
use crate::lane::{Lane, V3};
use crate::params::{Inextensibility, ParamsError};
use crate::strands::{BlockView, Scratch};
use follow_leader::{FollowStep, FollowTerms};
use glam::DVec3;

impl LaneSolver for DftlParams {
    type Terms = FollowTerms;

    const SHIFTS: bool = true;

    fn name(&self) -> &'static str {
        "dftl"
    }

    fn rules(&self) -> FrameRules {
        FrameRules {
            stage: follow_leader::STAGE,
            substep_secs: f64::INFINITY,
            exchange_secs: f64::INFINITY,
            clamped: self.clamped as usize,
            skin_thickness: self.skin_thickness,
            depenetration_speed: self.depenetration_speed,
            lengths: Inextensibility::FollowTheLeader,
            max_stretch: 0.0,
            length_damping: self.damping,
            stretch_limit: (!self.level_collisions || self.recheck > 0).then_some(EXACT),
            solver_collides: self.level_collisions,
            restores_own_lengths: true,
            local_drag: false,
            ties_weaken: false,
        }
    }

    fn channels(&self) -> Channels {
        Channels { previous: true, rest_frames: true, ..Channels::default() }
    }

    fn rate(&self) -> StepRate {
        if self.step_secs > 0.0 { StepRate::Fixed(self.step_secs) } else { StepRate::PerFrame }
    }

    fn validate(&self) -> Result<(), ParamsError> {
        Self::validate(self)
    }

    fn terms(&self, dt_secs: f64) -> FollowTerms {
        FollowTerms::new(self, dt_secs)
    }

    #[inline(always)]
    fn solve<L: Lane>(
        terms: &FollowTerms,
        cx: &FrameContext<'_, L::Scalar>,
        _: Substep,
        view: &mut BlockView<'_, L::Scalar>,
        group: LaneGroup,
        _: &mut Scratch<L::Scalar>,
    ) -> SolidContacts {
        // Where the air was sampled positions are at the frame's origin already; those before are
        // not.
        let shift = [if cx.air.is_some() { DVec3::ZERO } else { cx.shift }, cx.shift];
        let rest = cx.rest_motion::<L>(view, group.first, 1);
        let gravity = if terms.sag_free && !view.root_frames.is_empty() {
            V3::<L>::splat(cx.gravity) - cx.turned(view, &rest, 1, cx.rest_gravity)
        } else if terms.sag_free {
            V3::splat(cx.gravity - cx.poses[1].transform_vector(cx.rest_gravity))
        } else {
            V3::splat(cx.gravity)
        };
        let step = FollowStep::new(&rest, gravity, cx.air_velocity, shift);
        let levels = cx.rules.solver_collides;
        let solids = if levels { LevelSolids::new(cx.colliders(0, cx.max_push_out())) } else { None };
        follow_leader::advance(terms, &step, solids, view, group)
    }
}

crate::solver_from_params!(DftlParams);
