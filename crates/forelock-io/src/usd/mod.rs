//! Universal Scene Description: `.usda` (text), `.usdc` (binary) and `.usd` (either).
//!
//! # Theory
//! A layer holds prims, which have attributes with a value, samples at times, or both. A groom is a
//! `BasisCurves` prim: `curveVertexCounts`, `points`, `widths` and *primvars*, which are further
//! values of all, a curve or a control point. The prims above it transform it. The layer says the
//! metres of its unit (`metersPerUnit`, 0.01 if absent) and its up axis (`upAxis`, y if absent).
//! Times are in time codes, `timeCodesPerSecond` (24 if absent).
//!
//! # Practice
//! [`read_groom`](crate::read_groom) reads all `BasisCurves` of a file at its first sample, and
//! [`Usd`] each frame. Positions are those of the layer, after all transforms, and are converted
//! by the unit and the up axis of the layer. A unit other than metres that the user gives replaces
//! the layer's, `--up z` replaces `upAxis = "Y"`, and the scale multiplies. Blender writes its own
//! axes, z up, below a prim that turns by −90° about x, and `upAxis = "Y"`: (x, y, z) is read as
//! (x, z, −y).
//!
//! | attribute | read into |
//! | --- | --- |
//! | `widths` | widths |
//! | `primvars:displayColor` | colours |
//! | `primvars:displayOpacity` | 1 − transparencies |
//! | `primvars:st`, `groom_root_uv`, `root_uv`, `uv`, `surface_uv_coordinate` or `UVMap` | root UVs |
//! | `primvars:groom_id`, `groom_group_id`, `groom_guide`, `groom_closest_guides`, `groom_guide_weights` | labels |
//! | `primvars:forelock_pinned`, `_stiffness`, `_root_…` | what only this program knows |
//!
//! [`write_groom`](crate::write_groom) writes linear curves in metres, y up: text for `.usda`,
//! binary for `.usdc` and `.usd`. [`UsdCacheWriter`] writes a binary file with samples, frame by
//! frame.
//!
//! [`read_character`](crate::read_character) reads all `Mesh` prims as one body.
//!
//! # Limitations
//! One layer: sublayers, references, payloads, variants and instances are not followed;
//! `usdcat --flatten` makes one layer of them. No archives (`.usdz`). Text is read into memory with
//! all samples. Cubic curves become strands
//! with a particle for each control point. Attributes whose number of values does not fit are left
//! out, and so are visibility and purpose.

mod attributes;
mod cache;
mod coding;
mod crate_file;
mod crate_tables;
mod curves;
mod layer;
mod meshes;
mod names;
mod prims;
mod resume;
mod source;
mod text;
mod values;
mod write;
mod xform;

use std::{
    io::{self, Read, Seek, SeekFrom},
    path::Path,
};

use forelock_core::groom::{Groom, GroomError, Import, Unit, Up};

pub use cache::UsdCacheWriter;
pub use meshes::read_character;
pub use write::{write_binary, write_text};

use self::layer::Layer;
use crate::error::{FormatError, Problem, ReadError, check_room};

/// Metres of a unit where the layer does not say.
const METRES_PER_UNIT: f64 = 0.01;
/// Time codes of a second where the layer does not say.
const CODES_PER_SECOND: f64 = 24.0;

/// Why a layer cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum UsdError {
    /// A read failed.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// The bytes do not follow the format.
    #[error(transparent)]
    Format(#[from] FormatError),
}

impl UsdError {
    pub(crate) fn at(self, path: &Path) -> ReadError {
        match self {
            Self::Io(error) => ReadError::Io { path: path.into(), error },
            Self::Format(error) => ReadError::Format { path: path.into(), error },
        }
    }
}

fn invalid(words: impl Into<String>) -> UsdError {
    FormatError { format: ".usd", offset: 0, strand: None, problem: Problem::Invalid(words.into()) }.into()
}

fn from_groom(error: GroomError) -> UsdError {
    FormatError { format: ".usd", offset: 0, strand: None, problem: error.into() }.into()
}

/// An open layer.
///
/// ```
/// use forelock_core::groom::{Groom, Import, ZUp};
/// use forelock_io::usd::Usd;
///
/// let text = r#"#usda 1.0
/// ( metersPerUnit = 0.01 )
/// def BasisCurves "hair" {
///     int[] curveVertexCounts = [2]
///     uniform token type = "linear"
///     point3f[] points.timeSamples = { 0: [(0, 0, 0), (0, 5, 0)], 12: [(0, 0, 0), (0, 6, 0)] }
/// }"#;
/// let layer = Usd::open(std::io::Cursor::new(text))?;
/// assert_eq!(layer.times_secs(), [0.0, 0.5]);
/// let mut groom = layer.frame(1)?;
/// layer.import(&Import::default()).apply(&mut groom, ZUp::Common);
/// assert!((groom.length(0) - 0.06).abs() < 1e-6);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Usd<R> {
    layer: Layer<R>,
    /// The prims that hold curves.
    curves: Vec<usize>,
    /// The times of the frames, in time codes.
    times: Vec<f64>,
    times_secs: Vec<f64>,
    metres_per_unit: f64,
    is_z_up: bool,
}

impl<R: Read + Seek> Usd<R> {
    /// Opens the layer in `reader`, text or binary. A binary file is read only as far as needed.
    ///
    /// # Errors
    /// [`UsdError`] if it is no layer, or has no curves.
    pub fn open(reader: R) -> Result<Self, UsdError> {
        let layer = open_layer(reader)?;
        let prims = layer.prims.iter().enumerate();
        let curves: Vec<usize> =
            prims.filter(|(_, prim)| &*prim.kind == curves::SCHEMA).map(|(index, _)| index).collect();
        if curves.is_empty() {
            return Err(invalid(
                "it has no BasisCurves; if other files hold them, make one of all with `usdcat --flatten`",
            ));
        }
        let mut codes = times(&layer, &curves, &|name| name == "points")?;
        if codes.len() < 2 {
            codes = times(&layer, &curves, &|name| name == "points" || is_of_transform(name))?;
        }
        let Stage { metres_per_unit, is_z_up, codes_per_second } = Stage::of(&layer)?;
        let times_secs = codes.iter().map(|code| code / codes_per_second).collect();
        Ok(Self { layer, curves, times: codes, times_secs, metres_per_unit, is_z_up })
    }

    /// The times of the frames in seconds, `[F]`: the samples of the points, or if these do not
    /// change, of the transforms above them. Empty if nothing changes.
    pub fn times_secs(&self) -> &[f64] {
        &self.times_secs
    }

    /// The groom at frame `frame`, in the units and axes of the layer. Curves that do not change
    /// have frame 0 alone.
    ///
    /// # Errors
    /// [`UsdError`] if there is no such frame, or its values do not fit.
    pub fn frame(&self, frame: usize) -> Result<Groom, UsdError> {
        let time = match self.times.get(frame) {
            Some(&time) => time,
            None if frame == 0 => f64::NEG_INFINITY,
            None => return Err(invalid(format!("there is no frame {frame}: it has {}", self.times.len()))),
        };
        curves::groom(&self.layer, &self.curves, time)
    }

    /// The conversion of [`frame`](Self::frame) to metres and y up: what the user `asked` for, and
    /// otherwise what the layer says.
    pub fn import(&self, asked: &Import) -> Import {
        import(asked, self.metres_per_unit, self.is_z_up)
    }
}

/// The layer in `reader`, text or binary.
fn open_layer<R: Read + Seek>(mut reader: R) -> Result<Layer<R>, UsdError> {
    let mut magic = Vec::new();
    reader.by_ref().take(8).read_to_end(&mut magic)?;
    let size = reader.seek(SeekFrom::End(0))?;
    reader.seek(SeekFrom::Start(0))?;
    let layer = if magic == crate_file::MAGIC {
        crate_file::open(reader)?
    } else if magic.starts_with(b"PK") {
        return Err(invalid("this is an archive (.usdz); unpack it and read the layer in it"));
    } else if magic.starts_with(text::MAGIC.as_bytes()) {
        check_room(size)?;
        let mut bytes = Vec::new();
        reader.read_to_end(&mut bytes)?;
        text::read(&String::from_utf8_lossy(&bytes))?
    } else {
        return Err(invalid("this is no layer: it begins neither with `#usda` nor with `PXR-USDC`"));
    };
    Ok(layer)
}

/// What the metadata of a layer say of its numbers.
struct Stage {
    metres_per_unit: f64,
    is_z_up: bool,
    codes_per_second: f64,
}

impl Stage {
    fn of<R: Read + Seek>(layer: &Layer<R>) -> Result<Self, UsdError> {
        let positive = |name: &str, default: f64| {
            let value = layer.number(name)?.unwrap_or(default);
            let message = || invalid(format!("`{name}` is {value}, but must be above 0"));
            (value.is_finite() && value > 0.0).then_some(value).ok_or_else(message)
        };
        let up = layer.metadata.get("upAxis").map(|held| layer.value(held)).transpose()?;
        Ok(Self {
            metres_per_unit: positive("metersPerUnit", METRES_PER_UNIT)?,
            is_z_up: up.as_ref().and_then(|up| up.word()) == Some("Z"),
            codes_per_second: positive("timeCodesPerSecond", CODES_PER_SECOND)?,
        })
    }
}

/// Whether the attribute `name` is an operation of a transform.
fn is_of_transform(name: &str) -> bool {
    name.starts_with("xformOp")
}

/// The times of all samples of the attributes for whose name `is_one` is true, of the prims
/// `indices` and those above them, in time codes, ascending.
fn times<R: Read + Seek>(
    layer: &Layer<R>,
    indices: &[usize],
    is_one: &dyn Fn(&str) -> bool,
) -> Result<Vec<f64>, UsdError> {
    let mut times: Vec<f64> = Vec::new();
    let mut seen = vec![false; layer.prims.len()];
    for &index in indices {
        let mut next = Some(index);
        while let Some(index) = next.filter(|&index| !std::mem::replace(&mut seen[index], true)) {
            let prim = &layer.prims[index];
            for (_, attribute) in prim.attributes.iter().filter(|(name, _)| is_one(name)) {
                let samples = layer.samples(attribute)?;
                times.extend(samples.times.iter().filter(|time| time.is_finite()));
            }
            next = prim.parent;
        }
        // So that prims that share their times take no more memory than one.
        times.sort_by(f64::total_cmp);
        times.dedup();
    }
    Ok(times)
}

/// The conversion to metres and y up: what the user `asked` for, and otherwise what the layer says.
fn import(asked: &Import, metres_per_unit: f64, is_z_up: bool) -> Import {
    let is_asked = asked.unit != Unit::Metre;
    Import {
        unit: asked.unit,
        up: if is_z_up { Up::Z } else { asked.up },
        scale: if is_asked { asked.scale } else { asked.scale * metres_per_unit },
    }
}
