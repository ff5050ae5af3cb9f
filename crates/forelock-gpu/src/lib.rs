//! Forelock on a GPU: the stages of `forelock-core` as kernels, through wgpu.
//!
//! A [`Gpu`] is a device, opened here ([`Gpu::open`]) or by an engine ([`Gpu::from_device`]); a
//! [`GpuSimulation`] is a groom on it. A frame is one submission that uploads poses and reads
//! nothing back.
//!
//! ```
//! use forelock_core::frame::{FrameInput, Roots};
//! use forelock_core::groom::grow::{GrowParams, grow_on_head};
//! use forelock_core::pose::Pose;
//! use forelock_core::simulation::Options;
//! use forelock_core::solver::AmsParams;
//! use forelock_gpu::{Choice, Gpu, GpuSimulation};
//! use glam::DVec3;
//!
//! let Ok(gpu) = Gpu::open(&Choice::Fastest) else { return Ok(()) };
//! let groom = grow_on_head(&GrowParams { strands: 100, ..GrowParams::default() })?;
//! let (params, options) = (AmsParams::default(), Options::default());
//! let mut simulation = GpuSimulation::new(&gpu, &groom, &params, &options)?;
//! let still = FrameInput {
//!     roots: Roots::Rigid([Pose::IDENTITY; 2]),
//!     gravity: DVec3::new(0.0, -9.81, 0.0),
//!     dt_secs: 1.0 / 60.0,
//!     ..FrameInput::default()
//! };
//! simulation.step_frame(&still)?;
//! assert_eq!(simulation.report()?.quarantined_strands, 0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Practice
//! Each solver, interaction and stage owns its kernels: a module declares their WGSL, which
//! `forelock-core` exports alongside the CPU code, their bindings and constants ([`kernel`]).
//! Pipelines are made at first use and kept by the [`Gpu`]. The rows of Model and State are on the
//! device as they are on the CPU. One strand is one thread; on the grid one cell is: 16 neighbours
//! of a block read 64 adjacent bytes. Strands are split into batches, each within the device's
//! bindings; scratch is that of the largest batch.
//!
//! # Limitations
//! At most 32 solids at once. All fields of solids that change are resident. Read-backs block,
//! which a browser does not allow: native only so far. Frames are queued without limit if the
//! caller never reads back.

pub mod acceleration;
pub mod air;
mod batch;
mod bending;
mod channels;
mod clock;
pub mod collide;
mod device;
mod encode;
mod error;
mod fields;
pub mod frame;
pub mod guides;
pub mod interaction;
pub mod kernel;
pub mod network;
mod peaks;
mod pipelines;
mod positions;
mod report;
pub mod roots;
mod simulation;
mod simulator;
pub mod skin;
mod sleep;
mod solver;
pub mod uniforms;

pub use clock::FrameSecs;
pub use device::{Choice, Counts, Gpu};
pub use error::GpuError;
pub use guides::GpuSkinning;
pub use network::StrandNetwork;
pub use peaks::Peaks;
pub use positions::{DeviceBlock, DevicePositions, PendingPositions};
pub use report::{GpuReport, to_frame_report};
pub use simulation::GpuSimulation;
pub use skin::Skinner;

/// The shaders of all modules, for tests and tools.
pub fn shaders() -> impl Iterator<Item = &'static kernel::Shader> {
    let modules = [
        frame::SHADERS,
        collide::SHADERS,
        acceleration::SHADERS,
        air::SHADERS,
        channels::SHADERS,
        sleep::SHADERS,
        guides::SHADERS,
        skin::SHADERS,
        roots::SHADERS,
        network::SHADERS,
    ];
    let interactions = interaction::KINDS.iter().map(|kind| kind.shaders);
    modules.into_iter().chain(interactions).chain(solver::SHADERS).flatten().copied()
}
