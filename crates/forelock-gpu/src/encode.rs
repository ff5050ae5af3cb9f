//! A frame of a simulation: its uniforms, its dispatches, their recording.

use crate::GpuSimulation;
use crate::air::{AirFrame, Shelter};
use crate::clock::Clock;
use crate::collide::{SolidFrame, SolidKinds};
use crate::frame::{CHECK_STRANDS, RESTORE_AGAIN, RESTORE_LENGTHS};
use crate::interaction::contact::ContactStep;
use crate::interaction::grid::GridStep;
use crate::kernel::DispatchList;
use crate::solver::{ams, dftl};
use crate::uniforms::{FrameUniform, SubstepUniform};
use forelock_core::air::WindField;
use forelock_core::grid::GridFrame;
use forelock_core::pose::Pose;
use forelock_core::solver::dftl::Schedule;
use forelock_core::solver::params::Inextensibility;
use forelock_core::solver::{Frame, FrameStep, Meeting, SolverParams};
use glam::DVec3;

/// Whether one of `steps` moves positions to the frame's origin.
fn begins(steps: &[FrameStep]) -> bool {
    steps.iter().any(|step| matches!(step, FrameStep::SolveStrands(0) | FrameStep::FollowLeader))
}

/// Whether strands interact in a step: it runs on all batches before the next one.
fn interacts(step: FrameStep) -> bool {
    use FrameStep::{Contacts, Grid, NoteStart, Particles};
    matches!(step, NoteStart | Particles | Grid | Contacts)
}

impl GpuSimulation {
    /// All steps of a frame.
    pub(crate) fn steps(&self) -> Vec<FrameStep> {
        let meeting = Meeting {
            grid: self.grid.is_some(),
            particles: self.sph.is_some(),
            contacts: self.contacts.is_some(),
        };
        FrameStep::all(&self.params, meeting).collect()
    }

    /// Whether the solver is follow the leader.
    pub(crate) fn follows(&self) -> bool {
        matches!(self.params, SolverParams::Dftl(_))
    }

    /// Whether the frame has a length pass.
    pub(crate) fn restores_lengths(&self) -> bool {
        self.params.inextensibility().0 != Inextensibility::Off
    }

    /// Measures the time of each stage from the next frame on, or stops. Returns whether the device
    /// supports it.
    pub fn time_stages(&mut self, on: bool) -> bool {
        let air = self.air.is_some().then_some(Shelter { wake: true, canopy: true });
        let passes = self.plan(&self.steps(), SolidKinds::Rigid, air).stages().count() as u32;
        self.clock = on.then(|| Clock::new(&self.gpu, passes)).flatten();
        self.clock.is_some()
    }

    /// Records `steps` and submits them.
    pub(crate) fn submit(&mut self, steps: &[FrameStep], solids: SolidKinds, air: Option<Shelter>) {
        let mut clock = self.clock.take();
        let mut encoder = self.gpu.device().create_command_encoder(&Default::default());
        self.record(&mut encoder, &self.plan(steps, solids, air), clock.as_mut());
        self.clock = clock;
        self.gpu.queue().submit([encoder.finish()]);
    }

    /// Records a plan: in one pass, or in one pass a stage if stages are timed.
    fn record(&self, encoder: &mut wgpu::CommandEncoder, plan: &DispatchList<'_>, clock: Option<&mut Clock>) {
        let Some(clock) = clock else {
            let described = wgpu::ComputePassDescriptor { label: Some("frame"), timestamp_writes: None };
            let mut pass = encoder.begin_compute_pass(&described);
            plan.iter().for_each(|dispatch| dispatch.record(&self.gpu, &mut pass));
            return;
        };
        clock.begin();
        for dispatches in plan.stages() {
            let stage = dispatches[0].stage();
            let timestamp_writes = Some(clock.next(stage));
            let described = wgpu::ComputePassDescriptor { label: Some(stage), timestamp_writes };
            let mut pass = encoder.begin_compute_pass(&described);
            dispatches.iter().for_each(|dispatch| dispatch.record(&self.gpu, &mut pass));
        }
        clock.end(encoder);
    }

    /// The dispatches of `steps` in their order. Between interactions, batches run one after the
    /// other.
    fn plan(&self, steps: &[FrameStep], solids: SolidKinds, air: Option<Shelter>) -> DispatchList<'_> {
        let mut list = DispatchList::default();
        for steps in steps.chunk_by(|a, b| interacts(*a) == interacts(*b)) {
            if interacts(steps[0]) {
                steps.iter().for_each(|step| self.interact(&mut list, *step));
                continue;
            }
            if let Some((shelter, air)) = air.zip(self.air.as_ref()).filter(|_| begins(steps)) {
                air.sample(&mut list, shelter);
                if steps.contains(&FrameStep::FollowLeader) {
                    list.run(&self.groups.wind, &dftl::APPLY_WIND, &[0]);
                }
            }
            for batch in 0..self.batches.len() {
                steps.iter().for_each(|step| self.step_batch(&mut list, *step, batch, solids));
            }
        }
        list
    }

    /// A step of one batch.
    fn step_batch<'a>(
        &'a self,
        list: &mut DispatchList<'a>,
        step: FrameStep,
        batch: usize,
        solids: SolidKinds,
    ) {
        let groups = &self.groups;
        let strands = &groups.strands[batch];
        let last = self.params.substeps() - 1;
        match step {
            FrameStep::FollowLeader => {
                let schedule = match &self.params {
                    SolverParams::Dftl(params) => params.schedule,
                    SolverParams::Ams(_) => Schedule::Fused,
                };
                let longest = self.batches[batch].threads.longest;
                dftl::follow(list, &groups.follow[batch], schedule, solids, longest);
            }
            FrameStep::SolveStrands(number) => {
                list.push(groups.wind[batch].dispatch(ams::solve(self.half_factors), &[number]));
            }
            FrameStep::ResolveSolids(number) => {
                list.extend(solids.resolve().map(|kernel| groups.solids[batch].dispatch(kernel, &[number])));
            }
            FrameStep::LastSolids => {
                let follows = self.follows();
                list.extend(follows.then(|| strands.dispatch(&dftl::STORE_LOAD, &[0])));
                list.extend(
                    solids.resolve().map(|kernel| groups.solids[batch].dispatch(kernel, &[last + 1])),
                );
                list.extend(follows.then(|| strands.dispatch(&dftl::RESTORE_LOAD, &[0])));
            }
            FrameStep::RestoreLengths => list.push(strands.dispatch(&RESTORE_LENGTHS, &[last])),
            _ => list.push(strands.dispatch(&CHECK_STRANDS, &[last])),
        }
    }

    /// A step in which strands interact. Under follow the leader, velocities are those of the
    /// motion meanwhile.
    fn interact<'a>(&'a self, list: &mut DispatchList<'a>, step: FrameStep) {
        let strands = &self.groups.strands;
        let loaded = self.follows() && matches!(step, FrameStep::Grid | FrameStep::Contacts);
        if loaded {
            list.run(strands, &dftl::STORE_LOAD, &[0]);
        }
        match (step, &self.grid, &self.sph, &self.contacts) {
            (FrameStep::Grid, Some(grid), ..) => grid.exchange(list, self.params.substeps()),
            (FrameStep::Particles, _, Some(sph), _) => sph.interact(list),
            (FrameStep::NoteStart, .., Some(contacts)) => contacts.record_start(list),
            (FrameStep::Contacts, .., Some(contacts)) => contacts.interact(list),
            _ => {}
        }
        if loaded {
            list.run(strands, &dftl::RESTORE_LOAD, &[0]);
        }
        // Follow the leader restores lengths after the last interaction.
        let last = if self.contacts.is_some() { FrameStep::Contacts } else { FrameStep::Grid };
        if loaded && self.grid.is_some() && step == last {
            list.run(strands, &RESTORE_LENGTHS, &[0]);
        } else if self.restores_lengths() && self.contacts.is_some() && step == FrameStep::Contacts {
            list.run(strands, &RESTORE_AGAIN, &[self.params.substeps() - 1]);
        }
    }

    /// Writes the uniforms of a frame, before `steps` of it. Returns what shelters from the `wind`,
    /// if it is a field.
    pub(crate) fn write_frame(
        &mut self,
        frame: &Frame<'_>,
        wind: Option<&WindField>,
        steps: &[FrameStep],
    ) -> Option<Shelter> {
        let origin = frame.origin(&self.model);
        let start = self.model.about_centre(&frame.head[0], self.mirror.origin);
        let shift = self.mirror.origin - origin;
        // Positions move there in the first substep.
        if begins(steps) {
            self.mirror.origin = origin;
        }
        let mut uniform = FrameUniform::new(&self.params, frame.dt_secs, frame.gravity, frame.air_velocity);
        if wind.is_some() {
            uniform = uniform.in_wind();
        }
        self.gpu.queue().write_buffer(&self.shared.frame, 0, bytemuck::bytes_of(&uniform));
        let count = self.params.substeps();
        let poses: Vec<_> = frame.poses(&self.model, count, origin).collect();
        self.write_substeps(&poses, shift);
        if !frame.colliders.is_empty() || self.follows() {
            let has_last = self.steps().contains(&FrameStep::LastSolids);
            self.solids.write_frame(&self.gpu, &self.params, &SolidFrame { frame, origin, has_last });
        }
        if let (Some(contacts), [.., now]) = (&mut self.contacts, &*poses) {
            let (head, clamped) = ([&start, now], self.params.clamped());
            contacts.write_frame(&self.gpu, &ContactStep { head, clamped, dt_secs: frame.dt_secs });
        }
        if let Some(sph) = &mut self.sph {
            sph.write_frame(&self.gpu, frame.dt_secs);
        }
        if let (Some(grid), [.., before, now]) = (&mut self.grid, &*poses) {
            let motion = &GridFrame::new(before, now, frame.dt_secs / f64::from(count));
            grid.write_frame(&self.gpu, &GridStep { frame, substeps: count, motion, origin });
        }
        let (air, wind) = self.air.as_mut().zip(wind)?;
        let air_frame = AirFrame { wind, solids: frame.colliders.len(), origin, shift };
        Some(air.write_frame(&self.gpu, &self.model, &air_frame))
    }

    /// Writes the substeps between `poses`, the first of which moves positions by `shift`; further
    /// entries number the levels of follow the leader.
    fn write_substeps(&mut self, poses: &[Pose], shift: DVec3) {
        let (count, weight, stride) =
            (self.params.substeps(), self.options.carried_gravity(), self.shared.stride);
        self.substeps.clear();
        let mut append = |number: u32, substep: &SubstepUniform| {
            self.substeps.resize((number * stride) as usize, 0);
            self.substeps.extend_from_slice(bytemuck::bytes_of(substep));
        };
        for (step, ends) in (0..count).zip(poses.windows(2)) {
            let shift = if step == 0 { shift } else { DVec3::ZERO };
            append(step, &SubstepUniform::new([&ends[0], &ends[1]], weight, shift));
        }
        for level in count..(self.shared.substeps.size() / u64::from(stride)) as u32 {
            let [start, end] = [&poses[0], &poses[1]];
            append(level, &SubstepUniform { level, ..SubstepUniform::new([start, end], weight, shift) });
        }
        self.gpu.queue().write_buffer(&self.shared.substeps, 0, &self.substeps);
    }
}
