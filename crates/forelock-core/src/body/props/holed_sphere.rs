//! The hollow sphere with openings; its outer radius is 1.

use glam::Vec3;

use crate::body::implicit::carve;

/// Thickness of the shell.
const THICKNESS: f32 = 0.12;
/// Half the opening angle of a hole, in degrees, measured at the centre: for the holes through the
/// faces and the corners of a cube.
const HOLES: [f32; 2] = [19.0, 15.0];
/// Rounding of the holes' edges.
const ROUND: f32 = 0.05;

/// Signed distance to the shell, negative inside.
pub fn distance(p: Vec3) -> f32 {
    let length = p.length();
    let shell = (length - (1.0 - 0.5 * THICKNESS)).abs() - 0.5 * THICKNESS;
    // By symmetry the nearest hole of each kind is the one on the longest axis or the one at the
    // corner of the octant.
    let q = p.abs();
    let cosines = [q.max_element(), q.element_sum() / 3f32.sqrt()];
    let mut d = shell;
    for (cosine, hole) in cosines.into_iter().zip(HOLES) {
        let off = (cosine / length.max(1e-6)).clamp(0.0, 1.0).acos() - hole.to_radians();
        // A cone with its apex at the centre.
        d = carve(d, length * off.clamp(-1.5, 1.5).sin(), ROUND);
    }
    d
}
