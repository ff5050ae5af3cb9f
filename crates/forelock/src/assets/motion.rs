//! How body and colliders move: motions of a scene as functions of time.

use forelock_core::body::{Keyframe, KeyframeInterpolation, Keyframes, Motion, UnknownMotion};
use glam::{DQuat, DVec3, EulerRot};

use super::AssetError;
use crate::scene::{self, MotionSection};

/// The motion that `section` describes; rotations turn about `pivot` (metres) unless it names
/// another point.
pub(super) fn from_section(section: &MotionSection, pivot: DVec3) -> Result<Motion, AssetError> {
    let pivot = section.pivot.map_or(pivot, DVec3::from_array);
    if !section.keyframes.is_empty() {
        let keys = &section.keyframes;
        let keys = keys.iter().enumerate().map(|(index, key)| {
            let interpolation = if keys.get(index + 1).is_some_and(|next| next.jump) {
                KeyframeInterpolation::Hold
            } else {
                key.interpolation.unwrap_or(section.interpolation)
            };
            keyframe(key, section.amplitude, interpolation)
        });
        return Ok(Motion::Keyframes(Keyframes::new(keys.collect(), pivot)?));
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

fn keyframe(key: &scene::Keyframe, amplitude: f64, interpolation: KeyframeInterpolation) -> Keyframe {
    Keyframe {
        time_secs: key.time_secs,
        translation: DVec3::from_array(key.translation) * amplitude,
        turn: DVec3::from_array(key.rotation_degrees.map(f64::to_radians)) * amplitude,
        interpolation,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The motion of a `[body.motion]` table.
    fn motion(table: &str) -> Motion {
        from_section(&toml::from_str(table).unwrap(), DVec3::new(1.0, 2.0, 3.0)).unwrap()
    }

    #[test]
    fn keyframes_turn_about_the_pivot_at_all_times() {
        let motion = motion("keyframe = [{}, { time_secs = 1, rotation_degrees = [90, 0, 0] }]");
        let pivot = DVec3::new(1.0, 2.0, 3.0);
        for time in [0.0, 0.3, 0.7, 1.0] {
            assert!(motion.pose(time).transform_point(pivot).distance(pivot) < 1e-12);
        }
        assert!(motion.pose(1.0).transform_vector(DVec3::X).distance(DVec3::NEG_Z) < 1e-12);
    }

    #[test]
    fn a_key_says_how_the_motion_goes_on_from_it() {
        let motion = motion(
            "interpolation = \"linear\"
            keyframe = [
                { },
                { time_secs = 1, translation = [1, 0, 0], interpolation = \"hold\" },
                { time_secs = 2, translation = [3, 0, 0], interpolation = \"smooth\" },
                { time_secs = 3, translation = [4, 0, 0] },
            ]",
        );
        let x = |secs| motion.pose(secs).translation.x;
        assert_eq!([0.25, 1.75, 2.0].map(x), [0.25, 1.0, 3.0]);
        assert!((x(2.25) - (3.0 + 0.25f64.powi(2) * 2.5)).abs() < 1e-12, "at rest at both ends");
        assert_eq!(motion.jump_between([1.9, 2.0]).unwrap().translation, DVec3::X * 2.0);
    }

    #[test]
    fn a_keyframe_that_jumps_does_not_bend_the_motion_before_it() {
        let motion = motion(
            "keyframe = [
                { },
                { time_secs = 1, translation = [0.1, 0, 0] },
                { time_secs = 1, translation = [14, 0, 0], jump = true },
            ]",
        );
        let x = |secs| motion.pose(secs).translation.x;
        assert!((0..100).all(|i| (0.0..=0.1).contains(&x(f64::from(i) * 0.01))));
        assert_eq!((x(1.0), x(2.0)), (14.0, 14.0));
        let jump = motion.jump_between([0.9, 1.0]).unwrap();
        assert!((jump.translation.x - 13.9).abs() < 1e-12);
        assert!(motion.jump_between([1.0, 1.1]).is_none() && motion.jump_between([0.8, 0.9]).is_none());
    }
}
