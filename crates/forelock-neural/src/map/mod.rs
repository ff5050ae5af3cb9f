//! One network that emits a whole groom at once as a map of 64 × 64 strands: what the predecessors
//! of the [strand network](crate::network) do, kept for comparison (Quaffure, 2025).
//!
//! # Theory
//! Pose, body shape and the history of velocities, 682 numbers, go through two dense layers to a
//! map of 4 × 4 pixels, and four transposed convolutions with kernels of 2 × 2 pixels and a stride
//! of 2 make 64 × 64 of these, each pixel of a kernel with its own bias. At each texel two layers,
//! with the inputs of the strand as further ones, give the outputs of the same heads as those of
//! the strand network. ReLU is between all layers:
//!
//! ```text
//! 682 → 256 → 4² × 128 → 8² × 128 → 16² × 64 → 32² × 64 → 64² × 32 (+ 66) → 64² × 128 → 64² × 72
//! ```
//!
//! # Practice
//! Pixels are in the order of a quadtree: the children of pixel p are 4p … 4p + 3, so what such a
//! convolution makes of a pixel are its children, one after the other, and every layer is one
//! matrix product over pixels and frames. [`texel`] is the place of a texel in that order.
//!
//! # Limitations
//! Quaffure's layers are not published: ours are as small as its description allows, and have a
//! two-hundredth of its printed size. A groom has as many strands as the map has texels at most,
//! and the network is trained for one groom.

mod inference;
mod strands;
mod train;

pub use inference::MapPredictor;
pub use strands::MapStrands;
pub use train::MapTrainer;

use crate::network::head::OutputHead;
use crate::network::product::{
    Factors, PACKET, Start, by_strand, product, tile_by_tile, to_panels, zero_panels,
};
use crate::network::rotation::{Basis, fold};
use crate::network::{LengthError, OUTPUTS, SHARED, STATICS};
use forelock_core::lane::Simd;
use rayon::prelude::*;
use std::ops::Range;

/// Texels along a side of the map.
pub const SIDE: usize = 64;
/// Texels of the map.
pub const TEXELS: usize = SIDE * SIDE;

/// A layer: what a pixel's numbers become.
#[derive(Clone, Copy, Debug)]
struct Layer {
    inputs: usize,
    /// Outputs of all children together.
    outputs: usize,
    /// Pixels that it makes of one.
    children: usize,
}

/// The layers' number.
const DEPTH: usize = 8;
/// The layer that also takes the strands' inputs.
const JOINED: usize = 6;

const fn layer(inputs: usize, channels: usize, children: usize) -> Layer {
    Layer { inputs, outputs: channels * children, children }
}

/// All layers.
const LAYERS: [Layer; DEPTH] = [
    layer(SHARED, 256, 1),
    layer(256, 128, 16),
    layer(128, 128, 4),
    layer(128, 64, 4),
    layer(64, 64, 4),
    layer(64, 32, 4),
    layer(32 + STATICS, 128, 1),
    layer(128, OUTPUTS, 1),
];

/// Where the weights `[inputs, outputs]` and the bias of layer `number` are.
fn ranges(number: usize) -> [Range<usize>; 2] {
    let size = |layer: &Layer| (layer.inputs + 1) * layer.outputs;
    let first: usize = LAYERS[..number].iter().map(size).sum();
    let Layer { inputs, outputs, .. } = LAYERS[number];
    let bias = first + inputs * outputs;
    [first..bias, bias..bias + outputs]
}

/// The number of all weights and biases.
pub fn parameters() -> usize {
    ranges(DEPTH - 1)[1].end
}

/// The place of the texel in column `u` and row `v` in the order of the quadtree.
pub fn texel(u: usize, v: usize) -> usize {
    let bits =
        (0..SIDE.ilog2() as usize).map(|bit| (u >> bit & 1) << (2 * bit) | (v >> bit & 1) << (2 * bit + 1));
    bits.sum()
}

/// A network for a map: its weights, and what its outputs are.
#[derive(Clone, Debug, PartialEq)]
pub struct MapNetwork {
    parameters: Vec<f32>,
    head: OutputHead,
    basis: Basis,
}

impl MapNetwork {
    /// A network of [`parameters`] weights and biases, a layer after the other, each the weights
    /// `[inputs, outputs]` and then the bias. `basis` is that of the rotation head.
    ///
    /// # Errors
    /// If there are not as many.
    pub fn new(parameters: Vec<f32>, head: OutputHead, basis: &Basis) -> Result<Self, LengthError> {
        let (expected, found) = (self::parameters(), parameters.len());
        let own = Self { parameters, head, basis: *basis };
        if found == expected { Ok(own) } else { Err(LengthError { expected, found }) }
    }

    /// Its weights and biases.
    pub fn parameters(&self) -> &[f32] {
        &self.parameters
    }
}

/// Weights that a pass multiplies with: B/2 of the rotation head is folded into the last layer.
#[derive(Clone, Debug)]
struct Weights {
    parameters: Vec<f32>,
    /// Those of each layer, tile by tile.
    tiles: [Vec<f32>; DEPTH],
}

impl Weights {
    fn new(network: &MapNetwork) -> Self {
        let mut parameters = network.parameters.clone();
        if network.head == OutputHead::Rotation {
            for range in ranges(DEPTH - 1) {
                parameters[range].chunks_exact_mut(OUTPUTS).for_each(|row| fold(row, &network.basis));
            }
        }
        let tiles = std::array::from_fn(|number| {
            let [weights, _] = ranges(number);
            tile_by_tile(&parameters[weights], LAYERS[number].outputs)
        });
        Self { parameters, tiles }
    }

    /// The weights and the bias of layer `number`.
    fn of(&self, number: usize) -> [&[f32]; 2] {
        ranges(number).map(|range| &self.parameters[range])
    }
}

/// Pixels of a layer and frames: `[pixels × frames]` items.
#[derive(Clone, Debug, Default)]
struct Level {
    /// The pixels that are computed, in ascending order.
    pixels: Vec<usize>,
    /// `[items, inputs]`.
    inputs: Vec<f32>,
    /// `[items, outputs]`.
    outputs: Vec<f32>,
}

/// Aᵀ of each of `items` (`[inputs]` each), with what `start` says: `[items, columns]`. A is
/// `[inputs, columns]`, stored tile by tile.
fn apply(
    simd: Simd,
    tiles: &[f32],
    [inputs, columns]: [usize; 2],
    start: Start<'_>,
    items: &[f32],
) -> Vec<f32> {
    let mut out = vec![0.0; items.len() / inputs * columns];
    let packets = out.par_chunks_mut(PACKET * columns).zip(items.par_chunks(PACKET * inputs));
    packets.for_each_init(
        || (zero_panels(inputs), zero_panels(columns), vec![0.0; PACKET * columns]),
        |(panels, sums, found), (out, items)| {
            to_panels(items.chunks_exact(inputs), panels);
            product(simd, Factors { a: tiles, columns, b: panels }, start, sums);
            by_strand(sums, found);
            out.copy_from_slice(&found[..out.len()]);
        },
    );
    out
}

/// What all layers are computed for.
#[derive(Clone, Copy, Debug)]
struct Pass<'a> {
    /// The texels, ascending.
    texels: &'a [usize],
    /// Inputs of the frames, `[frames, 682]`.
    shared: &'a [f32],
    /// Inputs of the strands of all texels of the map, `[texels, 66]`.
    statics: &'a [f32],
}

impl Pass<'_> {
    fn frames(&self) -> usize {
        self.shared.len() / SHARED
    }

    /// All layers.
    fn forward(&self, simd: Simd, weights: &Weights) -> Vec<Level> {
        let mut levels: Vec<Level> = Vec::with_capacity(DEPTH);
        for (number, layer) in LAYERS.iter().enumerate() {
            // Texels below a pixel of this layer.
            let below: usize = LAYERS[number..].iter().map(|layer| layer.children).product();
            let mut pixels: Vec<usize> = self.texels.iter().map(|texel| texel / below).collect();
            pixels.dedup();
            let inputs = match levels.last() {
                None => self.shared.to_vec(),
                Some(before) => self.gather(before, number, &pixels),
            };
            let [_, bias] = weights.of(number);
            let start = if number + 1 < DEPTH { Start::BiasRelu(bias) } else { Start::Bias(bias) };
            let outputs = apply(simd, &weights.tiles[number], [layer.inputs, layer.outputs], start, &inputs);
            levels.push(Level { pixels, inputs, outputs });
        }
        levels
    }

    /// The inputs of `pixels` of layer `number` from the outputs of the level before.
    fn gather(&self, before: &Level, number: usize, pixels: &[usize]) -> Vec<f32> {
        let frames = self.frames();
        let mut inputs = Vec::with_capacity(pixels.len() * frames * LAYERS[number].inputs);
        for pixel in pixels {
            for own in before.places(&LAYERS[number - 1], *pixel, frames) {
                inputs.extend_from_slice(&before.outputs[own]);
                if number == JOINED {
                    inputs.extend_from_slice(&self.statics[pixel * STATICS..][..STATICS]);
                }
            }
        }
        inputs
    }
}

impl Level {
    /// Where the numbers of `pixel` are among the outputs of this level, whose layer is `layer`, in
    /// each of `frames`.
    fn places(&self, layer: &Layer, pixel: usize, frames: usize) -> impl Iterator<Item = Range<usize>> {
        let parent = self.pixels.partition_point(|own| *own < pixel / layer.children);
        let channels = layer.outputs / layer.children;
        let (outputs, child) = (layer.outputs, pixel % layer.children * channels);
        (0..frames).map(move |frame| {
            let first = (parent * frames + frame) * outputs + child;
            first..first + channels
        })
    }
}

#[cfg(test)]
mod tests;
