//! What the head and the solids did while a simulation ran, as keyframes of a scene.
//!
//! # Practice
//! The recorded changes are followed once more from frame to frame, without hair. The head and the
//! solids that were moved from outside get a linear keyframe at each step and frame. A solid that
//! was added or removed appears or disappears at that time.
//!
//! # Limitations
//! The motion of a body that bends stays that of the scene. Within a step keyframes interpolate
//! angles, while a drag interpolates the rotation. A jump within a step takes all of the step.

use forelock_core::body::{KeyframeInterpolation, Motion};
use forelock_core::pose::Pose;
use glam::{DQuat, DVec3, EulerRot};

use super::live::{Live, LiveSolid};
use super::timeline::Change;
use super::track::Track;
use super::{ColliderId, Player};
use crate::assets::ROUNDING_SECS;
use crate::scene::{ColliderSection, Keyframe, MotionSection, Scene, TeleportSection};

/// The motion of something.
#[derive(Debug, Default)]
struct Course {
    /// In order of time.
    poses: Vec<TimedPose>,
    /// Whether it was moved from outside.
    is_moved: bool,
}

/// A pose of a [`Course`].
#[derive(Clone, Copy, Debug)]
struct TimedPose {
    secs: f64,
    pose: Pose,
    /// Whether the pose before jumps to this one.
    jumps: bool,
}

/// A collider of the scene, or one that was added.
#[derive(Debug)]
struct RecordedSolid {
    id: ColliderId,
    section: ColliderSection,
    course: Course,
}

/// The motion of the head and of all colliders.
#[derive(Debug)]
struct Recording {
    head: Course,
    solids: Vec<RecordedSolid>,
    /// Whether colliders were added or removed.
    is_changed: bool,
}

impl Player {
    /// The [changed scene](Player::changed_scene) with what was done from outside. Motions and
    /// poses of the head and of colliders become keyframes, one a step and frame, until the last
    /// frame that was simulated. A collider that was added or removed appears or disappears at that
    /// time. If any of this was done, a run of the scene has at least that many frames.
    ///
    /// # Limitations
    /// The motion of a body that bends stays that of the scene, and so does whether hair collides
    /// with the body. A player without history records nothing.
    ///
    /// ```
    /// use forelock::core::pose::Pose;
    /// use forelock::player::Player;
    /// use forelock::scene::Override;
    /// use forelock::Scene;
    /// use glam::{DQuat, DVec3};
    ///
    /// let small = ["groom.strands=20", "body.sdf_cells=32", "time.frames=2"];
    /// let sets: Result<Vec<_>, _> = small.iter().map(|set| Override::set(set)).collect();
    /// let mut player = Player::new(Scene::builtin(&sets?)?)?;
    /// for frame in 1..=5 {
    ///     let turn = DQuat::from_rotation_y(0.02 * f64::from(frame));
    ///     player.set_head_pose(Pose::new(turn, DVec3::ZERO))?;
    ///     player.step()?;
    /// }
    /// let scene = player.performed_scene();
    /// assert_eq!(scene.body.motion.keyframes.len(), 6);
    /// assert_eq!(scene.time.frames, 5);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn performed_scene(&self) -> Scene {
        let mut scene = self.changed_scene();
        let mut live = self.start.clone();
        let bends = matches!(&live.head, Track::Motion(own) if matches!(**own, Motion::Joint(_)));
        let mut recording = Recording::new(&live, std::mem::take(&mut scene.colliders));
        let mut applied = 0;
        loop {
            let secs = live.simulated_secs();
            while let Some(change) = self.timeline.due(applied, live.frame) {
                applied += 1;
                match change {
                    Change::Solver(solver) => {
                        if let Ok(params) = self.solvers.solver(solver) {
                            live.set_solver(solver.clone(), params.into());
                        }
                    }
                    Change::Teleport(mode) if !bends && live.frame < self.reached => {
                        // Within the next step.
                        let at_secs = secs + 0.5 * live.step_secs();
                        scene.teleports.push(TeleportSection { at_secs, mode: *mode });
                    }
                    _ => recording.note(change, secs),
                }
                // It could be applied when it was recorded, unless its collider was undone since.
                let _ = live.apply_pose(change);
            }
            if live.frame >= self.reached {
                break;
            }
            live.follow_frame(|live, times, teleported| recording.record(live, times, teleported));
            recording.record_shown(&live);
        }
        recording.head.is_moved &= !bends;
        if recording.has_changes() {
            scene.time.frames = scene.time.frames.max(self.reached);
        }
        if recording.head.is_moved {
            scene.body.motion = recording.head.motion();
        }
        scene.colliders = recording.solids.into_iter().filter_map(RecordedSolid::section).collect();
        scene
    }
}

impl RecordedSolid {
    /// As a scene says it; none if it was there for no step.
    fn section(self) -> Option<ColliderSection> {
        let Self { section, course, .. } = self;
        let from = section.from_secs.unwrap_or(0.0);
        let is_there = section.until_secs.is_none_or(|until| until > from);
        let motion = if course.is_moved { course.motion() } else { section.motion.clone() };
        is_there.then_some(ColliderSection { motion, ..section })
    }
}

impl Recording {
    /// The head and the colliders of a scene at the start, `sections`.
    fn new(live: &Live, sections: Vec<ColliderSection>) -> Self {
        // The body, if it is a collider, comes before those of the scene.
        let first = live.solids.len().saturating_sub(sections.len());
        let solid = |(live, section): (&LiveSolid, ColliderSection)| {
            let mut course = Course::default();
            course.push(0.0, live.at, false);
            RecordedSolid { id: live.id, section, course }
        };
        let solids = live.solids[first..].iter().zip(sections).map(solid).collect();
        let mut head = Course::default();
        head.push(0.0, live.head_at, false);
        Self { head, solids, is_changed: false }
    }

    fn has_changes(&self) -> bool {
        self.is_changed || self.head.is_moved || self.solids.iter().any(|own| own.course.is_moved)
    }

    fn solid(&mut self, id: ColliderId) -> Option<&mut RecordedSolid> {
        self.solids.iter_mut().find(|own| own.id == id)
    }

    /// Notes what a change at `secs` moves, adds or removes.
    fn note(&mut self, change: &Change, secs: f64) {
        match change {
            Change::Motion(_) | Change::HeadPose(_) => self.head.is_moved = true,
            Change::ColliderPose(id, _) => {
                if let Some(own) = self.solid(*id) {
                    own.course.is_moved = true;
                }
            }
            Change::AddCollider(id, solid, section) => {
                let from = section.from_secs.unwrap_or(0.0).max(secs);
                let from_secs = (from > 0.0).then_some(from);
                let section = ColliderSection { from_secs, ..(**section).clone() };
                let mut course = Course::default();
                course.push(secs, solid.motion().pose(secs), false);
                self.solids.push(RecordedSolid { id: *id, section, course });
                self.is_changed = true;
            }
            Change::RemoveCollider(id) => {
                if let Some(RecordedSolid { section, .. }) = self.solid(*id) {
                    section.until_secs = Some(section.until_secs.map_or(secs, |until| until.min(secs)));
                    self.is_changed = true;
                }
            }
            Change::Solver(_)
            | Change::Interaction(_)
            | Change::Gravity(_)
            | Change::Wind(_)
            | Change::Teleport(_)
            | Change::Edit(_) => {}
        }
    }

    /// Adds the poses at the end of a step between two `times`.
    fn record(&mut self, live: &Live, times: [f64; 2], teleported: bool) {
        let jumps = teleported || live.head.jump_between(times).is_some();
        self.head.push(times[1], live.head_at, jumps);
        for own in &mut self.solids {
            if let Some(solid) = live.solids.iter().find(|solid| solid.id == own.id) {
                own.course.push(times[1], solid.at, solid.track.jump_between(times).is_some());
            }
        }
    }

    /// Adds the poses at the frame that is shown, if it lies within the last step.
    fn record_shown(&mut self, live: &Live) {
        let secs = live.shown_secs();
        if live.simulated_secs() - secs < ROUNDING_SECS {
            return;
        }
        self.head.insert(secs, live.head_shown);
        for own in &mut self.solids {
            if let Some(solid) = live.solids.iter().find(|solid| solid.id == own.id) {
                own.course.insert(secs, solid.track.pose(secs));
            }
        }
    }
}

impl Course {
    /// Adds the pose at `secs`, in place of those at that time and after it: a change of the solver
    /// can set its clock back within a step.
    fn push(&mut self, secs: f64, pose: Pose, jumps: bool) {
        while self.poses.last().is_some_and(|last| last.secs > secs - ROUNDING_SECS) {
            self.poses.pop();
        }
        self.poses.push(TimedPose { secs, pose, jumps });
    }

    /// Adds a pose at `secs`, within the last step, if there is none and nothing jumps there.
    fn insert(&mut self, secs: f64, pose: Pose) {
        let next = self.poses.partition_point(|own| own.secs < secs - ROUNDING_SECS);
        if self.poses.get(next).is_none_or(|own| own.secs > secs + ROUNDING_SECS && !own.jumps) {
            self.poses.insert(next, TimedPose { secs, pose, jumps: false });
        }
    }

    /// The motion through the poses.
    fn motion(&self) -> MotionSection {
        let mut keyframes: Vec<Keyframe> = Vec::with_capacity(self.poses.len() + 1);
        let mut angles = DVec3::ZERO;
        for own in &self.poses {
            angles = nearest_angles(own.pose.rotation, angles);
            let next = Keyframe {
                time_secs: own.secs,
                translation: own.pose.translation.to_array(),
                rotation_degrees: angles.to_array(),
                jump: own.jumps,
                ..Keyframe::default()
            };
            // Motions begin at 0.
            if keyframes.is_empty() && own.secs > 0.0 {
                keyframes.push(Keyframe { time_secs: 0.0, ..next });
            }
            // Of those at rest the first and the last count.
            if let [.., a, b] = &keyframes[..]
                && at_same_place(a, b)
                && at_same_place(b, &next)
            {
                keyframes.pop();
            }
            keyframes.push(next);
        }
        MotionSection {
            pivot: Some([0.0; 3]),
            interpolation: KeyframeInterpolation::Linear,
            keyframes,
            ..MotionSection::default()
        }
    }
}

/// Whether both have the same pose.
fn at_same_place(a: &Keyframe, b: &Keyframe) -> bool {
    (a.translation, a.rotation_degrees) == (b.translation, b.rotation_degrees)
}

/// Yaw, pitch and roll of `rotation`, degrees: of all that give it those nearest to `before`.
fn nearest_angles(rotation: DQuat, before: DVec3) -> DVec3 {
    let (yaw, pitch, roll) = rotation.to_euler(EulerRot::YXZ);
    let [yaw, pitch, roll] = [yaw, pitch, roll].map(f64::to_degrees);
    let same = [DVec3::new(yaw, pitch, roll), DVec3::new(yaw + 180.0, 180.0 - pitch, roll + 180.0)];
    let [a, b] = same.map(|own| own + 360.0 * ((before - own) / 360.0).round());
    if a.distance_squared(before) <= b.distance_squared(before) { a } else { b }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_give_the_rotation_and_never_leap() {
        let mut before = DVec3::ZERO;
        for step in 0..2000 {
            let share = f64::from(step) * 0.01;
            let rotation = DQuat::from_euler(EulerRot::YXZ, 1.7 * share, (0.9 * share).sin() * 1.4, share);
            let now = nearest_angles(rotation, before);
            let radians = now.to_array().map(f64::to_radians);
            let again = DQuat::from_euler(EulerRot::YXZ, radians[0], radians[1], radians[2]);
            assert!(rotation.dot(again).abs() > 1.0 - 1e-12);
            assert!(step == 0 || now.distance(before) < 5.0, "{step}: {before} {now}");
            before = now;
        }
        // Several turns.
        assert!(before.x > 1500.0 && before.z > 1000.0, "{before}");
    }
}
