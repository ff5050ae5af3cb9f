//! Rigid poses: where the head, a collider or a root frame is at one instant.

use glam::{DMat3, DQuat, DVec3};

/// A rigid transform `x ↦ R x + p`, in float64 so that interpolating inside a frame costs no precision.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Pose {
    /// R, a unit quaternion.
    pub rotation: DQuat,
    /// p, in metres.
    pub translation: DVec3,
}

impl Default for Pose {
    fn default() -> Self {
        Self::IDENTITY
    }
}

impl Pose {
    /// The pose that moves nothing.
    pub const IDENTITY: Self = Self { rotation: DQuat::IDENTITY, translation: DVec3::ZERO };

    /// The pose with rotation `rotation` (normalised here) and translation `translation` in metres.
    pub fn new(rotation: DQuat, translation: DVec3) -> Self {
        Self { rotation: rotation.normalize(), translation }
    }

    /// The pose `fraction` of the way from `self` (0) to `to` (1): translation linear, rotation spherical along
    /// the shorter arc. 0 and 1 give the end poses exactly.
    pub fn interpolate(&self, to: &Self, fraction: f64) -> Self {
        if fraction <= 0.0 {
            return *self;
        }
        if fraction >= 1.0 {
            return *to;
        }
        Self {
            rotation: slerp(self.rotation, to.rotation, fraction),
            translation: self.translation + (to.translation - self.translation) * fraction,
        }
    }

    /// `R point + p`.
    pub fn transform_point(&self, point: DVec3) -> DVec3 {
        self.rotation * point + self.translation
    }

    /// `R vector`.
    pub fn transform_vector(&self, vector: DVec3) -> DVec3 {
        self.rotation * vector
    }

    /// The pose that undoes this one.
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.conjugate();
        Self { rotation, translation: -(rotation * self.translation) }
    }

    /// This pose after `first`: `x ↦ self(first(x))`.
    pub fn after(&self, first: &Self) -> Self {
        Self {
            rotation: (self.rotation * first.rotation).normalize(),
            translation: self.transform_point(first.translation),
        }
    }

    /// R as a matrix.
    pub fn matrix(&self) -> DMat3 {
        DMat3::from_quat(self.rotation)
    }

    /// Whether every component is finite.
    pub fn is_finite(&self) -> bool {
        self.rotation.is_finite() && self.translation.is_finite()
    }
}

/// Spherical interpolation that is exact to rounding for near-equal quaternions too (a chord instead of an arc
/// there would err by 1e-9 of a turn, more than the golden files allow).
fn slerp(from: DQuat, to: DQuat, fraction: f64) -> DQuat {
    let to = if from.dot(to) < 0.0 { -to } else { to };
    // The angle from the chords, which keeps its precision where acos(dot) loses half the digits.
    let angle = 2.0 * (to - from).length().atan2((to + from).length());
    if angle < 1e-9 {
        return (from + (to - from) * fraction).normalize();
    }
    let sin = angle.sin();
    (from * (((1.0 - fraction) * angle).sin() / sin) + to * ((fraction * angle).sin() / sin)).normalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn interpolation_is_uniform_rotation() {
        let to = Pose::new(DQuat::from_axis_angle(DVec3::Y, 1.2), DVec3::new(1.0, 2.0, 3.0));
        let mid = Pose::IDENTITY.interpolate(&to, 0.25);
        assert!((mid.rotation.to_axis_angle().1 - 0.3).abs() < 1e-12);
        assert!((mid.translation - to.translation * 0.25).length() < 1e-15);
        assert_eq!(Pose::IDENTITY.interpolate(&to, 1.0), to);
    }

    #[test]
    fn inverse_undoes() {
        let pose =
            Pose::new(DQuat::from_euler(glam::EulerRot::XYZ, 0.3, -1.0, 2.0), DVec3::new(1.0, -4.0, 0.5));
        let p = DVec3::new(0.3, 0.7, -0.2);
        assert!((pose.inverse().transform_point(pose.transform_point(p)) - p).length() < 1e-14);
        let both = pose.inverse().after(&pose);
        assert!((both.transform_point(p) - p).length() < 1e-14);
    }
}
