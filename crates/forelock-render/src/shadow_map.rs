//! Shadows of solid bodies: the depth that each directional light sees.

use glam::Vec3;

/// Depths along a light's direction over a square grid of texels.
#[derive(Clone, Debug)]
pub(crate) struct ShadowMap {
    axes: [Vec3; 3],
    origin: Vec3,
    /// Side of a texel, metres.
    texel: f32,
    side: usize,
    /// Distance towards the light of the nearest surface, metres; −∞ where there is none.
    heights: Vec<f32>,
}

/// Texels along a side.
const SIDE: usize = 1024;
/// Half width of the soft edge, texels.
const SOFTNESS: i32 = 2;

impl ShadowMap {
    /// The map of `triangles` (world space, within the sphere `centre`, `radius`) for light from `to_light`.
    pub fn new(
        triangles: impl Iterator<Item = [Vec3; 3]>,
        to_light: Vec3,
        centre: Vec3,
        radius: f32,
    ) -> Self {
        let right = to_light.any_orthonormal_vector();
        let up = to_light.cross(right);
        let texel = (2.0 * radius / SIDE as f32).max(1e-12);
        let origin = centre - (right + up) * radius;
        let mut map =
            Self { axes: [right, up, to_light], origin, texel, side: SIDE, heights: vec![f32::NEG_INFINITY; SIDE * SIDE] };
        for triangle in triangles {
            map.draw(triangle.map(|p| map.locate(p)));
        }
        map
    }

    /// Texel coordinates and height of a world point.
    fn locate(&self, point: Vec3) -> Vec3 {
        let offset = point - self.origin;
        let [right, up, to_light] = self.axes;
        Vec3::new(offset.dot(right) / self.texel, offset.dot(up) / self.texel, offset.dot(to_light))
    }

    fn draw(&mut self, [a, b, c]: [Vec3; 3]) {
        let area = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
        if area == 0.0 {
            return;
        }
        let (lo, hi) = (a.min(b).min(c), a.max(b).max(c));
        let range = |lo: f32, hi: f32| {
            (lo - 0.5).ceil().max(0.0) as usize..((hi + 0.5).floor().max(0.0) as usize).min(self.side)
        };
        for y in range(lo.y, hi.y) {
            let py = y as f32 + 0.5;
            for x in range(lo.x, hi.x) {
                let px = x as f32 + 0.5;
                let u = ((b.x - px) * (c.y - py) - (b.y - py) * (c.x - px)) / area;
                let v = ((c.x - px) * (a.y - py) - (c.y - py) * (a.x - px)) / area;
                let w = 1.0 - u - v;
                if u >= 0.0 && v >= 0.0 && w >= 0.0 {
                    let height = u * a.z + v * b.z + w * c.z;
                    let texel = &mut self.heights[y * self.side + x];
                    *texel = texel.max(height);
                }
            }
        }
    }

    /// Side of a texel, metres: move a surface's point out by a few of these before asking.
    pub fn texel(&self) -> f32 {
        self.texel
    }

    /// The share of light that reaches `point`, 0–1; all of it outside the map.
    pub fn visibility(&self, point: Vec3) -> f32 {
        let p = self.locate(point);
        let (x, y) = ((p.x - 0.5).floor(), (p.y - 0.5).floor());
        let (fx, fy) = (p.x - 0.5 - x, p.y - 0.5 - y);
        let (x, y) = (x as i32, y as i32);
        let (mut lit, mut total) = (0.0, 0.0);
        // A box of texels whose outer rows fade with the position between them: smooth as the point moves.
        for j in -SOFTNESS..=SOFTNESS + 1 {
            let wy = edge_weight(j, fy);
            for i in -SOFTNESS..=SOFTNESS + 1 {
                let weight = wy * edge_weight(i, fx);
                total += weight;
                if self.height(x + i, y + j) <= p.z {
                    lit += weight;
                }
            }
        }
        lit / total
    }

    fn height(&self, x: i32, y: i32) -> f32 {
        let inside = (0..self.side as i32).contains(&x) && (0..self.side as i32).contains(&y);
        if inside { self.heights[y as usize * self.side + x as usize] } else { f32::NEG_INFINITY }
    }
}

fn edge_weight(i: i32, fraction: f32) -> f32 {
    match i {
        _ if i == -SOFTNESS => 1.0 - fraction,
        _ if i == SOFTNESS + 1 => fraction,
        _ => 1.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plate_shades_what_is_below_it() {
        let corner = |x: f32, z: f32| Vec3::new(x, 1.0, z);
        let plate = [
            [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0)],
            [corner(-1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)],
        ];
        let map = ShadowMap::new(plate.into_iter(), Vec3::Y, Vec3::ZERO, 2.0);
        assert_eq!(map.visibility(Vec3::new(0.3, 0.0, 0.2)), 0.0);
        assert_eq!(map.visibility(Vec3::new(0.3, 1.5, 0.2)), 1.0);
        assert_eq!(map.visibility(Vec3::new(1.5, 0.0, 0.2)), 1.0);
        let edge = map.visibility(Vec3::new(1.0, 0.0, 0.2));
        assert!((0.3..0.7).contains(&edge), "{edge}");
    }
}
