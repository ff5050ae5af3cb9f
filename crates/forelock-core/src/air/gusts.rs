//! Gusts: a smooth random function of time.
//!
//! # Theory
//! n(τ) = Σ √(2/N) cos 2π(f_j τ + φ_j), with N frequencies between 0.4 and 1.6 per period. The
//! range is divided into N intervals of equal length in the logarithm, and one frequency is drawn
//! at random from each. Over a long time n has mean 0 and variance 1 (Rice 1944, "Mathematical
//! analysis of random noise").

use std::f64::consts::TAU;

use crate::groom::grow::random::Random;

const WAVES: usize = 12;

/// Pairs of a frequency (cycles per period) and a phase (turns).
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Gusts([(f64, f64); WAVES]);

impl Gusts {
    pub(super) fn new(seed: u64) -> Self {
        let mut random = Random::new(seed, 0x6757);
        Self(std::array::from_fn(|j| {
            #[expect(clippy::cast_precision_loss, reason = "an index below twelve")]
            let share = (j as f64 + f64::from(random.unit())) / WAVES as f64;
            (0.4 * 4f64.powf(share), f64::from(random.unit()))
        }))
    }

    /// The value n(τ) at τ = `periods`, between −√(2N) and √(2N).
    pub(super) fn at(&self, periods: f64) -> f64 {
        #[expect(clippy::cast_precision_loss, reason = "the constant is twelve")]
        let amplitude = (2.0 / WAVES as f64).sqrt();
        self.0.iter().map(|(f, phase)| amplitude * (TAU * (f * periods + phase)).cos()).sum()
    }
}
