//! Keyframe motion: shifts and turns at given times, interpolated in between.
//!
//! # Theory
//! The six components of a key (shift along x, y, z; yaw, pitch, roll) are interpolated each by
//! itself. Smooth interpolation is the monotone cubic of M. Steffen (Astronomy and Astrophysics
//! 239, 1990): a cubic Hermite piece whose slope at a key between the secants d₁ and d₂ of
//! intervals h₁ and h₂ is
//!
//! m = (sgn d₁ + sgn d₂) min(|d₁|, |d₂|, ½ |d₁ h₂ + d₂ h₁| / (h₁ + h₂)),   (1)
//!
//! that of the parabola through three keys, but for its limits: 0 where the component turns back
//! and at most twice the smaller secant. With such slopes a piece is monotone, so no component ever
//! leaves the range of the two keys around it. Beside a linear interval the slope is that
//! interval's, as far as a monotone piece can have it (three times its own secant). At the first
//! and last key, and beside a hold, it is 0: motions start and stop at rest.
//!
//! # Practice
//! Turns are angles, so 1,440° of yaw in one interval are four turns. Between two keys that differ
//! in one angle the axis is fixed and the speed is that of the angle.
//!
//! # Limitations
//! Smooth motion is once continuously differentiable: accelerations are discontinuous at the keys.
//! Between keys that differ in several angles the axis moves, as it does for any Euler angles.

use glam::{DQuat, DVec3, EulerRot};

use crate::pose::Pose;

/// One key of a motion.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct Keyframe {
    /// When, seconds.
    pub time_secs: f64,
    /// Shift from rest, metres.
    pub translation: DVec3,
    /// Turn from rest about the pivot, radians: yaw about y, pitch about x, roll about z, in this
    /// order. Angles are taken as given: 4π is two turns.
    pub turn: DVec3,
    /// How the motion goes on from here to the next key.
    pub interpolation: KeyframeInterpolation,
}

/// Keys at increasing times and the point about which they turn.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(try_from = "raw::Keyframes", into = "raw::Keyframes")
)]
pub struct Keyframes {
    keys: Vec<Keyframe>,
    pivot: DVec3,
}

/// Interpolation between two keys.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "kebab-case"))]
pub enum KeyframeInterpolation {
    /// A smooth curve through all keys that never goes beyond them.
    #[default]
    Smooth,
    /// Constant speed.
    Linear,
    /// Rest until the next key, and a jump there.
    Hold,
}

/// Why keys do not form a motion.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum KeyframesError {
    /// There are no keys.
    #[error("a motion needs at least one keyframe")]
    Empty,
    /// The time of this key is not finite or not later than that of the key before, which does not
    /// hold.
    #[error("the time of keyframe {0} is not later than the time of the keyframe before it")]
    Order(usize),
    /// The shift or turn of this key, or the pivot, is not finite.
    #[error("keyframe {0} has a translation or rotation that is not finite")]
    NotFinite(usize),
}

impl Keyframes {
    /// Creates the motion through `keys`, turning about `pivot` (metres). It stays at the first key
    /// before its time and at the last key after its time. Two keys may have the same time if the
    /// first of them holds: the motion jumps there.
    ///
    /// # Errors
    /// [`KeyframesError`] if there are no keys, the times do not increase, or a number is not
    /// finite.
    pub fn new(keys: Vec<Keyframe>, pivot: DVec3) -> Result<Self, KeyframesError> {
        if keys.is_empty() {
            return Err(KeyframesError::Empty);
        }
        for (index, key) in keys.iter().enumerate() {
            let later = |before: &Keyframe| {
                let tied = before.interpolation == KeyframeInterpolation::Hold;
                key.time_secs > before.time_secs || (tied && key.time_secs == before.time_secs)
            };
            if !key.time_secs.is_finite() || (index > 0 && !later(&keys[index - 1])) {
                return Err(KeyframesError::Order(index));
            }
            if !(key.translation.is_finite() && key.turn.is_finite() && pivot.is_finite()) {
                return Err(KeyframesError::NotFinite(index));
            }
        }
        Ok(Self { keys, pivot })
    }

    /// The pose at `time` seconds; at a jump, the pose after it.
    pub fn pose(&self, time: f64) -> Pose {
        let next = self.keys.partition_point(|key| key.time_secs <= time);
        if next == 0 || next == self.keys.len() {
            return self.pose_at_key(next.saturating_sub(1));
        }
        let (from, to) = (&self.keys[next - 1], &self.keys[next]);
        let span = to.time_secs - from.time_secs;
        let u = (time - from.time_secs) / span;
        let component = |value: fn(&Keyframe) -> DVec3| -> DVec3 {
            let [start, end] = [value(from), value(to)];
            let at = match from.interpolation {
                KeyframeInterpolation::Hold => start,
                KeyframeInterpolation::Linear => start + (end - start) * u,
                KeyframeInterpolation::Smooth => {
                    let [a, b, c, d] = hermite(u, span);
                    let [leave, arrive] = self.slopes(next - 1, value);
                    start * a + leave * b + end * c + arrive * d
                }
            };
            // Monotone pieces leave their keys by rounding only.
            at.clamp(start.min(end), start.max(end))
        };
        self.turned(component(|key| key.translation), component(|key| key.turn))
    }

    /// The jumps after the first and not after the second of `times` (seconds) as one displacement,
    /// from poses before them to poses after them.
    pub fn jump_between(&self, times: [f64; 2]) -> Option<Pose> {
        let first = self.keys.partition_point(|key| key.time_secs <= times[0]).max(1);
        let mut jump: Option<Pose> = None;
        for next in (first..self.keys.len()).take_while(|&next| self.keys[next].time_secs <= times[1]) {
            let (from, to) = (&self.keys[next - 1], &self.keys[next]);
            let moves = from.translation != to.translation || from.turn != to.turn;
            if from.interpolation == KeyframeInterpolation::Hold && moves {
                let step = self.pose_at_key(next).after(&self.pose_at_key(next - 1).inverse());
                jump = Some(jump.map_or(step, |jump| step.after(&jump)));
            }
        }
        jump
    }

    fn pose_at_key(&self, key: usize) -> Pose {
        self.turned(self.keys[key].translation, self.keys[key].turn)
    }

    fn turned(&self, translation: DVec3, turn: DVec3) -> Pose {
        let rotation = DQuat::from_euler(EulerRot::YXZ, turn.x, turn.y, turn.z);
        Pose::new(rotation, self.pivot + translation - rotation * self.pivot)
    }

    /// The slopes of `value` at both ends of the smooth interval that begins at `key`.
    fn slopes(&self, key: usize, value: impl Fn(&Keyframe) -> DVec3) -> [DVec3; 2] {
        let interval = |key: usize| {
            let (from, to) = (self.keys.get(key)?, self.keys.get(key + 1)?);
            let span = to.time_secs - from.time_secs;
            let interpolation = from.interpolation;
            let secant = || (value(to) - value(from)) / span;
            (interpolation != KeyframeInterpolation::Hold).then(|| Interval {
                secant: secant(),
                span,
                interpolation,
            })
        };
        let own = interval(key);
        [key.checked_sub(1), Some(key + 1)].map(|beside| match (&own, beside.and_then(interval)) {
            (Some(own), Some(beside)) => {
                DVec3::from_array(std::array::from_fn(|axis| slope(own, &beside, axis)))
            }
            _ => DVec3::ZERO,
        })
    }
}

/// The time between two keys.
struct Interval {
    /// Change over time of three components.
    secant: DVec3,
    span: f64,
    interpolation: KeyframeInterpolation,
}

/// The slope of component `axis` at the key between a smooth interval and the one `beside` it.
fn slope(own: &Interval, beside: &Interval, axis: usize) -> f64 {
    let (d, e) = (own.secant[axis], beside.secant[axis]);
    if d * e <= 0.0 {
        return 0.0;
    }
    let most = if beside.interpolation == KeyframeInterpolation::Linear {
        e.abs().min(3.0 * d.abs())
    } else {
        // (1); the sum of the signs is ±2.
        let parabola = (d * beside.span + e * own.span).abs() / (own.span + beside.span);
        (2.0 * d.abs().min(e.abs())).min(parabola)
    };
    most.copysign(d)
}

/// Hermite weights at `u` of a cubic over `span` seconds: value and slope at its start, value and
/// slope at its end.
fn hermite(u: f64, span: f64) -> [f64; 4] {
    let v = 1.0 - u;
    [(1.0 + 2.0 * u) * v * v, u * v * v * span, u * u * (3.0 - 2.0 * u), -u * u * v * span]
}

#[cfg(feature = "serde")]
mod raw {
    //! The keys in the form in which a file stores them.

    use super::{DVec3, Keyframe, KeyframesError};

    #[derive(Clone, serde::Serialize, serde::Deserialize)]
    #[serde(deny_unknown_fields)]
    pub(super) struct Keyframes {
        keys: Vec<Keyframe>,
        #[serde(default)]
        pivot: DVec3,
    }

    impl TryFrom<Keyframes> for super::Keyframes {
        type Error = KeyframesError;

        fn try_from(raw: Keyframes) -> Result<Self, KeyframesError> {
            Self::new(raw.keys, raw.pivot)
        }
    }

    impl From<super::Keyframes> for Keyframes {
        fn from(motion: super::Keyframes) -> Self {
            Self { keys: motion.keys, pivot: motion.pivot }
        }
    }
}

#[cfg(test)]
mod tests;
