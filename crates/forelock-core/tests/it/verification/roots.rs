//! Roots on a body that bends: where nothing bends they are a rigid head's to the bit, and strands
//! follow their own motion under every solver.

use crate::rig::{DT, GRAVITY, LENGTH, Rig, Strand, assert_one_hash, largest, shake, tuft};
use forelock_core::frame::{FrameInput, Roots};
use forelock_core::groom::RootFrames;
use forelock_core::lane::{LANES, Simd};
use forelock_core::pose::Pose;
use forelock_core::simulation::{Simulation, SimulationReal};
use forelock_core::solver::{AmsParams, DftlParams, MassSpringParams, Solver, XpbdParams};
use glam::{DQuat, DVec3, Quat};

const STRANDS: usize = 2 * LANES + 3;

fn solvers<T: SimulationReal>() -> [(&'static str, Solver<T>); 5] {
    [
        ("ams", (&AmsParams::default()).into()),
        ("mass-spring", (&MassSpringParams::default()).into()),
        ("dftl", (&DftlParams::default()).into()),
        ("dftl, sag-free", (&DftlParams { sag_free: true, ..DftlParams::default() }).into()),
        ("xpbd", (&XpbdParams::default()).into()),
    ]
}

fn rig<T: SimulationReal>(solver: &Solver<T>, simd: Simd) -> Rig<T> {
    Rig::new(&tuft(STRANDS, 10), solver.clone(), simd)
}

/// A frame with the roots' own motion from `frames[0]` to `frames[1]`.
fn step<T: SimulationReal>(simulation: &mut Simulation<T>, head: [Pose; 2], frames: [&RootFrames; 2]) {
    let roots = Roots::PerStrand { head, frames };
    let frame = FrameInput { roots, gravity: GRAVITY, dt_secs: DT, ..FrameInput::default() };
    simulation.step_frame(&frame).unwrap();
}

/// The motion `pose` of all strands of `strands`, as one of each.
fn as_frames(strands: &[Strand], pose: &Pose) -> RootFrames {
    let shift = |strand: &Strand| {
        let root = DVec3::from(strand[0]);
        (pose.transform_point(root) - root).as_vec3()
    };
    RootFrames {
        rotations: vec![pose.rotation.as_quat(); strands.len()],
        shifts: strands.iter().map(shift).collect(),
    }
}

/// Shakes and turns.
fn ride(frame: u32) -> Pose {
    let t = f64::from(frame) * DT;
    Pose { rotation: DQuat::from_rotation_y((4.0 * t).sin() * 0.6), ..shake(2.0, 2.0, t) }
}

#[test]
fn roots_that_do_not_bend_are_a_rigid_head() {
    for (name, solver) in solvers::<f32>() {
        let [mut rigid, mut free] = [(); 2].map(|()| rig(&solver, Simd::Auto));
        let still = RootFrames::identity(STRANDS);
        for frame in 0..20 {
            let head = [ride(frame), ride(frame + 1)];
            rigid.step(head[1]);
            step(&mut free.simulation, head, [&still, &still]);
        }
        assert_eq!(rigid.simulation.state_hash(), free.simulation.state_hash(), "{name}");
    }
}

#[test]
fn a_motion_of_all_strands_is_a_motion_of_the_head() {
    for (name, solver) in solvers::<f64>() {
        let [mut rigid, mut free] = [(); 2].map(|()| rig(&solver, Simd::Auto));
        let strands = tuft(STRANDS, 10);
        let frames: Vec<RootFrames> = (0..=30).map(|frame| as_frames(&strands, &ride(frame))).collect();
        for frame in 0..30 {
            rigid.step(ride(frame + 1));
            let own = [&frames[frame as usize], &frames[frame as usize + 1]];
            step(&mut free.simulation, [Pose::IDENTITY; 2], own);
        }
        // The motions are stored in float32, and rotations between two frames, of up to 2.3°,
        // differ in speed by 1e-4. The zigzags of mass-spring are the stiffest.
        let difference = largest(&rigid.positions(), &free.positions());
        assert!(difference < 2e-4 * LENGTH, "{name}: {difference}");
        assert!(rigid.positions()[0].distance(DVec3::from(strands[0][0])) > 1e-3);
    }
}

/// Strands that stand on a line along x which is bent by `angle` from its first root to its last.
fn bent(strands: &[Strand], length: f64, angle: f64) -> RootFrames {
    let motion = |strand: &Strand| {
        let turn = angle * strand[0][0] / length;
        let radius = length / angle;
        let place = DVec3::new(radius * turn.sin(), radius * (turn.cos() - 1.0), strand[0][2]);
        (Quat::from_rotation_z(-turn as f32), (place - DVec3::from(strand[0])).as_vec3())
    };
    let (rotations, shifts) = strands.iter().map(motion).unzip();
    RootFrames { rotations, shifts }
}

#[test]
fn parallel_strands_stay_in_order_through_a_bend() {
    // 12 cm bent by 120° have a radius of 5.7 cm: strands of 3 cm do not meet where it is hollow.
    let (length, count) = (0.12, 40);
    let upright = |s: usize| -> Strand {
        let x = length * (s as f64 + 0.5) / f64::from(count);
        (0..8).map(|i| [x, 0.03 * f64::from(i) / 7.0, 0.0]).collect()
    };
    let strands: Vec<Strand> = (0..count as usize).map(upright).collect();
    // The others let strands that stand upright fall over.
    let stiff = |own: &(&str, Solver<f32>)| matches!(own.0, "ams" | "xpbd");
    for (name, solver) in solvers::<f32>().into_iter().filter(stiff) {
        for angle in [1.0, -1.0] {
            let angle: f64 = angle * 120f64.to_radians();
            let mut own = Rig::new(&strands, solver.clone(), Simd::Auto);
            // Bends within two seconds and stays.
            let at = |frame: u32| bent(&strands, length, angle * (1e-9 + f64::from(frame.min(120)) / 120.0));
            let mut frames = [RootFrames::identity(strands.len()), at(0)];
            for frame in 1..=150 {
                frames = [std::mem::take(&mut frames[1]), at(frame)];
                step(&mut own.simulation, [Pose::IDENTITY; 2], [&frames[0], &frames[1]]);
                let mut positions = Vec::new();
                own.simulation.positions(&mut positions);
                let positions: Vec<DVec3> = positions.iter().map(|x| x.as_dvec3()).collect();
                let of: Vec<&[DVec3]> = positions.chunks(8).collect();
                for (s, pair) in of.windows(2).enumerate() {
                    let turn = frames[1].rotations[s].as_dquat();
                    for (i, (a, b)) in pair[0].iter().zip(pair[1]).enumerate() {
                        let ahead = (turn * DVec3::X).dot(*b - *a);
                        assert!(ahead > 0.0, "{name}: strands {s} and the next cross at {i}, frame {frame}");
                    }
                }
                for (s, strand) in of.iter().enumerate() {
                    let root = DVec3::from(strands[s][0]);
                    let there = frames[1].transform_point(s, root, root);
                    assert!(strand[0].distance(there) < 1e-6, "{name}: {}", strand[0].distance(there));
                }
            }
        }
    }
}

#[test]
fn hair_rests_on_a_bent_body_and_a_lost_strand_returns_to_it() {
    let strands = tuft(STRANDS, 10);
    let frames = bent(&strands, 0.3, 1.0);
    let head = Pose::new(DQuat::from_rotation_x(0.3), DVec3::new(0.1, 0.2, 0.3));
    for (name, solver) in solvers::<f32>().into_iter().filter(|own| own.0 == "ams" || own.0 == "xpbd") {
        let mut own = Rig::new(&strands, solver, Simd::Auto);
        own.simulation.rest_on(&head, &frames);
        let at_rest = own.positions();
        let expected = strands.iter().enumerate().flat_map(|(s, strand)| {
            let root = DVec3::from(strand[0]);
            strand.iter().map(move |&x| (s, root, DVec3::from(x)))
        });
        let expected: Vec<DVec3> =
            expected.map(|(s, root, x)| head.transform_point(frames.transform_point(s, root, x))).collect();
        assert!(largest(&expected, &at_rest) < 1e-6, "{name}");
        own.edit(|snapshot| snapshot.positions[15] = [f32::NAN; 3]);
        let input = FrameInput {
            roots: Roots::PerStrand { head: [head; 2], frames: [&frames; 2] },
            dt_secs: DT,
            ..FrameInput::default()
        };
        let report = own.simulation.step_frame(&input).unwrap();
        assert_eq!(report.quarantined_strands, 1, "{name}");
        let own = own.positions();
        // The second strand, of particles 10 to 19.
        assert!(largest(&own[10..20], &expected[10..20]) < 1e-6, "{name}");
    }
}

#[test]
fn the_bits_do_not_depend_on_threads_widths_or_a_restart() {
    let strands = tuft(STRANDS, 10);
    let frames: Vec<RootFrames> =
        (0..=12).map(|frame| bent(&strands, 0.3, 1e-9 + 0.1 * f64::from(frame))).collect();
    for (name, solver) in solvers::<f32>() {
        let play = |own: &mut Rig<f32>, range: std::ops::Range<usize>| {
            for frame in range {
                let head = [ride(frame as u32), ride(frame as u32 + 1)];
                step(&mut own.simulation, head, [&frames[frame], &frames[frame + 1]]);
            }
            own.simulation.state_hash()
        };
        assert_one_hash(|simd| play(&mut rig(&solver, simd), 0..12));
        let whole = play(&mut rig(&solver, Simd::Auto), 0..12);
        let mut first = rig(&solver, Simd::Auto);
        play(&mut first, 0..5);
        let mut second = rig(&solver, Simd::Auto);
        second.simulation.restore(&first.simulation.snapshot()).unwrap();
        assert_eq!(play(&mut second, 5..12), whole, "{name}");
    }
}

#[test]
fn one_motion_a_strand_is_asked_for() {
    let mut own: Rig<f32> = rig(&(&AmsParams::default()).into(), Simd::Auto);
    let few = RootFrames::identity(3);
    let roots = Roots::PerStrand { head: [Pose::IDENTITY; 2], frames: [&few; 2] };
    let error = own.simulation.step_frame(&FrameInput { roots, ..FrameInput::default() }).unwrap_err();
    assert!(
        error.to_string().contains("`root frames` has 3 entries, but the groom has 35 strands"),
        "{error}"
    );
}

#[test]
fn a_rigid_head_needs_no_memory_for_roots() {
    let mut own: Rig<f32> = rig(&(&AmsParams::default()).into(), Simd::Auto);
    own.step(ride(1));
    let rigid = own.simulation.memory().workspace;
    let still = RootFrames::identity(STRANDS);
    step(&mut own.simulation, [ride(1), ride(2)], [&still, &still]);
    let bytes = own.simulation.memory().workspace - rigid;
    // 14 numbers a strand.
    assert_eq!(bytes, 14 * 4 * own.simulation.model().blocks.len() * LANES);
}
