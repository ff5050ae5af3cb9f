//! Strands that go where they are told: for simulators that compute positions by other means, such
//! as a learned one or the playback of a cache.
//!
//! # Practice
//! Before each frame the caller writes the positions at its end to the channel [`TARGET`]
//! ([`Simulation::parts_mut`](crate::simulation::Simulation::parts_mut)): metres, world axes,
//! relative to the frame's origin ([`FrameInput::origin`](crate::frame::FrameInput::origin)). The
//! only stage takes them over, and velocities are those of the motion in the frame:
//!
//! ```text
//! v = (target − x)/h,   x = target
//! ```
//!
//! Gravity, air and lengths have no part in it. With [`PrescribedParams::push_out`] collisions with
//! solids follow.
//!
//! # Limitations
//! A strand with a target that is not finite is put to rest and counted by the checks of the frame.
//! So is one that has none yet.

use crate::collide::resolve_solids::{EXACT, SolidContacts};
use crate::frame::{
    Channel, ChannelKind, Channels, FrameContext, FrameRules, LaneGroup, LaneSolver, Substep,
};
use crate::lane::{Lane, V3};
use crate::params::Inextensibility;
use crate::strands::{BlockView, Scratch};
use glam::DVec3;

/// The kernel's WGSL.
pub const WGSL: &str = include_str!("kernel.wgsl");

/// The stage's name in reports.
pub const STAGE: &str = "follow_targets";

/// The positions at the frame's end, metres, world axes, relative to the frame's origin.
pub const TARGET: Channel = Channel { name: "target", kind: ChannelKind::Vector(DVec3::NAN), values: 1 };

/// Parameters of strands that go where they are told.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PrescribedParams {
    /// Whether solids push hair out at the end of a frame. The next frame's targets know nothing of
    /// it. Default false.
    pub push_out: bool,
}

impl LaneSolver for PrescribedParams {
    /// One over the frame's length, 1/s.
    type Terms = f64;

    const SHIFTS: bool = true;

    fn name(&self) -> &'static str {
        "prescribed"
    }

    fn rules(&self) -> FrameRules {
        FrameRules {
            stage: STAGE,
            lengths: Inextensibility::Off,
            stretch_limit: Some(EXACT),
            // No pass of collisions follows a stage that resolves them itself.
            solver_collides: !self.push_out,
            ..FrameRules::default()
        }
    }

    fn channels(&self) -> Channels {
        Channels { extra: &[TARGET], ..Channels::default() }
    }

    fn terms(&self, dt_secs: f64) -> f64 {
        1.0 / dt_secs
    }

    #[inline(always)]
    fn solve<L: Lane>(
        inverse_h: &f64,
        cx: &FrameContext<'_, L::Scalar>,
        _: Substep,
        view: &mut BlockView<'_, L::Scalar>,
        group: LaneGroup,
        _: &mut Scratch<L::Scalar>,
    ) -> SolidContacts {
        // Where the air was sampled positions are at the frame's origin already.
        let shift = V3::<L>::splat(if cx.air.is_some() { DVec3::ZERO } else { cx.shift });
        let inverse_h = L::from_f64(*inverse_h);
        for i in 0..view.particles {
            let was = V3::<L>::load(view.positions, i, group.first) + shift;
            let x = V3::<L>::load(view.extra.rows(0, i), 0, group.first);
            x.store(view.positions, i, group.first);
            (x - was).scale(inverse_h).store(view.velocities, i, group.first);
        }
        SolidContacts::default()
    }
}

crate::solver_from_params!(PrescribedParams);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::{ColliderFrame, Shape};
    use crate::frame::FrameInput;
    use crate::groom::Groom;
    use crate::lane::Row;
    use crate::pose::Pose;
    use crate::simulation::{Options, Simulation};
    use glam::Vec3;

    fn simulation(push_out: bool) -> Simulation {
        let strand = |n: u16| (0..n).map(|i| Vec3::X * (0.01 * f32::from(i))).collect::<Vec<_>>();
        let groom = Groom::from_strands([strand(3), strand(7), strand(3)]).unwrap();
        Simulation::new(&groom, &PrescribedParams { push_out }, &Options::default()).unwrap()
    }

    /// Tells the strands of `simulation` to be a metre above their rest shape.
    fn raise(simulation: &mut Simulation) {
        let (model, state) = simulation.parts_mut();
        let up = |row: &Row<f32>| Row(row.0.map(|x| x + 1.0));
        let raised = model.rest.chunks_exact(3).flat_map(|rows| [rows[0], up(&rows[1]), rows[2]]);
        state.extra.rows_mut().iter_mut().zip(raised).for_each(|(row, x)| *row = x);
        state.extra.set_started([true]);
    }

    #[test]
    fn strands_go_to_their_targets_and_have_the_velocity_of_that_motion() {
        let mut simulation = simulation(false);
        raise(&mut simulation);
        // The head goes elsewhere, and with it the origin of targets.
        let away = Pose { translation: DVec3::new(2.0, 0.0, 0.0), ..Pose::IDENTITY };
        let frame = FrameInput {
            roots: [Pose::IDENTITY, away].into(),
            gravity: DVec3::new(0.0, -9.81, 0.0),
            dt_secs: 0.5,
            ..FrameInput::default()
        };
        let report = simulation.step_frame(&frame).unwrap();
        assert_eq!(report.quarantined_strands, 0);
        assert!(report.max_edge_stretch < 1e-5);
        let snapshot = simulation.snapshot();
        assert!(snapshot.velocities.iter().all(|v| *v == [4.0, 2.0, 0.0]), "{:?}", snapshot.velocities);
        let mut positions = Vec::new();
        simulation.positions(&mut positions);
        assert!((positions[12] - Vec3::new(2.02, 1.0, 0.0)).length() < 1e-6, "{}", positions[12]);
    }

    #[test]
    fn a_strand_without_a_target_is_put_to_rest_and_counted() {
        let mut simulation = simulation(false);
        let still = FrameInput::default();
        assert_eq!(simulation.step_frame(&still).unwrap().quarantined_strands, 3);
        raise(&mut simulation);
        simulation.parts_mut().1.extra.rows_mut()[0].0[1] = f32::INFINITY;
        assert_eq!(simulation.step_frame(&still).unwrap().quarantined_strands, 1);
        let mut positions = Vec::new();
        simulation.positions(&mut positions);
        assert_eq!(positions.iter().filter(|x| x.y > 0.5).count(), 10);
        assert!(positions.iter().all(|x| x.is_finite()));
    }

    #[test]
    fn solids_push_hair_out_where_they_are_asked_to() {
        let shape = Shape::Sphere { radius: 0.03 };
        let at = Pose { translation: DVec3::new(0.06, 1.0, 0.0), ..Pose::IDENTITY };
        let ball = ColliderFrame { shape: &shape, local: Pose::IDENTITY, from: at, to: at, friction: 0.0 };
        let closest = |push_out: bool| {
            let mut simulation = simulation(push_out);
            let frame = FrameInput { colliders: &[ball], ..FrameInput::default() };
            raise(&mut simulation);
            simulation.step_frame(&frame).unwrap();
            let mut positions = Vec::new();
            simulation.positions(&mut positions);
            positions.iter().map(|x| x.as_dvec3().distance(at.translation)).fold(1.0, f64::min)
        };
        assert!(closest(false) < 0.001);
        assert!(closest(true) > 0.0299, "{}", closest(true));
    }
}
