//! Preparation of bodies for drawing: in world space, clipped at the near plane, sorted into tiles.

use glam::{DVec3, Vec3};

use crate::camera::View;
use crate::face;
use crate::scene::{Body, RenderError, bounds_of};
use crate::tiles::{Bins, TileGrid};

/// A triangle on the screen: pixel x, pixel y and inverse depth of each corner.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ScreenTriangle {
    pub corners: [Vec3; 3],
    /// The index in [`Solids::triangles`].
    pub source: u32,
}

/// All bodies of a scene in world space.
#[derive(Debug, Default)]
pub(crate) struct Solids<'a> {
    pub positions: Vec<Vec3>,
    pub normals: Vec<Vec3>,
    pub triangles: Vec<[u32; 3]>,
    bodies: Vec<Range<'a>>,
    pub screen: Vec<ScreenTriangle>,
    pub bins: Bins,
}

/// A point on the surface of a body.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SurfacePoint {
    pub position: Vec3,
    /// Unit normal, on the front side of the triangle.
    pub normal: Vec3,
    pub albedo: Vec3,
    /// The exponent of its highlight.
    pub polish: f32,
}

/// What is a body's.
#[derive(Debug)]
struct Range<'a> {
    body: Body<'a>,
    /// The end of its triangles.
    end: u32,
    /// Its first vertex.
    first: u32,
}

impl<'a> Solids<'a> {
    pub fn new(bodies: &[Body<'a>], view: &View, tiles: TileGrid) -> Result<Self, RenderError> {
        let mut solids = Self::default();
        for (index, body) in bodies.iter().enumerate() {
            body.check(index)?;
            solids.append(body);
        }
        let seen: Vec<Vec3> = solids.positions.iter().map(|&p| view.to_camera(p)).collect();
        for (source, triangle) in solids.triangles.iter().enumerate() {
            let corners = triangle.map(|v| seen[v as usize]);
            if corners.iter().all(|c| c.is_finite()) {
                cut_at_near_plane(corners, view.near, |triangle| {
                    let corners = triangle.map(|c| view.to_pixels(c));
                    solids.screen.push(ScreenTriangle { corners, source: source as u32 });
                });
            }
        }
        let rects = solids.screen.iter().enumerate().filter_map(|(i, t)| {
            let [a, b, c] = t.corners;
            let (lo, hi) = (a.min(b).min(c), a.max(b).max(c));
            tiles.rect([lo.x, lo.y], [hi.x, hi.y]).map(|rect| (i as u32, rect))
        });
        solids.bins = Bins::new(tiles, rects);
        Ok(solids)
    }

    fn append(&mut self, body: &Body<'a>) {
        let first = self.positions.len() as u32;
        let place = |p: &Vec3| body.pose.transform_point(p.as_dvec3()).as_vec3();
        let turn = |n: Vec3| body.pose.transform_vector(DVec3::from(n)).as_vec3();
        self.positions.extend(body.mesh.positions.iter().map(place));
        self.normals.extend(body.mesh.vertex_normals().into_iter().map(turn));
        self.triangles.extend(body.mesh.triangles.iter().map(|t| t.map(|v| v + first)));
        self.bodies.push(Range { body: *body, end: self.triangles.len() as u32, first });
    }

    pub fn corners(&self, triangle: usize) -> [Vec3; 3] {
        self.triangles[triangle].map(|v| self.positions[v as usize])
    }

    /// The smallest box around all finite vertices. It is empty (min > max) if there is none, or no
    /// triangle.
    pub fn bounds(&self) -> (Vec3, Vec3) {
        if self.triangles.is_empty() {
            return bounds_of(std::iter::empty());
        }
        bounds_of(self.positions.iter().copied().filter(|p| p.is_finite()))
    }

    /// The point of triangle `source` nearest to `point`, which lies in its plane up to rounding.
    pub fn surface_point(&self, source: u32, point: Vec3) -> SurfacePoint {
        let triangle = self.triangles[source as usize];
        let [a, b, c] = self.corners(source as usize);
        let flat = (b - a).cross(c - a);
        let twice_area = flat.length_squared().max(f32::MIN_POSITIVE);
        let u = unit((c - b).cross(point - b).dot(flat) / twice_area);
        let v = unit((a - c).cross(point - c).dot(flat) / twice_area).min(1.0 - u);
        let [na, nb, nc] = triangle.map(|v| self.normals[v as usize]);
        let normal = (na * u + nb * v + nc * (1.0 - u - v)).normalize_or(flat.normalize_or(Vec3::Y));
        let body = self.bodies.partition_point(|body| body.end <= source);
        let Range { body, first, .. } = &self.bodies[body];
        let own = triangle.map(|v| (v - first) as usize);
        let mut skin = body.colour;
        if let Some(scalp) = body.scalp {
            let [a, b, c] = own.map(|v| scalp.shares[v]);
            skin = skin.lerp(scalp.colour, unit(a * u + b * v + c * (1.0 - u - v)));
        }
        let (albedo, polish) = match body.face {
            Some(face) => {
                let [a, b, c] = own.map(|v| face.rest[v]);
                face::paint(a * u + b * v + c * (1.0 - u - v), skin, face.brows)
            }
            None => (skin, face::SKIN),
        };
        SurfacePoint { position: a * u + b * v + c * (1.0 - u - v), normal, albedo, polish }
    }
}

/// `x` clamped to 0–1. NaN gives 0: the area of a very large triangle can overflow.
pub(crate) fn unit(x: f32) -> f32 {
    if x > 0.0 { x.min(1.0) } else { 0.0 }
}

/// Clips a triangle in camera space at z = `near`. The part beyond is up to two triangles.
fn cut_at_near_plane(corners: [Vec3; 3], near: f32, mut emit: impl FnMut([Vec3; 3])) {
    let behind = corners.iter().filter(|c| c.z < near).count();
    if behind == 0 {
        return emit(corners);
    }
    let cross = |a: Vec3, b: Vec3| a.lerp(b, ((near - a.z) / (b.z - a.z)).clamp(0.0, 1.0)).with_z(near);
    for i in 0..3 {
        let [a, b, c] = [corners[i], corners[(i + 1) % 3], corners[(i + 2) % 3]];
        if behind == 1 && a.z < near {
            let (ab, ca) = (cross(a, b), cross(a, c));
            emit([ab, b, c]);
            emit([ab, c, ca]);
        } else if behind == 2 && a.z >= near {
            emit([a, cross(a, b), cross(a, c)]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cutting_keeps_the_part_beyond() {
        let area = |t: [Vec3; 3]| 0.5 * (t[1] - t[0]).cross(t[2] - t[0]).length();
        let whole = [Vec3::new(0.0, 0.0, -1.0), Vec3::new(2.0, 0.0, 1.0), Vec3::new(-2.0, 0.0, 1.0)];
        for (near, share) in [(-2.0, 1.0), (0.0, 0.75), (1.5, 0.0)] {
            let mut kept = 0.0;
            cut_at_near_plane(whole, near, |t| {
                assert!(t.iter().all(|c| c.z >= near));
                kept += area(t);
            });
            assert!((kept - share * area(whole)).abs() < 1e-5);
        }
        let mut kept = 0.0;
        cut_at_near_plane(whole.map(|c| -c), 0.0, |t| kept += area(t));
        assert!((kept - 0.25 * area(whole)).abs() < 1e-5);
    }
}
