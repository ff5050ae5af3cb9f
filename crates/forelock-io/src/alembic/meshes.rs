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
    AlembicError, all,
    archive::{Archive, Property, Samples},
    curves::Geometry,
    noted_unit,
    ogawa::invalid,
};
use crate::error::check_room;
use crate::moving_mesh::{MovingMesh, character, fan};

/// The schemas of meshes.
const SCHEMAS: [&str; 2] = ["AbcGeom_PolyMesh_v", "AbcGeom_SubD_v"];
/// Bytes that a sample of a mesh takes at least.
const SAMPLE_BYTES: usize = 128;

/// Reads the meshes of an archive as a character, in the unit and axes of the file. Returns it, the
/// unit that the file notes, and what was left out, one sentence each.
///
/// # Errors
/// [`AlembicError`] if `file` is not a complete Ogawa archive, or has no meshes.
pub fn read_character(
    file: impl Read + Seek,
) -> Result<(Character, Option<Unit>, Vec<String>), AlembicError> {
    let mut archive = Archive::open(file)?;
    let objects = all(&mut archive, &SCHEMAS)?;
    let at = archive.top.offset();
    if objects.is_empty() {
        return Err(invalid(at, "there is no body: no object has the schema of meshes"));
    }
    let clock = moving(&objects).max_by_key(|samples| samples.distinct());
    let frames = clock.map_or(1, |samples| samples.distinct());
    check_room(u64::from(frames) * (objects.len() * SAMPLE_BYTES) as u64)?;
    let mesh = |object: &Geometry| MovingMesh { name: object.name.clone(), ..MovingMesh::default() };
    let mut meshes: Vec<MovingMesh> = objects.iter().map(mesh).collect();
    let (mut times, mut left_out) = (Vec::new(), 0);
    for frame in 0..frames {
        let time_secs = clock.map_or(0.0, |samples| archive.time_secs(samples, frame));
        archive.begin_samples();
        for (object, mesh) in objects.iter().zip(&mut meshes) {
            let world = match &object.parent {
                Some(parent) => parent.world(&mut archive, time_secs)?,
                None => DAffine3::IDENTITY,
            };
            if frame == 0 {
                left_out += polygons(&mut archive, object, time_secs, is_mirror(&world), mesh)?;
            }
            mesh.push(points(&mut archive, object, time_secs)?, world);
        }
        times.push(time_secs);
    }
    let notes = if left_out == 0 {
        Vec::new()
    } else {
        vec![format!("{left_out} triangles with a repeated corner are left out")]
    };
    let character = character(meshes, &times).map_err(|words| invalid(at, words))?;
    Ok((character, noted_unit(&archive), notes))
}

/// The samples of all points, and of the transforms above them.
fn moving(objects: &[Geometry]) -> impl Iterator<Item = Samples> + '_ {
    objects.iter().flat_map(|own| {
        let points = Property::find(&own.geom, "P").and_then(|points| points.samples);
        points.into_iter().chain(own.parent.as_ref().and_then(|parent| parent.samples()))
    })
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

/// Appends the triangles of `object` to those of `mesh`, turned over if it is mirrored; returns how
/// many were left out.
fn polygons<R: Read + Seek>(
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
    let (counts, indices) = (integers(".faceCounts")?, integers(".faceIndices")?);
    let mut left_out = 0;
    let mut rest = &indices[..];
    for count in counts {
        let split = usize::try_from(count).ok().and_then(|count| rest.split_at_checked(count));
        let (own, others) = split.ok_or_else(|| fail("has polygons with more corners than it has"))?;
        let corners: Result<Vec<u32>, _> = own.iter().map(|&corner| u32::try_from(corner)).collect();
        let corners = corners.map_err(|_| fail("has a corner below 0"))?;
        // Clockwise: the other way round than here.
        left_out += fan(&corners, !is_mirrored, &mut mesh.triangles);
        rest = others;
    }
    Ok(left_out)
}
