//! Cem Yuksel's `.hair` (cyHairFile.h of the cyCodeBase; models at
//! cemyuksel.com/research/hairmodels).
//!
//! # Theory
//! The file starts with a header of 128 bytes: magic, strands, points, flags, defaults and 88
//! characters of text. Up to five arrays follow, each present if its flag is set: `u16
//! segments[strands]`, `f32 xyz[points]`, `f32 thickness[points]`, `f32 transparency[points]`, `f32
//! rgb[points]`. A strand has segments + 1 points, root first.
//!
//! # Practice
//! The magic may be `HAIR` or `hair`. If thickness, transparency or colour have no array, the
//! header's default is used for all points. A header that was never filled in has the defaults 1, 0
//! and white; with these values the attribute is absent. Coordinates are not converted. The
//! well-known models are z up, with a unit of 0.00254 m.
//!
//! # Limitations
//! A strand has at most 65,535 segments.

use bytemuck::{Pod, Zeroable};
use forelock_core::groom::Groom;
use glam::Vec3;

use crate::{bytes::Bytes, error::FormatError};

const SEGMENTS: u32 = 1;
const POINTS: u32 = 2;
const THICKNESS: u32 = 4;
const TRANSPARENCY: u32 = 8;
const COLOUR: u32 = 16;

const UNSET_THICKNESS: f32 = 1.0;
const UNSET_TRANSPARENCY: f32 = 0.0;
const UNSET_COLOUR: [f32; 3] = [1.0; 3];

const INFO: &[u8] = b"Hair by Forelock";

#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Header {
    magic: [u8; 4],
    strands: u32,
    points: u32,
    flags: u32,
    segments: u32,
    thickness: f32,
    transparency: f32,
    colour: [f32; 3],
    info_head: [u8; 64],
    info_tail: [u8; 24],
}

/// Reads the groom in `bytes`. Units and axes are those of the file.
///
/// # Errors
/// [`FormatError`] if the bytes are not a `.hair` file, are too short for the counts in the header,
/// or have no points.
pub fn read(bytes: &[u8]) -> Result<Groom, FormatError> {
    let mut bytes = Bytes::new(bytes, ".hair");
    let start = bytes.at(0);
    let header: Header = bytes.value("the fields of the header")?;
    if !header.magic.eq_ignore_ascii_case(b"HAIR") {
        return Err(start.invalid("it does not start with HAIR, so it is not a file of this format"));
    }
    if header.flags & POINTS == 0 {
        return Err(start
            .at(12)
            .invalid(format!("the flags {:#x} say that there are no points", header.flags)));
    }
    let (strands, points) = (u64::from(header.strands), u64::from(header.points));
    let offsets = if header.flags & SEGMENTS == 0 {
        let each = u64::from(header.segments) + 1;
        if strands.checked_mul(each) != Some(points) {
            return Err(start.at(4).invalid(format!(
                "{strands} strands of {each} points make {}, but the header says {points} points",
                strands.saturating_mul(each)
            )));
        }
        // Check that the points exist before allocating their offsets.
        bytes.at(128).take(points, size_of::<Vec3>(), "the points")?;
        #[expect(clippy::cast_possible_truncation, reason = "at most `points`, which has 32 bits")]
        (0..=strands).map(|strand| (strand * each) as u32).collect()
    } else {
        let segments: Vec<u16> = bytes.array(strands, "the segment counts")?;
        prefix_sums(&segments, header.points).map_err(|words| start.at(8).invalid(words))?
    };
    let positions: Vec<Vec3> = bytes.array(points, "the points")?;
    let mut groom = Groom::new(positions, offsets).map_err(|e| start.at(4).error(e.into()))?;
    let count = groom.particle_count();
    let mut scalar = |flag: u32, what: &'static str, default: f32, unset: f32| {
        if header.flags & flag != 0 {
            return bytes.array(points, what).map(Some);
        }
        Ok((default != unset).then(|| vec![default; count]))
    };
    groom.widths = scalar(THICKNESS, "the thicknesses", header.thickness, UNSET_THICKNESS)?;
    groom.transparencies =
        scalar(TRANSPARENCY, "the transparencies", header.transparency, UNSET_TRANSPARENCY)?;
    groom.colours = if header.flags & COLOUR != 0 {
        Some(bytes.array(points, "the colours")?)
    } else {
        (header.colour != UNSET_COLOUR).then(|| vec![header.colour; count])
    };
    Ok(groom)
}

/// The offsets of strands with `segments` + 1 points each. Their sum must equal `points`.
fn prefix_sums(segments: &[u16], points: u32) -> Result<Vec<u32>, String> {
    let total: u64 = segments.iter().map(|&s| u64::from(s) + 1).sum();
    if total != u64::from(points) {
        return Err(format!("the segment counts make {total} points, but the header says {points}"));
    }
    let mut sum = 0;
    let ends = segments.iter().map(|&s| {
        sum += u32::from(s) + 1;
        sum
    });
    Ok(std::iter::once(0).chain(ends.collect::<Vec<_>>()).collect())
}

/// The bytes of a `.hair` file with `groom`. The format has no root UVs, pins or bindings.
///
/// # Errors
/// A message if a strand has no particle or more than 65,536, or an attribute does not match the
/// groom.
pub fn write(groom: &Groom) -> Result<Vec<u8>, String> {
    groom.check_attributes().map_err(|e| e.to_string())?;
    let mut segments = Vec::with_capacity(groom.strand_count());
    for strand in 0..groom.strand_count() {
        let count = groom.range(strand).len();
        let fits = count.checked_sub(1).and_then(|n| u16::try_from(n).ok());
        segments.push(fits.ok_or_else(|| {
            format!(
                "strand {strand} has {count} points, and .hair allows 1 to 65,536 per strand; resample the groom"
            )
        })?);
    }
    let uniform = segments.first().copied().filter(|first| segments.iter().all(|s| s == first));
    let flag = |there: bool, flag: u32| if there { flag } else { 0 };
    let mut header = Header {
        magic: *b"HAIR",
        strands: u32::try_from(groom.strand_count()).map_err(|_| "too many strands")?,
        points: u32::try_from(groom.particle_count()).map_err(|_| "too many points")?,
        flags: POINTS
            | flag(uniform.is_none(), SEGMENTS)
            | flag(groom.widths.is_some(), THICKNESS)
            | flag(groom.transparencies.is_some(), TRANSPARENCY)
            | flag(groom.colours.is_some(), COLOUR),
        segments: uniform.map_or(0, u32::from),
        thickness: UNSET_THICKNESS,
        transparency: UNSET_TRANSPARENCY,
        colour: UNSET_COLOUR,
        info_head: [0; 64],
        info_tail: [0; 24],
    };
    header.info_head[..INFO.len()].copy_from_slice(INFO);
    let mut out = bytemuck::bytes_of(&header).to_vec();
    if uniform.is_none() {
        out.extend_from_slice(bytemuck::cast_slice(&segments));
    }
    out.extend_from_slice(bytemuck::cast_slice(groom.positions()));
    out.extend_from_slice(bytemuck::cast_slice(groom.widths.as_deref().unwrap_or_default()));
    out.extend_from_slice(bytemuck::cast_slice(groom.transparencies.as_deref().unwrap_or_default()));
    out.extend_from_slice(bytemuck::cast_slice(groom.colours.as_deref().unwrap_or_default()));
    Ok(out)
}
