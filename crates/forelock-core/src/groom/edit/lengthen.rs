//! Extending strands, and changing their number of particles.
//!
//! # Theory
//! The bend at each particle and the torsion at each edge are measured in the last half of a strand
//! (the discrete Frenet frame: the angle between edges, and the angle between the planes that
//! neighbouring edges span). Beyond the tip they are repeated from the tip backwards, and forwards
//! again at the end of that half. So a helix continues as the same helix, a wave as a wave, a
//! circular arc as the arc.

use glam::{DQuat, DVec3};

use super::EditError;
use super::chain::Chain;
use super::change::{Change, Particle};
use super::error::check;
use crate::groom::Groom;
use crate::groom::resample::respaced;

/// Maximum number of particles of a strand.
const MOST_PARTICLES: usize = 1000;

crate::documented! {
/// `lengthen`: extends strands, continuing their curl.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct Lengthen {
    /// Length added to each strand. Unit m, default 0, range 0 to 1000; 0 adds nothing.
    pub by: f32,
    /// Factor on each strand's length, applied before `by`. No unit, default 1, range 1 to 1000; 1
    /// adds nothing.
    pub factor: f32,
}
}

impl Default for Lengthen {
    fn default() -> Self {
        Self { by: 0.0, factor: 1.0 }
    }
}

impl Lengthen {
    pub(super) fn validate(&self) -> Result<(), EditError> {
        check::<Self>(&[("by", &[self.by]), ("factor", &[self.factor])])
    }

    pub(super) fn change(&self, groom: &Groom, selected: &[bool]) -> Change {
        Change::reshaped(groom, selected, |chain| {
            let extra = chain.length() * (f64::from(self.factor) - 1.0) + f64::from(self.by);
            (extra > 0.0 && chain.length() > 0.0).then(|| longer(chain, groom, extra))
        })
    }
}

/// The strand extended by `extra` metres: with new edges as long as those of its last half, or by a
/// longer last edge if `extra` is less than half of such an edge.
fn longer(chain: &Chain, groom: &Groom, extra: f64) -> Vec<Particle> {
    let old = groom.strand(chain.strand);
    let edges = chain.lengths.len();
    let window = &chain.lengths[edges / 2..];
    let usual = window.iter().sum::<f64>() / window.len() as f64;
    let mut particles: Vec<Particle> =
        old.iter().enumerate().map(|(i, &position)| Particle { position, edge: i, fraction: 0.0 }).collect();
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "bounded by `min` and not negative"
    )]
    let new = (extra / usual).round().min(MOST_PARTICLES as f64 * 4.0) as usize;
    if new == 0 {
        let tip =
            chain.points[edges] + (chain.points[edges] - chain.points[edges - 1]).normalize_or_zero() * extra;
        particles[edges].position = tip.as_vec3();
        return particles;
    }
    let step = extra / new as f64;
    let mut at = old[edges].as_dvec3();
    for direction in continuation(chain, usual, step).take(new) {
        let position = (at + direction * step).as_vec3();
        // Continue from the position as rounded to float32.
        at = position.as_dvec3();
        particles.push(Particle { position, edge: edges, fraction: 0.0 });
    }
    if particles.len() <= MOST_PARTICLES.max(old.len()) {
        return particles;
    }
    let points: Vec<_> = particles.iter().map(|particle| particle.position).collect();
    let most = MOST_PARTICLES.max(old.len());
    let edge_of = |edge: usize, fraction: f32| if edge >= edges { (edges, 0.0) } else { (edge, fraction) };
    let respaced = respaced(&points, most).into_iter().map(|(position, edge, fraction)| {
        let (edge, fraction) = edge_of(edge, fraction);
        Particle { position, edge, fraction }
    });
    respaced.collect()
}

/// Directions of further edges, which continue the bend and torsion of the strand's last half.
fn continuation(chain: &Chain, usual: f64, step: f64) -> impl Iterator<Item = DVec3> + use<> {
    let directions: Vec<DVec3> = chain.directions().into_iter().filter(|d| *d != DVec3::ZERO).collect();
    let first = (directions.len() / 2).min(directions.len().saturating_sub(4));
    let last = directions.get(first..).unwrap_or_default().to_vec();
    let mut direction = last.last().copied().unwrap_or(DVec3::Y);
    let mut binormal = direction.any_orthonormal_vector();
    let mut binormals: Vec<DVec3> = Vec::with_capacity(last.len());
    let mut bends = Vec::with_capacity(last.len());
    for pair in last.windows(2) {
        let cross = pair[0].cross(pair[1]);
        bends.push(cross.length().atan2(pair[0].dot(pair[1])));
        binormals
            .push(cross.try_normalize().unwrap_or_else(|| binormals.last().copied().unwrap_or(binormal)));
    }
    if let Some(end) = binormals.last() {
        binormal = *end;
    }
    // Torsion k is the angle between binormals k and k + 1, about the edge that both share.
    let torsions: Vec<f64> = binormals
        .windows(2)
        .enumerate()
        .map(|(k, pair)| last[k + 1].dot(pair[0].cross(pair[1])).atan2(pair[0].dot(pair[1])))
        .collect();
    // Bends were measured on edges of the usual length; new edges may be slightly longer or
    // shorter.
    let scale = step / usual;
    let mut index = 0usize;
    std::iter::from_fn(move || {
        let torsion = reflected(&torsions, index) * scale;
        let bend = reflected(&bends, index) * scale;
        index += 1;
        binormal = (DQuat::from_axis_angle(direction, torsion) * binormal)
            .reject_from(direction)
            .normalize_or(binormal);
        direction = (DQuat::from_axis_angle(binormal, bend) * direction).normalize();
        Some(direction)
    })
}

/// Entry `k` from the end of `values`, reflected at both ends; 0 if there are none.
fn reflected(values: &[f64], k: usize) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let k = k % (2 * values.len());
    let from_end = if k < values.len() { k } else { 2 * values.len() - 1 - k };
    values[values.len() - 1 - from_end]
}

crate::documented! {
/// `resample`: the same curves with another number of particles, equally spaced.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct Resample {
    /// Number of particles of each strand. Unit particles, default 25, range 2 to 1000.
    pub particles: u32,
}
}

impl Default for Resample {
    fn default() -> Self {
        Self { particles: 25 }
    }
}

impl Resample {
    pub(super) fn validate(&self) -> Result<(), EditError> {
        check::<Self>(&[("particles", &[self.particles as f32])])
    }

    pub(super) fn change(&self, groom: &Groom, selected: &[bool]) -> Change {
        let count = self.particles as usize;
        Change::reshaped(groom, selected, |chain| {
            if chain.length() < f64::from(f32::MIN_POSITIVE) {
                return None;
            }
            let samples = respaced(groom.strand(chain.strand), count).into_iter();
            Some(samples.map(|(position, edge, fraction)| Particle { position, edge, fraction }).collect())
        })
    }
}
