//! A pinhole camera and its projection from world space to pixels.

use glam::{Vec2, Vec3};

/// The distance of the near plane as a fraction of the distance from the eye to the target.
/// Triangles are clipped at the near plane; strands are dropped there.
const NEAR_FRACTION: f32 = 0.02;

/// A pinhole camera that looks from `eye` to `target`. World space is in metres, y up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// The position of the camera, metres.
    pub eye: Vec3,
    /// The point in the centre of the picture, metres.
    pub target: Vec3,
    /// The up direction of the picture. It need not be perpendicular to the view direction.
    pub up: Vec3,
    /// The vertical field of view, radians, in (0, π). In a portrait picture it is the horizontal
    /// one.
    pub fov_y: f32,
}

impl Camera {
    /// The camera that shows the whole box `bounds` (min, max in metres) from the direction `yaw`
    /// and `pitch`, in radians. At yaw 0 the camera is on the +z side (the front of a head).
    /// Positive yaw turns it towards +x, positive pitch raises it.
    ///
    /// An empty or non-finite box is replaced by a unit box around the origin.
    pub fn framing(bounds: (Vec3, Vec3), yaw: f32, pitch: f32) -> Self {
        let (lo, hi) = bounds;
        let usable = lo.is_finite() && hi.is_finite() && lo.cmple(hi).all() && lo != hi;
        let (lo, hi) = if usable { (lo, hi) } else { (Vec3::splat(-0.5), Vec3::splat(0.5)) };
        let (target, half) = ((lo + hi) * 0.5, (hi - lo) * 0.5);
        let from_target =
            Vec3::new(yaw.sin() * pitch.cos(), pitch.sin(), yaw.cos() * pitch.cos()).normalize_or(Vec3::Z);
        let fov_y = 0.42_f32;
        let mut camera = Self { eye: target + from_target, target, up: Vec3::Y, fov_y };
        // Each corner needs a certain distance. Use the largest.
        let [right, up, forward] = camera.axes();
        let slope = (0.5 * fov_y).tan() * 0.92;
        let distance = (0..8)
            .map(|corner| {
                let sign = |bit: i32| if corner & bit == 0 { -1.0 } else { 1.0 };
                let offset = half * Vec3::new(sign(1), sign(2), sign(4));
                offset.dot(up).abs().max(offset.dot(right).abs()) / slope - offset.dot(forward)
            })
            .fold(0.0, f32::max);
        camera.eye = target + from_target * distance;
        camera
    }

    /// Where `point` (metres, world space) is in a picture of `width` × `height` pixels: the pixel,
    /// x to the right and y down from the upper left corner, and the depth along the view, metres.
    /// `None` for points before the near plane.
    pub fn project(&self, point: Vec3, width: u32, height: u32) -> Option<Vec3> {
        let view = View::new(self, width, height);
        let own = view.to_camera(point);
        (own.z > view.near).then(|| view.to_pixels(own).truncate().extend(own.z))
    }

    /// The point at `depth` metres along the view that is seen at `pixel`: the inverse of
    /// [`project`](Self::project).
    pub fn unproject(&self, pixel: Vec2, depth: f32, width: u32, height: u32) -> Vec3 {
        let view = View::new(self, width, height);
        let slope = (pixel - Vec2::from_array(view.centre)) / view.focal;
        view.eye + depth * (view.forward + slope.x * view.right - slope.y * view.up)
    }

    /// The unit vectors right, up and forward.
    pub(crate) fn axes(&self) -> [Vec3; 3] {
        let forward = (self.target - self.eye).normalize_or(Vec3::NEG_Z);
        let right = forward.cross(self.up).try_normalize();
        let right = right.unwrap_or_else(|| forward.any_orthonormal_vector());
        [right, right.cross(forward), forward]
    }

    /// Whether all numbers are finite and the field of view is valid.
    pub(crate) fn is_valid(&self) -> bool {
        let finite = self.eye.is_finite() && self.target.is_finite() && self.up.is_finite();
        finite && self.eye != self.target && self.fov_y > 1e-4 && self.fov_y < 3.1
    }
}

/// A camera with a picture size. It maps world space to pixels: x right, y down, (0, 0) in the
/// upper left corner.
#[derive(Clone, Debug)]
pub(crate) struct View {
    pub eye: Vec3,
    pub right: Vec3,
    pub up: Vec3,
    pub forward: Vec3,
    /// Pixels per unit of x / z or y / z.
    pub focal: f32,
    /// The centre of the picture in pixels.
    pub centre: [f32; 2],
    /// The depth of the near plane, metres.
    pub near: f32,
}

impl View {
    pub fn new(camera: &Camera, width: u32, height: u32) -> Self {
        let [right, up, forward] = camera.axes();
        let half = [width as f32 * 0.5, height as f32 * 0.5];
        // In a portrait picture the angle spans the width, so that a framed box stays visible.
        let focal = half[0].min(half[1]) / (0.5 * camera.fov_y).tan();
        let near = camera.eye.distance(camera.target) * NEAR_FRACTION;
        Self { eye: camera.eye, right, up, forward, focal, centre: half, near }
    }

    /// Maps a world point to camera space: x right, y up, z depth along the view, metres.
    pub fn to_camera(&self, point: Vec3) -> Vec3 {
        let offset = point - self.eye;
        Vec3::new(offset.dot(self.right), offset.dot(self.up), offset.dot(self.forward))
    }

    /// The pixel x, pixel y and inverse depth of a point in camera space with z > 0.
    pub fn to_pixels(&self, point: Vec3) -> Vec3 {
        let nearness = 1.0 / point.z;
        let scale = self.focal * nearness;
        Vec3::new(self.centre[0] + point.x * scale, self.centre[1] - point.y * scale, nearness)
    }

    /// The world point at pixel position (`x`, `y`) and depth 1/`nearness`.
    pub fn unproject(&self, x: f32, y: f32, nearness: f32) -> Vec3 {
        let (u, v) = ((x - self.centre[0]) / self.focal, (self.centre[1] - y) / self.focal);
        self.eye + (self.forward + self.right * u + self.up * v) / nearness
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn framing_keeps_every_corner_inside() {
        let bounds = (Vec3::new(-0.1, 1.4, -0.2), Vec3::new(0.3, 1.9, 0.1));
        for (yaw, pitch) in [(0.0, 0.0), (0.7, 0.2), (3.0, -0.5), (1.0, 1.5)] {
            let view = View::new(&Camera::framing(bounds, yaw, pitch), 300, 200);
            let mut farthest = 0.0_f32;
            for corner in 0..8 {
                let pick = |bit: usize, axis: usize| {
                    if corner & bit == 0 { bounds.0[axis] } else { bounds.1[axis] }
                };
                let p = view.to_pixels(view.to_camera(Vec3::new(pick(1, 0), pick(2, 1), pick(4, 2))));
                assert!(p.z > 0.0);
                farthest = farthest.max((p.x - 150.0).abs()).max((p.y - 100.0).abs());
            }
            assert!((85.0..100.0).contains(&farthest), "{farthest}");
        }
    }

    #[test]
    fn unproject_undoes_the_projection() {
        let view = View::new(&Camera::framing((Vec3::ZERO, Vec3::ONE), 0.4, 0.3), 640, 480);
        let point = Vec3::new(0.3, 0.8, 0.1);
        let p = view.to_pixels(view.to_camera(point));
        assert!(view.unproject(p.x, p.y, p.z).distance(point) < 1e-5);
    }

    #[test]
    fn right_is_right_and_up_is_up() {
        let view = View::new(&Camera::framing((Vec3::NEG_ONE, Vec3::ONE), 0.0, 0.0), 100, 100);
        let at = |p: Vec3| view.to_pixels(view.to_camera(p));
        assert!(at(Vec3::X).x > 50.0 && at(Vec3::Y).y < 50.0 && at(Vec3::Z).z > at(-Vec3::Z).z);
    }
}
