//! Stages: what happens to a block of strands in a step. Each is one lane-generic text with its equations beside it.

pub mod resolve_solids;
pub mod restore_lengths;
pub mod solve_strands;
