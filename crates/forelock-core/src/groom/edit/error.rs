//! Errors of edits.

use crate::groom::GroomError;
use glam::Vec3;

/// Why an edit was refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum EditError {
    /// A parameter is out of range or NaN.
    #[error("`{name}` should be {expected}, not {value}")]
    Parameter {
        /// Name of the field; the name of a nested field contains dots.
        name: String,
        /// The value given.
        value: String,
        /// Description of the valid values.
        expected: String,
    },
    /// An attribute has the wrong number of entries, or the result would be too large.
    #[error(transparent)]
    Groom(#[from] GroomError),
}

impl EditError {
    pub(super) fn new(name: &str, value: impl ToString, expected: impl Into<String>) -> Self {
        Self::Parameter { name: name.to_owned(), value: value.to_string(), expected: expected.into() }
    }

    /// The same error for a field inside `parent`.
    pub(super) fn under(self, parent: &str) -> Self {
        match self {
            Self::Parameter { name, value, expected } => {
                Self::Parameter { name: format!("{parent}.{name}"), value, expected }
            }
            other => other,
        }
    }
}

/// Checks that `value` is finite and at least `low`.
pub(super) fn at_least(name: &str, value: f32, low: f32) -> Result<(), EditError> {
    if value >= low && value.is_finite() {
        return Ok(());
    }
    Err(EditError::new(name, value, format!("{low} or more")))
}

/// Checks that `value` is finite and above 0.
pub(super) fn above_zero(name: &str, value: f32) -> Result<(), EditError> {
    if value > 0.0 && value.is_finite() { Ok(()) } else { Err(EditError::new(name, value, "above 0")) }
}

/// Checks that `value` is between `low` and `high`.
pub(super) fn within(name: &str, value: f32, low: f32, high: f32) -> Result<(), EditError> {
    if (low..=high).contains(&value) {
        return Ok(());
    }
    Err(EditError::new(name, value, format!("from {low} to {high}")))
}

/// Checks that every component of `value` is finite.
pub(super) fn finite(name: &str, value: Vec3) -> Result<(), EditError> {
    if value.is_finite() { Ok(()) } else { Err(EditError::new(name, value, "three finite numbers")) }
}

/// Checks that `value` is finite and not zero.
pub(super) fn direction(name: &str, value: Vec3) -> Result<(), EditError> {
    if value.is_finite() && value.length() > 1e-12 {
        return Ok(());
    }
    Err(EditError::new(name, value, "a vector of non-zero length"))
}
