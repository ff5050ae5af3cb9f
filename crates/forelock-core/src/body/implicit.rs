//! Signed distance functions of simple shapes and their smooth combinations, in any unit of length.
//! The built-in head, horse and props are made of them.
//!
//! # Theory
//! The distance to an ellipsoid is exact to first order near its surface; the distance to a capsule
//! is exact except for its taper. Smooth unions and cuts are polynomial (Quílez, "Distance
//! functions", "Smooth minimum").

use glam::{Vec3, vec3};

/// Step of the differences that give a gradient, metres.
const H: f32 = 4e-4;

/// Gradient of `distance` at `point`, where it is `value`, from three more samples.
pub fn forward_gradient(distance: impl Fn(Vec3) -> f32, point: Vec3, value: f32) -> Vec3 {
    let ahead = |axis: Vec3| (distance(point + axis * H) - value) / H;
    vec3(ahead(Vec3::X), ahead(Vec3::Y), ahead(Vec3::Z))
}

/// Gradient of `distance` from four samples at the corners of a tetrahedron, in units of `distance`
/// per metre.
pub fn gradient(distance: impl Fn(Vec3) -> f32, point: Vec3) -> Vec3 {
    let corners = [vec3(1.0, -1.0, -1.0), vec3(-1.0, -1.0, 1.0), vec3(-1.0, 1.0, -1.0), vec3(1.0, 1.0, 1.0)];
    corners.into_iter().map(|k| k * distance(point + k * H)).sum::<Vec3>() / (4.0 * H)
}

/// An ellipsoid: exact on its surface, to first order near it.
pub fn ellipsoid(p: Vec3, centre: Vec3, radii: Vec3) -> f32 {
    let q = (p - centre) / radii;
    let length = q.length();
    let slope = (q / radii).length();
    if slope < 1e-6 { -radii.min_element() } else { length * (length - 1.0) / slope }
}

/// A capsule from `a` to `b` whose radius changes linearly from `ra` to `rb`.
pub fn cone(p: Vec3, a: Vec3, b: Vec3, ra: f32, rb: f32) -> f32 {
    let axis = b - a;
    let t = ((p - a).dot(axis) / axis.length_squared()).clamp(0.0, 1.0);
    (p - a - axis * t).length() - (ra + (rb - ra) * t)
}

/// Smooth union, with a blend of width `k`.
pub fn join(a: f32, b: f32, k: f32) -> f32 {
    let h = (k - (a - b).abs()).max(0.0) / k;
    a.min(b) - h * h * k * 0.25
}

/// Smooth intersection, with a blend of width `k`.
pub fn intersect(a: f32, b: f32, k: f32) -> f32 {
    -join(-a, -b, k)
}

/// `a` minus `b`, with a smooth blend of width `k`.
pub fn carve(a: f32, b: f32, k: f32) -> f32 {
    intersect(a, -b, k)
}
