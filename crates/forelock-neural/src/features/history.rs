//! The pose history of a running simulation.

use super::{
    BodyPose, FeatureError, Features, HISTORY, Rates, SHAPE_NUMBERS, SHARED_NUMBERS, SPACING_SECS,
    check_time, pose_numbers, shared,
};

/// The oldest pose that an input depends on: the acceleration of the oldest entry spans two more.
const REACH: usize = HISTORY + 1;

/// The recent poses of a body, at any frame rate. The inputs of the network are read off at the
/// newest pose and at steps of [`SPACING_SECS`] before it, between frames by interpolation; before
/// the first frame the body is still.
///
/// The history is state: a snapshot holds it ([`Clone`], or [`Self::samples`] and
/// [`Self::from_samples`]), and a restored one gives the same inputs bit for bit.
///
/// ```
/// use forelock_core::pose::Pose;
/// use forelock_neural::features::{BodyPose, Features, HeadMotion, PoseHistory};
/// use glam::{DQuat, DVec3};
///
/// let features = Features::new(DVec3::new(0.0, 9.0, 2.0), HeadMotion::Velocity)?;
/// let still = Pose::IDENTITY;
/// let mut body = BodyPose { root: still, spine: still, neck: still, head: still };
/// let mut history = PoseHistory::still(body)?;
/// // The head nods by 0.01 radians in 1/60 s.
/// body.head.rotation = DQuat::from_rotation_x(0.01);
/// history.push(body, 1.0 / 60.0)?;
/// let inputs = history.inputs(&features, &[0.0; 10]);
/// // Within 1/30 s it turned by 0.01 radians: 0.3 1/s, a tenth of the scale.
/// assert!((inputs[21] - 0.1).abs() < 1e-6);
/// # Ok::<(), forelock_neural::features::FeatureError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct PoseHistory {
    /// Age in seconds and pose, newest (age 0) first; never empty.
    samples: Vec<(f64, BodyPose)>,
}

impl PoseHistory {
    /// The history of a body that has always been still in `pose`.
    ///
    /// # Errors
    /// If a joint's pose is not rigid.
    pub fn still(pose: BodyPose) -> Result<Self, FeatureError> {
        pose.check(0)?;
        Ok(Self { samples: vec![(0.0, pose)] })
    }

    /// Adds the pose `dt` seconds after the newest one.
    ///
    /// # Errors
    /// If a joint's pose is not rigid, or `dt` is not positive and finite. The history is as before
    /// then.
    pub fn push(&mut self, pose: BodyPose, dt: f64) -> Result<(), FeatureError> {
        pose.check(0)?;
        check_time(dt)?;
        for (age, _) in &mut self.samples {
            *age += dt;
        }
        // One sample at or beyond the reach is kept: the oldest input lies before it.
        let reach = REACH as f64 * SPACING_SECS;
        if let Some(beyond) = self.samples.iter().position(|&(age, _)| age >= reach) {
            self.samples.truncate(beyond + 1);
        }
        self.samples.insert(0, (0.0, pose));
        Ok(())
    }

    /// Forgets the past: the body has always been still in `pose`. For teleports and cuts.
    ///
    /// # Errors
    /// If a joint's pose is not rigid. The history is as before then.
    pub fn refill(&mut self, pose: BodyPose) -> Result<(), FeatureError> {
        *self = Self::still(pose)?;
        Ok(())
    }

    /// The newest pose.
    pub fn newest(&self) -> &BodyPose {
        &self.samples[0].1
    }

    /// The poses with their ages in seconds, newest first.
    pub fn samples(&self) -> &[(f64, BodyPose)] {
        &self.samples
    }

    /// The history that had these [`samples`](Self::samples).
    ///
    /// # Errors
    /// If there are none, a joint's pose is not rigid, the first age is not 0, or an age is not
    /// greater than the one before.
    pub fn from_samples(samples: Vec<(f64, BodyPose)>) -> Result<Self, FeatureError> {
        let first = samples.first().ok_or(FeatureError::Empty)?;
        if first.0 != 0.0 {
            return Err(FeatureError::Time(first.0));
        }
        samples.iter().enumerate().try_for_each(|(frame, (_, pose))| pose.check(frame))?;
        samples.windows(2).try_for_each(|pair| check_time(pair[1].0 - pair[0].0))?;
        Ok(Self { samples })
    }

    /// The shared inputs of the network at the newest pose, in float64. `shape` is copied.
    pub fn numbers(&self, features: &Features, shape: &[f64; SHAPE_NUMBERS]) -> [f64; SHARED_NUMBERS] {
        let poses: [BodyPose; REACH + 1] = std::array::from_fn(|step| self.at(step));
        let rates: [Rates; REACH] =
            std::array::from_fn(|step| features.rates(&poses[step], &poses[step + 1]));
        let pose = pose_numbers(&poses[0], &rates[0]);
        shared(&pose, shape, |entry| {
            features.velocity_numbers(&poses[entry], &rates[entry], &rates[entry + 1])
        })
    }

    /// The shared inputs of the network at the newest pose. `shape` is copied.
    pub fn inputs(&self, features: &Features, shape: &[f64; SHAPE_NUMBERS]) -> [f32; SHARED_NUMBERS] {
        self.numbers(features, shape).map(|number| number as f32)
    }

    /// The pose `step` spacings before the newest one.
    fn at(&self, step: usize) -> BodyPose {
        let age = step as f64 * SPACING_SECS;
        let older = self.samples.partition_point(|&(sample, _)| sample < age);
        match (self.samples.get(older), older.checked_sub(1)) {
            (Some(&(_, pose)), None) => pose,
            (Some((old, from)), Some(newer)) => {
                let (new, to) = &self.samples[newer];
                from.interpolate(to, (old - age) / (old - new))
            }
            (None, _) => self.samples[self.samples.len() - 1].1,
        }
    }
}
