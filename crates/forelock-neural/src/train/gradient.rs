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

use super::between::{Between, Neighbourhood};
use super::layers::{bias_gradient_of_panels, mask_rows, parts, weight_gradient, weight_gradient_of_panels};
use super::set::{Bust, Drawn, shared as shared_inputs};
use super::soap::Frames;
use super::window::{Goal, Neighbours, Window};
use super::{FRAMES, MOMENTS, STRANDS, TrainingSet};
use crate::losses::elastic::RestStrand;
use crate::losses::motion::Place;
use crate::losses::{Strand, zero};
use crate::network::head::Head;
use crate::network::product::{
    Factors, PACKET, Panels, Start, product, size_by_tiles, strands_by_tiles, tile_by_tile, to_panels,
    to_tiles, transposed_by_tiles, units_in_lanes, zero_panels, zero_unit_panels,
};
use crate::network::rotation::{Basis, fold};
use crate::network::{Network, OUTPUTS, STATICS, Shape};
use crate::{EDGES, PARTICLES};
use bytemuck::Zeroable;
use forelock_core::lane::{BASELINE_FMA, LANES, Lane, Mat3, Pack, Row, Simd, V3, on};
use rayon::prelude::*;

/// Numbers of the gradient that a task sums up.
const PART: usize = 1 << 14;
/// Minimum number of rows of the last layer that a task folds.
const FOLDED: usize = 32;

/// Strands of a step.
const BATCH: usize = FRAMES * STRANDS;
/// Packets of a step.
const PACKETS: usize = BATCH / PACKET;
/// Frames of a packet.
const FRAMES_OF_PACKET: usize = PACKET / STRANDS;

/// What a step finds.
#[derive(Clone, Copy)]
pub(super) struct Found<'a> {
    /// The gradient, in the order of the parameters.
    pub gradient: &'a [f32],
    /// The gradient of the first layer's sums of all frames, `[frames, width]`.
    pub by_frame_sums: &'a [f32],
}

/// Buffers of a step.
#[derive(Debug)]
pub(super) struct Workspace {
    /// The gradient, in the order of the parameters.
    found: Vec<f32>,
    by_frame_sums: Vec<f32>,
    packets: Vec<PacketBuffers>,
}

/// The weights of a step, tile by tile, and the transposes that the way back needs. B/2 is folded
/// into the last layer and its bias.
#[derive(Debug)]
struct StepWeights {
    statics: Vec<f32>,
    hidden: Vec<f32>,
    hidden_transposed: Vec<f32>,
    output: Vec<f32>,
    output_transposed: Vec<f32>,
    output_bias: Vec<f32>,
}

/// Buffers of a packet: numbers of 64 strands in panels, and in the order of the products that give
/// the weights' gradients.
#[derive(Debug)]
struct PacketBuffers {
    /// `[64, statics]`.
    statics: Vec<f32>,
    static_tiles: Vec<f32>,
    static_panels: Panels,
    /// The first layer's sums of strands.
    sums: Panels,
    moments: [MomentBuffers; MOMENTS],
    by_second: Panels,
    by_first: Panels,
    /// The gradient of the first layer's sums, over all moments: `[width / 16, 64]` rows of 16
    /// units.
    by_statics: Panels,
    energy: f64,
}

/// Buffers of a packet at one moment.
#[derive(Debug)]
struct MomentBuffers {
    first: Panels,
    second: Panels,
    /// The outputs, then the gradient with respect to them.
    outputs: Panels,
    /// The activations of [`FIRST`] and [`SECOND`] as `[64, width]`, tile by tile.
    tiles: [Vec<f32>; 2],
    /// The gradients with respect to [`FIRST`], [`SECOND`] and [`OUTPUT`]:
    /// `[units / 16, 64]` rows of 16 units.
    by: [Panels; 3],
}

/// Indices into [`MomentBuffers::tiles`] and [`MomentBuffers::by`].
const FIRST: usize = 0;
const SECOND: usize = 1;
const OUTPUT: usize = 2;

impl PacketBuffers {
    fn new(shape: Shape) -> Self {
        let tiles = |units: usize| vec![0.0; size_by_tiles(PACKET, units)];
        let width = shape.width;
        Self {
            statics: vec![0.0; shape.statics * PACKET],
            static_tiles: tiles(shape.statics),
            static_panels: zero_panels(shape.statics),
            sums: zero_panels(width),
            moments: std::array::from_fn(|_| MomentBuffers {
                first: zero_panels(width),
                second: zero_panels(width),
                outputs: zero_panels(shape.outputs),
                tiles: [width, width].map(tiles),
                by: [width, width, shape.outputs].map(zero_unit_panels),
            }),
            by_second: zero_panels(width),
            by_first: zero_panels(width),
            by_statics: zero_unit_panels(width),
            energy: 0.0,
        }
    }
}

/// What a step lowers the energy of.
#[derive(Clone, Copy)]
pub(super) struct Batch<'a> {
    pub set: &'a TrainingSet,
    pub drawn: &'a [Drawn; FRAMES],
    /// With the inputs of [`frame_inputs`].
    pub frames: &'a Frames,
}

/// What the packets of a step have in common.
struct Step<'a> {
    simd: Simd,
    network: &'a Network<f32>,
    weights: &'a StepWeights,
    goal: &'a Goal,
    set: &'a TrainingSet,
    drawn: &'a [Drawn; FRAMES],
    /// The first layer's sums of all frames, `[frames, width]`.
    frames: &'a [f32],
}

impl Workspace {
    pub(super) fn new(shape: Shape) -> Self {
        Self {
            found: vec![0.0; shape.parameters()],
            by_frame_sums: Vec::new(),
            packets: (0..PACKETS).map(|_| PacketBuffers::new(shape)).collect(),
        }
    }

    /// What the last step found.
    pub(super) fn found(&self) -> Found<'_> {
        Found { gradient: &self.found, by_frame_sums: &self.by_frame_sums }
    }

    /// The norm of its gradient.
    pub(super) fn norm(&self) -> f64 {
        let square = |part: &[f32]| part.iter().map(|g| f64::from(*g).powi(2)).sum::<f64>();
        let squares: Vec<f64> = self.found.par_chunks(PART).map(square).collect();
        squares.iter().sum::<f64>().sqrt()
    }

    /// The mean energy of the strands `drawn`; its gradient is in [`Self::found`].
    pub(super) fn gradient(
        &mut self,
        simd: Simd,
        network: &Network<f32>,
        basis: &Basis,
        goal: &Goal,
        batch: &Batch<'_>,
    ) -> f64 {
        let Batch { set, drawn, frames } = *batch;
        let weights = &StepWeights::new(network, goal.basis(basis));
        let step = Step { simd, network, weights, goal, set, drawn, frames: &frames.sums };
        self.packets.par_iter_mut().enumerate().for_each(|(number, packet)| step.packet(number, packet));
        self.weight_gradients(simd, network.shape(), goal.basis(basis), &frames.inputs);
        self.packets.iter().map(|packet| packet.energy).sum::<f64>()
    }

    /// The gradients of all weights from those of the layers' sums.
    fn weight_gradients(&mut self, simd: Simd, shape: &Shape, basis: Option<&Basis>, inputs: &[f32]) {
        let packets = &self.packets;
        let moments = || packets.iter().flat_map(|packet| &packet.moments);
        let tiles = |layer: usize| -> Vec<&[f32]> {
            moments().map(|moment| moment.tiles[layer].as_slice()).collect()
        };
        let by = |layer: usize| -> Vec<&[Row<f32>]> {
            moments().map(|moment| moment.by[layer].as_slice()).collect()
        };
        let [statics, shared, first_bias, hidden, second_bias, output, third_bias] = shape.ranges();
        let width = shape.width;
        let own: Vec<&[f32]> = packets.iter().map(|packet| packet.static_tiles.as_slice()).collect();
        let by_statics: Vec<&[Row<f32>]> =
            packets.iter().map(|packet| packet.by_statics.as_slice()).collect();
        let ([first, second], [by_first, by_second, by_output]) =
            ([FIRST, SECOND].map(tiles), [FIRST, SECOND, OUTPUT].map(by));
        let folded = output.start..third_bias.end;
        let by_frame_sums = &mut self.by_frame_sums;
        let ranges = [statics, shared, first_bias, hidden, second_bias, output, third_bias];
        let [statics, shared, first_bias, hidden, second_bias, output, third_bias] =
            parts(&mut self.found, ranges);
        let of_strands = || {
            weight_gradient_of_panels(simd, &own, &by_statics, [shape.statics, width], statics);
            bias_gradient_of_panels(&by_statics, first_bias);
        };
        let of_frames = || {
            // Two frames a packet and moment.
            *by_frame_sums = by_first.iter().flat_map(|panels| frame_gradients(panels, width)).collect();
            weight_gradient(simd, [&[inputs], &[by_frame_sums]], [shape.shared, width], shared);
        };
        let of_hidden = || {
            weight_gradient_of_panels(simd, &first, &by_second, [width, width], hidden);
            bias_gradient_of_panels(&by_second, second_bias);
        };
        let of_output = || {
            weight_gradient_of_panels(simd, &second, &by_output, [width, shape.outputs], output);
            bias_gradient_of_panels(&by_output, third_bias);
        };
        rayon::join(|| rayon::join(of_hidden, of_strands), || rayon::join(of_output, of_frames));
        if let Some(basis) = basis {
            let rows = self.found[folded].par_chunks_exact_mut(OUTPUTS).with_min_len(FOLDED);
            rows.for_each(|row| unfold(row, basis));
        }
    }
}

impl StepWeights {
    fn new(network: &Network<f32>, basis: Option<&Basis>) -> Self {
        let [statics, _, _, hidden, _, output, bias] = network.parts();
        let width = network.shape().width;
        let (mut last, mut output_bias) = (output.to_vec(), bias.to_vec());
        if let Some(basis) = basis {
            let rows = last.par_chunks_exact_mut(OUTPUTS).with_min_len(FOLDED);
            rows.for_each(|row| fold(row, basis));
            fold(&mut output_bias, basis);
        }
        let (hidden, output) = rayon::join(
            || [tile_by_tile(hidden, width), transposed_by_tiles(hidden, width)],
            || [tile_by_tile(&last, OUTPUTS), transposed_by_tiles(&last, OUTPUTS)],
        );
        let ([hidden, hidden_transposed], [output, output_transposed]) = (hidden, output);
        let statics = tile_by_tile(statics, width);
        Self { statics, hidden, hidden_transposed, output, output_transposed, output_bias }
    }
}

/// The gradient with respect to o from that with respect to u = ½ B o.
pub(crate) fn unfold(by: &mut [f32], basis: &Basis) {
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

/// The first `count` inputs of all frames of a step, packet by packet and moment by moment:
/// `[frames, count]`.
pub(super) fn frame_inputs(set: &TrainingSet, drawn: &[Drawn; FRAMES], count: usize) -> Vec<f32> {
    let mut inputs = Vec::with_capacity(FRAMES * MOMENTS * count);
    for drawn in drawn.chunks_exact(FRAMES_OF_PACKET) {
        for ago in 0..MOMENTS {
            for d in drawn {
                inputs.extend_from_slice(&shared_inputs(&set.clips[d.clip], d.frame - ago)[..count]);
            }
        }
    }
    inputs
}

/// Sums over the strands of each frame of a packet: `[frames, width]`.
fn frame_gradients(by_first: &[Row<f32>], width: usize) -> Vec<f32> {
    let mut sums = vec![0.0; FRAMES_OF_PACKET * width];
    for (frame, sums) in sums.chunks_exact_mut(width).enumerate() {
        for (sums, panel) in sums.chunks_mut(LANES).zip(by_first.chunks_exact(PACKET)) {
            for row in &panel[frame * STRANDS..][..STRANDS] {
                sums.iter_mut().zip(row.0).for_each(|(sum, x)| *sum += x);
            }
        }
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
        for ago in 0..MOMENTS {
            self.layers(number, ago, buffers);
        }
        buffers.energy = 0.0;
        let aims = Aims { simd: self.simd, goal: self.goal, set: self.set, strands: BATCH };
        let between = self.between(drawn, &rest, buffers);
        for (row, rest) in rest.chunks_exact(LANES).enumerate() {
            let mut outputs =
                buffers.moments.each_mut().map(|moment| &mut moment.outputs[row * OUTPUTS..][..OUTPUTS]);
            let (frame, first_strand) = (row * LANES / STRANDS, row * LANES % STRANDS);
            let weights = &drawn[frame].weights[first_strand..][..LANES];
            let (drawn, between) = (&drawn[frame], between[frame].as_slice());
            let of_row = OfRow { drawn, rest, first_strand, weights, between };
            buffers.energy += aims.row(&of_row, &mut outputs);
        }
        self.back(buffers);
    }

    /// What the strands of each frame of a packet do to each other at the moments that count; empty
    /// without repulsion and adhesion.
    fn between(
        &self,
        drawn: &[Drawn],
        rest: &[&[[f32; 3]; PARTICLES]],
        buffers: &PacketBuffers,
    ) -> [Vec<Between>; FRAMES_OF_PACKET] {
        let energies = &self.goal.energies;
        if !energies.have_neighbours() {
            return [const { Vec::new() }; FRAMES_OF_PACKET];
        }
        std::array::from_fn(|frame| {
            let neighbourhood = Neighbourhood::new(energies, self.set, &drawn[frame]);
            let own = frame * STRANDS..(frame + 1) * STRANDS;
            let moment = |ago: usize| {
                let outputs = &buffers.moments[ago].outputs;
                let strands = own.clone().zip(&rest[own.clone()]);
                let x: Vec<[f32; 3]> = strands.flat_map(|(s, rest)| self.strand(outputs, s, rest)).collect();
                neighbourhood.at(&x)
            };
            (0..self.goal.samples()).map(moment).collect()
        })
    }

    /// Strand `s` of a packet with these `outputs`.
    fn strand(&self, outputs: &[Row<f32>], s: usize, rest: &[[f32; 3]; PARTICLES]) -> [[f32; 3]; PARTICLES] {
        type One = Pack<1, BASELINE_FMA>;
        let at_rest: Strand<One> = rest.map(|x| V3(x.map(One::splat)));
        let output = |k: usize| One::splat(outputs[s / LANES * OUTPUTS + k].0[s % LANES]);
        let u = std::array::from_fn(|i| V3(std::array::from_fn(|c| output(3 * i + c))));
        Head::new(self.goal.head, &at_rest).strand(&at_rest, &u).map(|x| x.get(0))
    }

    /// The first layer's sums of a packet's strands.
    fn static_sums(&self, drawn: &[Drawn], buffers: &mut PacketBuffers) {
        let strands = drawn.iter().flat_map(|d| d.strands);
        for (strand, to) in strands.zip(buffers.statics.chunks_exact_mut(STATICS)) {
            to.copy_from_slice(&self.set.strands[strand].statics);
        }
        to_panels(buffers.statics.chunks_exact(STATICS), &mut buffers.static_panels);
        to_tiles(&buffers.statics, STATICS, &mut buffers.static_tiles);
        let [_, _, bias, ..] = self.network.parts();
        let factors = Factors { a: &self.weights.statics, columns: bias.len(), b: &buffers.static_panels };
        product(self.simd, factors, Start::Bias(bias), &mut buffers.sums);
    }

    /// The layers of packet `number`, `ago` frames before.
    fn layers(&self, number: usize, ago: usize, buffers: &mut PacketBuffers) {
        const ROWS_OF_FRAME: usize = STRANDS / LANES;
        let width = self.network.shape().width;
        let moment = &mut buffers.moments[ago];
        let panels = moment.first.chunks_exact_mut(width).zip(buffers.sums.chunks_exact(width));
        for (panel, (first, sums)) in panels.enumerate() {
            let frame = (number * MOMENTS + ago) * FRAMES_OF_PACKET + panel / ROWS_OF_FRAME;
            let shared = &self.frames[frame * width..][..width];
            for ((first, sums), shared) in first.iter_mut().zip(sums).zip(shared) {
                first.0 = sums.0.map(|sum| (sum + shared).max(0.0));
            }
        }
        let [.., second_bias, _, _] = self.network.parts();
        let factors = Factors { a: &self.weights.hidden, columns: width, b: &moment.first };
        product(self.simd, factors, Start::BiasRelu(second_bias), &mut moment.second);
        let factors = Factors { a: &self.weights.output, columns: OUTPUTS, b: &moment.second };
        product(self.simd, factors, Start::Bias(&self.weights.output_bias), &mut moment.outputs);
    }

    /// From the gradient with respect to the outputs, which is in their place, to those of the sums
    /// of all layers, and all that the weights' gradients need in the order of their products.
    fn back(&self, buffers: &mut PacketBuffers) {
        let (width, weights) = (self.network.shape().width, self.weights);
        let PacketBuffers { moments, by_second, by_first, by_statics, .. } = buffers;
        by_statics.fill(Row::zeroed());
        for MomentBuffers { first, second, outputs, tiles, by } in moments {
            let factors = Factors { a: &weights.output_transposed, columns: width, b: outputs };
            product(self.simd, factors, Start::Zero, by_second);
            mask_rows(second, by_second);
            let factors = Factors { a: &weights.hidden_transposed, columns: width, b: by_second };
            product(self.simd, factors, Start::Zero, by_first);
            mask_rows(first, by_first);
            [&*first, second].into_iter().zip(tiles).for_each(|(x, to)| strands_by_tiles(x, to));
            [&*by_first, by_second, outputs]
                .into_iter()
                .zip(&mut *by)
                .for_each(|(x, to)| units_in_lanes(x, to));
            let sums: &mut [f32] = bytemuck::cast_slice_mut(by_statics);
            sums.iter_mut().zip(bytemuck::cast_slice(&by[FIRST])).for_each(|(sum, x): (_, &f32)| *sum += x);
        }
    }
}

/// What the strands of a step are to do.
#[derive(Clone, Copy)]
pub(crate) struct Aims<'a> {
    /// An instruction set that this processor supports.
    pub simd: Simd,
    pub goal: &'a Goal,
    pub set: &'a TrainingSet,
    /// Strands of all windows of the step.
    pub strands: usize,
}

/// Sixteen strands of a frame.
pub(crate) struct OfRow<'a> {
    /// The clip, the frame and the number of the drapes; not the strands.
    pub drawn: &'a Drawn,
    /// The strands at rest.
    pub rest: &'a [&'a [[f32; 3]; PARTICLES]],
    /// The number of the first of them in the frame.
    pub first_strand: usize,
    /// What each counts for.
    pub weights: &'a [f32],
    /// What the strands of the frame do to each other, at each moment; may be empty.
    pub between: &'a [Between],
}

impl Aims<'_> {
    /// The share of sixteen strands in the mean of a step; the outputs at each moment, `[72]` rows,
    /// are replaced by the gradient with respect to them.
    pub(crate) fn row(&self, of_row: &OfRow<'_>, outputs: &mut [&mut [Row<f32>]; MOMENTS]) -> f64 {
        let simd = self.simd;
        let run = on!(simd, energies(aims: &Aims<'_>, of_row: &OfRow<'_>, outputs: &mut [&mut [Row<f32>]; MOMENTS]) -> f64);
        // SAFETY: trainers have checked that the instruction set is supported.
        #[allow(
            unused_unsafe,
            clippy::allow_attributes,
            reason = "only instantiations with features are unsafe"
        )]
        unsafe {
            run(self, of_row, outputs)
        }
    }
}

/// Strands in lanes.
#[inline(always)]
fn load<L: Lane<Scalar = f32>>(strands: &[[[f32; 3]; PARTICLES]]) -> Strand<L> {
    let mut x: Strand<L> = zero();
    for (lane, strand) in strands.iter().enumerate() {
        for (x, own) in x.iter_mut().zip(strand) {
            x.set(lane, *own);
        }
    }
    x
}

/// [`Aims::row`] in lanes.
#[inline(always)]
fn energies<L: Lane<Scalar = f32>>(
    aims: &Aims<'_>,
    of_row: &OfRow<'_>,
    outputs: &mut [&mut [Row<f32>]; MOMENTS],
) -> f64 {
    let OfRow { drawn, rest, first_strand, weights, between } = of_row;
    let clip = &aims.set.clips[drawn.clip];
    let newest = &clip[drawn.frame];
    let mut places = [Place { rotation: Mat3::splat(newest.rotation), origin: V3::<L>::zero() }; MOMENTS];
    let mut bodies = [Bust { field: &aims.set.field, parts: &newest.parts }; MOMENTS];
    for ago in 1..MOMENTS {
        let frame = &clip[drawn.frame - ago];
        places[ago].rotation = Mat3::splat(frame.rotation);
        places[ago].origin = V3::splat(frame.origin - newest.origin);
        bodies[ago].parts = &frame.parts;
    }
    let goal = aims.goal;
    let mean = 1.0 / (aims.strands * goal.samples()) as f64;
    let mut sum = 0.0;
    for first in (0..LANES).step_by(L::WIDTH) {
        let mut at_rest: Strand<L> = zero();
        for (i, x) in at_rest.iter_mut().enumerate() {
            for lane in 0..L::WIDTH {
                x.set(lane, rest[first + lane][i]);
            }
        }
        let shape = RestStrand::new(&at_rest, &goal.energies.elastic);
        let head = Head::new(goal.head, &at_rest);
        let mut u = [[V3::<L>::zero(); EDGES]; MOMENTS];
        let mut x = [zero::<L>(); MOMENTS];
        for ago in 0..MOMENTS {
            for k in 0..OUTPUTS {
                u[ago][k / 3].0[k % 3] = L::load(&outputs[ago][k], first);
            }
            x[ago] = head.strand(&at_rest, &u[ago]);
        }
        let mut by_x = [zero::<L>(); MOMENTS];
        let (at_rest, shape) = (&at_rest, &shape);
        let neighbours = Neighbours { moments: between, first: first_strand + first };
        let drapes = drawn.drape.zip(aims.set.drapes.as_ref()).map(|(number, drapes)| {
            let strand = first_strand + first;
            drapes.of(number).each_ref().map(|moment| load::<L>(&moment[strand..][..L::WIDTH]))
        });
        let drapes = drapes.as_ref();
        let window = Window { goal, at_rest, shape, places: &places, bodies: &bodies, neighbours, drapes };
        let energy = window.energy(&x, &mut by_x);
        let mut share = L::zero();
        for lane in 0..L::WIDTH {
            share.set(lane, weights[first + lane] * mean as f32);
            sum += f64::from(energy.get(lane)) * f64::from(share.get(lane));
        }
        for ago in 0..MOMENTS {
            let by_u = head.gradient(&u[ago], &by_x[ago]);
            for k in 0..OUTPUTS {
                let by = by_u[k / 3].0[k % 3] * share;
                by.store(&mut outputs[ago][k], first);
            }
        }
    }
    sum
}
