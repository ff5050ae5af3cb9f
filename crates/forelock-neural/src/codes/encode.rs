//! The encoder of strand codes without its decoder.

use super::encoder::{INPUTS, Layer};
use crate::network::product::{Factors, PACKET, Start, by_strand, product, to_rows, zero_rows};
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
        let packet = |strands: &[[f32; INPUTS]]| {
            let mut rows = zero_rows(INPUTS);
            to_rows(strands.iter().map(|strand| strand.as_slice()), &mut rows);
            for (number, layer) in self.layers.iter().enumerate() {
                let is_last = number + 1 == self.layers.len();
                let start = if is_last { Start::Bias(&layer.bias) } else { Start::BiasRelu(&layer.bias) };
                let mut sums = zero_rows(layer.bias.len());
                let factors = Factors { a: &layer.weights, columns: layer.bias.len(), b: &rows };
                product(simd, factors, start, &mut sums);
                rows = sums;
            }
            let mut codes = vec![0.0; PACKET * self.code_len()];
            by_strand(&rows, &mut codes);
            codes.truncate(strands.len() * self.code_len());
            codes
        };
        strands.par_chunks(PACKET).flat_map_iter(packet).collect()
    }
}
