//! The check at the end of a frame: the largest stretch of every strand, and the quarantine of
//! strands that are not finite, which go back to their rest shape and move with the head. The CPU
//! does this in its block loop.

/// WGSL of the stage.
pub const WGSL: &str = include_str!("kernel.wgsl");
