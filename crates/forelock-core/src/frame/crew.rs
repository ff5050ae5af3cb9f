//! Blocks of strands over the threads of the pool.

use super::context::FrameContext;
use super::finish::Finish;
use super::plan::Step;
use super::report::BlockReport;
use super::roots::FRAME_ROWS;
use super::sleep::{RestRows, Stillness};
use super::solver::{Solver, SolverReal};
use crate::lane::{Real, Row};
use crate::strands::{AIR_ROWS, Block, BlockChannels, BlockView, Model, Scratch, State, number, sleeps};
use glam::DVec3;
use std::sync::{Mutex, PoisonError};

/// Stretch of an edge from which it counts as stretched by colliders. The length pass leaves less,
/// so it would change edges below it by rounding only.
const STRETCHED: f64 = 2e-5;

/// What has happened to the edges of each block since the last substep.
#[derive(Debug)]
pub(crate) struct EdgeFlags {
    /// Whether an interaction has moved them.
    pub moved: Vec<bool>,
    /// Whether colliders have stretched them after the length pass.
    stretched: Vec<bool>,
}

impl EdgeFlags {
    /// Of so many blocks, in which nothing has happened.
    pub fn new(blocks: usize) -> Self {
        Self { moved: vec![false; blocks], stretched: vec![false; blocks] }
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        self.moved.len() + self.stretched.len()
    }
}

/// Runs consecutive strand steps on all blocks. Threads halve the list of blocks recursively;
/// nothing is allocated, and no result depends on which thread ran which block.
#[derive(Debug)]
pub(crate) struct Crew<'a, T> {
    /// The solver.
    pub solver: &'a Solver<T>,
    /// The frame.
    pub cx: FrameContext<'a, T>,
    /// The strands.
    pub model: &'a Model<T>,
    /// Scratch of each thread.
    pub scratch: &'a [Mutex<Scratch<T>>],
    /// Share of the wind that reaches each particle; empty: all of it.
    pub exposure: &'a [Row<T>],
    /// Acceleration of each particle in addition to gravity; empty: none.
    pub acceleration: &'a [Row<T>],
    /// Motion of each strand relative to the head, [`FRAME_ROWS`] a block; empty: none.
    pub root_frames: &'a [Row<T>],
    /// When strands are still, and the friction on them, if that is measured.
    pub stillness: Option<Stillness<T>>,
}

impl<T: SolverReal> Crew<'_, T> {
    /// Runs `steps`, all of strands that are awake. If an interaction has `moved` edges of a block,
    /// edges are restored there, and in the blocks that colliders have stretched since. Where
    /// stillness is measured, `start` holds the positions at the frame's start.
    pub fn run(
        &self,
        steps: &[Step],
        edges: &mut EdgeFlags,
        state: &mut State<T>,
        start: &mut [Row<T>],
    ) -> BlockReport {
        let substeps = steps.iter().take_while(|step| step.is_of_substep()).count();
        let (substeps, rest) = steps.split_at(substeps);
        let finish = [false, true].map(|moved| Finish::of(rest, self.cx.substeps, moved));
        let EdgeFlags { moved, stretched } = edges;
        let any_moved = moved.contains(&true);
        let work = BlockWork { substeps, finish, moved, any_moved };
        if substeps.is_empty() && !finish.iter().any(|own| own.is_any()) {
            return BlockReport::default();
        }
        self.halve(&work, &self.model.blocks, 0, Arrays::of(state, start, stretched))
    }

    fn halve(
        &self,
        work: &BlockWork<'_>,
        blocks: &[Block],
        index: usize,
        arrays: Arrays<'_, T>,
    ) -> BlockReport {
        match blocks {
            [] => BlockReport::default(),
            [block] => self.run_block(work, block, index, arrays),
            _ => {
                let middle = blocks.len() / 2;
                let (left, right) = blocks.split_at(middle);
                let (left_arrays, right_arrays) = arrays.split(middle, right[0].first - left[0].first);
                let (a, b) = rayon::join(
                    || self.halve(work, left, index, left_arrays),
                    || self.halve(work, right, index + middle, right_arrays),
                );
                a.merge(b)
            }
        }
    }

    fn run_block(
        &self,
        work: &BlockWork<'_>,
        block: &Block,
        index: usize,
        arrays: Arrays<'_, T>,
    ) -> BlockReport {
        let [still_secs] = arrays.still_secs else { return BlockReport::default() };
        let [stretched] = arrays.stretched else { return BlockReport::default() };
        *stretched &= work.substeps.is_empty();
        let restores = work.any_moved && (work.moved[index] || *stretched);
        let finish = work.finish[usize::from(restores)];
        let begins = work.substeps.contains(&Step::Solve { substep: 0 });
        if sleeps(still_secs) {
            if begins {
                [arrays.positions, arrays.previous].into_iter().for_each(|rows| shift(rows, self.cx.shift));
            }
            return BlockReport::default();
        }
        if begins && self.stillness.is_some() {
            arrays.start.copy_from_slice(arrays.positions);
            shift(arrays.start, self.cx.shift);
        }
        let rows = 3 * block.first..3 * (block.first + block.particles);
        let worker = rayon::current_thread_index().unwrap_or(0) % self.scratch.len();
        let mut scratch = self.scratch[worker].lock().unwrap_or_else(PoisonError::into_inner);
        let mut air = scratch.take_air();
        let blown = if self.cx.air.is_some() { block.particles } else { 0 };
        let (wind, rest) = air[..AIR_ROWS * blown].split_at_mut(3 * blown);
        let (drawn, drag) = rest.split_at_mut(3 * blown);
        let mut view = BlockView {
            particles: block.particles,
            rest: &self.model.rest[rows.clone()],
            root_frames: self
                .root_frames
                .get(FRAME_ROWS * index..FRAME_ROWS * (index + 1))
                .unwrap_or_default(),
            rest_lengths: &self.model.rest_lengths[rows.clone()],
            inverse_edges: &self.model.inverse_edges[block.range()],
            local: self.model.local.get(rows.clone()).unwrap_or_default(),
            strand_length: &self.model.strand_lengths[index],
            stiffness: &self.model.stiffness[index],
            masses: self.model.masses.get(block.range()).unwrap_or_default(),
            least_mass: self.model.least_mass,
            acceleration: self.acceleration.get(rows.clone()).unwrap_or_default(),
            positions: arrays.positions,
            previous: arrays.previous,
            velocities: arrays.velocities,
            integrity: arrays.integrity,
            clearance: arrays.clearance,
            extra: arrays.extra,
            exposure: self.exposure.get(block.range()).unwrap_or_default(),
            wind,
            air: drawn,
            drag,
        };
        let mut report = BlockReport::default();
        if !work.substeps.is_empty() {
            report = self.solver.advance(&self.cx, work.substeps, &mut view, block.live, &mut scratch);
        }
        if finish.is_any() {
            let after = T::run(&finish, &self.cx, &mut view, block.live, &mut scratch);
            if finish.lengths {
                *stretched = after.max_edge_stretch_final > STRETCHED;
            }
            report = report.finished(after, finish.lengths || finish.collides);
        }
        if let Some(stillness) = self.stillness.filter(|_| finish.checks) {
            let BlockView { positions, velocities, previous, clearance, .. } = &mut view;
            let mut rows = RestRows { positions, velocities, previous, clearance };
            stillness.advance(still_secs, arrays.start, &mut rows);
        }
        scratch.put_air(air);
        report
    }
}

/// Adds `shift` to positions.
fn shift<T: Real>(positions: &mut [Row<T>], shift: DVec3) {
    if shift == DVec3::ZERO {
        return;
    }
    let shift = shift.to_array().map(number::<T>);
    for rows in positions.as_chunks_mut::<3>().0 {
        for (row, shift) in rows.iter_mut().zip(shift) {
            row.0.iter_mut().for_each(|x| *x = *x + shift);
        }
    }
}

/// What is to be done with a block.
struct BlockWork<'a> {
    substeps: &'a [Step],
    /// The steps after substeps: of blocks whose edges are as the length pass left them, and of the
    /// others, if an interaction moved any.
    finish: [Finish; 2],
    /// As of [`EdgeFlags`].
    moved: &'a [bool],
    /// Whether any of `moved` is set.
    any_moved: bool,
}

/// The state's arrays, or the part of them that some blocks own.
struct Arrays<'a, T> {
    positions: &'a mut [Row<T>],
    velocities: &'a mut [Row<T>],
    integrity: &'a mut [Row<T>],
    clearance: &'a mut [Row<T>],
    /// Empty, or as long as the positions.
    previous: &'a mut [Row<T>],
    extra: BlockChannels<'a, T>,
    /// A row a block.
    still_secs: &'a mut [Row<T>],
    /// As of [`EdgeFlags`].
    stretched: &'a mut [bool],
    /// Empty, or as long as the positions.
    start: &'a mut [Row<T>],
}

impl<'a, T: Real> Arrays<'a, T> {
    fn of(state: &'a mut State<T>, start: &'a mut [Row<T>], stretched: &'a mut [bool]) -> Self {
        Self {
            positions: &mut state.positions,
            velocities: &mut state.velocities,
            integrity: &mut state.integrity,
            clearance: &mut state.clearance,
            previous: &mut state.previous,
            extra: state.extra.all(),
            still_secs: &mut state.sleep.still_secs,
            stretched,
            start,
        }
    }

    /// The arrays of the first `blocks` blocks, which have `places` places, and of the others.
    fn split(self, blocks: usize, places: usize) -> (Self, Self) {
        let (positions, positions_right) = self.positions.split_at_mut(3 * places);
        let (velocities, velocities_right) = self.velocities.split_at_mut(3 * places);
        let (integrity, integrity_right) = self.integrity.split_at_mut(places);
        let (clearance, clearance_right) = self.clearance.split_at_mut(places);
        let remembered = (3 * places).min(self.previous.len());
        let (previous, previous_right) = self.previous.split_at_mut(remembered);
        let (extra, extra_right) = self.extra.split_at(places);
        let (still_secs, still_secs_right) = self.still_secs.split_at_mut(blocks);
        let (stretched, stretched_right) = self.stretched.split_at_mut(blocks);
        let recorded = (3 * places).min(self.start.len());
        let (start, start_right) = self.start.split_at_mut(recorded);
        (
            Self {
                positions,
                velocities,
                integrity,
                clearance,
                previous,
                extra,
                still_secs,
                stretched,
                start,
            },
            Self {
                positions: positions_right,
                velocities: velocities_right,
                integrity: integrity_right,
                clearance: clearance_right,
                previous: previous_right,
                extra: extra_right,
                still_secs: still_secs_right,
                stretched: stretched_right,
                start: start_right,
            },
        )
    }
}
