//! The network from the pose of the head to the angles of the joints.

use super::chain::Angles;
use super::pose::RigPose;
use super::vec3::num;
use super::{ANGLES, INPUTS, RigError};
use crate::random::Random;
use forelock_core::lane::Real;

/// Width of the two hidden layers.
pub(super) const HIDDEN: usize = 16;
/// Numbers of the first layer: weights, then biases.
const FIRST: usize = (INPUTS + 1) * HIDDEN;
/// Numbers of the second layer.
const SECOND: usize = (HIDDEN + 1) * HIDDEN;
/// Numbers of the network: weights and biases.
pub const WEIGHTS: usize = FIRST + SECOND + (HIDDEN + 1) * ANGLES;
/// Multiply–adds of a pose.
pub const MULTIPLY_ADDS: usize = INPUTS * HIDDEN + HIDDEN * HIDDEN + HIDDEN * ANGLES;

/// The network 9 → 16 → 16 → 60 with tanh after the hidden layers.
///
/// In float32, tanh is a rational function within 4e-7 of it, so a pose takes the same time and
/// gives the same numbers everywhere.
#[derive(Clone, Debug, PartialEq)]
pub struct PoseNetwork<T> {
    weights: Vec<T>,
}

/// What the gradient needs from a pose's evaluation.
pub(super) struct Trace<T> {
    inputs: [T; INPUTS],
    first: [T; HIDDEN],
    second: [T; HIDDEN],
    pub(super) angles: Angles<T>,
}

impl<T: Real> PoseNetwork<T> {
    /// The network with these weights, layer by layer: the matrix \[in, out\], then the biases.
    ///
    /// # Errors
    /// If there are not [`WEIGHTS`] finite numbers.
    pub fn new(weights: Vec<T>) -> Result<Self, RigError> {
        if weights.len() == WEIGHTS && weights.iter().all(|w| w.is_finite()) {
            Ok(Self { weights })
        } else {
            Err(RigError::Weights(weights.len()))
        }
    }

    /// Random weights to start training from: uniform within √(6/(in + out)), a tenth of that in
    /// the last layer, biases zero. The rig starts near its rest shape.
    pub(super) fn random(random: &mut Random) -> Self {
        let mut weights = Vec::with_capacity(WEIGHTS);
        for (inputs, outputs, size) in [(INPUTS, HIDDEN, 1.0), (HIDDEN, HIDDEN, 1.0), (HIDDEN, ANGLES, 0.1)] {
            let bound = size * (6.0 / (inputs + outputs) as f64).sqrt();
            weights.extend((0..inputs * outputs).map(|_| num::<T>(bound * random.signed())));
            weights.extend((0..outputs).map(|_| T::zero()));
        }
        Self { weights }
    }

    /// The weights, in the order of [`Self::new`].
    pub fn weights(&self) -> &[T] {
        &self.weights
    }

    pub(super) fn weights_mut(&mut self) -> &mut [T] {
        &mut self.weights
    }

    /// The angles of the rig in a pose. [`super::PosePredictor`] is faster.
    pub fn angles(&self, pose: &RigPose<T>) -> Angles<T> {
        self.trace(pose).angles
    }

    pub(super) fn trace(&self, pose: &RigPose<T>) -> Trace<T> {
        let (first, rest) = self.weights.split_at(FIRST);
        let (second, last) = rest.split_at(SECOND);
        let inputs = pose.inputs();
        let first = dense::<T, INPUTS, HIDDEN>(first, &inputs).map(tanh);
        let second = dense::<T, HIDDEN, HIDDEN>(second, &first).map(tanh);
        let angles = dense::<T, HIDDEN, ANGLES>(last, &second);
        Trace { inputs, first, second, angles }
    }

    /// Adds to `gradient` that of a function of the angles with the gradient `slopes`.
    pub(super) fn add_gradient(&self, trace: &Trace<T>, slopes: &Angles<T>, gradient: &mut [T]) {
        let (second, last) = self.weights[FIRST..].split_at(SECOND);
        let (first_gradient, rest) = gradient.split_at_mut(FIRST);
        let (second_gradient, last_gradient) = rest.split_at_mut(SECOND);
        let slopes = dense_gradient(last, &trace.second, slopes, last_gradient);
        let slopes = through_tanh(slopes, &trace.second);
        let slopes = dense_gradient(second, &trace.first, &slopes, second_gradient);
        let slopes = through_tanh(slopes, &trace.first);
        dense_gradient(&self.weights[..FIRST], &trace.inputs, &slopes, first_gradient);
    }
}

/// x W + b.
#[inline(always)]
fn dense<T: Real, const I: usize, const O: usize>(layer: &[T], x: &[T; I]) -> [T; O] {
    let (matrix, bias) = layer.split_at(I * O);
    let mut y = [T::zero(); O];
    y.copy_from_slice(&bias[..O]);
    for (row, &x) in matrix.as_chunks::<O>().0.iter().zip(x) {
        for (y, &w) in y.iter_mut().zip(row) {
            *y = *y + x * w;
        }
    }
    y
}

/// Adds to the layer's gradient and returns that with respect to its inputs.
#[inline(always)]
fn dense_gradient<T: Real, const I: usize, const O: usize>(
    layer: &[T],
    x: &[T; I],
    slopes: &[T; O],
    gradient: &mut [T],
) -> [T; I] {
    let (matrix, bias) = gradient.split_at_mut(I * O);
    for (b, &slope) in bias.iter_mut().zip(slopes) {
        *b = *b + slope;
    }
    let rows = layer.as_chunks::<O>().0.iter().zip(matrix.as_chunks_mut::<O>().0);
    let mut inputs = [T::zero(); I];
    for ((row, row_gradient), (&x, input)) in rows.zip(x.iter().zip(&mut inputs)) {
        for ((&w, g), &slope) in row.iter().zip(row_gradient).zip(slopes) {
            *g = *g + x * slope;
            *input = *input + w * slope;
        }
    }
    inputs
}

fn through_tanh<T: Real>(mut slopes: [T; HIDDEN], outputs: &[T; HIDDEN]) -> [T; HIDDEN] {
    for (slope, &y) in slopes.iter_mut().zip(outputs) {
        *slope = *slope * (T::one() - y * y);
    }
    slopes
}

/// tanh: in float64 the system's, in float32 Lambert's continued fraction at x/4, cut off after
/// seven terms, and tanh 2z = 2 tanh z/(1 + tanh² z) twice.
#[inline(always)]
fn tanh<T: Real>(x: T) -> T {
    if size_of::<T>() == size_of::<f64>() {
        return x.tanh();
    }
    // At 9, tanh is 1 in float32.
    let z = x.max(num(-9.0)).min(num(9.0)) * num(0.25);
    let q = z * z;
    let above = ((q + num(378.0)) * q + num(17_325.0)) * q + num(135_135.0);
    let below = ((q * num(28.0) + num(3150.0)) * q + num(62_370.0)) * q + num(135_135.0);
    let double = |t: T| (t + t) / (T::one() + t * t);
    double(double(z * above / below))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tanh_is_accurate_in_both_precisions() {
        for i in -24_000..24_000 {
            let x = f64::from(i) / 2000.0;
            assert!((f64::from(tanh(x as f32)) - f64::from(x as f32).tanh()).abs() < 4e-7, "{x}");
            assert_eq!(tanh(x), x.tanh());
        }
    }

    #[test]
    fn the_gradient_of_the_weights_agrees_with_finite_differences() {
        let mut random = Random::new(4);
        let mut network = PoseNetwork::<f64>::random(&mut random);
        let pose = super::super::PoseRange::default().draw(&mut random);
        let slopes: Angles<f64> = std::array::from_fn(|_| random.signed());
        let mut gradient = vec![0.0; WEIGHTS];
        network.add_gradient(&network.trace(&pose), &slopes, &mut gradient);
        let value = |network: &PoseNetwork<f64>| -> f64 {
            network.angles(&pose).iter().zip(&slopes).map(|(a, s)| a * s).sum()
        };
        let largest = gradient.iter().fold(0.0f64, |a, g| a.max(g.abs()));
        for (i, expected) in gradient.into_iter().enumerate() {
            let before = network.weights[i];
            let mut at = |step: f64| {
                network.weights[i] = before + step;
                value(&network)
            };
            let slope = (at(1e-5) - at(-1e-5)) / 2e-5;
            at(0.0);
            assert!((slope - expected).abs() < 1e-8 * largest.max(1.0), "{i}: {slope} {expected}");
        }
    }

    #[test]
    fn a_pose_takes_1360_multiply_adds_and_1452_numbers() {
        assert_eq!((MULTIPLY_ADDS, WEIGHTS), (1360, 1452));
        // One multiply–add for each weight that is not a bias.
        assert_eq!(WEIGHTS - (HIDDEN + HIDDEN + ANGLES), MULTIPLY_ADDS);
    }
}
