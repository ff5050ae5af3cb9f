//! Sleep on the device: all strands sleep together.
//!
//! # Practice
//! While the surroundings are still, each frame records the positions at its start, slows strands
//! down by friction, and measures the largest speed of a strand over the frame. A report, which
//! reads back anyway, brings that to the host, which counts the time for which no strand has moved.
//! Once that is [`SLEEP_SECS`], and the surroundings have been still for as long as interactions
//! ask, frames record nothing until something wakes the hair: the causes are those of the CPU, with
//! one box around all hair. A simulation whose reports are never asked for
//! ([`GpuSimulation::report`](crate::GpuSimulation::report)) does not sleep.
//!
//! # Limitations
//! One strand that moves keeps all awake. Frames that are run in parts do not sleep.

use crate::Gpu;
use crate::batch::DeviceStrands;
use crate::kernel::{Bound, Constant, DispatchList, Shader, Threads, bindings, shader};
use crate::uniforms::{FrameUniform, SubstepUniform};
use forelock_core::frame::{
    FASTEST_SHARE, FrameInput, LEAST_FRICTION, LastSolids, Reach, SLEEP_WGSL, held_distance,
};
use forelock_core::lane::Row;
use forelock_core::strands::{Model, SLEEP_SECS, SleepPlace, State};
use wgpu::BufferUsages;

bindings! {
    /// Strands, their places at the frame's start, and the largest speed.
    pub(crate) struct SleepBindings {
        0 frame: uniform(FrameUniform),
        1 substep: dynamic(SubstepUniform),
        2 blocks: read,
        5 positions: read_write,
        6 velocities: read_write,
        7 memory: read_write,
        17 start: read_write,
        18 motion: read_write,
    }
}

shader! {
    /// `measure_motion`.
    SLEEP: "measure_motion", SleepBindings;
    texts: [SLEEP_WGSL];
    constants: [&[
        Constant::f32("FASTEST_SHARE", FASTEST_SHARE as f32),
        Constant::f32("LEAST_FRICTION", LEAST_FRICTION as f32),
    ]];
    kernels: {
        /// Records where hair is at the frame's start.
        RECORD_PLACE: "record_place", Threads::Strands;
        /// Slows strands down and measures the largest speed.
        MEASURE_MOTION: "measure_motion", Threads::Strands;
        /// Forgets distances to solids after a sleep.
        FORGET_DISTANCES: "forget_distances", Threads::Strands;
    }
}

pub(crate) static SHADERS: &[&Shader] = &[&SLEEP];

/// What a frame does about sleep.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum SleepStep {
    /// Nothing: the surroundings are not still.
    Awake,
    /// Slows hair down and measures how fast it moves.
    Measure,
    /// The same, after a sleep.
    Wake,
    /// All hair sleeps: the frame has nothing to do.
    Asleep,
}

/// The sleep of a simulation.
#[derive(Debug, Default)]
pub(crate) struct DeviceSleep {
    /// Seconds for which no strand has moved, as far as is reported; infinite: all sleep.
    still_secs: f32,
    place: Option<SleepPlace>,
    /// Seconds for which the surroundings have been still.
    calm_secs: f64,
    /// The same before the frame that was prepared.
    calm_before: f64,
    /// Distance up to which friction holds strands in that frame, metres.
    held: f64,
    /// Seconds of the frames that were measured since the last report.
    pending_secs: f64,
    /// Whether clearances are older than the last motion of solids.
    has_slept: bool,
    last_solids: LastSolids,
    moving: Vec<Reach>,
    buffers: Option<Buffers>,
}

/// Made at the first frame with still surroundings.
#[derive(Debug)]
struct Buffers {
    /// Three rows a place: a buffer a batch.
    start: Vec<wgpu::Buffer>,
    motion: wgpu::Buffer,
    groups: Vec<Bound<SleepBindings<'static>>>,
}

impl DeviceSleep {
    /// Bytes held on the device.
    pub fn bytes(&self) -> u64 {
        let own = self.buffers.iter();
        own.flat_map(|own| own.start.iter().chain([&own.motion])).map(|buffer| buffer.size()).sum()
    }

    /// Whether all strands sleep.
    pub fn is_asleep(&self) -> bool {
        self.still_secs == f32::INFINITY
    }

    /// Wakes all strands.
    pub fn wake(&mut self) {
        self.has_slept |= self.is_asleep();
        (self.still_secs, self.place, self.pending_secs) = (0.0, None, 0.0);
        (self.calm_secs, self.calm_before, self.held) = (0.0, 0.0, 0.0);
    }

    /// Seconds for which the surroundings had been still before the frame that was prepared.
    pub fn calm_before(&self) -> f64 {
        self.calm_before
    }

    /// The distance up to which friction holds strands in the frame that was prepared, metres.
    pub fn held(&self) -> f64 {
        self.held
    }

    /// Takes the sleep of `state`, which replaces that on the device.
    pub fn take(&mut self, gpu: &Gpu, model: &Model<f32>, state: &State<f32>) {
        let (place, calm_secs) = state.sleep.place();
        (self.still_secs, self.place) = (state.sleep.least_secs(model), place);
        self.calm_secs = calm_secs;
        if self.place.is_none() {
            self.still_secs = 0.0;
        }
        (self.pending_secs, self.has_slept) = (0.0, false);
        self.last_solids.forget();
        if let Some(own) = &self.buffers {
            gpu.queue().write_buffer(&own.motion, 0, &[0; 4]);
        }
    }

    /// Gives `state`, which was read back, its sleep. Distances to solids of hair that sleeps are
    /// not known, since solids may move meanwhile.
    pub fn give(&self, state: &mut State<f32>) {
        state.sleep.set_all(self.still_secs, self.place, self.calm_secs);
        if self.is_asleep() {
            state.clearance.iter_mut().for_each(|row| row.0.fill(f32::NEG_INFINITY));
        }
    }

    /// What `frame` does, at a sleep speed of `speed`; `whole`: it is not run in parts.
    pub fn prepare(
        &mut self,
        frame: &FrameInput<'_>,
        model: &Model<f32>,
        [speed, skin_thickness]: [f64; 2],
        whole: bool,
    ) -> SleepStep {
        if !(whole && speed > 0.0) {
            self.wake();
            return SleepStep::Awake;
        }
        let are_same_solids = self.last_solids.continue_in(frame);
        let here = frame.sleep_place(model);
        let stays = here.zip(self.place).is_some_and(|(here, place)| place.continues(&here, model));
        if !stays || !are_same_solids {
            self.wake();
        }
        let Some(here) = here else { return SleepStep::Awake };
        Reach::moving(frame, skin_thickness, &mut self.moving);
        if here.is_disturbed(model, &self.moving) {
            self.calm_secs = 0.0;
            if self.is_asleep() {
                self.wake();
            }
        }
        self.place = self.place.or(Some(here));
        if self.is_asleep() {
            return SleepStep::Asleep;
        }
        self.held = held_distance(speed, self.calm_secs, frame.dt_secs);
        self.calm_before = self.calm_secs;
        self.calm_secs += frame.dt_secs;
        self.pending_secs += frame.dt_secs;
        let has_slept = std::mem::take(&mut self.has_slept);
        if has_slept { SleepStep::Wake } else { SleepStep::Measure }
    }

    /// Makes the buffers, if there are none; returns whether it did.
    pub fn hold(&mut self, gpu: &Gpu, strands: DeviceStrands<'_>) -> bool {
        if self.buffers.is_some() {
            return false;
        }
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
        let rows = |places: usize| gpu.buffer("start", (3 * places * size_of::<Row<f32>>()) as u64, usage);
        self.buffers = Some(Buffers {
            start: strands.batches.iter().map(|batch| rows(batch.places.len())).collect(),
            motion: gpu.buffer("motion", 4, usage),
            groups: Vec::new(),
        });
        true
    }

    /// Makes its bind groups.
    pub fn bind(&mut self, gpu: &Gpu, strands: DeviceStrands<'_>) {
        let Some(own) = &mut self.buffers else { return };
        let bound = strands.batches.iter().zip(&own.start).map(|(batch, start)| {
            let bindings = SleepBindings {
                frame: &strands.shared.frame,
                substep: &strands.shared.substeps,
                blocks: &batch.blocks,
                positions: &batch.positions,
                velocities: &batch.velocities,
                memory: &batch.memory,
                start,
                motion: &own.motion,
            };
            bindings.bind(gpu, batch.threads)
        });
        own.groups = bound.collect();
    }

    /// Appends what comes before the steps of a frame.
    pub fn begin<'a>(&'a self, list: &mut DispatchList<'a>, step: SleepStep) {
        let Some(own) = self.buffers.as_ref().filter(|_| step != SleepStep::Awake) else { return };
        if step == SleepStep::Wake {
            list.run(&own.groups, &FORGET_DISTANCES, &[0]);
        }
        list.run(&own.groups, &RECORD_PLACE, &[0]);
    }

    /// Appends what comes after the steps of a frame.
    pub fn end<'a>(&'a self, list: &mut DispatchList<'a>, step: SleepStep) {
        let Some(own) = self.buffers.as_ref().filter(|_| step != SleepStep::Awake) else { return };
        list.run(&own.groups, &MEASURE_MOTION, &[0]);
    }

    /// What a report has to read, if a frame was measured.
    pub fn report_buffer(&self) -> Option<&wgpu::Buffer> {
        let own = self.buffers.as_ref()?;
        (self.pending_secs > 0.0).then_some(&own.motion)
    }

    /// Counts the frames whose largest squared speed, `motion`, was read back. At a sleep speed of
    /// `speed`, m/s, all strands fall asleep after a second of rest, but not before the
    /// surroundings have been still for `settle_secs`.
    pub fn report(&mut self, gpu: &Gpu, motion: &[u8], [speed, settle_secs]: [f64; 2]) {
        let Some(own) = &self.buffers else { return };
        gpu.queue().write_buffer(&own.motion, 0, &[0; 4]);
        let fastest_squared: f32 = bytemuck::pod_read_unaligned(motion);
        let secs = self.still_secs + std::mem::take(&mut self.pending_secs) as f32;
        let secs = secs.min(SLEEP_SECS as f32);
        let is_still = f64::from(fastest_squared) <= speed * speed;
        self.still_secs = match is_still {
            false => 0.0,
            true if secs >= SLEEP_SECS as f32 && self.calm_secs >= settle_secs => f32::INFINITY,
            true => secs,
        };
    }
}
