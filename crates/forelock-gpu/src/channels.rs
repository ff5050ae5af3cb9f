//! The channels of a solver on the device: state of particles beside positions and velocities.
//!
//! # Practice
//! Each batch has the rows of its particles as the CPU has them
//! ([`ChannelStore`](forelock_core::strands::ChannelStore)). The host keeps which channels have
//! values. The others start in the first frame that solves strands, and strands that are reset
//! start anew: for both, each frame uploads the initial value of each row of a particle, turned
//! with the head; kernels turn it by the strand's own motion, if it has one.

use crate::Gpu;
use crate::batch::DeviceStrands;
use crate::frame::ROOT_CONSTANTS;
use crate::kernel::{Bound, DispatchList, Shader, Threads, bindings, shader};
use crate::uniforms::{CHANNEL_KINDS, ChannelRowEntry, FrameUniform, SubstepUniform, channel_kinds};
use forelock_core::frame::{CHANNELS_WGSL, ChannelKind, FrameInput, ROOTS_WGSL, START_CHANNELS_WGSL};
use forelock_core::strands::{Channel, State};
use wgpu::BufferUsages;

bindings! {
    /// Channels and their initial values.
    pub(crate) struct ChannelBindings {
        0 frame: uniform(FrameUniform),
        1 substep: dynamic(SubstepUniform),
        2 blocks: read,
        3 model: read,
        35 channels: read_write,
        36 channel_starts: read,
    }
}

shader! {
    /// `start_channels`.
    CHANNELS: "start_channels", ChannelBindings;
    texts: [ROOTS_WGSL, CHANNELS_WGSL, START_CHANNELS_WGSL];
    constants: [ROOT_CONSTANTS, CHANNEL_KINDS];
    kernels: {
        /// Sets the channels that start in a frame.
        START_CHANNELS: "start_channels", Threads::Strands;
    }
}

pub(crate) static SHADERS: &[&Shader] = &[&CHANNELS];

/// The rows that all `channels` together have per particle.
pub(crate) fn rows(channels: &[Channel]) -> u32 {
    channels.iter().map(|channel| channel.rows() as u32).sum()
}

/// The channels of a simulation.
#[derive(Debug)]
pub(crate) struct DeviceChannels {
    channels: &'static [Channel],
    /// Whether each has values on the device.
    started: Vec<bool>,
    /// A [`ChannelRowEntry`] a row of a particle, at least one.
    starts: wgpu::Buffer,
    groups: Vec<Bound<ChannelBindings<'static>>>,
    host: Vec<ChannelRowEntry>,
}

impl DeviceChannels {
    /// For `channels`, of which `state` may have values.
    pub fn new(gpu: &Gpu, channels: &'static [Channel], state: &State<f32>) -> Self {
        let bytes = rows(channels).max(1) as usize * size_of::<ChannelRowEntry>();
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
        Self {
            channels,
            started: state.extra.started().collect(),
            starts: gpu.buffer("channel starts", bytes as u64, usage),
            groups: Vec::new(),
            host: Vec::new(),
        }
    }

    /// Initial values, a row of a particle each.
    pub fn starts(&self) -> &wgpu::Buffer {
        &self.starts
    }

    /// Rows per particle.
    pub fn rows(&self) -> u32 {
        rows(self.channels)
    }

    /// Bytes held on the device, without the rows of particles.
    pub fn bytes(&self) -> u64 {
        self.starts.size()
    }

    /// Makes its bind groups.
    pub fn bind(&mut self, gpu: &Gpu, strands: DeviceStrands<'_>) {
        let bound = strands.batches.iter().map(|batch| {
            let bindings = ChannelBindings {
                frame: &strands.shared.frame,
                substep: &strands.shared.substeps,
                blocks: &batch.blocks,
                model: &batch.model,
                channels: &batch.channels,
                channel_starts: &self.starts,
            };
            bindings.bind(gpu, batch.threads)
        });
        self.groups = bound.collect();
    }

    /// Uploads the initial values of a frame. `begins`: the frame begins to solve strands, so that
    /// channels without values start. Returns whether any does.
    pub fn write_frame(&mut self, gpu: &Gpu, frame: &FrameInput<'_>, begins: bool) -> bool {
        let [start, end] = frame.roots.head().map(|pose| pose.rotation);
        self.host.clear();
        for (channel, started) in self.channels.iter().zip(&self.started) {
            let starts = u32::from(begins && !started);
            let kind = match channel.kind {
                ChannelKind::Scalar(_) => channel_kinds::SCALAR,
                ChannelKind::Vector(_) => channel_kinds::VECTOR,
                ChannelKind::Rotation(_) => channel_kinds::ROTATION,
            };
            let rows = channel.initial_rows(start).zip(channel.initial_rows(end));
            self.host.extend(rows.zip(channel.components()).map(|((at_start, at_end), component)| {
                ChannelRowEntry {
                    at_start: at_start as f32,
                    at_end: at_end as f32,
                    starts,
                    kind,
                    component: component as u32,
                }
            }));
        }
        gpu.queue().write_buffer(&self.starts, 0, bytemuck::cast_slice(&self.host));
        let any = begins && self.started.contains(&false);
        if begins {
            self.started.fill(true);
        }
        any
    }

    /// All channels have values from now on.
    pub fn set_started(&mut self) {
        self.started.fill(true);
    }

    /// Appends the start of channels.
    pub fn start<'a>(&'a self, list: &mut DispatchList<'a>) {
        list.run(&self.groups, &START_CHANNELS, &[0]);
    }

    /// Takes which channels of `state`, which replaces that on the device, have values.
    pub fn take(&mut self, state: &State<f32>) {
        self.started.clear();
        self.started.extend(state.extra.started());
    }

    /// Gives `state`, which was read back, which channels have values.
    pub fn give(&self, state: &mut State<f32>) {
        state.extra.set_started(self.started.iter().copied());
    }
}
