//! A simulation on a GPU: construction, settings, stepping, snapshots.

use crate::acceleration::DeviceAcceleration;
use crate::air::DeviceAir;
use crate::batch::{Batch, DeviceStrands, Shared, StrandGroups, split};
use crate::channels::{self, DeviceChannels};
use crate::clock::Clock;
use crate::collide::{Solids, queries};
use crate::encode::FrameKinds;
use crate::interaction::{self, GpuInteraction, Kind};
use crate::network::DeviceNetwork;
use crate::positions::DevicePositions;
use crate::roots::{DeviceRoots, RootStep};
use crate::sleep::{DeviceSleep, SleepStep};
use crate::solver::{self, GpuSolver};
use crate::{Gpu, GpuError};
use forelock_core::air::WindField;
use forelock_core::body::ColliderFrame;
use forelock_core::frame::{
    Acceleration, Air, Exchange, FrameInput, FramePlan, FrameRules, PlannedStep, Roots, Solver, pack_frames,
};
use forelock_core::groom::Groom;
use forelock_core::interaction::Interactions;
use forelock_core::interaction::contact::ContactParams;
use forelock_core::interaction::grid::GridParams;
use forelock_core::interaction::sph::SphParams;
use forelock_core::lane::Row;
use forelock_core::simulation::{Options, Simulation};
use forelock_core::strands::{Model, Strands};
use forelock_core::strands::{Snapshot, State};
use glam::DVec3;

/// The frame that is planned before the length of one is known, seconds.
pub(crate) const USUAL_FRAME_SECS: f64 = 1.0 / 60.0;

/// A simulation whose state is on a GPU: [`forelock_core::simulation::Simulation`], stage by stage.
///
/// Pipelines are made when the first frame that uses them is recorded, and kept by the [`Gpu`];
/// further frames make none.
///
/// Memory, in bytes per particle: 28 of model, 32 of state, 120 of scratch (that of the largest
/// batch). With a grid 4 more, and 68 for each cell of its capacity; under follow the leader 24
/// more; with contacts 12 more and what [`crate::interaction::contact`] states; with SPH what
/// [`crate::interaction::sph`] states; 12 more after the first wind field, 12 after the first
/// acceleration in addition to gravity, 4 with masses, 4 for each row of the solver's channels. On
/// a body that bends 56 more per strand; where the device computes the motions of the roots, 128
/// more per strand and what a [`crate::Skinner`] takes.
#[derive(Debug)]
pub struct GpuSimulation {
    pub(crate) gpu: Gpu,
    pub(crate) model: Model<f32>,
    /// The point of the world that positions are relative to.
    pub(crate) origin: DVec3,
    /// Memory for read-backs of the state, once one was asked for.
    pub(crate) read_back: Option<State<f32>>,
    /// The positions, as renderers find them.
    pub(crate) positions: DevicePositions,
    pub(crate) solver: Solver<f32>,
    pub(crate) kernels: Box<dyn GpuSolver>,
    pub(crate) rules: FrameRules,
    /// Substeps of `plan`.
    pub(crate) count: u32,
    pub(crate) plan: FramePlan,
    pub(crate) options: Options,
    pub(crate) shared: Shared,
    pub(crate) solids: Solids,
    pub(crate) batches: Vec<Batch>,
    pub(crate) groups: StrandGroups,
    pub(crate) channels: DeviceChannels,
    /// Bytes of the substeps of a frame.
    pub(crate) substeps: Vec<u8>,
    /// Motions of strands relative to the head in a frame, packed.
    pub(crate) root_frames: Vec<Row<f32>>,
    /// Made at the first frame on a skin ([`Roots::OnSkin`]).
    pub(crate) roots: Option<DeviceRoots>,
    pub(crate) half_factors: bool,
    /// In the order of [`interaction::KINDS`], each at most once.
    pub(crate) interactions: Vec<Box<dyn GpuInteraction>>,
    /// Made at the first wind field.
    pub(crate) air: Option<DeviceAir>,
    /// Made at the first acceleration in addition to gravity.
    pub(crate) acceleration: Option<DeviceAcceleration>,
    pub(crate) sleep: DeviceSleep,
    /// What moves the strands, where a network does.
    pub(crate) network: Option<DeviceNetwork>,
    pub(crate) clock: Option<Clock>,
}

/// Strands to be simulated and their state.
pub(crate) struct Packed {
    pub model: Model<f32>,
    pub state: State<f32>,
}

impl GpuSimulation {
    /// A simulation of `groom`, at rest at `options.rest_pose`.
    ///
    /// # Errors
    /// [`GpuError`] if the groom cannot be packed, a parameter is out of range, or the GPU has no
    /// room.
    pub fn new(
        gpu: &Gpu,
        groom: &Groom,
        solver: impl Into<Solver<f32>>,
        options: &Options,
    ) -> Result<Self, GpuError> {
        let options = Options { masses: options.masses.fixed(groom)?, ..*options };
        let masses = options.masses.of(groom)?;
        Self::from_strands(gpu, &Strands { masses: masses.as_deref(), ..groom.into() }, solver, &options)
    }

    /// The same from plain arrays.
    ///
    /// # Errors
    /// The same errors as [`GpuSimulation::new`].
    pub fn from_strands(
        gpu: &Gpu,
        strands: &Strands<'_, f32>,
        solver: impl Into<Solver<f32>>,
        options: &Options,
    ) -> Result<Self, GpuError> {
        let solver = solver.into();
        solver.validate()?;
        let mut model = solver.pack(strands)?;
        let mut state = State::at_rest(&model, &options.rest_pose);
        solver.channels().prepare(&mut model, &mut state);
        Self::from_packed(gpu, Packed { model, state }, &solver, options)
    }

    /// Continues from the state of a simulation on the CPU. Interactions are not copied: set them
    /// with [`GpuSimulation::set_grid`], [`GpuSimulation::set_sph`] and
    /// [`GpuSimulation::set_contacts`]. The exposure to the air is not copied either.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] or [`GpuError::Failed`] if the GPU has no room.
    pub fn continuing(gpu: &Gpu, simulation: &Simulation<f32>) -> Result<Self, GpuError> {
        let packed = Packed { model: simulation.model().clone(), state: simulation.state().clone() };
        Self::from_packed(gpu, packed, simulation.solver(), simulation.options())
    }

    pub(crate) fn from_packed(
        gpu: &Gpu,
        packed: Packed,
        solver: &Solver<f32>,
        options: &Options,
    ) -> Result<Self, GpuError> {
        let Packed { model, state } = packed;
        let asked = solver.channels().extra;
        let channel_rows = channels::rows(asked);
        let ranges = split(gpu, &model, channel_rows)?;
        let places = |range: &std::ops::Range<usize>| {
            model.blocks[range.clone()].iter().map(|block| block.particles).sum::<usize>()
        };
        let (kernels, rules) = (solver::of(solver)?, solver.rules());
        let count = rules.substeps(USUAL_FRAME_SECS);
        let entries = kernels.substep_entries(count, model.longest() as u32);
        let shared = Shared::new(gpu, ranges.iter().map(places).max().unwrap_or(1), entries);
        let solids = Solids::new(gpu, queries::of_frame(&rules, count));
        let batch = |range| {
            let batch = Batch::new(gpu, &model, range, channel_rows);
            batch.write(gpu, &state);
            batch
        };
        let batches: Vec<Batch> = ranges.into_iter().map(batch).collect();
        gpu.check()?;
        let mut made = Self {
            gpu: gpu.clone(),
            model,
            origin: state.origin,
            read_back: None,
            positions: DevicePositions::default(),
            solver: solver.clone(),
            kernels,
            rules,
            count,
            plan: FramePlan::new(&rules, count, &[]),
            options: *options,
            shared,
            solids,
            batches,
            groups: StrandGroups::default(),
            channels: DeviceChannels::new(gpu, asked, &state),
            substeps: Vec::new(),
            root_frames: Vec::new(),
            roots: None,
            half_factors: false,
            interactions: Vec::new(),
            air: None,
            acceleration: None,
            sleep: DeviceSleep::default(),
            network: None,
            clock: None,
        };
        made.sleep.take(gpu, &made.model, &state);
        made.positions = DevicePositions::of(&made.model, &made.batches, made.origin);
        made.bind();
        Ok(made)
    }

    /// Sets the speed below which strands are still, m/s, from the next frame on; 0: no strand
    /// sleeps. See [`Options::sleep_speed`].
    pub fn set_sleep_speed(&mut self, speed: f64) {
        self.options.sleep_speed = speed;
        self.sleep.wake();
    }

    /// Strands that sleep: all or none.
    pub fn sleeping_strands(&self) -> usize {
        if self.sleep.is_asleep() { self.model.strand_count } else { 0 }
    }

    /// Whether the strand solve keeps its factors in 16 bits, from the next frame on. This saves 96
    /// of 320 bytes of traffic per particle and substep, where memory bounds the solve; after a
    /// second of a shaken tuft positions differ by 0.1 mm root mean square, where those of float32
    /// differ by 0.003 mm (`tests/conformance.rs`).
    pub fn set_half_factors(&mut self, on: bool) {
        self.half_factors = on;
    }

    /// Sets the grid interaction from the next frame on, or removes it.
    ///
    /// # Errors
    /// [`GpuError::Params`] if a parameter is out of range; then nothing changes.
    /// [`GpuError::Failed`] if the device has no room.
    pub fn set_grid(&mut self, params: Option<&GridParams>) -> Result<(), GpuError> {
        let wanted = Interactions { grid: params.cloned(), ..Interactions::default() };
        self.set_kinds(&[&interaction::grid::KIND], &wanted)
    }

    /// Sets the SPH interaction from the next frame on, or removes it.
    ///
    /// # Errors
    /// [`GpuError::Params`] if a parameter is out of range, [`GpuError::TooLarge`] if a buffer
    /// exceeds a binding; then nothing changes. [`GpuError::Failed`] if the device has no room.
    pub fn set_sph(&mut self, params: Option<&SphParams>) -> Result<(), GpuError> {
        let wanted = Interactions { sph: params.cloned(), ..Interactions::default() };
        self.set_kinds(&[&interaction::sph::KIND], &wanted)
    }

    /// Sets the contacts between strands from the next frame on, or removes them.
    ///
    /// # Errors
    /// [`GpuError::Params`] if a parameter is out of range, [`GpuError::TooLarge`] if a buffer
    /// exceeds a binding; then nothing changes. [`GpuError::Failed`] if the device has no room.
    pub fn set_contacts(&mut self, params: Option<&ContactParams>) -> Result<(), GpuError> {
        let wanted = Interactions { contacts: params.cloned(), ..Interactions::default() };
        self.set_kinds(&[&interaction::contact::KIND], &wanted)
    }

    /// Sets or removes all interactions, from the next frame on.
    ///
    /// # Errors
    /// [`GpuError::Params`] if a parameter is out of range; then nothing changes.
    /// [`GpuError::TooLarge`] if a buffer exceeds a binding, [`GpuError::Failed`] if the device has
    /// no room.
    pub fn set_interactions(&mut self, interactions: &Interactions) -> Result<(), GpuError> {
        interactions.validate()?;
        self.set_kinds(&interaction::KINDS, interactions)
    }

    /// Sets or removes the interactions of `kinds` one after the other, as `wanted` says.
    fn set_kinds(&mut self, kinds: &[&Kind], wanted: &Interactions) -> Result<(), GpuError> {
        let set = kinds.iter().try_for_each(|kind| {
            let made = (kind.make)(&self.gpu, self.strands(), wanted)?;
            interaction::replace(&mut self.interactions, kind.name, made);
            Ok(())
        });
        self.sleep.wake();
        // After an error too: those before it are set.
        let bound = self.rebind();
        set.and(bound)
    }

    /// Builds the interactions of `other`, a simulation of other strands.
    pub(crate) fn rebuild_interactions(&mut self, other: &Self) -> Result<(), GpuError> {
        let rebuilt = other.interactions.iter().map(|own| own.rebuild(&self.gpu, self.strands()));
        self.interactions = rebuilt.collect::<Result<_, _>>()?;
        self.rebind()
    }

    /// Makes all bind groups and plans frames anew.
    pub(crate) fn rebind(&mut self) -> Result<(), GpuError> {
        self.bind();
        self.replan()
    }

    /// Plans frames anew.
    pub(crate) fn replan(&mut self) -> Result<(), GpuError> {
        self.plan = FramePlan::new(&self.rules, self.count, &self.exchanges());
        self.gpu.check()
    }

    /// The interactions of the simulation.
    pub fn exchanges(&self) -> Vec<Exchange> {
        let of_each = self.interactions.iter();
        of_each.flat_map(|own| own.early_exchange().into_iter().chain([own.exchange_plan()])).collect()
    }

    /// The last frame as a list of steps; before the first frame, one of 1/60 s. Its stages do not
    /// depend on the frame's length, its substeps do.
    pub fn plan(&self) -> &FramePlan {
        &self.plan
    }

    /// A frame of `dt_secs` as a list of steps. Buffers grow if it has more substeps than all
    /// frames before.
    ///
    /// # Errors
    /// [`GpuError::Failed`] if the device has failed.
    pub fn plan_for(&mut self, dt_secs: f64) -> Result<FramePlan, GpuError> {
        let count = self.rules.substeps(dt_secs);
        if count != self.count {
            self.count = count;
            let entries = self.kernels.substep_entries(count, self.model.longest() as u32);
            let queries = queries::of_frame(&self.rules, count);
            let grown = [self.shared.hold(&self.gpu, entries), self.solids.hold_queries(&self.gpu, queries)];
            if grown.contains(&true) {
                self.bind();
            }
            self.replan()?;
        }
        Ok(self.plan.clone())
    }

    /// Makes all bind groups.
    fn bind(&mut self) {
        let Self {
            gpu,
            model,
            shared,
            solids,
            batches,
            groups,
            channels,
            kernels,
            interactions,
            air,
            acceleration,
            sleep,
            roots,
            network,
            ..
        } = self;
        let strands = DeviceStrands { model, shared, batches };
        sleep.bind(gpu, strands);
        channels.bind(gpu, strands);
        let winds = air.as_ref().map(|air| &*air.wind);
        *groups = StrandGroups::new(gpu, strands, channels, solids, winds);
        kernels.bind(gpu, strands, solids, winds);
        interactions.iter_mut().for_each(|own| own.bind(gpu, strands, solids));
        if let Some(air) = air {
            air.bind(gpu, strands, solids);
        }
        if let Some(acceleration) = acceleration {
            acceleration.bind(gpu, strands);
        }
        if let Some(roots) = roots {
            roots.bind(gpu, strands);
        }
        if let Some(network) = network {
            network.bind(gpu, strands);
        }
    }

    /// The model.
    pub fn model(&self) -> &Model<f32> {
        &self.model
    }

    /// The GPU that it runs on.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// The batches of its strands.
    pub(crate) fn batches(&self) -> &[Batch] {
        &self.batches
    }

    pub(crate) fn strands(&self) -> DeviceStrands<'_> {
        DeviceStrands { model: &self.model, shared: &self.shared, batches: &self.batches }
    }

    /// Bytes held on the device.
    pub fn bytes(&self) -> u64 {
        let batches = self.batches.iter().map(Batch::bytes).sum::<u64>();
        let air = self.air.as_ref().map_or(0, DeviceAir::bytes)
            + self.sleep.bytes()
            + self.channels.bytes()
            + self.acceleration.as_ref().map_or(0, DeviceAcceleration::bytes)
            + self.roots.as_ref().map_or(0, DeviceRoots::bytes)
            + self.network.as_ref().map_or(0, DeviceNetwork::bytes);
        let interactions = self.interactions.iter().map(|own| own.bytes()).sum::<u64>();
        self.shared.bytes() + self.solids.bytes() + interactions + air + batches
    }

    /// Submits a frame, in one submission, and does not wait for it.
    ///
    /// # Errors
    /// [`GpuError::Params`] if time step and stiffness are beyond float32,
    /// [`GpuError::Unsupported`] for what only the CPU supports, [`GpuError::Failed`] if the device
    /// has failed.
    pub fn step_frame(&mut self, frame: &FrameInput<'_>) -> Result<(), GpuError> {
        let plan = self.plan_for(frame.dt_secs)?;
        self.step_part(frame, plan.steps())
    }

    /// Records a frame into the caller's `encoder`, for an engine that submits its own work: the
    /// positions are in their buffers ([`GpuSimulation::positions`]) for what is recorded after it.
    /// The frame's coefficients are written to the queue at once, and take effect before the next
    /// submission: one frame a submission. A frame that is recorded and never submitted leaves what
    /// later frames count on undone, such as the motions of roots.
    ///
    /// # Errors
    /// The same errors as [`GpuSimulation::step_frame`].
    pub fn encode(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        frame: &FrameInput<'_>,
    ) -> Result<(), GpuError> {
        let plan = self.plan_for(frame.dt_secs)?;
        self.encode_part(encoder, frame, plan.steps())
    }

    /// Some steps of a frame ([`GpuSimulation::plan_for`]), in their order, if the CPU runs the
    /// others; in a submission of their own.
    ///
    /// # Errors
    /// The same errors as [`GpuSimulation::step_frame`].
    pub fn step_part(&mut self, frame: &FrameInput<'_>, steps: &[PlannedStep]) -> Result<(), GpuError> {
        let mut encoder = self.gpu.device().create_command_encoder(&Default::default());
        self.encode_part(&mut encoder, frame, steps)?;
        self.gpu.queue().submit([encoder.finish()]);
        Ok(())
    }

    fn encode_part(
        &mut self,
        encoder: &mut wgpu::CommandEncoder,
        frame: &FrameInput<'_>,
        steps: &[PlannedStep],
    ) -> Result<(), GpuError> {
        self.gpu.check()?;
        self.plan_for(frame.dt_secs)?;
        FramePlan::check(steps, self.count)?;
        self.solver.check_step(&self.model, frame.dt_secs, self.options.beyond_float32)?;
        frame.acceleration.check(&self.model)?;
        frame.roots.check(&self.model)?;
        self.write_root_frames(frame)?;
        self.hold(frame.colliders)?;
        let whole = steps.len() == self.plan.steps().len();
        let bounds = [self.options.sleep_speed, self.rules.skin_thickness];
        let sleep = self.sleep.prepare(frame, &self.model, bounds, whole);
        match sleep {
            SleepStep::Asleep => return Ok(()),
            SleepStep::Measure | SleepStep::Wake => {
                let Self { gpu, model, shared, batches, sleep, .. } = &mut *self;
                if sleep.hold(gpu, DeviceStrands { model, shared, batches }) {
                    self.rebind()?;
                }
            }
            SleepStep::Awake => {}
        }
        let Air { velocity, field } = frame.air;
        let velocity = field.map_or(DVec3::ZERO, |wind| wind.mean) + velocity;
        let wind = field.map(|wind| WindField { mean: velocity, ..*wind }).filter(|wind| !wind.is_uniform());
        if wind.is_some() && self.air.is_none() {
            self.air = Some(DeviceAir::new(&self.gpu, self.strands()));
            self.rebind()?;
        }
        let accelerates = !matches!(frame.acceleration, Acceleration::None);
        if accelerates && self.acceleration.is_none() {
            self.acceleration = Some(DeviceAcceleration::new(&self.gpu, self.strands()));
            self.rebind()?;
        }
        let roots = match (&frame.roots, &mut self.roots) {
            (Roots::OnSkin { poses, .. }, Some(own)) => own.prepare(&self.gpu, *poses)?,
            _ => RootStep::None,
        };
        let kinds =
            self.write_frame(&FrameInput { air: Air { velocity, field: wind.as_ref() }, ..*frame }, steps);
        let kinds = FrameKinds { sleep, roots, ..kinds };
        self.positions.origin = self.origin;
        self.record_steps(encoder, steps, kinds);
        if let Some(network) = &mut self.network {
            network.recorded();
        }
        Ok(())
    }

    /// Makes room for the motions of strands relative to the head, if they have any in `frame`, and
    /// uploads those that are given.
    fn write_root_frames(&mut self, frame: &FrameInput<'_>) -> Result<(), GpuError> {
        if frame.roots.are_rigid() {
            return Ok(());
        }
        let mut rebinds = false;
        if let Roots::OnSkin { roots, .. } = &frame.roots
            && !self.roots.as_ref().is_some_and(|own| own.is_of(roots))
        {
            self.roots = Some(DeviceRoots::new(&self.gpu, roots, &self.model)?);
            rebinds = true;
        }
        for batch in &mut self.batches {
            rebinds |= batch.hold_root_frames(&self.gpu, &self.model);
        }
        if rebinds {
            self.rebind()?;
        }
        if let Some(frames) = frame.roots.frames() {
            pack_frames(&self.model, frames, &mut self.root_frames);
            let write = |batch: &Batch| batch.write_root_frames(&self.gpu, &self.model, &self.root_frames);
            self.batches.iter().for_each(write);
        }
        Ok(())
    }

    /// The positions where they are, on the device: no copy, no wait.
    pub fn positions(&self) -> &DevicePositions {
        &self.positions
    }

    /// Uploads the distance fields of `solids`, before a frame needs them.
    ///
    /// # Errors
    /// [`GpuError::Unsupported`] for solids that it does not support, [`GpuError::TooLarge`] if
    /// their fields exceed a binding.
    pub fn hold(&mut self, solids: &[ColliderFrame<'_>]) -> Result<(), GpuError> {
        if self.solids.hold(&self.gpu, solids)? {
            self.bind();
        }
        Ok(())
    }

    /// A copy of the state that resumes bit for bit. Waits for the device.
    ///
    /// # Errors
    /// [`GpuError::Failed`] if the device has failed.
    pub fn snapshot(&mut self) -> Result<Snapshot<f32>, GpuError> {
        self.read_state()?;
        Ok(self.read_back.as_ref().map(|state| state.snapshot(&self.model)).unwrap_or_default())
    }

    /// Restores a snapshot, of this or of a simulation of the same groom on a CPU.
    ///
    /// # Errors
    /// [`GpuError::Snapshot`] if it is of another groom, [`GpuError::Failed`] if the device has
    /// failed.
    pub fn restore(&mut self, snapshot: &Snapshot<f32>) -> Result<(), GpuError> {
        let mut state = self.take_memory();
        let restored = state.restore(&self.model, snapshot);
        if restored.is_ok() {
            self.write_state(&state);
        }
        self.read_back = Some(state);
        restored?;
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
