//! Table 1 and the times in the paper's text.

use std::time::Instant;

use forelock::html::thousands;
use forelock::summary::{FrameRow, Spread, device_name};
use forelock::{Observer, Progress};
use forelock_core::lane::Simd;
use forelock_neural::features::{POSE_NUMBERS, SHAPE_NUMBERS};
use forelock_neural::network::inference::Predictor;
use forelock_neural::network::rotation::basis;
use forelock_neural::network::{Network, STATICS, Shape};
use forelock_neural::random::Random;
use forelock_neural::{EDGES, PARTICLES};

use super::NeuralOptions;
use super::map::{map_ms, map_size, megabytes};
use super::models::{demo, runs_builtin, xpbd_with_contacts};
use super::rigged::Rigged;
use crate::BenchError;
use crate::paper::study::{Study, Table};
use crate::paper::table1::{Table1Options, time};

/// The paper's machine.
const PAPER_DEVICE: &str = "NVIDIA GeForce RTX 4080 Laptop";
/// Strands of Table 1 and the paper's milliseconds.
const SIZES: [(f64, &str); 4] =
    [(3_000.0, "0.189"), (10_000.0, "–"), (50_000.0, "2.99"), (120_000.0, "6.872")];
/// Steps of a rig's training that is only timed.
const RIG_STEPS: u32 = 200;

/// Milliseconds of a frame, and of its stage `predict_strands` by the wall's clock.
fn medians(frames: &[FrameRow]) -> [f64; 2] {
    let stage = |frame: &FrameRow| {
        let own = frame.stages.iter().find(|(name, _)| name == "predict_strands");
        own.map_or(0.0, |(_, ms)| *ms)
    };
    let median =
        |of: &dyn Fn(&FrameRow) -> f64| Spread::of(&frames.iter().map(of).collect::<Vec<_>>()).median;
    [median(&|frame| frame.ms), median(&stage)]
}

/// Milliseconds of the network alone for `count` strands, `shape` having random weights.
pub(super) fn network_ms(shape: Shape, count: usize, timed: &Table1Options) -> Result<f64, BenchError> {
    let mut random = Random::new(1);
    let mut numbers =
        |count: usize| -> Vec<f32> { (0..count).map(|_| 0.1 * random.signed() as f32).collect() };
    let network = Network::new(shape, numbers(shape.parameters()))?;
    let predictor = Predictor::new(&network, &basis(100.0, 1e-4, 1.0 / 30.0), Simd::Auto)?;
    let strand = std::array::from_fn(|i| [0.0, 0.5 * i as f32, 0.0]);
    let prepared = predictor.prepare(&vec![strand; count], &numbers(count * STATICS))?;
    let (shared, mut out) = (numbers(shape.shared), vec![[[0.0; 3]; PARTICLES]; count]);
    let mut pass = || {
        let began = Instant::now();
        predictor.predict(&prepared, &shared, &mut out);
        1e3 * began.elapsed().as_secs_f64()
    };
    for _ in 0..timed.warm_up {
        pass();
    }
    Ok(Spread::of(&(0..timed.frames).map(|_| pass()).collect::<Vec<_>>()).median)
}

/// Times in milliseconds.
struct Times {
    table: Table,
    /// XPBD and the network, strands of the smallest size.
    xpbd: f64,
    network: f64,
}

/// Table 1.
fn table1(options: &NeuralOptions, observer: &mut Observer<'_>) -> Result<Times, BenchError> {
    let columns = ["method", "strands", "paper, ms: CPU, GPU", "frame, ms", "of that the network, ms"];
    let mut table = Table::new("Table 1", &columns);
    let timed = &options.scenes;
    let (scene, assets) = demo("straight", SIZES[0].0 * timed.share, &xpbd_with_contacts(), observer)?;
    let on_cpu = Table1Options { on_gpu: false, ..*timed };
    let [xpbd, _] = medians(&time(&scene, &assets, &on_cpu, "XPBD", observer)?);
    table.rows.push(vec![
        "XPBD, collisions, contacts".to_owned(),
        thousands(assets.groom.strand_count()),
        "7,200, 140".to_owned(),
        format!("{xpbd:.2}"),
        "–".to_owned(),
    ]);
    let mut first = None;
    let halves: &[bool] = if timed.on_gpu { &[false, true] } else { &[false] };
    for ((strands, paper), half) in SIZES.iter().flat_map(|size| halves.iter().map(move |half| (size, half)))
    {
        let keys = [runs_builtin(), vec![format!("solver.neural.half={half}")]].concat();
        let (scene, assets) = demo("straight", strands * timed.share, &keys, observer)?;
        let strands = assets.groom.strand_count();
        let found = time(&scene, &assets, timed, "the network", observer)?;
        // Stages of the CPU count all threads.
        let threads = if timed.on_gpu { 1 } else { rayon::current_num_threads() };
        let [frame, network] = medians(&found);
        let network = network / threads as f64;
        first.get_or_insert(network);
        table.rows.push(vec![
            if *half { "the network in 16 bits" } else { "the network" }.to_owned(),
            thousands(strands),
            format!("–, {paper}"),
            format!("{frame:.2}"),
            format!("{network:.2}"),
        ]);
    }
    Ok(Times { table, xpbd, network: first.unwrap_or_default() })
}

/// Times in the paper's text.
fn section4(
    options: &NeuralOptions,
    first: &Times,
    observer: &mut Observer<'_>,
) -> Result<Table, BenchError> {
    let count = (SIZES[0].0 * options.scenes.share).round().max(1.0) as usize;
    observer(&Progress::Begin { what: "networks alone", done: 0, total: 4 });
    let mut step = || observer(&Progress::Step);
    let moving = network_ms(Shape::default(), count, &options.scenes)?;
    step();
    let still = Shape { shared: POSE_NUMBERS + SHAPE_NUMBERS, ..Shape::default() };
    let still = network_ms(still, count, &options.scenes)?;
    step();
    let rig = Rigged::train(RIG_STEPS)?.micros;
    step();
    let map = map_ms(&options.scenes)?;
    step();
    observer(&Progress::End);
    let mut table = Table::new("Sec. 4", &["what", "paper", "ours, on the CPU"]);
    let mut row = |what: &str, paper: &str, ours: String| {
        table.rows.push(vec![what.to_owned(), paper.to_owned(), ours]);
    };
    let strands = thousands(count);
    row(&format!("dynamic network alone, {strands} strands"), "0.189 ms", format!("{moving:.2} ms"));
    row(&format!("static network alone, {strands} strands"), "0.105 ms", format!("{still:.2} ms"));
    row("rigged variant, one thread", "0.3 µs", format!("{rig:.3} µs"));
    let ratio = first.xpbd / first.network.max(f64::MIN_POSITIVE);
    row("XPBD over the network", "740", format!("{ratio:.0}"));
    let bytes = 4 * (Shape::default().parameters() + EDGES * EDGES);
    row("simulator's part of a model", "about 1 MB", megabytes(bytes));
    row(
        &format!("GroomGen-like: the static network, {strands} strands"),
        "5.364 ms",
        format!("{still:.2} ms"),
    );
    row("Quaffure-like: one map of 4,096 strands", "3.89 ms", format!("{map:.2} ms"));
    row("Quaffure-like: size", "692 MB", map_size());
    Ok(table)
}

/// Table 1 and the times of the paper's Sec. 4 beside ours.
///
/// # Errors
/// [`BenchError`] if a scene cannot be simulated.
pub fn neural_tables(options: &NeuralOptions, observer: &mut Observer<'_>) -> Result<Study, BenchError> {
    let first = table1(options, observer)?;
    let second = section4(options, &first, observer)?;
    Ok(Study {
        title: "Neuralocks, Table 1 and Sec. 4".to_owned(),
        claim: String::new(),
        notes: vec![
            format!(
                "Ours: medians of {} frames on {}, {} threads{}. The paper's: {PAPER_DEVICE}, as printed.",
                options.scenes.frames,
                device_name(),
                rayon::current_num_threads(),
                if options.scenes.on_gpu {
                    "; the learned simulator on a GPU, by the device's clock"
                } else {
                    ""
                },
            ),
            "Straight hair of 25 particles on a head that turns. XPBD collides with the head and with \
             itself. \"Network\" is the prediction alone; a frame also moves roots, checks strands and \
             keeps velocities."
                .to_owned(),
            "GroomGen-like and Quaffure-like are built after descriptions, for neither code is public, and \
             the map is as small as its description allows: the printed times and sizes of both are \
             quoted, not rerun (Figs. 5 and 12)."
                .to_owned(),
        ],
        tables: vec![first.table, second],
        ..Study::default()
    })
}
