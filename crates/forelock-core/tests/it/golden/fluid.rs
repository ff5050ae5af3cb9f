//! Reference results of DFTL with SPH (`dftl/README.md`, the last file), and the distance of a
//! backend from them.

use super::dftl::{poses, strands};
use super::{Backend, vectors};
use forelock_core::frame::{FrameInput, Roots};
use forelock_core::interaction::sph::{Sph, SphParams};
use forelock_core::lane::Simd;
use forelock_core::simulation::Options;
use forelock_core::simulation::SimulationReal;
use forelock_core::solver::{DftlParams, Solver};
use forelock_core::strands::{Model, Strands};
use glam::DVec3;
use num_traits::ToPrimitive;
use serde_json::Value;

/// The neighbours of the fluid of `dftl_6_sph`, which pushes with `k` and `mu` of the file.
pub fn fluid_params(file: &Value) -> SphParams {
    let f = |key: &str| file[key].as_f64().unwrap();
    SphParams {
        smoothing_length: f("h"),
        neighbours: f("K") as u32,
        rest_density: f("rho_scale"),
        own_strand: !file["skip"].as_bool().unwrap(),
        mutual: false,
        ..SphParams::default()
    }
}

/// Runs the steps of `dftl_6_sph`, shape and fluid together. Returns the largest distance from the
/// file's positions after them, over the strand's length.
pub fn coupled_error<B: Backend>(
    file: &Value,
    build: impl Fn(&Strands<'_, B::Real>, &Solver<B::Real>, Options) -> B,
) -> f64 {
    let steps = &file["step"];
    let poses = poses(steps);
    let (rest, offsets) = strands::<B::Real>(steps);
    let strands = Strands::new(&rest, &offsets);
    let params = DftlParams {
        tip_scale_global: 1.0,
        tip_scale_local: 1.0,
        drag: 0.0,
        skin_thickness: 0.0,
        ..DftlParams::default()
    };
    let options = Options { rest_pose: poses[0], ..Options::default() };
    let mut simulation = build(&strands, &(&params).into(), options);
    for head in poses.windows(2) {
        simulation.step_frame(&FrameInput {
            roots: Roots::Rigid([head[0], head[1]]),
            gravity: DVec3::new(0.0, -981.0, 0.0),
            dt_secs: 0.016,
            ..FrameInput::default()
        });
    }
    let snapshot = simulation.snapshot();
    let expected: Vec<[f64; 3]> = steps["x5"].as_array().unwrap().iter().flat_map(vectors).collect();
    let mut worst = 0.0f64;
    for (p, want) in expected.into_iter().enumerate() {
        let got = snapshot.positions[p].map(|x| x.to_f64().unwrap());
        worst = worst.max((DVec3::from(got) + DVec3::from(snapshot.origin)).distance(want.into()));
    }
    worst / simulation.model().strand_lengths[0].0[0].to_f64().unwrap()
}

/// The file's fluid. Its `k` and `mu` hold for particles of mass 1; here they are converted for the
/// strands of a model, whose mean density is 1.
pub fn raw<T: SimulationReal>(file: &Value) -> impl Fn(&Model<T>) -> SphParams {
    let params = fluid_params(file);
    let [k, mu] = ["k", "mu"].map(|key| file[key].as_f64().unwrap());
    move |model| {
        let (h, step) = (params.smoothing_length, 0.016);
        let kernel = 315.0 / (64.0 * std::f64::consts::PI * h.powi(3));
        let mass = Sph::new(model, &params, Simd::Auto).fluid().density(T::zero()).to_f64().unwrap() / kernel;
        let (pressure, viscosity) = (k * step * step / (h * h), mu * mass * step / (h * h));
        SphParams { pressure, viscosity, ..params.clone() }
    }
}
