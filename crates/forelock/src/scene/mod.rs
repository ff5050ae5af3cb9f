//! The scene file: what to simulate, in TOML.
//!
//! # Theory
//! A scene is one TOML document in which every key has a default, so that the empty file is a
//! scene. [`Scene`] is that document as a plain struct; its doc lines are the reference for the
//! keys.
//!
//! # Practice
//! [`Scene::load`] reads a file, [`Scene::parse`] a text; both lay the `key=value` overrides of the
//! command line over it before anything is interpreted, so that an override passes the same checks
//! and yields the same messages as the file. Unknown keys are refused with the nearest known one;
//! wrong types and values out of range name the key, the line and what would be right. Paths are
//! taken relative to the scene file.
//!
//! # Limitations
//! The simulation runs in float32, so a scene in which h²κ exceeds
//! [`FLOAT32_STIFFNESS_LIMIT`](forelock_core::params::FLOAT32_STIFFNESS_LIMIT) is refused.

mod check;
pub(crate) mod document;
mod edits;
mod error;
mod hair;
mod motion;
pub mod reference;
mod sections;
mod solver;
mod teleport;

pub use document::Override;
pub use edits::{EditSection, EditSections};
pub use error::{Place, SceneError};
pub use hair::HairSection;
pub use motion::{ClipSection, Keyframe, MotionSection};
pub(crate) use sections::NEAR_CELL;
pub use sections::{
    BodySection, CameraSection, ColliderSection, GroomSection, GroomSource, InteractionKind,
    InteractionSection, OutputSection, Renderer, ShapeKind, TimeSection,
};
pub use solver::{NeuralSection, SimdChoice, SolverKind, SolverSection};
pub use teleport::TeleportSection;

use std::path::{Path, PathBuf};

use document::{Document, Layer};
use forelock_core::air::WindParams;
use serde::{Deserialize, Serialize};
use solver::Registered;

/// What a scene of hair alone says besides its source.
const HAIR_ALONE: &str = "body.mesh = \"none\"\nbody.motion = \"builtin:still\"\n";

/// The scene that `forelock demo` runs: `default.toml` beside this module.
pub const DEFAULT_SCENE: &str = include_str!("default.toml");
/// The scene that `forelock demo --scene character` runs.
pub const CHARACTER_SCENE: &str = include_str!("character.toml");
/// The scene that `forelock demo --scene beard` runs.
pub const BEARD_SCENE: &str = include_str!("beard.toml");

forelock_core::documented! {
/// A whole scene, as its file holds it: every value checked, every path absolute or relative to the
/// current folder.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Scene {
    /// Name of the scene, for reports and the output folder. Default the file's name without its
    /// ending.
    pub name: String,
    /// Seed of everything random. No unit, default 1, range 0 or more; 0 is a seed like any other.
    pub seed: u64,
    /// Gravity, [x, y, z]. Unit m/s², default [0, -9.81, 0], range -1000 to 1000 each; zeros switch
    /// it off.
    pub gravity: [f64; 3],
    /// The strands.
    pub groom: GroomSection,
    /// What is done to them, each an `[[edit]]` table: `op` names the operation, its parameters
    /// stand beside it, and `at_secs` says when if not before the first frame.
    #[serde(rename = "edit", skip_serializing_if = "EditSections::is_empty")]
    pub edits: EditSections,
    /// What they grow on, and how it moves.
    pub body: BodySection,
    /// Jumps of the body, each a `[[teleport]]` table.
    #[serde(rename = "teleport", skip_serializing_if = "Vec::is_empty")]
    pub teleports: Vec<TeleportSection>,
    /// Further solids, each a `[[collider]]` table.
    #[serde(rename = "collider")]
    pub colliders: Vec<ColliderSection>,
    /// `[wind]`: moving air.
    pub wind: WindParams,
    /// Which solver, and its parameters.
    pub solver: SolverSection,
    /// Hair against hair.
    pub interaction: InteractionSection,
    /// Frames and substeps.
    pub time: TimeSection,
    /// What is written.
    pub output: OutputSection,
    /// From where pictures are taken.
    pub camera: CameraSection,
    /// How the hair looks in pictures.
    pub hair: HairSection,
}
}

impl Default for Scene {
    fn default() -> Self {
        Self {
            name: String::new(),
            seed: 1,
            gravity: [0.0, -9.81, 0.0],
            groom: GroomSection::default(),
            edits: EditSections::default(),
            body: BodySection::default(),
            teleports: Vec::new(),
            colliders: Vec::new(),
            wind: WindParams::default(),
            solver: SolverSection::default(),
            interaction: InteractionSection::default(),
            time: TimeSection::default(),
            output: OutputSection::default(),
            camera: CameraSection::default(),
            hair: HairSection::default(),
        }
    }
}

impl Scene {
    /// Reads the scene file at `path` with `overrides` laid over it.
    ///
    /// # Errors
    /// [`SceneError`] if the file cannot be read, is not TOML, holds an unknown key or a value that
    /// is wrong.
    pub fn load(path: &Path, overrides: &[Override]) -> Result<Self, SceneError> {
        Self::load_with(path, overrides, &[])
    }

    /// Like [`Scene::load`], of a scene that may name one of `solvers` as its `solver.kind` and
    /// give its parameters in the table `[solver.NAME]`. The player that runs the scene must have
    /// the solver registered: see [`PlayerBuilder::solver`](crate::player::PlayerBuilder::solver).
    ///
    /// # Errors
    /// The same errors as [`Scene::load`].
    pub fn load_with(path: &Path, overrides: &[Override], solvers: &[&str]) -> Result<Self, SceneError> {
        let text = std::fs::read_to_string(path)
            .map_err(|error| SceneError::Read { path: path.to_path_buf(), error })?;
        let mut scene = Self::parse_with(&text, path, overrides, solvers)?;
        if scene.name.is_empty() {
            scene.name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        }
        Ok(scene)
    }

    /// The built-in scene of `forelock demo` with `overrides` laid over it.
    ///
    /// # Errors
    /// [`SceneError`] if an override holds an unknown key or a value that is wrong.
    pub fn builtin(overrides: &[Override]) -> Result<Self, SceneError> {
        Self::parse(DEFAULT_SCENE, Path::new("the built-in scene"), overrides)
    }

    /// The scene of a cache or groom at `path`: that of `scene.toml`, which a run writes beside its
    /// cache; without this file, a scene of hair alone.
    ///
    /// # Errors
    /// The same errors as [`Scene::load`].
    pub fn beside(path: &Path, overrides: &[Override]) -> Result<Self, SceneError> {
        let beside = path.with_file_name("scene.toml");
        if beside.is_file() {
            Self::load(&beside, overrides)
        } else {
            // The source is not read, because the strands come from the input.
            let text = format!("groom.source = \"hair\"\ncamera.yaw_degrees = 0\n{HAIR_ALONE}");
            Self::parse(&text, path, overrides)
        }
    }

    /// The scene of the groom at `path`, hair alone.
    ///
    /// # Errors
    /// The same errors as [`Scene::parse`].
    pub fn of_groom(path: &Path, overrides: &[Override]) -> Result<Self, SceneError> {
        // Paths of a scene are relative to its folder; this text is in none.
        let absolute = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
        let source = toml::Value::String(absolute.to_string_lossy().into_owned());
        let name = toml::Value::String(path.file_stem().unwrap_or_default().to_string_lossy().into_owned());
        Self::parse(&format!("name = {name}\n{HAIR_ALONE}groom.source = {source}\n"), path, overrides)
    }

    /// Reads a scene from `text`. `path` names the text in messages, and paths inside it are taken
    /// relative to the folder that holds `path`.
    ///
    /// # Errors
    /// [`SceneError`] as for [`Scene::load`], except that nothing is read from disk.
    pub fn parse(text: &str, path: &Path, overrides: &[Override]) -> Result<Self, SceneError> {
        Self::parse_with(text, path, overrides, &[])
    }

    /// Like [`Scene::parse`], of a scene that may name one of `solvers`: see [`Scene::load_with`].
    ///
    /// # Errors
    /// The same errors as [`Scene::parse`].
    pub fn parse_with(
        text: &str,
        path: &Path,
        overrides: &[Override],
        solvers: &[&str],
    ) -> Result<Self, SceneError> {
        let layers = Layer::stack(text.len(), overrides)?;
        let written = Document::parse(text, path, &layers, "")?;
        let preset = written.text_at("groom", "preset").unwrap_or_else(|| GroomSection::default().preset);
        let growth =
            sections::preset_toml(&preset).map_err(|message| written.refuse("groom.preset", message))?;
        let below = written.below(&growth);
        let mut document = Document::parse(text, path, &layers, &below)?;
        check::refuse_former_keys(&document)?;
        let registered = Registered::take(&mut document, solvers)?;
        let mut scene: Self = document.deserialize()?;
        if let Some(registered) = registered {
            registered.put(&mut scene.solver);
        }
        scene.edits = edits::read(&document)?;
        check::check(&scene, &document).map_err(|(key, message)| document.refuse(&key, message))?;
        if let Some(secs) = scene.time.substep_secs {
            scene.solver.set_substep_secs(secs);
        }
        scene.time.substep_secs = scene.solver.substep_secs();
        scene.keep_vertices_a_strand(text, path, overrides, solvers);
        (scene.groom.grow.strands, scene.groom.grow.seed) = (scene.groom.strands, scene.seed);
        scene.resolve_paths(path.parent().unwrap_or(Path::new("")));
        Ok(scene)
    }

    /// Where `overrides` change the number of strands to grow of the scene `text` but not that of
    /// all their vertices, scales the latter alike.
    fn keep_vertices_a_strand(&mut self, text: &str, path: &Path, overrides: &[Override], solvers: &[&str]) {
        let is = |key: &str| overrides.iter().any(|own| own.key == key);
        let grows = self.groom.source == GroomSource::Grow;
        if !grows || self.groom.vertices == 0 || !is("groom.strands") || is("groom.vertices") {
            return;
        }
        // What other overrides mend may be wrong in the text itself.
        let rest: Vec<_> = overrides.iter().filter(|own| own.key != "groom.strands").cloned().collect();
        if let Ok(written) = Self::parse_with(text, path, &rest, solvers) {
            let share = f64::from(self.groom.strands) / f64::from(written.groom.strands);
            let vertices = (f64::from(self.groom.vertices) * share).round();
            self.groom.vertices = vertices.clamp(2.0 * f64::from(self.groom.strands), 1e9) as u32;
        }
    }

    /// Substeps per frame, M.
    pub fn substeps(&self) -> u32 {
        self.solver.substeps(1.0 / self.time.fps)
    }

    /// The scene as a TOML document with every key written out; [`Scene::parse`] reads it back to
    /// an equal scene.
    pub fn to_toml(&self) -> String {
        let table = toml::Table::try_from(self).map(|mut table| {
            // Keys that say the same as another: `substep_secs` of the solver, `groom.strands`,
            // `seed`.
            remove(&mut table, &["time", "substep_secs"]);
            remove(&mut table, &["groom", "grow", "strands"]);
            remove(&mut table, &["groom", "grow", "seed"]);
            if let (SolverKind::Custom(name), Some(solver)) =
                (&self.solver.kind, table.get_mut("solver").and_then(toml::Value::as_table_mut))
            {
                solver.insert(name.clone(), self.solver.custom.clone().into());
            }
            if let Some(grow) = table.get_mut("groom").and_then(|groom| groom.get_mut("grow")) {
                shorten(grow);
            }
            table.to_string()
        });
        table.unwrap_or_else(|error| format!("# this scene cannot be written as TOML: {error}\n"))
    }

    /// The scene with every path absolute, so that its text means the same wherever it is kept. A
    /// path stays as it is where the system does not know the current folder.
    #[must_use]
    pub fn with_absolute_paths(mut self) -> Self {
        self.each_path(|path| std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf()));
        self
    }

    fn resolve_paths(&mut self, folder: &Path) {
        self.each_path(|path| folder.join(path));
    }

    /// Paths of the files that the scene names to be read.
    pub fn inputs(&self) -> Vec<PathBuf> {
        let mut inputs = Vec::new();
        self.clone().each_path(|path| {
            inputs.push(path.to_path_buf());
            path.to_path_buf()
        });
        inputs
    }

    /// Puts `of(path)` in place of every path of an input.
    fn each_path(&mut self, mut of: impl FnMut(&Path) -> PathBuf) {
        if let GroomSource::Files(files) = &mut self.groom.source {
            files.iter_mut().for_each(|path| *path = of(path));
        }
        if !self.body.is_named() {
            self.body.mesh = of(self.body.mesh.as_ref()).to_string_lossy().into_owned();
        }
        if self.body.motion.is_file() {
            let name = &mut self.body.motion.name;
            *name = of(name.as_ref()).to_string_lossy().into_owned();
        }
        let neural = &mut self.solver.neural;
        if !neural.is_builtin() {
            neural.model = of(neural.model.as_ref()).to_string_lossy().into_owned();
        }
        let meshes = self.colliders.iter_mut().flat_map(|c| c.mesh.iter_mut().chain(&mut c.mesh_sequence));
        meshes.for_each(|path| *path = of(path));
    }
}

/// Writes numbers that were float32 with no more digits than float32 needs to read them back.
fn shorten(value: &mut toml::Value) {
    match value {
        toml::Value::Float(number) => *number = (*number as f32).to_string().parse().unwrap_or(*number),
        toml::Value::Array(list) => list.iter_mut().for_each(shorten),
        toml::Value::Table(table) => table.iter_mut().for_each(|(_, value)| shorten(value)),
        _ => {}
    }
}

fn remove(table: &mut toml::Table, path: &[&str]) {
    match path {
        [] => {}
        [key] => drop(table.remove(*key)),
        [key, rest @ ..] => {
            if let Some(toml::Value::Table(inner)) = table.get_mut(*key) {
                remove(inner, rest);
            }
        }
    }
}

#[cfg(test)]
mod tests;
