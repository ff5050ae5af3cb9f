//! Gusts: a smooth random function of time.
//!
//! # Theory
//! n(τ) = Σ √(2/N) cos 2π(f_j τ + φ_j), over N frequencies from 0.4 to 1.6 a period, evenly spaced in their logarithm and each drawn within its
//! share: mean 0 and variance 1 over a long time (Rice 1944, "Mathematical analysis of random noise").

use std::f64::consts::TAU;

use crate::groom::grow::random::Random;

const WAVES: usize = 12;

/// Frequencies a period and phases in turns.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Gusts([(f64, f64); WAVES]);

impl Gusts {
    pub(super) fn new(seed: u64) -> Self {
        let mut random = Random::new(seed, 0x6757);
        Self(std::array::from_fn(|j| {
            #[expect(clippy::cast_precision_loss, reason = "one of twelve")]
            let share = (j as f64 + f64::from(random.unit())) / WAVES as f64;
            (0.4 * 4f64.powf(share), f64::from(random.unit()))
        }))
    }

    /// n at `periods`, between −√(2N) and √(2N).
    pub(super) fn at(&self, periods: f64) -> f64 {
        #[expect(clippy::cast_precision_loss, reason = "twelve")]
        let amplitude = (2.0 / WAVES as f64).sqrt();
        self.0.iter().map(|(f, phase)| amplitude * (TAU * (f * periods + phase)).cos()).sum()
    }
}
