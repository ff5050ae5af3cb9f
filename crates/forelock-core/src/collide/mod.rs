//! Collisions of particles with solids: queries of distances, sweeps and friction.

pub mod resolve_solids;
