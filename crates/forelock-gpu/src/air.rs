//! Wind that is not the same everywhere, on the device.

use crate::Gpu;
use crate::batch::Batch;
use crate::layout::NO_EXTENT;
use bytemuck::{Pod, Zeroable};
use forelock_core::air::canopy::NODES as CANOPY_NODES;
use forelock_core::air::wake::NODES as WAKE_NODES;
use forelock_core::air::{Canopy, MODES, Wake, WindField};
use forelock_core::lane::Row;
use forelock_core::strands::Model;
use glam::{DMat3, DMat4, DVec3, Mat4, UVec3, Vec3};
use wgpu::BufferUsages;

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
    /// Nothing.
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
    /// Share of the wind that solids keep off.
    pub shelter: f32,
    /// What positions are moved by before the frame, metres.
    pub shift: Vec3,
    /// Side of the wake's cells, metres.
    pub wake_cell: f32,
    /// Density at rest times the depth that the wind reaches in it, 1/m; 0 without shelter in the hair.
    pub stop: f32,
    /// Integers to a metre of hair, while it is summed.
    pub scale: f32,
    /// Waves.
    pub modes: u32,
    /// Solids that shelter.
    pub solids: u32,
    /// The first `modes` are there.
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
    /// Nothing.
    pub pad_0: u32,
    /// Extent of the hair, ordered as integers.
    pub extent: [u32; 6],
    /// Nothing.
    pub pad_1: u32,
    /// Nothing.
    pub pad_2: u32,
}

/// The air of a simulation.
#[derive(Debug)]
pub(crate) struct DeviceAir {
    pub uniform: wgpu::Buffer,
    pub nodes: wgpu::Buffer,
    pub canopy: wgpu::Buffer,
    /// Velocity of the wind, three rows a place: a buffer a batch.
    pub wind: Vec<wgpu::Buffer>,
    host: Box<AirUniform>,
    /// Density of the hair at rest, m⁻²; measured at the first wind that hair keeps off.
    rest_density: Option<f64>,
}

/// What of the air there is in a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Shelter {
    /// Of solids.
    pub wake: bool,
    /// Of hair.
    pub canopy: bool,
}

impl DeviceAir {
    /// For strands that are on the device in `batches`.
    pub fn new(gpu: &Gpu, model: &Model<f32>, batches: &[&Batch]) -> Self {
        let storage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
        let empty = CanopyEntry { extent: NO_EXTENT, ..CanopyEntry::zeroed() };
        let canopy = gpu.filled("canopy", bytemuck::bytes_of(&empty), storage);
        let nodes = 2 * WAKE_NODES.pow(3) + 2 * CANOPY_NODES.pow(3);
        let rows = |batch: &&Batch| {
            gpu.buffer("wind", (3 * batch.places.len() * size_of::<Row<f32>>()) as u64, storage)
        };
        // All hair at one node is half of what an integer holds.
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
            wind: batches.iter().map(rows).collect(),
            host: Box::new(AirUniform { scale, ..AirUniform::zeroed() }),
            rest_density: None,
        }
    }

    /// Bytes held on the device.
    pub fn bytes(&self) -> u64 {
        let own = [&self.uniform, &self.nodes, &self.canopy];
        own.into_iter().chain(&self.wind).map(|buffer| buffer.size()).sum()
    }

    /// Brings `wind` to the device, about `origin`, for strands of `model` that are moved by `shift` first, among so many solids; what shelters from it.
    pub fn place(
        &mut self,
        gpu: &Gpu,
        model: &Model<f32>,
        (wind, solids): (&WindField, usize),
        (origin, shift): (DVec3, DVec3),
    ) -> Shelter {
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
