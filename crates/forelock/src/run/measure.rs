//! What a run measures of its frames: how much hair lies inside solids, and the time by the clock.
//!
//! # Practice
//! Measuring penetration takes as long as some frames of the solver where hair cuts into a mesh, so
//! it is done in every [`MEASURED_EVERY`]-th frame and in the last one. The numbers of the frames
//! depend on nothing else: every machine and every resumed run measures the same ones. The last
//! frame of a run counts in its summary only, because a longer run of the scene does not measure
//! it.

use std::time::Instant;

use glam::Vec3;

use crate::penetration::Penetration;
use crate::player::Player;

/// Frames from one measurement of penetration to the next. A prime, so that a motion that repeats
/// is measured at all of its phases.
pub const MEASURED_EVERY: u32 = 11;

/// Penetration in frame `frame` of `player`, which shows `positions`, if it is one that is
/// measured; and the milliseconds that it took.
pub(super) fn penetration(player: &Player, frame: u32, positions: &[Vec3]) -> Option<(Penetration, f64)> {
    frame.is_multiple_of(MEASURED_EVERY).then(|| {
        let started = Instant::now();
        let found = player.penetration(positions);
        (found, started.elapsed().as_secs_f64() * 1e3)
    })
}

/// A clock that tells the time from the end of a frame to the end of the next.
pub(super) struct FrameClock(Instant);

impl FrameClock {
    pub fn start() -> Self {
        Self(Instant::now())
    }

    /// Milliseconds since the last lap, or the start.
    pub fn lap_ms(&mut self) -> f64 {
        let now = Instant::now();
        let ms = now.duration_since(self.0).as_secs_f64() * 1e3;
        self.0 = now;
        ms
    }
}
