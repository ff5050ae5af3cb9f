//! A frame step by step.

use crate::rig::{DT, GRAVITY, shake, tuft};
use forelock_core::body::{ColliderFrame, Shape};
use forelock_core::frame::{Acceleration, Air, FrameInput, Roots, Step};
use forelock_core::interaction::contact::ContactParams;
use forelock_core::interaction::grid::GridParams;
use forelock_core::interaction::sph::SphParams;
use forelock_core::params::Inextensibility;
use forelock_core::pose::Pose;
use forelock_core::simulation::{Options, Simulation};
use forelock_core::solver::{AmsParams, DftlParams, Solver};
use forelock_core::strands::Strands;
use glam::{DQuat, DVec3};

/// The interactions of a run.
#[derive(Clone, Copy, Debug, Default)]
struct Interactions {
    grid: bool,
    sph: bool,
    contacts: bool,
}

/// How a run takes its frames.
#[derive(Clone, Copy)]
enum Way {
    Whole,
    StepByStep,
    Without(fn(&Step) -> bool),
}

fn run(solver: &Solver<f32>, own: Interactions, way: Way) -> u64 {
    let strands = tuft(60, 20);
    let positions: Vec<[f32; 3]> = strands.iter().flatten().map(|p| p.map(|x| x as f32)).collect();
    let offsets: Vec<u32> = (0..=60).map(|s| 20 * s).collect();
    let strands = Strands::new(&positions, &offsets);
    let ball = Shape::Sphere { radius: 0.04 };
    let mut simulation = Simulation::from_strands(&strands, solver, &Options::default()).unwrap();
    simulation.set_grid(own.grid.then_some(&GridParams::default())).unwrap();
    simulation.set_sph(own.sph.then_some(&SphParams::default())).unwrap();
    simulation.set_contacts(own.contacts.then_some(&ContactParams::default())).unwrap();
    for number in 0..12 {
        let [from, to] = [number, number + 1].map(|k| shake(4.0, 4.0, f64::from(k) * DT));
        let local = Pose::new(DQuat::IDENTITY, DVec3::new(0.03, -0.12, 0.0));
        let solid = ColliderFrame { shape: &ball, local, from, to: from, friction: 0.3 };
        let frame = FrameInput {
            roots: Roots::Rigid([from, to]),
            colliders: &[solid],
            gravity: GRAVITY,
            air: Air::uniform(DVec3::X),
            acceleration: Acceleration::Field(&|x| x.cross(DVec3::Z) * 9.0),
            dt_secs: DT,
        };
        let steps = simulation.plan().steps().to_vec();
        match way {
            Way::Whole => {
                simulation.step_frame(&frame).unwrap();
            }
            Way::StepByStep => {
                for step in &steps {
                    simulation.step_part(&frame, std::slice::from_ref(step)).unwrap();
                }
            }
            Way::Without(left_out) => {
                let rest: Vec<_> = steps.into_iter().filter(|own| !left_out(&own.step)).collect();
                simulation.step_part(&frame, &rest).unwrap();
            }
        }
    }
    simulation.state_hash()
}

/// Step by step is as all at once, bit for bit, with any interactions.
#[test]
fn the_steps_of_a_frame_are_the_frame() {
    let none = Interactions::default();
    let grid = Interactions { grid: true, ..none };
    let sph = Interactions { sph: true, ..none };
    let contacts = Interactions { contacts: true, ..none };
    let all = Interactions { grid: true, sph: true, contacts: true };
    let ams = |inextensibility| Solver::from(&AmsParams { inextensibility, ..AmsParams::default() });
    let [projected, followed, loose] =
        [Inextensibility::Projection, Inextensibility::FollowTheLeader, Inextensibility::Off].map(ams);
    let dftl = Solver::from(&DftlParams::default());
    for (own, solver) in [
        (none, &projected),
        (grid, &projected),
        (contacts, &followed),
        (all, &projected),
        (none, &loose),
        (none, &dftl),
        (grid, &dftl),
        (sph, &dftl),
        (contacts, &dftl),
        (all, &dftl),
    ] {
        assert_eq!(run(solver, own, Way::StepByStep), run(solver, own, Way::Whole), "{own:?} {solver:?}");
    }
}

/// A frame without one of its steps is another frame: the plan contains no step in vain.
#[test]
fn each_step_of_a_frame_counts() {
    let all = Interactions { grid: true, sph: true, contacts: true };
    let ams = Solver::from(&AmsParams::default());
    let dftl = Solver::from(&DftlParams::default());
    let shared: [fn(&Step) -> bool; 6] = [
        |step| matches!(step, Step::RecordStart { .. }),
        |step| matches!(step, Step::Exchange { exchange, .. } if exchange.name == "sph"),
        |step| matches!(step, Step::Exchange { exchange, .. } if exchange.name == "grid"),
        |step| matches!(step, Step::Exchange { exchange, .. } if exchange.name == "contacts"),
        |step| matches!(step, Step::Solve { substep: 0 }),
        |step| matches!(step, Step::RestoreLengths { .. }),
    ];
    let of_ams: [fn(&Step) -> bool; 2] = [
        |step| matches!(step, Step::Collide { substep: 1 }),
        |step| matches!(step, Step::RestoreIfMoved { .. }),
    ];
    for (solver, left_out) in [(&ams, [&shared[..], &of_ams].concat()), (&dftl, shared.to_vec())] {
        let whole = run(solver, all, Way::Whole);
        for (number, left_out) in left_out.into_iter().enumerate() {
            assert_ne!(run(solver, all, Way::Without(left_out)), whole, "{solver:?}: step {number}");
        }
    }
}
