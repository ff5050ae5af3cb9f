//! A simulation on the CPU: Model, State and Workspace, a frame at a time.

mod between;
mod regroom;
mod step;

pub use crate::strands::Teleport;
pub use regroom::{RegroomError, Regroomed, regroom};

use crate::air::WindField;
use crate::frame::{Exchange, Frame, FramePlan, FrameReport, Interaction, PlannedStep, Solver, SolverReal};
use crate::groom::Groom;
use crate::interaction::contact::{ContactInteraction, ContactParams};
use crate::interaction::grid::{GridInteraction, GridParams};
use crate::interaction::sph::find_neighbours::SearchReal;
use crate::interaction::sph::{Sph, SphParams};
use crate::interaction::{contact, grid, sph};
use crate::lane::{LANES, Row, Simd};
use crate::params::ParamsError;
use crate::pose::Pose;
use crate::strands::{Model, PackError, Snapshot, SnapshotError, State, Strands};
use glam::{DVec3, Vec3};
use step::Workspace;

/// How a simulation runs, beside its physics.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Options {
    /// Instruction set.
    pub simd: Simd,
    /// The head's pose at rest: where the groom is drawn, and against which gravity it was shaped.
    pub rest_pose: Pose,
    /// Gravity that the rest shape carries, m/s², world axes.
    pub rest_gravity: DVec3,
    /// Lets h²κ go beyond what float32 solves (for showing what happens then).
    pub beyond_float32: bool,
}

impl Options {
    /// The gravity that the rest shape carries, along the head's own axes, m/s².
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
    /// The instruction set asked for is not there.
    #[error("this processor cannot run simd = {0:?}: choose \"auto\"")]
    Simd(Simd),
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

/// Numbers that simulations run in. What it names is compiled once, in this crate.
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
        frame: &Frame<'_>,
        wind: Option<&WindField>,
        steps: &[PlannedStep],
    ) -> Result<FrameReport, ParamsError>;
}

macro_rules! simulation_real {
    ($real:ty) => {
        // Never inlined: a crate that inlines them would compile the interactions again.
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
                frame: &Frame<'_>,
                wind: Option<&WindField>,
                steps: &[PlannedStep],
            ) -> Result<FrameReport, ParamsError> {
                simulation.run(frame, wind, steps)
            }
        }
    };
}
simulation_real!(f32);
simulation_real!(f64);

/// Strands under a solver, on the CPU.
///
/// `T` is `f32` in use; `f64` runs the same text as specification.
#[derive(Debug)]
pub struct Simulation<T: SimulationReal = f32> {
    pub(super) model: Model<T>,
    pub(super) state: State<T>,
    workspace: Workspace<T>,
    solver: Solver<T>,
    options: Options,
    interactions: Vec<Box<dyn Interaction<T>>>,
    plan: FramePlan,
}

impl Simulation<f32> {
    /// A simulation of `groom`, at rest at `options.rest_pose`, under a solver: parameters of a built-in
    /// one by reference, or a [`Solver`]. Threads are those of the rayon pool it is called in.
    ///
    /// # Errors
    /// [`BuildError`] if the groom cannot be packed, a parameter is out of range, or the instruction set
    /// is not there.
    pub fn new(groom: &Groom, solver: impl Into<Solver<f32>>, options: &Options) -> Result<Self, BuildError> {
        Self::from_strands(&groom.into(), solver, options)
    }

    /// Positions in world space and the groom's order, `[P]`, metres. Virtual particles are left out.
    pub fn positions(&self, out: &mut Vec<Vec3>) {
        self.state.world_positions(&self.model, out);
    }
}

impl<T: SimulationReal> Simulation<T> {
    /// A simulation of plain arrays: see [`Simulation::new`].
    ///
    /// # Errors
    /// As [`Simulation::new`].
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
        let mut model = Model::for_solver(strands, |strands| solver.refine(strands))?;
        let mut state = State::at_rest(&model, &options.rest_pose);
        solver.channels().prepare(&mut model, &mut state);
        let workspace = Workspace::new(&model);
        let plan = FramePlan::new(&solver.rules(), &[]);
        Ok(Self { model, state, workspace, solver, options: *options, interactions: Vec::new(), plan })
    }

    fn replan(&mut self) {
        self.plan = FramePlan::new(&self.solver.rules(), &self.exchanges());
    }

    /// The interactions of the simulation.
    pub fn exchanges(&self) -> Vec<Exchange> {
        self.interactions.iter().map(|own| own.exchange_plan()).collect()
    }

    /// A frame as a list of steps.
    pub fn plan(&self) -> &FramePlan {
        &self.plan
    }

    /// Lets strands interact in one more way from the next frame on; an interaction of the same name is
    /// replaced.
    pub fn add_interaction(&mut self, interaction: Box<dyn Interaction<T>>) {
        let name = interaction.exchange_plan().name;
        self.interactions.retain(|own| own.exchange_plan().name != name);
        self.interactions.push(interaction);
        self.replan();
    }

    /// Removes the interaction `name`, if there is one.
    pub fn remove_interaction(&mut self, name: &str) {
        self.interactions.retain(|own| own.exchange_plan().name != name);
        self.replan();
    }

    /// Adds the interaction that `params` make, or with none removes `name`.
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

    /// Lets strands interact on a grid from the next frame on, or no more.
    ///
    /// # Errors
    /// [`ParamsError`] if a parameter is out of range; nothing is changed then.
    pub fn set_grid(&mut self, params: Option<&GridParams>) -> Result<(), ParamsError> {
        self.set_interaction(grid::EXCHANGE.name, params, |model, params, _| {
            params.validate()?;
            Ok(T::grid(model, params))
        })
    }

    /// Lets strands interact by SPH from the next frame on, or no more.
    ///
    /// # Errors
    /// [`ParamsError`] if a parameter is out of range; nothing is changed then.
    pub fn set_sph(&mut self, params: Option<&SphParams>) -> Result<(), ParamsError> {
        self.set_interaction(sph::EXCHANGE.name, params, |model, params, simd| {
            params.validate()?;
            Ok(T::sph(model, params, simd))
        })
    }

    /// Lets segments of strands collide from the next frame on, or no more.
    ///
    /// # Errors
    /// [`ParamsError`] if a parameter is out of range; nothing is changed then.
    pub fn set_contacts(&mut self, params: Option<&ContactParams>) -> Result<(), ParamsError> {
        self.set_interaction(contact::EXCHANGE.name, params, |model, params, simd| {
            params.validate()?;
            Ok(T::contacts(model, params, simd))
        })
    }

    /// Builds the workspace and the interactions again for a model that has changed.
    fn fit_workspace(&mut self) {
        let simd = self.options.simd.resolve();
        self.workspace.fit(&self.model);
        self.interactions.iter_mut().for_each(|own| own.rebuild(&self.model, simd));
    }

    /// Advances by a frame. Allocates nothing once it has seen a frame with as many colliders, as large a
    /// box of hair on the grid and as many contacts.
    ///
    /// # Errors
    /// [`ParamsError`] if the frame's time and stiffness are beyond float32, or the time is not positive.
    pub fn step_frame(&mut self, frame: &Frame<'_>) -> Result<FrameReport, ParamsError> {
        self.step_frame_in(frame, None)
    }

    /// The same in a `wind` that is not the same everywhere; the frame's own air velocity is added.
    ///
    /// # Errors
    /// As [`Simulation::step_frame`].
    pub fn step_frame_in(
        &mut self,
        frame: &Frame<'_>,
        wind: Option<&WindField>,
    ) -> Result<FrameReport, ParamsError> {
        // Taken out for the time of the frame: it allocates nothing.
        let plan = std::mem::take(&mut self.plan);
        let report = T::run_steps(self, frame, wind, plan.steps());
        self.plan = plan;
        report
    }

    /// Some consecutive steps of a frame ([`Simulation::plan`]), for an executor that runs the others
    /// elsewhere. All steps of a frame in their order, in however many calls, leave the state of a frame
    /// bit for bit, except that wind that is not the same everywhere is sampled anew by each call that
    /// solves strands. What the steps do not measure is zero in the report.
    ///
    /// # Errors
    /// As [`Simulation::step_frame`].
    pub fn step_part(
        &mut self,
        frame: &Frame<'_>,
        wind: Option<&WindField>,
        steps: &[PlannedStep],
    ) -> Result<FrameReport, ParamsError> {
        T::run_steps(self, frame, wind, steps)
    }

    /// The model.
    pub fn model(&self) -> &Model<T> {
        &self.model
    }

    /// The state.
    pub fn state(&self) -> &State<T> {
        &self.state
    }

    /// The state, to be changed from outside.
    pub fn state_mut(&mut self) -> &mut State<T> {
        &mut self.state
    }

    /// The solver.
    pub fn solver(&self) -> &Solver<T> {
        &self.solver
    }

    /// How it runs.
    pub fn options(&self) -> &Options {
        &self.options
    }

    /// Changes the parameters, or the solver, from the next frame on. The strands keep the particles that
    /// they have: a solver that refines strands is not refined again.
    ///
    /// # Errors
    /// [`ParamsError`] if one is out of range; nothing is changed then.
    pub fn set_params(&mut self, solver: impl Into<Solver<T>>) -> Result<(), ParamsError> {
        let solver = solver.into();
        solver.validate()?;
        self.solver = solver;
        self.solver.channels().prepare(&mut self.model, &mut self.state);
        self.replan();
        Ok(())
    }

    /// Share of the wind that reaches each particle, 0 to 1, a row a place of the model: all 1 until
    /// changed. For who knows how much hair stands in the wind's way; it counts in a wind field
    /// ([`Simulation::step_frame_in`]) only.
    pub fn air_exposure(&mut self) -> &mut [Row<T>] {
        let places = self.model.places();
        self.workspace.exposure.resize(places, Row([T::one(); LANES]));
        &mut self.workspace.exposure
    }

    /// A copy of the state that resumes bit for bit.
    pub fn snapshot(&self) -> Snapshot<T> {
        self.state.snapshot(&self.model)
    }

    /// Goes back to a snapshot.
    ///
    /// # Errors
    /// [`SnapshotError`] if it is of another groom.
    pub fn restore(&mut self, snapshot: &Snapshot<T>) -> Result<(), SnapshotError> {
        self.state.restore(&self.model, snapshot)
    }

    /// Forgets where colliders were: to be called when the set of colliders changes.
    pub fn forget_solids(&mut self) {
        self.state.forget_solids();
    }

    /// The head jumps from pose `from` to pose `to` between frames.
    pub fn teleport(&mut self, from: &Pose, to: &Pose, mode: Teleport) {
        if mode == Teleport::Reset {
            self.state = State::at_rest(&self.model, to);
            self.solver.channels().prepare(&mut self.model, &mut self.state);
        } else {
            let step_secs = self.solver.rate().usual_secs();
            self.state.carry(&to.after(&from.inverse()), mode, step_secs);
        }
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
