//! A simulation as a whole: Model, State and Workspace, a frame at a time.

use super::block::{
    BLOCK_STAGES, BlockFn, BlockReport, FrameJob, Part, STAGES, Simd, SolverReal, StrandTerms, Task,
};
use super::params::{ParamsError, SolverParams};
use super::steps::{FrameStep, Meeting};
use crate::air::{Canopy, PlacedHair, Wake, WindField};
use crate::body::ColliderFrame;
use crate::contact::{ContactParams, ContactReport, Contacts};
use crate::grid::{Grid, GridFrame, GridMoment, GridParams, GridReport};
use crate::groom::Groom;
use crate::lane::Row;
use crate::model::{Block, Model, PackError, Strands};
use crate::pose::Pose;
use crate::sph::{Sph, SphParams, SphReport};
use crate::stage::resolve_solids::{SolidPose, note_one};
use crate::stage::restore_lengths::LengthTerms;
use crate::stage::sample_air::AirTerms;
use crate::stage::{AIR_ROWS, BlockView, Scratch};
use crate::state::{Snapshot, SnapshotError, State};
use glam::{DVec3, Vec3};
use rayon::prelude::*;
use std::sync::{Mutex, PoisonError};

/// How a simulation runs, beside its physics.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Options {
    /// Instruction set.
    pub simd: Simd,
    /// The head's pose at rest: where the groom is drawn, and against which gravity it was shaped.
    pub rest_pose: Pose,
    /// Gravity that the rest shape carries, m/s², world axes.
    pub rest_gravity: DVec3,
    /// Lets h²κ go beyond what float32 solves (for showing what happens then).
    pub beyond_float32: bool,
}

impl Options {
    /// The gravity that the rest shape carries, along the head's own axes, m/s².
    pub fn carried_gravity(&self) -> DVec3 {
        self.rest_pose.inverse().transform_vector(self.rest_gravity)
    }
}

/// Why a simulation cannot be built.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BuildError {
    /// The groom cannot be packed.
    #[error(transparent)]
    Pack(#[from] PackError),
    /// A parameter is out of its range.
    #[error(transparent)]
    Params(#[from] ParamsError),
    /// The instruction set asked for is not there.
    #[error("this processor cannot run simd = {0:?}: choose \"auto\"")]
    Simd(Simd),
}

/// What happens in a frame.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a> {
    /// The head's pose at the frame's start and end.
    pub head: [Pose; 2],
    /// Solids.
    pub colliders: &'a [ColliderFrame<'a>],
    /// Gravity, m/s².
    pub gravity: DVec3,
    /// Velocity of the air, m/s.
    pub air_velocity: DVec3,
    /// Length of the frame, seconds.
    pub dt_secs: f64,
}

impl Frame<'_> {
    /// The point of the world that positions are relative to in this frame: where the head takes the middle of `model`.
    pub fn origin<T>(&self, model: &Model<T>) -> DVec3 {
        self.head[1].transform_point(model.centre.into())
    }

    /// Maps from the rest shape to positions relative to `origin`, at the start of each substep and at the end of the last.
    pub fn poses<T>(&self, model: &Model<T>, substeps: u32, origin: DVec3) -> impl Iterator<Item = Pose> {
        (0..=substeps).map(move |step| {
            let head = self.head[0].interpolate(&self.head[1], f64::from(step) / f64::from(substeps));
            model.about_centre(&head, origin)
        })
    }
}

/// Start and end of each substep as fractions of the frame.
pub fn fractions(substeps: u32) -> impl Iterator<Item = [f64; 2]> {
    (0..substeps).map(move |step| [step, step + 1].map(|step| f64::from(step) / f64::from(substeps)))
}

/// What a frame did.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameReport {
    /// Largest |l/l₀ − 1| of an edge after the length pass.
    pub max_edge_stretch: f64,
    /// The same at the end of the frame, after solids.
    pub max_edge_stretch_final: f64,
    /// Deepest particle under a solid's surface, metres.
    pub max_penetration_m: f64,
    /// Particles in touch with a solid.
    pub touching: u32,
    /// Strands that were not finite and were put back to their rest shape.
    pub quarantined_strands: u32,
    /// What the grid did, if there is one.
    pub grid: GridReport,
    /// What contacts between strands did, if there are any.
    pub strand_contacts: ContactReport,
    /// What smoothed particles did, if there are any.
    pub particles: SphReport,
    /// Seconds of work in each stage, summed over threads (for stages that all threads share, their time times the
    /// threads), in the order of [`STAGES`].
    pub stage_secs: [(&'static str, f64); STAGES.len()],
}

impl FrameReport {
    /// This and the `later` one, both of whole frames.
    #[must_use]
    pub fn then(self, later: &Self) -> Self {
        Self { touching: later.touching, ..self.and(later) }
    }

    /// This and what `other` steps of the same frame tell.
    #[must_use]
    pub fn and(self, other: &Self) -> Self {
        Self {
            max_edge_stretch: self.max_edge_stretch.max(other.max_edge_stretch),
            max_edge_stretch_final: self.max_edge_stretch_final.max(other.max_edge_stretch_final),
            max_penetration_m: self.max_penetration_m.max(other.max_penetration_m),
            touching: self.touching + other.touching,
            quarantined_strands: self.quarantined_strands + other.quarantined_strands,
            grid: if other.grid == GridReport::default() { self.grid } else { other.grid },
            strand_contacts: if other.strand_contacts == ContactReport::default() {
                self.strand_contacts
            } else {
                other.strand_contacts
            },
            particles: if other.particles == SphReport::default() { self.particles } else { other.particles },
            stage_secs: std::array::from_fn(|k| (STAGES[k], self.stage_secs[k].1 + other.stage_secs[k].1)),
        }
    }
}

/// Bytes held.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Memory {
    /// By the model.
    pub model: usize,
    /// By the state.
    pub state: usize,
    /// By the workspace.
    pub workspace: usize,
}

impl Memory {
    /// All together.
    pub fn total(&self) -> usize {
        self.model + self.state + self.workspace
    }
}

/// What becomes of the hair when the head jumps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "kebab-case"))]
pub enum Teleport {
    /// Back to the rest shape, without motion.
    Reset,
    /// The shape goes along, without motion.
    #[default]
    CarryShape,
    /// Shape and motion go along.
    CarryShapeAndVelocity,
}

/// Strands under the solver that its parameters are of.
///
/// `T` is `f32` in use; `f64` runs the same text as specification.
#[derive(Debug)]
pub struct Simulation<T: SolverReal = f32> {
    pub(super) model: Model<T>,
    pub(super) state: State<T>,
    workspace: Workspace<T>,
    params: SolverParams,
    options: Options,
    /// One in so many particles of a strand is the groom's; the others are virtual.
    pub(super) every: u32,
    /// Where strands meet, if they do.
    grid: Option<Grid>,
    /// Where strands meet as smoothed particles, if they do.
    sph: Option<Sph<T>>,
    /// What keeps segments from passing through each other, if anything does.
    contacts: Option<Contacts>,
}

/// Scratch that nothing relies on between steps.
#[derive(Debug)]
struct Workspace<T> {
    /// One a thread; a lock that only its thread takes.
    scratch: Vec<Mutex<Scratch<T>>>,
    poses: Vec<Pose>,
    solid_poses: Vec<SolidPose<T>>,
    wake: Wake,
    canopy: Canopy,
    /// Velocities with which hair moves, where the state's are others.
    motion: Vec<Row<T>>,
    /// Share of the wind that reaches each particle, a row a place; empty: all of it.
    exposure: Vec<Row<T>>,
}

impl Simulation<f32> {
    /// A simulation of `groom`, at rest at `options.rest_pose`. Threads are those of the rayon pool it is called in.
    ///
    /// # Errors
    /// [`BuildError`] if the groom cannot be packed, a parameter is out of range, or the instruction set is not there.
    pub fn new(
        groom: &Groom,
        params: impl Into<SolverParams>,
        options: &Options,
    ) -> Result<Self, BuildError> {
        Self::from_strands(&groom.into(), params, options)
    }

    /// Positions in world space and the groom's order, `[P]`, metres. Virtual particles are left out.
    pub fn positions(&self, out: &mut Vec<Vec3>) {
        let every = self.every as usize;
        // A strand of N particles of the groom has (N − 1) every + 1 here.
        let groom = |chain: usize, strands: usize| (chain + strands * (every - 1)) / every;
        out.resize(groom(self.model.particle_count, self.model.strand_count), Vec3::ZERO);
        for block in &self.model.blocks {
            for (lane, &strand) in block.strands[..block.live].iter().enumerate() {
                let strand = strand as usize;
                let from = groom(self.model.offsets[strand] as usize, strand);
                for (p, place) in block.range().step_by(every).enumerate() {
                    let relative = crate::state::vector(&self.state.positions, place, lane);
                    out[from + p] = (self.state.origin + Vec3::from_array(relative).as_dvec3()).as_vec3();
                }
            }
        }
    }
}

impl<T: SolverReal> Simulation<T> {
    /// A simulation of plain arrays: see [`Simulation::new`].
    ///
    /// # Errors
    /// As [`Simulation::new`].
    pub fn from_strands(
        strands: &Strands<'_, T>,
        params: impl Into<SolverParams>,
        options: &Options,
    ) -> Result<Self, BuildError> {
        let params = params.into();
        params.validate()?;
        let simd = options.simd.resolve();
        if !simd.is_supported() {
            return Err(BuildError::Simd(simd));
        }
        let model = Model::new(strands)?;
        let state = State::at_rest(&model, &options.rest_pose);
        let workspace = Workspace {
            scratch: scratch(&model),
            poses: Vec::with_capacity(params.substeps() as usize + 1),
            solid_poses: Vec::new(),
            wake: Wake::default(),
            canopy: Canopy::default(),
            motion: Vec::new(),
            exposure: Vec::new(),
        };
        let options = *options;
        let mut simulation = Self {
            model,
            state,
            workspace,
            params,
            options,
            every: 1,
            grid: None,
            sph: None,
            contacts: None,
        };
        simulation.prepare();
        Ok(simulation)
    }

    /// What a block does in its substeps, and after them.
    fn block_fns(&self) -> [BlockFn<T>; 2] {
        let task = match self.params {
            SolverParams::Ams(_) => Task::Ams,
            SolverParams::Dftl(_) => Task::Dftl,
        };
        [task, Task::Finish].map(|task| T::block_fn(task, self.options.simd.resolve()))
    }

    /// Makes what the solver asks for of model and state.
    pub(super) fn prepare(&mut self) {
        self.params.prepare(&mut self.model, &mut self.state);
    }

    /// The same, with only one in `every` particles of a strand the groom's.
    pub(super) fn keeping_every(self, every: u32) -> Self {
        Self { every, ..self }
    }

    /// Lets strands meet on a grid from the next frame on, or not any more.
    ///
    /// # Errors
    /// [`ParamsError`] if a parameter is out of range; nothing is changed then.
    pub fn set_grid(&mut self, params: Option<&GridParams>) -> Result<(), ParamsError> {
        self.grid = match params {
            None => None,
            Some(params) => {
                params.validate()?;
                Some(Grid::new(&self.model, params))
            }
        };
        Ok(())
    }

    /// Lets strands meet as smoothed particles from the next frame on, or not any more.
    ///
    /// # Errors
    /// [`ParamsError`] if a parameter is out of range; nothing is changed then.
    pub fn set_particles(&mut self, params: Option<&SphParams>) -> Result<(), ParamsError> {
        self.sph = match params {
            None => None,
            Some(params) => {
                params.validate()?;
                Some(Sph::new(&self.model, params, self.options.simd))
            }
        };
        Ok(())
    }

    /// Lets segments of strands touch from the next frame on, or not any more.
    ///
    /// # Errors
    /// [`ParamsError`] if a parameter is out of range; nothing is changed then.
    pub fn set_contacts(&mut self, params: Option<&ContactParams>) -> Result<(), ParamsError> {
        self.contacts = match params {
            None => None,
            Some(params) => {
                params.validate()?;
                Some(Contacts::new(&self.model, params, self.options.simd.resolve()))
            }
        };
        Ok(())
    }

    /// Makes the workspace anew for a model that has changed.
    pub(super) fn fit_workspace(&mut self) {
        self.workspace.scratch = scratch(&self.model);
        self.workspace.canopy = Canopy::default();
        self.grid = self.grid.take().map(|grid| Grid::new(&self.model, grid.params()));
        self.sph = self.sph.take().map(|sph| Sph::new(&self.model, sph.params(), self.options.simd));
        let simd = self.options.simd.resolve();
        self.contacts = self.contacts.take().map(|c| Contacts::new(&self.model, c.params(), simd));
    }

    /// Where strands meet.
    pub fn meeting(&self) -> Meeting {
        Meeting {
            grid: self.grid.is_some(),
            particles: self.sph.is_some(),
            contacts: self.contacts.is_some(),
        }
    }

    /// Advances by a frame. Allocates nothing once it has seen a frame with as many solids, as large a box of hair on the grid and as many contacts.
    ///
    /// # Errors
    /// [`ParamsError`] if the frame's time and stiffness are beyond float32, or the time is not positive.
    pub fn step_frame(&mut self, frame: &Frame<'_>) -> Result<FrameReport, ParamsError> {
        self.step_frame_in(frame, None)
    }

    /// The same in a `wind` that is not the same everywhere; the frame's own air velocity comes on top.
    ///
    /// # Errors
    /// As [`Simulation::step_frame`].
    pub fn step_frame_in(
        &mut self,
        frame: &Frame<'_>,
        wind: Option<&WindField>,
    ) -> Result<FrameReport, ParamsError> {
        let meets = self.grid.is_some() || self.contacts.is_some();
        let looks_last =
            FrameStep::all(&self.params, self.meeting()).any(|step| step == FrameStep::LastSolids);
        let substeps = 0..self.params.substeps() as usize;
        let lengths = matches!(self.params, SolverParams::Ams(_));
        let before = Part { substeps, solves: true, looks: true, lengths, ..Part::default() };
        let after = Part { looks_last, checks: true, ..Part::default() };
        let work = if meets {
            Work { notes: true, particles: true, before, grid: true, contacts: true, after: Some(after) }
        } else {
            let before = Part { looks_last, checks: true, ..before };
            Work { particles: true, before, ..Work::default() }
        };
        self.work(frame, wind, work)
    }

    /// One step of a frame, for whoever runs some of them elsewhere. All steps of a frame in their order ([`FrameStep::all`]) leave the state of a frame, bit for bit, but that wind that is not the same everywhere is
    /// sampled in each substep anew; others first would find hair away from the frame's origin, where the first substep brings it. What a step does not tell is zero in its report.
    ///
    /// # Errors
    /// As [`Simulation::step_frame`].
    pub fn step_part(
        &mut self,
        frame: &Frame<'_>,
        wind: Option<&WindField>,
        step: FrameStep,
    ) -> Result<FrameReport, ParamsError> {
        let nothing = Part::default();
        let substep = |k: u32| k as usize..k as usize + 1;
        let before = match step {
            FrameStep::SolveStrands(k) => Part { substeps: substep(k), solves: true, ..nothing },
            FrameStep::FollowLeader => Part { substeps: 0..1, solves: true, looks: true, ..nothing },
            FrameStep::ResolveSolids(k) => Part { substeps: substep(k), looks: true, ..nothing },
            FrameStep::RestoreLengths => Part { lengths: true, ..nothing },
            FrameStep::LastSolids => Part { looks_last: true, ..nothing },
            FrameStep::CheckStrands => Part { checks: true, ..nothing },
            FrameStep::NoteStart | FrameStep::Particles | FrameStep::Grid | FrameStep::Contacts => nothing,
        };
        let (grid, contacts) = (step == FrameStep::Grid, step == FrameStep::Contacts);
        let after = (grid || contacts).then(Part::default);
        let (notes, particles) = (step == FrameStep::NoteStart, step == FrameStep::Particles);
        self.work(frame, wind, Work { notes, particles, before, grid, contacts, after })
    }

    /// Does some `work` of a frame.
    fn work(
        &mut self,
        frame: &Frame<'_>,
        wind: Option<&WindField>,
        work: Work,
    ) -> Result<FrameReport, ParamsError> {
        self.params.validate_step(frame.dt_secs, self.options.beyond_float32 || size_of::<T>() > 4)?;
        let origin = frame.origin(&self.model);
        let shift = self.state.origin - origin;
        if let Some(contacts) = self.contacts.as_mut().filter(|_| work.notes) {
            let head = self.model.about_centre(&frame.head[0], self.state.origin);
            contacts.note_start(&self.model, &self.state.positions, &head);
        }
        let pushed = match self.sph.as_mut().filter(|_| work.particles) {
            Some(sph) => sph.push(&mut self.state, frame.dt_secs),
            None => SphReport::default(),
        };
        // Positions go to the frame's origin in the first substep.
        if (work.notes || work.particles) && work.before == Part::default() {
            return Ok(report(
                &BlockReport::default(),
                (GridReport::default(), ContactReport::default(), pushed),
            ));
        }
        self.state.origin = origin;
        let terms = StrandTerms::new(&self.params, frame.dt_secs);
        let (h, clamped) =
            (frame.dt_secs / f64::from(self.params.substeps()), self.params.clamped() as usize);
        let (inextensibility, damping) = self.params.inextensibility();
        self.workspace.place(&self.params, frame, &self.model, origin);
        // Drag that differs from particle to particle goes the way of a wind that does.
        let still = terms.is_slender().then_some(WindField::default());
        let wind = wind.copied().or(still).filter(|_| work.before.solves);
        let wind = wind.map(|wind| WindField { mean: wind.mean + frame.air_velocity, ..wind });
        if let Some(wind) = wind.filter(|wind| wind.shelter > 0.0) {
            self.workspace.wake.update(frame.colliders, origin, self.model.reach, wind.mean);
        }
        if let Some(wind) = wind.filter(|wind| wind.hair_depth > 0.0) {
            let hair = PlacedHair { positions: &self.state.positions, shift };
            self.workspace.canopy.update(&self.model, &hair, wind.mean, wind.hair_depth);
        }
        let job = FrameJob {
            part: work.before,
            terms: &terms,
            h,
            clamped,
            poses: &self.workspace.poses,
            lengths: LengthTerms { kind: inextensibility, damping, dt_secs: frame.dt_secs, clamped },
            gravity: frame.gravity,
            rest_gravity: self.options.carried_gravity(),
            air_velocity: frame.air_velocity,
            air: wind
                .map(|wind| AirTerms::new(&wind, (&self.workspace.wake, &self.workspace.canopy), origin)),
            shift,
            solids: frame.colliders,
            solid_poses: &self.workspace.solid_poses,
            lay_along: self.params.lays_along(),
            skin_thickness: self.params.skin_thickness(),
            way_out: self.params.depenetration_speed() * h,
        };
        let mut crew = Crew {
            job,
            model: &self.model,
            scratch: &self.workspace.scratch,
            exposure: &self.workspace.exposure,
            block_fns: self.block_fns(),
        };
        let before = if crew.job.part == Part::default() {
            BlockReport::default()
        } else {
            crew.run(&self.model.blocks, 0, Arrays::of(&mut self.state))
        };
        let Some(after) = work.after else {
            return Ok(report(&before, (GridReport::default(), ContactReport::default(), pushed)));
        };
        let [.., last, now] = &*self.workspace.poses else { return Ok(FrameReport::default()) };
        let met = self.grid.as_mut().filter(|_| work.grid).map_or_else(GridReport::default, |grid| {
            let moment = GridMoment {
                frame: GridFrame::new(last, now, h),
                solids: frame.colliders,
                last_substep: 1.0 - 1.0 / f64::from(self.params.substeps()),
                origin,
                clamped,
                dt_secs: frame.dt_secs,
            };
            let moving = (&mut self.workspace.motion, h);
            let report = with_motion(&mut self.state, moving, |positions, velocities| {
                grid.exchange(&self.model, positions, velocities, &moment)
            });
            let clearance = &mut self.state.clearance;
            if report.farthest_m > 0.0 {
                let moved = crate::state::number(report.farthest_m);
                let note = |row: &mut Row<T>| row.0.iter_mut().for_each(|own| note_one(own, moved));
                clearance.par_iter_mut().with_min_len(1024).for_each(note);
            }
            report
        });
        let touched = self.contacts.as_mut().filter(|_| work.contacts).map_or_else(
            ContactReport::default,
            |contacts| {
                // Apart for a while, for what moves is told by all the rest.
                let mut clearance = std::mem::take(&mut self.state.clearance);
                let moving = (&mut self.workspace.motion, h);
                let report = with_motion(&mut self.state, moving, |positions, velocities| {
                    let rows = (positions, velocities, &mut *clearance);
                    contacts.resolve(&self.model, rows, now, (clamped, frame.dt_secs))
                });
                self.state.clearance = clearance;
                report
            },
        );
        // Followers get their lengths back after the last step in which strands meet.
        let follows = matches!(self.params, SolverParams::Dftl(_)) && self.grid.is_some();
        let was_last = if self.contacts.is_some() { work.contacts } else { work.grid };
        crew.job.part = Part { lengths: touched.contacts > 0 || (follows && was_last), ..after };
        let after = crew.run(&self.model.blocks, 0, Arrays::of(&mut self.state));
        Ok(report(&before.then(&after), (met, touched, pushed)))
    }

    /// The model.
    pub fn model(&self) -> &Model<T> {
        &self.model
    }

    /// The state.
    pub fn state(&self) -> &State<T> {
        &self.state
    }

    /// The state, to be changed from outside.
    pub fn state_mut(&mut self) -> &mut State<T> {
        &mut self.state
    }

    /// The parameters.
    pub fn params(&self) -> &SolverParams {
        &self.params
    }

    /// How it runs.
    pub fn options(&self) -> &Options {
        &self.options
    }

    /// Changes the parameters from the next frame on, and with them, if they are of another one, the solver.
    ///
    /// # Errors
    /// [`ParamsError`] if one is out of range; nothing is changed then.
    pub fn set_params(&mut self, params: impl Into<SolverParams>) -> Result<(), ParamsError> {
        let params = params.into();
        params.validate()?;
        self.params = params;
        self.prepare();
        Ok(())
    }

    /// Share of the wind that reaches each particle, 0 to 1, a row a place of the model: all 1 until changed. For what finds out how much
    /// hair stands in the wind's way; it counts in a wind field ([`Simulation::step_frame_in`]) only.
    pub fn air_exposure(&mut self) -> &mut [Row<T>] {
        let places = self.model.places();
        self.workspace.exposure.resize(places, Row([T::one(); crate::lane::LANES]));
        &mut self.workspace.exposure
    }

    /// A copy of the state that resumes bit for bit.
    pub fn snapshot(&self) -> Snapshot<T> {
        self.state.snapshot(&self.model)
    }

    /// Goes back to a snapshot.
    ///
    /// # Errors
    /// [`SnapshotError`] if it is of another groom.
    pub fn restore(&mut self, snapshot: &Snapshot<T>) -> Result<(), SnapshotError> {
        self.state.restore(&self.model, snapshot)
    }

    /// Forgets where solids were: to be called when the set of solids changes.
    pub fn forget_solids(&mut self) {
        for row in &mut self.state.clearance {
            row.0.fill(T::neg_infinity());
        }
    }

    /// The head jumps from pose `from` to pose `to` between frames.
    pub fn teleport(&mut self, from: &Pose, to: &Pose, mode: Teleport) {
        if mode == Teleport::Reset {
            self.state = State::at_rest(&self.model, to);
            self.prepare();
            return;
        }
        let jump = to.after(&from.inverse());
        let origin = jump.transform_point(self.state.origin);
        let State { positions, previous, .. } = &mut self.state;
        for rows in positions.chunks_exact_mut(3).chain(previous.chunks_exact_mut(3)) {
            turn(rows, &jump);
        }
        for rows in self.state.velocities.chunks_exact_mut(3) {
            if mode == Teleport::CarryShape && self.state.previous.is_empty() {
                rows.fill(Row([T::zero(); crate::lane::LANES]));
            } else {
                turn(rows, &jump);
            }
        }
        self.state.origin = origin;
        if let (SolverParams::Dftl(params), Teleport::CarryShape) = (&self.params, mode) {
            // Without motion, but with the load that followers' velocities hold.
            self.state.stop(params.usual_step());
        }
        self.forget_solids();
    }

    /// A 64-bit hash of the state: see [`Snapshot::hash`].
    pub fn state_hash(&self) -> u64 {
        self.snapshot().hash()
    }

    /// Bytes held.
    pub fn memory(&self) -> Memory {
        let locked = |s: &Mutex<Scratch<T>>| s.lock().unwrap_or_else(PoisonError::into_inner).bytes();
        Memory {
            model: self.model.bytes(),
            state: self.state.bytes(),
            workspace: self.workspace.scratch.iter().map(locked).sum::<usize>()
                + size_of_val(&*self.workspace.poses)
                + size_of_val(&*self.workspace.solid_poses)
                + size_of_val(&*self.workspace.exposure)
                + size_of_val(&*self.workspace.motion)
                + self.workspace.wake.bytes()
                + self.workspace.canopy.bytes()
                + self.grid.as_ref().map_or(0, Grid::bytes)
                + self.contacts.as_ref().map_or(0, Contacts::bytes)
                + self.sph.as_ref().map_or(0, Sph::bytes),
        }
    }
}

/// Scratch for every thread.
fn scratch<T: SolverReal>(model: &Model<T>) -> Vec<Mutex<Scratch<T>>> {
    let threads = rayon::current_num_threads().max(1);
    (0..threads).map(|_| Mutex::new(Scratch::new(model.longest()))).collect()
}

/// Lets `change` have positions and velocities of `state`: those with which hair moves, where the state remembers how it moved, for its own hold the load handed up as well. `motion` is room for them,
/// the step takes `h` seconds.
fn with_motion<T: SolverReal, R>(
    state: &mut State<T>,
    (motion, h): (&mut Vec<Row<T>>, f64),
    change: impl FnOnce(&mut [Row<T>], &mut [Row<T>]) -> R,
) -> R {
    let State { positions, velocities, previous, .. } = state;
    if previous.is_empty() {
        return change(positions, velocities);
    }
    let inverse_h = crate::state::number::<T>(1.0 / h);
    motion.resize(previous.len(), Row([T::zero(); crate::lane::LANES]));
    let rows = motion.par_iter_mut().zip(&mut *velocities).zip(positions.par_iter().zip(&*previous));
    rows.with_min_len(1024).for_each(|((u, v), (x, before))| {
        for k in 0..crate::lane::LANES {
            u.0[k] = (x.0[k] - before.0[k]) * inverse_h;
            v.0[k] = v.0[k] - u.0[k];
        }
    });
    let result = change(positions, motion);
    let add = |(v, u): (&mut Row<T>, &Row<T>)| (0..crate::lane::LANES).for_each(|k| v.0[k] = v.0[k] + u.0[k]);
    velocities.par_iter_mut().zip(&*motion).with_min_len(1024).for_each(add);
    result
}

/// Turns the vectors in three rows.
fn turn<T: SolverReal>(rows: &mut [Row<T>], jump: &Pose) {
    for lane in 0..crate::lane::LANES {
        let v = DVec3::from_array([0, 1, 2].map(|c| rows[c].0[lane].to_f64().unwrap_or(0.0)));
        for (row, x) in rows.iter_mut().zip(jump.transform_vector(v).to_array()) {
            row.0[lane] = crate::state::number(x);
        }
    }
}

impl<T: SolverReal> Workspace<T> {
    /// Poses of head and solids at the substeps, relative to `origin`.
    fn place(&mut self, params: &SolverParams, frame: &Frame<'_>, model: &Model<T>, origin: DVec3) {
        self.poses.clear();
        self.poses.extend(frame.poses(model, params.substeps(), origin));
        self.solid_poses.clear();
        for fractions in fractions(params.substeps()) {
            self.solid_poses
                .extend(frame.colliders.iter().map(|solid| SolidPose::new(solid, fractions, origin)));
        }
    }
}

/// What is to be done of a frame.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct Work {
    /// Contacts note where hair is.
    notes: bool,
    /// Whether smoothed particles push each other, if there are any.
    particles: bool,
    /// What strands do by themselves before they meet.
    before: Part,
    /// Whether they meet, if there is a grid, and touch, if there are contacts.
    grid: bool,
    contacts: bool,
    /// What they do after.
    after: Option<Part>,
}

/// The state's arrays, or the part of them that some blocks own.
struct Arrays<'a, T> {
    positions: &'a mut [Row<T>],
    velocities: &'a mut [Row<T>],
    integrity: &'a mut [Row<T>],
    clearance: &'a mut [Row<T>],
    /// Empty, or as long as the positions.
    previous: &'a mut [Row<T>],
}

impl<'a, T> Arrays<'a, T> {
    fn of(state: &'a mut State<T>) -> Self {
        Self {
            positions: &mut state.positions,
            velocities: &mut state.velocities,
            integrity: &mut state.integrity,
            clearance: &mut state.clearance,
            previous: &mut state.previous,
        }
    }

    fn split(self, places: usize) -> (Self, Self) {
        let (positions, positions_right) = self.positions.split_at_mut(3 * places);
        let (velocities, velocities_right) = self.velocities.split_at_mut(3 * places);
        let (integrity, integrity_right) = self.integrity.split_at_mut(places);
        let (clearance, clearance_right) = self.clearance.split_at_mut(places);
        let remembered = (3 * places).min(self.previous.len());
        let (previous, previous_right) = self.previous.split_at_mut(remembered);
        (
            Self { positions, velocities, integrity, clearance, previous },
            Self {
                positions: positions_right,
                velocities: velocities_right,
                integrity: integrity_right,
                clearance: clearance_right,
                previous: previous_right,
            },
        )
    }
}

/// Runs blocks over the threads of the pool, halving the work as it goes: no allocation, and no result that depends on
/// who did what.
struct Crew<'a, T> {
    job: FrameJob<'a, T>,
    model: &'a Model<T>,
    scratch: &'a [Mutex<Scratch<T>>],
    exposure: &'a [Row<T>],
    /// For the substeps, and for what comes after them.
    block_fns: [BlockFn<T>; 2],
}

impl<T: SolverReal> Crew<'_, T> {
    fn run(&self, blocks: &[Block], index: usize, arrays: Arrays<'_, T>) -> BlockReport {
        match blocks {
            [] => BlockReport::default(),
            [block] => self.run_block(block, index, arrays),
            _ => {
                let middle = blocks.len() / 2;
                let (left, right) = blocks.split_at(middle);
                let (left_arrays, right_arrays) = arrays.split(right[0].first - left[0].first);
                let (a, b) = rayon::join(
                    || self.run(left, index, left_arrays),
                    || self.run(right, index + middle, right_arrays),
                );
                a.merge(b)
            }
        }
    }

    fn run_block(&self, block: &Block, index: usize, arrays: Arrays<'_, T>) -> BlockReport {
        let rows = 3 * block.first..3 * (block.first + block.particles);
        let worker = rayon::current_thread_index().unwrap_or(0) % self.scratch.len();
        let mut scratch = self.scratch[worker].lock().unwrap_or_else(PoisonError::into_inner);
        let mut air = scratch.take_air();
        let blown = if self.job.air.is_some() { block.particles } else { 0 };
        let (wind, rest) = air[..AIR_ROWS * blown].split_at_mut(3 * blown);
        let (drawn, drag) = rest.split_at_mut(3 * blown);
        let mut view = BlockView {
            particles: block.particles,
            rest: &self.model.rest[rows.clone()],
            rest_lengths: &self.model.rest_lengths[rows.clone()],
            inverse_edges: &self.model.inverse_edges[block.range()],
            local: self.model.local.get(rows.clone()).unwrap_or_default(),
            strand_length: &self.model.strand_lengths[index],
            stiffness: &self.model.stiffness[index],
            positions: arrays.positions,
            previous: arrays.previous,
            velocities: arrays.velocities,
            integrity: arrays.integrity,
            clearance: arrays.clearance,
            exposure: self.exposure.get(block.range()).unwrap_or_default(),
            wind,
            air: drawn,
            drag,
        };
        let mut report = BlockReport::default();
        let part = &self.job.part;
        let [substeps, finish] = self.block_fns;
        if !part.substeps.is_empty() {
            // SAFETY: `Simulation::from_strands` checked that the processor supports the instruction set.
            report = unsafe { substeps(&self.job, &mut view, block.live, &mut scratch) };
        }
        if part.lengths || part.looks_last || part.checks {
            // SAFETY: as above.
            let after = unsafe { finish(&self.job, &mut view, block.live, &mut scratch) };
            report = report.finished(after, part.looks_last);
        }
        scratch.put_air(air);
        report
    }
}

fn report(
    sum: &BlockReport,
    (grid, strand_contacts, particles): (GridReport, ContactReport, SphReport),
) -> FrameReport {
    let [splat, solve, gather] = grid.secs;
    let [find, resolve] = strand_contacts.secs;
    let [near, push] = particles.secs;
    let shared = [splat, solve, gather, find, resolve, near, push];
    #[expect(clippy::cast_precision_loss, reason = "nanoseconds of a frame, and threads")]
    let secs = |k: usize| match k.checked_sub(BLOCK_STAGES) {
        None => sum.stage_nanos[k] as f64 * 1e-9,
        Some(k) => shared[k] * rayon::current_num_threads() as f64,
    };
    FrameReport {
        max_edge_stretch: sum.max_edge_stretch,
        max_edge_stretch_final: sum.max_edge_stretch_final,
        max_penetration_m: sum.contacts.deepest,
        touching: sum.contacts.touching,
        quarantined_strands: sum.quarantined,
        grid,
        strand_contacts,
        particles,
        stage_secs: std::array::from_fn(|k| (STAGES[k], secs(k))),
    }
}
