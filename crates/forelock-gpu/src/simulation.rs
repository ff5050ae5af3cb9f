//! Strands under the augmented mass-spring model, on a GPU.

use crate::air::{DeviceAir, Shelter};
use crate::batch::{Batch, Shared, split};
use crate::clock::{Clock, FrameSecs};
use crate::contacts::{DeviceContacts, TouchEntry};
use crate::grid::{BoundsEntry, DeviceGrid, SWEEPS};
use crate::kernels::{self, Binding, GROUPS, Group, Kernel, Over};
use crate::layout::{FrameUniform, ReportEntry, SubstepUniform};
use crate::particles::DeviceParticles;
use crate::solids::Solids;
use crate::{Gpu, GpuError};
use forelock_core::air::WindField;
use forelock_core::body::{ColliderFrame, Shape};
use forelock_core::interaction::contact::{ContactParams, ContactReport};
use forelock_core::interaction::grid::{GridFrame, GridParams, GridReport};
use forelock_core::groom::Groom;
use forelock_core::strands::{Model, Strands};
use forelock_core::solver::dftl::Schedule;
use forelock_core::solver::ams::Inextensibility;
use forelock_core::frame::{Frame, FrameStep, Meeting};
use forelock_core::simulation::{Options, Simulation};
use forelock_core::solver::{SolverParams};
use forelock_core::interaction::sph::SphParams;
use forelock_core::interaction::contact::find_contacts::SLICES;
use forelock_core::strands::{Snapshot, State};
use glam::DVec3;

/// A simulation whose state lives on a GPU: [`forelock_core::simulation::Simulation`], stage by stage.
///
/// Memory, in bytes a particle: 28 of model, 32 of state, 120 of scratch (that of the largest batch); 4 more with a grid, and 68 a cell that there is room for; 24 more under follow the leader; 12 more with contacts, and what [`crate::contacts`] says; what [`crate::particles`] says with smoothed particles; 12 more once there was wind
/// that is not the same everywhere.
#[derive(Debug)]
pub struct GpuSimulation {
    gpu: Gpu,
    model: Model<f32>,
    /// The state as it was last on the CPU; its origin is always true.
    mirror: State<f32>,
    params: SolverParams,
    options: Options,
    shared: Shared,
    solids: Solids,
    batches: Vec<Bound>,
    substeps: Vec<u8>,
    /// The kernel of the strand solve.
    solve: Kernel,
    grid: Option<DeviceGrid>,
    particles: Option<DeviceParticles>,
    contacts: Option<DeviceContacts>,
    /// What is needed for wind that is not the same everywhere, after the first of it.
    air: Option<DeviceAir>,
    clock: Option<Clock>,
}

/// A batch and what each group of kernels sees of it: none of a grid that is not there.
#[derive(Debug)]
struct Bound {
    batch: Batch,
    groups: [Option<wgpu::BindGroup>; GROUPS.len()],
}

/// A kernel on a batch, with the number of its substep or look.
#[derive(Clone, Copy, Debug)]
struct Call {
    kernel: Kernel,
    batch: usize,
    number: u32,
}

/// The kernels that look at `solids`: at the end of a substep, if there are any, and on the way.
fn look_at(solids: &[ColliderFrame<'_>]) -> (Option<Kernel>, Kernel) {
    let changes = solids.iter().any(|solid| matches!(solid.shape, Shape::Morph { .. }));
    let (look, follow) = if changes {
        (Kernel::ResolveChanging, Kernel::FollowChanging)
    } else {
        (Kernel::ResolveSolids, Kernel::FollowLeader)
    };
    ((!solids.is_empty()).then_some(look), follow)
}

/// Whether one of `steps` brings hair to the frame's origin.
fn begins(steps: &[FrameStep]) -> bool {
    steps.iter().any(|step| matches!(step, FrameStep::SolveStrands(0) | FrameStep::FollowLeader))
}

/// Calls of one stage after the other, together.
fn by_stage(plan: &[Call]) -> impl Iterator<Item = &[Call]> {
    plan.chunk_by(|a, b| a.kernel.stage().name == b.kernel.stage().name)
}

/// What the frames since the last report did.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GpuReport {
    /// Largest |l/l₀ − 1| of an edge after the length pass.
    pub max_edge_stretch: f32,
    /// The same at the end of a frame, after solids.
    pub max_edge_stretch_final: f32,
    /// Strands that were not finite and were put back to their rest shape.
    pub quarantined_strands: u32,
    /// Particles in touch with a solid at a frame's end, over all frames.
    pub touching: u32,
    /// Deepest particle under a solid's surface at a frame's end, metres.
    pub max_penetration_m: f32,
    /// What the grid did in the last frame, as far as the device knows; nothing without one. Iterations are sweeps, the residual is their last change over the largest one at the start.
    pub grid: Option<GridReport>,
    /// What contacts between strands did in the last frame, but for their times; nothing without them.
    pub strand_contacts: Option<ContactReport>,
    /// What the last frame took, if stages are timed.
    pub secs: Option<FrameSecs>,
}

impl GpuSimulation {
    /// A simulation of `groom`, at rest at `options.rest_pose`.
    ///
    /// # Errors
    /// [`GpuError`] if the groom cannot be packed, a parameter is out of range, or the GPU has no room.
    pub fn new(
        gpu: &Gpu,
        groom: &Groom,
        params: impl Into<SolverParams>,
        options: &Options,
    ) -> Result<Self, GpuError> {
        Self::from_strands(gpu, &groom.into(), params, options)
    }

    /// The same from plain arrays.
    ///
    /// # Errors
    /// As [`GpuSimulation::new`].
    pub fn from_strands(
        gpu: &Gpu,
        strands: &Strands<'_, f32>,
        params: impl Into<SolverParams>,
        options: &Options,
    ) -> Result<Self, GpuError> {
        let params = params.into();
        params.validate()?;
        let mut model = Model::new(strands)?;
        let mut state = State::at_rest(&model, &options.rest_pose);
        params.prepare(&mut model, &mut state);
        Self::with(gpu, (model, state), &params, options)
    }

    /// What goes on where `simulation` is on the CPU. Strands that meet or touch there do not here until [`GpuSimulation::set_grid`] and [`GpuSimulation::set_contacts`] say so; the air's exposure
    /// is left behind.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] or [`GpuError::Failed`] if the GPU has no room.
    pub fn continuing(gpu: &Gpu, simulation: &Simulation<f32>) -> Result<Self, GpuError> {
        let (model, state) = (simulation.model().clone(), simulation.state().clone());
        Self::with(gpu, (model, state), simulation.params(), simulation.options())
    }

    fn with(
        gpu: &Gpu,
        (model, mirror): (Model<f32>, State<f32>),
        params: &SolverParams,
        options: &Options,
    ) -> Result<Self, GpuError> {
        let ranges = split(gpu, &model)?;
        let places = |range: &std::ops::Range<usize>| {
            model.blocks[range.clone()].iter().map(|block| block.particles).sum::<usize>()
        };
        // Kernels of one level find its number where others find their substep.
        let entries = match params {
            SolverParams::Dftl(own) if own.schedule == Schedule::Particles => model.longest() as u32,
            _ => params.substeps(),
        };
        let shared = Shared::new(gpu, ranges.iter().map(places).max().unwrap_or(1), entries);
        let solids = Solids::new(gpu, params.substeps());
        let bound = |range| {
            let batch = Batch::new(gpu, &model, range);
            batch.write(gpu, &mirror);
            Bound { batch, groups: Default::default() }
        };
        let batches = ranges.into_iter().map(bound).collect();
        gpu.check()?;
        let mut made = Self {
            gpu: gpu.clone(),
            model,
            mirror,
            params: params.clone(),
            options: *options,
            shared,
            solids,
            batches,
            substeps: Vec::new(),
            solve: Kernel::SolveStrands,
            grid: None,
            particles: None,
            contacts: None,
            air: None,
            clock: None,
        };
        made.bind();
        Ok(made)
    }

    /// Keeps the strand solve's factors in 16 bits from the next frame on, or not any more. That takes 96 bytes less to and fro a particle and substep, of 320, where memory bounds the solve; after a second of a
    /// shaken tuft positions are off by 0.1 mm, root mean square, where float32 is by 0.003 mm (`tests/conformance.rs`).
    pub fn set_half_factors(&mut self, on: bool) {
        self.solve = if on { Kernel::SolveHalved } else { Kernel::SolveStrands };
    }

    /// Lets strands meet on a grid from the next frame on, or not any more.
    ///
    /// # Errors
    /// [`GpuError::Params`] if a parameter is out of range; nothing is changed then. [`GpuError::Failed`] if the device has no room for it.
    pub fn set_grid(&mut self, params: Option<&GridParams>) -> Result<(), GpuError> {
        let batches: Vec<_> = self.batches.iter().map(|bound| &bound.batch).collect();
        let grid = params.map(|params| DeviceGrid::new(&self.gpu, &self.model, &batches, params));
        self.grid = grid.transpose()?;
        self.bind_anew()
    }

    /// Lets strands meet as smoothed particles from the next frame on, or not any more.
    ///
    /// # Errors
    /// [`GpuError::Params`] if a parameter is out of range, [`GpuError::TooLarge`] if the device cannot bind what they take; nothing is changed then. [`GpuError::Failed`] if it has no room.
    pub fn set_particles(&mut self, params: Option<&SphParams>) -> Result<(), GpuError> {
        let strands = (&self.model, &self.shared);
        self.particles = params.map(|params| DeviceParticles::new(&self.gpu, strands, params)).transpose()?;
        self.bind_anew()
    }

    /// Lets segments of strands touch from the next frame on, or not any more.
    ///
    /// # Errors
    /// [`GpuError::Params`] if a parameter is out of range, [`GpuError::TooLarge`] if the device cannot bind what they take; nothing is changed then. [`GpuError::Failed`] if it has no room.
    pub fn set_contacts(&mut self, params: Option<&ContactParams>) -> Result<(), GpuError> {
        let batches: Vec<_> = self.batches.iter().map(|bound| &bound.batch).collect();
        let strands = (&self.model, &self.shared);
        let contacts = params.map(|params| DeviceContacts::new(&self.gpu, strands, &batches, params));
        self.contacts = contacts.transpose()?;
        self.bind_anew()
    }

    fn bind_anew(&mut self) -> Result<(), GpuError> {
        self.bind();
        if self.clock.is_some() {
            self.time_stages(true);
        }
        self.gpu.check()
    }

    /// Binds what there is.
    fn bind(&mut self) {
        let (gpu, shared, solids, grid, air) = (&self.gpu, &self.shared, &self.solids, &self.grid, &self.air);
        let (contacts, particles) = (&self.contacts, &self.particles);
        let (device, kernels) = (gpu.device(), gpu.kernels());
        let common = |what: Binding| match (what, grid) {
            (Binding::Frame, _) => &shared.frame,
            (Binding::Substep, _) => &shared.substeps,
            (Binding::Look, _) => &solids.looks,
            (Binding::Read("fields"), _) => &solids.fields,
            (Binding::Change("scratch"), _) => &shared.scratch,
            (Binding::Grid, Some(grid)) => &grid.uniform,
            (Binding::Change("bounds"), Some(grid)) => &grid.bounds,
            (Binding::Change("cells"), Some(grid)) => &grid.cells,
            (Binding::Read("faces") | Binding::Change("faces"), Some(grid)) => &grid.faces,
            _ => match (what, contacts) {
                (Binding::Meet, Some(contacts)) => &contacts.uniform,
                (Binding::Change("starts"), Some(contacts)) => &contacts.starts,
                (Binding::Change("work"), Some(contacts)) => &contacts.work,
                (Binding::Change("table"), Some(contacts)) => &contacts.table,
                (Binding::Change("touch"), Some(contacts)) => &contacts.touch,
                (Binding::Read("rest"), Some(contacts)) => &contacts.rest,
                (Binding::Read("owners"), Some(contacts)) => &contacts.owners,
                _ => &shared.report,
            },
        };
        // Where there is no wind the kernels do not look at it.
        for (number, Bound { batch, groups }) in self.batches.iter_mut().enumerate() {
            let find = |what: Binding| match (what, grid) {
                (Binding::Read("blocks"), _) => &batch.blocks,
                (Binding::Read("model"), _) => &batch.model,
                (Binding::Read("strands"), _) => &batch.strands,
                (Binding::Change("positions"), _) => &batch.positions,
                (Binding::Change("velocities"), _) => &batch.velocities,
                (Binding::Change("memory"), _) => &batch.memory,
                (Binding::Read("rooms"), Some(grid)) => &grid.rooms[number],
                _ => match (what, air) {
                    (Binding::Read("wind") | Binding::Change("wind"), Some(air)) => &air.wind[number],
                    (Binding::Change("nodes"), Some(air)) => &air.nodes,
                    (Binding::Change("canopy"), Some(air)) => &air.canopy,
                    (Binding::Air, Some(air)) => &air.uniform,
                    (Binding::Read("wind"), None) => &batch.strands,
                    _ => common(what),
                },
            };
            *groups = GROUPS.map(|group| {
                let is_there = match group {
                    Group::Solve | Group::Strands | Group::Follow | Group::Solids => true,
                    Group::Air => air.is_some(),
                    Group::Splat | Group::Cells | Group::Gather => grid.is_some(),
                    Group::Wet | Group::Cloud => particles.is_some(),
                    Group::Enter | Group::Touch | Group::Bend => contacts.is_some(),
                    Group::Guides | Group::Carried => false,
                };
                let wet = |what: Binding| match (what, particles) {
                    (Binding::Fluid, Some(own)) => &own.uniform,
                    (Binding::Change("cloud"), Some(own)) => &own.cloud,
                    (Binding::Change("table"), Some(own)) => &own.table,
                    (Binding::Read("names"), Some(own)) => &own.names,
                    _ => find(what),
                };
                // Contacts have a table of their own.
                is_there.then(|| match group {
                    Group::Wet | Group::Cloud => kernels::bind(device, (kernels, group), &wet),
                    _ => kernels::bind(device, (kernels, group), &find),
                })
            });
        }
    }

    /// The model.
    pub fn model(&self) -> &Model<f32> {
        &self.model
    }

    /// The GPU that it is on.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// Its strands, batch by batch.
    pub(crate) fn batches(&self) -> impl ExactSizeIterator<Item = &Batch> {
        self.batches.iter().map(|bound| &bound.batch)
    }

    /// Bytes held on the device.
    pub fn bytes(&self) -> u64 {
        let batches = self.batches.iter().map(|bound| bound.batch.bytes());
        let grid = self.grid.as_ref().map_or(0, DeviceGrid::bytes);
        let air = self.air.as_ref().map_or(0, DeviceAir::bytes);
        let contacts = self.contacts.as_ref().map_or(0, DeviceContacts::bytes);
        let particles = self.particles.as_ref().map_or(0, DeviceParticles::bytes);
        self.shared.bytes() + self.solids.bytes() + grid + air + contacts + particles + batches.sum::<u64>()
    }

    /// Hands a frame to the device, in one submission, and does not wait for it.
    ///
    /// # Errors
    /// [`GpuError::Params`] if the frame's time and stiffness are beyond float32, [`GpuError::Unsupported`] for what runs on the CPU only, [`GpuError::Failed`] if the
    /// device has failed.
    pub fn step_frame(&mut self, frame: &Frame<'_>) -> Result<(), GpuError> {
        self.step_frame_in(frame, None)
    }

    /// The same in a `wind` that is not the same everywhere; the frame's own air velocity comes on top. The first such frame makes what it takes.
    ///
    /// # Errors
    /// As [`GpuSimulation::step_frame`].
    pub fn step_frame_in(&mut self, frame: &Frame<'_>, wind: Option<&WindField>) -> Result<(), GpuError> {
        self.step_part(frame, wind, &self.steps())
    }

    /// Some steps of a frame, in their order, for whoever runs the others on the CPU: see [`FrameStep::all`].
    ///
    /// # Errors
    /// As [`GpuSimulation::step_frame`].
    pub fn step_part(
        &mut self,
        frame: &Frame<'_>,
        wind: Option<&WindField>,
        steps: &[FrameStep],
    ) -> Result<(), GpuError> {
        self.gpu.check()?;
        self.params.validate_step(frame.dt_secs, self.options.beyond_float32)?;
        self.hold(frame.colliders)?;
        let air_velocity = wind.map_or(DVec3::ZERO, |wind| wind.mean) + frame.air_velocity;
        let wind =
            wind.map(|wind| WindField { mean: air_velocity, ..*wind }).filter(|wind| !wind.is_uniform());
        if wind.is_some() && self.air.is_none() {
            let batches: Vec<_> = self.batches.iter().map(|bound| &bound.batch).collect();
            self.air = Some(DeviceAir::new(&self.gpu, &self.model, &batches));
            self.bind();
            self.gpu.check()?;
        }
        let shelter = self.place(&Frame { air_velocity, ..*frame }, wind.as_ref(), steps);
        let mut encoder = self.gpu.device().create_command_encoder(&Default::default());
        self.encode(&mut encoder, &self.plan(steps, look_at(frame.colliders), shelter));
        self.gpu.queue().submit([encoder.finish()]);
        Ok(())
    }

    /// Brings the fields of `solids` to the device, before a frame asks for them.
    ///
    /// # Errors
    /// [`GpuError::Unsupported`] for solids that it cannot take, [`GpuError::TooLarge`] if their fields have no room.
    pub fn hold(&mut self, solids: &[ColliderFrame<'_>]) -> Result<(), GpuError> {
        if self.solids.hold(&self.gpu, solids)? {
            self.bind();
        }
        Ok(())
    }

    /// Times stages from the next frame on, or not any more; whether the device can.
    pub fn time_stages(&mut self, on: bool) -> bool {
        let look = (Some(Kernel::ResolveSolids), Kernel::FollowLeader);
        let air = Some(Shelter { wake: true, canopy: true });
        let plan = self.plan(&self.steps(), look, air);
        let passes = by_stage(&plan).count() as u32;
        self.clock = on.then(|| Clock::new(&self.gpu, passes)).flatten();
        self.clock.is_some()
    }

    /// All kernels of a plan: in one pass, or where they are timed each stage in its own.
    fn encode(&mut self, encoder: &mut wgpu::CommandEncoder, plan: &[Call]) {
        let mut clock = self.clock.take();
        if let Some(clock) = &mut clock {
            clock.begin();
            for calls in by_stage(plan) {
                let stage = calls[0].kernel.stage();
                let timestamp_writes = Some(clock.next(stage.stage));
                let described = wgpu::ComputePassDescriptor { label: Some(stage.name), timestamp_writes };
                let mut pass = encoder.begin_compute_pass(&described);
                calls.iter().for_each(|call| self.call(&mut pass, call));
            }
            clock.end(encoder);
        } else {
            let described = wgpu::ComputePassDescriptor { label: Some("frame"), timestamp_writes: None };
            let mut pass = encoder.begin_compute_pass(&described);
            plan.iter().for_each(|call| self.call(&mut pass, call));
        }
        self.clock = clock;
    }

    /// The kernels of `steps` in their order, with those that look at solids ([`look_at`]). Strands go batch by batch as far as they do not meet.
    fn plan(
        &self,
        steps: &[FrameStep],
        (look, follow): (Option<Kernel>, Kernel),
        air: Option<Shelter>,
    ) -> Vec<Call> {
        let mut plan = Vec::new();
        let meets = |step: &FrameStep| {
            use FrameStep::{Contacts, Grid, NoteStart, Particles};
            matches!(step, NoteStart | Particles | Grid | Contacts)
        };
        for steps in steps.chunk_by(|a, b| meets(a) == meets(b)) {
            if meets(&steps[0]) {
                steps.iter().for_each(|step| self.meet(&mut plan, *step));
                continue;
            }
            if let Some(shelter) = air.filter(|_| begins(steps)) {
                self.blow(&mut plan, shelter);
                if steps.contains(&FrameStep::FollowLeader) {
                    self.call_all(&mut plan, Kernel::BlowStrands, 0);
                }
            }
            for batch in 0..self.batches.len() {
                let last = self.params.substeps() - 1;
                for step in steps {
                    if *step == FrameStep::FollowLeader {
                        self.follow(&mut plan, batch, follow);
                        continue;
                    }
                    let follows = self.follows() && *step == FrameStep::LastSolids;
                    let call = match *step {
                        FrameStep::SolveStrands(number) => Some((self.solve, number)),
                        FrameStep::ResolveSolids(number) => look.map(|look| (look, number)),
                        FrameStep::LastSolids => look.map(|look| (look, last + 1)),
                        FrameStep::RestoreLengths => Some((Kernel::RestoreLengths, last)),
                        _ => Some((Kernel::CheckStrands, last)),
                    };
                    let own = call.map(|(kernel, number)| Call { kernel, batch, number });
                    let load = |kernel| follows.then_some(Call { kernel, batch, number: 0 });
                    plan.extend(load(Kernel::LayLoadAside).into_iter().chain(own));
                    plan.extend(load(Kernel::TakeLoadBack));
                }
            }
        }
        plan
    }

    /// A step of follow the leader, of which `follow` does all at once.
    fn follow(&self, plan: &mut Vec<Call>, batch: usize, follow: Kernel) {
        let schedule = match &self.params {
            // Only what does all at once knows solids that change.
            SolverParams::Dftl(params) if follow == Kernel::FollowLeader => params.schedule,
            _ => Schedule::Fused,
        };
        let call = |kernel, number| Call { kernel, batch, number };
        match schedule {
            Schedule::Fused => plan.push(call(follow, 0)),
            Schedule::Strands => {
                plan.extend([call(Kernel::PredictParticles, 0), call(Kernel::FollowStrands, 0)]);
            }
            Schedule::Particles => {
                plan.push(call(Kernel::PredictParticles, 0));
                let levels = 1..self.batches[batch].batch.longest;
                plan.extend(levels.map(|level| call(Kernel::FollowLevel, level)));
            }
        }
    }

    /// Whether strands follow the leader.
    fn follows(&self) -> bool {
        matches!(self.params, SolverParams::Dftl(_))
    }

    /// A step in which strands meet: followers with the speed at which they move.
    fn meet(&self, plan: &mut Vec<Call>, step: FrameStep) {
        let loaded = self.follows() && matches!(step, FrameStep::Grid | FrameStep::Contacts);
        if loaded {
            self.call_all(plan, Kernel::LayLoadAside, 0);
        }
        self.meet_in_motion(plan, step);
        if loaded {
            self.call_all(plan, Kernel::TakeLoadBack, 0);
        }
        // Followers get their lengths back after the last step in which they meet.
        let last = if self.contacts.is_some() { FrameStep::Contacts } else { FrameStep::Grid };
        if loaded && self.grid.is_some() && step == last {
            self.call_all(plan, Kernel::RestoreLengths, 0);
        } else if self.restores_lengths() && self.contacts.is_some() && step == FrameStep::Contacts {
            self.call_all(plan, Kernel::RestoreAgain, self.params.substeps() - 1);
        }
    }

    fn meet_in_motion(&self, plan: &mut Vec<Call>, step: FrameStep) {
        match (step, &self.grid, &self.contacts) {
            (FrameStep::Grid, Some(grid), _) => self.exchange(plan, grid.params.iterations),
            (FrameStep::Particles, ..) if self.particles.is_some() => {
                use Kernel::{
                    ClearBuckets, CountParticles, EnterParticles, FindNeighbours, KickStrands, LayBuckets,
                    PushParticles,
                };
                let find = [ClearBuckets, CountParticles, LayBuckets, EnterParticles, FindNeighbours];
                let kernels = find.into_iter().chain([PushParticles, KickStrands]);
                kernels.for_each(|kernel| self.call_all(plan, kernel, 0));
            }
            (FrameStep::NoteStart, _, Some(_)) => self.call_all(plan, Kernel::NoteStart, 0),
            (FrameStep::Contacts, _, Some(contacts)) => self.touch(plan, contacts.params.rounds),
            _ => {}
        }
    }

    fn steps(&self) -> Vec<FrameStep> {
        let meeting = Meeting {
            grid: self.grid.is_some(),
            particles: self.particles.is_some(),
            contacts: self.contacts.is_some(),
        };
        FrameStep::all(&self.params, meeting).collect()
    }

    /// Contacts between strands are found and resolved, in so many rounds at most.
    fn touch(&self, plan: &mut Vec<Call>, rounds: u32) {
        use Kernel::{
            ApplyMoves, ChooseActive, ChooseFound, ClearCells, ClearDrift, ClearLinks, CountFound,
            EnterSegments, FitDrift, JudgeRound, LayOut, LinkJoints, ListActive, MeasureStrays, MeetSegments,
            NextSlice, NoteEnd, OrderJoints, PrepareStrands, PressJoints, ReserveLists, SmoothDrift,
            SplatDrift, TakeMoves, TakeUp, WeighJoints,
        };
        let strays = [NoteEnd, FitDrift, ClearDrift, SplatDrift, SmoothDrift, MeasureStrays];
        // How many slices the frame has the device knows: of those that it has not nothing is searched.
        let slice = [ClearCells, EnterSegments, LayOut, EnterSegments, MeetSegments, NextSlice];
        let joints = [CountFound, ChooseFound, ClearLinks, TakeUp, ReserveLists, LinkJoints, OrderJoints];
        let kernels = strays
            .into_iter()
            .chain([ChooseActive, ListActive])
            .chain((0..SLICES).flat_map(|_| slice))
            .chain(joints)
            .chain([PrepareStrands, WeighJoints])
            .chain((0..rounds).flat_map(|_| [PressJoints, TakeMoves, JudgeRound]))
            .chain([ApplyMoves]);
        kernels.for_each(|kernel| self.call_all(plan, kernel, 0));
    }

    /// The wind, and the shelter in it.
    fn blow(&self, plan: &mut Vec<Call>, shelter: Shelter) {
        use Kernel::{
            ClearCanopy, FillWake, FitCanopy, MarchCanopy, MarchWake, MeasureCanopy, SampleAir, SplatCanopy,
        };
        let wake = [FillWake, MarchWake].into_iter().filter(|_| shelter.wake);
        let canopy = [MeasureCanopy, FitCanopy, ClearCanopy, SplatCanopy, MarchCanopy];
        for kernel in wake.chain(canopy.into_iter().filter(|_| shelter.canopy)).chain([SampleAir]) {
            self.call_all(plan, kernel, 0);
        }
    }

    /// A kernel on all batches, or once, if it is not of strands.
    fn call_all(&self, plan: &mut Vec<Call>, kernel: Kernel, number: u32) {
        let by_batch = matches!(kernel.over(), Over::Strands | Over::Particles);
        let batches = if by_batch { self.batches.len() } else { 1 };
        plan.extend((0..batches).map(|batch| Call { kernel, batch, number }));
    }

    /// Strands exchange what they have on the grid, whose pressure takes so many sweeps at most.
    fn exchange(&self, plan: &mut Vec<Call>, sweeps: u32) {
        use Kernel::{
            AimDisplacements, AimVelocities, ClearGrid, Divide, FitGrid, GatherDisplacements,
            GatherVelocities, Judge, MeasureHair, PushDisplacements, PushVelocities, RelaxEven, RelaxOdd,
            SplatSegments, WallOff,
        };
        // A pressure is looked at every few sweeps, and at its last.
        let relax = (1..=sweeps.next_multiple_of(SWEEPS)).flat_map(|sweep| {
            let judge = (sweep % SWEEPS == 0).then_some(Judge);
            [RelaxEven, RelaxOdd].into_iter().chain(judge)
        });
        let kernels = [MeasureHair, FitGrid, ClearGrid, SplatSegments, WallOff, Divide, AimVelocities]
            .into_iter()
            .chain(relax.clone())
            .chain([PushVelocities, GatherVelocities, AimDisplacements])
            .chain(relax)
            .chain([PushDisplacements, GatherDisplacements]);
        for kernel in kernels {
            self.call_all(plan, kernel, self.params.substeps());
        }
    }

    fn call(&self, pass: &mut wgpu::ComputePass<'_>, call: &Call) {
        let (kernel, bound) = (call.kernel, &self.batches[call.batch]);
        let group = kernel.stage().group;
        let offsets = match group {
            Group::Solve | Group::Strands => &[call.number * self.shared.stride][..],
            Group::Air | Group::Solids | Group::Cells => &[call.number * self.solids.stride],
            // The only look of a step.
            Group::Follow => &[call.number * self.shared.stride, 0],
            _ => &[],
        };
        let over = kernel.over();
        let along_y = if over == Over::Particles { bound.batch.longest } else { 1 };
        pass.set_pipeline(self.gpu.kernels().pipeline(kernel));
        pass.set_bind_group(0, &bound.groups[group as usize], offsets);
        pass.dispatch_workgroups(over.groups(bound.batch.groups), along_y, 1);
    }

    /// Whether solids are looked at once more at the frame's end.
    fn looks_last(&self) -> bool {
        self.steps().contains(&FrameStep::LastSolids)
    }

    fn restores_lengths(&self) -> bool {
        self.params.inextensibility().0 != Inextensibility::Off
    }

    /// Brings what the frame's strands share to the device, before `steps` of it; what shelters from the `wind`, if there is one that is not the same everywhere.
    fn place(&mut self, frame: &Frame<'_>, wind: Option<&WindField>, steps: &[FrameStep]) -> Option<Shelter> {
        let origin = frame.origin(&self.model);
        let start = self.model.about_centre(&frame.head[0], self.mirror.origin);
        let shift = self.mirror.origin - origin;
        // Positions go there in the first substep.
        if begins(steps) {
            self.mirror.origin = origin;
        }
        let air = (frame.air_velocity, wind.is_some());
        let uniform = FrameUniform::new(&self.params, frame.dt_secs, frame.gravity, air);
        self.gpu.queue().write_buffer(&self.shared.frame, 0, bytemuck::bytes_of(&uniform));
        let (count, weight) = (self.params.substeps(), self.options.carried_gravity());
        let poses: Vec<_> = frame.poses(&self.model, count, origin).collect();
        self.substeps.clear();
        for (step, ends) in (0..count).zip(poses.windows(2)) {
            let shift = if step == 0 { shift } else { DVec3::ZERO };
            let substep = SubstepUniform::new([&ends[0], &ends[1]], weight, shift);
            self.substeps.resize((step * self.shared.stride) as usize, 0);
            self.substeps.extend_from_slice(bytemuck::bytes_of(&substep));
        }
        for level in count..(self.shared.substeps.size() / u64::from(self.shared.stride)) as u32 {
            let [start, end] = [&poses[0], &poses[1]];
            let substep = SubstepUniform { level, ..SubstepUniform::new([start, end], weight, shift) };
            self.substeps.resize((level * self.shared.stride) as usize, 0);
            self.substeps.extend_from_slice(bytemuck::bytes_of(&substep));
        }
        self.gpu.queue().write_buffer(&self.shared.substeps, 0, &self.substeps);
        if !frame.colliders.is_empty() || matches!(self.params, SolverParams::Dftl(_)) {
            let looks_last = self.looks_last();
            self.solids.place(&self.gpu, &self.params, frame, origin, looks_last);
        }
        if let (Some(contacts), [.., now]) = (&mut self.contacts, &*poses) {
            contacts.place(&self.gpu, [&start, now], (self.params.clamped(), frame.dt_secs));
        }
        if let Some(particles) = &mut self.particles {
            particles.place(&self.gpu, frame.dt_secs);
        }
        if let (Some(grid), [.., before, now]) = (&mut self.grid, &*poses) {
            let moving = GridFrame::new(before, now, frame.dt_secs / f64::from(count));
            grid.place(&self.gpu, (frame, count), &moving, origin);
        }
        let wind = wind.map(|wind| (wind, frame.colliders.len()));
        let (model, gpu) = (&self.model, &self.gpu);
        self.air.as_mut().zip(wind).map(|(air, wind)| air.place(gpu, model, wind, (origin, shift)))
    }

    /// What the frames since the last report did. Waits for the device.
    ///
    /// # Errors
    /// [`GpuError::Failed`] if the device has failed.
    pub fn report(&mut self) -> Result<GpuReport, GpuError> {
        self.fetch(true, false)
    }

    /// The same and the state, rows as in the model, in one wait.
    ///
    /// # Errors
    /// As [`GpuSimulation::report`].
    pub fn report_and_state(&mut self) -> Result<(GpuReport, &State<f32>), GpuError> {
        let report = self.fetch(true, true)?;
        Ok((report, &self.mirror))
    }

    /// Reads what is asked for, in one wait.
    fn fetch(&mut self, report: bool, state: bool) -> Result<GpuReport, GpuError> {
        let mut buffers = Vec::new();
        if report {
            buffers.push(&self.shared.report);
            buffers.extend(self.grid.as_ref().map(|grid| &grid.bounds));
            buffers.extend(self.contacts.as_ref().map(|contacts| &contacts.touch));
            buffers.extend(self.clock.as_ref().map(Clock::resolved));
        }
        if state {
            buffers.extend(self.batches.iter().flat_map(|bound| bound.batch.state()));
        }
        let read = self.gpu.read(&buffers)?;
        let mut read = read.iter();
        let mut next = || read.next().map_or(&[][..], |bytes| bytes);
        let mut found = GpuReport::default();
        if report {
            // All but what is of the last frame alone.
            let sums = [0; std::mem::offset_of!(ReportEntry, contacts)];
            self.gpu.queue().write_buffer(&self.shared.report, 0, &sums);
            let own: ReportEntry = bytemuck::pod_read_unaligned(next());
            // Of followers that do not meet lengths are restored level by level.
            let level_by_level = self.follows() && self.grid.is_none() && self.contacts.is_none();
            let restores = self.restores_lengths() && !level_by_level;
            let restored = if restores { own.restored } else { own.stretch };
            found = GpuReport {
                max_edge_stretch: f32::from_bits(restored),
                max_edge_stretch_final: f32::from_bits(own.stretch),
                quarantined_strands: own.quarantined,
                touching: own.touching,
                max_penetration_m: f32::from_bits(own.deepest),
                grid: self
                    .grid
                    .as_ref()
                    .map(|_| bytemuck::pod_read_unaligned::<BoundsEntry>(next()).report()),
                strand_contacts: self.contacts.as_ref().map(|_| {
                    let touch = &next()[..size_of::<TouchEntry>()];
                    bytemuck::pod_read_unaligned::<TouchEntry>(touch).report(own.contacts)
                }),
                secs: self.clock.as_ref().map(|clock| clock.secs(next())),
            };
        }
        if state {
            for Bound { batch, .. } in &self.batches {
                batch.take([next(), next(), next()], &mut self.mirror);
            }
        }
        Ok(found)
    }

    /// A copy of the state that resumes bit for bit. Waits for the device.
    ///
    /// # Errors
    /// [`GpuError::Failed`] if the device has failed.
    pub fn snapshot(&mut self) -> Result<Snapshot<f32>, GpuError> {
        self.fetch(false, true)?;
        Ok(self.mirror.snapshot(&self.model))
    }

    /// Goes back to a snapshot, of this or of a simulation of the same groom on a CPU.
    ///
    /// # Errors
    /// [`GpuError::Snapshot`] if it is of another groom, [`GpuError::Failed`] if the device has failed.
    pub fn restore(&mut self, snapshot: &Snapshot<f32>) -> Result<(), GpuError> {
        self.mirror.restore(&self.model, snapshot)?;
        self.batches.iter().for_each(|bound| bound.batch.write(&self.gpu, &self.mirror));
        self.gpu.check()
    }

    /// A 64-bit hash of the state: see [`Snapshot::hash`]. Waits for the device.
    ///
    /// # Errors
    /// [`GpuError::Failed`] if the device has failed.
    pub fn state_hash(&mut self) -> Result<u64, GpuError> {
        Ok(self.snapshot()?.hash())
    }
}
