//! CT2Hair `.bin` (Shen et al. 2023, 'CT2Hair: High-Fidelity 3D Hair Modeling using Computed Tomography'),
//! reading only.
//!
//! # Theory
//! `i32 strands`; each: `i32 n`, then n × 28 bytes: `f32 xyz`, `f32 normal[3]`, a 4-byte label.
//!
//! # Limitations
//! Normals and labels are not kept.

use forelock_core::groom::Groom;

use crate::{error::FormatError, usc};

/// Bytes a point.
const STRIDE: usize = 28;

/// The groom in `bytes`, in the file's own units and axes.
///
/// # Errors
/// [`FormatError`] if a count is negative or announces more than the bytes hold.
pub fn read(bytes: &[u8]) -> Result<Groom, FormatError> {
    usc::read_points(bytes, "CT2Hair .bin", STRIDE)
}
