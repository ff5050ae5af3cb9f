//! What can go wrong in a player.

use forelock_core::params::ParamsError;
use forelock_core::simulation::{BuildError, RegroomError};
use forelock_core::simulator::SimulatorError;
use forelock_gpu::GpuError;

use crate::assets::AssetError;
use crate::neural::NeuralError;

use super::ColliderId;

/// Why a player cannot be built, stepped or changed.
#[derive(Debug, thiserror::Error)]
pub enum PlayerError {
    /// Something that the scene names cannot be used.
    #[error(transparent)]
    Asset(#[from] AssetError),
    /// The solver refuses groom or parameters.
    #[error("the solver cannot take this scene: {0}")]
    Build(#[from] BuildError),
    /// The hair cannot be carried by guides.
    #[error("groom.guides: {0}")]
    Guides(#[from] forelock_core::groom::guides::GuidesError),
    /// An edited groom cannot be simulated.
    #[error("the simulation cannot take the edited groom over: {0}")]
    Regroom(#[from] RegroomError),
    /// The parameters of the wind are invalid.
    #[error("the wind cannot blow: {0}")]
    Wind(ParamsError),
    /// A state belongs to another groom.
    #[error("the snapshot does not fit: {0}")]
    Restore(#[from] forelock_core::strands::SnapshotError),
    /// The GPU failed, or cannot do what the scene asks for.
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// The learned solver cannot run the scene.
    #[error(transparent)]
    Neural(#[from] NeuralError),
    /// A device failed.
    #[error(transparent)]
    Device(Box<dyn std::error::Error + Send + Sync>),
    /// The solver refuses a frame or a parameter.
    #[error("the solver cannot step this scene: {0}")]
    Step(#[from] ParamsError),
    /// The scene names a solver that is not registered with the player.
    #[error("the solver \"{0}\" is not registered with the player: see PlayerBuilder::solver")]
    UnknownSolver(String),
    /// A registered solver refuses its table of parameters.
    #[error("solver.{name}: {message}")]
    SolverTable {
        /// Name of the solver.
        name: String,
        /// Its message.
        message: String,
    },
    /// A parameter cannot change while the simulation runs.
    #[error("{0} cannot change while the simulation runs: build a new player")]
    Fixed(&'static str),
    /// The groom cannot be edited when guides carry its strands.
    #[error("a groom whose strands are carried by guides cannot be edited while it moves")]
    EditedGuides,
    /// There is no such collider.
    #[error("there is no collider {}", .0.0)]
    NoCollider(ColliderId),
    /// A pose is not finite.
    #[error("the pose is not finite")]
    Pose,
    /// A frame has not been simulated yet.
    #[error("frame {frame} has not been simulated yet: the last one is {reached}")]
    NotRun {
        /// The frame asked for.
        frame: u32,
        /// The last frame that was simulated.
        reached: u32,
    },
    /// No snapshot is early enough to go back.
    #[error("no snapshot is kept at or before frame {0}: see PlayerBuilder::history")]
    NotKept(u32),
}

impl From<SimulatorError> for PlayerError {
    fn from(error: SimulatorError) -> Self {
        match error {
            SimulatorError::Params(error) => error.into(),
            SimulatorError::Snapshot(error) => error.into(),
            SimulatorError::Regroom(error) => error.into(),
            SimulatorError::Device(error) => match error.downcast::<GpuError>() {
                Ok(error) => Self::Gpu(*error),
                Err(error) => match error.downcast::<NeuralError>() {
                    Ok(error) => Self::Neural(*error),
                    Err(error) => Self::Device(error),
                },
            },
        }
    }
}
