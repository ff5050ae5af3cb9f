//! The follow-the-leader paper (Sánchez-Banderas et al. 2015): its Table 1, Table 2 and Fig. 2.
//!
//! # Practice
//! [`dftl_tables`] runs the five scenes of Table 1, each with lengths alone, with shape and with
//! hair against hair, and the five sizes of Table 2 under each schedule that the device knows.
//! [`volume`] is Fig. 2, measured: the same hair under all four.
//!
//! # Limitations
//! The paper gives frames a second with rendering, and of the scenes it gives counts only. Ours are
//! of the simulation alone.

use std::ops::Range;
use std::time::Instant;

use forelock_core::frame::{FrameInput, Roots};
use forelock_core::groom::Groom;
use forelock_core::pose::Pose;
use forelock_core::simulation::{Options, Simulation};
use forelock_core::solver::DftlParams;
use forelock_core::solver::dftl::{STATED_STEP_SECS, Schedule};
use forelock_gpu::{Choice, Gpu, GpuSimulation};
use glam::{DQuat, DVec3, Vec3};
use serde::Serialize;

use crate::BenchError;
use forelock::AssetError;
use forelock::html::thousands;
use forelock::labelled;
use forelock::summary::{FrameRow, Spread, device_name};
use forelock::{Observer, Progress};

use super::followed::{Case, Followed, Shots, plot};
use super::scenes::{self, AS_IT_IS, Builtin};
use super::study::{Strip, Study, Table, percent};
use super::table1::{Table1Options, or_skipped, time};

/// The paper's machine.
const PAPER_DEVICE: &str = "NVIDIA GeForce GTX 650";

/// A scene of the paper.
pub(super) struct Entry {
    /// The paper's name.
    pub name: &'static str,
    pub builtin: Builtin,
    /// The paper's strands, vertices and colliders.
    counts: [usize; 3],
    /// The paper's frames a second with each of [`METHODS`].
    fps: [f64; 3],
}

/// The scenes of Table 1.
#[rustfmt::skip]
pub(super) const SCENES: [Entry; 5] = [
    Entry { name: "Mannequin A", builtin: scenes::MANNEQUIN_A, counts: [15_000, 349_232, 15], fps: [130.3, 124.0, 21.5] },
    Entry { name: "Mannequin B", builtin: scenes::MANNEQUIN_B, counts: [500, 8000, 15], fps: [174.2, 172.6, 147.4] },
    Entry { name: "Horse Louis", builtin: scenes::HORSE, counts: [3358, 32_041, 18], fps: [115.0, 108.5, 83.2] },
    Entry { name: "Bunny", builtin: scenes::BUNNY, counts: [2902, 34_824, 1], fps: [169.2, 164.0, 126.1] },
    Entry { name: "Hectroll", builtin: scenes::DOLL, counts: [496, 5710, 1], fps: [315.0, 305.3, 270.1] },
];

/// Lengths alone, with shape, and with hair against hair, as keys of a scene that has all.
const METHODS: [(&str, &[&str]); 3] = [
    ("DFTL", &["solver.dftl.shape_global=0", "solver.dftl.shape_local=0", "interaction.kind=\"none\""]),
    ("+ shape", &["interaction.kind=\"none\""]),
    ("+ hair–hair", &[]),
];

/// Strands and particles per strand of Table 2, and the paper's frames a second with strand-level
/// and particle-level parallelism. (The paper prints 8,190 vertices for the first.)
const SIZES: [([usize; 2], [f64; 2]); 5] = [
    ([1024, 8], [330.0, 570.0]),
    ([1024, 32], [250.0, 520.0]),
    ([4096, 32], [84.8, 370.0]),
    ([4096, 64], [40.1, 223.0]),
    ([16_384, 64], [10.0, 74.0]),
];

/// The schedules, as Table 2 has them.
const SCHEDULES: [(&str, Schedule); 3] =
    [("strands", Schedule::Strands), ("particles", Schedule::Particles), ("fused", Schedule::Fused)];

/// Both tables, and what they were made on.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DftlTables {
    /// Name of the processor.
    pub device: String,
    /// Threads; 0 on a GPU.
    pub threads: usize,
    /// The paper's machine.
    pub paper_device: &'static str,
    /// Frames timed.
    pub frames: u32,
    /// Share of the strands that were simulated.
    pub share: f64,
    /// Table 1.
    pub scenes: Vec<SceneRow>,
    /// Table 2.
    pub sizes: Vec<SizeRow>,
}

/// A row of Table 1.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SceneRow {
    /// The paper's name.
    pub name: &'static str,
    /// The paper's strands, vertices and colliders.
    pub paper_counts: [usize; 3],
    /// The paper's frames a second with each method.
    pub paper_fps: [f64; 3],
    /// Strands and particles simulated.
    pub counts: [usize; 2],
    /// Milliseconds a frame with each method, median, or why there are none.
    pub ms: Vec<Result<f64, String>>,
}

/// A row of Table 2.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SizeRow {
    /// Strands, and particles of each.
    pub counts: [usize; 2],
    /// The paper's frames a second, strand-level and particle-level.
    pub paper_fps: [f64; 2],
    /// Name of each schedule, or of the processor's lanes, and milliseconds a step.
    pub ms: Vec<(&'static str, f64)>,
}

/// Runs both tables.
///
/// # Errors
/// [`BenchError`] if a scene cannot be simulated; a row says if its scene needs a missing file, or
/// a feature that the GPU lacks.
pub fn dftl_tables(options: &Table1Options, observer: &mut Observer<'_>) -> Result<DftlTables, BenchError> {
    let gpu = if options.on_gpu { Some(Gpu::open(&Choice::Fastest)?) } else { None };
    let scenes = SCENES.iter().map(|scene| scene_row(scene, options, observer)).collect::<Result<_, _>>()?;
    observer(&Progress::Begin { what: "Table 2", done: 0, total: SIZES.len() as u64 });
    let mut sizes = Vec::new();
    for (counts, paper_fps) in SIZES {
        sizes.push(SizeRow { counts, paper_fps, ms: size_row(counts, gpu.as_ref(), options)? });
        observer(&Progress::Step);
    }
    observer(&Progress::End);
    Ok(DftlTables {
        device: gpu.as_ref().map_or_else(device_name, |gpu| gpu.name().to_owned()),
        threads: if gpu.is_some() { 0 } else { rayon::current_num_threads() },
        paper_device: PAPER_DEVICE,
        frames: options.frames,
        share: options.share,
        scenes,
        sizes,
    })
}

fn scene_row(
    entry: &Entry,
    options: &Table1Options,
    observer: &mut Observer<'_>,
) -> Result<SceneRow, BenchError> {
    let &Entry { name, builtin, counts: paper_counts, fps: paper_fps } = entry;
    let mut row = SceneRow { name, paper_counts, paper_fps, counts: [0; 2], ms: Vec::new() };
    let (_, assets) = match or_skipped(builtin.load(options.share, AS_IT_IS, &mut |_| {}))? {
        Ok(loaded) => loaded,
        Err(why) => {
            row.ms = vec![Err(why); METHODS.len()];
            return Ok(row);
        }
    };
    row.counts = [assets.groom.strand_count(), assets.groom.particle_count()];
    for (_, keys) in METHODS {
        let scene = builtin.scene(options.share, keys)?;
        let timed = or_skipped(time(&scene, &assets, options, name, observer))?;
        let median =
            |timed: Vec<FrameRow>| Spread::of(&timed.iter().map(|frame| frame.ms).collect::<Vec<_>>()).median;
        row.ms.push(timed.map(median));
    }
    Ok(row)
}

/// Milliseconds a step of strands without solids, under each schedule or on this processor.
fn size_row(
    [strands, particles]: [usize; 2],
    gpu: Option<&Gpu>,
    options: &Table1Options,
) -> Result<Vec<(&'static str, f64)>, BenchError> {
    let groom = curls(((strands as f64 * options.share).ceil() as usize).max(1), particles)?;
    let params = DftlParams { drag: 0.0, ..DftlParams::default() };
    let at_rest = Options { rest_gravity: DVec3::new(0.0, -9.81, 0.0), ..Options::default() };
    let head = |step: u32| Pose::new(DQuat::from_rotation_y(0.02 * f64::from(step)), DVec3::ZERO);
    let frame = |step: u32| FrameInput {
        roots: Roots::Rigid([head(step), head(step + 1)]),
        gravity: at_rest.rest_gravity,
        dt_secs: STATED_STEP_SECS,
        ..FrameInput::default()
    };
    let mut runs: Vec<(&'static str, Run<'_>)> = Vec::new();
    if let Some(gpu) = gpu {
        for (name, schedule) in SCHEDULES {
            let params = DftlParams { schedule, ..params.clone() };
            let mut simulation = GpuSimulation::new(gpu, &groom, &params, &at_rest)?;
            let run = move |mut steps: Range<u32>| {
                steps.try_for_each(|step| simulation.step_frame(&frame(step)))?;
                Ok(gpu.wait()?)
            };
            runs.push((name, Box::new(run)));
        }
    } else {
        let mut simulation = Simulation::new(&groom, &params, &at_rest)?;
        let run = move |mut steps: Range<u32>| {
            Ok(steps.try_for_each(|step| simulation.step_frame(&frame(step)).map(drop))?)
        };
        runs.push(("lanes", Box::new(run)));
    }
    let mut found: Vec<_> = runs.iter().map(|(name, _)| (*name, f64::INFINITY)).collect();
    runs.iter_mut().try_for_each(|(_, run)| run(0..options.warm_up))?;
    // In turn, and the least counts: what else the machine does is as bad for all.
    let each = options.frames.div_ceil(ROUNDS);
    for round in 0..ROUNDS {
        let from = options.warm_up + round * each;
        for ((_, run), (_, least)) in runs.iter_mut().zip(&mut found) {
            let started = Instant::now();
            run(from..from + each)?;
            *least = least.min(started.elapsed().as_secs_f64() * 1e3 / f64::from(each));
        }
    }
    Ok(found)
}

/// What goes through some steps, and waits for them.
type Run<'a> = Box<dyn FnMut(Range<u32>) -> Result<(), BenchError> + 'a>;

/// Turns that the schedules take in Table 2.
const ROUNDS: u32 = 5;

/// Curls of 25 cm in a square.
fn curls(strands: usize, particles: usize) -> Result<Groom, BenchError> {
    let side = (strands as f64).sqrt().ceil() as usize;
    let strand = |s: usize| {
        let at = move |i: usize| {
            let t = i as f32 / (particles - 1) as f32;
            let root = Vec3::new((s % side) as f32, 0.0, (s / side) as f32) * 0.001;
            root + Vec3::new(0.01 * (12.0 * t).cos(), -0.25 * t, 0.01 * (12.0 * t).sin())
        };
        (0..particles).map(at).collect::<Vec<_>>()
    };
    Ok(Groom::from_strands((0..strands).map(strand)).map_err(AssetError::from)?)
}

impl DftlTables {
    /// The paper's tables beside ours.
    pub fn study(&self) -> Study {
        let ours = if self.threads == 0 {
            format!("ours ({})", self.device)
        } else {
            format!("ours ({}, {} threads)", self.device, self.threads)
        };
        let fps = |ms: f64| format!("{:.1}", 1e3 / ms);
        let mut columns = vec![
            "scene".to_owned(),
            "strands, vertices, colliders".to_owned(),
            "ours: strands, particles".to_owned(),
        ];
        columns.extend(METHODS.iter().map(|(method, _)| format!("{method}: paper")));
        columns.extend(METHODS.iter().map(|(method, _)| format!("{method}: ours")));
        let mut scenes = Table {
            title: format!("Table 1, frames a second: paper ({}), {ours}", self.paper_device),
            columns,
            rows: Vec::new(),
        };
        for row in &self.scenes {
            let counts = row.paper_counts.map(thousands).join(", ");
            let mut cells = vec![row.name.to_owned(), counts, row.counts.map(thousands).join(", ")];
            cells.extend(row.paper_fps.iter().map(|fps| format!("{fps:.1}")));
            cells.extend(row.ms.iter().map(|ms| match ms {
                Ok(ms) => fps(*ms),
                Err(why) => format!("skipped: {why}"),
            }));
            scenes.rows.push(cells);
        }
        let names: Vec<&str> =
            self.sizes.first().map_or_else(Vec::new, |row| row.ms.iter().map(|(name, _)| *name).collect());
        let mut columns = vec![
            "strands".to_owned(),
            "particles".into(),
            "paper: strands".into(),
            "particles".into(),
            "speed-up".into(),
        ];
        columns.extend(names.iter().map(|name| format!("ours: {name}")));
        let on_gpu = names.len() == SCHEDULES.len();
        if on_gpu {
            columns.extend(["particles over strands".to_owned(), "fused over the better".to_owned()]);
        }
        let mut sizes = Table {
            title: format!("Table 2, steps a second: paper ({}), {ours}", self.paper_device),
            columns,
            rows: Vec::new(),
        };
        for row in &self.sizes {
            let [strands, particles] = row.counts;
            let [slow, fast] = row.paper_fps;
            let mut cells = vec![
                thousands(strands),
                thousands(strands * particles),
                format!("{slow}"),
                format!("{fast}"),
                format!("{:.2}", fast / slow),
            ];
            cells.extend(row.ms.iter().map(|(_, ms)| fps(*ms)));
            if let [(_, strands), (_, particles), (_, fused)] = row.ms[..] {
                cells.extend(
                    [strands / particles, strands.min(particles) / fused].map(|ratio| format!("{ratio:.2}")),
                );
            }
            sizes.rows.push(cells);
        }
        Study {
            title: "DFTL with shape and SPH, Tables 1 and 2".to_owned(),
            claim: "shape costs little over DFTL alone, hair against hair is the bottleneck; particle-level parallelism is 2 to 7 times as fast as strand-level.".to_owned(),
            notes: vec![
                format!("Ours: the median of {} frames of the simulation alone at 60 frames a second (Table 1, the solver steps at its own 16 ms), and steps of 16 ms without solids, the best of {ROUNDS} turns (Table 2).", self.frames),
                "The paper's frames a second are with rendering, of scenes of which it gives the counts; ours are made to its counts.".to_owned(),
                format!("Share of the strands that were simulated: {}.", percent(self.share)),
                "On a CPU strands are lanes of registers, whatever the schedule.".to_owned(),
            ],
            tables: vec![scenes, sizes],
            ..Study::default()
        }
    }
}

/// The four cases of Fig. 2, as keys.
const CASES: [(&str, &[&str]); 4] = [
    ("DFTL ALONE", METHODS[0].1),
    ("WITH HAIR-HAIR", &["solver.dftl.shape_global=0", "solver.dftl.shape_local=0"]),
    ("WITH SHAPE", METHODS[1].1),
    ("WITH BOTH", &[]),
];

/// What Fig. 2 shows of: waves that would be lost, over all of the head.
const FIGURE2: [&str; 6] = [
    "groom.preset=\"wavy\"",
    "groom.strands=3000",
    "solver.dftl.tip_scale_global=1",
    "solver.dftl.tip_scale_local=1",
    "interaction.sph.pressure=0.4",
    "time.frames=150",
];

/// Fig. 2: DFTL alone, with hair against hair, with shape, with both; volume and distance from the
/// shape over time.
///
/// # Errors
/// [`BenchError`] if it cannot be simulated.
pub fn volume(share: f64, observer: &mut Observer<'_>) -> Result<Study, BenchError> {
    let (base, assets) = scenes::MANNEQUIN_B.load(share, &FIGURE2, &mut |_| {})?;
    let mut followed = Vec::new();
    for (label, keys) in CASES {
        let scene = scenes::MANNEQUIN_B.scene(share, &[&FIGURE2, keys].concat())?;
        let case = Case { label: label.to_owned(), scene };
        followed.push(Followed::run(
            &case,
            &assets,
            &Shots { moments: &[0.99, 0.5, 0.75], scale: 0.54 },
            observer,
        )?);
    }
    let mut table = Table::new(
        "The last quarter of the time",
        &["case", "volume, litres", "from the shape, over L", "largest edge error", "ms a frame"],
    );
    for one in &followed {
        table.rows.push(vec![
            one.label.to_lowercase(),
            format!("{:.2}", Followed::late(&one.volume)),
            percent(Followed::late(&one.shape)),
            format!("{:.1e}", one.stretch[1]),
            format!("{:.1}", one.ms),
        ]);
    }
    let fps = base.time.fps;
    let plots = vec![
        plot("volume", "volume of the cells of 1 cm that hold hair, litres".into(), &followed, fps, |one| {
            one.volume.clone()
        }),
        plot(
            "shape",
            "mean distance from the rest shape over the strand's length, %".into(),
            &followed,
            fps,
            |one| one.shape.iter().map(|share| 100.0 * share).collect(),
        ),
    ];
    let pictures: Vec<_> = (0..3)
        .flat_map(|moment| followed.iter().filter_map(move |one| one.pictures.get(moment).cloned()))
        .collect();
    Ok(Study {
        title: "DFTL with shape and SPH, Fig. 2: what each part does".to_owned(),
        claim: "hair–hair interaction grants volume but does not preserve any kind of style; shape preservation can reproduce volume but results in stiff motion; both together are the most appealing.".to_owned(),
        notes: vec![format!(
            "{} strands of {} particles on the mannequin of Table 1; {} frames at {fps} a second; room is counted in the head's frame.",
            assets.groom.strand_count(),
            assets.groom.particle_count() / assets.groom.strand_count().max(1),
            base.time.frames
        )],
        tables: vec![table],
        plots,
        bars: None,
        strips: vec![Strip { name: "cases", title: "The four cases at half, three quarters and all of the time".to_owned(), image: labelled(&pictures, 4)? }],
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every scene at its counts, and all tables at a few strands.
    #[test]
    fn the_scenes_have_the_paper_s_counts() {
        for Entry { name, builtin, counts: [strands, vertices, colliders], .. } in SCENES {
            let scene = builtin.scene(1.0, AS_IT_IS).unwrap();
            let of_strands = scene.groom.strands * scene.groom.vertices_per_strand;
            let own = (scene.groom.strands as usize, (scene.groom.vertices.max(of_strands)) as usize);
            assert_eq!(own, (strands, vertices), "{name}");
            assert_eq!(scene.colliders.len() + usize::from(scene.body.collide), colliders, "{name}");
        }
        let options = Table1Options { warm_up: 1, frames: 2, share: 0.004, on_gpu: false };
        let tables = dftl_tables(&options, &mut |_| {}).unwrap();
        assert_eq!((tables.scenes.len(), tables.sizes.len()), (5, 5));
        for row in tables.scenes.iter().filter(|row| row.ms[0].is_ok()) {
            assert!(row.ms.iter().all(|ms| matches!(ms, Ok(ms) if *ms > 0.0)), "{row:?}");
        }
        let markdown = tables.study().to_markdown();
        assert!(
            markdown.contains("| Mannequin A | 15,000, 349,232, 15 | 60, 1,397 | 130.3 | 124.0 | 21.5 |"),
            "{markdown}"
        );
        assert!(markdown.contains("| 16,384 | 1,048,576 | 10 | 74 | 7.40 |"), "{markdown}");
    }

    /// The ordering of Fig. 2: particles give volume, shape keeps shape, both have both.
    fn each_part_does_its_part_at(share: f64) {
        let study = volume(share, &mut |_| {}).unwrap();
        let number = |cell: &String| cell.trim_end_matches(" %").parse::<f64>().unwrap();
        let rows: Vec<[f64; 2]> =
            study.tables[0].rows.iter().map(|row| [number(&row[1]), number(&row[2])]).collect();
        let [alone, hair, shape, both] = rows[..] else { panic!("{rows:?}") };
        assert!(hair[0] > 1.05 * alone[0] && both[0] > alone[0] && both[0] > shape[0], "volume: {rows:?}");
        assert!(shape[1] < 0.95 * alone[1] && both[1] < hair[1], "shape: {rows:?}");
        assert_eq!(study.strips.len(), 1);
    }

    #[test]
    fn each_part_does_its_part() {
        each_part_does_its_part_at(0.06);
    }

    #[test]
    #[ignore = "long: cargo xtask ci --nightly"]
    fn long_each_part_does_its_part() {
        each_part_does_its_part_at(0.2);
    }
}
