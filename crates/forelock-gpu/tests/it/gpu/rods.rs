//! Cosserat rods on a GPU against reference results and against the same on the CPU.

#![expect(clippy::unwrap_used, reason = "a test fails where it cannot be set up")]

use super::goldens::on;
use crate::common::{
    self, little,
    shaken::{self, GRAVITY, ROUNDED_STARTS, apart, error_of_strands, options, rounded},
};
use crate::golden_rods::Trajectory;
use forelock_core::body::{ColliderFrame, Shape};
use forelock_core::frame::{Air, FrameInput, Roots};
use forelock_core::groom::Groom;
use forelock_core::groom::edit::{Curl, Edit, Operation, Trim};
use forelock_core::params::Inextensibility;
use forelock_core::pose::Pose;
use forelock_core::simulation::Simulation;
use forelock_core::solver::xpbd::{ROTATION, SPIN};
use forelock_core::solver::{AmsParams, XpbdParams};
use forelock_core::strands::{Snapshot, Strands};
use forelock_gpu::{Gpu, GpuSimulation};
use glam::{DQuat, DVec3, Vec3};

const DT: f64 = 1.0 / 60.0;
/// The largest allowed ratio of a strand's distance from float64 to the CPU's own float32 distance,
/// and the distance over the strand's length that is always allowed.
const FACTOR: f64 = 3.0;
const FLOOR: f64 = 2e-6;
/// Lengths of hair, metres; how far rotations move the next particle.
const LENGTH: f64 = 0.25;
const EDGE: f64 = 0.02;

/// Trajectories of float64 at the tolerance of float32: 2e-3 cm, and that of quaternions.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn trajectories_are_the_references() {
    let gpu = common::gpu();
    for name in ["xpbd_3_cantilever", "xpbd_4_curly_turn"] {
        let mut trajectory = Trajectory::load(name);
        let [x, q] = trajectory.worst_errors(on(&gpu));
        println!("{name} on {}: {x:.1e} m, {q:.1e}", gpu.name());
        assert!(x <= 2e-5 && q <= 5e-3, "{name}: {x:e} {q:e}");
        trajectory.params.rotation_weight *= 1.1;
        let [x, q] = trajectory.worst_errors(on(&gpu));
        assert!(x > 2e-5 && q > 1e-4, "another weight of rotations is not seen: {x:e} {q:e}");
    }
}

fn tuft(count: u32, particles: impl Fn(u32) -> u32) -> (Vec<[f32; 3]>, Vec<u32>) {
    shaken::tuft(count, particles, [0.002, 0.01])
}

fn head(step: u32) -> Pose {
    shaken::head(f64::from(step) * DT)
}

fn frame(number: u32) -> FrameInput<'static> {
    FrameInput {
        roots: Roots::Rigid([head(number), head(number + 1)]),
        gravity: GRAVITY,
        air: Air::uniform(DVec3::new(1.0, 0.0, -2.0)),
        dt_secs: DT,
        ..FrameInput::default()
    }
}

/// A ball on the head, among the hair.
fn ball(shape: &Shape, number: u32) -> ColliderFrame<'_> {
    ColliderFrame {
        shape,
        local: Pose::new(DQuat::from_rotation_x(0.3), DVec3::new(0.03, -0.12, 0.02)),
        from: head(number),
        to: head(number + 1),
        friction: 0.4,
    }
}

/// Distance of `found` from `truth` over the length of a strand, of the median strand or after one
/// step of the worst: of positions, of velocities and angular velocities in a frame, of rotations.
fn error(offsets: &[u32], found: &Snapshot<f32>, truth: &Snapshot<f64>, steps: u32) -> f64 {
    let shift: [f64; 3] = std::array::from_fn(|c| truth.origin[c] - found.origin[c]);
    let of_rows = |channel: &str, rows: usize, p: usize| {
        let own = &found.extra[channel][rows * p..][..rows];
        let square = |(a, b): (&f32, &f64)| (f64::from(*a) - b).powi(2);
        own.iter().zip(&truth.extra[channel][rows * p..]).map(square).sum::<f64>().sqrt()
    };
    let of_particle = |p: usize| {
        let x = apart(found.positions[p], std::array::from_fn(|c| truth.positions[p][c] + shift[c]));
        let v = apart(found.velocities[p], truth.velocities[p]) * DT;
        let turned = of_rows(ROTATION.name, 4, p).max(DT * of_rows(SPIN.name, 3, p));
        x.max(v).max(EDGE * turned) / LENGTH
    };
    error_of_strands(offsets, of_particle, steps)
}

/// Errors of the GPU under `params[0]` and of the float32 CPU under `params[1]` after `steps`.
fn errors(
    gpu: &Gpu,
    strands: &Strands<'_, f32>,
    params: [&XpbdParams; 2],
    shape: Option<&Shape>,
    steps: u32,
) -> [f64; 2] {
    let exact: Vec<[f64; 3]> = strands.positions.iter().map(|x| x.map(f64::from)).collect();
    let exact = Strands { stiffness: strands.stiffness, ..Strands::new(&exact, strands.offsets) };
    let mut own = GpuSimulation::from_strands(gpu, strands, params[0], &options()).unwrap();
    let mut cpu = Simulation::from_strands(strands, params[1], &options()).unwrap();
    let mut truth = Simulation::<f64>::from_strands(&exact, params[1], &options()).unwrap();
    for number in 0..steps {
        let solid = shape.map(|shape| ball(shape, number));
        let frame = FrameInput { colliders: solid.as_slice(), ..frame(number) };
        own.step_frame(&frame).unwrap();
        truth.step_frame(&frame).unwrap();
        let expected = cpu.step_frame(&frame).unwrap();
        let report = own.report().unwrap();
        assert_eq!(report.quarantined_strands, 0, "{report:?}");
        let (touching, of) = (f64::from(report.touching), f64::from(expected.touching));
        assert!((touching - of).abs() <= 10.0 + 0.25 * of, "{report:?}, {expected:?}");
    }
    let truth = truth.snapshot();
    let mut of_cpu = error(strands.offsets, &cpu.snapshot(), &truth, steps);
    if let Some(shape) = shape.filter(|_| steps == 1) {
        for seed in 0..ROUNDED_STARTS {
            let starts = rounded(strands.positions, seed);
            let starts = Strands::new(&starts, strands.offsets);
            let mut cpu = Simulation::from_strands(&starts, params[1], &options()).unwrap();
            cpu.step_frame(&FrameInput { colliders: &[ball(shape, 0)], ..frame(0) }).unwrap();
            of_cpu = of_cpu.max(error(strands.offsets, &cpu.snapshot(), &truth, steps));
        }
    }
    [error(strands.offsets, &own.snapshot().unwrap(), &truth, steps), of_cpu]
}

fn is_close([gpu, cpu]: [f64; 2]) -> bool {
    gpu <= FACTOR * cpu + FLOOR
}

#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn any_count_of_strands_and_particles() {
    let gpu = common::gpu();
    let one = XpbdParams { substep_secs: DT / 20.0, ..XpbdParams::default() };
    let three = XpbdParams { iterations: 3, ..one.clone() };
    for (count, particles) in
        [(1, 30), (15, 9), (16, 9), (17, 9), (63, 9), (65, 12), (300, 25), (40, 2), (40, 3), (20, 150)]
    {
        for mixed in [false, true] {
            let (positions, offsets) = tuft(count, |strand| particles + if mixed { strand % 7 } else { 0 });
            let strands = Strands::new(&positions, &offsets);
            for params in [&one, &three] {
                let errors = errors(&gpu, &strands, [params; 2], None, 2);
                assert!(is_close(errors), "{count} × {particles}, mixed {mixed}, {params:?}: {errors:?}");
            }
        }
    }
}

/// Every parameter is felt as on the CPU, and one that is off is seen.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn every_parameter_is_felt() {
    let gpu = common::gpu();
    let (positions, offsets) = tuft(40, |strand| 18 + strand % 3);
    let stiffness: Vec<f32> = (0..40).map(|k| 0.1 * k as f32).collect();
    let strands = Strands { stiffness: Some(&stiffness), ..Strands::new(&positions, &offsets) };
    let base = XpbdParams::default();
    let others = [
        XpbdParams { k_stretch: 2e5, ..base.clone() },
        XpbdParams { k_bend_twist: 0.1, ..base.clone() },
        XpbdParams { k_bend_twist: 0.0, ..base.clone() },
        XpbdParams { rotation_weight: 5.0, ..base.clone() },
        XpbdParams { substep_secs: DT / 30.0, ..base.clone() },
        XpbdParams { substep_secs: DT / 30.0, iterations: 4, ..base.clone() },
        XpbdParams { drag: 8.0, ..base.clone() },
        XpbdParams { clamped: 4, ..base.clone() },
        XpbdParams { clamped: 1000, ..base.clone() },
        XpbdParams { k_stretch: 2e4, inextensibility: Inextensibility::Off, ..base.clone() },
        XpbdParams { k_stretch: 2e4, inextensibility: Inextensibility::Limit, ..base.clone() },
        XpbdParams { inextensibility: Inextensibility::FollowTheLeader, ..base.clone() },
    ];
    for params in &others {
        let alike = errors(&gpu, &strands, [params; 2], None, 6);
        let off = errors(&gpu, &strands, [params, &base], None, 6);
        println!("{params:?}: {alike:?}, {off:?} off");
        assert!(is_close(alike), "{params:?}: {alike:?}");
        assert!(!is_close(off) && off[0] > 10.0 * alike[0], "{params:?} is not seen: {off:?}");
    }
}

#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn solids_are_met_as_on_the_cpu() {
    let gpu = common::gpu();
    let (positions, offsets) = tuft(80, |strand| 20 + strand % 3);
    let strands = Strands::new(&positions, &offsets);
    let shape = Shape::Sphere { radius: 0.05 };
    for inextensibility in [Inextensibility::Projection, Inextensibility::Off] {
        let params = XpbdParams { inextensibility, ..XpbdParams::default() };
        for steps in [1, 8] {
            let errors = errors(&gpu, &strands, [&params; 2], Some(&shape), steps);
            println!("{inextensibility:?}, {steps} steps: {errors:?}");
            assert!(is_close(errors), "{inextensibility:?}, {steps} steps: {errors:?}");
        }
    }
}

/// Two runs, in one batch or many, from a snapshot: the same bits.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn the_bits_are_the_same_each_time() {
    let gpu = common::gpu();
    let little = little::binding_little(&gpu, 1 << 18);
    let (positions, offsets) = tuft(300, |strand| 12 + strand % 2);
    let strands = Strands::new(&positions, &offsets);
    let shape = Shape::Sphere { radius: 0.05 };
    for iterations in [1, 3] {
        let params = XpbdParams { iterations, ..XpbdParams::default() };
        let run = |gpu: &Gpu, broken: Option<u32>| {
            let new = || GpuSimulation::from_strands(gpu, &strands, &params, &options()).unwrap();
            let mut own = new();
            for number in 0..6 {
                if broken == Some(number) {
                    let snapshot = own.snapshot().unwrap();
                    own = new();
                    own.restore(&snapshot).unwrap();
                    assert_eq!(own.snapshot().unwrap(), snapshot);
                }
                own.step_frame(&FrameInput { colliders: &[ball(&shape, number)], ..frame(number) }).unwrap();
            }
            own.state_hash().unwrap()
        };
        let whole = run(&gpu, None);
        assert_eq!(
            [run(&gpu, None), run(&gpu, Some(0)), run(&gpu, Some(4)), run(&little, Some(3))],
            [whole; 4]
        );
    }
}

/// The rotation of particle `p` of `snapshot`.
fn rotation(snapshot: &Snapshot<f32>, p: usize) -> DQuat {
    DQuat::from_array([0, 1, 2, 3].map(|c| f64::from(snapshot.extra[ROTATION.name][4 * p + c])))
}

/// Channels have no values before the first frame and start in it; a change of the solver drops
/// them, and they start again.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn channels_start_with_the_first_frame() {
    let gpu = common::gpu();
    let (positions, offsets) = tuft(20, |_| 8);
    let strands = Strands::new(&positions, &offsets);
    // So stiff and short a step that rotations stay what they start as.
    let params = XpbdParams { substep_secs: 1e-5, ..XpbdParams::default() };
    let mut own = GpuSimulation::from_strands(&gpu, &strands, &params, &options()).unwrap();
    let turned = Pose::new(DQuat::from_rotation_y(1.0), DVec3::ZERO);
    let short = FrameInput { roots: [turned; 2].into(), dt_secs: 1e-5, ..FrameInput::default() };
    for times in 0..2 {
        let snapshot = own.snapshot().unwrap();
        assert_eq!(snapshot.extra.len(), 2);
        assert!(snapshot.extra.values().all(Vec::is_empty), "{times}: nothing before the first frame");
        own.teleport(&Pose::IDENTITY, &turned, forelock_core::strands::Teleport::Reset).unwrap();
        own.step_frame(&short).unwrap();
        let snapshot = own.snapshot().unwrap();
        for p in 0..positions.len() {
            let off = (rotation(&snapshot, p) - turned.rotation).length();
            assert!(off < 1e-4, "{times}, particle {p}: {off}");
        }
        own.set_params(&AmsParams::default()).unwrap();
        assert!(own.snapshot().unwrap().extra.is_empty());
        own.step_frame(&short).unwrap();
        own.set_params(&params).unwrap();
    }
    // The same channels under other parameters are kept.
    own.step_frame(&short).unwrap();
    let before = own.snapshot().unwrap();
    own.set_params(&XpbdParams::default()).unwrap();
    assert_eq!(own.snapshot().unwrap(), before);
    let mut without = before.clone();
    without.extra.remove(SPIN.name);
    own.restore(&without).unwrap_err();
    assert_eq!(own.snapshot().unwrap(), before, "nothing has changed");
}

/// A strand that is not finite starts anew, as on the CPU; no bit of the others depends on it.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn a_reset_strand_starts_anew() {
    let gpu = common::gpu();
    let (positions, offsets) = tuft(33, |_| 12);
    let strands = Strands::new(&positions, &offsets);
    let params = XpbdParams::default();
    let mut cpu = Simulation::from_strands(&strands, &params, &options()).unwrap();
    (0..3).for_each(|number| assert_eq!(cpu.step_frame(&frame(number)).unwrap().quarantined_strands, 0));
    let mut own = GpuSimulation::continuing(&gpu, &cpu).unwrap();
    let well = own.snapshot().unwrap();
    assert_eq!(well, cpu.snapshot());
    own.step_frame(&frame(3)).unwrap();
    let expected = own.snapshot().unwrap();
    let mut sick = well;
    sick.extra.get_mut(SPIN.name).unwrap()[3 * (20 * 12 + 5)] = f32::NAN;
    own.restore(&sick).unwrap();
    cpu.restore(&sick).unwrap();
    own.step_frame(&frame(3)).unwrap();
    cpu.step_frame(&frame(3)).unwrap();
    assert_eq!(own.report().unwrap().quarantined_strands, 1);
    let (found, on_cpu) = (own.snapshot().unwrap(), cpu.snapshot());
    for p in 0..positions.len() {
        if p / 12 != 20 {
            assert_eq!(found.positions[p], expected.positions[p]);
            assert_eq!(rotation(&found, p), rotation(&expected, p));
            continue;
        }
        for channel in [ROTATION, SPIN] {
            let rows = channel.rows() * p..channel.rows() * (p + 1);
            assert_eq!(found.extra[channel.name][rows.clone()], on_cpu.extra[channel.name][rows]);
        }
        assert!((rotation(&found, p) - head(4).rotation).length() < 1e-6);
    }
    own.step_frame(&frame(4)).unwrap();
    assert_eq!(own.report().unwrap().quarantined_strands, 0);
    assert!(own.snapshot().unwrap().extra.values().flatten().all(|x| x.is_finite()));
}

/// An edit while hair moves carries channels over as on the CPU.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn edits_keep_channels() {
    let gpu = common::gpu();
    let (positions, offsets) = tuft(20, |_| 10);
    let strand = |ends: &[u32]| {
        positions[ends[0] as usize..ends[1] as usize].iter().map(|p| Vec3::from_array(*p)).collect::<Vec<_>>()
    };
    let groom = Groom::from_strands(offsets.windows(2).map(strand)).unwrap();
    let params = XpbdParams::default();
    for operation in [
        Operation::Trim(Trim { to: 0.1, ..Trim::default() }),
        Operation::Curl(Curl { radius: 0.004, ..Curl::default() }),
    ] {
        let mut cpu = Simulation::new(&groom, &params, &options()).unwrap();
        (0..4).for_each(|number| assert_eq!(cpu.step_frame(&frame(number)).unwrap().quarantined_strands, 0));
        let mut own = GpuSimulation::continuing(&gpu, &cpu).unwrap();
        let mut edited = groom.clone();
        let sources = Edit::all(operation.clone()).apply(&mut edited, None).unwrap().sources;
        cpu.regroom(&edited, &sources, &head(4)).unwrap();
        own.regroom(&edited, &sources, &head(4)).unwrap();
        let start = cpu.snapshot();
        assert_eq!(own.snapshot().unwrap(), start, "{operation:?}");
        assert_eq!(start.extra[ROTATION.name].len(), 4 * edited.particle_count());
        cpu.step_frame(&frame(4)).unwrap();
        own.step_frame(&frame(4)).unwrap();
        let (a, b) = (own.snapshot().unwrap(), cpu.snapshot());
        let far = a.positions.iter().zip(&b.positions).map(|(a, b)| apart(*a, b.map(f64::from)));
        let far = far.fold(0.0, f64::max);
        assert!(far < 2e-5, "{operation:?}: {far} m");
    }
}
