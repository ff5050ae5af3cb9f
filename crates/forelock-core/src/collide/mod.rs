//! Collisions of particles with solids: distance queries, continuous collision detection and
//! friction.

pub mod impact;
pub mod resolve_solids;
