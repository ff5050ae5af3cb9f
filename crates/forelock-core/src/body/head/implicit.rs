//! The shape of the head as one implicit function. Lengths in this file are in centimetres.
//!
//! A smooth union with a blend of width k differs from the nearer of its parts only where their
//! distances differ by less than k, so parts that are farther away are skipped by a bounding ball.
//! Distances to parts may be too small far away from them; they are bounded from below by the
//! distance to the ball, so that there is no step where a part is skipped.
//! All parts are defined for x ≥ 0 and mirrored with a rounded |x|, which leaves no crease in the
//! middle.

use glam::{Vec3, vec3};

use crate::body::implicit::{carve, cone, ellipsoid, intersect, join};

/// Middle of an eyeball, and its radius.
pub const EYE: Vec3 = vec3(3.15, -0.1, 6.75);
pub const EYEBALL: f32 = 1.28;
/// Height of the line between the lips.
pub const MOUTH: f32 = -7.12;

/// Signed distance in metres, negative inside.
pub fn distance(point: Vec3) -> f32 {
    distance_cm(point * 100.0) * 0.01
}

/// The same for the union of the head and the space in front of the face, which extends to infinity
/// along +z.
pub fn distance_with_face_space(point: Vec3) -> f32 {
    let p = point * 100.0;
    let section = vec3(p.x, p.y, p.z.min(8.5));
    let space = cone(section, vec3(0.0, 0.2, 8.5), vec3(0.0, -16.0, 8.5), 5.6, 5.0);
    // Hair must pass over the ear, not between the ear and the skull, and without a step.
    let ear = ellipsoid(vec3(p.x.abs(), p.y, p.z), vec3(5.6, -1.0, -2.6), vec3(4.1, 9.0, 5.4));
    join(join(distance_cm(p), space, 2.0), ear, 2.0) * 0.01
}

fn distance_cm(p: Vec3) -> f32 {
    let m = vec3((p.x * p.x + 0.02).sqrt(), p.y, p.z);
    ear(m, bust(m, face(m, skull(m))))
}

fn skull(m: Vec3) -> f32 {
    let mut d = ellipsoid(m, vec3(0.0, 3.0, -1.6), vec3(7.55, 8.5, 8.7));
    d = join(d, ellipsoid(m, vec3(0.0, 3.6, 2.0), vec3(6.6, 6.9, 7.1)), 2.0);
    // Occiput.
    d = join(d, ellipsoid(m, vec3(0.0, 1.0, -5.5), vec3(5.6, 5.2, 4.9)), 2.0);
    // Temples.
    carve(d, ellipsoid(m, vec3(9.4, 0.9, 5.4), vec3(2.6, 3.4, 3.0)), 2.4)
}

fn face(m: Vec3, skull: f32) -> f32 {
    // A ball that contains the parts, less the width of the blends.
    let ball = (m - vec3(0.0, -4.0, 3.5)).length() - 11.8;
    if ball > skull { skull } else { features(m, skull).max(ball) }
}

fn features(m: Vec3, mut d: f32) -> f32 {
    // Maxilla and the mass between the jaws.
    d = join(d, ellipsoid(m, vec3(0.0, -4.4, 4.0), vec3(4.9, 6.0, 4.7)), 2.0);
    d = join(d, ellipsoid(m, vec3(0.0, -7.2, 3.4), vec3(4.2, 3.6, 5.2)), 2.0);
    // Side of the face: masseter and parotid.
    d = join(d, ellipsoid(m, vec3(4.1, -3.6, 2.0), vec3(2.0, 4.3, 4.0)), 2.5);
    // Jaw.
    d = join(d, cone(m, vec3(5.2, -1.5, -0.2), vec3(4.4, -6.3, 0.9), 1.2, 1.1), 2.0);
    d = join(d, cone(m, vec3(4.3, -6.4, 1.0), vec3(1.3, -9.9, 6.8), 1.2, 1.35), 2.0);
    // Chin.
    d = join(d, ellipsoid(m, vec3(0.0, -9.95, 7.3), vec3(1.55, 1.45, 1.45)), 1.5);
    // Cheekbones.
    d = join(d, ellipsoid(m, vec3(4.3, -2.4, 5.3), vec3(1.9, 1.5, 1.8)), 2.4);
    d = join(d, cone(m, vec3(4.9, -2.0, 4.8), vec3(6.0, -1.2, 0.6), 0.9, 0.7), 2.2);
    // Cheek.
    d = join(d, ellipsoid(m, vec3(3.4, -4.8, 4.6), vec3(2.1, 2.6, 2.5)), 2.0);
    // Brow ridge.
    d = join(d, cone(m, vec3(1.2, 1.5, 7.9), vec3(4.9, 1.6, 5.9), 0.85, 0.7), 1.8);
    // Sockets.
    d = carve(d, ellipsoid(m, vec3(3.2, -0.1, 9.4), vec3(2.2, 1.2, 1.9)), 1.3);
    d = eye(m, d);
    d = nose(m, d);
    mouth(m, d)
}

/// An eyeball between two lids; the lids are a thicker shell with an almond-shaped opening.
fn eye(m: Vec3, d: f32) -> f32 {
    let q = m - EYE;
    let [upper, lower] = lid_edges(q);
    let slit = upper.max(lower);
    let lids = join(d, q.length() - 1.5, 0.9);
    let parted = carve(lids, slit.max(q.length() - 2.2).max(0.4 - q.z), 0.25);
    join(parted, q.length() - EYEBALL, 0.15)
}

/// How far a point relative to the middle of an eyeball is above the edge of the upper lid, and
/// below that of the lower one.
pub fn lid_edges(q: Vec3) -> [f32; 2] {
    let t = (q.x - 0.05) / 1.5;
    let open = 1.0 - t * t;
    let tilted = q.y - 0.1 * q.x;
    [tilted - 0.55 * open + 0.1, -tilted - 0.45 * open + 0.1]
}

fn nose(m: Vec3, mut d: f32) -> f32 {
    d = join(d, cone(m, vec3(0.0, 0.9, 8.1), vec3(0.0, -3.2, 10.1), 0.7, 0.8), 1.5);
    d = join(d, ellipsoid(m, vec3(0.0, -3.8, 10.3), vec3(0.95, 0.85, 1.0)), 1.0);
    d = join(d, ellipsoid(m, vec3(1.15, -4.15, 9.1), vec3(0.62, 0.7, 1.0)), 0.9);
    carve(d, ellipsoid(m, vec3(0.62, -4.95, 9.6), vec3(0.36, 0.42, 0.6)), 0.5)
}

fn mouth(m: Vec3, mut d: f32) -> f32 {
    // Muzzle, and the groove over the chin.
    d = join(d, ellipsoid(m, vec3(0.0, -6.7, 5.6), vec3(3.2, 2.6, 3.0)), 1.8);
    d = carve(d, ellipsoid(m, vec3(0.0, -8.75, 9.5), vec3(2.0, 0.45, 1.0)), 1.0);
    // Lips, curved around the teeth, and the line between them; the philtrum above.
    let bent = vec3(m.x, m.y, m.z + 0.11 * m.x * m.x);
    d = carve(d, cone(m, vec3(0.0, -5.2, 9.1), vec3(0.0, -6.0, 9.25), 0.25, 0.3), 0.6);
    d = join(d, cone(bent, vec3(0.45, -6.55, 8.55), vec3(2.2, -7.0, 8.25), 0.5, 0.2), 0.5);
    d = join(d, cone(bent, vec3(0.0, -7.7, 8.4), vec3(2.0, -7.3, 8.2), 0.6, 0.2), 0.5);
    carve(d, cone(bent, vec3(0.0, MOUTH, 9.42), vec3(2.2, MOUTH, 8.92), 0.25, 0.12), 0.6)
}

/// Width of the blend between the ear and the skull.
const EAR_BLEND: f32 = 0.7;

/// A plate in the shape of an egg with a rolled rim, a hollow and a tragus.
fn ear(m: Vec3, d: f32) -> f32 {
    let q = m - vec3(7.35, -1.5, -1.2);
    // A ball that contains the ear.
    let ball = q.length() - 3.7;
    if ball > d.max(0.0) + EAR_BLEND {
        return d;
    }
    let back = vec3(0.43, -0.2, -0.88).normalize();
    let up = vec3(0.12, 0.96, -0.24);
    let up = (up - back * up.dot(back)).normalize();
    let out = up.cross(back);
    let out = if out.x < 0.0 { -out } else { out };
    let l = vec3(q.dot(back), q.dot(up), q.dot(out));
    // The ear is wider at the top than at the lobe.
    let width = 1.6 + 0.12 * l.y.clamp(-3.0, 3.0);
    let rim = (vec3(l.x / width, l.y / 3.05, 0.0).length() - 1.0) * 1.5;
    let lift = l.z - 0.25 - 0.05 * l.x;
    let plate = intersect(rim, lift.abs() - 0.38, 0.5);
    let tube = ((rim + 0.25) * (rim + 0.25) + (lift - 0.3) * (lift - 0.3)).sqrt() - 0.4;
    let mut ear = join(plate, tube, 0.5);
    // Concha and the fossa above it.
    ear = carve(ear, ellipsoid(l, vec3(-0.15, -0.35, 0.95), vec3(0.8, 1.0, 0.75)), 0.4);
    ear = carve(ear, ellipsoid(l, vec3(0.2, 1.5, 0.85), vec3(0.6, 0.7, 0.35)), 0.4);
    ear = join(ear, ellipsoid(l, vec3(-1.2, -0.55, 0.3), vec3(0.4, 0.6, 0.4)), 0.4);
    join(d, ear.max(ball), EAR_BLEND)
}

fn bust(m: Vec3, mut d: f32) -> f32 {
    if m.y - 3.0 > d + 2.5 {
        return d;
    }
    // Neck.
    let mut b = cone(m, vec3(0.0, -4.0, -2.0), vec3(0.0, -18.0, -4.2), 5.2, 5.6);
    // Trapezius.
    b = join(b, cone(m, vec3(1.8, -11.5, -5.4), vec3(12.0, -20.4, -5.0), 2.6, 2.4), 3.5);
    // Shoulders, chest and back.
    b = join(b, cone(m, vec3(6.0, -22.0, -4.4), vec3(16.0, -22.4, -4.4), 4.6, 4.7), 3.0);
    b = join(b, cone(m, vec3(16.6, -22.6, -4.4), vec3(17.6, -32.0, -4.2), 4.5, 4.0), 2.0);
    b = join(b, ellipsoid(m, vec3(0.0, -29.0, -3.4), vec3(16.0, 11.5, 9.4)), 3.0);
    // Sternomastoid and clavicle.
    b = join(b, cone(m, vec3(5.2, -5.5, -2.2), vec3(1.4, -18.8, 1.8), 0.9, 0.7), 2.0);
    b = join(b, cone(m, vec3(1.8, -19.3, 2.2), vec3(14.5, -18.9, -2.8), 0.6, 0.7), 2.0);
    b = carve(b, ellipsoid(m, vec3(0.0, -18.4, 4.0), vec3(1.2, 1.4, 1.4)), 0.8);
    d = join(d, b, 2.2);
    // Flat base.
    carve(d, m.y + 30.0, 0.6)
}
