//! The implicit reference against reference results.

use crate::golden::{load, numbers, vectors};
use forelock_core::lane::{Mat3, V3};
use forelock_neural::PARTICLES;
use forelock_neural::features::{BodyPose, SPACING_SECS};
use forelock_neural::losses::Strand;
use forelock_neural::losses::body::{Body, BodyTerms, Capsule, Ellipsoid, Near};
use forelock_neural::losses::elastic::ElasticTerms;
use forelock_neural::losses::motion::{MotionTerms, Place};
use forelock_neural::reference::{Terms, motion};
use forelock_neural::train::motions::{Kind, generate};
use glam::{DMat3, DVec3};

/// A head and the parts below it.
struct Bust {
    head: Ellipsoid<f64>,
    parts: Vec<Capsule<f64>>,
}

impl Body<f64> for Bust {
    fn near(&self, x: V3<f64>) -> Near<f64> {
        self.parts.near(x).min(self.head.near(x))
    }
}

#[test]
fn a_turn_agrees_with_reference_results() {
    let file = load("ie_1_turn_sequential");
    let radii = V3::splat(DVec3::from(vectors(&file["ellipsoid"])[0]));
    let sizes = numbers(&file["cap_r"]);
    let ends = ["cap_a", "cap_b"].map(|key| vectors(&file[key]));
    let (places, bodies): (Vec<Place<f64>>, Vec<Bust>) = (0..30)
        .map(|frame| {
            let rotation: [f64; 9] = numbers(&file["R"][frame]).try_into().unwrap();
            let rotation = Mat3::splat(DMat3::from_cols_array(&rotation).transpose());
            let origin = V3::splat(DVec3::from(vectors(&file["p"])[frame]));
            let part =
                |k: usize| Capsule { ends: [0, 1].map(|e| V3(ends[e][4 * frame + k])), radius: sizes[k] };
            (
                Place { rotation, origin },
                Bust { head: Ellipsoid { radii }, parts: (0..4).map(part).collect() },
            )
        })
        .unzip();
    let terms = Terms {
        elastic: ElasticTerms::default(),
        motion: MotionTerms { drag: 0.0, ..MotionTerms::default() },
        body: BodyTerms { tail: f64::INFINITY, ..BodyTerms::default() },
    };
    let rests = vectors(&file["x_rest"]);
    let expected = vectors(&file["x"]);
    let frames = numbers(&file["frames"]);
    let mut worst = 0.0f64;
    for (s, rest) in rests.chunks_exact(PARTICLES).enumerate() {
        let rest: Strand<f64> = std::array::from_fn(|i| V3(rest[i]));
        let found = motion(&terms, &rest, &places, &bodies);
        for (f, frame) in frames.iter().enumerate() {
            let expected = &expected[(2 * f + s) * PARTICLES..][..PARTICLES];
            for (found, expected) in found[*frame as usize].iter().zip(expected) {
                worst = worst.max(DVec3::from(found.0).distance(DVec3::from(*expected)));
            }
        }
    }
    assert!(worst < 1e-5, "{worst:e} cm");
}

/// A strand whose stiffness far exceeds its inertia stays near its shape, however the head moves:
/// going on at its velocity would fold it. The body's margin lifts it by 1.1 cm.
#[test]
fn short_strands_stay_near_their_shape() {
    let radii = V3::splat(DVec3::splat(9.0));
    let rest: Strand<f64> = std::array::from_fn(|i| {
        let angle = 0.4 * i as f64 / (PARTICLES - 1) as f64;
        V3([9.01 * angle.sin(), 9.01 * angle.cos(), 0.0])
    });
    let terms = Terms {
        elastic: ElasticTerms::default(),
        motion: MotionTerms::default(),
        body: BodyTerms::default(),
    };
    for seed in 0..4 {
        let poses = generate(Kind::RigidTurnAndHold, false, 60, SPACING_SECS, seed);
        let place = |pose: &BodyPose| Place {
            rotation: Mat3::splat(DMat3::from_quat(pose.head.rotation)),
            origin: V3::splat(pose.head.translation),
        };
        let places: Vec<Place<f64>> = poses.iter().map(place).collect();
        let bodies: Vec<Ellipsoid<f64>> = poses.iter().map(|_| Ellipsoid { radii }).collect();
        for (frame, x) in motion(&terms, &rest, &places, &bodies).iter().enumerate() {
            let off = (0..PARTICLES).map(|i| DVec3::from((x[i] - rest[i]).0).length()).fold(0.0, f64::max);
            assert!(off < 1.5, "{seed}, frame {frame}: {off} cm");
        }
    }
}
