//! The built-in talker: the built-in head with a jaw that talks and chews.
//!
//! # Practice
//! At rest it is the built-in head itself, vertex for vertex, so grooms of the head fit. Its
//! skeleton is a head that carries all, and a jaw with its hinge before the ears. A vertex follows
//! the jaw below the plane through the hinge and the line between the lips: sharply at the lips,
//! smoothly in the cheeks and towards the neck. A blend shape draws the skin between the lips back
//! while they part, so that the mouth opens to a hollow. Its clips end as they start, at the same
//! speed.
//!
//! # Limitations
//! No teeth, no tongue, and lips that keep their shape: the mouth opens as a puppet's does.

use std::f64::consts::TAU;
use std::sync::{Arc, OnceLock};

use glam::{DQuat, DVec3, Vec3, vec3};

use super::Head;
use super::character::{
    BlendShape, Bone, Character, CharacterParts, Clip, Group, Interpolation, Joint, Skeleton, Skin, Track,
    Transform, Values,
};

/// The hinge of the jaw, metres.
const HINGE: Vec3 = vec3(0.0, -0.018, 0.004);
/// Where the lips meet in the middle, metres.
const LIPS: Vec3 = vec3(0.0, -0.0712, 0.0885);
/// From the middle of the mouth to its corners, metres.
const HALF_MOUTH: f32 = 0.023;
/// How far the skin between the lips is drawn back when the mouth is open, metres.
const HOLLOW: f32 = 0.014;
/// The angle of the jaw at which the mouth counts as open, radians.
const OPEN: f64 = 0.2;
/// Keys a second of a clip.
const KEYS_PER_SEC: f64 = 60.0;

/// The head, which carries all.
const HEAD: usize = 0;
const JAW: usize = 1;

/// The built-in talker.
#[derive(Debug)]
pub struct Talker;

impl Talker {
    /// The names of its clips.
    pub const CLIPS: [&'static str; 2] = ["talk", "chew"];

    /// The built-in talker. The first call creates it; later calls return the same.
    pub fn builtin() -> &'static Arc<Character> {
        static TALKER: OnceLock<Arc<Character>> = OnceLock::new();
        TALKER.get_or_init(|| Arc::new(make()))
    }
}

fn make() -> Character {
    let bound = Head::builtin().mesh.clone();
    let joint = |name: &str, parent: Option<usize>, translation: Vec3| Joint {
        name: name.into(),
        parent,
        rest: Transform { translation: translation.as_dvec3(), ..Transform::IDENTITY },
    };
    let neck = Head::NECK_PIVOT;
    let joints = vec![joint("Head", None, neck), joint("Jaw", Some(HEAD), HINGE - neck)];
    let skeleton = Skeleton::new(joints).unwrap_or_default();
    let globals = skeleton.rest_globals();
    let bones = globals.iter().enumerate();
    let bones = bones.map(|(joint, global)| Bone { joint, inverse_bind: global.inverse() }).collect();
    let weights = bound.positions.iter().map(|&p| {
        let jaw = jaw_weight(p);
        vec![(HEAD, 1.0 - jaw), (JAW, jaw)]
    });
    let (skin, _) = Skin::new(bones, weights.collect());
    let deltas = bound.positions.iter().zip(0..).map(|(&p, vertex)| (vertex, Vec3::NEG_Z * hollow(p)));
    let deltas = deltas.filter(|(_, delta)| *delta != Vec3::ZERO).collect();
    let shapes = vec![BlendShape { name: "mouth".into(), deltas, rest_weight: 0.0 }];
    let groups = vec![Group { name: "talker".into(), triangles: 0..bound.triangles.len() }];
    let clips = vec![talk(), chew()];
    #[expect(clippy::expect_used, reason = "constant input, which a test makes")]
    Character::new(CharacterParts { skeleton, bound, skin, shapes, groups, clips })
        .expect("the parts fit together")
}

/// Distance below the plane through the hinge and the line between the lips, metres.
fn below_lips(p: Vec3) -> f32 {
    let forwards = (LIPS - HINGE).normalize();
    let down = vec3(0.0, -forwards.z, forwards.y);
    down.dot(p - HINGE)
}

/// How much a vertex follows the jaw, 0 to 1; nothing above the lips.
fn jaw_weight(p: Vec3) -> f32 {
    // Between the corners of the mouth the lips part at once; in the cheeks the skin stretches over
    // a width that grows.
    let aside = p.x.abs() - 0.5 * HALF_MOUTH;
    let over = aside.max(0.0).powi(2);
    let (up, down) = ((20.0 * over).min(0.012), 0.0045 + (60.0 * over).min(0.03));
    let lower = rise(below_lips(p) + up, up + down);
    // The neck stays: an upright cone.
    let at = p - vec3(0.0, -0.04, -0.02);
    let neck = 0.053 + 0.03 * (-at.y).max(0.0);
    let before_neck = vec3(at.x, 0.0, at.z + 0.157 * at.y.abs().min(0.14)).length() - neck;
    let before_hinge = p.z - HINGE.z;
    let above_chest = p.y + 0.135;
    lower * rise(above_chest, 0.02) * rise(before_neck + 0.002, 0.034) * rise(before_hinge, 0.025)
}

/// How far a vertex is drawn back when the mouth is open, metres: those of the groove between the
/// lips.
fn hollow(p: Vec3) -> f32 {
    let across = (p.x / HALF_MOUTH).powi(2);
    let off_line = (below_lips(p) - 0.001).abs();
    if across >= 1.0 || p.z < 0.06 { 0.0 } else { HOLLOW * (1.0 - across) * (1.0 - rise(off_line, 0.004)) }
}

/// A smooth step: 0 below 0, 1 above `width`.
fn rise(x: f32, width: f32) -> f32 {
    let t = (x / width.max(f32::MIN_POSITIVE)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// A clip of `secs` in which the jaw opens, turns to the side (radians) and shifts to the side
/// (metres), as functions of the phase from 0 to 1.
fn clip(name: &str, secs: f64, of: impl Fn(f64) -> [f64; 3]) -> Clip {
    let keys = (KEYS_PER_SEC * secs).round() as u32;
    let phases = || (0..=keys).map(|key| f64::from(key % keys) / f64::from(keys));
    let track = |joint: usize, values: Values| Track {
        joint,
        times: (0..=keys).map(|key| f64::from(key) / f64::from(keys) * secs).collect(),
        interpolation: Interpolation::Linear,
        values,
    };
    let turn = |phase| {
        let [open, aside, _] = of(phase);
        DQuat::from_rotation_y(aside) * DQuat::from_rotation_x(open)
    };
    let base = (HINGE - Head::NECK_PIVOT).as_dvec3();
    let shift = |phase| base + DVec3::X * of(phase)[2];
    let parted =
        Values::Shapes { first: 0, count: 1, weights: phases().map(|phase| of(phase)[0] / OPEN).collect() };
    let tracks = vec![
        track(JAW, Values::Rotation(phases().map(turn).collect())),
        track(JAW, Values::Translation(phases().map(shift).collect())),
        track(HEAD, parted),
    ];
    Clip { name: name.into(), tracks }
}

/// Seven syllables in 2.8 s, loud and soft, that come out of a corner of the mouth a little.
fn talk() -> Clip {
    clip("talk", 2.8, |at| {
        let syllable = 0.5 - 0.5 * (7.0 * TAU * at).cos();
        let loud = 0.55 + 0.3 * (TAU * (at - 0.1)).sin() + 0.15 * (3.0 * TAU * at).sin();
        let aside = (TAU * at).sin();
        [0.2 * syllable * loud, 0.02 * syllable * aside, 0.001 * syllable * aside]
    })
}

/// Two bites in 1.6 s, one to each side: down, aside, and up.
fn chew() -> Clip {
    clip("chew", 1.6, |at| {
        let bite = 0.5 - 0.5 * (2.0 * TAU * at).cos();
        let aside = (TAU * at).sin() + 0.3 * (3.0 * TAU * at).sin();
        [0.15 * bite, 0.05 * aside, 0.003 * aside]
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::Region;
    use crate::body::character::{Performance, Playback, PosingBuffers, Skinning};

    /// The vertices of a clip at `secs`.
    fn posed(clip: &Clip, secs: f64) -> Vec<Vec3> {
        let playback = Playback { blend_secs: 0.0, ..Playback::default() };
        let talker = Talker::builtin().clone();
        let own = Performance::new(talker, clip.clone(), playback, Skinning::Linear, HEAD).unwrap();
        own.posed(secs, &mut PosingBuffers::default()).positions.to_vec()
    }

    #[test]
    fn at_rest_it_is_the_head() {
        let (talker, head) = (Talker::builtin(), Head::builtin());
        assert_eq!(talker.rest(), &head.mesh);
        for clip in talker.clips() {
            assert!(Talker::CLIPS.contains(&clip.name.as_str()));
            let closed = posed(clip, 0.0);
            let apart =
                closed.iter().zip(&head.mesh.positions).map(|(a, b)| a.distance(*b)).fold(0.0, f32::max);
            assert!(apart < 1e-7, "{}: {apart}", clip.name);
        }
    }

    #[test]
    fn the_jaw_moves_and_the_upper_lip_does_not() {
        let (talker, head) = (Talker::builtin(), Head::builtin());
        for clip in talker.clips() {
            let (mut chin, mut aside) = (0.0f32, 0.0f32);
            for step in 0..28 {
                let now = posed(clip, clip.duration_secs() * f64::from(step) / 28.0);
                for ((&p, &rest), &beard) in now.iter().zip(&head.mesh.positions).zip(&head.beard) {
                    let moved = p - rest;
                    if below_lips(rest) < -0.013 || rest.z < HINGE.z || rest.y < -0.136 {
                        assert_eq!(moved, Vec3::ZERO, "{rest}");
                    }
                    let is_lip = beard > 0.0 && rest.y > LIPS.y && rest.x.abs() < 0.6 * HALF_MOUTH;
                    assert!(!is_lip || rest.z < 0.06 || moved == Vec3::ZERO, "{rest}: {moved}");
                    if Region::Beard.weight(rest) == 1.0 && rest.distance(vec3(0.0, -0.1, 0.085)) < 0.01 {
                        (chin, aside) = (chin.max(-moved.y), aside.max(moved.x.abs()));
                    }
                }
            }
            assert!((0.008..0.025).contains(&chin), "{}: {chin}", clip.name);
            assert!((0.001..0.01).contains(&aside), "{}: {aside}", clip.name);
        }
    }

    /// Neither the place nor the speed of a vertex steps at the seam by more than within the clip.
    #[test]
    fn clips_repeat_without_a_seam() {
        for clip in Talker::builtin().clips() {
            let (duration, step) = (clip.duration_secs(), 1.0 / KEYS_PER_SEC);
            let change = |at: f64| {
                let three = [-1.0, 0.0, 1.0].map(|side| posed(clip, at + side * step));
                let each = three[0].iter().zip(&three[1]).zip(&three[2]);
                each.map(|((a, b), c)| (*a + *c - 2.0 * *b).length()).fold(0.0, f32::max)
            };
            let within = (2..20).map(|key| change(f64::from(key) * duration / 21.0)).fold(0.0, f32::max);
            let seam = change(duration);
            assert!(seam > 0.0 && seam < 1.1 * within, "{}: {seam} {within}", clip.name);
        }
    }

    /// Neighbours do not tear: away from the mouth no edge becomes twice as long or turns over.
    #[test]
    fn skin_stretches_smoothly() {
        let (talker, head) = (Talker::builtin(), Head::builtin());
        for clip in talker.clips() {
            let (at, _) = (0..140)
                .map(|step| clip.duration_secs() * f64::from(step) / 140.0)
                .map(|at| (at, posed(clip, at)))
                .map(|(at, now)| (at, now.iter().map(|p| -p.y).fold(0.0, f32::max)))
                .fold((0.0, 0.0), |best, own| if own.1 > best.1 { own } else { best });
            let now = posed(clip, at);
            for t in &head.mesh.triangles {
                for (a, b) in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
                    let length = |of: &[Vec3]| of[a as usize].distance(of[b as usize]);
                    let rest = head.mesh.positions[a as usize];
                    let is_mouth = rest.x.abs() < 1.3 * HALF_MOUTH && below_lips(rest).abs() < 0.012;
                    let factor = length(&now) / length(&head.mesh.positions);
                    assert!(is_mouth || (0.3..2.0).contains(&factor), "{}, {rest}: {factor}", clip.name);
                }
            }
        }
    }
}
