//! Interactions between strands. Each folder contains the parameters, stages and WGSL of one
//! interaction.
//!
//! Interactions implement [`Interaction`]; see `docs/dev/add-an-interaction.md`.

pub mod contact;
pub mod grid;
pub mod sph;

pub use crate::frame::{Exchange, ExchangeContext, Interaction, Moves, Phase};
