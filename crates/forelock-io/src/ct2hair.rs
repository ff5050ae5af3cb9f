//! CT2Hair `.bin` (Shen et al. 2023, 'CT2Hair: High-Fidelity 3D Hair Modeling using Computed
//! Tomography'). Read only.
//!
//! # Theory
//! The file starts with `i32 strands`. Each strand is `i32 n`, then n points of 28 bytes: `f32
//! xyz`, `f32 normal[3]` and a 4-byte label.
//!
//! # Limitations
//! Normals and labels are discarded.

use forelock_core::groom::Groom;

use crate::{error::FormatError, usc};

/// Bytes per point.
const STRIDE: usize = 28;

/// Reads the groom in `bytes`. Units and axes are those of the file.
///
/// # Errors
/// [`FormatError`] if a count is negative, or larger than the remaining bytes allow.
pub fn read(bytes: &[u8]) -> Result<Groom, FormatError> {
    usc::read_points(bytes, "CT2Hair .bin", STRIDE)
}
