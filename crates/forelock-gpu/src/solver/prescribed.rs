//! The kernel of strands that go where they are told.

use super::{GpuSolver, SolveBatch};
use crate::Gpu;
use crate::batch::DeviceStrands;
use crate::collide::Solids;
use crate::kernel::{Bound, DispatchList, Shader, Threads, bindings, shader};
use crate::uniforms::{FrameUniform, SubstepUniform};
use forelock_core::frame::Solver;
use forelock_core::solver::{PrescribedParams, prescribed};

bindings! {
    /// Strands and their targets.
    pub(crate) struct TargetBindings {
        0 frame: uniform(FrameUniform),
        1 substep: dynamic(SubstepUniform),
        2 blocks: read,
        5 positions: read_write,
        6 velocities: read_write,
        35 channels: read_write,
    }
}

shader! {
    /// `follow_targets`.
    FOLLOW: "follow_targets", TargetBindings;
    texts: [prescribed::WGSL];
    constants: [];
    kernels: {
        /// Takes the targets over.
        FOLLOW_TARGETS: "follow_targets", Threads::Strands;
    }
}

pub(crate) static SHADERS: &[&Shader] = &[&FOLLOW];

/// The solver on a GPU, if `solver` goes where it is told.
pub(crate) fn of(solver: &Solver<f32>) -> Option<Box<dyn GpuSolver>> {
    solver.params::<PrescribedParams>()?;
    Some(Box::new(GpuPrescribed::default()))
}

#[derive(Debug, Default)]
struct GpuPrescribed {
    /// One a batch.
    groups: Vec<Bound<TargetBindings<'static>>>,
}

impl GpuSolver for GpuPrescribed {
    fn bind(&mut self, gpu: &Gpu, strands: DeviceStrands<'_>, _: &Solids, _: Option<&[wgpu::Buffer]>) {
        let shared = strands.shared;
        let bound = strands.batches.iter().map(|batch| {
            let bindings = TargetBindings {
                frame: &shared.frame,
                substep: &shared.substeps,
                blocks: &batch.blocks,
                positions: &batch.positions,
                velocities: &batch.velocities,
                channels: &batch.channels,
            };
            bindings.bind(gpu, batch.threads)
        });
        self.groups = bound.collect();
    }

    fn write_terms(&self, _: f64, _: &mut FrameUniform) {}

    fn solve<'a>(&'a self, list: &mut DispatchList<'a>, batch: &SolveBatch<'a>, substep: u32) {
        list.push(self.groups[batch.batch].dispatch(&FOLLOW_TARGETS, &[substep]));
    }
}
