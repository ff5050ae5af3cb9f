//! The kernels of each hair–hair interaction.

pub mod contact;
pub mod grid;
pub mod sph;
pub(crate) mod table;
