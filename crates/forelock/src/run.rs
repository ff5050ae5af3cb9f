//! A run: a scene simulated frame by frame into an output folder.
//!
//! # Practice
//! [`simulate`] loads what the scene names, steps through its frames while the cache goes to disk, and leaves in the
//! output folder: the cache, `snapshot.npz` (the state after the last frame), `scene.toml` (every key written out), the
//! pictures, `summary.json` and `report.html`. Nothing is written before everything has been loaded.
//!
//! When `cancel` is set the frame at hand is finished and the run ends as if its scene were that long. A later run
//! with [`RunOptions::resume`] goes on from the snapshot: cache and state hash come out as if nothing had happened.
//!
//! # Limitations
//! A resumed run must have the scene and the files of the first one: all but `time.frames`, the outputs and the looks
//! is compared, and a difference is an error.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use forelock_core::air::{Wind, WindParams};
use forelock_core::body::ColliderFrame;
use forelock_core::frame::{Frame, FrameReport};
use forelock_core::groom::guides::Skinning;
use forelock_core::lane::Simd;
use forelock_core::pose::Pose;
use forelock_core::simulation::{Options, Simulation};
use forelock_io::CacheWriter;
use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::assets::{AssetError, Assets};
use crate::backend::{Backend, Device};
use crate::hash::Fnv;
use crate::pictures::{self, PictureError, Studio};
use crate::regrooming::Regrooming;
use crate::report;
use crate::scene::{InteractionKind, Scene, SolverKind};
use crate::snapshot::{Snapshot, SnapshotError};
use crate::summary::{
    FrameRow, SKIN_STRANDS, Spread, Summary, WRITE_CACHE, device_name, median_stages, peak_memory_bytes,
};

/// Where and how a scene is run.
#[derive(Clone, Debug)]
pub struct RunOptions {
    /// The output folder; made if it is not there.
    pub out: PathBuf,
    /// Whether to go on where an earlier run into the same folder ended.
    pub resume: bool,
    /// Where to compute.
    pub backend: Backend,
}

/// What a run tells while it runs.
#[derive(Clone, Copy, Debug)]
pub enum Progress<'a> {
    /// Something worth knowing, one sentence.
    Note(&'a str),
    /// A piece of work begins, of which `done` of `total` steps are done already.
    Begin {
        /// What it is, a word or two.
        what: &'static str,
        /// Steps done before.
        done: u64,
        /// Steps in all.
        total: u64,
    },
    /// One more step is done.
    Step,
    /// The piece of work is done.
    End,
}

/// Receives what a run tells.
pub type Observer<'a> = dyn FnMut(&Progress<'_>) + 'a;

/// Why a run failed.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The scene itself is wrong.
    #[error(transparent)]
    Scene(#[from] crate::scene::SceneError),
    /// Something that the scene names cannot be used.
    #[error(transparent)]
    Asset(#[from] AssetError),
    /// The solver refuses groom or parameters.
    #[error("the solver cannot take this scene: {0}")]
    Build(#[from] forelock_core::simulation::BuildError),
    /// The hair cannot be carried by guides.
    #[error("groom.guides: {0}")]
    Guides(#[from] forelock_core::groom::guides::GuidesError),
    /// An edited groom cannot be taken over.
    #[error("the simulation cannot take the edited groom over: {0}")]
    Regroom(#[from] forelock_core::simulation::RegroomError),
    /// The wind is none.
    #[error("the wind cannot blow: {0}")]
    Wind(forelock_core::params::ParamsError),
    /// There is nothing to resume, or it does not fit.
    #[error(transparent)]
    Snapshot(#[from] SnapshotError),
    /// The snapshot is of another groom.
    #[error("the snapshot does not fit: {0}")]
    Restore(#[from] forelock_core::strands::SnapshotError),
    /// The GPU cannot do it.
    #[error(transparent)]
    Gpu(#[from] forelock_gpu::GpuError),
    /// The solver refuses a frame.
    #[error("the solver cannot step this scene: {0}")]
    Step(#[from] forelock_core::params::ParamsError),
    /// A file cannot be written.
    #[error(transparent)]
    Write(#[from] forelock_io::WriteError),
    /// The output folder cannot be made.
    #[error("{}: the output folder cannot be made: {error}; name another with --out", .path.display())]
    Folder {
        /// The folder.
        path: PathBuf,
        /// What the system said.
        error: std::io::Error,
    },
    /// A picture cannot be made.
    #[error(transparent)]
    Picture(#[from] PictureError),
}

/// Runs `scene` and writes its outputs; `observer` is told how it goes, `cancel` ends it early and cleanly.
///
/// # Errors
/// [`RunError`]; what was written until then is whole.
pub fn simulate(
    scene: &Scene,
    options: &RunOptions,
    observer: &mut Observer<'_>,
    cancel: &AtomicBool,
) -> Result<Summary, RunError> {
    let assets = Assets::load(scene, observer)?;
    let mut run = Run::start(scene, &assets, options)?;
    run.notes.iter().for_each(|note| observer(&Progress::Note(note)));
    match run.step_through(observer, cancel) {
        // What is done is not lost with the device: its last frame is here, and can be resumed from.
        Err(RunError::Gpu(error)) => {
            run.finish(observer)?;
            Err(error.into())
        }
        stepped => stepped.and_then(|()| run.finish(observer)),
    }
}

/// A simulation and what it is fed with.
pub struct Stepper<'a> {
    scene: &'a Scene,
    assets: &'a Assets,
    wind: Wind,
    /// The simulation.
    pub simulation: Simulation,
    /// What steps it, if not this processor.
    pub(crate) device: Option<Device>,
    /// How guides carry all strands, if only guides are simulated.
    skinning: Option<Skinning>,
    /// The guides' positions.
    guides: Vec<Vec3>,
    /// Edits while the hair moves.
    regrooming: Regrooming,
    /// The state before the edits and the steps of the frame under way on a device: what a run that fails there is resumed from, for they are done again then.
    before_edits: Option<forelock_core::strands::Snapshot<f32>>,
}

impl<'a> Stepper<'a> {
    /// The simulation of `assets` at rest as `scene` asks for it, on this processor.
    pub fn new(scene: &'a Scene, assets: &'a Assets) -> Result<Self, RunError> {
        Ok(Self::on(Backend::Cpu, scene, assets)?.0)
    }

    /// The same on `backend`, and what is worth telling about that.
    pub fn on(
        backend: Backend,
        scene: &'a Scene,
        assets: &'a Assets,
    ) -> Result<(Self, Option<String>), RunError> {
        let options = Options {
            simd: scene.solver.simd.into(),
            rest_pose: assets.head_pose(0.0),
            rest_gravity: DVec3::from_array(scene.gravity),
            beyond_float32: scene.solver.beyond_float32,
        };
        let (count, solver) = (scene.groom.guides as usize, &scene.solver);
        let skinning = (count > 0).then(|| Skinning::new(&assets.groom, count, scene.seed)).transpose()?;
        let groom = skinning.as_ref().map_or(&assets.groom, Skinning::guides);
        let mut simulation = match solver.kind {
            SolverKind::MassSpring => Simulation::new(groom, &solver.mass_spring, &options)?,
            SolverKind::Dftl => Simulation::new(groom, &solver.dftl, &options)?,
            _ => Simulation::new(groom, &solver.ams, &options)?,
        };
        let (device, note) = backend.device((scene, assets), &simulation)?;
        let on_cpu = device.as_ref().is_none_or(Device::is_mixed);
        if on_cpu && scene.interaction.kind == InteractionKind::Grid {
            simulation.set_grid(Some(&scene.interaction.grid))?;
        }
        if on_cpu && scene.interaction.kind == InteractionKind::Sph {
            simulation.set_sph(Some(&scene.interaction.sph))?;
        }
        if on_cpu && scene.interaction.contacts {
            simulation.set_contacts(Some(&scene.interaction.contact))?;
        }
        let regrooming = Regrooming::new(scene);
        // A scene's seed is that of everything random.
        let wind = WindParams { seed: scene.seed.wrapping_add(scene.wind.seed), ..scene.wind.clone() };
        let wind = Wind::new(&wind).map_err(RunError::Wind)?;
        let guides = Vec::new();
        let before_edits = None;
        Ok((
            Self { scene, assets, wind, simulation, device, skinning, guides, regrooming, before_edits },
            note,
        ))
    }

    /// All strands at frame `frame`, which the simulation has reached: positions in world space and the groom's order, metres.
    pub fn positions(&mut self, frame: u32, out: &mut Vec<Vec3>) {
        let time = self.time_secs(frame);
        let head = self.assets.head_pose(time);
        let (simulation, assets) = (&self.simulation, self.assets);
        let between = self.steps(frame).filter(|(_, done)| *done > 0);
        let simulated = |out: &mut Vec<Vec3>| {
            let Some((step_secs, done)) = between else { return simulation.positions(out) };
            let at = |step: u64| step as f64 * step_secs;
            let heads = [done - 1, done].map(|step| assets.head_pose(at(step)));
            // To rounding the last step is the frame itself.
            let share = (1.0 - (at(done) - time) / step_secs).clamp(0.0, 1.0);
            let share = if share > 1.0 - STEP_ROUNDING { 1.0 } else { share as f32 };
            simulation.positions_between(share, [&heads[0], &heads[1]], &head, out);
        };
        let Some(skinning) = &mut self.skinning else {
            return self.regrooming.positions(simulated, out);
        };
        simulated(&mut self.guides);
        skinning.skin(&head, &self.guides, out);
    }

    /// For a solver that steps at its own rate, its step in seconds and the steps that it has done by frame `frame`: those that begin before it.
    fn steps(&self, frame: u32) -> Option<(f64, u64)> {
        let step_secs = self.scene.solver.step_secs()?;
        let steps = self.time_secs(frame) / step_secs;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a count of steps")]
        Some((step_secs, (steps - STEP_ROUNDING).ceil().max(0.0) as u64))
    }

    /// The time, seconds, that the simulation has reached by frame `frame`.
    fn simulated_secs(&self, frame: u32) -> f64 {
        self.steps(frame).map_or_else(|| self.time_secs(frame), |(step_secs, done)| done as f64 * step_secs)
    }

    /// Seconds that the last frame took by a GPU's own clock.
    pub fn device_secs(&self) -> Option<f64> {
        self.device.as_ref().and_then(|device| device.frame_secs)
    }

    /// Time of frame `frame`, seconds.
    pub fn time_secs(&self, frame: u32) -> f64 {
        f64::from(frame) / self.scene.time.fps
    }

    /// Where each strand's positions begin, and how many of them go with the head.
    pub fn strands(&self) -> (&'a [u32], u32) {
        (self.assets.groom.strand_offsets(), self.scene.solver.clamped())
    }

    /// All solids between frame `frame` and the next, and the head's poses then.
    pub fn surroundings(&self, frame: u32) -> ([Pose; 2], Vec<ColliderFrame<'a>>) {
        self.surroundings_at([frame, frame + 1].map(|frame| self.time_secs(frame)))
    }

    /// The same between two times, seconds.
    fn surroundings_at(&self, times: [f64; 2]) -> ([Pose; 2], Vec<ColliderFrame<'a>>) {
        let head = times.map(|time| self.assets.head_pose(time));
        (head, self.assets.collider_frames(times, head))
    }

    /// Does the edits that are to be done by frame `frame`.
    pub fn regroom(&mut self, frame: u32) -> Result<(), RunError> {
        let time = self.time_secs(frame);
        let moment = (time, self.assets.head_pose(self.simulated_secs(frame)));
        if self.device.is_some() && self.regrooming.is_due(time) {
            self.before_edits = Some(self.simulation.snapshot());
        }
        let edited = self.regrooming.advance(self.scene, self.assets, &mut self.simulation, moment)?;
        if let Some(device) = self.device.as_mut().filter(|_| edited) {
            device.begin_anew(&self.simulation)?;
        }
        Ok(())
    }

    /// From frame `frame` to the next.
    pub fn step(&mut self, frame: u32) -> Result<FrameReport, RunError> {
        self.regroom(frame)?;
        let report = match self.steps(frame) {
            None => self.step_between([frame, frame + 1].map(|frame| self.time_secs(frame)))?,
            Some((step_secs, done)) => {
                let end = self.steps(frame + 1).map_or(done, |(_, end)| end);
                if self.device.is_some() && end > done + 1 && self.before_edits.is_none() {
                    self.before_edits = Some(self.simulation.snapshot());
                }
                let (mut sum, mut secs) = (FrameReport::default(), None);
                // Frames that are shorter than a step may have none.
                for step in done..end {
                    let report = self.step_between([step, step + 1].map(|step| step as f64 * step_secs))?;
                    sum = sum.then(&report);
                    if let Some(own) = self.device.as_ref().and_then(|device| device.frame_secs) {
                        secs = Some(secs.unwrap_or(0.0) + own);
                    }
                }
                if let Some(device) = &mut self.device {
                    device.frame_secs = secs;
                }
                sum
            }
        };
        self.before_edits = None;
        Ok(report)
    }

    /// From one time to another, seconds.
    fn step_between(&mut self, times: [f64; 2]) -> Result<FrameReport, RunError> {
        let (head, colliders) = self.surroundings_at(times);
        let air = self.wind.at(times[0]);
        // What is the same everywhere goes the quick way.
        let (air_velocity, field) =
            if self.wind.params().is_uniform() { (air.mean, None) } else { (DVec3::ZERO, Some(&air)) };
        let frame = Frame {
            head,
            colliders: &colliders,
            gravity: DVec3::from_array(self.scene.gravity),
            air_velocity,
            dt_secs: self.scene.solver.step_secs().unwrap_or(1.0 / self.scene.time.fps),
        };
        Ok(match &mut self.device {
            Some(device) => device.step(&frame, field, &mut self.simulation)?,
            None => self.simulation.step_frame_in(&frame, field)?,
        })
    }
}

/// Share of a step within which two times are the same.
const STEP_ROUNDING: f64 = 1e-6;

/// Where a run computes.
struct Machine {
    backend: &'static str,
    device: String,
    simd: String,
    threads: usize,
}

impl Machine {
    fn of(stepper: &Stepper<'_>) -> Self {
        let on_gpu = stepper.device.as_ref();
        let simd = Simd::from(stepper.scene.solver.simd).resolve();
        Self {
            backend: if on_gpu.is_some() { "gpu" } else { "cpu" },
            device: on_gpu.map_or_else(device_name, |device| device.name().to_owned()),
            simd: if on_gpu.is_some() { "wgsl".to_owned() } else { format!("{simd:?}").to_lowercase() },
            threads: rayon::current_num_threads(),
        }
    }

    fn hash(&self) -> u64 {
        let text = [self.backend, &self.device, &self.simd, &self.threads.to_string()].join("\n");
        Fnv::new().bytes(text.as_bytes()).value()
    }
}

/// A run under way.
struct Run<'a> {
    stepper: Stepper<'a>,
    out: &'a Path,
    cache: Option<CacheWriter>,
    /// Frames done, what they took, and the worst values over them.
    so_far: Snapshot,
    positions: Vec<Vec3>,
    /// What is worth telling of the run itself.
    notes: Vec<String>,
}

impl<'a> Run<'a> {
    fn start(scene: &'a Scene, assets: &'a Assets, options: &'a RunOptions) -> Result<Self, RunError> {
        let out = options.out.as_path();
        let (mut stepper, note) = Stepper::on(options.backend, scene, assets)?;
        let fingerprint = assets.fingerprint(scene);
        let cache_path = cache_path(scene, out);
        let mut so_far = Snapshot::begin(fingerprint);
        let cache = if options.resume {
            so_far = Snapshot::read(&out.join(SNAPSHOT), fingerprint)?;
            // What was edited before its last frame.
            if let Some(last) = so_far.frame.checked_sub(1) {
                stepper.regroom(last)?;
            }
            if let Some(state) = so_far.state.take() {
                stepper.simulation.restore(&state)?;
                if let Some(device) = &mut stepper.device {
                    device.take(&stepper.simulation)?;
                }
                stepper.before_edits = None;
            }
            cache_path.map(|path| CacheWriter::resume(&path, so_far.frame as usize + 1)).transpose()?
        } else {
            std::fs::create_dir_all(out)
                .map_err(|error| RunError::Folder { path: out.to_path_buf(), error })?;
            let offsets = assets.groom.strand_offsets();
            cache_path.map(|path| CacheWriter::create(&path, offsets, &[])).transpose()?
        };
        let mut notes: Vec<String> = note.into_iter().collect();
        let machine = Machine::of(&stepper).hash();
        if so_far.machine != machine && !so_far.rows.is_empty() {
            let (frames, _) = (so_far.frame, so_far.rows.drain(..));
            notes.push(format!("the first {frames} frames ran elsewhere: times and plots are without them"));
        }
        so_far.machine = machine;
        let mut run = Self { stepper, out, cache, so_far, positions: Vec::new(), notes };
        run.stepper.positions(run.so_far.frame, &mut run.positions);
        if !options.resume {
            run.append()?;
        }
        Ok(run)
    }

    /// Appends the present positions to the cache.
    fn append(&mut self) -> Result<(), RunError> {
        let time = self.stepper.time_secs(self.so_far.frame);
        if let Some(cache) = &mut self.cache {
            cache.append(time, &self.positions)?;
        }
        Ok(())
    }

    fn step_through(&mut self, observer: &mut Observer<'_>, cancel: &AtomicBool) -> Result<(), RunError> {
        let frames = self.stepper.scene.time.frames;
        let done = self.so_far.frame.into();
        observer(&Progress::Begin { what: "simulating", done, total: frames.into() });
        while self.so_far.frame < frames && !cancel.load(Ordering::SeqCst) {
            self.step()?;
            let written = Instant::now();
            self.append()?;
            if let Some(row) = self.so_far.rows.last_mut() {
                row.stages.push((WRITE_CACHE, written.elapsed().as_secs_f64() * 1e3));
            }
            observer(&Progress::Step);
        }
        observer(&Progress::End);
        Ok(())
    }

    /// One frame.
    fn step(&mut self) -> Result<(), RunError> {
        let frame = self.so_far.frame;
        let started = Instant::now();
        let report = self.stepper.step(frame)?;
        let stepped = Instant::now();
        self.stepper.positions(frame + 1, &mut self.positions);
        let skin_ms = stepped.elapsed().as_secs_f64() * 1e3;
        let guided = self.stepper.skinning.is_some();
        let mut ms = stepped.duration_since(started).as_secs_f64() * 1e3;
        let (_, colliders) = self.stepper.surroundings(frame);
        let (share, deepest) = deep_particles(&self.positions, self.stepper.strands(), &colliders);
        // What follows the leader is shown between steps, and knows a bound only.
        let follows = self.stepper.scene.solver.kind == SolverKind::Dftl;
        let mut penetration_m = if follows { deepest } else { report.max_penetration_m };
        // Stages that did not run are left out.
        let ran = report.stage_secs.iter().filter(|(_, secs)| *secs > 0.0);
        let mut stages: Vec<_> = ran.map(|&(stage, secs)| (stage, secs * 1e3)).collect();
        if guided {
            ms += skin_ms;
            stages.push((SKIN_STRANDS, skin_ms));
            // What the solver knows is how deep its guides are.
            penetration_m = penetration_m.max(deepest);
        }
        let contacts = report.strand_contacts.contacts as f64;
        let worst = [report.max_edge_stretch, report.max_edge_stretch_final, penetration_m, share, contacts];
        let so_far = &mut self.so_far;
        so_far.frame += 1;
        so_far.worst = std::array::from_fn(|i| so_far.worst[i].max(worst[i]));
        so_far.quarantined_strands += u64::from(report.quarantined_strands);
        so_far.rows.push(FrameRow { ms, stretch: report.max_edge_stretch, penetration_m, stages });
        Ok(())
    }

    /// Closes the cache, saves the state, takes the pictures, and writes summary and report.
    fn finish(mut self, observer: &mut Observer<'_>) -> Result<Summary, RunError> {
        let mut outputs = Vec::new();
        if let (Some(cache), Some(path)) = (self.cache.take(), cache_path(self.stepper.scene, self.out)) {
            cache.finish()?;
            outputs.push(path);
        }
        let before_edits = self.stepper.before_edits.take();
        self.so_far.state = Some(before_edits.unwrap_or_else(|| self.stepper.simulation.snapshot()));
        let snapshot = self.out.join(SNAPSHOT);
        self.so_far.write(&snapshot)?;
        outputs.push(snapshot);
        let text = |name: &str, text: &str| {
            let path = self.out.join(name);
            forelock_io::atomic_write(&path, |file| file.write_all(text.as_bytes())).map(|()| path)
        };
        outputs.push(text("scene.toml", &self.stepper.scene.clone().with_absolute_paths().to_toml())?);
        let studio = Studio::new(self.stepper.scene, self.stepper.assets);
        let last = (self.positions.as_slice(), self.stepper.time_secs(self.so_far.frame));
        // An interrupted run gets its film when it has been resumed.
        let whole = self.so_far.frame >= self.stepper.scene.time.frames;
        let cache = cache_path(self.stepper.scene, self.out).filter(|_| whole);
        let pictures = pictures::of_run(&studio, last, cache.as_deref(), self.out, observer)?;
        outputs.extend(pictures.files);

        let mut summary = self.summary(outputs);
        summary.outputs.push(self.out.join("summary.json"));
        if self.stepper.scene.output.report {
            summary.outputs.push(self.out.join("report.html"));
            text(
                "report.html",
                &report::html(self.stepper.scene, &summary, &self.so_far.rows, &pictures.shown),
            )?;
        }
        let json = serde_json::to_string_pretty(&summary).unwrap_or_default();
        text("summary.json", &json)?;
        Ok(summary)
    }

    fn summary(&self, outputs: Vec<PathBuf>) -> Summary {
        let times: Vec<f64> = self.so_far.rows.iter().map(|row| row.ms).collect();
        let memory = self.stepper.simulation.memory();
        let on_cpu = memory.total() as u64;
        let skinning_bytes = self.stepper.skinning.as_ref().map_or(0, Skinning::bytes) as u64;
        let so_far = &self.so_far;
        let on_gpu = self.stepper.device.as_ref();
        let machine = Machine::of(&self.stepper);
        Summary {
            scene: self.stepper.scene.name.clone(),
            solver: self.stepper.scene.solver.kind.name().to_owned(),
            backend: machine.backend,
            device: machine.device,
            simd: machine.simd,
            threads: machine.threads,
            strands: self.stepper.assets.groom.strand_count(),
            particles: self.stepper.assets.groom.particle_count(),
            guides: self.stepper.skinning.as_ref().map_or(0, |skinning| skinning.chosen().len()),
            frames: so_far.frame,
            frames_asked: self.stepper.scene.time.frames,
            fps: self.stepper.scene.time.fps,
            substeps: self.stepper.scene.substeps(),
            ms_per_frame: Spread::of(&times),
            ms_per_stage: median_stages(&so_far.rows),
            peak_memory_bytes: peak_memory_bytes(),
            simulation_bytes: on_gpu.map_or(on_cpu, Device::bytes) + skinning_bytes,
            max_edge_stretch: so_far.worst[0],
            max_edge_stretch_after_solids: so_far.worst[1],
            max_penetration_m: so_far.worst[2],
            max_share_1mm_inside: so_far.worst[3],
            max_strand_contacts: so_far.worst[4] as u64,
            quarantined_strands: so_far.quarantined_strands,
            state_hash: format!("{:016x}", self.stepper.simulation.state_hash()),
            notes: [&self.stepper.assets.notes[..], &self.notes, &self.stepper.regrooming.notes].concat(),
            outputs,
        }
    }
}

/// Name of the snapshot in the output folder.
const SNAPSHOT: &str = "snapshot.npz";

/// Where the cache goes, if there is to be one.
fn cache_path(scene: &Scene, out: &Path) -> Option<PathBuf> {
    let name = &scene.output.cache;
    (!name.as_os_str().is_empty()).then(|| out.join(name))
}

/// Depth under a surface from which a particle counts as inside, metres.
const DEEP_M: f64 = 1e-3;

/// The share of particles that are more than [`DEEP_M`] inside a solid at the end of its frame, and the depth of the deepest, metres. Of each strand's particles, which begin at `offsets`, the first `clamped` go with the head wherever that is, and do not count.
pub fn deep_particles(
    positions: &[Vec3],
    (offsets, clamped): (&[u32], u32),
    solids: &[ColliderFrame<'_>],
) -> (f64, f64) {
    let local: Vec<_> = solids.iter().map(|solid| (solid.shape, solid.pose(1.0).inverse())).collect();
    let depth = |p: &Vec3| {
        let depths = local.iter().map(|(shape, local_from_world): &(_, Pose)| {
            let p = local_from_world.transform_point(p.as_dvec3()).as_vec3().to_array();
            shape.sample_near(p, 0.0).map_or(0.0, |(distance, _)| -f64::from(distance))
        });
        depths.fold(0.0, f64::max)
    };
    let of_strand = |ends: &[u32]| {
        let free = positions.get((ends[0] + clamped) as usize..ends[1] as usize).unwrap_or_default();
        free.iter().map(depth).fold(
            (0, free.len(), 0.0),
            |(count, all, deepest): (usize, usize, f64), depth| {
                (count + usize::from(depth > DEEP_M), all, deepest.max(depth))
            },
        )
    };
    let both = |a: (usize, usize, f64), b: (usize, usize, f64)| (a.0 + b.0, a.1 + b.1, a.2.max(b.2));
    let strands = offsets.par_windows(2).with_min_len(256).map(of_strand);
    let (count, all, deepest) = strands.reduce(|| (0, 0, 0.0), both);
    (count as f64 / all.max(1) as f64, deepest)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Override;

    /// Positions after a second of follow the leader at a rate, and the deepest share inside the ball that flies through.
    fn after_a_second(fps: u32, keys: &[&str]) -> Vec<Vec3> {
        let text = "[groom]\nstrands = 60\n[wind]\nvelocity = [0.5, 0.0, 1.0]\n[solver]\nkind = \"dftl\"\n\
                    [interaction]\nkind = \"sph\"\n[body]\nmotion = \"builtin:shake\"\nsdf_cells = 32\n";
        let keys =
            [&[format!("time.fps={fps}")][..], &keys.iter().map(|&key| key.to_owned()).collect::<Vec<_>>()];
        let overrides: Vec<_> = keys.concat().iter().map(|key| Override::set(key).unwrap()).collect();
        let scene = Scene::parse(text, Path::new("scene.toml"), &overrides).unwrap();
        let assets = Assets::load(&scene, &mut |_| {}).unwrap();
        let mut stepper = Stepper::new(&scene, &assets).unwrap();
        let mut positions = Vec::new();
        for frame in 0..fps {
            stepper.step(frame).unwrap();
            stepper.positions(frame + 1, &mut positions);
            // Between steps too roots are where the head carries them.
            let head = assets.head_pose(stepper.time_secs(frame + 1));
            let root = head.transform_point(assets.groom.positions()[0].as_dvec3()).as_vec3();
            assert!(positions[0].distance(root) < 1e-5, "frame {frame} at {fps}");
        }
        positions
    }

    /// A solver with steps of its own shows the same hair at any rate: 24 to 240 frames a second.
    #[test]
    fn follow_the_leader_looks_alike_at_every_rate() {
        let far = |a: &[Vec3], b: &[Vec3]| a.iter().zip(b).map(|(a, b)| a.distance(*b)).fold(0.0, f32::max);
        let sixty = after_a_second(60, &[]);
        for fps in [24, 30, 120, 240] {
            let off = far(&after_a_second(fps, &[]), &sixty);
            assert!(off < 1e-5, "{fps} frames a second: {off} m");
        }
        // One step a frame is another motion.
        let own = ["solver.dftl.step_secs=0"];
        assert!(far(&after_a_second(30, &own), &after_a_second(120, &own)) > 1e-3);
    }
}
