//! Roots on a body that bends, on a GPU: a rigid motion a strand, against the same on the CPU.

use crate::common::{
    self, little,
    shaken::{self, GRAVITY, apart, error_of_strands, options},
};
use forelock_core::frame::{Air, FrameInput, Roots, Solver};
use forelock_core::groom::RootFrames;
use forelock_core::pose::Pose;
use forelock_core::simulation::{Options, Simulation, SimulationReal};
use forelock_core::solver::ams::IntegrityForm;
use forelock_core::solver::dftl::Schedule;
use forelock_core::solver::xpbd::{ROTATION, SPIN};
use forelock_core::solver::{AmsParams, DftlParams, MassSpringParams, XpbdParams};
use forelock_core::strands::{Snapshot, Strands, Teleport};
use forelock_gpu::{Gpu, GpuSimulation};
use glam::{DQuat, DVec3};

const DT: f64 = 1.0 / 60.0;
/// The largest allowed ratio of a strand's distance from float64 to the CPU's own float32 distance,
/// and the distance over the strand's length that is always allowed.
const FACTOR: f64 = 3.0;
const FLOOR: f64 = 2e-6;
/// Lengths of hair, metres; how far rotations move the next particle.
const LENGTH: f64 = 0.25;
const EDGE: f64 = 0.02;

/// The solvers, with what they use of the rest shape.
fn solvers<T: SimulationReal>() -> Vec<(&'static str, Solver<T>)> {
    let other = AmsParams { integrity: IntegrityForm::Paper, clamped: 3, ..AmsParams::default() };
    let rods = XpbdParams { substep_secs: DT / 20.0, ..XpbdParams::default() };
    vec![
        ("ams", (&AmsParams::default()).into()),
        ("ams, paper ties", (&other).into()),
        ("mass-spring", (&MassSpringParams::default()).into()),
        ("dftl", (&DftlParams::default()).into()),
        ("dftl, sag-free", (&DftlParams { sag_free: true, ..DftlParams::default() }).into()),
        ("dftl, by levels", (&DftlParams { schedule: Schedule::Particles, ..DftlParams::default() }).into()),
        ("xpbd", (&rods).into()),
        ("xpbd, clamped", (&XpbdParams { clamped: 4, iterations: 3, ..rods }).into()),
    ]
}

fn tuft() -> (Vec<[f32; 3]>, Vec<u32>) {
    shaken::tuft(70, |strand| 12 + strand % 5, [0.002, 0.01])
}

fn head(step: u32) -> Pose {
    shaken::head(f64::from(step) * DT)
}

/// The motion of the roots of a patch that bends, where the head is after `step`.
fn patch(strands: &Strands<'_, f32>, step: u32) -> RootFrames {
    let t = f64::from(step) * DT;
    let roots = strands.offsets[..strands.offsets.len() - 1].iter().map(|&first| {
        let root = DVec3::from(strands.positions[first as usize].map(f64::from));
        let turn = DQuat::from_rotation_z(0.8 * (6.0 * t + 30.0 * root.x).sin())
            * DQuat::from_rotation_y(1.5 * (4.0 * t + 10.0 * root.z).sin());
        let shift = 0.03 * DVec3::new((7.0 * t).sin(), (8.0 * t + 20.0 * root.x).sin(), 0.2);
        (turn.as_quat(), shift.as_vec3())
    });
    let (rotations, shifts) = roots.unzip();
    RootFrames { rotations, shifts }
}

/// The rotation `turn` of all strands about the origin, as a motion of each.
fn turned(strands: &Strands<'_, f32>, turn: DQuat) -> RootFrames {
    let count = strands.offsets.len() - 1;
    let shift = |&first: &u32| {
        let root = DVec3::from(strands.positions[first as usize].map(f64::from));
        (turn * root - root).as_vec3()
    };
    RootFrames {
        rotations: vec![turn.as_quat(); count],
        shifts: strands.offsets[..count].iter().map(shift).collect(),
    }
}

fn frame(roots: Roots<'_>) -> FrameInput<'_> {
    FrameInput {
        roots,
        gravity: GRAVITY,
        air: Air::uniform(DVec3::new(1.0, 0.0, -2.0)),
        dt_secs: DT,
        ..FrameInput::default()
    }
}

/// A frame on the patch: the motions at its ends, and the head.
fn on_patch<'a>(frames: &'a [RootFrames; 2], number: u32) -> FrameInput<'a> {
    let [from, to] = frames;
    frame(Roots::PerStrand { head: [head(number), head(number + 1)], frames: [from, to] })
}

fn ends(strands: &Strands<'_, f32>, number: u32) -> [RootFrames; 2] {
    [patch(strands, number), patch(strands, number + 1)]
}

/// Distance of `found` from `truth` over the length of a strand, of positions, of velocities in a
/// frame, of rotations and of angular velocities in a frame: see [`error_of_strands`].
fn error(offsets: &[u32], found: &Snapshot<f32>, truth: &Snapshot<f64>, steps: u32) -> f64 {
    let shift: [f64; 3] = std::array::from_fn(|c| truth.origin[c] - found.origin[c]);
    let of_channel = |channel: &str, rows: usize, p: usize| {
        let Some(found) = found.extra.get(channel) else { return 0.0 };
        let square = |(a, b): (&f32, &f64)| (f64::from(*a) - b).powi(2);
        let pairs = found[rows * p..][..rows].iter().zip(&truth.extra[channel][rows * p..]);
        pairs.map(square).sum::<f64>().sqrt()
    };
    // Velocities of follow the leader hold the load of all the strand.
    let secs = if found.previous.is_empty() { DT } else { 0.1 * DT };
    let of_particle = |p: usize| {
        let x = apart(found.positions[p], std::array::from_fn(|c| truth.positions[p][c] + shift[c]));
        let v = secs * apart(found.velocities[p], truth.velocities[p]);
        let turned = of_channel(ROTATION.name, 4, p).max(DT * of_channel(SPIN.name, 3, p));
        x.max(v).max(EDGE * turned) / LENGTH
    };
    error_of_strands(offsets, of_particle, steps)
}

fn is_close([gpu, cpu]: [f64; 2]) -> bool {
    gpu <= FACTOR * cpu + FLOOR
}

/// Each solver follows the motion of each strand as nearly as on the CPU, and one for which it is
/// not there is seen.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn strands_follow_their_own_motion() {
    let gpu = common::gpu();
    let (positions, offsets) = tuft();
    let exact: Vec<[f64; 3]> = positions.iter().map(|x| x.map(f64::from)).collect();
    let masses: Vec<f32> = (0..positions.len()).map(|p| 1.0 + 0.2 * (p % 7) as f32).collect();
    for (name, solver) in solvers::<f32>() {
        let (_, precise) = solvers::<f64>().into_iter().find(|own| own.0 == name).unwrap();
        let masses = (name == "ams").then_some(&*masses);
        let strands = Strands { masses, ..Strands::new(&positions, &offsets) };
        let exact = Strands { masses, ..Strands::new(&exact, &offsets) };
        for steps in [1, 6] {
            let new = || GpuSimulation::from_strands(&gpu, &strands, &solver, &options()).unwrap();
            let [mut own, mut without] = [new(), new()];
            let mut cpu = Simulation::from_strands(&strands, &solver, &options()).unwrap();
            let mut truth = Simulation::<f64>::from_strands(&exact, &precise, &options()).unwrap();
            let start = patch(&strands, 0);
            own.rest_on(&head(0), &start).unwrap();
            without.rest_on(&head(0), &start).unwrap();
            cpu.rest_on(&head(0), &start);
            truth.rest_on(&head(0), &start);
            for number in 0..steps {
                let ends = ends(&strands, number);
                let frame = on_patch(&ends, number);
                own.step_frame(&frame).unwrap();
                without.step_frame(&FrameInput { roots: (*frame.roots.head()).into(), ..frame }).unwrap();
                cpu.step_frame(&frame).unwrap();
                truth.step_frame(&frame).unwrap();
                assert_eq!(own.report().unwrap().quarantined_strands, 0);
            }
            let truth = truth.snapshot();
            let offsets = &cpu.model().offsets;
            let error = |found: &Snapshot<f32>| error(offsets, found, &truth, steps);
            let of_cpu = error(&cpu.snapshot());
            let [found, off] = [&mut own, &mut without].map(|own| error(&own.snapshot().unwrap()));
            println!("{name}, {steps} steps: {found:.1e}, CPU {of_cpu:.1e}, on a rigid head {off:.1e}");
            assert!(is_close([found, of_cpu]), "{name}, {steps} steps: {found:e}, {of_cpu:e}");
            assert!(!is_close([off, of_cpu]) && off > 1e-2, "{name} ignores motions: {off:e}");
        }
    }
}

/// Motions that change nothing give the bits of a rigid head, and a rotation of all strands gives
/// what it gives as one of the head.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn one_rigid_motion_is_that_of_a_head() {
    let gpu = common::gpu();
    let (positions, offsets) = tuft();
    let strands = Strands::new(&positions, &offsets);
    let still = RootFrames::identity(offsets.len() - 1);
    let turn = DQuat::from_rotation_z(0.7) * DQuat::from_rotation_x(1.9);
    let moved = turned(&strands, turn);
    for (name, solver) in solvers::<f32>() {
        let new = |options: &Options| GpuSimulation::from_strands(&gpu, &strands, &solver, options).unwrap();
        let [mut rigid, mut free, mut of_strands] = [(); 3].map(|()| new(&options()));
        let before = Pose::new(turn, DVec3::ZERO);
        // The weight at rest is in the axes of the strands.
        let mut of_head = new(&options());
        of_head.teleport(&head(0), &head(0).after(&before), Teleport::Reset).unwrap();
        of_strands.rest_on(&head(0), &moved).unwrap();
        for number in 0..5 {
            let ends = [head(number), head(number + 1)];
            rigid.step_frame(&frame(ends.into())).unwrap();
            free.step_frame(&frame(Roots::PerStrand { head: ends, frames: [&still; 2] })).unwrap();
            of_strands.step_frame(&frame(Roots::PerStrand { head: ends, frames: [&moved; 2] })).unwrap();
            of_head.step_frame(&frame(ends.map(|pose| pose.after(&before)).into())).unwrap();
        }
        assert_eq!(rigid.state_hash().unwrap(), free.state_hash().unwrap(), "{name}");
        let [a, b] = [of_strands, of_head].map(|mut own| own.snapshot().unwrap());
        let shift: [f64; 3] = std::array::from_fn(|c| b.origin[c] - a.origin[c]);
        let far = a.positions.iter().zip(&b.positions);
        let far = far.map(|(a, b)| apart(*a, std::array::from_fn(|c| f64::from(b[c]) + shift[c])));
        let far = far.fold(0.0, f64::max);
        println!("{name}: {far:.1e} m");
        assert!(far < 2e-5, "{name}: {far:e} m");
    }
}

/// Two runs, in one batch or many, from a snapshot: the same bits.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn the_bits_are_the_same_each_time() {
    let gpu = common::gpu();
    let little = little::binding_little(&gpu, 1 << 17);
    let (positions, offsets) = shaken::tuft(150, |strand| 12 + strand % 2, [0.002, 0.01]);
    let strands = Strands::new(&positions, &offsets);
    for (name, solver) in solvers::<f32>() {
        let run = |gpu: &Gpu, broken: Option<u32>| {
            let new = || GpuSimulation::from_strands(gpu, &strands, &solver, &options()).unwrap();
            let mut own = new();
            own.rest_on(&head(0), &patch(&strands, 0)).unwrap();
            for number in 0..4 {
                if broken == Some(number) {
                    let snapshot = own.snapshot().unwrap();
                    own = new();
                    own.restore(&snapshot).unwrap();
                }
                let ends = ends(&strands, number);
                own.step_frame(&on_patch(&ends, number)).unwrap();
            }
            own.state_hash().unwrap()
        };
        let whole = run(&gpu, None);
        assert_eq!([run(&gpu, Some(2)), run(&little, Some(1))], [whole; 2], "{name}");
    }
}

/// A strand that is not finite is put to rest where its root is, as on the CPU.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn a_reset_strand_is_at_rest_on_its_root() {
    let gpu = common::gpu();
    let (positions, offsets) = tuft();
    let strands = Strands::new(&positions, &offsets);
    for (name, solver) in solvers::<f32>() {
        let mut cpu = Simulation::from_strands(&strands, &solver, &options()).unwrap();
        cpu.rest_on(&head(0), &patch(&strands, 0));
        let ends = [0, 1].map(|number| ends(&strands, number));
        cpu.step_frame(&on_patch(&ends[0], 0)).unwrap();
        let mut own = GpuSimulation::continuing(&gpu, &cpu).unwrap();
        let mut sick = cpu.snapshot();
        let range = cpu.model().offsets[20] as usize..cpu.model().offsets[21] as usize;
        sick.velocities[range.start + 5][1] = f32::NAN;
        own.restore(&sick).unwrap();
        cpu.restore(&sick).unwrap();
        own.step_frame(&on_patch(&ends[1], 1)).unwrap();
        cpu.step_frame(&on_patch(&ends[1], 1)).unwrap();
        assert_eq!(own.report().unwrap().quarantined_strands, 1, "{name}");
        let (found, on_cpu) = (own.snapshot().unwrap(), cpu.snapshot());
        for p in range {
            let x = apart(found.positions[p], on_cpu.positions[p].map(f64::from));
            let v = apart(found.velocities[p], on_cpu.velocities[p].map(f64::from));
            assert!(x < 1e-6 && v < 1e-3, "{name}, particle {p}: {x:e} m, {v:e} m/s");
            for (channel, rows) in [(ROTATION.name, 4), (SPIN.name, 3)] {
                let Some(values) = found.extra.get(channel) else { continue };
                let pairs = values[rows * p..][..rows].iter().zip(&on_cpu.extra[channel][rows * p..]);
                assert!(pairs.clone().all(|(a, b)| (a - b).abs() < 1e-6), "{name}, {channel} of {p}");
            }
        }
        own.step_frame(&on_patch(&ends[1], 1)).unwrap();
        assert_eq!(own.report().unwrap().quarantined_strands, 0, "{name}");
    }
}

/// Motions that are not one a strand are refused, and nothing changes.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn there_is_one_motion_a_strand() {
    let gpu = common::gpu();
    let (positions, offsets) = tuft();
    let strands = Strands::new(&positions, &offsets);
    let mut own = GpuSimulation::from_strands(&gpu, &strands, &AmsParams::default(), &options()).unwrap();
    let before = own.state_hash().unwrap();
    let few = [(); 2].map(|()| RootFrames::identity(offsets.len() - 2));
    own.step_frame(&on_patch(&few, 0)).unwrap_err();
    own.rest_on(&head(0), &few[0]).unwrap_err();
    assert_eq!(own.state_hash().unwrap(), before);
}
