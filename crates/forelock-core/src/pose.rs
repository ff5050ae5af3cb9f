//! Rigid poses: the position and orientation of the head, a collider or a root frame at one
//! instant.

use glam::{DMat3, DQuat, DVec3};

/// A rigid transform `x ↦ R x + p`, stored in float64 so that interpolation inside a frame loses no
/// precision.
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
    /// The identity pose.
    pub const IDENTITY: Self = Self { rotation: DQuat::IDENTITY, translation: DVec3::ZERO };

    /// The pose with rotation `rotation` (normalised here) and translation `translation` in metres.
    pub fn new(rotation: DQuat, translation: DVec3) -> Self {
        Self { rotation: rotation.normalize(), translation }
    }

    /// Interpolates from `self` (`fraction` 0) to `to` (`fraction` 1): linear in the translation,
    /// spherical linear along the shorter arc in the rotation. Fractions 0 and 1 return the end
    /// poses exactly.
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

    /// Transforms a point: `R point + p`.
    pub fn transform_point(&self, point: DVec3) -> DVec3 {
        self.rotation * point + self.translation
    }

    /// Transforms a vector, ignoring the translation: `R vector`.
    pub fn transform_vector(&self, vector: DVec3) -> DVec3 {
        self.rotation * vector
    }

    /// The inverse pose.
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.conjugate();
        Self { rotation, translation: -(rotation * self.translation) }
    }

    /// Composition: the pose that applies `first` and then `self`, `x ↦ self(first(x))`.
    pub fn after(&self, first: &Self) -> Self {
        Self {
            rotation: (self.rotation * first.rotation).normalize(),
            translation: self.transform_point(first.translation),
        }
    }

    /// The rotation R as a matrix.
    pub fn matrix(&self) -> DMat3 {
        DMat3::from_quat(self.rotation)
    }

    /// Whether every component is finite.
    pub fn is_finite(&self) -> bool {
        self.rotation.is_finite() && self.translation.is_finite()
    }
}

/// Spherical linear interpolation, exact to rounding for nearly equal quaternions too. Falling back
/// to linear interpolation there would cause an error of 1e-9 of a turn, more than the golden files
/// allow.
pub(crate) fn slerp(from: DQuat, to: DQuat, fraction: f64) -> DQuat {
    let to = if from.dot(to) < 0.0 { -to } else { to };
    // The angle is computed from the chord lengths: `acos(dot)` would lose half the digits for
    // small angles.
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
    fn interpolation_rotates_at_constant_speed() {
        let to = Pose::new(DQuat::from_axis_angle(DVec3::Y, 1.2), DVec3::new(1.0, 2.0, 3.0));
        let mid = Pose::IDENTITY.interpolate(&to, 0.25);
        assert!((mid.rotation.to_axis_angle().1 - 0.3).abs() < 1e-12);
        assert!((mid.translation - to.translation * 0.25).length() < 1e-15);
        assert_eq!(Pose::IDENTITY.interpolate(&to, 1.0), to);
    }

    #[test]
    fn a_pose_after_its_inverse_is_the_identity() {
        let pose =
            Pose::new(DQuat::from_euler(glam::EulerRot::XYZ, 0.3, -1.0, 2.0), DVec3::new(1.0, -4.0, 0.5));
        let p = DVec3::new(0.3, 0.7, -0.2);
        assert!((pose.inverse().transform_point(pose.transform_point(p)) - p).length() < 1e-14);
        let both = pose.inverse().after(&pose);
        assert!((both.transform_point(p) - p).length() < 1e-14);
    }
}
