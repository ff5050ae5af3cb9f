//! Kernels of XPBD Cosserat rods.

use super::{GpuSolver, SolveBatch};
use crate::Gpu;
use crate::batch::DeviceStrands;
use crate::collide::Solids;
use crate::frame::ROOT_CONSTANTS;
use crate::kernel::{Bound, Constant, DispatchList, Shader, Threads, bindings, shader};
use crate::uniforms::{FrameUniform, SubstepUniform, flags};
use forelock_core::frame::{LaneSolver, ROOTS_WGSL, Solver};
use forelock_core::solver::XpbdParams;
use forelock_core::solver::xpbd::{
    ROTATION,
    solve_rods::{self, LEAST_STIFFNESS, SOFTEST},
};

bindings! {
    /// Strands, their channels and the wind at their particles.
    pub(crate) struct RodBindings {
        0 frame: uniform(FrameUniform),
        1 substep: dynamic(SubstepUniform),
        2 blocks: read,
        3 model: read,
        4 strands: read,
        5 positions: read_write,
        6 velocities: read_write,
        8 scratch: read_write,
        17 wind: read,
        35 channels: read_write,
    }
}

shader! {
    /// `solve_rods`.
    RODS: "solve_rods", RodBindings;
    texts: [ROOTS_WGSL, solve_rods::WGSL];
    constants: [ROOT_CONSTANTS, &[
        Constant::u32("ROTATION", 0),
        Constant::u32("SPIN", ROTATION.rows() as u32),
        Constant::f32("LEAST_STIFFNESS", LEAST_STIFFNESS as f32),
        Constant::f32("SOFTEST", SOFTEST as f32),
    ]];
    kernels: {
        /// One substep.
        SOLVE_RODS: "solve_rods", Threads::Strands;
    }
}

pub(crate) static SHADERS: &[&Shader] = &[&RODS];

/// The solver on a GPU, if `solver` is XPBD.
pub(crate) fn of(solver: &Solver<f32>) -> Option<Box<dyn GpuSolver>> {
    let params = solver.params::<XpbdParams>()?.clone();
    Some(Box::new(GpuXpbd { params, groups: Vec::new() }))
}

#[derive(Debug)]
struct GpuXpbd {
    params: XpbdParams,
    /// One a batch.
    groups: Vec<Bound<RodBindings<'static>>>,
}

impl GpuSolver for GpuXpbd {
    fn bind(&mut self, gpu: &Gpu, strands: DeviceStrands<'_>, _: &Solids, winds: Option<&[wgpu::Buffer]>) {
        let shared = strands.shared;
        let bound = strands.batches.iter().enumerate().map(|(number, batch)| {
            let bindings = RodBindings {
                frame: &shared.frame,
                substep: &shared.substeps,
                blocks: &batch.blocks,
                model: &batch.model,
                strands: &batch.strands,
                positions: &batch.positions,
                velocities: &batch.velocities,
                scratch: &shared.scratch,
                // Without a wind field kernels do not read it, but WebGPU wants a buffer.
                wind: winds.map_or(&batch.strands, |winds| &winds[number]),
                channels: &batch.channels,
            };
            bindings.bind(gpu, batch.threads)
        });
        self.groups = bound.collect();
    }

    fn write_terms(&self, dt_secs: f64, uniform: &mut FrameUniform) {
        let terms = LaneSolver::terms(&self.params, dt_secs);
        uniform.stretch_compliance = terms.stretch as f32;
        // So large that a strand of the least stiffness is still in the range of float32.
        uniform.bend_compliance = terms.bend_twist.min(SOFTEST * LEAST_STIFFNESS) as f32;
        uniform.rotation_weight = terms.rotation_weight as f32;
        uniform.keep = terms.keep as f32;
        uniform.iterations = terms.iterations;
        *uniform = uniform.with_flags(&[(terms.bend_twist.is_finite(), flags::BENDS)]);
    }

    fn solve<'a>(&'a self, list: &mut DispatchList<'a>, batch: &SolveBatch<'a>, substep: u32) {
        list.push(self.groups[batch.batch].dispatch(&SOLVE_RODS, &[substep]));
    }
}
