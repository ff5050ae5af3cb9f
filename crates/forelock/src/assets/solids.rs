//! The body and all other solids.

use std::borrow::Cow;
use std::sync::{Arc, OnceLock};

use forelock_core::body::character::Character;
use forelock_core::body::{
    ClosedMesh, ColliderFrame, Head, Horse, Morph, Motion, Prop, Sdf, Shape, Talker, TriMesh, Walker,
};
use forelock_core::meter::Meter;
use forelock_core::pose::Pose;
use glam::DVec3;

use super::{AssetError, distance_grid, motion, neck};
use crate::scalp::Cover;
use crate::scene::{ColliderSection, NEAR_CELL, Scene, ShapeKind};
use crate::sdf_cache::CellSizes;
use crate::tessellate;

/// Cells along the longest side of a mesh collider's distance grid.
const COLLIDER_CELLS: u32 = 96;

/// Meshes a second of a sequence that does not say.
const SEQUENCE_FPS: f64 = 24.0;

/// Times that are closer are the same, seconds.
pub(crate) const ROUNDING_SECS: f64 = 1e-9;

/// What hair grows on.
#[derive(Debug)]
pub(super) struct Body {
    pub(super) mesh: Cow<'static, TriMesh>,
    /// Its distance grid, if strands collide with it.
    pub(super) sdf: Option<Arc<Sdf>>,
    pivot: Option<DVec3>,
    /// Whether it has the vertices of the built-in head.
    pub(super) has_face: bool,
    /// How hair covers it, once a picture needs it.
    pub(super) cover: OnceLock<Cover>,
    /// It with its joints, if it has any.
    pub(super) character: Option<Arc<Character>>,
    /// What was changed when it was read.
    pub(super) notes: Vec<String>,
}

/// What to say of a body that is so large, so small or so far from the origin that its file is
/// probably read in a wrong unit, or float32 does not resolve its places.
fn unusual_place(mesh: &TriMesh) -> Option<String> {
    let (low, high) = mesh.bounds();
    let (size, away) = (low.distance(high), ((low + high) * 0.5).length());
    if !(SMALLEST_M..=LARGEST_M).contains(&size) {
        return Some(format!(
            "the body is {size:.3} m across: if its file is not in metres, set `body.unit`, or \
             `body.scale` (and `groom.unit` for hair in the same unit)"
        ));
    }
    (away > FARTHEST * size).then(|| {
        format!(
            "the body lies {away:.0} m from the origin of its file, where places are resolved to {:.3} mm only: \
             move it to the origin",
            1e3 * away * f32::EPSILON,
        )
    })
}

/// Sizes of a body beyond which it is noted, metres.
const LARGEST_M: f32 = 20.0;
const SMALLEST_M: f32 = 0.02;
/// The distance from the origin, over the size, from which a body is noted.
const FARTHEST: f32 = 50.0;

impl Body {
    /// The body of `scene`, if it has one.
    pub(super) fn load(scene: &Scene, meter: &Meter) -> Result<Option<Self>, AssetError> {
        let section = &scene.body;
        let (mut character, mut notes) = (None, Vec::new());
        let (mesh, pivot) = match section.mesh.as_str() {
            "none" => return Ok(None),
            "builtin:head" => (Cow::Borrowed(&Head::builtin().mesh), Some(Head::NECK_PIVOT.as_dvec3())),
            "builtin:horse" => (Cow::Borrowed(&Horse::builtin().mesh), Some(Horse::PIVOT.as_dvec3())),
            "builtin:walker" => {
                let walker = Walker::builtin();
                character = Some(walker.clone());
                (Cow::Borrowed(walker.rest()), None)
            }
            "builtin:talker" => {
                let talker = Talker::builtin();
                character = Some(talker.clone());
                (Cow::Borrowed(talker.rest()), None)
            }
            path if section.is_character() => {
                let read = forelock_io::read_character(path.as_ref(), &section.import())?;
                notes.extend(read.notes.into_iter().map(|note| format!("{path}: {note}")));
                let mesh = read.character.rest().clone();
                character = Some(Arc::new(read.character));
                (Cow::Owned(mesh), None)
            }
            path => (Cow::Owned(forelock_io::read_mesh(path.as_ref(), &section.import())?), None),
        };
        notes.extend(unusual_place(&mesh));
        let cells = CellSizes { along: section.sdf_cells, near: section.sdf_near_cell as f32 };
        let grid = || distance_grid(&mesh, &section.mesh, cells, "body.collide = false", meter);
        let sdf = section.collide.then(grid).transpose()?.map(Arc::new);
        let has_face = ["builtin:head", "builtin:talker"].contains(&section.mesh.as_str());
        Ok(Some(Self { mesh, sdf, pivot, has_face, cover: OnceLock::new(), character, notes }))
    }

    /// The point about which it turns.
    pub(super) fn pivot(&self) -> DVec3 {
        self.pivot.unwrap_or_else(|| {
            let (lo, hi) = self.mesh.bounds();
            neck(lo.as_dvec3(), hi.as_dvec3())
        })
    }
}

/// A solid and how it moves.
#[derive(Debug)]
pub(crate) struct Solid {
    /// Its shape in every frame, the last one for all that follow.
    pub(super) shapes: Vec<Shape>,
    /// Frames a second.
    pub(super) fps: f64,
    pub(super) friction: f64,
    pub(super) on_body: bool,
    /// Its pose before its motion.
    pub(super) base: Pose,
    pub(super) motion: Arc<Motion>,
    /// When it appears and disappears, seconds.
    pub(super) present: [f64; 2],
    pub(super) visible: bool,
    /// Meshes for pictures, one after the other; the body is drawn as itself.
    pub(super) meshes: Vec<TriMesh>,
    /// Meshes a second.
    pub(super) sequence_fps: f64,
    /// The mesh of which its shape is the distance grid, and its surface, which is made when it is
    /// asked for.
    pub(super) exact: Option<(Arc<TriMesh>, OnceLock<ClosedMesh>)>,
}

impl Solid {
    /// World from local at `time` seconds, when the body is at `head`.
    pub(crate) fn pose(&self, time: f64, head: &Pose) -> Pose {
        self.carrier(head, &self.motion.pose(time)).after(&self.base)
    }

    /// The solid between two `times` at which the body is at `head`.
    pub(super) fn frame(&self, times: [f64; 2], head: [Pose; 2]) -> ColliderFrame<'_> {
        let carriers = [0, 1].map(|end| self.carrier(&head[end], &self.motion.pose(times[end])));
        self.frame_between(times[0], carriers)
    }

    /// The solid in the frame that starts at `time` seconds, between two `carriers`.
    pub(crate) fn frame_between(&self, time: f64, carriers: [Pose; 2]) -> ColliderFrame<'_> {
        let shape = &self.shapes[nearest(time * self.fps, self.shapes.len())];
        let [from, to] = carriers;
        ColliderFrame { shape, local: self.base, from, to, friction: self.friction }
    }

    /// Whether it is there at `secs`.
    pub(crate) fn is_there(&self, secs: f64) -> bool {
        let [from, until] = self.present;
        from <= secs + ROUNDING_SECS && secs <= until + ROUNDING_SECS
    }

    /// Whether it takes part in a step between two `times`, seconds: not if it appears at the end
    /// of the step or disappears at its start.
    pub(crate) fn acts_between(&self, times: [f64; 2]) -> bool {
        let [from, until] = self.present;
        times[1] - from > ROUNDING_SECS && until - times[0] > ROUNDING_SECS
    }

    /// The mesh for a picture at `time` seconds, if the solid is there and visible: the nearest of
    /// its sequence.
    pub(crate) fn mesh_at(&self, time: f64) -> Option<&TriMesh> {
        let shown = if self.visible && self.is_there(time) { &self.meshes[..] } else { &[] };
        shown.get(nearest(time * self.sequence_fps, shown.len()))
    }

    /// The exact surface of which its shape is the distance grid; `None` for other shapes.
    pub(crate) fn surface(&self) -> Option<&ClosedMesh> {
        self.exact.as_ref().map(|(mesh, surface)| surface.get_or_init(|| ClosedMesh::new(mesh)))
    }

    /// The pose that carries the solid when the body is at `head` and its motion at `motion`.
    pub(crate) fn carrier(&self, head: &Pose, motion: &Pose) -> Pose {
        if self.on_body { head.after(motion) } else { *motion }
    }

    /// Its motion, relative to the body or the world.
    pub(crate) fn motion(&self) -> &Arc<Motion> {
        &self.motion
    }

    /// Its pose before its motion.
    pub(crate) fn base(&self) -> &Pose {
        &self.base
    }
}

/// The whole number nearest to `at`, within 0 to `count` − 1.
fn nearest(at: f64, count: usize) -> usize {
    (at.round().max(0.0) as usize).min(count.saturating_sub(1))
}

/// All solids of `scene`, a rigid `body` first.
pub(super) fn load(scene: &Scene, body: Option<&Body>, meter: &Meter) -> Result<Vec<Arc<Solid>>, AssetError> {
    let mut solids = Vec::with_capacity(scene.colliders.len() + 1);
    if let Some((body, sdf)) = body.and_then(|body| Some((body, body.sdf.as_ref()?))) {
        solids.push(Arc::new(Solid {
            shapes: vec![Shape::Sdf(sdf.clone())],
            fps: scene.time.fps,
            friction: scene.body.friction,
            on_body: true,
            base: Pose::IDENTITY,
            motion: Arc::default(),
            present: [0.0, f64::INFINITY],
            visible: true,
            meshes: Vec::new(),
            sequence_fps: 1.0,
            exact: Some((Arc::new(body.mesh.clone().into_owned()), OnceLock::new())),
        }));
    }
    for section in &scene.colliders {
        solids.push(Arc::new(solid(section, scene.time.fps, meter)?));
    }
    Ok(solids)
}

pub(super) fn solid(section: &ColliderSection, fps: f64, meter: &Meter) -> Result<Solid, AssetError> {
    let radius = section.radius.unwrap_or(0.1);
    let half_length = section.half_length.unwrap_or(0.1);
    let half_extents = DVec3::from_array(section.half_extents.unwrap_or([0.1; 3]));
    let (shape, mesh) = match section.shape {
        ShapeKind::Sphere => (Shape::Sphere { radius }, Some(tessellate::capsule(0.0, radius))),
        ShapeKind::HollowSphere => (Shape::HollowSphere { radius }, None),
        ShapeKind::Capsule => {
            (Shape::Capsule { half_length, radius }, Some(tessellate::capsule(half_length, radius)))
        }
        ShapeKind::Box => (Shape::Box { half_extents }, Some(tessellate::cuboid(half_extents.as_vec3()))),
        ShapeKind::Plane => (Shape::Plane, None),
        // Its shapes come from the sequence.
        ShapeKind::Mesh if !section.mesh_sequence.is_empty() => (Shape::Plane, None),
        ShapeKind::Mesh => {
            let path = section.mesh.as_deref().unwrap_or("".as_ref());
            let mesh = forelock_io::read_mesh(path, &section.import())?;
            let name = path.display().to_string();
            let cells = cell_sizes(section, COLLIDER_CELLS);
            let sdf = distance_grid(&mesh, &name, cells, "another `shape`", meter)?;
            (Shape::Sdf(Arc::new(sdf)), Some(mesh))
        }
        ShapeKind::Hand => prop(Prop::Hand, section, meter)?,
        ShapeKind::Comb => prop(Prop::Comb, section, meter)?,
        ShapeKind::HoledSphere => prop(Prop::HoledSphere { radius: radius as f32 }, section, meter)?,
    };
    let position = DVec3::from_array(section.position);
    let sequence_fps = section.sequence_fps.unwrap_or(SEQUENCE_FPS);
    let (shapes, meshes) = if section.mesh_sequence.is_empty() {
        (vec![shape], mesh.into_iter().collect())
    } else {
        sequence(section, sequence_fps / fps, meter)?
    };
    let exact = match (&shapes[..], &meshes[..]) {
        ([Shape::Sdf(_)], [mesh]) => Some((Arc::new(mesh.clone()), OnceLock::new())),
        _ => None,
    };
    Ok(Solid {
        shapes,
        fps,
        friction: section.friction,
        on_body: section.on_body,
        base: Pose::new(motion::rotation(section.rotation_degrees), position),
        motion: Arc::new(motion::from_section(&section.motion, position)?),
        present: [section.from_secs.unwrap_or(0.0), section.until_secs.unwrap_or(f64::INFINITY)],
        visible: section.visible,
        meshes,
        sequence_fps,
        exact,
    })
}

/// How fine the grid of `section` is, with `along` cells along the longest side if it does not say.
fn cell_sizes(section: &ColliderSection, along: u32) -> CellSizes {
    let near = section.sdf_near_cell.unwrap_or(NEAR_CELL);
    CellSizes { along: section.sdf_cells.unwrap_or(along), near: near as f32 }
}

/// A mesh that changes: its shape in each frame, which advances by `step` meshes, and its meshes.
fn sequence(
    section: &ColliderSection,
    step: f64,
    meter: &Meter,
) -> Result<(Vec<Shape>, Vec<TriMesh>), AssetError> {
    // A sequence has many fields: their cells are all alike, to save memory.
    let cells = CellSizes { near: 0.0, ..cell_sizes(section, COLLIDER_CELLS) };
    let (mut fields, mut meshes) = (Vec::new(), Vec::new());
    for path in &section.mesh_sequence {
        let mesh = forelock_io::read_mesh(path, &section.import())?;
        fields.push(distance_grid(&mesh, &path.display().to_string(), cells, "another `shape`", meter)?);
        meshes.push(mesh);
    }
    let frames = ((fields.len() - 1) as f64 / step).ceil() as u32;
    let Some(morph) = Morph::new(fields).map(Arc::new) else { return Ok((Vec::new(), meshes)) };
    let shape = |frame: u32| Shape::Morph {
        morph: morph.clone(),
        phases: [frame, frame + 1].map(|frame| f64::from(frame) * step),
    };
    // One more, in which it stands still.
    Ok(((0..=frames).map(shape).collect(), meshes))
}

/// A built-in solid as a distance grid.
fn prop(
    prop: Prop,
    section: &ColliderSection,
    meter: &Meter,
) -> Result<(Shape, Option<TriMesh>), AssetError> {
    let mesh = prop.mesh();
    let cells = cell_sizes(section, prop.field_nodes());
    let sdf = distance_grid(&mesh, section.shape.name(), cells, "fewer `sdf_cells`", meter)?;
    Ok((Shape::Sdf(Arc::new(sdf)), Some(mesh)))
}
