//! Smoothing of hair along strands and between neighbours.

use glam::DVec3;

use super::EditError;
use super::chain::{Chain, falloff};
use super::change::Change;
use super::error::check;
use crate::groom::Groom;
use crate::groom::nearest::Nearest;

/// Maximum number of neighbours with which a strand is averaged.
const NEIGHBOURS: usize = 16;

crate::documented! {
/// `smooth`: rotates edges towards the mean of the edges around them; lengths are kept.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct Smooth {
    /// Fraction of the rotation. No unit, default 0.5, range 0 to 1; 0 does nothing.
    pub amount: f32,
    /// Distance along the strand within which edges are averaged. Unit m, default 0.01, range 0 to
    /// 1000; 0 uses the edge alone.
    pub along: f32,
    /// Distance around the root within which other strands are averaged, at the same arc length and
    /// weighted by the agreement of their directions; the 16 nearest at most. Unit m, default 0.01,
    /// range 0 to 1000; 0 uses none.
    pub across: f32,
}
}

impl Default for Smooth {
    fn default() -> Self {
        Self { amount: 0.5, along: 0.01, across: 0.01 }
    }
}

impl Smooth {
    pub(super) fn validate(&self) -> Result<(), EditError> {
        check::<Self>(&[("amount", &[self.amount]), ("along", &[self.along]), ("across", &[self.across])])
    }

    pub(super) fn change(&self, groom: &Groom, selected: &[bool]) -> Change {
        // Strands that are not selected are used as neighbours too, so that the border of a
        // selection is not visible.
        let whole = |s: usize| groom.strand(s).len() >= 2 && groom.strand(s).iter().all(|p| p.is_finite());
        let usable: Vec<usize> = (0..groom.strand_count()).filter(|&s| whole(s)).collect();
        let tree = Nearest::new(usable.iter().map(|&s| groom.strand(s)[0]));
        let reach = f64::from(self.across);
        Change::moved(groom, selected, |chain| {
            if self.amount == 0.0 {
                return None;
            }
            let mut flow = chain.smoothed_directions(self.along.into());
            let mut found = Vec::with_capacity(NEIGHBOURS + 2);
            if self.across > 0.0 {
                tree.find(groom.strand(chain.strand)[0], NEIGHBOURS + 1, self.across, &mut found);
            }
            let others = found.iter().map(|&(d, n)| (f64::from(d).sqrt(), usable[n as usize]));
            let others = others.filter(|&(_, other)| other != chain.strand);
            let others: Vec<(f64, Chain)> =
                others.map(|(d, other)| (falloff(d / reach), Chain::of(groom, other))).collect();
            add_neighbours(chain, &others, &mut flow);
            let directions = chain.directions();
            Some(chain.rebuilt(|edge, _| {
                let direction = directions[edge];
                direction.lerp(flow[edge].normalize_or(direction), self.amount.into()).normalize_or(direction)
            }))
        })
    }
}

/// Adds to each edge's direction those of `others` at the same arc length, weighted by `weight` and
/// by the agreement of the directions: hair on the other side of a parting has no effect.
fn add_neighbours(chain: &Chain, others: &[(f64, Chain)], flow: &mut [DVec3]) {
    let arcs = chain.arcs();
    let of_strand = flow.to_vec();
    for (weight, other) in others {
        let (directions, other_arcs) = (other.directions(), other.arcs());
        for (edge, sum) in flow.iter_mut().enumerate() {
            let middle = 0.5 * (arcs[edge] + arcs[edge + 1]);
            let at = other_arcs.partition_point(|&a| a <= middle);
            // A neighbour has no effect beyond its tip.
            if at < other_arcs.len() {
                let agreement = directions[at - 1].dot(of_strand[edge]).max(0.0);
                *sum += directions[at - 1] * (weight * agreement * agreement);
            }
        }
    }
}
