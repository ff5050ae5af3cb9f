//! Parameters of the grid.

use crate::params::{NON_NEGATIVE, ParamsError, check};

/// Parameters of hair against hair through a grid.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct GridParams {
    /// Cells along the longest side of the rest shape's box. Unit cells, default 64, range 8 to 512.
    pub resolution: u32,
    /// Rate at which a particle takes over the grid's velocity (PIC) instead of its change (FLIP). Unit s⁻¹, default 3, range 0 or more; 0 is pure FLIP, 3.08 is 95 % FLIP at 60 frames a second.
    pub pic_rate: f64,
    /// Metres of hair in a cubic metre up to which hair may gather. Unit m⁻², default 0, range 0 or more; 0 takes the mean of the rest shape.
    pub rest_density: f64,
    /// Rate at which hair that is too dense expands. Unit s⁻¹, default 10, range 0 or more; 0 stops it from getting denser only.
    pub volume_rate: f64,
    /// Iterations of the pressure solve at most: of conjugate gradients in each round of the active set, on a GPU sweeps of relaxation. Unit iterations, default 60, range 1 to 10000.
    pub iterations: u32,
    /// Residual of the pressure solve, over that at its start; on a GPU the largest change in four sweeps, over the largest residual at the start. No unit, default 1e-3, range above 0 and below 1.
    pub tolerance: f64,
    /// Cells of the grid at most; hair beyond the box is left alone. Unit cells, default 4000000, range 4096 to 1000000000.
    pub max_cells: u32,
}

impl Default for GridParams {
    fn default() -> Self {
        Self {
            resolution: 64,
            pic_rate: 3.0,
            rest_density: 0.0,
            volume_rate: 10.0,
            iterations: 60,
            tolerance: 1e-3,
            max_cells: 4_000_000,
        }
    }
}

impl GridParams {
    /// Share of the grid's velocity (PIC) that a particle takes over in `dt_secs`.
    pub fn pic_share(&self, dt_secs: f64) -> f64 {
        1.0 - (-self.pic_rate * dt_secs).exp()
    }

    /// Share of an excess of hair that expands in `dt_secs`.
    pub fn expansion(&self, dt_secs: f64) -> f64 {
        1.0 - (-self.volume_rate * dt_secs).exp()
    }

    /// Checks every parameter against its range.
    ///
    /// # Errors
    /// [`ParamsError::Range`] for the first that is not in it.
    pub fn validate(&self) -> Result<(), ParamsError> {
        let (resolution, iterations) = (f64::from(self.resolution), f64::from(self.iterations));
        check(&[
            ("resolution", resolution, ("between 8 and 512", |x| (8.0..=512.0).contains(&x))),
            ("pic_rate", self.pic_rate, NON_NEGATIVE),
            ("rest_density", self.rest_density, NON_NEGATIVE),
            ("volume_rate", self.volume_rate, NON_NEGATIVE),
            ("iterations", iterations, ("between 1 and 10000", |x| (1.0..=1e4).contains(&x))),
            ("tolerance", self.tolerance, ("above 0 and below 1", |x| x > 0.0 && x < 1.0)),
            (
                "max_cells",
                self.max_cells.into(),
                ("between 4096 and 1000000000", |x| (4096.0..=1e9).contains(&x)),
            ),
        ])
    }
}
