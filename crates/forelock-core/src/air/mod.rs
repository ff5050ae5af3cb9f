//! The air that hair moves in: a mean wind with gusts, turbulence, and shelter behind solids.
//!
//! # Theory
//! u(x, t) = [U g(t) + u'(x − U t)] (1 − s D(x)) e^−τ(x):
//!
//! - U is the mean velocity and g ≥ 0 its gusts, 1 + σ n(t/T), with n a seeded sum of cosines of mean 0 and variance 1 (`gusts`);
//! - u' is turbulence, the curl of a random potential that the mean wind carries along unchanged (Taylor 1938, "The spectrum of turbulence", frozen
//!   turbulence), so that ∇·u' = 0 exactly (`turbulence`);
//! - D is the deficit in the wake of solids, marched downwind (`wake`), and s how much of it counts;
//! - τ is the optical depth of the hair upwind (`canopy`).
//!
//! What a strand does in that air is its drag: see [`AmsParams::drag`](crate::solver::AmsParams::drag), `drag_along` and `drag_quadratic`.
//!
//! # Practice
//! [`Wind::new`] draws the random numbers once; [`Wind::at`] is the wind of one moment, a plain value that
//! [`Simulation::step_frame_in`](crate::simulation::Simulation::step_frame_in) takes. The solver evaluates it once a frame at every particle. The same seed gives the same
//! wind on every machine and for any number of threads.
//!
//! # Limitations
//! The air's own motion is given: it goes straight on through hair and past solids, weakened. Gusts come everywhere at once. In the lee the turbulence is damped with the mean, where real wakes are
//! rougher, and the sheltered field is not free of divergence. The wake follows the direction of the mean wind alone.

pub mod canopy;
mod gusts;
pub mod sample_air;
mod turbulence;
pub mod wake;

use glam::DVec3;

pub use canopy::Canopy;
pub use turbulence::MODES;
pub use turbulence::Mode;
pub use wake::Wake;

use crate::params::{NON_NEGATIVE, POSITIVE, ParamsError, Range, SHARE, check};
use gusts::Gusts;
use turbulence::Turbulence;

/// The wind of a scene.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct WindParams {
    /// Mean velocity of the air, [x, y, z]. Unit m/s, default [0, 0, 0]; zeros are still air, without gusts and turbulence.
    pub velocity: DVec3,
    /// Standard deviation of the wind's speed over time, over the mean. No unit, default 0, range 0 to 1; 0 blows steadily.
    pub gust_strength: f64,
    /// Time from gust to gust, about. Unit s, default 2, range above 0.
    pub gust_period_secs: f64,
    /// Standard deviation of each component of the velocity from place to place, over the mean speed. No unit, default 0, range 0 to 1; 0 is a uniform flow.
    pub turbulence: f64,
    /// Wavelength of the largest eddies; the smallest are a sixth of it. Unit m, default 0.3, range above 0.
    pub turbulence_scale: f64,
    /// Share of the wind that solids keep off what lies behind them. No unit, default 0, range 0 to 1; 0 lets it blow through them.
    pub shelter: f64,
    /// How deep wind reaches into hair: on this way through hair as dense as at rest it falls to 37 %. Unit m, default 0, range 0 or more; 0 lets it blow through.
    pub hair_depth: f64,
    /// Seed of gusts and turbulence; a scene adds its own. No unit, default 0, range 0 or more.
    pub seed: u64,
}

impl Default for WindParams {
    fn default() -> Self {
        Self {
            velocity: DVec3::ZERO,
            gust_strength: 0.0,
            gust_period_secs: 2.0,
            turbulence: 0.0,
            turbulence_scale: 0.3,
            shelter: 0.0,
            hair_depth: 0.0,
            seed: 0,
        }
    }
}

impl WindParams {
    /// Checks every parameter against its range.
    ///
    /// # Errors
    /// [`ParamsError::Range`] for the first that is not in it.
    pub fn validate(&self) -> Result<(), ParamsError> {
        const FINITE: Range = ("finite", |_| true);
        check(&self.velocity.to_array().map(|value| ("velocity", value, FINITE)))?;
        check(&[
            ("gust_strength", self.gust_strength, SHARE),
            ("turbulence", self.turbulence, SHARE),
            ("shelter", self.shelter, SHARE),
            ("hair_depth", self.hair_depth, NON_NEGATIVE),
            ("gust_period_secs", self.gust_period_secs, POSITIVE),
            ("turbulence_scale", self.turbulence_scale, POSITIVE),
        ])
    }

    /// Whether the wind is the same everywhere, so that one velocity a frame says all.
    pub fn is_uniform(&self) -> bool {
        self.velocity == DVec3::ZERO
            || (self.turbulence == 0.0 && self.shelter == 0.0 && self.hair_depth == 0.0)
    }
}

/// A wind over time.
#[derive(Clone, Debug, PartialEq)]
pub struct Wind {
    params: WindParams,
    gusts: Gusts,
    turbulence: Turbulence,
}

impl Wind {
    /// The wind of `params`.
    ///
    /// # Errors
    /// [`ParamsError::Range`] if one of them is out of range.
    pub fn new(params: &WindParams) -> Result<Self, ParamsError> {
        params.validate()?;
        let turbulence = Turbulence::new(params.turbulence_scale, params.seed);
        Ok(Self { params: params.clone(), gusts: Gusts::new(params.seed), turbulence })
    }

    /// What it was made from.
    pub fn params(&self) -> &WindParams {
        &self.params
    }

    /// The wind at `time_secs`.
    pub fn at(&self, time_secs: f64) -> WindField {
        let p = &self.params;
        let gust = self.gusts.at(time_secs / p.gust_period_secs);
        let drift = p.velocity * time_secs;
        let rms = p.turbulence * p.velocity.length();
        WindField {
            mean: p.velocity * (1.0 + p.gust_strength * gust).max(0.0),
            modes: (rms > 0.0).then(|| self.turbulence.modes(rms, drift)),
            shelter: if p.velocity == DVec3::ZERO { 0.0 } else { p.shelter },
            hair_depth: if p.velocity == DVec3::ZERO { 0.0 } else { p.hair_depth },
        }
    }
}

/// The wind at one moment, without the solids and the hair in it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WindField {
    /// Mean velocity at this moment, gust included, m/s.
    pub mean: DVec3,
    /// Turbulence, if there is any.
    pub modes: Option<[Mode; MODES]>,
    /// Share of the wind that solids keep off what lies behind them.
    pub shelter: f64,
    /// How deep it reaches into hair, metres; 0: all the way.
    pub hair_depth: f64,
}

impl WindField {
    /// Whether it is the same everywhere.
    pub fn is_uniform(&self) -> bool {
        self.modes.is_none() && self.shelter == 0.0 && self.hair_depth == 0.0
    }

    /// Velocity at `point` (metres, world space) in the open, m/s.
    pub fn velocity(&self, point: DVec3) -> DVec3 {
        let modes = self.modes.iter().flatten();
        self.mean + modes.map(|mode| mode.velocity(point)).sum::<DVec3>()
    }
}

#[cfg(test)]
mod tests;
