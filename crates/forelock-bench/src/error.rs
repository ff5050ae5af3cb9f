//! Why an experiment failed.

use std::path::PathBuf;

/// Why an experiment failed.
#[derive(Debug, thiserror::Error)]
pub enum BenchError {
    /// A scene is invalid.
    #[error(transparent)]
    Scene(#[from] forelock::scene::SceneError),
    /// A file that a scene names cannot be used.
    #[error(transparent)]
    Asset(#[from] forelock::AssetError),
    /// A scene cannot be simulated.
    #[error(transparent)]
    Player(#[from] forelock::PlayerError),
    /// The solver refuses groom or parameters.
    #[error("the solver cannot take this scene: {0}")]
    Build(#[from] forelock_core::simulation::BuildError),
    /// The solver refuses a frame.
    #[error("the solver cannot step this scene: {0}")]
    Step(#[from] forelock_core::params::ParamsError),
    /// The GPU failed.
    #[error(transparent)]
    Gpu(#[from] forelock_gpu::GpuError),
    /// A model cannot be trained or measured.
    #[error(transparent)]
    Training(#[from] forelock::training::TrainingError),
    /// A model cannot be read.
    #[error(transparent)]
    Model(#[from] forelock_neural::model::ModelError),
    /// A network cannot be made.
    #[error("the network: {0}")]
    Network(#[from] forelock_neural::network::LengthError),
    /// A network cannot be made ready for strands.
    #[error("the network: {0}")]
    Strands(#[from] forelock_neural::network::inference::CountError),
    /// A rig cannot be trained.
    #[error(transparent)]
    Rig(#[from] forelock_neural::rigged::RigError),
    /// A picture cannot be made.
    #[error(transparent)]
    Picture(#[from] forelock::PictureError),
    /// The output folder cannot be made.
    #[error("{}: the output folder cannot be made: {error}; name another", .path.display())]
    Folder {
        /// The folder.
        path: PathBuf,
        /// The error of the operating system.
        error: std::io::Error,
    },
}
