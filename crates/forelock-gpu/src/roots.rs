//! Roots on the skin of a character, on the device: [`SkinnedRoots::frames`].
//!
//! # Practice
//! What does not change with the pose is uploaded once. In a step from where the last one ended
//! only the pose at its end is uploaded: the motions of the bones, and the vertices where blend
//! shapes displace them. Nothing is uploaded while the skin holds still. Otherwise the pose at the
//! start goes first, in a submission of its own. Kernels skin the mesh, turn its triangles, average
//! their rotations at the corners of the roots' triangles and at the roots, and pack the motions at
//! both ends to where the other kernels read them.
//!
//! The mesh at rest is skinned on the device too, so roots on skin that does not move from there
//! have no motion, to the last bit of a place.
//!
//! # Limitations
//! Computed in float32: for the same places of vertices rotations are within 1e-6 rad of those of
//! the CPU, and shifts within 3e-7 m. Places themselves are float32 on both, which turns triangles
//! of a centimetre by up to 2e-4 rad where the two round them differently, and smaller ones more.

use crate::batch::{Batch, DeviceStrands};
use crate::frame::ROOT_CONSTANTS;
use crate::kernel::{Bound, Constant, DispatchList, Shader, StrandThreads, Threads, bindings, shader};
use crate::{Gpu, GpuError, GpuSimulation, Skinner};
use bytemuck::{Pod, Zeroable};
use forelock_core::body::character::{SkinPose, Skinning};
use forelock_core::frame::{FRAME_ROWS, PACK_ROOTS_WGSL, ROOTS_WGSL};
use forelock_core::groom::{
    COLLAPSED_TRIANGLE, FLAT_TRIANGLE, ROOT_FRAMES_WGSL, RootFrames, SURFACE_WGSL, SkinnedRoots, SurfaceRoot,
};
use forelock_core::lane::Row;
use forelock_core::strands::Model;
use glam::{Quat, UVec3, Vec3, Vec4};
use std::sync::Arc;
use wgpu::BufferUsages;

bindings! {
    /// A mesh and the roots on it.
    pub(crate) struct BendBindings {
        42 surface: uniform(SurfaceUniform),
        43 triangles: read,
        44 fans: read,
        45 neighbours: read,
        46 at_rest: read,
        47 bent: read,
        48 roots: read,
        49 turns: read_write,
        50 root_frames: read_write,
    }
}

bindings! {
    /// Motions of roots, and the model that they belong to.
    pub(crate) struct PackBindings {
        2 blocks: read,
        42 surface: uniform(SurfaceUniform),
        50 root_frames: read_write,
        51 packed: read_write,
    }
}

const TRIANGLE_CONSTANTS: [Constant; 2] = [
    Constant::f32("FLAT_TRIANGLE", FLAT_TRIANGLE as f32),
    Constant::f32("COLLAPSED_TRIANGLE", COLLAPSED_TRIANGLE as f32),
];

shader! {
    /// `bend_roots`.
    BEND: "bend_roots", BendBindings;
    texts: [ROOTS_WGSL, SURFACE_WGSL, ROOT_FRAMES_WGSL];
    constants: [ROOT_CONSTANTS, &TRIANGLE_CONSTANTS];
    kernels: {
        /// The rotation of each triangle.
        TURN_TRIANGLES: "turn_triangles", Threads::LIST;
        /// The rotation of each corner.
        TURN_CORNERS: "turn_corners", Threads::LIST;
        /// The motion of each root.
        MOVE_ROOTS: "move_roots", Threads::LIST;
    }
}

shader! {
    /// The packing of motions.
    PACK: "bend_roots", PackBindings;
    texts: [ROOTS_WGSL, SURFACE_WGSL, PACK_ROOTS_WGSL];
    constants: [ROOT_CONSTANTS];
    kernels: {
        /// Packs the motions at a frame's start and end.
        PACK_FRAMES: "pack_frames", Threads::Strands;
    }
}

pub(crate) static SHADERS: &[&Shader] = &[&BEND, &PACK];

/// How many there are of what a surface has, and where motions are: `Surface` in the kernels.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct SurfaceUniform {
    /// Triangles.
    pub triangles: u32,
    /// Corners of the roots' triangles.
    pub corners: u32,
    /// Roots.
    pub roots: u32,
    /// The first entry of the motions that are written.
    pub frames: u32,
    /// That of the motions at a frame's start.
    pub start: u32,
    /// That of the motions at its end.
    pub end: u32,
    /// Padding.
    pub pad_0: u32,
    /// Padding.
    pub pad_1: u32,
}

/// A root on its triangle: `Root` in the kernels.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct RootEntry {
    /// The triangle's corners in the mesh.
    pub corners: UVec3,
    /// Padding.
    pub pad_0: u32,
    /// The same among the corners of all roots' triangles.
    pub own: UVec3,
    /// Padding.
    pub pad_1: u32,
    /// The point that it is bound to.
    pub barycentric: Vec3,
    /// Padding.
    pub pad_2: f32,
    /// The root at rest, from that point, metres.
    pub offset: Vec3,
    /// Padding.
    pub pad_3: f32,
}

impl RootEntry {
    fn new(root: &SurfaceRoot) -> Self {
        Self {
            corners: root.corners.into(),
            own: root.own.into(),
            barycentric: root.barycentric.into(),
            offset: root.offset.as_vec3(),
            ..Self::zeroed()
        }
    }
}

/// What a frame computes of the motions of roots.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum RootStep {
    /// Nothing: they have none of their own, or it is uploaded.
    None,
    /// Packs those that are there.
    Pack,
    /// Those of the pose at the frame's end, with this blend of bones, and packs.
    Bend(Skinning),
}

/// Roots on a skin.
#[derive(Debug)]
pub(crate) struct DeviceRoots {
    roots: Arc<SkinnedRoots>,
    skinner: Skinner,
    /// The bound vertices that the skinner has, if shapes displace them.
    shaped: Vec<Vec3>,
    /// The poses of which the motions are in the two halves of their buffer.
    held: [Option<SkinPose>; 2],
    surface: SurfaceUniform,
    uniform: wgpu::Buffer,
    frames: wgpu::Buffer,
    group: Bound<BendBindings<'static>>,
    packs: Vec<Bound<PackBindings<'static>>>,
    bytes: u64,
}

/// The lists as one array: where each begins and where the last ends, then all of them.
fn joined<'a>(lists: impl ExactSizeIterator<Item = &'a [u32]>) -> Vec<u32> {
    let mut joined = vec![0; lists.len() + 1];
    for (k, list) in lists.enumerate() {
        joined[k] = joined.len() as u32;
        joined.extend_from_slice(list);
        joined[k + 1] = joined.len() as u32;
    }
    joined
}

impl DeviceRoots {
    /// The `roots` of the strands of `model`.
    pub fn new(gpu: &Gpu, roots: &Arc<SkinnedRoots>, model: &Model<f32>) -> Result<Self, GpuError> {
        let (surface, character) = (roots.surface(), roots.character());
        let skinner = Skinner::new(gpu, character.skin(), &character.bound().positions)?;
        let of_strand = |&strand: &u32| RootEntry::new(&surface.roots()[strand as usize]);
        let entries: Vec<RootEntry> =
            model.blocks.iter().flat_map(|block| block.strands.iter().map(of_strand)).collect();
        let turned = surface.triangles().len() + surface.fans().len();
        let largest = size_of_val(&*entries).max(turned * size_of::<Vec4>());
        gpu.check_room("roots on a skin", largest as u64, u64::MAX)?;
        let sizes = SurfaceUniform {
            triangles: surface.triangles().len() as u32,
            corners: surface.fans().len() as u32,
            roots: entries.len() as u32,
            ..SurfaceUniform::zeroed()
        };
        let list =
            |label, numbers: &[u32]| gpu.filled(label, bytemuck::cast_slice(numbers), BufferUsages::STORAGE);
        let triangles = list("triangles", surface.triangles().as_flattened());
        let fans = list("fans", &joined(surface.fans()));
        let neighbours = list("neighbours", &joined(surface.neighbours()));
        let entries = gpu.filled("roots", bytemuck::cast_slice(&entries), BufferUsages::STORAGE);
        let vectors = |label, count: u32| {
            let bytes = (count.max(1) as usize * size_of::<Vec4>()) as u64;
            gpu.buffer(label, bytes, BufferUsages::STORAGE | BufferUsages::COPY_SRC)
        };
        let turns = vectors("turns", sizes.triangles + sizes.corners);
        let frames = vectors("root frames", 4 * sizes.roots);
        let written = BufferUsages::STORAGE | BufferUsages::COPY_DST;
        let at_rest = gpu.buffer("vertices at rest", skinner.positions().size(), written);
        let usage = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
        let uniform = gpu.buffer("surface", size_of::<SurfaceUniform>() as u64, usage);
        let buffers = BendBindings {
            surface: &uniform,
            triangles: &triangles,
            fans: &fans,
            neighbours: &neighbours,
            at_rest: &at_rest,
            bent: skinner.positions(),
            roots: &entries,
            turns: &turns,
            root_frames: &frames,
        };
        let group = buffers.bind(gpu, StrandThreads::default());
        let own = [&triangles, &fans, &neighbours, &at_rest, &entries, &turns, &frames, &uniform];
        let bytes = own.iter().map(|buffer| buffer.size()).sum::<u64>() + skinner.bytes();
        let mut made = Self {
            roots: roots.clone(),
            skinner,
            shaped: Vec::new(),
            held: [None, None],
            surface: sizes,
            uniform,
            frames,
            group,
            packs: Vec::new(),
            bytes,
        };
        let rest = character.rest_pose();
        made.write_pose(&rest)?;
        let mut encoder = gpu.device().create_command_encoder(&Default::default());
        made.record_alone(gpu, &mut encoder, |list| list.push(made.skinner.dispatch(rest.skinning)));
        let posed = made.skinner.positions();
        encoder.copy_buffer_to_buffer(posed, 0, &at_rest, 0, posed.size());
        gpu.queue().submit([encoder.finish()]);
        gpu.check()?;
        Ok(made)
    }

    /// Whether they are `roots`.
    pub fn is_of(&self, roots: &Arc<SkinnedRoots>) -> bool {
        Arc::ptr_eq(&self.roots, roots)
    }

    /// Bytes held on the device.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Makes the bind groups of batches, which have room for the motions.
    pub fn bind(&mut self, gpu: &Gpu, strands: DeviceStrands<'_>) {
        let pack = strands.batches.iter().map(|batch| {
            let bindings = PackBindings {
                blocks: &batch.blocks,
                surface: &self.uniform,
                root_frames: &self.frames,
                packed: &batch.model,
            };
            bindings.bind(gpu, batch.threads)
        });
        self.packs = pack.collect();
    }

    /// Uploads what is missing of a frame between two `poses`, and submits the motions at its start
    /// if they are not there. Returns what the frame has to compute.
    pub fn prepare(&mut self, gpu: &Gpu, poses: [&SkinPose; 2]) -> Result<RootStep, GpuError> {
        let held = poses.map(|pose| self.held.iter().position(|own| own.as_ref() == Some(pose)));
        let ends = match held {
            _ if poses[0] == poses[1] => [held[0].unwrap_or(0); 2],
            [Some(start), _] => [start, 1 - start],
            [None, Some(end)] => [1 - end, end],
            [None, None] => [0, 1],
        };
        let first = |half: usize| 2 * self.surface.roots * half as u32;
        [self.surface.start, self.surface.end] = ends.map(first);
        if self.held[ends[0]].as_ref() != Some(poses[0]) {
            self.hold(gpu, ends[0], poses[0])?;
            let mut encoder = gpu.device().create_command_encoder(&Default::default());
            self.record_alone(gpu, &mut encoder, |list| self.bend_to(list, poses[0].skinning));
            gpu.queue().submit([encoder.finish()]);
        }
        if self.held[ends[1]].as_ref() != Some(poses[1]) {
            self.hold(gpu, ends[1], poses[1])?;
            return Ok(RootStep::Bend(poses[1].skinning));
        }
        self.write_surface(gpu);
        Ok(RootStep::Pack)
    }

    /// Uploads `pose`, of which the motions come into a `half` of their buffer.
    fn hold(&mut self, gpu: &Gpu, half: usize, pose: &SkinPose) -> Result<(), GpuError> {
        self.held[half] = None;
        self.write_pose(pose)?;
        self.surface.frames = 2 * self.surface.roots * half as u32;
        self.write_surface(gpu);
        self.held[half] = Some(pose.clone());
        Ok(())
    }

    fn write_surface(&self, gpu: &Gpu) {
        gpu.queue().write_buffer(&self.uniform, 0, bytemuck::bytes_of(&self.surface));
    }

    fn write_pose(&mut self, pose: &SkinPose) -> Result<(), GpuError> {
        if pose.shaped != self.shaped {
            self.skinner.set_vertices(self.roots.character().shaped(pose))?;
            self.shaped.clone_from(&pose.shaped);
        }
        self.skinner.write(&pose.palette, pose.skinning)
    }

    /// Records dispatches in a pass of their own.
    fn record_alone<'a>(
        &'a self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        dispatches: impl FnOnce(&mut DispatchList<'a>),
    ) {
        let mut list = DispatchList::default();
        dispatches(&mut list);
        let described = wgpu::ComputePassDescriptor { label: Some(BEND.stage), timestamp_writes: None };
        let mut pass = encoder.begin_compute_pass(&described);
        list.iter().for_each(|dispatch| dispatch.record(gpu, &mut pass));
    }

    /// Appends the motions in the pose that was uploaded last.
    fn bend_to<'a>(&'a self, list: &mut DispatchList<'a>, skinning: Skinning) {
        list.push(self.skinner.dispatch(skinning));
        for kernel in [&TURN_TRIANGLES, &TURN_CORNERS, &MOVE_ROOTS] {
            list.push(self.group.dispatch(kernel, &[]));
        }
    }

    /// Appends what a frame computes.
    pub fn bend<'a>(&'a self, list: &mut DispatchList<'a>, step: RootStep) {
        if let RootStep::Bend(skinning) = step {
            self.bend_to(list, skinning);
        }
        if step != RootStep::None {
            list.run(&self.packs, &PACK_FRAMES, &[]);
        }
    }
}

impl GpuSimulation {
    /// The motions of strands relative to the head at the start and at the end of the last frame,
    /// in the groom's order, the rotations at its end with the signs nearest to those at its start;
    /// none if no frame had any. Waits for the device.
    ///
    /// # Errors
    /// [`GpuError::Failed`] if the device has failed.
    pub fn read_root_frames(&self) -> Result<Option<[RootFrames; 2]>, GpuError> {
        let has_room = |batch: &Batch| batch.model.usage().contains(BufferUsages::COPY_SRC);
        if !self.batches.iter().all(has_room) {
            return Ok(None);
        }
        let models: Vec<_> = self.batches.iter().map(|batch| &batch.model).collect();
        let mut frames = [0, 1].map(|_| RootFrames::identity(self.model.strand_count));
        for (batch, bytes) in self.batches.iter().zip(self.gpu.read(&models)?) {
            let rows: Vec<Row<f32>> = bytemuck::pod_collect_to_vec(&bytes);
            let blocks = &self.model.blocks[batch.blocks_range()];
            let own = &rows[rows.len() - FRAME_ROWS * blocks.len()..];
            for (block, rows) in blocks.iter().zip(own.chunks_exact(FRAME_ROWS)) {
                for (lane, &strand) in block.strands.iter().enumerate() {
                    for (frames, rows) in frames.iter_mut().zip(rows.chunks_exact(FRAME_ROWS / 2)) {
                        let at = |row: usize| rows[row].0[lane];
                        frames.rotations[strand as usize] = Quat::from_xyzw(at(0), at(1), at(2), at(3));
                        frames.shifts[strand as usize] = Vec3::new(at(4), at(5), at(6));
                    }
                }
            }
        }
        Ok(Some(frames))
    }
}
