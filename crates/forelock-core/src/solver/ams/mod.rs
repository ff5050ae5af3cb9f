//! The augmented mass-spring model (AMS): one exact, implicit solve per strand and substep.

pub mod drag;
mod params;
pub mod solve_strands;

pub use crate::params::Inextensibility;
#[cfg(feature = "serde")]
pub(crate) use params::LengthPass;
pub use params::{AmsParams, AngularForm, IntegrityForm, Jacobian};

use crate::collide::resolve_solids::{SPRING_STRETCH, STRETCHED, SolidContacts};
use crate::frame::{FrameContext, FrameRules, LaneGroup, LaneSolver, StepCheck, StepRate, Substep};
use crate::lane::Lane;
use crate::params::ParamsError;
use crate::strands::{BlockView, Scratch};
use solve_strands::{FrameTerms, SubstepTerms};

impl LaneSolver for AmsParams {
    type Terms = FrameTerms;

    fn name(&self) -> &'static str {
        "ams"
    }

    fn rules(&self) -> FrameRules {
        FrameRules {
            stage: solve_strands::STAGE,
            substep_secs: self.substep_secs,
            exchange_secs: f64::INFINITY,
            clamped: self.clamped as usize,
            skin_thickness: self.skin_thickness,
            depenetration_speed: self.depenetration_speed,
            lengths: self.inextensibility,
            max_stretch: self.max_stretch,
            length_damping: self.length_damping,
            stretch_limit: match self.inextensibility {
                _ if !self.lay_along_solids => None,
                // Without springs either, nothing keeps lengths.
                Inextensibility::Off => (self.k_edge > 0.0).then_some(SPRING_STRETCH),
                Inextensibility::Limit => Some(SPRING_STRETCH.max(self.max_stretch)),
                _ => Some(STRETCHED),
            },
            solver_collides: false,
            restores_own_lengths: false,
            local_drag: self.has_local_drag(),
            ties_weaken: self.non_hookean && self.k_integrity > 0.0,
        }
    }

    fn rate(&self) -> StepRate {
        self.rate()
    }

    fn validate(&self) -> Result<(), ParamsError> {
        Self::validate(self)
    }

    fn validate_step(&self, step: &StepCheck) -> Result<(), ParamsError> {
        Self::validate_step(self, step)
    }

    fn terms(&self, dt_secs: f64) -> FrameTerms {
        FrameTerms::new(self, dt_secs)
    }

    #[inline(always)]
    fn solve<L: Lane>(
        terms: &FrameTerms,
        cx: &FrameContext<'_, L::Scalar>,
        substep: Substep,
        view: &mut BlockView<'_, L::Scalar>,
        group: LaneGroup,
        scratch: &mut Scratch<L::Scalar>,
    ) -> SolidContacts {
        let (first, end) = (group.first, substep.index + 1);
        let rests = [cx.rest_motion::<L>(view, first, substep.index), cx.rest_motion(view, first, end)];
        let weight = cx.turned(view, &rests[1], end, cx.rest_gravity);
        let own = SubstepTerms::new(terms.h, [&rests[0], &rests[1]], cx.gravity, weight, cx.air_velocity);
        // Drag that depends on the hair's motion changes in each substep.
        if cx.air.is_some() && (terms.slender || substep.air_is_new) {
            drag::towards_air::<L>(terms, view, group.first);
        }
        solve_strands::advance(terms, &own, view, group.first, scratch);
        SolidContacts::default()
    }
}

crate::solver_from_params!(AmsParams);
