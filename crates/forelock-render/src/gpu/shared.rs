//! Positions that are on the device already.

use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

use super::GpuRenderError;
use super::stages::{FRAME, module, most_bound, workgroups_for};

/// The largest number of particles of a group.
const MOST_PARTICLES: u32 = 1 << 27;
/// The largest margin, metres.
const MOST_MARGIN: f32 = 100.0;

/// Positions of a group of strands that are on the device already, in buffers of what simulates
/// them there, for [`GpuRenderer::share`](super::GpuRenderer::share).
#[derive(Clone, Debug, Default)]
pub struct SharedPositions {
    /// The point that positions are relative to, world space, metres. Simulations move it, so it
    /// must be set anew after each frame. If a simulation gets other buffers, all is made anew.
    pub origin: Vec3,
    /// How far strands may be outside the box of the positions in the scene, 0 (default) to 100
    /// metres. Farther out they cast no shadows on each other; the larger the box, the coarser the
    /// shadows.
    pub margin: f32,
    parts: Vec<Part>,
    /// Which particles have been added, and how many.
    known: Arc<Vec<bool>>,
    count: usize,
}

/// Particles in one buffer.
#[derive(Clone, Debug)]
struct Part {
    positions: wgpu::Buffer,
    places: wgpu::Buffer,
    count: u32,
    stride: u32,
}

impl SharedPositions {
    /// No particles yet, relative to `origin` (world space, metres).
    pub fn new(origin: Vec3) -> Self {
        Self { origin, ..Self::default() }
    }

    /// Adds particles whose coordinates are float32 numbers in `positions`, a buffer of `device`
    /// with the usage `STORAGE`, in metres along the world's axes. `places` are for each particle
    /// the index of its x and the particle's own index in the group, `[K]`; y and z follow at a
    /// distance of
    /// `stride` numbers. Each particle is added once.
    ///
    /// # Errors
    /// [`GpuRenderError::Shared`] if the buffer cannot be read, ends before a particle, or a
    /// particle has been added before.
    pub fn add(
        &mut self,
        device: &wgpu::Device,
        positions: &wgpu::Buffer,
        stride: u32,
        places: &[[u32; 2]],
    ) -> Result<(), GpuRenderError> {
        let wrong = |reason: String| Err(GpuRenderError::Shared(reason));
        if !positions.usage().contains(wgpu::BufferUsages::STORAGE) {
            return wrong("their buffer lacks the usage STORAGE".to_owned());
        }
        let bytes: &[u8] = bytemuck::cast_slice(places);
        for (what, size) in [("their buffer", positions.size()), ("the places", bytes.len() as u64)] {
            if size > most_bound(device) {
                return wrong(format!("{what} of {size} bytes: the GPU allows {}", most_bound(device)));
            }
        }
        let numbers = positions.size() / 4;
        let mut known = self.known.to_vec();
        for [x, particle] in places.iter().copied() {
            if u64::from(x) + 2 * u64::from(stride) >= numbers {
                return wrong(format!("particle {particle} at {x} is beyond the buffer's {numbers} numbers"));
            }
            if particle >= MOST_PARTICLES {
                return wrong(format!("there is no particle {particle}: at most {MOST_PARTICLES}"));
            }
            let index = particle as usize;
            if known.len() <= index {
                known.resize(index + 1, false);
            }
            if std::mem::replace(&mut known[index], true) {
                return wrong(format!("particle {particle} is there twice"));
            }
        }
        if bytes.is_empty() {
            return Ok(());
        }
        let buffer = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("places of shared positions"),
            size: bytes.len() as u64,
            usage: wgpu::BufferUsages::STORAGE,
            mapped_at_creation: true,
        });
        buffer.get_mapped_range_mut(..).copy_from_slice(bytes);
        buffer.unmap();
        let count = places.len() as u32;
        self.parts.push(Part { positions: positions.clone(), places: buffer, count, stride });
        (self.known, self.count) = (known.into(), self.count + places.len());
        Ok(())
    }

    /// Checks that all of `particles` particles of group number `group` have been added.
    pub(super) fn check(&self, group: usize, particles: usize) -> Result<(), GpuRenderError> {
        let found = self.count;
        if !(0.0..=MOST_MARGIN).contains(&self.margin) {
            let margin = self.margin;
            return Err(GpuRenderError::Shared(format!("`margin` is {margin}, not in 0 to {MOST_MARGIN} m")));
        }
        if found == particles && self.known.len() == particles {
            return Ok(());
        }
        Err(GpuRenderError::Shared(format!(
            "group {group} has {particles} particles, but {found} were added"
        )))
    }
}

/// The struct of the same name in `gather.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct GatherData {
    pub origin: [f32; 3],
    pub stride: u32,
    pub first: u32,
    pub count: u32,
    pub unused: [u32; 2],
}

/// The text of the kernel.
pub(super) const TEXTS: &[&str] = &[FRAME, include_str!("wgsl/gather.wgsl")];

/// Gathers shared positions into the renderer's own buffer.
#[derive(Debug)]
pub(super) struct Gatherer {
    pipeline: wgpu::ComputePipeline,
    /// What each part is gathered by.
    uniforms: Vec<wgpu::Buffer>,
}

impl Gatherer {
    pub fn new(device: &wgpu::Device) -> Self {
        let module = module(device, "gather", TEXTS);
        let pipeline = device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some("gather"),
            layout: None,
            module: &module,
            entry_point: Some("gather"),
            compilation_options: Default::default(),
            cache: None,
        });
        Self { pipeline, uniforms: Vec::new() }
    }

    /// Gathers `shared` into `gathered`. Each group is given with the index of its first coordinate
    /// there.
    pub fn gather(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        gathered: &wgpu::Buffer,
        shared: &[(u32, &SharedPositions)],
    ) {
        let parts =
            shared.iter().flat_map(|(first, own)| own.parts.iter().map(move |part| (*first, own, part)));
        let mut encoder = device.create_command_encoder(&Default::default());
        for (index, (first, shared, part)) in parts.enumerate() {
            if index == self.uniforms.len() {
                self.uniforms.push(device.create_buffer(&wgpu::BufferDescriptor {
                    label: Some("a part of shared positions"),
                    size: size_of::<GatherData>() as u64,
                    usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
                    mapped_at_creation: false,
                }));
            }
            let uniform = &self.uniforms[index];
            let Part { positions, places, count, stride } = part;
            let origin = shared.origin.into();
            let data = GatherData { origin, stride: *stride, first, count: *count, unused: [0; 2] };
            queue.write_buffer(uniform, 0, bytemuck::bytes_of(&data));
            let buffers = [uniform, gathered, positions, places];
            let entries: Vec<_> = (0..)
                .zip(buffers)
                .map(|(binding, own)| wgpu::BindGroupEntry { binding, resource: own.as_entire_binding() })
                .collect();
            let bound = device.create_bind_group(&wgpu::BindGroupDescriptor {
                label: Some("gather"),
                layout: &self.pipeline.get_bind_group_layout(0),
                entries: &entries,
            });
            let mut pass = encoder.begin_compute_pass(&Default::default());
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, &bound, &[]);
            let [x, y] = workgroups_for(*count);
            pass.dispatch_workgroups(x, y, 1);
        }
        queue.submit([encoder.finish()]);
    }
}
