//! A groom edited by a script: what `forelock groom` does.
//!
//! # Practice
//! A script is a scene file with `[[edit]]` tables: `[groom]` and `[body]` say what is edited, the
//! edits what is done, `[output]`, `[camera]` and `[hair]` what is written and how it looks. The
//! same file simulates: a scene's edits are done before its first frame. Into the output folder go
//! the groom (`output.groom`), with `output.picture` the sheet `before-after.png`, and with
//! [`GroomingOptions::steps`] a picture after each edit, `steps/01-comb.png` and so on, beside
//! `steps/00.png` of the beginning. Nothing is written before every edit has been done. Edits with
//! a time, `at_secs`, wait for a simulation and are left out.

use std::path::{Path, PathBuf};
use std::time::Instant;

use forelock_core::groom::Groom;
use forelock_core::groom::edit::EditReport;
use forelock_render::{Camera, Image};
use serde::Serialize;

use crate::assets::{AssetError, Assets};
use crate::pictures::{Studio, labelled, write_picture};
use crate::progress::{Observer, Progress};
use crate::run::{RunError, check_outputs};
use crate::scene::Scene;

/// Where an edited groom goes.
#[derive(Clone, Debug)]
pub struct GroomingOptions {
    /// The output folder; made if it is not there.
    pub out: PathBuf,
    /// Whether to write a picture after each edit.
    pub steps: bool,
}

/// What was done to a groom.
#[derive(Clone, Debug, Serialize)]
pub struct Grooming {
    /// Name of the script.
    pub scene: String,
    /// Strands and particles before the first edit.
    pub before: Counts,
    /// Strands and particles after the last.
    pub after: Counts,
    /// The edits, in order.
    pub edits: Vec<EditRow>,
    /// What import and growth had to say, one sentence each.
    pub notes: Vec<String>,
    /// Files written.
    pub outputs: Vec<PathBuf>,
}

/// How much hair there is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Counts {
    /// Strands, S.
    pub strands: usize,
    /// Particles, P.
    pub particles: usize,
}

/// One edit.
#[derive(Clone, Debug, Serialize)]
pub struct EditRow {
    /// Its operation.
    pub op: &'static str,
    /// Wall time, milliseconds.
    pub ms: f64,
    /// Strands changed.
    pub changed: usize,
    /// Strands added.
    pub added: usize,
    /// Strands removed.
    pub removed: usize,
    /// Its report, one sentence.
    pub report: String,
}

impl Counts {
    fn of(groom: &Groom) -> Self {
        Self { strands: groom.strand_count(), particles: groom.particle_count() }
    }
}

impl EditRow {
    fn new(op: &'static str, ms: f64, report: &EditReport) -> Self {
        let EditReport { changed, added, removed, .. } = *report;
        Self { op, ms, changed, added, removed, report: report.to_string() }
    }
}

/// Does the edits of `scene` and writes the groom and its pictures; `observer` receives the
/// progress.
///
/// # Errors
/// [`RunError`] if something that the scene names cannot be used, an edit not be done or a file not
/// be written.
pub fn groom(
    scene: &Scene,
    options: &GroomingOptions,
    observer: &mut Observer<'_>,
) -> Result<Grooming, RunError> {
    let mut assets = Assets::unedited(scene, observer)?;
    let before = assets.groom.clone();
    // Pictures of the steps are drawn once the camera knows the last of them.
    let mut stages = vec![before.clone()];
    let mut edits = Vec::with_capacity(scene.edits.0.len());
    observer(&Progress::Begin { what: "editing", done: 0, total: scene.edits.before().count() as u64 });
    for (number, edit) in scene.edits.before() {
        let started = Instant::now();
        let report = assets.edit(scene, number)?;
        let ms = started.elapsed().as_secs_f64() * 1e3;
        edits.push(EditRow::new(edit.operation.name(), ms, &report));
        if options.steps {
            stages.push(assets.groom.clone());
        }
        observer(&Progress::Step);
    }
    observer(&Progress::End);
    std::fs::create_dir_all(&options.out)
        .map_err(|error| RunError::Folder { path: options.out.clone(), error })?;
    let path = options.out.join(&scene.output.groom);
    check_outputs(scene, &[&path])?;
    forelock_io::write_groom(&path, &assets.groom)?;
    let mut outputs = vec![path];
    let after = assets.groom.clone();
    let mut darkroom = Darkroom { scene, camera: both(scene, &mut assets, &before, &after)?, assets };
    if scene.output.picture {
        outputs.push(darkroom.before_and_after(&before, &after, &options.out)?);
    }
    if options.steps {
        outputs.extend(darkroom.steps(stages, &edits, &options.out, observer)?);
    }
    let (before, after) = (Counts::of(&before), Counts::of(&after));
    Ok(Grooming { scene: scene.name.clone(), before, after, edits, notes: darkroom.assets.notes, outputs })
}

/// The camera that has both grooms in its picture.
fn both(scene: &Scene, assets: &mut Assets, before: &Groom, after: &Groom) -> Result<Camera, RunError> {
    let strands = before.strands().chain(after.strands());
    assets.groom = Groom::from_strands(strands).map_err(AssetError::from)?;
    Ok(Studio::new(scene, assets).camera())
}

/// Where pictures are made of one groom after another, from the same place.
struct Darkroom<'a> {
    scene: &'a Scene,
    camera: Camera,
    assets: Assets,
}

impl Darkroom<'_> {
    fn picture(&mut self, groom: Groom, yaw_degrees: f64, scale: f64) -> Result<Image, RunError> {
        self.assets.replace_groom(groom);
        let studio = Studio::new(self.scene, &self.assets).at(self.camera);
        Ok(studio.from_side(yaw_degrees).picture(self.assets.groom.positions(), 0.0, scale)?)
    }

    fn before_and_after(&mut self, before: &Groom, after: &Groom, out: &Path) -> Result<PathBuf, RunError> {
        let mut pictures = Vec::new();
        for (moment, groom) in [("BEFORE", before), ("AFTER", after)] {
            for (side, yaw) in [("FRONT", 0.0), ("THREE QUARTERS", 40.0), ("SIDE", 90.0), ("BACK", 180.0)] {
                pictures.push((self.picture(groom.clone(), yaw, 0.6)?, format!("{moment}  {side}")));
            }
        }
        let path = out.join("before-after.png");
        write_picture(&path, &labelled(&pictures, 4)?)?;
        Ok(path)
    }

    fn steps(
        &mut self,
        stages: Vec<Groom>,
        edits: &[EditRow],
        out: &Path,
        observer: &mut Observer<'_>,
    ) -> Result<Vec<PathBuf>, RunError> {
        let folder = out.join("steps");
        std::fs::create_dir_all(&folder).map_err(|error| RunError::Folder { path: folder.clone(), error })?;
        observer(&Progress::Begin { what: "drawing", done: 0, total: stages.len() as u64 });
        let mut written = Vec::with_capacity(stages.len());
        for (number, groom) in stages.into_iter().enumerate() {
            let image = self.picture(groom, self.scene.camera.yaw_degrees, 1.0)?;
            let name = match number.checked_sub(1) {
                None => "00.png".to_owned(),
                Some(edit) => format!("{number:02}-{}.png", edits[edit].op),
            };
            let path = folder.join(name);
            write_picture(&path, &image)?;
            written.push(path);
            observer(&Progress::Step);
        }
        observer(&Progress::End);
        Ok(written)
    }
}
