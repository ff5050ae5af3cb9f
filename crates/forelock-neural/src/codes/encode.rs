//! The encoder of strand codes without its decoder.

use super::encoder::{INPUTS, Layer};
use crate::network::product::{
    Factors, PACKET, Start, by_strand, product, tile_by_tile, to_panels, zero_panels,
};
use forelock_core::lane::Simd;
use rayon::prelude::*;

/// The encoder: layers with ReLU between them, from the inputs of a strand
/// ([`encoder_inputs`](super::encoder_inputs)) to its code. A [model](crate::model) keeps it.
#[derive(Clone, Debug, PartialEq)]
pub struct Encoder {
    layers: Vec<Layer>,
}

impl Encoder {
    /// An encoder of layers that suit each other; the first one takes [`INPUTS`] numbers.
    pub(crate) fn of(layers: Vec<Layer>) -> Self {
        Self { layers }
    }

    /// The layers, from the inputs to the code.
    pub(crate) fn layers(&self) -> &[Layer] {
        &self.layers
    }

    /// Numbers of a code.
    pub fn code_len(&self) -> usize {
        self.layers.last().map_or(INPUTS, |layer| layer.bias.len())
    }

    /// The codes of strands, `[strands, code]`, from their inputs. A code depends on its strand and
    /// the instruction set alone.
    ///
    /// # Panics
    /// If the processor does not support `simd`.
    pub fn encode(&self, strands: &[[f32; INPUTS]], simd: Simd) -> Vec<f32> {
        run_layers(&self.layers, strands.as_flattened(), simd)
    }
}

/// The outputs of layers with ReLU between them, `[items, outputs]`, from `items`,
/// `[items, inputs]`.
pub(super) fn run_layers(layers: &[Layer], items: &[f32], simd: Simd) -> Vec<f32> {
    let [first, .., last] = layers else {
        return items.to_vec();
    };
    let (inputs, outputs) = (first.weights.len() / first.bias.len(), last.bias.len());
    let tiles: Vec<Vec<f32>> =
        layers.iter().map(|layer| tile_by_tile(&layer.weights, layer.bias.len())).collect();
    let packet = |items: &[f32]| {
        let mut panels = zero_panels(inputs);
        to_panels(items.chunks_exact(inputs), &mut panels);
        for (number, (layer, tiles)) in layers.iter().zip(&tiles).enumerate() {
            let is_last = number + 1 == layers.len();
            let start = if is_last { Start::Bias(&layer.bias) } else { Start::BiasRelu(&layer.bias) };
            let mut sums = zero_panels(layer.bias.len());
            let factors = Factors { a: tiles, columns: layer.bias.len(), b: &panels };
            product(simd, factors, start, &mut sums);
            panels = sums;
        }
        let mut found = vec![0.0; PACKET * outputs];
        by_strand(&panels, &mut found);
        found.truncate(items.len() / inputs * outputs);
        found
    };
    items.par_chunks(PACKET * inputs).flat_map_iter(packet).collect()
}
