//! How the time of a frame grows with the strands, and how near it comes to what the device can do.
//!
//! # Practice
//! Straight strands of 25 particles grown on the built-in head, which turns against its own distance field; hair meets on a grid, if asked for. A frame's time is the mean of some
//! after some to warm up, handed over one after the other and waited for at their end; stages are of one frame more, on a GPU by its own clock.
//!
//! The roof is measured first: independent multiply–adds, and a copy of what no cache holds. Beside it stands the strand solve, whose operations are counted by `cargo run --release -p
//! forelock-core --example roofline`, and whose traffic is what it reads and writes when each number goes to memory once: a frame on the CPU, a substep on a GPU.

use std::sync::Arc;
use std::time::Instant;

use forelock_core::body::{ColliderFrame, Head, Motion, Sdf, Shape};
use forelock_core::grid::GridParams;
use forelock_core::groom::Groom;
use forelock_core::groom::grow::{GrowParams, grow_on_head};
use forelock_core::lane::peak::multiply_adds_per_sec;
use forelock_core::pose::Pose;
use forelock_core::solver::{AmsParams, Frame, Options, Simulation};
use forelock_gpu::{Choice, Gpu, GpuSimulation, Peaks};
use glam::DVec3;
use rayon::prelude::*;
use serde::Serialize;

use crate::assets::AssetError;
use crate::paper::{Study, Table};
use crate::report::thousands;
use crate::run::{Observer, Progress, RunError};
use crate::summary::device_name;

/// Counts of strands, of which those up to the greatest asked for are run.
pub const STRANDS: [u32; 6] = [1_000, 10_000, 30_000, 120_000, 400_000, 1_000_000];
/// Particles of a strand.
const PARTICLES: u32 = 25;
/// Float32 operations of the strand solve, a particle and substep.
const OPERATIONS: f64 = 770.0;
/// Bytes that it moves there on a GPU: 28 of the model, 48 of positions and velocities, 8 of ties, 240 of factors, and 6 of blocks and lengths.
const GPU_BYTES: f64 = 330.0;
/// Bytes that a particle moves in a frame on the CPU, where all substeps run in the cache.
const CPU_BYTES: f64 = 92.0;
const FPS: f64 = 60.0;

/// How the table is made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScalingOptions {
    /// On a GPU.
    pub on_gpu: bool,
    /// Strands at most.
    pub most: u32,
    /// Frames timed, 1 at least.
    pub frames: u32,
    /// Whether hair meets on a grid.
    pub grid: bool,
}

/// The table and what it was made on.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Scaling {
    /// Name of the processor.
    pub device: String,
    /// Threads; 0 on a GPU.
    pub threads: usize,
    /// Substeps a frame.
    pub substeps: u32,
    /// Frames timed.
    pub frames: u32,
    /// Whether hair meets on a grid.
    pub grid: bool,
    /// Operations a second at most, measured.
    pub peak_operations_per_sec: f64,
    /// Bytes a second at most, measured.
    pub peak_bytes_per_sec: f64,
    /// One row a count of strands.
    pub rows: Vec<ScalingRow>,
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
    /// Milliseconds of each stage in one frame; on the CPU of work, summed over threads and shared out among them.
    pub ms_per_stage: Vec<(&'static str, f64)>,
    /// Bytes held, a particle.
    pub bytes_per_particle: f64,
    /// Operations a second of the strand solve.
    pub solve_operations_per_sec: f64,
    /// Bytes a second of the strand solve.
    pub solve_bytes_per_sec: f64,
}

/// What is simulated.
enum On {
    Cpu(Box<Simulation>),
    Gpu(Box<GpuSimulation>),
}

/// The head's field and how it moves.
struct Scene {
    shape: Shape,
    motion: Motion,
}

impl Scene {
    fn step(&self, on: &mut On, number: u32) -> Result<Vec<(&'static str, f64)>, RunError> {
        let head = [number, number + 1].map(|number| self.motion.pose(f64::from(number) / FPS));
        let [from, to] = head;
        let colliders =
            [ColliderFrame { shape: &self.shape, local: Pose::IDENTITY, from, to, friction: 0.3 }];
        let frame = Frame {
            head,
            colliders: &colliders,
            gravity: GRAVITY,
            air_velocity: DVec3::ZERO,
            dt_secs: 1.0 / FPS,
        };
        match on {
            On::Gpu(simulation) => {
                simulation.step_frame(&frame)?;
                Ok(Vec::new())
            }
            On::Cpu(simulation) => Ok(simulation.step_frame(&frame)?.stage_secs.to_vec()),
        }
    }
}

const GRAVITY: DVec3 = DVec3::new(0.0, -9.81, 0.0);

/// Times frames of ever more strands.
///
/// # Errors
/// [`RunError`] if there is no such device, or it has no room.
pub fn scaling(options: &ScalingOptions, observer: &mut Observer<'_>) -> Result<Scaling, RunError> {
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
    let mut rows = Vec::with_capacity(counts.len());
    for strands in counts {
        let preset = GrowParams::preset("straight").map_err(AssetError::Grow)?;
        let params = GrowParams { strands, vertices_per_strand: PARTICLES, ..preset };
        let groom = grow_on_head(&params).map_err(AssetError::Grow)?;
        rows.push(row(options, &scene, gpu.as_ref(), &groom)?);
        observer(&Progress::Step);
    }
    observer(&Progress::End);
    Ok(Scaling {
        device: gpu.as_ref().map_or_else(device_name, |gpu| gpu.name().to_owned()),
        threads: if options.on_gpu { 0 } else { rayon::current_num_threads() },
        substeps: AmsParams::default().substeps,
        frames: options.frames,
        grid: options.grid,
        peak_operations_per_sec: peaks.operations_per_sec,
        peak_bytes_per_sec: peaks.bytes_per_sec,
        rows,
    })
}

fn row(
    options: &ScalingOptions,
    scene: &Scene,
    gpu: Option<&Gpu>,
    groom: &Groom,
) -> Result<ScalingRow, RunError> {
    let (params, grid) = (AmsParams::default(), options.grid.then(GridParams::default));
    let at_rest = Options { rest_gravity: GRAVITY, ..Options::default() };
    let mut on = match gpu {
        Some(gpu) => {
            let mut simulation = GpuSimulation::new(gpu, groom, &params, &at_rest)?;
            simulation.set_grid(grid.as_ref())?;
            On::Gpu(Box::new(simulation))
        }
        None => {
            let mut simulation = Simulation::new(groom, &params, &at_rest)?;
            simulation.set_grid(grid.as_ref())?;
            On::Cpu(Box::new(simulation))
        }
    };
    let warm_up = options.frames.min(5);
    for number in 0..warm_up {
        scene.step(&mut on, number)?;
    }
    gpu.map_or(Ok(()), Gpu::wait)?;
    let started = Instant::now();
    for number in warm_up..warm_up + options.frames {
        scene.step(&mut on, number)?;
    }
    gpu.map_or(Ok(()), Gpu::wait)?;
    let ms_per_frame = started.elapsed().as_secs_f64() * 1e3 / f64::from(options.frames);
    let particles = groom.particle_count();
    let (stages, bytes, traffic) = stages(scene, &mut on, warm_up + options.frames)?;
    let solve = stages.iter().find(|(name, _)| *name == "solve_strands").map_or(0.0, |(_, secs)| *secs);
    let per_sec = |work: f64| if solve > 0.0 { work * particles as f64 / solve } else { 0.0 };
    Ok(ScalingRow {
        strands: groom.strand_count(),
        particles,
        ms_per_frame,
        ms_per_stage: stages.iter().map(|&(name, secs)| (name, secs * 1e3)).collect(),
        bytes_per_particle: bytes as f64 / particles as f64,
        solve_operations_per_sec: per_sec(OPERATIONS * f64::from(params.substeps)),
        solve_bytes_per_sec: per_sec(traffic * f64::from(params.substeps)),
    })
}

/// A stage's name and its seconds.
type StageSecs = Vec<(&'static str, f64)>;

/// Seconds of each stage in one frame more, bytes held, and bytes that a particle moves in the strand solve of a substep.
fn stages(scene: &Scene, on: &mut On, number: u32) -> Result<(StageSecs, u64, f64), RunError> {
    if let On::Gpu(simulation) = on {
        simulation.time_stages(true);
    }
    let secs = scene.step(on, number)?;
    Ok(match on {
        On::Gpu(simulation) => {
            let secs = simulation.report()?.stage_secs.map_or_else(Vec::new, |secs| secs.to_vec());
            let ran = secs.into_iter().filter(|(_, secs)| *secs > 0.0);
            (ran.collect(), simulation.bytes(), GPU_BYTES)
        }
        On::Cpu(simulation) => {
            let threads = rayon::current_num_threads() as f64;
            let ran = secs.into_iter().filter(|(_, secs)| *secs > 0.0);
            let memory = simulation.memory();
            let bytes = (memory.model + memory.state + memory.workspace) as u64;
            let substeps = f64::from(simulation.params().substeps);
            (ran.map(|(name, secs)| (name, secs / threads)).collect(), bytes, CPU_BYTES / substeps)
        }
    })
}

/// What the processor's threads do together.
fn cpu_peaks() -> Peaks {
    const NUMBERS: usize = 1 << 26;
    let threads = rayon::current_num_threads();
    let operations = (0..threads).into_par_iter().with_max_len(1).map(|_| multiply_adds_per_sec()).sum();
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
        let mut stages = Table::new("Stages, ms of one frame", &["strands", "all"]);
        let names: Vec<&str> =
            self.rows.iter().flat_map(|row| &row.ms_per_stage).map(|(name, _)| *name).fold(
                Vec::new(),
                |mut names, name| {
                    if !names.contains(&name) {
                        names.push(name);
                    }
                    names
                },
            );
        stages.columns.extend(names.iter().map(|name| name.replace('_', " ")));
        for row in &self.rows {
            let (operations, bytes) = (row.solve_operations_per_sec, row.solve_bytes_per_sec);
            let share = |rate: f64, peak: f64| format!("{:.0} %", 100.0 * rate / peak);
            table.rows.push(vec![
                format!("{} × {}", thousands(row.strands), row.particles / row.strands.max(1)),
                format!("{:.3}", row.ms_per_frame),
                format!("{:.0}", row.bytes_per_particle),
                format!("{:.1}", operations / 1e9),
                share(operations, self.peak_operations_per_sec),
                format!("{:.1}", bytes / 1e9),
                share(bytes, self.peak_bytes_per_sec),
            ]);
            let of = |name: &&str| row.ms_per_stage.iter().find(|(own, _)| own == name).map_or(0.0, |s| s.1);
            let parts: Vec<f64> = names.iter().map(of).collect();
            let all = std::iter::once(parts.iter().sum::<f64>()).chain(parts.iter().copied());
            let cells = all.map(|ms| format!("{ms:.3}"));
            stages.rows.push(std::iter::once(thousands(row.strands)).chain(cells).collect());
        }
        let threads = match self.threads {
            0 => String::new(),
            threads => format!(", {threads} threads"),
        };
        let meets = if self.grid { "hair meets on a grid of 64" } else { "hair does not meet" };
        Study {
            title: format!("Scaling, {}{threads}", self.device),
            claim: String::new(),
            notes: vec![
                format!(
                    "The mean of {} frames, waited for at their end; {} substeps a frame; {meets}.",
                    self.frames, self.substeps
                ),
                format!(
                    "Measured peaks: {:.0} GFLOP/s of independent multiply–adds, {:.1} GB/s of a copy, read and written.",
                    self.peak_operations_per_sec / 1e9,
                    self.peak_bytes_per_sec / 1e9
                ),
            ],
            tables: vec![table, stages],
            plots: Vec::new(),
            bars: None,
        }
    }
}
