//! The GPU kernels of each solver. A solver is registered by one line in [`of`] and one in
//! [`SHADERS`].

mod ams;
mod dftl;
mod prescribed;
mod xpbd;

use crate::batch::{DeviceStrands, StrandGroups};
use crate::collide::{SolidKinds, Solids};
use crate::kernel::{DispatchList, Shader};
use crate::uniforms::FrameUniform;
use crate::{Gpu, GpuError};
use forelock_core::frame::Solver;
use std::fmt::Debug;

/// A solver on a GPU.
pub(crate) trait GpuSolver: Debug + Send + Sync {
    /// Number of entries that the solver needs in the uniform buffer of substeps: at least one per
    /// substep. `longest` is the number of particles of the longest strand.
    fn substep_entries(&self, substeps: u32, longest: u32) -> u32 {
        let _ = longest;
        substeps
    }

    /// Creates the bind groups of the solver; those that all solvers share are in [`StrandGroups`].
    /// It is called again whenever a buffer was replaced. `winds` are the wind fields of the
    /// batches, if there are any yet.
    fn bind(
        &mut self,
        gpu: &Gpu,
        strands: DeviceStrands<'_>,
        solids: &Solids,
        winds: Option<&[wgpu::Buffer]>,
    ) {
        let _ = (gpu, strands, solids, winds);
    }

    /// Writes the solver's coefficients for a frame time of `dt_secs` into the uniform.
    fn write_terms(&self, dt_secs: f64, uniform: &mut FrameUniform);

    /// Appends the dispatches of substep `substep` of one batch to `list`.
    fn solve<'a>(&'a self, list: &mut DispatchList<'a>, batch: &SolveBatch<'a>, substep: u32);

    /// Appends the dispatches that apply a wind field, once per frame, before the first substep.
    fn apply_wind<'a>(&self, list: &mut DispatchList<'a>, groups: &'a StrandGroups) {
        let _ = (list, groups);
    }
}

/// The inputs of [`GpuSolver::solve`]: a batch of strands.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SolveBatch<'a> {
    /// Bind groups of all batches.
    pub groups: &'a StrandGroups,
    /// Index of the batch.
    pub batch: usize,
    /// Number of particles of the longest strand in the batch.
    pub longest: u32,
    /// The kinds of colliders in the scene.
    pub solids: SolidKinds,
    /// Whether the solve stores its matrix factors in 16 bits, if the solver supports that.
    pub half_factors: bool,
}

/// The shaders of each solver.
pub(crate) static SHADERS: [&[&Shader]; 4] =
    [ams::SHADERS, dftl::SHADERS, xpbd::SHADERS, prescribed::SHADERS];

/// Creates the GPU counterpart of `solver`.
///
/// # Errors
/// [`GpuError::Unsupported`] for a solver that runs on the CPU only.
pub(crate) fn of(solver: &Solver<f32>) -> Result<Box<dyn GpuSolver>, GpuError> {
    ams::of(solver)
        .or_else(|| dftl::of(solver))
        .or_else(|| xpbd::of(solver))
        .or_else(|| prescribed::of(solver))
        .ok_or(GpuError::Unsupported { what: "a solver without GPU kernels" })
}
