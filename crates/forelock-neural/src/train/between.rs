//! Forces between the neighbouring strands of a window.

use super::set::{Drawn, TrainingSet};
use super::{Energies, STRANDS};
use crate::PARTICLES;
use crate::losses::adhesion::Adhesion;
use crate::losses::repulsion::Repulsion;

/// Particles of a window's strands.
const SET: usize = STRANDS * PARTICLES;

/// What holds for the strands of a window at every moment.
pub(super) struct Neighbourhood {
    repulsion: Option<Repulsion<f32>>,
    adhesion: Option<Adhesion<f32>>,
}

/// What neighbouring strands do to each other, particle by particle: `[32 × 25]`.
#[derive(Clone, Debug)]
pub(crate) struct Between {
    pub gradient: Vec<[f32; 3]>,
    /// What holds each particle.
    pub stiffness: Vec<f32>,
    pub energy: f64,
}

impl Neighbourhood {
    /// That of the strands that `drawn` names.
    pub fn new(energies: &Energies, set: &TrainingSet, drawn: &Drawn) -> Self {
        let rest = || drawn.strands.iter().flat_map(|s| set.strands[*s].rest).collect::<Vec<_>>();
        let bonds = set.run_of(drawn).and_then(|(kind, first)| Some((set.adhesion.get(kind)?, first)));
        Self {
            repulsion: energies.repulsion.map(|terms| Repulsion::new(terms, &rest())),
            adhesion: bonds.map(|(all, first)| all.of_strands(first, STRANDS, PARTICLES)),
        }
    }

    /// Repulsion and adhesion at `x`, `[32 × 25]` in canonical space.
    pub fn at(&self, x: &[[f32; 3]]) -> Between {
        let (mut gradient, mut stiffness) = (vec![[0.0; 3]; SET], vec![0.0; SET]);
        let mut energy = 0.0;
        if let Some(own) = &self.repulsion {
            energy += own.energy(x, &mut gradient, &mut stiffness);
        }
        if let Some(own) = &self.adhesion {
            energy += own.energy(x, &mut gradient, &mut stiffness);
        }
        Between { gradient, stiffness, energy: energy.into() }
    }
}
