//! A body that bends: the clip that it plays, and its distance field.

use std::collections::BTreeMap;
use std::sync::Arc;

use forelock_core::body::character::{Character, Clip, Performance, PosingBuffers, Retarget};
use forelock_core::body::{BendingBox, BendingField, ClosedMesh, ColliderFrame, Shape};
use forelock_core::groom::{Groom, SkinnedRoots, SurfaceRoots, bind_roots};
use forelock_core::pose::Pose;
use glam::Vec3;

use super::AssetError;
use crate::scene::{BodySection, TimeSection};

/// Times a second at which a clip is sampled to find where the body is, and the most of all.
const SAMPLES_PER_SECOND: f64 = 30.0;
const MOST_SAMPLES: f64 = 3000.0;
/// Space around the body in all of its poses, metres: what it may move between two samples.
const MARGIN_M: f32 = 0.08;
/// Longest reach of a strand over its length, and what is added to it in metres: strands stretch a
/// little where solids press on them.
const STRETCH: f32 = 1.1;
const ROOM_M: f32 = 0.02;
/// Cells of the field near the skin, over `sdf_near_cell`: they are computed anew in each step.
const COARSER: f32 = 2.0;
/// The longest motion of a particle in a substep that is not swept, in cells near the skin.
const THIN_CELLS: f32 = 4.0;

/// The body as a solid.
#[derive(Clone, Debug)]
pub(crate) struct BendingSolid {
    /// Its field at rest.
    pub(crate) field: BendingField,
    friction: f64,
}

impl BendingSolid {
    /// The solid with the `shape`, which moves with the joint that carries the hair between two
    /// poses.
    pub(crate) fn frame<'a>(&self, shape: &'a Shape, [from, to]: [Pose; 2]) -> ColliderFrame<'a> {
        ColliderFrame { shape, local: Pose::IDENTITY, from, to, friction: self.friction }
    }
}

/// The performance that `section` asks of `character`, whose hair has the roots of `groom`; none if
/// it only moves as a whole.
pub(super) fn performance(
    section: &BodySection,
    character: &Arc<Character>,
    groom: &Groom,
    notes: &mut Vec<String>,
) -> Result<Option<Performance>, AssetError> {
    let motion = &section.motion;
    if motion.builtin_name().is_some() || !motion.keyframes.is_empty() {
        let is_usual = *motion == BodySection::default().motion;
        let clips: Vec<&str> = character.clips().iter().map(|clip| &*clip.name).collect();
        if is_usual && !clips.is_empty() && !section.is_named() {
            let clips = clips.join("`, `");
            notes.push(format!("{}: no clip is played; `body.motion` may be `{clips}`", section.mesh));
        }
        return Ok(None);
    }
    let clip = if motion.is_file() {
        let own = forelock_io::read_motion(motion.name.as_ref())?;
        let retarget = Retarget::new(&own.skeleton, character.skeleton(), &motion.clip.joints)?;
        notes.extend(unmatched(&motion.name, &retarget, &motion.clip.joints));
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
    let is_baked = !motion.is_file() && forelock_io::is_baked(section.mesh.as_ref());
    let playback = motion.clip.playback(is_baked);
    Ok(Some(Performance::new(character.clone(), clip, playback, section.skinning, joint)?))
}

/// What to say of a run that goes on for more than a frame after the end of `performance`.
pub(super) fn still_end(performance: &Performance, time: &TimeSection) -> Option<String> {
    let playback = performance.playback();
    let left = performance.clip().duration_secs() - playback.start_secs;
    let ends = left.max(0.0) / playback.speed.max(1e-3);
    let frames = (ends * time.fps).round().max(1.0);
    (!playback.repeats && f64::from(time.frames) > frames + 1.0).then(|| {
        format!(
            "the body's motion `{}` ends at {ends:.2} s, the run at {:.2} s: the body then stands \
             still; with `time.frames = {frames}` the run ends with the motion",
            performance.clip().name,
            f64::from(time.frames) / time.fps,
        )
    })
}

/// What to say of the joints that do not follow the motion of the file `path`, if there are any
/// that `map` does not name.
fn unmatched(path: &str, retarget: &Retarget<'_>, map: &BTreeMap<String, String>) -> Option<String> {
    let [mut own, others] = retarget.unmatched();
    own.retain(|name| !map.contains_key(*name));
    if own.is_empty() || others.is_empty() {
        return None;
    }
    let list = |names: &[&str]| {
        let shown = names.iter().take(12).copied().collect::<Vec<_>>().join(", ");
        if names.len() > 12 { format!("{shown}, …") } else { shown }
    };
    Some(format!(
        "{path}: {} joints of the body have no counterpart and keep their rest pose ({}); unused joints of the \
         motion are {}: see `body.motion.clip.joints`",
        own.len(),
        list(&own),
        list(&others),
    ))
}

/// The roots of `groom` on the body of `performance`.
pub(super) fn bind(performance: &Performance, groom: &Groom) -> SkinnedRoots {
    let mesh = performance.character().rest();
    let (bindings, _) = bind_roots(groom, mesh, &ClosedMesh::new(mesh));
    let roots: Vec<_> = groom.strands().map(|strand| strand.first().copied().unwrap_or_default()).collect();
    SkinnedRoots::new(SurfaceRoots::new(&roots, &bindings, mesh), performance.character().clone())
}

/// Whether the body of `performance` only moves as a whole, with the joint that carries the hair.
pub(super) fn is_rigid(performance: &Performance) -> bool {
    let character = performance.character();
    character.shapes().is_empty()
        && character.skin().bones().iter().all(|bone| bone.joint == performance.joint())
}

/// The body of `performance` as a solid, where the strands of `groom` can reach it; `None` if they
/// cannot.
pub(super) fn solid(
    section: &BodySection,
    groom: &Groom,
    performance: &Performance,
) -> Result<Option<BendingSolid>, AssetError> {
    let balls = reach(groom);
    let ends = balls.iter().flat_map(|(root, length)| [*root - *length, *root + *length]);
    let [low, high] = box_of(ends);
    let mesh = performance.character().rest();
    let (from, to) = mesh.bounds();
    let uniform = (to - from).max_element() / section.sdf_cells as f32;
    let near = COARSER * section.sdf_near_cell as f32;
    let near = if near > 0.0 { near.min(uniform) } else { uniform };
    let [least, most] = extent(performance);
    let margin = MARGIN_M + 2.0 * THIN_CELLS * near;
    let bounds = [low.max(least - margin), high.min(most + margin)];
    if !bounds[0].cmplt(bounds[1]).all() {
        return Ok(None);
    }
    let place = BendingBox { bounds, balls, near, thinness: uniform.clamp(near, THIN_CELLS * near) };
    let field = BendingField::new(mesh, &place).map_err(|error| AssetError::Solid {
        mesh: section.mesh.clone(),
        error,
        key: "body.collide = false",
    })?;
    Ok(Some(BendingSolid { field, friction: section.friction }))
}

/// The balls that the strands of `groom` can reach: root and radius.
fn reach(groom: &Groom) -> Vec<(Vec3, f32)> {
    let strands = groom.strands().enumerate();
    let ball = |(strand, points): (usize, &[Vec3])| {
        Some((*points.first()?, STRETCH * groom.length(strand) + ROOM_M))
    };
    strands.filter_map(ball).collect()
}

/// The box of the body in all poses of `performance`, relative to the joint that carries the hair.
fn extent(performance: &Performance) -> [Vec3; 2] {
    let playback = performance.playback();
    let seconds = playback.blend_secs + performance.clip().duration_secs() / playback.speed.abs().max(1e-3);
    let mut buffers = PosingBuffers::default();
    let samples = (seconds * SAMPLES_PER_SECOND).ceil().clamp(1.0, MOST_SAMPLES) as u32;
    let times = (0..=samples).map(|sample| seconds * f64::from(sample) / f64::from(samples));
    let boxes = times.map(|secs| box_of(performance.posed(secs, &mut buffers).positions.iter().copied()));
    boxes.fold([Vec3::INFINITY, Vec3::NEG_INFINITY], |[a, b], [low, high]| [a.min(low), b.max(high)])
}

/// The box around `points`, (low, high).
pub(super) fn box_of(points: impl Iterator<Item = Vec3>) -> [Vec3; 2] {
    points.fold([Vec3::INFINITY, Vec3::NEG_INFINITY], |[low, high], p| [low.min(p), high.max(p)])
}

/// Names for a message.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Names(Vec<String>);

impl std::fmt::Display for Names {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if self.0.is_empty() { f.write_str("none") } else { f.write_str(&self.0.join(", ")) }
    }
}
