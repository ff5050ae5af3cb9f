//! The kernels of each solver.

pub(crate) mod ams;
pub(crate) mod dftl;
