//! Forelock: real-time simulation of dense hair, strand by strand.
//!
//! A [`Scene`] is a TOML file in which every key has a default; a [`Player`] runs one frame by
//! frame and takes live changes; [`simulate`] runs one into a folder; [`Studio`] takes its
//! pictures. The parts are [`core`] (grooms, bodies, solvers), [`io`] (files) and [`render`]
//! (pictures).
//!
//! ```
//! use forelock::scene::Override;
//! use forelock::{Backend, RunOptions, Scene, simulate};
//! use std::sync::atomic::AtomicBool;
//!
//! # let folder = std::env::temp_dir().join("forelock-doc");
//! let small = ["groom.strands=20", "time.frames=3", "body.sdf_cells=32"];
//! let small = [&small[..], &["output.film=false", "output.picture=false"]].concat();
//! let sets: Result<Vec<_>, _> = small.iter().map(|set| Override::set(set)).collect();
//! let scene = Scene::builtin(&sets?)?;
//! let options = RunOptions { out: folder, resume: false, backend: Backend::Cpu };
//! let summary = simulate(&scene, &options, &mut |_| {}, &AtomicBool::new(false))?;
//! assert_eq!((summary.strands, summary.frames), (20, 3));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod assets;
mod backend;
mod grooming;
mod hash;
pub mod html;
mod neural;
mod painter;
pub mod penetration;
mod pictures;
pub mod player;
mod progress;
pub mod report;
mod run;
mod scalp;
pub mod scene;
mod sdf_cache;
pub mod session;
pub mod shots;
pub mod sinks;
pub mod summary;
mod tessellate;
pub mod training;

pub use assets::{AssetError, Assets};
pub use backend::{Backend, GpuStage};
pub use grooming::{Counts, EditRow, Grooming, GroomingOptions, groom};
pub use neural::{NeuralError, builtin_model, read as read_model};
pub use painter::GpuPainter;
pub use pictures::{PictureError, Studio, labelled, write_picture};
pub use player::{Player, PlayerError};
pub use progress::{Observer, Progress};
pub use run::{
    MEASURED_EVERY, RunError, RunOptions, SIMULATING, SnapshotError, folder_name, is_running_in, record,
    simulate,
};
pub use scene::Scene;
pub use summary::Summary;
pub use {forelock_core as core, forelock_gpu as gpu, forelock_io as io, forelock_render as render};

/// The README's examples, run as tests.
#[cfg(doctest)]
#[doc = include_str!("../../../README.md")]
struct Readme;

/// The examples of the page on the library, run as tests.
#[cfg(doctest)]
#[doc = include_str!("../../../docs/library.md")]
struct Library;
