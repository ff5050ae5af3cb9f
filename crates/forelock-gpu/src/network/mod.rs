//! A network that moves strands (Neuralocks, 2025): it writes the targets that strands under
//! [`PrescribedParams`](forelock_core::solver::PrescribedParams) go to.
//!
//! # Theory
//! Outputs of a strand are W₃ᵀ relu(W₂ᵀ relu(s + f) + b₂) + b₃ with the first layer's sums s of
//! the strand, computed once a groom, and f of the frame, computed on the CPU in each one. An edge
//! is turned by its outputs, or a particle displaced; strands of other numbers of particles than
//! the network's blend the outputs of its edges.
//!
//! # Practice
//! `layers.wgsl` computes both layers of a packet of 64 strands, four blocks, in one kernel; the
//! activations between them stay in registers and workgroup memory. `place.wgsl` places strands. A
//! strand takes 1,024 bytes of sums, half of that in float16, and 288 of outputs, which batches use
//! one after the other.
//!
//! # Limitations
//! Networks of 256 units and 72 outputs.

use crate::batch::DeviceStrands;
use crate::kernel::{Bound, Constant, DispatchList, Shader, Threads, bindings, shader};
use crate::uniforms::{FrameUniform, rigid};
use crate::{Gpu, GpuError, GpuSimulation};
use bytemuck::{Pod, Zeroable};
use forelock_core::lane::{LANES, Row};
use forelock_core::pose::Pose;
use glam::Mat4;
use wgpu::BufferUsages;

/// Units of both hidden layers.
pub const WIDTH: usize = 256;
/// Outputs: three for each of the network's 24 edges.
pub const OUTPUTS: usize = 72;
/// Blocks of a packet.
const PACKET: usize = 4;
/// The start of the blends of a block whose edges are the network's.
const OWN: u32 = u32::MAX;

/// A network and what it knows of the strands of a simulation. Matrices are `[inputs, outputs]`.
#[derive(Clone, Copy, Debug)]
pub struct StrandNetwork<'a> {
    /// Weights of the second layer, `[256, 256]`.
    pub hidden: &'a [f32],
    /// Its bias, `[256]`.
    pub hidden_bias: &'a [f32],
    /// Weights of the last layer, `[256, 72]`.
    pub output: &'a [f32],
    /// Its bias, `[72]`.
    pub output_bias: &'a [f32],
    /// Whether outputs are displacements; else they are rotations.
    pub displaces: bool,
    /// The first layer's sums of strands with its bias: `[256]` rows for each block of the model,
    /// and for blocks that pad the last packet to four.
    pub sums: &'a [Row<f32>],
    /// For each block where its blends begin, one an edge; none where its edges are the network's.
    pub blend_starts: &'a [Option<u32>],
    /// The network's edges that edges take.
    pub blends: &'a [BlendEntry],
    /// A row for each edge that a blend takes.
    pub blend_weights: &'a [Row<f32>],
}

/// The network's edges whose outputs an edge of sixteen strands takes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct BlendEntry {
    /// The first of them.
    pub first: u32,
    /// How many there are.
    pub count: u32,
    /// The first row of their weights.
    pub weights: u32,
}

/// How outputs become positions.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct PlacingUniform {
    /// From rest positions to positions relative to the frame's origin.
    pub pose: Mat4,
    /// Whether outputs are displacements.
    pub displaces: u32,
    /// Padding.
    pub pad_0: [u32; 3],
}

bindings! {
    /// The layers of a network.
    pub(crate) struct LayerBindings {
        41 strand_sums: read,
        42 frame_sums: read,
        43 weights: read,
        44 biases: read,
        45 outputs: read_write,
    }
}

bindings! {
    /// Outputs of a network and the targets of strands.
    pub(crate) struct PlaceBindings {
        0 frame: uniform(FrameUniform),
        2 blocks: read,
        3 model: read,
        35 channels: read_write,
        40 placing: uniform(PlacingUniform),
        45 outputs: read,
        46 blend_starts: read,
        47 blends: read,
        48 blend_weights: read,
    }
}

const SIZES: &[Constant] = &[Constant::u32("WIDTH", WIDTH as u32)];

shader! {
    /// The layers with weights in 32 bits.
    LAYERS: "predict_strands", LayerBindings;
    texts: [include_str!("single.wgsl"), include_str!("layers.wgsl")];
    constants: [SIZES];
    kernels: {
        /// The outputs of 64 strands a workgroup.
        PREDICT_OUTPUTS: "predict_outputs", Threads::Strands;
    }
}

shader! {
    /// The layers with weights in 16 bits.
    LAYERS_HALVED: "predict_strands", LayerBindings;
    texts: [include_str!("half.wgsl"), include_str!("layers.wgsl")];
    constants: [SIZES];
    kernels: {
        /// The outputs of 64 strands a workgroup.
        PREDICT_OUTPUTS_HALVED: "predict_outputs", Threads::Strands;
    }
}

shader! {
    /// Targets from outputs.
    PLACE: "predict_strands", PlaceBindings;
    texts: [include_str!("place.wgsl")];
    constants: [];
    kernels: {
        /// Places a strand a thread.
        PLACE_STRANDS: "place_strands", Threads::Strands;
    }
}

pub(crate) static SHADERS: &[&Shader] = &[&LAYERS, &LAYERS_HALVED, &PLACE];

/// The part of a batch.
#[derive(Debug)]
struct BatchPart {
    sums: wgpu::Buffer,
    starts: wgpu::Buffer,
}

/// A network on the device.
#[derive(Debug)]
pub(crate) struct DeviceNetwork {
    halved: bool,
    displaces: bool,
    weights: wgpu::Buffer,
    biases: wgpu::Buffer,
    frame_sums: wgpu::Buffer,
    placing: wgpu::Buffer,
    outputs: wgpu::Buffer,
    blends: wgpu::Buffer,
    blend_weights: wgpu::Buffer,
    parts: Vec<BatchPart>,
    layers: Vec<Bound<LayerBindings<'static>>>,
    places: Vec<Bound<PlaceBindings<'static>>>,
    /// Whether the next frame predicts.
    is_due: bool,
}

/// `numbers` for the device, in 32 or 16 bits.
fn stored(numbers: &[f32], halved: bool) -> Vec<u8> {
    if !halved {
        return bytemuck::cast_slice(numbers).to_vec();
    }
    numbers.iter().flat_map(|x| half::f16::from_f32(*x).to_le_bytes()).collect()
}

/// Rows of [`OUTPUTS`] numbers, in threes of which each is followed by a zero.
fn in_quads(rows: &[f32]) -> Vec<f32> {
    rows.chunks_exact(3).flat_map(|three| [three[0], three[1], three[2], 0.0]).collect()
}

impl DeviceNetwork {
    fn new(
        gpu: &Gpu,
        strands: DeviceStrands<'_>,
        network: &StrandNetwork<'_>,
        halved: bool,
    ) -> Result<Self, GpuError> {
        let sizes =
            [network.hidden, network.hidden_bias, network.output, network.output_bias].map(<[f32]>::len);
        let packets = strands.model.blocks.len().div_ceil(PACKET);
        if sizes != [WIDTH * WIDTH, WIDTH, WIDTH * OUTPUTS, OUTPUTS]
            || network.sums.len() != packets * WIDTH * PACKET
            || network.blend_starts.len() != strands.model.blocks.len()
        {
            return Err(GpuError::Unsupported { what: "a network without 256 units and 72 outputs" });
        }
        let storage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
        let rows = |rows: &[Row<f32>]| bytemuck::cast_slice::<_, f32>(rows).to_vec();
        let weights = [network.hidden, &in_quads(network.output)].concat();
        let biases = [network.hidden_bias, &in_quads(network.output_bias)].concat();
        let mut parts = Vec::with_capacity(strands.batches.len());
        let mut most = 0;
        for batch in strands.batches {
            let blocks = batch.blocks_range();
            let packets = blocks.len().div_ceil(PACKET);
            most = most.max(packets);
            let mut sums = vec![0.0f32; packets * WIDTH * PACKET * LANES];
            for (own, block) in blocks.clone().enumerate() {
                for k in 0..WIDTH {
                    let from = network.sums[block * WIDTH + k];
                    let to = ((own / PACKET * WIDTH + k) * PACKET + own % PACKET) * LANES;
                    sums[to..to + LANES].copy_from_slice(&from.0);
                }
            }
            let sums = stored(&sums, halved);
            gpu.check_room("the network's sums of strands", sums.len() as u64, gpu.most_bound())?;
            let starts: Vec<u32> =
                network.blend_starts[blocks].iter().map(|own| own.unwrap_or(OWN)).collect();
            parts.push(BatchPart {
                sums: gpu.filled("sums of strands", &sums, storage),
                starts: gpu.filled("starts of blends", bytemuck::cast_slice(&starts), storage),
            });
        }
        // WebGPU has no empty bindings.
        let blends = [network.blends, &[BlendEntry::default()]].concat();
        let blend_weights = [rows(network.blend_weights), vec![0.0; LANES]].concat();
        let bytes = 4 * (most * OUTPUTS * PACKET * LANES) as u64;
        gpu.check_room("the network's outputs", bytes, gpu.most_bound())?;
        let blend_bytes = bytemuck::cast_slice(&blend_weights);
        gpu.check_room("the weights of blends", 4 * blend_weights.len() as u64, gpu.most_bound())?;
        let uniform = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
        Ok(Self {
            halved,
            displaces: network.displaces,
            weights: gpu.filled("weights", &stored(&weights, halved), storage),
            biases: gpu.filled("biases", bytemuck::cast_slice(&biases), storage),
            frame_sums: gpu.buffer("sums of the frame", 4 * WIDTH as u64, storage),
            placing: gpu.buffer("placing", size_of::<PlacingUniform>() as u64, uniform),
            outputs: gpu.buffer("outputs", bytes, storage),
            blends: gpu.filled("blends", bytemuck::cast_slice(&blends), storage),
            blend_weights: gpu.filled("weights of blends", blend_bytes, storage),
            parts,
            layers: Vec::new(),
            places: Vec::new(),
            is_due: false,
        })
    }

    /// Makes its bind groups.
    pub fn bind(&mut self, gpu: &Gpu, strands: DeviceStrands<'_>) {
        let parts = || strands.batches.iter().zip(&self.parts);
        let layers = parts().map(|(batch, part)| {
            let bindings = LayerBindings {
                strand_sums: &part.sums,
                frame_sums: &self.frame_sums,
                weights: &self.weights,
                biases: &self.biases,
                outputs: &self.outputs,
            };
            bindings.bind(gpu, batch.threads)
        });
        let layers = layers.collect();
        let places = parts().map(|(batch, part)| {
            let bindings = PlaceBindings {
                frame: &strands.shared.frame,
                blocks: &batch.blocks,
                model: &batch.model,
                channels: &batch.channels,
                placing: &self.placing,
                outputs: &self.outputs,
                blend_starts: &part.starts,
                blends: &self.blends,
                blend_weights: &self.blend_weights,
            };
            bindings.bind(gpu, batch.threads)
        });
        self.places = places.collect();
        self.layers = layers;
    }

    /// Appends the prediction, if this frame has one.
    pub fn predict<'a>(&'a self, list: &mut DispatchList<'a>) {
        let kernel = if self.halved { &PREDICT_OUTPUTS_HALVED } else { &PREDICT_OUTPUTS };
        for (layers, places) in self.layers.iter().zip(&self.places).filter(|_| self.is_due) {
            list.push(layers.dispatch(kernel, &[]));
            list.push(places.dispatch(&PLACE_STRANDS, &[]));
        }
    }

    /// The frame with the prediction was recorded.
    pub fn recorded(&mut self) {
        self.is_due = false;
    }

    /// Bytes held on the device.
    pub fn bytes(&self) -> u64 {
        let own = [&self.weights, &self.biases, &self.frame_sums, &self.placing, &self.outputs];
        let blends = [&self.blends, &self.blend_weights];
        let parts = self.parts.iter().flat_map(|part| [&part.sums, &part.starts]);
        own.into_iter().chain(blends).chain(parts).map(|buffer| buffer.size()).sum()
    }
}

impl GpuSimulation {
    /// Takes a network that moves the strands, whose solver must be
    /// [`PrescribedParams`](forelock_core::solver::PrescribedParams). `halved` stores its weights
    /// and the sums of strands in 16 bits. After a change of the strands it must be given anew.
    ///
    /// # Errors
    /// [`GpuError::Unsupported`] for a network of other sizes, [`GpuError::TooLarge`] if a buffer
    /// exceeds a binding, [`GpuError::Failed`] if the device has no room.
    pub fn set_network(&mut self, network: &StrandNetwork<'_>, halved: bool) -> Result<(), GpuError> {
        if self.channels.rows() != 3 {
            return Err(GpuError::Unsupported { what: "a network under a solver without targets" });
        }
        self.network = Some(DeviceNetwork::new(&self.gpu, self.strands(), network, halved)?);
        self.rebind()
    }

    /// Predicts in the next frame: `sums` are the first layer's of the frame, `[256]`, and `pose`
    /// takes rest positions to those relative to the frame's origin
    /// ([`Model::about_centre`](forelock_core::strands::Model::about_centre)).
    ///
    /// # Panics
    /// If there are not 256 sums.
    pub fn predict(&mut self, sums: &[f32], pose: &Pose) {
        assert_eq!(sums.len(), WIDTH, "sums of a frame");
        let Some(network) = &mut self.network else { return };
        let displaces = u32::from(network.displaces);
        let placing = PlacingUniform { pose: rigid(pose), displaces, pad_0: [0; 3] };
        let queue = self.gpu.queue();
        queue.write_buffer(&network.frame_sums, 0, bytemuck::cast_slice(sums));
        queue.write_buffer(&network.placing, 0, bytemuck::bytes_of(&placing));
        network.is_due = true;
        self.channels.set_started();
    }
}
