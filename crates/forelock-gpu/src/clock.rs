//! Times of stages, by the timestamps of the device.

use crate::Gpu;
use wgpu::BufferUsages;

/// Passes of a frame that is timed, at most: in WebGPU a set has 4096 queries.
const MOST_PASSES: usize = 4096 / 2;

/// The times of a frame, by the clock of the device.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameSecs {
    /// Seconds of each stage that ran, in the order of their first passes.
    pub stages: Vec<(&'static str, f64)>,
    /// Seconds from the start of the first pass to the end of the last.
    pub whole: f64,
}

/// The clock of a simulation.
#[derive(Debug)]
pub(crate) struct Clock {
    secs_per_tick: f64,
    /// Room for the longest frame so far.
    queries: Option<Queries>,
    /// The stage of each pass of the last frame; none if it was not timed.
    passes: Vec<&'static str>,
}

/// Two timestamps a pass.
#[derive(Debug)]
struct Queries {
    set: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    /// Passes at most.
    passes: usize,
}

impl Queries {
    fn new(gpu: &Gpu, passes: usize) -> Self {
        let count = 2 * passes as u32;
        let described =
            wgpu::QuerySetDescriptor { label: Some("stages"), ty: wgpu::QueryType::Timestamp, count };
        let usage = BufferUsages::QUERY_RESOLVE | BufferUsages::COPY_SRC;
        let resolved = gpu.buffer("timestamps", u64::from(count) * 8, usage);
        Self { set: gpu.device().create_query_set(&described), resolved, passes }
    }
}

/// A frame that is timed while it is recorded.
#[derive(Debug)]
pub(crate) struct TimedFrame<'a> {
    queries: &'a Queries,
    passes: &'a mut Vec<&'static str>,
}

impl TimedFrame<'_> {
    /// The timestamps of the next pass, a pass of `stage`.
    pub fn next(&mut self, stage: &'static str) -> wgpu::ComputePassTimestampWrites<'_> {
        let first = 2 * self.passes.len() as u32;
        self.passes.push(stage);
        wgpu::ComputePassTimestampWrites {
            query_set: &self.queries.set,
            beginning_of_pass_write_index: Some(first),
            end_of_pass_write_index: Some(first + 1),
        }
    }

    /// Ends the frame.
    pub fn end(self, encoder: &mut wgpu::CommandEncoder) {
        let Queries { set, resolved, .. } = self.queries;
        encoder.resolve_query_set(set, 0..2 * self.passes.len() as u32, resolved, 0);
    }
}

impl Clock {
    /// A clock; `None` if the device has no timestamps.
    pub fn new(gpu: &Gpu) -> Option<Self> {
        let has_timestamps = gpu.device().features().contains(wgpu::Features::TIMESTAMP_QUERY);
        has_timestamps.then(|| Self {
            secs_per_tick: f64::from(gpu.queue().get_timestamp_period()) * 1e-9,
            queries: None,
            passes: Vec::new(),
        })
    }

    /// Begins a frame of `passes`; `None` if a query set has no room for so many, or there are
    /// none: the frame is not timed.
    pub fn begin(&mut self, gpu: &Gpu, passes: usize) -> Option<TimedFrame<'_>> {
        self.passes.clear();
        if passes == 0 || passes > MOST_PASSES {
            return None;
        }
        let kept = self.queries.take().filter(|own| own.passes >= passes);
        let queries = self.queries.insert(kept.unwrap_or_else(|| Queries::new(gpu, passes)));
        Some(TimedFrame { queries, passes: &mut self.passes })
    }

    /// The buffer of timestamps, if the last frame was timed.
    pub fn resolved(&self) -> Option<&wgpu::Buffer> {
        self.queries.as_ref().filter(|_| !self.passes.is_empty()).map(|own| &own.resolved)
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
