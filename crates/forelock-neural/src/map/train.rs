//! Training of the map's network with the energies alone.
//!
//! # Theory
//! A step draws windows of consecutive frames as that of the [strand network](crate::train) does,
//! and random texels of the map, whose strands count in each frame. It computes the pixels above
//! these texels alone: of each layer the gradient with respect to the weights is (inputs)ᵀ D, with
//! the gradient D of its sums, and that of its inputs, D Wᵀ, is what the pixels of the layer above
//! get for that child.
//!
//! # Practice
//! 64 texels in 8 windows of 4 frames: as many strands as in a step of the strand network. Sums
//! have their own order, so that the result does not depend on the number of threads.

use super::{DEPTH, LAYERS, Level, MapNetwork, MapStrands, Pass, TEXELS, Weights, apply, parameters, ranges};
use crate::PARTICLES;
use crate::network::product::{
    PACKET, PANELS, Start, by_strand, to_panels, transposed_by_tiles, zero_panels,
};
use crate::network::rotation::basis;
use crate::network::{OUTPUTS, SHARED};
use crate::random::Random;
use crate::train::adam::Adam;
use crate::train::gradient::{Aims, OfRow, unfold};
use crate::train::layers::{bias_gradient, mask, weight_gradient};
use crate::train::set::Drawn;
use crate::train::window::Goal;
use crate::train::{MOMENTS, NotFinite, Options, StepReport, TrainingSet, average, shared};
use forelock_core::lane::{LANES, Row, Simd};
use rayon::prelude::*;
use std::collections::BTreeSet;

/// Windows of a step.
const WINDOWS: usize = 8;
/// Frames of a step.
const FRAMES: usize = WINDOWS * MOMENTS;
/// Texels of a step: a packet.
const DRAWN: usize = PACKET;

/// A training of a map's network.
#[derive(Debug)]
pub struct MapTrainer {
    options: Options,
    strands: MapStrands,
    network: MapNetwork,
    average: MapNetwork,
    adam: Adam<f32>,
    done: u32,
}

/// What a step lowers the energy of.
struct Batch<'a> {
    set: &'a TrainingSet,
    windows: Vec<Drawn>,
    /// Ascending.
    texels: Vec<usize>,
}

impl MapTrainer {
    /// A training from random weights, with deviations √(2/inputs), those of the last layer 1e-3,
    /// for `strands`. Strands do not act on each other, whatever the energies, and lock codes are
    /// always among the inputs.
    ///
    /// # Panics
    /// If this processor does not support `options.simd`.
    pub fn new(mut options: Options, strands: MapStrands) -> Self {
        options.simd = options.simd.resolve();
        assert!(options.simd.is_supported(), "{:?} is not supported by this processor", options.simd);
        options.energies.repulsion = None;
        options.energies.adhesion = None;
        let mut random = Random::stream(options.seed, 0);
        let mut own = vec![0.0f32; parameters()];
        for (number, layer) in LAYERS.iter().enumerate() {
            let deviation = if number + 1 < DEPTH { (2.0 / layer.inputs as f64).sqrt() } else { 1e-3 };
            let [matrix, _] = ranges(number);
            own[matrix].iter_mut().for_each(|weight| *weight = (deviation * random.normal()) as f32);
        }
        let motion = options.energies.motion;
        let basis = basis(options.energies.elastic.bend_twist, motion.mass, motion.dt_secs);
        let network = MapNetwork { parameters: own, head: options.head, basis };
        Self { adam: Adam::new(parameters()), average: network.clone(), network, done: 0, strands, options }
    }

    /// The result: the running average of the network.
    pub fn average(&self) -> &MapNetwork {
        &self.average
    }

    /// The strands that it trains.
    pub fn strands(&self) -> &MapStrands {
        &self.strands
    }

    /// A step on motions of `set`.
    ///
    /// # Errors
    /// If the energy or its gradient is not finite: nothing is changed then.
    pub fn step(&mut self, set: &TrainingSet) -> Result<StepReport, NotFinite> {
        let options = &self.options;
        let energies = options.energies_at(self.done);
        let goal = Goal { energies, objective: options.objective, head: options.head };
        let mut random = Random::stream(options.seed, 1 + u64::from(self.done));
        let batch = Batch::draw(set, &mut random);
        let (energy, gradient) = self.gradient(&self.network, &goal, &batch);
        let norm = gradient.iter().map(|g| f64::from(*g).powi(2)).sum::<f64>().sqrt();
        if !(energy.is_finite() && norm.is_finite()) {
            return Err(NotFinite { step: self.done });
        }
        let rate = options.rate_at(self.done);
        let scale = (options.largest_gradient / norm.max(1e-30)).min(1.0);
        self.adam.step(&mut self.network.parameters, &gradient, [rate, scale]);
        self.done += 1;
        average(&mut self.average.parameters, &self.network.parameters, self.done, 1);
        Ok(StepReport { energy, gradient: norm, rate })
    }

    /// The mean energy of the strands of `batch`, and its gradient with respect to the parameters.
    fn gradient(&self, network: &MapNetwork, goal: &Goal, batch: &Batch<'_>) -> (f64, Vec<f32>) {
        let simd = self.options.simd;
        let weights = Weights::new(network);
        let shared = batch.shared();
        let pass = Pass { texels: &batch.texels, shared: &shared, statics: &self.strands.statics };
        let levels = pass.forward(simd, &weights);
        let (energy, by_outputs) = self.energies(goal, batch, &levels[DEPTH - 1]);
        let mut found = back(simd, &weights, &levels, by_outputs);
        if let Some(basis) = goal.basis(&network.basis) {
            for range in ranges(DEPTH - 1) {
                found[range].chunks_exact_mut(OUTPUTS).for_each(|row| unfold(row, basis));
            }
        }
        (energy, found)
    }

    /// The mean energy of the strands with the outputs of the `last` level, and its gradient with
    /// respect to these: `[texels × frames, 72]`.
    fn energies(&self, goal: &Goal, batch: &Batch<'_>, last: &Level) -> (f64, Vec<f32>) {
        let aims = Aims { simd: self.options.simd, goal, set: batch.set, strands: DRAWN * WINDOWS };
        let rest: Vec<&[[f32; 3]; PARTICLES]> =
            batch.texels.iter().map(|texel| &self.strands.rest[*texel]).collect();
        let item = |s: usize, frame: usize| (s * FRAMES + frame) * OUTPUTS;
        let of_window = |(number, drawn): (usize, &Drawn)| {
            let mut panels: [Vec<Row<f32>>; MOMENTS] = std::array::from_fn(|ago| {
                let mut panels = zero_panels(OUTPUTS);
                let first = |s| item(s, number * MOMENTS + ago);
                to_panels((0..DRAWN).map(|s| &last.outputs[first(s)..][..OUTPUTS]), &mut panels);
                panels
            });
            let mut energy = 0.0;
            for panel in 0..PANELS {
                let mut outputs = panels.each_mut().map(|panels| &mut panels[panel * OUTPUTS..][..OUTPUTS]);
                let first_strand = panel * LANES;
                let rest = &rest[first_strand..][..LANES];
                let weights = &[1.0; LANES];
                energy += aims.row(&OfRow { drawn, rest, first_strand, weights, between: &[] }, &mut outputs);
            }
            let strands = panels.each_ref().map(|panels| {
                let mut to = vec![0.0; DRAWN * OUTPUTS];
                by_strand(panels, &mut to);
                to
            });
            (energy, strands)
        };
        let windows: Vec<(f64, [Vec<f32>; MOMENTS])> =
            batch.windows.par_iter().enumerate().map(of_window).collect();
        let mut by = vec![0.0; last.outputs.len()];
        for (number, (_, moments)) in windows.iter().enumerate() {
            for (ago, strands) in moments.iter().enumerate() {
                for (s, own) in strands.chunks_exact(OUTPUTS).enumerate() {
                    by[item(s, number * MOMENTS + ago)..][..OUTPUTS].copy_from_slice(own);
                }
            }
        }
        (windows.iter().map(|(energy, _)| energy).sum(), by)
    }
}

impl<'a> Batch<'a> {
    /// Random windows of `set` and random texels.
    fn draw(set: &'a TrainingSet, random: &mut Random) -> Self {
        let drawn = set.draw(random, false);
        let windows = drawn[..WINDOWS].iter().map(|own| Drawn { drape: None, ..*own }).collect();
        let mut texels = BTreeSet::new();
        while texels.len() < DRAWN {
            texels.insert(random.below(TEXELS));
        }
        Self { set, windows, texels: texels.into_iter().collect() }
    }

    /// Inputs of the frames, the newest of a window first: `[frames, 682]`.
    fn shared(&self) -> Vec<f32> {
        let frames = self.windows.iter().flat_map(|own| (0..MOMENTS).map(move |ago| (own, ago)));
        let mut inputs = Vec::with_capacity(FRAMES * SHARED);
        frames.for_each(|(own, ago)| {
            inputs.extend_from_slice(&shared(&self.set.clips[own.clip], own.frame - ago))
        });
        inputs
    }
}

/// The gradient with respect to all parameters from that with respect to the last outputs.
fn back(simd: Simd, weights: &Weights, levels: &[Level], mut by: Vec<f32>) -> Vec<f32> {
    let mut found = vec![0.0; parameters()];
    for number in (0..DEPTH).rev() {
        let (layer, level) = (&LAYERS[number], &levels[number]);
        if number + 1 < DEPTH {
            mask(&level.outputs, &mut by);
        }
        let [matrix, bias] = ranges(number);
        let sizes = [layer.inputs, layer.outputs];
        weight_gradient(simd, [&[&level.inputs], &[&by]], sizes, &mut found[matrix]);
        bias_gradient(&[&by], &mut found[bias]);
        if number == 0 {
            break;
        }
        let [matrix, _] = weights.of(number);
        let tiles = transposed_by_tiles(matrix, layer.outputs);
        let by_inputs = apply(simd, &tiles, [layer.outputs, layer.inputs], Start::Zero, &by);
        // Each pixel is one child of one pixel of the level before.
        let (before, parents) = (&levels[number - 1], &LAYERS[number - 1]);
        by = vec![0.0; before.outputs.len()];
        let items = level.pixels.iter().flat_map(|pixel| before.places(parents, *pixel, FRAMES));
        for (own, by_inputs) in items.zip(by_inputs.chunks_exact(layer.inputs)) {
            let channels = own.len();
            by[own].copy_from_slice(&by_inputs[..channels]);
        }
    }
    found
}

#[cfg(test)]
mod tests;
