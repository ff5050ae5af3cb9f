//! Strand codes: 32 numbers that tell the rest shape of a strand (Neuralocks, Sec. 4.2).
//!
//! # Theory
//! An encoder 75 → 256 → 256 → 32 and a decoder 32 → 256 → 256 → 75, ReLU between layers, are
//! trained together to reproduce the inputs of [`encoder_inputs`](super::encoder_inputs) with the
//! least mean squared error. The decoder is not kept.
//!
//! # Practice
//! Adam at 1e-3 with a cosine schedule, batches of 256 strands. The result depends on the seed and
//! the instruction set, not on the number of threads.

use super::Encoder;
use super::encode::run_layers;
use crate::PARTICLES;
use crate::network::product::{
    Factors, PACKET, Panels, Start, product, size_by_tiles, strands_by_tiles, tile_by_tile, to_panels,
    transposed_by_tiles, units_in_lanes, zero_panels, zero_unit_panels,
};
use crate::random::Random;
use crate::train::adam::Adam;
use crate::train::layers::{bias_gradient_of_panels, mask_rows, weight_gradient_of_panels};
use forelock_core::lane::{Row, Simd};
use rayon::prelude::*;

/// Numbers of a strand that are encoded.
pub const INPUTS: usize = 3 * PARTICLES;
/// Numbers of a code.
pub const CODE: usize = 32;
/// Units of the layers of encoder and decoder, from the inputs to the reconstruction.
const SIZES: [usize; 7] = [INPUTS, 256, 256, CODE, 256, 256, INPUTS];
/// Layers of the encoder.
pub(crate) const ENCODER: usize = 3;
/// Layers of both.
const LAYERS: usize = SIZES.len() - 1;
/// Strands of a step. The gradient counts all 64 strands of a packet, so packets must be full.
const BATCH: usize = 256;
const _: () = assert!(BATCH.is_multiple_of(PACKET));

/// How to train codes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CodeOptions {
    /// Seed of all random numbers.
    pub seed: u64,
    /// Steps.
    pub steps: u32,
    /// Learning rate at the start.
    pub rate: f64,
    /// The instruction set.
    pub simd: Simd,
}

impl Default for CodeOptions {
    fn default() -> Self {
        Self { seed: 1, steps: 4000, rate: 1e-3, simd: Simd::Auto }
    }
}

/// Weights, `[inputs, outputs]`, and biases of a layer.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Layer {
    pub weights: Vec<f32>,
    pub bias: Vec<f32>,
}

/// Encoder and decoder.
#[derive(Clone, Debug, PartialEq)]
pub struct StrandCodes {
    layers: Vec<Layer>,
}

/// Whether the outputs of a layer are clamped at zero: not those of a code or a reconstruction.
fn has_relu(layer: usize) -> bool {
    layer != ENCODER - 1 && layer != LAYERS - 1
}

/// What a packet of 64 strands leaves for the gradients of all layers.
struct GradientFactors {
    /// The inputs of each layer, `[64, inputs]`, tile by tile.
    inputs: Vec<Vec<f32>>,
    /// The gradient with respect to the sums of each layer: `[units / 16, 64]` rows of 16 units.
    by_sums: Vec<Panels>,
}

impl StrandCodes {
    /// Trains codes for `strands`, inputs of the encoder. `done` is called after each step.
    ///
    /// # Panics
    /// If there are no strands.
    pub fn train(strands: &[[f32; INPUTS]], options: &CodeOptions, done: &mut dyn FnMut()) -> Self {
        assert!(!strands.is_empty(), "codes need strands");
        let mut random = Random::stream(options.seed, u64::MAX);
        let layers = SIZES.windows(2).map(|size| {
            let deviation = (2.0 / size[0] as f64).sqrt();
            let weights = (0..size[0] * size[1]).map(|_| (deviation * random.normal()) as f32).collect();
            Layer { weights, bias: vec![0.0; size[1]] }
        });
        let mut own = Self { layers: layers.collect() };
        let moments = |layer: &Layer| [Adam::new(layer.weights.len()), Adam::new(layer.bias.len())];
        let mut adams: Vec<[Adam<f32>; 2]> = own.layers.iter().map(moments).collect();
        let simd = options.simd.resolve();
        for step in 0..options.steps {
            let batch: Vec<&[f32]> =
                (0..BATCH).map(|_| strands[random.below(strands.len())].as_slice()).collect();
            let share = f64::from(step) / f64::from(options.steps);
            let rate = options.rate * (0.5 + 0.5 * (std::f64::consts::PI * share).cos());
            let gradient = own.gradient(simd, &batch);
            for ((layer, adams), by) in own.layers.iter_mut().zip(&mut adams).zip(&gradient) {
                adams[0].step(&mut layer.weights, &by.weights, [rate, 1.0]);
                adams[1].step(&mut layer.bias, &by.bias, [rate, 1.0]);
            }
            done();
        }
        own
    }

    /// The gradient of the mean squared error of a batch.
    fn gradient(&self, simd: Simd, batch: &[&[f32]]) -> Vec<Layer> {
        let weights: Vec<[Vec<f32>; 2]> = self
            .layers
            .iter()
            .map(|layer| {
                let columns = layer.bias.len();
                [tile_by_tile(&layer.weights, columns), transposed_by_tiles(&layer.weights, columns)]
            })
            .collect();
        let packets: Vec<GradientFactors> =
            batch.par_chunks(PACKET).map(|strands| self.packet(simd, strands, &weights)).collect();
        (0..LAYERS)
            .map(|layer| {
                let [m, n] = [SIZES[layer], SIZES[layer + 1]];
                let inputs: Vec<&[f32]> = packets.iter().map(|own| own.inputs[layer].as_slice()).collect();
                let by_sums: Vec<&[Row<f32>]> =
                    packets.iter().map(|own| own.by_sums[layer].as_slice()).collect();
                let mut by = Layer { weights: vec![0.0; m * n], bias: vec![0.0; n] };
                weight_gradient_of_panels(simd, &inputs, &by_sums, [m, n], &mut by.weights);
                bias_gradient_of_panels(&by_sums, &mut by.bias);
                by
            })
            .collect()
    }

    /// The way of 64 strands through all layers and back; `weights` are those of each layer and
    /// their transposes, tile by tile.
    fn packet(&self, simd: Simd, strands: &[&[f32]], weights: &[[Vec<f32>; 2]]) -> GradientFactors {
        let mut panels = vec![zero_panels(INPUTS)];
        to_panels(strands.iter().copied(), &mut panels[0]);
        for (number, layer) in self.layers.iter().enumerate() {
            let mut c = zero_panels(layer.bias.len());
            let factors = Factors { a: &weights[number][0], columns: layer.bias.len(), b: &panels[number] };
            let start =
                if has_relu(number) { Start::BiasRelu(&layer.bias) } else { Start::Bias(&layer.bias) };
            product(simd, factors, start, &mut c);
            panels.push(c);
        }
        let scale = 2.0 / (BATCH * INPUTS) as f32;
        let mut by = zero_panels(INPUTS);
        for ((by, found), expected) in by.iter_mut().zip(&panels[LAYERS]).zip(&panels[0]) {
            by.0 = std::array::from_fn(|lane| scale * (found.0[lane] - expected.0[lane]));
        }
        let by_tiles = |(panels, units): (&Panels, &usize)| {
            let mut to = vec![0.0; size_by_tiles(PACKET, *units)];
            strands_by_tiles(panels, &mut to);
            to
        };
        let inputs = panels[..LAYERS].iter().zip(&SIZES).map(by_tiles).collect();
        let mut by_sums = vec![Vec::new(); LAYERS];
        for number in (0..LAYERS).rev() {
            if has_relu(number) {
                mask_rows(&panels[number + 1], &mut by);
            }
            by_sums[number] = zero_unit_panels(SIZES[number + 1]);
            units_in_lanes(&by, &mut by_sums[number]);
            if number == 0 {
                break;
            }
            let mut below = zero_panels(SIZES[number]);
            let factors = Factors { a: &weights[number][1], columns: SIZES[number], b: &by };
            product(simd, factors, Start::Zero, &mut below);
            by = below;
        }
        GradientFactors { inputs, by_sums }
    }

    /// The encoder alone: what a model keeps.
    pub fn encoder(&self) -> Encoder {
        Encoder::of(self.layers[..ENCODER].to_vec())
    }

    /// The code of a strand, layer by layer: the specification of [`Encoder::encode`].
    pub fn encode(&self, strand: &[f32; INPUTS]) -> [f32; CODE] {
        let code = self.run(0..ENCODER, strand);
        std::array::from_fn(|k| code[k])
    }

    /// The strands of codes `[strands, code]`, as inputs of the encoder: [`Self::decode`] in lanes.
    ///
    /// # Panics
    /// If the processor does not support `simd`.
    pub fn decode_all(&self, codes: &[f32], simd: Simd) -> Vec<[f32; INPUTS]> {
        let found = run_layers(&self.layers[ENCODER..], codes, simd);
        found.chunks_exact(INPUTS).map(|strand| std::array::from_fn(|k| strand[k])).collect()
    }

    /// The strand of a code.
    pub fn decode(&self, code: &[f32; CODE]) -> [f32; INPUTS] {
        let strand = self.run(ENCODER..LAYERS, code);
        std::array::from_fn(|k| strand[k])
    }

    fn run(&self, layers: std::ops::Range<usize>, inputs: &[f32]) -> Vec<f32> {
        let mut x = inputs.to_vec();
        for number in layers {
            let layer = &self.layers[number];
            let mut sums = layer.bias.clone();
            crate::network::add_layer(&layer.weights, &x, &mut sums);
            if has_relu(number) {
                sums.iter_mut().for_each(|sum| *sum = sum.max(0.0));
            }
            x = sums;
        }
        x
    }
}
