//! The regions of the built-in head on which hair grows. Lengths in this file are in centimetres.

use glam::{Vec3, vec3};

/// A region of the head on which hair grows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "kebab-case"))]
pub enum Region {
    /// The scalp: from the hairline at the forehead, around the ears, to the nape.
    #[default]
    Scalp,
    /// Chin, jaw, lower cheeks, upper lip and upper neck.
    Beard,
}

/// Height of the hairline as a function of the position from back to front, (z, y).
const HAIRLINE: [(f32, f32); 9] = [
    (-4.5, -5.6),
    (-2.6, -3.8),
    (0.4, -0.6),
    (1.4, -0.4),
    (2.4, 2.4),
    (4.0, 4.6),
    (5.5, 5.2),
    (7.0, 6.2),
    (8.6, 6.9),
];

/// Height of the upper edge of the beard as a function of the position from back to front, (z, y).
const BEARDLINE: [(f32, f32); 5] = [(0.2, -1.0), (1.2, -2.2), (3.5, -5.2), (6.5, -6.4), (8.0, -8.2)];

impl Region {
    /// Density of hair at `point` (metres) on the skin, 0 to 1, smooth across the region's edge.
    pub fn weight(self, point: Vec3) -> f32 {
        let p = point * 100.0;
        match self {
            Self::Scalp => {
                let ear = ellipsoid(p, vec3(7.5, -1.6, -1.4), vec3(3.0, 3.5, 2.3));
                rise(p.y - line(&HAIRLINE, p.z) + 0.3, 1.8) * rise(ear, 0.8)
            }
            Self::Beard => {
                let lips = ellipsoid(p, vec3(0.0, -7.1, 8.8), vec3(2.9, 1.0, 2.4));
                let nostrils = rise(-5.3 - p.y, 0.5);
                // The moustache reaches down to the beard at the corners of the mouth.
                let lower = 7.0 + 2.0 * rise(p.x.abs() - 2.3, 0.8);
                let lip = rise(3.9 - p.x.abs(), 1.0)
                    * rise(p.z - 6.0, 0.8)
                    * rise(p.y + lower, 0.3)
                    * nostrils
                    * 0.8;
                let jaw = rise(line(&BEARDLINE, p.z) + 0.3 - p.y, 1.6)
                    * rise(p.y + 13.0, 1.6)
                    * rise(p.z + 0.6, 1.6);
                let ear = ellipsoid(p, vec3(7.5, -1.6, -1.4), vec3(2.6, 3.6, 2.0));
                lip.max(jaw) * rise(lips, 0.3) * rise(ear, 0.5)
            }
        }
    }
}

/// Piecewise linear interpolation, constant outside the range of `points`.
fn line(points: &[(f32, f32)], at: f32) -> f32 {
    let next = points.partition_point(|&(x, _)| x <= at);
    if next == 0 || next == points.len() {
        return points[next.saturating_sub(1)].1;
    }
    let ((x0, y0), (x1, y1)) = (points[next - 1], points[next]);
    y0 + (y1 - y0) * (at - x0) / (x1 - x0)
}

/// A smooth step: 0 below 0, 1 above `width`.
pub(super) fn rise(x: f32, width: f32) -> f32 {
    let t = (x / width).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Approximate distance to an ellipsoid that is mirrored at x = 0.
fn ellipsoid(p: Vec3, centre: Vec3, radii: Vec3) -> f32 {
    let q = (vec3(p.x.abs(), p.y, p.z) - centre) / radii;
    (q.length() - 1.0) * radii.min_element()
}
