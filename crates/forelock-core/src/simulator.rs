//! The seam of simulators: the CPU's [`Simulation`], a GPU's, a learned one, a cache's playback.
//!
//! Players, windows and engines hold a `Box<dyn Simulator>` and need not know where it computes.
//!
//! ```
//! use forelock_core::frame::FrameInput;
//! use forelock_core::groom::Groom;
//! use forelock_core::pose::Pose;
//! use forelock_core::simulation::{Options, Simulation, Teleport};
//! use forelock_core::simulator::{HostPositions, Simulator};
//! use forelock_core::solver::AmsParams;
//! use glam::{DVec3, Vec3};
//!
//! let strand = (0..10).map(|i| Vec3::new(0.0, -0.01 * i as f32, 0.0)).collect::<Vec<_>>();
//! let groom = Groom::from_strands([strand])?;
//! let simulation = Simulation::new(&groom, &AmsParams::default(), &Options::default())?;
//! let mut simulator: Box<dyn Simulator> = Box::new(HostPositions::new(simulation));
//! let head = [Pose::IDENTITY; 2];
//! let gravity = DVec3::new(0.0, -9.81, 0.0);
//! let still =
//!     FrameInput { roots: head.into(), gravity, dt_secs: 1.0 / 60.0, ..FrameInput::default() };
//! simulator.step(&still)?;
//! let there = Pose { translation: DVec3::X, ..Pose::IDENTITY };
//! simulator.teleport(&Pose::IDENTITY, &there, Teleport::CarryShape)?;
//! assert!((simulator.positions()?.host().unwrap()[0].x - 1.0).abs() < 1e-6);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use crate::frame::{FrameInput, FramePlan, FrameReport, GridCells, Solver};
use crate::groom::edit::Source;
use crate::groom::{Groom, RootFrames};
use crate::interaction::Interactions;
use crate::params::ParamsError;
use crate::pose::Pose;
use crate::simulation::{RegroomError, Simulation, Touch};
use crate::strands::{Between, Model, Snapshot, SnapshotError, Teleport};
use glam::Vec3;
use std::any::Any;
use std::fmt::Debug;

/// Why a simulator cannot do what it is asked for.
#[derive(Debug, thiserror::Error)]
pub enum SimulatorError {
    /// A parameter is out of its range, or the frame's time and stiffness are beyond float32.
    #[error(transparent)]
    Params(#[from] ParamsError),
    /// The snapshot is of another groom.
    #[error("the snapshot does not fit: {0}")]
    Snapshot(#[from] SnapshotError),
    /// The edited groom cannot be simulated in place of the present one.
    #[error("the edited groom cannot be simulated: {0}")]
    Regroom(#[from] RegroomError),
    /// The device that it runs on has failed or has no room.
    #[error(transparent)]
    Device(Box<dyn std::error::Error + Send + Sync>),
}

/// Where the positions of a frame are.
#[derive(Clone, Copy, Debug)]
pub enum Positions<'a> {
    /// In memory: world space and the groom's order, `[P]`, metres.
    Host(&'a [Vec3]),
    /// On a device. The crate of the device knows the type: `forelock_gpu::DevicePositions`.
    Device(&'a dyn Any),
}

impl<'a> Positions<'a> {
    /// Positions in memory; none if they are on a device.
    pub fn host(self) -> Option<&'a [Vec3]> {
        if let Self::Host(positions) = self { Some(positions) } else { None }
    }

    /// Positions on a device as `D`; none if they are in memory or of another type.
    pub fn device<D: 'static>(self) -> Option<&'a D> {
        if let Self::Device(handle) = self { handle.downcast_ref() } else { None }
    }
}

/// Something that moves the strands of a groom frame by frame.
pub trait Simulator: Debug + Send {
    /// Advances by a frame. A device reports when it has finished the frame.
    ///
    /// # Errors
    /// [`SimulatorError::Params`] or [`SimulatorError::Device`].
    fn step(&mut self, frame: &FrameInput<'_>) -> Result<FrameReport, SimulatorError>;

    /// The positions after the last frame, where they are: a device does not copy them.
    ///
    /// # Errors
    /// [`SimulatorError::Device`].
    fn positions(&mut self) -> Result<Positions<'_>, SimulatorError>;

    /// Copies the positions after the last frame to memory: world space and the groom's order,
    /// `[P]`, metres. A device waits for its frames.
    ///
    /// # Errors
    /// [`SimulatorError::Device`].
    fn read_positions(&mut self, out: &mut Vec<Vec3>) -> Result<(), SimulatorError>;

    /// The same at a moment between the last two steps:
    /// [`State::positions_between`](crate::strands::State::positions_between).
    ///
    /// # Errors
    /// [`SimulatorError::Device`].
    fn read_positions_between(&mut self, moment: &Between, out: &mut Vec<Vec3>)
    -> Result<(), SimulatorError>;

    /// By how much the tie of each particle to the rest shape has weakened, `[P]`, in the groom's
    /// order: 0 for an intact one, 1 for a broken one. A device copies its whole state for it. Ties
    /// weaken under some solvers only ([`FrameRules::ties_weaken`]).
    ///
    /// [`FrameRules::ties_weaken`]: crate::frame::FrameRules::ties_weaken
    ///
    /// # Errors
    /// [`SimulatorError::Device`].
    fn read_damage(&mut self, out: &mut Vec<f32>) -> Result<(), SimulatorError> {
        let integrity = self.snapshot()?.integrity;
        let model = self.model();
        out.clear();
        for strand in 0..model.strand_count {
            let [first, end] = [strand, strand + 1].map(|own| model.offsets[own] as usize);
            out.extend(integrity[first..end].iter().step_by(model.every as usize).map(|own| 1.0 - own));
        }
        Ok(())
    }

    /// Whether it tells contacts and the grid.
    fn tells_interactions(&self) -> bool {
        false
    }

    /// The contacts of each particle in the last frame, `[P]`, in the groom's order: see
    /// [`Simulation::touches`]. Returns false, and an empty list, where they are not known: always
    /// without [`tells_interactions`](Self::tells_interactions).
    fn touches(&self, out: &mut Vec<Touch>) -> bool {
        out.clear();
        false
    }

    /// The cells of the grid on which strands interact, in the last frame: see
    /// [`Simulation::grid_cells`]. None without [`tells_interactions`](Self::tells_interactions).
    fn grid_cells(&self) -> Option<GridCells> {
        None
    }

    /// A copy of the state that resumes bit for bit.
    ///
    /// # Errors
    /// [`SimulatorError::Device`].
    fn snapshot(&mut self) -> Result<Snapshot<f32>, SimulatorError>;

    /// Goes back to a snapshot, of this or of another simulator of the same groom.
    ///
    /// # Errors
    /// [`SimulatorError::Snapshot`] or [`SimulatorError::Device`].
    fn restore(&mut self, snapshot: &Snapshot<f32>) -> Result<(), SimulatorError>;

    /// The head jumps from pose `from` to pose `to` between frames.
    ///
    /// # Errors
    /// [`SimulatorError::Device`].
    fn teleport(&mut self, from: &Pose, to: &Pose, mode: Teleport) -> Result<(), SimulatorError>;

    /// Puts all strands to rest, with the head at `head` and each strand at its own motion of
    /// `frames`, one a strand in the groom's order.
    ///
    /// # Errors
    /// [`SimulatorError::Device`], also of a device that has no motion of single roots.
    fn rest_on(&mut self, head: &Pose, frames: &RootFrames) -> Result<(), SimulatorError>;

    /// Whether it computes the motion of roots from poses of a skin faster than it takes their
    /// motions: see [`Roots::OnSkin`](crate::frame::Roots::OnSkin).
    fn poses_roots(&self) -> bool {
        false
    }

    /// Invalidates cached distances to colliders, because their set has changed or they have
    /// jumped.
    ///
    /// # Errors
    /// [`SimulatorError::Device`].
    fn forget_solids(&mut self) -> Result<(), SimulatorError>;

    /// Changes the parameters, or the solver, from the next frame on.
    ///
    /// # Errors
    /// [`SimulatorError::Params`] if one is out of range; nothing is changed then.
    /// [`SimulatorError::Device`].
    fn set_params(&mut self, solver: &Solver<f32>) -> Result<(), SimulatorError>;

    /// Sets the speed below which strands are still, m/s, from the next frame on: those that are
    /// still for a second sleep until something wakes them. 0: no strand sleeps.
    fn set_sleep_speed(&mut self, speed: f64);

    /// Sets or removes the built-in interactions, from the next frame on.
    ///
    /// # Errors
    /// [`SimulatorError::Params`] if a parameter is out of range; nothing is changed then.
    /// [`SimulatorError::Device`].
    fn set_interactions(&mut self, interactions: &Interactions) -> Result<(), SimulatorError>;

    /// Continues with the edited `groom`, whose strands come from those simulated so far as
    /// `sources` say, with the head at `head`.
    ///
    /// # Errors
    /// [`SimulatorError::Regroom`]; nothing is changed then. [`SimulatorError::Device`].
    fn regroom(&mut self, groom: &Groom, sources: &[Source], head: &Pose) -> Result<(), SimulatorError>;

    /// Name of the device; none for the CPU.
    fn device(&self) -> Option<&str> {
        None
    }

    /// The steps of a frame.
    fn plan(&self) -> &FramePlan;

    /// The strands.
    fn model(&self) -> &Model<f32>;

    /// Bytes held, on the device where there is one.
    fn bytes(&self) -> u64;
}

/// A simulation on the CPU with a list of its positions.
#[derive(Debug)]
pub struct HostPositions {
    simulation: Simulation<f32>,
    positions: Vec<Vec3>,
}

impl HostPositions {
    /// Around `simulation`.
    pub fn new(simulation: Simulation<f32>) -> Self {
        Self { simulation, positions: Vec::new() }
    }

    /// The simulation.
    pub fn simulation(&self) -> &Simulation<f32> {
        &self.simulation
    }

    /// The simulation, to be changed.
    pub fn simulation_mut(&mut self) -> &mut Simulation<f32> {
        &mut self.simulation
    }
}

impl Simulator for HostPositions {
    fn step(&mut self, frame: &FrameInput<'_>) -> Result<FrameReport, SimulatorError> {
        Ok(self.simulation.step_frame(frame)?)
    }

    fn positions(&mut self) -> Result<Positions<'_>, SimulatorError> {
        self.simulation.positions(&mut self.positions);
        Ok(Positions::Host(&self.positions))
    }

    fn read_positions(&mut self, out: &mut Vec<Vec3>) -> Result<(), SimulatorError> {
        self.simulation.positions(out);
        Ok(())
    }

    fn read_positions_between(
        &mut self,
        moment: &Between,
        out: &mut Vec<Vec3>,
    ) -> Result<(), SimulatorError> {
        self.simulation.state().positions_between(self.simulation.model(), moment, out);
        Ok(())
    }

    fn read_damage(&mut self, out: &mut Vec<f32>) -> Result<(), SimulatorError> {
        self.simulation.damage(out);
        Ok(())
    }

    fn tells_interactions(&self) -> bool {
        true
    }

    fn touches(&self, out: &mut Vec<Touch>) -> bool {
        self.simulation.touches(out)
    }

    fn grid_cells(&self) -> Option<GridCells> {
        self.simulation.grid_cells()
    }

    fn snapshot(&mut self) -> Result<Snapshot<f32>, SimulatorError> {
        Ok(self.simulation.snapshot())
    }

    fn restore(&mut self, snapshot: &Snapshot<f32>) -> Result<(), SimulatorError> {
        Ok(self.simulation.restore(snapshot)?)
    }

    fn teleport(&mut self, from: &Pose, to: &Pose, mode: Teleport) -> Result<(), SimulatorError> {
        self.simulation.teleport(from, to, mode);
        Ok(())
    }

    fn rest_on(&mut self, head: &Pose, frames: &RootFrames) -> Result<(), SimulatorError> {
        self.simulation.rest_on(head, frames);
        Ok(())
    }

    fn forget_solids(&mut self) -> Result<(), SimulatorError> {
        self.simulation.forget_solids();
        Ok(())
    }

    fn set_params(&mut self, solver: &Solver<f32>) -> Result<(), SimulatorError> {
        Ok(self.simulation.set_params(solver)?)
    }

    fn set_sleep_speed(&mut self, speed: f64) {
        self.simulation.set_sleep_speed(speed);
    }

    fn set_interactions(&mut self, interactions: &Interactions) -> Result<(), SimulatorError> {
        Ok(self.simulation.set_interactions(interactions)?)
    }

    fn regroom(&mut self, groom: &Groom, sources: &[Source], head: &Pose) -> Result<(), SimulatorError> {
        Ok(self.simulation.regroom(groom, sources, head)?)
    }

    fn plan(&self) -> &FramePlan {
        self.simulation.plan()
    }

    fn model(&self) -> &Model<f32> {
        self.simulation.model()
    }

    fn bytes(&self) -> u64 {
        self.simulation.memory().total() as u64
    }
}
