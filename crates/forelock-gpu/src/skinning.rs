//! Guides on the device carry all strands.

use crate::kernels::{self, Binding, Group, Kernel};
use crate::{Gpu, GpuError, GpuSimulation};
use bytemuck::{Pod, Zeroable};
use forelock_core::groom::Groom;
use forelock_core::groom::guides::Skinning;
use forelock_core::lane::LANES;
use forelock_core::strands::Model;
use forelock_core::pose::Pose;
use forelock_core::strands::{State, vector};
use glam::{DVec3, Quat, UVec4, Vec3, Vec4};
use wgpu::BufferUsages;

/// A frame of skinning: `Skin` in the kernels.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct SkinUniform {
    /// The head's rotation.
    pub head: Quat,
    /// Particles that are carried.
    pub count: u32,
    /// Nothing.
    pub pad_0: u32,
    /// Nothing.
    pub pad_1: u32,
    /// Nothing.
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
    /// Nothing.
    pub pad_0: f32,
}

/// All strands of a groom, carried by guides that are simulated on the same device: [`Skinning`], whose positions need not leave it.
///
/// Memory, in bytes a particle: 64 and 12 of all strands, 32 of the guides. It looks at the simulation's own memory: of another simulation, also one that goes on after an edit, a new one is to be made.
#[derive(Debug)]
pub struct GpuSkinning {
    gpu: Gpu,
    uniform: wgpu::Buffer,
    placed: wgpu::Buffer,
    to_guides: wgpu::BindGroup,
    to_strands: wgpu::BindGroup,
    count: u32,
    groups: u32,
    bytes: u64,
}

impl GpuSkinning {
    /// What `skinning` carries, by the guides that `guides` simulates.
    ///
    /// # Errors
    /// [`GpuError::Guides`] if the guides are not those of `skinning`, [`GpuError::Unsupported`] if they are more than one batch of strands, [`GpuError::TooLarge`] if the strands have no room.
    pub fn new(skinning: &Skinning, guides: &GpuSimulation) -> Result<Self, GpuError> {
        let (gpu, model) = (guides.gpu(), guides.model());
        let batch = guides.batches().next().filter(|_| guides.batches().len() == 1);
        let batch = batch.ok_or(GpuError::Unsupported { what: "guides in more than one batch" })?;
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
        let bound = |group| {
            kernels::bind(gpu.device(), (gpu.kernels(), group), &|what| match what {
                Binding::Read("blocks") => &batch.blocks,
                Binding::Read("model") => &batch.model,
                Binding::Change("positions") => &batch.positions,
                Binding::Change("motions") => &motions,
                Binding::Read("carried") => &places,
                Binding::Skin => &uniform,
                _ => &placed,
            })
        };
        let (to_guides, to_strands) = (bound(Group::Guides), bound(Group::Carried));
        gpu.check()?;
        let bytes = [&uniform, &motions, &places, &placed].map(|buffer| buffer.size()).iter().sum();
        Ok(Self {
            gpu: gpu.clone(),
            to_guides,
            to_strands,
            count: carried.len() as u32,
            groups: batch.groups,
            bytes,
            uniform,
            placed,
        })
    }

    /// Hands the placing of all strands to the device, with the head at `head` and the guides where they are; does not wait for it.
    ///
    /// # Errors
    /// [`GpuError::Failed`] if the device has failed.
    pub fn place(&self, head: &Pose) -> Result<(), GpuError> {
        self.gpu.check()?;
        let uniform =
            SkinUniform { head: head.rotation.as_quat(), count: self.count, pad_0: 0, pad_1: 0, pad_2: 0 };
        self.gpu.queue().write_buffer(&self.uniform, 0, bytemuck::bytes_of(&uniform));
        let mut encoder = self.gpu.device().create_command_encoder(&Default::default());
        for (kernel, bound) in
            [(Kernel::FollowGuides, &self.to_guides), (Kernel::CarryStrands, &self.to_strands)]
        {
            let mut pass = encoder.begin_compute_pass(&Default::default());
            pass.set_pipeline(self.gpu.kernels().pipeline(kernel));
            pass.set_bind_group(0, bound, &[]);
            pass.dispatch_workgroups(kernel.over().groups(self.groups), 1, 1);
        }
        self.gpu.queue().submit([encoder.finish()]);
        Ok(())
    }

    /// Where all strands are, three float32 a particle in the groom's order, relative to the simulation's origin, metres: to be drawn from.
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

/// Whether `model` was made of `groom`, to rounding.
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
