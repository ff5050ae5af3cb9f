//! A frame step by step.

use crate::rig::{DT, GRAVITY, shake, tuft};
use forelock_core::body::{ColliderFrame, Shape};
use forelock_core::interaction::contact::ContactParams;
use forelock_core::interaction::grid::GridParams;
use forelock_core::strands::Strands;
use forelock_core::pose::Pose;
use forelock_core::solver::ams::Inextensibility;
use forelock_core::solver::{AmsParams, DftlParams, SolverParams};
use forelock_core::frame::{Frame, FrameStep, Meeting};
use forelock_core::simulation::{Options, Simulation};
use forelock_core::interaction::sph::SphParams;
use glam::{DQuat, DVec3};

/// Step by step is as all at once, bit for bit, wherever strands meet; and each step is felt.
#[test]
fn the_steps_of_a_frame_are_the_frame() {
    let strands = tuft(60, 20);
    let positions: Vec<[f32; 3]> = strands.iter().flatten().map(|p| p.map(|x| x as f32)).collect();
    let offsets: Vec<u32> = (0..=60).map(|s| 20 * s).collect();
    let strands = Strands { positions: &positions, offsets: &offsets, stiffness: None };
    let ball = Shape::Sphere { radius: 0.04 };
    let run = |(meeting, params): (Meeting, &SolverParams), left_out: Option<FrameStep>, whole| {
        let mut simulation = Simulation::from_strands(&strands, params, &Options::default()).unwrap();
        simulation.set_grid(meeting.grid.then_some(&GridParams::default())).unwrap();
        simulation.set_particles(meeting.particles.then_some(&SphParams::default())).unwrap();
        simulation.set_contacts(meeting.contacts.then_some(&ContactParams::default())).unwrap();
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
            let steps: Vec<_> = FrameStep::all(simulation.params(), simulation.meeting()).collect();
            for step in steps.into_iter().filter(|step| Some(*step) != left_out) {
                simulation.step_part(&frame, None, step).unwrap();
            }
        }
        simulation.state_hash()
    };
    let apart = Meeting::default();
    let grid = Meeting { grid: true, ..apart };
    let particles = Meeting { particles: true, ..apart };
    let contacts = Meeting { contacts: true, ..apart };
    let all = Meeting { grid: true, particles: true, contacts: true };
    let ams = |inextensibility| SolverParams::from(&AmsParams { inextensibility, ..AmsParams::default() });
    let [projected, followed, loose] =
        [Inextensibility::Projection, Inextensibility::Dftl, Inextensibility::Off].map(ams);
    let dftl = SolverParams::from(&DftlParams::default());
    for (meeting, params) in [
        (apart, &projected),
        (grid, &projected),
        (contacts, &followed),
        (all, &projected),
        (apart, &loose),
        (apart, &dftl),
        (grid, &dftl),
        (particles, &dftl),
        (contacts, &dftl),
        (all, &dftl),
    ] {
        let how = (meeting, params);
        assert_eq!(run(how, None, false), run(how, None, true), "{how:?}");
    }
    let felt = |params: &SolverParams, steps: &[FrameStep]| {
        let whole = run((all, params), None, true);
        for step in steps {
            assert_ne!(run((all, params), Some(*step), false), whole, "{step:?}");
        }
    };
    use FrameStep::{
        Contacts, FollowLeader, Grid, LastSolids, NoteStart, Particles, ResolveSolids, RestoreLengths,
        SolveStrands,
    };
    let substeps = [SolveStrands(0), ResolveSolids(1), RestoreLengths];
    felt(&projected, &[&[NoteStart, Particles, Grid, Contacts, LastSolids][..], &substeps].concat());
    felt(&dftl, &[NoteStart, Particles, FollowLeader, Grid, Contacts, LastSolids]);
}
