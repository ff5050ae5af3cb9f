//! Strands in batches that each fit into the bindings of a device.

use crate::channels::DeviceChannels;
use crate::collide::{SolidBindings, Solids};
use crate::frame::{CheckBindings, MODEL_ROWS, StrandBindings, WindBindings};
use crate::kernel::{Bound, StrandThreads, WORKGROUP};
use crate::uniforms::{BlockEntry, FrameUniform, ReportEntry, SubstepUniform, UNKNOWN};
use crate::{Gpu, GpuError};
use forelock_core::frame::FRAME_ROWS;
use forelock_core::lane::{LANES, Row};
use forelock_core::strands::{Channel, Model, SCRATCH_ROWS, State};
use std::ops::Range;
use wgpu::BufferUsages;

/// Maximum size of the scratch buffer, bytes, if the device can bind more. The batches use the
/// buffer one after another.
const SCRATCH_BYTES: u64 = 512 << 20;
/// Bytes of a row.
const ROW: u64 = size_of::<Row<f32>>() as u64;

/// What all batches use.
#[derive(Debug)]
pub(crate) struct Shared {
    /// `FrameUniform`.
    pub frame: wgpu::Buffer,
    /// A `SubstepUniform` a substep, each at a multiple of `stride`.
    pub substeps: wgpu::Buffer,
    pub stride: u32,
    pub scratch: wgpu::Buffer,
    /// `ReportEntry`.
    pub report: wgpu::Buffer,
}

/// Some blocks of strands on the device.
#[derive(Debug)]
pub(crate) struct Batch {
    /// Blocks of the model that are here.
    range: Range<usize>,
    /// Places of the model that are here.
    pub places: Range<usize>,
    /// The threads that its strands take.
    pub threads: StrandThreads,
    pub blocks: wgpu::Buffer,
    pub model: wgpu::Buffer,
    pub strands: wgpu::Buffer,
    pub positions: wgpu::Buffer,
    /// Where the solver keeps the positions of the step before, they follow the velocities, and the
    /// load follows them.
    pub velocities: wgpu::Buffer,
    /// Integrity and clearance, two rows a place.
    pub memory: wgpu::Buffer,
    /// The channels of the solver, as in the state; of no meaning without one.
    pub channels: wgpu::Buffer,
}

/// The strands of a simulation on the device.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DeviceStrands<'a> {
    /// The model.
    pub model: &'a Model<f32>,
    /// What all batches use.
    pub shared: &'a Shared,
    /// The batches.
    pub batches: &'a [Batch],
}

/// Bind groups of strands, one a batch.
#[derive(Debug, Default)]
pub(crate) struct StrandGroups {
    pub strands: Vec<Bound<StrandBindings<'static>>>,
    pub checks: Vec<Bound<CheckBindings<'static>>>,
    pub wind: Vec<Bound<WindBindings<'static>>>,
    pub solids: Vec<Bound<SolidBindings<'static>>>,
}

impl StrandGroups {
    /// Binds `strands`, their `channels` and `solids`; `winds` are the wind fields of the batches,
    /// if there are any yet.
    pub fn new(
        gpu: &Gpu,
        strands: DeviceStrands<'_>,
        channels: &DeviceChannels,
        solids: &Solids,
        winds: Option<&[wgpu::Buffer]>,
    ) -> Self {
        let mut groups = Self::default();
        let shared = strands.shared;
        for (number, batch) in strands.batches.iter().enumerate() {
            let bindings = StrandBindings {
                frame: &shared.frame,
                substep: &shared.substeps,
                blocks: &batch.blocks,
                model: &batch.model,
                positions: &batch.positions,
                velocities: &batch.velocities,
                memory: &batch.memory,
                scratch: &shared.scratch,
                report: &shared.report,
            };
            groups.strands.push(bindings.bind(gpu, batch.threads));
            let bindings = CheckBindings {
                frame: &shared.frame,
                substep: &shared.substeps,
                blocks: &batch.blocks,
                model: &batch.model,
                positions: &batch.positions,
                velocities: &batch.velocities,
                memory: &batch.memory,
                report: &shared.report,
                channels: &batch.channels,
                channel_starts: channels.starts(),
            };
            groups.checks.push(bindings.bind(gpu, batch.threads));
            let bindings = WindBindings {
                frame: &shared.frame,
                substep: &shared.substeps,
                blocks: &batch.blocks,
                model: &batch.model,
                strands: &batch.strands,
                positions: &batch.positions,
                velocities: &batch.velocities,
                memory: &batch.memory,
                scratch: &shared.scratch,
                // Without a wind field kernels do not read it, but WebGPU wants a buffer.
                wind: winds.map_or(&batch.strands, |winds| &winds[number]),
            };
            groups.wind.push(bindings.bind(gpu, batch.threads));
            let bindings = SolidBindings {
                frame: &shared.frame,
                blocks: &batch.blocks,
                model: &batch.model,
                positions: &batch.positions,
                velocities: &batch.velocities,
                memory: &batch.memory,
                scratch: &shared.scratch,
                report: &shared.report,
                fields: &solids.fields,
                query: &solids.queries,
            };
            groups.solids.push(bindings.bind(gpu, batch.threads));
        }
        groups
    }
}

/// The blocks of `model`, whose particles have `channel_rows` of channels, in ranges of which each
/// fits into the device's bindings.
pub(crate) fn split(gpu: &Gpu, model: &Model<f32>, channel_rows: u32) -> Result<Vec<Range<usize>>, GpuError> {
    let limits = gpu.device().limits();
    let limit = gpu.most_bound().min(SCRATCH_BYTES);
    let most_blocks = limits.max_compute_workgroups_per_dimension as usize * WORKGROUP as usize / LANES;
    let mut batches: Vec<Range<usize>> = Vec::new();
    let rows = u64::from(channel_rows).max(SCRATCH_ROWS as u64);
    let mut bytes = 0;
    for (k, block) in model.blocks.iter().enumerate() {
        let own = block.particles as u64 * rows * ROW;
        gpu.check_room("sixteen strands of that many particles", own, limit)?;
        match batches.last_mut() {
            Some(last) if bytes + own <= limit && last.len() < most_blocks => {
                last.end = k + 1;
                bytes += own;
            }
            _ => {
                batches.push(k..k + 1);
                bytes = own;
            }
        }
    }
    Ok(batches)
}

impl Shared {
    /// For batches of up to `places` places and frames of `substeps`.
    pub fn new(gpu: &Gpu, places: usize, substeps: u32) -> Self {
        let stride = gpu.uniform_stride(size_of::<SubstepUniform>());
        let uniform = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
        let storage = BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
        let scratch = places as u64 * SCRATCH_ROWS as u64 * ROW;
        Self {
            frame: gpu.buffer("frame", size_of::<FrameUniform>() as u64, uniform),
            substeps: gpu.buffer("substeps", u64::from(stride) * u64::from(substeps), uniform),
            stride,
            scratch: gpu.buffer("scratch", scratch, BufferUsages::STORAGE),
            report: gpu.buffer("report", size_of::<ReportEntry>() as u64, storage),
        }
    }

    /// Makes room for `substeps`. Returns whether the buffer is a new one.
    pub fn hold(&mut self, gpu: &Gpu, substeps: u32) -> bool {
        let bytes = u64::from(self.stride) * u64::from(substeps);
        let grows = bytes > self.substeps.size();
        if grows {
            self.substeps = gpu.buffer("substeps", bytes, BufferUsages::UNIFORM | BufferUsages::COPY_DST);
        }
        grows
    }

    /// Bytes held.
    pub fn bytes(&self) -> u64 {
        [&self.frame, &self.substeps, &self.scratch, &self.report].iter().map(|buffer| buffer.size()).sum()
    }
}

impl Batch {
    /// `blocks` of `model`, whose particles have `channel_rows` of channels, without a state yet.
    pub fn new(gpu: &Gpu, model: &Model<f32>, blocks: Range<usize>, channel_rows: u32) -> Self {
        let own = &model.blocks[blocks.clone()];
        let places = own[0].first..own[own.len() - 1].range().end;
        let entries = entries(model, blocks.clone(), |_| 1);
        let rows = all_model_rows(model, places.clone());
        let strands: Vec<Row<f32>> =
            blocks.clone().flat_map(|block| [model.strand_lengths[block], model.stiffness[block]]).collect();
        let read = BufferUsages::STORAGE | BufferUsages::COPY_DST;
        let change = read | BufferUsages::COPY_SRC;
        let range = blocks;
        let blocks = gpu.filled("blocks", bytemuck::cast_slice(&entries), read);
        let arrays = if model.local.is_empty() { 1 } else { 3 };
        let longest = own.iter().map(|block| block.particles).max().unwrap_or(0) as u32;
        let model = gpu.filled("model", bytemuck::cast_slice(&rows), read);
        let strands = gpu.filled("strands", bytemuck::cast_slice(&strands), read);
        let room = places.len() as u64 * ROW;
        let positions = gpu.buffer("positions", 3 * room, change);
        let velocities = gpu.buffer("velocities", 3 * arrays * room, change);
        let memory = gpu.buffer("memory", 2 * room, change);
        let channels = gpu.buffer("channels", (u64::from(channel_rows) * room).max(ROW), change);
        Self {
            threads: StrandThreads {
                workgroups: (own.len() * LANES).div_ceil(WORKGROUP as usize) as u32,
                longest,
            },
            places,
            range,
            blocks,
            model,
            strands,
            positions,
            velocities,
            memory,
            channels,
        }
    }

    /// Bytes of the model before the motions of strands relative to the head.
    fn before_root_frames(&self, model: &Model<f32>) -> u64 {
        let row_count = if model.masses.is_empty() { MODEL_ROWS } else { MODEL_ROWS + 1 };
        u64::from(row_count) * self.places.len() as u64 * ROW
    }

    /// Makes room for the motions of strands relative to the head after its part of `model`.
    /// Returns whether it has made a new buffer of it.
    pub fn hold_root_frames(&mut self, gpu: &Gpu, model: &Model<f32>) -> bool {
        let grows = self.model.size() == self.before_root_frames(model);
        if grows {
            let mut rows = all_model_rows(model, self.places.clone());
            rows.resize(rows.len() + FRAME_ROWS * self.range.len(), Row([0.0; LANES]));
            let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
            self.model = gpu.filled("model", bytemuck::cast_slice(&rows), usage);
        }
        grows
    }

    /// Uploads its part of these motions: all `frames`, packed, of a `model`.
    pub fn write_root_frames(&self, gpu: &Gpu, model: &Model<f32>, frames: &[Row<f32>]) {
        let own = &frames[FRAME_ROWS * self.range.start..FRAME_ROWS * self.range.end];
        let at = self.before_root_frames(model);
        gpu.queue().write_buffer(&self.model, at, bytemuck::cast_slice(own));
    }

    /// Sets how many samples the grid takes of the edges of each block of `model`.
    pub fn set_points(&self, gpu: &Gpu, model: &Model<f32>, points: &[u32]) {
        let entries = entries(model, self.range.clone(), |k| points[k]);
        gpu.queue().write_buffer(&self.blocks, 0, bytemuck::cast_slice(&entries));
    }

    /// Its blocks in the model.
    pub fn blocks_range(&self) -> Range<usize> {
        self.range.clone()
    }

    /// Its first place in the model.
    pub fn first_place(&self) -> usize {
        self.places.start
    }

    /// Bytes held on the device.
    pub fn bytes(&self) -> u64 {
        let constant = [&self.blocks, &self.model, &self.strands];
        constant.into_iter().chain(self.state()).map(|buffer| buffer.size()).sum()
    }

    /// Uploads its part of `state`.
    pub fn write(&self, gpu: &Gpu, state: &State<f32>) {
        let (from, to) = (self.places.start, self.places.end);
        let memory: Vec<Row<f32>> = self
            .places
            .clone()
            .flat_map(|place| [state.integrity[place], known(state.clearance[place])])
            .collect();
        let queue = gpu.queue();
        queue.write_buffer(&self.positions, 0, bytemuck::cast_slice(&state.positions[3 * from..3 * to]));
        queue.write_buffer(&self.velocities, 0, bytemuck::cast_slice(&state.velocities[3 * from..3 * to]));
        if !state.previous.is_empty() {
            let previous = bytemuck::cast_slice(&state.previous[3 * from..3 * to]);
            queue.write_buffer(&self.velocities, self.velocities.size() / 3, previous);
        }
        queue.write_buffer(&self.memory, 0, bytemuck::cast_slice(&memory));
        queue.write_buffer(
            &self.channels,
            0,
            bytemuck::cast_slice(&state.extra.rows()[self.channels_of(state)]),
        );
    }

    /// Its rows of the channels of `state`.
    fn channels_of(&self, state: &State<f32>) -> Range<usize> {
        let rows: usize = state.extra.channels().map(Channel::rows).sum();
        rows * self.places.start..rows * self.places.end
    }

    /// The buffers of its part of the state.
    pub fn state(&self) -> [&wgpu::Buffer; 4] {
        [&self.positions, &self.velocities, &self.memory, &self.channels]
    }

    /// Copies its part of `state` from the bytes of [`Batch::state`].
    pub fn take(&self, [positions, velocities, memory, channels]: [&[u8]; 4], state: &mut State<f32>) {
        let (from, to) = (self.places.start, self.places.end);
        bytemuck::cast_slice_mut(&mut state.positions[3 * from..3 * to]).copy_from_slice(positions);
        let own = if state.previous.is_empty() { velocities.len() } else { velocities.len() / 3 };
        let (velocities, later) = velocities.split_at(own);
        bytemuck::cast_slice_mut(&mut state.velocities[3 * from..3 * to]).copy_from_slice(velocities);
        if !state.previous.is_empty() {
            bytemuck::cast_slice_mut(&mut state.previous[3 * from..3 * to]).copy_from_slice(&later[..own]);
        }
        let range = self.channels_of(state);
        let own: &mut [u8] = bytemuck::cast_slice_mut(&mut state.extra.rows_mut()[range]);
        own.copy_from_slice(&channels[..own.len()]);
        let rows: Vec<[Row<f32>; 2]> = bytemuck::pod_collect_to_vec(memory);
        for (place, [integrity, clearance]) in self.places.clone().zip(rows) {
            let unknown = |x: f32| if x <= UNKNOWN { f32::NEG_INFINITY } else { x };
            (state.integrity[place], state.clearance[place]) = (integrity, Row(clearance.0.map(unknown)));
        }
    }
}

/// The rows of all `places` of `model`, and their masses.
fn all_model_rows(model: &Model<f32>, places: Range<usize>) -> Vec<Row<f32>> {
    let mut rows = Vec::with_capacity(places.len() * MODEL_ROWS as usize);
    for place in places.clone() {
        rows.extend(model_rows(model, place));
    }
    rows.extend(model.masses.get(places).unwrap_or_default());
    rows
}

/// The rows of a place of `model`: rest position, rest length to the next particle; then, as the
/// solver needs, the edge in its frame, or two more rest lengths and the inverse of the first.
pub(crate) fn model_rows(model: &Model<f32>, place: usize) -> [Row<f32>; MODEL_ROWS as usize] {
    let rows = 3 * place..3 * place + 3;
    let (rest, lengths) = (&model.rest[rows.clone()], &model.rest_lengths[rows.clone()]);
    let last = match model.local.get(rows) {
        Some(local) => [local[0], local[1], local[2]],
        None => [lengths[1], lengths[2], model.inverse_edges[place]],
    };
    [rest[0], rest[1], rest[2], lengths[0], last[0], last[1], last[2]]
}

/// The blocks `range` of `model` for the device, places counted from the first of them, each with
/// its samples an edge.
fn entries(model: &Model<f32>, range: Range<usize>, points: impl Fn(usize) -> u32) -> Vec<BlockEntry> {
    let first = model.blocks[range.start].first;
    let entry = |k: usize| {
        let block = &model.blocks[k];
        BlockEntry {
            first: (block.first - first) as u32,
            particles: block.particles as u32,
            live: block.live as u32,
            points: points(k),
            place: block.first as u32,
            number: k as u32,
        }
    };
    range.map(entry).collect()
}

/// Clearances as the device stores them, where −∞ is [`UNKNOWN`].
fn known(clearance: Row<f32>) -> Row<f32> {
    Row(clearance.0.map(|x| x.max(UNKNOWN)))
}
