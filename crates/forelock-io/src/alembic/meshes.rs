//! Meshes: objects of the schemas `AbcGeom_PolyMesh_v1` and `AbcGeom_SubD_v1`, as a character.
//!
//! # Theory
//! The compound `.geom` of such an object has the points `P`, the number of corners of each polygon
//! `.faceCounts` and the points of these corners `.faceIndices`, clockwise as seen from outside.
//!
//! # Practice
//! All meshes of a file become one body, with the transforms above them applied. What moves them is
//! found from their points at each sample (see `moving_mesh`), so it does not matter whether a
//! program stored it as points or as transforms.
//!
//! # Limitations
//! The polygons are those of the first sample. Subdivision surfaces are read as their control
//! polygons. Hidden objects are read like others.

use std::io::{Read, Seek};

use forelock_core::body::character::Character;
use forelock_core::groom::Unit;
use glam::{DAffine3, Vec3};

use super::{
    AlembicError, CURVES, all,
    archive::{Archive, Property},
    curves::Geometry,
    moving,
    ogawa::invalid,
    unit,
};
use crate::error::check_room;
use crate::moving_mesh::{self, MovingMesh, Room, character};

/// The schemas of meshes.
const SCHEMAS: [&str; 2] = ["AbcGeom_PolyMesh_v", "AbcGeom_SubD_v"];
/// Times nearer than this are one.
const SAME_SECS: f64 = 1e-6;

/// Reads the meshes of an archive as a character, in the unit and axes of the file. Returns it, the
/// unit of the file, and what was left out, one sentence each.
///
/// # Errors
/// [`AlembicError`] if `file` is not a complete Ogawa archive, or has no meshes.
pub fn read_character(file: impl Read + Seek) -> Result<(Character, Unit, Vec<String>), AlembicError> {
    let mut archive = Archive::open(file)?;
    let [polygons, surfaces] = SCHEMAS;
    let mut objects = all(&mut archive, &[polygons, surfaces, CURVES])?;
    let unit = unit(&archive, &objects);
    objects.retain(|own| !own.schema.starts_with(CURVES));
    let at = archive.top.offset();
    if objects.is_empty() {
        return Err(invalid(at, "there is no body: no object has the schema of meshes"));
    }
    let times = times(&archive, &objects)?;
    let mesh = |object: &Geometry| MovingMesh { name: object.name.clone(), ..MovingMesh::default() };
    let mut meshes: Vec<MovingMesh> = objects.iter().map(mesh).collect();
    let (mut room, mut left_out) = (Room::default(), 0);
    for (frame, &time_secs) in times.iter().enumerate() {
        archive.begin_samples();
        for (object, mesh) in objects.iter().zip(&mut meshes) {
            let world = match &object.parent {
                Some(parent) => parent.world(&mut archive, time_secs)?,
                None => DAffine3::IDENTITY,
            };
            let points = points(&mut archive, object, time_secs)?;
            if frame == 0 && !points.is_empty() {
                left_out += add_polygons(&mut archive, object, time_secs, is_mirror(&world), mesh)?;
            }
            room.take(mesh.push(points, world))?;
        }
    }
    let notes = moving_mesh::left_out(left_out).into_iter().collect();
    let character = character(meshes, &times).map_err(|words| invalid(at, words))?;
    Ok((character, unit, notes))
}

/// The times at which a point or a transform of `objects` changes, ascending, one at least.
fn times<R: Read + Seek>(archive: &Archive<R>, objects: &[Geometry]) -> Result<Vec<f64>, AlembicError> {
    let mut times: Vec<f64> = Vec::new();
    for samples in moving(objects) {
        let count = samples.until_last_change();
        check_room(8 * u64::from(count))?;
        times.extend((0..count).map(|sample| archive.time_secs(samples, sample)).filter(|t| t.is_finite()));
        // So that those who share their times take no more memory than one.
        times.sort_by(f64::total_cmp);
        times.dedup_by(|a, b| (*a - *b).abs() < SAME_SECS);
    }
    if times.is_empty() {
        times.push(0.0);
    }
    Ok(times)
}

/// Whether `map` turns surfaces inside out.
fn is_mirror(map: &DAffine3) -> bool {
    map.matrix3.determinant() < 0.0
}

/// The points of `object`.
fn points<R: Read + Seek>(
    archive: &mut Archive<R>,
    object: &Geometry,
    time_secs: f64,
) -> Result<Vec<Vec3>, AlembicError> {
    let property = Property::find(&object.geom, "P");
    let sample = property.map(|own| archive.sample(own, time_secs)).transpose()?.flatten();
    let floats = sample.and_then(|sample| sample.floats());
    let floats = floats.ok_or_else(|| invalid(0, format!("the mesh `{}` has no points", object.name)))?;
    Ok(floats.as_chunks::<3>().0.iter().map(|&p| Vec3::from_array(p)).collect())
}

/// Appends the triangles of `object` to those of `mesh`, with the winding reversed if it is
/// mirrored; returns how
/// many were left out.
fn add_polygons<R: Read + Seek>(
    archive: &mut Archive<R>,
    object: &Geometry,
    time_secs: f64,
    is_mirrored: bool,
    mesh: &mut MovingMesh,
) -> Result<usize, AlembicError> {
    let fail = |words: &str| invalid(0, format!("the mesh `{}` {words}", object.name));
    let mut integers = |name: &str| {
        let property = Property::find(&object.geom, name);
        let sample = property.map(|own| archive.sample(own, time_secs)).transpose()?.flatten();
        let values = sample.and_then(|sample| sample.integers());
        values.ok_or_else(|| fail(&format!("has no `{name}`")))
    };
    let (counts, corners) = (integers(".faceCounts")?, integers(".faceIndices")?);
    // Clockwise: the other way round than here.
    mesh.add_polygons(&counts, &corners, !is_mirrored).map_err(|words| fail(&words))
}
