//! Colliders: solids described by signed distances in local space, and their poses during a frame.
//!
//! # Theory
//! The distance σ to a primitive is exact inside and outside, so |∇σ| = 1 wherever the nearest
//! surface point is unique (the eikonal equation). Where it is not unique (the centre of a sphere,
//! the medial planes of a box), a fixed rule selects one of the nearest surface points, so that the
//! direction is never zero.
//!
//! # Practice
//! Shapes are defined in local space, in metres; a rigid [`Pose`] places them. A rigid transform
//! preserves distances, so a solver transforms its point to local space, samples the distance there
//! and rotates the gradient back.

use std::sync::Arc;

use glam::{DVec3, Vec3};
use num_traits::Float;

use super::{BendingField, Morph, Sdf};
use crate::pose::Pose;

/// A solid in local space, in metres, y up.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// A ball centred at the origin.
    Sphere {
        /// Radius in metres.
        radius: f64,
    },
    /// Everything outside a ball centred at the origin: hair is kept inside the ball.
    HollowSphere {
        /// Radius in metres.
        radius: f64,
    },
    /// All points within `radius` of the segment from (0, −`half_length`, 0) to (0, `half_length`,
    /// 0).
    Capsule {
        /// Half the length of the segment in metres, without the caps.
        half_length: f64,
        /// Radius in metres.
        radius: f64,
    },
    /// An axis-aligned box centred at the origin.
    Box {
        /// Half the size along each axis in metres.
        half_extents: DVec3,
    },
    /// The half-space y ≤ 0.
    Plane,
    /// A distance field on a grid, in metres. It is sampled in float32, whatever the solver's
    /// precision.
    Sdf(Arc<Sdf>),
    /// A sequence of distance fields that are blended during the frame; also sampled in float32.
    Morph {
        /// The sequence.
        morph: Arc<Morph>,
        /// Positions in the sequence at the frame's start and end, counted in fields from the
        /// first.
        phases: [f64; 2],
    },
    /// The field of a body that bends, which moves from one pose to another during the frame; also
    /// sampled in float32.
    Bending(Arc<BendingField>),
}

/// Number of points that are sampled together.
pub const PACKET: usize = 8;

impl Shape {
    /// The signed distance in metres from `p` to the surface (negative inside) and its outward unit
    /// gradient. A shape that changes is sampled at the frame's end.
    ///
    /// The result is exact for the primitives. For [`Shape::Sdf`] the accuracy is that of
    /// [`Sdf::sample`], with the gradient normalised. For [`Shape::Bending`] the gradient is
    /// shorter than 1 where two parts press into each other and no direction leads out.
    #[inline]
    pub fn sample<T: Float>(&self, p: [T; 3]) -> (T, [T; 3]) {
        self.sample_at(p, 1.0)
    }

    /// [`Shape::sample`] at `fraction` of the frame, which matters for shapes that change.
    #[inline]
    pub fn sample_at<T: Float>(&self, p: [T; 3], fraction: f64) -> (T, [T; 3]) {
        match self {
            Self::Sphere { radius } => {
                let (length, direction) = unit(p);
                (length - cast(*radius), direction)
            }
            Self::HollowSphere { radius } => {
                let (length, direction) = unit(p);
                (cast::<T>(*radius) - length, direction.map(|d| -d))
            }
            Self::Capsule { half_length, radius } => {
                let h = cast::<T>(*half_length);
                let (length, direction) = unit([p[0], p[1] - p[1].min(h).max(-h), p[2]]);
                (length - cast(*radius), direction)
            }
            Self::Box { half_extents } => sample_box(half_extents.to_array().map(cast), p),
            Self::Plane => (p[1], [T::zero(), T::one(), T::zero()]),
            Self::Sdf(sdf) => {
                let (distance, gradient) = sdf.sample(to_vec3(p));
                from_field(distance, gradient)
            }
            Self::Morph { morph, phases: [from, to] } => {
                let (distance, gradient) = morph.sample(to_vec3(p), from + (to - from) * fraction);
                from_field(distance, gradient)
            }
            Self::Bending(field) => sample_bending(field, p, fraction),
        }
    }

    /// The side of the cells near the surface in metres, if the shape is a field.
    pub fn cell(&self) -> Option<f32> {
        match self {
            Self::Sdf(sdf) => Some(sdf.near_cell()),
            Self::Morph { morph, .. } => Some(morph.cell()),
            Self::Bending(field) => Some(field.cell()),
            _ => None,
        }
    }

    /// Half the thickness of the thinnest part in metres, as far as it is known: a point that moves
    /// less than this cannot pass through the solid. For a field it is an assumption
    /// ([`Sdf::thinness`]).
    pub fn thinness(&self) -> f64 {
        match self {
            Self::Sphere { radius } | Self::Capsule { radius, .. } => *radius,
            Self::Box { half_extents } => half_extents.min_element(),
            Self::HollowSphere { .. } | Self::Plane => f64::INFINITY,
            Self::Sdf(sdf) => sdf.thinness().into(),
            Self::Morph { morph, .. } => morph.thinness().into(),
            Self::Bending(field) => field.thinness().into(),
        }
    }

    /// [`Shape::sample_at`] for a packet of points, component-major. The results are bit-identical
    /// to those of single points.
    #[inline(always)]
    pub fn sample_packet<T: Float>(
        &self,
        p: &[[T; PACKET]; 3],
        fraction: f64,
    ) -> ([T; PACKET], [[T; PACKET]; 3]) {
        if let Self::Bending(field) = self {
            return sample_bending_packet(field, p, fraction);
        }
        let (mut distances, mut gradients) = ([T::zero(); PACKET], [[T::zero(); PACKET]; 3]);
        let Self::Sdf(sdf) = self else {
            for k in 0..PACKET {
                let (distance, gradient) = self.sample_at([p[0][k], p[1][k], p[2][k]], fraction);
                distances[k] = distance;
                for c in 0..3 {
                    gradients[c][k] = gradient[c];
                }
            }
            return (distances, gradients);
        };
        let mut at = [[0.0; PACKET]; 3];
        for c in 0..3 {
            for k in 0..PACKET {
                at[c][k] = p[c][k].to_f32().unwrap_or(f32::NAN);
            }
        }
        let (values, slopes) = sdf.sample_lanes(at);
        let to_t = |c: f32| T::from(c).unwrap_or_else(T::nan);
        for k in 0..PACKET {
            let [x, y, z] = [slopes[0][k], slopes[1][k], slopes[2][k]];
            let unit = 1.0 / (x * x + y * y + z * z).sqrt();
            distances[k] = to_t(values[k]);
            gradients[0][k] = to_t(x * unit);
            gradients[1][k] = to_t(y * unit);
            gradients[2][k] = to_t(z * unit);
        }
        (distances, gradients)
    }

    /// [`Shape::sample`] if the distance may be at most `reach` metres; `None` if it is certainly
    /// greater. For a field a small table is read first ([`Sdf::sample_near`]), which halves the
    /// cost for hair at rest on a head.
    #[inline]
    pub fn sample_near<T: Float>(&self, p: [T; 3], reach: T) -> Option<(T, [T; 3])> {
        if let Self::Sdf(sdf) = self {
            let reach = reach.to_f32().unwrap_or(f32::INFINITY);
            let found = sdf.sample_near(to_vec3(p), reach);
            return found.map(|(distance, gradient)| from_field(distance, gradient));
        }
        if let Self::Bending(field) = self {
            return sample_bending_near(field, p, reach);
        }
        Some(self.sample(p)).filter(|(distance, _)| *distance <= reach)
    }

    /// The smallest known axis-aligned box that contains the solid, (min, max) in local metres,
    /// rounded outwards; `None` for an unbounded solid.
    pub fn bounds(&self) -> Option<(Vec3, Vec3)> {
        let half = match self {
            Self::Sphere { radius } => DVec3::splat(*radius),
            Self::Capsule { half_length, radius } => DVec3::new(*radius, half_length + radius, *radius),
            Self::Box { half_extents } => *half_extents,
            Self::HollowSphere { .. } | Self::Plane => return None,
            Self::Sdf(sdf) => return Some(sdf.bounds()),
            Self::Morph { morph, .. } => return Some(morph.bounds()),
            Self::Bending(field) => return Some(field.bounds()),
        };
        let half = half.as_vec3() * (1.0 + f32::EPSILON);
        Some((-half, half))
    }
}

/// A solid in a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct Collider {
    /// The shape.
    pub shape: Shape,
    /// Coulomb friction coefficient μ; no unit, 0 is frictionless.
    pub friction: f64,
    /// The space in which `pose` is given.
    pub attachment: Attachment,
    /// The pose of the shape in the space of `attachment`, unless a motion replaces it.
    pub pose: Pose,
}

/// The space to which a collider is attached.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "kebab-case"))]
pub enum Attachment {
    /// The collider is fixed in the world.
    #[default]
    World,
    /// The collider moves with the head.
    Head,
}

impl Collider {
    /// The collider during a frame in which the head moves from `head_from` to `head_to`.
    pub fn frame(&self, head_from: &Pose, head_to: &Pose) -> ColliderFrame<'_> {
        let (from, to) = match self.attachment {
            Attachment::World => (Pose::IDENTITY, Pose::IDENTITY),
            Attachment::Head => (*head_from, *head_to),
        };
        ColliderFrame { shape: &self.shape, local: self.pose, from, to, friction: self.friction }
    }
}

/// A solid during one frame. It is attached to a carrier that moves from pose `from` to pose `to`.
///
/// The carrier's pose and the local pose are stored separately. If their product were interpolated,
/// a solid far from the carrier's origin would move along the chord instead of the arc, away from
/// the hair that moves with the same carrier.
#[derive(Clone, Copy, Debug)]
pub struct ColliderFrame<'a> {
    /// The shape, in local space.
    pub shape: &'a Shape,
    /// Carrier from local: the pose of the shape in the carrier's space.
    pub local: Pose,
    /// World from carrier at the frame's start.
    pub from: Pose,
    /// World from carrier at the frame's end.
    pub to: Pose,
    /// Coulomb friction coefficient μ.
    pub friction: f64,
}

impl ColliderFrame<'_> {
    /// World from local, at `fraction` of the frame.
    pub fn pose(&self, fraction: f64) -> Pose {
        self.from.interpolate(&self.to, fraction).after(&self.local)
    }
}

/// Converts a constant to the caller's precision.
#[inline]
fn cast<T: Float>(value: f64) -> T {
    T::from(value).unwrap_or_else(T::nan)
}

#[inline]
fn to_vec3<T: Float>(p: [T; 3]) -> Vec3 {
    Vec3::from_array(p.map(|c| c.to_f32().unwrap_or(f32::NAN)))
}

/// [`Shape::sample_at`] of a body that bends. Like the next two not inlined, so that rigid shapes
/// are sampled as fast as without it.
#[inline(never)]
fn sample_bending<T: Float>(field: &BendingField, p: [T; 3], fraction: f64) -> (T, [T; 3]) {
    let (distance, gradient) = field.sample(to_vec3(p), fraction);
    from_bending_field(distance, gradient)
}

/// [`Shape::sample_near`] of a body that bends.
#[inline(never)]
fn sample_bending_near<T: Float>(field: &BendingField, p: [T; 3], reach: T) -> Option<(T, [T; 3])> {
    let reach = reach.to_f32().unwrap_or(f32::INFINITY);
    let found = field.end().sample_near(to_vec3(p), reach);
    found.map(|(distance, gradient)| from_bending_field(distance, gradient))
}

/// [`Shape::sample_packet`] of a body that bends.
#[inline(never)]
fn sample_bending_packet<T: Float>(
    field: &BendingField,
    p: &[[T; PACKET]; 3],
    fraction: f64,
) -> ([T; PACKET], [[T; PACKET]; 3]) {
    let at = p.map(|row| row.map(|c| c.to_f32().unwrap_or(f32::NAN)));
    let to_t = |c: f32| T::from(c).unwrap_or_else(T::nan);
    let (values, slopes) = field.sample_packet(at, fraction);
    let [x, y, z] = slopes;
    let unit: [f32; PACKET] = std::array::from_fn(|k| shorten(Vec3::new(x[k], y[k], z[k])));
    let gradients = slopes.map(|row| std::array::from_fn(|k| to_t(row[k] * unit[k])));
    (values.map(to_t), gradients)
}

/// The factor that makes `gradient` a unit vector, or a shorter one where the field is flat: where
/// two surfaces of a body press into each other, no direction leads out.
#[inline(always)]
fn shorten(gradient: Vec3) -> f32 {
    1.0 / gradient.length().max(FLAT_GRADIENT)
}

/// Gradients of a body that bends are shorter than 1 where the field's are shorter than this.
pub const FLAT_GRADIENT: f32 = 0.5;

/// Converts a sample of the field of a body that bends to the caller's precision.
#[inline]
fn from_bending_field<T: Float>(distance: f32, gradient: Vec3) -> (T, [T; 3]) {
    let to_t = |c: f32| T::from(c).unwrap_or_else(T::nan);
    (to_t(distance), (gradient * shorten(gradient)).to_array().map(to_t))
}

/// Converts a sample of a field to the caller's precision and normalises its gradient.
#[inline]
fn from_field<T: Float>(distance: f32, gradient: Vec3) -> (T, [T; 3]) {
    let to_t = |c: f32| T::from(c).unwrap_or_else(T::nan);
    (to_t(distance), (gradient * gradient.length_recip()).to_array().map(to_t))
}

/// Length and direction of `v`; the direction of the zero vector is +y.
#[inline]
fn unit<T: Float>(v: [T; 3]) -> (T, [T; 3]) {
    let length = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
    if length > T::min_positive_value() {
        (length, v.map(|c| c / length))
    } else {
        (T::zero(), [T::zero(), T::one(), T::zero()])
    }
}

/// Distance to a box of `half` extents: to the nearest point if `p` is outside, to the nearest face
/// if it is inside.
#[inline]
fn sample_box<T: Float>(half: [T; 3], p: [T; 3]) -> (T, [T; 3]) {
    let sign = |c: T| if c < T::zero() { -T::one() } else { T::one() };
    let q: [T; 3] = std::array::from_fn(|axis| p[axis].abs() - half[axis]);
    let (length, direction) = unit(q.map(|c| c.max(T::zero())));
    if length > T::zero() {
        return (length, std::array::from_fn(|axis| sign(p[axis]) * direction[axis]));
    }
    // If several faces are equally near, y is preferred to x and x to z.
    let face = [0, 2].into_iter().fold(1, |best, axis| if q[axis] > q[best] { axis } else { best });
    (q[face], std::array::from_fn(|axis| if axis == face { sign(p[axis]) } else { T::zero() }))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn primitives() -> Vec<Shape> {
        vec![
            Shape::Sphere { radius: 0.3 },
            Shape::HollowSphere { radius: 0.9 },
            Shape::Capsule { half_length: 0.2, radius: 0.1 },
            Shape::Box { half_extents: DVec3::new(0.2, 0.3, 0.5) },
            Shape::Plane,
        ]
    }

    /// Points of an irrational lattice, which avoids all medial sets of the shapes above.
    fn points() -> impl Iterator<Item = [f64; 3]> {
        (1..400).map(|i| {
            let i = f64::from(i);
            [0.754_877_666, 0.569_840_291, 0.430_159_709].map(|step| (i * step).fract() * 1.6 - 0.8)
        })
    }

    #[test]
    fn gradients_have_unit_length_and_are_the_derivative() {
        let h = 1e-6;
        for shape in primitives() {
            for p in points() {
                let (_, gradient) = shape.sample(p);
                let length = gradient.iter().map(|g| g * g).sum::<f64>().sqrt();
                assert!((length - 1.0).abs() < 1e-12, "{shape:?} at {p:?}: |gradient| = {length}");
                for axis in 0..3 {
                    let moved = |by: f64| {
                        let mut q = p;
                        q[axis] += by;
                        shape.sample(q).0
                    };
                    let slope = (moved(h) - moved(-h)) / (2.0 * h);
                    assert!((slope - gradient[axis]).abs() < 1e-5, "{shape:?} at {p:?}, axis {axis}");
                }
            }
        }
    }

    #[test]
    fn stepping_by_the_distance_lands_on_the_surface() {
        for shape in primitives() {
            for p in points() {
                let (distance, n) = shape.sample(p);
                let foot = std::array::from_fn(|axis| p[axis] - distance * n[axis]);
                assert!(shape.sample(foot).0.abs() < 1e-12, "{shape:?} at {p:?}");
            }
        }
    }

    #[test]
    fn known_distances_and_degenerate_points() {
        let sample = |shape: &Shape, p: [f64; 3]| shape.sample(p).0;
        let [ball, hollow, capsule, cuboid, plane] = &primitives()[..] else {
            panic!("there are five primitives")
        };
        assert!((sample(ball, [0.0, 0.5, 0.0]) - 0.2).abs() < 1e-15);
        assert!((sample(hollow, [0.0, 0.5, 0.0]) - 0.4).abs() < 1e-15);
        assert!((sample(capsule, [0.0, 0.5, 0.0]) - 0.2).abs() < 1e-15);
        assert!((sample(cuboid, [0.5, 0.7, 0.5]) - 0.5).abs() < 1e-15);
        assert!((sample(cuboid, [0.1, 0.0, 0.0]) + 0.1).abs() < 1e-15);
        assert_eq!(sample(plane, [9.0, -0.25, 3.0]), -0.25);
        for shape in [ball, capsule, cuboid] {
            let (distance, gradient) = shape.sample([0.0f32; 3]);
            assert!(distance < 0.0 && gradient.iter().map(|g| g * g).sum::<f32>() == 1.0);
        }
        assert_eq!(ball.sample([0.0f64; 3]).1, [0.0, 1.0, 0.0]);
    }

    #[test]
    fn bounds_contain_the_solid() {
        for shape in primitives() {
            let Some((low, high)) = shape.bounds() else { continue };
            for p in points() {
                let point = DVec3::from_array(p);
                let within = point.cmpge(low.as_dvec3()).all() && point.cmple(high.as_dvec3()).all();
                assert!(within || shape.sample(p).0 > 0.0, "{shape:?} at {p:?}");
            }
        }
    }

    #[test]
    fn a_collider_on_the_head_moves_with_it() {
        let collider = Collider {
            shape: Shape::Plane,
            friction: 0.5,
            attachment: Attachment::Head,
            pose: Pose::new(glam::DQuat::IDENTITY, DVec3::X),
        };
        let to = Pose::new(glam::DQuat::from_rotation_y(std::f64::consts::FRAC_PI_2), DVec3::Y);
        let frame = collider.frame(&Pose::IDENTITY, &to);
        assert_eq!(frame.pose(0.0), collider.pose);
        // Halfway through the frame the collider is on the arc about the head, not on the chord.
        let half = frame.pose(0.5).translation - DVec3::new(0.0, 0.5, 0.0);
        assert!((half.length() - 1.0).abs() < 1e-15);
        assert!((frame.pose(1.0).translation - DVec3::new(0.0, 1.0, -1.0)).length() < 1e-15);
    }
}
