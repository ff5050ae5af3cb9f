//! Shorter: by length, or where a shape is met.
//!
//! # Practice
//! Particles up to the cut keep their places, bit for bit; the tip lies at the cut. So a cut strand has fewer particles, and
//! its last edge may be shorter than the others. Where less than a tenth of an edge would be left, the particle before it
//! goes too, and the corner there is cut off.

use super::chain::Chain;
use super::change::{Change, Particle};
use super::error::at_least;
use super::{CutShape, EditError};
use crate::groom::Groom;
use crate::groom::grow::random::Random;

/// Least share of an edge that is left as the last one.
const LEAST_EDGE: f64 = 0.1;

/// `trim`: takes length off the tips.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct Trim {
    /// Length that no strand may exceed. Unit m, default 0, range 0 or more; 0 sets none.
    pub to: f32,
    /// Length taken off each strand. Unit m, default 0, range 0 or more; 0 takes none.
    pub by: f32,
    /// Up to so much more is taken off, drawn for each strand that is trimmed, so that tips make no ruled line. Unit m, default 0, range 0 or more; 0 is sharp.
    pub variation: f32,
    /// Length below which no strand is trimmed. Unit m, default 0.002, range 0 or more; 0 leaves nearly nothing.
    pub stub: f32,
    /// Seed of the variation. No unit, default 1; 0 is a seed like any other.
    pub seed: u64,
}

impl Default for Trim {
    fn default() -> Self {
        Self { to: 0.0, by: 0.0, variation: 0.0, stub: 0.002, seed: 1 }
    }
}

impl Trim {
    pub(super) fn validate(&self) -> Result<(), EditError> {
        at_least("to", self.to, 0.0)?;
        at_least("by", self.by, 0.0)?;
        at_least("variation", self.variation, 0.0)?;
        at_least("stub", self.stub, 0.0)
    }

    pub(super) fn change(&self, groom: &Groom, selected: &[bool]) -> Change {
        Change::reshaped(groom, selected, |chain| {
            let length = chain.length();
            let limit = if self.to > 0.0 { length.min(self.to.into()) } else { length };
            let wanted = limit - f64::from(self.by);
            if wanted >= length {
                return None;
            }
            let drawn = Random::new(self.seed, chain.strand as u64).unit();
            cut_at(chain, groom, wanted - f64::from(self.variation * drawn), self.stub)
        })
    }
}

/// `cut`: ends strands where they first meet a shape.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct Cut {
    /// What cuts: a table `plane`, `sphere`, `box`, `capsule` or `stroke`. No default.
    pub shape: CutShape,
    /// Up to so much more is taken off, drawn for each strand that is cut. Unit m, default 0, range 0 or more; 0 is sharp.
    #[cfg_attr(feature = "serde", serde(default))]
    pub variation: f32,
    /// Length below which no strand is cut. Unit m, default 0.002, range 0 or more; 0 leaves nearly nothing.
    #[cfg_attr(feature = "serde", serde(default = "stub"))]
    pub stub: f32,
    /// Seed of the variation. No unit, default 1; 0 is a seed like any other.
    #[cfg_attr(feature = "serde", serde(default = "seed"))]
    pub seed: u64,
}

/// The default of `Cut::stub`.
fn stub() -> f32 {
    Trim::default().stub
}

/// The default of `Cut::seed`.
#[cfg(feature = "serde")]
fn seed() -> u64 {
    Trim::default().seed
}

impl Cut {
    /// A sharp cut by `shape`.
    pub fn new(shape: CutShape) -> Self {
        Self { shape, variation: 0.0, stub: stub(), seed: Trim::default().seed }
    }

    pub(super) fn validate(&self) -> Result<(), EditError> {
        self.shape.validate().map_err(|e| e.under("shape"))?;
        at_least("variation", self.variation, 0.0)?;
        at_least("stub", self.stub, 0.0)
    }

    pub(super) fn change(&self, groom: &Groom, selected: &[bool]) -> Change {
        Change::reshaped(groom, selected, |chain| {
            let strand = groom.strand(chain.strand);
            let met = strand.windows(2).enumerate().find_map(|(edge, ends)| {
                self.shape.first_met(ends[0], ends[1]).map(|share| (edge, f64::from(share)))
            });
            let (edge, share) = met?;
            let arc = chain.arcs()[edge] + share * chain.lengths[edge];
            let drawn = Random::new(self.seed, chain.strand as u64).unit();
            cut_at(chain, groom, arc - f64::from(self.variation * drawn), self.stub)
        })
    }
}

/// The particles up to arc length `arc`, or to the `stub`; none if that is all of the strand.
fn cut_at(chain: &Chain, groom: &Groom, arc: f64, stub: f32) -> Option<Vec<Particle>> {
    let arcs = chain.arcs();
    let length = chain.length();
    // Even with no stub something must be left: a strand has an edge.
    let arc = arc.max(f64::from(stub)).max(1e-3 * length);
    if arc >= length {
        return None;
    }
    let edge = arcs.partition_point(|&a| a < arc).saturating_sub(1).min(chain.lengths.len() - 1);
    let share = (arc - arcs[edge]) / chain.lengths[edge];
    let kept = if share < LEAST_EDGE && edge > 0 { edge } else { edge + 1 };
    let particle = |i: usize| Particle { position: groom.strand(chain.strand)[i], edge: i, fraction: 0.0 };
    let mut particles: Vec<Particle> = (0..kept).map(particle).collect();
    particles.push(Particle {
        position: chain.points[edge].lerp(chain.points[edge + 1], share).as_vec3(),
        edge,
        #[expect(clippy::cast_possible_truncation, reason = "a fraction in [0, 1]")]
        fraction: share as f32,
    });
    Some(particles)
}
