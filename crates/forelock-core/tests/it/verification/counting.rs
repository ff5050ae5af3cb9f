//! A solver that counts the blocks it advances, to tell what a frame does.

use forelock_core::frame::{
    BlockReport, Channels, FrameContext, FrameRules, Refinement, Step, StepCheck, StepRate, StrandSolver,
};
use forelock_core::params::ParamsError;
use forelock_core::solver::{AmsParams, Solver};
use forelock_core::strands::{BlockView, Scratch, Strands};
use std::any::Any;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

/// AMS that counts the blocks it advances.
#[derive(Debug)]
pub struct Counting {
    solver: Solver<f32>,
    blocks: Arc<AtomicU32>,
}

/// AMS, and its count.
pub fn counting() -> (Solver<f32>, Arc<AtomicU32>) {
    let blocks = Arc::new(AtomicU32::new(0));
    let solver = (&AmsParams::default()).into();
    (Solver::new(Counting { solver, blocks: blocks.clone() }), blocks)
}

impl StrandSolver<f32> for Counting {
    fn name(&self) -> &'static str {
        "counting"
    }
    fn rules(&self) -> FrameRules {
        self.solver.rules()
    }
    fn channels(&self) -> Channels {
        self.solver.channels()
    }
    fn rate(&self) -> StepRate {
        self.solver.rate()
    }
    fn validate(&self) -> Result<(), ParamsError> {
        self.solver.validate()
    }
    fn validate_step(&self, step: &StepCheck) -> Result<(), ParamsError> {
        self.solver.validate_step(step)
    }
    fn refinement(&self) -> Option<Refinement> {
        None
    }
    fn refine(&self, strands: &Strands<'_, f32>, refinement: &Refinement) -> Vec<[f32; 3]> {
        self.solver.refine(strands, refinement)
    }
    fn advance(
        &self,
        cx: &FrameContext<'_, f32>,
        steps: &[Step],
        view: &mut BlockView<'_, f32>,
        live: usize,
        scratch: &mut Scratch<f32>,
    ) -> BlockReport {
        self.blocks.fetch_add(1, Ordering::Relaxed);
        self.solver.advance(cx, steps, view, live, scratch)
    }
    fn params(&self) -> &dyn Any {
        self
    }
}
