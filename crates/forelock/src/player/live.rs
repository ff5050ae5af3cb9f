//! All of a running player that changes from frame to frame, but for the solver's state.

use std::sync::{Arc, OnceLock};

use forelock_core::air::{Wind, WindParams};
use forelock_core::body::Motion;
use forelock_core::frame::StepRate;
use forelock_core::pose::Pose;
use forelock_core::simulation::Teleport;
use forelock_core::solver::Solver;
use glam::{DVec3, Vec3};

use super::ColliderId;
use super::bending::ShownSkin;
use super::engine::Solvers;
use super::error::PlayerError;
use super::regrooming::Grooming;
use super::report::Counters;
use super::track::Track;
use crate::assets::{Assets, Solid};
use crate::backend::Parts;
use crate::neural::Learned;
use crate::penetration::MeasuredSolid;
use crate::scene::{InteractionSection, Scene, SolverSection};

/// Share of a step within which two times are the same.
const STEP_ROUNDING: f64 = 1e-6;

/// The parameters of a running simulation.
#[derive(Clone, Debug)]
pub(super) struct Setting {
    pub solver: Arc<SolverSection>,
    /// What `solver` resolves to.
    pub params: Arc<Solver<f32>>,
    pub interaction: Arc<InteractionSection>,
    pub gravity: DVec3,
    pub wind: Arc<Wind>,
    /// The trained model that moves the strands, if one does.
    pub learned: Option<Arc<Learned>>,
}

impl Setting {
    fn new(scene: &Scene, assets: &Assets, solvers: &Solvers) -> Result<Self, PlayerError> {
        Ok(Self {
            params: Arc::new(solvers.solver(&scene.solver)?),
            solver: Arc::new(scene.solver.clone()),
            interaction: Arc::new(scene.interaction.clone()),
            gravity: DVec3::from_array(scene.gravity),
            wind: Arc::new(wind(scene, &scene.wind)?),
            learned: Learned::of(scene, assets)?.map(Arc::new),
        })
    }

    /// What a simulation is built from.
    pub fn parts(&self) -> Parts<'_> {
        Parts {
            solver: &self.params,
            interactions: self.interaction.interactions(),
            learned: self.learned.as_ref(),
        }
    }

    /// The step of a solver with a fixed step, seconds.
    fn own_step_secs(&self) -> Option<f64> {
        match self.params.rate() {
            StepRate::Fixed(secs) => Some(secs),
            StepRate::PerFrame => None,
        }
    }

    /// Particles of a strand of the groom that are fixed to the head.
    pub fn clamped(&self) -> u32 {
        self.params.clamped() as u32
    }

    /// Whether the state holds the positions of the step before.
    pub fn stores_step_before(&self) -> bool {
        self.params.channels().previous
    }

    /// Substeps of a frame of `dt_secs`, 1 for a solver without them.
    pub fn substeps(&self, dt_secs: f64) -> u32 {
        self.params.rules().substeps(dt_secs)
    }
}

/// The wind of `params`, with the seed of `scene`, which is that of everything random.
pub(super) fn wind(scene: &Scene, params: &WindParams) -> Result<Wind, PlayerError> {
    let params = WindParams { seed: scene.seed.wrapping_add(params.seed), ..params.clone() };
    Wind::new(&params).map_err(PlayerError::Wind)
}

/// The clock of a solver with a fixed step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct OwnClock {
    pub step_secs: f64,
    /// When its steps began.
    pub since_secs: f64,
    /// Steps done since.
    pub done: u64,
}

impl OwnClock {
    /// Time of step `step`, seconds.
    pub fn secs(&self, step: u64) -> f64 {
        let rate = (1.0 / self.step_secs).round();
        // A whole number of steps a second: the times are those of frames at that rate, to the bit.
        if (rate * self.step_secs - 1.0).abs() < 1e-12 {
            return self.since_secs + step as f64 / rate;
        }
        self.since_secs + step as f64 * self.step_secs
    }

    /// Steps that begin before `secs`.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a count of steps")]
    pub fn steps_until(&self, secs: f64) -> u64 {
        let steps = (secs - self.since_secs) / self.step_secs;
        (steps - STEP_ROUNDING).ceil().max(0.0) as u64
    }

    /// Share of the last step that has passed at `secs`.
    #[expect(clippy::cast_possible_truncation, reason = "a share")]
    pub fn share(&self, secs: f64) -> f32 {
        let share = (1.0 - (self.secs(self.done) - secs) / self.step_secs).clamp(0.0, 1.0);
        // Up to rounding the last step is the frame itself.
        if share > 1.0 - STEP_ROUNDING { 1.0 } else { share as f32 }
    }
}

/// A solid of a running simulation.
#[derive(Clone, Debug)]
pub(super) struct LiveSolid {
    pub id: ColliderId,
    pub solid: Arc<Solid>,
    /// Its motion, relative to the head or the world.
    pub track: Track,
    /// The pose of its motion at the time that the simulation has reached.
    pub at: Pose,
    /// What carries it at the frame before the one shown, and at that.
    pub shown: [Pose; 2],
    /// Whether it was there in the last step.
    pub was_there: bool,
}

impl LiveSolid {
    fn new(id: u32, solid: &Arc<Solid>, head: &Pose) -> Self {
        let track = Track::Motion(solid.motion().clone());
        let at = track.pose(0.0);
        let shown = [solid.carrier(head, &at); 2];
        let was_there = solid.is_there(0.0);
        Self { id: ColliderId(id), solid: solid.clone(), track, at, shown, was_there }
    }
}

/// All that changes from frame to frame, but for the solver's state.
#[derive(Clone, Debug)]
pub(super) struct Live {
    /// Frames done.
    pub frame: u32,
    pub fps: f64,
    pub setting: Setting,
    pub own_clock: Option<OwnClock>,
    pub head: Track,
    /// The head's pose at the time that the simulation has reached.
    pub head_at: Pose,
    /// The time of the pose that a body that bends has, seconds.
    pub bent_secs: f64,
    /// Its skin at the frame, once it has been asked for, if hair collides with it.
    pub shown_skin: OnceLock<Option<Arc<ShownSkin>>>,
    /// Its poses at start and end of the last step.
    pub step_heads: [Pose; 2],
    /// Positions that are simulated before the last step, if the frame lies within that step and
    /// the state does not hold them: world space, metres.
    pub before: Option<Arc<[Vec3]>>,
    /// Its pose at the frame.
    pub head_shown: Pose,
    pub solids: Vec<LiveSolid>,
    pub next_collider: u32,
    pub grooming: Grooming,
    /// A teleport from outside, for the next step.
    pub teleport: Option<Teleport>,
    /// How many changes of the timeline are in here.
    pub applied: usize,
    pub counters: Counters,
}

impl Live {
    pub fn new(scene: &Scene, assets: &Assets, solvers: &Solvers) -> Result<Self, PlayerError> {
        let head = Track::Motion(assets.head_motion().clone());
        let at = head.pose(0.0);
        // Number 0 is the body's, whether it collides or not.
        let first = u32::from(!assets.body_collides());
        let solids: Vec<_> =
            (first..).zip(assets.solids()).map(|(id, solid)| LiveSolid::new(id, solid, &at)).collect();
        let mut live = Self {
            frame: 0,
            fps: scene.time.fps,
            setting: Setting::new(scene, assets, solvers)?,
            own_clock: None,
            head,
            head_at: at,
            bent_secs: 0.0,
            shown_skin: OnceLock::new(),
            step_heads: [at; 2],
            before: None,
            head_shown: at,
            next_collider: solids.last().map_or(1, |solid| solid.id.0 + 1),
            solids,
            grooming: Grooming::new(scene),
            teleport: None,
            applied: 0,
            counters: Counters::default(),
        };
        live.start_clock(0.0);
        Ok(live)
    }

    /// The time of the pose that a body that bends has at the end of a step until `secs`: it stays
    /// as it is while the head is dragged.
    pub fn bends_until(&self, secs: f64) -> f64 {
        match &self.head {
            Track::Motion(motion) if matches!(**motion, Motion::Joint(_)) => secs,
            _ => self.bent_secs,
        }
    }

    /// Time of frame `frame`, seconds.
    pub fn frame_secs(&self, frame: u32) -> f64 {
        f64::from(frame) / self.fps
    }

    /// Time of the frame that is shown, seconds.
    pub fn shown_secs(&self) -> f64 {
        self.frame_secs(self.frame)
    }

    /// The time that the simulation has reached, seconds: not before that of the frame.
    pub fn simulated_secs(&self) -> f64 {
        self.own_clock.map_or_else(|| self.shown_secs(), |clock| clock.secs(clock.done))
    }

    /// Length of a step, seconds.
    pub fn step_secs(&self) -> f64 {
        self.own_clock.map_or(1.0 / self.fps, |clock| clock.step_secs)
    }

    /// Whether the next frame is shown before a step that ends at `secs`.
    pub fn ends_within(&self, secs: f64) -> bool {
        let next = self.frame_secs(self.frame + 1);
        self.own_clock.is_some_and(|clock| secs - next > STEP_ROUNDING * clock.step_secs)
    }

    /// Starts the clock of a solver with a fixed step at `secs`.
    fn start_clock(&mut self, secs: f64) {
        let step_secs = self.setting.own_step_secs();
        self.own_clock = step_secs.map(|step_secs| OwnClock { step_secs, since_secs: secs, done: 0 });
    }

    /// The solver's parameters have changed: keeps the clock if its rate is the same.
    pub fn set_solver(&mut self, solver: Arc<SolverSection>, params: Arc<Solver<f32>>) {
        let secs = self.simulated_secs();
        (self.setting.solver, self.setting.params) = (solver, params);
        if self.own_clock.map(|clock| clock.step_secs) != self.setting.own_step_secs() {
            self.start_clock(secs);
        }
    }

    /// The solids of the last step, or all that there ever are, from the frame before to the one
    /// that is shown, with their exact surfaces.
    pub fn measured_solids<'a>(&'a self, assets: &'a Assets, ever: bool) -> Vec<MeasuredSolid<'a>> {
        let skin = self.shown_skin.get_or_init(|| {
            let secs = self.bends_until(self.shown_secs());
            ShownSkin::new(assets, secs).map(Arc::new)
        });
        let head = [self.head_shown; 2];
        let skin = skin.as_ref().zip(assets.bending_solid()).map(|(skin, solid)| skin.measured(solid, head));
        let secs = self.frame_secs(self.frame.saturating_sub(1));
        let others = self.solids.iter().filter(|live| ever || live.was_there).map(|live| MeasuredSolid {
            frame: live.solid.frame_between(secs, live.shown),
            surface: live.solid.surface(),
        });
        skin.into_iter().chain(others).collect()
    }

    /// Starts and ends of the steps of the next frame, seconds. A frame that is shorter than a step
    /// may have none.
    pub fn next_steps(&self) -> Vec<[f64; 2]> {
        let end_secs = self.frame_secs(self.frame + 1);
        match self.own_clock {
            None => vec![[self.shown_secs(), end_secs]],
            Some(clock) => {
                let steps = clock.done..clock.steps_until(end_secs);
                steps.map(|step| [step, step + 1].map(|step| clock.secs(step))).collect()
            }
        }
    }

    /// The next of [`Self::next_steps`] is done.
    pub fn step_done(&mut self) {
        if let Some(clock) = &mut self.own_clock {
            clock.done += 1;
        }
    }

    /// A teleport takes a head that is dragged to its place at once.
    pub fn end_teleported_drag(&mut self) {
        if let (Some(_), Track::Drag(drag)) = (self.teleport, &mut self.head) {
            drag.from = drag.to;
        }
    }

    /// Moves the head and the solids on by a frame, without hair. `stepped` is called after each
    /// step, with its start and end, seconds, and whether the head was teleported in it.
    pub fn follow_frame(&mut self, mut stepped: impl FnMut(&Self, [f64; 2], bool)) {
        for times in self.next_steps() {
            self.end_teleported_drag();
            let teleport = self.teleport.take();
            self.head_at = self.head.pose(times[1]);
            for live in &mut self.solids {
                live.at = live.track.pose(times[1]);
            }
            self.step_done();
            stepped(self, times, teleport.is_some());
        }
        self.show_next_frame();
    }

    /// One frame more is done: poses at its time.
    pub fn show_next_frame(&mut self) {
        self.frame += 1;
        let secs = self.shown_secs();
        self.head_shown = self.head.pose(secs);
        self.shown_skin = OnceLock::new();
        for live in &mut self.solids {
            let motion = live.track.pose(secs);
            live.shown = [live.shown[1], live.solid.carrier(&self.head_shown, &motion)];
        }
    }
}
