//! Kernels of the augmented mass-spring solver.

use super::{GpuSolver, SolveBatch};
use crate::frame::{ROOT_CONSTANTS, WindBindings};
use crate::kernel::DispatchList;
use crate::kernel::{Constant, Kernel, Shader, Threads, shader};
use crate::uniforms::{FrameUniform, flags};
use forelock_core::frame::{ROOTS_WGSL, Solver};
use forelock_core::lane::ASIN_RATIO;
use forelock_core::solver::ams::solve_strands::{self, FrameTerms};
use forelock_core::solver::{AmsParams, MassSpringParams};
use glam::DVec3;

const CONSTANTS: &[Constant] = &[
    Constant::f32("PIVOT_FLOOR", solve_strands::PIVOT_FLOOR as f32),
    Constant::f32("ASIN_RATIO_0", ASIN_RATIO[0]),
    Constant::f32("ASIN_RATIO_1", ASIN_RATIO[1]),
    Constant::f32("ASIN_RATIO_2", ASIN_RATIO[2]),
    Constant::f32("ASIN_RATIO_3", ASIN_RATIO[3]),
    Constant::f32("ASIN_RATIO_4", ASIN_RATIO[4]),
];

shader! {
    /// `solve_strands`.
    SOLVE: "solve_strands", WindBindings;
    texts: [ROOTS_WGSL, solve_strands::LINKS_WGSL, solve_strands::WGSL];
    constants: [CONSTANTS, ROOT_CONSTANTS];
    kernels: {
        /// One implicit substep.
        SOLVE_STRANDS: "solve_strands", Threads::Strands;
    }
}

shader! {
    /// `solve_strands` with factors in 16 bits.
    SOLVE_HALVED: "solve_strands", WindBindings;
    texts: [ROOTS_WGSL, solve_strands::LINKS_HALVED_WGSL, solve_strands::WGSL];
    constants: [CONSTANTS, ROOT_CONSTANTS];
    kernels: {
        /// One implicit substep.
        SOLVE_STRANDS_HALVED: "solve_strands", Threads::Strands;
    }
}

pub(crate) static SHADERS: &[&Shader] = &[&SOLVE, &SOLVE_HALVED];

/// The solver on a GPU, if `solver` is AMS or what is said in its terms.
pub(crate) fn of(solver: &Solver<f32>) -> Option<Box<dyn GpuSolver>> {
    let params = solver.params::<AmsParams>().cloned();
    let params = params.or_else(|| solver.params::<MassSpringParams>().map(MassSpringParams::ams))?;
    Some(Box::new(GpuAms { params }))
}

#[derive(Debug)]
struct GpuAms {
    params: AmsParams,
}

impl GpuSolver for GpuAms {
    fn write_terms(&self, dt_secs: f64, uniform: &mut FrameUniform) {
        let terms = FrameTerms::new(&self.params, dt_secs);
        let single = |x: f64| x as f32;
        uniform.k_springs = DVec3::from_array(terms.k_springs).as_vec3();
        uniform.k_integrity = single(terms.k_integrity);
        uniform.tip_scales = DVec3::from_array(terms.tip_scales).as_vec3();
        uniform.k_angular = single(terms.k_angular);
        uniform.k_altitude = single(terms.k_altitude);
        uniform.drag = single(terms.h * terms.drag);
        uniform.drag_along = single(terms.drag_along);
        uniform.drag_quadratic = single(terms.h * terms.drag_quadratic);
        if let Some(curve) = terms.non_hookean {
            uniform.elastic_limit = single(curve.elastic_limit);
            uniform.breaking_point = single(curve.breaking_point);
            uniform.breaking_width = single(curve.breaking_width);
            uniform.healing = single(curve.healing);
            uniform.healing_limit = single(curve.healing_limit);
        }
        let on = [
            (terms.tension, flags::TENSION),
            (terms.angular_edge, flags::ANGULAR_EDGE),
            (terms.angular_paper, flags::ANGULAR_PAPER),
            (terms.directional, flags::DIRECTIONAL),
            (terms.sag_free, flags::SAG_FREE),
            (terms.non_hookean.is_some(), flags::NON_HOOKEAN),
            (terms.slender, flags::SLENDER),
            (uniform.k_integrity > 0.0, flags::INTEGRITY),
            (uniform.k_altitude > 0.0, flags::ALTITUDE),
        ];
        *uniform = uniform.with_flags(&on);
    }

    fn solve<'a>(&'a self, list: &mut DispatchList<'a>, batch: &SolveBatch<'a>, substep: u32) {
        let kernel: &'static Kernel<WindBindings<'static>> =
            if batch.half_factors { &SOLVE_STRANDS_HALVED } else { &SOLVE_STRANDS };
        list.push(batch.groups.wind[batch.batch].dispatch(kernel, &[substep]));
    }
}
