//! The GPU renderer. Feature `gpu`.
//!
//! # Theory
//! The same picture as [`render`](crate::render), by the same equations. Each drawn particle is
//! projected once. Light is computed at some points of each edge: one where edges are at most a
//! few pixels long, more in a close-up. The curve between two particles is divided into straight
//! pieces. Each tile of 16 × 16 pixels gets a list of its pieces by counting, a prefix sum and
//! filling, and sorts it by depth. Then each pixel composites the pieces from front to back by
//! their exact coverage, against the depths of the bodies, until it is opaque.
//!
//! # Practice
//! The device and its queue come from outside: WebGPU's default limits suffice, and no feature is
//! needed. With timestamps ([`wgpu::Features::TIMESTAMP_QUERY`]) the [`FrameReport`] has the times
//! of the stages. The device places and draws bodies, and computes shadow maps, grids of optical
//! depth and all light. The renderer keeps what it uploaded: for the next picture the CPU compares
//! meshes and attributes of strands with those of the last one, and uploads positions, poses and
//! what is new. Positions that a simulation has written on the device need no upload
//! ([`GpuRenderer::share`]).
//!
//! The list of pieces has no fixed size. [`GpuRenderer::render`] draws again with more room where
//! pieces had none. [`GpuRenderer::render_to`] and [`GpuRenderer::render_over`], which draws over
//! what an engine has drawn, do not wait, so they cannot; a later frame has the
//! room that this one lacked, and [`GpuRenderer::report`] tells how many pieces were left out.
//! Equal depths are ordered by the number of the piece, so that a picture drawn twice has the same
//! bytes.
//!
//! # Limitations
//! Neighbouring pieces divide pixels along the curve's normal, so that none is drawn twice or left
//! out; the CPU takes the normal of each piece. Light is interpolated between equal steps of an
//! edge; the CPU computes it at the end of each piece. Bodies always have two samples along each
//! side of a pixel, and 2 million vertices at most under WebGPU's default limits.

mod curves;
mod error;
mod hosted;
mod meshes;
mod present;
mod shadows;
mod shared;
mod stages;
mod work;

pub use error::GpuRenderError;
pub use present::Target;
pub use shared::SharedPositions;
pub use work::{FrameReport, GpuRenderer};
