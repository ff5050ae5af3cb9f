//! The hand. Lengths in this file are in centimetres, angles in degrees.
//!
//! The proportions are those that drawing courses teach: the middle finger is as long as the back
//! of the palm, each phalanx is about two thirds of the one before it (0.46, 0.30, 0.24 of a
//! finger), the knuckles lie on an arc, and the axes of the fingers intersect at the wrist.

use glam::{Vec3, vec3};

use crate::body::implicit::{carve, cone, ellipsoid, intersect, join};
use crate::body::surface_nets::Bounds;

/// A box that contains the hand, in metres.
pub const BOX: Bounds = Bounds { min: vec3(-0.105, -0.075, -0.032), max: vec3(0.058, 0.197, 0.072) };

/// A finger: its knuckle, its lean towards +x, its length from the knuckle's centre to its tip, and
/// its radius at the knuckle.
struct Finger {
    knuckle: Vec3,
    lean: f32,
    length: f32,
    radius: f32,
}

/// Index, middle, ring and little finger.
const FINGERS: [Finger; 4] = [
    Finger { knuckle: vec3(-2.75, 9.3, -0.1), lean: -11.0, length: 8.85, radius: 0.93 },
    Finger { knuckle: vec3(-0.75, 9.75, -0.25), lean: -2.0, length: 9.67, radius: 0.95 },
    Finger { knuckle: vec3(1.2, 9.3, -0.15), lean: 7.0, length: 9.0, radius: 0.9 },
    Finger { knuckle: vec3(2.95, 8.35, 0.1), lean: 18.0, length: 7.2, radius: 0.8 },
];

/// Angle by which each phalanx bends towards the palm, relative to the one before it.
const BENDS: [f32; 3] = [7.0, 12.0, 9.0];

/// Signed distance to the hand, negative inside.
pub fn distance_cm(p: Vec3) -> f32 {
    let mut fingers = f32::INFINITY;
    for finger in &FINGERS {
        fingers = join(fingers, finger.distance(p), 0.3);
    }
    let d = join(palm(p), fingers, 0.8);
    let d = join(d, thumb(p), 1.1);
    join(d, forearm(p), 2.2)
}

impl Finger {
    fn distance(&self, p: Vec3) -> f32 {
        if (p - self.knuckle).length() > 2.0 * self.length {
            return (p - self.knuckle).length() - 1.2 * self.length;
        }
        let side = self.lean.to_radians();
        let along = |bend: f32| {
            let bend = bend.to_radians();
            vec3(side.sin() * bend.cos(), side.cos() * bend.cos(), bend.sin())
        };
        let (mut from, mut bend, mut radius, mut d) = (self.knuckle, 0.0, self.radius, f32::INFINITY);
        // The rounded tip is part of the length.
        let bones = self.length - 0.72 * self.radius;
        for (share, more) in [0.46, 0.3, 0.24].into_iter().zip(BENDS) {
            bend += more;
            let to = from + along(bend) * (bones * share);
            let next = 0.9 * radius;
            // The smooth union makes the joints slightly thicker than the bones between them.
            d = join(d, cone(p, from, to, radius, next), 0.25);
            (from, radius) = (to, next);
        }
        d
    }
}

fn palm(p: Vec3) -> f32 {
    let mut d = f32::INFINITY;
    for finger in &FINGERS {
        // The four bones of the palm converge at the wrist.
        let base = vec3(0.42 * finger.knuckle.x - 0.05, 1.2, 0.0);
        d = join(d, cone(p, base, finger.knuckle, 1.35, finger.radius + 0.12), 1.3);
    }
    // The balls of the thumb and of the little finger, and the hollow between them.
    d = join(d, ellipsoid(p, vec3(-2.3, 3.7, 0.95), vec3(1.75, 3.0, 1.25)), 1.2);
    d = join(d, ellipsoid(p, vec3(2.2, 3.7, 0.75), vec3(1.35, 3.2, 1.15)), 1.2);
    d = join(d, ellipsoid(p, vec3(0.1, 8.5, 0.55), vec3(3.4, 1.2, 0.9)), 1.0);
    carve(d, ellipsoid(p, vec3(0.1, 5.6, 2.6), vec3(1.9, 2.9, 1.35)), 1.4)
}

fn thumb(p: Vec3) -> f32 {
    let (root, knuckle) = (vec3(-2.2, 2.0, 0.9), vec3(-4.7, 5.1, 1.9));
    let (joint, tip) = (vec3(-6.5, 7.9, 2.5), vec3(-7.5, 10.2, 2.6));
    let mut d = cone(p, root, knuckle, 1.45, 1.08);
    d = join(d, cone(p, knuckle, joint, 1.05, 0.93), 0.4);
    join(d, cone(p, joint, tip, 0.95, 0.78), 0.3)
}

/// A flattened cone with a flat end.
fn forearm(p: Vec3) -> f32 {
    let flat = vec3(p.x, p.y, 1.32 * p.z);
    let arm = cone(flat, vec3(0.0, 1.0, 0.1), vec3(0.0, -8.5, 0.0), 2.55, 3.05);
    // Distances in compressed space change faster than true distances, by a factor of at most 1.32.
    intersect(arm / 1.15, -7.0 - p.y, 0.5)
}
