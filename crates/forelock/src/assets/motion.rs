//! How body and colliders move: the scene's words as functions of time.

use forelock_core::body::{KeyframeInterpolation, Keyframes, Motion, UnknownMotion};
use forelock_core::pose::Pose;
use glam::{DQuat, DVec3, EulerRot};

use super::AssetError;
use crate::scene::{Keyframe, MotionSection};

/// The motion that `section` describes; rotations turn about `pivot` (metres) unless it names another point.
pub(super) fn motion(section: &MotionSection, pivot: DVec3) -> Result<Motion, AssetError> {
    let pivot = section.pivot.map_or(pivot, DVec3::from_array);
    if !section.keyframes.is_empty() {
        let times = section.keyframes.iter().map(|key| key.time_secs).collect();
        let poses =
            section.keyframes.iter().map(|key| keyframe_pose(key, section.amplitude, pivot)).collect();
        return Ok(Motion::Keyframes(Keyframes::new(times, poses, KeyframeInterpolation::default())?));
    }
    let name = section.builtin_name().unwrap_or(&section.name);
    let mut motion = Motion::by_name(name).map_err(|UnknownMotion(name)| AssetError::Motion(name))?;
    if let Motion::Builtin(builtin) = &mut motion {
        builtin.amplitude = section.amplitude;
        builtin.frequency_hz = section.frequency_hz;
        builtin.rest_after_secs = Some(section.rest_after_secs).filter(|secs| *secs > 0.0);
        builtin.pivot = pivot;
    }
    Ok(motion)
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

    #[test]
    fn keyframes_turn_about_the_pivot() {
        let key =
            |time_secs, yaw| Keyframe { time_secs, rotation_degrees: [yaw, 0.0, 0.0], ..Keyframe::default() };
        let section =
            MotionSection { keyframes: vec![key(0.0, 0.0), key(1.0, 90.0)], ..MotionSection::default() };
        let pivot = DVec3::new(1.0, 2.0, 3.0);
        let pose = motion(&section, pivot).unwrap().pose(1.0);
        assert!(pose.transform_point(pivot).distance(pivot) < 1e-12);
        assert!(pose.transform_vector(DVec3::X).distance(DVec3::NEG_Z) < 1e-12);
    }
}
