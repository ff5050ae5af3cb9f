//! Contacts between strands as an interaction of a simulation.

use super::{ContactParams, Contacts};
use crate::frame::{
    Exchange, ExchangeContext, FrameReport, Interaction, Moves, Phase, shared_secs, with_motion,
};
use crate::lane::{Real, Row, Simd};
use crate::strands::{Model, State};

/// Contacts in a frame's plan.
pub const EXCHANGE: Exchange = Exchange {
    name: "contacts",
    stage: "find_contacts",
    phase: Phase::AfterStrands(1),
    moves: Moves::Edges,
    records_start: true,
};

/// Contacts and the buffer for velocities that hair moves with.
#[derive(Debug)]
pub(crate) struct ContactInteraction<T> {
    contacts: Contacts,
    motion: Vec<Row<T>>,
}

impl<T: Real> ContactInteraction<T> {
    /// Contacts for the strands of `model`, found with the instruction set `simd`.
    pub fn new(model: &Model<T>, params: &ContactParams, simd: Simd) -> Self {
        Self { contacts: Contacts::new(model, params, simd), motion: Vec::new() }
    }
}

impl<T: Real> Interaction<T> for ContactInteraction<T> {
    fn exchange_plan(&self) -> Exchange {
        EXCHANGE
    }

    fn record_start(&mut self, cx: &ExchangeContext<'_, T>, state: &State<T>) {
        self.contacts.note_start(cx.model, &state.positions, &cx.start);
    }

    fn exchange(
        &mut self,
        cx: &ExchangeContext<'_, T>,
        state: &mut State<T>,
        report: &mut FrameReport,
    ) -> bool {
        // Taken out for a while, for the rest of the state is borrowed.
        let mut clearance = std::mem::take(&mut state.clearance);
        let contacts = &mut self.contacts;
        let own = with_motion(state, &mut self.motion, cx.h(), |positions, velocities| {
            let rows = (positions, velocities, &mut *clearance);
            contacts.resolve(cx.model, rows, &cx.last_substep[1], (cx.clamped, cx.dt_secs))
        });
        state.clearance = clearance;
        report.strand_contacts = own;
        let stages = ["find_contacts", "resolve_contacts"];
        stages.into_iter().zip(own.secs).for_each(|(name, secs)| report.stages.add(name, shared_secs(secs)));
        own.contacts > 0
    }

    fn rebuild(&mut self, model: &Model<T>, simd: Simd) {
        self.contacts = Contacts::new(model, self.contacts.params(), simd);
    }

    fn bytes(&self) -> usize {
        self.contacts.bytes() + size_of_val(&*self.motion)
    }
}
