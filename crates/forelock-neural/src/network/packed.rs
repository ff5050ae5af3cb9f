//! Inference for the strands of a simulation: packed, with any numbers of particles.
//!
//! # Theory
//! The network sees each strand with [`PARTICLES`](crate::PARTICLES) particles, and its rotation
//! head gives the rotations u of their 24 edges. The edge of a strand with other particles takes u
//! at its middle: linear in the arc length between the middles of the network's edges, constant
//! before the first and beyond the last one. It is rotated by the same formula
//! ([`rotate`](super::rotation::rotate)), so a strand of any number of particles keeps its lengths.
//!
//! The displacement head gives o at the ends of the 24 edges. A particle takes o at its own arc
//! length s, likewise linear between those ends, and goes to X + s o.
//!
//! # Practice
//! A packet is four consecutive blocks of the core's
//! [`Model`], whose strands have equal numbers of particles; results
//! are written in the rows of its order. The weights of the interpolation are stored a lane, so
//! strands of a block may differ in the spacing of their particles. A strand of
//! [`PARTICLES`](crate::PARTICLES) particles whose edges are about equally long
//! ([`is_even`]) is the network's own, and takes its rotations as they are.
//!
//! Threads halve the list of packets; nothing is allocated, and no result depends on which thread
//! ran which packet.

use super::head::OutputHead;
use super::inference::{Activations, CountError, Predictor};
use super::product::{Factors, PANELS, Start, product, tile_by_tile, to_panels, zero_panels};
use super::rotation::turn;
use super::{OUTPUTS, Shape, add_layer};
use crate::EDGES;
use bytemuck::Zeroable;
use forelock_core::lane::{LANES, Lane, Mat3, Row, Simd, V3, on};
use forelock_core::pose::Pose;
use forelock_core::strands::{Block, Model};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

/// The range of an edge's length over the mean of its strand in which edges are about equally long.
const EVEN: std::ops::RangeInclusive<f64> = 0.5..=2.0;

/// Whether a strand with edges of these `lengths` is the network's own: as many edges as the
/// network's, each half to twice as long as their mean.
pub fn is_even(lengths: &[f64]) -> bool {
    let mean = lengths.iter().sum::<f64>() / EDGES as f64;
    lengths.len() == EDGES && lengths.iter().all(|length| EVEN.contains(&(length / mean)))
}

/// What the network needs of the strands of a simulation: computed once a groom.
#[derive(Clone, Debug)]
pub struct PackedStrands {
    /// The first layer's sums: `[width]` rows for every 16 strands, padded to whole packets.
    sums: Vec<Row<f32>>,
    blocks: Vec<PackedBlock>,
    blends: Vec<Blend>,
    /// A row for each of the network's edges that a blend takes.
    weights: Vec<Row<f32>>,
    places: usize,
}

/// A block of the simulation.
#[derive(Clone, Debug)]
struct PackedBlock {
    /// Place of the first particle.
    first: usize,
    /// Particles of a strand.
    particles: usize,
    /// One an edge; none where all strands are the network's own.
    blends: Range<usize>,
}

/// The network's edges whose outputs an edge of sixteen strands takes.
#[derive(Clone, Copy, Debug)]
pub struct Blend {
    /// The first of them.
    pub first: u32,
    /// How many there are.
    pub count: u32,
    /// The place of the first one's weights.
    pub weights: u32,
}

impl PackedStrands {
    /// Bytes held.
    pub fn bytes(&self) -> usize {
        let rows = size_of_val(&*self.sums) + size_of_val(&*self.weights);
        rows + size_of_val(&*self.blocks) + size_of_val(&*self.blends)
    }

    /// The first layer's sums of strands with its bias: `[width]` rows for each block, and for
    /// blocks that pad the last packet to four.
    pub fn sums(&self) -> &[Row<f32>] {
        &self.sums
    }

    /// For each block where its blends begin, one an edge; none where its edges are the network's.
    pub fn blend_starts(&self) -> impl Iterator<Item = Option<u32>> {
        let start = |block: &PackedBlock| (!block.blends.is_empty()).then_some(block.blends.start as u32);
        self.blocks.iter().map(start)
    }

    /// The blends of all blocks that have some.
    pub fn blends(&self) -> impl Iterator<Item = Blend> {
        self.blends.iter().copied()
    }

    /// Their weights: a row for each edge that a blend takes.
    pub fn blend_weights(&self) -> &[Row<f32>] {
        &self.weights
    }

    /// Adds the weights of the edges of `block`, whose strands have `places`: where their edges lie
    /// among the network's, `[edge]` for each lane.
    fn add_block(&mut self, block: &Block, places: &[Vec<f64>; LANES]) {
        let start = (self.blends.len(), self.weights.len());
        let mut is_own = block.particles == crate::PARTICLES;
        for edge in 0..block.particles - 1 {
            let of_lanes = places.each_ref().map(|places| places[edge]);
            let first = of_lanes.into_iter().fold(f64::INFINITY, f64::min).floor() as usize;
            let end = of_lanes.into_iter().fold(0.0, f64::max).ceil() as usize;
            is_own &= first == edge && end == edge;
            self.blends.push(Blend {
                first: first as u32,
                count: (end + 1 - first) as u32,
                weights: self.weights.len() as u32,
            });
            for own in first..=end {
                let weight = |place: f64| (1.0 - (place - own as f64).abs()).max(0.0) as f32;
                self.weights.push(Row(of_lanes.map(weight)));
            }
        }
        if is_own {
            self.blends.truncate(start.0);
            self.weights.truncate(start.1);
        }
        let blends = start.0..self.blends.len();
        self.blocks.push(PackedBlock { first: block.first, particles: block.particles, blends });
    }
}

/// Where the edges of these `lengths` lie among the network's, 0 to 23: their middles for
/// rotations, their ends for displacements.
fn places(head: OutputHead, lengths: &[f64]) -> Vec<f64> {
    if is_even(lengths) {
        return (0..EDGES).map(|edge| edge as f64).collect();
    }
    let share = match head {
        OutputHead::Rotation => 0.5,
        OutputHead::Displacement => 1.0,
    };
    let whole = lengths.iter().sum::<f64>();
    let mut end = 0.0;
    let place = |length: &f64| {
        let place = end + share * length;
        end += length;
        (place / whole * EDGES as f64 - share).clamp(0.0, (EDGES - 1) as f64)
    };
    lengths.iter().map(place).collect()
}

/// Buffers of [`Predictor::predict_packed`], a set a thread.
#[derive(Debug)]
pub struct Workspace {
    /// The first layer's sums of the frame.
    frame: Vec<f32>,
    /// Each behind a lock that only its thread takes.
    activations: Vec<Mutex<Activations>>,
}

/// Strands of a simulation in a frame.
#[derive(Clone, Copy, Debug)]
pub struct PackedFrame<'a> {
    /// The network's inputs of the frame, `[shared]`.
    pub shared: &'a [f32],
    /// The strands at rest, in the axes of canonical space: `[3 × places]` rows of
    /// [`Model::rest`]. They may have any unit and origin.
    pub rest: &'a [Row<f32>],
    /// From the space of `rest` to that of the results.
    pub pose: Pose,
}

impl Predictor {
    /// Prepares the strands of `model`; `statics` are the inputs of each strand in the groom's
    /// order, `[strands, statics]`.
    ///
    /// # Errors
    /// If there are not as many inputs as strands.
    pub fn prepare_packed(&self, model: &Model<f32>, statics: &[f32]) -> Result<PackedStrands, CountError> {
        let Shape { statics: inputs, width, .. } = *self.network.shape();
        if statics.len() != inputs * model.strand_count {
            return Err(CountError { rest: model.strand_count, inputs: statics.len() / inputs });
        }
        let [matrix, _, bias, ..] = self.network.parts();
        let tiles = tile_by_tile(matrix, width);
        let packets = model.blocks.len().div_ceil(PANELS);
        let mut own = PackedStrands {
            sums: vec![Row::zeroed(); packets * width * PANELS],
            blocks: Vec::with_capacity(model.blocks.len()),
            blends: Vec::new(),
            weights: Vec::new(),
            places: model.places(),
        };
        own.sums.par_chunks_exact_mut(width * PANELS).zip(model.blocks.par_chunks(PANELS)).for_each(
            |(sums, blocks)| {
                let strands = blocks.iter().flat_map(|block| block.strands);
                let mut panels = zero_panels(inputs);
                to_panels(strands.map(|s| &statics[inputs * s as usize..][..inputs]), &mut panels);
                let factors = Factors { a: &tiles, columns: width, b: &panels };
                product(self.simd, factors, Start::Bias(bias), sums);
            },
        );
        for block in &model.blocks {
            let of_lane = |lane: usize| {
                let length = |i: usize| f64::from(model.rest_lengths[3 * (block.first + i)].0[lane]);
                places(self.head, &(0..block.particles - 1).map(length).collect::<Vec<_>>())
            };
            own.add_block(block, &std::array::from_fn(of_lane));
        }
        Ok(own)
    }

    /// Buffers for [`Self::predict_packed`] on the threads of the current pool.
    pub fn workspace(&self) -> Workspace {
        let width = self.network.shape().width;
        let threads = rayon::current_num_threads().max(1);
        let activations = (0..threads).map(|_| Mutex::new(Activations::new(width))).collect();
        Workspace { frame: vec![0.0; width], activations }
    }

    /// Writes the positions of `strands` in `frame` to `out`, `[3 × places]` rows as in the
    /// simulation's model. A prediction that is not finite gives positions that are not.
    ///
    /// # Panics
    /// If `frame` or `out` has another length than the network's inputs or the strands.
    pub fn predict_packed(
        &self,
        strands: &PackedStrands,
        frame: &PackedFrame<'_>,
        workspace: &mut Workspace,
        out: &mut [Row<f32>],
    ) {
        assert_eq!(frame.shared.len(), self.network.shape().shared, "inputs of a frame");
        assert_eq!(frame.rest.len(), 3 * strands.places, "rows at rest");
        assert_eq!(out.len(), 3 * strands.places, "rows of positions");
        workspace.frame.fill(0.0);
        add_layer(self.network.parts()[1], frame.shared, &mut workspace.frame);
        let run = Run { predictor: self, strands, frame, workspace };
        run.halve(0..strands.blocks.len().div_ceil(PANELS), out);
    }
}

/// A frame of packed strands.
struct Run<'a> {
    predictor: &'a Predictor,
    strands: &'a PackedStrands,
    frame: &'a PackedFrame<'a>,
    workspace: &'a Workspace,
}

impl Run<'_> {
    /// Runs `packets`, whose places are in `out`.
    fn halve(&self, packets: Range<usize>, out: &mut [Row<f32>]) {
        let first = |packet: usize| self.strands.blocks[PANELS * packet].first;
        match packets.len() {
            0 => {}
            1 => self.packet(packets.start, out),
            count => {
                let middle = packets.start + count / 2;
                let (left, right) = out.split_at_mut(3 * (first(middle) - first(packets.start)));
                rayon::join(
                    || self.halve(packets.start..middle, left),
                    || self.halve(middle..packets.end, right),
                );
            }
        }
    }

    fn packet(&self, packet: usize, out: &mut [Row<f32>]) {
        let Self { predictor, strands, frame, workspace } = self;
        let sums = workspace.frame.len() * PANELS;
        let worker = rayon::current_thread_index().unwrap_or(0) % workspace.activations.len();
        let mut activations = workspace.activations[worker].lock().unwrap_or_else(PoisonError::into_inner);
        predictor.layers(&workspace.frame, &strands.sums[packet * sums..][..sums], &mut activations);
        let blocks = &strands.blocks[PANELS * packet..];
        let mut out = out;
        for (block, outputs) in blocks.iter().zip(activations.outputs.chunks_exact(OUTPUTS)) {
            let (own, rest) = std::mem::take(&mut out).split_at_mut(3 * block.particles);
            let edges = Edges {
                head: predictor.head,
                rest: &frame.rest[3 * block.first..][..3 * block.particles],
                blends: &strands.blends[block.blends.clone()],
                weights: &strands.weights,
                outputs,
                pose: frame.pose,
            };
            place(predictor.simd, &edges, own);
            out = rest;
        }
    }
}

/// What the positions of a block follow from.
#[derive(Debug)]
struct Edges<'a> {
    head: OutputHead,
    rest: &'a [Row<f32>],
    blends: &'a [Blend],
    weights: &'a [Row<f32>],
    /// The network's outputs, `[72]`.
    outputs: &'a [Row<f32>],
    pose: Pose,
}

impl Edges<'_> {
    /// The network's output of its edge `k`.
    #[inline(always)]
    fn own_output<L: Lane<Scalar = f32>>(&self, k: usize, first: usize) -> V3<L> {
        V3::load(self.outputs, k, first)
    }

    /// The output of edge `i`.
    #[inline(always)]
    fn output<L: Lane<Scalar = f32>>(&self, i: usize, first: usize) -> V3<L> {
        if self.blends.is_empty() {
            return self.own_output(i, first);
        }
        let blend = self.blends[i];
        let weights = &self.weights[blend.weights as usize..][..blend.count as usize];
        let mut o = V3::zero();
        for (k, weight) in (blend.first as usize..).zip(weights) {
            o = o.add_scaled(L::load(weight, first), self.own_output(k, first));
        }
        o
    }
}

/// Positions of the strands of a block.
fn place(simd: Simd, edges: &Edges<'_>, out: &mut [Row<f32>]) {
    let run = on!(simd, place_lanes(edges: &Edges<'_>, out: &mut [Row<f32>]));
    // SAFETY: `Predictor::displacing` has checked that the instruction set is supported.
    #[allow(unused_unsafe, clippy::allow_attributes, reason = "only instantiations with features are unsafe")]
    unsafe {
        run(edges, out);
    }
}

/// [`place`] in lanes. Edges are turned one by one, so that rounding far from the root does not
/// change their lengths.
#[inline(always)]
fn place_lanes<L: Lane<Scalar = f32>>(edges: &Edges<'_>, out: &mut [Row<f32>]) {
    let particles = out.len() / 3;
    let (rotation, origin) = (Mat3::<L>::splat(edges.pose.matrix()), V3::splat(edges.pose.translation));
    for first in (0..LANES).step_by(L::WIDTH) {
        let mut before = V3::load(edges.rest, 0, first);
        let mut x = origin.add_mul(&rotation, before);
        x.store(out, 0, first);
        let mut arc = L::zero();
        for i in 1..particles {
            let rest = V3::load(edges.rest, i, first);
            let (edge, o) = (rest - before, edges.output(i - 1, first));
            x = match edges.head {
                OutputHead::Rotation => x.add_mul(&rotation, edge + turn(o, edge)),
                OutputHead::Displacement => {
                    arc += edge.dot(edge).sqrt();
                    origin.add_mul(&rotation, rest.add_scaled(arc, o))
                }
            };
            x.store(out, i, first);
            before = rest;
        }
    }
}
