//! TressFX `.tfx`, versions 3.0 (read) and 4.0 (read and written).
//!
//! # Theory
//! The file is a header, then arrays at the offsets that the header gives. Offset 0 means that the
//! array is absent. All strands have the same number of vertices.
//!
//! | | 3.0 | 4.0 |
//! | --- | --- | --- |
//! | header | 296 bytes, offsets at byte 144 | 160 bytes, offsets at byte 12 |
//! | positions | `f32[3]` per vertex | `f32[4]` per vertex, w = 0 pinned |
//! | thickness | `f32` per strand | `f32` per strand |
//! | strand UV, vertex colour | `f32[2]`, `f32[4]` | `f32[2]`, `f32[4]` |
//!
//! # Practice
//! [`Groom::pinned`] is the number of consecutive vertices with w = 0, counted from the root.
//! Pinned vertices further along the strand are ignored. The writer pins the roots of a groom
//! without pins. It writes the mean of a strand's widths as the strand's thickness.
//!
//! # Limitations
//! Follow strands, vertex UVs, alpha and the flag 'both ends immovable' are discarded.

use bytemuck::{Pod, Zeroable};
use forelock_core::groom::Groom;
use glam::{Vec3, Vec4};

use crate::{bytes::Bytes, error::FormatError};

/// The offsets of a file's arrays. 0 means absent.
struct Layout {
    positions: u32,
    thickness: u32,
    strand_uv: u32,
    colour: u32,
    has_pins: bool,
}

/// The header of version 4.0.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Header {
    version: f32,
    strands: u32,
    vertices_per_strand: u32,
    positions: u32,
    strand_uv: u32,
    vertex_uv: u32,
    thickness: u32,
    colour: u32,
    reserved: [u32; 32],
}

/// Reads the groom in `bytes`. Units and axes are those of the file.
///
/// # Errors
/// [`FormatError`] if the version is not 3.0 or 4.0, or an array extends beyond the bytes.
pub fn read(bytes: &[u8]) -> Result<Groom, FormatError> {
    let mut bytes = Bytes::new(bytes, ".tfx");
    let start = bytes.at(0);
    let version: f32 = bytes.value("the fields of the header")?;
    let strands: u32 = bytes.value("the fields of the header")?;
    let each: u32 = bytes.value("the fields of the header")?;
    let layout = if version == 4.0 {
        let [positions, strand_uv, _, thickness, colour] =
            bytes.value::<[u32; 5]>("the fields of the header")?;
        Layout { positions, thickness, strand_uv, colour, has_pins: true }
    } else if version == 3.0 {
        let [positions, thickness, strand_uv, colour] =
            start.at(144).value::<[u32; 4]>("the fields of the header")?;
        Layout { positions, thickness, strand_uv, colour, has_pins: false }
    } else {
        return Err(start.invalid(format!(
            "version {version} of TressFX is not supported (3.0 and 4.0 are), or this is not a .tfx file"
        )));
    };
    if each == 0 {
        return Err(start.at(8).invalid("0 vertices per strand"));
    }
    let points = u64::from(strands) * u64::from(each);
    let at = |offset: u32| (offset != 0).then(|| start.at(u64::from(offset)));
    let Some(mut data) = at(layout.positions) else {
        return Err(start.at(12).invalid("the offset of the positions is 0, so the file has none"));
    };
    let (positions, pinned) = if layout.has_pins {
        split_pins(&data.array(points, "the positions")?, each as usize)
    } else {
        (data.array(points, "the positions")?, None)
    };
    // The positions were read, so the offsets take less memory than the file.
    let offsets = (0..=u64::from(strands)).map(|s| u32::try_from(s * u64::from(each)));
    let offsets =
        offsets.collect::<Result<_, _>>().map_err(|_| start.at(4).invalid("over 4,294,967,295 vertices"))?;
    let mut groom = Groom::new(positions, offsets).map_err(|e| start.at(4).error(e.into()))?;
    groom.pinned = pinned;
    if let Some(mut data) = at(layout.thickness) {
        let thickness: Vec<f32> = data.array(u64::from(strands), "the thicknesses")?;
        groom.widths = Some(thickness.iter().flat_map(|&t| std::iter::repeat_n(t, each as usize)).collect());
    }
    if let Some(mut data) = at(layout.strand_uv) {
        groom.root_uvs = Some(data.array(u64::from(strands), "the strand UVs")?);
    }
    if let Some(mut data) = at(layout.colour) {
        let rgba: Vec<[f32; 4]> = data.array(points, "the colours")?;
        groom.colours = Some(rgba.into_iter().map(|[r, g, b, _]| [r, g, b]).collect());
    }
    Ok(groom)
}

/// The positions, and for each strand of `each` vertices the number of vertices with w = 0, counted
/// from the root.
fn split_pins(vertices: &[Vec4], each: usize) -> (Vec<Vec3>, Option<Vec<u16>>) {
    let pins = |strand: &[Vec4]| {
        let count = strand.iter().take_while(|v| v.w <= 0.0).count();
        u16::try_from(count).unwrap_or(u16::MAX)
    };
    let positions = vertices.iter().map(|v| v.truncate()).collect();
    (positions, Some(vertices.chunks_exact(each).map(pins).collect()))
}

/// The bytes of a version 4.0 file with `groom`.
///
/// # Errors
/// A message if the strands have different numbers of particles, an attribute does not match the
/// groom, or the file would exceed 4 GiB.
pub fn write(groom: &Groom) -> Result<Vec<u8>, String> {
    groom.check_attributes().map_err(|e| e.to_string())?;
    let strands = groom.strand_count();
    let each = if strands == 0 { 0 } else { groom.range(0).len() };
    if let Some(strand) = (0..strands).find(|&s| groom.range(s).len() != each) {
        return Err(format!(
            "strand {strand} has {} points and strand 0 has {each}, but .tfx needs the same number on every \
             strand; resample the groom",
            groom.range(strand).len()
        ));
    }
    if each == 0 {
        return Err("there are no points to write".into());
    }
    let pins = |strand: usize| groom.pinned.as_ref().map_or(1, |pinned| usize::from(pinned[strand]));
    let vertices: Vec<Vec4> = (0..strands)
        .flat_map(|s| groom.strand(s).iter().enumerate().map(move |(i, p)| (s, i, p)))
        .map(|(s, i, p)| p.extend(if i < pins(s) { 0.0 } else { 1.0 }))
        .collect();
    let thickness: Option<Vec<f32>> =
        groom.widths.as_ref().map(|widths| widths.chunks_exact(each).map(mean).collect());
    let colours: Option<Vec<[f32; 4]>> =
        groom.colours.as_ref().map(|colours| colours.iter().map(|&[r, g, b]| [r, g, b, 1.0]).collect());

    let mut out = vec![0; size_of::<Header>()];
    let mut append = |bytes: Option<&[u8]>| -> Result<u32, String> {
        let Some(bytes) = bytes else { return Ok(0) };
        out.resize(out.len().next_multiple_of(8), 0);
        let offset = u32::try_from(out.len()).map_err(|_| "over 4 GiB, the limit of .tfx")?;
        out.extend_from_slice(bytes);
        Ok(offset)
    };
    let header = Header {
        version: 4.0,
        strands: u32::try_from(strands).map_err(|_| "too many strands")?,
        vertices_per_strand: u32::try_from(each).map_err(|_| "too many points")?,
        positions: append(Some(bytemuck::cast_slice(&vertices)))?,
        strand_uv: append(groom.root_uvs.as_deref().map(bytemuck::cast_slice))?,
        vertex_uv: 0,
        thickness: append(thickness.as_deref().map(bytemuck::cast_slice))?,
        colour: append(colours.as_deref().map(bytemuck::cast_slice))?,
        reserved: [0; 32],
    };
    out[..size_of::<Header>()].copy_from_slice(bytemuck::bytes_of(&header));
    Ok(out)
}

fn mean(values: &[f32]) -> f32 {
    let (&first, rest) = match values.split_first() {
        Some(split) => split,
        None => return 0.0,
    };
    // Sum the differences to the first value, so that the mean of equal values is exact.
    first + rest.iter().map(|v| v - first).sum::<f32>() / values.len() as f32
}
