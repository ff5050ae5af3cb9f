//! Alembic `.abc`: grooms and motion caches, in the container Ogawa.
//!
//! # Theory
//! An archive is a tree of objects. Objects of the schema `AbcGeom_Curve_v2` hold strands, those of
//! `AbcGeom_PolyMesh_v1` and `AbcGeom_SubD_v1` meshes (`meshes`), and those of `AbcGeom_Xform_v3`
//! move what is below them. A property has samples, each at a time.
//! Unreal's schema for grooms adds attributes:
//!
//! | attribute | read | written | into |
//! | --- | --- | --- | --- |
//! | `P`, `nVertices` | yes | yes | positions, offsets |
//! | `width`, `groom_width` | yes | `width` | [`Groom::widths`] |
//! | `groom_color` | yes | yes | [`Groom::colours`] |
//! | `groom_root_uv`, `uv` | yes | `groom_root_uv` | [`Groom::root_uvs`] |
//! | `groom_id`, `groom_group_id`, `groom_guide`, `groom_closest_guides`, `groom_guide_weights` | yes | yes | [`Groom::labels`] |
//! | `.velocities` | yes | by [`CurvesWriter`] | [`Contents::velocities`] |
//!
//! # Practice
//! All strand groups of a file become one groom, in the order of the file, with the transforms
//! above them applied. A groom is the first frame.
//!
//! Alembic knows no units. Forelock writes metres and notes that in the metadata of the archive. A
//! file with `groom_version_major` and without this note is Unreal's, in centimetres, unless the
//! user names another unit; for such a file in metres, say cm and a scale of 100. For all others
//! the user's unit holds, metres by default.
//!
//! Alembic is y up by convention. Blender turns its scene, (x, y, z) → (x, z, −y), when it writes,
//! and back when it reads: what it wrote needs no `--up z` here.
//!
//! # Limitations
//! The HDF5 kind of Alembic, layers, instances, float16 and the names of groups
//! (`groom_group_name`) are not read. Hidden objects are read like others. Guides are strands among
//! the others: their labels tell them apart.

mod archive;
mod cache;
mod curves;
mod hash;
mod meshes;
mod ogawa;
mod output;
#[cfg(test)]
mod tests;
mod times;
mod transforms;
mod writer;

use std::{
    io::{self, Read, Seek},
    path::Path,
    sync::Arc,
};

use forelock_core::groom::{Groom, Unit};
use glam::Vec3;

pub use cache::CurvesWriter;
pub use meshes::read_character;
pub use writer::write;

use crate::error::{FormatError, ReadError};
use archive::{Archive, ObjectHeader, Property, Samples};
use curves::{Geometry, Joined};
use ogawa::{Child, invalid};
use transforms::Transform;

/// Objects within objects that are followed.
const DEPTH: usize = 128;
/// A file may have so many frames, or one a byte if that is more: frames that are equal to the one
/// before take no bytes.
const STILL_FRAMES: u64 = 1 << 20;
/// The key of the archive's metadata that names the unit of length.
const UNIT_KEY: &str = "forelock_unit";
/// How the names of the schemas of strands begin.
const CURVES: &str = "AbcGeom_Curve_v";
/// The metadata of strands.
const SCHEMA: &str = "schema=AbcGeom_Curve_v2;schemaBaseType=AbcGeom_GeomBase_v1";
/// The version of Unreal's schema for grooms, major and minor.
const VERSION: [i16; 2] = [1, 5];

/// Why an `.abc` cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum AlembicError {
    /// A read failed.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// The bytes do not follow the format.
    #[error(transparent)]
    Format(#[from] FormatError),
}

impl From<io::ErrorKind> for AlembicError {
    fn from(kind: io::ErrorKind) -> Self {
        Self::Io(kind.into())
    }
}

impl AlembicError {
    pub(crate) fn at(self, path: &Path) -> ReadError {
        match self {
            Self::Io(error) => ReadError::Io { path: path.into(), error },
            Self::Format(error) => ReadError::Format { path: path.into(), error },
        }
    }
}

/// A frame of a file.
#[derive(Clone, Debug, PartialEq)]
pub struct Contents {
    /// The strands, in the unit and axes of the file.
    pub groom: Groom,
    /// Velocities in units of the file per second, one entry for each particle.
    pub velocities: Option<Vec<Vec3>>,
}

/// An Alembic file whose frames are read on demand.
pub struct Reader<R> {
    archive: Archive<R>,
    curves: Vec<Geometry>,
    /// The samples of the points or transforms that have the most.
    clock: Option<Samples>,
    unit: Unit,
}

impl<R: Read + Seek> Reader<R> {
    /// Opens an archive and finds its strands.
    ///
    /// # Errors
    /// [`AlembicError`] if `file` is not a complete Ogawa archive, or has no strands.
    pub fn open(file: R) -> Result<Self, AlembicError> {
        let mut archive = Archive::open(file)?;
        let curves = all(&mut archive, &[CURVES])?;
        if curves.is_empty() {
            let words = "there are no strands: no object has the schema of curves";
            return Err(invalid(archive.top.offset(), words));
        }
        let samples = curves.iter().flat_map(moving).filter_map(|property| property.samples);
        let clock = samples.max_by_key(|samples| samples.count);
        let (frames, size) = (clock.map_or(0, |samples| samples.count), archive.size());
        if u64::from(frames) > size.max(STILL_FRAMES) {
            let words = format!("{frames} frames are too many for a file of {size} bytes; it is damaged");
            return Err(invalid(archive.top.offset(), words));
        }
        let unit = unit(&archive, &curves);
        Ok(Self { archive, curves, clock, unit })
    }

    /// The number of frames.
    pub fn frames(&self) -> u32 {
        self.clock.map_or(0, |samples| samples.count)
    }

    /// The time of frame `frame` in seconds.
    pub fn time_secs(&self, frame: u32) -> f64 {
        self.clock.map_or(0.0, |samples| self.archive.time_secs(samples, frame))
    }

    /// The unit of the file where the user names none.
    pub fn unit(&self) -> Unit {
        self.unit
    }

    /// The names of the strand groups, with those of the objects above them.
    pub fn names(&self) -> impl ExactSizeIterator<Item = &str> {
        self.curves.iter().map(|curves| curves.name.as_str())
    }

    /// Reads all strands at the time of frame `frame`. Behind the last frame strands stay.
    ///
    /// # Errors
    /// [`AlembicError`] if the bytes do not follow the format, or strands and points do not match.
    pub fn read(&mut self, frame: u32) -> Result<Contents, AlembicError> {
        let time_secs = self.time_secs(frame);
        self.archive.begin_samples();
        let mut joined = Joined::new(self.archive.size());
        for curves in &self.curves {
            joined.add(&mut self.archive, curves, time_secs)?;
        }
        joined.finish()
    }
}

/// Reads the groom in an archive, at its first frame. Units and axes are those of the file.
///
/// # Errors
/// As [`Reader::open`] and [`Reader::read`].
pub fn read(file: impl Read + Seek) -> Result<Groom, AlembicError> {
    Ok(Reader::open(file)?.read(0)?.groom)
}

/// The points of `object`, and the transforms above it.
fn moving(object: &Geometry) -> impl Iterator<Item = &Property> {
    let points = Property::find(&object.geom, "P");
    points.into_iter().chain(object.parent.iter().flat_map(|parent| parent.moving()))
}

/// The unit of length of an archive with `objects`, unless the user names another one.
fn unit<R>(archive: &Archive<R>, objects: &[Geometry]) -> Unit {
    let noted = value(&archive.metadata, UNIT_KEY).and_then(|unit| unit.parse().ok());
    let is_unreal = objects.iter().any(|own| Property::find(&own.others, "groom_version_major").is_some());
    noted.unwrap_or(if is_unreal { Unit::Centimetre } else { Unit::Metre })
}

/// All objects of an archive whose schema begins with one of `schemas`, in the order of the file.
fn all<R: Read + Seek>(archive: &mut Archive<R>, schemas: &[&str]) -> Result<Vec<Geometry>, AlembicError> {
    let mut found = Vec::new();
    let group = archive.top;
    let node = Node { path: String::new(), metadata: Arc::from(""), group, parent: None, depth: 0 };
    visit(archive, schemas, &mut found, node)?;
    Ok(found)
}

/// An object on the way through the tree.
struct Node {
    /// The names of the object and those above it.
    path: String,
    metadata: Arc<str>,
    group: Child,
    /// The transform that the object inherits.
    parent: Option<Arc<Transform>>,
    depth: usize,
}

/// Collects the objects of `schemas` at and below the object `node`.
fn visit<R: Read + Seek>(
    archive: &mut Archive<R>,
    schemas: &[&str],
    found: &mut Vec<Geometry>,
    node: Node,
) -> Result<(), AlembicError> {
    let Node { path, metadata, group, mut parent, depth } = node;
    if depth > DEPTH {
        return Err(invalid(group.offset(), format!("objects lie more than {DEPTH} deep")));
    }
    let object = archive.object(group)?;
    archive.spend_path(&path, group)?;
    let schema = value(&metadata, "schema").unwrap_or_default();
    if schemas.iter().any(|own| schema.starts_with(own)) {
        found.push(read_geometry(archive, object.properties, [&path, schema], parent.clone())?);
    } else if schema.starts_with("AbcGeom_Xform_v") {
        let properties = archive.properties(object.properties)?;
        if let Some(xform) = Property::find(&properties, ".xform") {
            parent = Some(Arc::new(Transform::read(archive, xform.group, parent)?));
        }
    }
    for ObjectHeader { name, metadata, group } in object.children {
        let path = format!("{path}/{name}");
        visit(
            archive,
            schemas,
            found,
            Node { path, metadata, group, parent: parent.clone(), depth: depth + 1 },
        )?;
    }
    Ok(())
}

/// The object with the properties in the group `properties`.
fn read_geometry<R: Read + Seek>(
    archive: &mut Archive<R>,
    properties: Child,
    [path, schema]: [&str; 2],
    parent: Option<Arc<Transform>>,
) -> Result<Geometry, AlembicError> {
    let properties = archive.properties(properties)?;
    let geom = Property::find(&properties, ".geom")
        .ok_or_else(|| invalid(0, format!("`{path}` has a schema of geometry, but no `.geom`")))?;
    let geom = archive.properties(geom.group)?;
    let others = match Property::find(&geom, ".arbGeomParams") {
        Some(others) => archive.properties(others.group)?,
        None => Vec::new(),
    };
    let (geom, others) = (with_parts(archive, geom)?, with_parts(archive, others)?);
    Ok(Geometry { name: path.to_owned(), schema: schema.to_owned(), parent, geom, others })
}

/// The properties `all`, and behind them the parts of compounds: `uv.vals` and `uv.indices` of the
/// compound `uv`.
fn with_parts<R: Read + Seek>(
    archive: &mut Archive<R>,
    mut all: Vec<Property>,
) -> Result<Vec<Property>, AlembicError> {
    for at in 0..all.len() {
        if all[at].samples.is_some() || all[at].name == ".arbGeomParams" {
            continue;
        }
        for part in archive.properties(all[at].group)? {
            let name = format!("{}{}", all[at].name, part.name);
            all.push(Property { name, ..part });
        }
    }
    Ok(all)
}

/// The value of `key` in `metadata`, which is `key=value;…`.
fn value<'a>(metadata: &'a str, key: &str) -> Option<&'a str> {
    metadata.split(';').find_map(|pair| pair.strip_prefix(key)?.strip_prefix('='))
}
