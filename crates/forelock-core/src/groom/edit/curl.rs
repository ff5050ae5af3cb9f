//! Curling hair and removing curls.
//!
//! # Theory
//! One turn of a helix with radius r and pitch λ has the arc length L = √(λ² + (2πr)²), and the
//! sine of the angle between its tangent and its axis is 2πr/L. So each edge t of a strand, in a
//! frame (t, n, b) that is propagated along the strand without twist (Bishop 1975), is rotated to
//! λ/L t + 2πr/L (cos φ n + sin φ b), with dφ/ds = 2π/L: a helix about the original strand, with
//! every edge at its length. A wave oscillates in one plane; a roll bends steadily towards a point,
//! as on a roller.

use std::f64::consts::TAU;

use glam::{DQuat, DVec3, Vec3};

use super::EditError;
use super::chain::{Chain, rise};
use super::change::Change;
use super::error::check;
use super::locks::locks;
use crate::groom::Groom;
use crate::groom::grow::random::{Random, sin_cos};

/// Smallest number of edges per turn that represents a curl.
const EDGES_PER_TURN: f64 = 6.0;

/// The kinds of curls.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "kebab-case"))]
pub enum CurlKind {
    /// A helix about the strand, as a corkscrew.
    #[default]
    Helix,
    /// An oscillation in one plane.
    Wave,
    /// A steady bend towards `centre`, on a circle of `radius`.
    Roll,
}

crate::documented! {
/// `curl`: curls strands; lengths are kept, so tips rise.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct Curl {
    /// Kind of curl: "helix", "wave" or "roll". Default "helix".
    pub kind: CurlKind,
    /// Strength of the curl. No unit, default 1, range -1 to 1; 0 does nothing, a negative value
    /// reverses the sense.
    pub amount: f32,
    /// Radius of a helix or roll; amplitude of a wave. Unit m, default 0.006, range 1e-6 to 1000.
    pub radius: f32,
    /// Distance along the strand's axis from one turn to the next; not used by a roll. Unit m,
    /// default 0.035, range 1e-6 to 1000.
    pub wavelength: f32,
    /// Number of turns per metre, which replaces the wavelength. Unit 1/m, default 0, range 0 to
    /// 1e6; 0 uses the wavelength.
    pub frequency: f32,
    /// Fraction of the strand at which the curl begins. No unit, default 0, range 0 to 1; 0 is the
    /// root.
    pub start: f32,
    /// Fraction of the strand at which the curl reaches its full strength. No unit, default 0.3,
    /// range 0 to 1.
    pub full: f32,
    /// Point towards which a roll bends; at each edge the point's height is that of the edge. Unit
    /// m, default the middle of the roots, range -1e4 to 1e4 each.
    #[cfg_attr(feature = "serde", serde(skip_serializing_if = "Option::is_none"))]
    pub centre: Option<Vec3>,
    /// Width of the locks whose strands curl together. Unit m, default 0.015, range 1e-6 to 1000.
    pub lock_size: f32,
    /// Coherence of the phases of the strands in a lock. No unit, default 0.8, range 0 to 1; 0
    /// gives each strand an independent phase.
    pub coherence: f32,
    /// Seed of all random numbers. No unit, default 1, range 0 or more; 0 is a valid seed.
    pub seed: u64,
}
}

impl Default for Curl {
    fn default() -> Self {
        Self {
            kind: CurlKind::Helix,
            amount: 1.0,
            radius: 0.006,
            wavelength: 0.035,
            frequency: 0.0,
            start: 0.0,
            full: 0.3,
            centre: None,
            lock_size: 0.015,
            coherence: 0.8,
            seed: 1,
        }
    }
}

impl Curl {
    pub(super) fn validate(&self) -> Result<(), EditError> {
        check::<Self>(&[
            ("amount", &[self.amount]),
            ("radius", &[self.radius]),
            ("wavelength", &[self.wavelength]),
            ("frequency", &[self.frequency]),
            ("start", &[self.start]),
            ("full", &[self.full]),
        ])?;
        self.centre.iter().try_for_each(|centre| check::<Self>(&[("centre", &centre.to_array())]))?;
        check::<Self>(&[("lock_size", &[self.lock_size]), ("coherence", &[self.coherence])])
    }

    fn wavelength(&self) -> f64 {
        if self.frequency > 0.0 { 1.0 / f64::from(self.frequency) } else { self.wavelength.into() }
    }

    /// Arc length of a turn at the fraction `share` of the radius, and the sine of the angle to the
    /// axis.
    fn turn(&self, share: f64) -> (f64, f64) {
        let around = TAU * f64::from(self.radius) * share;
        let arc = self.wavelength().hypot(around);
        (arc, around / arc)
    }

    pub(super) fn change(&self, groom: &Groom, selected: &[bool]) -> Change {
        if self.amount == 0.0 {
            return Change::moved(groom, selected, |_| None);
        }
        let locks = locks(groom, selected, self.lock_size, self.seed);
        let centre = self.centre.map_or_else(|| middle_of_roots(groom), Vec3::as_dvec3);
        let mut change = Change::moved(groom, selected, |chain| {
            Some(match self.kind {
                CurlKind::Roll => self.rolled(chain, centre),
                _ => self.wound(chain, locks[chain.strand]),
            })
        });
        let turn = match self.kind {
            CurlKind::Roll => TAU * f64::from(self.radius / self.amount.abs()),
            _ => self.turn(self.amount.abs().into()).0,
        };
        let coarse = |s: &usize| {
            let edges = groom.range(*s).len().saturating_sub(1) as f64;
            selected[*s] && f64::from(groom.length(*s)) * EDGES_PER_TURN > turn * edges
        };
        change.coarse = (0..groom.strand_count()).filter(coarse).count();
        change
    }

    /// Signed strength of the curl at fraction `at` of the strand.
    fn share(&self, at: f64) -> f64 {
        let (start, full) = (f64::from(self.start), f64::from(self.full));
        let set_in =
            if full > start { rise((at - start) / (full - start)) } else { f64::from(u8::from(at >= start)) };
        set_in * f64::from(self.amount)
    }

    fn wound(&self, chain: &Chain, lock: u32) -> Vec<DVec3> {
        let directions = chain.directions();
        let (arcs, length) = (chain.arcs(), chain.length());
        let mut of_lock = Random::new(self.seed, 2 * u64::from(lock));
        let mut of_strand = Random::new(self.seed, 2 * chain.strand as u64 + 1);
        let loose = 1.0 - f64::from(self.coherence);
        let mut phase = TAU * (f64::from(of_lock.unit()) + loose * f64::from(of_strand.signed()) * 0.5);
        let sense = if of_lock.unit() < 0.5 { -1.0 } else { 1.0 };
        let mut before = directions[0];
        // The initial frame is the same for neighbouring strands: it points as far to the front as
        // the first edge allows.
        let mut aside =
            DVec3::Z.reject_from(before).try_normalize().unwrap_or(before.any_orthonormal_vector());
        chain.rebuilt(|edge, _| {
            let along = directions[edge];
            aside = DQuat::from_rotation_arc(before, along) * aside;
            before = along;
            let share = self.share(0.5 * (arcs[edge] + arcs[edge + 1]) / length);
            let (turn, lean) = self.turn(share);
            let across = along.cross(aside);
            phase += 0.5 * TAU * chain.lengths[edge] / turn;
            let (sin, cos) = sin_cos(phase);
            phase += 0.5 * TAU * chain.lengths[edge] / turn;
            let (sin, cos) = (f64::from(sin) * sense, f64::from(cos));
            let (lean, around) = match self.kind {
                CurlKind::Wave => (lean * cos, aside),
                _ => (lean, aside * cos + across * sin),
            };
            (along * (1.0 - lean * lean).max(0.0).sqrt() + around * lean).normalize_or(along)
        })
    }

    fn rolled(&self, chain: &Chain, centre: DVec3) -> Vec<DVec3> {
        let directions = chain.directions();
        let (arcs, length) = (chain.arcs(), chain.length());
        let mut angle = 0.0;
        chain.rebuilt(|edge, _| {
            let along = directions[edge];
            let inwards = (centre - chain.points[edge]) * DVec3::new(1.0, 0.0, 1.0);
            let rate = self.share(0.5 * (arcs[edge] + arcs[edge + 1]) / length) / f64::from(self.radius);
            angle += 0.5 * rate * chain.lengths[edge];
            let (sin, cos) = sin_cos(angle);
            angle += 0.5 * rate * chain.lengths[edge];
            let Some(aside) = inwards.reject_from(along).try_normalize() else { return along };
            (along * f64::from(cos) + aside * f64::from(sin)).normalize_or(along)
        })
    }
}

/// The centre of the bounding box of all finite roots.
fn middle_of_roots(groom: &Groom) -> DVec3 {
    let roots = groom.strands().filter_map(|strand| strand.first()).filter(|p| p.is_finite());
    let (lo, hi) = roots.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(lo, hi), &p| (lo.min(p), hi.max(p)));
    if lo.x <= hi.x { ((lo + hi) * 0.5).as_dvec3() } else { DVec3::ZERO }
}

crate::documented! {
/// `straighten`: rotates edges towards the strand's smoothed direction; lengths are kept.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct Straighten {
    /// Fraction of the rotation. No unit, default 1, range 0 to 1; 0 does nothing.
    pub amount: f32,
    /// Length over which directions are averaged: finer curls are removed. Unit m, default 0.05,
    /// range 0 to 1000; 0 does nothing.
    pub reach: f32,
    /// Fraction of the strand at which straightening begins. No unit, default 0, range 0 to 1; 0 is
    /// the root.
    pub start: f32,
}
}

impl Default for Straighten {
    fn default() -> Self {
        Self { amount: 1.0, reach: 0.05, start: 0.0 }
    }
}

impl Straighten {
    pub(super) fn validate(&self) -> Result<(), EditError> {
        check::<Self>(&[("amount", &[self.amount]), ("reach", &[self.reach]), ("start", &[self.start])])
    }

    pub(super) fn change(&self, groom: &Groom, selected: &[bool]) -> Change {
        Change::moved(groom, selected, |chain| {
            let (arcs, length) = (chain.arcs(), chain.length());
            let directions = chain.directions();
            let flow = chain.smoothed_directions(self.reach.into());
            Some(chain.rebuilt(|edge, _| {
                let share = if arcs[edge] >= f64::from(self.start) * length { self.amount } else { 0.0 };
                directions[edge].lerp(flow[edge], share.into()).normalize_or(directions[edge])
            }))
        })
    }
}
