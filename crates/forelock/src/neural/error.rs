//! Why the learned simulator cannot run a scene.

use std::path::PathBuf;

use forelock_core::groom::ResampleError;
use forelock_neural::features::FeatureError;
use forelock_neural::model::{InputsError, ModelError};
use forelock_neural::network::inference::CountError;
use glam::DVec3;

use crate::scene::SolverKind;

/// What helps wherever the learned simulator cannot.
fn instead() -> String {
    format!("set solver.kind = \"{}\"", SolverKind::default().name())
}

/// Why the learned simulator cannot run a scene.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum NeuralError {
    /// There is no model, or it cannot be used.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// The model needs what this version does not do.
    #[error("{}: {problem}", .path.display())]
    Unsupported {
        /// The model.
        path: PathBuf,
        /// What that is, and what to do.
        problem: String,
    },
    /// The scene has another gravity than the model was trained with.
    #[error(
        "gravity is {found} m/s², and the model was trained with {trained}: set gravity to that, or {}",
        instead()
    )]
    Gravity {
        /// The scene's, m/s².
        found: DVec3,
        /// The model's, m/s².
        trained: DVec3,
    },
    /// It was to run on two processors.
    #[error("the learned solver runs on one processor: leave out --gpu-from, or {}", instead())]
    GpuFrom,
    /// The solver was to be another one, or this one in place of another, during a simulation.
    #[error("the learned solver cannot replace another one while hair moves, nor be replaced")]
    Replaced,
    /// The roots are nowhere near the head that the model knows.
    #[error(
        "the roots lie {distance_m:.2} m from the head's centre on average, more than on any head: set \
         solver.neural.origin to the point of the groom's space between the ears; the middle of the roots is {middle}"
    )]
    Far {
        /// Mean distance of the roots, metres.
        distance_m: f64,
        /// Middle of the roots in the groom's space, metres.
        middle: DVec3,
    },
    /// The strands cannot be resampled for the network.
    #[error("the strands cannot be resampled for the network: {0}")]
    Resample(#[from] ResampleError),
    /// A strand has no inputs.
    #[error("the strands have no inputs of the network: {0}")]
    Inputs(#[from] InputsError),
    /// The numbers of strands and of inputs differ.
    #[error(transparent)]
    Count(#[from] CountError),
    /// The head's pose cannot be followed.
    #[error("the head's motion cannot be followed: {0}")]
    Motion(#[from] FeatureError),
}
