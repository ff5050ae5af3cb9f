//! Inference of the network on the CPU.
//!
//! # Theory
//! See [the network](super). B/2 of the rotation head is folded into the last layer, whose outputs
//! then are the rotations u. Outputs of the displacement head are taken as they are.
//!
//! # Practice
//! A packet is 64 strands. Its activations, 64 KiB, and the 328 KiB of weights stay in the second
//! cache. Threads share packets; results do not depend on their number.

use super::head::{Head, OutputHead};
use super::product::{Factors, PACKET, PANELS, Panels, Start, product, tile_by_tile, to_panels, zero_panels};
use super::rotation::{Basis, fold, rotate};
use super::{LengthError, Network, OUTPUTS, Shape};
use crate::losses::Strand;
use crate::{EDGES, PARTICLES};
use bytemuck::Zeroable;
use forelock_core::lane::{LANES, Lane, Row, Simd, V3, on};
use rayon::prelude::*;

/// What the network needs of its strands: computed once a groom.
#[derive(Clone, Debug)]
pub struct Strands {
    count: usize,
    /// The first layer's sums: `[width]` rows for every 16 strands, padded to whole packets.
    sums: Panels,
    /// Roots and edges at rest, cm, a row of strands after the other: `[25, 3]` rows.
    rest: Panels,
}

impl Strands {
    /// The number of strands.
    pub fn count(&self) -> usize {
        self.count
    }
}

/// Inputs of strands that do not agree in number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{rest} strands at rest, but inputs of {inputs}")]
pub struct CountError {
    /// Strands at rest.
    pub rest: usize,
    /// Strands with inputs.
    pub inputs: usize,
}

/// A network made ready for inference.
#[derive(Clone, Debug)]
pub struct Predictor {
    pub(super) simd: Simd,
    pub(super) head: OutputHead,
    pub(super) network: Network<f32>,
    /// The weights of the second and of the last layer, tile by tile.
    tiles: [Vec<f32>; 2],
}

/// Where predicted positions go: `[strand][25]`, cm, canonical space.
pub type Positions = [[f32; 3]; PARTICLES];

impl Predictor {
    /// A predictor of `network` with the rotation head of `basis`.
    ///
    /// # Errors
    /// If the network has not three outputs an edge.
    ///
    /// # Panics
    /// If this processor does not support `simd`.
    pub fn new(network: &Network<f32>, basis: &Basis, simd: Simd) -> Result<Self, LengthError> {
        let mut folded = network.clone();
        // The last layer and its bias.
        for range in &network.shape().ranges()[5..] {
            for row in folded.parameters_mut()[range.clone()].chunks_exact_mut(OUTPUTS) {
                fold(row, basis);
            }
        }
        Self::with_head(OutputHead::Rotation, folded, simd)
    }

    /// A predictor of `network` with the displacement head.
    ///
    /// # Errors
    /// If the network has not three outputs an edge.
    ///
    /// # Panics
    /// If this processor does not support `simd`.
    pub fn displacing(network: &Network<f32>, simd: Simd) -> Result<Self, LengthError> {
        Self::with_head(OutputHead::Displacement, network.clone(), simd)
    }

    fn with_head(head: OutputHead, network: Network<f32>, simd: Simd) -> Result<Self, LengthError> {
        let found = network.shape().outputs;
        if found != OUTPUTS {
            return Err(LengthError { expected: OUTPUTS, found });
        }
        let simd = simd.resolve();
        assert!(simd.is_supported(), "{simd:?} is not supported by this processor");
        let [.., hidden, _, output, _] = network.parts();
        let tiles = [tile_by_tile(hidden, network.shape().width), tile_by_tile(output, OUTPUTS)];
        Ok(Self { simd, head, network, tiles })
    }

    /// What the network's outputs are.
    pub fn head(&self) -> OutputHead {
        self.head
    }

    /// The network, with B/2 of the rotation head in its last layer.
    pub fn network(&self) -> &Network<f32> {
        &self.network
    }

    /// The first layer's sums of a frame with the inputs `shared`, `[width]`.
    pub fn shared_sums(&self, shared: &[f32]) -> Vec<f32> {
        super::shared_part(&self.network, shared)
    }

    /// Inputs of a frame.
    pub fn shared_inputs(&self) -> usize {
        self.network.shape().shared
    }

    /// Prepares strands: `rest` are positions at rest, cm, canonical space; `statics` the inputs of
    /// each strand, `[strands, statics]`.
    ///
    /// # Errors
    /// If there are not as many inputs as strands.
    pub fn prepare(&self, rest: &[Positions], statics: &[f32]) -> Result<Strands, CountError> {
        let Shape { statics: inputs, width, .. } = *self.network.shape();
        if statics.len() != inputs * rest.len() {
            return Err(CountError { rest: rest.len(), inputs: statics.len() / inputs });
        }
        let packets = rest.len().div_ceil(PACKET);
        let mut own = Strands {
            count: rest.len(),
            sums: vec![Row::zeroed(); packets * width * PANELS],
            rest: edges_at_rest(rest),
        };
        let [matrix, _, bias, ..] = self.network.parts();
        let tiles = tile_by_tile(matrix, width);
        own.sums.par_chunks_exact_mut(width * PANELS).enumerate().for_each(|(packet, sums)| {
            let mut panels = zero_panels(inputs);
            to_panels(statics.chunks_exact(inputs).skip(packet * PACKET).take(PACKET), &mut panels);
            let factors = Factors { a: &tiles, columns: width, b: &panels };
            product(self.simd, factors, Start::Bias(bias), sums);
        });
        Ok(own)
    }

    /// Positions of `strands` in a frame with the inputs `shared`, `[shared]`: cm, canonical space.
    ///
    /// # Panics
    /// If `shared` or `out` has another length than the network's inputs or the strands.
    pub fn predict(&self, strands: &Strands, shared: &[f32], out: &mut [Positions]) {
        assert_eq!(shared.len(), self.network.shape().shared, "inputs of a frame");
        assert_eq!(out.len(), strands.count, "strands");
        let frame = super::shared_part(&self.network, shared);
        let width = self.network.shape().width;
        out.par_chunks_mut(PACKET)
            .zip(strands.sums.par_chunks_exact(width * PANELS))
            .enumerate()
            .for_each_init(
                || Activations::new(width),
                |activations, (packet, (out, sums))| {
                    self.layers(&frame, sums, activations);
                    let first = packet * PANELS * 3 * PARTICLES;
                    let rest = strands.rest[first..].chunks_exact(3 * PARTICLES);
                    let panels = activations.outputs.chunks_exact(OUTPUTS);
                    for (out, (rest, outputs)) in out.chunks_mut(LANES).zip(rest.zip(panels)) {
                        let strands = HeadRow { head: self.head, rest, outputs };
                        place(self.simd, &strands, out);
                    }
                },
            );
    }

    /// The layers of a packet, from the first layer's sums of the frame and of its strands.
    pub(super) fn layers(&self, frame: &[f32], sums: &[Row<f32>], activations: &mut Activations) {
        let [.., second_bias, _, third_bias] = self.network.parts();
        let Activations { first, second, outputs } = activations;
        let width = self.network.shape().width;
        for (first, sums) in first.chunks_exact_mut(width).zip(sums.chunks_exact(width)) {
            for ((first, sums), frame) in first.iter_mut().zip(sums).zip(frame) {
                for (x, sum) in first.0.iter_mut().zip(sums.0) {
                    *x = (sum + frame).max(0.0);
                }
            }
        }
        let [hidden, output] = &self.tiles;
        let factors = Factors { a: hidden, columns: width, b: first };
        product(self.simd, factors, Start::BiasRelu(second_bias), second);
        let factors = Factors { a: output, columns: OUTPUTS, b: second };
        product(self.simd, factors, Start::Bias(third_bias), outputs);
    }
}

/// Roots and edges of strands at rest, whole packets, a row of strands after the other: `[25, 3]`
/// rows.
pub(crate) fn edges_at_rest(rest: &[Positions]) -> Panels {
    let packets = rest.len().div_ceil(PACKET);
    let mut own = vec![Row::zeroed(); packets * PANELS * 3 * PARTICLES];
    for (s, x) in rest.iter().enumerate() {
        let rows = &mut own[s / LANES * 3 * PARTICLES..][..3 * PARTICLES];
        for i in 0..PARTICLES {
            for c in 0..3 {
                let before = if i > 0 { x[i - 1][c] } else { 0.0 };
                rows[3 * i + c].0[s % LANES] = x[i][c] - before;
            }
        }
    }
    own
}

/// Activations of a packet, in panels.
#[derive(Debug)]
pub(super) struct Activations {
    first: Panels,
    second: Panels,
    pub(super) outputs: Panels,
}

impl Activations {
    pub(super) fn new(width: usize) -> Self {
        Self { first: zero_panels(width), second: zero_panels(width), outputs: zero_panels(OUTPUTS) }
    }
}

/// What the positions of up to 16 strands, a row of a packet, follow from.
#[derive(Debug)]
pub(crate) struct HeadRow<'a> {
    pub head: OutputHead,
    /// Roots and edges at rest.
    pub rest: &'a [Row<f32>],
    /// The network's outputs, `[72]`.
    pub outputs: &'a [Row<f32>],
}

/// The positions of `strands`.
pub(crate) fn place(simd: Simd, strands: &HeadRow<'_>, out: &mut [Positions]) {
    let run = on!(simd, place_lanes(strands: &HeadRow<'_>, out: &mut [Positions]));
    // SAFETY: `Predictor::displacing` has checked that the instruction set is supported.
    #[allow(unused_unsafe, clippy::allow_attributes, reason = "only instantiations with features are unsafe")]
    unsafe {
        run(strands, out);
    }
}

/// [`place`] in lanes.
#[inline(always)]
fn place_lanes<L: Lane<Scalar = f32>>(strands: &HeadRow<'_>, out: &mut [Positions]) {
    let HeadRow { head, rest, outputs } = strands;
    for first in (0..LANES.min(out.len())).step_by(L::WIDTH) {
        let mut edges = [V3::zero(); EDGES];
        let mut o = [V3::zero(); EDGES];
        for i in 0..EDGES {
            edges[i] = V3::<L>::load(rest, i + 1, first);
            o[i] = V3::load(outputs, i, first);
        }
        let root = V3::load(rest, 0, first);
        let x: Strand<L> = match head {
            OutputHead::Rotation => rotate(root, &edges, &o),
            OutputHead::Displacement => {
                let mut at_rest = [root; PARTICLES];
                for i in 0..EDGES {
                    at_rest[i + 1] = at_rest[i] + edges[i];
                }
                Head::new(OutputHead::Displacement, &at_rest).strand(&at_rest, &o)
            }
        };
        for (lane, out) in out.iter_mut().skip(first).take(L::WIDTH).enumerate() {
            for (out, x) in out.iter_mut().zip(&x) {
                *out = x.get(lane);
            }
        }
    }
}
