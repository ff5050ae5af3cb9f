use std::f64::consts::TAU;

use KeyframeInterpolation::{Hold, Linear, Smooth};
use glam::DVec3;

use super::*;
use crate::groom::grow::random::Random;

fn key(time_secs: f64, x: f64, interpolation: KeyframeInterpolation) -> Keyframe {
    Keyframe { time_secs, translation: DVec3::X * x, interpolation, ..Keyframe::default() }
}

fn motion(keys: Vec<Keyframe>) -> Keyframes {
    Keyframes::new(keys, DVec3::ZERO).unwrap()
}

/// Keys at random times, now and then tied, with random shifts, some of them equal and some huge.
fn random_keys(random: &mut Random) -> Vec<Keyframe> {
    let mut keys: Vec<Keyframe> = Vec::new();
    let mut unit = || f64::from(random.unit());
    for _ in 0..2 + (unit() * 6.0) as usize {
        let interpolation = [Smooth, Smooth, Linear, Hold][(unit() * 4.0) as usize];
        let (time_secs, translation, turn) = match keys.last() {
            None => (0.0, DVec3::ZERO, DVec3::ZERO),
            Some(before) => {
                let tied = before.interpolation == Hold && unit() < 0.3;
                let span = if tied { 0.0 } else { 10f64.powf(unit() * 4.0 - 3.0) };
                let scale = if unit() < 0.2 { 0.0 } else { 10f64.powf(unit() * 5.0 - 3.0) };
                let by = DVec3::new(unit() - 0.5, unit() - 0.5, (unit() - 0.5).max(0.0));
                let axes = if unit() < 0.5 { DVec3::X } else { DVec3::ONE };
                (before.time_secs + span, before.translation + by * scale, before.turn - by * axes * scale)
            }
        };
        keys.push(Keyframe { time_secs, translation, turn, interpolation });
    }
    keys
}

#[test]
fn a_step_after_a_hold_stays_between_its_keys() {
    for step in [0.3, 100.0] {
        let keys = motion(vec![
            key(0.0, 0.0, Smooth),
            key(2.0, 0.0, Smooth),
            key(2.01, step, Smooth),
            key(4.0, step, Smooth),
        ]);
        for i in 0..40_000 {
            let x = keys.pose(f64::from(i) * 1e-4).translation.x;
            assert!((0.0..=step).contains(&x), "{x}");
        }
    }
}

#[test]
fn no_component_leaves_the_keys_around_it() {
    let random = &mut Random::new(1, 0);
    for _ in 0..3000 {
        let motion = motion(random_keys(random));
        for pair in motion.keys.windows(2) {
            let [from, to] = [pair[0], pair[1]];
            let (low, high) = (from.translation.min(to.translation), from.translation.max(to.translation));
            let mut before = from.translation;
            let mut turned = 0.0;
            // The end of an interval may be a jump.
            for i in 0..49 {
                let time = |i| from.time_secs + (to.time_secs - from.time_secs) * f64::from(i) / 50.0;
                let at = motion.pose(time(i));
                if from.time_secs < to.time_secs {
                    assert!(at.translation.cmpge(low).all() && at.translation.cmple(high).all());
                    // Monotone: never back towards the start, but for rounding.
                    let back = (before - at.translation) * (to.translation - from.translation);
                    assert!(back.max_element() <= 1e-12 * (1.0 + before.length_squared()));
                    before = at.translation;
                    turned += if i < 48 { angle_between(&at, &motion.pose(time(i + 1))) } else { 0.0 };
                }
            }
            // Turns about one axis do not go on and come back.
            if from.interpolation != Hold && from.turn.z == to.turn.z && from.turn.y == to.turn.y {
                assert!(turned <= (to.turn - from.turn).length() * (1.0 + 1e-6) + 1e-6);
            }
        }
    }
}

fn angle_between(a: &Pose, b: &Pose) -> f64 {
    let turn = a.rotation.conjugate() * b.rotation;
    2.0 * turn.xyz().length().atan2(turn.w.abs())
}

#[test]
fn motions_pass_through_their_keys() {
    let random = &mut Random::new(2, 0);
    for _ in 0..1000 {
        let pivot = DVec3::new(0.1, 1.5, -0.2);
        let keys = random_keys(random);
        let motion = Keyframes::new(keys.clone(), pivot).unwrap();
        for (index, key) in keys.iter().enumerate() {
            // Of keys at one time the last rules.
            if keys.get(index + 1).is_none_or(|next| next.time_secs > key.time_secs) {
                assert_eq!(motion.pose(key.time_secs), motion.pose_at_key(index));
                let moved = motion.pose(key.time_secs).transform_point(pivot) - pivot;
                assert!(moved.distance(key.translation) <= 1e-12 * (1.0 + key.translation.length()));
            }
        }
        assert_eq!(motion.pose(-1.0), motion.pose_at_key(0));
        assert_eq!(motion.pose(1e9), motion.pose_at_key(keys.len() - 1));
    }
}

/// Largest change of the velocity at a key between two intervals of which at least one is smooth
/// and none holds, over the larger mean speed of the two.
fn kink(keys: &[Keyframe]) -> f64 {
    let motion = motion(keys.to_vec());
    let mut kink = 0.0f64;
    for part in keys.windows(3) {
        let spans = [part[1].time_secs - part[0].time_secs, part[2].time_secs - part[1].time_secs];
        let h = 1e-6 * spans[0].min(spans[1]);
        let x = |steps: f64| motion.pose(part[1].time_secs + steps * h).translation.x;
        let change = ((x(2.0) - x(1.0)) - (x(-1.0) - x(-2.0))).abs() / h;
        let speed = |i: usize| ((part[i + 1].translation - part[i].translation).x / spans[i]).abs();
        kink = kink.max(change / speed(0).max(speed(1)).max(1e-3));
    }
    kink
}

#[test]
fn smooth_velocity_is_continuous_and_linear_is_not() {
    let random = &mut Random::new(3, 0);
    let mut linear = 0.0f64;
    for _ in 0..1000 {
        let mut keys = Vec::new();
        for i in 0..6 {
            keys.push(key(f64::from(i) + 0.9 * f64::from(random.unit()), f64::from(random.signed()), Smooth));
        }
        assert!(kink(&keys) < 1e-3, "{keys:?}");
        keys.iter_mut().for_each(|key| key.interpolation = Linear);
        linear = linear.max(kink(&keys));
    }
    assert!(linear > 1.0);
}

#[test]
fn smooth_motion_takes_the_speed_of_a_linear_neighbour() {
    let keys = [key(0.0, 0.0, Smooth), key(1.0, 1.0, Linear), key(2.0, 2.5, Smooth), key(3.0, 3.5, Smooth)];
    assert!(kink(&keys) < 1e-3);
}

#[test]
fn constant_speed_is_reproduced() {
    for interpolation in [Smooth, Linear] {
        let keys = (0..6).map(|i| {
            let time = f64::from(i * i) * 0.3;
            Keyframe { turn: DVec3::Y * time * 0.5, ..key(time, time * 2.0 - 1.0, interpolation) }
        });
        let motion = motion(keys.collect());
        // Smooth motions start and stop at rest, in the first and the last interval.
        for i in 0..1000 {
            let time = 0.3 + f64::from(i) * (4.8 - 0.3) / 1000.0;
            let pose = motion.pose(time);
            assert!((pose.translation.x - (time * 2.0 - 1.0)).abs() < 1e-14, "{interpolation:?} {time}");
            assert!(pose.rotation.angle_between(DQuat::from_rotation_x(time * 0.5)) < 1e-7);
        }
    }
}

#[test]
fn a_hold_rests_and_jumps() {
    let keys = motion(vec![
        key(0.0, 0.0, Smooth),
        key(1.0, 1.0, Hold),
        key(2.0, 5.0, Smooth),
        key(3.0, 6.0, Smooth),
    ]);
    let x = |time| keys.pose(time).translation.x;
    assert_eq!([1.0, 1.5, 2.0 - 1e-9, 2.0].map(x), [1.0, 1.0, 1.0, 5.0]);
    assert!((x(1.0) - x(1.0 - 1e-6)).abs() < 1e-9 && (x(2.0 + 1e-6) - 5.0).abs() < 1e-9, "at rest beside it");
    assert_eq!(keys.jump_between([1.9, 2.0]).unwrap().translation, DVec3::X * 4.0);
    assert_eq!([[0.0, 1.9], [2.0, 9.0]].map(|times| keys.jump_between(times)), [None; 2]);
    let rest = motion(vec![key(0.0, 1.0, Hold), key(1.0, 1.0, Smooth)]);
    assert_eq!(rest.jump_between([0.0, 2.0]), None, "nothing jumps");
    let twice = motion(vec![key(0.0, 0.0, Hold), key(1.0, 2.0, Hold), key(1.0, 5.0, Smooth)]);
    assert_eq!(twice.jump_between([0.5, 1.5]).unwrap().translation, DVec3::X * 5.0);
}

#[test]
fn angles_are_turned_as_given() {
    for degrees in [1432.0f64, -720.0, 350.0] {
        for interpolation in [Smooth, Linear] {
            let key = |time_secs, yaw| Keyframe {
                time_secs,
                turn: DVec3::X * yaw,
                interpolation,
                ..Keyframe::default()
            };
            let motion = motion(vec![key(0.0, 0.0), key(1.0, degrees.to_radians())]);
            let mut turned = 0.0;
            for i in 0..1000 {
                turned += angle_between(
                    &motion.pose(f64::from(i) / 1000.0),
                    &motion.pose(f64::from(i + 1) / 1000.0),
                );
            }
            assert!((turned - degrees.to_radians().abs()).abs() < 1e-9 * TAU, "{degrees}: {turned}");
        }
    }
}

#[test]
fn invalid_keys_are_refused() {
    let new = |keys: &[Keyframe]| Keyframes::new(keys.to_vec(), DVec3::ZERO);
    assert_eq!(new(&[]), Err(KeyframesError::Empty));
    assert_eq!(new(&[key(0.0, 0.0, Smooth), key(0.0, 0.0, Smooth)]), Err(KeyframesError::Order(1)));
    assert!(new(&[key(0.0, 0.0, Hold), key(0.0, 1.0, Smooth)]).is_ok());
    assert_eq!(new(&[key(f64::NAN, 0.0, Smooth)]), Err(KeyframesError::Order(0)));
    assert_eq!(new(&[key(0.0, f64::INFINITY, Smooth)]), Err(KeyframesError::NotFinite(0)));
}

#[cfg(feature = "serde")]
#[test]
fn keys_read_from_a_file_are_checked() {
    let keys = motion(vec![key(0.0, 0.0, Linear), key(1.0, 0.5, Hold)]);
    let text = serde_json::to_string(&keys).unwrap();
    assert_eq!(serde_json::from_str::<Keyframes>(&text).unwrap(), keys);
    assert!(serde_json::from_str::<Keyframes>(r#"{"keys": []}"#).is_err());
}
