//! The simulation of a player: a [`Simulation`] on the CPU, and the [`Device`] that steps it if it
//! runs on a GPU. All of the facade's use of the solver's centre is here and in
//! [`backend`](crate::backend).

use std::collections::BTreeMap;
use std::fmt;
use std::sync::Arc;

use forelock_core::air::WindField;
use forelock_core::body::ColliderFrame;
use forelock_core::frame::{Air, FrameInput, FrameReport, Roots};
use forelock_core::groom::Groom;
use forelock_core::groom::edit::Source;
use forelock_core::lane::Simd;
use forelock_core::pose::Pose;
use forelock_core::simulation::{Options, Simulation, Teleport};
use forelock_core::solver::Solver;
use forelock_core::strands::Snapshot;
use glam::{DVec3, Vec3};

use super::PlayerError;
use crate::backend::{Backend, Device, DeviceNeeds};
use crate::scene::{InteractionKind, InteractionSection, Scene, SolverSection};

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

/// What a simulation is built from beside its groom.
#[derive(Clone, Copy)]
pub(super) struct Parts<'a> {
    /// The solver.
    pub params: &'a Solver<f32>,
    pub interaction: &'a InteractionSection,
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
    pub colliders: &'a [ColliderFrame<'a>],
    pub gravity: DVec3,
    pub air: &'a WindField,
    /// Whether the air moves alike everywhere, which is cheaper.
    pub uniform_air: bool,
    pub dt_secs: f64,
}

/// Two poses of the head in steps and the one between them that is shown.
pub(super) struct Between<'a> {
    /// Share of the step that has passed.
    pub share: f32,
    pub heads: &'a [Pose; 2],
    pub now: &'a Pose,
}

/// A simulation, wherever it runs.
#[derive(Debug)]
pub(super) struct Engine {
    simulation: Simulation,
    device: Option<Device>,
    options: Options,
    /// The state before the frame under way on a device, as soon as something has changed since: a
    /// run that fails there resumes from it.
    before_frame: Option<Snapshot<f32>>,
}

impl Engine {
    /// The simulation of `groom` at rest on `backend`, and what the user should know of that
    /// choice.
    pub fn new(
        scene: &Scene,
        groom: &Groom,
        parts: Parts<'_>,
        backend: Backend,
        start: Start<'_>,
    ) -> Result<(Self, Option<String>), PlayerError> {
        let options = Options {
            simd: scene.solver.simd.into(),
            rest_pose: start.head,
            masses: scene.solver.masses,
            rest_gravity: DVec3::from_array(scene.gravity),
            beyond_float32: scene.solver.beyond_float32,
        };
        let simulation = build(groom, parts, &options)?;
        simulation.solver().check_step(
            simulation.model(),
            1.0 / scene.time.fps,
            scene.solver.beyond_float32,
        )?;
        // Masses keep the unit of this groom when it is edited.
        let options = Options { masses: simulation.options().masses, ..options };
        let needs = DeviceNeeds { interaction: parts.interaction, solids: start.solids };
        let placed = backend.place(needs, &simulation)?;
        let mut engine = Self { simulation, device: placed.device, options, before_frame: None };
        engine.set_cpu_interaction(parts.interaction)?;
        Ok((engine, placed.note))
    }

    fn set_cpu_interaction(&mut self, section: &InteractionSection) -> Result<(), PlayerError> {
        if self.device.as_ref().is_some_and(|device| !device.is_mixed()) {
            return Ok(());
        }
        let InteractionSection { kind, grid, sph, contacts, contact } = section;
        self.simulation.set_grid((*kind == InteractionKind::Grid).then_some(grid))?;
        self.simulation.set_sph((*kind == InteractionKind::Sph).then_some(sph))?;
        self.simulation.set_contacts(contacts.then_some(contact))?;
        Ok(())
    }

    /// Replaces the simulation by one of `groom` at rest.
    pub fn rebuild(&mut self, groom: &Groom, parts: Parts<'_>) -> Result<(), PlayerError> {
        self.simulation = build(groom, parts, &self.options)?;
        self.set_interaction(parts.interaction)
    }

    /// Checks that frames of `dt_secs` can be stepped with `params`.
    pub fn check_step(
        &self,
        params: &Solver<f32>,
        dt_secs: f64,
        beyond_float32: bool,
    ) -> Result<(), PlayerError> {
        Ok(params.check_step(self.simulation.model(), dt_secs, beyond_float32)?)
    }

    /// Changes the solver's parameters.
    pub fn set_params(&mut self, params: &Solver<f32>) -> Result<(), PlayerError> {
        self.simulation.set_params(params)?;
        self.rebuild_device()
    }

    /// Changes the interaction of strands.
    pub fn set_interaction(&mut self, section: &InteractionSection) -> Result<(), PlayerError> {
        self.set_cpu_interaction(section)?;
        if let Some(device) = &mut self.device {
            device.set_interaction(section);
        }
        self.rebuild_device()
    }

    fn rebuild_device(&mut self) -> Result<(), PlayerError> {
        if let Some(device) = &mut self.device {
            device.rebuild(&self.simulation)?;
        }
        Ok(())
    }

    fn upload(&mut self) -> Result<(), PlayerError> {
        if let Some(device) = &mut self.device {
            device.take(&self.simulation)?;
        }
        Ok(())
    }

    /// Continues with the edited `groom`.
    pub fn regroom(&mut self, groom: &Groom, sources: &[Source], head: &Pose) -> Result<(), PlayerError> {
        self.simulation.regroom(groom, sources, head)?;
        self.rebuild_device()
    }

    /// Moves the hair from the head at `from` to the head at `to`.
    pub fn teleport(&mut self, from: &Pose, to: &Pose, mode: Teleport) -> Result<(), PlayerError> {
        self.simulation.teleport(from, to, mode);
        self.upload()
    }

    /// Drops cached distances to solids, whose set or place has changed.
    pub fn forget_solids(&mut self) -> Result<(), PlayerError> {
        self.simulation.forget_solids();
        self.upload()
    }

    /// Keeps the state to resume from, should the frame under way fail on a device.
    pub fn guard(&mut self) {
        if self.device.is_some() && self.before_frame.is_none() {
            self.before_frame = Some(self.simulation.snapshot());
        }
    }

    /// The frame under way is done.
    pub fn end_frame(&mut self) {
        self.before_frame = None;
    }

    pub fn step(&mut self, step: &Step<'_>) -> Result<FrameReport, PlayerError> {
        let air = if step.uniform_air {
            Air::uniform(step.air.mean)
        } else {
            Air { velocity: DVec3::ZERO, field: Some(step.air) }
        };
        let frame = FrameInput {
            roots: Roots::Rigid(step.head),
            colliders: step.colliders,
            gravity: step.gravity,
            air,
            dt_secs: step.dt_secs,
            ..FrameInput::default()
        };
        match &mut self.device {
            Some(device) => device.step(&frame, &mut self.simulation),
            None => Ok(self.simulation.step_frame(&frame)?),
        }
    }

    /// Positions of the simulated strands in world space, metres.
    pub fn positions(&self, out: &mut Vec<Vec3>) {
        self.simulation.positions(out);
    }

    /// The same between the last two steps.
    pub fn positions_between(&self, between: &Between<'_>, out: &mut Vec<Vec3>) {
        let [from, to] = between.heads;
        self.simulation.positions_between(between.share, [from, to], between.now, out);
    }

    /// The state.
    pub fn snapshot(&self) -> Snapshot<f32> {
        self.simulation.snapshot()
    }

    /// The state that a later run resumes from: that after the last whole frame.
    pub fn resumable(&mut self) -> Snapshot<f32> {
        self.before_frame.take().unwrap_or_else(|| self.simulation.snapshot())
    }

    pub fn restore(&mut self, state: &Snapshot<f32>) -> Result<(), PlayerError> {
        self.simulation.restore(state)?;
        self.before_frame = None;
        self.upload()
    }

    pub fn state_hash(&self) -> u64 {
        self.simulation.state_hash()
    }

    /// Bytes held by the simulation, wherever it runs.
    pub fn bytes(&self) -> u64 {
        self.device.as_ref().map_or_else(|| self.simulation.memory().total() as u64, Device::bytes)
    }

    /// Strands that are simulated.
    pub fn strand_count(&self) -> usize {
        self.simulation.model().strand_count
    }

    /// Name of the GPU, if it runs on one.
    pub fn gpu_name(&self) -> Option<&str> {
        self.device.as_ref().map(Device::name)
    }

    /// Name of the instruction set.
    pub fn simd_name(&self) -> String {
        if self.device.is_some() {
            return "wgsl".to_owned();
        }
        let simd: Simd = self.options.simd;
        format!("{:?}", simd.resolve()).to_lowercase()
    }

    /// Seconds of the last step on the clock of a GPU.
    pub fn device_secs(&self) -> Option<f64> {
        self.device.as_ref().and_then(|device| device.frame_secs)
    }
}

fn build(groom: &Groom, parts: Parts<'_>, options: &Options) -> Result<Simulation, PlayerError> {
    Ok(Simulation::new(groom, parts.params, options)?)
}
