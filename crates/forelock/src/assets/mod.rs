//! What a scene names, loaded: strands, body, solids and their motions.
//!
//! # Practice
//! [`Assets::load`] reads or grows the groom, repairs and resamples it, reads or makes the body,
//! turns meshes into distance grids, and brings strands that start inside the body out of it. Every
//! repair is reported in a note.

mod character;
mod groom;
mod motion;
mod solids;

use std::borrow::Cow;
use std::sync::{Arc, OnceLock};

use forelock_core::body::character::{CharacterError, Performance, PosingBuffers, RetargetError};
use forelock_core::body::{ColliderFrame, Head, Motion, Sdf, SdfError, TriMesh};
use forelock_core::groom::edit::{Edit, EditError, EditReport};
use forelock_core::groom::{Groom, SkinnedRoots};
use forelock_core::meter::Meter;
use forelock_core::pose::Pose;
use forelock_io::Cache;
use forelock_neural::model::Model;
use glam::DVec3;

use crate::hash::Fnv;
use crate::neural;
use crate::pictures::frame_time_secs;
use crate::progress::{Observer, Progress, watch};
use crate::scalp::Cover;
use crate::scene::{
    CameraSection, ColliderSection, GroomSource, HairSection, MotionSection, OutputSection, Scene,
};
use crate::sdf_cache::CellSizes;
pub(crate) use character::BendingSolid;
pub use character::Names;
use solids::Body;
pub(crate) use solids::{ROUNDING_SECS, Solid};

/// Times of a performance that a fingerprint is made of.
const MOMENTS: u32 = 16;

/// Why something that a scene names cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum AssetError {
    /// A file cannot be read.
    #[error(transparent)]
    Read(#[from] forelock_io::ReadError),
    /// Growth failed.
    #[error("hair cannot be grown: {0}")]
    Grow(#[from] forelock_core::groom::grow::GrowError),
    /// Nothing of the body is in the box that hair grows in.
    #[error(
        "`groom.region_box` holds no vertex of the body, which lies between {0:.2} and {1:.2} (metres): \
         choose corners around the part that hair grows on"
    )]
    EmptyBox(glam::Vec3, glam::Vec3),
    /// Several files do not make one groom.
    #[error(transparent)]
    Groom(#[from] forelock_core::groom::GroomError),
    /// Strands cannot be resampled.
    #[error("the strands cannot be resampled: {0}")]
    Resample(#[from] forelock_core::groom::ResampleError),
    /// The groom does not fit into the memory.
    #[error(transparent)]
    Memory(#[from] forelock_core::memory::MemoryError),
    /// `groom.vertices` does not suit the strands.
    #[error("`groom.vertices` is {vertices}, but {strands} strands take 2 to 1000 each: between {} and {}", 2 * .strands, 1000 * .strands)]
    Vertices {
        /// What was asked for.
        vertices: usize,
        /// Strands of the groom.
        strands: usize,
    },
    /// A strand would get too many of them.
    #[error(
        "of `groom.vertices` strand {strand} would get {particles}, more than 1000, for it is much longer than others: lower it"
    )]
    Uneven {
        /// Which.
        strand: usize,
        /// What it would get.
        particles: usize,
    },
    /// An edit cannot be done.
    #[error("edit {number} ({operation}) cannot be done: {error}")]
    Edit {
        /// Which, from 1.
        number: usize,
        /// Its `op`.
        operation: &'static str,
        /// What is wrong.
        error: EditError,
    },
    /// An edit removes all strands.
    #[error("edit {number} ({operation}) leaves no strands: change its parameters, or select with `only`")]
    NoStrands {
        /// Which, from 1.
        number: usize,
        /// Its `op`.
        operation: &'static str,
    },
    /// No motion of that name.
    #[error("there is no motion `{0}`")]
    Motion(String),
    /// The character has no clip of that name.
    #[error("there is no clip \"{name}\" in the body's file; it has: {known}")]
    Clip {
        /// The name.
        name: String,
        /// Those that there are.
        known: Names,
    },
    /// The character has no joint of that name.
    #[error("body.joint: there is no joint \"{name}\"; the body has: {known}")]
    Joint {
        /// The name.
        name: String,
        /// Those that there are.
        known: Names,
    },
    /// A motion cannot be carried over to the body's joints.
    #[error("the motion of the .bvh file: {0} (`body.motion.clip.joints`)")]
    Retarget(#[from] RetargetError),
    /// A character cannot play its clip.
    #[error(transparent)]
    Character(#[from] CharacterError),
    /// The trained model cannot be used.
    #[error(transparent)]
    Model(#[from] forelock_neural::model::ModelError),
    /// Keyframes do not make a motion.
    #[error("the keyframes do not make a motion: {0}")]
    Keyframes(#[from] forelock_core::body::KeyframesError),
    /// A mesh that strands should collide with encloses nothing.
    #[error("{mesh} cannot be made solid: {error}; set {key} or close the mesh")]
    Solid {
        /// The mesh.
        mesh: String,
        /// What is wrong.
        error: SdfError,
        /// The key that would help.
        key: &'static str,
    },
}

impl AssetError {
    /// `error` of edit `number`, from 0.
    pub(crate) fn of_edit(number: usize, edit: &Edit, error: EditError) -> Self {
        Self::Edit { number: number + 1, operation: edit.operation.name(), error }
    }
}

/// What a scene names, ready to be simulated.
#[derive(Debug)]
pub struct Assets {
    /// The strands at rest, in metres, y up, in the body's space.
    pub groom: Groom,
    /// What was changed on import, one sentence each.
    pub notes: Vec<String>,
    body: Option<Body>,
    /// The point about which the head turns, metres.
    pivot: DVec3,
    head: Arc<Motion>,
    performance: Option<Arc<Performance>>,
    /// The body as a solid, if it bends.
    bending: Option<BendingSolid>,
    solids: Vec<Arc<Solid>>,
    /// The trained model that moves the strands, if one does, and its name.
    model: Option<(String, Arc<Model>)>,
}

impl Assets {
    /// Loads what `scene` names; `observer` receives what was changed.
    ///
    /// # Errors
    /// [`AssetError`] if a file cannot be used.
    pub fn load(scene: &Scene, observer: &mut Observer<'_>) -> Result<Self, AssetError> {
        let mut assets = Self::unedited(scene, observer)?;
        for (number, edit) in scene.edits.before() {
            let report = assets.edit(scene, number)?;
            let note = format!("edit {} ({}): {report}", number + 1, edit.operation.name());
            observer(&Progress::Note(&note));
            assets.notes.push(note);
        }
        Ok(assets)
    }

    /// Loads what `scene` names, with the groom before the first edit.
    ///
    /// # Errors
    /// [`AssetError`] if a file cannot be used.
    pub fn unedited(scene: &Scene, observer: &mut Observer<'_>) -> Result<Self, AssetError> {
        let assets = watch(observer, |meter| Self::unedited_watched(scene, meter))?;
        for note in &assets.notes {
            observer(&Progress::Note(note));
        }
        Ok(assets)
    }

    fn unedited_watched(scene: &Scene, meter: &Meter) -> Result<Self, AssetError> {
        // Before minutes of growth.
        let name = Some(&scene.solver.neural.model).filter(|_| scene.solver.is_learned());
        let read = |name: &String| Ok::<_, AssetError>((name.clone(), neural::read(name)?.into()));
        let model = name.map(read).transpose()?;
        let body = Body::load(scene, meter)?;
        let mut notes = body.as_ref().map_or_else(Vec::new, |body| body.notes.clone());
        let groom = groom::load(scene, body.as_ref(), &mut notes, meter)?;
        let pivot = body.as_ref().map_or_else(|| groom::middle_of_roots(&groom), Body::pivot);
        let (head, performance) = Self::head(scene, body.as_ref(), &groom, pivot, &mut notes)?;
        let collides = body.as_ref().is_some_and(|body| body.sdf.is_some());
        let bends = performance.as_deref().filter(|own| !character::is_rigid(own));
        let bending = match bends {
            Some(performance) if collides => character::solid(&scene.body, &groom, performance)?,
            _ => None,
        };
        let rigid = body.as_ref().filter(|_| bends.is_none());
        let solids = solids::load(scene, rigid, meter)?;
        Ok(Self { groom, notes, body, pivot, head, performance, bending, solids, model })
    }

    /// Does edit `number`, from 0, of `scene` to the groom.
    ///
    /// # Errors
    /// [`AssetError`] if it cannot be done, and the groom is unchanged then; or if it leaves no
    /// strands.
    pub fn edit(&mut self, scene: &Scene, number: usize) -> Result<EditReport, AssetError> {
        let Some(edit) = scene.edits.0.get(number).map(|section| &section.edit) else {
            return Ok(EditReport::default());
        };
        let report = groom::edit(edit, scene, &mut self.groom, self.body.as_ref());
        let report = report.map_err(|error| AssetError::of_edit(number, edit, error))?;
        if self.groom.strand_count() == 0 {
            return Err(AssetError::NoStrands { number: number + 1, operation: edit.operation.name() });
        }
        Ok(report)
    }

    /// Does `edit` to `groom`, which may be another than [`Assets::groom`], and keeps its strands
    /// out of the body as the solver of `scene` does.
    pub(crate) fn edit_other(
        &self,
        scene: &Scene,
        edit: &Edit,
        groom: &mut Groom,
    ) -> Result<EditReport, EditError> {
        groom::edit(edit, scene, groom, self.body.as_ref())
    }

    /// What `scene` names around a `groom` that is there already; nothing collides. For pictures.
    ///
    /// # Errors
    /// [`AssetError`] if a file cannot be used.
    pub fn around(scene: &Scene, groom: Groom) -> Result<Self, AssetError> {
        let mut scene = scene.clone();
        scene.body.collide = false;
        let meter = Meter::default();
        let body = Body::load(&scene, &meter)?;
        let pivot = body.as_ref().map_or_else(|| groom::middle_of_roots(&groom), Body::pivot);
        let mut notes = Vec::new();
        let (head, performance) = Self::head(&scene, body.as_ref(), &groom, pivot, &mut notes)?;
        let solids = solids::load(&scene, None, &meter)?;
        let (bending, model) = (None, None);
        Ok(Self { groom, notes, body, pivot, head, performance, bending, solids, model })
    }

    /// What `scene` names around the strands of `cache`, that of a run of it: they are at rest in
    /// its first frame. Nothing collides. For pictures.
    ///
    /// # Errors
    /// [`AssetError`] if a file cannot be used.
    pub fn of_cache(scene: &Scene, cache: &mut Cache) -> Result<Self, AssetError> {
        let mut positions = Vec::new();
        cache.read_frame(0, &mut positions)?;
        let offsets = cache.strand_offsets().to_vec();
        let mut assets = Self::around(scene, Groom::new(positions.clone(), offsets.clone())?)?;
        // A cache is in world space, a groom in the body's.
        let back = assets.head_pose(frame_time_secs(scene, cache, 0)).inverse();
        positions.iter_mut().for_each(|x| *x = back.transform_point(x.as_dvec3()).as_vec3());
        assets.replace_groom(Groom::new(positions, offsets)?);
        Ok(assets)
    }

    /// The motion of what carries `groom`, and what the body plays if it bends.
    fn head(
        scene: &Scene,
        body: Option<&Body>,
        groom: &Groom,
        pivot: DVec3,
        notes: &mut Vec<String>,
    ) -> Result<(Arc<Motion>, Option<Arc<Performance>>), AssetError> {
        if let Some(character) = body.and_then(|body| body.character.as_ref())
            && let Some(own) = character::performance(&scene.body, character, groom, notes)?
        {
            notes.extend(character::still_end(&own, &scene.time));
            let own = Arc::new(own);
            return Ok((Arc::new(Motion::Joint(own.clone())), Some(own)));
        }
        Ok((Arc::new(motion::from_section(&scene.body.motion, pivot)?), None))
    }

    /// The trained model `name`, if it is among them.
    pub(crate) fn model(&self, name: &str) -> Option<Arc<Model>> {
        self.model.as_ref().filter(|(own, _)| own == name).map(|(_, model)| Arc::clone(model))
    }

    /// What the body plays, if it bends.
    pub fn performance(&self) -> Option<&Arc<Performance>> {
        self.performance.as_ref()
    }

    /// The roots of `groom` on the body, if it bends.
    pub(crate) fn bind(&self, groom: &Groom) -> Option<SkinnedRoots> {
        Some(character::bind(self.performance.as_deref()?, groom))
    }

    /// The body's mesh at `time` seconds before its pose ([`Assets::head_pose`]), if there is a
    /// body.
    pub fn body_mesh_at(&self, time: f64) -> Option<Cow<'_, TriMesh>> {
        let mesh = self.body_mesh()?;
        let Some(performance) = &self.performance else { return Some(Cow::Borrowed(mesh)) };
        let mut buffers = PosingBuffers::default();
        let positions = performance.posed(time, &mut buffers).positions.to_vec();
        Some(Cow::Owned(TriMesh { positions, triangles: mesh.triangles.clone() }))
    }

    /// The body's mesh in local space, if there is a body.
    pub fn body_mesh(&self) -> Option<&TriMesh> {
        self.body.as_ref().map(|body| body.mesh.as_ref())
    }

    /// The vertices of the built-in head for each of the body's, if its face is that head's.
    pub(crate) fn face(&self) -> Option<&'static [glam::Vec3]> {
        let body = self.body.as_ref().filter(|body| body.has_face)?;
        let head = &Head::builtin().mesh.positions;
        (body.mesh.positions.len() == head.len()).then_some(head)
    }

    /// Takes `groom` in place of the strands that there are, for pictures.
    pub(crate) fn replace_groom(&mut self, groom: Groom) {
        self.groom = groom;
        if let Some(body) = &mut self.body {
            body.cover = OnceLock::new();
        }
    }

    /// How hair covers the body, if there is one, computed at the first call.
    pub(crate) fn cover(&self) -> Option<&Cover> {
        let body = self.body.as_ref()?;
        Some(body.cover.get_or_init(|| Cover::new(&body.mesh.positions, &self.groom)))
    }

    /// How `groom` covers the body, if there is one.
    pub(crate) fn cover_by(&self, groom: &Groom) -> Option<Cover> {
        Some(Cover::new(&self.body.as_ref()?.mesh.positions, groom))
    }

    /// The body's pose at `time` seconds.
    pub fn head_pose(&self, time: f64) -> Pose {
        self.head.pose(time)
    }

    /// The motion of the body.
    pub fn head_motion(&self) -> &Arc<Motion> {
        &self.head
    }

    /// The motion that `section` describes, about the point about which the body turns.
    ///
    /// # Errors
    /// [`AssetError`] if it is not a motion.
    pub fn motion(&self, section: &MotionSection) -> Result<Motion, AssetError> {
        motion::from_section(section, self.pivot)
    }

    /// The body as a solid, if it bends and collides.
    pub(crate) fn bending_solid(&self) -> Option<&BendingSolid> {
        self.bending.as_ref()
    }

    /// All solids but a body that bends, a rigid body first.
    pub(crate) fn solids(&self) -> &[Arc<Solid>] {
        &self.solids
    }

    /// Whether the first of the solids is the body.
    pub(crate) fn body_collides(&self) -> bool {
        let bends = self.performance.as_deref().is_some_and(|own| !character::is_rigid(own));
        !bends && self.body.as_ref().is_some_and(|body| body.sdf.is_some())
    }

    /// The middle of the roots, metres.
    pub(crate) fn middle_of_roots(&self) -> DVec3 {
        let roots = self.groom.strands().filter_map(|strand| strand.first());
        let (sum, count) =
            roots.fold((DVec3::ZERO, 0.0), |(sum, count), p| (sum + p.as_dvec3(), count + 1.0));
        sum / f64::max(count, 1.0)
    }

    /// All solids but a body that bends, in the frame between two `times` (seconds) at which the
    /// body is at `head`.
    pub fn collider_frames(&self, times: [f64; 2], head: [Pose; 2]) -> Vec<ColliderFrame<'_>> {
        let is_instant = times[0] == times[1];
        let is_there = |solid: &&Arc<Solid>| {
            if is_instant { solid.is_there(times[0]) } else { solid.acts_between(times) }
        };
        let solids = self.solids.iter().filter(is_there);
        solids.map(|solid| solid.frame(times, head)).collect()
    }

    /// Meshes of all solids that are visible but the body, with their poses at `time` seconds, for
    /// pictures.
    pub fn solid_meshes(&self, time: f64) -> Vec<(&TriMesh, Pose)> {
        let head = self.head_pose(time);
        self.solids.iter().filter_map(|solid| Some((solid.mesh_at(time)?, solid.pose(time, &head)))).collect()
    }

    /// A hash of all that determines the simulation: strands, meshes and the scene's physics. The
    /// number of frames, the outputs but `cache_every`, the looks and where files lie are no part
    /// of it.
    pub fn fingerprint(&self, scene: &Scene) -> u64 {
        let mut physics = scene.clone();
        physics.name = String::new();
        physics.time.frames = Scene::default().time.frames;
        physics.groom.source = GroomSource::Grow;
        physics.body.mesh = String::new();
        if physics.body.motion.is_file() {
            physics.body.motion.name = String::new();
        }
        if !physics.solver.neural.is_builtin() {
            physics.solver.neural.model = String::new();
        }
        for collider in &mut physics.colliders {
            collider.mesh = None;
            collider.mesh_sequence.clear();
            collider.visible = true;
        }
        // Which frames a cache holds must not change within it.
        let cache_every = physics.output.cache_every;
        physics.output = OutputSection { cache_every, ..OutputSection::default() };
        physics.camera = CameraSection::default();
        physics.hair = HairSection::default();
        let mut hash = Fnv::new().bytes(physics.to_toml().as_bytes());
        if let Some(bytes) = self.model.as_ref().and_then(|(_, model)| model.to_bytes().ok()) {
            hash = hash.bytes(&bytes);
        }
        for offset in self.groom.strand_offsets() {
            hash = hash.bytes(&offset.to_le_bytes());
        }
        let meshes = self.body_mesh().into_iter().chain(self.solids.iter().flat_map(|s| &s.meshes));
        let points = meshes.flat_map(|mesh| &mesh.positions).chain(self.groom.positions());
        let hash = points.flat_map(|p| p.to_array()).fold(hash, |hash, x| hash.bytes(&x.to_le_bytes()));
        let Some(performance) = &self.performance else { return hash.value() };
        // What the performance does: where vertices are at some of its times.
        let mut buffers = PosingBuffers::default();
        let duration = performance.clip().duration_secs();
        let moments = (0..=MOMENTS).map(|moment| duration * f64::from(moment) / f64::from(MOMENTS));
        moments
            .fold(hash, |hash, secs| {
                let posed = performance.posed(secs, &mut buffers);
                let carrier = posed.carrier.rotation.to_array().into_iter();
                let carrier = carrier.chain(posed.carrier.translation.to_array());
                let hash = carrier.fold(hash, |hash, x| hash.bytes(&x.to_le_bytes()));
                let positions = posed.positions.iter().flat_map(|p| p.to_array());
                positions.fold(hash, |hash, x| hash.bytes(&x.to_le_bytes()))
            })
            .value()
    }
}

/// The solid that `section` describes; `fps` is the frame rate of the scene.
pub(crate) fn solid(section: &ColliderSection, fps: f64) -> Result<Solid, AssetError> {
    solids::solid(section, fps, &Meter::default())
}

/// The point about which a body of bounds (`lo`, `hi`) turns: in its middle, a quarter of the way
/// up, where a bust has its neck.
fn neck(lo: DVec3, hi: DVec3) -> DVec3 {
    let middle = (lo + hi) * 0.5;
    DVec3::new(middle.x, lo.y + 0.25 * (hi.y - lo.y), middle.z)
}

/// The distance grid of `mesh`, from the cache if it is there.
fn distance_grid(
    mesh: &TriMesh,
    name: &str,
    cells: CellSizes,
    key: &'static str,
    meter: &Meter,
) -> Result<Sdf, AssetError> {
    crate::sdf_cache::load_or_compute(mesh, cells, meter).map_err(|error| AssetError::Solid {
        mesh: name.to_owned(),
        error,
        key,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    #[test]
    fn what_is_not_visible_is_still_there() {
        let load = |more: &str| {
            let text = format!(
                "[groom]\nstrands = 5\n[body]\ncollide = false\n[[collider]]\nshape = \"sphere\"\n{more}\n"
            );
            let scene = Scene::parse(&text, Path::new("scene.toml"), &[]).unwrap();
            let assets = Assets::load(&scene, &mut |_| {}).unwrap();
            let head = assets.head_pose(0.0);
            let solids = assets.collider_frames([0.0; 2], [head; 2]).len();
            (solids, assets.solid_meshes(0.0).len(), assets.fingerprint(&scene))
        };
        let (shown, hidden) = (load(""), load("visible = false"));
        assert_eq!((shown.0, shown.1), (1, 1));
        assert_eq!((hidden.0, hidden.1), (1, 0));
        // Visibility does not affect a resumed run; another solid does.
        assert_eq!(hidden.2, shown.2);
        assert_ne!(load("radius = 0.2").2, shown.2);
    }
}
