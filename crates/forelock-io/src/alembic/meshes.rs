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
use crate::moving_mesh::{self, Meshes, MovingMesh, Order, Room};

/// The schemas of meshes.
const SCHEMAS: [&str; 2] = ["AbcGeom_PolyMesh_v", "AbcGeom_SubD_v"];
/// Times nearer than this are one.
const SAME_SECS: f64 = 1e-6;
/// The bytes that meshes may take in memory for each byte of the file.
const ROOM: u64 = 16;

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
    let fail = |words: String| invalid(at, words);
    let (mut meshes, mut left_out) = (Meshes::new(Room::new(archive.size(), ROOM)), 0);
    for object in &objects {
        let times = times(&mut archive, object)?;
        meshes.take(size_of_val(&*times)).map_err(fail)?;
        let mut mesh = meshes.begin(object.name.clone(), &times);
        let mut before: Option<(u64, Vec<Vec3>)> = None;
        for (frame, &time_secs) in times.iter().enumerate() {
            archive.begin_samples();
            let world = match &object.parent {
                Some(parent) => parent.world(&mut archive, time_secs)?,
                None => DAffine3::IDENTITY,
            };
            let points = points(&mut archive, object, time_secs, before.take())?;
            if frame == 0 && !points.1.is_empty() {
                left_out += add_polygons(&mut archive, object, time_secs, is_mirror(&world), &mut mesh)?;
            }
            mesh.push(&points.1, &world).map_err(fail)?;
            before = Some(points);
        }
        mesh.finish().map_err(fail)?;
    }
    let notes = moving_mesh::left_out(left_out).into_iter().collect();
    Ok((meshes.finish().map_err(fail)?, unit, notes))
}

/// The times of the first samples of points and transforms of `object`, and of all around changes,
/// ascending, one at least.
fn times<R: Read + Seek>(archive: &mut Archive<R>, object: &Geometry) -> Result<Vec<f64>, AlembicError> {
    let mut times: Vec<f64> = Vec::new();
    for property in moving(object) {
        times.extend(archive.changes(property)?.into_iter().filter(|time| time.is_finite()));
        // So that those who share their times take no more memory than one.
        times.sort_unstable_by(f64::total_cmp);
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

/// The points of `object`, and where they are in the file: those `before`, if they are the same.
fn points<R: Read + Seek>(
    archive: &mut Archive<R>,
    object: &Geometry,
    time_secs: f64,
    before: Option<(u64, Vec<Vec3>)>,
) -> Result<(u64, Vec<Vec3>), AlembicError> {
    let missing = || invalid(0, format!("the mesh `{}` has no points", object.name));
    let property = Property::find(&object.geom, "P").ok_or_else(missing)?;
    let place = archive.place(property, time_secs)?.ok_or_else(missing)?;
    if let Some(before) = before.filter(|before| before.0 == place.offset()) {
        return Ok(before);
    }
    let sample = archive.sample_at(property, place)?;
    let points = sample.points().ok_or_else(missing)?;
    Ok((place.offset(), points))
}

/// Appends the triangles of `object` to those of `mesh`, with the winding reversed if it is
/// mirrored; returns how many were left out.
fn add_polygons<R: Read + Seek>(
    archive: &mut Archive<R>,
    object: &Geometry,
    time_secs: f64,
    is_mirrored: bool,
    mesh: &mut MovingMesh<'_>,
) -> Result<usize, AlembicError> {
    let fail = |words: &str| invalid(0, format!("the mesh `{}` {words}", object.name));
    let mut integers = |name: &str| {
        let property = Property::find(&object.geom, name);
        let sample = property.map(|own| archive.sample(own, time_secs)).transpose()?.flatten();
        let values = sample.and_then(|sample| sample.integers());
        values.ok_or_else(|| fail(&format!("has no `{name}`")))
    };
    let (counts, corners) = (integers(".faceCounts")?, integers(".faceIndices")?);
    // Programs reverse their polygons, which are clockwise in the file.
    let order = Order { is_clockwise: !is_mirrored, is_backwards: true };
    mesh.add_polygons(&counts, &corners, order).map_err(|words| invalid(0, words))
}
