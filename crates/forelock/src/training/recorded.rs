//! Recorded motions of people for a training: `.bvh` files.
//!
//! # Practice
//! Three quarters of each file are trained: pieces from random times, mirrored or not, 0.7 to 1.4
//! times as fast. The last quarter, as it was recorded, measures the result. The head's origin is
//! midway between its joint and the next one.

use std::path::Path;

use forelock_core::pose::Pose;
use forelock_io::bvh::Bvh;
use forelock_neural::features::{BodyPose, SPACING_SECS};
use forelock_neural::random::Random;
use glam::{DAffine3, DQuat, DVec3};

use super::TrainingError;
use super::config::TrainedMotions;
use crate::hash::Fnv;

/// Share of a file that is trained.
const TRAINED: f64 = 0.75;
/// Speeds of pieces, over that of the recording: the least, and the largest over the least.
const SPEEDS: [f64; 2] = [0.7, 2.0];
/// The shortest file and the longest, seconds.
const SHORTEST_SECS: f64 = 4.0;
const LONGEST_SECS: f64 = 1e5;
/// Height of the head above the lowest joint where a file's unit is not given, cm.
const HEAD_CM: f64 = 150.0;

/// A file.
struct Recording {
    /// Poses, cm, `frame_secs` apart.
    poses: Vec<BodyPose>,
    frame_secs: f64,
}

/// The files of a training.
pub(super) struct Recorded(Vec<Recording>);

/// `pose` seen in the mirror x → −x.
fn mirrored(pose: &Pose) -> Pose {
    let (q, t) = (pose.rotation, pose.translation);
    Pose { rotation: DQuat::from_xyzw(q.x, -q.y, -q.z, q.w), translation: DVec3::new(-t.x, t.y, t.z) }
}

impl Recording {
    fn read(path: &Path, own: &TrainedMotions) -> Result<Self, TrainingError> {
        let bvh = forelock_io::read_motion(path).map_err(|error| TrainingError::Assets(error.into()))?;
        let refused = |problem| TrainingError::Recorded { path: path.to_path_buf(), problem };
        let mut joints = [0; 4];
        for (joint, name) in joints.iter_mut().zip(&own.joints) {
            let found = name.split('|').find_map(|name| bvh.skeleton.find(name.trim()));
            *joint = found.ok_or_else(|| {
                let names = bvh.skeleton.joints().iter().map(|joint| joint.name.as_str());
                let names = names.collect::<Vec<_>>().join(", ");
                refused(format!("it has no joint {name:?} (`motions.joints`); it has {names}"))
            })?;
        }
        let secs = bvh.secs(bvh.frames.saturating_sub(1));
        if secs < SHORTEST_SECS {
            return Err(refused(format!("it lasts {secs:.1} s: at least {SHORTEST_SECS} s are needed")));
        }
        if secs > LONGEST_SECS {
            return Err(refused(format!("it lasts {secs:.1e} s: {LONGEST_SECS} s are allowed; cut it")));
        }
        let poses = poses(&bvh, joints, own.unit);
        let poses = poses.ok_or_else(|| {
            refused("its head is not above all joints in the first frame: set `motions.unit`".to_owned())
        })?;
        Ok(Self { poses, frame_secs: bvh.frame_secs })
    }

    /// Seconds from the first to the last frame.
    fn secs(&self) -> f64 {
        (self.poses.len() - 1) as f64 * self.frame_secs
    }

    fn at(&self, secs: f64) -> BodyPose {
        let place = (secs / self.frame_secs).clamp(0.0, (self.poses.len() - 1) as f64);
        let first = (place as usize).min(self.poses.len().saturating_sub(2));
        self.poses[first].interpolate(&self.poses[first + 1], place - first as f64)
    }

    /// `frames` poses from `start_secs` on, `speed` times as fast.
    fn piece(&self, start_secs: f64, frames: usize, speed: f64) -> Vec<BodyPose> {
        (0..frames).map(|frame| self.at(start_secs + speed * SPACING_SECS * frame as f64)).collect()
    }
}

/// The poses of root, spine, neck and head, which are `joints`, in cm; none if no unit is given and
/// the head is not above the lowest joint.
fn poses(bvh: &Bvh, joints: [usize; 4], unit_m: f64) -> Option<Vec<BodyPose>> {
    let (mut locals, mut globals) = (bvh.skeleton.rest(), Vec::new());
    let head = joints[3];
    let next = bvh.skeleton.joints().iter().find(|joint| joint.parent == Some(head));
    let middle = next.map_or(DVec3::ZERO, |joint| 0.5 * joint.rest.translation);
    let mut scale = 100.0 * unit_m;
    let mut found = Vec::with_capacity(bvh.frames);
    for secs in bvh.times() {
        bvh.clip.sample(secs, &mut locals, &mut []);
        bvh.skeleton.globals(&locals, &mut globals);
        if scale <= 0.0 {
            let lowest = globals.iter().fold(f64::INFINITY, |least, joint| least.min(joint.translation.y));
            let height = globals[head].translation.y - lowest;
            scale = HEAD_CM / height;
            if !(height > 0.0 && scale.is_finite()) {
                return None;
            }
        }
        let pose = |joint: &DAffine3, origin: DVec3| {
            let (_, rotation, _) = joint.to_scale_rotation_translation();
            Pose { rotation: rotation.normalize(), translation: scale * joint.transform_point3(origin) }
        };
        let [root, spine, neck] = [0, 1, 2].map(|k| pose(&globals[joints[k]], DVec3::ZERO));
        found.push(BodyPose { root, spine, neck, head: pose(&globals[head], middle) });
    }
    Some(found)
}

impl Recorded {
    /// Reads the files of `own`.
    pub fn load(own: &TrainedMotions) -> Result<Self, TrainingError> {
        Ok(Self(own.files.iter().map(|path| Recording::read(path, own)).collect::<Result<_, _>>()?))
    }

    /// Whether there are no files.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// A hash of all poses and their times.
    pub fn hash(&self) -> u64 {
        let mut hash = Fnv::new();
        for own in &self.0 {
            hash = hash.bytes(&own.poses.len().to_le_bytes()).bytes(&own.frame_secs.to_le_bytes());
            for pose in own.poses.iter().flat_map(BodyPose::joints) {
                let (rotation, translation) = (pose.rotation.to_array(), pose.translation.to_array());
                let numbers = rotation.into_iter().chain(translation);
                hash = numbers.fold(hash, |hash, x| hash.bytes(&x.to_le_bytes()));
            }
        }
        hash.value()
    }

    /// A random piece of what is trained, of at most `frames` frames.
    ///
    /// # Panics
    /// If there are no files.
    pub fn piece(&self, frames: usize, random: &mut Random) -> Vec<BodyPose> {
        let mut place = random.unit() * self.0.iter().map(Recording::secs).sum::<f64>();
        let found = self.0.iter().position(|own| {
            place -= own.secs();
            place < 0.0
        });
        let own = &self.0[found.unwrap_or(self.0.len() - 1)];
        let speed = SPEEDS[0] * SPEEDS[1].powf(random.unit());
        let is_mirrored = random.unit() < 0.5;
        let trained_secs = TRAINED * own.secs();
        let frames = frames.min((trained_secs / (speed * SPACING_SECS)) as usize + 1);
        let rest_secs = trained_secs - speed * SPACING_SECS * (frames - 1) as f64;
        let mut poses = own.piece(rest_secs.max(0.0) * random.unit(), frames, speed);
        if is_mirrored {
            for BodyPose { root, spine, neck, head } in &mut poses {
                [root, spine, neck, head].into_iter().for_each(|pose| *pose = mirrored(pose));
            }
        }
        poses
    }

    /// What measures the result: the last quarter of each file, in equal pieces of at most `frames`
    /// frames, or `most` such pieces of it.
    pub fn measured(&self, frames: usize, most: usize) -> Vec<Vec<BodyPose>> {
        let of_file = |own: &Recording| {
            let secs = (1.0 - TRAINED) * own.secs();
            let all = (secs / SPACING_SECS) as usize + 1;
            let pieces = all.div_ceil(frames.max(1)).min(most);
            let start = |piece: usize| TRAINED * own.secs() + secs * piece as f64 / pieces as f64;
            (0..pieces)
                .map(|piece| own.piece(start(piece), frames.min(all / pieces), 1.0))
                .collect::<Vec<_>>()
        };
        self.0.iter().flat_map(of_file).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A file whose head rises by a unit a second and turns about the vertical by 0.5 radians a
    /// second, twelve seconds long.
    fn file() -> tempfile::NamedTempFile {
        let joints = "HIERARCHY\nROOT Hips\n{\nOFFSET 0 1 0\nCHANNELS 4 Xposition Yposition Zposition Yrotation\n\
            JOINT Spine1\n{\nOFFSET 0 1 0\nCHANNELS 0\nJOINT Neck1\n{\nOFFSET 0 1 0\nCHANNELS 0\nJOINT Head\n{\n\
            OFFSET 0 1 0\nCHANNELS 0\nEnd Site\n{\nOFFSET 0 0 0.4\n}\n}\n}\n}\n}\n";
        let frames: String = (0..=360)
            .map(|k| {
                let secs = f64::from(k) / 30.0;
                format!("{} {} 0 {}\n", 0.1 * secs, 1.0 + secs, (0.5 * secs).to_degrees())
            })
            .collect();
        let file = tempfile::Builder::new().suffix(".bvh").tempfile().unwrap();
        let text = format!("{joints}MOTION\nFrames: 361\nFrame Time: 0.0333333333\n{frames}");
        std::fs::write(file.path(), text).unwrap();
        file
    }

    fn motions(file: &tempfile::NamedTempFile) -> TrainedMotions {
        TrainedMotions { files: vec![file.path().to_path_buf()], ..TrainedMotions::default() }
    }

    #[test]
    fn what_measures_is_the_last_quarter_and_none_of_it_is_trained() {
        let file = file();
        let recorded = Recorded::load(&motions(&file)).unwrap();
        // 150 cm are three units.
        let height = |pose: &BodyPose| pose.head.translation.y / 50.0 - 4.0;
        assert_eq!(recorded.measured(60, 1).iter().map(Vec::len).collect::<Vec<_>>(), [60]);
        let measured = recorded.measured(60, 6);
        assert_eq!(measured.iter().map(Vec::len).collect::<Vec<_>>(), [45, 45]);
        assert!((height(&measured[0][0]) - 9.0).abs() < 1e-6);
        assert!((height(&measured[1][44]) - 10.5 - 44.0 / 30.0).abs() < 1e-6);
        let mut random = Random::new(3);
        let mut sides = [0, 0];
        for _ in 0..200 {
            let piece = recorded.piece(90, &mut random);
            assert_eq!(piece.len(), 90);
            let [first, last] = [0, 89].map(|k| height(&piece[k]));
            let speed = (last - first) / (89.0 / 30.0);
            assert!((0.699..1.401).contains(&speed), "{speed}");
            assert!(first > -1e-6 && last < 9.0 + 1e-6, "{first} to {last}");
            // Mirrored, the body moves and turns the other way.
            let side = piece[89].root.translation.x - piece[0].root.translation.x;
            let turned = (piece[0].head.rotation.inverse() * piece[89].head.rotation).to_scaled_axis();
            assert!((turned.y / side - 0.5 / 5.0).abs() < 1e-6, "{turned} and {side}");
            assert!((turned.y.abs() - 0.5 * (last - first)).abs() < 1e-6);
            sides[usize::from(side > 0.0)] += 1;
        }
        assert!(sides[0] > 60 && sides[1] > 60, "{sides:?}");
    }

    #[test]
    fn the_heads_origin_is_between_its_joint_and_the_next() {
        let file = file();
        let recorded = Recorded::load(&motions(&file)).unwrap();
        let pose = recorded.0[0].poses[0];
        assert!(
            (pose.head.transform_point(DVec3::ZERO) - pose.neck.translation)
                .distance(DVec3::new(0.0, 50.0, 10.0))
                < 1e-9
        );
    }

    #[test]
    fn files_that_cannot_be_used_say_why() {
        let file = file();
        let said = |own: &TrainedMotions| Recorded::load(own).map(|_| ()).unwrap_err().to_string();
        let mut own = motions(&file);
        own.joints[3] = "Skull".to_owned();
        assert!(
            said(&own).contains("no joint \"Skull\" (`motions.joints`); it has Hips, Spine1, Neck1, Head")
        );
        own.files = vec!["nowhere.bvh".into()];
        assert!(said(&own).contains("nowhere.bvh"));
        let text = std::fs::read_to_string(file.path()).unwrap();
        std::fs::write(file.path(), text.replace("Frame Time: 0.0333333333", "Frame Time: 0.005")).unwrap();
        assert!(said(&motions(&file)).contains("it lasts 1.8 s: at least 4 s"));
        std::fs::write(file.path(), text.replace("Frame Time: 0.0333333333", "Frame Time: 1e6")).unwrap();
        assert!(said(&motions(&file)).contains("it lasts 3.6e8 s: 100000 s are allowed"));
    }
}
