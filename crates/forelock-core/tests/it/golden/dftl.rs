//! Reference results of DFTL in float64 (`dftl/README.md`), and the distance of a backend from
//! them.

use super::{Backend, numbers, vec3, vectors};
use forelock_core::body::{ColliderFrame, Shape};
use forelock_core::frame::{FrameInput, Roots};
use forelock_core::lane::Real;
use forelock_core::pose::Pose;
use forelock_core::simulation::Options;
use forelock_core::solver::{DftlParams, Solver};
use forelock_core::strands::Strands;
use glam::{DQuat, DVec3};
use num_traits::ToPrimitive;
use serde_json::Value;

/// Parameters of a DFTL reference file. Its lengths are in centimetres; no parameter depends on
/// that.
fn params(file: &Value) -> DftlParams {
    let f = |key: &str| file.get(key).and_then(Value::as_f64);
    // A number, or one a particle that fades linearly: at the root, and the tip's over the root's.
    let fading = |key: &str| match f(key) {
        Some(share) => (share, 1.0),
        None => {
            let shares = numbers(&file[key]);
            (shares[0], shares[shares.len() - 1] / shares[0])
        }
    };
    let ((shape_global, tip_scale_global), (shape_local, tip_scale_local)) = (fading("sg"), fading("sl"));
    DftlParams {
        shape_global,
        shape_local,
        tip_scale_global,
        tip_scale_local,
        damping: f("sd").unwrap(),
        drag: 0.0,
        clamped: 1,
        level_collisions: true,
        recheck: f("recheck").map_or(0, |x| x as u32),
        skin_thickness: f("thick").unwrap_or(0.0),
        depenetration_speed: 1e6,
        ..DftlParams::default()
    }
}

/// The head's poses of a file of follow the leader.
pub fn poses(file: &Value) -> Vec<Pose> {
    let turns = file["head_q"].as_array().unwrap().iter().map(numbers);
    let places = file["head_p"].as_array().unwrap().iter().map(vec3);
    turns.zip(places).map(|(q, p)| Pose::new(DQuat::from_xyzw(q[1], q[2], q[3], q[0]), p)).collect()
}

/// The strands of a file of follow the leader, and where each begins.
pub fn strands<T: Real>(file: &Value) -> (Vec<[T; 3]>, Vec<u32>) {
    let strands: Vec<Vec<[T; 3]>> = file["x_rest"].as_array().unwrap().iter().map(vectors).collect();
    let mut offsets = vec![0];
    strands.iter().for_each(|strand| offsets.push(offsets[offsets.len() - 1] + strand.len() as u32));
    (strands.concat(), offsets)
}

/// How far follow the leader is from a file.
#[derive(Debug, Default)]
pub struct Errors {
    /// Largest distance from the file's positions over the strand's length, over all strands and
    /// stored frames.
    pub worst: f64,
    /// Largest difference of an edge's length from its rest length, over the strand's length, over
    /// all frames.
    pub stretch: f64,
}

/// Runs a file of follow the leader.
pub fn errors<B: Backend>(
    file: &Value,
    build: impl Fn(&Strands<'_, B::Real>, &Solver<B::Real>, Options) -> B,
) -> Errors {
    let poses = poses(file);
    let (rest, offsets) = strands::<B::Real>(file);
    let strands = Strands::new(&rest, &offsets);
    let options = Options { rest_pose: poses[0], ..Options::default() };
    let mut simulation = build(&strands, &(&params(file)).into(), options);
    let capsules: Vec<(Shape, Pose)> = file.get("caps").map_or_else(Vec::new, |caps| {
        let ends = ["a", "b"].map(|end| vectors::<f64>(&caps[end]));
        let capsule = |(k, &radius): (usize, &f64)| {
            let (a, b) = (DVec3::from(ends[0][k]), DVec3::from(ends[1][k]));
            let turn = DQuat::from_rotation_arc(DVec3::Y, (b - a).normalize_or(DVec3::Y));
            let shape = Shape::Capsule { radius, half_length: 0.5 * a.distance(b) };
            (shape, Pose::new(turn, 0.5 * (a + b)))
        };
        numbers(&caps["r"]).iter().enumerate().map(capsule).collect()
    });
    let colliders: Vec<_> = capsules
        .iter()
        .map(|(shape, local)| ColliderFrame {
            shape,
            local: *local,
            from: Pose::IDENTITY,
            to: Pose::IDENTITY,
            friction: 0.0,
        })
        .collect();
    let frames = numbers(&file["frames"]);
    let mut errors = Errors::default();
    for frame in 1..poses.len() {
        simulation.step_frame(&FrameInput {
            roots: Roots::Rigid([poses[frame - 1], poses[frame]]),
            colliders: &colliders,
            gravity: DVec3::new(0.0, -981.0, 0.0),
            dt_secs: file["dt"].as_f64().unwrap(),
            ..FrameInput::default()
        });
        let snapshot = simulation.snapshot();
        let place = |p: usize| DVec3::from(snapshot.positions[p].map(|x| x.to_f64().unwrap()));
        let stored = frames.iter().position(|&f| f as usize == frame);
        for (strand, ends) in offsets.windows(2).enumerate() {
            let (from, to) = (ends[0] as usize, ends[1] as usize);
            let point = |p: usize| DVec3::from(rest[p].map(|x| x.to_f64().unwrap()));
            let lengths = (from + 1..to).map(|p| point(p).distance(point(p - 1)));
            let length: f64 = lengths.clone().sum();
            for (p, rest_length) in (from + 1..to).zip(lengths) {
                let stretch = (place(p).distance(place(p - 1)) - rest_length).abs() / length;
                errors.stretch = errors.stretch.max(stretch);
            }
            let Some(stored) = stored else { continue };
            for (p, want) in (from..to).zip(vectors::<f64>(&file["x"][stored][strand])) {
                let got = place(p) + DVec3::from(snapshot.origin);
                errors.worst = errors.worst.max(got.distance(DVec3::from(want)) / length);
            }
        }
    }
    errors
}
