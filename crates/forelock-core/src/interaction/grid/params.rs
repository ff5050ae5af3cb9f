//! Parameters of the grid.

use crate::params::{ParamsError, check};

crate::documented! {
/// Parameters of hair–hair interaction on a grid.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct GridParams {
    /// Number of cells along the longest side of the bounding box of the rest shape. Unit cells,
    /// default 48, range 8 to 512.
    pub resolution: u32,
    /// Rate at which particles adopt the velocity of the grid (PIC) rather than its change (FLIP).
    /// Unit s⁻¹, default 3, range 0 to 1e6; 0 is pure FLIP, 3.08 is 95 % FLIP at 60 frames a
    /// second.
    pub pic_rate: f64,
    /// Length of hair per volume, at rest, of the sparsest hair that keeps its volume; sparser hair
    /// may gather until it is as dense. Unit m⁻², default 0, range 0 to 1e15; 0 uses a tenth of the
    /// mean of the rest shape.
    pub rest_density: f64,
    /// Rate at which over-dense hair expands. Unit s⁻¹, default 200, range 0 to 1e6; with 0 it does
    /// not expand and only stops getting denser.
    pub volume_rate: f64,
    /// Maximum number of relaxation sweeps of a pressure solve, rounded up to a multiple of four.
    /// Unit iterations, default 60, range 1 to 10000.
    pub iterations: u32,
    /// Largest change in four sweeps, relative to the largest right-hand side, at which the
    /// pressure solve stops. No unit, default 1e-3, range 1e-9 to 1.
    pub tolerance: f64,
    /// Maximum number of cells; hair outside the box does not take part. Unit cells, default
    /// 4000000, range 4096 to 1000000000.
    pub max_cells: u32,
}
}

impl Default for GridParams {
    fn default() -> Self {
        Self {
            resolution: 48,
            pic_rate: 3.0,
            rest_density: 0.0,
            volume_rate: 200.0,
            iterations: 60,
            tolerance: 1e-3,
            max_cells: 4_000_000,
        }
    }
}

impl GridParams {
    /// Fraction of the velocity of the grid (PIC) that a particle adopts in `dt_secs`.
    pub fn pic_share(&self, dt_secs: f64) -> f64 {
        1.0 - (-self.pic_rate * dt_secs).exp()
    }

    /// Fraction of an excess volume that expands in `dt_secs`.
    pub fn expansion(&self, dt_secs: f64) -> f64 {
        1.0 - (-self.volume_rate * dt_secs).exp()
    }

    /// Checks every parameter against its range.
    ///
    /// # Errors
    /// [`ParamsError::Range`] for the first parameter that is out of range.
    pub fn validate(&self) -> Result<(), ParamsError> {
        let (resolution, iterations) = (f64::from(self.resolution), f64::from(self.iterations));
        Ok(check::<Self, f64>(&[
            ("resolution", &[resolution]),
            ("pic_rate", &[self.pic_rate]),
            ("rest_density", &[self.rest_density]),
            ("volume_rate", &[self.volume_rate]),
            ("iterations", &[iterations]),
            ("tolerance", &[self.tolerance]),
            ("max_cells", &[self.max_cells.into()]),
        ])?)
    }
}
