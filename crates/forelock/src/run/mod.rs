//! A run: a scene simulated frame by frame into an output folder.
//!
//! # Practice
//! [`simulate`] is a [`Player`] whose frames go to a [`CacheSink`]. It loads what the scene names,
//! steps through its frames while the cache is written, and leaves in the output folder: the cache,
//! `snapshot.npz` (the state after the last frame), `scene.toml` (every key written out), the
//! pictures, `summary.json` and `report.html`. Nothing is written before everything has been
//! loaded. [`record`] does the same with a player that was built elsewhere, for one with a
//! registered solver.
//!
//! When `cancel` is set, the current frame is finished and the run ends as if its scene were that
//! long. A later run with [`RunOptions::resume`] continues from the snapshot: cache and state hash
//! are those of an uninterrupted run.
//!
//! # Limitations
//! A resumed run needs the scene and the files of the first one: all but `time.frames`, the outputs
//! and the looks is compared, and a difference is an error.

mod machine;
mod measure;
mod snapshot;

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use glam::Vec3;

use crate::backend::Backend;
use crate::penetration::Penetration;
use crate::pictures::{self, LastFrame, PictureError, Studio};
use crate::player::{Player, PlayerError, StepReport};
use crate::progress::{Observer, Progress};
use crate::report;
use crate::scene::Scene;
use crate::sinks::{self, CacheSink, FrameView};
use crate::summary::{
    FrameRow, MEASURE_DEPTH, SKIN_STRANDS, Spread, Summary, WRITE_CACHE, median_stages, peak_memory_bytes,
};
use machine::Machine;
use measure::FrameClock;
pub use measure::MEASURED_EVERY;
use snapshot::Snapshot;
pub use snapshot::SnapshotError;

/// Where and how a scene is run.
#[derive(Clone, Debug)]
pub struct RunOptions {
    /// The output folder; made if it is not there.
    pub out: PathBuf,
    /// Whether to continue where an earlier run into the same folder ended.
    pub resume: bool,
    /// Where to compute.
    pub backend: Backend,
}

/// Why a run failed.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The scene itself is wrong.
    #[error(transparent)]
    Scene(#[from] crate::scene::SceneError),
    /// The scene cannot be simulated.
    #[error(transparent)]
    Player(#[from] PlayerError),
    /// There is nothing to resume, or it does not fit.
    #[error(transparent)]
    Snapshot(#[from] SnapshotError),
    /// A file cannot be written.
    #[error(transparent)]
    Write(#[from] forelock_io::WriteError),
    /// The output folder cannot be made.
    #[error("{}: the output folder cannot be made: {error}; name another with --out", .path.display())]
    Folder {
        /// The folder.
        path: PathBuf,
        /// The error of the operating system.
        error: std::io::Error,
    },
    /// A picture cannot be made.
    #[error(transparent)]
    Picture(#[from] PictureError),
}

impl From<crate::assets::AssetError> for RunError {
    fn from(error: crate::assets::AssetError) -> Self {
        Self::Player(error.into())
    }
}

/// Runs `scene` and writes its outputs; `observer` receives the progress, `cancel` ends the run
/// early and cleanly.
///
/// # Errors
/// [`RunError`]; the files that were written until then are complete.
pub fn simulate(
    scene: &Scene,
    options: &RunOptions,
    observer: &mut Observer<'_>,
    cancel: &AtomicBool,
) -> Result<Summary, RunError> {
    let builder = Player::builder(scene.clone()).backend(options.backend).without_history();
    record(builder.build_observed(observer)?, options, observer, cancel)
}

/// Runs the scene of `player`, which is at its start, and writes its outputs: see [`simulate`]. The
/// backend is the player's, whatever `options` say.
///
/// # Errors
/// The same errors as [`simulate`].
pub fn record(
    player: Player,
    options: &RunOptions,
    observer: &mut Observer<'_>,
    cancel: &AtomicBool,
) -> Result<Summary, RunError> {
    let mut run = Run::start(player, options)?;
    run.player.backend_notes().iter().chain(&run.notes).for_each(|note| observer(&Progress::Note(note)));
    match run.step_through(observer, cancel) {
        // Not all frames are lost with a device: the run can be resumed after the last state that
        // is kept.
        Err(RunError::Player(error @ (PlayerError::Gpu(_) | PlayerError::Device(_)))) => {
            run.go_back_to_kept();
            run.finish(observer)?;
            Err(error.into())
        }
        stepped => stepped.and_then(|()| run.finish(observer)),
    }
}

/// A run under way.
struct Run<'a> {
    player: Player,
    out: &'a Path,
    cache: Option<Box<dyn CacheSink>>,
    /// Frames done, what they took, and the worst values over them.
    so_far: Snapshot,
    /// The same at an earlier frame, with the state, of a run on a device.
    kept: Option<Snapshot>,
    positions: Vec<Vec3>,
    /// What the user should know of the run itself.
    notes: Vec<String>,
}

impl<'a> Run<'a> {
    fn start(mut player: Player, options: &'a RunOptions) -> Result<Self, RunError> {
        let out = options.out.as_path();
        let fingerprint = player.assets().fingerprint(player.scene());
        let cache_path = cache_path(player.scene(), out);
        let mut so_far = Snapshot::begin(fingerprint);
        let mut stored_frames = None;
        if options.resume {
            so_far = Snapshot::read(&out.join(SNAPSHOT), fingerprint)?;
            if let Some(state) = so_far.state.take() {
                player.resume(so_far.frame, &state)?;
            }
            stored_frames = Some(so_far.frame as usize + 1);
        } else {
            std::fs::create_dir_all(out)
                .map_err(|error| RunError::Folder { path: out.to_path_buf(), error })?;
        }
        let offsets = player.assets().groom.strand_offsets();
        let cache = cache_path.map(|path| sinks::open_cache(&path, offsets, stored_frames)).transpose()?;
        let mut notes = Vec::new();
        let machine = Machine::of(&player).hash();
        if so_far.machine != machine && !so_far.rows.is_empty() {
            so_far.rows.clear();
            let frames = so_far.frame;
            notes.push(format!("the first {frames} frames ran elsewhere: times and plots are without them"));
        }
        so_far.machine = machine;
        let mut run = Self { player, out, cache, so_far, kept: None, positions: Vec::new(), notes };
        run.player.positions(&mut run.positions)?;
        if run.is_on_device() {
            run.keep_state()?;
        }
        if !options.resume {
            run.append()?;
        }
        Ok(run)
    }

    /// Appends the present positions to the cache.
    fn append(&mut self) -> Result<(), RunError> {
        if let Some(cache) = &mut self.cache {
            cache.append(&FrameView {
                frame: self.player.frame(),
                time_secs: self.player.time_secs(),
                head: self.player.head_pose(),
                strand_offsets: self.player.layout().strand_offsets,
                positions: &self.positions,
            })?;
        }
        Ok(())
    }

    fn step_through(&mut self, observer: &mut Observer<'_>, cancel: &AtomicBool) -> Result<(), RunError> {
        let frames = self.player.scene().time.frames;
        let done = self.so_far.frame.into();
        // Surfaces to measure against are made here, not in the first frame that is measured.
        drop(self.player.measured_solids());
        observer(&Progress::Begin { what: "simulating", done, total: frames.into() });
        let mut clock = FrameClock::start();
        while self.so_far.frame < frames && !cancel.load(Ordering::SeqCst) {
            self.step()?;
            let written = Instant::now();
            self.append()?;
            if let Some(row) = self.so_far.rows.last_mut() {
                row.stages.push((WRITE_CACHE.into(), written.elapsed().as_secs_f64() * 1e3));
                row.ms = clock.lap_ms();
            }
            if self.is_on_device() && self.so_far.frame.is_multiple_of(KEEP_EVERY) {
                self.keep_state()?;
            }
            observer(&Progress::Step);
        }
        observer(&Progress::End);
        Ok(())
    }

    /// One frame.
    fn step(&mut self) -> Result<(), RunError> {
        let started = Instant::now();
        let StepReport { solver: report, .. } = self.player.step()?;
        let stepped = Instant::now();
        self.player.positions(&mut self.positions)?;
        let skin_ms = stepped.elapsed().as_secs_f64() * 1e3;
        let mut solver_ms = stepped.duration_since(started).as_secs_f64() * 1e3;
        let measured = measure::penetration(&self.player, self.so_far.frame + 1, &self.positions);
        // Stages that did not run are left out.
        let ran = report.stages.iter().filter(|(_, secs)| *secs > 0.0);
        let mut stages: Vec<_> = ran.map(|(stage, secs)| (stage.into(), secs * 1e3)).collect();
        if self.player.guides() > 0 {
            solver_ms += skin_ms;
            stages.push((SKIN_STRANDS.into(), skin_ms));
        }
        stages.extend(measured.map(|(_, ms)| (MEASURE_DEPTH.into(), ms)));
        let worst =
            [report.max_edge_stretch, report.max_edge_stretch_final, report.strand_contacts.contacts as f64];
        let penetration = measured.map(|(found, _)| found);
        let so_far = &mut self.so_far;
        so_far.frame += 1;
        so_far.worst = std::array::from_fn(|i| so_far.worst[i].max(worst[i]));
        so_far.penetration = so_far.penetration.max(&penetration.unwrap_or_default());
        so_far.quarantined_strands += u64::from(report.quarantined_strands);
        so_far.rows.push(FrameRow {
            ms: solver_ms,
            solver_ms,
            stretch: report.max_edge_stretch,
            penetration,
            stages,
        });
        Ok(())
    }

    /// Keeps the present state in memory, for the case that the device fails.
    fn keep_state(&mut self) -> Result<(), RunError> {
        let state = Some(self.player.state()?);
        self.kept = Some(Snapshot { state, ..self.so_far.clone() });
        Ok(())
    }

    fn is_on_device(&self) -> bool {
        self.player.gpu_name().is_some()
    }

    /// Goes back to the state that was kept last. Frames of the cache after it are written again
    /// when the run is resumed.
    fn go_back_to_kept(&mut self) {
        if let Some(kept) = self.kept.take() {
            let lost = self.so_far.frame - kept.frame;
            self.so_far = kept;
            if lost > 0 {
                self.notes
                    .push(format!("the device failed: --resume simulates the last {lost} frames again"));
            }
        }
    }

    /// Closes the cache, saves the state, takes the pictures, and writes summary and report.
    fn finish(mut self, observer: &mut Observer<'_>) -> Result<Summary, RunError> {
        let mut outputs = Vec::new();
        if let Some(cache) = self.cache.take() {
            outputs.extend(cache.finish()?);
        }
        let state = match self.so_far.state.take() {
            Some(kept) => kept,
            None => self.player.state()?,
        };
        let state_hash = state.hash();
        self.so_far.state = Some(state);
        let snapshot = self.out.join(SNAPSHOT);
        self.so_far.write(&snapshot)?;
        outputs.push(snapshot);
        let text = |name: &str, text: &str| {
            let path = self.out.join(name);
            forelock_io::atomic_write(&path, |file| file.write_all(text.as_bytes())).map(|()| path)
        };
        let (scene, assets) = (self.player.scene(), self.player.assets());
        outputs.push(text("scene.toml", &Scene::clone(scene).with_absolute_paths().to_toml())?);
        // An interrupted run gets its film when it has been resumed.
        let whole = self.so_far.frame >= scene.time.frames;
        let cache = cache_path(scene, self.out).filter(|_| whole);
        let last = LastFrame {
            positions: &self.positions,
            time_secs: self.player.secs_of(self.so_far.frame),
            cache: cache.as_deref(),
        };
        let pictures = pictures::of_run(&Studio::new(scene, assets), &last, self.out, observer)?;
        outputs.extend(pictures.files);

        let mut summary = self.summary(outputs, state_hash);
        summary.outputs.push(self.out.join("summary.json"));
        if scene.output.report {
            summary.outputs.push(self.out.join("report.html"));
            text("report.html", &report::html(scene, &summary, &self.so_far.rows, &pictures.shown))?;
        }
        let json = serde_json::to_string_pretty(&summary).unwrap_or_default();
        text("summary.json", &json)?;
        Ok(summary)
    }

    /// Penetration in the last frame, unless it has been measured or its positions are lost with a
    /// device.
    fn last_penetration(&self) -> Penetration {
        let frame = self.so_far.frame;
        let is_missing = frame > 0 && !frame.is_multiple_of(MEASURED_EVERY) && self.player.frame() == frame;
        if is_missing { self.player.penetration(&self.positions) } else { Penetration::default() }
    }

    fn summary(&self, outputs: Vec<PathBuf>, state_hash: u64) -> Summary {
        let Self { player, so_far, .. } = self;
        let (scene, groom) = (player.scene(), &player.assets().groom);
        let spread = |ms: fn(&FrameRow) -> f64| Spread::of(&so_far.rows.iter().map(ms).collect::<Vec<_>>());
        let penetration = so_far.penetration.max(&self.last_penetration());
        let machine = Machine::of(player);
        Summary {
            scene: scene.name.clone(),
            solver: scene.solver.kind.name().to_owned(),
            backend: machine.backend,
            device: machine.device,
            simd: machine.simd,
            threads: machine.threads,
            strands: groom.strand_count(),
            particles: groom.particle_count(),
            guides: player.guides(),
            frames: so_far.frame,
            frames_asked: scene.time.frames,
            fps: scene.time.fps,
            substeps: player.substeps(),
            ms_per_frame: spread(|row| row.ms),
            solver_ms_per_frame: spread(|row| row.solver_ms),
            ms_per_stage: median_stages(&so_far.rows),
            peak_memory_bytes: peak_memory_bytes(),
            simulation_bytes: player.simulation_bytes(),
            max_edge_stretch: so_far.worst[0],
            max_edge_stretch_after_solids: so_far.worst[1],
            penetration_measured_every: MEASURED_EVERY,
            max_penetration_m: penetration.deepest_m,
            max_share_1mm_inside: penetration.share_inside,
            max_edge_penetration_m: penetration.deepest_edge_m,
            max_edge_share_1mm_inside: penetration.edge_share_inside,
            max_strand_contacts: so_far.worst[2] as u64,
            quarantined_strands: so_far.quarantined_strands,
            teleports: player.counters().teleports,
            state_hash: format!("{:016x}", state_hash),
            notes: [player.notes(), self.notes.clone()].concat(),
            outputs,
        }
    }
}

/// Frames after which a run on a device keeps its state.
const KEEP_EVERY: u32 = 30;

/// Name of the snapshot in the output folder.
const SNAPSHOT: &str = "snapshot.npz";

/// Where the cache goes, if there is to be one.
fn cache_path(scene: &Scene, out: &Path) -> Option<PathBuf> {
    let name = &scene.output.cache;
    (!name.as_os_str().is_empty()).then(|| out.join(name))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Override;

    /// After a device has failed a run goes back to the state that was kept, and resumes from it to
    /// the result of a run without the failure.
    #[test]
    fn a_run_whose_device_failed_resumes_from_the_kept_state() {
        let sets = ["groom.strands=20", "body.sdf_cells=32", "time.frames=8", "output.picture=false"];
        let sets: Vec<Override> = sets.iter().map(|set| Override::set(set).unwrap()).collect();
        let scene = Scene::builtin(&sets).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let options = |name: &str, resume| {
            let out = folder.path().join(name);
            RunOptions { out, resume, backend: Backend::Cpu }
        };
        let never = AtomicBool::new(false);
        let whole = simulate(&scene, &options("whole", false), &mut |_| {}, &never).unwrap();
        let failing = options("failing", false);
        let player = || Player::builder(scene.clone()).without_history().build().unwrap();
        let mut run = Run::start(player(), &failing).unwrap();
        for frame in 1..=5 {
            run.step().unwrap();
            run.append().unwrap();
            if frame == 3 {
                run.keep_state().unwrap();
            }
        }
        run.go_back_to_kept();
        let so_far = run.finish(&mut |_| {}).unwrap();
        assert_eq!(so_far.frames, 3);
        assert!(so_far.notes.iter().any(|note| note.contains("the last 2 frames again")), "{so_far:?}");
        assert_ne!(so_far.state_hash, whole.state_hash);
        let resumed = simulate(&scene, &options("failing", true), &mut |_| {}, &never).unwrap();
        assert_eq!((resumed.frames, resumed.state_hash), (8, whole.state_hash));
        let cache =
            |name: &str| std::fs::read(cache_path(&scene, &folder.path().join(name)).unwrap()).unwrap();
        assert!(cache("whole") == cache("failing"));
    }
}
