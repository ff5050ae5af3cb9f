//! What the head and the solids did while a simulation ran, as keyframes of a scene.
//!
//! # Practice
//! The recorded changes are followed once more from frame to frame, without hair. The head and the
//! solids that were moved from outside get a linear keyframe at each step and frame. A solid that
//! was added or removed is there from and until that time.
//!
//! # Limitations
//! The motion of a body that bends stays that of the scene. Within a step keyframes interpolate
//! angles, a drag the rotation itself.

use forelock_core::body::{KeyframeInterpolation, Motion};
use forelock_core::pose::Pose;
use glam::{DQuat, DVec3, EulerRot};

use super::live::{Live, LiveSolid};
use super::timeline::Change;
use super::track::Track;
use super::{ColliderId, Player};
use crate::scene::{ColliderSection, Keyframe, MotionSection, Scene, TeleportSection};

/// Times that are closer are the same, seconds.
const ROUNDING_SECS: f64 = 1e-9;

/// The poses of something over time.
#[derive(Debug, Default)]
struct Course {
    /// Times and poses, in order of time.
    poses: Vec<(f64, Pose)>,
    /// Whether it was moved from outside.
    is_moved: bool,
}

/// A solid of the scene, or one that was added.
#[derive(Debug)]
struct Performer {
    id: ColliderId,
    section: ColliderSection,
    course: Course,
}

/// All that moves but hair.
#[derive(Debug)]
struct Cast {
    head: Course,
    solids: Vec<Performer>,
}

impl Player {
    /// The [changed scene](Player::changed_scene) with what was done from outside: motions and
    /// poses of the head and of colliders become keyframes, one a step and frame, until the last
    /// frame that was simulated, and colliders that were added or removed are there from and until
    /// then. If anything was moved, a run of the scene has at least that many frames. The motion of
    /// a body that bends stays that of the scene.
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
        let mut cast = Cast::new(&live, std::mem::take(&mut scene.colliders));
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
                    Change::Teleport(mode) => {
                        let at_secs = secs + live.step_secs();
                        scene.teleports.push(TeleportSection { at_secs, mode: *mode });
                    }
                    _ => cast.follow(change, secs),
                }
                // What was recorded could be applied.
                let _ = live.pose(change);
            }
            if live.frame >= self.reached {
                break;
            }
            live.pass_frame(|secs, live| cast.record(secs, live));
            cast.record_shown(&live);
        }
        let bends = matches!(&self.start.head, Track::Motion(own) if matches!(**own, Motion::Joint(_)));
        cast.head.is_moved &= !bends;
        if cast.head.is_moved || cast.solids.iter().any(|own| own.course.is_moved) {
            scene.time.frames = scene.time.frames.max(self.reached);
        }
        if cast.head.is_moved {
            scene.body.motion = cast.head.motion();
        }
        scene.colliders = cast.solids.into_iter().filter_map(Performer::section).collect();
        scene
    }
}

impl Performer {
    /// As a scene says it; none if it was there for no step.
    fn section(self) -> Option<ColliderSection> {
        let Self { section, course, .. } = self;
        let is_there = section.until_secs.is_none_or(|until| until > section.from_secs);
        let motion = if course.is_moved { course.motion() } else { section.motion.clone() };
        is_there.then_some(ColliderSection { motion, ..section })
    }
}

impl Cast {
    /// The head and the solids of a scene at the start, `sections`.
    fn new(live: &Live, sections: Vec<ColliderSection>) -> Self {
        // The body, if it is a solid, comes before those of the scene.
        let first = live.solids.len().saturating_sub(sections.len());
        let own = live.solids[first..].iter().zip(sections);
        let performer = |(live, section): (&LiveSolid, ColliderSection)| Performer {
            id: live.id,
            section,
            course: Course::default(),
        };
        let mut cast = Self { head: Course::default(), solids: own.map(performer).collect() };
        cast.record(0.0, live);
        cast
    }

    fn solid(&mut self, id: ColliderId) -> Option<&mut Performer> {
        self.solids.iter_mut().find(|own| own.id == id)
    }

    /// Notes what a change at `secs` moves, adds or removes.
    fn follow(&mut self, change: &Change, secs: f64) {
        match change {
            Change::Motion(_) | Change::HeadPose(_) => self.head.is_moved = true,
            Change::ColliderPose(id, _) => {
                if let Some(own) = self.solid(*id) {
                    own.course.is_moved = true;
                }
            }
            Change::AddCollider(id, solid, section) => {
                let from_secs = section.from_secs.max(secs);
                let section = ColliderSection { from_secs, ..(**section).clone() };
                let course = Course { poses: vec![(secs, solid.motion().pose(secs))], is_moved: false };
                self.solids.push(Performer { id: *id, section, course });
            }
            Change::RemoveCollider(id) => {
                if let Some(Performer { section, .. }) = self.solid(*id) {
                    section.until_secs = Some(section.until_secs.map_or(secs, |until| until.min(secs)));
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

    /// Adds the poses at `secs`, the end of a step.
    fn record(&mut self, secs: f64, live: &Live) {
        self.head.poses.push((secs, live.head_at));
        for own in &mut self.solids {
            if let Some(solid) = live.solids.iter().find(|solid| solid.id == own.id) {
                own.course.poses.push((secs, solid.at));
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
    /// Adds a pose at `secs` where none is.
    fn insert(&mut self, secs: f64, pose: Pose) {
        let before = self.poses.partition_point(|(own, _)| *own < secs - ROUNDING_SECS);
        if self.poses.get(before).is_none_or(|(own, _)| *own > secs + ROUNDING_SECS) {
            self.poses.insert(before, (secs, pose));
        }
    }

    /// The motion through the poses.
    fn motion(&self) -> MotionSection {
        let mut keyframes: Vec<Keyframe> = Vec::with_capacity(self.poses.len() + 1);
        let mut before = DVec3::ZERO;
        for (time_secs, pose) in &self.poses {
            before = nearest_angles(pose.rotation, before);
            let next = Keyframe {
                time_secs: *time_secs,
                translation: pose.translation.to_array(),
                rotation_degrees: before.to_array(),
                ..Keyframe::default()
            };
            // Motions begin at 0.
            if keyframes.is_empty() && *time_secs > 0.0 {
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
