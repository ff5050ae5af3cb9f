//! The kernels against the same stages on the CPU, both in float32: same scene, same frames.

#![expect(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test fails where it cannot be set up, and tells how near it came"
)]

mod common;

use forelock_core::model::Strands;
use forelock_core::pose::Pose;
use forelock_core::solver::params::{AngularForm, Inextensibility, IntegrityForm, Jacobian};
use forelock_core::solver::{AmsParams, Frame, MassSpringParams, Options, Simulation};
use forelock_gpu::{Choice, Gpu, GpuError, GpuSimulation};
use glam::{DQuat, DVec3};

const GRAVITY: DVec3 = DVec3::new(0.0, -9.81, 0.0);
const FPS: f64 = 60.0;

/// How far a frame on the GPU may be from the same in float64, over how far the CPU's own float32 is from it: both round in their own order, the CPU fuses multiply–adds,
/// and a driver's divisions and roots may be off by two units in the last place.
const FACTOR: f64 = 3.0;
/// What never counts, over the strand's length: a few units in the last place of a position.
const FLOOR: f64 = 2e-6;

/// `count` curls of `particles(strand)` particles each, and their offsets.
fn tuft(count: u32, particles: impl Fn(u32) -> u32) -> (Vec<[f32; 3]>, Vec<u32>) {
    let (mut positions, mut offsets) = (Vec::new(), vec![0]);
    for strand in 0..count {
        let turn = DQuat::from_rotation_y(2.4 * f64::from(strand))
            * DQuat::from_rotation_z(0.01 * f64::from(strand % 50));
        let root = DVec3::new(0.001 * f64::from(strand % 40), 0.0, 0.001 * f64::from(strand / 40));
        let n = particles(strand);
        for i in 0..n {
            let s = f64::from(i) / f64::from(n - 1);
            let curl = DVec3::new(0.01 * (12.0 * s).cos(), -0.25 * s, 0.01 * (12.0 * s).sin());
            positions.push((root + turn * curl).as_vec3().to_array());
        }
        offsets.push(positions.len() as u32);
    }
    (positions, offsets)
}

/// A head that nods, turns and is shaken.
fn head(frame: u32) -> Pose {
    let t = f64::from(frame) / FPS;
    let turn = DQuat::from_rotation_y((3.0 * t).sin()) * DQuat::from_rotation_x(0.5 * (5.0 * t).sin());
    Pose::new(turn, DVec3::new(0.1 * (9.0 * t).sin(), 0.0, 5.0 * t))
}

fn frame(number: u32) -> Frame<'static> {
    Frame {
        head: [head(number), head(number + 1)],
        colliders: &[],
        gravity: GRAVITY,
        air_velocity: DVec3::new(1.0, 0.0, -2.0),
        dt_secs: 1.0 / FPS,
    }
}

fn options() -> Options {
    Options { rest_pose: head(0), rest_gravity: GRAVITY, ..Options::default() }
}

/// Distance from the float64 CPU after `frames` frames, over the length of a strand: of the GPU, and of the float32 CPU. `params` are the GPU's and the CPU's. After one frame that of
/// the worst strand; after more that of the median strand, for single ones may fall to either side of a threshold (a tie breaks or holds, a curl flips).
fn errors(gpu: &Gpu, strands: &Strands<'_, f32>, params: [&AmsParams; 2], frames: u32) -> [f64; 2] {
    let exact: Vec<[f64; 3]> = strands.positions.iter().map(|x| x.map(f64::from)).collect();
    let exact = Strands { positions: &exact, offsets: strands.offsets, stiffness: strands.stiffness };
    let mut own = GpuSimulation::from_strands(gpu, strands, params[0], &options()).unwrap();
    let mut cpu = Simulation::from_strands(strands, params[1], &options()).unwrap();
    let mut truth = Simulation::<f64>::from_strands(&exact, params[1], &options()).unwrap();
    for number in 0..frames {
        own.step_frame(&frame(number)).unwrap();
        cpu.step_frame(&frame(number)).unwrap();
        truth.step_frame(&frame(number)).unwrap();
    }
    let truth = truth.snapshot();
    [own.snapshot().unwrap(), cpu.snapshot()].map(|found| {
        assert_eq!(found.origin, truth.origin);
        let apart = |a: [f32; 3], b: [f64; 3]| {
            let d = DVec3::from(a.map(f64::from)) - DVec3::from(b);
            if d.is_finite() { d.length() } else { f64::INFINITY }
        };
        let of_particle = |p: usize| {
            let x = apart(found.positions[p], truth.positions[p]);
            // A frame's worth of velocity.
            let v = apart(found.velocities[p], truth.velocities[p]) / FPS;
            (x.max(v) / 0.25).max((f64::from(found.integrity[p]) - truth.integrity[p]).abs())
        };
        let of_strand =
            |ends: &[u32]| (ends[0]..ends[1]).map(|p| of_particle(p as usize)).fold(0.0, f64::max);
        let mut errors: Vec<f64> = strands.offsets.windows(2).map(of_strand).collect();
        errors.sort_by(f64::total_cmp);
        if frames == 1 { errors[errors.len() - 1] } else { errors[errors.len() / 2] }
    })
}

/// Whether the GPU is as near as float32 should be.
fn is_close([gpu, cpu]: [f64; 2]) -> bool {
    gpu <= FACTOR * cpu + FLOOR
}

/// Counts about every threshold: lanes, workgroups, the shortest strands, strands of many lengths.
#[test]
fn any_count_of_strands_and_particles() {
    let Some(gpu) = common::gpu() else { return };
    let params = AmsParams::default();
    for (count, particles) in [
        (1, 30),
        (15, 30),
        (16, 30),
        (17, 30),
        (63, 12),
        (64, 12),
        (65, 12),
        (700, 25),
        (40, 3),
        (40, 4),
        (40, 200),
    ] {
        for mixed in [false, true] {
            let (positions, offsets) = tuft(count, |strand| particles + if mixed { strand % 7 } else { 0 });
            let strands = Strands { positions: &positions, offsets: &offsets, stiffness: None };
            let errors = errors(&gpu, &strands, [&params; 2], 1);
            assert!(is_close(errors), "{count} × {particles}, mixed {mixed}: {errors:?}");
        }
    }
}

/// Every form of every term.
fn forms() -> Vec<(&'static str, AmsParams)> {
    let default = AmsParams::default;
    let breaking = AmsParams {
        non_hookean: true,
        elastic_limit: 0.01,
        breaking_point: 0.05,
        breaking_width: 0.1,
        healing_secs: 0.5,
        healing_limit: 0.02,
        ..default()
    };
    vec![
        ("default", default()),
        ("no preload", AmsParams { sag_free: false, ..default() }),
        (
            "paper's ties",
            AmsParams { integrity: IntegrityForm::Paper, angular: AngularForm::Paper, ..default() },
        ),
        ("no angular tie", AmsParams { angular: AngularForm::Off, ..default() }),
        (
            "paper's jacobian",
            AmsParams { jacobian: Jacobian::Paper, k_edge: 1e4, k_bend: 1e4, k_torsion: 1e4, ..default() },
        ),
        ("no ties, one clamped", AmsParams { k_integrity: 0.0, k_angular: 0.0, clamped: 1, ..default() }),
        (
            "soft tips",
            AmsParams {
                tip_scale_springs: 0.2,
                tip_scale_integrity: 0.1,
                tip_scale_angular: 0.0,
                ..default()
            },
        ),
        ("breaking", breaking),
        ("follow the leader", AmsParams { inextensibility: Inextensibility::Dftl, ..default() }),
        ("stretching", AmsParams { inextensibility: Inextensibility::Off, substeps: 7, ..default() }),
        ("all clamped", AmsParams { clamped: 1000, ..default() }),
        ("mass-spring", MassSpringParams { virtual_particles: false, ..MassSpringParams::default() }.ams()),
    ]
}

#[test]
fn every_form_of_every_term() {
    let Some(gpu) = common::gpu() else { return };
    let (positions, offsets) = tuft(70, |strand| 20 + strand % 2);
    let stiffness: Vec<f32> = (0..70u8).map(|strand| 0.5 + f32::from(strand) / 70.0).collect();
    let strands = Strands { positions: &positions, offsets: &offsets, stiffness: Some(&stiffness) };
    for (name, params) in forms() {
        let [one, many] = [1, 30].map(|frames| errors(&gpu, &strands, [&params; 2], frames));
        println!("{name} on {}: {one:?} after a frame, {many:?} after thirty (GPU, CPU)", gpu.name());
        assert!(is_close(one) && is_close(many), "{name}: {one:?}, {many:?}");
    }
}

/// The comparison can fail: every parameter that is off by a hundredth is seen.
#[test]
fn a_perturbed_twin_fails() {
    let Some(gpu) = common::gpu() else { return };
    let (positions, offsets) = tuft(20, |_| 20);
    let strands = Strands { positions: &positions, offsets: &offsets, stiffness: None };
    let truth = AmsParams {
        drag: 3.0,
        tip_scale_integrity: 0.5,
        inextensibility: Inextensibility::Off,
        ..AmsParams::default()
    };
    let off = |change: fn(&mut AmsParams)| {
        let mut params = truth.clone();
        change(&mut params);
        errors(&gpu, &strands, [&params, &truth], 30)
    };
    for (name, error) in [
        ("k_bend", off(|p| p.k_bend *= 0.5)),
        ("k_integrity", off(|p| p.k_integrity *= 1.01)),
        ("k_angular", off(|p| p.k_angular *= 1.01)),
        ("drag", off(|p| p.drag *= 1.01)),
        ("tip_scale_integrity", off(|p| p.tip_scale_integrity *= 1.01)),
        ("sag_free", off(|p| p.sag_free = false)),
        ("clamped", off(|p| p.clamped += 1)),
    ] {
        assert!(!is_close(error), "{name}: {error:?}");
    }
}

#[test]
fn two_runs_are_the_same_bits_and_a_run_that_was_interrupted_too() {
    let Some(gpu) = common::gpu() else { return };
    let (positions, offsets) = tuft(500, |strand| 10 + strand % 5);
    let strands = Strands { positions: &positions, offsets: &offsets, stiffness: None };
    let new = || GpuSimulation::from_strands(&gpu, &strands, &AmsParams::default(), &options()).unwrap();
    let run = |mut simulation: GpuSimulation, frames: std::ops::Range<u32>| {
        frames.for_each(|number| simulation.step_frame(&frame(number)).unwrap());
        simulation
    };
    let whole = run(new(), 0..40).state_hash().unwrap();
    assert_eq!(run(new(), 0..40).state_hash().unwrap(), whole);
    let half = run(new(), 0..17).snapshot().unwrap();
    let mut resumed = new();
    resumed.restore(&half).unwrap();
    assert_eq!(run(resumed, 17..40).state_hash().unwrap(), whole);
}

#[test]
fn a_strand_that_is_not_finite_goes_back_to_rest_and_the_others_go_on() {
    let Some(gpu) = common::gpu() else { return };
    let (positions, offsets) = tuft(50, |_| 20);
    let strands = Strands { positions: &positions, offsets: &offsets, stiffness: None };
    let (params, options) = (AmsParams::default(), options());
    let mut own = GpuSimulation::from_strands(&gpu, &strands, &params, &options).unwrap();
    let mut cpu = Simulation::from_strands(&strands, &params, &options).unwrap();
    let mut broken = cpu.snapshot();
    broken.positions[20 * 7 + 11][1] = f32::NAN;
    broken.velocities[20 * 31 + 3][2] = f32::INFINITY;
    own.restore(&broken).unwrap();
    cpu.restore(&broken).unwrap();
    own.step_frame(&frame(0)).unwrap();
    let expected = cpu.step_frame(&frame(0)).unwrap();
    let report = own.report().unwrap();
    assert_eq!((report.quarantined_strands, expected.quarantined_strands), (2, 2));
    assert!(report.max_edge_stretch < 1e-5, "{report:?}");
    assert_eq!(own.report().unwrap().quarantined_strands, 0, "a report begins anew");
    let (own, cpu) = (own.snapshot().unwrap(), cpu.snapshot());
    for (a, b) in own.positions.iter().flatten().zip(cpu.positions.iter().flatten()) {
        assert!((a - b).abs() < 1e-5, "{a} {b}");
    }
}

#[test]
fn a_steady_frame_makes_nothing_and_reads_nothing_back() {
    let Some(gpu) = common::gpu() else { return };
    let (positions, offsets) = tuft(100, |_| 20);
    let strands = Strands { positions: &positions, offsets: &offsets, stiffness: None };
    // A device of its own, for counts are a device's.
    let gpu = Gpu::open(&Choice::Named(gpu.name().to_owned())).unwrap();
    let mut simulation =
        GpuSimulation::from_strands(&gpu, &strands, &AmsParams::default(), &options()).unwrap();
    simulation.step_frame(&frame(0)).unwrap();
    let before = gpu.counts();
    (1..20).for_each(|number| simulation.step_frame(&frame(number)).unwrap());
    assert_eq!(gpu.counts(), before);
    simulation.state_hash().unwrap();
    assert!(gpu.counts().read_backs > before.read_backs, "the counter counts");
}

#[test]
fn what_a_gpu_cannot_do_is_said() {
    let Some(gpu) = common::gpu() else { return };
    let named = Gpu::open(&Choice::Named("a name that no one has".to_owned()));
    let text = named.unwrap_err().to_string();
    assert!(text.contains("a name that no one has") && text.contains(gpu.name()), "{text}");
    let (positions, offsets) = tuft(10, |_| 20);
    let strands = Strands { positions: &positions, offsets: &offsets, stiffness: None };
    let gpu = Gpu::open(&Choice::Named(gpu.name().to_owned())).unwrap();
    let mut simulation =
        GpuSimulation::from_strands(&gpu, &strands, &AmsParams::default(), &options()).unwrap();
    let too_stiff = Frame { dt_secs: 1e3, ..frame(0) };
    assert!(matches!(simulation.step_frame(&too_stiff), Err(GpuError::Params(_))));
    simulation.step_frame(&frame(0)).unwrap();
    gpu.lose("a cable was pulled");
    for error in [simulation.step_frame(&frame(1)).unwrap_err(), simulation.snapshot().unwrap_err()] {
        assert!(
            matches!(&error, GpuError::Failed { .. }) && error.to_string().contains("a cable was pulled"),
            "{error}"
        );
    }
}

/// 15,000 × 30, the paper's hand scene: at most 200 bytes a particle.
#[test]
fn two_hundred_bytes_a_particle() {
    let Some(gpu) = common::gpu() else { return };
    let (positions, offsets) = tuft(15_000, |_| 30);
    let strands = Strands { positions: &positions, offsets: &offsets, stiffness: None };
    let simulation = GpuSimulation::from_strands(&gpu, &strands, &AmsParams::default(), &options()).unwrap();
    let bytes = simulation.bytes() as f64 / positions.len() as f64;
    println!("{bytes:.0} bytes a particle on the device");
    assert!(bytes <= 200.0, "{bytes}");
}
