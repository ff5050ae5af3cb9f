//! Shapes as functions of space, in any one unit of length: what the built-in head and the props are made of.
//!
//! # Theory
//! Ellipsoids to first order, capsules exact but for their taper, and polynomial smooth unions and cuts
//! (Quílez, "Distance functions", "Smooth minimum").

use glam::{Vec3, vec3};

/// Gradient of `distance` by four samples at the corners of a tetrahedron, in units of `distance` a metre.
pub fn gradient(distance: impl Fn(Vec3) -> f32, point: Vec3) -> Vec3 {
    const H: f32 = 4e-4;
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

/// A capsule from `a` to `b` whose radius goes from `ra` to `rb`.
pub fn cone(p: Vec3, a: Vec3, b: Vec3, ra: f32, rb: f32) -> f32 {
    let axis = b - a;
    let t = ((p - a).dot(axis) / axis.length_squared()).clamp(0.0, 1.0);
    (p - a - axis * t).length() - (ra + (rb - ra) * t)
}

/// Union, rounded over `k`.
pub fn join(a: f32, b: f32, k: f32) -> f32 {
    let h = (k - (a - b).abs()).max(0.0) / k;
    a.min(b) - h * h * k * 0.25
}

/// Intersection, rounded over `k`.
pub fn meet(a: f32, b: f32, k: f32) -> f32 {
    -join(-a, -b, k)
}

/// `a` without `b`, rounded over `k`.
pub fn carve(a: f32, b: f32, k: f32) -> f32 {
    meet(a, -b, k)
}
