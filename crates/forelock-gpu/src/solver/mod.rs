//! The kernels of each solver. A solver registers with one line in [`of`] and one in [`SHADERS`].

mod ams;
mod dftl;

use crate::batch::{DeviceStrands, StrandGroups};
use crate::collide::{SolidKinds, Solids};
use crate::kernel::{DispatchList, Shader};
use crate::uniforms::FrameUniform;
use crate::{Gpu, GpuError};
use forelock_core::frame::Solver;
use std::fmt::Debug;

/// A solver on a GPU.
pub(crate) trait GpuSolver: Debug + Send + Sync {
    /// Entries that it needs in the buffer of substeps; at least one a substep.
    fn substep_entries(&self, substeps: u32, longest: u32) -> u32 {
        let _ = longest;
        substeps
    }

    /// Makes its bind groups, beside those that all solvers share ([`StrandGroups`]). Called again
    /// when a buffer was replaced.
    fn bind(&mut self, gpu: &Gpu, strands: DeviceStrands<'_>, solids: &Solids) {
        let _ = (gpu, strands, solids);
    }

    /// Writes its coefficients for frames of `dt_secs`.
    fn write_terms(&self, dt_secs: f64, uniform: &mut FrameUniform);

    /// Appends a substep of one batch.
    fn solve<'a>(&'a self, list: &mut DispatchList<'a>, batch: &SolveBatch<'a>, substep: u32);

    /// Appends what a wind field does before the first substep.
    fn apply_wind<'a>(&self, list: &mut DispatchList<'a>, groups: &'a StrandGroups) {
        let _ = (list, groups);
    }
}

/// A batch of strands as a solver sees it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SolveBatch<'a> {
    /// Bind groups of all batches.
    pub groups: &'a StrandGroups,
    /// Number of the batch.
    pub batch: usize,
    /// Particles of its longest strand.
    pub longest: u32,
    /// What kinds of colliders there are.
    pub solids: SolidKinds,
    /// Whether the solve keeps its factors in 16 bits, where it can.
    pub half_factors: bool,
}

/// The shaders of each solver.
pub(crate) static SHADERS: [&[&Shader]; 2] = [ams::SHADERS, dftl::SHADERS];

/// The kernels of `solver`.
///
/// # Errors
/// [`GpuError::Unsupported`] for a solver that runs on the CPU only.
pub(crate) fn of(solver: &Solver<f32>) -> Result<Box<dyn GpuSolver>, GpuError> {
    ams::of(solver)
        .or_else(|| dftl::of(solver))
        .ok_or(GpuError::Unsupported { what: "this solver: it has no GPU kernels" })
}
