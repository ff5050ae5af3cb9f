//! USC-HairSalon `.data` (Hu et al. 2015, 'Single-View Hair Modeling Using A Hairstyle Database').
//!
//! # Theory
//! The file starts with `i32 strands`. Each strand is `i32 n`, then n points `f32 xyz`, root first.
//! There is no header and there are no attributes.
//!
//! # Practice
//! Units vary: a unit of the database is about 0.82 m; other files use centimetres. A strand with
//! one point means 'no strand here'. The reader keeps such strands, and `repair` removes and counts
//! them.

use forelock_core::groom::Groom;
use glam::Vec3;

use crate::{bytes::Bytes, error::FormatError};

/// Reads the groom in `bytes`. Units and axes are those of the file.
///
/// # Errors
/// [`FormatError`] if a count is negative, or larger than the remaining bytes allow.
pub fn read(bytes: &[u8]) -> Result<Groom, FormatError> {
    read_points(bytes, ".data", size_of::<Vec3>())
}

/// Reads a number of strands, each a number of points. A point is `stride` bytes and starts with
/// its position.
pub(crate) fn read_points(bytes: &[u8], format: &'static str, stride: usize) -> Result<Groom, FormatError> {
    let mut bytes = Bytes::new(bytes, format);
    let start = bytes.at(0);
    let strands = bytes.count("strands")?;
    // Each strand takes at least the 4 bytes of its count.
    bytes.at(4).take(strands, 4, "the strands")?;
    let mut positions: Vec<Vec3> = Vec::with_capacity(bytes.left() / stride);
    let mut offsets = vec![0];
    for strand in 0..strands {
        bytes.enter_strand(usize::try_from(strand).unwrap_or(usize::MAX));
        let count = bytes.count("points")?;
        let points = bytes.take(count, stride, "the points")?;
        positions.extend(
            points
                .chunks_exact(stride)
                .map(|p| bytemuck::pod_read_unaligned::<Vec3>(&p[..size_of::<Vec3>()])),
        );
        offsets.push(u32::try_from(positions.len()).map_err(|_| bytes.invalid("over 4,294,967,295 points"))?);
    }
    Groom::new(positions, offsets).map_err(|e| start.error(e.into()))
}

/// The bytes of a `.data` file with the strands of `groom`. The format has no attributes.
///
/// # Errors
/// A message if there are more than 2³¹ − 1 strands, or more than 2³¹ − 1 points in a strand.
pub fn write(groom: &Groom) -> Result<Vec<u8>, String> {
    let count = |n: usize| {
        i32::try_from(n)
            .map(i32::to_le_bytes)
            .map_err(|_| "over 2,147,483,647 strands, or points in a strand, the limit of .data")
    };
    let mut out = Vec::with_capacity(4 + 4 * groom.strand_count() + size_of_val(groom.positions()));
    out.extend(count(groom.strand_count())?);
    for strand in groom.strands() {
        out.extend(count(strand.len())?);
        out.extend_from_slice(bytemuck::cast_slice(strand));
    }
    Ok(out)
}
