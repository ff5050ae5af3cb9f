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
//! Every few seconds a checkpoint makes the cache readable and writes the snapshot, so a run whose
//! process is killed, whose device fails or whose disk is full loses only the work after it. A
//! later run with [`RunOptions::resume`] continues from the snapshot: cache and state hash are
//! those of an uninterrupted run. Where there is no snapshot, it starts with the first frame.
//!
//! When `cancel` is set, the current frame is finished and the run ends as if its scene were that
//! long, but without pictures.
//!
//! The output folder and the cache are locked while a run writes there.
//!
//! # Limitations
//! A resumed run needs the scene and the files of the first one: all but `time.frames`, the outputs
//! and the looks is compared, and a difference is an error.

mod checkpoints;
mod exports;
mod machine;
mod measure;
mod overwrite;
mod snapshot;

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use forelock_io::{Lock, Stored, WriteError};
use glam::Vec3;

use crate::backend::Backend;
use crate::painter::GpuPainter;
use crate::penetration::Penetration;
use crate::pictures::{self, LastFrame, PictureError, RunPictures, Studio};
use crate::player::{Player, PlayerError, StepReport};
use crate::progress::{Observer, Progress};
use crate::report;
use crate::scene::Scene;
use crate::sinks::{self, CacheSink, FrameView};
use crate::summary::{
    FrameRow, MEASURE_DEPTH, SKIN_STRANDS, Spread, Summary, WRITE_CACHE, median_stages, peak_memory_bytes,
};
use checkpoints::Checkpoints;
pub(crate) use exports::check_written;
use forelock_core::strands::{SleepSnapshot, Snapshot as State};
use machine::Machine;
use measure::FrameClock;
pub use measure::MEASURED_EVERY;
pub(crate) use overwrite::check_outputs;
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
    Write(#[from] WriteError),
    /// A file for other programs cannot be made.
    #[error("output.exports: {0}; `forelock convert --animated` makes it from the cache")]
    Export(#[from] forelock_io::animation::AnimationError),
    /// The output folder cannot be made.
    #[error("{}: the output folder cannot be made: {}; name another with --out", .path.display(), .error.kind())]
    Folder {
        /// The folder.
        path: PathBuf,
        /// The error of the operating system.
        error: std::io::Error,
    },
    /// An output would replace a file of the user.
    #[error("{}: this would be replaced, {what}; name another folder with --out or another file", .path.display())]
    Overwrites {
        /// The file.
        path: PathBuf,
        /// What it is.
        what: &'static str,
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
        Ok(ended) => run.finish(ended, observer),
        Err(error) => {
            run.keep_cache(observer);
            Err(error)
        }
    }
}

/// How the frames of a run ended.
#[derive(Clone, Copy, PartialEq)]
enum Ended {
    Whole,
    Interrupted,
}

/// A run under way.
struct Run<'a> {
    player: Player,
    out: &'a Path,
    cache: Option<Box<dyn CacheSink>>,
    /// Frames done, what they took, and the worst values over them.
    so_far: Snapshot,
    checkpoints: Checkpoints,
    /// Frames done at the last checkpoint in this folder that a later run can resume from.
    saved: Option<u32>,
    positions: Vec<Vec3>,
    /// What the user should know of the run itself.
    notes: Vec<String>,
    /// Draws the pictures; none: the CPU does.
    painter: Option<GpuPainter>,
    _lock: Lock,
}

impl<'a> Run<'a> {
    fn start(mut player: Player, options: &'a RunOptions) -> Result<Self, RunError> {
        let out = options.out.as_path();
        let output = &player.scene().output;
        let draws = output.picture || output.contact_sheet || output.film;
        // Before the first frame, so that a machine without a GPU is refused at once.
        let painter = if draws { GpuPainter::of(player.scene())? } else { None };
        std::fs::create_dir_all(out).map_err(|error| RunError::Folder { path: out.to_path_buf(), error })?;
        let snapshot = out.join(SNAPSHOT);
        let cache = cache_path(player.scene(), out);
        check_written(player.scene(), out)?;
        overwrite::check_scene_file(&out.join(SCENE))?;
        let lock = Lock::take(&out.join(LOCK), out)?;
        forelock_io::remove_leftovers(out);
        let fingerprint = player.assets().fingerprint(player.scene());
        let mut notes = Vec::new();
        let mut so_far = Snapshot::begin(fingerprint);
        let mut stored = None;
        if options.resume && !snapshot.exists() {
            notes.push(format!("there is nothing to resume in {}: the run starts anew", out.display()));
        } else if options.resume {
            let (read, state) = Snapshot::read(&snapshot, fingerprint)?;
            so_far = read;
            player.resume(so_far.frame, &state)?;
            let cached = (0..=so_far.frame).step_by(player.scene().output.cache_every as usize);
            let times_secs = cached.map(|frame| player.secs_of(frame)).collect();
            stored = Some(Stored { times_secs, checksum: so_far.cache_checksum });
        }
        let offsets = player.assets().groom.strand_offsets();
        let cache = cache.map(|path| sinks::open_cache(&path, offsets, stored.as_ref())).transpose()?;
        if so_far.frame > player.scene().time.frames {
            let [done, asked] = [so_far.frame, player.scene().time.frames];
            notes.push(format!("{done} frames are simulated already, more than the {asked} asked for"));
        }
        let machine = Machine::of(&player).hash();
        if so_far.machine != machine && !so_far.rows.is_empty() {
            so_far.rows.clear();
            let frames = so_far.frame;
            notes.push(format!("the first {frames} frames ran elsewhere: times and plots are without them"));
        }
        so_far.machine = machine;
        let saved = stored.as_ref().map(|_| so_far.frame);
        let checkpoints = Checkpoints::begin();
        let positions = Vec::new();
        let mut run =
            Self { player, out, cache, so_far, checkpoints, saved, positions, notes, painter, _lock: lock };
        run.player.positions(&mut run.positions)?;
        if stored.is_none() {
            run.append()?;
        }
        Ok(run)
    }

    /// Appends the present positions to the cache, if the frame belongs there.
    fn append(&mut self) -> Result<(), RunError> {
        let every = self.player.scene().output.cache_every;
        if let Some(cache) = self.cache.as_mut().filter(|_| self.player.frame().is_multiple_of(every)) {
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

    /// Simulates the frames that are left.
    fn step_through(&mut self, observer: &mut Observer<'_>, cancel: &AtomicBool) -> Result<Ended, RunError> {
        let frames = self.player.scene().time.frames;
        let done = self.so_far.frame.into();
        // Surfaces to measure against are made here, not in the first frame that is measured.
        self.player.prepare_surfaces();
        observer(&Progress::Begin { what: SIMULATING, done, total: frames.into() });
        let mut clock = FrameClock::start();
        while self.so_far.frame < frames && !cancel.load(Ordering::SeqCst) {
            self.step()?;
            let written = Instant::now();
            self.append()?;
            if let Some(row) = self.so_far.rows.last_mut() {
                row.stages.push((WRITE_CACHE.into(), written.elapsed().as_secs_f64() * 1e3));
                row.ms = clock.lap_ms();
            }
            if self.checkpoints.are_due() {
                let started = Instant::now();
                self.checkpoint()?;
                self.checkpoints.done(started);
            }
            observer(&Progress::Step);
        }
        observer(&Progress::End);
        Ok(if self.so_far.frame < frames { Ended::Interrupted } else { Ended::Whole })
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

    /// Saves all that a later run needs to continue from here.
    fn checkpoint(&mut self) -> Result<(), RunError> {
        let state = self.player.state()?;
        let checksum = self.cache.as_mut().map(|cache| cache.checkpoint()).transpose()?;
        self.save(state, checksum)
    }

    /// Writes the snapshot with `state` for a cache with `checksum`.
    fn save(&mut self, state: State<f32>, checksum: Option<u32>) -> Result<(), RunError> {
        if self.saved.is_none() && checksum.is_some() {
            // The snapshot of an earlier run, whose cache has just been replaced. If it cannot be
            // removed, it cannot be replaced either, which is an error.
            let _ = std::fs::remove_file(self.out.join(SNAPSHOT));
        }
        self.so_far.cache_checksum = checksum.unwrap_or(0);
        self.so_far.write(&self.out.join(SNAPSHOT), state)?;
        self.saved = Some(self.so_far.frame);
        Ok(())
    }

    /// After an error: keeps the cache of the frames so far, if they can be resumed. Otherwise an
    /// earlier run's files stay as they are.
    fn keep_cache(mut self, observer: &mut Observer<'_>) {
        let Some(frame) = self.saved else { return };
        let _ = self.cache.take().map(CacheSink::finish);
        let note = format!("the run stopped; the same command with --resume goes on after frame {frame}");
        observer(&Progress::Note(&note));
    }

    /// Closes the cache, saves the state, takes the pictures, and writes summary and report.
    fn finish(mut self, ended: Ended, observer: &mut Observer<'_>) -> Result<Summary, RunError> {
        let mut outputs = Vec::new();
        let state = self.player.state()?;
        let state_hash = state.hash();
        let asleep =
            |own: &SleepSnapshot<f32>| own.still_secs.iter().filter(|secs| secs.is_infinite()).count();
        let sleeping = state.sleep.as_ref().map_or(0, asleep);
        let finished = self.cache.take().map(CacheSink::finish).transpose()?;
        self.save(state, finished.as_ref().map(|cache| cache.checksum))?;
        outputs.extend(finished.into_iter().flat_map(|cache| cache.files));
        outputs.push(self.out.join(SNAPSHOT));
        let text = |name: &str, text: &str| {
            let path = self.out.join(name);
            forelock_io::atomic_write(&path, |file| file.write_all(text.as_bytes())).map(|()| path)
        };
        let (scene, assets) = (self.player.scene(), self.player.assets());
        let written = Scene::clone(scene).with_absolute_paths().to_toml();
        outputs.push(text(SCENE, &format!("{}{written}", overwrite::SCENE_HEADER))?);
        // An interrupted run gets its pictures when it has been resumed.
        let mut pictures = RunPictures::default();
        if ended == Ended::Whole {
            let cache = cache_path(scene, self.out);
            let last = LastFrame {
                positions: &self.positions,
                time_secs: self.player.secs_of(self.so_far.frame),
                cache: cache.as_deref(),
            };
            let studio = Studio::new(scene, assets).drawn_by(self.painter.as_ref());
            pictures = pictures::of_run(&studio, &last, self.out, observer)?;
            if let Some(cache) = &cache {
                outputs.extend(exports::write(scene, &assets.groom, cache, self.out, observer)?);
            }
        }
        outputs.extend(pictures.files);

        let mut summary = self.summary(outputs, state_hash, sleeping);
        summary.outputs.push(self.out.join(SUMMARY));
        if scene.output.report {
            summary.outputs.push(self.out.join("report.html"));
            text("report.html", &report::html(scene, &summary, &self.so_far.rows, &pictures.shown))?;
        }
        let json = serde_json::to_string_pretty(&summary).unwrap_or_default();
        text(SUMMARY, &json)?;
        Ok(summary)
    }

    /// Penetration in the last frame, unless it has been measured.
    fn last_penetration(&self) -> Penetration {
        let frame = self.so_far.frame;
        let is_missing = frame > 0 && !frame.is_multiple_of(MEASURED_EVERY);
        if is_missing { self.player.penetration(&self.positions) } else { Penetration::default() }
    }

    fn summary(&self, outputs: Vec<PathBuf>, state_hash: u64, sleeping: usize) -> Summary {
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
            penetration_measured_every: if player.has_solids() { MEASURED_EVERY } else { 0 },
            max_penetration_m: penetration.deepest_m,
            max_share_1mm_inside: penetration.share_inside,
            max_edge_penetration_m: penetration.deepest_edge_m,
            max_edge_share_1mm_inside: penetration.edge_share_inside,
            max_strand_contacts: so_far.worst[2] as u64,
            quarantined_strands: so_far.quarantined_strands,
            sleeping_strands: sleeping as u64,
            teleports: player.counters().teleports,
            state_hash: format!("{:016x}", state_hash),
            notes: [player.notes(), self.notes.clone()].concat(),
            outputs,
        }
    }
}

/// The piece of work ([`Progress::Begin`]) in which a run watches for its `cancel`.
pub const SIMULATING: &str = "simulating";

/// Name of the snapshot in the output folder.
pub(crate) const SNAPSHOT: &str = "snapshot.npz";

/// Name of the summary in the output folder, which is written last.
pub(crate) const SUMMARY: &str = "summary.json";

/// Name of the scene with every key in the output folder.
const SCENE: &str = "scene.toml";

/// Name of the lock in the output folder.
const LOCK: &str = ".forelock.lock";

/// Whether a run, of this process or of another one, writes into the folder `out`.
pub fn is_running_in(out: &Path) -> bool {
    let lock = out.join(LOCK);
    lock.is_file() && matches!(Lock::take(&lock, out), Err(WriteError::Locked { .. }))
}

/// `name` as the name of a folder: characters that do not suit one are replaced. `otherwise` if
/// nothing is left.
pub fn folder_name(name: &str, otherwise: &str) -> String {
    let plain = |c: char| if c.is_alphanumeric() || "-_. ".contains(c) { c } else { '-' };
    let name: String = name.chars().map(plain).collect();
    let name = name.trim_matches(['.', ' ']);
    if name.is_empty() { otherwise.to_owned() } else { name.to_owned() }
}

/// Where the cache goes, if there is to be one.
fn cache_path(scene: &Scene, out: &Path) -> Option<PathBuf> {
    let name = &scene.output.cache;
    (!name.as_os_str().is_empty()).then(|| out.join(name))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Override;

    /// A small scene without pictures.
    fn scene() -> Scene {
        let sets = ["groom.strands=20", "body.sdf_cells=32", "time.frames=8", "output.picture=false"];
        let sets: Vec<Override> = sets.iter().map(|set| Override::set(set).unwrap()).collect();
        Scene::builtin(&sets).unwrap()
    }

    fn options(folder: &Path, name: &str, resume: bool) -> RunOptions {
        RunOptions { out: folder.join(name), resume, backend: Backend::Cpu }
    }

    fn cache(options: &RunOptions) -> Vec<u8> {
        std::fs::read(cache_path(&scene(), &options.out).unwrap()).unwrap()
    }

    static NEVER: AtomicBool = AtomicBool::new(false);

    /// After an error a run resumes from its last checkpoint, to the result of a run without it.
    #[test]
    fn a_run_that_failed_resumes_from_its_checkpoint() {
        let folder = tempfile::tempdir().unwrap();
        let whole_options = options(folder.path(), "whole", false);
        let whole = simulate(&scene(), &whole_options, &mut |_| {}, &NEVER).unwrap();
        for checkpoints in [&[1, 4][..], &[]] {
            let failing = options(folder.path(), "failing", false);
            let player = Player::builder(scene()).without_history().build().unwrap();
            let mut run = Run::start(player, &failing).unwrap();
            for frame in 1..=5 {
                run.step().unwrap();
                run.append().unwrap();
                if checkpoints.contains(&frame) {
                    run.checkpoint().unwrap();
                }
            }
            let mut notes = Vec::new();
            run.keep_cache(&mut |progress| {
                if let Progress::Note(note) = progress {
                    notes.push((*note).to_owned());
                }
            });
            let last = checkpoints.last();
            assert_eq!(notes.len(), usize::from(last.is_some()));
            assert!(last.is_none_or(|frame| notes[0].contains(&format!("after frame {frame}"))), "{notes:?}");
            let failing = RunOptions { resume: true, ..failing };
            let resumed = simulate(&scene(), &failing, &mut |_| {}, &NEVER).unwrap();
            assert_eq!((resumed.frames, &resumed.state_hash), (8, &whole.state_hash), "{checkpoints:?}");
            assert!(cache(&whole_options) == cache(&failing), "{checkpoints:?}");
            std::fs::remove_dir_all(&failing.out).unwrap();
        }
    }

    /// A run that fails early leaves the files of the run before it.
    #[test]
    fn an_earlier_run_stays_until_the_first_checkpoint() {
        let folder = tempfile::tempdir().unwrap();
        let at = options(folder.path(), "run", false);
        let files = || {
            let names = std::fs::read_dir(&at.out).unwrap().map(|entry| entry.unwrap().path());
            let mut files: Vec<_> = names.map(|path| (std::fs::read(&path).unwrap(), path)).collect();
            files.sort();
            files
        };
        simulate(&scene(), &at, &mut |_| {}, &NEVER).unwrap();
        let before = files();
        let player = || Player::builder(scene()).without_history().build().unwrap();
        let mut run = Run::start(player(), &at).unwrap();
        run.step().unwrap();
        run.append().unwrap();
        let second = Run::start(player(), &at).map(|_| ()).unwrap_err().to_string();
        assert!(second.contains("another run writes here"), "{second}");
        run.keep_cache(&mut |_| {});
        assert!(files() == before);
        // What killed processes have left goes with the next run.
        for name in [".forelock-abc.part", "hair.npz.part"] {
            std::fs::write(at.out.join(name), "half a file").unwrap();
        }
        simulate(&scene(), &RunOptions { resume: true, ..at.clone() }, &mut |_| {}, &NEVER).unwrap();
        let names =
            |files: &[(Vec<u8>, PathBuf)]| files.iter().map(|file| file.1.clone()).collect::<Vec<_>>();
        assert_eq!(names(&files()).len(), names(&before).len());
    }
}
