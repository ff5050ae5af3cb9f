//! Solvers: each an ordered list of stages over the same Model, State and Workspace.

pub mod params;

pub use params::AmsParams;
