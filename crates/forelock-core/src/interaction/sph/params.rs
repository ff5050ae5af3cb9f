//! Parameters of hair as smoothed particles.

use crate::params::{POSITIVE, ParamsError, check};

/// Parameters of hair against hair through smoothed particles (Sánchez-Banderas et al. 2015, Sec. 3.2; Müller et al. 2003).
///
/// Densities are relative to the mean of the groom at rest. Pressure and viscosity are told relative to the smoothing length h and the paper's step of 16 ms, so that they mean the same for hair of any density and size, and
/// do not change with the step.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct SphParams {
    /// How far particles feel each other, h. Unit m, default 0, range 0 to 10; 0 takes what gives half the particles as many `neighbours` at rest, anything else under 1e-6 is refused.
    pub smoothing_length: f64,
    /// Neighbours that a particle takes into account, the nearest ones, K. Unit particles, default 16, range 1 to 64.
    pub neighbours: u32,
    /// Growth of the pressure with the density beyond that at rest: k over (h/16 ms)², the square of a speed. No unit, default 0.05, range 0 to 0.5; 0 switches it off.
    pub pressure: f64,
    /// How much neighbours take of each other's speed: the kinematic viscosity over h²/16 ms. No unit, default 0.02, range 0 to 0.2; 0 switches it off.
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
    /// [`ParamsError::Range`] for the first that is not in it.
    pub fn validate(&self) -> Result<(), ParamsError> {
        check(&[
            (
                "smoothing_length",
                self.smoothing_length,
                ("0, or between 1e-6 and 10", |x| x == 0.0 || (1e-6..=10.0).contains(&x)),
            ),
            ("neighbours", f64::from(self.neighbours), ("between 1 and 64", |x| (1.0..=64.0).contains(&x))),
            ("pressure", self.pressure, ("between 0 and 0.5", |x| (0.0..=0.5).contains(&x))),
            ("viscosity", self.viscosity, ("between 0 and 0.2", |x| (0.0..=0.2).contains(&x))),
            ("rest_density", self.rest_density, POSITIVE),
        ])
    }
}
