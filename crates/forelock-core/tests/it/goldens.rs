//! Steps against reference results in float64 (`tests/golden/ams/README.md`,
//! `tests/golden/dftl/README.md`): the float64 solver at the files' float64 tolerances, and every
//! float32 one that this processor runs at their float32 tolerances.

#![expect(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test fails where its file is not as expected, and tells how near it came"
)]

use crate::golden::{self, Backend, dftl, fluid, load, params};
use crate::golden_rods::Trajectory;
use forelock_core::frame::FrameInput;
use forelock_core::interaction::sph::Fluid;
use forelock_core::interaction::sph::find_neighbours::{Neighbours, Particle};
use forelock_core::interaction::sph::push_particles;
use forelock_core::lane::Simd;
use forelock_core::simulation::SimulationReal;
use forelock_core::simulation::{Options, Simulation};
use forelock_core::solver::ams::{Inextensibility, Jacobian};
use forelock_core::solver::{MassSpringParams, Solver};
use forelock_core::strands::Snapshot;
use forelock_core::strands::{Model, Strands};
use serde_json::Value;

impl<T: SimulationReal> Backend for Simulation<T> {
    type Real = T;

    fn step_frame(&mut self, frame: &FrameInput<'_>) {
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
fn with<T: SimulationReal>(simd: Simd) -> impl Fn(&Strands<'_, T>, &Solver<T>, Options) -> Simulation<T> {
    move |strands, params, options| {
        Simulation::from_strands(strands, params, &Options { simd, ..options }).unwrap()
    }
}

fn worst_error<T: SimulationReal>(file: &Value, simd: Simd) -> f64 {
    golden::worst_error(file, with::<T>(simd))
}

fn substep_error<T: SimulationReal>(case: &Value, simd: Simd) -> (f64, f64) {
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
        substep_secs: 1.0 / 60.0 / 5.0,
        jacobian: Jacobian::Paper,
        inextensibility: Inextensibility::Off,
        skin_thickness: 0.0,
        depenetration_speed: 1e3,
        ..MassSpringParams::default()
    };
    let ams = forelock_core::solver::AmsParams { lay_along_solids: false, ..mass_spring.ams() };
    assert_eq!(ams, params(&load("g03_ms_sag")["params"]), "the file's is plain mass-spring");
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

/// Tolerances of DFTL, over the strand's length: positions in float64 and float32, and lengths of
/// edges after restoration.
const DFTL_TOLERANCES: [f64; 2] = [1e-9, 1e-4];
const DFTL_STRETCH: [f64; 2] = [1e-12, 1e-6];

fn check_dftl(name: &str, exact_edges: bool) {
    let file = load(name);
    let held = |what: &str, errors: &dftl::Errors, precision: usize| {
        println!("{name} {what}: {:.2e}, edges {:.2e} of the strand", errors.worst, errors.stretch);
        assert!(errors.worst <= DFTL_TOLERANCES[precision], "{name} {what}: {errors:?}");
        assert!(!exact_edges || errors.stretch <= DFTL_STRETCH[precision], "{name} {what}: {errors:?}");
    };
    held("float64", &dftl::errors(&file, with::<f64>(Simd::Auto)), 0);
    for simd in Simd::ALL.into_iter().filter(|s| s.is_supported()) {
        held(&format!("{simd:?}"), &dftl::errors(&file, with::<f32>(simd)), 1);
    }
}

#[test]
fn dftl_alone() {
    check_dftl("dftl_1_plain", true);
}

#[test]
fn dftl_with_shape() {
    check_dftl("dftl_2_shape", true);
}

#[test]
fn dftl_with_fading_shape() {
    check_dftl("dftl_3_fade_sd1", true);
}

#[test]
fn dftl_with_solids_last() {
    check_dftl("dftl_4_collision_recheck0", false);
}

#[test]
fn dftl_with_lengths_last() {
    check_dftl("dftl_5_collision_recheck2", true);
}

/// Of smoothed particles, relative: densities and accelerations in float64 and float32.
const SPH_TOLERANCES: [[f64; 2]; 2] = [[1e-12, 1e-12], [1e-4, 1e-3]];

/// The neighbours, densities and accelerations of the file's particles.
fn check_fluid<T: SimulationReal>(file: &Value, tolerances: [f64; 2]) {
    let float = |x: &Value| forelock_core::strands::number::<T>(x.as_f64().unwrap());
    let list = |key: &str| file[key].as_array().unwrap().iter();
    let places = golden::vectors::<T>(&file["P"]).into_iter().zip(golden::vectors::<T>(&file["U"]));
    let particles: Vec<_> = (0..)
        .zip(places.zip(list("strand")))
        .map(|(number, ((x, u), strand))| Particle { x, u, number, strand: strand.as_u64().unwrap() as u32 })
        .collect();
    let f = |key: &str| file[key].as_f64().unwrap();
    let fluid = Fluid::<T>::new(f("h"), f("m"), &fluid::fluid_params(file)).pushing(f("k"), f("mu"));
    let mut neighbours = Neighbours::default();
    neighbours.find(&particles, &fluid);
    let rest: Vec<T> = list("rho0").map(float).collect();
    let mut pressure = vec![T::zero(); particles.len()];
    let mut pushed = vec![[T::zero(); 3]; particles.len()];
    push_particles::push(&neighbours, &rest, &fluid, &mut pressure, &mut pushed);
    let strongest = list("acc").flat_map(golden::numbers).fold(0.0, |m: f64, a| m.max(a.abs()));
    let mut worst = [0.0f64; 2];
    for (number, ((near, density), acceleration)) in list("knn").zip(list("rho")).zip(list("acc")).enumerate()
    {
        let slot = neighbours.slots[number] as usize;
        let found = neighbours.near(slot, &fluid).iter().map(|&j| neighbours.sorted[j as usize].number);
        let expected = near.as_array().unwrap().iter().filter_map(Value::as_u64);
        assert!(found.map(u64::from).eq(expected), "neighbours of particle {number}");
        let density = density.as_f64().unwrap();
        worst[0] = worst[0].max((neighbours.density[slot].to_f64().unwrap() / density - 1.0).abs());
        for (a, b) in pushed[slot].iter().zip(golden::numbers(acceleration)) {
            worst[1] = worst[1].max((a.to_f64().unwrap() - b).abs() / strongest);
        }
    }
    println!(
        "dftl_6_sph float{}: density {:.2e}, accelerations {:.2e}",
        8 * size_of::<T>(),
        worst[0],
        worst[1]
    );
    assert!(worst[0] <= tolerances[0] && worst[1] <= tolerances[1], "{worst:?}");
}

/// Simulations for `simd` of strands that are the fluid of `file` as well.
fn wet<T: SimulationReal>(
    file: &Value,
    simd: Simd,
) -> impl Fn(&Strands<'_, T>, &Solver<T>, Options) -> Simulation<T> {
    let params = fluid::raw::<T>(file);
    move |strands, solver, options| {
        let mut simulation = with::<T>(simd)(strands, solver, options);
        let params = params(simulation.model());
        simulation.set_sph(Some(&params)).unwrap();
        simulation
    }
}

#[test]
fn dftl_with_smoothed_particles() {
    let file = load("dftl_6_sph");
    check_fluid::<f64>(&file, SPH_TOLERANCES[0]);
    check_fluid::<f32>(&file, SPH_TOLERANCES[1]);
    let error = fluid::coupled_error(&file, wet::<f64>(&file, Simd::Auto));
    println!("dftl_6_sph float64: {error:.2e}");
    assert!(error <= DFTL_TOLERANCES[0], "{error:e}");
    for simd in Simd::ALL.into_iter().filter(|s| s.is_supported()) {
        let error = fluid::coupled_error(&file, wet::<f32>(&file, simd));
        println!("dftl_6_sph {simd:?}: {error:.2e}");
        assert!(error <= DFTL_TOLERANCES[1], "{simd:?}: {error:e}");
    }
    // Without the fluid hair would be somewhere else.
    assert!(fluid::coupled_error(&file, with::<f64>(Simd::Auto)) > 1e-4);
}

/// Trajectories of XPBD rods: positions in metres, quaternions.
fn check_rods(name: &str) {
    let trajectory = Trajectory::load(name);
    let [x, q] = trajectory.worst_errors(with::<f64>(Simd::Auto));
    println!("{name} float64: {x:.1e} m, {q:.1e}");
    assert!(x <= 1e-9 && q <= 1e-8, "{name} float64: {x:e} {q:e}");
    for simd in Simd::ALL.into_iter().filter(|s| s.is_supported()) {
        let [x, q] = trajectory.worst_errors(with::<f32>(simd));
        println!("{name} {simd:?}: {x:.1e} m, {q:.1e}");
        assert!(x <= 2e-5 && q <= 5e-3, "{name} {simd:?}: {x:e} {q:e}");
    }
}

#[test]
fn xpbd_3_cantilever() {
    check_rods("xpbd_3_cantilever");
}

#[test]
fn xpbd_4_curly_turn() {
    check_rods("xpbd_4_curly_turn");
}

/// A wrong weight of rotations is found.
#[test]
fn rods_of_another_weight_are_not_the_reference() {
    let mut trajectory = Trajectory::load("xpbd_4_curly_turn");
    trajectory.params.rotation_weight *= 1.01;
    let [x, q] = trajectory.worst_errors(with::<f64>(Simd::Auto));
    assert!(x > 1e-5 && q > 1e-4, "{x:e} {q:e}");
}
