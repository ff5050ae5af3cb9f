//! Interactions between strands. Each folder contains the parameters, stages and WGSL of one
//! interaction.
//!
//! Interactions implement [`Interaction`]; see `docs/dev/add-an-interaction.md`.

pub mod contact;
pub mod grid;
pub mod sph;
mod transpose;

use crate::params::ParamsError;
use contact::ContactParams;
use grid::GridParams;
use sph::SphParams;

/// The built-in interactions of a simulation: parameters of those that are on.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Interactions {
    /// The grid.
    pub grid: Option<GridParams>,
    /// SPH.
    pub sph: Option<SphParams>,
    /// Contacts between segments.
    pub contacts: Option<ContactParams>,
}

impl Interactions {
    /// Checks every parameter against its range.
    ///
    /// # Errors
    /// [`ParamsError::Range`] for the first that is not in it.
    pub fn validate(&self) -> Result<(), ParamsError> {
        self.grid.as_ref().map_or(Ok(()), GridParams::validate)?;
        self.sph.as_ref().map_or(Ok(()), SphParams::validate)?;
        self.contacts.as_ref().map_or(Ok(()), ContactParams::validate)
    }
}

pub use crate::frame::{Exchange, ExchangeContext, Interaction, Moves, Phase};
