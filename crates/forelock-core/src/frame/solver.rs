//! The seam of strand solvers.
//!
//! # Practice
//! A solver is a type that holds its parameters and implements [`LaneSolver`]: one function,
//! generic over lanes, that advances a group of strands by a substep. It is compiled for every
//! instruction set, and as float64 it is its own specification. What all solvers share is done
//! around it: positions are moved to the frame's origin, the air is sampled, collisions, lengths
//! and checks follow as the plan says. [`Solver::new`] makes it a solver that a simulation takes.
//!
//! What cannot be said lane by lane (a learned solver with its own batches) implements
//! [`StrandSolver`] itself: one dynamic call a block.

use super::context::{FrameContext, Substep};
use super::finish;
use super::plan::Step;
use super::report::BlockReport;
use super::rules::{Channels, FrameRules, Refinement, StepCheck, StepRate};
use crate::air::sample_air;
use crate::collide::resolve_solids::SolidContacts;
use crate::lane::{LANES, Lane, Real, Simd, V3};
use crate::params::{ParamsError, check_time};
use crate::strands::{BlockView, LaneGroup, Model, PackError, Scratch, Strands};
use glam::DVec3;
use std::any::Any;
use std::fmt::Debug;
use std::sync::Arc;
use std::time::Instant;

/// A solver of strands, written once for all widths of lanes.
pub trait LaneSolver: Debug + Send + Sync + 'static {
    /// What is computed once a block and frame from the parameters.
    type Terms: Debug + Send + Sync;

    /// Whether the solver adds [`FrameContext::shift`] to stored positions itself. Otherwise this
    /// has been done before the first substep.
    const SHIFTS: bool = false;

    /// Its name, as scene files and reports have it.
    fn name(&self) -> &'static str;

    /// What the shared stages need to know.
    fn rules(&self) -> FrameRules;

    /// Per-particle data that it asks for.
    fn channels(&self) -> Channels {
        Channels::default()
    }

    /// How often it steps.
    fn rate(&self) -> StepRate {
        StepRate::PerFrame
    }

    /// Checks every parameter against its range.
    ///
    /// # Errors
    /// [`ParamsError::Range`] for the first that is not in it.
    fn validate(&self) -> Result<(), ParamsError> {
        Ok(())
    }

    /// Checks that frames like `step` can be solved: a positive time, and parameters that float32
    /// can solve unless [`StepCheck::beyond_float32`].
    ///
    /// # Errors
    /// [`ParamsError`] if they cannot.
    fn validate_step(&self, step: &StepCheck) -> Result<(), ParamsError> {
        check_time(step.dt_secs)
    }

    /// The particles that the solver adds between those of the groom, if it adds any. Such a solver
    /// implements [`LaneSolver::refine`].
    fn refinement(&self) -> Option<Refinement> {
        None
    }

    /// Rest positions of `strands` with the particles of `refinement`, in the head's frame, strand
    /// after strand: (N − 1) `every` + 1 for a strand of N, metres.
    fn refine<T: Real>(&self, strands: &Strands<'_, T>, refinement: &Refinement) -> Vec<[T; 3]> {
        let _ = (strands, refinement);
        Vec::new()
    }

    /// The terms for frames of `dt_secs`.
    fn terms(&self, dt_secs: f64) -> Self::Terms;

    /// Advances the lanes of `group` by a substep; what it finds of collisions, if it resolves them
    /// itself. Mark the implementation `#[inline(always)]`: it is then compiled for each
    /// instruction set.
    fn solve<L: Lane>(
        terms: &Self::Terms,
        cx: &FrameContext<'_, L::Scalar>,
        substep: Substep,
        view: &mut BlockView<'_, L::Scalar>,
        group: LaneGroup,
        scratch: &mut Scratch<L::Scalar>,
    ) -> SolidContacts;
}

/// A solver of strands that a simulation calls once a block.
pub trait StrandSolver<T>: Debug + Send + Sync + 'static {
    /// Its name, as scene files and reports have it.
    fn name(&self) -> &'static str;

    /// What the shared stages need to know.
    fn rules(&self) -> FrameRules;

    /// Per-particle data that it asks for.
    fn channels(&self) -> Channels;

    /// How often it steps.
    fn rate(&self) -> StepRate;

    /// Checks every parameter against its range.
    ///
    /// # Errors
    /// [`ParamsError::Range`] for the first that is not in it.
    fn validate(&self) -> Result<(), ParamsError>;

    /// Checks that frames like `step` can be solved: see [`LaneSolver::validate_step`].
    ///
    /// # Errors
    /// [`ParamsError`] if they cannot.
    fn validate_step(&self, step: &StepCheck) -> Result<(), ParamsError>;

    /// The particles that the solver adds between those of the groom, if it adds any.
    fn refinement(&self) -> Option<Refinement>;

    /// Rest positions of strands with the particles of `refinement`: see [`LaneSolver::refine`].
    fn refine(&self, strands: &Strands<'_, T>, refinement: &Refinement) -> Vec<[T; 3]>;

    /// Runs consecutive [`Step::Solve`] and [`Step::Collide`] of a block of which `live` lanes
    /// count.
    fn advance(
        &self,
        cx: &FrameContext<'_, T>,
        steps: &[Step],
        view: &mut BlockView<'_, T>,
        live: usize,
        scratch: &mut Scratch<T>,
    ) -> BlockReport;

    /// The parameters, for who knows their type.
    fn params(&self) -> &dyn Any;
}

impl<T: SolverReal, S: LaneSolver> StrandSolver<T> for S {
    fn name(&self) -> &'static str {
        LaneSolver::name(self)
    }

    fn rules(&self) -> FrameRules {
        LaneSolver::rules(self)
    }

    fn channels(&self) -> Channels {
        LaneSolver::channels(self)
    }

    fn rate(&self) -> StepRate {
        LaneSolver::rate(self)
    }

    fn validate(&self) -> Result<(), ParamsError> {
        LaneSolver::validate(self)
    }

    fn validate_step(&self, step: &StepCheck) -> Result<(), ParamsError> {
        LaneSolver::validate_step(self, step)
    }

    fn refinement(&self) -> Option<Refinement> {
        LaneSolver::refinement(self)
    }

    fn refine(&self, strands: &Strands<'_, T>, refinement: &Refinement) -> Vec<[T; 3]> {
        LaneSolver::refine(self, strands, refinement)
    }

    fn advance(
        &self,
        cx: &FrameContext<'_, T>,
        steps: &[Step],
        view: &mut BlockView<'_, T>,
        live: usize,
        scratch: &mut Scratch<T>,
    ) -> BlockReport {
        let task = Substeps::<S> { terms: self.terms(cx.dt_secs), steps };
        T::run(&task, cx, view, live, scratch)
    }

    fn params(&self) -> &dyn Any {
        self
    }
}

/// A solver that simulations share: cheap to clone.
#[derive(Debug)]
pub struct Solver<T>(Arc<dyn StrandSolver<T>>);

impl<T> Clone for Solver<T> {
    fn clone(&self) -> Self {
        Self(Arc::clone(&self.0))
    }
}

impl<T: 'static> Solver<T> {
    /// A solver of one's own.
    pub fn new(solver: impl StrandSolver<T>) -> Self {
        Self(Arc::new(solver))
    }

    /// Particles of a strand of the groom, from the root, that follow the head exactly:
    /// [`FrameRules::clamped`] without those that the solver adds between them.
    pub fn clamped(&self) -> usize {
        let every = self.refinement().map_or(1, |own| own.every as usize);
        self.rules().clamped.div_ceil(every)
    }

    /// The parameters, if they are of type `P`.
    pub fn params<P: 'static>(&self) -> Option<&P> {
        self.0.params().downcast_ref()
    }

    /// Checks that frames of `dt_secs` of `model` can be solved ([`LaneSolver::validate_step`]).
    ///
    /// # Errors
    /// [`ParamsError`] if they cannot.
    pub fn check_step(
        &self,
        model: &Model<T>,
        dt_secs: f64,
        beyond_float32: bool,
    ) -> Result<(), ParamsError> {
        self.validate_step(&StepCheck { dt_secs, least_mass: model.least_mass, beyond_float32 })
    }
}

impl<T: Real> Solver<T> {
    /// `strands` packed for this solver, with the particles that it adds.
    ///
    /// # Errors
    /// [`PackError`] if they cannot be simulated.
    pub fn pack(&self, strands: &Strands<'_, T>) -> Result<Model<T>, PackError> {
        match self.refinement() {
            None => Model::new(strands),
            Some(own) => Model::refined(strands, own.every, |strands| self.refine(strands, &own)),
        }
    }
}

impl<T> std::ops::Deref for Solver<T> {
    type Target = dyn StrandSolver<T>;

    fn deref(&self) -> &Self::Target {
        &*self.0
    }
}

impl<T> From<&Self> for Solver<T> {
    fn from(solver: &Self) -> Self {
        solver.clone()
    }
}

/// Makes parameters that are a [`StrandSolver`] in either precision convert to a [`Solver`]. The
/// solver is compiled once, in the crate that calls this.
#[macro_export]
macro_rules! solver_from_params {
    ($params:ty) => {
        impl<T: $crate::frame::SolverReal> From<&$params> for $crate::frame::Solver<T> {
            fn from(params: &$params) -> Self {
                // Never inlined: a crate that inlines them would compile the solver again.
                #[inline(never)]
                fn single(params: &$params) -> $crate::frame::Solver<f32> {
                    $crate::frame::Solver::new(params.clone())
                }
                #[inline(never)]
                fn double(params: &$params) -> $crate::frame::Solver<f64> {
                    $crate::frame::Solver::new(params.clone())
                }
                T::select(|| single(params), || double(params))
            }
        }
    };
}

/// Something that a block does, lane group by lane group.
pub(crate) trait BlockTask {
    /// Does it for one group.
    fn run<L: Lane>(
        &self,
        cx: &FrameContext<'_, L::Scalar>,
        view: &mut BlockView<'_, L::Scalar>,
        group: LaneGroup,
        scratch: &mut Scratch<L::Scalar>,
    ) -> BlockReport;
}

/// Numbers that solvers run in.
pub trait SolverReal: Real {
    /// The solver in this precision.
    #[doc(hidden)]
    fn select(single: impl FnOnce() -> Solver<f32>, double: impl FnOnce() -> Solver<f64>) -> Solver<Self>;

    /// Runs `task` on a block, of which `live` lanes count, with the lanes of
    /// [`FrameContext::simd`].
    #[doc(hidden)]
    #[expect(private_bounds, reason = "only this crate has block tasks")]
    fn run<K: BlockTask>(
        task: &K,
        cx: &FrameContext<'_, Self>,
        view: &mut BlockView<'_, Self>,
        live: usize,
        scratch: &mut Scratch<Self>,
    ) -> BlockReport;
}

/// The specification: one strand at a time, plain float64.
impl SolverReal for f64 {
    fn select(_: impl FnOnce() -> Solver<f32>, double: impl FnOnce() -> Solver<Self>) -> Solver<Self> {
        double()
    }

    #[expect(private_bounds, reason = "only this crate has block tasks")]
    fn run<K: BlockTask>(
        task: &K,
        cx: &FrameContext<'_, Self>,
        view: &mut BlockView<'_, Self>,
        live: usize,
        scratch: &mut Scratch<Self>,
    ) -> BlockReport {
        groups::<K, Self>(task, cx, view, live, scratch)
    }
}

/// `task` on all groups of lanes of a block.
#[inline(always)]
fn groups<K: BlockTask, L: Lane>(
    task: &K,
    cx: &FrameContext<'_, L::Scalar>,
    view: &mut BlockView<'_, L::Scalar>,
    live: usize,
    scratch: &mut Scratch<L::Scalar>,
) -> BlockReport {
    let mut report = BlockReport::default();
    for first in (0..live.min(LANES)).step_by(L::WIDTH) {
        report = report.merge(task.run::<L>(cx, view, LaneGroup { first, live }, scratch));
    }
    report
}

/// A function for each instruction set, and the choice among them. The unit tests of this crate are
/// built without those of AVX, which halves their compile time: `tests/it` runs them all.
macro_rules! instruction_sets {
    ($($simd:ident, $name:ident, $features:literal, $lane:ty;)*) => {
        $(
            #[cfg(all(target_arch = "x86_64", not(test)))]
            #[target_feature(enable = $features)]
            fn $name<K: BlockTask>(
                task: &K,
                cx: &FrameContext<'_, f32>,
                view: &mut BlockView<'_, f32>,
                live: usize,
                scratch: &mut Scratch<f32>,
            ) -> BlockReport {
                groups::<K, $lane>(task, cx, view, live, scratch)
            }
        )*

        impl SolverReal for f32 {
            fn select(single: impl FnOnce() -> Solver<Self>, _: impl FnOnce() -> Solver<f64>) -> Solver<Self> {
                single()
            }

            #[expect(private_bounds, reason = "only this crate has block tasks")]
            fn run<K: BlockTask>(
                task: &K,
                cx: &FrameContext<'_, Self>,
                view: &mut BlockView<'_, Self>,
                live: usize,
                scratch: &mut Scratch<Self>,
            ) -> BlockReport {
                use crate::lane::{BASELINE_FMA, Pack};
                match cx.simd {
                    $(
                        #[cfg(all(target_arch = "x86_64", not(test)))]
                        // SAFETY: a simulation is built only for instruction sets that the
                        // processor has.
                        Simd::$simd => unsafe { $name(task, cx, view, live, scratch) },
                    )*
                    Simd::Scalar => groups::<K, Pack<1, BASELINE_FMA>>(task, cx, view, live, scratch),
                    _ => groups::<K, Pack<4, BASELINE_FMA>>(task, cx, view, live, scratch),
                }
            }
        }
    };
}

instruction_sets! {
    Avx2x1, on_avx2_1, "avx2,fma", crate::lane::Pack<1, true>;
    Avx2x4, on_avx2_4, "avx2,fma", crate::lane::Pack<4, true>;
    Avx2, on_avx2, "avx2,fma", crate::lane::Avx2;
    Avx2x16, on_avx2_16, "avx2,fma", crate::lane::Pack<16, true>;
    Avx512, on_avx512, "avx512f,avx512vl,avx512dq,avx512bw,avx2,fma", crate::lane::Avx512;
}

/// The steps of substeps under solver `S`.
struct Substeps<'a, S: LaneSolver> {
    terms: S::Terms,
    steps: &'a [Step],
}

impl<S: LaneSolver> BlockTask for Substeps<'_, S> {
    #[inline(always)]
    fn run<L: Lane>(
        &self,
        cx: &FrameContext<'_, L::Scalar>,
        view: &mut BlockView<'_, L::Scalar>,
        group: LaneGroup,
        scratch: &mut Scratch<L::Scalar>,
    ) -> BlockReport {
        let mut report = BlockReport::default();
        let mut clock = Clock::start();
        let solves = self.steps.iter().any(|step| matches!(step, Step::Solve { .. }));
        let air = cx.air.as_ref().filter(|_| solves);
        if !S::SHIFTS || air.is_some() {
            shift_positions::<L>(cx.shift, view, group.first);
        }
        if let Some(air) = air {
            sample_air::sample::<L>(air, view.positions, view.exposure, group.first, view.wind);
        }
        let mut air_is_new = true;
        for step in self.steps {
            match *step {
                Step::Solve { substep } => {
                    let substep = Substep { index: substep as usize, air_is_new };
                    air_is_new = false;
                    accelerate::<L>(cx.h, view, group.first);
                    report.contacts = S::solve::<L>(&self.terms, cx, substep, view, group, scratch);
                    report.nanos.solve += clock.lap();
                }
                Step::Collide { substep } => {
                    report.contacts =
                        finish::collide_substep::<L>(cx, substep as usize, view, group, scratch);
                    report.nanos.collide += clock.lap();
                }
                _ => {}
            }
        }
        report
    }
}

/// Adds h a to all velocities, with the acceleration a in addition to gravity.
#[inline(always)]
fn accelerate<L: Lane>(h: f64, view: &mut BlockView<'_, L::Scalar>, first: usize) {
    if view.acceleration.is_empty() {
        return;
    }
    let h = L::from_f64(h);
    for i in 0..view.particles {
        let v = V3::<L>::load(view.velocities, i, first);
        v.add_scaled(h, V3::load(view.acceleration, i, first)).store(view.velocities, i, first);
    }
}

/// Adds `shift` to all positions.
#[inline(always)]
fn shift_positions<L: Lane>(shift: DVec3, view: &mut BlockView<'_, L::Scalar>, first: usize) {
    if shift == DVec3::ZERO {
        return;
    }
    let shift = V3::<L>::splat(shift);
    for i in 0..view.particles {
        (V3::load(view.positions, i, first) + shift).store(view.positions, i, first);
    }
}

/// Laps of a stage's time.
pub(super) struct Clock(Instant);

impl Clock {
    pub(super) fn start() -> Self {
        Self(Instant::now())
    }

    #[expect(clippy::cast_possible_truncation, reason = "a lap is far under 584 years")]
    pub(super) fn lap(&mut self) -> u64 {
        let now = Instant::now();
        let nanos = (now - self.0).as_nanos() as u64;
        self.0 = now;
        nanos
    }
}
