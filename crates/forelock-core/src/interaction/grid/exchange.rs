//! The grid as an interaction of a simulation.

use super::{Grid, GridFrame, GridMoment, GridParams};
use crate::frame::{
    Exchange, ExchangeContext, FrameReport, GridCells, Interaction, Moves, Phase, shared_secs, with_motion,
};
use crate::lane::{Real, Row, Simd};
use crate::pose::Pose;
use crate::strands::{Model, State};
use glam::{DQuat, DVec3};

/// The exchange that the grid adds to the plan of a frame.
pub const EXCHANGE: Exchange = Exchange {
    name: "grid",
    stage: "splat_segments",
    phase: Phase::BeforeLengths(0),
    moves: Moves::Particles,
    records_start: false,
    repeats: false,
};

/// The grid, and a buffer for the velocities of the hair.
#[derive(Debug)]
pub(crate) struct GridInteraction<T> {
    grid: Grid,
    motion: Vec<Row<T>>,
    /// The frame of reference of the last exchange, and its origin in the world.
    last: Option<(GridFrame, DVec3)>,
}

impl<T: Real> GridInteraction<T> {
    /// Creates a grid for the strands of `model`.
    pub fn new(model: &Model<T>, params: &GridParams) -> Self {
        Self { grid: Grid::new(model, params), motion: Vec::new(), last: None }
    }
}

impl<T: Real> Interaction<T> for GridInteraction<T> {
    fn exchange_plan(&self) -> Exchange {
        EXCHANGE
    }

    fn exchange(
        &mut self,
        cx: &ExchangeContext<'_, T>,
        state: &mut State<T>,
        _: &mut [bool],
        report: &mut FrameReport,
    ) {
        let [last, now] = &cx.last_substep;
        let moment = GridMoment {
            frame: GridFrame::new(last, now, cx.h()),
            solids: cx.solids,
            last_substep: cx.last_fraction(),
            origin: cx.origin,
            clamped: cx.clamped,
            dt_secs: cx.dt_secs,
        };
        let grid = &mut self.grid;
        // Moved out while the rest of the state is borrowed.
        let mut clearance = std::mem::take(&mut state.clearance);
        let grid_report = with_motion(state, &mut self.motion, cx.h(), |positions, velocities| {
            grid.exchange(cx.model, positions, velocities, &mut clearance, &moment)
        });
        state.clearance = clearance;
        self.last = Some((moment.frame, moment.origin));
        report.grid = grid_report;
        let stages = ["splat_segments", "solve_pressure", "gather_velocities"];
        stages
            .into_iter()
            .zip(grid_report.secs)
            .for_each(|(name, secs)| report.stages.add(name, shared_secs(secs)));
    }

    fn cells(&self) -> Option<GridCells> {
        let (frame, origin) = self.last?;
        let pose = Pose::new(DQuat::from_mat3(&frame.rotation), origin);
        Some(GridCells { pose, side: self.grid.cell(), cells: self.grid.cells().collect() })
    }

    fn rebuild(&mut self, model: &Model<T>, _: Simd) {
        (self.grid, self.last) = (Grid::new(model, self.grid.params()), None);
    }

    fn bytes(&self) -> usize {
        self.grid.bytes() + size_of_val(&*self.motion)
    }
}
