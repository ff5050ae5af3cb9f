//! Sleep: for how long each strand has been still, and which strands sleep.
//!
//! # Theory
//! A strand is still in a frame if none of its particles moves, relative to the head, by more than
//! the sleep speed times the frame's length. This is measured only while the head and gravity are
//! those of [`SleepPlace`]. A strand that is still for [`SLEEP_SECS`] sleeps, with contacts not
//! before their friction has faded: it is not simulated until something wakes it. Once the
//! surroundings have been still for some seconds, friction brings the others to rest: see
//! `Stillness`.
//!
//! # Practice
//! The sixteen strands of a block sleep together, because they are simulated together: a block
//! falls asleep when all of them are still. The time of a strand that sleeps is infinite.

use super::{Model, SnapshotError, number};
use crate::lane::{LANES, Real, Row};
use crate::pose::Pose;
use glam::{DQuat, DVec3};

/// How long a strand is still before it sleeps, seconds.
pub const SLEEP_SECS: f64 = 1.0;

/// Where and under which load strands are still.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SleepPlace {
    /// The head's pose.
    pub head: Pose,
    /// Gravity, m/s².
    pub gravity: DVec3,
}

/// The sleep of all strands. Without a place the surroundings are not still, nor is any strand.
#[derive(Clone, Debug)]
pub struct Sleep<T> {
    /// Seconds for which each strand has been still, at most [`SLEEP_SECS`]; infinite in all lanes
    /// of a block that sleeps. A row a block.
    pub(crate) still_secs: Vec<Row<T>>,
    pub(crate) place: Option<SleepPlace>,
    /// Seconds for which head, gravity, air and colliders have been still.
    pub(crate) calm_secs: f64,
}

/// The sleep of all strands in the groom's order, if their surroundings are still.
#[derive(Clone, Debug, PartialEq)]
pub struct SleepSnapshot<T> {
    /// Seconds for which each strand has been still, `[S]`; infinite for those that sleep.
    pub still_secs: Vec<T>,
    /// Rotation x, y, z, w and translation of the head, and gravity.
    pub place: [f64; 10],
    /// Seconds for which the surroundings have been still.
    pub calm_secs: f64,
}

impl<T: Real> Sleep<T> {
    /// All strands of `model` are awake.
    pub(super) fn awake(model: &Model<T>) -> Self {
        Self { still_secs: vec![Row([T::zero(); LANES]); model.blocks.len()], place: None, calm_secs: 0.0 }
    }

    /// Wakes all strands.
    pub(crate) fn wake(&mut self) {
        self.calm_secs = 0.0;
        if self.place.take().is_some() {
            self.still_secs.fill(Row([T::zero(); LANES]));
        }
    }

    /// Wakes the strands of block `block`.
    pub(crate) fn wake_block(&mut self, block: usize) {
        self.still_secs[block] = Row([T::zero(); LANES]);
    }

    /// Whether the strands of block `block` sleep.
    pub fn is_asleep(&self, block: usize) -> bool {
        sleeps(&self.still_secs[block])
    }

    /// Strands of `model` that sleep.
    pub fn sleeping_strands(&self, model: &Model<T>) -> usize {
        let blocks = model.blocks.iter().zip(&self.still_secs);
        blocks.filter(|(_, secs)| sleeps(secs)).map(|(block, _)| block.live).sum()
    }

    /// The least time for which a strand of `model` has been still, seconds; infinite: all sleep.
    pub fn least_secs(&self, model: &Model<T>) -> T {
        let blocks = model.blocks.iter().zip(&self.still_secs);
        let all = blocks.flat_map(|(block, secs)| &secs.0[..block.live]);
        all.fold(T::infinity(), |least, secs| least.min(*secs))
    }

    /// The place where strands can be still, and the seconds for which it has been calm there.
    pub fn place(&self) -> (Option<SleepPlace>, f64) {
        (self.place, self.calm_secs)
    }

    /// All strands have been still at `place` for `secs`, infinite: they sleep; the surroundings
    /// for `calm_secs`.
    pub fn set_all(&mut self, secs: T, place: Option<SleepPlace>, calm_secs: f64) {
        (self.place, self.calm_secs) = (place, calm_secs);
        let secs = if self.place.is_some() { secs } else { T::zero() };
        self.still_secs.fill(Row([secs; LANES]));
    }

    /// Copies `other` without a new allocation.
    pub(super) fn take(&mut self, other: &Self) {
        self.still_secs.clone_from(&other.still_secs);
        (self.place, self.calm_secs) = (other.place, other.calm_secs);
    }

    /// The sleep in the groom's order; none if the surroundings are not still.
    pub(super) fn snapshot(&self, model: &Model<T>) -> Option<SleepSnapshot<T>> {
        let SleepPlace { head, gravity } = self.place?;
        let mut still_secs = vec![T::zero(); model.strand_count];
        for (block, row) in model.blocks.iter().zip(&self.still_secs) {
            for (&strand, own) in block.strands[..block.live].iter().zip(row.0) {
                still_secs[strand as usize] = own;
            }
        }
        let mut place = [0.0; 10];
        place[..4].copy_from_slice(&head.rotation.to_array());
        place[4..7].copy_from_slice(&head.translation.to_array());
        place[7..].copy_from_slice(&gravity.to_array());
        Some(SleepSnapshot { still_secs, place, calm_secs: self.calm_secs })
    }

    /// Takes the sleep of a snapshot of as many strands as `model` has; none: all are awake.
    pub(super) fn restore(&mut self, model: &Model<T>, snapshot: Option<&SleepSnapshot<T>>) {
        self.wake();
        let Some(SleepSnapshot { still_secs, place, calm_secs }) = snapshot else { return };
        let [x, y, z, w, tx, ty, tz, gx, gy, gz] = *place;
        let head = Pose { rotation: DQuat::from_xyzw(x, y, z, w), translation: DVec3::new(tx, ty, tz) };
        self.place = Some(SleepPlace { head, gravity: DVec3::new(gx, gy, gz) });
        self.calm_secs = *calm_secs;
        let longest = number::<T>(SLEEP_SECS);
        for (block, row) in model.blocks.iter().zip(&mut self.still_secs) {
            let own = block.strands.map(|strand| still_secs[strand as usize]);
            let sleep = own.iter().all(|secs| *secs == T::infinity());
            *row = Row(if sleep { own } else { own.map(|secs| secs.min(longest)) });
        }
    }

    /// Bytes held.
    pub(super) fn bytes(&self) -> usize {
        size_of_val(&*self.still_secs)
    }
}

/// Whether the strands of a block that have been still for `secs` sleep.
#[inline]
pub(crate) fn sleeps<T: Real>(secs: &Row<T>) -> bool {
    secs.0[0] == T::infinity()
}

impl<T> SleepSnapshot<T> {
    /// Checks that there is a time for each strand of `model`.
    pub(super) fn check(&self, model: &Model<T>) -> Result<(), SnapshotError> {
        let (found, expected) = (self.still_secs.len(), model.strand_count);
        if found == expected { Ok(()) } else { Err(SnapshotError { array: "still_secs", expected, found }) }
    }

    /// Bytes held.
    pub(super) fn bytes(&self) -> usize {
        size_of_val(&*self.still_secs)
    }
}
