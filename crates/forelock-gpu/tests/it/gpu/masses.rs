//! Masses and accelerations in addition to gravity on a device, compared with the CPU in float32
//! and float64.

#![expect(clippy::unwrap_used, reason = "a test fails where it cannot be set up")]

use crate::common::{
    self,
    shaken::{self, GRAVITY, apart, error_of_strands, options},
};
use forelock_core::air::WindField;
use forelock_core::frame::{Acceleration, Air, FrameInput};
use forelock_core::groom::Groom;
use forelock_core::params::ParamsError;
use forelock_core::simulation::{Options, Simulation};
use forelock_core::solver::{AmsParams, DftlParams, MassSpringParams, Solver, XpbdParams};
use forelock_core::strands::{Masses, Strands};
use forelock_gpu::{Gpu, GpuError, GpuSimulation};
use glam::{DMat3, DVec3, Vec3};

const DT: f64 = 1.0 / 60.0;
const STRANDS: u32 = 100;
const PARTICLES: u32 = 16;

/// What a run has beside the defaults.
#[derive(Clone, Copy, Debug)]
struct With {
    masses: bool,
    each: bool,
    field: bool,
    wind: bool,
}

/// A field that a lattice represents exactly.
fn linear(x: DVec3) -> DVec3 {
    let stretch = DMat3::from_cols_array(&[-20.0, 5.0, 0.0, 9.0, 4.0, -8.0, 3.0, 0.0, -15.0]);
    DVec3::new(4.0, 2.0, -6.0) + stretch * x
}

/// Runs `frames` on the GPU, on the CPU, and on the CPU in float64. Returns the distances of the
/// first two from the last, over the length of a strand.
fn errors(gpu: &Gpu, solvers: &(Solver<f32>, Solver<f64>), with: [With; 2], frames: u32) -> [f64; 2] {
    let (positions, offsets) = shaken::tuft(STRANDS, |_| PARTICLES, [0.001, 0.01]);
    let exact: Vec<[f64; 3]> = positions.iter().map(|x| x.map(f64::from)).collect();
    let masses: Vec<f32> = (0..positions.len()).map(|p| 0.2 * 1.37f32.powi((p % 10) as i32)).collect();
    let each: Vec<Vec3> =
        (0..positions.len()).map(|p| Vec3::new((p % 7) as f32, (p % 3) as f32, -((p % 5) as f32))).collect();
    let of = |with: With| with.masses.then_some(&*masses);
    let strands = |with| Strands { masses: of(with), ..Strands::new(&positions, &offsets) };
    let mut own = GpuSimulation::from_strands(gpu, &strands(with[0]), &solvers.0, &options()).unwrap();
    let mut cpu = Simulation::from_strands(&strands(with[1]), &solvers.0, &options()).unwrap();
    let exact = Strands { masses: of(with[1]), ..Strands::new(&exact, &offsets) };
    let mut truth = Simulation::<f64>::from_strands(&exact, &solvers.1, &options()).unwrap();
    let wind = WindField { mean: DVec3::new(2.0, 0.0, -1.0), shelter: 0.5, ..WindField::default() };
    for number in 0..frames {
        let [from, to] = [number, number + 1].map(|number| shaken::head(f64::from(number) * DT));
        let input = |with: With| FrameInput {
            roots: [from, to].into(),
            gravity: GRAVITY,
            air: Air { velocity: DVec3::X, field: with.wind.then_some(&wind) },
            acceleration: match with {
                With { each: true, .. } => Acceleration::PerParticle(&each),
                With { field: true, .. } => Acceleration::Field(&linear),
                _ => Acceleration::None,
            },
            dt_secs: DT,
            ..FrameInput::default()
        };
        own.step_frame(&input(with[0])).unwrap();
        cpu.step_frame(&input(with[1])).unwrap();
        truth.step_frame(&input(with[1])).unwrap();
    }
    let truth = truth.snapshot();
    [own.snapshot().unwrap(), cpu.snapshot()].map(|found| {
        let of_particle = |p: usize| {
            let x = apart(found.positions[p], truth.positions[p]);
            x.max(apart(found.velocities[p], truth.velocities[p]) * DT) / 0.25
        };
        error_of_strands(&offsets, of_particle, frames)
    })
}

/// As near as float32 should be, and a hundredfold nearer than without the feature.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn masses_and_accelerations_are_those_of_the_cpu() {
    let gpu = common::gpu();
    let ams = AmsParams { drag: 4.0, ..AmsParams::default() };
    let dftl = DftlParams { drag: 4.0, sag_free: true, ..DftlParams::default() };
    let rods = XpbdParams { drag: 4.0, ..XpbdParams::default() };
    let solvers =
        [((&ams).into(), (&ams).into()), ((&dftl).into(), (&dftl).into()), ((&rods).into(), (&rods).into())];
    let none = With { masses: false, each: false, field: false, wind: false };
    for (solver, name) in solvers.iter().zip(["ams", "dftl", "xpbd"]) {
        for with in [
            With { masses: true, ..none },
            With { each: true, ..none },
            With { field: true, ..none },
            With { masses: true, field: true, wind: true, ..none },
        ] {
            for frames in [1, 6] {
                let [gpu_error, cpu_error] = errors(&gpu, solver, [with, with], frames);
                let without = errors(&gpu, solver, [With { wind: with.wind, ..none }, with], frames)[0];
                println!(
                    "{name}, {with:?}, {frames} frames: {gpu_error:.1e}, CPU {cpu_error:.1e}, {without:.1e}"
                );
                assert!(gpu_error <= 3.0 * cpu_error + 4e-6, "{name} {with:?}: {gpu_error:e} {cpu_error:e}");
                assert!(without > 10.0 * gpu_error, "{name} {with:?}: {without:e} without it");
            }
        }
    }
}

/// A field that bends between the nodes of the lattice differs by the error of interpolation alone,
/// and particles that a solver adds are interpolated.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn a_curved_field_and_virtual_particles() {
    let gpu = common::gpu();
    let (positions, offsets) = shaken::tuft(20, |_| 8, [0.001, 0.01]);
    let strands = Strands::new(&positions, &offsets);
    let params = MassSpringParams::default();
    let mut own = GpuSimulation::from_strands(&gpu, &strands, &params, &options()).unwrap();
    let mut cpu = Simulation::from_strands(&strands, &params, &options()).unwrap();
    let each: Vec<Vec3> = (0..positions.len()).map(|p| Vec3::splat((p % 6) as f32)).collect();
    let field = |x: DVec3| DVec3::new((8.0 * x.y).sin(), 0.0, (6.0 * x.y).cos()) * 5.0;
    let far = |own: &mut GpuSimulation, cpu: &Simulation| {
        let (a, b) = (own.snapshot().unwrap(), cpu.snapshot());
        let apart = a.velocities.iter().zip(&b.velocities).map(|(a, b)| apart(*a, b.map(f64::from)));
        apart.fold(0.0, f64::max)
    };
    let still = FrameInput { gravity: GRAVITY, ..FrameInput::default() };
    let per_particle = FrameInput { acceleration: Acceleration::PerParticle(&each), ..still };
    own.step_frame(&per_particle).unwrap();
    cpu.step_frame(&per_particle).unwrap();
    assert!(far(&mut own, &cpu) < 1e-4);
    let in_field = FrameInput { acceleration: Acceleration::Field(&field), ..still };
    for _ in 0..3 {
        own.step_frame(&in_field).unwrap();
        cpu.step_frame(&in_field).unwrap();
    }
    let curved = far(&mut own, &cpu);
    assert!(curved < 1e-2, "{curved:e} m/s");
    // No acceleration is left over for the frames after.
    let start = cpu.snapshot();
    own.restore(&start).unwrap();
    own.step_frame(&still).unwrap();
    cpu.step_frame(&still).unwrap();
    assert!(far(&mut own, &cpu) < 1e-4);
}

/// Hair that falls far from where it rests stays within the lattice.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn a_field_reaches_hair_in_any_pose() {
    let gpu = common::gpu();
    let strand = (0..25).map(|i| Vec3::new(0.01 * i as f32, 0.1, 0.0)).collect::<Vec<_>>();
    let groom = Groom::from_strands([strand]).unwrap();
    let params = AmsParams { sag_free: false, k_integrity: 0.0, k_angular: 0.0, ..AmsParams::default() };
    let mut own = GpuSimulation::new(&gpu, &groom, &params, &Options::default()).unwrap();
    let mut cpu = Simulation::new(&groom, &params, &Options::default()).unwrap();
    let field = |x: DVec3| DVec3::new(0.0, 0.0, 40.0 * (0.1 - x.y));
    let acceleration = Acceleration::Field(&field);
    let frame = FrameInput { gravity: GRAVITY, acceleration, ..FrameInput::default() };
    for _ in 0..20 {
        own.step_frame(&frame).unwrap();
        cpu.step_frame(&frame).unwrap();
    }
    let (a, b) = (own.snapshot().unwrap(), cpu.snapshot());
    let tip = DVec3::from(b.origin) + DVec3::from(b.positions[24].map(f64::from));
    assert!(tip.y < 0.1 - cpu.model().reach, "the hair is outside of {}: {tip}", cpu.model().reach);
    let far = a.positions.iter().zip(&b.positions).map(|(a, b)| apart(*a, b.map(f64::from)));
    assert!(far.fold(0.0, f64::max) < 1e-3);
}

/// Masses follow widths through an edit, and wrong input is refused before anything is changed.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn widths_and_wrong_input() {
    let gpu = common::gpu();
    let strand = (0..6).map(|i| Vec3::new(0.0, -0.01 * i as f32, 0.0)).collect::<Vec<_>>();
    let mut groom = Groom::from_strands([strand]).unwrap();
    let options = Options { masses: Masses::Widths, ..Options::default() };
    assert!(GpuSimulation::new(&gpu, &groom, &AmsParams::default(), &options).is_err(), "no widths");
    groom.widths = Some((0..6).map(|i| 1e-4 * (1.0 - 0.1 * i as f32)).collect());
    let mut own = GpuSimulation::new(&gpu, &groom, &AmsParams::default(), &options).unwrap();
    let mut cpu = Simulation::new(&groom, &AmsParams::default(), &options).unwrap();
    assert_eq!(own.model().masses, cpu.model().masses);
    assert_eq!(own.model().masses.len(), 6);
    let before = own.state_hash().unwrap();
    let acceleration = Acceleration::PerParticle(&[Vec3::X; 3]);
    let wrong = own.step_frame(&FrameInput { acceleration, ..FrameInput::default() });
    assert!(matches!(wrong, Err(GpuError::Params(ParamsError::Count { found: 3, expected: 6, .. }))));
    assert_eq!(own.state_hash().unwrap(), before);
    let source = forelock_core::groom::edit::Source { strand: 0, fresh: false };
    groom.widths = Some(vec![1e-4; 6]);
    own.regroom(&groom, &[source], &options.rest_pose).unwrap();
    cpu.regroom(&groom, &[source], &options.rest_pose).unwrap();
    assert_eq!(own.model().masses, cpu.model().masses);
}
