//! Clips: the transforms of joints and the weights of blend shapes over time.

use glam::{DQuat, DVec3};

use super::skeleton::{Skeleton, Transform};
use crate::pose::slerp;

/// How a track passes from one key to the next.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Interpolation {
    /// It holds a key until the next one.
    Step,
    /// Linear; rotations are interpolated spherically, along the shorter arc.
    #[default]
    Linear,
    /// Cubic Hermite with tangents: three values a key, of which the first and the last are the
    /// derivatives before and after it, per second (glTF 2.0, appendix C).
    Cubic,
}

/// What a track drives, and its values.
#[derive(Clone, Debug, PartialEq)]
pub enum Values {
    /// Translation of a joint.
    Translation(Vec<DVec3>),
    /// Rotation of a joint.
    Rotation(Vec<DQuat>),
    /// Scale of a joint.
    Scale(Vec<DVec3>),
    /// Weights of consecutive blend shapes, all of a key one after the other.
    Shapes {
        /// The first shape.
        first: usize,
        /// Number of shapes.
        count: usize,
        /// The weights.
        weights: Vec<f64>,
    },
}

/// One property over time.
#[derive(Clone, Debug, PartialEq)]
pub struct Track {
    /// The joint; without meaning for the weights of shapes.
    pub joint: usize,
    /// Times of the keys, seconds, ascending.
    pub times: Vec<f64>,
    /// How it is interpolated.
    pub interpolation: Interpolation,
    /// The values: one a key, three with [`Interpolation::Cubic`].
    pub values: Values,
}

/// Why a track cannot be played.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TrackError {
    /// It has no keys.
    #[error("it has no keys")]
    Empty,
    /// Times are not ascending or not finite.
    #[error("its times do not ascend at key {0}")]
    Times(usize),
    /// Keys and values do not match.
    #[error("it has {keys} keys and {values} values, but needs {needed}")]
    Count {
        /// Number of keys.
        keys: usize,
        /// Number of values.
        values: usize,
        /// Number of values that the keys need.
        needed: usize,
    },
    /// A value is not finite.
    #[error("its value {0} is not finite")]
    NonFinite(usize),
}

impl Track {
    /// Checks that the track can be played, and normalises rotations.
    ///
    /// # Errors
    /// [`TrackError`] if it cannot.
    pub fn check(&mut self) -> Result<(), TrackError> {
        if self.times.is_empty() {
            return Err(TrackError::Empty);
        }
        let ascends =
            |i: &usize| !(self.times[*i].is_finite() && (*i == 0 || self.times[i - 1] <= self.times[*i]));
        if let Some(key) = (0..self.times.len()).find(ascends) {
            return Err(TrackError::Times(key));
        }
        let (values, finite, width) = match &self.values {
            Values::Translation(own) | Values::Scale(own) => {
                (own.len(), own.iter().position(|v| !v.is_finite()), 1)
            }
            Values::Rotation(own) => (own.len(), own.iter().position(|v| !v.is_finite()), 1),
            Values::Shapes { count, weights, .. } => {
                (weights.len(), weights.iter().position(|v| !v.is_finite()), *count)
            }
        };
        let is_cubic = self.interpolation == Interpolation::Cubic;
        let needed = self.times.len() * width * if is_cubic { 3 } else { 1 };
        if values != needed {
            return Err(TrackError::Count { keys: self.times.len(), values, needed });
        }
        if let Some(value) = finite {
            return Err(TrackError::NonFinite(value));
        }
        if let Values::Rotation(own) = &mut self.values {
            for (i, q) in own.iter_mut().enumerate() {
                if !is_cubic || i % 3 == 1 {
                    *q = if q.length_squared() > 1e-12 { q.normalize() } else { DQuat::IDENTITY };
                }
            }
        }
        Ok(())
    }

    /// The key before `secs`, the share of the way to the next one, and that way's length, seconds.
    fn locate(&self, secs: f64) -> (usize, f64, f64) {
        let after = self.times.partition_point(|&time| time <= secs);
        if after == 0 {
            return (0, 0.0, 0.0);
        }
        let key = after - 1;
        let Some(&next) = self.times.get(after) else { return (key, 0.0, 0.0) };
        let length = next - self.times[key];
        (key, (secs - self.times[key]) / length, length)
    }

    /// The value at `secs` of values that `hermite` combines with four weights and `between` with
    /// a share; the first and the last hold before and after the track.
    fn at<V: Copy>(
        &self,
        secs: f64,
        value: impl Fn(usize) -> V,
        between: impl Fn(V, V, f64) -> V,
        hermite: impl Fn([V; 4], [f64; 4]) -> V,
    ) -> V {
        let (key, share, length) = self.locate(secs);
        match self.interpolation {
            Interpolation::Step => value(key),
            Interpolation::Linear if share == 0.0 => value(key),
            Interpolation::Linear => between(value(key), value(key + 1), share),
            Interpolation::Cubic if share == 0.0 => value(3 * key + 1),
            Interpolation::Cubic => {
                let (s, s2, s3) = (share, share * share, share * share * share);
                let weights = [
                    2.0 * s3 - 3.0 * s2 + 1.0,
                    length * (s3 - 2.0 * s2 + s),
                    -2.0 * s3 + 3.0 * s2,
                    length * (s3 - s2),
                ];
                let at = 3 * key;
                hermite([value(at + 1), value(at + 2), value(at + 4), value(at + 3)], weights)
            }
        }
    }

    /// Sets what the track drives to its value at `secs`.
    fn apply(&self, secs: f64, locals: &mut [Transform], shapes: &mut [f64]) {
        let vector = |own: &[DVec3]| {
            let hermite = |v: [DVec3; 4], w: [f64; 4]| (0..4).map(|i| v[i] * w[i]).sum::<DVec3>();
            self.at(secs, |i| own[i], |a, b, share| a.lerp(b, share), hermite)
        };
        match &self.values {
            Values::Translation(own) => locals[self.joint].translation = vector(own),
            Values::Scale(own) => locals[self.joint].scale = vector(own),
            Values::Rotation(own) => {
                let hermite = |v: [DQuat; 4], w: [f64; 4]| {
                    let sum = (1..4).fold(v[0] * w[0], |sum, i| sum + v[i] * w[i]);
                    if sum.length_squared() > 1e-12 { sum.normalize() } else { v[0] }
                };
                locals[self.joint].rotation = self.at(secs, |i| own[i], slerp, hermite);
            }
            Values::Shapes { first, count, weights } => {
                // Those who only pose joints pass no shapes.
                for (shape, own) in shapes.iter_mut().skip(*first).take(*count).enumerate() {
                    let hermite = |v: [f64; 4], w: [f64; 4]| (0..4).map(|i| v[i] * w[i]).sum();
                    *own = self.at(secs, |i| weights[i * count + shape], |a, b, s| a + (b - a) * s, hermite);
                }
            }
        }
    }
}

/// The motion of a skeleton and of blend shapes over time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Clip {
    /// Its name; may be empty.
    pub name: String,
    /// Its tracks. What none drives is at rest.
    pub tracks: Vec<Track>,
}

impl Clip {
    /// The time of the last key, seconds.
    pub fn duration_secs(&self) -> f64 {
        self.tracks.iter().filter_map(|track| track.times.last()).fold(0.0, |a, &b| a.max(b))
    }

    /// Sets `locals` (one a joint) and `shapes` (the weights of the blend shapes) to the clip's
    /// values at `secs`; what it does not drive is left as it is.
    ///
    /// # Panics
    /// If a track drives a joint that is not there: see [`Clip::check`]. Shapes that are not there
    /// are passed over.
    pub fn sample(&self, secs: f64, locals: &mut [Transform], shapes: &mut [f64]) {
        for track in &self.tracks {
            track.apply(secs, locals, shapes);
        }
    }

    /// Whether every track drives a joint of `skeleton` or one of `shapes` blend shapes.
    pub fn check(&self, skeleton: &Skeleton, shapes: usize) -> bool {
        self.tracks.iter().all(|track| match track.values {
            Values::Shapes { first, count, .. } => first + count <= shapes,
            _ => track.joint < skeleton.joints().len(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn track(times: &[f64], interpolation: Interpolation, values: Values) -> Track {
        let mut track = Track { joint: 0, times: times.into(), interpolation, values };
        track.check().unwrap();
        track
    }

    fn x(track: &Track, secs: f64) -> f64 {
        let mut locals = [Transform::IDENTITY];
        track.apply(secs, &mut locals, &mut []);
        locals[0].translation.x
    }

    #[test]
    fn keys_are_held_joined_or_smoothed() {
        let of = |values: &[f64]| Values::Translation(values.iter().map(|&v| DVec3::X * v).collect());
        let step = track(&[1.0, 2.0, 3.0], Interpolation::Step, of(&[1.0, 5.0, 7.0]));
        assert_eq!([0.0, 1.0, 1.99, 2.0, 9.0].map(|t| x(&step, t)), [1.0, 1.0, 1.0, 5.0, 7.0]);
        let linear = track(&[1.0, 2.0, 3.0], Interpolation::Linear, of(&[1.0, 5.0, 7.0]));
        assert_eq!([0.0, 1.5, 2.0, 2.5, 3.0].map(|t| x(&linear, t)), [1.0, 3.0, 5.0, 6.0, 7.0]);
        // t³ over two seconds from its values and derivatives at 0 and 2.
        let cubic = track(&[0.0, 2.0], Interpolation::Cubic, of(&[9.0, 0.0, 0.0, 12.0, 8.0, 9.0]));
        for t in [0.0, 0.3, 1.0, 1.7, 2.0] {
            assert!((x(&cubic, t) - t.powi(3)).abs() < 1e-14);
        }
    }

    #[test]
    fn rotations_take_the_shorter_arc_at_constant_speed() {
        let turn = |angle: f64| DQuat::from_rotation_y(angle);
        let own =
            track(&[0.0, 1.0], Interpolation::Linear, Values::Rotation(vec![turn(0.1), -turn(1.1) * 3.0]));
        let mut locals = [Transform::IDENTITY];
        for share in [0.0, 0.25, 0.9] {
            own.apply(share, &mut locals, &mut []);
            assert!(locals[0].rotation.angle_between(turn(0.1 + share)) < 1e-7);
        }
    }

    #[test]
    fn shapes_are_driven_side_by_side() {
        let values = Values::Shapes { first: 1, count: 2, weights: vec![0.0, 1.0, 1.0, 0.5] };
        let own = track(&[0.0, 1.0], Interpolation::Linear, values);
        let mut shapes = [9.0; 4];
        own.apply(0.5, &mut [], &mut shapes);
        assert_eq!(shapes, [9.0, 0.5, 0.75, 9.0]);
    }

    #[test]
    fn broken_tracks_are_refused() {
        let own = |times: &[f64], count: usize| Track {
            joint: 0,
            times: times.into(),
            interpolation: Interpolation::Linear,
            values: Values::Scale(vec![DVec3::ONE; count]),
        };
        assert_eq!(own(&[], 0).check(), Err(TrackError::Empty));
        assert_eq!(own(&[0.0, 2.0, 1.0], 3).check(), Err(TrackError::Times(2)));
        assert_eq!(own(&[0.0, f64::NAN], 2).check(), Err(TrackError::Times(1)));
        assert_eq!(own(&[0.0], 2).check(), Err(TrackError::Count { keys: 1, values: 2, needed: 1 }));
        let mut bad = own(&[0.0], 1);
        bad.values = Values::Scale(vec![DVec3::NAN]);
        assert_eq!(bad.check(), Err(TrackError::NonFinite(0)));
    }
}
