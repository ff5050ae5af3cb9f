//! Training of the rigged variant's network.

use super::chain::{Angles, Rig};
use super::network::{PoseNetwork, WEIGHTS};
use super::pose::RigPose;
use super::vec3::num;
use super::{ANGLES, RigError};
use crate::random::Random;
use crate::train::adam::Adam;
use forelock_core::lane::Real;
use std::f64::consts::PI;

/// Settings of the training.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrainSettings {
    /// Steps: 6,000 by default.
    pub steps: u32,
    /// Poses of a step: 64 by default.
    pub batch: u32,
    /// Learning rate of Adam at the start: 3e-3 by default. It falls to 2 % along a cosine.
    pub rate: f64,
    /// Seed of the first weights and of the poses drawn: 1 by default.
    pub seed: u64,
}

impl Default for TrainSettings {
    fn default() -> Self {
        Self { steps: 6000, batch: 64, rate: 3e-3, seed: 1 }
    }
}

/// Trains a network for `rig`: Adam on the mean energy of `batch` poses a step, drawn at random
/// from `poses`. One seed gives the same weights, bit for bit, on the same machine.
///
/// # Errors
/// If there are no poses, one is not finite, a setting is zero or not finite, or the training
/// diverges.
pub fn train<T: Real>(
    rig: &Rig<T>,
    poses: &[RigPose<T>],
    settings: &TrainSettings,
) -> Result<PoseNetwork<T>, RigError> {
    check(poses, settings)?;
    let bodies: Vec<_> = poses.iter().map(|pose| rig.body(pose)).collect();
    let mut random = Random::new(settings.seed);
    let mut network = PoseNetwork::random(&mut random);
    let mut adam = Adam::new(WEIGHTS);
    let mut gradient = vec![T::zero(); WEIGHTS];
    let share = num::<T>(1.0 / f64::from(settings.batch));
    for step in 0..settings.steps {
        gradient.fill(T::zero());
        for _ in 0..settings.batch {
            let drawn = random.below(poses.len());
            let trace = network.trace(&poses[drawn]);
            let mut slopes: Angles<T> = [T::zero(); ANGLES];
            rig.energy(&bodies[drawn], &trace.angles, &mut slopes);
            let slopes = slopes.map(|slope| slope * share);
            network.add_gradient(&trace, &slopes, &mut gradient);
        }
        let passed = f64::from(step) / f64::from(settings.steps);
        let rate = settings.rate * (0.02 + 0.49 * (1.0 + (PI * passed).cos()));
        adam.step(network.weights_mut(), &gradient, [rate, 1.0]);
        if !network.weights().iter().all(|w| w.is_finite()) {
            return Err(RigError::Diverged(step));
        }
    }
    Ok(network)
}

fn check<T: Real>(poses: &[RigPose<T>], settings: &TrainSettings) -> Result<(), RigError> {
    if poses.is_empty() {
        return Err(RigError::NoPoses);
    }
    poses.iter().enumerate().try_for_each(|(number, pose)| pose.check(number))?;
    if settings.steps == 0 {
        return Err(RigError::Setting("steps"));
    }
    if settings.batch == 0 {
        return Err(RigError::Setting("batch"));
    }
    if !(settings.rate > 0.0 && settings.rate.is_finite()) {
        return Err(RigError::Setting("rate"));
    }
    Ok(())
}
