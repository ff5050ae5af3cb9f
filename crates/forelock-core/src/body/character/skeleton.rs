//! A tree of joints and its poses.

use glam::{DAffine3, DMat3, DQuat, DVec3};

/// Translation, rotation and scale of a joint relative to its parent: x ↦ t + R (s ∘ x).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transform {
    /// t, metres after import.
    pub translation: DVec3,
    /// R, a unit quaternion.
    pub rotation: DQuat,
    /// s, no unit.
    pub scale: DVec3,
}

impl Default for Transform {
    fn default() -> Self {
        Self::IDENTITY
    }
}

impl Transform {
    /// The identity.
    pub const IDENTITY: Self =
        Self { translation: DVec3::ZERO, rotation: DQuat::IDENTITY, scale: DVec3::ONE };

    /// The same map as a matrix and a translation.
    pub fn affine(&self) -> DAffine3 {
        DAffine3::from_scale_rotation_translation(self.scale, self.rotation, self.translation)
    }

    /// The translation, rotation and scale of `affine`; what they cannot express (shear) is lost.
    pub fn of(affine: &DAffine3) -> Self {
        let rotation = nearest_rotation(&affine.matrix3);
        let turned_back = DMat3::from_quat(rotation.conjugate()) * affine.matrix3;
        let scale = DVec3::new(turned_back.x_axis.x, turned_back.y_axis.y, turned_back.z_axis.z);
        Self { translation: affine.translation, rotation, scale }
    }

    /// Linear interpolation of translation and scale and spherical linear interpolation, along the
    /// shorter arc, of the rotation: `self` at `share` 0, `to` at 1.
    #[must_use]
    pub fn interpolate(&self, to: &Self, share: f64) -> Self {
        Self {
            translation: self.translation.lerp(to.translation, share),
            rotation: crate::pose::slerp(self.rotation, to.rotation, share),
            scale: self.scale.lerp(to.scale, share),
        }
    }
}

/// The rotation of the orthonormal axes that Gram and Schmidt make of the columns of `matrix`, the
/// first first. Columns without a direction are completed by any normal ones.
pub(crate) fn nearest_rotation(matrix: &DMat3) -> DQuat {
    let x = matrix.x_axis.try_normalize();
    let [x, y] = match (x, matrix.y_axis.try_normalize()) {
        (Some(x), Some(y)) => [x, y],
        (Some(x), None) => [x, matrix.z_axis.cross(x)],
        (None, Some(y)) => [y.cross(matrix.z_axis), y],
        (None, None) => return DQuat::IDENTITY,
    };
    let x = x.try_normalize().unwrap_or_else(|| y.normalize_or(DVec3::Y).any_orthonormal_vector());
    let y = (y - x * x.dot(y)).try_normalize().unwrap_or_else(|| x.any_orthonormal_vector());
    DQuat::from_mat3(&DMat3::from_cols(x, y, x.cross(y))).normalize()
}

/// A joint of a skeleton.
#[derive(Clone, Debug, PartialEq)]
pub struct Joint {
    /// Its name; need not be unique.
    pub name: String,
    /// Its parent, an earlier joint; none for a root.
    pub parent: Option<usize>,
    /// Its transform at rest.
    pub rest: Transform,
}

/// A tree of joints, parents before children.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Skeleton {
    joints: Vec<Joint>,
    /// What the roots' parent would be: the import's change of axes and units.
    base: DAffine3,
}

/// Why joints are not a skeleton.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SkeletonError {
    /// A parent is the joint itself or comes after it.
    #[error("joint {joint} ({name}) comes before its parent {parent}")]
    Order {
        /// The joint.
        joint: usize,
        /// Its name.
        name: String,
        /// Its parent.
        parent: usize,
    },
    /// A transform at rest has a number that is not finite.
    #[error("the rest transform of joint {joint} ({name}) is not finite")]
    NonFinite {
        /// The joint.
        joint: usize,
        /// Its name.
        name: String,
    },
}

impl Skeleton {
    /// A skeleton of `joints`, each of which comes after its parent.
    ///
    /// # Errors
    /// [`SkeletonError`] if one does not, or its rest transform is not finite.
    pub fn new(joints: Vec<Joint>) -> Result<Self, SkeletonError> {
        for (joint, own) in joints.iter().enumerate() {
            if let Some(parent) = own.parent.filter(|&parent| parent >= joint) {
                return Err(SkeletonError::Order { joint, name: own.name.clone(), parent });
            }
            let rest = &own.rest;
            if !(rest.translation.is_finite() && rest.rotation.is_finite() && rest.scale.is_finite()) {
                return Err(SkeletonError::NonFinite { joint, name: own.name.clone() });
            }
        }
        Ok(Self { joints, base: DAffine3::IDENTITY })
    }

    /// The joints, parents before children.
    pub fn joints(&self) -> &[Joint] {
        &self.joints
    }

    /// The first joint called `name`; upper and lower case are the same where no other one fits.
    pub fn find(&self, name: &str) -> Option<usize> {
        let exact = self.joints.iter().position(|joint| joint.name == name);
        exact.or_else(|| self.joints.iter().position(|joint| joint.name.eq_ignore_ascii_case(name)))
    }

    /// Transforms the whole skeleton by `map`, before all else.
    pub(crate) fn transform(&mut self, map: &DAffine3) {
        self.base = *map * self.base;
    }

    /// The transforms at rest, one a joint.
    pub fn rest(&self) -> Vec<Transform> {
        self.joints.iter().map(|joint| joint.rest).collect()
    }

    /// Replaces `globals` by the joints' transforms to the body's space, of `locals` relative to
    /// their parents.
    ///
    /// # Panics
    /// If `locals` are fewer than the joints.
    pub fn globals(&self, locals: &[Transform], globals: &mut Vec<DAffine3>) {
        globals.clear();
        for (joint, local) in self.joints.iter().zip(&locals[..self.joints.len()]) {
            let parent = joint.parent.map_or(self.base, |parent| globals[parent]);
            globals.push(parent * local.affine());
        }
    }

    /// The joints' transforms to the body's space at rest.
    pub fn rest_globals(&self) -> Vec<DAffine3> {
        let mut globals = Vec::new();
        self.globals(&self.rest(), &mut globals);
        globals
    }

    /// Whether `joint` is `ancestor` or one of its descendants.
    pub fn descends(&self, joint: usize, ancestor: usize) -> bool {
        let mut at = Some(joint);
        while let Some(here) = at {
            if here == ancestor {
                return true;
            }
            at = self.joints[here].parent;
        }
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn joint(name: &str, parent: Option<usize>, translation: DVec3) -> Joint {
        Joint { name: name.into(), parent, rest: Transform { translation, ..Transform::IDENTITY } }
    }

    #[test]
    fn children_follow_their_parents() {
        let joints =
            vec![joint("a", None, DVec3::X), joint("b", Some(0), DVec3::Y), joint("c", Some(1), DVec3::Y)];
        let skeleton = Skeleton::new(joints).unwrap();
        let mut locals = skeleton.rest();
        locals[1].rotation = DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2);
        let mut globals = Vec::new();
        skeleton.globals(&locals, &mut globals);
        assert!((globals[2].translation - DVec3::new(0.0, 1.0, 0.0)).length() < 1e-15);
        assert!(skeleton.descends(2, 0) && skeleton.descends(1, 1) && !skeleton.descends(0, 1));
        assert_eq!((skeleton.find("B"), skeleton.find("d")), (Some(1), None));
    }

    #[test]
    fn joints_before_their_parents_are_refused() {
        let error = Skeleton::new(vec![joint("a", Some(0), DVec3::X)]).unwrap_err();
        assert_eq!(error.to_string(), "joint 0 (a) comes before its parent 0");
        let error = Skeleton::new(vec![joint("a", None, DVec3::NAN)]).unwrap_err();
        assert!(error.to_string().contains("not finite"));
    }

    #[test]
    fn a_matrix_without_shear_is_a_transform() {
        let own = Transform {
            translation: DVec3::new(1.0, 2.0, 3.0),
            rotation: DQuat::from_euler(glam::EulerRot::XYZ, 0.3, -1.0, 2.0),
            scale: DVec3::new(2.0, 3.0, -0.5),
        };
        let back = Transform::of(&own.affine());
        assert!(own.affine().abs_diff_eq(back.affine(), 1e-12));
        let flat = DMat3::from_cols(DVec3::ZERO, DVec3::Y, DVec3::ZERO);
        for degenerate in [DMat3::ZERO, flat, DMat3::from_cols(DVec3::X, DVec3::X, DVec3::X)] {
            let rotation = nearest_rotation(&degenerate);
            assert!(rotation.is_normalized() && rotation.is_finite());
        }
    }
}
