//! Hair as smoothed particles on the device.
//!
//! # Practice
//! Particles of all batches are entered into one table of buckets, sorted by counting. A thread has a particle, and its list of neighbours; lists are in the order of distance and number, so nothing depends on the order in which
//! threads came. Densities at rest are measured on the CPU.
//!
//! Memory: 12 bytes a particle and a table of 16 to 32. All else, 120 bytes a particle with 16 neighbours, lies in the strands' scratch where that has room: it has with up to 16 neighbours, as long as strands are one batch.
//!
//! # Limitations
//! What one binding holds bounds the strands: 120 bytes a particle, 1.1 million particles where a device binds 128 MiB. How dense hair is is not told.

use crate::batch::Shared;
use crate::contacts::ROW_CELLS;
use crate::kernels::LIST_NUMBERS;
use crate::{Gpu, GpuError};
use bytemuck::{Pod, Zeroable};
use forelock_core::lane::LANES;
use forelock_core::strands::Model;
use forelock_core::lane::Simd;
use forelock_core::interaction::sph::{Sph, SphParams};
use wgpu::BufferUsages;

/// The fluid: `Fluid` in the kernels, which say what fields are.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[expect(missing_docs, reason = "beside the kernels")]
pub struct FluidUniform {
    pub h: f32,
    pub h2: f32,
    pub inverse_h: f32,
    pub dt: f32,
    pub mass_density: f32,
    pub mass_push: f32,
    pub mass_drag: f32,
    pub pressure: f32,
    pub viscosity: f32,
    pub inverse_dt: f32,
    pub neighbours: u32,
    pub numbers: u32,
    pub buckets: u32,
    pub own_strand: u32,
    pub mutual: u32,
    pub pad_0: u32,
}

/// The smoothed particles of a simulation.
#[derive(Debug)]
pub(crate) struct DeviceParticles {
    pub uniform: wgpu::Buffer,
    pub cloud: wgpu::Buffer,
    pub names: wgpu::Buffer,
    pub table: wgpu::Buffer,
    /// Bytes of those that are no one else's.
    bytes: u64,
    host: FluidUniform,
}

impl DeviceParticles {
    /// Particles of the strands of `model`.
    pub fn new(
        gpu: &Gpu,
        (model, shared): (&Model<f32>, &Shared),
        params: &SphParams,
    ) -> Result<Self, GpuError> {
        params.validate()?;
        let sph = Sph::new(model, params, Simd::Auto);
        let (fluid, [mass_density, mass_push, mass_drag]) = (sph.fluid(), sph.fluid().masses());
        let numbers = LANES * model.places();
        let buckets = (2 * model.particle_count).next_power_of_two().clamp(ROW_CELLS as usize, 1 << 22);
        let cloud = 4 * (numbers * (LIST_NUMBERS as usize + fluid.neighbours)) as u64;
        let what = "smoothed particles of so many strands, or with so many neighbours,";
        gpu.check_room(what, cloud.max(12 * numbers as u64), u64::MAX)?;
        let mut names = vec![[0u32; 3]; numbers];
        for block in &model.blocks {
            for (lane, &strand) in block.strands.iter().enumerate() {
                for (number, place) in (model.offsets[strand as usize]..).zip(block.range()) {
                    let rest = sph.rest_density()[number as usize];
                    names[place * LANES + lane] = [number, strand, rest.to_bits()];
                }
            }
        }
        let storage = BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
        let names = gpu.filled("names", bytemuck::cast_slice(&names), storage);
        let table = gpu.buffer("table", 4 * (2 * buckets as u64 + 1), storage);
        let mut bytes = names.size() + table.size();
        let cloud = if shared.scratch.size() >= cloud {
            shared.scratch.clone()
        } else {
            bytes += cloud;
            gpu.buffer("cloud", cloud, storage)
        };
        let uniform = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
        let uniform = gpu.buffer("fluid", size_of::<FluidUniform>() as u64, uniform);
        bytes += uniform.size();
        let host = FluidUniform {
            h: fluid.h,
            h2: fluid.h2,
            inverse_h: 1.0 / fluid.h,
            mass_density,
            mass_push,
            mass_drag,
            pressure: fluid.pressure,
            viscosity: fluid.viscosity,
            neighbours: fluid.neighbours as u32,
            numbers: numbers as u32,
            buckets: buckets as u32,
            own_strand: fluid.own_strand.into(),
            mutual: fluid.mutual.into(),
            ..FluidUniform::zeroed()
        };
        Ok(Self { uniform, cloud, names, table, bytes, host })
    }

    /// Bytes held on the device.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Brings a step of `dt_secs` to the device.
    pub fn place(&mut self, gpu: &Gpu, dt_secs: f64) {
        (self.host.dt, self.host.inverse_dt) = (dt_secs as f32, (1.0 / dt_secs) as f32);
        gpu.queue().write_buffer(&self.uniform, 0, bytemuck::bytes_of(&self.host));
    }
}
