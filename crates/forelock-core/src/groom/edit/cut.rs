//! Shortening strands by length or where they enter a shape.
//!
//! # Practice
//! Particles up to the cut keep their positions bit for bit; the tip is at the cut. So a cut strand
//! has fewer particles, and its last edge may be shorter than the others. If less than a tenth of
//! an edge would be left, the particle before the cut is removed too, which cuts off the corner
//! there.

use super::chain::Chain;
use super::change::{Change, Particle};
use super::error::check;
use super::{CutShape, EditError};
use crate::groom::Groom;
use crate::groom::grow::random::Random;

/// Smallest fraction of an edge that may be left as the last edge.
const LEAST_EDGE: f64 = 0.1;

crate::documented! {
/// `trim`: removes length at the tips.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct Trim {
    /// Maximum length of a strand. Unit m, default 0, range 0 to 1000; 0 sets no limit.
    pub to: f32,
    /// Length removed from each strand. Unit m, default 0, range 0 to 1000; 0 removes nothing.
    pub by: f32,
    /// Largest additional length removed, drawn at random for each trimmed strand, so that the tips
    /// do not form a straight line. Unit m, default 0, range 0 to 1000; 0 cuts exactly.
    pub variation: f32,
    /// Length that every strand keeps. Unit m, default 0.002, range 0 to 1000; 0 may leave almost
    /// nothing.
    pub stub: f32,
    /// Seed of the variation. No unit, default 1, range 0 or more; 0 is a valid seed.
    pub seed: u64,
}
}

impl Default for Trim {
    fn default() -> Self {
        Self { to: 0.0, by: 0.0, variation: 0.0, stub: 0.002, seed: 1 }
    }
}

impl Trim {
    pub(super) fn validate(&self) -> Result<(), EditError> {
        check::<Self>(&[
            ("to", &[self.to]),
            ("by", &[self.by]),
            ("variation", &[self.variation]),
            ("stub", &[self.stub]),
        ])
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

crate::documented! {
/// `cut`: ends strands where they first enter a shape.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct Cut {
    /// The cutting shape: a table `plane`, `sphere`, `box`, `capsule` or `stroke`. No default.
    pub shape: CutShape,
    /// Largest additional length removed, drawn at random for each cut strand. Unit m, default 0,
    /// range 0 to 1000; 0 cuts exactly.
    #[cfg_attr(feature = "serde", serde(default))]
    pub variation: f32,
    /// Length that every strand keeps. Unit m, default 0.002, range 0 to 1000; 0 may leave almost
    /// nothing.
    #[cfg_attr(feature = "serde", serde(default = "stub"))]
    pub stub: f32,
    /// Seed of the variation. No unit, default 1, range 0 or more; 0 is a valid seed.
    #[cfg_attr(feature = "serde", serde(default = "seed"))]
    pub seed: u64,
}
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
    /// A cut by `shape` without variation.
    pub fn new(shape: CutShape) -> Self {
        Self { shape, variation: 0.0, stub: stub(), seed: Trim::default().seed }
    }

    pub(super) fn validate(&self) -> Result<(), EditError> {
        self.shape.validate().map_err(|e| e.under("shape"))?;
        check::<Self>(&[("variation", &[self.variation]), ("stub", &[self.stub])])
    }

    pub(super) fn change(&self, groom: &Groom, selected: &[bool]) -> Change {
        Change::reshaped(groom, selected, |chain| {
            let strand = groom.strand(chain.strand);
            let entry = strand.windows(2).enumerate().find_map(|(edge, ends)| {
                self.shape.first_hit(ends[0], ends[1]).map(|share| (edge, f64::from(share)))
            });
            let (edge, share) = entry?;
            let arc = chain.arcs()[edge] + share * chain.lengths[edge];
            let drawn = Random::new(self.seed, chain.strand as u64).unit();
            cut_at(chain, groom, arc - f64::from(self.variation * drawn), self.stub)
        })
    }
}

/// The particles up to arc length `arc`, but at least up to `stub`; `None` if the whole strand is
/// kept.
fn cut_at(chain: &Chain, groom: &Groom, arc: f64, stub: f32) -> Option<Vec<Particle>> {
    let arcs = chain.arcs();
    let length = chain.length();
    // Even without a stub, a strand must have at least one edge.
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
