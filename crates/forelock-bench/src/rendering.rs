//! How long a GPU draws hair, stage by stage, and the CPU beside it.
//!
//! # Practice
//! Straight strands of 25 particles grown on the built-in head, without children, from three
//! distances. Times of stages are means on the device's clock, after a warm-up. Preparing is what
//! the CPU does for the next picture by the GPU of the same hair and bodies: it compares them with
//! those before and uploads positions. The CPU's picture is the one of `forelock render`, drawn
//! once.

use std::collections::BTreeMap;
use std::time::Instant;

use forelock::html::thousands;
use forelock::{AssetError, Observer, PictureError, Progress};
use forelock_core::body::Head;
use forelock_core::groom::Groom;
use forelock_core::groom::grow::{GrowParams, grow_on_head};
use forelock_core::pose::Pose;
use forelock_gpu::{Choice, Gpu};
use forelock_render::gpu::GpuRenderer;
use forelock_render::{Body, Camera, HairColour, Image, Scene, Settings, Strands, render};
use glam::Vec3;
use serde::Serialize;

use crate::BenchError;
use crate::paper::{Strip, Study, Table};

/// Counts of strands.
const STRANDS: [u32; 3] = [10_000, 50_000, 120_000];
/// Particles of a strand.
const PARTICLES: u32 = 25;
/// Names of the distances, in distances from which the whole head fills the picture.
const DISTANCES: [(&str, f32); 3] = [("near", 0.35), ("whole", 1.0), ("far", 4.0)];
/// Pictures before the timed ones.
const WARM_UP: u32 = 3;

/// How the table is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RenderingOptions {
    /// The largest number of strands.
    pub most: u32,
    /// Pictures timed, 1 at least.
    pub frames: u32,
    /// Width of the picture, pixels.
    pub width: u32,
    /// Height of the picture, pixels.
    pub height: u32,
}

/// The table and what it was made on.
#[derive(Clone, Debug, Serialize)]
pub struct Rendering {
    /// Name of the GPU.
    pub device: String,
    /// Whether it is a software rasterizer.
    pub is_software: bool,
    /// Threads of the CPU.
    pub threads: usize,
    /// Width of the pictures, pixels.
    pub width: u32,
    /// Height of the pictures, pixels.
    pub height: u32,
    /// Pictures timed.
    pub frames: u32,
    /// The stages of the GPU, in their order.
    pub stages: Vec<&'static str>,
    /// One row a count of strands and distance.
    pub rows: Vec<RenderingRow>,
    /// Pictures by the CPU and by the GPU, side by side.
    #[serde(skip)]
    pub pictures: Vec<Image>,
}

/// A count of strands, from a distance.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct RenderingRow {
    /// Strands.
    pub strands: usize,
    /// Name of the distance.
    pub distance: &'static str,
    /// Pieces of strands in all tiles.
    pub pieces: u32,
    /// Pieces without room in the list.
    pub dropped: u32,
    /// Milliseconds of each stage; empty if the GPU has no clock.
    pub ms_per_stage: BTreeMap<&'static str, f64>,
    /// Milliseconds of all stages.
    pub gpu_ms: f64,
    /// Milliseconds from the call to the picture in the CPU's memory.
    pub with_reading_ms: f64,
    /// Milliseconds of the CPU: strands are chosen, and what is new is uploaded.
    pub prepare_ms: f64,
    /// Bytes uploaded for a picture.
    pub uploaded_bytes: u64,
    /// Bytes held by the device.
    pub device_bytes: u64,
    /// Milliseconds of the picture by the CPU.
    pub cpu_ms: f64,
    /// The mean difference of a channel between both pictures, 1/255.
    pub difference: f64,
}

/// Times pictures of ever more strands.
///
/// # Errors
/// [`BenchError`] if there is no GPU, or it has no room.
pub fn rendering(options: &RenderingOptions, observer: &mut Observer<'_>) -> Result<Rendering, BenchError> {
    let gpu = Gpu::open(&Choice::Fastest)?;
    let mut renderer = GpuRenderer::new(gpu.device(), gpu.queue());
    gpu.check()?;
    let head = Head::builtin();
    let counts: Vec<u32> = STRANDS.into_iter().filter(|&strands| strands <= options.most).collect();
    let total = (counts.len() * DISTANCES.len()) as u64;
    observer(&Progress::Begin { what: "pictures", done: 0, total });
    let (mut rows, mut pictures, mut stages) = (Vec::new(), Vec::new(), Vec::new());
    for strands in counts {
        let preset = GrowParams::preset("straight").map_err(AssetError::Grow)?;
        let params = GrowParams { strands, vertices_per_strand: PARTICLES, ..preset };
        let groom = grow_on_head(&params).map_err(AssetError::Grow)?;
        for distance in DISTANCES {
            let scene = scene_from(head, &groom, distance.1);
            let (row, picture) = row(&mut renderer, &scene, options)?;
            gpu.check()?;
            stages = renderer.report().stages_ms.iter().map(|&(name, _)| name).collect();
            rows.push(RenderingRow { strands: groom.strand_count(), distance: distance.0, ..row });
            pictures.push(picture);
            observer(&Progress::Step);
        }
    }
    observer(&Progress::End);
    Ok(Rendering {
        device: gpu.name().to_owned(),
        is_software: gpu.is_software(),
        threads: rayon::current_num_threads(),
        width: options.width,
        height: options.height,
        frames: options.frames,
        stages,
        rows,
        pictures,
    })
}

/// The head with `groom`, from `distance` times the distance at which it fills the picture.
fn scene_from<'a>(head: &'a Head, groom: &'a Groom, distance: f32) -> Scene<'a> {
    let points = groom.positions().iter().chain(&head.mesh.positions);
    let bounds = points.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(lo, hi), &p| (lo.min(p), hi.max(p)));
    let mut camera = Camera::framing(bounds, 0.6, 0.1);
    camera.eye = camera.target + (camera.eye - camera.target) * distance;
    let strands = Strands::from_groom(groom, HairColour::CHESTNUT);
    Scene::new(vec![Body::new(&head.mesh, Pose::IDENTITY)], vec![strands], camera)
}

/// The times of one scene, and its picture by the CPU beside that by the GPU.
fn row(
    renderer: &mut GpuRenderer,
    scene: &Scene<'_>,
    options: &RenderingOptions,
) -> Result<(RenderingRow, Image), BenchError> {
    let failed = |error| BenchError::Picture(PictureError::Gpu(error));
    let settings =
        Settings { width: options.width, height: options.height, children: Some(1), ..Settings::default() };
    let started = Instant::now();
    let by_cpu = render(scene, &settings).map_err(PictureError::Render)?;
    let cpu_ms = started.elapsed().as_secs_f64() * 1e3;
    let by_gpu = renderer.render(scene, &settings).map_err(failed)?;
    // Once more: the first upload also makes the buffers.
    renderer.render(scene, &settings).map_err(failed)?;
    let prepared = renderer.report().clone();
    for _ in 0..WARM_UP.min(options.frames) {
        renderer.redraw().map_err(failed)?;
    }
    let (started, mut sums) = (Instant::now(), BTreeMap::new());
    for _ in 0..options.frames {
        renderer.redraw().map_err(failed)?;
        for &(name, ms) in &renderer.report().stages_ms {
            *sums.entry(name).or_insert(0.0) += ms / f64::from(options.frames);
        }
    }
    let with_reading_ms = started.elapsed().as_secs_f64() * 1e3 / f64::from(options.frames);
    let report = renderer.report();
    let pairs = by_cpu.rgba().iter().zip(by_gpu.rgba());
    let sum: u64 = pairs.map(|(&a, &b)| u64::from(a.abs_diff(b))).sum();
    let row = RenderingRow {
        pieces: report.pieces,
        dropped: report.dropped,
        gpu_ms: sums.values().sum(),
        ms_per_stage: sums,
        with_reading_ms,
        prepare_ms: prepared.prepare_ms,
        uploaded_bytes: prepared.uploaded_bytes,
        device_bytes: report.device_bytes,
        cpu_ms,
        difference: sum as f64 / (by_cpu.rgba().len() / 4 * 3) as f64,
        ..RenderingRow::default()
    };
    let mut both = Image::filled(2 * options.width.min(2048), options.height, [0, 0, 0, 255])
        .map_err(PictureError::Image)?;
    both.paste(&by_cpu, 0, 0);
    both.paste(&by_gpu, options.width.min(2048), 0);
    Ok((row, both))
}

impl Rendering {
    /// The table, a row a count of strands and distance.
    pub fn study(&self) -> Study {
        let columns =
            ["strands × 25", "distance", "GPU, ms", "with reading, ms", "preparing, ms", "CPU's picture, ms"];
        let mut table = Table::new("", &columns);
        table.columns.extend(["uploaded, MB", "on the GPU, MB", "difference, 1/255"].map(str::to_owned));
        let mut stages = Table::new("Stages, ms", &["strands", "distance", "pieces", "without room"]);
        stages.columns.extend(self.stages.iter().map(|name| name.replace('_', " ")));
        for row in &self.rows {
            let mut cells = vec![thousands(row.strands), row.distance.to_owned()];
            let times = [row.gpu_ms, row.with_reading_ms, row.prepare_ms, row.cpu_ms];
            cells.extend(times.map(|ms| format!("{ms:.2}")));
            cells.extend([row.uploaded_bytes, row.device_bytes].map(|n| format!("{:.1}", n as f64 / 1e6)));
            cells.push(format!("{:.2}", row.difference));
            table.rows.push(cells);
            let mut cells = vec![thousands(row.strands), row.distance.to_owned()];
            cells.extend([row.pieces, row.dropped].map(|n| thousands(n as usize)));
            let ms = |name: &&str| row.ms_per_stage.get(name).copied().unwrap_or(0.0);
            cells.extend(self.stages.iter().map(|name| format!("{:.3}", ms(name))));
            stages.rows.push(cells);
        }
        let tables = if self.stages.is_empty() { vec![table] } else { vec![table, stages] };
        let software = if self.is_software { " (software)" } else { "" };
        let strips = self.pictures.last().map(|_| self.strips()).unwrap_or_default();
        Study {
            title: format!("Drawing hair, {}{software}, {} threads of the CPU", self.device, self.threads),
            notes: vec![
                format!(
                    "Pictures of {} × {} pixels; the mean of {} pictures on the device's clock.",
                    self.width, self.height, self.frames
                ),
                "Preparing is the CPU's part of the next picture by the GPU: it uploads what moves."
                    .to_owned(),
            ],
            tables,
            strips,
            ..Study::default()
        }
    }

    /// The pictures of the most strands.
    fn strips(&self) -> Vec<Strip> {
        let last = self.pictures.len().saturating_sub(DISTANCES.len());
        let shown = self.pictures[last..].iter().zip(DISTANCES);
        shown
            .map(|(image, (name, _))| Strip {
                name,
                title: format!("By the CPU and by the GPU, {name}"),
                image: image.clone(),
            })
            .collect()
    }
}
