//! SPH as an interaction of a simulation.

use super::Sph;
use super::find_neighbours::SearchReal;
use crate::frame::{Exchange, ExchangeContext, FrameReport, Interaction, Moves, Phase, shared_secs};
use crate::lane::Simd;
use crate::strands::{Model, State};

/// The exchange that SPH adds to the plan of a frame.
pub const EXCHANGE: Exchange = Exchange {
    name: "sph",
    stage: "find_neighbours",
    phase: Phase::BeforeStrands,
    moves: Moves::Velocities,
    records_start: false,
    repeats: false,
};

impl<T: SearchReal> Interaction<T> for Sph<T> {
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
        report.sph = self.push(state, cx.dt_secs);
        let stages = ["find_neighbours", "push_particles"];
        let timed = stages.into_iter().zip(report.sph.secs);
        timed.for_each(|(name, secs)| report.stages.add(name, shared_secs(secs)));
    }

    fn rebuild(&mut self, model: &Model<T>, simd: Simd) {
        *self = Self::new(model, self.params(), simd);
    }

    fn bytes(&self) -> usize {
        Self::bytes(self)
    }
}
