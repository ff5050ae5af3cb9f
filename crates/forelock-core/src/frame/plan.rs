//! The order of a frame's steps, built once from the solver and the interactions and read by every
//! executor: the CPU runs consecutive strand steps of a block in one go, the GPU turns each step
//! into dispatches.

use super::rules::FrameRules;
use crate::params::{Inextensibility, ParamsError};
use std::sync::Arc;

/// When an interaction exchanges momentum.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Phase {
    /// Before strands are solved; it changes velocities only.
    BeforeStrands,
    /// After strands are solved and before the length pass, whose collisions follow what it moved;
    /// without a length pass, and with solvers that keep lengths themselves, the first after
    /// strands are solved. Lower numbers first.
    BeforeLengths(u8),
    /// After strands are solved and have their lengths; lower numbers first.
    AfterStrands(u8),
}

/// What an interaction moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Moves {
    /// Velocities only.
    Velocities,
    /// Positions a little: solvers whose lengths are exact after every step restore them once more.
    Particles,
    /// Positions, and it says each frame in which blocks: edges are restored there.
    Edges,
}

/// An interaction as a frame's plan knows it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Exchange {
    /// Its name, unique among the interactions of a simulation.
    pub name: &'static str,
    /// The first of its stages, as reports name it.
    pub stage: &'static str,
    /// When it runs.
    pub phase: Phase,
    /// What it moves.
    pub moves: Moves,
    /// Whether it records where hair is at the start of its span.
    pub records_start: bool,
    /// Whether it runs also between substeps, as often as [`FrameRules::exchange_secs`] asks for;
    /// not [`Phase::BeforeStrands`].
    pub repeats: bool,
}

/// Consecutive substeps of a frame. An exchange at the end of a span sees the motion of hair in it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Span {
    /// Its number among [`FramePlan::spans`]; 0 for the whole frame.
    pub number: u32,
    /// Number of the first substep.
    pub first: u32,
    /// Number after that of the last substep.
    pub end: u32,
}

impl Span {
    /// Number of substeps.
    pub fn substeps(&self) -> u32 {
        self.end - self.first
    }

    /// Its length in a frame of `substeps` and `dt_secs`, seconds.
    pub fn secs(&self, substeps: u32, dt_secs: f64) -> f64 {
        dt_secs * (f64::from(self.substeps()) / f64::from(substeps))
    }

    /// Span `number` of `count` equal ones, up to whole substeps, in a frame of `substeps`.
    fn of(number: u32, count: u32, substeps: u32) -> Self {
        let start = |number: u32| (u64::from(substeps) * u64::from(number) / u64::from(count)) as u32;
        Self { number, first: start(number), end: start(number + 1) }
    }

    /// A frame of `substeps` as one span.
    pub fn whole(substeps: u32) -> Self {
        Self::of(0, 1, substeps)
    }
}

/// A step of a frame, over all strands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// An interaction records where hair is at the start of a span; after an exchange, before the
    /// length pass that follows it.
    RecordStart {
        /// What the interaction does at the span's end.
        exchange: Exchange,
        /// The span.
        span: Span,
    },
    /// An interaction exchanges momentum between strands.
    Exchange {
        /// What it does.
        exchange: Exchange,
        /// The substeps since the last time, or all of the frame.
        span: Span,
    },
    /// The solver's own stage in a substep. The first one moves hair to the frame's origin.
    Solve {
        /// Number of the substep.
        substep: u32,
    },
    /// Collisions with solids at the end of a substep.
    Collide {
        /// Number of the substep.
        substep: u32,
    },
    /// The length pass, and the collisions of what it displaced.
    RestoreLengths {
        /// The substeps since the last one, or all of the frame.
        span: Span,
    },
    /// The same, where an interaction before it moved edges since the last substep; if there is
    /// such a block, also where colliders have stretched edges since the length pass.
    RestoreIfMoved {
        /// As of [`Step::RestoreLengths`].
        span: Span,
    },
    /// Collisions after interactions.
    CollideFinal {
        /// As of [`Step::RestoreLengths`].
        span: Span,
        /// Not where [`Step::RestoreIfMoved`] has resolved them.
        unless_moved: bool,
    },
    /// Stretch is measured; strands that are not finite are put back to rest.
    CheckStrands,
}

impl Step {
    /// Whether blocks of strands run it independently of each other.
    pub fn is_of_strands(&self) -> bool {
        !matches!(self, Self::RecordStart { .. } | Self::Exchange { .. })
    }

    /// Whether blocks of strands run this and the `next` step of a frame in one go: substeps, and
    /// what follows them.
    pub fn runs_with(&self, next: &Self) -> bool {
        let restarts = next.is_of_substep() && !self.is_of_substep();
        self.is_of_strands() && next.is_of_strands() && !restarts
    }

    /// Whether the solver runs it, together with the collisions of its substeps.
    pub fn is_of_substep(&self) -> bool {
        matches!(self, Self::Solve { .. } | Self::Collide { .. })
    }

    /// Whether it queries colliders; `solver_collides` if the solver's own stage does.
    pub fn collides(&self, solver_collides: bool) -> bool {
        match self {
            Self::Collide { .. }
            | Self::CollideFinal { .. }
            | Self::RestoreLengths { .. }
            | Self::RestoreIfMoved { .. } => true,
            Self::Solve { .. } => solver_collides,
            _ => false,
        }
    }
}

/// A step and the stage that it belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PlannedStep {
    /// What to do.
    pub step: Step,
    /// The stage that it counts for when a frame is divided between executors: a length pass after
    /// an interaction belongs to the interaction.
    pub stage: &'static str,
}

/// A frame as an ordered list of steps.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct FramePlan {
    /// Shared, so that an executor copies the plan without an allocation.
    steps: Arc<[PlannedStep]>,
    spans: Arc<[Span]>,
}

/// A plan under construction.
#[derive(Default)]
struct Steps(Vec<PlannedStep>);

impl Steps {
    fn push(&mut self, step: Step, stage: &'static str) {
        self.0.push(PlannedStep { step, stage });
    }
}

impl FramePlan {
    /// The plan of a frame of `substeps` under a solver with `rules` and the `interactions` of a
    /// simulation.
    pub fn new(rules: &FrameRules, substeps: u32, interactions: &[Exchange]) -> Self {
        let mut plan = Steps::default();
        let mut sorted = interactions.to_vec();
        sorted.sort_by_key(|exchange| exchange.phase);
        let restores = rules.lengths != Inextensibility::Off;
        let has_pass = restores && !rules.restores_own_lengths;
        let (before, rest) =
            sorted.split_at(sorted.partition_point(|own| own.phase < Phase::BeforeLengths(0)));
        let of_pass = |own: &Exchange| has_pass && matches!(own.phase, Phase::BeforeLengths(_));
        let (between, after) = rest.split_at(rest.partition_point(of_pass));
        let whole = Span::whole(substeps);
        let count = if rest.iter().any(|own| own.repeats) { rules.spans(substeps) } else { 1 };
        let spans: Arc<[Span]> = (0..count).map(|number| Span::of(number, count, substeps)).collect();
        let of_whole = |own: &Exchange| !own.repeats || own.phase < Phase::BeforeLengths(0);
        for exchange in sorted.iter().filter(|own| own.records_start).copied() {
            let span = if of_whole(&exchange) { whole } else { spans[0] };
            plan.push(Step::RecordStart { exchange, span }, exchange.stage);
        }
        for exchange in before.iter().copied() {
            plan.push(Step::Exchange { exchange, span: whole }, exchange.stage);
        }
        for (number, &span) in spans.iter().enumerate() {
            for substep in span.first..span.end {
                plan.push(Step::Solve { substep }, rules.stage);
                if !rules.solver_collides {
                    plan.push(Step::Collide { substep }, COLLIDE);
                }
            }
            let next = spans.get(number + 1).copied();
            let is_last = next.is_none();
            let is_due = |own: &&Exchange| own.repeats || is_last;
            let exchange = |plan: &mut Steps, own: &Exchange| {
                let span = if own.repeats { span } else { whole };
                plan.push(Step::Exchange { exchange: *own, span }, own.stage);
            };
            between.iter().filter(is_due).for_each(|own| exchange(&mut plan, own));
            if has_pass {
                plan.push(Step::RestoreLengths { span }, LENGTHS);
            }
            let after = || after.iter().filter(is_due);
            after().for_each(|own| exchange(&mut plan, own));
            // Before lengths are restored, so that the next exchange sees what that displaces.
            if let Some(span) = next {
                for exchange in rest.iter().filter(|own| own.records_start && own.repeats).copied() {
                    plan.push(Step::RecordStart { exchange, span }, exchange.stage);
                }
            }
            if let Some(last) = after().next_back() {
                let moves = |kind| restores && after().any(|own| own.moves == kind);
                if rules.restores_own_lengths && moves(Moves::Particles) {
                    plan.push(Step::RestoreLengths { span }, last.stage);
                } else {
                    let unless_moved = moves(Moves::Edges);
                    if unless_moved {
                        plan.push(Step::RestoreIfMoved { span }, last.stage);
                    }
                    plan.push(Step::CollideFinal { span, unless_moved }, COLLIDE);
                }
            }
        }
        plan.push(Step::CheckStrands, CHECK);
        Self { steps: plan.0.into(), spans }
    }

    /// The spans of the frame: one if no interaction repeats.
    pub fn spans(&self) -> &[Span] {
        &self.spans
    }

    /// All steps in their order.
    pub fn steps(&self) -> &[PlannedStep] {
        &self.steps
    }

    /// Checks that `steps` are of a frame of `substeps`.
    ///
    /// # Errors
    /// [`ParamsError::Range`] for a step of a substep that the frame does not have.
    pub fn check(steps: &[PlannedStep], substeps: u32) -> Result<(), ParamsError> {
        let last = |step: Step| match step {
            Step::Solve { substep } | Step::Collide { substep } => substep,
            Step::RecordStart { span, .. }
            | Step::Exchange { span, .. }
            | Step::RestoreLengths { span }
            | Step::RestoreIfMoved { span }
            | Step::CollideFinal { span, .. } => span.end.saturating_sub(1),
            Step::CheckStrands => 0,
        };
        let beyond = steps.iter().map(|own| last(own.step)).find(|substep| *substep >= substeps);
        let Some(value) = beyond.map(f64::from) else { return Ok(()) };
        let expected = "below those of the frame: plan steps for the frame's length".to_owned();
        Err(ParamsError::Range { name: "substep", value, expected })
    }

    /// Whether there are steps for which `is_one` is true.
    pub fn any(&self, is_one: impl Fn(&Step) -> bool) -> bool {
        self.steps.iter().any(|own| is_one(&own.step))
    }

    /// The stages in the order in which they first do their work; recording the start counts for
    /// nothing.
    pub fn stages(&self) -> Vec<&'static str> {
        let mut names = Vec::new();
        let works = |own: &&PlannedStep| !matches!(own.step, Step::RecordStart { .. });
        for own in self.steps.iter().filter(works) {
            if !names.contains(&own.stage) {
                names.push(own.stage);
            }
        }
        names
    }

    /// The steps in runs, each on one side of stage `from`: with `true` those of stages before it,
    /// with `false` those of itself and of stages after it, by the order of [`FramePlan::stages`].
    /// A stage that the plan lacks comes after all others.
    pub fn split_at(&self, from: &str) -> Vec<(bool, &[PlannedStep])> {
        let mut early = self.stages();
        early.truncate(early.iter().position(|name| *name == from).unwrap_or(early.len()));
        let is_early = |own: &PlannedStep| early.contains(&own.stage);
        let chunks = self.steps.chunk_by(|a, b| is_early(a) == is_early(b));
        chunks.map(|chunk| (is_early(&chunk[0]), chunk)).collect()
    }
}

/// Names of the stages that all solvers share.
pub const COLLIDE: &str = "resolve_solids";
/// The length pass.
pub const LENGTHS: &str = "restore_lengths";
/// Checks at the frame's end.
pub const CHECK: &str = "check_strands";
