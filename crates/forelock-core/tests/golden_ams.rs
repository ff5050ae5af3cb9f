//! The AMS step against reference results in float64 (`tests/golden/ams/README.md`): the float64 instantiation at the
//! files' float64 tolerances, and every float32 one that this processor runs at their float32 tolerances.

#![expect(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test fails where its file is not as expected, and tells how near it came"
)]

#[path = "golden/mod.rs"]
mod golden;

use forelock_core::model::{Model, Strands};
use forelock_core::solver::params::Jacobian;
use forelock_core::solver::{AmsParams, Frame, MassSpringParams, Options, Simd, Simulation, SolverReal};
use forelock_core::state::Snapshot;
use golden::{Backend, load, params};
use serde_json::Value;

impl<T: SolverReal> Backend for Simulation<T> {
    type Real = T;

    fn step_frame(&mut self, frame: &Frame<'_>) {
        Self::step_frame(self, frame).unwrap();
    }

    fn snapshot(&mut self) -> Snapshot<T> {
        Self::snapshot(self)
    }

    fn restore(&mut self, snapshot: &Snapshot<T>) {
        Self::restore(self, snapshot).unwrap();
    }

    fn model(&self) -> &Model<T> {
        Self::model(self)
    }
}

/// Builds simulations for `simd`.
fn with<T: SolverReal>(simd: Simd) -> impl Fn(&Strands<'_, T>, &AmsParams, Options) -> Simulation<T> {
    move |strands, params, options| {
        Simulation::from_strands(strands, params, &Options { simd, ..options }).unwrap()
    }
}

fn worst_error<T: SolverReal>(file: &Value, simd: Simd) -> f64 {
    golden::worst_error(file, with::<T>(simd))
}

fn substep_error<T: SolverReal>(case: &Value, simd: Simd) -> (f64, f64) {
    golden::substep_error(case, with::<T>(simd))
}

fn check(name: &str) {
    let file = load(name);
    let tolerance = |precision: &str| file["tolerance_max_dx_over_L"][precision].as_f64().unwrap();
    let error = worst_error::<f64>(&file, Simd::Auto);
    println!("{name} float64: {error:.2e} (tolerance {:.2e})", tolerance("float64"));
    assert!(error <= tolerance("float64"), "{name} float64: {error:e}");
    for simd in Simd::ALL.into_iter().filter(|s| s.is_supported()) {
        let error = worst_error::<f32>(&file, simd);
        println!("{name} {simd:?}: {error:.2e} (tolerance {:.2e})", tolerance("float32"));
        assert!(error <= tolerance("float32"), "{name} {simd:?}: {error:e}");
    }
}

macro_rules! goldens {
    ($($test:ident $file:literal;)*) => {$(
        #[test]
        fn $test() {
            check($file);
        }
    )*};
}
goldens! {
    g01_preload_static "g01_preload_static";
    g02_fig4_no_preload "g02_fig4_no_preload";
    g04_default_head_turn "g04_default_head_turn";
    g05_literal_angular "g05_literal_angular";
    g06_nonhooke_launch "g06_nonhooke_launch";
    g07_contact_sphere "g07_contact_sphere";
}

#[test]
fn g03_ms_sag() {
    check("g03_ms_sag");
    let mass_spring = MassSpringParams {
        k_altitude: 0.0,
        virtual_particles: false,
        drag: 3.0,
        substeps: 5,
        jacobian: Jacobian::Paper,
        skin_thickness: 0.0,
        depenetration_speed: 1e3,
        ..MassSpringParams::default()
    };
    assert_eq!(mass_spring.ams(), params(&load("g03_ms_sag")["params"]), "the file's is plain mass-spring");
}

#[test]
fn g10_one_substep_system() {
    for case in load("g10_one_substep_system")["cases"].as_array().unwrap() {
        let label = case["label"].as_str().unwrap();
        let (residual, error) = substep_error::<f64>(case, Simd::Auto);
        println!("{label} float64: residual {residual:.1e}, velocities {error:.1e}");
        assert!(residual < 1e-10 && error < 1e-10, "{label}: {residual:e} {error:e}");
        for simd in Simd::ALL.into_iter().filter(|s| s.is_supported()) {
            let (_, error) = substep_error::<f32>(case, simd);
            println!("{label} {simd:?}: velocities {error:.1e}");
            assert!(error < 1e-4, "{label} {simd:?}: {error:e}");
        }
    }
}

/// The comparison can fail: a solver whose stiffness is off by a thousandth does not pass.
#[test]
fn a_perturbed_solver_fails() {
    let mut file = load("g04_default_head_turn");
    file["params"]["kI"] = Value::from(100.1);
    assert!(worst_error::<f64>(&file, Simd::Auto) > 1e-9);
    assert!(worst_error::<f32>(&file, Simd::Auto) > 1e-5);
}
