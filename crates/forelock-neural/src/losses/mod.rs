//! The energies that the network is trained with (Neuralocks, Sec. 4.1 and 4.2), each with its
//! gradient with respect to canonical positions.
//!
//! # Theory
//! An energy is a sum over a strand. The equation stands at the top of each module. Gradients are
//! written out by hand; the tests compare them with finite differences and with reference results.
//!
//! # Practice
//! Energies of single strands are generic over [`Lane`]: `f64` is the specification, and training
//! runs the same text over a register of strands. Each function adds to the gradient that it is
//! given and returns the energy. Energies between strands ([`repulsion`], [`adhesion`]) are generic
//! over the scalar type.
//!
//! # Limitations
//! Strands have [`PARTICLES`] particles.

pub mod adhesion;
pub mod body;
pub mod elastic;
pub mod field;
pub mod motion;
pub mod repulsion;
pub mod style;

use crate::PARTICLES;
use forelock_core::lane::{Lane, V3};

/// Positions of one strand in each lane, or their gradient.
pub type Strand<L> = [V3<L>; PARTICLES];

/// A strand whose vectors are all zero.
pub fn zero<L: Lane>() -> Strand<L> {
    [V3::zero(); PARTICLES]
}
