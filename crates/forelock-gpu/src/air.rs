//! Wind fields on the device: turbulence, the wake behind solids, the shelter within hair.

use crate::Gpu;
use crate::batch::DeviceStrands;
use crate::collide::{BENDING, QueryUniform, SHAPE_CONSTANTS, Solids};
use crate::kernel::{Bound, Constant, DispatchList, Shader, Threads, bindings, shader};
use crate::uniforms::NO_EXTENT;
use bytemuck::{Pod, Zeroable};
use forelock_core::air::canopy::NODES as CANOPY_NODES;
use forelock_core::air::sample_air;
use forelock_core::air::wake::NODES as WAKE_NODES;
use forelock_core::air::{Canopy, MODES, Wake, WindField, canopy, wake};
use forelock_core::body::SHAPES_WGSL;
use forelock_core::lane::Row;
use forelock_core::strands::Model;
use glam::{DMat3, DMat4, DVec3, Mat4, UVec3, Vec3};
use wgpu::BufferUsages;

const WAKE_COUNT: u32 = WAKE_NODES.pow(3) as u32;
const CANOPY_LAYER: u32 = CANOPY_NODES.pow(2) as u32;
const CANOPY_COUNT: u32 = CANOPY_NODES.pow(3) as u32;

const CONSTANTS: &[Constant] = &[
    Constant::u32("MOST_MODES", MODES as u32),
    Constant::u32("WAKE_NODES", WAKE_NODES as u32),
    Constant::u32("CANOPY_NODES", CANOPY_NODES as u32),
    Constant::u32("CANOPY_MARGIN", canopy::MARGIN as u32),
    Constant::f32("SPREAD", wake::SPREAD),
];

bindings! {
    /// From strands and solids to the wind.
    pub(crate) struct AirBindings {
        2 blocks: read,
        3 model: read,
        5 positions: read_write,
        10 fields: read,
        11 query: dynamic(QueryUniform),
        17 wind: read_write,
        18 nodes: read_write,
        19 canopy: read_write,
        20 air: uniform(AirUniform),
    }
}

shader! {
    /// `sample_air`.
    AIR: "sample_air", AirBindings;
    texts: [SHAPES_WGSL, sample_air::WGSL];
    constants: [SHAPE_CONSTANTS, BENDING, CONSTANTS];
    kernels: {
        /// Samples the solids at the nodes of the wake.
        FILL_WAKE: "fill_wake", Threads::count(WAKE_COUNT);
        /// Marches the wind through the wake.
        MARCH_WAKE: "march_wake", Threads::ONCE;
        /// Measures the extent of the hair along the wind.
        MEASURE_CANOPY: "measure_canopy", Threads::Strands;
        /// Fits the nodes of the canopy to it.
        FIT_CANOPY: "fit_canopy", Threads::ONCE;
        /// Clears them.
        CLEAR_CANOPY: "clear_canopy", Threads::count(CANOPY_COUNT);
        /// Sums the length of hair at each node.
        SPLAT_CANOPY: "splat_canopy", Threads::Strands;
        /// Marches the wind through the canopy.
        MARCH_CANOPY: "march_canopy", Threads::count(CANOPY_LAYER);
        /// Samples the wind at each particle.
        SAMPLE_AIR: "sample_air", Threads::Strands;
    }
}

pub(crate) static SHADERS: &[&Shader] = &[&AIR];

/// A wave of the turbulence: `Mode` in the kernel.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct ModeEntry {
    /// Turns a metre.
    pub wave: Vec3,
    /// Turns at the frame's origin.
    pub phase: f32,
    /// Velocity at a crest, m/s.
    pub amplitude: Vec3,
    /// Padding.
    pub pad_0: f32,
}

/// The air of a frame: `Air` in the kernel.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct AirUniform {
    /// From positions to nodes of the wake.
    pub to_wake: Mat4,
    /// From nodes of the wake to positions.
    pub from_wake: Mat4,
    /// Axes across, across and along the wind, as rows.
    pub axes: Mat4,
    /// Mean velocity, m/s.
    pub mean: Vec3,
    /// Share of the wind that solids block.
    pub shelter: f32,
    /// What positions are moved by before the frame, metres.
    pub shift: Vec3,
    /// Side of the wake's cells, metres.
    pub wake_cell: f32,
    /// Density at rest times the depth that the wind reaches in it, 1/m; 0 without shelter in the
    /// hair.
    pub stop: f32,
    /// Integers to a metre of hair, while it is summed.
    pub scale: f32,
    /// Waves.
    pub modes: u32,
    /// Solids that shelter.
    pub solids: u32,
    /// The first `modes` are used.
    pub each: [ModeEntry; MODES],
}

/// The canopy's nodes: `Canopy` in the kernel.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct CanopyEntry {
    /// The first, in nodes from the origin.
    pub low: Vec3,
    /// Side of a cell, metres.
    pub cell: f32,
    /// Nodes along each axis.
    pub dims: UVec3,
    /// Padding.
    pub pad_0: u32,
    /// Extent of the hair, ordered as integers.
    pub extent: [u32; 6],
    /// Padding.
    pub pad_1: u32,
    /// Padding.
    pub pad_2: u32,
}

/// The air of a simulation.
#[derive(Debug)]
pub(crate) struct DeviceAir {
    uniform: wgpu::Buffer,
    nodes: wgpu::Buffer,
    canopy: wgpu::Buffer,
    /// Velocity of the wind, three rows a place: a buffer a batch.
    pub wind: Vec<wgpu::Buffer>,
    groups: Vec<Bound<AirBindings<'static>>>,
    host: Box<AirUniform>,
    /// Density of the hair at rest, m⁻²; measured at the first wind that hair shelters from.
    rest_density: Option<f64>,
}

/// What shelters from the wind in a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Shelter {
    /// Solids do.
    pub wake: bool,
    /// Hair does.
    pub canopy: bool,
}

/// The wind of a frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct AirFrame<'a> {
    /// The field.
    pub wind: &'a WindField,
    /// Solids of the frame.
    pub solids: usize,
    /// The origin of positions.
    pub origin: DVec3,
    /// What positions are moved by before the frame, metres.
    pub shift: DVec3,
}

impl DeviceAir {
    /// For `strands`, to be bound before the first frame.
    pub fn new(gpu: &Gpu, strands: DeviceStrands<'_>) -> Self {
        let model = strands.model;
        let storage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
        let empty = CanopyEntry { extent: NO_EXTENT, ..CanopyEntry::zeroed() };
        let canopy = gpu.filled("canopy", bytemuck::bytes_of(&empty), storage);
        let nodes = 2 * WAKE_NODES.pow(3) + 2 * CANOPY_NODES.pow(3);
        let rows = |places: usize| gpu.buffer("wind", (3 * places * size_of::<Row<f32>>()) as u64, storage);
        // All hair at one node is half of the largest integer.
        let lengths = model.blocks.iter().flat_map(|block| {
            let own = block.range().map(|place| &model.rest_lengths[3 * place]);
            own.map(|row| row.0[..block.live].iter().map(|&length| f64::from(length)).sum::<f64>())
        });
        let total: f64 = lengths.sum();
        let scale = (f64::from(u32::MAX) / (2.0 * total.max(f64::MIN_POSITIVE))).min(1e9) as f32;
        Self {
            uniform: gpu.buffer(
                "air",
                size_of::<AirUniform>() as u64,
                BufferUsages::UNIFORM | BufferUsages::COPY_DST,
            ),
            nodes: gpu.buffer("nodes", 4 * nodes as u64, storage),
            canopy,
            wind: strands.batches.iter().map(|batch| rows(batch.places.len())).collect(),
            groups: Vec::new(),
            host: Box::new(AirUniform { scale, ..AirUniform::zeroed() }),
            rest_density: None,
        }
    }

    /// Bytes held on the device.
    pub fn bytes(&self) -> u64 {
        let own = [&self.uniform, &self.nodes, &self.canopy];
        own.into_iter().chain(&self.wind).map(|buffer| buffer.size()).sum()
    }

    /// Makes its bind groups.
    pub fn bind(&mut self, gpu: &Gpu, strands: DeviceStrands<'_>, solids: &Solids) {
        let bound = strands.batches.iter().zip(&self.wind).map(|(batch, wind)| {
            let bindings = AirBindings {
                blocks: &batch.blocks,
                model: &batch.model,
                positions: &batch.positions,
                fields: &solids.fields,
                query: &solids.queries,
                wind,
                nodes: &self.nodes,
                canopy: &self.canopy,
                air: &self.uniform,
            };
            bindings.bind(gpu, batch.threads)
        });
        self.groups = bound.collect();
    }

    /// Appends the wind at every particle.
    pub fn sample<'a>(&'a self, list: &mut DispatchList<'a>, shelter: Shelter) {
        let wake = [&FILL_WAKE, &MARCH_WAKE];
        let canopy = [&MEASURE_CANOPY, &FIT_CANOPY, &CLEAR_CANOPY, &SPLAT_CANOPY, &MARCH_CANOPY];
        let wake = wake.into_iter().filter(|_| shelter.wake);
        let canopy = canopy.into_iter().filter(|_| shelter.canopy);
        for kernel in wake.chain(canopy).chain([&SAMPLE_AIR]) {
            list.run(&self.groups, kernel, &[]);
        }
    }

    /// Writes the uniform of a frame. Returns what shelters from the wind.
    pub fn write_frame(&mut self, gpu: &Gpu, model: &Model<f32>, frame: &AirFrame<'_>) -> Shelter {
        let AirFrame { wind, solids, origin, shift } = *frame;
        let host = &mut *self.host;
        host.mean = wind.mean.as_vec3();
        host.shift = shift.as_vec3();
        host.modes = 0;
        for (entry, mode) in host.each.iter_mut().zip(wind.modes.iter().flatten()) {
            let phase = mode.phase_at(origin);
            let (wave, amplitude) = (mode.wave.as_vec3(), mode.amplitude.as_vec3());
            *entry = ModeEntry { wave, phase: phase as f32, amplitude, pad_0: 0.0 };
            host.modes += 1;
        }
        let along = wind.mean.try_normalize();
        let shelter = Shelter {
            wake: along.is_some() && wind.shelter > 0.0 && solids > 0,
            canopy: along.is_some() && wind.hair_depth > 0.0,
        };
        let (axes, cell) = Wake::nodes(along.unwrap_or(DVec3::Z), model.reach);
        let turn = DMat4::from_mat3(DMat3::from_cols(axes[0], axes[1], axes[2]));
        host.axes = turn.transpose().as_mat4();
        let middle = 0.5 * (WAKE_NODES as f64 - 1.0);
        let from_wake =
            turn * DMat4::from_scale(DVec3::splat(cell)) * DMat4::from_translation(DVec3::splat(-middle));
        (host.from_wake, host.to_wake) = (from_wake.as_mat4(), from_wake.inverse().as_mat4());
        host.wake_cell = cell as f32;
        host.shelter = wind.shelter as f32;
        host.solids = if shelter.wake { solids as u32 } else { 0 };
        host.stop = 0.0;
        if shelter.canopy {
            let density = *self.rest_density.get_or_insert_with(|| Canopy::rest_density(model));
            host.stop = (density * wind.hair_depth) as f32;
        }
        gpu.queue().write_buffer(&self.uniform, 0, bytemuck::bytes_of(host));
        shelter
    }
}
