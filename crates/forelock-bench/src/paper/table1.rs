//! Table 1 of the paper: every scene, timed.
//!
//! # Practice
//! A scene is simulated for some frames to warm up and some that are timed, without pictures or
//! files; a frame is what a step of the simulation takes on the wall clock, from poses to
//! positions. Stages are seconds of work summed over threads. On a GPU both come from the device's
//! clock.
//!
//! # Limitations
//! The paper's times are of another machine, a graphics card, and of scenes of which it gives the
//! counts only.

use forelock_core::groom::edit::{Density, Edit, Operation, Resample};
use forelock_gpu::{Choice, Gpu, GpuError};
use serde::Serialize;
use std::sync::Arc;

use crate::BenchError;
use crate::plot::{Bar, Bars};
use forelock::Backend;
use forelock::html::thousands;
use forelock::summary::{FrameRow, Spread, device_name, median_stages};
use forelock::{AssetError, Assets};
use forelock::{Observer, Player, PlayerError, Progress};
use forelock::{Scene, scene::InteractionKind};

use super::scenes::{self, Builtin};
use super::study::{Study, Table};

/// The paper's machine.
const PAPER_DEVICE: &str = "NVIDIA GeForce GTX 3080 Ti";

/// How the table is made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Table1Options {
    /// Frames before the first that is timed.
    pub warm_up: u32,
    /// Frames that are timed.
    pub frames: u32,
    /// Share of the strands, 0 to 1, where they are grown.
    pub share: f64,
    /// On a GPU; a scene that cannot be computed there is skipped, and says so.
    pub on_gpu: bool,
}

impl Default for Table1Options {
    fn default() -> Self {
        Self { warm_up: 30, frames: 60, share: 1.0, on_gpu: false }
    }
}

/// The table and what it was made on.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Table1 {
    /// Name of the processor.
    pub device: String,
    /// Threads; 0 on a GPU.
    pub threads: usize,
    /// The paper's machine.
    pub paper_device: &'static str,
    /// Frames before the first that was timed.
    pub warm_up: u32,
    /// Frames timed.
    pub frames: u32,
    /// One row a scene.
    pub rows: Vec<Table1Row>,
}

/// One scene's row.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Table1Row {
    /// Figure of the paper.
    pub figure: &'static str,
    /// What the paper calls the scene.
    pub name: &'static str,
    /// File in `scenes/ams`, without its ending.
    pub scene: &'static str,
    /// The paper's strands.
    pub paper_strands: usize,
    /// The paper's particles, as printed; empty where it gives none.
    pub paper_particles: &'static str,
    /// The paper's milliseconds a frame, where it gives them.
    pub paper_ms: Option<f64>,
    /// Strands simulated.
    pub strands: usize,
    /// Particles simulated.
    pub particles: usize,
    /// Solver.
    pub solver: String,
    /// Substeps per frame.
    pub substeps: u32,
    /// Whether strands interact on a grid.
    pub grid: bool,
    /// Milliseconds a frame.
    pub ms_per_frame: Spread,
    /// The shortest of them: what a frame takes when nothing else runs.
    pub ms_least: f64,
    /// Median work of each stage, milliseconds a frame, summed over threads.
    pub ms_per_stage: std::collections::BTreeMap<String, f64>,
    /// Why the scene was not run.
    pub skipped: Option<String>,
}

/// A row of the paper's table.
struct Entry {
    figure: &'static str,
    name: &'static str,
    builtin: Builtin,
    keys: &'static [&'static str],
    /// Where the strands come from.
    strands: Strands,
    paper: (usize, &'static str, Option<f64>),
}

/// Where an entry's strands are from.
#[derive(Clone, Copy, PartialEq)]
enum Strands {
    /// As the scene says.
    Scene,
    /// The one strand of Fig. 4.
    Helix,
    /// The wisp of Fig. 5, made up to 480 strands of 29 particles.
    Wisp,
}

/// Table 1, with the 1,024 strands of Fig. 6 and the mass-spring beard of Fig. 9 from the text.
#[rustfmt::skip]
const ENTRIES: [Entry; 12] = {
    use Strands::*;
    const fn entry(figure: &'static str, name: &'static str, builtin: Builtin, keys: &'static [&'static str], strands: Strands, paper: (usize, &'static str, Option<f64>)) -> Entry {
        Entry { figure, name, builtin, keys, strands, paper }
    }
    [
        entry("4", "Single Strand", scenes::FIGURE4, &[], Helix, (1, "30", Some(0.01))),
        entry("5", "Wisp Comparison", scenes::FIGURE5, &[], Wisp, (480, "14k", Some(0.02))),
        entry("6", "Wig, 1,024 strands", scenes::WIG, &["groom.strands=1024"], Scene, (1024, "", Some(0.04))),
        entry("6", "Wig", scenes::WIG, &[], Scene, (10_422, "214k", Some(1.9))),
        entry("7", "Hand Interaction", scenes::HAND, &[], Scene, (15_000, "450k", Some(15.2))),
        entry("8", "Hollow Sphere", scenes::HOLLOW_SPHERE, &[], Scene, (10_298, "308k", Some(1.8))),
        entry("1", "Wind", scenes::WIND, &[], Scene, (14_718, "294k", Some(14.9))),
        entry("1", "Asymmetric Style", scenes::ASYMMETRIC, &[], Scene, (7528, "150k", Some(6.4))),
        entry("9", "Beard", scenes::BEARD, &[], Scene, (1100, "22k", Some(0.03))),
        entry("9", "Beard, mass-spring", scenes::BEARD, &["solver.kind=mass-spring"], Scene, (1100, "22k", None)),
        entry("10", "Roller-Coaster", scenes::ROLLER_COASTER, &[], Scene, (7500, "225k", Some(7.4))),
        entry("11", "Digital Grooming", scenes::GROOMING, &[], Scene, (7905, "166k", Some(6.2))),
    ]
};

/// Runs every scene of Table 1. A scene whose groom is a file that is not there is skipped, and
/// says so.
///
/// # Errors
/// [`BenchError`] if a scene cannot be simulated.
pub fn table1(options: &Table1Options, observer: &mut Observer<'_>) -> Result<Table1, BenchError> {
    // Before minutes of work, not after them.
    let gpu = if options.on_gpu { Some(Gpu::open(&Choice::Fastest)?) } else { None };
    let mut rows = Vec::new();
    for entry in &ENTRIES {
        rows.push(entry.row(options, observer)?);
    }
    Ok(Table1 {
        device: gpu.as_ref().map_or_else(device_name, |gpu| gpu.name().to_owned()),
        threads: if gpu.is_some() { 0 } else { rayon::current_num_threads() },
        paper_device: PAPER_DEVICE,
        warm_up: options.warm_up,
        frames: options.frames,
        rows,
    })
}

/// `result`, or why the scene is skipped: it needs a file that is not there, or what this GPU does
/// not have.
pub(super) fn or_skipped<T>(result: Result<T, BenchError>) -> Result<Result<T, String>, BenchError> {
    let unavailable =
        |error: &GpuError| matches!(error, GpuError::Unsupported { .. } | GpuError::TooLarge { .. });
    match result {
        Ok(found) => Ok(Ok(found)),
        Err(BenchError::Asset(AssetError::Read(error))) => Ok(Err(error.to_string())),
        Err(BenchError::Gpu(error) | BenchError::Player(PlayerError::Gpu(error))) if unavailable(&error) => {
            Ok(Err(error.to_string()))
        }
        Err(error) => Err(error),
    }
}

impl Entry {
    fn row(&self, options: &Table1Options, observer: &mut Observer<'_>) -> Result<Table1Row, BenchError> {
        let scene = self.builtin.scene(options.share, self.keys)?;
        let (paper_strands, paper_particles, paper_ms) = self.paper;
        let mut row = Table1Row {
            figure: self.figure,
            name: self.name,
            scene: self.builtin.name,
            paper_strands,
            paper_particles,
            paper_ms,
            solver: scene.solver.kind.name().to_owned(),
            substeps: scene.substeps(),
            grid: scene.interaction.kind == InteractionKind::Grid,
            ..Table1Row::default()
        };
        // What growth and edits have to say is no news here.
        let mut quiet = |progress: &Progress<'_>| {
            if !matches!(progress, Progress::Note(_)) {
                observer(progress);
            }
        };
        let assets = match or_skipped(self.strands.load(&scene, &mut quiet))? {
            Ok(assets) => assets,
            Err(why) => return Ok(Table1Row { skipped: Some(why), ..row }),
        };
        (row.strands, row.particles) = (assets.groom.strand_count(), assets.groom.particle_count());
        let timed = match or_skipped(time(&scene, &assets, options, self.name, &mut quiet))? {
            Ok(timed) => timed,
            Err(why) => return Ok(Table1Row { skipped: Some(why), ..row }),
        };
        row.ms_per_frame = Spread::of(&timed.iter().map(|frame| frame.ms).collect::<Vec<_>>());
        row.ms_least = timed.iter().map(|frame| frame.ms).fold(f64::INFINITY, f64::min);
        row.ms_per_stage = median_stages(&timed);
        Ok(row)
    }
}

impl Strands {
    fn load(self, scene: &Scene, observer: &mut Observer<'_>) -> Result<Arc<Assets>, BenchError> {
        match self {
            Self::Scene => Ok(Arc::new(Assets::load(scene, observer)?)),
            Self::Helix => scenes::alone(scene, scenes::HELIX),
            Self::Wisp => {
                let mut groom = scenes::wisp(scene)?;
                let factor = 480.0 / groom.strand_count() as f32;
                for operation in [
                    Operation::Density(Density { factor, ..Density::default() }),
                    Operation::Resample(Resample { particles: 29 }),
                ] {
                    let operation_name = operation.name();
                    Edit::all(operation).apply(&mut groom, None).map_err(|error| AssetError::Edit {
                        number: 1,
                        operation: operation_name,
                        error,
                    })?;
                }
                Ok(Arc::new(Assets::around(scene, groom)?))
            }
        }
    }
}

/// The timed frames of `scene`.
pub(super) fn time(
    scene: &Scene,
    assets: &Arc<Assets>,
    options: &Table1Options,
    what: &'static str,
    observer: &mut Observer<'_>,
) -> Result<Vec<FrameRow>, BenchError> {
    let backend = if options.on_gpu { Backend::Gpu } else { Backend::Cpu };
    let player = Player::builder(scene.clone()).assets(assets.clone()).backend(backend);
    let mut player = player.without_history().build()?;
    let frames = options.warm_up + options.frames;
    observer(&Progress::Begin { what, done: 0, total: frames.into() });
    let mut rows = Vec::with_capacity(options.frames as usize);
    for frame in 0..frames {
        let started = std::time::Instant::now();
        let report = player.step()?;
        let mut ms = started.elapsed().as_secs_f64() * 1e3;
        // On a GPU the wall clock would count the read-back too, which a frame does not need.
        if let Some(secs) = report.solver.device_secs {
            ms = secs * 1e3;
        }
        if frame >= options.warm_up {
            let ran = report.solver.stages.iter().filter(|(_, secs)| *secs > 0.0);
            let stages = ran.map(|(stage, secs)| (stage.into(), secs * 1e3)).collect();
            rows.push(FrameRow { ms, stages, ..FrameRow::default() });
        }
        observer(&Progress::Step);
    }
    observer(&Progress::End);
    Ok(rows)
}

impl Table1 {
    /// The paper's table beside ours, and where the time goes.
    pub fn study(&self) -> Study {
        let paper = format!("paper, ms ({})", self.paper_device);
        let (ours, clock) = match self.threads {
            0 => (
                format!("ours, ms ({})", self.device),
                "by the device's clock from the first stage's start to the last one's end (where it has none, on the wall's, with the state brought back)",
            ),
            threads => (format!("ours, ms ({}, {threads} threads)", self.device), "on the wall's clock"),
        };
        let columns = [
            "Fig.",
            "scene",
            "paper: strands, particles",
            &paper,
            "strands × particles",
            &ours,
            "least",
            "95 %",
        ];
        let mut table = Table::new("", &columns);
        let mut stages = Table::new(
            if self.threads == 0 {
                "Stages, median, ms a frame"
            } else {
                "Work a stage, median, ms a frame summed over threads"
            },
            &["scene", "strands", "solids", "lengths", "splat", "pressure", "gather", "checks", "other"],
        );
        let mut bars = Vec::new();
        for row in &self.rows {
            let mut known = thousands(row.paper_strands);
            if !row.paper_particles.is_empty() {
                known = format!("{known}, {}", row.paper_particles);
            }
            let paper_ms = row.paper_ms.map_or_else(|| "–".to_owned(), |ms| ms.to_string());
            let mut cells = vec![row.figure.to_owned(), row.name.to_owned(), known, paper_ms];
            if let Some(why) = &row.skipped {
                cells.extend([format!("skipped: {why}"), "–".into(), "–".into(), "–".into()]);
                table.rows.push(cells);
                continue;
            }
            let per_strand = row.particles as f64 / row.strands.max(1) as f64;
            cells.push(format!("{} × {per_strand:.0}", thousands(row.strands)));
            cells.extend(
                [row.ms_per_frame.median, row.ms_least, row.ms_per_frame.p95].map(|ms| format!("{ms:.2}")),
            );
            table.rows.push(cells);
            let parts = parts(row);
            stages.rows.push(
                std::iter::once(row.name.to_owned())
                    .chain(parts.iter().map(|ms| format!("{ms:.2}")))
                    .collect(),
            );
            bars.push(Bar { name: row.name.to_owned(), parts: parts.to_vec() });
        }
        let names = stages.columns[1..].to_vec();
        let bars = Bars { title: "Work a stage, ms a frame".to_owned(), names, bars };
        Study {
            title: "AMS, Table 1".to_owned(),
            claim: String::new(),
            notes: vec![
                format!("Ours: the median of {} frames after {} to warm up, {clock}; {} substeps a frame.", self.frames, self.warm_up, substeps(&self.rows)),
                "The paper gives counts, not strands and motions; ours are made to its counts. The 1,024 strands of Fig. 6 and their time are from its text.".to_owned(),
            ],
            tables: vec![table, stages],
            plots: Vec::new(),
            bars: Some(bars),
            strips: Vec::new(),
        }
    }
}

/// The substeps that `rows` have, in order.
fn substeps(rows: &[Table1Row]) -> String {
    let mut all: Vec<u32> = rows.iter().map(|row| row.substeps).collect();
    all.sort_unstable();
    all.dedup();
    all.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")
}

/// Stages in the order of the table's columns; the last takes all that have none.
const STAGES: [&str; 7] = [
    "solve_strands",
    "resolve_solids",
    "restore_lengths",
    "splat_segments",
    "solve_pressure",
    "gather_velocities",
    "check_strands",
];

fn parts(row: &Table1Row) -> [f64; 8] {
    let mut parts = [0.0; 8];
    for (stage, ms) in &row.ms_per_stage {
        parts[STAGES.iter().position(|known| known == stage).unwrap_or(7)] += ms;
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every scene at a few strands: the counts of the table are the scenes'.
    #[test]
    fn every_scene_runs_and_has_its_counts() {
        for entry in &ENTRIES {
            let scene = entry.builtin.scene(1.0, entry.keys).unwrap();
            if entry.strands == Strands::Scene && entry.builtin.name != "grooming" {
                assert_eq!(scene.groom.strands as usize, entry.paper.0, "{}", entry.name);
            }
        }
        let options = Table1Options { warm_up: 0, frames: 2, share: 0.002, on_gpu: false };
        let table = table1(&options, &mut |_| {}).unwrap();
        for row in table.rows.iter().filter(|row| row.skipped.is_none()) {
            assert!(row.ms_per_frame.median > 0.0 && row.ms_per_stage["solve_strands"] > 0.0, "{row:?}");
            assert_eq!(row.ms_per_stage.contains_key("splat_segments"), row.grid, "{row:?}");
        }
        let skipped: Vec<_> = table.rows.iter().filter_map(|row| row.skipped.as_ref()).collect();
        assert!(skipped.iter().all(|why| why.contains("data")), "{skipped:?}");
        let wisp = &table.rows[1];
        assert_eq!((wisp.strands, wisp.particles), (480, 480 * 29));
        let markdown = table.study().to_markdown();
        assert!(markdown.contains("| 7 | Hand Interaction | 15,000, 450k | 15.2 |"), "{markdown}");
    }
}
