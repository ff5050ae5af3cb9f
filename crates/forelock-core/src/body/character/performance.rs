//! A character that plays a clip.

use std::sync::Arc;

use glam::{DAffine3, DMat3, DVec3, Vec3};

use super::skeleton::nearest_rotation;
use super::{Character, CharacterError, Clip, SkinPose, Skinning, Transform};
use crate::pose::Pose;

/// Joints that move by less than this share of the body's size, relative to the one that carries
/// the hair, follow it exactly.
const ROUNDING: f64 = 1e-9;

/// How a clip is played.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Playback {
    /// The clip's time at the start, seconds.
    pub start_secs: f64,
    /// Seconds of the clip a second.
    pub speed: f64,
    /// Whether it is repeated; otherwise it stays at its end.
    pub repeats: bool,
    /// Time over which the end of a repeated clip fades into its start, seconds of the clip. The
    /// period is as much shorter than the clip.
    pub seam_secs: f64,
    /// Time over which the pose goes from rest to the clip's, seconds.
    pub blend_secs: f64,
    /// Whether the joints of left and right are exchanged, in the body's plane x = 0.
    pub mirrored: bool,
}

impl Default for Playback {
    fn default() -> Self {
        Self { start_secs: 0.0, speed: 1.0, repeats: true, seam_secs: 0.0, blend_secs: 0.5, mirrored: false }
    }
}

/// A character that plays a clip: a function from time to its pose.
#[derive(Clone, Debug, PartialEq)]
pub struct Performance {
    character: Arc<Character>,
    clip: Clip,
    playback: Playback,
    skinning: Skinning,
    /// The joint that carries the hair's space.
    joint: usize,
    rest: Vec<Transform>,
    rest_globals: Vec<DAffine3>,
    /// For each joint, the one on the other side of the body.
    counterparts: Vec<usize>,
    /// The extent of the skeleton, metres.
    size: f64,
}

/// A character at one instant, seen from the joint that carries the hair.
#[derive(Clone, Copy, Debug)]
pub struct Posed<'a> {
    /// From rest to the body's space: the motion of that joint.
    pub carrier: Pose,
    /// The mesh's vertices before that motion, metres: those of the mesh at rest where the body
    /// does not bend.
    pub positions: &'a [Vec3],
}

/// Buffers for posing a character.
#[derive(Clone, Debug, Default)]
pub struct PosingBuffers {
    locals: Vec<Transform>,
    other: Vec<Transform>,
    weights: Vec<f64>,
    other_weights: Vec<f64>,
    globals: Vec<DAffine3>,
    mirrored: Vec<DAffine3>,
    pose: SkinPose,
    positions: Vec<Vec3>,
}

impl Performance {
    /// `character` playing `clip`, with hair that `joint` carries.
    ///
    /// # Errors
    /// [`CharacterError`] if the clip is of another skeleton, or the joint does not exist.
    pub fn new(
        character: Arc<Character>,
        clip: Clip,
        playback: Playback,
        skinning: Skinning,
        joint: usize,
    ) -> Result<Self, CharacterError> {
        let skeleton = character.skeleton();
        if !clip.check(skeleton, character.shapes().len()) {
            return Err(CharacterError::Missing(format!("clip {:?}", clip.name)));
        }
        if joint >= skeleton.joints().len() {
            return Err(CharacterError::Missing("the joint that carries hair".into()));
        }
        let (rest, rest_globals) = (skeleton.rest(), skeleton.rest_globals());
        let names = skeleton.joints().iter().map(|joint| joint.name.as_str());
        let counterpart = |(own, name): (usize, &str)| {
            let other = super::retarget::other_side(name);
            other.and_then(|other| skeleton.find(&other)).unwrap_or(own)
        };
        let counterparts = names.enumerate().map(counterpart).collect();
        let places = rest_globals.iter().map(|global| global.translation);
        let (low, high) =
            places.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)));
        let size = low.distance(high).max(f64::MIN_POSITIVE);
        Ok(Self { character, clip, playback, skinning, joint, rest, rest_globals, counterparts, size })
    }

    /// The character.
    pub fn character(&self) -> &Arc<Character> {
        &self.character
    }

    /// The clip.
    pub fn clip(&self) -> &Clip {
        &self.clip
    }

    /// How the clip is played.
    pub fn playback(&self) -> &Playback {
        &self.playback
    }

    /// The joint that carries the hair.
    pub fn joint(&self) -> usize {
        self.joint
    }

    /// The motion of that joint at `secs`, from rest to the body's space.
    pub fn carrier(&self, secs: f64, buffers: &mut PosingBuffers) -> Pose {
        self.pose_joints(secs, buffers);
        self.carrier_of(&buffers.globals[self.joint])
    }

    /// The character at `secs`.
    pub fn posed<'a>(&self, secs: f64, buffers: &'a mut PosingBuffers) -> Posed<'a> {
        let mut pose = std::mem::take(&mut buffers.pose);
        let carrier = self.pose(secs, buffers, &mut pose);
        self.character.deform(&pose, &mut buffers.positions);
        buffers.pose = pose;
        Posed { carrier, positions: &buffers.positions }
    }

    /// Computes the pose of the skin at `secs`, before the motion of the joint that carries the
    /// hair, and returns that motion.
    pub fn pose(&self, secs: f64, buffers: &mut PosingBuffers, pose: &mut SkinPose) -> Pose {
        self.pose_joints(secs, buffers);
        let carrier = self.carrier_of(&buffers.globals[self.joint]);
        let back = carrier.inverse();
        let back = DAffine3::from_rotation_translation(back.rotation, back.translation);
        for (global, rest) in buffers.globals.iter_mut().zip(&self.rest_globals) {
            *global = back * *global;
            let turned = global.matrix3.abs_diff_eq(rest.matrix3, ROUNDING * largest(&rest.matrix3));
            if turned && global.translation.abs_diff_eq(rest.translation, ROUNDING * self.size) {
                *global = *rest;
            }
        }
        self.character.pose(&buffers.globals, &buffers.weights, self.skinning, pose);
        carrier
    }

    /// The motion from rest of the joint that carries the hair, which is at `global`.
    fn carrier_of(&self, global: &DAffine3) -> Pose {
        self.motion_of(self.joint, global)
    }

    /// The motion from rest of `joint`, which is at `global`.
    fn motion_of(&self, joint: usize, global: &DAffine3) -> Pose {
        let rest = &self.rest_globals[joint];
        let rotation = nearest_rotation(&global.matrix3) * nearest_rotation(&rest.matrix3).conjugate();
        let turned = Pose::new(rotation, DVec3::ZERO);
        Pose { translation: global.translation - turned.transform_point(rest.translation), ..turned }
    }

    /// Computes the joints' transforms and the shapes' weights at `secs`.
    fn pose_joints(&self, secs: f64, buffers: &mut PosingBuffers) {
        let PosingBuffers { locals, other, weights, other_weights, globals, mirrored, .. } = buffers;
        let rest_weights = || self.character.shapes().iter().map(|shape| shape.rest_weight);
        let sample = |at: f64, locals: &mut Vec<Transform>, weights: &mut Vec<f64>| {
            locals.clone_from(&self.rest);
            weights.clear();
            weights.extend(rest_weights());
            self.clip.sample(at, locals, weights);
        };
        let (at, again) = self.clip_secs(secs.max(0.0));
        sample(at, locals, weights);
        if let Some((at, share)) = again {
            sample(at, other, other_weights);
            blend((locals, weights), (other, other_weights), share);
        }
        let share = if self.playback.blend_secs > 0.0 { secs / self.playback.blend_secs } else { 1.0 };
        if share < 1.0 {
            other.clone_from(&self.rest);
            other_weights.clear();
            other_weights.extend(rest_weights());
            blend((locals, weights), (other, other_weights), 1.0 - smooth(share.max(0.0)));
        }
        self.character.skeleton().globals(locals, globals);
        if self.playback.mirrored {
            self.mirror(globals, mirrored);
        }
    }

    /// The clip's time at `secs`, and within the seam of a repeated clip the time towards its end
    /// that fades out, with its share.
    fn clip_secs(&self, secs: f64) -> (f64, Option<(f64, f64)>) {
        let Playback { start_secs, speed, repeats, seam_secs, .. } = self.playback;
        let duration = self.clip.duration_secs();
        let played = start_secs + secs * speed;
        if !repeats || duration <= 0.0 {
            return (played.clamp(0.0, duration), None);
        }
        // At most half of the clip, so that there is never more than one end that fades out.
        let seam = seam_secs.clamp(0.0, 0.5 * duration);
        let period = duration - seam;
        let at = played.rem_euclid(period);
        let is_first = (0.0..period).contains(&played);
        if at >= seam || is_first {
            return (at, None);
        }
        (at, Some((at + period, 1.0 - smooth(at / seam))))
    }

    /// Exchanges the motions of the two sides.
    fn mirror(&self, globals: &mut Vec<DAffine3>, mirrored: &mut Vec<DAffine3>) {
        let reflection = DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0));
        mirrored.clear();
        for (rest, &other) in self.rest_globals.iter().zip(&self.counterparts) {
            let back = self.rest_globals[other].inverse();
            // A joint of scale 0 has no inverse, and hides what follows it.
            if !back.is_finite() {
                mirrored.push(*rest);
                continue;
            }
            let motion = globals[other] * back;
            mirrored.push(reflection * motion * reflection * *rest);
        }
        std::mem::swap(globals, mirrored);
    }
}

/// 0 at 0, 1 at 1, with no slope at either.
fn smooth(share: f64) -> f64 {
    share * share * (3.0 - 2.0 * share)
}

/// The largest absolute entry of `matrix`.
fn largest(matrix: &DMat3) -> f64 {
    matrix.to_cols_array().into_iter().fold(0.0, |largest, x| x.abs().max(largest))
}

/// The state of joints and shapes, relative to parents.
type Local<'a> = (&'a mut [Transform], &'a mut [f64]);

/// Moves `own` by `share` of the way to `other`.
fn blend(own: Local<'_>, other: Local<'_>, share: f64) {
    for (a, b) in own.0.iter_mut().zip(other.0) {
        *a = a.interpolate(b, share);
    }
    for (a, b) in own.1.iter_mut().zip(other.1) {
        *a += (*b - *a) * share;
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Bone, CharacterParts, Interpolation, Joint, Skeleton, Skin, Track, Values};
    use super::*;
    use crate::body::TriMesh;
    use glam::DQuat;

    /// Two joints one above the other, a vertex beside each, and a third between the two.
    fn character() -> Arc<Character> {
        let joint = |name: &str, parent: Option<usize>| Joint {
            name: name.into(),
            parent,
            rest: Transform { translation: DVec3::Y, ..Transform::IDENTITY },
        };
        let joints = vec![joint("root", None), joint("L_arm", Some(0)), joint("R_arm", Some(0))];
        let skeleton = Skeleton::new(joints).unwrap();
        let globals = skeleton.rest_globals();
        let bones = globals.iter().enumerate();
        let bones = bones.map(|(joint, global)| Bone { joint, inverse_bind: global.inverse() }).collect();
        let weights = vec![vec![(0, 1.0)], vec![(1, 1.0)], vec![(0, 0.5), (1, 0.5)]];
        let positions = vec![Vec3::new(1.0, 1.0, 0.0), Vec3::new(1.0, 2.0, 0.0), Vec3::new(1.0, 1.5, 0.0)];
        let bound = TriMesh::new(positions, vec![[0, 1, 2]]).unwrap();
        let skin = Skin::new(bones, weights).0;
        Arc::new(Character::new(CharacterParts { skeleton, bound, skin, ..Default::default() }).unwrap())
    }

    fn turning(joint: usize) -> Clip {
        let values = [0.0, 1.0, 2.0].map(DQuat::from_rotation_y).to_vec();
        let track = Track {
            joint,
            times: vec![0.0, 1.0, 2.0],
            interpolation: Interpolation::Linear,
            values: Values::Rotation(values),
        };
        Clip { name: "turn".into(), tracks: vec![track] }
    }

    fn performance(clip: Clip, playback: Playback) -> Performance {
        Performance::new(character(), clip, playback, Skinning::Linear, 0).unwrap()
    }

    #[test]
    fn a_body_that_turns_as_a_whole_does_not_bend() {
        let own = performance(turning(0), Playback::default());
        let mut buffers = PosingBuffers::default();
        for secs in [0.0, 0.3, 0.9, 7.7] {
            let posed = own.posed(secs, &mut buffers);
            assert_eq!(posed.positions, own.character().rest().positions, "{secs}");
            assert_eq!(secs == 0.0, posed.carrier == Pose::IDENTITY);
            let carrier = posed.carrier;
            assert_eq!(own.carrier(secs, &mut buffers), carrier);
        }
    }

    #[test]
    fn a_joint_that_turns_bends_the_body_seen_from_its_parent() {
        let own =
            performance(turning(1), Playback { blend_secs: 0.0, repeats: false, ..Playback::default() });
        let mut buffers = PosingBuffers::default();
        let posed = own.posed(1.0, &mut buffers);
        let turned = Vec3::new(1.0f32.cos(), 2.0, -1.0f32.sin());
        assert_eq!(posed.positions[0], Vec3::new(1.0, 1.0, 0.0));
        assert!(posed.positions[1].distance(turned) < 1e-6);
        let between = (Vec3::new(1.0, 1.5, 0.0) + turned - Vec3::Y * 0.5) * 0.5;
        assert!(posed.positions[2].distance(between) < 1e-6);
        assert_eq!(own.posed(99.0, &mut buffers).positions.to_vec(), own.posed(2.0, &mut buffers).positions);
    }

    #[test]
    fn clips_start_at_rest_and_repeat_without_a_jump() {
        let angle = |own: &Performance, secs: f64| {
            let carrier = own.carrier(secs, &mut PosingBuffers::default());
            2.0 * carrier.rotation.y.atan2(carrier.rotation.w)
        };
        let start = Playback { start_secs: 1.0, ..Playback::default() };
        let own = performance(turning(0), start);
        assert_eq!(angle(&own, 0.0), 0.0);
        assert!((angle(&own, 0.5) - 1.5).abs() < 1e-12 && (angle(&own, 1.25) - 0.25).abs() < 1e-12);
        let seam = Playback { seam_secs: 0.5, blend_secs: 0.0, ..Playback::default() };
        let own = performance(turning(0), seam);
        let steps: Vec<f64> = (0..4000).map(|i| angle(&own, f64::from(i) * 1e-3)).collect();
        let largest = steps.windows(2).map(|pair| (pair[1] - pair[0]).abs()).fold(0.0, f64::max);
        // Of a fade over 0.5 s from an angle that is greater by 1.5: 1.5 × 1.5/0.5 per second.
        assert!(largest < 5e-3, "{largest}");
        let fast = performance(turning(0), Playback { speed: 2.0, blend_secs: 0.0, ..Playback::default() });
        assert!((angle(&fast, 0.6) - 1.2).abs() < 1e-12);
    }

    #[test]
    fn a_mirrored_clip_moves_the_other_side() {
        let playback = Playback { mirrored: true, blend_secs: 0.0, ..Playback::default() };
        let own = performance(turning(1), playback);
        let mut buffers = PosingBuffers::default();
        own.pose_joints(0.5, &mut buffers);
        let turn = |joint: usize| nearest_rotation(&buffers.globals[joint].matrix3);
        assert!(turn(2).angle_between(DQuat::from_rotation_y(-0.5)) < 1e-7);
        assert!(turn(1).angle_between(DQuat::IDENTITY) < 1e-7);
    }
}
