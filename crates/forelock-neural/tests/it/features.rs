//! Inputs of the network from a body's motion.

#![expect(clippy::unwrap_used, reason = "a test fails where a result is an error")]

use crate::golden::{error, load, numbers, vectors};
use forelock_core::pose::Pose;
use forelock_neural::features::{
    BodyPose, FeatureError, Features, HeadMotion, PoseHistory, SHARED_NUMBERS, SPACING_SECS, resample,
};
use glam::{DMat3, DQuat, DVec3, EulerRot};

const SHAPE: [f64; 10] = [0.1, -2.0, 0.0, 1.0, 0.3, -0.4, 0.5, 2.0, 1.5, -1.0];

fn features(head_motion: HeadMotion) -> Features {
    Features::new(DVec3::new(0.0, 9.0, 2.0), head_motion).unwrap()
}

/// A smooth motion of all joints at a time in seconds.
fn moving(time: f64) -> BodyPose {
    let joint = |k: f64| {
        let turn = |rate: f64, most: f64| most * (rate * time + k).sin();
        Pose::new(
            DQuat::from_euler(EulerRot::YXZ, turn(3.0, 0.9), turn(2.1, 0.4), turn(1.3, 0.3)),
            DVec3::new(turn(1.7, 20.0), 100.0 + 20.0 * k + turn(4.0, 3.0), turn(0.9, 30.0)),
        )
    };
    BodyPose { root: joint(0.0), spine: joint(1.0), neck: joint(2.0), head: joint(2.5) }
}

fn largest_difference(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

fn golden_motion() -> Vec<BodyPose> {
    let file = load("net_6_features");
    let rotations = numbers(&file["R"]);
    let joints: Vec<Pose> = rotations
        .chunks_exact(9)
        .zip(vectors(&file["P"]))
        .map(|(r, p)| {
            let rotation = DMat3::from_cols_slice(r).transpose();
            Pose::new(DQuat::from_mat3(&rotation), p.into())
        })
        .collect();
    joints.chunks_exact(4).map(|j| BodyPose { root: j[0], spine: j[1], neck: j[2], head: j[3] }).collect()
}

#[test]
fn the_numbers_of_a_motion_are_the_golden_ones() {
    let file = load("net_6_features");
    let poses = golden_motion();
    let origin = vectors(&file["origin_in_head"])[0].into();
    let shape: [f64; 10] = numbers(&file["shape"]).try_into().unwrap();
    let velocity = Features::new(origin, HeadMotion::Velocity).unwrap();
    let force = Features::new(origin, HeadMotion::SpecificForce).unwrap();
    let motion = velocity.motion(&poses).unwrap();
    let golden = |key: &str| numbers(&file["out"][key]);
    assert!(error(motion.pose.as_flattened(), &golden("pose")) < 1e-9);
    assert!(error(motion.velocity.as_flattened(), &golden("vel")) < 1e-9);
    assert!(error(force.motion(&poses).unwrap().velocity.as_flattened(), &golden("acc")) < 1e-9);
    for frame in [5, 33] {
        let expected = golden(&format!("shared_frame_{frame}"));
        assert!(error(&motion.shared(frame, &shape).unwrap(), &expected) < 1e-9);
    }
    assert_eq!(motion.shared(34, &shape), None);

    // Frame 33 is beyond the start, so a running history agrees.
    let mut history = PoseHistory::still(poses[0]).unwrap();
    poses[1..].iter().for_each(|&pose| history.push(pose, SPACING_SECS).unwrap());
    let expected = golden("shared_frame_33");
    assert!(error(&history.numbers(&velocity, &shape), &expected) < 1e-9);
    let rounded = history.inputs(&velocity, &shape).map(f64::from);
    assert!(error(&rounded, &expected) < 1e-4);
    let forces = force.motion(&poses).unwrap().shared(33, &shape).unwrap();
    assert!(error(&history.numbers(&force, &shape), &forces) < 1e-9);
}

#[test]
fn moving_and_turning_the_world_changes_nothing() {
    let world = Pose::new(DQuat::from_rotation_y(2.3), DVec3::new(300.0, -50.0, 1000.0));
    let moved = |pose: BodyPose| BodyPose {
        root: world.after(&pose.root),
        spine: world.after(&pose.spine),
        neck: world.after(&pose.neck),
        head: world.after(&pose.head),
    };
    for head_motion in [HeadMotion::Velocity, HeadMotion::SpecificForce] {
        let features = features(head_motion);
        let poses: Vec<BodyPose> = (0..40).map(|i| moving(f64::from(i) * SPACING_SECS)).collect();
        let elsewhere: Vec<BodyPose> = poses.iter().map(|&pose| moved(pose)).collect();
        let (here, there) = (features.motion(&poses).unwrap(), features.motion(&elsewhere).unwrap());
        for frame in [0, 7, 39] {
            let (a, b) = (here.shared(frame, &SHAPE).unwrap(), there.shared(frame, &SHAPE).unwrap());
            assert!(largest_difference(&a, &b) < 1e-9);
        }
    }
    // Negative control: a tilt changes the direction of gravity.
    let pose = moving(0.3);
    let tilt = Pose::new(DQuat::from_rotation_x(0.1), DVec3::ZERO);
    let tilted = BodyPose { head: tilt.after(&pose.head), ..pose };
    let numbers = |pose| features(HeadMotion::Velocity).motion(&[pose]).unwrap().pose[0];
    assert!(largest_difference(&numbers(pose)[18..21], &numbers(tilted)[18..21]) > 1e-2);
}

#[test]
fn the_specific_force_does_not_know_a_constant_velocity() {
    let features = features(HeadMotion::SpecificForce);
    let drift = |pose: BodyPose, time: f64| {
        let moved = |joint: Pose| Pose { translation: joint.translation + 200.0 * time * DVec3::Z, ..joint };
        BodyPose { head: moved(pose.head), ..pose }
    };
    let time = |i: i32| f64::from(i) * SPACING_SECS;
    let poses: Vec<BodyPose> = (0..40).map(|i| moving(time(i))).collect();
    let drifting: Vec<BodyPose> = (0..40).map(|i| drift(moving(time(i)), time(i))).collect();
    let (a, b) = (features.motion(&poses).unwrap(), features.motion(&drifting).unwrap());
    assert!(largest_difference(a.velocity.as_flattened(), b.velocity.as_flattened()) < 1e-9);
    // At rest it is gravity.
    let rest = features.motion(&[moving(0.2)]).unwrap();
    assert_eq!(rest.velocity[0][21..], rest.pose[0][18..21]);
}

#[test]
fn a_still_body_has_no_velocity_at_any_frame_rate() {
    let features = features(HeadMotion::Velocity);
    let pose = moving(0.77);
    let mut history = PoseHistory::still(moving(0.0)).unwrap();
    history.push(moving(0.1), 0.01).unwrap();
    history.refill(pose).unwrap();
    let refilled = history.numbers(&features, &SHAPE);
    assert!(refilled[21..24].iter().chain(&refilled[34..]).all(|&v| v == 0.0));
    for dt in [SPACING_SECS, 0.013, 0.1, 1.0 / 240.0] {
        let mut still = PoseHistory::still(pose).unwrap();
        for _ in 0..300 {
            still.push(pose, dt).unwrap();
        }
        assert_eq!(still.numbers(&features, &SHAPE), refilled);
    }
    assert_eq!(features.motion(&[pose; 50]).unwrap().shared(49, &SHAPE).unwrap(), refilled);
}

#[test]
fn a_constant_turn_is_the_same_at_every_frame_rate() {
    let features = features(HeadMotion::Velocity);
    let turning = |time: f64| {
        let joint =
            |height: f64| Pose::new(DQuat::from_rotation_y(2.0 * time), DVec3::new(50.0 * time, height, 0.0));
        BodyPose { root: joint(100.0), spine: joint(120.0), neck: joint(145.0), head: joint(155.0) }
    };
    let at_rate = |dt: f64, frames: u32| {
        let mut history = PoseHistory::still(turning(3.0 - dt * f64::from(frames))).unwrap();
        for left in (0..frames).rev() {
            history.push(turning(3.0 - dt * f64::from(left)), dt).unwrap();
        }
        history.numbers(&features, &SHAPE)
    };
    let expected = at_rate(SPACING_SECS, 40);
    assert!((expected[22] - 2.0 / 3.0).abs() < 1e-12);
    // The origin's path is a chord between frames: equal to the square of the angle of a frame.
    for (dt, frames, bar) in [(1.0 / 60.0, 80, 1e-9), (1.0 / 120.0, 160, 1e-9), (0.011, 120, 1e-2)] {
        assert!(largest_difference(&at_rate(dt, frames), &expected) < bar, "{dt}");
    }
    let poses: Vec<BodyPose> = (0..241).map(|i| turning(f64::from(i) / 120.0)).collect();
    let thirds = resample(&poses, 1.0 / 120.0).unwrap();
    assert_eq!(thirds.len(), 61);
    assert_eq!(thirds[60], poses[240]);
    // Slower frames are interpolated at constant speed.
    let slow: Vec<BodyPose> = (0..4).map(|i| turning(f64::from(i) * 0.04)).collect();
    let between = resample(&slow, 0.04).unwrap();
    assert_eq!(between.len(), 4);
    let angle = between[2].head.rotation.to_axis_angle().1;
    assert!((angle - 4.0 * SPACING_SECS).abs() < 1e-12);
}

#[test]
fn a_restored_history_continues_bit_for_bit() {
    let features = features(HeadMotion::SpecificForce);
    let mut history = PoseHistory::still(moving(0.0)).unwrap();
    (1..50).for_each(|i| history.push(moving(f64::from(i) * 0.017), 0.017).unwrap());
    let mut clone = history.clone();
    let mut restored = PoseHistory::from_samples(history.samples().to_vec()).unwrap();
    for i in 50..60 {
        for history in [&mut history, &mut clone, &mut restored] {
            history.push(moving(f64::from(i) * 0.017), 0.017).unwrap();
        }
        let expected = history.inputs(&features, &SHAPE);
        assert_eq!(clone.inputs(&features, &SHAPE), expected);
        assert_eq!(restored.inputs(&features, &SHAPE), expected);
        assert_eq!(history.newest(), &moving(f64::from(i) * 0.017));
    }
    // What lies beyond the reach is dropped: 28/30 s and one frame before.
    assert_eq!(history.samples().len(), 56);
    assert_eq!(SHARED_NUMBERS, 682);
}

#[test]
fn bad_motions_are_errors() {
    let good = moving(0.0);
    let mut bad = good;
    bad.neck.translation.x = f64::NAN;
    let mut stretched = good;
    stretched.root.rotation = DQuat::from_xyzw(0.0, 0.0, 0.0, 2.0);
    let features = features(HeadMotion::Velocity);
    assert_eq!(features.motion(&[]), Err(FeatureError::Empty));
    assert_eq!(features.motion(&[good, bad]), Err(FeatureError::Pose { frame: 1, joint: "neck" }));
    assert_eq!(PoseHistory::still(stretched).unwrap_err(), FeatureError::Pose { frame: 0, joint: "root" });
    assert_eq!(Features::new(DVec3::INFINITY, HeadMotion::Velocity), Err(FeatureError::Origin));
    let mut history = PoseHistory::still(good).unwrap();
    assert_eq!(history.push(good, 0.0), Err(FeatureError::Time(0.0)));
    assert!(history.push(bad, 0.1).is_err());
    assert_eq!(history, PoseHistory::still(good).unwrap());
    assert_eq!(resample(&[], 0.1), Err(FeatureError::Empty));
    assert_eq!(resample(&[good], -1.0), Err(FeatureError::Time(-1.0)));
    assert!(matches!(resample(&[good; 3], 1e12), Err(FeatureError::TooMany(_))));
    assert_eq!(PoseHistory::from_samples(vec![]), Err(FeatureError::Empty));
    assert_eq!(PoseHistory::from_samples(vec![(0.1, good)]), Err(FeatureError::Time(0.1)));
    assert_eq!(PoseHistory::from_samples(vec![(0.0, good), (0.0, good)]), Err(FeatureError::Time(0.0)));
}
