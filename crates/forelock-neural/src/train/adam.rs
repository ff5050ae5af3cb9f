//! Adam (Kingma and Ba 2015).

use rayon::prelude::*;

const FIRST: f32 = 0.9;
const SECOND: f32 = 0.999;
const LEAST: f32 = 1e-8;
/// Parameters that a task updates.
const CHUNK: usize = 1 << 14;

/// The moments of the gradient.
#[derive(Clone, Debug)]
pub(crate) struct Adam {
    steps: i32,
    first: Vec<f32>,
    second: Vec<f32>,
}

impl Adam {
    pub(crate) fn new(parameters: usize) -> Self {
        Self { steps: 0, first: vec![0.0; parameters], second: vec![0.0; parameters] }
    }

    /// Moves `parameters` along `scale` times the gradient, at `rate`.
    pub(crate) fn step(&mut self, parameters: &mut [f32], gradient: &[f32], [rate, scale]: [f64; 2]) {
        self.steps += 1;
        let corrections = [FIRST, SECOND].map(|decay| 1.0 - f64::from(decay).powi(self.steps));
        let rate = (rate / corrections[0]) as f32;
        let over_second = (1.0 / corrections[1]) as f32;
        let scale = scale as f32;
        let moments = self.first.par_chunks_mut(CHUNK).zip(self.second.par_chunks_mut(CHUNK));
        parameters.par_chunks_mut(CHUNK).zip(gradient.par_chunks(CHUNK)).zip(moments).for_each(
            |((parameters, gradient), (first, second))| {
                for (((p, g), m), v) in parameters.iter_mut().zip(gradient).zip(first).zip(second) {
                    let g = scale * g;
                    *m = FIRST * *m + (1.0 - FIRST) * g;
                    *v = SECOND * *v + (1.0 - SECOND) * g * g;
                    *p -= rate * *m / ((*v * over_second).sqrt() + LEAST);
                }
            },
        );
    }
}
