//! Placement of all strands by simulated guides, on the device.

use crate::kernel::{Bound, Shader, StrandThreads, Threads, bindings, shader};
use crate::{Gpu, GpuError, GpuSimulation};
use bytemuck::{Pod, Zeroable};
use forelock_core::groom::Groom;
use forelock_core::groom::guides::{CARRY_WGSL, FOLLOW_WGSL, Skinning, WGSL};
use forelock_core::lane::LANES;
use forelock_core::pose::Pose;
use forelock_core::strands::Model;
use forelock_core::strands::{State, vector};
use glam::{DVec3, Quat, UVec4, Vec3, Vec4};
use wgpu::BufferUsages;

bindings! {
    /// Guides and their motions.
    pub(crate) struct GuideBindings {
        2 blocks: read,
        3 model: read,
        5 positions: read_write,
        21 motions: read_write,
        22 skin: uniform(SkinUniform),
    }
}

bindings! {
    /// From motions of guides to positions of strands.
    pub(crate) struct CarryBindings {
        21 motions: read_write,
        22 skin: uniform(SkinUniform),
        23 carried: read,
        24 placed: read_write,
    }
}

shader! {
    /// `follow_guides`.
    FOLLOW: "follow_guides", GuideBindings;
    texts: [WGSL, FOLLOW_WGSL];
    constants: [];
    kernels: {
        /// The motion of each guide particle.
        FOLLOW_GUIDES: "follow_guides", Threads::Strands;
    }
}

shader! {
    /// `carry_strands`.
    CARRY: "carry_strands", CarryBindings;
    texts: [WGSL, CARRY_WGSL];
    constants: [];
    kernels: {
        /// The position of each particle.
        CARRY_STRANDS: "carry_strands", Threads::CELLS;
    }
}

pub(crate) static SHADERS: &[&Shader] = &[&FOLLOW, &CARRY];

/// A frame of skinning: `Skin` in the kernels.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct SkinUniform {
    /// The head's rotation.
    pub head: Quat,
    /// Particles that are carried.
    pub count: u32,
    /// Padding.
    pub pad_0: u32,
    /// Padding.
    pub pad_1: u32,
    /// Padding.
    pub pad_2: u32,
}

/// Where a particle is carried: `Carried` in the kernels.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct CarriedEntry {
    /// The particle before it on each guide, as an entry of a row.
    pub entries: UVec4,
    /// How far it is from there to the next.
    pub fractions: Vec4,
    /// How much each guide counts.
    pub weights: Vec4,
    /// Where it is at rest, from the middle of the guides' rest shape, metres.
    pub rest: Vec3,
    /// Padding.
    pub pad_0: f32,
}

/// All strands of a groom, placed by guides that are simulated on the same device: [`Skinning`]
/// without a read-back.
///
/// Memory, in bytes per particle: 76 of all strands, 32 of the guides. It binds the buffers of the
/// simulation: make a new one for another simulation, also for one that continues after an edit.
#[derive(Debug)]
pub struct GpuSkinning {
    gpu: Gpu,
    uniform: wgpu::Buffer,
    placed: wgpu::Buffer,
    guides: Bound<GuideBindings<'static>>,
    strands: Bound<CarryBindings<'static>>,
    count: u32,
    bytes: u64,
}

impl GpuSkinning {
    /// The strands of `skinning`, placed by the simulation of its guides.
    ///
    /// # Errors
    /// [`GpuError::Guides`] if `guides` does not simulate the guides of `skinning`,
    /// [`GpuError::Unsupported`] if the guides are more than one batch, [`GpuError::TooLarge`] if
    /// the strands exceed a binding.
    pub fn new(skinning: &Skinning, guides: &GpuSimulation) -> Result<Self, GpuError> {
        let (gpu, model) = (guides.gpu(), guides.model());
        let [batch] = guides.batches() else {
            return Err(GpuError::Unsupported { what: "guides in more than one batch" });
        };
        if !is_of(model, skinning.guides()) {
            return Err(GpuError::Guides);
        }
        let mut entries = vec![0u32; model.particle_count];
        State::each_particle(model, |particle, place, lane| {
            entries[particle] = (place * LANES + lane) as u32
        });
        let middle = Vec3::from_array(model.centre.map(|c| c as f32));
        let carried: Vec<CarriedEntry> = skinning
            .carried()
            .map(|own| CarriedEntry {
                entries: own.particles.map(|particle| entries[particle as usize]).into(),
                fractions: own.fractions.into(),
                weights: own.weights.into(),
                rest: own.rest - middle,
                pad_0: 0.0,
            })
            .collect();
        gpu.check_room("all strands that guides carry", size_of_val(&*carried) as u64, u64::MAX)?;
        let storage = BufferUsages::STORAGE | BufferUsages::COPY_SRC | BufferUsages::COPY_DST;
        let uniform = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
        let uniform = gpu.buffer("skin", size_of::<SkinUniform>() as u64, uniform);
        let motions = gpu.buffer("motions", 32 * (model.places() * LANES) as u64, storage);
        let places = gpu.filled("carried", bytemuck::cast_slice(&carried), BufferUsages::STORAGE);
        let usage = storage | BufferUsages::VERTEX;
        let placed = gpu.buffer("placed", 12 * carried.len() as u64, usage);
        let bindings = GuideBindings {
            blocks: &batch.blocks,
            model: &batch.model,
            positions: &batch.positions,
            motions: &motions,
            skin: &uniform,
        };
        let guides = bindings.bind(gpu, batch.threads);
        let bindings = CarryBindings { motions: &motions, skin: &uniform, carried: &places, placed: &placed };
        let strands = bindings.bind(gpu, StrandThreads::default());
        gpu.check()?;
        let bytes = [&uniform, &motions, &places, &placed].map(|buffer| buffer.size()).iter().sum();
        Ok(Self { gpu: gpu.clone(), guides, strands, count: carried.len() as u32, bytes, uniform, placed })
    }

    /// Submits the placement of all strands by the current guides, with the head at `head`, and
    /// does not wait for it.
    ///
    /// # Errors
    /// [`GpuError::Failed`] if the device has failed.
    pub fn place(&self, head: &Pose) -> Result<(), GpuError> {
        self.gpu.check()?;
        let uniform =
            SkinUniform { head: head.rotation.as_quat(), count: self.count, pad_0: 0, pad_1: 0, pad_2: 0 };
        self.gpu.queue().write_buffer(&self.uniform, 0, bytemuck::bytes_of(&uniform));
        let mut encoder = self.gpu.device().create_command_encoder(&Default::default());
        for dispatch in
            [self.guides.dispatch(&FOLLOW_GUIDES, &[]), self.strands.dispatch(&CARRY_STRANDS, &[])]
        {
            let described =
                wgpu::ComputePassDescriptor { label: Some(dispatch.stage()), timestamp_writes: None };
            dispatch.record(&self.gpu, &mut encoder.begin_compute_pass(&described));
        }
        self.gpu.queue().submit([encoder.finish()]);
        Ok(())
    }

    /// Positions of all strands, three float32 per particle in the groom's order, relative to the
    /// simulation's origin, metres. The buffer can be bound as vertices.
    pub fn positions(&self) -> &wgpu::Buffer {
        &self.placed
    }

    /// The same on the CPU. Waits for the device.
    ///
    /// # Errors
    /// [`GpuError::Failed`] if the device has failed.
    pub fn read(&self) -> Result<Vec<Vec3>, GpuError> {
        let bytes = self.gpu.read(&[&self.placed])?;
        Ok(bytes.first().map_or_else(Vec::new, |bytes| bytemuck::pod_collect_to_vec(bytes)))
    }

    /// Bytes held on the device.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }
}

/// Whether `model` is that of `groom`, up to rounding.
fn is_of(model: &Model<f32>, groom: &Groom) -> bool {
    let mut is_same = model.offsets == groom.strand_offsets();
    let middle = DVec3::from(model.centre);
    if is_same {
        State::each_particle(model, |particle, place, lane| {
            let own = Vec3::from_array(vector(&model.rest, place, lane)).as_dvec3() + middle;
            is_same &= own.distance(groom.positions()[particle].as_dvec3()) < 1e-5;
        });
    }
    is_same
}
