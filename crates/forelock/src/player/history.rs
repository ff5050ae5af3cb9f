//! States of the past in memory, from which a player goes back.

use forelock_core::strands::Snapshot;

use super::live::Live;

/// How many states of the past a player keeps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HistoryOptions {
    /// Frames from one kept state to the next, at least 1. It doubles whenever the budget is used
    /// up.
    pub every: u32,
    /// Memory for kept states, bytes. The first state is kept even if it is larger.
    pub budget_bytes: usize,
}

impl Default for HistoryOptions {
    /// A state every 30 frames, and 256 MiB for them.
    fn default() -> Self {
        Self { every: 30, budget_bytes: 256 << 20 }
    }
}

/// A state of the past.
#[derive(Clone, Debug)]
pub(super) struct Keyframe {
    pub live: Live,
    pub state: Snapshot<f32>,
}

impl Keyframe {
    fn bytes(&self) -> usize {
        let before = self.live.before.as_ref().map_or(0, |own| size_of_val(&**own));
        size_of::<Live>() + before + self.state.bytes()
    }
}

/// Kept states in order of their frames.
#[derive(Debug)]
pub(super) struct History {
    every: u32,
    budget_bytes: usize,
    kept: Vec<Keyframe>,
}

impl History {
    pub fn new(options: HistoryOptions) -> Self {
        let HistoryOptions { every, budget_bytes } = options;
        Self { every: every.max(1), budget_bytes, kept: Vec::new() }
    }

    /// Whether the state after `frame` frames is to be kept and is not.
    pub fn wants(&self, frame: u32) -> bool {
        frame.is_multiple_of(self.every) && self.kept.iter().all(|kept| kept.live.frame != frame)
    }

    /// Keeps a state.
    pub fn keep(&mut self, keyframe: Keyframe) {
        let at = self.kept.partition_point(|kept| kept.live.frame <= keyframe.live.frame);
        self.kept.insert(at, keyframe);
        while self.kept.len() > 1 && self.bytes() > self.budget_bytes {
            match self.every.checked_mul(2) {
                Some(every) => self.every = every,
                None => self.kept.truncate(1),
            }
            let (every, mut first) = (self.every, true);
            self.kept.retain(|kept| std::mem::take(&mut first) || kept.live.frame.is_multiple_of(every));
        }
    }

    /// The latest state that is not after `frame` and has at most `changes` of the timeline in it.
    pub fn at_or_before(&self, frame: u32, changes: usize) -> Option<&Keyframe> {
        let fits = |kept: &&Keyframe| kept.live.frame <= frame && kept.live.applied <= changes;
        self.kept.iter().rev().find(fits)
    }

    /// Drops states after `frame` and those with more than `changes` of the timeline in them.
    pub fn drop_after(&mut self, frame: u32, changes: usize) {
        self.kept.retain(|kept| kept.live.frame <= frame && kept.live.applied <= changes);
    }

    /// Drops all states.
    pub fn clear(&mut self) {
        self.kept.clear();
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        self.kept.iter().map(Keyframe::bytes).sum()
    }
}
