//! Kernels of every frame: lengths, loads and the final check; the bindings of strands; the
//! constants of every shader.

use crate::kernel::{
    CELLS_GROUP, CELLS_THREADS, Constant, LIST_THREADS, Shader, Threads, WORKGROUP, bindings, shader,
};
use crate::uniforms::{CHANNEL_KINDS, FLAGS, FrameUniform, SubstepUniform};
use forelock_core::frame::{CHANNELS_WGSL, FRAME_ROWS, LOAD_WGSL, ROOTS_WGSL, finish, restore_lengths};
use forelock_core::lane::LANES;
use forelock_core::strands::SCRATCH_ROWS;

/// Rows of the model a particle.
pub const MODEL_ROWS: u32 = 7;
/// A distance that stands for infinity, metres: WGSL has no infinities.
pub const FAR: f64 = 1e30;

/// Constants of the prelude and of what several modules share.
pub(crate) const COMMON_CONSTANTS: [&[Constant]; 2] = [
    &[
        Constant::u32("LANES", LANES as u32),
        Constant::u32("WORKGROUP", WORKGROUP),
        Constant::u32("CELLS_GROUP", CELLS_GROUP),
        Constant::u32("CELLS_THREADS", CELLS_THREADS),
        Constant::u32("LIST_THREADS", LIST_THREADS),
        Constant::u32("SCRATCH", SCRATCH_ROWS as u32),
        Constant::u32("MODEL_ROWS", MODEL_ROWS),
        Constant::f32("FAR", FAR as f32),
    ],
    &FLAGS,
];

/// Constants of the text that says where strands are at rest.
pub(crate) const ROOT_CONSTANTS: &[Constant] = &[Constant::u32("ROOT_ROWS", FRAME_ROWS as u32)];

bindings! {
    /// Strands: model, state and report.
    pub(crate) struct StrandBindings {
        0 frame: uniform(FrameUniform),
        1 substep: dynamic(SubstepUniform),
        2 blocks: read,
        3 model: read,
        5 positions: read_write,
        6 velocities: read_write,
        7 memory: read_write,
        8 scratch: read_write,
        9 report: read_write,
    }
}

bindings! {
    /// Strands and the wind at their particles.
    pub(crate) struct WindBindings {
        0 frame: uniform(FrameUniform),
        1 substep: dynamic(SubstepUniform),
        2 blocks: read,
        3 model: read,
        4 strands: read,
        5 positions: read_write,
        6 velocities: read_write,
        7 memory: read_write,
        8 scratch: read_write,
        17 wind: read,
    }
}

bindings! {
    /// Strands and channels: what a strand that is reset needs.
    pub(crate) struct CheckBindings {
        0 frame: uniform(FrameUniform),
        1 substep: dynamic(SubstepUniform),
        2 blocks: read,
        3 model: read,
        5 positions: read_write,
        6 velocities: read_write,
        7 memory: read_write,
        9 report: read_write,
        35 channels: read_write,
        36 channel_starts: read,
    }
}

shader! {
    /// `restore_lengths`.
    RESTORE: "restore_lengths", StrandBindings;
    texts: [restore_lengths::WGSL];
    constants: [&[
        Constant::u32("NEWTON_STEPS", restore_lengths::NEWTON_STEPS as u32),
        Constant::f32("AT_LIMIT", restore_lengths::AT_LIMIT as f32),
    ]];
    kernels: {
        /// Restores the length of every edge.
        RESTORE_LENGTHS: "restore_lengths", Threads::Strands;
        /// The same after contacts, where they moved hair.
        RESTORE_AGAIN: "restore_again", Threads::Strands;
    }
}

shader! {
    /// `check_strands`.
    CHECK: "check_strands", CheckBindings;
    texts: [ROOTS_WGSL, CHANNELS_WGSL, finish::WGSL];
    constants: [ROOT_CONSTANTS, CHANNEL_KINDS];
    kernels: {
        /// Measures the stretch and quarantines strands that are not finite.
        CHECK_STRANDS: "check_strands", Threads::Strands;
    }
}

shader! {
    /// The load that velocities hold in addition to the motion, under solvers that keep the
    /// positions of the step before.
    LOAD: "store_load", StrandBindings;
    texts: [LOAD_WGSL];
    constants: [];
    kernels: {
        /// Takes the load out of velocities, before hair–hair interactions and collisions.
        STORE_LOAD: "store_load", Threads::Strands;
        /// Adds it again afterwards.
        RESTORE_LOAD: "restore_load", Threads::Strands;
        /// Adds it to the motion of the positions after the collisions of a substep.
        DERIVE_VELOCITIES: "derive_velocities", Threads::Strands;
    }
}

pub(crate) static SHADERS: &[&Shader] = &[&RESTORE, &CHECK, &LOAD];
