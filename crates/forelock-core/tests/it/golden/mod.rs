//! Reference results in float64 (`ams/README.md`), and how far a backend is from them.

#![expect(clippy::unwrap_used, reason = "a test fails where its file is not as expected")]

pub mod dftl;
pub mod fluid;

use forelock_core::body::{ColliderFrame, Shape};
use forelock_core::frame::SolverReal;
use forelock_core::frame::{Air, FrameInput, Roots};
use forelock_core::lane::Real;
use forelock_core::pose::Pose;
use forelock_core::simulation::Options;
use forelock_core::solver::ams::{AngularForm, Inextensibility, IntegrityForm, Jacobian};
use forelock_core::solver::{AmsParams, Solver};
use forelock_core::strands::{Model, Strands};
use forelock_core::strands::{Snapshot, number};
use glam::{DQuat, DVec3};
use num_traits::ToPrimitive;
use serde_json::Value;

/// What runs strands.
pub trait Backend {
    /// Its numbers.
    type Real: SolverReal;
    fn step_frame(&mut self, frame: &FrameInput<'_>);
    fn snapshot(&mut self) -> Snapshot<Self::Real>;
    fn restore(&mut self, snapshot: &Snapshot<Self::Real>);
    fn model(&self) -> &Model<Self::Real>;
}

/// The file `name` of its folder, which the names of all but AMS's begin with.
pub fn load(name: &str) -> Value {
    let folder = ["dftl", "xpbd"].into_iter().find(|own| name.starts_with(own)).unwrap_or("ams");
    let folder = format!("{}/../forelock-core/tests/golden/{folder}", env!("CARGO_MANIFEST_DIR"));
    let path = format!("{folder}/{name}.json");
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

pub fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
}

pub fn vectors<T: Real>(value: &Value) -> Vec<[T; 3]> {
    let vector = |v: &Value| [0, 1, 2].map(|c| number(v[c].as_f64().unwrap()));
    value.as_array().unwrap().iter().map(vector).collect()
}

fn pose(value: &Value) -> Pose {
    let q = numbers(value);
    Pose::new(DQuat::from_xyzw(q[1], q[2], q[3], q[0]), DVec3::new(q[4], q[5], q[6]))
}

pub fn vec3(value: &Value) -> DVec3 {
    DVec3::from_slice(&numbers(value))
}

pub fn params(p: &Value) -> AmsParams {
    let f = |key: &str| p[key].as_f64().unwrap();
    let flag = |key: &str| p[key].as_bool().unwrap();
    let k = numbers(&p["kL"]);
    AmsParams {
        k_edge: k[0],
        k_bend: k[1],
        k_torsion: k[2],
        k_integrity: f("kI"),
        k_angular: f("kA"),
        k_altitude: f("kAlt"),
        drag: f("drag"),
        clamped: f("n_clamp") as u32,
        substep_secs: f("dt") / f("M"),
        jacobian: if flag("geo") { Jacobian::Tension } else { Jacobian::Paper },
        angular: match p["angular"].as_str().unwrap() {
            "off" => AngularForm::Off,
            "literal" => AngularForm::Paper,
            "edge_couple" => AngularForm::Edge,
            other => panic!("angular form {other}"),
        },
        integrity: if flag("iso") { IntegrityForm::Isotropic } else { IntegrityForm::Paper },
        sag_free: f("preload") > 0.0,
        non_hookean: flag("nonhooke"),
        elastic_limit: f("e0"),
        breaking_point: f("eb"),
        breaking_width: f("de"),
        healing_secs: f("heal_tau"),
        healing_limit: f("e_heal"),
        inextensibility: match p["inext"].as_str().unwrap() {
            "none" => Inextensibility::Off,
            "projection" => Inextensibility::Projection,
            "dftl" => Inextensibility::FollowTheLeader,
            other => panic!("inextensibility {other}"),
        },
        length_damping: f("dftl_damp"),
        skin_thickness: f("thick"),
        depenetration_speed: 1e3,
        lay_along_solids: false,
        ..AmsParams::default()
    }
}

fn options(p: &Value, rest_pose: Pose) -> Options {
    Options { rest_pose, rest_gravity: vec3(&p["g"]), beyond_float32: true, ..Options::default() }
}

/// Largest distance from the file's positions over the strand's length, over all strands and stored
/// frames.
pub fn worst_error<B: Backend>(
    file: &Value,
    build: impl Fn(&Strands<'_, B::Real>, &Solver<B::Real>, Options) -> B,
) -> f64 {
    let p = &file["params"];
    let poses: Vec<Pose> = file["poses_qw_qx_qy_qz_px_py_pz"].as_array().unwrap().iter().map(pose).collect();
    let sphere = numbers(&p["sphere"]);
    let shape = Shape::Sphere { radius: sphere[3] };
    let centre = Pose::new(DQuat::IDENTITY, DVec3::from_slice(&sphere[..3]));
    let mut worst = 0.0f64;
    for strand in file["strands"].as_array().unwrap() {
        let rest = vectors::<B::Real>(&strand["rest"]);
        let offsets = [0, rest.len() as u32];
        let strands = Strands::new(&rest, &offsets);
        let mut simulation = build(&strands, &(&params(p)).into(), options(p, poses[0]));
        let length = simulation.model().strand_lengths[0].0[0].to_f64().unwrap();
        let frames = numbers(&strand["frames"]);
        for frame in 1..poses.len() {
            let head = [poses[frame - 1], poses[frame]];
            let collider = ColliderFrame {
                shape: &shape,
                local: centre,
                from: head[0],
                to: head[1],
                friction: p["mu"].as_f64().unwrap(),
            };
            let colliders = if p["contact"].as_bool().unwrap() { vec![collider] } else { vec![] };
            simulation.step_frame(&FrameInput {
                roots: head.into(),
                colliders: &colliders,
                gravity: vec3(&p["g"]),
                air: Air::uniform(vec3(&p["wind"])),
                dt_secs: p["dt"].as_f64().unwrap(),
                ..FrameInput::default()
            });
            let Some(stored) = frames.iter().position(|&f| f as usize == frame) else { continue };
            let snapshot = simulation.snapshot();
            let expected = vectors::<f64>(&strand["x"][stored]);
            for (got, want) in snapshot.positions.iter().zip(&expected) {
                let got = DVec3::from(got.map(|x| x.to_f64().unwrap())) + DVec3::from(snapshot.origin);
                worst = worst.max((got - DVec3::from(*want)).length() / length);
            }
            if let Some(damage) = strand.get("s") {
                for (got, want) in snapshot.integrity.iter().zip(numbers(&damage[stored])) {
                    worst = worst.max((got.to_f64().unwrap() - want).abs());
                }
            }
        }
    }
    worst
}

/// One substep from a perturbed state: the velocities solve the file's dense system and equal its
/// solution.
pub fn substep_error<B: Backend>(
    case: &Value,
    build: impl Fn(&Strands<'_, B::Real>, &Solver<B::Real>, Options) -> B,
) -> (f64, f64) {
    let p = &case["params"];
    let poses = [pose(&case["pose0"]), pose(&case["pose1"])];
    let rest = vectors::<B::Real>(&case["rest"]);
    let offsets = [0, rest.len() as u32];
    let strands = Strands::new(&rest, &offsets);
    let one_substep = AmsParams { substep_secs: 1.0, ..params(p) };
    let mut simulation = build(&strands, &(&one_substep).into(), options(p, Pose::IDENTITY));
    let origin = poses[0].transform_point(simulation.model().centre.into());
    let relative = |x: [f64; 3]| [0, 1, 2].map(|c| number(x[c] - origin[c]));
    let snapshot = Snapshot {
        positions: vectors::<f64>(&case["x"]).into_iter().map(relative).collect(),
        velocities: vectors(&case["v"]),
        origin: origin.to_array(),
        ..simulation.snapshot()
    };
    simulation.restore(&snapshot);
    let h = case["h"].as_f64().unwrap();
    let (gravity, air_velocity) = (vec3(&p["g"]), vec3(&p["wind"]));
    simulation.step_frame(&FrameInput {
        roots: Roots::Rigid(poses),
        gravity,
        air: Air::uniform(air_velocity),
        dt_secs: h,
        ..FrameInput::default()
    });
    let after = simulation.snapshot();
    let v: Vec<f64> = after.velocities.iter().flatten().map(|x| x.to_f64().unwrap()).collect();
    let b: Vec<f64> = case["b"].as_array().unwrap().iter().flat_map(numbers).collect();
    let mut residual = 0.0f64;
    let scale = b.iter().fold(0.0f64, |m, x| m.max(x.abs()));
    for (row, b) in case["A"].as_array().unwrap().iter().zip(&b) {
        let product: f64 = numbers(row).iter().zip(&v).map(|(a, v)| a * v).sum();
        residual = residual.max((product - b).abs() / scale);
    }
    let expected: Vec<f64> = case["v_new"].as_array().unwrap().iter().flat_map(numbers).collect();
    let speed = expected.iter().fold(0.0f64, |m, x| m.max(x.abs()));
    let error = v.iter().zip(&expected).map(|(a, b)| (a - b).abs() / speed).fold(0.0, f64::max);
    (residual, error)
}
