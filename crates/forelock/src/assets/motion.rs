//! How body and colliders move: motions of a scene as functions of time.

use forelock_core::body::{KeyframeInterpolation, Keyframes, Motion, UnknownMotion};
use forelock_core::pose::Pose;
use glam::{DQuat, DVec3, EulerRot};

use super::AssetError;
use crate::scene::{Keyframe, MotionSection};

/// A pose as a function of time that may jump.
///
/// Each piece is a smooth motion; at the start of every piece but the first the pose jumps to it.
#[derive(Clone, Debug, PartialEq)]
pub struct MotionTrack {
    first: Motion,
    /// Later pieces and the times at which they start, seconds, increasing.
    later: Vec<Piece>,
}

#[derive(Clone, Debug, PartialEq)]
struct Piece {
    start_secs: f64,
    motion: Motion,
}

impl From<Motion> for MotionTrack {
    fn from(motion: Motion) -> Self {
        Self { first: motion, later: Vec::new() }
    }
}

impl Default for MotionTrack {
    fn default() -> Self {
        Motion::default().into()
    }
}

impl MotionTrack {
    /// The motion that `section` describes; rotations turn about `pivot` (metres) unless it names
    /// another point.
    pub(super) fn new(section: &MotionSection, pivot: DVec3) -> Result<Self, AssetError> {
        let pivot = section.pivot.map_or(pivot, DVec3::from_array);
        if !section.keyframes.is_empty() {
            return Self::through(&section.keyframes, section.amplitude, pivot);
        }
        let name = section.builtin_name().unwrap_or(&section.name);
        let mut motion = Motion::by_name(name).map_err(|UnknownMotion(name)| AssetError::Motion(name))?;
        if let Motion::Builtin(builtin) = &mut motion {
            builtin.amplitude = section.amplitude;
            builtin.frequency_hz = section.frequency_hz;
            builtin.rest_after_secs = Some(section.rest_after_secs).filter(|secs| *secs > 0.0);
            builtin.pivot = pivot;
        }
        Ok(motion.into())
    }

    fn through(keyframes: &[Keyframe], amplitude: f64, pivot: DVec3) -> Result<Self, AssetError> {
        let motion = |keys: &[Keyframe]| -> Result<Motion, AssetError> {
            let times = keys.iter().map(|key| key.time_secs).collect();
            let poses = keys.iter().map(|key| keyframe_pose(key, amplitude, pivot)).collect();
            Ok(Motion::Keyframes(Keyframes::new(times, poses, KeyframeInterpolation::default())?))
        };
        let mut pieces = keyframes.chunk_by(|_, next| !next.jump);
        let first = motion(pieces.next().unwrap_or_default())?;
        let later = pieces.map(|keys| Ok(Piece { start_secs: keys[0].time_secs, motion: motion(keys)? }));
        Ok(Self { first, later: later.collect::<Result<_, AssetError>>()? })
    }

    /// The pose at `secs`; at a jump, the pose after it.
    pub fn pose(&self, secs: f64) -> Pose {
        let piece = self.later.iter().rfind(|piece| piece.start_secs <= secs);
        piece.map_or(&self.first, |piece| &piece.motion).pose(secs)
    }

    /// The jumps after the first and not after the second of `times` (seconds) as one displacement,
    /// from poses before them to poses after them.
    pub fn jump_between(&self, times: [f64; 2]) -> Option<Pose> {
        let motions = std::iter::once(&self.first).chain(self.later.iter().map(|piece| &piece.motion));
        let mut jump: Option<Pose> = None;
        for (before, piece) in motions.zip(&self.later) {
            let secs = piece.start_secs;
            if times[0] < secs && secs <= times[1] {
                let next = piece.motion.pose(secs).after(&before.pose(secs).inverse());
                jump = Some(jump.map_or(next, |jump| next.after(&jump)));
            }
        }
        jump
    }
}

/// The rotation of yaw about y, pitch about x and roll about z, in degrees.
pub(super) fn rotation(degrees: [f64; 3]) -> DQuat {
    let [yaw, pitch, roll] = degrees.map(f64::to_radians);
    DQuat::from_euler(EulerRot::YXZ, yaw, pitch, roll)
}

fn keyframe_pose(key: &Keyframe, amplitude: f64, pivot: DVec3) -> Pose {
    let rotation = rotation(key.rotation_degrees.map(|degrees| degrees * amplitude));
    let shift = DVec3::from_array(key.translation) * amplitude;
    Pose::new(rotation, pivot + shift - rotation * pivot)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn section(keyframes: Vec<Keyframe>) -> MotionSection {
        MotionSection { keyframes, ..MotionSection::default() }
    }

    #[test]
    fn keyframes_turn_about_the_pivot() {
        let key =
            |time_secs, yaw| Keyframe { time_secs, rotation_degrees: [yaw, 0.0, 0.0], ..Keyframe::default() };
        let pivot = DVec3::new(1.0, 2.0, 3.0);
        let keys = section(vec![key(0.0, 0.0), key(1.0, 90.0)]);
        let pose = MotionTrack::new(&keys, pivot).unwrap().pose(1.0);
        assert!(pose.transform_point(pivot).distance(pivot) < 1e-12);
        assert!(pose.transform_vector(DVec3::X).distance(DVec3::NEG_Z) < 1e-12);
    }

    #[test]
    fn a_keyframe_that_jumps_does_not_bend_the_motion_before_it() {
        let key = |time_secs, x, jump| Keyframe {
            time_secs,
            translation: [x, 0.0, 0.0],
            jump,
            ..Keyframe::default()
        };
        let keys = section(vec![key(0.0, 0.0, false), key(1.0, 0.1, false), key(1.0, 14.0, true)]);
        let motion = MotionTrack::new(&keys, DVec3::ZERO).unwrap();
        let x = |secs| motion.pose(secs).translation.x;
        assert!((0..100).all(|i| (0.0..=0.1).contains(&x(f64::from(i) * 0.01))));
        assert_eq!((x(1.0), x(2.0)), (14.0, 14.0));
        let jump = motion.jump_between([0.9, 1.0]).unwrap();
        assert!((jump.translation.x - 13.9).abs() < 1e-12);
        assert!(motion.jump_between([1.0, 1.1]).is_none() && motion.jump_between([0.8, 0.9]).is_none());
    }
}
