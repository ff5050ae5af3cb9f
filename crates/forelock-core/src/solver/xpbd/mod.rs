//! Cosserat rods under extended position-based dynamics (XPBD): the reference method of Neuralocks
//! (2025).

mod params;
pub mod solve_rods;

pub use params::XpbdParams;

use crate::collide::resolve_solids::{SPRING_STRETCH, STRETCHED, SolidContacts};
use crate::frame::{
    Channel, ChannelKind, Channels, FrameContext, FrameRules, LaneGroup, LaneSolver, StepRate, Substep,
};
use crate::lane::Lane;
use crate::params::{Inextensibility, ParamsError};
use crate::strands::{BlockView, Scratch};
use glam::{DQuat, DVec3};
use solve_rods::{RodStep, RodTerms};

/// A step of whole substeps, seconds: the motion does not depend on the frame rate.
const STEP_SECS: f64 = 1.0 / 60.0;

/// Time between two searches for contacts, seconds: rods that have been pushed react within it.
const CONTACT_SECS: f64 = 1.0 / 480.0;

/// The rotation of each edge from its rest direction on the head at rest, in the place of its lower
/// particle.
pub const ROTATION: Channel =
    Channel { name: "rotation", kind: ChannelKind::Rotation(DQuat::IDENTITY), values: 1 };
/// The angular velocity of each edge, rad/s.
pub const SPIN: Channel = Channel { name: "spin", kind: ChannelKind::Vector(DVec3::ZERO), values: 1 };

impl LaneSolver for XpbdParams {
    type Terms = RodTerms;

    fn name(&self) -> &'static str {
        "xpbd"
    }

    fn rules(&self) -> FrameRules {
        FrameRules {
            stage: solve_rods::STAGE,
            substep_secs: self.substep_secs,
            exchange_secs: CONTACT_SECS,
            clamped: self.clamped as usize,
            skin_thickness: self.skin_thickness,
            depenetration_speed: self.depenetration_speed,
            lengths: self.inextensibility,
            max_stretch: self.max_stretch,
            stretch_limit: Some(match self.inextensibility {
                Inextensibility::Off => SPRING_STRETCH,
                Inextensibility::Limit => SPRING_STRETCH.max(self.max_stretch),
                _ => STRETCHED,
            }),
            ..FrameRules::default()
        }
    }

    fn channels(&self) -> Channels {
        Channels { extra: &[ROTATION, SPIN], ..Channels::default() }
    }

    fn rate(&self) -> StepRate {
        StepRate::Fixed(self.substep_secs.max(STEP_SECS))
    }

    fn validate(&self) -> Result<(), ParamsError> {
        Self::validate(self)
    }

    fn terms(&self, dt_secs: f64) -> RodTerms {
        RodTerms::new(self, LaneSolver::rules(self).h(dt_secs))
    }

    #[inline(always)]
    fn solve<L: Lane>(
        terms: &RodTerms,
        cx: &FrameContext<'_, L::Scalar>,
        substep: Substep,
        view: &mut BlockView<'_, L::Scalar>,
        group: LaneGroup,
        scratch: &mut Scratch<L::Scalar>,
    ) -> SolidContacts {
        let (first, end) = (group.first, substep.index + 1);
        let rest = cx.rest_motion::<L>(view, first, end);
        let spin = cx.spin(view, first, end);
        let step = RodStep::new(terms, &rest, spin, cx.gravity, cx.air_velocity);
        solve_rods::advance(terms, &step, view, group.first, scratch.vectors());
        SolidContacts::default()
    }
}

crate::solver_from_params!(XpbdParams);
