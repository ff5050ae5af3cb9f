//! Times of stages, by the timestamps of the device.

use crate::Gpu;
use wgpu::BufferUsages;

/// Queries of a set at most, as in WebGPU.
const MOST_QUERIES: u32 = 4096;

/// The times of a frame, by the clock of the device.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameSecs {
    /// Seconds of each stage that ran, in the order of their first passes.
    pub stages: Vec<(&'static str, f64)>,
    /// Seconds from the start of the first pass to the end of the last.
    pub whole: f64,
}

/// Two timestamps a pass.
#[derive(Debug)]
pub(crate) struct Clock {
    set: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    secs_per_tick: f64,
    /// The stage of each pass of the last frame.
    passes: Vec<&'static str>,
}

impl Clock {
    /// A clock for frames of up to `passes`; `None` if the device has no timestamps, or not enough.
    pub fn new(gpu: &Gpu, passes: u32) -> Option<Self> {
        let count = 2 * passes;
        if !gpu.device().features().contains(wgpu::Features::TIMESTAMP_QUERY) || count > MOST_QUERIES {
            return None;
        }
        let described =
            wgpu::QuerySetDescriptor { label: Some("stages"), ty: wgpu::QueryType::Timestamp, count };
        let usage = BufferUsages::QUERY_RESOLVE | BufferUsages::COPY_SRC;
        Some(Self {
            set: gpu.device().create_query_set(&described),
            resolved: gpu.buffer("timestamps", u64::from(count) * 8, usage),
            secs_per_tick: f64::from(gpu.queue().get_timestamp_period()) * 1e-9,
            passes: Vec::with_capacity(passes as usize),
        })
    }

    /// Begins a frame.
    pub fn begin(&mut self) {
        self.passes.clear();
    }

    /// The timestamps of the next pass, a pass of `stage`.
    pub fn next(&mut self, stage: &'static str) -> wgpu::ComputePassTimestampWrites<'_> {
        let first = 2 * self.passes.len() as u32;
        self.passes.push(stage);
        wgpu::ComputePassTimestampWrites {
            query_set: &self.set,
            beginning_of_pass_write_index: Some(first),
            end_of_pass_write_index: Some(first + 1),
        }
    }

    /// Ends the frame.
    pub fn end(&self, encoder: &mut wgpu::CommandEncoder) {
        encoder.resolve_query_set(&self.set, 0..2 * self.passes.len() as u32, &self.resolved, 0);
    }

    /// The buffer of timestamps.
    pub fn resolved(&self) -> &wgpu::Buffer {
        &self.resolved
    }

    /// The times of the last frame, from the bytes of the timestamps.
    pub fn secs(&self, bytes: &[u8]) -> FrameSecs {
        let ticks: Vec<[u64; 2]> = bytemuck::pod_collect_to_vec(bytes);
        let mut stages: Vec<(&str, f64)> = Vec::new();
        let secs = |[from, to]: [u64; 2]| to.saturating_sub(from) as f64 * self.secs_per_tick;
        let ends = ticks.first().zip(self.passes.len().checked_sub(1).and_then(|last| ticks.get(last)));
        let whole = ends.map_or(0.0, |(first, last)| secs([first[0], last[1]]));
        for (&stage, ticks) in self.passes.iter().zip(ticks) {
            match stages.iter_mut().find(|(name, _)| *name == stage) {
                Some((_, sum)) => *sum += secs(ticks),
                None => stages.push((stage, secs(ticks))),
            }
        }
        FrameSecs { stages, whole }
    }
}
