//! Masses of particles.

use super::model::PackError;
use crate::groom::Groom;

/// The range of relative masses.
pub const MASS_RANGE: std::ops::RangeInclusive<f32> = 0.1..=10.0;

/// The masses of a groom's particles.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "kebab-case"))]
pub enum Masses {
    /// All particles have the same mass.
    #[default]
    Uniform,
    /// The mass is proportional to the square of the groom's width at the particle, over the mean
    /// square of the groom that a simulation is built from, and clamped to [`MASS_RANGE`]. Later
    /// edits of the groom keep this unit ([`Masses::fixed`]).
    Widths,
    /// The same over a given square of a width, m².
    #[cfg_attr(feature = "serde", serde(skip))]
    WidthsOver(f64),
}

impl Masses {
    /// The same choice with the unit that it has for `groom`.
    ///
    /// # Errors
    /// [`PackError::NoWidths`] if masses are to follow widths that the groom does not have.
    pub fn fixed(self, groom: &Groom) -> Result<Self, PackError> {
        if self != Self::Widths {
            return Ok(self);
        }
        let widths = groom.widths.as_deref().ok_or(PackError::NoWidths)?;
        #[expect(clippy::cast_precision_loss, reason = "a groom's particles")]
        let mean = widths.iter().map(square).sum::<f64>() / widths.len().max(1) as f64;
        if mean.is_nan() || mean <= 0.0 { Err(PackError::NoWidths) } else { Ok(Self::WidthsOver(mean)) }
    }

    /// The relative masses of the particles of `groom`, `[P]`, or none if they are all 1.
    ///
    /// # Errors
    /// As [`Masses::fixed`].
    pub fn of(self, groom: &Groom) -> Result<Option<Vec<f32>>, PackError> {
        let Self::WidthsOver(unit) = self.fixed(groom)? else { return Ok(None) };
        let widths = groom.widths.as_deref().ok_or(PackError::NoWidths)?;
        #[expect(clippy::cast_possible_truncation, reason = "clamped to the range")]
        let mass = |w: &f32| ((square(w) / unit) as f32).clamp(*MASS_RANGE.start(), *MASS_RANGE.end());
        Ok(Some(widths.iter().map(mass).collect()))
    }
}

fn square(width: &f32) -> f64 {
    f64::from(*width).powi(2)
}
