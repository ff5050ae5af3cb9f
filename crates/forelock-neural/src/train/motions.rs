//! Generated motions of a body's joints.
//!
//! # Theory
//! Each angle of each joint is a sum of five sines of 0.15 to 1.6 Hz, or turns and holds: smooth
//! turns to random angles within the joint's limits, with rests between, no faster than people move
//! ([`FASTEST`]). A part of the motions is rigid: all joints move as one body. A body that stands
//! moves about a place; one that travels also goes at up to 2 m/s in any direction, rises and falls
//! with its steps, and may jump. All begin at rest.
//!
//! # Practice
//! Limits are those of walking, jumping and dancing people in recorded motions: the head tilts by
//! up to 75°, and is accelerated by 4 to 8 m/s² on average (root mean square).

use crate::features::BodyPose;
use crate::random::Random;
use forelock_core::pose::Pose;
use glam::{DQuat, DVec3, EulerRot};
use std::f64::consts::TAU;

/// Limits of the angles of each joint: yaw, pitch, roll of root, spine, neck, head.
const LIMITS: [[f64; 3]; 4] = [[0.6, 0.3, 0.15], [0.4, 0.4, 0.2], [0.4, 0.35, 0.2], [0.7, 0.5, 0.3]];
/// Limits of a body that moves as one.
const RIGID: [f64; 3] = [1.2, 0.9, 0.5];
/// Limits of the root's displacement, cm.
const REACH: [f64; 3] = [30.0, 6.0, 30.0];
/// The largest speed of a turn, rad/s, and acceleration of a displacement, cm/s², of one curve that
/// turns and holds.
pub const FASTEST: [f64; 2] = [6.0, 981.0];
/// The largest speed of a body that travels, sideways and forwards, cm/s.
const SPEED: f64 = 150.0;
/// Rates of steps, Hz, and how far they move the body up and down, cm: least and most.
const STEPS: [[f64; 2]; 2] = [[1.2, 3.0], [0.5, 5.0]];
/// Half the time in the air of a jump, seconds: least and most.
const JUMPS: [f64; 2] = [0.1, 0.28];
/// The time in which a jump begins and a landing ends, and in which the body then straightens,
/// seconds.
const BENDING: [f64; 2] = [0.15, 0.35];
/// Parts of a frame in which a position is the integral of a speed.
const PARTS: u32 = 8;
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
                    (Some([from, a]), Some([to, b])) => a + (b - a) * smooth((time - from) / (to - from)),
                    (Some([_, last]), None) => last,
                    (None, _) => 0.0,
                }
            }
        }
    }
}

/// 3 s² − 2 s³ of `s` between 0 and 1.
fn smooth(s: f64) -> f64 {
    let s = s.clamp(0.0, 1.0);
    s * s * (3.0 - 2.0 * s)
}

/// The height of a body that jumps, over that at rest, cm, `secs` before or after the highest
/// point. `half_secs` is half the time in the air.
fn jump(secs: f64, half_secs: f64) -> f64 {
    let (secs, [landing, straightening]) = (secs.abs(), BENDING);
    let speed = FASTEST[1] * half_secs;
    let after = secs - half_secs;
    if after < 0.0 {
        0.5 * FASTEST[1] * (half_secs * half_secs - secs * secs)
    } else if after < landing {
        -speed * after * (1.0 - 0.5 * after / landing)
    } else {
        -0.5 * speed * landing * (1.0 - smooth((after - landing) / straightening))
    }
}

/// How a body travels.
struct Travel {
    /// Speeds sideways and forwards, cm/s.
    speeds: [Curve; 2],
    /// Amplitude, cm, frequency and phase of the steps.
    step: [f64; 3],
    /// Times of the highest points of jumps and half of their durations, seconds.
    jumps: Vec<[f64; 2]>,
}

impl Travel {
    fn new(secs: f64, random: &mut Random) -> Self {
        let changing = |change: f64| 1.5 * change / FASTEST[1];
        let speeds = [0; 2].map(|_| Curve::new(Kind::TurnAndHold, SPEED, secs, changing, random));
        let [rate, height] = STEPS.map(|[least, most]| least + (most - least) * random.unit());
        let most = FASTEST[1] / (TAU * rate).powi(2);
        let step = [height.min(most), rate, TAU * random.unit()];
        let (mut jumps, mut time) = (Vec::new(), 1.0);
        let jumps_often = random.unit() < 0.5;
        while jumps_often && time < secs {
            let half = JUMPS[0] + (JUMPS[1] - JUMPS[0]) * random.unit();
            let around = half + BENDING.iter().sum::<f64>();
            time += around + random.unit();
            jumps.push([time, half]);
            time += around + random.unit();
        }
        Self { speeds, step, jumps }
    }

    fn height(&self, secs: f64) -> f64 {
        let [amplitude, rate, phase] = self.step;
        let jumps: f64 = self.jumps.iter().map(|[time, half]| jump(secs - time, *half)).sum();
        smooth(secs) * amplitude * (TAU * rate * secs + phase).sin() + jumps
    }
}

/// Where the body is in each frame because it travels, cm.
fn places(travel: Option<&Travel>, frames: usize, dt_secs: f64) -> Vec<DVec3> {
    let Some(travel) = travel else { return vec![DVec3::ZERO; frames] };
    let part_secs = dt_secs / f64::from(PARTS);
    let mut ground = [0.0; 2];
    let place = |frame: usize| {
        let secs = frame as f64 * dt_secs;
        let place = DVec3::new(ground[0], travel.height(secs), ground[1]);
        for part in 0..PARTS {
            let secs = secs + (f64::from(part) + 0.5) * part_secs;
            let speeds = travel.speeds.each_ref().map(|speed| smooth(secs) * speed.at(secs));
            ground.iter_mut().zip(speeds).for_each(|(x, speed)| *x += part_secs * speed);
        }
        place
    };
    (0..frames).map(place).collect()
}

/// A motion of `frames` frames, `dt_secs` apart, in cm, of a body that stands or travels.
pub fn generate(kind: Kind, travels: bool, frames: usize, dt_secs: f64, seed: u64) -> Vec<BodyPose> {
    let mut random = Random::stream(seed, kind as u64);
    let secs = frames as f64 * dt_secs;
    // Of s² (3 − 2 s) the largest slope is 3/2, the largest second derivative 6.
    let turning = |change: f64| 1.5 * change / FASTEST[0];
    let moving = |change: f64| (6.0 * change / FASTEST[1]).sqrt();
    let mut curves = |limits: [f64; 3], least_secs: fn(f64) -> f64| {
        limits.map(|limit| Curve::new(kind, limit, secs, least_secs, &mut random))
    };
    // From rest.
    let at = |curves: &[Curve; 3], time: f64| [0, 1, 2].map(|k| smooth(time) * curves[k].at(time));
    let (reach, rigid) = (curves(REACH, moving), curves(RIGID, turning));
    let joints = LIMITS.map(|limits| curves(limits, turning));
    let travel = travels.then(|| Travel::new(secs, &mut random));
    let places = places(travel.as_ref(), frames, dt_secs);
    let rotation = |[yaw, pitch, roll]: [f64; 3]| DQuat::from_euler(EulerRot::YXZ, yaw, pitch, roll);
    let frame = |frame_number: usize| {
        let time = frame_number as f64 * dt_secs;
        let moved = DVec3::from(at(&reach, time)) + places[frame_number];
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
    (0..frames).map(frame).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::features::SPACING_SECS;

    /// Root mean square of the head's acceleration, cm/s², and of its angular velocity, rad/s, and
    /// the largest tilt, radians, of motions of five seconds.
    fn rates(travels: bool) -> [f64; 3] {
        let (mut accelerations, mut turns, mut tilt) = (Vec::new(), Vec::new(), 0.0f64);
        for seed in 0..60 {
            let poses = generate(Kind::ALL[seed as usize % 4], travels, 150, SPACING_SECS, seed);
            for pair in poses.windows(2) {
                let turn = pair[0].head.rotation.inverse() * pair[1].head.rotation;
                turns.push(turn.to_scaled_axis().length() / SPACING_SECS);
                tilt = tilt.max((pair[1].head.rotation * DVec3::Y).angle_between(DVec3::Y));
            }
            for three in poses.windows(3) {
                let [a, b, c] = [0, 1, 2].map(|k| three[k].head.translation);
                accelerations.push((a - 2.0 * b + c).length() / SPACING_SECS.powi(2));
            }
        }
        let rms = |all: &[f64]| (all.iter().map(|x| x * x).sum::<f64>() / all.len() as f64).sqrt();
        [rms(&accelerations), rms(&turns), tilt]
    }

    #[test]
    fn bodies_move_as_fast_as_people() {
        let [standing, travelling] = [false, true].map(rates);
        println!("standing {standing:?}, travelling {travelling:?}");
        assert!((150.0..500.0).contains(&standing[0]) && (400.0..900.0).contains(&travelling[0]));
        assert!([standing, travelling].iter().all(|own| (0.8..1.8).contains(&own[1])));
        assert!([standing, travelling].iter().all(|own| (0.8..1.6).contains(&own[2])));
    }

    #[test]
    fn a_jump_has_a_speed_everywhere_and_falls_freely_in_the_air() {
        for half in JUMPS {
            let height = |secs: f64| jump(secs, half);
            let step = 1e-4;
            let mut before = f64::NAN;
            for k in -10_000..10_000 {
                let secs = step * f64::from(k);
                let speed = (height(secs + step) - height(secs)) / step;
                assert!(before.is_nan() || (speed - before).abs() < 0.5, "{secs}: {before} to {speed}");
                before = speed;
            }
            assert!((height(0.0) - 0.5 * 981.0 * half * half).abs() < 1e-9);
            assert_eq!(height(2.0), 0.0);
        }
    }

    #[test]
    fn motions_begin_at_rest_and_travel_far() {
        let mut far = 0.0f64;
        for seed in 0..20 {
            let poses = generate(Kind::RigidSines, true, 150, SPACING_SECS, seed);
            let first = poses[1].head.translation - poses[0].head.translation;
            assert!(first.length() / SPACING_SECS < 30.0, "{first}");
            far = far.max(poses[149].head.translation.distance(poses[0].head.translation));
        }
        assert!(far > 150.0, "{far} cm");
    }
}
