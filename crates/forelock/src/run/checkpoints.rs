//! When a run saves its state.

use std::time::{Duration, Instant};

/// The least and the most time between two checkpoints.
const INTERVAL: [Duration; 2] = [Duration::from_millis(250), Duration::from_secs(4)];

/// Time between two checkpoints, in times of what one takes, so that they cost a hundredth of a
/// run. Where that would be longer than the longest interval, they may cost a twentieth.
const COST: [u32; 2] = [100, 20];

/// The clock of a run's checkpoints.
#[derive(Debug)]
pub(super) struct Checkpoints {
    last: Instant,
    cost: Duration,
}

impl Checkpoints {
    /// The clock at the start of a run.
    pub fn begin() -> Self {
        Self { last: Instant::now(), cost: Duration::ZERO }
    }

    /// Whether it is time for a checkpoint.
    pub fn are_due(&self) -> bool {
        self.last.elapsed() >= self.interval()
    }

    fn interval(&self) -> Duration {
        let [wanted, least] = COST.map(|times| self.cost * times);
        wanted.clamp(INTERVAL[0], INTERVAL[1]).max(least)
    }

    /// A checkpoint that began at `started` is done.
    pub fn done(&mut self, started: Instant) {
        self.last = Instant::now();
        self.cost = self.last - started;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn costly_checkpoints_are_rare_but_not_too_rare() {
        for (cost_ms, interval_ms) in [(0, 250), (10, 1000), (30, 3000), (100, 4000), (500, 10_000)] {
            let cost = Duration::from_millis(cost_ms);
            let clock = Checkpoints { last: Instant::now(), cost };
            assert_eq!(clock.interval(), Duration::from_millis(interval_ms), "{cost_ms}");
        }
        assert!(!Checkpoints::begin().are_due());
    }
}
