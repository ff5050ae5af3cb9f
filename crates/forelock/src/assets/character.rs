//! A body that bends: the clip that it plays, and its parts as solids.

use std::sync::{Arc, OnceLock};

use forelock_core::body::character::{Character, Clip, Performance, Retarget};
use forelock_core::body::{ClosedMesh, Motion, Shape, TriMesh};
use forelock_core::groom::{Groom, SurfaceRoots, bind_roots};
use forelock_core::meter::Meter;
use forelock_core::pose::Pose;
use glam::Vec3;

use super::solids::{Body, Solid};
use super::{AssetError, distance_grid};
use crate::scene::{BodySection, Scene};
use crate::sdf_cache::CellSizes;

/// A vertex belongs to the part of a joint that has at least this share of its weights. Parts of
/// neighbours overlap, so that no gap opens between them when a joint bends.
const PART_WEIGHT: f32 = 0.3;
/// Parts with a smaller surface are no solids, m².
const SMALLEST_PART: f32 = 1e-4;

/// The performance that `section` asks of `character`, whose hair has the roots of `groom`; none if
/// it only moves as a whole.
pub(super) fn performance(
    section: &BodySection,
    character: &Arc<Character>,
    groom: &Groom,
) -> Result<Option<Performance>, AssetError> {
    let motion = &section.motion;
    if motion.builtin_name().is_some() || !motion.keyframes.is_empty() {
        return Ok(None);
    }
    let clip = if motion.is_file() {
        let own = forelock_io::read_motion(motion.name.as_ref())?;
        let retarget = Retarget::new(&own.skeleton, character.skeleton(), &motion.clip.joints)?;
        Clip { name: motion.name.clone(), ..retarget.apply(&own.clip, &own.times()) }
    } else {
        let clips = character.clips();
        let found = clips.iter().find(|clip| clip.name == motion.name);
        let found = found.or_else(|| clips.iter().find(|clip| clip.name.eq_ignore_ascii_case(&motion.name)));
        let known = || clips.iter().map(|clip| clip.name.clone()).collect();
        found.ok_or_else(|| AssetError::Clip { name: motion.name.clone(), known: Names(known()) })?.clone()
    };
    let skeleton = character.skeleton();
    let joint = if section.joint.is_empty() {
        let (bindings, _) = bind_roots(groom, character.rest(), &ClosedMesh::new(character.rest()));
        let triangles = &character.rest().triangles;
        let vertices = bindings.iter().flat_map(|own| triangles[own.triangle as usize]);
        character.main_joint(vertices.map(|vertex| vertex as usize)).unwrap_or(0)
    } else {
        let known = || skeleton.joints().iter().map(|joint| joint.name.clone()).collect();
        let unknown = || AssetError::Joint { name: section.joint.clone(), known: Names(known()) };
        skeleton.find(&section.joint).ok_or_else(unknown)?
    };
    Ok(Some(Performance::new(character.clone(), clip, motion.clip.playback(), section.skinning, joint)?))
}

/// The roots of `groom` on the body of `performance`.
pub(super) fn bind(performance: &Performance, groom: &Groom) -> SurfaceRoots {
    let mesh = performance.character().rest();
    let (bindings, _) = bind_roots(groom, mesh, &ClosedMesh::new(mesh));
    let roots: Vec<_> = groom.strands().map(|strand| strand.first().copied().unwrap_or_default()).collect();
    SurfaceRoots::new(&roots, &bindings, mesh)
}

/// The box that the strands of `groom` can reach from where they are at rest.
fn reach(groom: &Groom) -> [Vec3; 2] {
    let longest = (0..groom.strand_count()).map(|strand| groom.length(strand)).fold(0.0, f32::max);
    let box_of = |[low, high]: [Vec3; 2], &p: &Vec3| [low.min(p), high.max(p)];
    let [low, high] = groom.positions().iter().fold([Vec3::INFINITY, Vec3::NEG_INFINITY], box_of);
    [low - longest, high + longest]
}

/// The parts of the body that joints move and the strands of `groom` can reach, each rigid.
pub(super) fn parts(
    scene: &Scene,
    body: &Body,
    groom: &Groom,
    performance: &Arc<Performance>,
    meter: &Meter,
) -> Result<Vec<Solid>, AssetError> {
    let section = &scene.body;
    let character = performance.character();
    let mut solids = Vec::new();
    if body.sdf.is_none() {
        return Ok(solids);
    }
    let [low, high] = reach(groom);
    for (joint, own) in character.skeleton().joints().iter().enumerate() {
        if !character.skin().bones().iter().any(|bone| bone.joint == joint) {
            continue;
        }
        let Some(mesh) = part(character, joint) else { continue };
        let (from, to) = mesh.bounds();
        if from.cmpgt(high).any() || to.cmplt(low).any() {
            continue;
        }
        let closed = ClosedMesh::new(&mesh);
        if closed.area() < SMALLEST_PART || !closed.encloses_something() {
            continue;
        }
        let name = format!("{}, joint {}", section.mesh, own.name);
        let cells = CellSizes { along: section.sdf_cells, near: section.sdf_near_cell as f32 };
        let grid = distance_grid(&mesh, &name, cells, "body.collide = false", meter)?;
        solids.push(Solid {
            shapes: vec![Shape::Sdf(Arc::new(grid))],
            fps: scene.time.fps,
            friction: section.friction,
            on_body: true,
            base: Pose::IDENTITY,
            motion: Arc::new(Motion::Part(performance.clone(), joint)),
            visible: false,
            meshes: Vec::new(),
            sequence_fps: 1.0,
            exact: Some((Arc::new(mesh), OnceLock::new())),
        });
    }
    Ok(solids)
}

/// The part of the mesh at rest that `joint` moves.
fn part(character: &Character, joint: usize) -> Option<TriMesh> {
    let bones = character.skin().bones();
    let belongs = |vertex: u32| {
        let own = character.skin().of_vertex(vertex as usize).filter(|own| bones[own.0].joint == joint);
        own.map(|own| own.1).sum::<f32>() >= PART_WEIGHT
    };
    let rest = character.rest();
    let triangles = rest.triangles.iter().filter(|corners| corners.iter().all(|&vertex| belongs(vertex)));
    let mut number = vec![u32::MAX; rest.positions.len()];
    let mut positions = Vec::new();
    let mut renumber = |vertex: u32| {
        let own = &mut number[vertex as usize];
        if *own == u32::MAX {
            *own = positions.len() as u32;
            positions.push(rest.positions[vertex as usize]);
        }
        *own
    };
    let triangles: Vec<[u32; 3]> = triangles.map(|corners| corners.map(&mut renumber)).collect();
    TriMesh::new(positions, triangles).ok()
}

/// Names for a message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Names(Vec<String>);

impl std::fmt::Display for Names {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if self.0.is_empty() { f.write_str("none") } else { f.write_str(&self.0.join(", ")) }
    }
}
