//! Kernels of the augmented mass-spring solver.

use crate::frame::WindBindings;
use crate::kernel::{Constant, Kernel, Shader, Threads, shader};
use forelock_core::lane::ASIN_RATIO;
use forelock_core::solver::ams::solve_strands;

const CONSTANTS: &[Constant] = &[
    Constant::f32("ASIN_RATIO_0", ASIN_RATIO[0]),
    Constant::f32("ASIN_RATIO_1", ASIN_RATIO[1]),
    Constant::f32("ASIN_RATIO_2", ASIN_RATIO[2]),
    Constant::f32("ASIN_RATIO_3", ASIN_RATIO[3]),
    Constant::f32("ASIN_RATIO_4", ASIN_RATIO[4]),
];

shader! {
    /// `solve_strands`.
    SOLVE: "solve_strands", WindBindings;
    texts: [solve_strands::LINKS_WGSL, solve_strands::WGSL];
    constants: [CONSTANTS];
    kernels: {
        /// One implicit substep.
        SOLVE_STRANDS: "solve_strands", Threads::Strands;
    }
}

shader! {
    /// `solve_strands` with factors in 16 bits.
    SOLVE_HALVED: "solve_strands", WindBindings;
    texts: [solve_strands::LINKS_HALVED_WGSL, solve_strands::WGSL];
    constants: [CONSTANTS];
    kernels: {
        /// One implicit substep.
        SOLVE_STRANDS_HALVED: "solve_strands", Threads::Strands;
    }
}

pub(crate) static SHADERS: &[&Shader] = &[&SOLVE, &SOLVE_HALVED];

/// The kernel of a substep.
pub(crate) fn solve(half_factors: bool) -> &'static Kernel<WindBindings<'static>> {
    if half_factors { &SOLVE_STRANDS_HALVED } else { &SOLVE_STRANDS }
}
