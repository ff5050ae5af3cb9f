//! Solvers of strands. Each is a folder with its parameters, its stage and its WGSL, and registers
//! with one line here.
//!
//! The seam is [`LaneSolver`] (one function, generic over lanes) or [`StrandSolver`] (one call a
//! block); see `docs/dev/add-a-solver.md`.

pub mod ams;
pub mod dftl;
pub mod mass_spring;
pub mod prescribed;
pub mod xpbd;

pub use crate::frame::{
    Channel, ChannelKind, Channels, FrameContext, FrameRules, LaneGroup, LaneSolver, Refinement, Solver,
    StepCheck, StepRate, StrandSolver, Substep,
};
pub use ams::AmsParams;
#[cfg(feature = "serde")]
pub(crate) use ams::LengthPass;
pub use dftl::DftlParams;
pub use mass_spring::MassSpringParams;
pub use prescribed::PrescribedParams;
pub use xpbd::XpbdParams;
