//! The hollow sphere with openings, of outer radius 1.

use glam::Vec3;

use crate::body::implicit::carve;

/// Thickness of the shell.
const THICKNESS: f32 = 0.12;
/// Half the angle of a hole as seen from the middle, through the faces and the corners of a cube, degrees.
const HOLES: [f32; 2] = [19.0, 15.0];
/// How much the holes' edges are rounded.
const ROUND: f32 = 0.05;

/// Signed distance to the shell, negative inside.
pub fn distance(p: Vec3) -> f32 {
    let length = p.length();
    let shell = (length - (1.0 - 0.5 * THICKNESS)).abs() - 0.5 * THICKNESS;
    // By symmetry the nearest hole of each kind is that of the octant's corner, and of its longest axis.
    let q = p.abs();
    let cosines = [q.max_element(), q.element_sum() / 3f32.sqrt()];
    let mut d = shell;
    for (cosine, hole) in cosines.into_iter().zip(HOLES) {
        let off = (cosine / length.max(1e-6)).clamp(0.0, 1.0).acos() - hole.to_radians();
        // A cone from the middle.
        d = carve(d, length * off.clamp(-1.5, 1.5).sin(), ROUND);
    }
    d
}
