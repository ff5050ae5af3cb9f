//! Errors of edits.

use crate::groom::GroomError;
use crate::memory::MemoryError;
use crate::params::{self, Documented, OutOfRange, Short};
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
    /// The result does not fit into the memory.
    #[error(transparent)]
    Memory(#[from] MemoryError),
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

impl From<OutOfRange> for EditError {
    fn from(error: OutOfRange) -> Self {
        Self::new(error.name, Short(error.value), error.range.to_string())
    }
}

/// Checks parameters of `D`, each its name in files and its numbers.
pub(super) fn check<D: Documented>(values: &[(&'static str, &[f32])]) -> Result<(), EditError> {
    Ok(params::check::<D, f32>(values)?)
}

/// Checks that `value` is finite and not zero.
pub(super) fn direction(name: &str, value: Vec3) -> Result<(), EditError> {
    if value.is_finite() && value.length() > 1e-12 {
        return Ok(());
    }
    Err(EditError::new(name, value, "a vector of non-zero length"))
}
