//! Forces between the neighbouring strands of a window.

use super::set::{Drawn, TrainingSet};
use super::{Energies, STRANDS};
use crate::PARTICLES;
use crate::losses::repulsion::Repulsion;

/// Particles of a window's strands.
const SET: usize = STRANDS * PARTICLES;

/// What neighbouring strands do to each other, particle by particle: `[32 × 25]`.
#[derive(Clone, Debug)]
pub(super) struct Between {
    pub gradient: Vec<[f32; 3]>,
    /// What holds each particle.
    pub stiffness: Vec<f32>,
    pub energy: f64,
}

impl Between {
    /// Repulsion and adhesion of the strands that `drawn` names, at `x`, `[32 × 25]` in canonical
    /// space.
    pub fn new(energies: &Energies, set: &TrainingSet, drawn: &Drawn, x: &[[f32; 3]]) -> Self {
        let mut own = Self { gradient: vec![[0.0; 3]; SET], stiffness: vec![0.0; SET], energy: 0.0 };
        let Self { gradient, stiffness, .. } = &mut own;
        let mut energy = 0.0;
        if let Some(terms) = energies.repulsion {
            let rest: Vec<[f32; 3]> = drawn.strands.iter().flat_map(|s| set.strands[*s].rest).collect();
            energy += Repulsion::new(terms, &rest).energy(x, gradient, stiffness);
        }
        if let Some((kind, first)) = set.run_of(drawn)
            && let Some(adhesion) = set.adhesion.get(kind)
        {
            energy += adhesion.of_strands(first, STRANDS, PARTICLES).energy(x, gradient, stiffness);
        }
        own.energy = energy.into();
        own
    }
}
