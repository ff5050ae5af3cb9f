//! Training of the learned simulator, from a configuration to a model's file.
//!
//! # Practice
//! [`train`] grows or reads the hair that a [`TrainingConfig`] names, trains its strand codes and
//! then the network, with the energies alone, and keeps the best network: at every
//! `steps.measure_every` steps it is compared with the implicit reference, for strands and motions
//! that are not trained. What is reported in the end is measured on further strands and motions,
//! which did not choose it.
//!
//! | file in the output folder | what |
//! | --- | --- |
//! | `model.safetensors` | the model |
//! | `training.toml` | the configuration with every key |
//! | `training.html` | curves of the energy and of the measures, while it trains too |
//! | `checkpoint.safetensors` | the state from which `resume` goes on, bit for bit |
//!
//! The same configuration gives the same file, whatever the number of threads and interruptions, on
//! processors with the same instruction set.

mod config;
mod data;
mod examination;
mod material;
mod page;
mod recorded;
mod run;

pub use config::{
    TrainedEnergies, TrainedHair, TrainedMethod, TrainedMotions, TrainingConfig, TrainingPreset,
    TrainingSteps, help, markdown,
};
pub use examination::{Examination, KindScore, measure};
pub use material::Material;
pub use run::{TRAINING, TrainingOptions, TrainingSummary, train};

use std::path::PathBuf;

/// Why a training failed.
#[derive(Debug, thiserror::Error)]
pub enum TrainingError {
    /// The scene of the hair is wrong.
    #[error(transparent)]
    Scene(#[from] crate::scene::SceneError),
    /// Something that it names cannot be used.
    #[error(transparent)]
    Assets(#[from] crate::assets::AssetError),
    /// There is no body.
    #[error("`hair.scene` has no body: hair is trained on one, name it in `body.mesh`")]
    NoBody,
    /// The body encloses nothing.
    #[error("the body cannot be made solid: {0}; close its mesh")]
    Body(forelock_core::body::SdfError),
    /// A strand has no code.
    #[error("groom {groom}: {error}")]
    Strand {
        /// The groom.
        groom: String,
        /// What is wrong with the strand.
        error: forelock_neural::model::InputsError,
    },
    /// The head is not at the origin.
    #[error(
        "groom {groom}: its roots are {distance_m:.2} m from the origin on average; move body and groom so \
         that the middle of the head is there"
    )]
    Far {
        /// The groom.
        groom: String,
        /// Mean distance of the roots, m.
        distance_m: f64,
    },
    /// A file of the user would be replaced.
    #[error("{} was not written by a training: choose another output folder with --out", .0.display())]
    Overwrites(PathBuf),
    /// A groom has too few strands.
    #[error(
        "groom {groom} has {strands} strands, too few: {needed} are needed with those held out (`hair.held_out`)"
    )]
    Few {
        /// The groom.
        groom: String,
        /// Its strands.
        strands: usize,
        /// What it needs.
        needed: usize,
    },
    /// All strands have one shape.
    #[error("all strands have the same shape, so there is nothing that codes could tell apart: add a groom")]
    AllAlike,
    /// Strands have no locks.
    #[error(transparent)]
    Locks(forelock_neural::codes::LocksError),
    /// A motion is wrong.
    #[error(transparent)]
    Motion(forelock_neural::features::FeatureError),
    /// A file of a recorded motion cannot be used.
    #[error("{}: {problem}", .path.display())]
    Recorded {
        /// The file.
        path: PathBuf,
        /// What is wrong, and what to do.
        problem: String,
    },
    /// Strands or motions cannot be trained with.
    #[error(transparent)]
    Set(#[from] forelock_neural::train::SetError),
    /// A step has diverged.
    #[error(transparent)]
    NotFinite(#[from] forelock_neural::train::NotFinite),
    /// What was trained cannot be measured.
    #[error("what was trained cannot be measured: {0}")]
    Measure(#[from] forelock_neural::measures::MeasureError),
    /// The model cannot be measured.
    #[error("{0}")]
    Unsupported(String),
    /// The model cannot be made of its parts.
    #[error(transparent)]
    Model(#[from] forelock_neural::model::ModelError),
    /// A file cannot be read.
    #[error("{}: {error}", .path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        error: std::io::Error,
    },
    /// A file cannot be written.
    #[error(transparent)]
    Write(#[from] forelock_io::WriteError),
    /// The checkpoint is damaged.
    #[error("{}: {error}; train without --resume", .path.display())]
    Checkpoint {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        error: forelock_neural::train::CheckpointError,
    },
    /// The checkpoint is of another configuration or program.
    #[error("{}: this checkpoint is of another training: {what}", .path.display())]
    Other {
        /// The file.
        path: PathBuf,
        /// What differs, and what to do.
        what: String,
    },
    /// No step was good enough to be kept.
    #[error(
        "after no measurement less than {0} % of the particles were inside the body: train longer, or raise `energies.body`"
    )]
    NoneKept(f64),
}
