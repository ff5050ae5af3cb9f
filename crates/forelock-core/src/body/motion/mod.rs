//! Motions of the head and of colliders: functions from time to [`Pose`].
//!
//! # Theory
//! The built-in motions start at the identity with zero velocity and acceleration and are twice
//! continuously differentiable. They are composed of sines, of sin⁴ and of the step function
//! s(u) = 6u⁵ − 15u⁴ + 10u³, multiplied by the envelope s(t/T) − s((t − t₁)/T), which fades in over
//! one period T and fades out before `rest_after_secs`. The spin is the exact integral of this
//! envelope, so it stops at the angle that it has reached.
//!
//! # Practice
//! The head turns about the pivot, the base of the neck. The documentation of each [`MotionKind`]
//! gives the peak acceleration of a point 20 cm above and 10 cm in front of the pivot, at the
//! default frequency and amplitude 1. It is proportional to the amplitude and, except for the
//! roller-coaster, to the square of the frequency.

mod keyframes;

use std::f64::consts::{PI, TAU};
use std::sync::Arc;

use glam::{DQuat, DVec3};

pub use keyframes::{Keyframe, KeyframeInterpolation, Keyframes, KeyframesError};

use super::character::{Performance, PosingBuffers};
use crate::pose::Pose;

/// Standard gravity, m/s².
const GRAVITY: f64 = 9.80665;

/// The motion of the head or of a collider.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "kebab-case"))]
pub enum Motion {
    /// One of the built-in motions.
    Builtin(BuiltinMotion),
    /// Shifts and turns at given times.
    Keyframes(Keyframes),
    /// That of the joint of a character that carries hair.
    #[cfg_attr(feature = "serde", serde(skip))]
    Joint(Arc<Performance>),
}

/// The built-in motions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "kebab-case"))]
pub enum MotionKind {
    /// No motion. Peak 0.
    #[default]
    Still,
    /// Yaw to 60° left and right alternately, with a stop at each side; 0.4 Hz. Peak 2.7 m/s².
    Turn,
    /// Pitch by ±25°; 0.8 Hz. Peak 2.7 m/s².
    Nod,
    /// Shaking the head: yaw by ±30° and a sideways motion of ±3 cm; 2 Hz. Peak 14.1 m/s².
    Shake,
    /// Continuous yaw; 0.75 turns per second. Peak 2.2 m/s².
    Spin,
    /// Jumps of 20 cm; 1.2 Hz. Peak 11.4 m/s².
    Jump,
    /// One second of violent shaking (35°, 4 cm, 2.5 Hz) alternating with one second of jumps (15
    /// cm, 2 Hz); the frequency, 0.5 Hz, is that of the whole cycle. Peak 39 m/s².
    ShakeAndJump,
    /// A ride with accelerations up to 3 g vertically and 1.5 g sideways at any frequency, pitching
    /// by 20°; 1 Hz, as in the AMS paper. Peak 33 m/s².
    RollerCoaster,
}

/// A built-in motion and its parameters.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct BuiltinMotion {
    /// Kind of motion. Default "still".
    pub kind: MotionKind,
    /// Factor applied to the angles and lengths of the motion. No unit, default 1, range 0 or more;
    /// 0 is still.
    pub amplitude: f64,
    /// Frequency in Hz, above 0 (otherwise nothing moves); if absent, the default frequency of the
    /// motion.
    pub frequency_hz: Option<f64>,
    /// Time at which the motion has come to rest, in seconds; if absent, it never stops.
    pub rest_after_secs: Option<f64>,
    /// The point about which the head turns, the base of the neck, in metres. Default (0, 0, 0).
    pub pivot: DVec3,
}

/// There is no built-in motion of the given name; [`Motion::NAMES`] lists the names.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("there is no built-in motion `{0}`")]
pub struct UnknownMotion(pub String);

impl Default for Motion {
    fn default() -> Self {
        Self::Builtin(BuiltinMotion::default())
    }
}

impl Motion {
    /// The names of the built-in motions.
    pub const NAMES: [&'static str; 8] =
        ["still", "turn", "nod", "shake", "spin", "jump", "shake-and-jump", "roller-coaster"];

    /// The built-in motion `name` with its default frequency, amplitude 1 and the pivot at the
    /// origin.
    ///
    /// # Errors
    /// [`UnknownMotion`] if `name` is not in [`Motion::NAMES`].
    pub fn by_name(name: &str) -> Result<Self, UnknownMotion> {
        let kind = match name {
            "still" => MotionKind::Still,
            "turn" => MotionKind::Turn,
            "nod" => MotionKind::Nod,
            "shake" => MotionKind::Shake,
            "spin" => MotionKind::Spin,
            "jump" => MotionKind::Jump,
            "shake-and-jump" => MotionKind::ShakeAndJump,
            "roller-coaster" => MotionKind::RollerCoaster,
            _ => return Err(UnknownMotion(name.to_owned())),
        };
        Ok(Self::Builtin(BuiltinMotion { kind, ..BuiltinMotion::default() }))
    }

    /// The pose at `time` seconds: world from head; at a jump, the pose after it. A built-in motion
    /// is at the identity before time 0.
    pub fn pose(&self, time: f64) -> Pose {
        match self {
            Self::Builtin(motion) => motion.pose(time),
            Self::Keyframes(keyframes) => keyframes.pose(time),
            Self::Joint(performance) => performance.carrier(time, &mut PosingBuffers::default()),
        }
    }

    /// The jumps after the first and not after the second of `times` (seconds) as one displacement,
    /// from poses before them to poses after them. Only keyframes jump; a clip that leaps where it
    /// is repeated moves there.
    pub fn jump_between(&self, times: [f64; 2]) -> Option<Pose> {
        match self {
            Self::Builtin(_) | Self::Joint(_) => None,
            Self::Keyframes(keyframes) => keyframes.jump_between(times),
        }
    }
}

impl Default for BuiltinMotion {
    fn default() -> Self {
        Self {
            kind: MotionKind::default(),
            amplitude: 1.0,
            frequency_hz: None,
            rest_after_secs: None,
            pivot: DVec3::ZERO,
        }
    }
}

impl MotionKind {
    /// The default frequency of the motion in Hz.
    pub fn frequency_hz(self) -> f64 {
        match self {
            Self::Still | Self::RollerCoaster => 1.0,
            Self::Turn => 0.4,
            Self::Nod => 0.8,
            Self::Shake => 2.0,
            Self::Spin => 0.75,
            Self::Jump => 1.2,
            Self::ShakeAndJump => 0.5,
        }
    }
}

impl BuiltinMotion {
    /// The pose at `time` seconds.
    pub fn pose(&self, time: f64) -> Pose {
        let frequency = self.frequency_hz.unwrap_or(self.kind.frequency_hz());
        let moves = time > 0.0 && frequency > 0.0 && frequency.is_finite();
        if !moves {
            return Pose::IDENTITY;
        }
        let periods = time * frequency;
        let rest = self.rest_after_secs.map_or(f64::INFINITY, |rest| rest.max(0.0) * frequency);
        let fade = Fade { length: (rest * 0.5).min(1.0), rest };
        let (axis, angle, shift) = self.kind.displace(periods, frequency, &fade);
        let rotation = DQuat::from_axis_angle(axis, angle * self.amplitude);
        Pose::new(rotation, self.pivot - rotation * self.pivot + shift * self.amplitude)
    }
}

impl MotionKind {
    /// Rotation axis, angle in radians and translation in metres after `periods` periods.
    fn displace(self, periods: f64, frequency: f64, fade: &Fade) -> (DVec3, f64, DVec3) {
        let level = fade.level(periods);
        let sine = |times: f64| (TAU * times * periods).sin();
        let degrees = |angle: f64| angle.to_radians() * level;
        match self {
            Self::Still => (DVec3::Y, 0.0, DVec3::ZERO),
            Self::Turn => (DVec3::Y, degrees(60.0) * swing_with_stops(periods), DVec3::ZERO),
            Self::Nod => (DVec3::X, degrees(25.0) * sine(1.0), DVec3::ZERO),
            Self::Shake => (DVec3::Y, degrees(30.0) * sine(1.0), DVec3::X * (0.03 * level * sine(1.0))),
            Self::Spin => (DVec3::Y, TAU * fade.integral(periods), DVec3::ZERO),
            Self::Jump => (DVec3::Y, 0.0, DVec3::Y * (0.2 * level * hop(periods))),
            Self::ShakeAndJump => {
                let part = periods.fract();
                // Half a cycle each, with a fade of a tenth of a cycle at both ends.
                let window = |from: f64| step((part - from) / 0.1) - step((part - from - 0.4) / 0.1);
                let (shake, jump) = (window(0.0) * sine(5.0), window(0.5) * hop(4.0 * part));
                let shift = DVec3::new(0.04 * shake, 0.15 * jump, 0.0) * level;
                (DVec3::Y, degrees(35.0) * shake, shift)
            }
            Self::RollerCoaster => {
                let reach = 3.0 * GRAVITY / (TAU * frequency).powi(2) * level;
                let shift = DVec3::new(0.125 * sine(2.0), sine(1.0), 0.0) * reach;
                (DVec3::X, degrees(20.0) * (TAU * periods).cos() * step(periods), shift)
            }
        }
    }
}

/// The envelope that starts a motion from rest and brings it back to rest.
struct Fade {
    /// Duration of each fade, in periods.
    length: f64,
    /// Time at which the motion has come to rest, in periods.
    rest: f64,
}

impl Fade {
    /// The value of the envelope, 0 to 1, twice continuously differentiable.
    fn level(&self, periods: f64) -> f64 {
        if periods >= self.rest {
            return 0.0;
        }
        step(periods / self.length) - step((periods - (self.rest - self.length)) / self.length)
    }

    /// The integral of the envelope from time 0.
    fn integral(&self, periods: f64) -> f64 {
        let periods = periods.min(self.rest);
        if self.length == 0.0 {
            return 0.0;
        }
        let risen = |since: f64| {
            let u = (since / self.length).clamp(0.0, 1.0);
            self.length * u.powi(4) * (u * u - 3.0 * u + 2.5) + (since - self.length).max(0.0)
        };
        risen(periods) - risen(periods - (self.rest - self.length))
    }
}

/// A smooth step from 0 at `u` ≤ 0 to 1 at `u` ≥ 1; the first two derivatives are zero at both
/// ends.
fn step(u: f64) -> f64 {
    let u = u.clamp(0.0, 1.0);
    u * u * u * (u * (6.0 * u - 15.0) + 10.0)
}

/// From 0 to 1 in the first half period, to −1 in the next, and so on; the motion takes three
/// fifths of each half period.
fn swing_with_stops(periods: f64) -> f64 {
    let half = (2.0 * periods).floor();
    let to = if half % 2.0 == 0.0 { 1.0 } else { -1.0 };
    let from = if half == 0.0 { 0.0 } else { -to };
    from + (to - from) * step((2.0 * periods - half) / 0.6)
}

/// sin⁴: one hop per period, at rest on the ground in between.
fn hop(periods: f64) -> f64 {
    (PI * periods).sin().powi(4)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn builtin(name: &str) -> BuiltinMotion {
        match Motion::by_name(name) {
            Ok(Motion::Builtin(motion)) => motion,
            other => panic!("{other:?}"),
        }
    }

    /// Largest acceleration of a point on the head within ten seconds, and its largest change in a
    /// millisecond.
    fn peaks(motion: &BuiltinMotion) -> (f64, f64) {
        let (h, point) = (1e-3, DVec3::new(0.0, 0.2, 0.1));
        let x = |n: i32| motion.pose(f64::from(n) * h).transform_point(point);
        let a = |n: i32| (x(n + 1) - x(n) * 2.0 + x(n - 1)) / (h * h);
        (-5..10_000).fold((0.0, 0.0), |(most, jump): (f64, f64), n| {
            (most.max(a(n).length()), jump.max((a(n + 1) - a(n)).length()))
        })
    }

    #[test]
    fn accelerations_are_as_documented_and_continuous() {
        let documented = [0.0, 2.7, 2.7, 14.1, 2.2, 11.4, 39.0, 33.0];
        for (name, expected) in Motion::NAMES.into_iter().zip(documented) {
            for rest_after_secs in [None, Some(7.3)] {
                let (peak, jump) = peaks(&BuiltinMotion { rest_after_secs, ..builtin(name) });
                println!("{name} {peak} {jump}");
                assert!((peak - expected).abs() <= 0.05 * expected, "{name}: {peak} m/s²");
                assert!(jump <= 0.05 * expected, "{name}: jumps by {jump} m/s² in a millisecond");
            }
        }
    }

    #[test]
    fn all_motions_start_and_end_at_rest() {
        for name in Motion::NAMES {
            let motion = BuiltinMotion {
                rest_after_secs: Some(2.0),
                pivot: DVec3::new(0.0, 1.4, -0.02),
                ..builtin(name)
            };
            assert_eq!(motion.pose(0.0), Pose::IDENTITY);
            let early = motion.pose(1e-3);
            assert!(early.translation.length() < 1e-6 && early.rotation.w > 1.0 - 1e-9, "{name}");
            assert_eq!(motion.pose(2.0), motion.pose(3.0), "{name}");
            assert!(
                (motion.pose(2.0).translation - motion.pose(1.999).translation).length() < 1e-6,
                "{name}"
            );
            if name != "spin" {
                assert!((motion.pose(2.0).rotation.w - 1.0).abs() < 1e-12, "{name}");
            }
            assert_eq!(motion.pose(-1.0), Pose::IDENTITY);
        }
    }

    #[test]
    fn the_head_turns_about_its_pivot() {
        let pivot = DVec3::new(0.1, 1.4, -0.2);
        let motion = BuiltinMotion { pivot, ..builtin("spin") };
        for t in [0.3, 1.7, 4.0] {
            assert!((motion.pose(t).transform_point(pivot) - pivot).length() < 1e-14);
        }
    }

    #[test]
    fn spin_is_the_integral_of_its_envelope() {
        let motion = BuiltinMotion { frequency_hz: Some(1.0), rest_after_secs: Some(4.0), ..builtin("spin") };
        let fade = Fade { length: 1.0, rest: 4.0 };
        let (n, mut sum) = (4000, 0.0);
        for i in 0..n {
            sum += fade.level((f64::from(i) + 0.5) * 4.0 / f64::from(n)) * 4.0 / f64::from(n);
        }
        assert!((fade.integral(4.0) - 3.0).abs() < 1e-12 && (sum - 3.0).abs() < 1e-6);
        assert!((motion.pose(9.0).rotation.w.abs() - 1.0).abs() < 1e-12, "three whole turns");
    }

    #[test]
    fn only_listed_names_are_known() {
        for name in Motion::NAMES {
            assert!(Motion::by_name(name).is_ok());
        }
        assert_eq!(Motion::by_name("tunr"), Err(UnknownMotion("tunr".into())));
    }

    #[cfg(feature = "serde")]
    #[test]
    fn the_scene_file_uses_the_same_names() {
        for name in Motion::NAMES {
            let json = format!(r#"{{"builtin": {{"kind": "{name}"}}}}"#);
            let read: Motion = serde_json::from_str(&json).unwrap();
            assert_eq!(Ok(read), Motion::by_name(name));
        }
        assert!(serde_json::from_str::<Motion>(r#"{"builtin": {"frequency": 1}}"#).is_err());
    }
}
