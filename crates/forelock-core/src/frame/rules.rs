//! What the stages that all solvers share need to know of the solver.

use crate::collide::resolve_solids::STRETCHED;
use crate::lane::Real;
use crate::params::{Inextensibility, STATED_STEP_SECS, parts};
use crate::strands::{Channel, Model, State};

/// Most spans of a frame.
pub const SPANS: u32 = 16;

/// Parameters of the shared stages, and how the solver wants its frame laid out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameRules {
    /// The solver's stage, as reports name it.
    pub stage: &'static str,
    /// The longest substep, seconds: a frame is divided into as many equal ones as it takes.
    /// Infinite: one a frame.
    pub substep_secs: f64,
    /// The longest time between two exchanges of an interaction that repeats
    /// ([`Exchange::repeats`](super::plan::Exchange::repeats)), in whole substeps, seconds; longer
    /// where a frame would have more than [`SPANS`] of them. Infinite: once a frame.
    pub exchange_secs: f64,
    /// Particles of each strand, from the root, that follow the head exactly.
    pub clamped: usize,
    /// Distance that particles keep from colliders, metres.
    pub skin_thickness: f64,
    /// Fastest that a particle which starts a frame inside a collider is brought out, m/s.
    pub depenetration_speed: f64,
    /// The length pass.
    pub lengths: Inextensibility,
    /// Stretch, over the rest length, to which [`Inextensibility::Limit`] shortens edges.
    pub max_stretch: f64,
    /// Share of a length correction that the particle before loses as velocity, for
    /// [`Inextensibility::FollowTheLeader`].
    pub length_damping: f64,
    /// Stretch above which a strand that touches colliders is laid along their surfaces at the end
    /// of a frame ([`lay_along`](crate::collide::resolve_solids::lay_along)); `None`: never.
    pub stretch_limit: Option<f64>,
    /// Whether the solver's own stage resolves collisions, so that no pass follows it.
    pub solver_collides: bool,
    /// Whether the solver's own stage leaves every edge at its length, so that the length pass runs
    /// only after interactions.
    pub restores_own_lengths: bool,
    /// Whether drag differs from particle to particle even where the air does not.
    pub local_drag: bool,
    /// Whether ties to the rest shape weaken ([`State::integrity`]).
    pub ties_weaken: bool,
}

impl Default for FrameRules {
    /// One substep, one clamped particle, collisions and a length pass by the shared stages.
    fn default() -> Self {
        Self {
            stage: "solve",
            substep_secs: f64::INFINITY,
            exchange_secs: f64::INFINITY,
            clamped: 1,
            skin_thickness: 5e-4,
            depenetration_speed: 1.0,
            lengths: Inextensibility::Projection,
            max_stretch: 0.0,
            length_damping: 0.9,
            stretch_limit: Some(STRETCHED),
            solver_collides: false,
            restores_own_lengths: false,
            local_drag: false,
            ties_weaken: false,
        }
    }
}

impl FrameRules {
    /// Substeps of a frame of `dt_secs`: [`parts`].
    pub fn substeps(&self, dt_secs: f64) -> u32 {
        parts(dt_secs, self.substep_secs)
    }

    /// Spans of a frame of `substeps`, at whose ends interactions that repeat run.
    pub fn spans(&self, substeps: u32) -> u32 {
        // In whole substeps; rounding must not lose one.
        let each = (self.exchange_secs / self.substep_secs * (1.0 + 1e-9)).max(1.0);
        substeps.div_ceil(each as u32).clamp(1, SPANS)
    }

    /// Whether the collisions of the last substep are the frame's final ones unless interactions
    /// follow, so that they test all edges and lay strands along colliders.
    pub fn collides_once(&self) -> bool {
        !self.solver_collides
            && self.stretch_limit.is_some()
            && (self.restores_own_lengths || self.lengths == Inextensibility::Off)
    }

    /// Length of a substep of a frame of `dt_secs`, seconds.
    pub fn h(&self, dt_secs: f64) -> f64 {
        dt_secs / f64::from(self.substeps(dt_secs))
    }
}

/// Per-particle data that a solver requests in addition to positions, velocities, integrity and
/// clearance.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Channels {
    /// Positions a step before (`State::previous`); velocities then may hold more than motion, and
    /// whoever asks how fast hair moves takes the difference of positions.
    pub previous: bool,
    /// Rest edges in the frame of the particle before (`Model::local`).
    pub rest_frames: bool,
    /// State that only this solver understands, in [`BlockView::extra`] under its index here.
    ///
    /// [`BlockView::extra`]: crate::strands::BlockView::extra
    pub extra: &'static [Channel],
}

impl Channels {
    /// Adds to `model` and `state` what is asked for, and drops what is not: where positions a step
    /// before are no longer kept, velocities become those with which hair moved. Extra channels of
    /// the same name, kind and number of values are kept, others start in the next frame.
    pub fn prepare<T: Real>(self, model: &mut Model<T>, state: &mut State<T>) {
        if self.rest_frames {
            model.find_frames();
        } else {
            model.local = Vec::new();
        }
        self.prepare_state(model, state);
    }

    /// Adds to `state` what is asked for, and drops what is not: the part of [`Channels::prepare`]
    /// that leaves the model as it is.
    pub fn prepare_state<T: Real>(self, model: &Model<T>, state: &mut State<T>) {
        if self.previous {
            state.remember();
        } else {
            state.forget(STATED_STEP_SECS);
        }
        state.extra.prepare(self.extra, model.places());
    }
}

/// The particles that a solver adds between those of the groom. Solvers for which it is equal have
/// the same strands: a simulation can change from one to the other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Refinement {
    /// Spacing of the groom's particles: counted from the root, every `every`-th particle is from
    /// the groom, the others are added.
    pub every: u32,
    /// A parameter of the positions of the added particles.
    pub offset: f64,
}

/// How often a solver steps.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum StepRate {
    /// Once a frame.
    #[default]
    PerFrame,
    /// At its own rate, independent of the frame rate: the length of a step, seconds.
    Fixed(f64),
}

impl StepRate {
    /// The step, or [`STATED_STEP_SECS`] where it is the frame's.
    pub fn usual_secs(self) -> f64 {
        self.secs(STATED_STEP_SECS)
    }

    /// The step in frames of `frame_secs`, seconds.
    pub fn secs(self, frame_secs: f64) -> f64 {
        if let Self::Fixed(secs) = self { secs } else { frame_secs }
    }
}

/// The frames that a solver is asked to check before it steps one
/// ([`LaneSolver::validate_step`](super::LaneSolver::validate_step)).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepCheck {
    /// Length of a frame, seconds.
    pub dt_secs: f64,
    /// The smallest relative mass of a particle: under a spring, a light particle is as stiff as
    /// one of unit mass under a stiffer spring.
    pub least_mass: f64,
    /// Accepts parameters beyond the limit of float32.
    pub beyond_float32: bool,
}
