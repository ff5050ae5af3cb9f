//! Strands that sleep, and what wakes them.
//!
//! # Theory
//! A strand that is still for a second ([`crate::strands::Sleep`]) sleeps: its particles keep their
//! places, without velocity, until something wakes it. Over that second the mean acceleration of
//! each particle is at most 2 v/T (v the sleep speed, T one second), so the forces on it other than
//! drag are out of balance by at most (2/T + c) v, c the drag rate. A strand whose softest mode has
//! the frequency ω is therefore at most (2/T + c) v/ω² from where it would come to rest: 0.08 mm
//! under AMS by default (v = 2 mm/s, c = 2 s⁻¹, ω = 10 s⁻¹).
//!
//! All strands wake when the head is no longer where they fell asleep, when gravity, parameters,
//! interactions or the set of colliders change, in wind, under an acceleration in addition to
//! gravity, at a teleport, an edit or [`Simulation::wake`]. The strands of a block wake when a
//! collider that moves comes within reach of the box around them, or when an interaction moves or
//! accelerates one of them beyond the sleep speed. They wake before the frame in which that
//! happens, or in it.
//!
//! # Practice
//! Blocks that sleep take no part in the steps of strands. If all do, the frame ends at once.
//! Without interactions each block falls asleep by itself. With interactions all strands fall
//! asleep together, since each may lean on others, once the surroundings have been still for
//! [`Interaction::settle_secs`](crate::frame::Interaction::settle_secs) too. If only some of them
//! are woken, the others take part in interactions as obstacles: what an interaction does to them
//! is undone unless it wakes them. Rest is not measured, and strands are awake, in frames that are
//! run in parts ([`Simulation::step_part`]).
//!
//! # Limitations
//! A strand that moves, however little of it, keeps the fifteen others of its block awake, and with
//! interactions all strands. Damage of ties does not heal in sleep. Under strong drag a strand may
//! fall asleep visibly before it has come to rest, by the distance above: lower the sleep speed.

use super::{Simulation, SimulationReal};
use crate::frame::{FrameInput, LastSolids, Reach, farthest_squared};
use crate::lane::{LANES, Real, Row};
use crate::strands::{Block, Model, SLEEP_SECS, State, number};

/// Buffers for sleep. What they hold can be computed again.
#[derive(Clone, Debug, Default)]
pub(super) struct Sleeper<T> {
    /// Positions at the frame's start, while stillness is measured.
    pub start: Vec<Row<T>>,
    /// Positions and velocities before an interaction, while some strands sleep.
    held: [Vec<Row<T>>; 2],
    /// The boxes around blocks that sleep, where they are known.
    boxes: Vec<Option<Reach>>,
    /// Where colliders move.
    moving: Vec<Reach>,
    last_solids: LastSolids,
}

impl<T: Real> Sleeper<T> {
    /// Bytes held.
    pub fn bytes(&self) -> usize {
        let rows = self.start.len() + self.held.iter().map(Vec::len).sum::<usize>();
        rows * size_of::<Row<T>>() + size_of_val(&*self.boxes)
    }

    /// Takes nothing for known of the frame before and of the strands that sleep.
    pub fn forget(&mut self) {
        self.boxes.clear();
        self.last_solids.forget();
    }

    /// Remembers positions and velocities before an interaction.
    pub fn hold(&mut self, state: &State<T>) {
        self.held[0].clone_from(&state.positions);
        self.held[1].clone_from(&state.velocities);
    }

    /// After an interaction: wakes strands that it moved or accelerated beyond `speed` in a frame
    /// of `dt_secs`, and undoes what it did to the others that sleep.
    pub fn release(&mut self, model: &Model<T>, state: &mut State<T>, speed: f64, dt_secs: f64) {
        let largest = [speed * dt_secs, speed].map(|x| number::<T>(x * x));
        let [positions, velocities] = &self.held;
        for (number, block) in model.blocks.iter().enumerate() {
            if !state.sleep.is_asleep(number) {
                continue;
            }
            let rows = 3 * block.range().start..3 * block.range().end;
            let before = [&positions[rows.clone()], &velocities[rows.clone()]];
            let after = [&mut state.positions[rows.clone()], &mut state.velocities[rows.clone()]];
            let beyond = |k: usize| {
                let changes = farthest_squared(before[k], after[k]);
                // What is not finite counts as beyond.
                !changes[..block.live].iter().all(|change| *change <= largest[k])
            };
            if beyond(0) || beyond(1) {
                self.start[rows].copy_from_slice(before[0]);
                state.sleep.wake_block(number);
            } else {
                after.into_iter().zip(before).for_each(|(rows, before)| rows.copy_from_slice(before));
            }
        }
    }
}

impl<T: SimulationReal> Simulation<T> {
    /// Sets the speed below which strands are still, m/s, from the next frame on; 0: no strand
    /// sleeps. See [`Options::sleep_speed`](super::Options::sleep_speed).
    pub fn set_sleep_speed(&mut self, speed: f64) {
        self.options.sleep_speed = speed;
        self.state.sleep.wake();
    }

    /// Wakes all strands: call it after a change that a simulation cannot see.
    pub fn wake(&mut self) {
        self.state.sleep.wake();
    }

    /// Strands that sleep.
    pub fn sleeping_strands(&self) -> usize {
        self.state.sleep.sleeping_strands(&self.model)
    }

    /// Before `frame`: wakes the strands that have a cause to, and returns whether stillness is
    /// measured in the frame.
    pub(super) fn prepare_sleep(&mut self, frame: &FrameInput<'_>) -> bool {
        let is_on = self.options.sleep_speed > 0.0;
        if !is_on {
            self.state.sleep.wake();
            return false;
        }
        let are_same_solids = self.workspace.sleeper.last_solids.continue_in(frame);
        let here = frame.sleep_place(&self.model);
        let sleep = &mut self.state.sleep;
        let stays = here.zip(sleep.place).is_some_and(|(here, place)| place.continues(&here, &self.model));
        if !stays || !are_same_solids {
            sleep.wake();
        }
        if here.is_none() {
            return false;
        }
        sleep.place = sleep.place.or(here);
        self.wake_by_solids(frame);
        if here.is_some_and(|here| here.is_disturbed(&self.model, &self.workspace.sleeper.moving)) {
            self.state.sleep.calm_secs = 0.0;
        }
        let rows = self.state.positions.len();
        self.workspace.sleeper.start.resize(rows, Row([T::zero(); LANES]));
        true
    }

    /// Wakes the strands within reach of colliders that move in `frame`.
    fn wake_by_solids(&mut self, frame: &FrameInput<'_>) {
        let Sleeper { boxes, moving, .. } = &mut self.workspace.sleeper;
        let State { sleep, positions, origin, .. } = &mut self.state;
        Reach::moving(frame, self.solver.rules().skin_thickness, moving);
        boxes.resize(self.model.blocks.len(), None);
        if moving.is_empty() {
            return;
        }
        for ((number, block), own) in self.model.blocks.iter().enumerate().zip(boxes) {
            if !sleep.is_asleep(number) {
                continue;
            }
            let rows = &positions[3 * block.range().start..3 * block.range().end];
            let own = *own.get_or_insert_with(|| Reach::of_rows(rows, block.live, *origin));
            if moving.iter().any(|reach| reach.meets(&own)) {
                sleep.wake_block(number);
            }
        }
    }

    /// After a frame of `dt_secs` with substeps of `h` seconds in which stillness was measured:
    /// lets strands fall asleep that have been still for long enough.
    pub(super) fn fall_asleep(&mut self, dt_secs: f64, h: f64) {
        let longest = number::<T>(SLEEP_SECS);
        let Self { model, state, workspace, interactions, .. } = self;
        state.sleep.calm_secs += dt_secs;
        let each = || model.blocks.iter().enumerate();
        let rests = |state: &State<T>, number: usize, block: &Block| {
            state.sleep.still_secs[number].0[..block.live].iter().all(|secs| *secs >= longest)
        };
        if !interactions.is_empty() {
            let has_settled = interactions.iter().all(|own| state.sleep.calm_secs >= own.settle_secs());
            if !(has_settled && each().all(|(number, block)| rests(state, number, block))) {
                return;
            }
        }
        for (number, block) in each() {
            if rests(state, number, block) && !state.sleep.is_asleep(number) {
                state.stop_block(block, h);
                state.sleep.still_secs[number] = Row([T::infinity(); LANES]);
                if let Some(own) = workspace.sleeper.boxes.get_mut(number) {
                    *own = None;
                }
            }
        }
    }
}
