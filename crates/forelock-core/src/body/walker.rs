//! The built-in walker: a figure with a skeleton that walks, jumps and looks around.
//!
//! # Practice
//! The walker is a smooth union of tapered capsules, each of which belongs to a joint, meshed at
//! first use as the built-in head is. It stands on y = 0, is 1.7 m high and faces +z. Vertices
//! follow the joints whose capsules they are near, so joints bend smoothly. The names of its joints
//! are those of common motion capture files, which it can play too. Its clips walk and jump on the
//! spot, and end as they start.
//!
//! # Limitations
//! A mannequin without face, fingers or toes.

use std::f64::consts::{PI, TAU};
use std::sync::{Arc, OnceLock};

use glam::{DQuat, DVec3, Vec3, vec3};

use super::character::{
    Bone, Character, CharacterParts, Clip, Group, Interpolation, Joint, Skeleton, Skin, Track, Transform,
    Values,
};
use super::implicit::{cone, join};
use super::surface_nets::{self, Bounds};

/// Side of the mesh's cells, metres.
const CELL: f32 = 0.012;
/// The box that contains the walker, metres.
const BOX: Bounds = Bounds { min: vec3(-0.75, -0.05, -0.3), max: vec3(0.75, 1.8, 0.35) };
/// Width of the smooth blend between capsules, metres.
const BLEND: f32 = 0.04;
/// A vertex follows capsules that are farther than the nearest one by up to this, metres.
const REACH: f32 = 0.06;
/// Keys of a clip.
const KEYS: u32 = 48;

/// A joint with the capsules that are fixed to it.
struct Limb {
    name: &'static str,
    parent: Option<usize>,
    /// The joint, metres.
    at: [f64; 3],
    capsules: &'static [Capsule],
}

/// A tapered capsule: its ends and the radii there, metres.
type Capsule = ([f32; 3], [f32; 3], f32, f32);

const HIPS: usize = 0;
const SPINE: usize = 1;
const NECK: usize = 3;
const HEAD: usize = 4;
/// Arm, forearm and hand: those on the left, and three further those on the right.
const ARM: usize = 5;
/// Thigh, shank and foot, alike.
const LEG: usize = 11;

const LIMBS: [Limb; 17] = [
    limb("Hips", None, [0.0, 0.95, 0.0], &[([-0.08, 0.95, 0.0], [0.08, 0.95, 0.0], 0.115, 0.115)]),
    limb("Spine", Some(HIPS), [0.0, 1.08, 0.0], &[([0.0, 1.05, 0.0], [0.0, 1.2, 0.01], 0.11, 0.115)]),
    limb(
        "Spine1",
        Some(SPINE),
        [0.0, 1.24, 0.0],
        &[
            ([-0.09, 1.34, 0.0], [0.09, 1.34, 0.0], 0.105, 0.105),
            ([0.0, 1.24, 0.01], [0.0, 1.36, 0.0], 0.115, 0.1),
        ],
    ),
    limb("Neck", Some(2), [0.0, 1.43, -0.01], &[([0.0, 1.41, -0.01], [0.0, 1.5, 0.0], 0.05, 0.048)]),
    limb(
        "Head",
        Some(NECK),
        [0.0, 1.51, 0.0],
        &[
            ([0.0, 1.6, -0.015], [0.0, 1.61, 0.015], 0.095, 0.09),
            ([0.0, 1.54, 0.03], [0.0, 1.6, 0.03], 0.055, 0.075),
        ],
    ),
    limb("LeftArm", Some(2), [0.17, 1.4, 0.0], &[([0.17, 1.4, 0.0], [0.36, 1.19, 0.0], 0.055, 0.045)]),
    limb("LeftForeArm", Some(5), [0.36, 1.19, 0.0], &[([0.36, 1.19, 0.0], [0.53, 1.0, 0.02], 0.045, 0.032)]),
    limb("LeftHand", Some(6), [0.53, 1.0, 0.02], &[([0.54, 0.99, 0.02], [0.61, 0.91, 0.03], 0.036, 0.025)]),
    limb("RightArm", Some(2), [-0.17, 1.4, 0.0], &[([-0.17, 1.4, 0.0], [-0.36, 1.19, 0.0], 0.055, 0.045)]),
    limb(
        "RightForeArm",
        Some(8),
        [-0.36, 1.19, 0.0],
        &[([-0.36, 1.19, 0.0], [-0.53, 1.0, 0.02], 0.045, 0.032)],
    ),
    limb(
        "RightHand",
        Some(9),
        [-0.53, 1.0, 0.02],
        &[([-0.54, 0.99, 0.02], [-0.61, 0.91, 0.03], 0.036, 0.025)],
    ),
    limb("LeftUpLeg", Some(HIPS), [0.1, 0.9, 0.0], &[([0.1, 0.87, 0.0], [0.11, 0.5, 0.0], 0.09, 0.06)]),
    limb("LeftLeg", Some(11), [0.11, 0.49, 0.0], &[([0.11, 0.49, 0.0], [0.115, 0.1, -0.02], 0.06, 0.04)]),
    limb(
        "LeftFoot",
        Some(12),
        [0.115, 0.09, -0.02],
        &[([0.115, 0.06, -0.04], [0.125, 0.04, 0.13], 0.045, 0.032)],
    ),
    limb("RightUpLeg", Some(HIPS), [-0.1, 0.9, 0.0], &[([-0.1, 0.87, 0.0], [-0.11, 0.5, 0.0], 0.09, 0.06)]),
    limb("RightLeg", Some(14), [-0.11, 0.49, 0.0], &[([-0.11, 0.49, 0.0], [-0.115, 0.1, -0.02], 0.06, 0.04)]),
    limb(
        "RightFoot",
        Some(15),
        [-0.115, 0.09, -0.02],
        &[([-0.115, 0.06, -0.04], [-0.125, 0.04, 0.13], 0.045, 0.032)],
    ),
];

const fn limb(name: &'static str, parent: Option<usize>, at: [f64; 3], capsules: &'static [Capsule]) -> Limb {
    Limb { name, parent, at, capsules }
}

/// The built-in walker.
#[derive(Debug)]
pub struct Walker;

impl Walker {
    /// The names of its clips.
    pub const CLIPS: [&'static str; 3] = ["walk", "jump", "look"];

    /// Corners of the box in which its scalp is, metres.
    pub const SCALP: [Vec3; 2] = [vec3(-0.12, 1.6, -0.2), vec3(0.12, 1.8, 0.065)];

    /// The built-in walker. The first call creates it; later calls return the same.
    pub fn builtin() -> &'static Arc<Character> {
        static WALKER: OnceLock<Arc<Character>> = OnceLock::new();
        WALKER.get_or_init(|| Arc::new(make()))
    }
}

/// Distance to the capsules of a joint, metres.
fn limb_distance(limb: &Limb, p: Vec3) -> f32 {
    let own = limb.capsules.iter();
    own.map(|&(a, b, ra, rb)| cone(p, a.into(), b.into(), ra, rb)).fold(f32::INFINITY, f32::min)
}

/// Approximate signed distance to the whole, metres.
fn distance(p: Vec3) -> f32 {
    let capsules = LIMBS.iter().flat_map(|limb| limb.capsules);
    capsules.fold(1.0, |d, &(a, b, ra, rb)| join(d, cone(p, a.into(), b.into(), ra, rb), BLEND))
}

fn make() -> Character {
    let mut bound = surface_nets::surface_nets(distance, |p| p, BOX, CELL);
    bound.positions.iter_mut().for_each(|p| *p = surface_nets::project(*p, distance, 0.4 * CELL));
    let joint = |limb: &Limb| {
        let base = limb.parent.map_or(DVec3::ZERO, |parent| LIMBS[parent].at.into());
        let translation = DVec3::from(limb.at) - base;
        Joint {
            name: limb.name.into(),
            parent: limb.parent,
            rest: Transform { translation, ..Transform::IDENTITY },
        }
    };
    let skeleton = Skeleton::new(LIMBS.iter().map(joint).collect()).unwrap_or_default();
    let globals = skeleton.rest_globals();
    let bones = globals.iter().enumerate();
    let bones = bones.map(|(joint, global)| Bone { joint, inverse_bind: global.inverse() }).collect();
    let (skin, _) = Skin::new(bones, bound.positions.iter().map(|&p| weights(p)).collect());
    let groups = vec![Group { name: "walker".into(), triangles: 0..bound.triangles.len() }];
    let clips = vec![walk(), jump(), look()];
    let parts = CharacterParts { skeleton, bound, skin, groups, clips, ..CharacterParts::default() };
    #[expect(clippy::expect_used, reason = "constant input, which a test makes")]
    Character::new(parts).expect("the parts fit together")
}

/// The joints that a vertex follows, and how much: those whose capsules are near, of which the
/// nearest is an ancestor, a child or a sibling.
fn weights(p: Vec3) -> Vec<(usize, f32)> {
    let distances: Vec<f32> = LIMBS.iter().map(|limb| limb_distance(limb, p)).collect();
    let nearest = (0..LIMBS.len()).min_by(|&a, &b| distances[a].total_cmp(&distances[b])).unwrap_or(HIPS);
    let is_near = |other: usize| {
        let (own, parent) = (LIMBS[nearest].parent, LIMBS[other].parent);
        other == nearest || own == Some(other) || parent == Some(nearest) || (own.is_some() && own == parent)
    };
    let weight = |joint: usize| {
        let share = 1.0 - (distances[joint] - distances[nearest]) / REACH;
        (joint, share.max(0.0).powi(2))
    };
    let own: Vec<(usize, f32)> = (0..LIMBS.len()).filter(|&joint| is_near(joint)).map(weight).collect();
    let sum: f32 = own.iter().map(|own| own.1).sum();
    own.into_iter().map(|(joint, weight)| (joint, weight / sum)).collect()
}

/// A clip of `secs` whose joints have rotations, and whose hips have a displacement, as functions
/// of the phase from 0 to 1.
fn clip(
    name: &str,
    secs: f64,
    joints: &[usize],
    rotation: impl Fn(usize, f64) -> DQuat,
    displacement: impl Fn(f64) -> DVec3,
) -> Clip {
    let phases = (0..=KEYS).map(|key| f64::from(key) / f64::from(KEYS));
    let track = |joint: usize, values: Values| Track {
        joint,
        times: phases.clone().map(|phase| phase * secs).collect(),
        interpolation: Interpolation::Linear,
        values,
    };
    let mut tracks: Vec<Track> = joints
        .iter()
        .map(|&joint| track(joint, Values::Rotation(phases.clone().map(|at| rotation(joint, at)).collect())))
        .collect();
    let hips = DVec3::from(LIMBS[HIPS].at);
    tracks.push(track(HIPS, Values::Translation(phases.clone().map(|at| hips + displacement(at)).collect())));
    Clip { name: name.into(), tracks }
}

/// Lowers an arm from its rest direction, 45° down, by `angle`: to the body.
fn lowered(joint: usize, angle: f64) -> DQuat {
    DQuat::from_rotation_z(if joint < ARM + 3 { -angle } else { angle })
}

/// Two steps of 0.55 s on the spot.
fn walk() -> Clip {
    let joints: Vec<usize> = (0..LIMBS.len()).collect();
    let rotation = |joint: usize, at: f64| {
        // The right side is half a cycle later.
        let is_right = (ARM + 3..LEG).contains(&joint) || joint >= LEG + 3;
        let own = TAU * (at + if is_right { 0.5 } else { 0.0 });
        let pitch = DQuat::from_rotation_x;
        match joint {
            HIPS => DQuat::from_rotation_y(0.1 * (TAU * at).sin()),
            SPINE => DQuat::from_rotation_y(-0.14 * (TAU * at).sin()) * pitch(0.03),
            NECK => pitch(0.03 * (2.0 * TAU * at).cos()),
            HEAD => DQuat::from_rotation_y(0.04 * (TAU * at).sin()),
            5 | 8 => lowered(joint, 0.62) * pitch(0.45 * own.sin()),
            6 | 9 => pitch(-0.35 - 0.2 * own.sin()),
            LEG | 14 => pitch(-0.48 * own.sin() - 0.06),
            12 | 15 => pitch(0.12 + 0.85 * (own + 0.6 * PI).cos().max(0.0).powi(2)),
            13 | 16 => pitch(-0.1 + 0.25 * (own + 0.3 * PI).sin()),
            _ => DQuat::IDENTITY,
        }
    };
    clip("walk", 1.1, &joints, rotation, |at| {
        DVec3::new(0.02 * (TAU * at).sin(), 0.022 * (2.0 * TAU * at).cos() - 0.03, 0.0)
    })
}

/// Crouches, jumps 45 cm high and lands, in 1.6 s.
fn jump() -> Clip {
    let joints: Vec<usize> = (0..LIMBS.len()).collect();
    // Height of the hips over standing: 0.32 s to crouch, 0.2 s to take off, free flight until
    // 1.14 s, then the same backwards.
    let ease = |share: f64| {
        let share = share.clamp(0.0, 1.0);
        share * share * (3.0 - 2.0 * share)
    };
    let crouch = move |at: f64| {
        let half = 1.6 * if at < 0.5 { at } else { 1.0 - at };
        ease(half / 0.3) - ease((half - 0.3) / 0.2)
    };
    let flight = |at: f64| {
        let share = (1.6 * at - 0.46) / 0.68;
        if (0.0..=1.0).contains(&share) { 4.0 * 0.45 * share * (1.0 - share) } else { 0.0 }
    };
    let rotation = move |joint: usize, at: f64| {
        let (bent, up) = (crouch(at), flight(at) / 0.45);
        let pitch = DQuat::from_rotation_x;
        match joint {
            SPINE => pitch(0.5 * bent - 0.05 * up),
            HEAD => pitch(-0.35 * bent + 0.1 * up),
            5 | 8 => lowered(joint, 0.6 - 0.5 * up) * pitch(0.7 * bent - 1.6 * up),
            6 | 9 => pitch(-0.5 * bent - 0.2),
            LEG | 14 => pitch(-0.95 * bent - 0.15 * up),
            12 | 15 => pitch(1.7 * bent + 0.3 * up),
            13 | 16 => pitch(-0.75 * bent + 0.5 * up),
            _ => DQuat::IDENTITY,
        }
    };
    // Thighs and shanks of 0.41 m each fold by these angles.
    clip("jump", 1.6, &joints, rotation, move |at| {
        let bent = crouch(at);
        let fold = 0.41 * (2.0 - (0.95 * bent).cos() - (0.75 * bent).cos());
        DVec3::new(0.0, flight(at) - fold, -0.12 * bent)
    })
}

/// Looks to both sides, up and down, in 4 s.
fn look() -> Clip {
    let rotation = |joint: usize, at: f64| {
        let (yaw, pitch) = (0.75 * (TAU * at).sin(), 0.3 * (2.0 * TAU * at).sin());
        match joint {
            SPINE => DQuat::from_rotation_y(0.2 * yaw),
            NECK | HEAD => DQuat::from_rotation_y(0.5 * yaw) * DQuat::from_rotation_x(0.5 * pitch),
            _ => lowered(joint, 0.6),
        }
    };
    clip("look", 4.0, &[SPINE, NECK, HEAD, ARM, ARM + 3], rotation, |_| DVec3::ZERO)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::ClosedMesh;
    use crate::body::character::{Performance, Playback, PosingBuffers, Skinning};

    #[test]
    fn the_walker_is_one_closed_surface_on_the_ground() {
        let walker = Walker::builtin();
        let (low, high) = walker.rest().bounds();
        assert!(low.y.abs() < 0.02 && (1.65..1.8).contains(&high.y), "{low} {high}");
        let report = ClosedMesh::new(walker.rest()).report();
        assert_eq!((report.rims, report.turned), (0, false));
        let moved = walker.rest().positions.iter().zip(&walker.bound().positions);
        assert!(moved.map(|(a, b)| a.distance(*b)).fold(0.0, f32::max) < 1e-6);
        let [lo, hi] = Walker::SCALP;
        let scalp = walker.rest().positions.iter().filter(|p| p.cmpge(lo).all() && p.cmple(hi).all());
        assert!(scalp.count() > 100);
    }

    #[test]
    fn clips_end_as_they_start_and_keep_the_feet_above_the_ground() {
        let walker = Walker::builtin();
        for clip in walker.clips() {
            assert!(Walker::CLIPS.contains(&clip.name.as_str()));
            let playback = Playback { blend_secs: 0.0, ..Playback::default() };
            let own =
                Performance::new(walker.clone(), clip.clone(), playback, Skinning::Linear, HEAD).unwrap();
            let mut buffers = PosingBuffers::default();
            let duration = clip.duration_secs();
            let ends = [0.0, duration * (1.0 - 1e-9)].map(|secs| own.carrier(secs, &mut buffers));
            assert!(ends[0].translation.distance(ends[1].translation) < 1e-6, "{}", clip.name);
            let mut highest = f64::NEG_INFINITY;
            for step in 0..40 {
                let posed = own.posed(duration * f64::from(step) / 40.0, &mut buffers);
                let heights = posed.positions.iter().map(|p| posed.carrier.transform_point(p.as_dvec3()).y);
                let lowest = heights.fold(f64::INFINITY, f64::min);
                assert!(lowest > -0.1, "{} {step}: {lowest}", clip.name);
                highest = highest.max(lowest);
            }
            assert_eq!(highest > 0.3, clip.name == "jump", "{}: {highest}", clip.name);
        }
    }
}
