//! Shadow maps: the depth of bodies as seen from a directional light.

use glam::Vec3;

/// Depths along the direction of a light, on a square grid of texels.
#[derive(Clone, Debug)]
pub(crate) struct ShadowMap {
    pub axes: [Vec3; 3],
    pub origin: Vec3,
    /// Texels along each side.
    pub side: usize,
    /// Side of a texel, metres.
    texel: f32,
    /// The height of the surface nearest to the light, measured towards the light, metres. −∞ where
    /// there is no surface.
    heights: Vec<f32>,
    /// The lowest and the highest value of each block of texels. They suffice for most points.
    blocks: Vec<[f32; 2]>,
}

/// Texels along each side of a block.
const BLOCK: usize = 8;

impl ShadowMap {
    /// A map without surfaces for light from the direction `to_light`, with `side` texels along
    /// each side, a multiple of eight, for triangles inside the sphere `centre`, `radius`.
    pub fn empty(to_light: Vec3, centre: Vec3, radius: f32, side: usize) -> Self {
        let right = to_light.any_orthonormal_vector();
        let up = to_light.cross(right);
        let texel = (2.0 * radius / side as f32).max(1e-12);
        let origin = centre - (right + up) * radius;
        let (heights, blocks) = (Vec::new(), Vec::new());
        Self { axes: [right, up, to_light], origin, side, texel, heights, blocks }
    }

    /// The map of `triangles`, world space.
    pub fn of(mut self, triangles: impl Iterator<Item = [Vec3; 3]>) -> Self {
        let side = self.side;
        self.heights = vec![f32::NEG_INFINITY; side * side];
        for triangle in triangles {
            self.draw(triangle.map(|p| self.locate(p)));
        }
        self.blocks = vec![[f32::INFINITY, f32::NEG_INFINITY]; (side / BLOCK) * (side / BLOCK)];
        for (i, &height) in self.heights.iter().enumerate() {
            let [lo, hi] = &mut self.blocks[i / side / BLOCK * (side / BLOCK) + i % side / BLOCK];
            (*lo, *hi) = (lo.min(height), hi.max(height));
        }
        self
    }

    /// The texel coordinates and the height of a world point.
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

    /// The side of a texel, metres. To avoid self-shadowing, move a point off its surface by a few
    /// texels before calling [`visibility`](Self::visibility).
    pub fn texel(&self) -> f32 {
        self.texel
    }

    /// The share of light that reaches `point`, 0–1. It is 1 outside the map. The edge of a shadow
    /// is `2 softness + 2` texels wide.
    pub fn visibility(&self, point: Vec3, softness: u8) -> f32 {
        let p = self.locate(point);
        let margin = f32::from(softness) + 1.0;
        let inside = p.x.min(p.y) >= margin && p.x.max(p.y) <= self.side as f32 - margin - 1.0;
        if !inside {
            return 1.0;
        }
        let (x, y) = ((p.x - 0.5) as usize, (p.y - 0.5) as usize);
        let (fx, fy) = (p.x - 0.5 - x as f32, p.y - 0.5 - y as f32);
        let [lo, hi] = self.range(x, y, usize::from(softness));
        if p.z >= hi {
            return 1.0;
        } else if p.z < lo {
            return 0.0;
        }
        let (mut lit, mut total) = (0.0, 0.0);
        // A box filter. The outer texels are weighted by the position within a texel, so that the
        // result is continuous.
        let reach = i32::from(softness);
        let edge = |i: i32, fraction: f32| match i {
            _ if i == -reach => 1.0 - fraction,
            _ if i == reach + 1 => fraction,
            _ => 1.0,
        };
        for j in -reach..=reach + 1 {
            let wy = edge(j, fy);
            for i in -reach..=reach + 1 {
                let weight = wy * edge(i, fx);
                total += weight;
                let texel = (y as i32 + j) * self.side as i32 + x as i32 + i;
                if self.heights[texel as usize] <= p.z {
                    lit += weight;
                }
            }
        }
        lit / total
    }

    /// Bounds of all heights within the soft edge around texel (`x`, `y`).
    fn range(&self, x: usize, y: usize, reach: usize) -> [f32; 2] {
        let blocks = |at: usize| [(at - reach) / BLOCK, (at + reach + 1) / BLOCK];
        let (columns, rows) = (blocks(x), blocks(y));
        let mut range = [f32::INFINITY, f32::NEG_INFINITY];
        for (column, row) in rows.iter().flat_map(|&r| columns.map(|c| (c, r))) {
            let [lo, hi] = self.blocks[row * (self.side / BLOCK) + column];
            range = [range[0].min(lo), range[1].max(hi)];
        }
        range
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
        let map = ShadowMap::empty(Vec3::Y, Vec3::ZERO, 2.0, 768).of(plate.into_iter());
        assert_eq!(map.visibility(Vec3::new(0.3, 0.0, 0.2), 2), 0.0);
        assert_eq!(map.visibility(Vec3::new(0.3, 1.5, 0.2), 2), 1.0);
        assert_eq!(map.visibility(Vec3::new(1.5, 0.0, 0.2), 2), 1.0);
        let edge = map.visibility(Vec3::new(1.0, 0.0, 0.2), 2);
        assert!((0.3..0.7).contains(&edge), "{edge}");
    }
}
