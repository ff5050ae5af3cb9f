//! The comb. Lengths in this file are in centimetres.

use glam::{Vec3, vec2, vec3};

use crate::body::implicit::{cone, join};
use crate::body::surface_nets::Bounds;

/// A box that contains the comb, in metres.
pub const BOX: Bounds = Bounds { min: vec3(-0.0896, -0.0448, -0.0042), max: vec3(0.0896, 0.0084, 0.0042) };

/// Number of teeth on each side of the middle tooth, and distance between teeth.
const TEETH: f32 = 15.0;
const PITCH: f32 = 0.55;
/// Radii of a tooth at its root and its tip.
const RADII: (f32, f32) = (0.16, 0.11);
/// The y coordinate of the end of a tooth's axis.
const TIP: f32 = -4.0;

/// Signed distance to the comb, negative inside.
pub fn distance_cm(p: Vec3) -> f32 {
    // The nearest tooth of the row.
    let tooth = (p.x / PITCH).round().clamp(-TEETH, TEETH) * PITCH;
    let teeth = cone(vec3(p.x - tooth, p.y, p.z), Vec3::ZERO, vec3(0.0, TIP, 0.0), RADII.0, RADII.1);
    join(spine(p), teeth, 0.12)
}

/// A rounded plate with a slightly arched back.
fn spine(p: Vec3) -> f32 {
    let arch = 0.12 * (1.0 - (p.x / 8.75).powi(2));
    let half = vec3(8.6, 0.6 + 0.5 * arch, 0.19);
    let q = (p - vec3(0.0, 0.5 * arch, 0.0)).abs() - (half - 0.15);
    let across = vec2(q.x.max(0.0), q.y.max(0.0)).length();
    vec2(across, q.z.max(0.0)).length() + q.max_element().min(0.0) - 0.15
}
