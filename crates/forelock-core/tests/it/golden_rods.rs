//! Trajectories of XPBD Cosserat rods (`tests/golden/xpbd/README.md`).

#![expect(clippy::unwrap_used, reason = "a test fails where its file is not as expected")]

use crate::golden::{Backend, load, numbers, vectors};
use forelock_core::frame::FrameInput;
use forelock_core::lane::Real;
use forelock_core::params::Inextensibility;
use forelock_core::pose::Pose;
use forelock_core::simulation::Options;
use forelock_core::solver::{Solver, XpbdParams};
use forelock_core::strands::{Snapshot, Strands};
use glam::{DQuat, DVec3};
use serde_json::Value;

/// Metres of a centimetre.
const CM: f64 = 0.01;

/// The name of the channel of rotations.
const ROTATION: &str = "rotation";

/// A file of a strand that moves.
pub struct Trajectory {
    file: Value,
    pub params: XpbdParams,
    pub dt_secs: f64,
    /// Rest positions, metres.
    pub rest: Vec<DVec3>,
    /// Poses of the head, one a frame and that at the start; none if it is at rest.
    poses: Vec<Pose>,
}

/// A quaternion w, x, y, z.
fn quaternion(value: &Value) -> DQuat {
    let q = numbers(value);
    DQuat::from_xyzw(q[1], q[2], q[3], q[0])
}

/// The vectors of a file in metres.
fn metres(value: &Value) -> Vec<DVec3> {
    vectors::<f64>(value).into_iter().map(|x| CM * DVec3::from(x)).collect()
}

impl Trajectory {
    /// The trajectory of file `name`.
    pub fn load(name: &str) -> Self {
        let file = load(name);
        let f = |key: &str| file[key].as_f64().unwrap();
        let dt_secs = f("dt");
        let params = XpbdParams {
            k_stretch: f("ks") / f("m"),
            k_bend_twist: f("kbt") / f("m") * CM * CM * CM,
            rotation_weight: f("wqs"),
            substep_secs: dt_secs / f("nsub"),
            iterations: f("nit") as u32,
            drag: f("damp"),
            inextensibility: Inextensibility::Off,
            ..XpbdParams::default()
        };
        let turns = file["head_q"].as_array().into_iter().flatten();
        let places = file["head_p"].as_array().into_iter().flatten();
        let pose = |(q, p): (&Value, &Value)| Pose::new(quaternion(q), CM * DVec3::from_slice(&numbers(p)));
        let poses = turns.zip(places).map(pose).collect();
        Self { rest: metres(&file["x_rest"]), poses, params, dt_secs, file }
    }

    /// The head's pose after `frame` frames.
    pub fn pose(&self, frame: usize) -> Pose {
        self.poses.get(frame).copied().unwrap_or(Pose::IDENTITY)
    }

    /// The largest distance from the file's positions, metres, and the largest difference from its
    /// quaternions.
    pub fn worst_errors<B: Backend>(
        &self,
        build: impl Fn(&Strands<'_, B::Real>, &Solver<B::Real>, Options) -> B,
    ) -> [f64; 2] {
        let rest: Vec<[B::Real; 3]> =
            self.rest.iter().map(|x| x.to_array().map(forelock_core::strands::number)).collect();
        let offsets = [0, rest.len() as u32];
        let options = Options { rest_pose: self.pose(0), ..Options::default() };
        let mut backend = build(&Strands::new(&rest, &offsets), &(&self.params).into(), options);
        let kept: Vec<usize> = numbers(&self.file["frames"]).iter().map(|x| *x as usize).collect();
        let of_turns = self.file.get("q_frames").map_or_else(
            || vec![kept[kept.len() - 1]],
            |frames| numbers(frames).iter().map(|x| *x as usize).collect(),
        );
        let mut worst = [0.0f64; 2];
        for frame in 0..kept[kept.len() - 1] {
            let roots = [self.pose(frame), self.pose(frame + 1)].into();
            let gravity = DVec3::new(0.0, -9.81, 0.0);
            backend.step_frame(&FrameInput {
                roots,
                gravity,
                dt_secs: self.dt_secs,
                ..FrameInput::default()
            });
            let snapshot = backend.snapshot();
            if let Some(k) = kept.iter().position(|own| *own == frame + 1) {
                let expected = metres(&self.file["x"][k]);
                let apart = positions(&snapshot).into_iter().zip(expected).map(|(x, y)| x.distance(y));
                worst[0] = apart.fold(worst[0], f64::max);
            }
            if let Some(k) = of_turns.iter().position(|own| *own == frame + 1) {
                worst[1] = worst[1].max(self.worst_turn(&snapshot, &self.file["q"][k]));
            }
        }
        worst
    }

    /// The largest difference of the frames of edges from those of the file, whose sign does not
    /// count.
    fn worst_turn<T: Real>(&self, snapshot: &Snapshot<T>, expected: &Value) -> f64 {
        let rotations = &snapshot.extra[ROTATION];
        let mut at_rest = DQuat::IDENTITY;
        let mut direction = DVec3::Z;
        let mut worst = 0.0f64;
        for (i, ends) in self.rest.windows(2).enumerate() {
            let next = (ends[1] - ends[0]).normalize();
            at_rest = DQuat::from_rotation_arc(direction, next) * at_rest;
            direction = next;
            let of = |c: usize| rotations[4 * i + c].to_f64().unwrap();
            let found = DQuat::from_xyzw(of(0), of(1), of(2), of(3)) * at_rest;
            let expected = quaternion(&expected[i]);
            worst = worst.max((found - expected).length().min((found + expected).length()));
        }
        worst
    }
}

/// Positions in the world, metres.
pub fn positions<T: Real>(snapshot: &Snapshot<T>) -> Vec<DVec3> {
    let origin = DVec3::from(snapshot.origin);
    let all = snapshot.positions.iter();
    all.map(|x| origin + DVec3::from(x.map(|x| x.to_f64().unwrap()))).collect()
}
