//! Parameters of the contacts.

use crate::solver::ParamsError;

/// Parameters of hair against hair, segment by segment.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct ContactParams {
    /// How near the middle lines of two strands may come. Unit m, default 5e-4, range 1e-6 to 0.1. Strands that lie nearer at rest may come as near as there.
    pub distance: f64,
    /// Relative speed up to which strands are let pass each other: what is slower is left to the grid. Unit m/s, default 0.01, range 0 or more.
    pub slip: f64,
    /// Contacts in a frame at most, those of the fastest approach; sought of a quarter as many segments, those that move most against their neighbours. Unit contacts, default 32768, range 4 or more.
    pub budget: u32,
    /// Coulomb friction between strands. No unit, default 0.3, range 0 or more.
    pub friction: f64,
    /// Length of strand that takes part in what a contact gives it, at least. Unit m, default 0.05, range 0 to 10.
    pub spread: f64,
    /// Rounds of the solve at most. Unit rounds, default 16, range 1 to 1000.
    pub rounds: u32,
    /// Contacts of a segment at most, the first in time. Unit contacts, default 128, range 1 to 1024.
    pub per_segment: u32,
}

impl Default for ContactParams {
    fn default() -> Self {
        Self {
            distance: 5e-4,
            slip: 0.01,
            budget: 32_768,
            friction: 0.3,
            spread: 0.05,
            rounds: 16,
            per_segment: 128,
        }
    }
}

impl ContactParams {
    /// Checks every parameter against its range.
    ///
    /// # Errors
    /// [`ParamsError::Range`] for the first that is not in it.
    pub fn validate(&self) -> Result<(), ParamsError> {
        const NON_NEGATIVE: &str = "a finite number of 0 or more";
        let (rounds, per_segment) = (f64::from(self.rounds), f64::from(self.per_segment));
        let not_negative = |x: f64| x >= 0.0 && x.is_finite();
        let checks = [
            ("distance", self.distance, "between 1e-6 and 0.1", (1e-6..=0.1).contains(&self.distance)),
            ("slip", self.slip, NON_NEGATIVE, not_negative(self.slip)),
            ("budget", self.budget.into(), "4 or more", self.budget >= 4),
            ("friction", self.friction, NON_NEGATIVE, not_negative(self.friction)),
            ("spread", self.spread, "between 0 and 10", (0.0..=10.0).contains(&self.spread)),
            ("rounds", rounds, "between 1 and 1000", (1.0..=1e3).contains(&rounds)),
            ("per_segment", per_segment, "between 1 and 1024", (1.0..=1024.0).contains(&per_segment)),
        ];
        match checks.into_iter().find(|(.., holds)| !holds) {
            Some((name, value, expected, _)) => Err(ParamsError::Range { name, value, expected }),
            None => Ok(()),
        }
    }
}
