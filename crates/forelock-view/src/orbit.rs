//! A camera that orbits a point, as in Blender.

use forelock_render::Camera;
use glam::{Vec2, Vec3};

/// Radians for each pixel of a drag.
const TURN: f32 = 0.008;
/// How far up and down the camera goes, radians.
const STEEPEST: f32 = 1.55;

/// A camera on a sphere around a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Orbit {
    /// The middle of the picture, metres.
    pub target: Vec3,
    /// Metres from the camera to it.
    pub distance: f32,
    /// Angle around y from +z, radians.
    pub yaw: f32,
    /// Angle above the horizon, radians.
    pub pitch: f32,
    /// See [`Camera::fov_y`].
    fov_y: f32,
}

impl Orbit {
    /// The orbit on which all of `bounds` (smallest and largest corner, metres) is visible from
    /// `yaw` and `pitch`, radians.
    pub fn framing(bounds: (Vec3, Vec3), yaw: f32, pitch: f32) -> Self {
        // Straight from above, the camera's place does not tell the yaw.
        Self { yaw, pitch, ..Self::of(&Camera::framing(bounds, yaw, pitch)) }
    }

    /// The orbit of `camera` around its target.
    pub fn of(camera: &Camera) -> Self {
        let Camera { eye, target, fov_y, .. } = *camera;
        let back = eye - target;
        let (yaw, pitch) = (back.x.atan2(back.z), back.y.atan2(back.x.hypot(back.z)));
        let pitch = pitch.clamp(-STEEPEST, STEEPEST);
        Self { target, distance: back.length().max(1e-3), yaw, pitch, fov_y }
    }

    /// The camera.
    pub fn camera(&self) -> Camera {
        let [sin_yaw, cos_yaw] = [self.yaw.sin(), self.yaw.cos()];
        let direction = Vec3::new(sin_yaw * self.pitch.cos(), self.pitch.sin(), cos_yaw * self.pitch.cos());
        Camera {
            eye: self.target + self.distance * direction,
            target: self.target,
            up: Vec3::Y,
            fov_y: self.fov_y,
        }
    }

    /// Turns by a drag of `pixels`.
    pub fn turn(&mut self, pixels: Vec2) {
        self.yaw -= TURN * pixels.x;
        self.pitch = (self.pitch + TURN * pixels.y).clamp(-STEEPEST, STEEPEST);
    }

    /// Moves the target by a drag of `pixels` in a picture of `width` × `height` pixels.
    pub fn pan(&mut self, pixels: Vec2, width: u32, height: u32) {
        self.target -= self.shift(pixels, self.distance, width, height);
    }

    /// What a drag of `pixels` is at `depth`, metres.
    pub fn shift(&self, pixels: Vec2, depth: f32, width: u32, height: u32) -> Vec3 {
        let at = |pixel| self.camera().unproject(pixel, depth, width, height);
        at(pixels) - at(Vec2::ZERO)
    }

    /// Goes nearer for positive `notches` of a wheel, by a tenth each.
    pub fn zoom(&mut self, notches: f32) {
        self.distance = (self.distance * 0.9_f32.powf(notches.clamp(-50.0, 50.0))).clamp(1e-3, 1e4);
    }

    /// Looks at all of `bounds` from the same side.
    pub fn frame(&mut self, bounds: (Vec3, Vec3)) {
        *self = Self::framing(bounds, self.yaw, self.pitch);
    }

    /// Looks from the angles `yaw` and `pitch`, degrees.
    pub fn look_from(&mut self, yaw: f32, pitch: f32) {
        (self.yaw, self.pitch) = (yaw.to_radians(), pitch.to_radians());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn orbit() -> Orbit {
        Orbit::framing((Vec3::splat(-0.2), Vec3::splat(0.2)), 0.4, 0.1)
    }

    #[test]
    fn a_drag_moves_the_target_with_the_pointer() {
        let before = orbit();
        let mut after = before;
        after.pan(Vec2::new(30.0, -12.0), 640, 480);
        let seen = after.camera().project(before.target, 640, 480).unwrap();
        assert!((seen.truncate() - Vec2::new(350.0, 228.0)).length() < 1e-2, "{seen}");
    }

    #[test]
    fn the_orbit_of_a_camera_has_it() {
        let orbit = orbit();
        let found = Orbit::of(&orbit.camera());
        assert!((found.yaw - orbit.yaw).abs() < 1e-5 && (found.pitch - orbit.pitch).abs() < 1e-5);
        assert!((found.distance - orbit.distance).abs() < 1e-5 && found.target == orbit.target);
    }

    #[test]
    fn the_camera_never_turns_over() {
        let mut orbit = orbit();
        for _ in 0..100 {
            orbit.turn(Vec2::new(70.0, 400.0));
            orbit.zoom(9.0);
        }
        let camera = orbit.camera();
        assert!(orbit.pitch < 1.56 && camera.eye != camera.target && camera.eye.is_finite());
    }
}
