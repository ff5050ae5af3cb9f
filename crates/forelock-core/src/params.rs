//! Ranges, checks and the error type for the parameters of all solvers and interactions.

/// The time step to which the published coefficients of dynamic follow the leader and of SPH refer,
/// seconds (Sánchez-Banderas et al. 2015).
pub const STATED_STEP_SECS: f64 = 0.016;

/// The pass, once a frame, that brings every edge back to its rest length.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Inextensibility {
    /// Two Newton steps on the constraints, one follow-the-leader sweep for the remaining error,
    /// and a projection of the velocities.
    #[default]
    Projection,
    /// Dynamic follow the leader (Müller 2012) with
    /// [`FrameRules::length_damping`](crate::frame::FrameRules::length_damping).
    FollowTheLeader,
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
        expected: &'static str,
    },
    /// An array of another length than the particles of the groom.
    #[error("`{name}` has {found} entries, but the groom has {expected} particles: give one a particle")]
    Count {
        /// The array.
        name: &'static str,
        /// Its entries.
        found: usize,
        /// Particles.
        expected: usize,
    },
    /// h² κ too large for float32.
    #[error(
        "`{name}` = {value:e} at {substeps} substep(s) of a {dt_secs:.4} s frame is beyond float32 \
         (h²κ = {product:.0}, limit {FLOAT32_STIFFNESS_LIMIT:.0}): set substeps to {needed} or more, or lower it to {allowed:.1e}"
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
        /// The smallest sufficient number of substeps.
        needed: u32,
        /// The largest stiffness allowed at this number of substeps.
        allowed: f64,
    },
}

/// The range of a finite number: in words, and as a test.
pub(crate) type Range = (&'static str, fn(f64) -> bool);
pub(crate) const NON_NEGATIVE: Range = ("a finite number of 0 or more", |x| x >= 0.0);
pub(crate) const POSITIVE: Range = ("a finite number above 0", |x| x > 0.0);
pub(crate) const SHARE: Range = ("between 0 and 1", |x| (0.0..=1.0).contains(&x));
pub(crate) const COUNT: Range = ("between 1 and 1000", |x| (1.0..=1000.0).contains(&x));

/// Checks parameters, each a name, a value and its range.
///
/// # Errors
/// [`ParamsError::Range`] for the first value that is not finite or not in its range.
pub(crate) fn check(values: &[(&'static str, f64, Range)]) -> Result<(), ParamsError> {
    match values.iter().find(|(_, value, (_, holds))| !(value.is_finite() && holds(*value))) {
        Some(&(name, value, (expected, _))) => Err(ParamsError::Range { name, value, expected }),
        None => Ok(()),
    }
}

/// Checks that `dt_secs` can be the length of a frame.
///
/// # Errors
/// [`ParamsError::Range`] if it is not finite or not above 0.
pub(crate) fn check_time(dt_secs: f64) -> Result<(), ParamsError> {
    check(&[("dt_secs", dt_secs, POSITIVE)])
}
