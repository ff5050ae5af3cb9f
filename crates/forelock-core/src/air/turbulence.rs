//! Turbulence: the curl of a random potential.
//!
//! # Theory
//! The potential is a sum of plane waves, A = Σ_j a_j (k_j × e_j)/(2π k_j²) sin 2π(k_j·x + φ_j), with wave vectors k_j in turns a metre and unit
//! vectors e_j ⟂ k_j. Its curl
//!
//! ```text
//! u' = ∇ × A = Σ_j a_j e_j cos 2π(k_j·x + φ_j)
//! ```
//!
//! has ∇·u' = −2π Σ a_j (e_j·k_j) sin(…) = 0, term by term, and Σ a_j²/2 for its mean square: kinematic simulation after Kraichnan (1970), "Diffusion by a
//! random velocity field". The lengths k_j go from 1 to 6 over the scale, evenly in their logarithm, with a_j² ∝ k_j^(−2/3), Kolmogorov's −5/3 spectrum in
//! such steps. Directions are spread evenly over the half-sphere (Fibonacci's lattice, turned by the seed).
//!
//! # Limitations
//! Sixteen waves: beyond some ten scales the eye finds repeats.

use std::f64::consts::{PI, TAU};

use glam::{DQuat, DVec3};

use crate::groom::grow::random::Random;

/// Plane waves of a field.
pub const MODES: usize = 16;
/// Shortest over longest wavelength, inverted.
const RANGE: f64 = 6.0;

/// One plane wave of the velocity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mode {
    /// Wave vector k, turns a metre.
    pub wave: DVec3,
    /// Velocity at its crest, a e, m/s; perpendicular to `wave`.
    pub amplitude: DVec3,
    /// Phase φ at the world's origin, turns.
    pub phase: f64,
}

impl Mode {
    /// Its phase at `origin` (metres), within a turn.
    pub fn phase_at(&self, origin: DVec3) -> f64 {
        (self.phase + self.wave.dot(origin)).rem_euclid(1.0)
    }

    /// Its velocity at `point` (metres), m/s.
    pub fn velocity(&self, point: DVec3) -> DVec3 {
        self.amplitude * (TAU * (self.wave.dot(point) + self.phase)).cos()
    }
}

/// The waves of unit strength: each component of the velocity has variance 1 on average.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Turbulence([Mode; MODES]);

impl Turbulence {
    pub(super) fn new(scale: f64, seed: u64) -> Self {
        let mut random = Random::new(seed, 0x7572_6275);
        let mut unit = || f64::from(random.unit());
        let turned = {
            // A uniform rotation (Shoemake 1992).
            let (a, b, c) = (unit(), TAU * unit(), TAU * unit());
            let (p, q) = ((1.0 - a).sqrt(), a.sqrt());
            DQuat::from_xyzw(p * b.sin(), p * b.cos(), q * c.sin(), q * c.cos()).normalize()
        };
        // Long and short waves take turns over the half-sphere.
        let stride = 7;
        #[expect(clippy::cast_precision_loss, reason = "at most sixteen")]
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

    /// The waves of components of `rms` m/s, carried along by `drift` metres.
    pub(super) fn modes(&self, rms: f64, drift: DVec3) -> [Mode; MODES] {
        self.0.map(|mode| Mode {
            amplitude: mode.amplitude * rms,
            phase: (mode.phase - mode.wave.dot(drift)).rem_euclid(1.0),
            ..mode
        })
    }
}
