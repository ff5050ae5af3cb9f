//! The history of the head's poses as an array of a snapshot.
//!
//! # Practice
//! A sample is its age and the head's pose: eight float64. Each is written as four float32 that
//! hold 16 bits as a whole number, so that every bit survives and none makes a number that is not
//! one.

use forelock_core::pose::Pose;
use forelock_core::strands::SnapshotError;
use forelock_neural::features::{BodyPose, PoseHistory};
use glam::{DQuat, DVec3};

/// The name of the array.
pub(super) const NAME: &str = "pose_history";

/// Numbers of a sample.
const SAMPLE: usize = 8;
/// Parts of a number.
const PARTS: usize = 4;

/// The joints of a rigid head.
pub(super) fn rigid(head: Pose) -> BodyPose {
    BodyPose { root: head, spine: head, neck: head, head }
}

/// The array of `history`.
pub(super) fn encode(history: &PoseHistory) -> Vec<f32> {
    let numbers = |(age, body): &(f64, BodyPose)| {
        let (q, x) = (body.head.rotation, body.head.translation);
        [*age, q.x, q.y, q.z, q.w, x.x, x.y, x.z]
    };
    let parts = |number: f64| {
        let bits = number.to_bits();
        [0, 16, 32, 48].map(|shift| f32::from((bits >> shift) as u16))
    };
    history.samples().iter().flat_map(numbers).flat_map(parts).collect()
}

/// What is wrong with an `array` that is not that of a history.
pub(super) fn unfit(array: &[f32]) -> SnapshotError {
    let found = array.len();
    SnapshotError {
        array: NAME,
        expected: (SAMPLE * PARTS).max(found.next_multiple_of(SAMPLE * PARTS)),
        found,
    }
}

/// The history of an array; none if it is not that of a history.
pub(super) fn decode(array: &[f32]) -> Option<PoseHistory> {
    let (samples, []) = array.as_chunks::<{ SAMPLE * PARTS }>() else { return None };
    let is_part = |part: &f32| part.fract() == 0.0 && (0.0..65536.0).contains(part);
    if !array.iter().all(is_part) {
        return None;
    }
    let number = |parts: &[f32]| {
        let bits = parts.iter().zip([0, 16, 32, 48]).map(|(part, shift)| (*part as u64) << shift);
        f64::from_bits(bits.fold(0, |all, own| all | own))
    };
    let sample = |parts: &[f32; SAMPLE * PARTS]| {
        let n: [f64; SAMPLE] = std::array::from_fn(|k| number(&parts[PARTS * k..][..PARTS]));
        let rotation = DQuat::from_xyzw(n[1], n[2], n[3], n[4]);
        (n[0], rigid(Pose { rotation, translation: DVec3::new(n[5], n[6], n[7]) }))
    };
    PoseHistory::from_samples(samples.iter().map(sample).collect()).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_history_comes_back_bit_for_bit() {
        let pose = |k: u32| {
            let s = f64::from(k) / 7.0;
            Pose::new(DQuat::from_rotation_x(s.sin()), DVec3::new(-0.0, 1e-300 * s, 1e7 / (s + 0.1)))
        };
        let mut history = PoseHistory::still(rigid(pose(0))).unwrap();
        for k in 1..80 {
            history.push(rigid(pose(k)), 1.0 / 60.0).unwrap();
        }
        let array = encode(&history);
        assert_eq!(array.len(), 32 * history.samples().len());
        assert!(array.iter().all(|part| part.is_finite()));
        let bits = |history: &PoseHistory| -> Vec<u64> {
            let numbers = |(age, body): &(f64, BodyPose)| {
                let [q, x] =
                    [body.head.rotation.to_array().to_vec(), body.head.translation.to_array().to_vec()];
                [vec![*age], q, x].concat()
            };
            history.samples().iter().flat_map(numbers).map(f64::to_bits).collect()
        };
        assert_eq!(bits(&decode(&array).unwrap()), bits(&history));
        assert!(decode(&array[1..]).is_none() && decode(&[]).is_none());
        assert!(decode(&[f32::NAN; 32]).is_none() && decode(&[0.5; 32]).is_none());
    }
}
