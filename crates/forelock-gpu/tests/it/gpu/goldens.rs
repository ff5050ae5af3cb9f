//! The kernels against reference results in float64, at the files' float32 tolerances.

#![expect(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test fails where its file is not as expected, and tells how near it came"
)]

use crate::common;
use crate::golden::{self, Backend, dftl, fluid, load};
use forelock_core::frame::FrameInput;
use forelock_core::simulation::Options;
use forelock_core::solver::dftl::Schedule;
use forelock_core::solver::{DftlParams, Solver};
use forelock_core::strands::Snapshot;
use forelock_core::strands::{Model, Strands};
use forelock_gpu::{Gpu, GpuSimulation};
use serde_json::Value;

impl Backend for GpuSimulation {
    type Real = f32;

    fn step_frame(&mut self, frame: &FrameInput<'_>) {
        Self::step_frame(self, frame).unwrap();
    }

    fn snapshot(&mut self) -> Snapshot<f32> {
        Self::snapshot(self).unwrap()
    }

    fn restore(&mut self, snapshot: &Snapshot<f32>) {
        Self::restore(self, snapshot).unwrap();
    }

    fn model(&self) -> &Model<f32> {
        Self::model(self)
    }
}

pub fn on(gpu: &Gpu) -> impl Fn(&Strands<'_, f32>, &Solver<f32>, Options) -> GpuSimulation {
    |strands, params, options| GpuSimulation::from_strands(gpu, strands, params, &options).unwrap()
}

fn check(name: &str) {
    let gpu = common::gpu();
    let file = load(name);
    let tolerance = file["tolerance_max_dx_over_L"]["float32"].as_f64().unwrap();
    let error = golden::worst_error(&file, on(&gpu));
    println!("{name} on {}: {error:.2e} (tolerance {tolerance:.2e})", gpu.name());
    assert!(error <= tolerance, "{name}: {error:e}");
}

macro_rules! goldens {
    ($($test:ident)*) => {$(
        #[test]
        #[cfg_attr(not(gpu), ignore = "there is no GPU")]
        fn $test() {
            check(stringify!($test));
        }
    )*};
}
goldens! {
    g01_preload_static
    g02_fig4_no_preload
    g03_ms_sag
    g04_default_head_turn
    g05_literal_angular
    g06_nonhooke_launch
    g07_contact_sphere
}

#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn g10_one_substep_system() {
    let gpu = common::gpu();
    for case in load("g10_one_substep_system")["cases"].as_array().unwrap() {
        let (label, (_, error)) = (case["label"].as_str().unwrap(), golden::substep_error(case, on(&gpu)));
        println!("{label} on {}: velocities {error:.1e}", gpu.name());
        assert!(error < 1e-4, "{label}: {error:e}");
    }
}

/// The comparison can fail: stiffness off by a thousandth does not pass.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn a_perturbed_solver_fails() {
    let gpu = common::gpu();
    let mut file = load("g04_default_head_turn");
    file["params"]["kI"] = Value::from(100.1);
    assert!(golden::worst_error(&file, on(&gpu)) > 1e-5);
}

/// Tolerances of DFTL in float32, over the strand's length: positions, and lengths of edges after
/// restoration.
const DFTL_TOLERANCES: [f64; 2] = [1e-4, 1e-6];

/// Every schedule against the files of follow the leader; a schedule has no bits of its own.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn dftl_in_every_schedule() {
    let gpu = common::gpu();
    for name in [
        "dftl_1_plain",
        "dftl_2_shape",
        "dftl_3_fade_sd1",
        "dftl_4_collision_recheck0",
        "dftl_5_collision_recheck2",
    ] {
        let file = load(name);
        for schedule in [Schedule::Fused, Schedule::Strands, Schedule::Particles] {
            let build = |strands: &Strands<'_, f32>, params: &Solver<f32>, options: Options| {
                let Some(params) = params.params::<DftlParams>() else { panic!("{name}") };
                on(&gpu)(strands, &(&DftlParams { schedule, ..params.clone() }).into(), options)
            };
            let errors = dftl::errors(&file, build);
            println!(
                "{name}, {schedule:?}: {:.2e}, edges {:.2e} of the strand",
                errors.worst, errors.stretch
            );
            let [position, stretch] = DFTL_TOLERANCES;
            assert!(errors.worst <= position, "{name}, {schedule:?}: {errors:?}");
            let exact = name != "dftl_4_collision_recheck0";
            assert!(!exact || errors.stretch <= stretch, "{name}, {schedule:?}: {errors:?}");
        }
    }
}

/// Shape and smoothed particles together, against the last file of follow the leader.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn dftl_with_smoothed_particles() {
    let gpu = common::gpu();
    let file = load("dftl_6_sph");
    let params = fluid::raw(&file);
    let error = fluid::coupled_error(&file, |strands, solver, options| {
        let mut simulation = on(&gpu)(strands, solver, options);
        let params = params(simulation.model());
        simulation.set_sph(Some(&params)).unwrap();
        simulation
    });
    println!("dftl_6_sph on {}: {error:.2e}", gpu.name());
    assert!(error <= DFTL_TOLERANCES[0], "{error:e}");
    assert!(fluid::coupled_error(&file, on(&gpu)) > DFTL_TOLERANCES[0], "without particles");
}
