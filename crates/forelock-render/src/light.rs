//! Lights.

use glam::{Quat, Vec3};

use crate::camera::Camera;

/// A light as far away as the sun.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light {
    /// Towards the light; normalised when used.
    pub direction: Vec3,
    /// Its radiance on a surface that faces it, linear RGB.
    pub colour: Vec3,
    /// Whether bodies and hair block it.
    pub shadows: bool,
}

impl Light {
    /// Key, fill and rim as a portrait studio sets them, turned with the camera about the vertical: every side that
    /// is pictured is lit alike.
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

/// Light from all around: one colour from above that blends into another from below, linear RGB.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ambient {
    /// From straight above.
    pub sky: Vec3,
    /// From straight below.
    pub ground: Vec3,
}

impl Default for Ambient {
    fn default() -> Self {
        Self { sky: Vec3::new(0.34, 0.37, 0.42), ground: Vec3::new(0.12, 0.11, 0.10) }
    }
}

impl Ambient {
    /// What a surface of normal `normal` gathers.
    pub(crate) fn at(&self, normal: Vec3) -> Vec3 {
        self.ground.lerp(self.sky, 0.5 + 0.5 * normal.y)
    }
}
