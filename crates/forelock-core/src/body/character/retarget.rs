//! Carries a clip from one skeleton to another.
//!
//! # Theory
//! A joint's motion is its rotation from rest, in the body's axes: D = G(t) G(0)⁻¹ of the source.
//! The joint of the target that corresponds to it turns by the same, G′(t) = D A G′(0), where A is
//! the smallest rotation that takes the direction of the target's bone at rest to that of the
//! source's: skeletons at rest may hold their arms differently. Joints without a counterpart follow
//! their parents.
//!
//! Bones that point upwards in both skeletons (spine, neck), and bones at a branch that are shorter
//! than the next one (collar bones, hip joints), keep their own direction: skeletons differ in
//! where such joints are, not in how the body stands.
//!
//! # Practice
//! The first joint that both have also takes over the source's path, scaled by the ratio of the
//! heights of the two. The path starts where the target is at rest and in the direction in which it
//! looks there, and its lowest point is on the target's ground.

use std::collections::BTreeMap;

use glam::{DAffine3, DQuat, DVec3};

use super::skeleton::nearest_rotation;
use super::{Clip, Interpolation, Skeleton, Track, Values};

/// Height of the direction of a bone that points upwards: within 37° of the vertical.
const UPRIGHT: f64 = 0.8;
/// Bones shorter than this share of the skeleton's height have no direction.
const SHORTEST: f64 = 1e-6;

/// A correspondence of the joints of two skeletons.
#[derive(Clone, Debug, PartialEq)]
pub struct Retarget<'a> {
    source: &'a Skeleton,
    target: &'a Skeleton,
    /// For each joint of the target, its counterpart.
    joints: Vec<Option<usize>>,
}

/// Why a clip cannot be carried over.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RetargetError {
    /// The map names a joint that does not exist.
    #[error("there is no joint {name:?} in the {side}; it has {known}")]
    Unknown {
        /// Where: "motion" or "body".
        side: &'static str,
        /// The name.
        name: String,
        /// Some of the names that exist.
        known: String,
    },
    /// The skeletons have no joint in common.
    #[error(
        "the motion and the body have no joint name in common: the motion has {source_names}, the body \
         {target_names}; say which correspond"
    )]
    NothingInCommon {
        /// Some names of the motion.
        source_names: String,
        /// Some names of the body.
        target_names: String,
    },
}

/// The first names of the joints of `skeleton`.
fn names(skeleton: &Skeleton) -> String {
    let mut names: Vec<&str> = skeleton.joints().iter().take(12).map(|joint| joint.name.as_str()).collect();
    if skeleton.joints().len() > names.len() {
        names.push("…");
    }
    names.join(", ")
}

impl<'a> Retarget<'a> {
    /// Joints of the same names correspond, and those that `map` names: each name of the target
    /// with one of the source, or with an empty one for no counterpart.
    ///
    /// # Errors
    /// [`RetargetError`] if `map` names an unknown joint, or no joints correspond.
    pub fn new(
        source: &'a Skeleton,
        target: &'a Skeleton,
        map: &BTreeMap<String, String>,
    ) -> Result<Self, RetargetError> {
        let unknown = |side, name: &str, skeleton| RetargetError::Unknown {
            side,
            name: name.to_owned(),
            known: names(skeleton),
        };
        for (own, other) in map {
            target.find(own).ok_or_else(|| unknown("body", own, target))?;
            if !other.is_empty() {
                source.find(other).ok_or_else(|| unknown("motion", other, source))?;
            }
        }
        let mapped: BTreeMap<usize, &str> =
            map.iter().filter_map(|(own, other)| Some((target.find(own)?, other.as_str()))).collect();
        let counterpart = |(index, joint): (usize, &super::Joint)| match mapped.get(&index) {
            Some(other) => source.find(other),
            None => source.find(&joint.name).filter(|_| !joint.name.is_empty()),
        };
        let joints: Vec<Option<usize>> = target.joints().iter().enumerate().map(counterpart).collect();
        if joints.iter().all(Option::is_none) {
            let (source_names, target_names) = (names(source), names(target));
            return Err(RetargetError::NothingInCommon { source_names, target_names });
        }
        Ok(Self { source, target, joints })
    }

    /// Joints that have no counterpart: of the target, and of the source. Joints at the ends of
    /// chains, which move no other, do not count in the source.
    pub fn unmatched(&self) -> [Vec<&'a str>; 2] {
        let own = self.target.joints().iter().zip(&self.joints);
        let own = own.filter(|(_, other)| other.is_none()).map(|(joint, _)| joint.name.as_str());
        let sources = self.source.joints();
        let moves = |index| sources.iter().any(|joint| joint.parent == Some(index));
        let others = (0..sources.len()).filter(|&index| moves(index) && !self.joints.contains(&Some(index)));
        [own.collect(), others.map(|index| sources[index].name.as_str()).collect()]
    }

    /// `clip` of the source as one of the target, with keys at the `times` (seconds, ascending).
    pub fn apply(&self, clip: &Clip, times: &[f64]) -> Clip {
        let (source_rest, target_rest) = (self.source.rest_globals(), self.target.rest_globals());
        let rotations = |globals: &[DAffine3]| -> Vec<DQuat> {
            globals.iter().map(|global| nearest_rotation(&global.matrix3)).collect()
        };
        let (source_turns, target_turns) = (rotations(&source_rest), rotations(&target_rest));
        let aligned = self.alignments(&source_rest, &target_rest);
        let mut rows: Vec<Vec<DQuat>> = vec![Vec::with_capacity(times.len()); self.joints.len()];
        let root = self.joints.iter().position(Option::is_some).unwrap_or(0);
        let mut path = Vec::with_capacity(times.len());
        let mut heading = None;
        let (mut locals, mut globals) = (self.source.rest(), Vec::new());
        let mut lowest = f64::INFINITY;
        for &time in times {
            clip.sample(time, &mut locals, &mut []);
            self.source.globals(&locals, &mut globals);
            let turns = rotations(&globals);
            let motion = |joint: usize| turns[joint] * source_turns[joint].conjugate();
            let source_root = self.joints[root].unwrap_or(0);
            let heading = *heading.get_or_insert_with(|| yaw(motion(source_root)).conjugate());
            lowest = globals.iter().map(|global| global.translation.y).fold(lowest, f64::min);
            path.push(globals[source_root].translation);
            let mut now: Vec<DQuat> = Vec::with_capacity(self.joints.len());
            for (joint, own) in self.target.joints().iter().enumerate() {
                let parent = own.parent.map_or_else(
                    || target_turns[joint] * own.rest.rotation.conjugate(),
                    |parent| now[parent],
                );
                now.push(match self.joints[joint] {
                    Some(other) => heading * motion(other) * aligned[joint] * target_turns[joint],
                    None => parent * own.rest.rotation,
                });
                rows[joint].push((parent.conjugate() * now[joint]).normalize());
            }
        }
        let track = |joint: usize, values: Values| Track {
            joint,
            times: times.into(),
            interpolation: Interpolation::Linear,
            values,
        };
        let place =
            self.place(&path, lowest, heading.unwrap_or(DQuat::IDENTITY), [&source_rest, &target_rest]);
        let to_parent = self.target.joints()[root].parent.map_or_else(
            || target_rest[root] * self.target.joints()[root].rest.affine().inverse(),
            |parent| target_rest[parent],
        );
        let back = to_parent.inverse();
        let moved = place.into_iter().map(|point| back.transform_point3(point)).collect();
        let mut tracks = vec![track(root, Values::Translation(moved))];
        for (joint, values) in rows.into_iter().enumerate().filter(|(joint, _)| self.joints[*joint].is_some())
        {
            tracks.push(track(joint, Values::Rotation(values)));
        }
        Clip { name: clip.name.clone(), tracks }
    }

    /// The places of the target's root on a path of the source's.
    fn place(&self, path: &[DVec3], lowest: f64, heading: DQuat, rest: [&[DAffine3]; 2]) -> Vec<DVec3> {
        let ground = |globals: &[DAffine3]| {
            globals.iter().map(|global| global.translation.y).fold(f64::INFINITY, f64::min)
        };
        let Some((target_root, source_root)) =
            self.joints.iter().enumerate().find_map(|(joint, other)| Some((joint, (*other)?)))
        else {
            return Vec::new();
        };
        let [source_ground, target_ground] = rest.map(ground);
        let source_height = rest[0][source_root].translation.y - source_ground;
        let at = rest[1][target_root].translation;
        let target_height = at.y - target_ground;
        let scale =
            if source_height > 0.0 && target_height > 0.0 { target_height / source_height } else { 1.0 };
        let first = path.first().copied().unwrap_or_default();
        let on_path = |p: &DVec3| {
            let along = heading * (*p - first) * scale;
            DVec3::new(at.x + along.x, target_ground + (p.y - lowest) * scale, at.z + along.z)
        };
        path.iter().map(on_path).collect()
    }

    /// For each joint of the target, the rotation of its bone at rest to its counterpart's.
    fn alignments(&self, source: &[DAffine3], target: &[DAffine3]) -> Vec<DQuat> {
        let height = |globals: &[DAffine3]| {
            globals.iter().map(|global| global.translation.length()).fold(0.0, f64::max)
        };
        let (source_shortest, target_shortest) = (SHORTEST * height(source), SHORTEST * height(target));
        let children_of = |joint: usize| self.target_children(joint).count();
        let arc = |joint: usize| {
            let other = self.joints[joint]?;
            let mut children = self.target_children(joint);
            let (child, more) = (children.next()?, children.next());
            // Joints that branch, such as the hips, have no one direction.
            if more.is_some() {
                return None;
            }
            let ours = target[child].translation - target[joint].translation;
            let theirs = source[self.joints[child]?].translation - source[other].translation;
            if ours.length() <= target_shortest || theirs.length() <= source_shortest {
                return None;
            }
            let (length, ours, theirs) = (ours.length(), ours.normalize(), theirs.normalize());
            let is_at_branch = self.counterpart_parent(joint).is_some_and(|parent| children_of(parent) > 1);
            let next = self.target_children(child).next();
            let next = next.map_or(0.0, |next| target[next].translation.distance(target[child].translation));
            if (ours.y > UPRIGHT && theirs.y > UPRIGHT) || (is_at_branch && length < next) {
                return None;
            }
            Some(DQuat::from_rotation_arc(ours, theirs))
        };
        (0..self.joints.len()).map(|joint| arc(joint).unwrap_or(DQuat::IDENTITY)).collect()
    }

    /// The nearest descendants of a joint of the target that have a counterpart.
    fn target_children(&self, joint: usize) -> impl Iterator<Item = usize> {
        let own = (0..self.joints.len()).filter(|&own| self.joints[own].is_some());
        own.filter(move |&own| self.counterpart_parent(own) == Some(joint))
    }

    /// The nearest ancestor of a joint of the target that has a counterpart.
    fn counterpart_parent(&self, joint: usize) -> Option<usize> {
        let mut at = self.target.joints()[joint].parent;
        while let Some(parent) = at {
            if self.joints[parent].is_some() {
                return Some(parent);
            }
            at = self.target.joints()[parent].parent;
        }
        None
    }
}

/// The part of `turn` that turns about the vertical.
fn yaw(turn: DQuat) -> DQuat {
    let about = DQuat::from_xyzw(0.0, turn.y, 0.0, turn.w);
    if about.length_squared() > 1e-12 { about.normalize() } else { DQuat::IDENTITY }
}

/// The name of the joint on the other side of the body: "Left" and "Right" are exchanged, and "L"
/// and "R" at the start or the end, apart or before a capital.
pub(super) fn other_side(name: &str) -> Option<String> {
    for (from, to) in [("Left", "Right"), ("Right", "Left"), ("left", "right"), ("right", "left")] {
        if name.contains(from) {
            return Some(name.replacen(from, to, 1));
        }
    }
    let swap = |side: char| match side {
        'L' => Some('R'),
        'R' => Some('L'),
        'l' => Some('r'),
        'r' => Some('l'),
        _ => None,
    };
    let is_gap = |c: char| matches!(c, '_' | '.' | '-' | ' ' | ':');
    let letters: Vec<char> = name.chars().collect();
    let at = (0..letters.len()).find(|&i| {
        let (before, after) = (i.checked_sub(1).map(|i| letters[i]), letters.get(i + 1).copied());
        let apart = before.is_none_or(is_gap) && after.is_none_or(is_gap);
        let leads = i == 0 && letters[i].is_uppercase() && after.is_some_and(char::is_uppercase);
        swap(letters[i]).is_some() && (apart || leads) && letters.len() > 1
    })?;
    let mut letters = letters;
    letters[at] = swap(letters[at])?;
    Some(letters.into_iter().collect())
}

#[cfg(test)]
mod tests {
    use super::super::{Joint, Transform};
    use super::*;
    use std::f64::consts::FRAC_PI_2;

    /// A hip at `height` with an upper and a lower arm along `arm` and a foot on the ground.
    fn skeleton(prefix: &str, height: f64, arm: DVec3) -> Skeleton {
        let joint = |name: &str, parent: Option<usize>, translation: DVec3| Joint {
            name: format!("{prefix}{name}"),
            parent,
            rest: Transform { translation, ..Transform::IDENTITY },
        };
        Skeleton::new(vec![
            joint("Hips", None, DVec3::Y * height),
            joint("Arm", Some(0), DVec3::Y * height * 0.3),
            joint("ForeArm", Some(1), arm),
            joint("Hand", Some(2), arm),
            joint("Foot", Some(0), DVec3::NEG_Y * height),
        ])
        .unwrap()
    }

    fn track(joint: usize, values: Values) -> Track {
        Track { joint, times: vec![0.0, 1.0], interpolation: Interpolation::Linear, values }
    }

    fn at(skeleton: &Skeleton, clip: &Clip, secs: f64) -> Vec<DVec3> {
        let (mut locals, mut globals) = (skeleton.rest(), Vec::new());
        clip.sample(secs, &mut locals, &mut []);
        skeleton.globals(&locals, &mut globals);
        globals.iter().map(|global| global.translation).collect()
    }

    #[test]
    fn limbs_point_as_the_sources_do_and_the_path_is_scaled() {
        let source = skeleton("", 1.0, DVec3::X);
        let target = skeleton("", 2.0, DVec3::new(0.6, -0.8, 0.0));
        let clip = Clip {
            name: "wave".into(),
            tracks: vec![
                track(0, Values::Translation(vec![DVec3::new(5.0, 1.1, 3.0), DVec3::new(6.0, 1.5, 3.0)])),
                track(2, Values::Rotation(vec![DQuat::IDENTITY, DQuat::from_rotation_z(FRAC_PI_2)])),
            ],
        };
        let retarget = Retarget::new(&source, &target, &BTreeMap::new()).unwrap();
        assert_eq!(retarget.unmatched(), [Vec::<&str>::new(), Vec::new()]);
        let clip = retarget.apply(&clip, &[0.0, 1.0]);
        let places = at(&target, &clip, 0.0);
        assert!(places[0].distance(DVec3::new(0.0, 2.0, 0.0)) < 1e-12, "{}", places[0]);
        assert!((places[2] - places[1]).distance(DVec3::X) < 1e-12, "the source's arm is level");
        let places = at(&target, &clip, 1.0);
        assert!(places[0].distance(DVec3::new(2.0, 2.8, 0.0)) < 1e-12, "{}", places[0]);
        assert!((places[2] - places[1]).distance(DVec3::X) < 1e-12);
        assert!((places[3] - places[2]).distance(DVec3::Y) < 1e-12);
    }

    #[test]
    fn the_target_starts_in_its_own_direction() {
        let source = skeleton("", 1.0, DVec3::X);
        let about = |angle: f64| DQuat::from_rotation_y(angle);
        let clip = Clip {
            name: String::new(),
            tracks: vec![
                track(0, Values::Rotation(vec![about(2.0), about(2.5)])),
                track(0, Values::Translation(vec![DVec3::Y, DVec3::Y + about(2.0) * DVec3::Z])),
            ],
        };
        let own = Retarget::new(&source, &source, &BTreeMap::new()).unwrap().apply(&clip, &[0.0, 1.0]);
        assert!((at(&source, &own, 0.0)[2]).distance(at(&source, &Clip::default(), 0.0)[2]) < 1e-12);
        assert!(at(&source, &own, 1.0)[0].distance(DVec3::new(0.0, 1.0, 1.0)) < 1e-12);
    }

    #[test]
    fn names_are_mapped() {
        let (source, target) = (skeleton("a:", 1.0, DVec3::X), skeleton("", 1.0, DVec3::X));
        let error = Retarget::new(&source, &target, &BTreeMap::new()).unwrap_err();
        assert!(error.to_string().contains("a:Hips") && error.to_string().contains("say which"));
        let map = |pairs: &[(&str, &str)]| {
            pairs.iter().map(|(own, other)| (own.to_string(), other.to_string())).collect()
        };
        let own = Retarget::new(&source, &target, &map(&[("Hips", "a:Hips"), ("Arm", "a:ForeArm")])).unwrap();
        assert_eq!(own.joints, [Some(0), Some(2), None, None, None]);
        let error = Retarget::new(&source, &target, &map(&[("Arm", "Leg")])).unwrap_err();
        assert!(error.to_string().contains("no joint \"Leg\" in the motion"));
    }

    #[test]
    fn sides_are_known_by_their_names() {
        for (name, other) in [
            ("LeftArm", "RightArm"),
            ("mixamorig:RightHand", "mixamorig:LeftHand"),
            ("upper_arm.L", "upper_arm.R"),
            ("b_r_hand", "b_l_hand"),
            ("LThumb", "RThumb"),
        ] {
            assert_eq!(other_side(name).as_deref(), Some(other));
            assert_eq!(other_side(other).as_deref(), Some(name));
        }
        for name in ["Head", "Leg", "Root", "L", "", "Collar"] {
            assert_eq!(other_side(name), None, "{name}");
        }
    }
}
