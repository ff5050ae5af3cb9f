//! Positions on the device, for renderers that share it, and read-backs that do not wait.

use crate::batch::Batch;
use crate::{GpuError, GpuSimulation};
use forelock_core::lane::{LANES, Row};
use forelock_core::strands::{Model, world_positions};
use glam::{DVec3, Vec3};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// The positions of all strands on the device.
///
/// # Layout
/// Strands are divided into batches, each with a buffer of its own. A buffer is an array of float32
/// rows of [`LANES`] = 16 numbers. Sixteen strands of equal particle count lie side by side, one a
/// lane: component `c` of particle `i` of the strand in lane `l` of a [`DeviceBlock`] is number
///
/// ```text
/// 16 (3 (first + i) + c) + l
/// ```
///
/// Positions are relative to `origin`, along the world's axes, in metres. Lanes from `live` on
/// repeat the last strand.
#[derive(Clone, Debug, Default)]
pub struct DevicePositions {
    /// The point of the world that positions are relative to after the last frame that was
    /// recorded.
    pub origin: DVec3,
    /// A buffer a batch, with usages `STORAGE | COPY_SRC | COPY_DST`.
    pub buffers: Vec<wgpu::Buffer>,
    /// Where strands are in the buffers.
    pub blocks: Vec<DeviceBlock>,
    /// Where the particles of the groom are: for each buffer, and each particle in it, the index of
    /// its x in the buffer and its own index in the groom. y and z follow at a distance of
    /// [`STRIDE`](Self::STRIDE). Some solvers have particles between them, which are not there.
    pub places: Vec<Vec<[u32; 2]>>,
    /// Another number whenever buffers and places are other ones: after edits, changes of the
    /// solver, and going back over either.
    pub revision: u64,
}

/// Sixteen strands in a buffer of [`DevicePositions`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DeviceBlock {
    /// Number of the buffer.
    pub buffer: usize,
    /// Place of the first particles.
    pub first: usize,
    /// Particles per strand.
    pub particles: usize,
    /// The groom's strand in each lane.
    pub strands: [u32; LANES],
    /// Lanes that hold a strand of their own.
    pub live: usize,
}

impl DevicePositions {
    pub(crate) fn of(model: &Model<f32>, batches: &[Batch], origin: DVec3) -> Self {
        let mut blocks = Vec::with_capacity(model.blocks.len());
        for (buffer, batch) in batches.iter().enumerate() {
            blocks.extend(model.blocks[batch.blocks_range()].iter().map(|block| DeviceBlock {
                buffer,
                first: block.first - batch.first_place(),
                particles: block.particles,
                strands: block.strands,
                live: block.live,
            }));
        }
        let buffers: Vec<_> = batches.iter().map(|batch| batch.positions.clone()).collect();
        let mut places = vec![Vec::new(); buffers.len()];
        for block in &blocks {
            for (lane, &strand) in block.strands[..block.live].iter().enumerate() {
                let from = model.groom_offset(strand as usize);
                let own = (0..block.particles).step_by(model.every as usize).enumerate();
                places[block.buffer].extend(own.map(|(p, i)| {
                    let x = LANES * 3 * (block.first + i) + lane;
                    [x as u32, (from + p) as u32]
                }));
            }
        }
        static REVISIONS: AtomicU64 = AtomicU64::new(1);
        Self { origin, buffers, blocks, places, revision: REVISIONS.fetch_add(1, Ordering::Relaxed) }
    }

    /// From the index of a coordinate to that of the next one, float32 numbers.
    pub const STRIDE: u32 = LANES as u32;
}

/// Whether a mapping has ended, and how.
type Outcome = Arc<Mutex<Option<Result<(), wgpu::BufferAsyncError>>>>;

/// A read-back of positions that is under way.
#[derive(Debug)]
pub struct PendingPositions {
    staging: Vec<wgpu::Buffer>,
    outcomes: Vec<Outcome>,
    origin: DVec3,
}

impl GpuSimulation {
    /// Begins to copy the positions after the last submitted frame, and does not wait.
    /// [`GpuSimulation::try_read`] finishes it, in a later frame or from a browser's loop.
    pub fn begin_read(&self) -> PendingPositions {
        let device = self.gpu.device();
        let mut encoder = device.create_command_encoder(&Default::default());
        let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
        let copy = |buffer: &wgpu::Buffer| {
            let staging = self.gpu.buffer("positions read-back", buffer.size(), usage);
            encoder.copy_buffer_to_buffer(buffer, 0, &staging, 0, buffer.size());
            staging
        };
        let staging: Vec<_> = self.positions.buffers.iter().map(copy).collect();
        self.gpu.queue().submit([encoder.finish()]);
        let map = |buffer: &wgpu::Buffer| {
            let outcome = Outcome::default();
            let told = Arc::clone(&outcome);
            buffer.map_async(wgpu::MapMode::Read, .., move |result| {
                *told.lock().unwrap_or_else(PoisonError::into_inner) = Some(result);
            });
            outcome
        };
        let outcomes = staging.iter().map(map).collect();
        PendingPositions { staging, outcomes, origin: self.origin }
    }

    /// Finishes a read-back if the device has copied everything: positions in world space and the
    /// groom's order, `[P]`, metres. Returns whether it had; does not wait.
    ///
    /// # Errors
    /// [`GpuError::Failed`] if the device has failed.
    pub fn try_read(&self, pending: &PendingPositions, out: &mut Vec<Vec3>) -> Result<bool, GpuError> {
        self.gpu.poll()?;
        for outcome in &pending.outcomes {
            match &*outcome.lock().unwrap_or_else(PoisonError::into_inner) {
                None => return Ok(false),
                Some(Err(error)) => return Err(self.gpu.failed(&error.to_string())),
                Some(Ok(())) => {}
            }
        }
        let mut rows: Vec<Row<f32>> = Vec::with_capacity(3 * self.model.places());
        for staging in &pending.staging {
            rows.extend_from_slice(&bytemuck::pod_collect_to_vec(&staging.get_mapped_range(..)));
        }
        world_positions(&self.model, &rows, pending.origin, out);
        Ok(true)
    }
}
