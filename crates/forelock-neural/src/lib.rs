//! Forelock's learned simulator (Neuralocks, 2025): a network of about a megabyte that moves
//! strands from the pose history of a body, trained with physical energies alone.
//!
//! Lengths are in centimetres, masses in grams and times in seconds throughout this crate: the
//! weights of the energies suit each other only in these units. Positions of strands are in
//! *canonical space*: the axes of the head joint, with a fixed origin. The world position of a
//! canonical one is `w = R x + p`.

pub mod codes;
pub mod features;
pub mod losses;
pub mod map;
pub mod measures;
pub mod model;
pub mod network;
pub mod random;
pub mod reference;
pub mod rigged;
pub mod train;
pub mod trial;

/// Particles of a strand of the network.
pub const PARTICLES: usize = 25;
/// Edges of a strand of the network.
pub const EDGES: usize = PARTICLES - 1;
