//! The simulator of a GPU: what changes a simulation as a whole.

use crate::collide::queries;
use crate::positions::DevicePositions;
use crate::report::{GpuReport, to_frame_report};
use crate::simulation::{Packed, USUAL_FRAME_SECS};
use crate::solver;
use crate::{GpuError, GpuSimulation};
use forelock_core::frame::{FrameInput, FramePlan, FrameReport, Roots, Solver};
use forelock_core::groom::edit::Source;
use forelock_core::groom::{Groom, RootFrames};
use forelock_core::interaction::Interactions;
use forelock_core::pose::Pose;
use forelock_core::simulation::{Regroomed, regroom};
use forelock_core::simulator::{Positions, Simulator, SimulatorError};
use forelock_core::strands::{Between, Model, Snapshot, State, Teleport};
use glam::Vec3;

impl GpuSimulation {
    /// The head jumps from pose `from` to pose `to` between frames. The state is read back, moved
    /// as on the CPU and uploaded.
    ///
    /// # Errors
    /// [`GpuError::Failed`] if the device has failed.
    pub fn teleport(&mut self, from: &Pose, to: &Pose, mode: Teleport) -> Result<(), GpuError> {
        if mode == Teleport::Reset {
            self.take_rest(State::at_rest(&self.model, to));
        } else {
            self.read_state()?;
            let mut state = self.take_memory();
            state.carry(&to.after(&from.inverse()), mode, self.solver.rate().usual_secs());
            self.write_state(&state);
            self.read_back = Some(state);
        }
        self.gpu.check()
    }

    /// Brings all strands to rest with the head at `head` and the strands at their own `frames`, in
    /// the groom's order.
    ///
    /// # Errors
    /// [`GpuError::Params`] if there is not one motion a strand, [`GpuError::Failed`] if the device
    /// has failed.
    pub fn rest_on(&mut self, head: &Pose, frames: &RootFrames) -> Result<(), GpuError> {
        Roots::PerStrand { head: [*head; 2], frames: [frames; 2] }.check(&self.model)?;
        self.take_rest(State::at_rest_on(&self.model, head, frames));
        self.gpu.check()
    }

    /// Takes `state`, in which strands are at rest.
    fn take_rest(&mut self, mut state: State<f32>) {
        self.solver.channels().prepare(&mut self.model, &mut state);
        self.write_state(&state);
        self.read_back = Some(state);
    }

    /// Invalidates cached distances to colliders, because their set has changed or they have
    /// jumped. The state is read back and uploaded.
    ///
    /// # Errors
    /// [`GpuError::Failed`] if the device has failed.
    pub fn forget_solids(&mut self) -> Result<(), GpuError> {
        self.read_state()?;
        let mut state = self.take_memory();
        state.forget_solids();
        self.write_state(&state);
        self.read_back = Some(state);
        self.gpu.check()
    }

    /// Changes the parameters, or the solver, from the next frame on. Buffers are made again only
    /// where the solver asks for others.
    ///
    /// # Errors
    /// [`GpuError::Params`] if a parameter is out of range, [`GpuError::Unsupported`] for a solver
    /// without kernels; nothing is changed then. [`GpuError::TooLarge`] or [`GpuError::Failed`] if
    /// there is no room.
    pub fn set_params(&mut self, solver: impl Into<Solver<f32>>) -> Result<(), GpuError> {
        let solver = solver.into();
        solver.validate()?;
        let (kernels, rules) = (solver::of(&solver)?, solver.rules());
        let longest = self.model.longest() as u32;
        let count = rules.substeps(USUAL_FRAME_SECS);
        if solver.channels() == self.solver.channels() {
            self.shared.hold(&self.gpu, kernels.substep_entries(count, longest));
            self.solids.hold_queries(&self.gpu, queries::of_frame(&rules, count));
            (self.solver, self.kernels, self.rules, self.count) = (solver, kernels, rules, count);
            self.sleep.wake();
            return self.rebind();
        }
        self.read_state()?;
        let (mut model, mut state) = (self.model.clone(), self.take_memory());
        solver.channels().prepare(&mut model, &mut state);
        state.sleep.set_all(0.0, None, 0.0);
        self.replace(Packed { model, state }, &solver)
    }

    /// Continues with the edited `groom`, whose strands come from those simulated so far as
    /// `sources` say, with the head at `head`.
    ///
    /// # Errors
    /// [`GpuError::Regroom`] if the groom cannot be simulated or the sources do not fit; nothing is
    /// changed then. [`GpuError::TooLarge`] or [`GpuError::Failed`] if there is no room.
    pub fn regroom(&mut self, groom: &Groom, sources: &[Source], head: &Pose) -> Result<(), GpuError> {
        self.read_state()?;
        let state = self.take_memory();
        let edited = regroom(&self.model, &state, groom, self.options.masses, sources, head);
        self.read_back = Some(state);
        let Regroomed { mut model, mut state } = edited?;
        let solver = self.solver.clone();
        solver.channels().prepare(&mut model, &mut state);
        self.replace(Packed { model, state }, &solver)
    }

    /// Continues with other strands or another solver, with the same interactions and settings.
    fn replace(&mut self, packed: Packed, solver: &Solver<f32>) -> Result<(), GpuError> {
        let mut made = Self::from_packed(&self.gpu, packed, solver, &self.options)?;
        made.set_half_factors(self.half_factors);
        made.rebuild_interactions(self)?;
        made.time_stages(self.clock.is_some());
        *self = made;
        Ok(())
    }
}

impl From<GpuError> for SimulatorError {
    fn from(error: GpuError) -> Self {
        match error {
            GpuError::Params(error) => error.into(),
            GpuError::Snapshot(error) => error.into(),
            GpuError::Regroom(error) => error.into(),
            other => Self::Device(Box::new(other)),
        }
    }
}

impl Simulator for GpuSimulation {
    fn step(&mut self, frame: &FrameInput<'_>) -> Result<FrameReport, SimulatorError> {
        self.step_frame(frame)?;
        if self.sleep.is_asleep() {
            let sleeping_strands = self.sleeping_strands() as u32;
            return Ok(FrameReport { sleeping_strands, ..FrameReport::default() });
        }
        let report = GpuReport { sleeping_strands: 0, ..self.report()? };
        Ok(to_frame_report(&report, self.rules.stage))
    }

    fn positions(&mut self) -> Result<Positions<'_>, SimulatorError> {
        let positions: &DevicePositions = Self::positions(self);
        Ok(Positions::Device(positions))
    }

    fn read_positions(&mut self, out: &mut Vec<Vec3>) -> Result<(), SimulatorError> {
        Ok(Self::read_positions(self, out)?)
    }

    fn read_positions_between(
        &mut self,
        moment: &Between,
        out: &mut Vec<Vec3>,
    ) -> Result<(), SimulatorError> {
        self.read_state()?;
        let state = self.take_memory();
        state.positions_between(&self.model, moment, out);
        self.read_back = Some(state);
        Ok(())
    }

    fn snapshot(&mut self) -> Result<Snapshot<f32>, SimulatorError> {
        Ok(Self::snapshot(self)?)
    }

    fn restore(&mut self, snapshot: &Snapshot<f32>) -> Result<(), SimulatorError> {
        Ok(Self::restore(self, snapshot)?)
    }

    fn teleport(&mut self, from: &Pose, to: &Pose, mode: Teleport) -> Result<(), SimulatorError> {
        Ok(Self::teleport(self, from, to, mode)?)
    }

    fn rest_on(&mut self, head: &Pose, frames: &RootFrames) -> Result<(), SimulatorError> {
        Ok(Self::rest_on(self, head, frames)?)
    }

    fn poses_roots(&self) -> bool {
        true
    }

    fn forget_solids(&mut self) -> Result<(), SimulatorError> {
        Ok(Self::forget_solids(self)?)
    }

    fn set_params(&mut self, solver: &Solver<f32>) -> Result<(), SimulatorError> {
        Ok(Self::set_params(self, solver)?)
    }

    fn set_sleep_speed(&mut self, speed: f64) {
        Self::set_sleep_speed(self, speed);
    }

    fn set_interactions(&mut self, interactions: &Interactions) -> Result<(), SimulatorError> {
        Ok(Self::set_interactions(self, interactions)?)
    }

    fn regroom(&mut self, groom: &Groom, sources: &[Source], head: &Pose) -> Result<(), SimulatorError> {
        Ok(Self::regroom(self, groom, sources, head)?)
    }

    fn device(&self) -> Option<&str> {
        Some(self.gpu.name())
    }

    fn plan(&self) -> &FramePlan {
        Self::plan(self)
    }

    fn model(&self) -> &Model<f32> {
        Self::model(self)
    }

    fn bytes(&self) -> u64 {
        Self::bytes(self)
    }
}
