//! A simulation on the CPU: Model, State and Workspace, a frame at a time.

mod regroom;
mod sleep;
mod step;
mod touches;

pub use crate::strands::Teleport;
pub use regroom::{RegroomError, Regroomed, regroom};
pub use touches::Touch;

use crate::frame::{
    Exchange, FrameInput, FramePlan, FrameReport, Interaction, PlannedStep, Solver, SolverReal,
};
use crate::groom::{Groom, RootFrames};
use crate::interaction::contact::{ContactInteraction, ContactParams};
use crate::interaction::grid::{GridInteraction, GridParams};
use crate::interaction::sph::find_neighbours::SearchReal;
use crate::interaction::sph::{Sph, SphParams};
use crate::interaction::{Interactions, contact, grid, sph};
use crate::lane::{LANES, Row, Simd};
use crate::memory::{self, MemoryError};
use crate::params::ParamsError;
use crate::pose::Pose;
use crate::strands::{Masses, Model, PackError, Snapshot, SnapshotError, State, Strands};
use glam::{DVec3, Vec3};
use step::Workspace;
use touches::LastFrame;

/// The frame that is planned before the length of one is known, seconds.
const USUAL_FRAME_SECS: f64 = 1.0 / 60.0;

/// Options of a simulation besides its parameters.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Options {
    /// Instruction set.
    pub simd: Simd,
    /// The head's pose at rest: the pose in which the groom was modelled.
    pub rest_pose: Pose,
    /// Masses of particles, for simulations that are built from a [`Groom`].
    pub masses: Masses,
    /// Gravity that the rest shape compensates, m/s², world axes.
    pub rest_gravity: DVec3,
    /// Accepts h²κ beyond the float32 limit (to demonstrate the failure).
    pub beyond_float32: bool,
    /// Speed below which strands are still, m/s: those that are still for a second sleep until
    /// something wakes them. 0, the default: no strand sleeps, and friction between neighbours
    /// ([`ContactParams::hold`]) does not fade.
    pub sleep_speed: f64,
}

impl Options {
    /// The gravity that the rest shape compensates, in the head's axes, m/s².
    pub fn carried_gravity(&self) -> DVec3 {
        self.rest_pose.inverse().transform_vector(self.rest_gravity)
    }
}

/// Why a simulation cannot be built.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BuildError {
    /// The groom cannot be packed.
    #[error(transparent)]
    Pack(#[from] PackError),
    /// A parameter is out of its range.
    #[error(transparent)]
    Params(#[from] ParamsError),
    /// The simulation does not fit into the memory.
    #[error(transparent)]
    Memory(#[from] MemoryError),
    /// The processor does not have the requested instruction set.
    #[error("this processor cannot run simd = {0:?}: choose \"auto\"")]
    Simd(Simd),
}

/// Checks that the simulation of `particles` with `interactions` fits into the memory, as far as
/// can be foreseen.
///
/// # Errors
/// [`MemoryError`] if it does not.
pub fn check_memory(particles: u64, interactions: &Interactions) -> Result<(), MemoryError> {
    // The least of the solvers, with the groom; its neighbour lists for SPH; a cell's node, masses,
    // pressures and equations.
    let [particle, listed, cell] = [150, 100, 60];
    let lists = interactions.sph.as_ref().map_or(0, |sph| listed + 4 * u64::from(sph.neighbours));
    let remedy = "lower the number of strands or of their particles, or simulate guides";
    memory::check("the simulation", particles, particle + lists, remedy)?;
    let cells = interactions.grid.as_ref().map_or(0, |grid| u64::from(grid.max_cells));
    memory::check("the grid of hair–hair interaction", cells, cell, "lower `interaction.grid.max_cells`")
}

/// Bytes held.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Memory {
    /// By the model.
    pub model: usize,
    /// By the state.
    pub state: usize,
    /// By the workspace.
    pub workspace: usize,
}

impl Memory {
    /// All together.
    pub fn total(&self) -> usize {
        self.model + self.state + self.workspace
    }
}

/// Number types of simulations. The methods of this trait are compiled once, in this crate.
pub trait SimulationReal: SolverReal + SearchReal {
    #[doc(hidden)]
    fn grid(model: &Model<Self>, params: &GridParams) -> Box<dyn Interaction<Self>>;
    #[doc(hidden)]
    fn sph(model: &Model<Self>, params: &SphParams, simd: Simd) -> Box<dyn Interaction<Self>>;
    #[doc(hidden)]
    fn contacts(model: &Model<Self>, params: &ContactParams, simd: Simd) -> Box<dyn Interaction<Self>>;
    #[doc(hidden)]
    fn run_steps(
        simulation: &mut Simulation<Self>,
        frame: &FrameInput<'_>,
        steps: &[PlannedStep],
    ) -> Result<FrameReport, ParamsError>;
}

macro_rules! simulation_real {
    ($real:ty) => {
        // Never inlined: a crate that inlined them would compile the interactions again.
        impl SimulationReal for $real {
            #[inline(never)]
            fn grid(model: &Model<Self>, params: &GridParams) -> Box<dyn Interaction<Self>> {
                Box::new(GridInteraction::new(model, params))
            }

            #[inline(never)]
            fn sph(model: &Model<Self>, params: &SphParams, simd: Simd) -> Box<dyn Interaction<Self>> {
                Box::new(Sph::new(model, params, simd))
            }

            #[inline(never)]
            fn contacts(
                model: &Model<Self>,
                params: &ContactParams,
                simd: Simd,
            ) -> Box<dyn Interaction<Self>> {
                Box::new(ContactInteraction::new(model, params, simd))
            }

            #[inline(never)]
            fn run_steps(
                simulation: &mut Simulation<Self>,
                frame: &FrameInput<'_>,
                steps: &[PlannedStep],
            ) -> Result<FrameReport, ParamsError> {
                simulation.run(frame, steps)
            }
        }
    };
}
simulation_real!(f32);
simulation_real!(f64);

/// Strands under a solver, on the CPU.
///
/// `T` is `f32` in production; `f64` runs the same code as a reference.
#[derive(Debug)]
pub struct Simulation<T: SimulationReal = f32> {
    pub(super) model: Model<T>,
    pub(super) state: State<T>,
    workspace: Workspace<T>,
    solver: Solver<T>,
    options: Options,
    interactions: Vec<Box<dyn Interaction<T>>>,
    /// Substeps of `plan`.
    substeps: u32,
    plan: FramePlan,
    /// What is known of contacts.
    last_frame: LastFrame,
}

impl Simulation<f32> {
    /// A simulation of `groom`, at rest at `options.rest_pose`, under a solver: parameters of a
    /// built-in one by reference, or a [`Solver`]. It uses the threads of the current rayon pool.
    ///
    /// # Errors
    /// [`BuildError`] if the groom cannot be packed, a parameter is out of range, or the processor
    /// does not have the instruction set.
    pub fn new(groom: &Groom, solver: impl Into<Solver<f32>>, options: &Options) -> Result<Self, BuildError> {
        let options = Options { masses: options.masses.fixed(groom)?, ..*options };
        let masses = options.masses.of(groom)?;
        Self::from_strands(&Strands { masses: masses.as_deref(), ..groom.into() }, solver, &options)
    }

    /// Positions in world space and the groom's order, `[P]`, metres. Virtual particles are left
    /// out.
    pub fn positions(&self, out: &mut Vec<Vec3>) {
        self.state.world_positions(&self.model, out);
    }
}

impl<T: SimulationReal> Simulation<T> {
    /// A simulation of plain arrays: see [`Simulation::new`].
    ///
    /// # Errors
    /// The same errors as [`Simulation::new`].
    pub fn from_strands(
        strands: &Strands<'_, T>,
        solver: impl Into<Solver<T>>,
        options: &Options,
    ) -> Result<Self, BuildError> {
        let solver = solver.into();
        solver.validate()?;
        let simd = options.simd.resolve();
        if !simd.is_supported() {
            return Err(BuildError::Simd(simd));
        }
        check_memory(strands.positions.len() as u64, &Interactions::default())?;
        let mut model = solver.pack(strands)?;
        let mut state = State::at_rest(&model, &options.rest_pose);
        solver.channels().prepare(&mut model, &mut state);
        let workspace = Workspace::new(&model);
        let (rules, interactions) = (solver.rules(), Vec::new());
        let substeps = rules.substeps(USUAL_FRAME_SECS);
        let plan = FramePlan::new(&rules, substeps, &[]);
        let (options, last_frame) = (*options, LastFrame::Unknown);
        Ok(Self { model, state, workspace, solver, options, interactions, substeps, plan, last_frame })
    }

    fn replan(&mut self) {
        self.plan = FramePlan::new(&self.solver.rules(), self.substeps, &self.exchanges());
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

    /// A frame of `dt_secs` as a list of steps.
    pub fn plan_for(&mut self, dt_secs: f64) -> FramePlan {
        let substeps = self.solver.rules().substeps(dt_secs);
        if substeps != self.substeps {
            self.substeps = substeps;
            self.replan();
        }
        self.plan.clone()
    }

    /// Adds an interaction from the next frame on. It replaces an interaction of the same name.
    pub fn add_interaction(&mut self, interaction: Box<dyn Interaction<T>>) {
        let name = interaction.exchange_plan().name;
        self.interactions.retain(|own| own.exchange_plan().name != name);
        self.interactions.push(interaction);
        self.last_frame = LastFrame::Unknown;
        self.wake();
        self.replan();
    }

    /// Removes the interaction `name`, if there is one.
    pub fn remove_interaction(&mut self, name: &str) {
        self.interactions.retain(|own| own.exchange_plan().name != name);
        self.last_frame = LastFrame::Unknown;
        self.wake();
        self.replan();
    }

    /// Adds the interaction that `make` returns for `params`, or removes `name` if there are none.
    fn set_interaction<P>(
        &mut self,
        name: &str,
        params: Option<&P>,
        make: impl FnOnce(&Model<T>, &P, Simd) -> Result<Box<dyn Interaction<T>>, ParamsError>,
    ) -> Result<(), ParamsError> {
        match params {
            None => self.remove_interaction(name),
            Some(params) => {
                let made = make(&self.model, params, self.options.simd.resolve())?;
                self.add_interaction(made);
            }
        }
        Ok(())
    }

    /// Sets or removes the interaction of strands on a grid, from the next frame on.
    ///
    /// # Errors
    /// [`ParamsError`] if a parameter is out of range; nothing is changed then.
    pub fn set_grid(&mut self, params: Option<&GridParams>) -> Result<(), ParamsError> {
        self.set_interaction(grid::EXCHANGE.name, params, |model, params, _| {
            params.validate()?;
            Ok(T::grid(model, params))
        })
    }

    /// Sets or removes the interaction of strands by SPH, from the next frame on.
    ///
    /// # Errors
    /// [`ParamsError`] if a parameter is out of range; nothing is changed then.
    pub fn set_sph(&mut self, params: Option<&SphParams>) -> Result<(), ParamsError> {
        self.set_interaction(sph::EXCHANGE.name, params, |model, params, simd| {
            params.validate()?;
            Ok(T::sph(model, params, simd))
        })
    }

    /// Sets or removes the contacts between segments of strands, and with them the friction between
    /// neighbouring hair, from the next frame on.
    ///
    /// # Errors
    /// [`ParamsError`] if a parameter is out of range; nothing is changed then.
    pub fn set_contacts(&mut self, params: Option<&ContactParams>) -> Result<(), ParamsError> {
        self.set_interaction(contact::EXCHANGE.name, params, |model, params, simd| {
            params.validate()?;
            Ok(T::contacts(model, params, simd))
        })
    }

    /// Sets or removes all built-in interactions, from the next frame on.
    ///
    /// # Errors
    /// [`ParamsError`] if a parameter is out of range; nothing is changed then.
    pub fn set_interactions(&mut self, interactions: &Interactions) -> Result<(), ParamsError> {
        interactions.validate()?;
        self.set_grid(interactions.grid.as_ref())?;
        self.set_sph(interactions.sph.as_ref())?;
        self.set_contacts(interactions.contacts.as_ref())
    }

    /// Builds the workspace and the interactions again for a model that has changed.
    fn fit_workspace(&mut self) {
        let simd = self.options.simd.resolve();
        self.last_frame = LastFrame::Unknown;
        self.workspace.fit(&self.model);
        self.interactions.iter_mut().for_each(|own| own.rebuild(&self.model, simd));
    }

    /// Advances by a frame. It allocates only when a frame has other substeps than the one before,
    /// or more colliders, a larger box of hair on the grid or more contacts than all before.
    ///
    /// # Errors
    /// [`ParamsError`] if the frame's time and stiffness are beyond float32, or the time is not
    /// positive.
    pub fn step_frame(&mut self, frame: &FrameInput<'_>) -> Result<FrameReport, ParamsError> {
        let plan = self.plan_for(frame.dt_secs);
        self.last_frame = LastFrame::Unknown;
        let report = T::run_steps(self, frame, plan.steps())?;
        let is_asleep = report.sleeping_strands as usize == self.model.strand_count;
        self.last_frame = if is_asleep { LastFrame::Asleep } else { LastFrame::Awake };
        Ok(report)
    }

    /// Runs some consecutive steps of a frame ([`Simulation::plan_for`]), for an executor that runs
    /// the other steps elsewhere. All steps of a frame in order, in any number of calls, give the
    /// state of [`Simulation::step_frame`] bit for bit, except that each call that solves strands
    /// samples a wind field again. Quantities that the steps do not measure are zero in the report.
    ///
    /// # Errors
    /// The same errors as [`Simulation::step_frame`].
    pub fn step_part(
        &mut self,
        frame: &FrameInput<'_>,
        steps: &[PlannedStep],
    ) -> Result<FrameReport, ParamsError> {
        self.last_frame = LastFrame::Unknown;
        T::run_steps(self, frame, steps)
    }

    /// The model.
    pub fn model(&self) -> &Model<T> {
        &self.model
    }

    /// The state.
    pub fn state(&self) -> &State<T> {
        &self.state
    }

    /// The state, mutable; all strands wake.
    pub fn state_mut(&mut self) -> &mut State<T> {
        self.last_frame = LastFrame::Unknown;
        self.wake();
        &mut self.state
    }

    /// The model, and the state to be changed; all strands wake.
    pub fn parts_mut(&mut self) -> (&Model<T>, &mut State<T>) {
        self.last_frame = LastFrame::Unknown;
        self.wake();
        (&self.model, &mut self.state)
    }

    /// The solver.
    pub fn solver(&self) -> &Solver<T> {
        &self.solver
    }

    /// The options.
    pub fn options(&self) -> &Options {
        &self.options
    }

    /// Changes the parameters, or the solver, from the next frame on. The particles stay the same:
    /// strands are not refined again.
    ///
    /// # Errors
    /// [`ParamsError`] if one is out of range; nothing is changed then.
    pub fn set_params(&mut self, solver: impl Into<Solver<T>>) -> Result<(), ParamsError> {
        let solver = solver.into();
        solver.validate()?;
        self.solver = solver;
        self.solver.channels().prepare(&mut self.model, &mut self.state);
        self.wake();
        self.substeps = self.solver.rules().substeps(USUAL_FRAME_SECS);
        self.replan();
        Ok(())
    }

    /// Share of the wind that reaches each particle, 0 to 1, a row a place of the model; 1 by
    /// default. For callers that compute the shelter of hair themselves. It affects wind fields
    /// only ([`Air::field`](crate::frame::Air::field)).
    pub fn air_exposure(&mut self) -> &mut [Row<T>] {
        let places = self.model.places();
        self.workspace.exposure.resize(places, Row([T::one(); LANES]));
        &mut self.workspace.exposure
    }

    /// A copy of the state that resumes bit for bit.
    pub fn snapshot(&self) -> Snapshot<T> {
        self.state.snapshot(&self.model)
    }

    /// Restores a snapshot.
    ///
    /// # Errors
    /// [`SnapshotError`] if it is of another groom, or lacks a channel of the solver.
    pub fn restore(&mut self, snapshot: &Snapshot<T>) -> Result<(), SnapshotError> {
        self.workspace.sleeper.forget();
        self.last_frame = LastFrame::Unknown;
        self.state.restore(&self.model, snapshot)
    }

    /// Invalidates the clearances. Call it when the set of colliders changes.
    pub fn forget_solids(&mut self) {
        self.last_frame = LastFrame::Unknown;
        self.state.forget_solids();
    }

    /// Moves the hair for a jump of the head from pose `from` to pose `to` between frames.
    pub fn teleport(&mut self, from: &Pose, to: &Pose, mode: Teleport) {
        self.last_frame = LastFrame::Unknown;
        if mode == Teleport::Reset {
            self.state = State::at_rest(&self.model, to);
            self.solver.channels().prepare(&mut self.model, &mut self.state);
        } else {
            let step_secs = self.solver.rate().usual_secs();
            self.state.carry(&to.after(&from.inverse()), mode, step_secs);
        }
    }

    /// Puts all strands to rest, with the head at `head` and each strand at its own motion of
    /// `frames`, in the groom's order.
    ///
    /// # Panics
    /// If `frames` are not one a strand.
    pub fn rest_on(&mut self, head: &Pose, frames: &RootFrames) {
        self.last_frame = LastFrame::Unknown;
        self.state = State::at_rest_on(&self.model, head, frames);
        self.solver.channels().prepare(&mut self.model, &mut self.state);
    }

    /// A 64-bit hash of the state: see [`Snapshot::hash`].
    pub fn state_hash(&self) -> u64 {
        self.snapshot().hash()
    }

    /// Bytes held.
    pub fn memory(&self) -> Memory {
        let interactions = self.interactions.iter().map(|own| own.bytes()).sum::<usize>();
        Memory {
            model: self.model.bytes(),
            state: self.state.bytes(),
            workspace: self.workspace.bytes() + interactions,
        }
    }
}
