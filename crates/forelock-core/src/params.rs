//! Ranges, checks and the error type for the parameters of all solvers and interactions.

mod key;

pub use key::{Documented, Key, Range, Short, in_few_letters};
pub(crate) use key::{OutOfRange, check};

/// The time step to which the published coefficients of dynamic follow the leader and of SPH refer,
/// seconds (Sánchez-Banderas et al. 2015).
pub const STATED_STEP_SECS: f64 = 0.016;

/// The longest substep by default, seconds.
pub const SUBSTEP_SECS: f64 = 1.0 / 240.0;

/// How often the length pass runs in a player, whatever the frame rate, seconds. Between two passes
/// edges stretch with their springs, so hair would move differently if frames decided.
pub const LENGTH_PASS_SECS: f64 = 1.0 / 60.0;

/// By how much of itself a part of a frame may be longer than it is said to be at most: a frame of
/// 59.94 a second has the substeps of one of 60, and so has one whose substep was rounded.
pub const PART_TOLERANCE: f64 = 2e-3;

/// The most parts of a frame, so that a frame of hours does not fill the memory with its plan.
pub const MOST_PARTS: u32 = 10_000;

/// Into how many equal parts a frame of `secs` seconds is divided, so that none is longer than
/// `longest_secs` (with [`PART_TOLERANCE`]): at least one, and at most [`MOST_PARTS`], which are
/// longer then.
pub fn parts(secs: f64, longest_secs: f64) -> u32 {
    let parts = secs / (longest_secs * (1.0 + PART_TOLERANCE));
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "positive, saturating")]
    let whole = (parts - 1e-9).ceil() as u32;
    whole.clamp(1, MOST_PARTS)
}

/// The pass, once a frame, that brings edges back to their rest lengths.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Inextensibility {
    /// Two Newton steps on the constraints, one follow-the-leader sweep for the remaining error,
    /// and a projection of the velocities.
    #[default]
    Projection,
    /// Dynamic follow the leader (Müller 2012) with
    /// [`FrameRules::length_damping`](crate::frame::FrameRules::length_damping).
    FollowTheLeader,
    /// The steps of the projection for edges that are stretched by more than
    /// [`FrameRules::max_stretch`](crate::frame::FrameRules::max_stretch), back to that stretch.
    Limit,
    /// No pass: edges stretch with their springs.
    Off,
}

/// The largest h² κ for which the float32 solve is reliable (float64 has no such limit).
pub const FLOAT32_STIFFNESS_LIMIT: f64 = 1e3;

/// A parameter that cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ParamsError {
    /// A value that is not finite or out of its range.
    #[error("`{name}` is {value}, but it must be {expected}")]
    Range {
        /// The field.
        name: &'static str,
        /// The value.
        value: f64,
        /// The range, in words.
        expected: String,
    },
    /// An array of another length than the groom has particles, or strands.
    #[error("`{name}` has {found} entries, but the groom has {expected} {of}: give one for each")]
    Count {
        /// The array.
        name: &'static str,
        /// Its entries.
        found: usize,
        /// Entries that are needed.
        expected: usize,
        /// "particles" or "strands".
        of: &'static str,
    },
    /// h² κ too large for float32.
    #[error(
        "`{name}` = {value:e} at {substeps} substep(s) of a {dt_secs:.4} s frame is beyond float32 \
         (h²κ = {product:.0}, limit {FLOAT32_STIFFNESS_LIMIT:.0}): {}lower it to {allowed:.1e}",
        needed_secs.map(|secs| format!("set substep_secs to {secs:e} or less, or ")).unwrap_or_default()
    )]
    TooStiff {
        /// The field.
        name: &'static str,
        /// The value, s⁻².
        value: f64,
        /// Substeps per frame.
        substeps: u32,
        /// Frame time, seconds.
        dt_secs: f64,
        /// h² κ, over the smallest relative mass.
        product: f64,
        /// The longest substep that suffices, rounded down to three digits, seconds; none if it is
        /// below the range of substeps.
        needed_secs: Option<f64>,
        /// The largest stiffness allowed with these substeps.
        allowed: f64,
    },
}

pub(crate) const LEAST_SUBSTEP_SECS: f64 = 1e-5;

impl From<OutOfRange> for ParamsError {
    fn from(error: OutOfRange) -> Self {
        let OutOfRange { name, value, range } = error;
        Self::Range { name, value, expected: range.to_string() }
    }
}

/// Checks that `dt_secs` can be the length of a frame.
///
/// # Errors
/// [`ParamsError::Range`] if it is not finite or not above 0.
pub(crate) fn check_time(dt_secs: f64) -> Result<(), ParamsError> {
    if dt_secs > 0.0 && dt_secs.is_finite() {
        return Ok(());
    }
    Err(ParamsError::Range {
        name: "dt_secs",
        value: dt_secs,
        expected: "a finite number above 0".to_owned(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_divided_tolerantly_to_rounding() {
        for (fps, expected) in
            [(60.0, 4), (59.94, 4), (30.0, 8), (24.0, 10), (144.0, 2), (240.0, 1), (1e4, 1)]
        {
            assert_eq!(parts(1.0 / fps, SUBSTEP_SECS), expected, "{fps}");
        }
        // Lengths that were rounded to four digits, either way; half a percent is no rounding.
        assert_eq!([4.166e-3, 4.167e-3, 4.145e-3].map(|secs| parts(1.0 / 60.0, secs)), [4, 4, 5]);
        // Parts of a part are not divided again.
        assert!((1..2000).all(|n| parts(1.0 / f64::from(n), 1.0 / f64::from(n)) == 1));
        assert_eq!([f64::INFINITY, f64::NAN, -1.0].map(|secs| parts(secs, 1e-3)), [MOST_PARTS, 1, 1]);
        assert_eq!(parts(1.0, f64::INFINITY), 1);
    }
}
