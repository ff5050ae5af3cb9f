//! Parameters of SPH between hair particles.

use crate::params::{ParamsError, check};

crate::documented! {
/// Parameters of hair–hair interaction by smoothed-particle hydrodynamics (Sánchez-Banderas et al.
/// 2015, Sec. 3.2; Müller et al. 2003).
///
/// Densities are relative to the mean density of the groom at rest. Pressure and viscosity are
/// relative to the smoothing length h and to the step of 16 ms of the paper, so that their effect
/// depends neither on the density and size of the hair nor on the step.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct SphParams {
    /// Smoothing length h, the reach of the forces between particles. Unit m, default 0, range 1e-6
    /// to 10 or 0; 0 selects the length at which half of the particles have `neighbours` neighbours
    /// at rest, other values under 1e-6 are refused.
    pub smoothing_length: f64,
    /// Maximum number of nearest neighbours K of a particle. Unit particles, default 16, range 1 to
    /// 64.
    pub neighbours: u32,
    /// Increase of the pressure with the excess of density over the rest density: k over (h/16
    /// ms)², the square of a speed. No unit, default 0.05, range 0 to 0.5; 0 disables pressure.
    pub pressure: f64,
    /// Damping of the relative velocity of neighbours: the kinematic viscosity over h²/16 ms. No
    /// unit, default 0.02, range 0 to 0.2; 0 disables viscosity.
    pub viscosity: f64,
    /// Density above which hair is under pressure, relative to that of the groom at rest. No unit,
    /// default 1, range 1e-3 to 1000.
    pub rest_density: f64,
    /// Whether particles of the same strand are neighbours. Default false.
    pub own_strand: bool,
    /// Whether a pair interacts only if each particle is among the nearest neighbours of the other,
    /// which conserves momentum; the paper checks one side only. Default true.
    pub mutual: bool,
}
}

impl Default for SphParams {
    fn default() -> Self {
        Self {
            smoothing_length: 0.0,
            neighbours: 16,
            pressure: 0.05,
            viscosity: 0.02,
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
    /// [`ParamsError::Range`] for the first parameter that is out of range.
    pub fn validate(&self) -> Result<(), ParamsError> {
        Ok(check::<Self, f64>(&[
            ("smoothing_length", &[self.smoothing_length]),
            ("neighbours", &[f64::from(self.neighbours)]),
            ("pressure", &[self.pressure]),
            ("viscosity", &[self.viscosity]),
            ("rest_density", &[self.rest_density]),
        ])?)
    }
}
