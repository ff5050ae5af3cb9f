//! Interactions between strands. Each is a folder with its parameters, stages and WGSL.
//!
//! The seam is [`Interaction`]; see `docs/dev/add-an-interaction.md`.

pub mod contact;
pub mod grid;
pub mod sph;

pub use crate::frame::{Exchange, ExchangeContext, Interaction, Moves, Phase};
