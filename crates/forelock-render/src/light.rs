//! Directional and ambient lights.

use glam::{Quat, Vec3};

use crate::camera::Camera;

/// A directional light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light {
    /// The direction towards the light. It need not be normalised.
    pub direction: Vec3,
    /// The radiance on a surface that faces the light, linear RGB.
    pub colour: Vec3,
    /// Whether bodies and hair cast shadows in this light.
    pub shadows: bool,
}

impl Light {
    /// Key, fill and rim light of a portrait studio. They turn about the vertical axis with the
    /// camera, so the lighting is the same from all sides.
    pub fn studio(camera: &Camera) -> Vec<Self> {
        let to_camera = camera.eye - camera.target;
        let turn = Quat::from_rotation_y(to_camera.x.atan2(to_camera.z));
        let from = |x: f32, y: f32, z: f32| turn * Vec3::new(x, y, z).normalize();
        vec![
            Self { direction: from(-0.62, 0.85, 0.80), colour: Vec3::new(2.0, 1.9, 1.76), shadows: true },
            Self { direction: from(0.95, 0.15, 0.60), colour: Vec3::new(0.42, 0.46, 0.53), shadows: true },
            Self { direction: from(0.65, 0.80, -0.85), colour: Vec3::new(1.5, 1.56, 1.68), shadows: true },
        ]
    }
}

/// Ambient light: one colour from above that blends into another from below, linear RGB.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ambient {
    /// The colour from straight above.
    pub sky: Vec3,
    /// The colour from straight below.
    pub ground: Vec3,
}

impl Default for Ambient {
    fn default() -> Self {
        Self { sky: Vec3::new(0.34, 0.37, 0.42), ground: Vec3::new(0.12, 0.11, 0.10) }
    }
}

impl Ambient {
    /// The light that a surface with the normal `normal` receives.
    pub(crate) fn at(&self, normal: Vec3) -> Vec3 {
        self.ground.lerp(self.sky, 0.5 + 0.5 * normal.y)
    }
}
