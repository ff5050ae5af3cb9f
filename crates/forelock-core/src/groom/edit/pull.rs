//! Moving hair towards a point or away from it.
//!
//! # Theory
//! Particles within the radius get a target: nearer to the point by the fraction given by the
//! falloff, or farther away towards the border of the radius. The strand is then moved to its
//! targets by FABRIK (Aristidou and Lasenby 2011): it is rebuilt from tip to root and back, each
//! edge at its length.

use glam::{DVec3, Vec3};

use super::EditError;
use super::chain::{Chain, falloff};
use super::change::Change;
use super::error::check;
use crate::groom::Groom;

/// Number of rounds from tip to root and back.
const ROUNDS: usize = 8;

crate::documented! {
/// `attract` and `repel`: moves hair towards a point or away from it; lengths are kept.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct Pull {
    /// The point. Unit m, no default, range -1e4 to 1e4 each.
    pub centre: Vec3,
    /// Distance from the point within which hair is moved. Unit m, default 0.05, range 1e-6 to
    /// 1000.
    #[cfg_attr(feature = "serde", serde(default = "radius"))]
    pub radius: f32,
    /// Fraction of the distance to the point, or to the border of the radius. No unit, default 0.5,
    /// range 0 to 1; 0 does nothing.
    #[cfg_attr(feature = "serde", serde(default = "strength"))]
    pub strength: f32,
}
}

fn radius() -> f32 {
    0.05
}
fn strength() -> f32 {
    0.5
}

impl Pull {
    /// A pull about `centre` (metres) with default values of all other parameters.
    pub fn about(centre: Vec3) -> Self {
        Self { centre, radius: radius(), strength: strength() }
    }

    pub(super) fn validate(&self) -> Result<(), EditError> {
        check::<Self>(&[
            ("centre", &self.centre.to_array()),
            ("radius", &[self.radius]),
            ("strength", &[self.strength]),
        ])
    }

    /// `sign` is 1 to attract, -1 to repel.
    pub(super) fn change(&self, groom: &Groom, selected: &[bool], sign: f64) -> Change {
        let (centre, reach) = (self.centre.as_dvec3(), f64::from(self.radius));
        Change::moved(groom, selected, |chain| {
            let mut targets = chain.points.clone();
            let mut touched = false;
            for (i, target) in targets.iter_mut().enumerate().skip(chain.hold) {
                let away = chain.points[i] - centre;
                let distance = away.length();
                if distance >= reach || self.strength == 0.0 {
                    continue;
                }
                touched = true;
                let strength = f64::from(self.strength);
                *target -= if sign > 0.0 {
                    away * (strength * falloff(distance / reach))
                } else {
                    let edge = chain.points[i] - chain.points[i - 1];
                    let aside = || edge.normalize_or(DVec3::Y).any_orthonormal_vector();
                    away.try_normalize().unwrap_or_else(aside) * (-strength * (reach - distance))
                };
            }
            // Particles that were pushed away must not be pulled back in by their strand.
            let away = |target: &DVec3| if sign < 0.0 { target.distance(centre).min(reach) } else { 0.0 };
            let least: Vec<f64> = targets.iter().map(away).collect();
            touched.then(|| reached(chain, targets, centre, &least))
        })
    }
}

/// The strand as near to `targets` as its edges allow, with each particle at least at the distance
/// `least` from `centre`.
fn reached(chain: &Chain, mut targets: Vec<DVec3>, centre: DVec3, least: &[f64]) -> Vec<DVec3> {
    let kept_away = |target: DVec3, least: f64| {
        let away = target - centre;
        if away.length() < least { centre + away.normalize_or(DVec3::Y) * least } else { target }
    };
    for _ in 0..ROUNDS {
        for i in (chain.hold..targets.len() - 1).rev() {
            let from = targets[i + 1];
            if let Some(back) = (targets[i] - from).try_normalize() {
                targets[i] = kept_away(from + back * chain.lengths[i], least[i]);
            }
        }
        targets = chain.following(&targets);
        for (target, &least) in targets.iter_mut().zip(least).skip(chain.hold) {
            *target = kept_away(*target, least);
        }
    }
    chain.following(&targets)
}
