//! The mean energy of a batch and its gradient with respect to all parameters.
//!
//! # Theory
//! Layers as in [the network](crate::network). With the gradients of the sums of a layer as rows D,
//! `[strands, units]`, that of its weights is (activations)ᵀ D, and that of the activations below
//! is W D. B/2 of the rotation head is folded into the last layer before a step; its gradient is
//! unfolded afterwards.
//!
//! # Practice
//! A packet is two frames of 32 strands. Packets run in parallel through the layers, the energies
//! and back; then the weights' gradients are products over all 512 strands, in parallel over blocks
//! of weights.

use super::layers::{bias_gradient, mask, transpose, weight_gradient};
use super::set::{Bust, Drawn, shared as shared_inputs};
use super::{Energies, FRAMES, STRANDS, TrainingSet};
use crate::losses::body::body;
use crate::losses::elastic::{RestStrand, elastic};
use crate::losses::motion::{Inertial, Place};
use crate::losses::style::style;
use crate::losses::{Strand, zero};
use crate::network::product::{
    Factors, PACKET, Rows, Start, TILE_ROWS, by_strand, product, to_rows, zero_rows,
};
use crate::network::rotation::{Basis, rotate, rotate_gradient};
use crate::network::{Network, OUTPUTS, SHARED, STATICS, Shape};
use crate::{EDGES, PARTICLES};
use forelock_core::lane::{LANES, Lane, Mat3, Row, Simd, V3, on};
use rayon::prelude::*;

/// Strands of a step.
const BATCH: usize = FRAMES * STRANDS;
/// Packets of a step.
const PACKETS: usize = BATCH / PACKET;
/// Frames of a packet.
const FRAMES_OF_PACKET: usize = PACKET / STRANDS;
/// A frame and the two before it.
const MOMENTS: usize = 3;

/// Buffers of a step.
#[derive(Debug)]
pub(super) struct Workspace {
    /// The gradient, in the order of the parameters.
    found: Vec<f32>,
    packets: Vec<PacketBuffers>,
    /// The weights that a step multiplies with: those of the network and of the average.
    weights: [Folded; 2],
}

/// The last layer with B/2 folded in, and the transposes that the way back needs.
#[derive(Debug)]
struct Folded {
    output: Vec<f32>,
    bias: Vec<f32>,
    output_transposed: Vec<f32>,
    hidden_transposed: Vec<f32>,
}

/// Buffers of a packet: rows of 64 strands, and strand by strand for the weights' gradients.
#[derive(Debug)]
struct PacketBuffers {
    statics: Vec<f32>,
    static_rows: Rows,
    /// The first layer's sums of strands: of the network and of the average.
    sums: [Rows; 2],
    first: Rows,
    second: Rows,
    outputs: Rows,
    by_second: Rows,
    by_first: Rows,
    /// The same strand by strand: `[64][units]`.
    by_strand: [Vec<f32>; 5],
    energy: f64,
}

/// Indices of [`PacketBuffers::by_strand`].
const FIRST: usize = 0;
const SECOND: usize = 1;
const BY_OUTPUT: usize = 2;
const BY_SECOND: usize = 3;
const BY_FIRST: usize = 4;

impl PacketBuffers {
    fn new(shape: Shape) -> Self {
        let rows = zero_rows;
        let strands = |units: usize| vec![0.0; units * PACKET];
        let width = shape.width;
        Self {
            statics: strands(shape.statics),
            static_rows: rows(shape.statics),
            sums: [rows(width), rows(width)],
            first: rows(width),
            second: rows(width),
            outputs: rows(shape.outputs),
            by_second: rows(width),
            by_first: rows(width),
            by_strand: [
                strands(width),
                strands(width),
                strands(shape.outputs),
                strands(width),
                strands(width),
            ],
            energy: 0.0,
        }
    }
}

/// What a step lowers the energy of.
#[derive(Clone, Copy)]
pub(super) struct Batch<'a> {
    pub set: &'a TrainingSet,
    pub drawn: &'a [Drawn; FRAMES],
}

/// What the packets of a step have in common.
struct Step<'a> {
    simd: Simd,
    /// The network and the average, which predicts the two frames before.
    networks: [&'a Network<f32>; 2],
    weights: &'a [Folded; 2],
    energies: &'a Energies,
    set: &'a TrainingSet,
    drawn: &'a [Drawn; FRAMES],
    /// Fᵀ shared of each moment of each frame, `[width]` each, of both.
    frames: &'a [Vec<Vec<f32>>; 2],
}

impl Workspace {
    pub(super) fn new(shape: Shape) -> Self {
        let matrix = |rows: usize, columns: usize| vec![0.0; rows * columns];
        Self {
            found: vec![0.0; shape.parameters()],
            packets: (0..PACKETS).map(|_| PacketBuffers::new(shape)).collect(),
            weights: [0; 2].map(|_| Folded {
                output: matrix(shape.width, shape.outputs),
                bias: matrix(1, shape.outputs),
                output_transposed: matrix(shape.outputs, shape.width),
                hidden_transposed: matrix(shape.width, shape.width),
            }),
        }
    }

    /// The gradient found by the last step.
    pub(super) fn found(&self) -> &[f32] {
        &self.found
    }

    /// Its norm.
    pub(super) fn norm(&self) -> f64 {
        self.found.iter().map(|g| f64::from(*g).powi(2)).sum::<f64>().sqrt()
    }

    /// The mean energy of the strands `drawn`; its gradient is in [`Self::found`].
    pub(super) fn gradient(
        &mut self,
        simd: Simd,
        networks: [&Network<f32>; 2],
        basis: &Basis,
        energies: &Energies,
        batch: &Batch<'_>,
    ) -> f64 {
        let Batch { set, drawn } = *batch;
        for (weights, network) in self.weights.iter_mut().zip(networks) {
            weights.fold(network, basis);
        }
        let frames = networks.map(|network| frame_sums(simd, network, set, drawn));
        let weights = &self.weights;
        let step = Step { simd, networks, weights, energies, set, drawn, frames: &frames };
        self.packets.par_iter_mut().enumerate().for_each(|(number, packet)| step.packet(number, packet));
        self.weight_gradients(simd, networks[0].shape(), basis, set, drawn);
        self.packets.iter().map(|packet| packet.energy).sum::<f64>() / BATCH as f64
    }

    /// The gradients of all weights from those of the layers' sums.
    fn weight_gradients(
        &mut self,
        simd: Simd,
        shape: &Shape,
        basis: &Basis,
        set: &TrainingSet,
        drawn: &[Drawn; FRAMES],
    ) {
        let packets = &self.packets;
        let all = |index: usize| packets.iter().map(move |packet| packet.by_strand[index].as_slice());
        let [statics, shared, first_bias, hidden, second_bias, output, third_bias] = shape.ranges();
        let width = shape.width;
        let by_first: Vec<&[f32]> = all(BY_FIRST).collect();
        let own: Vec<&[f32]> = packets.iter().map(|packet| packet.statics.as_slice()).collect();
        weight_gradient(simd, [&own, &by_first], [shape.statics, width], &mut self.found[statics]);
        let by_frame = frame_gradients(&by_first, width);
        let inputs: Vec<f32> =
            drawn.iter().flat_map(|d| shared_inputs(&set.clips[d.clip], d.frame)).collect();
        weight_gradient(simd, [&[&inputs], &[&by_frame]], [SHARED, width], &mut self.found[shared]);
        let [first, second, by_output, by_second] =
            [FIRST, SECOND, BY_OUTPUT, BY_SECOND].map(|index| all(index).collect::<Vec<_>>());
        weight_gradient(simd, [&first, &by_second], [width, width], &mut self.found[hidden]);
        weight_gradient(simd, [&second, &by_output], [width, shape.outputs], &mut self.found[output.clone()]);
        for (range, rows) in
            [(first_bias, &by_first), (second_bias, &by_second), (third_bias.clone(), &by_output)]
        {
            bias_gradient(rows, &mut self.found[range]);
        }
        for row in self.found[output.start..third_bias.end].chunks_exact_mut(OUTPUTS) {
            unfold(row, basis);
        }
    }
}

impl Folded {
    fn fold(&mut self, network: &Network<f32>, basis: &Basis) {
        let [.., hidden, _, output, bias] = network.parts();
        self.output.copy_from_slice(output);
        self.bias.copy_from_slice(bias);
        let rows = self.output.chunks_exact_mut(OUTPUTS).chain(std::iter::once(self.bias.as_mut_slice()));
        rows.for_each(|row| crate::network::rotation::fold(row, basis));
        transpose(&self.output, OUTPUTS, &mut self.output_transposed);
        let width = network.shape().width;
        transpose(hidden, width, &mut self.hidden_transposed);
    }
}

/// The gradient with respect to o from that with respect to u = ½ B o.
fn unfold(by: &mut [f32], basis: &Basis) {
    let mut sums = [[0.0; 3]; EDGES];
    for (row, by) in basis.iter().zip(by.chunks_exact(3)) {
        for (sum, weight) in sums.iter_mut().zip(row) {
            for c in 0..3 {
                sum[c] += 0.5 * weight * f64::from(by[c]);
            }
        }
    }
    for (by, sum) in by.iter_mut().zip(sums.as_flattened()) {
        *by = *sum as f32;
    }
}

/// The frame `ago` frames before a drawn one; the first frame stands for those before it.
fn moment(drawn: &Drawn, ago: usize) -> usize {
    drawn.frame.saturating_sub(ago)
}

/// Fᵀ shared of each moment of each drawn frame: `[width]` each, frame by frame.
fn frame_sums(
    simd: Simd,
    network: &Network<f32>,
    set: &TrainingSet,
    drawn: &[Drawn; FRAMES],
) -> Vec<Vec<f32>> {
    const { assert!(FRAMES * MOMENTS <= PACKET) };
    let mut inputs = zero_rows(SHARED);
    for (column, (d, ago)) in drawn.iter().flat_map(|d| (0..MOMENTS).map(move |ago| (d, ago))).enumerate() {
        for (k, x) in shared_inputs(&set.clips[d.clip], moment(d, ago)).enumerate() {
            inputs[k * TILE_ROWS + column / LANES].0[column % LANES] = x;
        }
    }
    let width = network.shape().width;
    let mut sums = zero_rows(width);
    product(simd, Factors { a: network.parts()[1], columns: width, b: &inputs }, Start::Zero, &mut sums);
    let column = |c: usize| (0..width).map(|m| sums[m * TILE_ROWS + c / LANES].0[c % LANES]).collect();
    (0..FRAMES * MOMENTS).map(column).collect()
}

/// Sums over the strands of each frame: `[frames, width]`.
fn frame_gradients(by_first: &[&[f32]], width: usize) -> Vec<f32> {
    let mut sums = vec![0.0; FRAMES * width];
    let strands = by_first.iter().flat_map(|packet| packet.chunks_exact(width));
    for (s, row) in strands.enumerate() {
        let sums = &mut sums[s / STRANDS * width..][..width];
        sums.iter_mut().zip(row).for_each(|(sum, x)| *sum += x);
    }
    sums
}

impl Step<'_> {
    /// A packet: its energy, and the gradients of its layers' sums.
    fn packet(&self, number: usize, buffers: &mut PacketBuffers) {
        let drawn = &self.drawn[number * FRAMES_OF_PACKET..][..FRAMES_OF_PACKET];
        self.static_sums(drawn, buffers);
        let strands = drawn.iter().flat_map(|d| d.strands);
        let rest: Vec<&[[f32; 3]; PARTICLES]> = strands.map(|s| &self.set.strands[s].rest).collect();
        let mut outputs: [Rows; MOMENTS] = std::array::from_fn(|_| Vec::new());
        // The frame itself comes last: its activations are what the way back needs.
        for ago in (0..MOMENTS).rev() {
            self.layers(number, ago, buffers);
            outputs[ago].clone_from(&buffers.outputs);
        }
        buffers.energy = 0.0;
        let simd = self.simd;
        for (row, rest) in rest.chunks_exact(LANES).enumerate() {
            let drawn = &drawn[row * LANES / STRANDS];
            let of_row = OfRow { drawn, rest, outputs: &outputs, row };
            let run = on!(simd, energies(step: &Step<'_>, of_row: &OfRow<'_>, by: &mut [Row<f32>]) -> f64);
            // SAFETY: `Trainer::new` has checked that the instruction set is supported.
            #[allow(
                unused_unsafe,
                clippy::allow_attributes,
                reason = "only instantiations with features are unsafe"
            )]
            let energy = unsafe { run(self, &of_row, &mut buffers.outputs) };
            buffers.energy += energy;
        }
        self.back(buffers);
    }

    /// The first layer's sums of a packet's strands.
    fn static_sums(&self, drawn: &[Drawn], buffers: &mut PacketBuffers) {
        let strands = drawn.iter().flat_map(|d| d.strands);
        for (strand, to) in strands.zip(buffers.statics.chunks_exact_mut(STATICS)) {
            to.copy_from_slice(&self.set.strands[strand].statics);
        }
        to_rows(buffers.statics.chunks_exact(STATICS), &mut buffers.static_rows);
        for (network, sums) in self.networks.iter().zip(&mut buffers.sums) {
            let [statics, _, bias, ..] = network.parts();
            let factors = Factors { a: statics, columns: bias.len(), b: &buffers.static_rows };
            product(self.simd, factors, Start::Bias(bias), sums);
        }
    }

    /// The layers of packet `number`, `ago` frames before.
    fn layers(&self, number: usize, ago: usize, buffers: &mut PacketBuffers) {
        const ROWS_OF_FRAME: usize = STRANDS / LANES;
        let which = usize::from(ago > 0);
        let (network, weights) = (self.networks[which], &self.weights[which]);
        let width = network.shape().width;
        for unit in 0..width {
            for row in 0..TILE_ROWS {
                let frame = number * FRAMES_OF_PACKET + row / ROWS_OF_FRAME;
                let shared = self.frames[which][frame * MOMENTS + ago][unit];
                let sums = &buffers.sums[which][unit * TILE_ROWS + row];
                buffers.first[unit * TILE_ROWS + row].0 = sums.0.map(|sum| (sum + shared).max(0.0));
            }
        }
        let [.., hidden, second_bias, _, _] = network.parts();
        let factors = Factors { a: hidden, columns: width, b: &buffers.first };
        product(self.simd, factors, Start::BiasRelu(second_bias), &mut buffers.second);
        let factors = Factors { a: &weights.output, columns: OUTPUTS, b: &buffers.second };
        product(self.simd, factors, Start::Bias(&weights.bias), &mut buffers.outputs);
    }

    /// From the gradient with respect to the outputs, which is in their place, to those of the sums
    /// of all layers, strand by strand.
    fn back(&self, buffers: &mut PacketBuffers) {
        let (width, weights) = (self.networks[0].shape().width, &self.weights[0]);
        let PacketBuffers { first, second, outputs, by_second, by_first, by_strand: to, .. } = buffers;
        let factors = Factors { a: &weights.output_transposed, columns: width, b: outputs };
        product(self.simd, factors, Start::Zero, by_second);
        mask(second, by_second);
        let factors = Factors { a: &weights.hidden_transposed, columns: width, b: by_second };
        product(self.simd, factors, Start::Zero, by_first);
        mask(first, by_first);
        for (rows, to) in [&*first, second, outputs, by_second, by_first].into_iter().zip(to) {
            by_strand(rows, to);
        }
    }
}

/// Sixteen strands of a frame.
struct OfRow<'a> {
    drawn: &'a Drawn,
    rest: &'a [&'a [[f32; 3]; PARTICLES]],
    /// Outputs at each moment.
    outputs: &'a [Rows; MOMENTS],
    /// The row in a packet.
    row: usize,
}

/// The sum of the energies of sixteen strands; `by` receives the gradient of their mean in the
/// batch with respect to the outputs.
#[inline(always)]
fn energies<L: Lane<Scalar = f32>>(step: &Step<'_>, of_row: &OfRow<'_>, by: &mut [Row<f32>]) -> f64 {
    let OfRow { drawn, rest, outputs, row } = of_row;
    let clip = &step.set.clips[drawn.clip];
    let place = |ago: usize| {
        let frame = &clip[moment(drawn, ago)];
        Place::<L> {
            rotation: Mat3::splat(frame.rotation),
            origin: V3::splat(frame.origin - clip[drawn.frame].origin),
        }
    };
    let bust = Bust { field: &step.set.field, parts: &clip[drawn.frame].parts };
    let mean = L::from_f64(1.0 / BATCH as f64);
    let mut sum = 0.0;
    for first in (0..LANES).step_by(L::WIDTH) {
        let mut at_rest: Strand<L> = zero();
        for (i, x) in at_rest.iter_mut().enumerate() {
            for lane in 0..L::WIDTH {
                x.set(lane, rest[first + lane][i]);
            }
        }
        let edges: [V3<L>; EDGES] = std::array::from_fn(|i| at_rest[i + 1] - at_rest[i]);
        let load = |ago: usize| {
            let output = |k: usize| L::load(&outputs[ago][k * TILE_ROWS + row], first);
            std::array::from_fn(|i| V3([output(3 * i), output(3 * i + 1), output(3 * i + 2)]))
        };
        let u: [V3<L>; EDGES] = load(0);
        let x = rotate(at_rest[0], &edges, &u);
        let before = [1, 2].map(|ago| place(ago).world(&rotate(at_rest[0], &edges, &load(ago))));
        let mut by_x = zero();
        let terms = step.energies;
        let shape = RestStrand::new(&at_rest, &terms.elastic);
        let inertial = Inertial { place: place(0), before: [&before[0], &before[1]] };
        let mut energy = elastic(&terms.elastic, &shape, &x, &mut by_x)
            + inertial.energy(&terms.motion, &x, &mut by_x)
            + body(&terms.body, &bust, &x, &mut by_x);
        if let Some(terms) = &terms.style {
            energy += style(terms, &bust, [&at_rest, &x], &mut by_x);
        }
        let by_u = rotate_gradient(&edges, &u, &by_x);
        for (i, by_u) in by_u.iter().enumerate() {
            for c in 0..3 {
                (by_u.0[c] * mean).store(&mut by[(3 * i + c) * TILE_ROWS + row], first);
            }
        }
        for lane in 0..L::WIDTH {
            sum += f64::from(energy.get(lane));
        }
    }
    sum
}
