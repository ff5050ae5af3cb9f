//! A frame step by step.

use crate::rig::{DT, GRAVITY, shake, tuft};
use forelock_core::body::{ColliderFrame, Shape};
use forelock_core::contact::ContactParams;
use forelock_core::grid::GridParams;
use forelock_core::model::Strands;
use forelock_core::pose::Pose;
use forelock_core::solver::params::Inextensibility;
use forelock_core::solver::{AmsParams, Frame, FrameStep, Options, Simulation};
use glam::{DQuat, DVec3};

/// Step by step is as all at once, bit for bit, wherever strands meet; and each step is felt.
#[test]
fn the_steps_of_a_frame_are_the_frame() {
    let strands = tuft(60, 20);
    let positions: Vec<[f32; 3]> = strands.iter().flatten().map(|p| p.map(|x| x as f32)).collect();
    let offsets: Vec<u32> = (0..=60).map(|s| 20 * s).collect();
    let strands = Strands { positions: &positions, offsets: &offsets, stiffness: None };
    let ball = Shape::Sphere { radius: 0.04 };
    let run =
        |(grid, contacts, lengths): (bool, bool, Inextensibility), left_out: Option<FrameStep>, whole| {
            let params = AmsParams { inextensibility: lengths, ..AmsParams::default() };
            let mut simulation = Simulation::from_strands(&strands, &params, &Options::default()).unwrap();
            simulation.set_grid(grid.then_some(&GridParams::default())).unwrap();
            simulation.set_contacts(contacts.then_some(&ContactParams::default())).unwrap();
            for number in 0..12 {
                let [from, to] = [number, number + 1].map(|k| shake(4.0, 4.0, f64::from(k) * DT));
                let local = Pose::new(DQuat::IDENTITY, DVec3::new(0.03, -0.12, 0.0));
                let solid = ColliderFrame { shape: &ball, local, from, to: from, friction: 0.3 };
                let frame = Frame {
                    head: [from, to],
                    colliders: &[solid],
                    gravity: GRAVITY,
                    air_velocity: DVec3::X,
                    dt_secs: DT,
                };
                if whole {
                    simulation.step_frame(&frame).unwrap();
                    continue;
                }
                let steps: Vec<_> = FrameStep::all(&params, simulation.meeting()).collect();
                for step in steps.into_iter().filter(|step| Some(*step) != left_out) {
                    simulation.step_part(&frame, None, step).unwrap();
                }
            }
            simulation.state_hash()
        };
    for how in [
        (false, false, Inextensibility::Projection),
        (true, false, Inextensibility::Projection),
        (false, true, Inextensibility::Dftl),
        (true, true, Inextensibility::Projection),
        (false, false, Inextensibility::Off),
    ] {
        assert_eq!(run(how, None, false), run(how, None, true), "{how:?}");
    }
    let all = (true, true, Inextensibility::Projection);
    let whole = run(all, None, true);
    for step in [
        FrameStep::NoteStart,
        FrameStep::SolveStrands(0),
        FrameStep::ResolveSolids(1),
        FrameStep::RestoreLengths,
        FrameStep::Grid,
        FrameStep::Contacts,
        FrameStep::LastSolids,
    ] {
        assert_ne!(run(all, Some(step), false), whole, "{step:?}");
    }
}
