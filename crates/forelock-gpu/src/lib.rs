//! Forelock on a GPU: the stages of `forelock-core` as kernels, through wgpu.
//!
//! A [`Gpu`] is a device, opened here ([`Gpu::open`]) or by an engine ([`Gpu::from_device`]); a [`GpuSimulation`] is a groom on it. A frame is one
//! submission: poses go up, nothing comes back unless it is asked for.
//!
//! ```
//! use forelock_core::groom::grow::{GrowParams, grow_on_head};
//! use forelock_core::pose::Pose;
//! use forelock_core::solver::{AmsParams};
use forelock_core::frame::{Frame};
use forelock_core::simulation::{Options};
//! use forelock_gpu::{Choice, Gpu, GpuSimulation};
//! use glam::DVec3;
//!
//! let Ok(gpu) = Gpu::open(&Choice::Fastest) else { return Ok(()) };
//! let groom = grow_on_head(&GrowParams { strands: 100, ..GrowParams::default() })?;
//! let mut simulation = GpuSimulation::new(&gpu, &groom, &AmsParams::default(), &Options::default())?;
//! let still = Frame {
//!     head: [Pose::IDENTITY; 2],
//!     colliders: &[],
//!     gravity: DVec3::new(0.0, -9.81, 0.0),
//!     air_velocity: DVec3::ZERO,
//!     dt_secs: 1.0 / 60.0,
//! };
//! simulation.step_frame(&still)?;
//! assert_eq!(simulation.report()?.quarantined_strands, 0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Practice
//! Kernels lie as text beside what they are twins of (`kernel.wgsl` of each stage in `forelock-core`, `body/shapes.wgsl`, `grid/grid.wgsl`), and the rows of Model and State are on the
//! device as they are on the CPU. One strand is one thread, on the grid some cells are: 16 neighbours of a block read 64 bytes side by side. Strands go in batches, each within the
//! device's bindings; scratch is that of the largest batch.
//!
//! # Limitations
//! At most 32 solids at once. The fields of solids that change are all held at once. Numbers come back by waiting, which a browser does not allow: native only so far. Nothing holds back a caller who steps without ever reading.

pub mod air;
mod batch;
mod clock;
pub mod contacts;
mod device;
mod error;
pub mod grid;
pub mod kernels;
pub mod layout;
pub mod particles;
mod peaks;
mod simulation;
pub mod skinning;
pub mod solids;

pub use clock::{FrameSecs, StageSecs};
pub use device::{Choice, Counts, Gpu};
pub use error::GpuError;
pub use peaks::Peaks;
pub use simulation::{GpuReport, GpuSimulation};
pub use skinning::GpuSkinning;
