//! Turbulence: the curl of a random potential.
//!
//! # Theory
//! The potential is a sum of plane waves, A = Σ_j a_j (k_j × e_j)/(2π k_j²) sin 2π(k_j·x + φ_j),
//! with wave vectors k_j in turns per metre and unit vectors e_j ⟂ k_j. Its curl
//!
//! ```text
//! u' = ∇ × A = Σ_j a_j e_j cos 2π(k_j·x + φ_j)
//! ```
//!
//! satisfies ∇·u' = −2π Σ a_j (e_j·k_j) sin(…) = 0 term by term, and its mean square is Σ a_j²/2:
//! kinematic simulation after Kraichnan (1970), "Diffusion by a random velocity field". The wave
//! numbers |k_j| range from 1 to 6 over the turbulence scale, evenly in their logarithm, with a_j²
//! ∝ k_j^(−2/3), which is Kolmogorov's −5/3 spectrum in logarithmic steps. The directions are
//! spread evenly over the half-sphere (a Fibonacci lattice, rotated at random by the seed).
//!
//! # Limitations
//! There are sixteen waves only: over distances of more than about ten scales, repetition is
//! visible.

use std::f64::consts::{PI, TAU};

use glam::{DQuat, DVec3};

use crate::groom::grow::random::Random;

/// Number of plane waves.
pub const MODES: usize = 16;
/// Ratio of the longest to the shortest wavelength.
const RANGE: f64 = 6.0;

/// One plane wave of the velocity field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mode {
    /// Wave vector k, turns per metre.
    pub wave: DVec3,
    /// Amplitude of the velocity, a e, m/s; perpendicular to `wave`.
    pub amplitude: DVec3,
    /// Phase φ at the world's origin, turns.
    pub phase: f64,
}

impl Mode {
    /// The phase at `origin` (metres), in turns from 0 to 1.
    pub fn phase_at(&self, origin: DVec3) -> f64 {
        (self.phase + self.wave.dot(origin)).rem_euclid(1.0)
    }

    /// The velocity of this wave at `point` (metres), m/s.
    pub fn velocity(&self, point: DVec3) -> DVec3 {
        self.amplitude * (TAU * (self.wave.dot(point) + self.phase)).cos()
    }
}

/// Waves of unit strength: each component of the velocity has variance 1 on average.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Turbulence([Mode; MODES]);

impl Turbulence {
    pub(super) fn new(scale: f64, seed: u64) -> Self {
        let mut random = Random::new(seed, 0x7572_6275);
        let mut unit = || f64::from(random.unit());
        let turned = {
            // A uniformly distributed rotation (Shoemake 1992).
            let (a, b, c) = (unit(), TAU * unit(), TAU * unit());
            let (p, q) = ((1.0 - a).sqrt(), a.sqrt());
            DQuat::from_xyzw(p * b.sin(), p * b.cos(), q * c.sin(), q * c.cos()).normalize()
        };
        // Neighbouring directions get waves of different lengths.
        let stride = 7;
        #[expect(clippy::cast_precision_loss, reason = "numbers up to sixteen")]
        let mut modes: [Mode; MODES] = std::array::from_fn(|j| {
            let count = MODES as f64;
            let length = RANGE.powf((j as f64 + unit()) / count) / scale;
            let height = (((j * stride) % MODES) as f64 + 0.5) / count;
            let around = j as f64 * PI * (3.0 - 5f64.sqrt());
            let flat = (1.0 - height * height).sqrt();
            let direction = turned * DVec3::new(flat * around.cos(), flat * around.sin(), height);
            let (u, v) = direction.any_orthonormal_pair();
            let (sin, cos) = (TAU * unit()).sin_cos();
            Mode {
                wave: direction * length,
                amplitude: (u * cos + v * sin) * length.powf(-1.0 / 3.0),
                phase: unit(),
            }
        });
        let mean_square = modes.iter().map(|mode| 0.5 * mode.amplitude.length_squared()).sum::<f64>();
        for mode in &mut modes {
            mode.amplitude *= (3.0 / mean_square).sqrt();
        }
        Self(modes)
    }

    /// The waves scaled to `rms` m/s per component and advected by `displacement` metres.
    pub(super) fn modes(&self, rms: f64, displacement: DVec3) -> [Mode; MODES] {
        self.0.map(|mode| Mode {
            amplitude: mode.amplitude * rms,
            phase: (mode.phase - mode.wave.dot(displacement)).rem_euclid(1.0),
            ..mode
        })
    }
}
