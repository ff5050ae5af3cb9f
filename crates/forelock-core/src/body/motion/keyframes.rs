//! Keyframe motion: poses at given times, interpolated in between.
//!
//! # Theory
//! Linear interpolation: linear in the translation, constant speed along the shorter arc in the
//! rotation. Smooth interpolation: cubic Hermite pieces whose slope at each key is that of the
//! parabola through the key and its neighbours (Catmull and Rom 1974, for uneven times), for the
//! translation and for the four components of the rotation, which is then normalised. The slopes at
//! the ends are zero, so the motion starts and stops at rest.
//!
//! # Limitations
//! Smooth motion is once continuously differentiable: accelerations are discontinuous at the keys.
//! A rotation of more than half a turn between two keys takes the shorter arc.

use glam::{DQuat, DVec4};

use crate::pose::Pose;

/// Poses at increasing times.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(try_from = "raw::Keyframes", into = "raw::Keyframes")
)]
pub struct Keyframes {
    times: Vec<f64>,
    poses: Vec<Pose>,
    interpolation: KeyframeInterpolation,
}

/// Interpolation between two keys.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "kebab-case"))]
pub enum KeyframeInterpolation {
    /// A smooth curve through all keys.
    #[default]
    Smooth,
    /// Linear interpolation at constant speed.
    Linear,
}

/// Why keys do not form a motion.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum KeyframesError {
    /// There are no keys.
    #[error("a motion needs at least one keyframe")]
    Empty,
    /// The numbers of times and poses differ.
    #[error("there are {times} times, but {poses} poses")]
    Length {
        /// Times given.
        times: usize,
        /// Poses given.
        poses: usize,
    },
    /// The time of this key is not finite or not later than that of the key before.
    #[error("the time of keyframe {0} is not later than the time of the keyframe before it")]
    Order(usize),
    /// The pose of this key is not finite, or its rotation is zero.
    #[error("the pose of keyframe {0} is not finite or has a zero rotation")]
    Pose(usize),
}

impl Keyframes {
    /// Creates the motion through `poses` at `times` (seconds, increasing). It stays at the first
    /// pose before the first time and at the last pose after the last time. Rotations are
    /// normalised.
    ///
    /// # Errors
    /// [`KeyframesError`] if there are no keys, the numbers of times and poses differ, the times do
    /// not increase, or a pose is invalid.
    pub fn new(
        times: Vec<f64>,
        mut poses: Vec<Pose>,
        interpolation: KeyframeInterpolation,
    ) -> Result<Self, KeyframesError> {
        if times.len() != poses.len() {
            return Err(KeyframesError::Length { times: times.len(), poses: poses.len() });
        }
        if times.is_empty() {
            return Err(KeyframesError::Empty);
        }
        let late = |key: usize| times[key].is_finite() && (key == 0 || times[key] > times[key - 1]);
        if let Some(key) = (0..times.len()).find(|&key| !late(key)) {
            return Err(KeyframesError::Order(key));
        }
        let mut before = DQuat::IDENTITY;
        for (key, pose) in poses.iter_mut().enumerate() {
            let length = pose.rotation.length();
            if !(pose.is_finite() && length > 1e-6 && length.is_finite()) {
                return Err(KeyframesError::Pose(key));
            }
            if (length - 1.0).abs() > 1e-9 {
                pose.rotation = pose.rotation.normalize();
            }
            // q and −q are the same rotation: choose the one nearer to the previous key.
            if pose.rotation.dot(before) < 0.0 {
                pose.rotation = -pose.rotation;
            }
            before = pose.rotation;
        }
        Ok(Self { times, poses, interpolation })
    }

    /// The pose at `time` seconds.
    pub fn pose(&self, time: f64) -> Pose {
        let next = self.times.partition_point(|&t| t <= time);
        if next == 0 {
            return self.poses[0];
        }
        let key = next - 1;
        if next == self.times.len() {
            return self.poses[key];
        }
        let span = self.times[next] - self.times[key];
        let u = (time - self.times[key]) / span;
        match self.interpolation {
            KeyframeInterpolation::Linear => self.poses[key].interpolate(&self.poses[next], u),
            KeyframeInterpolation::Smooth => {
                let translation = [
                    self.translation(key),
                    self.translation_slope(key),
                    self.translation(next),
                    self.translation_slope(next),
                ];
                let rotation = [
                    self.rotation(key),
                    self.rotation_slope(key),
                    self.rotation(next),
                    self.rotation_slope(next),
                ];
                let [a, b, c, d] = hermite(u, span);
                let blend = |v: [DVec4; 4]| v[0] * a + v[1] * b + v[2] * c + v[3] * d;
                Pose::new(DQuat::from_vec4(blend(rotation)), blend(translation).truncate())
            }
        }
    }

    fn translation(&self, key: usize) -> DVec4 {
        self.poses[key].translation.extend(0.0)
    }

    fn rotation(&self, key: usize) -> DVec4 {
        DVec4::from(self.poses[key].rotation)
    }

    fn translation_slope(&self, key: usize) -> DVec4 {
        self.slope(key, |key| self.translation(key))
    }

    fn rotation_slope(&self, key: usize) -> DVec4 {
        self.slope(key, |key| self.rotation(key))
    }

    /// The slope at `key` of the parabola through it and its neighbours; zero at the ends.
    fn slope(&self, key: usize, value: impl Fn(usize) -> DVec4) -> DVec4 {
        if key == 0 || key + 1 == self.times.len() {
            return DVec4::ZERO;
        }
        let (before, after) = (self.times[key] - self.times[key - 1], self.times[key + 1] - self.times[key]);
        let rise = (value(key) - value(key - 1)) / before;
        let next = (value(key + 1) - value(key)) / after;
        (rise * after + next * before) / (before + after)
    }
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

    use super::{KeyframeInterpolation, KeyframesError, Pose};

    #[derive(Clone, serde::Serialize, serde::Deserialize)]
    #[serde(deny_unknown_fields)]
    pub(super) struct Keyframes {
        times: Vec<f64>,
        poses: Vec<Pose>,
        #[serde(default)]
        interpolation: KeyframeInterpolation,
    }

    impl TryFrom<Keyframes> for super::Keyframes {
        type Error = KeyframesError;

        fn try_from(raw: Keyframes) -> Result<Self, KeyframesError> {
            Self::new(raw.times, raw.poses, raw.interpolation)
        }
    }

    impl From<super::Keyframes> for Keyframes {
        fn from(keys: super::Keyframes) -> Self {
            Self { times: keys.times, poses: keys.poses, interpolation: keys.interpolation }
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    fn keys(interpolation: KeyframeInterpolation) -> Keyframes {
        let pose = |yaw: f64, x: f64| Pose::new(-DQuat::from_rotation_y(yaw), DVec3::X * x);
        Keyframes::new(
            vec![0.0, 1.0, 1.5, 3.0],
            vec![pose(0.0, 0.0), pose(0.5, 1.0), pose(0.2, -1.0), pose(2.0, 0.5)],
            interpolation,
        )
        .unwrap()
    }

    #[test]
    fn the_motion_passes_through_its_keys() {
        for interpolation in [KeyframeInterpolation::Smooth, KeyframeInterpolation::Linear] {
            let keys = keys(interpolation);
            for (time, pose) in keys.times.iter().zip(&keys.poses) {
                for side in [-1e-9, 0.0, 1e-9] {
                    let got = keys.pose(time + side);
                    assert!((got.translation - pose.translation).length() < 1e-7);
                    assert!(got.rotation.dot(pose.rotation).abs() > 1.0 - 1e-12);
                }
            }
            assert_eq!(keys.pose(-5.0), keys.poses[0]);
            assert_eq!(keys.pose(50.0), keys.poses[3]);
        }
    }

    #[test]
    fn smooth_velocity_is_continuous_and_linear_is_not() {
        let jump = |interpolation| {
            let (keys, h, point) = (keys(interpolation), 1e-5, DVec3::new(0.1, 0.0, 0.3));
            let x = |t: f64| keys.pose(t).transform_point(point);
            let at = |t: f64| ((x(t + 2.0 * h) - x(t + h)) - (x(t - h) - x(t - 2.0 * h))).length() / h;
            keys.times.iter().map(|&t| at(t)).fold(0.0, f64::max)
        };
        assert!(jump(KeyframeInterpolation::Smooth) < 1e-2);
        assert!(jump(KeyframeInterpolation::Linear) > 1.0);
    }

    #[test]
    fn invalid_keys_are_refused() {
        let new = |times: Vec<f64>, poses| Keyframes::new(times, poses, KeyframeInterpolation::Linear);
        let pose = Pose::IDENTITY;
        let zero = Pose { rotation: DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0), ..pose };
        assert_eq!(new(vec![], vec![]), Err(KeyframesError::Empty));
        assert_eq!(new(vec![0.0], vec![]), Err(KeyframesError::Length { times: 1, poses: 0 }));
        assert_eq!(new(vec![0.0, 0.0], vec![pose; 2]), Err(KeyframesError::Order(1)));
        assert_eq!(new(vec![f64::NAN], vec![pose]), Err(KeyframesError::Order(0)));
        assert_eq!(new(vec![0.0], vec![zero]), Err(KeyframesError::Pose(0)));
    }

    #[cfg(feature = "serde")]
    #[test]
    fn keys_read_from_a_file_are_checked() {
        let text = serde_json::to_string(&keys(KeyframeInterpolation::Linear)).unwrap();
        assert_eq!(serde_json::from_str::<Keyframes>(&text).unwrap(), keys(KeyframeInterpolation::Linear));
        assert!(serde_json::from_str::<Keyframes>(r#"{"times": [], "poses": []}"#).is_err());
    }
}
