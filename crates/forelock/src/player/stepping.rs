//! One frame: edits that are due, the steps of the solver, and jumps of the head.

use forelock_core::pose::Pose;
use forelock_core::simulation::Teleport;
use forelock_core::strands::Snapshot;
use glam::Vec3;

use super::bending::BentRoots;
use super::between;
use super::engine::Step;
use super::regrooming::EditContext;
use super::report::{Jump, StepReport};
use super::{Player, PlayerError};

/// The head in one step.
struct HeadStep {
    /// Its poses at start and end, after a jump at the start.
    poses: [Pose; 2],
    /// A jump that is simulated as a teleport.
    jump: Option<Jump>,
}

impl Player {
    /// Simulates the next frame.
    ///
    /// # Errors
    /// [`PlayerError`] if an edit that is due cannot be done, the solver refuses the step, or the
    /// GPU fails.
    pub fn step(&mut self) -> Result<StepReport, PlayerError> {
        self.apply_due_edits()?;
        let mut report = StepReport { frame: self.live.frame + 1, ..StepReport::default() };
        let before = self.live.clone();
        for times in self.live.next_steps() {
            let stepped = self.step_between(times, &mut report);
            if stepped.is_err() {
                self.live = before;
                return stepped.map(|()| report);
            }
            self.live.step_done();
        }
        self.live.show_next_frame();
        self.live.counters.add(&report);
        self.reached = self.reached.max(self.live.frame);
        self.keep_state()?;
        self.repeat_due_changes()?;
        Ok(report)
    }

    /// Does the scene's timed edits that are due at the present frame, which are otherwise done at
    /// the start of the next step.
    ///
    /// # Errors
    /// [`PlayerError`] if one cannot be done.
    pub fn apply_due_edits(&mut self) -> Result<(), PlayerError> {
        let secs = self.live.shown_secs();
        if !self.live.grooming.is_due(secs) {
            return Ok(());
        }
        let Self { scene, assets, engine, live, .. } = self;
        let mut context = EditContext { scene, assets, engine, head: live.head_at };
        live.grooming.advance(secs, &mut context)
    }

    /// One step of the solver between two `times`, seconds.
    fn step_between(&mut self, times: [f64; 2], report: &mut StepReport) -> Result<(), PlayerError> {
        self.live.end_teleported_drag();
        let HeadStep { poses: head, jump } = self.head_step(times);
        self.live.teleport = None;
        let bent_until = self.live.bends_until(times[1]);
        let poses_roots = self.engine.simulator().poses_roots();
        let bent = self.bending.as_mut().map(|bending| {
            bending.follow(&self.assets, self.live.grooming.groom.as_ref());
            // A reset takes the body to its pose at the end of the step; hair that is carried
            // follows what the body bends in the step, as without a jump.
            let is_reset = jump.as_ref().is_some_and(|jump| jump.mode == Teleport::Reset);
            let from = if is_reset { bent_until } else { self.live.bent_secs };
            // Hair that is put to rest needs the motions.
            bending.at(&self.assets, [from, bent_until], poses_roots && !is_reset)
        });
        let roots = bent.map(|body| body.roots);
        if let Some(jump) = &jump {
            self.engine.simulator().teleport(&self.live.head_at, &head[0], jump.mode)?;
            let is_reset = jump.mode == Teleport::Reset;
            if let Some(frames) = roots.and_then(BentRoots::at_start).filter(|_| is_reset) {
                self.engine.simulator().rest_on(&head[0], frames)?;
            }
            report.teleports.push(*jump);
        }
        let mut jumped = false;
        let mut ends = Vec::with_capacity(self.live.solids.len());
        let mut frames = Vec::with_capacity(self.live.solids.len() + 1);
        frames.extend(bent.and_then(|body| body.solid(head)));
        for live in &self.live.solids {
            // A solid is not swept across a jump of its motion.
            let across = live.track.jump_between(times);
            jumped |= across.is_some();
            let from = across.map_or(live.at, |across| across.after(&live.at));
            let to = live.track.pose(times[1]);
            let is_there = live.solid.acts_between(times);
            jumped |= is_there != live.was_there;
            ends.push((to, is_there));
            if is_there {
                let carriers = [live.solid.carrier(&head[0], &from), live.solid.carrier(&head[1], &to)];
                frames.push(live.solid.frame_between(times[0], carriers));
            }
        }
        if jumped && jump.is_none() {
            self.engine.simulator().forget_solids()?;
        }
        let needs_before = self.live.ends_within(times[1]) && !self.live.setting.stores_step_before();
        let setting = &self.live.setting;
        let air = setting.wind.at(times[0]);
        let step = Step {
            head,
            roots,
            colliders: &frames,
            gravity: setting.gravity,
            air: &air,
            uniform_air: setting.wind.params().is_uniform(),
            dt_secs: self.live.step_secs(),
        };
        let before = if needs_before {
            let mut before = Vec::new();
            self.engine.simulator().read_positions(&mut before)?;
            Some(before.into())
        } else {
            None
        };
        let stepped = self.engine.step(&step)?;
        drop(frames);
        report.solver = report.solver.then(&stepped);
        for (live, (at, is_there)) in self.live.solids.iter_mut().zip(ends) {
            (live.at, live.was_there) = (at, is_there);
        }
        (self.live.before, self.live.step_heads, self.live.head_at) = (before, head, head[1]);
        self.live.bent_secs = bent_until;
        Ok(())
    }

    /// The head between two `times`, and whether it jumps.
    fn head_step(&self, times: [f64; 2]) -> HeadStep {
        let (from, to) = (self.live.head_at, self.live.head.pose(times[1]));
        let (distance_m, turn_degrees) = self.motion_between(&from, &to);
        let in_scene = self
            .scene
            .teleports
            .iter()
            .rfind(|teleport| times[0] < teleport.at_secs && teleport.at_secs <= times[1]);
        let declared = self.live.teleport.or(in_scene.map(|teleport| teleport.mode));
        let body = &self.scene.body;
        let beyond = |moved: f64, limit: f64| limit > 0.0 && moved > limit * self.live.step_secs();
        let sudden =
            beyond(distance_m, body.teleport_speed) || beyond(turn_degrees, body.teleport_turn_degrees);
        if declared.is_none() && !sudden {
            return HeadStep { poses: [from, to], jump: None };
        }
        // Where the motion says what of the step is a jump, the rest of it is motion.
        let across = self.live.head.jump_between(times);
        let start = across.map_or(to, |across| across.after(&from));
        let (distance_m, turn_degrees) = self.motion_between(&from, &start);
        let jump = Jump {
            frame: self.live.frame + 1,
            distance_m,
            turn_degrees,
            mode: declared.unwrap_or(Teleport::CarryShape),
            declared: declared.is_some(),
        };
        HeadStep { poses: [start, to], jump: Some(jump) }
    }

    /// How far the middle of the roots moves, metres, and how far the head turns, degrees.
    fn motion_between(&self, from: &Pose, to: &Pose) -> (f64, f64) {
        let distance = to.transform_point(self.middle).distance(from.transform_point(self.middle));
        let turn = (from.rotation.inverse() * to.rotation).normalize();
        let angle = 2.0 * turn.xyz().length().atan2(turn.w.abs());
        (distance, angle.to_degrees())
    }

    /// Continues from the `state` that a run of the same scene had after `frame` frames: see
    /// [`Player::state`]. Only a player at its start does, before any live change.
    ///
    /// # Errors
    /// [`PlayerError`] if an edit that was done before `frame` cannot be done, or the state belongs
    /// to another groom.
    pub fn resume(&mut self, frame: u32, state: &Snapshot<f32>) -> Result<(), PlayerError> {
        if self.live.frame > frame {
            return Err(PlayerError::NotKept(frame));
        }
        // What the steps until then did, but for the solver's state.
        while self.live.frame < frame {
            if self.live.frame + 1 == frame {
                self.apply_due_edits()?;
            }
            self.pass_frame();
        }
        self.engine.simulator().restore(state)?;
        let before = state.extra.get(between::CHANNEL);
        self.live.before =
            before.map(|flat| flat.as_chunks().0.iter().copied().map(Vec3::from_array).collect());
        self.reached = frame;
        self.keep_only_this()
    }

    /// Moves clock, head and solids by a frame, and counts the jumps in it.
    fn pass_frame(&mut self) {
        for times in self.live.next_steps() {
            self.pass(times);
            self.live.step_done();
        }
        self.live.show_next_frame();
    }

    fn pass(&mut self, times: [f64; 2]) {
        let HeadStep { poses, jump } = self.head_step(times);
        jump.iter().for_each(|jump| self.live.counters.add_jump(jump));
        for live in &mut self.live.solids {
            (live.at, live.was_there) = (live.track.pose(times[1]), live.solid.acts_between(times));
        }
        self.live.step_heads = poses;
        self.live.head_at = poses[1];
        self.live.bent_secs = self.live.bends_until(times[1]);
    }
}
