//! Fig. 12: a network that emits a whole groom at once, Quaffure-like, beside ours.

use std::collections::HashSet;
use std::time::Instant;

use forelock::summary::Spread;
use forelock::training::{Material, TrainingConfig, TrainingError};
use forelock::{Assets, Observer, Progress, Studio, html, labelled};
use forelock_core::groom::Groom;
use forelock_core::lane::Simd;
use forelock_neural::map::{MapNetwork, MapPredictor, MapStrands, MapTrainer, TEXELS, parameters};
use forelock_neural::network::inference::{Positions, Predictor};
use forelock_neural::network::rotation::basis;
use forelock_neural::network::{STATICS, Shape};
use forelock_neural::random::Random;
use forelock_neural::train::{Clip, Options, TrainingSet, TrainingStrand, shared};
use forelock_neural::trial::{Score, Trial};
use forelock_neural::{EDGES, PARTICLES};
use glam::Vec3;

use super::NeuralOptions;
use super::ablations::steps;
use super::models::{SCORES, Trained, Variant, config, demo, score_row, score_table};
use super::speed::network_ms;
use crate::BenchError;
use crate::paper::study::{Strip, Study, Table};
use crate::paper::table1::Table1Options;

/// Our network for the groom that the map is of.
const OURS: Variant = Variant {
    name: "straight",
    label: "ours, strand by strand",
    keys: &["hair.grooms=[\"straight\"]", "hair.grown=4096"],
};
const MAP: &str = "Quaffure-like, one map";
/// Texels from one measured strand to the next.
const MEASURED: usize = 64;
/// The motion of the pictures among those that are not trained, and its frames.
const SHOWN: [usize; 3] = [1, 40, 100];

/// Bytes of a network of the map with B of its head.
fn map_bytes() -> usize {
    4 * (parameters() + EDGES * EDGES)
}

/// Megabytes.
pub(super) fn megabytes(bytes: usize) -> String {
    format!("{:.3} MB", bytes as f64 / 1e6)
}

/// Megabytes of the map's network.
pub(super) fn map_size() -> String {
    megabytes(map_bytes())
}

/// Milliseconds of the map's network with random weights, all strands of the map.
pub(super) fn map_ms(timed: &Table1Options) -> Result<f64, BenchError> {
    let mut random = Random::new(1);
    let mut numbers =
        |count: usize| -> Vec<f32> { (0..count).map(|_| 0.1 * random.signed() as f32).collect() };
    let network =
        MapNetwork::new(numbers(parameters()), Options::default().head, &basis(100.0, 1e-4, 1.0 / 30.0))?;
    let rest = std::array::from_fn(|i| [0.0, 0.5 * i as f32, 0.0]);
    let strand = TrainingStrand { rest, statics: numbers(STATICS) };
    // One strand fills the map.
    let Some(strands) = MapStrands::new(&[strand]) else { return Ok(0.0) };
    let predictor = MapPredictor::new(&network, &strands, Simd::Auto);
    let shared = numbers(Shape::default().shared);
    let pass = || {
        let began = Instant::now();
        let found = predictor.predict(&shared);
        let ms = 1e3 * began.elapsed().as_secs_f64();
        found.map(|found| {
            std::hint::black_box(found);
            ms
        })
    };
    for _ in 0..timed.warm_up {
        pass()?;
    }
    let all: Vec<f64> = (0..timed.frames).map(|_| pass()).collect::<Result<_, _>>()?;
    Ok(Spread::of(&all).median)
}

/// What both networks are compared on.
struct Both {
    strands: MapStrands,
    /// A texel of each different strand, in the order of the map.
    texels: Vec<usize>,
    map: MapPredictor,
    ours: Predictor,
}

/// The learning rate of the map's network, which is trained by Adam.
const RATE: f64 = 1e-3;

/// Trains the map's network on what ours was trained with.
fn train(
    own: &TrainingConfig,
    material: &Material,
    observer: &mut Observer<'_>,
) -> Result<MapTrainer, BenchError> {
    let Material { strands, counts, field, motions, .. } = material;
    let set = TrainingSet::new(strands.clone(), counts, motions.clone(), field.clone());
    let set = set.map_err(TrainingError::from)?;
    let options = Options { rate: RATE, ..own.options() };
    let map = MapStrands::new(strands).ok_or(forelock_neural::train::SetError::NoStrands);
    let mut trainer = MapTrainer::new(options, map.map_err(TrainingError::from)?);
    observer(&Progress::Begin { what: "training the map", done: 0, total: options.steps.into() });
    for _ in 0..options.steps {
        trainer.step(&set).map_err(TrainingError::from)?;
        observer(&Progress::Step);
    }
    observer(&Progress::End);
    Ok(trainer)
}

impl Both {
    fn new(trainer: &MapTrainer, ours: &Trained) -> Result<Self, BenchError> {
        let strands = trainer.strands().clone();
        let mut seen = HashSet::new();
        let texels = (0..TEXELS).filter(|texel| seen.insert(strands.numbers()[*texel])).collect();
        let map = MapPredictor::new(trainer.average(), &strands, Simd::Auto);
        Ok(Self { strands, texels, map, ours: ours.model.predictor(Simd::Auto)? })
    }

    /// The strands of `texels` at rest, and their inputs.
    fn of(&self, texels: &[usize]) -> (Vec<Positions>, Vec<f32>) {
        let statics = |texel: &usize| self.strands.statics()[texel * STATICS..][..STATICS].to_vec();
        (texels.iter().map(|t| self.strands.rest()[*t]).collect(), texels.iter().flat_map(statics).collect())
    }

    /// The measures of ours and of the map beside the reference, in motions that were not trained.
    fn scores(
        &self,
        own: &TrainingConfig,
        material: &Material,
        observer: &mut Observer<'_>,
    ) -> Result<[Score; 2], BenchError> {
        let texels: Vec<usize> = self.texels.iter().step_by(MEASURED).copied().collect();
        let (rest, statics) = self.of(&texels);
        let strands: Vec<TrainingStrand> = rest
            .iter()
            .zip(statics.chunks_exact(STATICS))
            .map(|(rest, statics)| TrainingStrand { rest: *rest, statics: statics.to_vec() })
            .collect();
        let terms = own.options().energies.terms();
        let clips = material.unseen.clone();
        observer(&Progress::Begin { what: "references", done: 0, total: clips.len() as u64 });
        let mut step = || observer(&Progress::Step);
        let trial = Trial::new(&terms, material.field.clone(), &strands, &[strands.len()], clips, &mut step);
        observer(&Progress::End);
        let ours = trial.run(&self.ours).map_err(TrainingError::from)?;
        let mut failed = None;
        let map = trial.run_by(&mut |inputs, found| match self.map.predict(inputs) {
            Ok(all) => found.iter_mut().zip(&texels).for_each(|(to, texel)| *to = all[*texel]),
            Err(error) => failed = Some(error),
        });
        failed.map_or(Ok(()), Err)?;
        let map = map.map_err(TrainingError::from)?;
        Ok([Score::mean(&ours), Score::mean(&map)])
    }

    /// All different strands in two frames of a motion, ours and the map's, in the head's axes.
    fn show(
        &self,
        clip: &Clip,
        options: &NeuralOptions,
        observer: &mut Observer<'_>,
    ) -> Result<Strip, BenchError> {
        let (rest, statics) = self.of(&self.texels);
        let metres = |strand: &Positions| strand.map(|x| 0.01 * Vec3::from(x));
        let groom = Groom::from_strands(rest.iter().map(metres)).map_err(forelock::AssetError::from)?;
        let (scene, _) = demo("straight", 64.0 * options.scenes.share, &[], observer)?;
        let assets = Assets::around(&scene, groom)?;
        let studio = Studio::new(&scene, &assets);
        let prepared = self.ours.prepare(&rest, &statics)?;
        let mut pictures = Vec::new();
        let frames = SHOWN[1..].iter().map(|frame| (*frame).min(clip.len() - 1));
        let inputs: Vec<Vec<f32>> = frames.map(|frame| shared(clip, frame)).collect();
        for is_map in [false, true] {
            for (k, inputs) in inputs.iter().enumerate() {
                let mut found = vec![[[0.0; 3]; PARTICLES]; rest.len()];
                if is_map {
                    let all = self.map.predict(inputs)?;
                    found.iter_mut().zip(&self.texels).for_each(|(to, texel)| *to = all[*texel]);
                } else {
                    self.ours.predict(&prepared, inputs, &mut found);
                }
                let positions: Vec<Vec3> = found.iter().flat_map(metres).collect();
                let label = if is_map { MAP } else { OURS.label };
                let label = if k == 0 { label.to_uppercase() } else { String::new() };
                pictures.push((studio.picture(&positions, 0.0, 0.5)?, label));
            }
        }
        let title = "A motion that was not trained, on the head".to_owned();
        Ok(Strip { name: "map", title, image: labelled(&pictures, 4)? })
    }
}

/// Sizes and times.
fn costs(timed: &Table1Options) -> Result<Table, BenchError> {
    let columns = ["network", "size", "paper", "4,096 strands, ms", "paper, ms on a GPU"];
    let mut table = Table::new("", &columns);
    let shape = Shape::default();
    let ours = [network_ms(shape, TEXELS, timed)?, map_ms(timed)?].map(|ms| format!("{ms:.2}"));
    let sizes = [4 * (shape.parameters() + EDGES * EDGES), map_bytes()].map(megabytes);
    let papers = [["1 MB", "0.189 (3,000 strands)"], ["692 MB", "3.89"]];
    for (k, name) in [OURS.label, MAP].into_iter().enumerate() {
        let cells = [name, &sizes[k], papers[k][0], &ours[k], papers[k][1]];
        table.rows.push(cells.map(str::to_owned).into());
    }
    Ok(table)
}

/// Fig. 12.
pub(super) fn study(options: &NeuralOptions, observer: &mut Observer<'_>) -> Result<Study, BenchError> {
    let ours = OURS.train(options, observer)?;
    let own = config(options, OURS.keys)?;
    let material = Material::load(&own, &ours.model, observer)?;
    let trainer = train(&own, &material, observer)?;
    let both = Both::new(&trainer, &ours)?;
    let mut table = score_table("", "network");
    let scores = both.scores(&own, &material, observer)?;
    for (label, score) in [OURS.label, MAP].into_iter().zip(&scores) {
        table.rows.push(score_row(label, score));
    }
    let strip = match material.unseen.get(SHOWN[0]).or(material.unseen.first()) {
        Some(clip) => vec![both.show(clip, options, observer)?],
        None => Vec::new(),
    };
    Ok(Study {
        title: "Neuralocks, Fig. 12: beside a network for a whole groom (Quaffure-like)".to_owned(),
        claim: "both look alike, but Quaffure extended by the history takes 692 MB, 3.89 ms and at most \
                4,096 strands."
            .to_owned(),
        notes: vec![
            steps(options),
            format!(
                "The map of 64 × 64 texels holds {} different strands of a groom of {}, the one groom that \
                 both were trained with, by the same energies, history and motions. In each step the map \
                 learns from 64 random texels in 8 windows of frames, as many strands as ours.",
                html::thousands(both.texels.len()),
                html::thousands(material.strands.len())
            ),
            SCORES.replacen(
                "Strands and motions that were not trained",
                "Strands of the map, which were trained, in motions that were not",
                1,
            ),
            format!(
                "Neither code nor layers of Quaffure are public: ours are as small as its description \
                 allows, with {} numbers a two-hundredth of the printed size. They say what the layout \
                 costs at least, not what Quaffure costs.",
                html::thousands(parameters())
            ),
            "In our run of 3,000 steps the map followed the motion worse than ours, where the paper has both \
             alike: a step of it reaches 64 of 4,096 texels."
                .to_owned(),
            "Times are of the predictions alone on this machine's CPU; the printed ones are quoted, not \
             rerun."
                .to_owned(),
        ],
        tables: vec![table, costs(&options.scenes)?],
        strips: strip,
        ..Study::default()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_and_times_stand_beside_the_printed_ones() {
        let timed = Table1Options { warm_up: 0, frames: 2, share: 0.01, on_gpu: false };
        let table = costs(&timed).unwrap();
        let [ours, map] = &*table.rows else { panic!() };
        assert_eq!([&*ours[1], &*ours[2]], ["1.106 MB", "1 MB"]);
        assert_eq!([&*map[1], &*map[2], &*map[4]], ["3.391 MB", "692 MB", "3.89"]);
        assert!(ours[3].parse::<f64>().unwrap() > 0.0 && map[3].parse::<f64>().unwrap() > 0.0);
    }
}
