//! Executes the steps of a frame's plan on the CPU.

use super::sleep::Sleeper;
use super::{Simulation, SimulationReal};
use crate::air::sample_air::AirTerms;
use crate::air::{Canopy, PlacedHair, Wake, WindField};
use crate::collide::resolve_solids::SolidPose;
use crate::frame::{
    BlockReport, Crew, EdgeFlags, ExchangeContext, FrameContext, FrameInput, FramePlan, FrameReport,
    Interaction, PlannedStep, Roots, SolverReal, Span, Step, Stillness, fractions, pack_frames,
};
use crate::lane::Row;
use crate::params::ParamsError;
use crate::pose::Pose;
use crate::strands::{Model, Scratch};
use glam::DVec3;
use std::sync::{Mutex, PoisonError};

/// Buffers whose contents are not used across frames.
#[derive(Debug)]
pub(super) struct Workspace<T> {
    /// One per thread, each behind a lock that only its thread takes.
    scratch: Vec<Mutex<Scratch<T>>>,
    poses: Vec<Pose>,
    /// Motion of strands relative to the head; empty: none.
    root_frames: Vec<Row<T>>,
    solid_poses: Vec<SolidPose<T>>,
    wake: Wake,
    canopy: Canopy,
    /// Share of the wind that reaches each particle, a row a place; empty: 1 everywhere.
    pub exposure: Vec<Row<T>>,
    /// Acceleration of each particle in addition to gravity; empty: none.
    acceleration: Vec<Row<T>>,
    /// Consecutive steps of strands.
    steps: Vec<Step>,
    edges: EdgeFlags,
    pub sleeper: Sleeper<T>,
}

impl<T: SolverReal> Workspace<T> {
    /// Buffers for the strands of `model`.
    pub fn new(model: &Model<T>) -> Self {
        Self {
            scratch: scratch(model),
            poses: Vec::new(),
            root_frames: Vec::new(),
            solid_poses: Vec::new(),
            wake: Wake::default(),
            canopy: Canopy::default(),
            exposure: Vec::new(),
            acceleration: Vec::new(),
            steps: Vec::new(),
            edges: EdgeFlags::new(model.blocks.len()),
            sleeper: Sleeper::default(),
        }
    }

    /// Resizes the buffers for a model that has changed.
    pub fn fit(&mut self, model: &Model<T>) {
        self.scratch = scratch(model);
        self.canopy = Canopy::default();
        self.edges = EdgeFlags::new(model.blocks.len());
        self.acceleration.clear();
        self.sleeper.forget();
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        let locked = |s: &Mutex<Scratch<T>>| s.lock().unwrap_or_else(PoisonError::into_inner).bytes();
        self.scratch.iter().map(locked).sum::<usize>()
            + size_of_val(&*self.poses)
            + size_of_val(&*self.root_frames)
            + size_of_val(&*self.solid_poses)
            + size_of_val(&*self.exposure)
            + size_of_val(&*self.acceleration)
            + self.edges.bytes()
            + self.wake.bytes()
            + self.canopy.bytes()
            + self.sleeper.bytes()
    }

    /// Poses of head and colliders at the substeps, relative to `origin`.
    fn place(&mut self, frame: &FrameInput<'_>, substeps: u32, model: &Model<T>, origin: DVec3) {
        self.poses.clear();
        self.poses.extend(frame.poses(model, substeps, origin));
        self.solid_poses.clear();
        for fractions in fractions(substeps) {
            self.solid_poses
                .extend(frame.colliders.iter().map(|solid| SolidPose::new(solid, fractions, origin)));
        }
    }
}

/// Scratch for every thread.
fn scratch<T: SolverReal>(model: &Model<T>) -> Vec<Mutex<Scratch<T>>> {
    let threads = rayon::current_num_threads().max(1);
    (0..threads).map(|_| Mutex::new(Scratch::new(model.longest()))).collect()
}

/// The interaction `name`, if there is one.
fn named<'a, T>(
    interactions: &'a mut [Box<dyn Interaction<T>>],
    name: &str,
) -> Option<&'a mut Box<dyn Interaction<T>>> {
    interactions.iter_mut().find(|own| own.exchange_plan().name == name)
}

impl<T: SimulationReal> Simulation<T> {
    /// Runs `steps` of a frame.
    pub(super) fn run(
        &mut self,
        frame: &FrameInput<'_>,
        steps: &[PlannedStep],
    ) -> Result<FrameReport, ParamsError> {
        let beyond_float32 = self.options.beyond_float32 || size_of::<T>() > 4;
        self.solver.check_step(&self.model, frame.dt_secs, beyond_float32)?;
        frame.acceleration.check(&self.model)?;
        frame.roots.check(&self.model)?;
        if let Roots::OnSkin { head, roots, poses } = frame.roots {
            let [from, to] = poses.map(|pose| roots.frames(pose));
            let roots = Roots::PerStrand { head, frames: [&from, &to] };
            return self.run(&FrameInput { roots, ..*frame }, steps);
        }
        let rules = self.solver.rules();
        let substeps = rules.substeps(frame.dt_secs);
        FramePlan::check(steps, substeps)?;
        let is_whole = steps.len() == self.plan.steps().len();
        if !is_whole {
            self.wake();
        }
        let measures_stillness = is_whole && self.prepare_sleep(frame);
        let sleeping = self.sleeping_strands();
        if sleeping == self.model.strand_count {
            return Ok(FrameReport { sleeping_strands: sleeping as u32, ..FrameReport::default() });
        }
        let origin = frame.origin(&self.model);
        let shift = self.state.origin - origin;
        let start = self.model.about_centre(&frame.roots.head()[0], self.state.origin);
        self.workspace.place(frame, substeps, &self.model, origin);
        self.workspace.root_frames.clear();
        if let Some(frames) = frame.roots.frames() {
            pack_frames(&self.model, frames, &mut self.workspace.root_frames);
        }
        let solves = steps.iter().any(|own| matches!(own.step, Step::Solve { .. }));
        let wind =
            self.wind(frame, frame.air.field.filter(|_| solves), solves && rules.local_drag, origin, shift);
        let begins = steps.iter().any(|own| own.step == Step::Solve { substep: 0 });
        if begins {
            self.start_channels(frame);
            frame.acceleration.sample(&self.model, &self.state, &mut self.workspace.acceleration);
        }
        let Workspace {
            scratch,
            poses,
            root_frames,
            solid_poses,
            wake,
            canopy,
            exposure,
            acceleration,
            steps: run,
            edges,
            sleeper,
        } = &mut self.workspace;
        let cx = FrameContext {
            rules,
            simd: self.options.simd.resolve(),
            dt_secs: frame.dt_secs,
            substeps,
            h: frame.dt_secs / f64::from(substeps),
            poses,
            gravity: frame.gravity,
            rest_gravity: self.options.carried_gravity(),
            air_velocity: frame.air.velocity,
            air: wind.map(|wind| AirTerms::new(&wind, wake, canopy, origin)),
            shift,
            solids: frame.colliders,
            solid_poses,
        };
        let calm_secs = if measures_stillness { self.state.sleep.calm_secs } else { 0.0 };
        let context = |span: Span| {
            let [first, end] = [span.first, span.end].map(|k| k as usize);
            ExchangeContext {
                model: &self.model,
                start: if first == 0 { start } else { poses[first] },
                last_substep: [poses[end - 1], poses[end]],
                solids: frame.colliders,
                origin,
                clamped: rules.clamped,
                substeps: span.substeps(),
                dt_secs: span.secs(substeps, frame.dt_secs),
                calm_secs,
            }
        };
        let (speed, dt_secs, h) = (self.options.sleep_speed, frame.dt_secs, cx.h);
        let stillness =
            measures_stillness.then(|| Stillness::new([speed, self.state.sleep.calm_secs], dt_secs, h));
        let mut crew = Crew {
            solver: &self.solver,
            cx,
            model: &self.model,
            scratch,
            exposure,
            acceleration,
            root_frames,
            stillness,
        };
        let mut report = FrameReport { sleeping_strands: sleeping as u32, ..FrameReport::default() };
        let mut sum: Option<BlockReport> = None;
        // An interaction with two exchanges records the start of a span once.
        let mut recorded = None;
        for chunk in steps.chunk_by(|a, b| a.step.runs_with(&b.step)) {
            match chunk[0].step {
                Step::RecordStart { exchange: own, span } => {
                    let now = Some((own.name, span));
                    let is_new = std::mem::replace(&mut recorded, now) != now;
                    if let Some(interaction) = named(&mut self.interactions, own.name).filter(|_| is_new) {
                        interaction.record_start(&context(span), &self.state);
                    }
                }
                Step::Exchange { exchange: own, span } => {
                    let exchange = context(span);
                    if let Some(interaction) = named(&mut self.interactions, own.name) {
                        if sleeping > 0 {
                            sleeper.hold(&self.state);
                        }
                        if interaction.early_exchange() == Some(own) {
                            interaction.exchange_early(&exchange, &mut self.state, &mut report);
                        } else {
                            interaction.exchange(&exchange, &mut self.state, &mut edges.moved, &mut report);
                        }
                        if sleeping > 0 {
                            sleeper.release(&self.model, &mut self.state, speed, dt_secs);
                        }
                    }
                }
                _ => {
                    run.clear();
                    run.extend(chunk.iter().map(|own| own.step));
                    if run.iter().any(|step| matches!(step, Step::Solve { .. })) {
                        edges.moved.fill(false);
                    }
                    // Positions are moved there by the first of these steps.
                    self.state.origin = origin;
                    let found = crew.run(run, edges, &mut self.state, &mut sleeper.start);
                    crew.cx.shift = DVec3::ZERO;
                    sum = Some(sum.map_or(found, |sum| sum.then(&found)));
                }
            }
        }
        if let Some(sum) = sum {
            report.add_blocks(&sum, rules.stage);
        }
        if measures_stillness {
            self.fall_asleep(dt_secs, h);
        }
        Ok(report)
    }

    /// Sets channels without values to their initial ones, at the start of `frame`.
    fn start_channels(&mut self, frame: &FrameInput<'_>) {
        let head = frame.roots.head()[0].rotation;
        let Some([frames, _]) = frame.roots.frames() else {
            return self.state.extra.start(|_, _| head);
        };
        let blocks = &self.model.blocks;
        self.state.extra.start(|place, lane| {
            let block = &blocks[blocks.partition_point(|block| block.first <= place) - 1];
            head * frames.rotations[block.strands[lane] as usize].as_dquat()
        });
    }

    /// The wind of a frame in which the air, or the drag (`local`), differs from particle to
    /// particle; brings its shelter up to date.
    fn wind(
        &mut self,
        frame: &FrameInput<'_>,
        wind: Option<&WindField>,
        local: bool,
        origin: DVec3,
        shift: DVec3,
    ) -> Option<WindField> {
        // Drag that differs from particle to particle is computed as in a wind that does.
        let still = local.then(WindField::default);
        let wind = wind.copied().or(still)?;
        let wind = WindField { mean: wind.mean + frame.air.velocity, ..wind };
        let Workspace { wake, canopy, .. } = &mut self.workspace;
        if wind.shelter > 0.0 {
            wake.update(frame.colliders, origin, self.model.reach, wind.mean);
        }
        if wind.hair_depth > 0.0 {
            let hair = PlacedHair { positions: &self.state.positions, shift };
            canopy.update(&self.model, &hair, wind.mean, wind.hair_depth);
        }
        Some(wind)
    }
}
