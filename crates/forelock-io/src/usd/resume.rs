//! What a resumed cache keeps.

use std::{fs::File, path::Path};

use crc32fast::Hasher;
use forelock_core::groom::Groom;

use super::{
    crate_file,
    curves::SCHEMA,
    layer::{Held, Layer, Prim, Value},
};

/// The values of the frames that are kept.
pub(super) struct Kept {
    pub points: Vec<u64>,
    pub velocities: Vec<u64>,
    pub extent: Vec<u64>,
    /// The checksum of the points.
    pub crc: Hasher,
}

impl Kept {
    /// The frames at `codes` of the cache `path`, whose positions have the checksum `checksum`. The
    /// error is a sentence.
    pub fn read(
        path: &Path,
        groom: &Groom,
        codes_per_second: f64,
        codes: &[f64],
        checksum: u32,
    ) -> Result<Self, String> {
        let file = File::open(path).map_err(|error| error.to_string())?;
        let layer = crate_file::open(file).map_err(|error| error.to_string())?;
        let prim = layer.prims.iter().find(|prim| &*prim.kind == SCHEMA);
        let prim = prim.ok_or("it was not written by Forelock")?;
        check_strands(&layer, prim, groom)?;
        let rate = layer.number("timeCodesPerSecond").map_err(|error| error.to_string())?;
        if rate != Some(codes_per_second) {
            let rate = rate.map_or_else(|| "no rate".into(), |rate| format!("{rate} frames per second"));
            return Err(format!("it has {rate} in place of {codes_per_second}"));
        }
        let points = samples(&layer, prim, "points", codes)?.ok_or("it has no points")?;
        let mut crc = Hasher::new();
        for &value in &points {
            match &*layer.value(&Held::Packed(value)).map_err(|error| error.to_string())? {
                Value::Floats(numbers) if numbers.len() == 3 * groom.particle_count() => {
                    crc.update(bytemuck::cast_slice(numbers));
                }
                _ => return Err("it has frames of another length".into()),
            }
        }
        if crc.clone().finalize() != checksum {
            return Err("it does not hold the frames of this run, or it is damaged".into());
        }
        let velocities = samples(&layer, prim, "velocities", codes)?.unwrap_or_default();
        let extent = samples(&layer, prim, "extent", codes)?.ok_or("it was not written by Forelock")?;
        Ok(Self { points, velocities, extent, crc })
    }
}

/// Checks that `prim` has the strands of `groom`.
fn check_strands(layer: &Layer<File>, prim: &Prim, groom: &Groom) -> Result<(), String> {
    let counts = layer.find(prim, "curveVertexCounts", 0.0).map_err(|error| error.to_string())?;
    let wanted = groom.strand_offsets().windows(2).map(|pair| i64::from(pair[1] - pair[0]));
    match counts.as_deref() {
        Some(Value::Integers(counts)) if wanted.eq(counts.iter().copied()) => Ok(()),
        _ => Err("it holds other strands".into()),
    }
}

/// The values of the attribute `name` at `codes`, which must be its first samples; nothing if it
/// has none.
fn samples(layer: &Layer<File>, prim: &Prim, name: &str, codes: &[f64]) -> Result<Option<Vec<u64>>, String> {
    let Some(attribute) = prim.attributes.get(name) else { return Ok(None) };
    let samples = layer.samples(attribute).map_err(|error| error.to_string())?;
    if samples.times.get(..codes.len()) != Some(codes) {
        return Err(format!("the times of `{name}` are not those of the {} frames wanted", codes.len()));
    }
    let packed = |held: &Held| match held {
        Held::Packed(value) => Some(*value),
        Held::Value(_) => None,
    };
    Ok(samples.values[..codes.len()].iter().map(packed).collect())
}
