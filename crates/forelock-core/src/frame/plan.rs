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
    /// Positions, and it says each frame whether it moved any: edges are restored if it did.
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
    /// Whether it records where hair is at the frame's start.
    pub records_start: bool,
}

/// A step of a frame, over all strands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// An interaction records where hair is at the frame's start.
    RecordStart(Exchange),
    /// An interaction exchanges momentum between strands.
    Exchange(Exchange),
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
    RestoreLengths,
    /// The same, if an interaction before it moved edges in this frame.
    RestoreIfMoved,
    /// Collisions after interactions.
    CollideFinal {
        /// Not if [`Step::RestoreIfMoved`] has resolved them.
        unless_moved: bool,
    },
    /// Stretch is measured; strands that are not finite are put back to rest.
    CheckStrands,
}

impl Step {
    /// Whether blocks of strands run it independently of each other.
    pub fn is_of_strands(&self) -> bool {
        !matches!(self, Self::RecordStart(_) | Self::Exchange(_))
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
            | Self::RestoreLengths
            | Self::RestoreIfMoved => true,
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
        for own in sorted.iter().filter(|own| own.records_start) {
            plan.push(Step::RecordStart(*own), own.stage);
        }
        let restores = rules.lengths != Inextensibility::Off;
        let has_pass = restores && !rules.restores_own_lengths;
        let (before, rest) =
            sorted.split_at(sorted.partition_point(|own| own.phase < Phase::BeforeLengths(0)));
        let of_pass = |own: &Exchange| has_pass && matches!(own.phase, Phase::BeforeLengths(_));
        let (between, after) = rest.split_at(rest.partition_point(of_pass));
        before.iter().for_each(|own| plan.push(Step::Exchange(*own), own.stage));
        for substep in 0..substeps {
            plan.push(Step::Solve { substep }, rules.stage);
            if !rules.solver_collides {
                plan.push(Step::Collide { substep }, COLLIDE);
            }
        }
        between.iter().for_each(|own| plan.push(Step::Exchange(*own), own.stage));
        if has_pass {
            plan.push(Step::RestoreLengths, LENGTHS);
        }
        after.iter().for_each(|own| plan.push(Step::Exchange(*own), own.stage));
        if let Some(last) = after.last() {
            let moves = |kind| restores && after.iter().any(|own| own.moves == kind);
            if rules.restores_own_lengths && moves(Moves::Particles) {
                plan.push(Step::RestoreLengths, last.stage);
            } else {
                let unless_moved = moves(Moves::Edges);
                if unless_moved {
                    plan.push(Step::RestoreIfMoved, last.stage);
                }
                plan.push(Step::CollideFinal { unless_moved }, COLLIDE);
            }
        }
        plan.push(Step::CheckStrands, CHECK);
        Self { steps: plan.0.into() }
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
        let beyond = steps.iter().find_map(|own| match own.step {
            Step::Solve { substep } | Step::Collide { substep } if substep >= substeps => Some(substep),
            _ => None,
        });
        let Some(value) = beyond.map(f64::from) else { return Ok(()) };
        let expected = "below those of the frame: plan steps for the frame's length".to_owned();
        Err(ParamsError::Range { name: "substep", value, expected })
    }

    /// Whether `step` is one of them.
    pub fn contains(&self, step: Step) -> bool {
        self.steps.iter().any(|own| own.step == step)
    }

    /// The stages in the order in which they first do their work; recording the start counts for
    /// nothing.
    pub fn stages(&self) -> Vec<&'static str> {
        let mut names = Vec::new();
        let works = |own: &&PlannedStep| !matches!(own.step, Step::RecordStart(_));
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
