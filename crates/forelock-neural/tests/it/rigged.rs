//! The rigged variant: golden values, gradients, training.

#![expect(clippy::unwrap_used, reason = "a test fails where a result is an error")]

use crate::golden::{error, load, numbers, vectors};
use forelock_core::lane::{Real, Simd};
use forelock_neural::random::Random;
use forelock_neural::rigged::{
    ANGLES, Angles, Body, Capsule, Chain, PoseNetwork, PosePredictor, PoseRange, Rig, RigError, RigPose,
    RigWeights, Torso, TrainSettings, WEIGHTS, train,
};
use glam::DQuat;

/// The rig of the golden file in either precision.
fn golden_rig<T: Real>() -> Rig<T> {
    let file = load("net_5_tiny_rig");
    let cast = |x: f64| cast_to::<T>(x);
    let vector = |v: [f64; 3]| v.map(cast);
    let (roots, bones, radii) = (vectors(&file["root"]), vectors(&file["bone"]), numbers(&file["radius"]));
    let chains = std::array::from_fn(|c| Chain {
        root: vector(roots[c]),
        bones: std::array::from_fn(|j| vector(bones[5 * c + j])),
        radius: cast(radii[c]),
    });
    let torso = Torso {
        pivot: vector([0.0, -9.0, -2.0]),
        neck: vector([0.0, -13.0, 0.0]),
        shoulder: vector([15.0, 0.0, 0.0]),
        neck_radius: cast(5.5),
        shoulder_radius: cast(7.0),
    };
    Rig::new(chains, vector(vectors(&file["ellipsoid"])[0]), torso, RigWeights::default()).unwrap()
}

fn cast_to<T: Real>(x: f64) -> T {
    T::from(x).unwrap()
}

fn golden_bodies() -> Vec<Body<f64>> {
    let file = load("net_5_tiny_rig");
    let all = |key: &str| vectors(&file[key]);
    let radii = numbers(&file["par"]["cap_r"]);
    (0..3)
        .map(|pose| Body {
            gravity: all("gravity_dir")[pose],
            capsules: [
                Capsule { a: all("shoulders_a")[pose], b: all("shoulders_b")[pose], radius: radii[0] },
                Capsule { a: all("neck_a")[pose], b: all("neck_b")[pose], radius: radii[1] },
            ],
        })
        .collect()
}

fn golden_angles() -> Vec<Angles<f64>> {
    let angles = numbers(&load("net_5_tiny_rig")["theta"]);
    angles.chunks_exact(ANGLES).map(|a| a.try_into().unwrap()).collect()
}

#[test]
fn joints_distances_energy_and_gradient_are_the_golden_ones() {
    let out = &load("net_5_tiny_rig")["out"];
    let rig = golden_rig::<f64>();
    let (mut ends, mut distances, mut energies, mut gradients) = (vec![], vec![], vec![], vec![]);
    for (body, angles) in golden_bodies().iter().zip(golden_angles()) {
        let x = rig.joints(&angles);
        ends.extend_from_slice(x.as_flattened().as_flattened());
        distances.extend_from_slice(rig.distances(body, &x).as_flattened());
        let mut gradient = [f64::NAN; ANGLES];
        energies.push(rig.energy(body, &angles, &mut gradient));
        gradients.extend(gradient);
    }
    assert!(error(&ends, &numbers(&out["x"])) < 1e-9);
    assert!(error(&distances, &numbers(&out["d"])) < 1e-9);
    assert!(error(&energies, &numbers(&out["E"])) < 1e-9);
    assert!(error(&gradients, &numbers(&out["grad_theta"])) < 1e-9);
}

#[test]
fn single_precision_is_close_to_the_golden_values() {
    let out = &load("net_5_tiny_rig")["out"];
    let rig = golden_rig::<f32>();
    let (mut energies, mut gradients) = (vec![], vec![]);
    for (body, angles) in golden_bodies().iter().zip(golden_angles()) {
        let narrow = |v: [f64; 3]| v.map(|c| c as f32);
        let capsules =
            body.capsules.map(|c| Capsule { a: narrow(c.a), b: narrow(c.b), radius: c.radius as f32 });
        let body = Body { gravity: narrow(body.gravity), capsules };
        let mut gradient = [0.0; ANGLES];
        energies.push(f64::from(rig.energy(&body, &angles.map(|a| a as f32), &mut gradient)));
        gradients.extend(gradient.map(f64::from));
    }
    assert!(error(&energies, &numbers(&out["E"])) < 2e-5);
    assert!(error(&gradients, &numbers(&out["grad_theta"])) < 1e-3);
}

#[test]
fn gradients_agree_with_finite_differences() {
    let rig = golden_rig::<f64>();
    let mut random = Random::new(9);
    for size in [0.0, 1e-4, 0.3, 1.5] {
        for body in golden_bodies() {
            let mut angles: Angles<f64> = std::array::from_fn(|_| size * random.signed());
            let mut gradient = [0.0; ANGLES];
            rig.energy(&body, &angles, &mut gradient);
            let largest = gradient.iter().fold(0.0f64, |a, g| a.max(g.abs()));
            for i in 0..ANGLES {
                let before = angles[i];
                let mut at = |step: f64| {
                    angles[i] = before + step;
                    rig.energy(&body, &angles, &mut [0.0; ANGLES])
                };
                // Fourth order.
                let h = 1e-3;
                let slope = (8.0 * (at(h) - at(-h)) - (at(2.0 * h) - at(-2.0 * h))) / (12.0 * h);
                at(0.0);
                assert!((slope - gradient[i]).abs() <= 1e-5 * largest, "{size} {i}: {slope} {}", gradient[i]);
            }
        }
    }
}

#[test]
fn a_straight_chain_at_rest_is_the_sum_of_its_bones() {
    let rig = Rig::<f64>::example();
    let ends = rig.joints(&[0.0; ANGLES]);
    assert!((ends[1][4][1] + 5.0 * 3.962).abs() < 1e-12);
    // A quarter turn of the first joint about x takes y to z and turns all bones alike.
    let mut angles = [0.0; ANGLES];
    angles[15] = std::f64::consts::FRAC_PI_2;
    let turned = rig.joints(&angles);
    for (a, b) in ends[1].iter().zip(turned[1]) {
        // About the root at (−7.6, 0, −2): (y, z + 2) → (−(z + 2), y).
        assert!((b[1] + (a[2] + 2.0)).abs() < 1e-12 && (b[2] + 2.0 - a[1]).abs() < 1e-12);
    }
    assert_eq!(turned[0], ends[0]);
}

#[test]
fn the_body_follows_the_torso() {
    let rig = Rig::<f64>::example();
    let upright = rig.body(&RigPose::new(DQuat::IDENTITY, DQuat::IDENTITY));
    assert_eq!(upright.gravity, [0.0, -1.0, 0.0]);
    assert_eq!(upright.capsules[0].b, [15.0, -22.0, -2.0]);
    assert_eq!(upright.capsules[1].b, [0.0, -9.0, -2.0]);
    // The head turns a quarter to its left (about y): the right shoulder (−x) comes to the front.
    let head = DQuat::from_rotation_y(std::f64::consts::FRAC_PI_2);
    let turned = rig.body(&RigPose::new(head, DQuat::IDENTITY));
    assert!((turned.capsules[0].a[2] + 2.0 + 15.0).abs() < 1e-12, "{turned:?}");
}

/// The least energy of a pose, by Adam on the angles from those given.
fn least_energy(rig: &Rig<f64>, body: &Body<f64>, start: &Angles<f64>) -> f64 {
    let (mut angles, mut mean, mut square) = (*start, [0.0; ANGLES], [0.0; ANGLES]);
    let mut gradient = [0.0; ANGLES];
    let mut least = rig.energy(body, &angles, &mut gradient);
    let steps = 2000;
    for step in 1..=steps {
        let rate = 0.005 * (1.0 - f64::from(step) / f64::from(steps + 1));
        for i in 0..ANGLES {
            mean[i] = 0.9 * mean[i] + 0.1 * gradient[i];
            square[i] = 0.99 * square[i] + 0.01 * gradient[i] * gradient[i];
            angles[i] -= rate * mean[i]
                / (1.0 - 0.9f64.powi(step))
                / ((square[i] / (1.0 - 0.99f64.powi(step))).sqrt() + 1e-12);
        }
        least = least.min(rig.energy(body, &angles, &mut gradient));
    }
    least
}

/// Trains on random poses and tests on others: the share of joints inside, and the mean energy over
/// the least as a share of the rigid pose's.
fn train_and_judge(steps: u32) -> (f64, f64) {
    let mut random = Random::new(20);
    let mut draw =
        |n: usize| -> Vec<RigPose<f32>> { (0..n).map(|_| PoseRange::default().draw(&mut random)).collect() };
    let (seen, unseen) = (draw(16_384), draw(100));
    let clock = std::time::Instant::now();
    let network = train(&golden_rig(), &seen, &TrainSettings { steps, ..Default::default() }).unwrap();
    eprintln!("{steps} steps: {:.1} s", clock.elapsed().as_secs_f64());
    let rig = golden_rig::<f64>();
    let (mut inside, mut excess, mut rigid_excess) = (0, 0.0, 0.0);
    for pose in &unseen {
        let angles = network.angles(pose).map(f64::from);
        let wide =
            RigPose { gravity: pose.gravity.map(f64::from), torso: pose.torso.map(|c| c.map(f64::from)) };
        let body = rig.body(&wide);
        let distances = rig.distances(&body, &rig.joints(&angles));
        inside += distances.as_flattened().iter().filter(|&&d| d < 0.0).count();
        // Two starts, so that one that ends in a valley of its own does not count.
        let least = least_energy(&rig, &body, &angles).min(least_energy(&rig, &body, &[0.0; ANGLES]));
        let mut gradient = [0.0; ANGLES];
        excess += rig.energy(&body, &angles, &mut gradient) - least;
        rigid_excess += rig.energy(&body, &[0.0; ANGLES], &mut gradient) - least;
    }
    let share = excess / rigid_excess;
    let inside = inside as f64 / (20.0 * unseen.len() as f64);
    eprintln!("inside {:.3} %, excess {:.3} % of {:.1}", 100.0 * inside, 100.0 * share, rigid_excess / 100.0);
    (inside, share)
}

#[test]
fn training_takes_the_chains_out_of_the_body_and_near_the_least_energy() {
    // Seen: 0.15 % inside, 0.12 % of the rigid pose's excess.
    let (inside, excess) = train_and_judge(TrainSettings::default().steps);
    assert!(inside <= 0.005 && excess <= 0.003, "{inside} {excess}");
    // Negative control: training matters.
    let (_, excess) = train_and_judge(1);
    assert!(excess > 0.5, "{excess}");
}

#[test]
fn lanes_of_any_width_predict_the_angles_of_the_network() {
    let mut random = Random::new(3);
    let poses: Vec<RigPose<f32>> = (0..200).map(|_| PoseRange::default().draw(&mut random)).collect();
    // Large weights bring tanh to its ends too.
    for size in [0.3, 1.0, 4.0] {
        let weights = (0..WEIGHTS).map(|_| (size * random.signed()) as f32).collect();
        let network = PoseNetwork::new(weights).unwrap();
        for simd in Simd::ALL.into_iter().filter(|simd| simd.is_supported()) {
            let predictor = PosePredictor::new(&network, simd);
            for pose in &poses {
                let (found, expected) = (predictor.angles(pose), network.angles(pose));
                let error = found.iter().zip(&expected).fold(0.0f32, |e, (a, b)| e.max((a - b).abs()));
                assert!(error < 6e-6 * size as f32, "{simd:?}, {size}: {error}");
            }
        }
    }
}

#[test]
#[ignore = "measures time"]
fn a_pose_takes_at_most_300_ns() {
    let mut random = Random::new(2);
    let poses: Vec<RigPose<f32>> = (0..1000).map(|_| PoseRange::default().draw(&mut random)).collect();
    let settings = TrainSettings { steps: 1, ..Default::default() };
    let network = train(&Rig::example(), &poses, &settings).unwrap();
    let network = PosePredictor::new(&network, Simd::Auto);
    let best = (0..200).map(|_| {
        let clock = std::time::Instant::now();
        for pose in &poses {
            std::hint::black_box(network.angles(std::hint::black_box(pose)));
        }
        clock.elapsed().as_nanos()
    });
    let nanoseconds = best.min().unwrap() as f64 / 1000.0;
    println!("{nanoseconds:.0} ns a pose");
    assert!(nanoseconds <= 300.0);
}

#[test]
fn one_seed_gives_the_same_weights_and_another_others() {
    let mut random = Random::new(5);
    let poses: Vec<RigPose<f32>> = (0..64).map(|_| PoseRange::default().draw(&mut random)).collect();
    let run = |seed| {
        train(&Rig::example(), &poses, &TrainSettings { steps: 20, seed, ..Default::default() }).unwrap()
    };
    let network = run(7);
    assert_eq!(network, run(7));
    assert_ne!(network, run(8));
    assert_eq!(PoseNetwork::new(network.weights().to_vec()).unwrap(), network);
}

#[test]
fn bad_rigs_and_settings_are_errors() {
    let pose = RigPose::<f64>::new(DQuat::IDENTITY, DQuat::IDENTITY);
    let rig = Rig::example();
    let settings = TrainSettings::default();
    assert_eq!(train(&rig, &[], &settings), Err(RigError::NoPoses));
    let bad = RigPose { gravity: [f64::NAN; 3], ..pose };
    assert_eq!(train(&rig, &[pose, bad], &settings), Err(RigError::Pose(1)));
    for (setting, settings) in [
        ("steps", TrainSettings { steps: 0, ..settings }),
        ("batch", TrainSettings { batch: 0, ..settings }),
        ("rate", TrainSettings { rate: f64::NAN, ..settings }),
    ] {
        assert_eq!(train(&rig, &[pose], &settings), Err(RigError::Setting(setting)));
    }
    assert_eq!(PoseNetwork::new(vec![0.0f32; 3]), Err(RigError::Weights(3)));
    assert_eq!(PoseNetwork::new(vec![f64::NAN; WEIGHTS]), Err(RigError::Weights(WEIGHTS)));
    let chain = Chain { root: [0.0; 3], bones: [[0.0, -1.0, 0.0]; 5], radius: 1.0 };
    let torso = Torso {
        pivot: [0.0; 3],
        neck: [0.0, -1.0, 0.0],
        shoulder: [1.0, 0.0, 0.0],
        neck_radius: 1.0,
        shoulder_radius: 0.0,
    };
    let made = |axes, torso| Rig::new([chain; 4], axes, torso, RigWeights::default());
    assert_eq!(made([1.0; 3], torso), Err(RigError::Rig("torso")));
    assert_eq!(made([1.0, -1.0, 1.0], torso), Err(RigError::Rig("head")));
    // A point at the head's centre has no direction out, and does no harm.
    let rig = made([1.0; 3], Torso { shoulder_radius: 1.0, ..torso }).unwrap();
    let mut gradient = [0.0; ANGLES];
    assert!(rig.energy(&rig.body(&pose), &[0.0; ANGLES], &mut gradient).is_finite());
    assert!(gradient.iter().all(|g| g.is_finite()));
}
