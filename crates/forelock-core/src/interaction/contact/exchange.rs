//! Contacts between strands, with friction between neighbours, as an interaction of a simulation:
//! two exchanges that share their buffers.

use super::{ContactMoment, ContactParams, Contacts, ParticleRows};
use crate::frame::{
    Exchange, ExchangeContext, FrameReport, Interaction, Moves, Phase, shared_secs, with_motion,
};
use crate::lane::{Real, Row, Simd};
use crate::strands::{Model, State};

/// The exchange that contacts add to the plan of a frame.
pub const EXCHANGE: Exchange = Exchange {
    name: "contacts",
    stage: "find_contacts",
    phase: Phase::AfterStrands(1),
    moves: Moves::Edges,
    records_start: true,
    repeats: true,
};

/// The exchange that friction between neighbouring hair adds to the plan of a frame.
pub const FRICTION: Exchange = Exchange {
    name: EXCHANGE.name,
    stage: "hold_hair",
    phase: Phase::BeforeLengths(1),
    moves: Moves::Particles,
    records_start: true,
    repeats: true,
};

/// Contacts, and a buffer for the velocities of the hair.
#[derive(Debug)]
pub(crate) struct ContactInteraction<T> {
    contacts: Contacts,
    motion: Vec<Row<T>>,
}

impl<T: Real> ContactInteraction<T> {
    /// Creates the contacts for the strands of `model`; the search uses the instruction set `simd`.
    pub fn new(model: &Model<T>, params: &ContactParams, simd: Simd) -> Self {
        Self { contacts: Contacts::new(model, params, simd), motion: Vec::new() }
    }
}

/// What contacts need of the frame of `cx`.
fn moment<'a, T>(cx: &'a ExchangeContext<'_, T>) -> ContactMoment<'a> {
    ContactMoment { head: &cx.last_substep[1], clamped: cx.clamped, dt_secs: cx.dt_secs }
}

impl<T: Real> Interaction<T> for ContactInteraction<T> {
    fn exchange_plan(&self) -> Exchange {
        EXCHANGE
    }

    fn record_start(&mut self, cx: &ExchangeContext<'_, T>, state: &State<T>) {
        self.contacts.record_start(cx.model, &state.positions, &cx.start);
    }

    fn exchange(
        &mut self,
        cx: &ExchangeContext<'_, T>,
        state: &mut State<T>,
        moved: &mut [bool],
        report: &mut FrameReport,
    ) {
        let Self { contacts, motion } = self;
        let moment = moment(cx);
        let mut contact_report = contacts.find(cx.model, &state.positions, &moment);
        if contact_report.contacts > 0 {
            // Moved out while the rest of the state is borrowed.
            let mut clearance = std::mem::take(&mut state.clearance);
            contact_report = with_motion(state, motion, cx.h(), |positions, velocities| {
                let rows = ParticleRows { positions, velocities, clearance: &mut clearance };
                contacts.resolve_found(cx.model, rows, &moment, contact_report)
            });
            state.clearance = clearance;
            contacts.moved_blocks().for_each(|block| moved[block] = true);
        }
        report.strand_contacts = report.strand_contacts.then(contact_report);
        let stages = ["find_contacts", "resolve_contacts"];
        stages
            .into_iter()
            .zip(contact_report.secs)
            .for_each(|(name, secs)| report.stages.add(name, shared_secs(secs)));
    }

    fn early_exchange(&self) -> Option<Exchange> {
        (self.contacts.params().hold > 0.0).then_some(FRICTION)
    }

    fn exchange_early(
        &mut self,
        cx: &ExchangeContext<'_, T>,
        state: &mut State<T>,
        report: &mut FrameReport,
    ) {
        let clock = std::time::Instant::now();
        let held = self.contacts.params().hold_after(cx.calm_secs);
        if held > 0.0 {
            // Only changes are added, so velocities may hold more than motion.
            let State { positions, velocities, clearance, .. } = state;
            let rows = ParticleRows { positions, velocities, clearance };
            self.contacts.hold(cx.model, rows, &moment(cx), held);
        }
        report.stages.add(FRICTION.stage, shared_secs(clock.elapsed().as_secs_f64()));
    }

    fn each_in_contact(&self, visit: &mut dyn FnMut(u32)) {
        for contact in self.contacts.resolved() {
            contact.particles().into_iter().for_each(|(particle, _)| visit(particle));
        }
    }

    fn settle_secs(&self) -> f64 {
        self.contacts.params().settle_secs()
    }

    fn rebuild(&mut self, model: &Model<T>, simd: Simd) {
        self.contacts = Contacts::new(model, self.contacts.params(), simd);
    }

    fn bytes(&self) -> usize {
        self.contacts.bytes() + size_of_val(&*self.motion)
    }
}
