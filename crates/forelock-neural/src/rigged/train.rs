//! Training of the rigged variant's network.

use super::chain::{Angles, Rig};
use super::network::{PoseNetwork, WEIGHTS};
use super::pose::RigPose;
use super::vec3::num;
use super::{ANGLES, RigError};
use crate::random::Random;
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
    let mut adam = Adam::new();
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
        adam.step(network.weights_mut(), &gradient, rate);
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

/// Adam (Kingma and Ba 2015), β 0.9 and 0.999.
struct Adam<T> {
    mean: Vec<T>,
    square: Vec<T>,
    /// β₁ and β₂ to the power of the steps taken.
    decayed: [f64; 2],
}

const DECAY: [f64; 2] = [0.9, 0.999];

impl<T: Real> Adam<T> {
    fn new() -> Self {
        Self { mean: vec![T::zero(); WEIGHTS], square: vec![T::zero(); WEIGHTS], decayed: [1.0; 2] }
    }

    fn step(&mut self, weights: &mut [T], gradient: &[T], rate: f64) {
        for (power, decay) in self.decayed.iter_mut().zip(DECAY) {
            *power *= decay;
        }
        let unbias = self.decayed.map(|power| num::<T>(1.0 / (1.0 - power)));
        let (keep, take) = (DECAY.map(num::<T>), DECAY.map(|decay| num::<T>(1.0 - decay)));
        let (rate, least) = (num::<T>(rate), num::<T>(1e-8));
        let moments = self.mean.iter_mut().zip(&mut self.square);
        for ((w, &g), (mean, square)) in weights.iter_mut().zip(gradient).zip(moments) {
            *mean = keep[0] * *mean + take[0] * g;
            *square = keep[1] * *square + take[1] * g * g;
            *w = *w - rate * (*mean * unbias[0]) / ((*square * unbias[1]).sqrt() + least);
        }
    }
}
