//! How the time of a frame grows with the strands, and how near it comes to what the device can do.
//!
//! # Practice
//! Straight strands of 25 particles grown on the built-in head, which turns against its distance
//! field; strands interact on a grid, if asked for. The time of a frame is a mean over several
//! frames after a warm-up. They are submitted one after the other; the host waits after every few
//! of them and at the end. Times of stages are means of the same frames; on a GPU, of a few more
//! frames on the device's clock.
//!
//! The roof is measured first: independent multiply–adds, and a copy of what no cache holds. Beside
//! it stands the strand solve, whose operations are counted by `cargo run --release -p
//! forelock-core --example roofline`, and whose traffic is what it reads and writes when each
//! number goes to memory once: a frame on the CPU, a substep on a GPU. Few strands stay in a cache,
//! so that their share of the memory's peak may be more than there is.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Instant;

use forelock_core::body::{ColliderFrame, Head, Motion, Sdf, Shape};
use forelock_core::frame::FrameInput;
use forelock_core::groom::Groom;
use forelock_core::groom::grow::{GrowParams, grow_on_head};
use forelock_core::interaction::contact::ContactParams;
use forelock_core::interaction::grid::GridParams;
use forelock_core::lane::peak::multiply_adds_per_sec;
use forelock_core::params::parts;
use forelock_core::pose::Pose;
use forelock_core::simulation::{Options, Simulation};
use forelock_core::solver::AmsParams;
use forelock_gpu::{Choice, Gpu, GpuError, GpuSimulation, Peaks};
use glam::DVec3;
use rayon::prelude::*;
use serde::Serialize;

use crate::BenchError;
use crate::paper::{Study, Table};
use forelock::AssetError;
use forelock::html::thousands;
use forelock::summary::device_name;
use forelock::{Observer, Progress};

/// Counts of strands, of which those up to the largest asked for are run.
pub const STRANDS: [u32; 6] = [1_000, 10_000, 30_000, 120_000, 400_000, 1_000_000];
/// Particles of a strand.
const PARTICLES: u32 = 25;
/// Float32 operations of the strand solve, a particle and substep.
const OPERATIONS: f64 = 770.0;
/// Bytes that it moves there on a GPU: 28 of the model, 48 of positions and velocities, 4 of ties,
/// 240 of factors.
const GPU_BYTES: f64 = 320.0;
/// The same with factors in 16 bits.
const GPU_BYTES_HALVED: f64 = 224.0;
/// Bytes that a particle moves in a frame on the CPU, where all substeps run in the cache.
const CPU_BYTES: f64 = 92.0;
/// Frames handed to a GPU before one waits for it.
const IN_FLIGHT: u32 = 32;
/// Frames whose stages a GPU times, at most.
const TIMED: u32 = 10;
const FPS: f64 = 60.0;

/// How the table is made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScalingOptions {
    /// On a GPU.
    pub on_gpu: bool,
    /// Maximum number of strands.
    pub most: u32,
    /// Frames timed, 1 at least.
    pub frames: u32,
    /// Whether strands interact on a grid.
    pub grid: bool,
    /// Whether segments of strands touch.
    pub contacts: bool,
    /// Whether a GPU keeps the strand solve's factors in 16 bits.
    pub half_factors: bool,
}

/// The table and what it was made on.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Scaling {
    /// Name of the processor.
    pub device: String,
    /// Threads; 0 on a GPU.
    pub threads: usize,
    /// Substeps per frame.
    pub substeps: u32,
    /// Frames timed.
    pub frames: u32,
    /// Whether strands interact on a grid.
    pub grid: bool,
    /// Whether segments of strands touch.
    pub contacts: bool,
    /// Whether the strand solve's factors are kept in 16 bits.
    pub half_factors: bool,
    /// Operations a second at most, measured.
    pub peak_operations_per_sec: f64,
    /// Bytes a second at most, measured.
    pub peak_bytes_per_sec: f64,
    /// One row a count of strands.
    pub rows: Vec<ScalingRow>,
    /// Why there are no more rows, if there are not.
    pub stopped: Option<String>,
}

/// A count of strands.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ScalingRow {
    /// Strands.
    pub strands: usize,
    /// Particles.
    pub particles: usize,
    /// Milliseconds a frame.
    pub ms_per_frame: f64,
    /// Milliseconds a frame of each stage that ran; on the CPU of work, summed over threads and
    /// shared out among them. Empty of a GPU without a clock.
    pub ms_per_stage: BTreeMap<&'static str, f64>,
    /// Bytes held, a particle.
    pub bytes_per_particle: f64,
    /// Operations a second of the strand solve, where its time is known.
    pub solve_operations_per_sec: Option<f64>,
    /// Bytes a second of the strand solve, where its time is known.
    pub solve_bytes_per_sec: Option<f64>,
    /// Strands that were not finite and were put back to rest.
    pub quarantined_strands: u32,
}

/// What is simulated.
enum On {
    Cpu(Box<Simulation>),
    Gpu(Box<GpuSimulation>),
}

impl On {
    /// Adds the times of the last frame on a GPU to `tally`.
    fn add_to(&mut self, tally: &mut Tally) -> Result<(), BenchError> {
        if let Self::Gpu(simulation) = self {
            let report = simulation.report()?;
            tally.add(report.secs.into_iter().flat_map(|secs| secs.stages), report.quarantined_strands);
        }
        Ok(())
    }
}

/// The head's field and how it moves.
struct Scene {
    shape: Shape,
    motion: Motion,
}

/// Seconds of stages, and strands put back.
#[derive(Default)]
struct Tally {
    secs: BTreeMap<&'static str, f64>,
    quarantined: u32,
}

impl Tally {
    fn add(&mut self, secs: impl IntoIterator<Item = (&'static str, f64)>, quarantined: u32) {
        for (name, secs) in secs.into_iter().filter(|(_, secs)| *secs > 0.0) {
            *self.secs.entry(name).or_default() += secs;
        }
        self.quarantined += quarantined;
    }
}

impl Scene {
    /// Steps a frame; on the CPU `tally` receives its times.
    fn step(&self, on: &mut On, number: u32, tally: &mut Tally) -> Result<(), BenchError> {
        let head = [number, number + 1].map(|number| self.motion.pose(f64::from(number) / FPS));
        let [from, to] = head;
        let colliders =
            [ColliderFrame { shape: &self.shape, local: Pose::IDENTITY, from, to, friction: 0.3 }];
        let frame = FrameInput {
            roots: head.into(),
            colliders: &colliders,
            gravity: GRAVITY,
            dt_secs: 1.0 / FPS,
            ..FrameInput::default()
        };
        match on {
            On::Gpu(simulation) => simulation.step_frame(&frame)?,
            On::Cpu(simulation) => {
                let report = simulation.step_frame(&frame)?;
                tally.add(report.stages.iter(), report.quarantined_strands);
            }
        }
        Ok(())
    }
}

const GRAVITY: DVec3 = DVec3::new(0.0, -9.81, 0.0);

/// Times frames of ever more strands.
///
/// # Errors
/// [`BenchError`] if there is no such device, or it has no room.
pub fn scaling(options: &ScalingOptions, observer: &mut Observer<'_>) -> Result<Scaling, BenchError> {
    let gpu = options.on_gpu.then(|| Gpu::open(&Choice::Fastest)).transpose()?;
    let peaks = match &gpu {
        Some(gpu) => Peaks::measure(gpu)?,
        None => cpu_peaks(),
    };
    let field = Sdf::from_mesh(&Head::builtin().mesh, 96, 0.02).map_err(|error| AssetError::Solid {
        mesh: "the built-in head".to_owned(),
        error,
        key: "body.sdf_cells",
    });
    let motion = Motion::by_name("turn").map_err(|error| AssetError::Motion(error.to_string()))?;
    let scene = Scene { shape: Shape::Sdf(Arc::new(field?)), motion };
    let counts: Vec<u32> = STRANDS.into_iter().filter(|&strands| strands <= options.most).collect();
    observer(&Progress::Begin { what: "strands", done: 0, total: counts.len() as u64 });
    let (mut rows, mut stopped) = (Vec::with_capacity(counts.len()), None);
    for strands in counts {
        let preset = GrowParams::preset("straight").map_err(AssetError::Grow)?;
        let params = GrowParams { strands, vertices_per_strand: PARTICLES, ..preset };
        let groom = grow_on_head(&params).map_err(AssetError::Grow)?;
        match row(options, &scene, gpu.as_ref(), &groom) {
            Ok(row) => rows.push(row),
            // What fits is worth telling.
            Err(BenchError::Gpu(error @ (GpuError::TooLarge { .. } | GpuError::Failed { .. })))
                if !rows.is_empty() =>
            {
                stopped = Some(format!("{} strands: {error}", thousands(strands as usize)));
                break;
            }
            Err(error) => return Err(error),
        }
        observer(&Progress::Step);
    }
    observer(&Progress::End);
    Ok(Scaling {
        device: gpu.as_ref().map_or_else(device_name, |gpu| gpu.name().to_owned()),
        threads: if options.on_gpu { 0 } else { rayon::current_num_threads() },
        substeps: substeps(&AmsParams::default()),
        frames: options.frames,
        grid: options.grid,
        contacts: options.contacts,
        half_factors: options.half_factors,
        peak_operations_per_sec: peaks.operations_per_sec,
        peak_bytes_per_sec: peaks.bytes_per_sec,
        rows,
        stopped,
    })
}

fn row(
    options: &ScalingOptions,
    scene: &Scene,
    gpu: Option<&Gpu>,
    groom: &Groom,
) -> Result<ScalingRow, BenchError> {
    let (params, grid) = (AmsParams::default(), options.grid.then(GridParams::default));
    let contacts = options.contacts.then(ContactParams::default);
    let at_rest = Options { rest_gravity: GRAVITY, ..Options::default() };
    let mut on = match gpu {
        Some(gpu) => {
            let mut simulation = GpuSimulation::new(gpu, groom, &params, &at_rest)?;
            simulation.set_grid(grid.as_ref())?;
            simulation.set_contacts(contacts.as_ref())?;
            simulation.set_half_factors(options.half_factors);
            On::Gpu(Box::new(simulation))
        }
        None => {
            let mut simulation = Simulation::new(groom, &params, &at_rest)?;
            simulation.set_grid(grid.as_ref())?;
            simulation.set_contacts(contacts.as_ref())?;
            On::Cpu(Box::new(simulation))
        }
    };
    let wait = || gpu.map_or(Ok(()), Gpu::wait);
    // An idle device lowers its clock.
    gpu.map(Peaks::measure).transpose()?;
    let warm_up = options.frames.min(5);
    for number in 0..warm_up {
        scene.step(&mut on, number, &mut Tally::default())?;
    }
    wait()?;
    let (started, mut tally) = (Instant::now(), Tally::default());
    for number in warm_up..warm_up + options.frames {
        scene.step(&mut on, number, &mut tally)?;
        if number % IN_FLIGHT == 0 {
            wait()?;
        }
    }
    wait()?;
    let ms_per_frame = started.elapsed().as_secs_f64() * 1e3 / f64::from(options.frames);
    let particles = groom.particle_count();
    let bytes = match &mut on {
        On::Cpu(simulation) => simulation.memory().total() as u64,
        On::Gpu(simulation) => {
            tally.quarantined = simulation.report()?.quarantined_strands;
            simulation.time_stages(true);
            simulation.bytes()
        }
    };
    // Seconds of all threads in a frame, over which they are shared out.
    let (mut frames, mut threads) = (options.frames, rayon::current_num_threads() as f64);
    let mut traffic = CPU_BYTES;
    if gpu.is_some() {
        (frames, threads) = (options.frames.min(TIMED), 1.0);
        traffic = if options.half_factors { GPU_BYTES_HALVED } else { GPU_BYTES };
        traffic *= f64::from(substeps(&params));
        for number in 0..frames {
            scene.step(&mut on, warm_up + options.frames + number, &mut tally)?;
            on.add_to(&mut tally)?;
        }
    }
    let secs = |name: &str| tally.secs.get(name).map(|secs| secs / f64::from(frames) / threads);
    let per_sec = |work: f64| secs("solve_strands").map(|secs| work * particles as f64 / secs);
    Ok(ScalingRow {
        strands: groom.strand_count(),
        particles,
        ms_per_frame,
        ms_per_stage: tally.secs.keys().filter_map(|&name| Some((name, secs(name)? * 1e3))).collect(),
        bytes_per_particle: bytes as f64 / particles as f64,
        solve_operations_per_sec: per_sec(OPERATIONS * f64::from(substeps(&params))),
        solve_bytes_per_sec: per_sec(traffic),
        quarantined_strands: tally.quarantined,
    })
}

/// Substeps of a frame of the scene.
fn substeps(params: &AmsParams) -> u32 {
    parts(1.0 / FPS, params.substep_secs)
}

/// What the processor's threads do together.
fn cpu_peaks() -> Peaks {
    const NUMBERS: usize = 1 << 26;
    let operations = rayon::broadcast(|_| multiply_adds_per_sec()).into_iter().sum();
    let source = vec![1.0f32; NUMBERS];
    let mut target = vec![0.0f32; NUMBERS];
    let mut best = 0.0f64;
    for _ in 0..5 {
        let started = Instant::now();
        let parts = target.par_chunks_mut(NUMBERS / 64).zip(source.par_chunks(NUMBERS / 64));
        parts.for_each(|(target, source)| target.copy_from_slice(source));
        let bytes = 2.0 * size_of_val(&*source) as f64;
        best = best.max(bytes / started.elapsed().as_secs_f64());
    }
    std::hint::black_box(&target);
    Peaks { operations_per_sec: operations, bytes_per_sec: best }
}

impl Scaling {
    /// The table, a row a count of strands.
    pub fn study(&self) -> Study {
        let mut table = Table::new(
            "",
            &[
                "strands × particles",
                "ms a frame",
                "bytes a particle",
                "solve, GFLOP/s",
                "of the peak",
                "solve, GB/s",
                "of the peak",
            ],
        );
        let mut stages = Table::new("Stages, ms a frame", &["strands", "all"]);
        let names: BTreeSet<&str> =
            self.rows.iter().flat_map(|row| row.ms_per_stage.keys().copied()).collect();
        stages.columns.extend(names.iter().map(|name| name.replace('_', " ")));
        for row in &self.rows {
            let rate =
                |rate: Option<f64>| rate.map_or_else(|| "–".to_owned(), |rate| format!("{:.1}", rate / 1e9));
            let share = |rate: Option<f64>, peak: f64| {
                rate.map_or_else(|| "–".to_owned(), |rate| format!("{:.0} %", 100.0 * rate / peak))
            };
            let (operations, bytes) = (row.solve_operations_per_sec, row.solve_bytes_per_sec);
            table.rows.push(vec![
                format!("{} × {}", thousands(row.strands), row.particles / row.strands.max(1)),
                format!("{:.3}", row.ms_per_frame),
                format!("{:.0}", row.bytes_per_particle),
                rate(operations),
                share(operations, self.peak_operations_per_sec),
                rate(bytes),
                share(bytes, self.peak_bytes_per_sec),
            ]);
            let parts: Vec<f64> =
                names.iter().map(|name| row.ms_per_stage.get(name).copied().unwrap_or(0.0)).collect();
            let all = std::iter::once(parts.iter().sum::<f64>()).chain(parts.iter().copied());
            let cells = all.map(|ms| format!("{ms:.3}"));
            stages.rows.push(std::iter::once(thousands(row.strands)).chain(cells).collect());
        }
        // Of a device without a clock there are none.
        let tables = if names.is_empty() { vec![table] } else { vec![table, stages] };
        let threads = match self.threads {
            0 => String::new(),
            threads => format!(", {threads} threads"),
        };
        let resolution = GridParams::default().resolution;
        let meets = if self.grid {
            format!("hair meets on a grid of {resolution}")
        } else {
            "hair does not meet".to_owned()
        };
        let touches = if self.contacts { ", segments touch" } else { "" };
        let halves = if self.half_factors { "; factors in 16 bits" } else { "" };
        let quarantined: u32 = self.rows.iter().map(|row| row.quarantined_strands).sum();
        let broken = (quarantined > 0)
            .then(|| format!("{quarantined} strands were not finite and were put back to rest."));
        Study {
            title: format!("Scaling, {}{threads}", self.device),
            claim: String::new(),
            notes: [
                format!(
                    "The mean of {} frames, waited for now and then and at their end; {} substeps a frame; {meets}{touches}{halves}.",
                    self.frames, self.substeps
                ),
                format!(
                    "Measured peaks: {:.0} GFLOP/s of independent multiply–adds, {:.1} GB/s of a copy, read and written.",
                    self.peak_operations_per_sec / 1e9,
                    self.peak_bytes_per_sec / 1e9
                ),
            ]
            .into_iter()
            .chain(broken)
            .chain(self.stopped.clone())
            .collect(),
            tables,
            ..Study::default()
        }
    }
}
