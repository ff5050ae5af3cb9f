//! The seam of interactions between strands.
//!
//! # Practice
//! An interaction holds what it needs of the model and its own buffers, and changes the state of
//! all strands at once. Its [`Exchange`] says when it runs, and the frame's plan is made from that.
//! It does not need to know whether strands are solved by forces or by constraints: [`with_motion`]
//! gives it the velocities with which hair moves.

use super::cells::GridCells;
use super::plan::Exchange;
use super::report::FrameReport;
use crate::body::ColliderFrame;
use crate::lane::{LANES, Real, Row, Simd};
use crate::pose::Pose;
use crate::strands::{Model, State, number};
use glam::DVec3;
use rayon::prelude::*;
use std::fmt::Debug;

/// What an interaction needs to know of the frame, or of the part of it since its last exchange.
#[derive(Debug)]
pub struct ExchangeContext<'a, T> {
    /// The strands.
    pub model: &'a Model<T>,
    /// The head at the start of the span, from the model's centre to where positions are then.
    pub start: Pose,
    /// The head at the start and the end of the span's last substep, from the model's centre to the
    /// frame's origin.
    pub last_substep: [Pose; 2],
    /// Colliders of the frame.
    pub solids: &'a [ColliderFrame<'a>],
    /// The point of the world that positions are relative to after strands are solved.
    pub origin: DVec3,
    /// Particles of each strand, from the root, that follow the head.
    pub clamped: usize,
    /// Substeps of the span.
    pub substeps: u32,
    /// Length of the span, seconds.
    pub dt_secs: f64,
    /// Seconds for which head, gravity, air and colliders have been still; 0 if that is not
    /// measured.
    pub calm_secs: f64,
}

impl<T> ExchangeContext<'_, T> {
    /// Length of a substep, seconds.
    pub fn h(&self) -> f64 {
        self.dt_secs / f64::from(self.substeps)
    }

    /// Where the last substep starts, as a fraction of the span.
    pub fn last_fraction(&self) -> f64 {
        1.0 - 1.0 / f64::from(self.substeps)
    }
}

/// A way in which strands interact.
pub trait Interaction<T>: Debug + Send + Sync {
    /// Its name, when it runs, and what it moves.
    fn exchange_plan(&self) -> Exchange;

    /// Records where hair is at the start of a span, if [`Exchange::records_start`].
    fn record_start(&mut self, cx: &ExchangeContext<'_, T>, state: &State<T>) {
        let _ = (cx, state);
    }

    /// Exchanges momentum between strands, and adds what it did and the times of its stages to
    /// `report`. One that moves edges ([`Moves::Edges`](super::plan::Moves::Edges)) sets the flags
    /// of the blocks in which it did, `moved`.
    fn exchange(
        &mut self,
        cx: &ExchangeContext<'_, T>,
        state: &mut State<T>,
        moved: &mut [bool],
        report: &mut FrameReport,
    );

    /// An exchange that comes earlier in the frame, if it has one; both have the same name.
    fn early_exchange(&self) -> Option<Exchange> {
        None
    }

    /// Does what [`early_exchange`](Self::early_exchange) announces.
    fn exchange_early(
        &mut self,
        cx: &ExchangeContext<'_, T>,
        state: &mut State<T>,
        report: &mut FrameReport,
    ) {
        let _ = (cx, state, report);
    }

    /// Calls `visit` with each particle of the contacts between strands that its last exchange
    /// resolved, perhaps more than once: place × [`LANES`] + lane. Of other interactions, none.
    fn each_in_contact(&self, visit: &mut dyn FnMut(u32)) {
        let _ = visit;
    }

    /// The cells that held hair in its last exchange; none of an interaction without a grid.
    fn cells(&self) -> Option<GridCells> {
        None
    }

    /// Seconds of still surroundings before which no strand falls asleep, since what the
    /// interaction does to strands at rest still changes.
    fn settle_secs(&self) -> f64 {
        0.0
    }

    /// Is built again for a model that has changed.
    fn rebuild(&mut self, model: &Model<T>, simd: Simd);

    /// Bytes held.
    fn bytes(&self) -> usize;
}

/// Seconds of work in a stage that all threads of the pool share.
pub(crate) fn shared_secs(secs: f64) -> f64 {
    #[expect(clippy::cast_precision_loss, reason = "a count of threads")]
    let threads = rayon::current_num_threads() as f64;
    secs * threads
}

/// Calls `change` with the positions of `state` and with velocities: those with which hair moved in
/// the step of `h` seconds, where the stored ones hold more than motion ([`State::previous`]).
/// `motion` is a buffer for them.
pub fn with_motion<T: Real, R>(
    state: &mut State<T>,
    motion: &mut Vec<Row<T>>,
    h: f64,
    change: impl FnOnce(&mut [Row<T>], &mut [Row<T>]) -> R,
) -> R {
    let State { positions, velocities, previous, .. } = state;
    if previous.is_empty() {
        return change(positions, velocities);
    }
    let inverse_h = number::<T>(1.0 / h);
    motion.resize(previous.len(), Row([T::zero(); LANES]));
    let rows = motion.par_iter_mut().zip(&mut *velocities).zip(positions.par_iter().zip(&*previous));
    rows.with_min_len(1024).for_each(|((u, v), (x, before))| {
        for k in 0..LANES {
            u.0[k] = (x.0[k] - before.0[k]) * inverse_h;
            v.0[k] = v.0[k] - u.0[k];
        }
    });
    let result = change(positions, motion);
    let add = |(v, u): (&mut Row<T>, &Row<T>)| (0..LANES).for_each(|k| v.0[k] = v.0[k] + u.0[k]);
    velocities.par_iter_mut().zip(&*motion).with_min_len(1024).for_each(add);
    result
}
