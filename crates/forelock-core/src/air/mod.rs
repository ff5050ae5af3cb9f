//! The air around the hair: a mean wind with gusts, turbulence, shelter behind solids and
//! attenuation inside the hair.
//!
//! # Theory
//! u(x, t) = [U g(t) + u'(x − U t)] (1 − s D(x)) e^−τ(x):
//!
//! - U is the mean velocity and g ≥ 0 the gust factor, 1 + σ n(t/T), where n is a seeded sum of
//!   cosines of mean 0 and variance 1 (`gusts`);
//! - u' is the turbulence, the curl of a random potential that the mean wind advects unchanged
//!   (Taylor 1938, "The spectrum of turbulence": frozen turbulence), so that ∇·u' = 0 exactly
//!   (`turbulence`);
//! - D is the velocity deficit in the wake of solids, computed by a march downwind (`wake`), and s
//!   the strength of the shelter;
//! - τ is the optical depth of the hair upwind of x (`canopy`).
//!
//! The force of the air on a strand is drag: see
//! [`AmsParams::drag`](crate::solver::AmsParams::drag), `drag_along` and `drag_quadratic`.
//!
//! # Practice
//! [`Wind::new`] draws the random numbers once; [`Wind::at`] returns the wind at one time as a
//! plain value, which [`Air::field`](crate::frame::Air::field)
//! takes. The solver evaluates it once a frame at every particle. The same seed gives the same wind
//! on every machine and for any number of threads.
//!
//! # Limitations
//! The velocity field is prescribed, not simulated: the wind keeps its direction when it passes
//! through hair and behind solids and only loses speed. A gust reaches all places at the same time.
//! Behind solids the turbulence is damped together with the mean wind, whereas real wakes are more
//! turbulent, and the sheltered field is not free of divergence. The wake follows the direction of
//! the mean wind only.

pub mod canopy;
mod gusts;
pub mod sample_air;
mod turbulence;
pub mod wake;

use glam::DVec3;

pub use canopy::{Canopy, PlacedHair};
pub use turbulence::MODES;
pub use turbulence::Mode;
pub use wake::Wake;

use crate::params::{ParamsError, check};
use gusts::Gusts;
use turbulence::Turbulence;

crate::documented! {
/// The wind of a scene.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct WindParams {
    /// Mean velocity of the air, [x, y, z]. Unit m/s, default [0, 0, 0], range -1000 to 1000 each;
    /// a zero vector means still air, without gusts or turbulence.
    pub velocity: DVec3,
    /// Standard deviation of the wind speed over time, relative to the mean speed. No unit, default
    /// 0, range 0 to 1; 0 is a steady wind.
    pub gust_strength: f64,
    /// Approximate time between two gusts. Unit s, default 2, range 1e-3 to 1e6.
    pub gust_period_secs: f64,
    /// Standard deviation of each component of the velocity over space, relative to the mean speed.
    /// No unit, default 0, range 0 to 1; 0 is a uniform flow.
    pub turbulence: f64,
    /// Wavelength of the largest eddies; the smallest eddies are a sixth of it. Unit m, default
    /// 0.3, range 1e-3 to 1000.
    pub turbulence_scale: f64,
    /// Fraction of the wind that solids block in their wake. No unit, default 0, range 0 to 1; 0
    /// lets the wind blow through solids.
    pub shelter: f64,
    /// Penetration depth of the wind into hair: over this distance, in hair at its rest density,
    /// the wind falls to 37 %. Unit m, default 0, range 0 to 1000; 0 lets the wind blow through
    /// hair.
    pub hair_depth: f64,
    /// Seed of gusts and turbulence; the scene's seed is added to it. No unit, default 0, range 0
    /// or more.
    pub seed: u64,
}
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
    /// [`ParamsError::Range`] for the first parameter that is out of range.
    pub fn validate(&self) -> Result<(), ParamsError> {
        Ok(check::<Self, f64>(&[
            ("velocity", &self.velocity.to_array()),
            ("gust_strength", &[self.gust_strength]),
            ("turbulence", &[self.turbulence]),
            ("shelter", &[self.shelter]),
            ("hair_depth", &[self.hair_depth]),
            ("gust_period_secs", &[self.gust_period_secs]),
            ("turbulence_scale", &[self.turbulence_scale]),
        ])?)
    }

    /// Whether the wind is the same at all places, so that one velocity a frame describes it.
    pub fn is_uniform(&self) -> bool {
        self.velocity == DVec3::ZERO
            || (self.turbulence == 0.0 && self.shelter == 0.0 && self.hair_depth == 0.0)
    }
}

/// A wind as a function of time.
#[derive(Clone, Debug, PartialEq)]
pub struct Wind {
    params: WindParams,
    gusts: Gusts,
    turbulence: Turbulence,
}

impl Wind {
    /// Creates the wind with the given parameters.
    ///
    /// # Errors
    /// [`ParamsError::Range`] if a parameter is out of range.
    pub fn new(params: &WindParams) -> Result<Self, ParamsError> {
        params.validate()?;
        let turbulence = Turbulence::new(params.turbulence_scale, params.seed);
        Ok(Self { params: params.clone(), gusts: Gusts::new(params.seed), turbulence })
    }

    /// The parameters of this wind.
    pub fn params(&self) -> &WindParams {
        &self.params
    }

    /// The wind at `time_secs` seconds.
    pub fn at(&self, time_secs: f64) -> WindField {
        let p = &self.params;
        let gust = self.gusts.at(time_secs / p.gust_period_secs);
        let displacement = p.velocity * time_secs;
        let rms = p.turbulence * p.velocity.length();
        WindField {
            mean: p.velocity * (1.0 + p.gust_strength * gust).max(0.0),
            modes: (rms > 0.0).then(|| self.turbulence.modes(rms, displacement)),
            shelter: if p.velocity == DVec3::ZERO { 0.0 } else { p.shelter },
            hair_depth: if p.velocity == DVec3::ZERO { 0.0 } else { p.hair_depth },
        }
    }
}

/// The wind at one time, without the effect of solids and hair.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WindField {
    /// Mean velocity at this time, gust included, m/s.
    pub mean: DVec3,
    /// Plane waves of the turbulence; `None` without turbulence.
    pub modes: Option<[Mode; MODES]>,
    /// Fraction of the wind that solids block in their wake.
    pub shelter: f64,
    /// Penetration depth of the wind into hair, metres; 0 lets it blow through.
    pub hair_depth: f64,
}

impl WindField {
    /// Whether the wind is the same at all places.
    pub fn is_uniform(&self) -> bool {
        self.modes.is_none() && self.shelter == 0.0 && self.hair_depth == 0.0
    }

    /// Velocity in m/s at `point` (metres, world space), away from solids and hair.
    pub fn velocity(&self, point: DVec3) -> DVec3 {
        let modes = self.modes.iter().flatten();
        self.mean + modes.map(|mode| mode.velocity(point)).sum::<DVec3>()
    }
}

#[cfg(test)]
mod tests;
