//! A frame of a simulation: its uniforms, its dispatches, their recording.

use crate::GpuSimulation;
use crate::air::{AirFrame, Shelter};
use crate::batch::DeviceStrands;
use crate::clock::Clock;
use crate::collide::{SolidFrame, SolidKinds, queries};
use crate::frame::{
    CHECK_STRANDS, DERIVE_VELOCITIES, RESTORE_AGAIN, RESTORE_LENGTHS, RESTORE_LOAD, STORE_LOAD,
};
use crate::interaction::{GpuInteraction, InteractionFrame};
use crate::kernel::DispatchList;
use crate::roots::RootStep;
use crate::sleep::SleepStep;
use crate::solver::SolveBatch;
use crate::uniforms::{FrameUniform, SubstepUniform};
use forelock_core::frame::{Exchange, FrameInput, Phase, PlannedStep, Span, Step, fractions};
use forelock_core::pose::Pose;
use glam::DVec3;

/// Which kernels a frame needs.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FrameKinds {
    /// What kinds of colliders there are.
    pub solids: SolidKinds,
    /// What shelters from the wind, if it is a field.
    pub air: Option<Shelter>,
    /// Whether channels of the solver start.
    pub starts_channels: bool,
    /// What it does about sleep.
    pub sleep: SleepStep,
    /// What it computes of the motions of roots.
    pub roots: RootStep,
}

/// Whether one of `steps` moves positions to the frame's origin.
fn begins(steps: &[PlannedStep]) -> bool {
    steps.iter().any(|own| own.step == Step::Solve { substep: 0 })
}

impl GpuSimulation {
    /// Whether velocities hold more than motion.
    pub(crate) fn has_load(&self) -> bool {
        self.solver.channels().previous
    }

    /// Measures the time of each stage from the next frame on, or stops. Returns whether the device
    /// supports it. A frame that changes from stage to stage more than 2048 times, by many substeps
    /// and batches, is not timed.
    pub fn time_stages(&mut self, on: bool) -> bool {
        self.clock = on.then(|| Clock::new(&self.gpu)).flatten();
        self.clock.is_some()
    }

    /// Records `steps`.
    pub(crate) fn record_steps(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        steps: &[PlannedStep],
        kinds: FrameKinds,
    ) {
        let mut clock = self.clock.take();
        self.record(encoder, &self.dispatches(steps, kinds), clock.as_mut());
        self.clock = clock;
    }

    /// Records a plan: in one pass, or in one pass a stage if the frame is timed.
    fn record(&self, encoder: &mut wgpu::CommandEncoder, plan: &DispatchList<'_>, clock: Option<&mut Clock>) {
        let Some(mut timed) = clock.and_then(|clock| clock.begin(&self.gpu, plan.stages().count())) else {
            let described = wgpu::ComputePassDescriptor { label: Some("frame"), timestamp_writes: None };
            let mut pass = encoder.begin_compute_pass(&described);
            plan.iter().for_each(|dispatch| dispatch.record(&self.gpu, &mut pass));
            return;
        };
        for dispatches in plan.stages() {
            let stage = dispatches[0].stage();
            let timestamp_writes = Some(timed.next(stage));
            let described = wgpu::ComputePassDescriptor { label: Some(stage), timestamp_writes };
            let mut pass = encoder.begin_compute_pass(&described);
            dispatches.iter().for_each(|dispatch| dispatch.record(&self.gpu, &mut pass));
        }
        timed.end(encoder);
    }

    /// The dispatches of `steps` in their order. Between interactions, batches run one after the
    /// other.
    fn dispatches(&self, steps: &[PlannedStep], kinds: FrameKinds) -> DispatchList<'_> {
        let mut list = DispatchList::default();
        if let Some(roots) = &self.roots {
            roots.bend(&mut list, kinds.roots);
        }
        self.sleep.begin(&mut list, kinds.sleep);
        for steps in steps.chunk_by(|a, b| a.step.is_of_strands() && b.step.is_of_strands()) {
            let step = steps[0].step;
            if !step.is_of_strands() {
                self.run_on_all(&mut list, step);
                continue;
            }
            if begins(steps) {
                if let Some(network) = &self.network {
                    network.predict(&mut list);
                }
                if kinds.starts_channels {
                    self.channels.start(&mut list);
                }
                if let Some((shelter, air)) = kinds.air.zip(self.air.as_ref()) {
                    air.sample(&mut list, shelter);
                    self.kernels.apply_wind(&mut list, &self.groups);
                }
                if let Some(acceleration) = &self.acceleration {
                    acceleration.sample(&mut list);
                }
            }
            for batch in 0..self.batches.len() {
                steps.iter().for_each(|own| self.step_batch(&mut list, own.step, batch, kinds));
            }
        }
        self.sleep.end(&mut list, kinds.sleep);
        list
    }

    /// A step of one batch.
    fn step_batch<'a>(&'a self, list: &mut DispatchList<'a>, step: Step, batch: usize, kinds: FrameKinds) {
        let solids = kinds.solids;
        let groups = &self.groups;
        let strands = &groups.strands[batch];
        let collide =
            |number| solids.resolve().map(|kernel| groups.solids[batch].dispatch(kernel, &[number]));
        // At a span's end colliders meet hair with the speed at which it moves.
        let collide_at_end = |list: &mut DispatchList<'a>, span: Span, query| {
            let loaded = self.has_load() && solids.resolve().is_some();
            list.extend(loaded.then(|| strands.dispatch(&STORE_LOAD, &[0])));
            list.extend(collide(queries::at_end(span, query, self.count)));
            list.extend(loaded.then(|| strands.dispatch(&RESTORE_LOAD, &[0])));
        };
        match step {
            Step::Solve { substep } => {
                if let Some(acceleration) = &self.acceleration {
                    acceleration.accelerate(list, batch);
                }
                let longest = self.batches[batch].threads.longest;
                let half_factors = self.half_factors;
                let batch = SolveBatch { groups, batch, longest, solids, half_factors };
                self.kernels.solve(list, &batch, substep);
            }
            Step::Collide { substep } => {
                let loaded = self.has_load() && solids.resolve().is_some();
                list.extend(loaded.then(|| strands.dispatch(&STORE_LOAD, &[0])));
                list.extend(collide(substep));
                list.extend(loaded.then(|| strands.dispatch(&DERIVE_VELOCITIES, &[0])));
            }
            Step::CollideFinal { span, .. } => collide_at_end(list, span, queries::FINAL),
            Step::RestoreLengths { span } => {
                list.push(strands.dispatch(&RESTORE_LENGTHS, &[span.end - 1]));
                collide_at_end(list, span, queries::RESTORED);
            }
            Step::RestoreIfMoved { span } => {
                list.push(strands.dispatch(&RESTORE_AGAIN, &[span.end - 1]));
                collide_at_end(list, span, queries::RESTORED_AGAIN);
            }
            Step::CheckStrands => {
                list.push(groups.checks[batch].dispatch(&CHECK_STRANDS, &[self.count - 1]));
            }
            Step::RecordStart { .. } | Step::Exchange { .. } => {}
        }
    }

    /// A step of all batches together.
    fn run_on_all<'a>(&'a self, list: &mut DispatchList<'a>, step: Step) {
        let strands = &self.groups.strands;
        match step {
            Step::RecordStart { exchange, span } => {
                if let Some(own) = self.interaction(&exchange) {
                    own.record_start(list, span);
                }
            }
            Step::Exchange { exchange, span } => {
                // Where velocities hold more than motion, they are those of the motion meanwhile.
                let loaded = self.has_load() && exchange.phase != Phase::BeforeStrands;
                if loaded {
                    list.run(strands, &STORE_LOAD, &[0]);
                }
                if let Some(own) = self.interaction(&exchange) {
                    if own.early_exchange() == Some(exchange) {
                        own.exchange_early(list, span);
                    } else {
                        own.exchange(list, span);
                    }
                }
                if loaded {
                    list.run(strands, &RESTORE_LOAD, &[0]);
                }
            }
            _ => {}
        }
    }

    /// The interaction of `exchange`, if the simulation has it.
    fn interaction(&self, exchange: &Exchange) -> Option<&dyn GpuInteraction> {
        let own = self.interactions.iter().find(|own| own.exchange_plan().name == exchange.name)?;
        Some(&**own)
    }

    /// Writes the uniforms of a frame, before `steps` of it.
    pub(crate) fn write_frame(&mut self, frame: &FrameInput<'_>, steps: &[PlannedStep]) -> FrameKinds {
        let origin = frame.origin(&self.model);
        let start = self.model.about_centre(&frame.roots.head()[0], self.origin);
        let shift = self.origin - origin;
        let starts_channels = self.channels.write_frame(&self.gpu, frame, begins(steps));
        if begins(steps) {
            self.write_acceleration(frame);
            // Positions move there in the first substep.
            self.origin = origin;
        }
        let mut uniform = FrameUniform::new(&self.rules, frame.dt_secs, frame.gravity, frame.air.velocity);
        self.kernels.write_terms(frame.dt_secs, &mut uniform);
        uniform.channel_rows = self.channels.rows();
        if !self.model.masses.is_empty() {
            uniform = uniform.with_masses(self.model.least_mass);
        }
        if !frame.roots.are_rigid() {
            uniform = uniform.with_root_frames();
        }
        uniform.held = self.sleep.held() as f32;
        let wind = frame.air.field;
        if wind.is_some() {
            uniform = uniform.in_wind();
        }
        self.gpu.queue().write_buffer(&self.shared.frame, 0, bytemuck::bytes_of(&uniform));
        let count = self.count;
        let poses: Vec<_> = frame.poses(&self.model, count, origin).collect();
        self.write_substeps(&poses, frame.dt_secs, shift);
        if !frame.colliders.is_empty() || self.rules.solver_collides {
            let solids =
                SolidFrame { frame, substeps: count, origin, plan: &self.plan, positional: self.has_load() };
            self.solids.write_frame(&self.gpu, &self.rules, &solids);
        }
        let given = InteractionFrame {
            input: frame,
            start,
            poses: &poses,
            origin,
            clamped: self.rules.clamped as u32,
            substeps: count,
            spans: self.plan.spans(),
            calm_secs: self.sleep.calm_before(),
        };
        self.interactions.iter_mut().for_each(|own| own.write_frame(&self.gpu, &given));
        let air = self.air.as_mut().zip(wind).map(|(air, wind)| {
            let air_frame = AirFrame { wind, solids: frame.colliders.len(), origin, shift };
            air.write_frame(&self.gpu, &self.model, &air_frame)
        });
        let solids = SolidKinds::of(frame.colliders);
        FrameKinds { solids, air, starts_channels, sleep: SleepStep::Awake, roots: RootStep::None }
    }

    /// Uploads the acceleration in addition to gravity of a frame, before positions move to its
    /// origin.
    fn write_acceleration(&mut self, frame: &FrameInput<'_>) {
        let Self { gpu, model, shared, batches, acceleration, origin, .. } = self;
        if let Some(own) = acceleration {
            let centre = frame.roots.head()[0].transform_point(model.centre.into());
            let strands = DeviceStrands { model, shared, batches };
            own.write_frame(gpu, strands, &frame.acceleration, centre, *origin);
        }
    }

    /// Writes the substeps of a frame of `dt_secs` between `poses`, the first of which moves
    /// positions by `shift`; further entries number the levels of kernels that place one particle
    /// of each strand.
    fn write_substeps(&mut self, poses: &[Pose], dt_secs: f64, shift: DVec3) {
        let h = dt_secs / f64::from(self.count);
        let (count, weight, stride) = (self.count, self.options.carried_gravity(), self.shared.stride);
        let spans = self.plan.spans();
        self.substeps.clear();
        let mut append = |number: u32, substep: &SubstepUniform| {
            self.substeps.resize((number * stride) as usize, 0);
            self.substeps.extend_from_slice(bytemuck::bytes_of(substep));
        };
        for ((step, ends), shares) in (0..count).zip(poses.windows(2)).zip(fractions(count)) {
            let shift = if step == 0 { shift } else { DVec3::ZERO };
            let substep = SubstepUniform::new([&ends[0], &ends[1]], h, shares, weight, shift);
            let span = spans.iter().find(|span| step < span.end);
            let secs = span.map_or(h, |span| span.secs(count, dt_secs));
            append(step, &SubstepUniform { inverse_span: (1.0 / secs) as f32, ..substep });
        }
        for level in count..self.kernels.substep_entries(count, self.model.longest() as u32) {
            // Solvers that step particles level by level have one substep a frame, and one span.
            let substep = SubstepUniform::new([&poses[0], &poses[1]], h, [0.0, 1.0], weight, shift);
            append(level, &SubstepUniform { level, ..substep });
        }
        self.gpu.queue().write_buffer(&self.shared.substeps, 0, &self.substeps);
    }
}
