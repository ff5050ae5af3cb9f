//! Parameters of the contacts.

use crate::interaction::contact::find_contacts::SLOP;
use crate::params::{ParamsError, check};

/// Time within which friction between neighbours fades in still surroundings, seconds.
pub const CREEP_SECS: f64 = 3.0;

crate::documented! {
/// Parameters of contacts between strand segments.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct ContactParams {
    /// Minimum distance of the centre lines of two strands. Unit m, default 5e-4, range 1e-6 to
    /// 0.1. Strands that are closer at rest may come as close as they are at rest.
    pub distance: f64,
    /// Relative speed below which contacts are ignored and left to friction and the grid. Unit m/s,
    /// default 0.02, range 0 to 1000.
    pub slip: f64,
    /// Acceleration up to which friction holds hair that moves relative to its neighbours; 0 is no
    /// such friction. It fades within three seconds while head, air and colliders are still, unless
    /// sleep is off. Unit m/s², default 2, range 0 to 10000.
    pub hold: f64,
    /// Maximum number of contacts in a frame; those of the fastest approach are kept. Contacts are
    /// searched for a quarter of this number of particles, those of the largest motion relative to
    /// their neighbours. Unit contacts, default 16384, range 8 to 10000000.
    pub budget: u32,
    /// Coulomb friction between strands. No unit, default 0.3, range 0 to 100.
    pub friction: f64,
    /// Minimum length of strand over which a contact distributes its push. Unit m, default 0.05,
    /// range 0 to 10.
    pub spread: f64,
    /// Maximum number of rounds of the solve. Unit rounds, default 16, range 1 to 1000.
    pub rounds: u32,
    /// Maximum number of contacts of a segment, the first in time. Unit contacts, default 128,
    /// range 1 to 1024.
    pub per_segment: u32,
}
}

impl Default for ContactParams {
    fn default() -> Self {
        Self {
            distance: 5e-4,
            slip: 0.02,
            hold: 2.0,
            budget: 16_384,
            friction: 0.3,
            spread: 0.05,
            rounds: 16,
            per_segment: 128,
        }
    }
}

impl ContactParams {
    /// Approach in a frame of `dt_secs` below which contacts are ignored, metres: from `slip`, and
    /// at least a small share of the contact distance.
    pub fn slip_distance(&self, dt_secs: f64) -> f32 {
        ((self.slip * dt_secs) as f32).max(SLOP * self.distance as f32)
    }

    /// Seconds within which friction fades in still surroundings; 0 without friction.
    pub fn settle_secs(&self) -> f64 {
        if self.hold > 0.0 { CREEP_SECS } else { 0.0 }
    }

    /// Acceleration up to which friction holds hair whose surroundings have been still for
    /// `calm_secs`, m/s².
    pub fn hold_after(&self, calm_secs: f64) -> f64 {
        self.hold * (1.0 - calm_secs / CREEP_SECS).clamp(0.0, 1.0)
    }

    /// Checks every parameter against its range.
    ///
    /// # Errors
    /// [`ParamsError::Range`] for the first parameter that is out of range.
    pub fn validate(&self) -> Result<(), ParamsError> {
        Ok(check::<Self, f64>(&[
            ("distance", &[self.distance]),
            ("slip", &[self.slip]),
            ("hold", &[self.hold]),
            ("budget", &[self.budget.into()]),
            ("friction", &[self.friction]),
            ("spread", &[self.spread]),
            ("rounds", &[self.rounds.into()]),
            ("per_segment", &[self.per_segment.into()]),
        ])?)
    }
}
