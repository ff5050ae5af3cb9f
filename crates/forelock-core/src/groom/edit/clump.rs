//! Gathering strands into locks.

use super::EditError;
use super::chain::Chain;
use super::change::Change;
use super::error::check;
use super::locks::locks;
use crate::groom::Groom;
use crate::groom::grow::random::Random;

crate::documented! {
/// `clump`: moves strands towards the strand at the centre of their lock; lengths are kept.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct Clump {
    /// Smallest distance between the centres of locks. Unit m, default 0.012, range 1e-6 to 1000.
    pub spacing: f32,
    /// Fraction of the distance to the centre strand that is removed at the root. No unit, default
    /// 0, range 0 to 1; 0 does nothing there.
    pub root: f32,
    /// The same fraction at the tip; in between it is linear. No unit, default 0.7, range 0 to 1; 1
    /// joins the tips.
    pub tip: f32,
    /// Distance between a strand's tip and the centre strand beyond which the strand does not join
    /// the lock, as on the other side of a parting. Unit m, default 0.05, range 1e-6 to 1000.
    pub spread: f32,
    /// Fraction of the strands that do not join locks. No unit, default 0.02, range 0 to 1; 0
    /// includes all strands.
    pub flyaways: f32,
    /// Seed of all random numbers. No unit, default 1, range 0 or more; 0 is a valid seed.
    pub seed: u64,
}
}

impl Default for Clump {
    fn default() -> Self {
        Self { spacing: 0.012, root: 0.0, tip: 0.7, spread: 0.05, flyaways: 0.02, seed: 1 }
    }
}

impl Clump {
    pub(super) fn validate(&self) -> Result<(), EditError> {
        check::<Self>(&[
            ("spacing", &[self.spacing]),
            ("root", &[self.root]),
            ("tip", &[self.tip]),
            ("spread", &[self.spread]),
            ("flyaways", &[self.flyaways]),
        ])
    }

    pub(super) fn change(&self, groom: &Groom, selected: &[bool]) -> Change {
        let locks = locks(groom, selected, self.spacing, self.seed);
        Change::moved(groom, selected, |chain| {
            let middle = locks[chain.strand] as usize;
            let stray = Random::new(self.seed, chain.strand as u64).unit() < self.flyaways;
            if middle == chain.strand || stray {
                return None;
            }
            let middle = Chain::of(groom, middle);
            let (arcs, length, middle_arcs) = (chain.arcs(), chain.length(), middle.arcs());
            let apart = chain.points[arcs.len() - 1].distance(middle.at(&middle_arcs, length));
            if apart > self.spread.into() {
                return None;
            }
            let mut targets = chain.points.clone();
            for (target, &arc) in targets.iter_mut().zip(&arcs).skip(chain.hold) {
                let share = self.root + (self.tip - self.root) * (arc / length) as f32;
                *target = target.lerp(middle.at(&middle_arcs, arc), share.into());
            }
            Some(chain.following(&targets))
        })
    }
}
