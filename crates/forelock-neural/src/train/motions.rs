//! Generated motions of a body's joints.
//!
//! # Theory
//! Each angle of each joint is a sum of five sines of 0.15 to 1.6 Hz, or turns and holds: smooth
//! turns to random angles within the joint's limits, with rests between, no faster than people move
//! ([`FASTEST`]). A part of the motions is rigid: all joints move as one body. All begin at rest.

use crate::features::BodyPose;
use crate::random::Random;
use forelock_core::pose::Pose;
use glam::{DQuat, DVec3, EulerRot};
use std::f64::consts::TAU;

/// Limits of the angles of each joint: yaw, pitch, roll of root, spine, neck, head.
const LIMITS: [[f64; 3]; 4] = [[0.6, 0.15, 0.1], [0.3, 0.25, 0.15], [0.4, 0.25, 0.2], [0.6, 0.35, 0.25]];
/// Limits of a body that moves as one.
const RIGID: [f64; 3] = [1.2, 0.6, 0.4];
/// Limits of the root's displacement, cm.
const REACH: [f64; 3] = [30.0, 6.0, 30.0];
/// The largest speed of a turn, rad/s, and acceleration of a displacement, cm/s², of one curve that
/// turns and holds.
pub const FASTEST: [f64; 2] = [6.0, 981.0];
/// Where each joint is in the axes of the one before, cm.
const BONES: [DVec3; 4] = [
    DVec3::new(0.0, 95.0, 0.0),
    DVec3::new(0.0, 25.0, 0.0),
    DVec3::new(0.0, 25.0, -1.0),
    DVec3::new(0.0, 10.0, 2.0),
];

/// What kind of motion to generate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Each joint by its own sines.
    Sines,
    /// Each joint turns and holds.
    TurnAndHold,
    /// All joints as one body, by sines.
    RigidSines,
    /// All joints as one body, which turns and holds.
    RigidTurnAndHold,
}

impl Kind {
    /// All kinds.
    pub const ALL: [Self; 4] = [Self::Sines, Self::TurnAndHold, Self::RigidSines, Self::RigidTurnAndHold];

    fn is_rigid(self) -> bool {
        matches!(self, Self::RigidSines | Self::RigidTurnAndHold)
    }
}

/// An angle or a displacement over time.
enum Curve {
    /// Amplitude, frequency, phase.
    Sines([[f64; 3]; 5]),
    /// Times and values between which it moves smoothly.
    Holds(Vec<[f64; 2]>),
}

impl Curve {
    /// A random curve within ±`limit`. `least_secs` is the least duration of a change.
    fn new(kind: Kind, limit: f64, secs: f64, least_secs: fn(f64) -> f64, random: &mut Random) -> Self {
        if matches!(kind, Kind::Sines | Kind::RigidSines) {
            let liveliness = 0.2 + 0.8 * random.unit();
            let mut sines = [[0.0; 3]; 5].map(|_| {
                let frequency = 0.15 * (1.6f64 / 0.15).powf(random.unit());
                [random.unit() / frequency.sqrt(), frequency, TAU * random.unit()]
            });
            let sum: f64 = sines.iter().map(|sine| sine[0]).sum();
            sines.iter_mut().for_each(|sine| sine[0] *= liveliness * limit / sum);
            return Self::Sines(sines);
        }
        let (mut holds, mut time, mut value) = (Vec::new(), 0.0, 0.0);
        while time < secs {
            time += 0.3 + 1.5 * random.unit();
            holds.push([time, value]);
            let (duration, next) = (0.25 + 0.6 * random.unit(), limit * random.signed());
            time += duration.max(least_secs((next - value).abs()));
            value = next;
            holds.push([time, value]);
        }
        Self::Holds(holds)
    }

    fn at(&self, time: f64) -> f64 {
        match self {
            Self::Sines(sines) => sines.iter().map(|[a, f, phase]| a * (TAU * f * time + phase).sin()).sum(),
            Self::Holds(holds) => {
                let next = holds.partition_point(|hold| hold[0] <= time);
                match (next.checked_sub(1).map(|before| holds[before]), holds.get(next)) {
                    (Some([from, a]), Some([to, b])) => {
                        let s = (time - from) / (to - from);
                        a + (b - a) * s * s * (3.0 - 2.0 * s)
                    }
                    (Some([_, last]), None) => last,
                    (None, _) => 0.0,
                }
            }
        }
    }
}

/// A motion of `frames` frames, `dt_secs` apart, in cm.
pub fn generate(kind: Kind, frames: usize, dt_secs: f64, seed: u64) -> Vec<BodyPose> {
    let mut random = Random::stream(seed, kind as u64);
    let secs = frames as f64 * dt_secs;
    // Of s² (3 − 2 s) the largest slope is 3/2, the largest second derivative 6.
    let turning = |change: f64| 1.5 * change / FASTEST[0];
    let moving = |change: f64| (6.0 * change / FASTEST[1]).sqrt();
    let mut curves = |limits: [f64; 3], least_secs: fn(f64) -> f64| {
        limits.map(|limit| Curve::new(kind, limit, secs, least_secs, &mut random))
    };
    // From rest.
    let at = |curves: &[Curve; 3], time: f64| {
        let s = time.min(1.0);
        [0, 1, 2].map(|k| s * s * (3.0 - 2.0 * s) * curves[k].at(time))
    };
    let (reach, rigid) = (curves(REACH, moving), curves(RIGID, turning));
    let joints = LIMITS.map(|limits| curves(limits, turning));
    let rotation = |[yaw, pitch, roll]: [f64; 3]| DQuat::from_euler(EulerRot::YXZ, yaw, pitch, roll);
    let frame = |time: f64| {
        let moved = DVec3::from(at(&reach, time));
        if kind.is_rigid() {
            let head = Pose::new(rotation(at(&rigid, time)), moved + BONES.iter().sum::<DVec3>());
            return BodyPose { root: head, spine: head, neck: head, head };
        }
        let mut place = Pose::new(DQuat::IDENTITY, moved);
        let mut poses = [place; 4];
        for ((pose, bone), curves) in poses.iter_mut().zip(BONES).zip(&joints) {
            place = Pose::new(place.rotation * rotation(at(curves, time)), place.transform_point(bone));
            *pose = place;
        }
        let [root, spine, neck, head] = poses;
        BodyPose { root, spine, neck, head }
    };
    (0..frames).map(|frame_number| frame(frame_number as f64 * dt_secs)).collect()
}
