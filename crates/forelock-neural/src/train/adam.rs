//! Adam (Kingma and Ba 2015).

use forelock_core::lane::Real;
use rayon::prelude::*;

/// What a step keeps of the mean and of the mean square, by default.
const DECAY: [f64; 2] = [0.9, 0.999];
/// Added to the root of the mean square.
const LEAST: f64 = 1e-8;
/// Parameters that a task updates.
const CHUNK: usize = 1 << 14;

/// The moments of the gradient.
#[derive(Clone, Debug)]
pub(crate) struct Adam<T> {
    decay: [f64; 2],
    steps: u32,
    first: Vec<T>,
    second: Vec<T>,
}

impl<T: Real> Adam<T> {
    pub(crate) fn new(parameters: usize) -> Self {
        Self::with_decay(DECAY, parameters)
    }

    /// One that keeps these shares of the mean and of the mean square.
    pub(crate) fn with_decay(decay: [f64; 2], parameters: usize) -> Self {
        Self { decay, steps: 0, first: vec![T::zero(); parameters], second: vec![T::zero(); parameters] }
    }

    /// Steps done.
    pub(crate) fn steps(&self) -> u32 {
        self.steps
    }

    /// The moments, which [`Adam::resume`] takes.
    pub(crate) fn moments(&self) -> [&[T]; 2] {
        [&self.first, &self.second]
    }

    /// The moments, to be changed.
    pub(crate) fn moments_mut(&mut self) -> [&mut [T]; 2] {
        [&mut self.first, &mut self.second]
    }

    /// Goes on after `steps` steps with these moments.
    pub(crate) fn resume(&mut self, steps: u32, [first, second]: [Vec<T>; 2]) {
        (self.steps, self.first, self.second) = (steps, first, second);
    }

    /// Moves `parameters` along `scale` times the gradient, at `rate`.
    pub(crate) fn step(&mut self, parameters: &mut [T], gradient: &[T], [rate, scale]: [f64; 2]) {
        self.steps += 1;
        let number = |x: f64| T::from(x).unwrap_or_else(T::zero);
        let steps = i32::try_from(self.steps).unwrap_or(i32::MAX);
        let corrections = self.decay.map(|decay| 1.0 - decay.powi(steps));
        let (keep, take) = (self.decay.map(number), self.decay.map(|decay| number(1.0 - decay)));
        let [rate, over_second] = [rate / corrections[0], 1.0 / corrections[1]].map(number);
        let [scale, least] = [scale, LEAST].map(number);
        let moments = self.first.par_chunks_mut(CHUNK).zip(self.second.par_chunks_mut(CHUNK));
        parameters.par_chunks_mut(CHUNK).zip(gradient.par_chunks(CHUNK)).zip(moments).for_each(
            |((parameters, gradient), (first, second))| {
                for (((p, g), m), v) in parameters.iter_mut().zip(gradient).zip(first).zip(second) {
                    let g = scale * *g;
                    *m = keep[0] * *m + take[0] * g;
                    *v = keep[1] * *v + take[1] * g * g;
                    *p = *p - rate * *m / ((*v * over_second).sqrt() + least);
                }
            },
        );
    }
}
