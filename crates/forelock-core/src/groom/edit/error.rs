//! What can be wrong with an edit.

use crate::groom::GroomError;
use glam::Vec3;

/// Why an edit was refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum EditError {
    /// A parameter is outside its range or not a number.
    #[error("`{name}` should be {expected}, not {value}")]
    Parameter {
        /// The field, with dots where it is inside another.
        name: String,
        /// What it holds.
        value: String,
        /// What would be right.
        expected: String,
    },
    /// The groom's attributes do not fit it, or it would become too large.
    #[error(transparent)]
    Groom(#[from] GroomError),
}

impl EditError {
    pub(super) fn new(name: &str, value: impl ToString, expected: impl Into<String>) -> Self {
        Self::Parameter { name: name.to_owned(), value: value.to_string(), expected: expected.into() }
    }

    /// The same error of a field inside `parent`.
    pub(super) fn under(self, parent: &str) -> Self {
        match self {
            Self::Parameter { name, value, expected } => {
                Self::Parameter { name: format!("{parent}.{name}"), value, expected }
            }
            other => other,
        }
    }
}

/// `value` is finite and `low` or more.
pub(super) fn at_least(name: &str, value: f32, low: f32) -> Result<(), EditError> {
    if value >= low && value.is_finite() {
        return Ok(());
    }
    Err(EditError::new(name, value, format!("{low} or more")))
}

/// `value` is finite and above 0.
pub(super) fn above_zero(name: &str, value: f32) -> Result<(), EditError> {
    if value > 0.0 && value.is_finite() { Ok(()) } else { Err(EditError::new(name, value, "above 0")) }
}

/// `value` is from `low` to `high`.
pub(super) fn within(name: &str, value: f32, low: f32, high: f32) -> Result<(), EditError> {
    if (low..=high).contains(&value) {
        return Ok(());
    }
    Err(EditError::new(name, value, format!("from {low} to {high}")))
}

/// Every component of `value` is finite.
pub(super) fn finite(name: &str, value: Vec3) -> Result<(), EditError> {
    if value.is_finite() { Ok(()) } else { Err(EditError::new(name, value, "three finite numbers")) }
}

/// `value` has a direction.
pub(super) fn direction(name: &str, value: Vec3) -> Result<(), EditError> {
    if value.is_finite() && value.length() > 1e-12 {
        return Ok(());
    }
    Err(EditError::new(name, value, "a direction of some length"))
}
