//! The simulator of a player. All of the facade's use of the solver's centre is here and in
//! [`backend`](crate::backend).

use std::collections::BTreeMap;
use std::fmt;
use std::sync::Arc;

use forelock_core::air::WindField;
use forelock_core::body::ColliderFrame;
use forelock_core::frame::{Air, FrameInput, FrameReport, Roots};
use forelock_core::groom::Groom;
use forelock_core::lane::Simd;
use forelock_core::pose::Pose;
use forelock_core::simulation::{BuildError, Options};
use forelock_core::simulator::Simulator;
use forelock_core::solver::Solver;
use forelock_gpu::Gpu;
use glam::DVec3;

use super::PlayerError;
use super::bending::BentRoots;
use crate::backend::{Backend, Parts, Place, Placed};
use crate::scene::{Scene, SolverSection};

/// Makes the solver of a scene from its table of parameters, `[solver.NAME]`.
pub type SolverFactory = dyn Fn(&toml::Table) -> Result<Solver<f32>, String> + Send + Sync;

/// The solvers that are registered with a player, by name.
#[derive(Clone, Default)]
pub(super) struct Solvers(BTreeMap<String, Arc<SolverFactory>>);

impl fmt::Debug for Solvers {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_set().entries(self.0.keys()).finish()
    }
}

impl Solvers {
    pub fn register(&mut self, name: String, factory: Arc<SolverFactory>) {
        self.0.insert(name, factory);
    }

    /// The solver that `section` chooses: a built-in or a registered one.
    pub fn solver(&self, section: &SolverSection) -> Result<Solver<f32>, PlayerError> {
        if let Some(own) = section.chosen() {
            return Ok(own.solver);
        }
        let name = section.kind.name();
        let factory = self.0.get(name).ok_or_else(|| PlayerError::UnknownSolver(name.to_owned()))?;
        factory(&section.custom)
            .map_err(|message| PlayerError::SolverTable { name: name.to_owned(), message })
    }
}

/// The surroundings at the start.
#[derive(Clone, Copy)]
pub(super) struct Start<'a> {
    pub head: Pose,
    pub solids: &'a [ColliderFrame<'a>],
}

/// What the solver needs to know of a step.
pub(super) struct Step<'a> {
    pub head: [Pose; 2],
    /// The roots on a body that bends.
    pub roots: Option<BentRoots<'a>>,
    pub colliders: &'a [ColliderFrame<'a>],
    pub gravity: DVec3,
    pub air: &'a WindField,
    /// Whether the air moves alike everywhere, which is cheaper.
    pub uniform_air: bool,
    pub dt_secs: f64,
}

/// The simulator of a player, wherever it runs.
#[derive(Debug)]
pub(super) struct Engine {
    simulator: Box<dyn Simulator>,
    place: Place,
    options: Options,
}

impl Engine {
    /// The simulator of `groom` at rest on `backend` (its GPU is `gpu`, or the fastest), with the
    /// head at `head` and `solids` as the colliders of the first frame, and what the user should
    /// know of the choice of the backend.
    pub fn new(
        scene: &Scene,
        groom: &Groom,
        parts: &Parts<'_>,
        backend: Backend,
        gpu: Option<Gpu>,
        start: Start<'_>,
    ) -> Result<(Self, Option<String>), PlayerError> {
        let options = Options {
            simd: scene.solver.simd.into(),
            rest_pose: start.head,
            // Masses keep the unit of this groom when it is edited.
            masses: scene.solver.masses.fixed(groom).map_err(BuildError::from)?,
            rest_gravity: DVec3::from_array(scene.gravity),
            beyond_float32: scene.solver.beyond_float32,
            sleep_speed: scene.solver.sleep_speed,
        };
        let Placed { simulator, place, note } = backend.place(gpu, groom, parts, &options, start.solids)?;
        let engine = Self { simulator, place, options };
        engine.check_step(parts.solver, 1.0 / scene.time.fps, scene.solver.beyond_float32)?;
        Ok((engine, note))
    }

    /// Replaces the simulator by one of `groom` at rest.
    pub fn rebuild(&mut self, groom: &Groom, parts: &Parts<'_>) -> Result<(), PlayerError> {
        self.simulator = self.place.simulator(groom, parts, &self.options, &[])?;
        Ok(())
    }

    /// Sets the speed below which strands are still, m/s; all strands wake if it is another one.
    pub fn set_sleep_speed(&mut self, speed: f64) {
        if self.options.sleep_speed != speed {
            self.options.sleep_speed = speed;
            self.simulator.set_sleep_speed(speed);
        }
    }

    /// Checks that frames of `dt_secs` can be stepped with `params`.
    pub fn check_step(
        &self,
        params: &Solver<f32>,
        dt_secs: f64,
        beyond_float32: bool,
    ) -> Result<(), PlayerError> {
        let step_secs = params.rate().secs(dt_secs);
        Ok(params.check_step(self.simulator.model(), step_secs, beyond_float32)?)
    }

    pub fn step(&mut self, step: &Step<'_>) -> Result<FrameReport, PlayerError> {
        let air = if step.uniform_air {
            Air::uniform(step.air.mean)
        } else {
            Air { velocity: DVec3::ZERO, field: Some(step.air) }
        };
        let frame = FrameInput {
            roots: step.roots.map_or(Roots::Rigid(step.head), |own| own.on(step.head)),
            colliders: step.colliders,
            gravity: step.gravity,
            air,
            dt_secs: step.dt_secs,
            ..FrameInput::default()
        };
        Ok(self.simulator.step(&frame)?)
    }

    /// The simulator.
    pub fn simulator(&mut self) -> &mut dyn Simulator {
        &mut *self.simulator
    }

    /// Whether contacts are told.
    pub fn tells_interactions(&self) -> bool {
        self.simulator.tells_interactions()
    }

    /// A 64-bit hash of the state.
    pub fn state_hash(&mut self) -> Result<u64, PlayerError> {
        Ok(self.simulator.snapshot()?.hash())
    }

    /// Bytes held by the simulation, wherever it runs.
    pub fn bytes(&self) -> u64 {
        self.simulator.bytes()
    }

    /// Strands that are simulated.
    pub fn strand_count(&self) -> usize {
        self.simulator.model().strand_count
    }

    /// Name of the GPU, if it runs on one.
    pub fn gpu_name(&self) -> Option<&str> {
        self.simulator.device()
    }

    /// Name of the instruction set.
    pub fn simd_name(&self) -> String {
        if !self.place.is_cpu() {
            return "wgsl".to_owned();
        }
        let simd: Simd = self.options.simd;
        format!("{:?}", simd.resolve()).to_lowercase()
    }
}
