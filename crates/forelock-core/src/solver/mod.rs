//! Solvers: each an ordered list of stages over the same Model, State and Workspace.

mod between;
mod block;
pub mod dftl;
mod mass_spring;
pub mod params;
mod regroom;
mod simulation;
mod steps;

#[cfg(target_arch = "x86_64")]
pub(crate) use block::with_features;
pub(crate) use block::{BASELINE_FMA, on};
pub use block::{STAGES, Simd, SolverReal};
pub use dftl::DftlParams;
pub use mass_spring::MassSpringParams;
pub use params::{AmsParams, ParamsError, SolverParams};
pub use regroom::RegroomError;
pub use simulation::{BuildError, Frame, FrameReport, Memory, Options, Simulation, Teleport, fractions};
pub use steps::{FrameStep, Meeting};
