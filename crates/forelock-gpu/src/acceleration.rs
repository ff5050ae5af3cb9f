//! Acceleration in addition to gravity on the device.

use crate::Gpu;
use crate::batch::DeviceStrands;
use crate::kernel::{Bound, Constant, DispatchList, Shader, Threads, bindings, shader};
use crate::uniforms::FrameUniform;
use bytemuck::{Pod, Zeroable};
use forelock_core::frame::{ACCELERATION_WGSL, Acceleration, LATTICE};
use forelock_core::lane::Row;
use forelock_core::strands::Model;
use glam::{DVec3, Vec3, Vec4};
use wgpu::BufferUsages;

bindings! {
    /// From a lattice to particles, and from these to velocities.
    pub(crate) struct AccelerationBindings {
        0 frame: uniform(FrameUniform),
        2 blocks: read,
        5 positions: read_write,
        6 velocities: read_write,
        17 acceleration: read_write,
        18 nodes: read,
        20 lattice: uniform(LatticeUniform),
    }
}

shader! {
    /// `accelerate`.
    ACCELERATION: "accelerate", AccelerationBindings;
    texts: [ACCELERATION_WGSL];
    constants: [&[Constant::u32("LATTICE", LATTICE)]];
    kernels: {
        /// Interpolates the field at each particle.
        SAMPLE_ACCELERATION: "sample_acceleration", Threads::Strands;
        /// Adds h a to velocities.
        ACCELERATE: "accelerate", Threads::Strands;
    }
}

pub(crate) static SHADERS: &[&Shader] = &[&ACCELERATION];

/// A lattice around the hair: `Lattice` in the kernel.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct LatticeUniform {
    /// The first node, relative to the origin of positions.
    pub low: Vec3,
    /// One over the side of a cell, 1/m.
    pub per_metre: f32,
}

/// What a frame has in addition to gravity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Accelerated {
    /// Each particle has its acceleration.
    PerParticle,
    /// The lattice has those of a field.
    Field,
}

/// The acceleration of a simulation.
#[derive(Debug)]
pub(crate) struct DeviceAcceleration {
    uniform: wgpu::Buffer,
    nodes: wgpu::Buffer,
    /// Three rows a place: a buffer a batch.
    rows: Vec<wgpu::Buffer>,
    groups: Vec<Bound<AccelerationBindings<'static>>>,
    host: Vec<Row<f32>>,
    lattice: Vec<Vec4>,
    /// What the last frame had.
    kind: Option<Accelerated>,
}

impl DeviceAcceleration {
    /// For `strands`, to be bound before the first frame.
    pub fn new(gpu: &Gpu, strands: DeviceStrands<'_>) -> Self {
        let storage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
        let uniform = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
        let nodes = (LATTICE as usize + 1).pow(3) * size_of::<Vec4>();
        let rows =
            |places: usize| gpu.buffer("acceleration", (3 * places * size_of::<Row<f32>>()) as u64, storage);
        Self {
            uniform: gpu.buffer("lattice", size_of::<LatticeUniform>() as u64, uniform),
            nodes: gpu.buffer("nodes", nodes as u64, storage),
            rows: strands.batches.iter().map(|batch| rows(batch.places.len())).collect(),
            groups: Vec::new(),
            host: Vec::new(),
            lattice: Vec::new(),
            kind: None,
        }
    }

    /// Bytes held on the device.
    pub fn bytes(&self) -> u64 {
        [&self.uniform, &self.nodes].into_iter().chain(&self.rows).map(|buffer| buffer.size()).sum()
    }

    /// Makes its bind groups.
    pub fn bind(&mut self, gpu: &Gpu, strands: DeviceStrands<'_>) {
        let bound = strands.batches.iter().zip(&self.rows).map(|(batch, acceleration)| {
            let bindings = AccelerationBindings {
                frame: &strands.shared.frame,
                blocks: &batch.blocks,
                positions: &batch.positions,
                velocities: &batch.velocities,
                acceleration,
                nodes: &self.nodes,
                lattice: &self.uniform,
            };
            bindings.bind(gpu, batch.threads)
        });
        self.groups = bound.collect();
    }

    /// Appends the samples of a field at the frame's start, if the frame has a field.
    pub fn sample<'a>(&'a self, list: &mut DispatchList<'a>) {
        if self.kind == Some(Accelerated::Field) {
            list.run(&self.groups, &SAMPLE_ACCELERATION, &[]);
        }
    }

    /// Appends h a for one batch before a substep, if the frame has an acceleration.
    pub fn accelerate<'a>(&'a self, list: &mut DispatchList<'a>, batch: usize) {
        if self.kind.is_some() {
            list.push(self.groups[batch].dispatch(&ACCELERATE, &[]));
        }
    }

    /// Uploads the acceleration of a frame, for hair about `centre` whose positions are relative to
    /// `origin` before the frame.
    pub fn write_frame(
        &mut self,
        gpu: &Gpu,
        strands: DeviceStrands<'_>,
        acceleration: &Acceleration<'_>,
        centre: DVec3,
        origin: DVec3,
    ) {
        let model: &Model<f32> = strands.model;
        self.kind = match acceleration {
            Acceleration::PerParticle(all) => {
                Acceleration::pack(all, model, &mut self.host);
                for (batch, rows) in strands.batches.iter().zip(&self.rows) {
                    let own = &self.host[3 * batch.places.start..3 * batch.places.end];
                    gpu.queue().write_buffer(rows, 0, bytemuck::cast_slice(own));
                }
                Some(Accelerated::PerParticle)
            }
            Acceleration::Field(field) => {
                let cell = 2.0 * model.bound / f64::from(LATTICE);
                let low = centre - DVec3::splat(model.bound);
                let side = || (0..=LATTICE).map(|k| f64::from(k) * cell);
                self.lattice.clear();
                self.lattice.extend(side().flat_map(|z| {
                    side().flat_map(move |y| {
                        side().map(move |x| {
                            let a = field(low + DVec3::new(x, y, z)).as_vec3();
                            if a.is_finite() { a.extend(0.0) } else { Vec4::ZERO }
                        })
                    })
                }));
                let uniform =
                    LatticeUniform { low: (low - origin).as_vec3(), per_metre: (1.0 / cell) as f32 };
                gpu.queue().write_buffer(&self.uniform, 0, bytemuck::bytes_of(&uniform));
                gpu.queue().write_buffer(&self.nodes, 0, bytemuck::cast_slice(&self.lattice));
                Some(Accelerated::Field)
            }
            _ => None,
        };
    }
}
