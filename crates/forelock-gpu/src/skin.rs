//! Skinning of a body's vertices on the device: [`Skin::deform`].
//!
//! # Practice
//! Vertices and weights are uploaded once; a pose uploads the motions of its bones, three vectors
//! of four numbers each, or five for dual quaternions, which are made from the matrices on the CPU
//! in float64. The places of the vertices stay on the device: other kernels and renderers bind
//! [`Skinner::positions`].
//!
//! On a body of human size places are within 4e-7 m of float64, or 8e-7 m by dual quaternions: as
//! near as those of the CPU.

use crate::kernel::{Bound, Constant, Dispatch, Shader, StrandThreads, Threads, bindings, shader};
use crate::{Gpu, GpuError};
use bytemuck::{Pod, Zeroable};
use forelock_core::body::character::{Palette, SKIN_WGSL, Skin, Skinning};
use glam::{Vec3, Vec4};
use wgpu::BufferUsages;

bindings! {
    /// Vertices, what they follow, and their places.
    pub(crate) struct SkinBindings {
        37 skinned: uniform(SkinnedUniform),
        38 bones: read,
        39 influences: read,
        40 bound: read,
        41 posed: read_write,
    }
}

shader! {
    /// `skin_vertices`.
    SKIN: "skin_vertices", SkinBindings;
    texts: [SKIN_WGSL];
    constants: [&[
        Constant::u32("LINEAR_VECTORS", Skinning::Linear.bone_vectors() as u32),
        Constant::u32("DUAL_VECTORS", Skinning::DualQuaternion.bone_vectors() as u32),
    ]];
    kernels: {
        /// Places by the mean of matrices.
        BLEND_MATRICES: "blend_matrices", Threads::LIST;
        /// Places by the mean of dual quaternions.
        BLEND_DUALS: "blend_duals", Threads::LIST;
    }
}

pub(crate) static SHADERS: &[&Shader] = &[&SKIN];

/// How many vertices there are: `Skinned` in the kernels.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct SkinnedUniform {
    /// Vertices.
    pub vertices: u32,
    /// Bones that a vertex follows.
    pub influences: u32,
    /// Padding.
    pub pad_0: u32,
    /// Padding.
    pub pad_1: u32,
}

/// A bone that a vertex follows: `Influence` in the kernels.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct InfluenceEntry {
    /// Its number in the skin.
    pub bone: u32,
    /// Its weight.
    pub weight: f32,
}

/// The vertices of a body, which a device moves.
///
/// Memory, in bytes per vertex: 24, and 8 for each bone that it follows.
///
/// ```
/// use forelock_core::body::Walker;
/// use forelock_core::body::character::{Palette, Skinning};
/// use forelock_gpu::{Choice, Gpu, Skinner};
///
/// let Ok(gpu) = Gpu::open(&Choice::Fastest) else { return Ok(()) };
/// let walker = Walker::builtin();
/// let mut skinner = Skinner::new(&gpu, walker.skin(), &walker.bound().positions)?;
/// let mut palette = Palette::default();
/// walker.skin().palette(&walker.skeleton().rest_globals(), &mut palette);
/// let mut encoder = gpu.device().create_command_encoder(&Default::default());
/// skinner.encode(&mut encoder, &palette, Skinning::Linear)?;
/// gpu.queue().submit([encoder.finish()]);
/// assert!(skinner.read()?[7].distance(walker.rest().positions[7]) < 1e-6);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Skinner {
    gpu: Gpu,
    bones: wgpu::Buffer,
    bound: wgpu::Buffer,
    posed: wgpu::Buffer,
    group: Bound<SkinBindings<'static>>,
    bone_count: usize,
    vertex_count: usize,
    bytes: u64,
    /// The motions of bones, packed.
    packed: Vec<Vec4>,
}

impl Skinner {
    /// For `vertices` of a mesh bound to `skin`, `[V]`, metres.
    ///
    /// # Errors
    /// [`GpuError::Skin`] if the skin has another number of vertices, [`GpuError::TooLarge`] if
    /// they exceed a binding, [`GpuError::Failed`] if the device has failed.
    pub fn new(gpu: &Gpu, skin: &Skin, vertices: &[Vec3]) -> Result<Self, GpuError> {
        let (count, per_vertex) = (skin.vertices(), skin.influences());
        check_count("vertices", vertices.len(), count)?;
        let mut influences = vec![InfluenceEntry::zeroed(); count * per_vertex];
        for vertex in 0..count {
            for (i, (bone, weight)) in skin.of_vertex(vertex).enumerate() {
                influences[i * count + vertex] = InfluenceEntry { bone: bone as u32, weight };
            }
        }
        gpu.check_room("the weights of a skin", size_of_val(&*influences) as u64, u64::MAX)?;
        gpu.check_room("the vertices of a body", size_of_val(vertices) as u64, u64::MAX)?;
        let sizes = SkinnedUniform {
            vertices: count as u32,
            influences: per_vertex as u32,
            ..SkinnedUniform::zeroed()
        };
        let vectors = skin.bones().len() * Skinning::DualQuaternion.bone_vectors();
        let skinned = gpu.filled("skinned", bytemuck::bytes_of(&sizes), BufferUsages::UNIFORM);
        let written = BufferUsages::STORAGE | BufferUsages::COPY_DST;
        let bones = gpu.buffer("bones", (vectors.max(1) * size_of::<Vec4>()) as u64, written);
        let influences = gpu.filled("influences", bytemuck::cast_slice(&influences), BufferUsages::STORAGE);
        let bound = gpu.filled("bound vertices", bytemuck::cast_slice(vertices), BufferUsages::STORAGE);
        let usage = written | BufferUsages::COPY_SRC | BufferUsages::VERTEX;
        let posed = gpu.buffer("posed vertices", bound.size(), usage);
        let buffers = SkinBindings {
            skinned: &skinned,
            bones: &bones,
            influences: &influences,
            bound: &bound,
            posed: &posed,
        };
        let group = buffers.bind(gpu, StrandThreads::default());
        gpu.check()?;
        let bytes = [&skinned, &bones, &influences, &bound, &posed].map(|buffer| buffer.size()).iter().sum();
        Ok(Self {
            gpu: gpu.clone(),
            bone_count: skin.bones().len(),
            vertex_count: count,
            bones,
            bound,
            posed,
            group,
            bytes,
            packed: Vec::new(),
        })
    }

    /// Replaces the vertices that are moved, from the next submission on: blend shapes change them.
    ///
    /// # Errors
    /// [`GpuError::Skin`] if the skin has another number of vertices.
    pub fn set_vertices(&mut self, vertices: &[Vec3]) -> Result<(), GpuError> {
        check_count("vertices", vertices.len(), self.vertex_count)?;
        self.gpu.queue().write_buffer(&self.bound, 0, bytemuck::cast_slice(vertices));
        Ok(())
    }

    /// Records the motion of the vertices by `palette`. The motions of bones are written to the
    /// queue at once, and take effect before the next submission: one pose a submission.
    ///
    /// # Errors
    /// [`GpuError::Skin`] if the palette is of another skin, [`GpuError::Failed`] if the device has
    /// failed.
    pub fn encode(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        palette: &Palette,
        skinning: Skinning,
    ) -> Result<(), GpuError> {
        self.gpu.check()?;
        self.write(palette, skinning)?;
        let dispatch = self.dispatch(skinning);
        let label = Some(dispatch.stage());
        let described = wgpu::ComputePassDescriptor { label, timestamp_writes: None };
        dispatch.record(&self.gpu, &mut encoder.begin_compute_pass(&described));
        Ok(())
    }

    /// Uploads the motions of the bones.
    pub(crate) fn write(&mut self, palette: &Palette, skinning: Skinning) -> Result<(), GpuError> {
        check_count("bones", palette.matrices.len(), self.bone_count)?;
        palette.pack(skinning, &mut self.packed);
        self.gpu.queue().write_buffer(&self.bones, 0, bytemuck::cast_slice(&self.packed));
        Ok(())
    }

    /// The motion of the vertices by the bones that were uploaded last, in the same way.
    pub(crate) fn dispatch(&self, skinning: Skinning) -> Dispatch<'_> {
        let kernel = match skinning {
            Skinning::Linear => &BLEND_MATRICES,
            Skinning::DualQuaternion => &BLEND_DUALS,
        };
        self.group.dispatch(kernel, &[])
    }

    /// Places of the vertices, three float32 each, metres: of no meaning before the first pose. The
    /// buffer can be bound as storage and as vertices.
    pub fn positions(&self) -> &wgpu::Buffer {
        &self.posed
    }

    /// The same on the CPU, `[V]`. Waits for the device.
    ///
    /// # Errors
    /// [`GpuError::Failed`] if the device has failed.
    pub fn read(&self) -> Result<Vec<Vec3>, GpuError> {
        let bytes = self.gpu.read(&[&self.posed])?;
        let mut positions: Vec<Vec3> =
            bytes.first().map_or_else(Vec::new, |bytes| bytemuck::pod_collect_to_vec(bytes));
        positions.truncate(self.vertex_count);
        Ok(positions)
    }

    /// Bytes held on the device.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }
}

fn check_count(what: &'static str, found: usize, expected: usize) -> Result<(), GpuError> {
    if found == expected { Ok(()) } else { Err(GpuError::Skin { what, found, expected }) }
}
