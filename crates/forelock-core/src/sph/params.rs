//! Parameters of hair as smoothed particles.

use crate::solver::ParamsError;
use crate::solver::params::{NON_NEGATIVE, POSITIVE, check};

/// Parameters of hair against hair through smoothed particles (Sánchez-Banderas et al. 2015, Sec. 3.2; Müller et al. 2003).
///
/// Densities are relative to the mean of the groom at rest, so pressure and viscosity are those of a fluid over its density.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct SphParams {
    /// How far particles feel each other, h. Unit m, default 0, range 0 or more; 0 takes what gives half the particles as many `neighbours` at rest.
    pub smoothing_length: f64,
    /// Neighbours that a particle takes into account, the nearest ones, K. Unit particles, default 16, range 1 to 64.
    pub neighbours: u32,
    /// Growth of the pressure with the density beyond that at rest, the square of a speed of sound, k. Unit m²/s², default 0.05, range 0 or more; 0 switches it off. A step of Δt takes up to about (h/Δt)².
    pub pressure: f64,
    /// Kinematic viscosity, what neighbours take from each other's speed, μ over the density. Unit m²/s, default 2e-4, range 0 or more; 0 switches it off. A step of Δt takes up to about h²/(4 Δt).
    pub viscosity: f64,
    /// Density from which on hair is pressed, over that of the groom at rest. No unit, default 1, range above 0.
    pub rest_density: f64,
    /// Whether particles of one strand are neighbours of each other. Default false.
    pub own_strand: bool,
    /// Whether only those push each other that are among each other's nearest, so that momentum is kept; the paper asks of one side only. Default true.
    pub mutual: bool,
}

impl Default for SphParams {
    fn default() -> Self {
        Self {
            smoothing_length: 0.0,
            neighbours: 16,
            pressure: 0.05,
            viscosity: 2e-4,
            rest_density: 1.0,
            own_strand: false,
            mutual: true,
        }
    }
}

impl SphParams {
    /// Checks every parameter against its range.
    ///
    /// # Errors
    /// [`ParamsError::Range`] for the first that is not in it.
    pub fn validate(&self) -> Result<(), ParamsError> {
        check(&[
            ("smoothing_length", self.smoothing_length, NON_NEGATIVE),
            ("neighbours", f64::from(self.neighbours), ("between 1 and 64", |x| (1.0..=64.0).contains(&x))),
            ("pressure", self.pressure, NON_NEGATIVE),
            ("viscosity", self.viscosity, NON_NEGATIVE),
            ("rest_density", self.rest_density, POSITIVE),
        ])
    }
}
