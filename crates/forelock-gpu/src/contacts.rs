//! Contacts between segments of strands on the device.
//!
//! # Practice
//! What the CPU does, found another way: entries lie in a table of cells, sorted by counting, in which neighbours along x are neighbours; each active segment is one workgroup, whose threads share what is near it. Nothing
//! comes back in a frame, and nothing depends on the order in which threads come: sums are of integers; what does not fit is chosen by what it is, not by when it came; each sum of floats is taken by one thread,
//! over a list in order of time. Lists have room for more than a budget chooses on the whole, by many deviations of what chance may make of it.
//!
//! Memory: 12 bytes a particle, and a table of 8 or more. All else, 76 bytes a particle and more and what the budget takes (10 MB by default), lies in the strands' scratch where that has room: it has from 230,000 particles on, as long as they are
//! one batch; of many batches there is a second copy of the model, 28 bytes a particle.
//!
//! # Limitations
//! What one binding holds bounds the strands: 76 bytes a particle, 1.7 million particles where a device binds 128 MiB. Of an active segment the [`SLOTS`] contacts of the greatest approach are taken up, where the CPU takes up all; of those each segment keeps the first `per_segment`, there and here. Of contacts that approach about as fast as the last that the budget has room for, a
//! share is taken, spread evenly, where the CPU takes the first; the budget is of the whole frame, where there it is kept slice by slice. So is a share taken of a run of more than `RUN_SEGMENTS` segments. Particles that stray farther than 64 edges count as such when the frame is cut
//! into slices. A segment that is stretched by more than a quarter beyond its rest length may be met at its middle only.

use crate::batch::{Batch, Shared, model_rows};
use crate::kernels::MODEL_ROWS;
use crate::layout::{NO_EXTENT, rigid};
use crate::{Gpu, GpuError};
use bytemuck::{Pod, Zeroable};
use forelock_core::interaction::contact::{ContactParams, ContactReport, drift, fastest};
use forelock_core::lane::{LANES, Row};
use forelock_core::strands::Model;
use forelock_core::pose::Pose;
use forelock_core::interaction::contact::find_contacts::{FEW, PIECE, PIECES, SEGMENT_CONTACTS, search_edge};
use forelock_core::interaction::contact::resolve_contacts::CLOSE;
use glam::{Mat4, UVec3, Vec3};
use wgpu::BufferUsages;

/// Contacts that are taken up of an active segment.
pub const SLOTS: u32 = 64;
/// Contacts that an active segment may find in a slice, with those of earlier slices.
pub const FOUND: u32 = 512;
/// Entries that the threads of an active segment look at before those are followed that it may touch.
pub const QUEUE: u32 = 512;
/// Workgroups that active segments are shared by.
pub const MEET_GROUPS: u32 = 2048;
/// Cells in a row of the table: entries of one row lie one after the other.
pub const ROW_CELLS: u32 = 1024;
/// Workgroups that lay out rows.
pub const ROW_GROUPS: u32 = 256;
/// Half of a piece that is stretched by a quarter, over the length that the search is made for.
pub const HALF_PIECE: f32 = 0.5 * 1.25 * PIECE;

/// Rows of `work` a place that last.
pub const WAY_ROWS: u64 = 4;
/// Rows of bodies there.
pub const BODY_ROWS: u64 = 15;
/// Numbers of a joint, and of its two sides.
const JOINT_NUMBERS: u64 = 28;
const SIDE_NUMBERS: u64 = 8;

/// Contacts in a frame: `Meet` in the kernels, which say what fields are.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[expect(missing_docs, reason = "beside the kernels")]
pub struct MeetUniform {
    pub from_start: Mat4,
    pub from_end: Mat4,
    pub edge: f32,
    pub distance: f32,
    pub slip: f32,
    pub friction: f32,
    pub spread: f32,
    pub dt: f32,
    pub close: f32,
    pub far: f32,
    pub spacing: f32,
    pub inverse_piece: f32,
    pub inverse_particles: f32,
    pub pad_0: f32,
    pub budget: u32,
    pub most_active: u32,
    pub few: u32,
    pub per_segment: u32,
    pub rounds: u32,
    pub clamped: u32,
    pub cells: u32,
    pub entries: u32,
    pub numbers: u32,
    pub bodies: u32,
    pub found: u32,
    pub joints: u32,
    pub sides: u32,
    pub most_actives: u32,
    pub most_joints: u32,
    pub strands: u32,
}

/// What a frame's contacts are found with: the beginning of `Touch` in the kernels, which say what fields are.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[expect(missing_docs, reason = "beside the kernels")]
pub struct TouchEntry {
    pub low: Vec3,
    pub spacing: f32,
    pub high: Vec3,
    pub slices: u32,
    pub dims: UVec3,
    pub slice: u32,
    pub extent: [u32; 6],
    pub squares: [u32; 2],
    pub fastest: u32,
    pub actives: u32,
    pub joints: u32,
    pub taken: u32,
    pub least: f32,
    pub bin: u32,
    pub share: f32,
    pub found_bin: u32,
    pub found_share: f32,
    pub momentum: f32,
    pub round: u32,
    pub last: u32,
    pub done: u32,
    pub lack: u32,
    pub farthest: u32,
    pub shelves: u32,
}

/// The contacts of a simulation.
#[derive(Debug)]
pub(crate) struct DeviceContacts {
    pub params: ContactParams,
    pub uniform: wgpu::Buffer,
    pub starts: wgpu::Buffer,
    pub work: wgpu::Buffer,
    pub table: wgpu::Buffer,
    pub touch: wgpu::Buffer,
    /// The model of all strands: that of the only batch, or one more.
    pub rest: wgpu::Buffer,
    pub owners: wgpu::Buffer,
    /// Bytes of those that are no one else's.
    bytes: u64,
    host: Box<MeetUniform>,
}

impl DeviceContacts {
    /// Contacts of the strands of `model`, which are on the device in `batches`.
    pub fn new(
        gpu: &Gpu,
        (model, shared): (&Model<f32>, &Shared),
        batches: &[&Batch],
        params: &ContactParams,
    ) -> Result<Self, GpuError> {
        params.validate()?;
        let edge = search_edge(model, params);
        let inverse_piece = 1.0 / (PIECE * edge);
        let (mut segments, mut entries, mut longest) = (0, 0, 0.0f32);
        for block in &model.blocks {
            for place in block.first..block.first + block.particles - 1 {
                for length in &model.rest_lengths[3 * place].0[..block.live] {
                    segments += 1;
                    entries += (length * inverse_piece).ceil().clamp(1.0, PIECES) as u64;
                    longest = longest.max(*length);
                }
            }
        }
        let budget = u64::from(params.budget);
        let most_active = budget / SEGMENT_CONTACTS as u64;
        // A particle has two segments; what the last bin has by its share may be some more.
        let most_actives = (2 * most_active + most_active / 8 + 256).min(segments).max(1);
        let most_joints = (budget + budget / 8 + 1024).min(most_actives * u64::from(SLOTS));
        let cells = entries.next_power_of_two().max(u64::from(ROW_CELLS));
        let (numbers, strands) = ((LANES * model.places()) as u64, (LANES * model.blocks.len()) as u64);
        let nodes = (drift::NODES as u64 + 1).pow(3);
        let bodies = WAY_ROWS * numbers;
        let found = bodies + (BODY_ROWS * numbers).max(5 * entries).max(4 * nodes);
        let joints = found + 2 * u64::from(SLOTS) * most_actives;
        let sides = joints + JOINT_NUMBERS * most_joints;
        let work = 4 * (sides + SIDE_NUMBERS * most_joints);
        let table = 4 * (2 * cells).max(2 * numbers + strands).max(8 * nodes);
        let room = u64::MAX;
        gpu.check_room(
            "contacts between so many strands, or within so large a budget,",
            work.max(table),
            room,
        )?;
        gpu.check_room("contacts between so many strands", numbers * u64::from(MODEL_ROWS) * 4, room)?;
        let storage = BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
        let starts = gpu.buffer("starts", 12 * numbers, storage);
        let table = gpu.buffer("table", table, storage);
        let mut touch =
            bytemuck::bytes_of(&TouchEntry { extent: NO_EXTENT, ..TouchEntry::zeroed() }).to_vec();
        touch.resize(touch.len() + 4 * (fastest::BINS + most_actives as usize), 0);
        let touch = gpu.filled("touch", &touch, storage);
        let owners = gpu.filled("owners", bytemuck::cast_slice(&model.block_of_places()), storage);
        let mut bytes = [&starts, &table, &touch, &owners].iter().map(|buffer| buffer.size()).sum::<u64>();
        let work = if shared.scratch.size() >= work {
            shared.scratch.clone()
        } else {
            bytes += work;
            gpu.buffer("work", work, storage)
        };
        let rest = if let [only] = batches {
            only.model.clone()
        } else {
            let rows: Vec<Row<f32>> =
                (0..model.places()).flat_map(|place| model_rows(model, place)).collect();
            let rest = gpu.filled("rest", bytemuck::cast_slice(&rows), storage);
            bytes += rest.size();
            rest
        };
        let host = MeetUniform {
            edge,
            distance: params.distance as f32,
            friction: params.friction as f32,
            spread: params.spread as f32,
            close: CLOSE * params.distance as f32,
            far: drift::FAR * model.reach as f32,
            spacing: drift::SPACING.max(4.0 * longest),
            inverse_piece,
            inverse_particles: 1.0 / model.particle_count.max(1) as f32,
            budget: params.budget,
            most_active: most_active as u32,
            few: (model.particle_count / FEW) as u32,
            per_segment: params.per_segment,
            rounds: params.rounds,
            cells: cells as u32,
            entries: entries as u32,
            numbers: numbers as u32,
            bodies: bodies as u32,
            found: found as u32,
            joints: joints as u32,
            sides: sides as u32,
            most_actives: most_actives as u32,
            most_joints: most_joints as u32,
            strands: strands as u32,
            ..MeetUniform::zeroed()
        };
        let uniform = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
        let uniform = gpu.buffer("meet", size_of::<MeetUniform>() as u64, uniform);
        bytes += uniform.size();
        let (params, host) = (params.clone(), Box::new(host));
        Ok(Self { params, uniform, starts, work, table, touch, rest, owners, bytes, host })
    }

    /// Bytes held on the device.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Brings a frame to the device: the head at its start and at its end, about the model's centre, where positions are relative to the origin then.
    pub fn place(&mut self, gpu: &Gpu, [start, end]: [&Pose; 2], (clamped, dt_secs): (u32, f64)) {
        let host = &mut *self.host;
        [host.from_start, host.from_end] = [start, end].map(|pose| rigid(&pose.inverse()));
        host.slip = self.params.let_pass(dt_secs);
        (host.clamped, host.dt) = (clamped, dt_secs as f32);
        gpu.queue().write_buffer(&self.uniform, 0, bytemuck::bytes_of(host));
    }
}

impl TouchEntry {
    /// What it says of a frame, with the contacts that were resolved.
    pub(crate) fn report(&self, contacts: u32) -> ContactReport {
        let farthest_m = f32::from_bits(self.farthest).into();
        ContactReport { contacts: contacts as usize, farthest_m, ..ContactReport::default() }
    }
}
