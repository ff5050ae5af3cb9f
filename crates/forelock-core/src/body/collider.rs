//! Solids that hair meets, as signed distances in their own space, and what a solver gets of them in a frame.
//!
//! # Theory
//! Each primitive's distance σ is exact inside and out, so |∇σ| = 1 wherever the nearest surface point is unique (the
//! eikonal equation). Where it is not (a sphere's centre, a box's medial planes) one of the nearest surface points is
//! chosen by a fixed rule: the direction is never zero.
//!
//! # Practice
//! Shapes live in local metres; a rigid [`Pose`] places them. Distances survive rigid transforms, so a solver takes
//! its point into local space, samples there, and turns the gradient back.

use std::sync::Arc;

use glam::{DVec3, Vec3};
use num_traits::Float;

use super::{Morph, Sdf};
use crate::pose::Pose;

/// A solid in its own space, in metres, y up.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// A ball about the origin.
    Sphere {
        /// Radius in metres.
        radius: f64,
    },
    /// All outside a ball about the origin: hair is kept within.
    HollowSphere {
        /// Radius in metres.
        radius: f64,
    },
    /// All within `radius` of the segment from (0, −`half_length`, 0) to (0, `half_length`, 0).
    Capsule {
        /// Half the length of the segment in metres, without the caps.
        half_length: f64,
        /// Radius in metres.
        radius: f64,
    },
    /// A box about the origin, faces across the axes.
    Box {
        /// Half the size along each axis in metres.
        half_extents: DVec3,
    },
    /// The half-space y ≤ 0.
    Plane,
    /// A field on a grid, in metres; sampled in float32 whatever the solver computes in.
    Sdf(Arc<Sdf>),
    /// A sequence of fields during one frame; sampled in float32 too.
    Morph {
        /// The sequence.
        morph: Arc<Morph>,
        /// Where in it the frame starts and ends, in fields after the first.
        phases: [f64; 2],
    },
}

/// Points in a packet of lookups.
pub const PACKET: usize = 8;

impl Shape {
    /// The signed distance in metres from `p` to the surface, negative inside, and its unit gradient (outwards); of a shape that changes,
    /// as it is at the frame's end.
    ///
    /// Exact for the primitives; for [`Shape::Sdf`] as [`Sdf::sample`] says, with the gradient normalised.
    #[inline]
    pub fn sample<T: Float>(&self, p: [T; 3]) -> (T, [T; 3]) {
        self.sample_at(p, 1.0)
    }

    /// [`Shape::sample`] at `fraction` of the frame, which matters to shapes that change.
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
            Self::Sdf(sdf) => from_field(sdf.sample(to_vec3(p))),
            Self::Morph { morph, phases: [from, to] } => {
                from_field(morph.sample(to_vec3(p), from + (to - from) * fraction))
            }
        }
    }

    /// The side of the cells of a field in metres, if it is one.
    pub fn cell(&self) -> Option<f32> {
        match self {
            Self::Sdf(sdf) => Some(sdf.cell()),
            Self::Morph { morph, .. } => Some(morph.cell()),
            _ => None,
        }
    }

    /// Half the thickness of its thinnest part in metres, as far as is known: what moves less than that cannot pass through. A field's thinnest part is
    /// two cells.
    pub fn thinness(&self) -> f64 {
        match self {
            Self::Sphere { radius } | Self::Capsule { radius, .. } => *radius,
            Self::Box { half_extents } => half_extents.min_element(),
            Self::HollowSphere { .. } | Self::Plane => f64::INFINITY,
            Self::Sdf(_) | Self::Morph { .. } => self.cell().map_or(f64::INFINITY, f64::from),
        }
    }

    /// [`Shape::sample_at`] at a packet of points, component-major; bit for bit what the points alone give.
    #[inline(always)]
    pub fn sample_packet<T: Float>(
        &self,
        p: &[[T; PACKET]; 3],
        fraction: f64,
    ) -> ([T; PACKET], [[T; PACKET]; 3]) {
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

    /// [`Shape::sample`] where the distance may be `reach` metres or less; `None` where it is surely more. For a
    /// field a small table decides first ([`Sdf::sample_near`]), which halves the cost for hair at rest on a head.
    #[inline]
    pub fn sample_near<T: Float>(&self, p: [T; 3], reach: T) -> Option<(T, [T; 3])> {
        if let Self::Sdf(sdf) = self {
            let reach = reach.to_f32().unwrap_or(f32::INFINITY);
            return sdf.sample_near(to_vec3(p), reach).map(from_field);
        }
        Some(self.sample(p)).filter(|(distance, _)| *distance <= reach)
    }

    /// The smallest known axis-aligned box that holds the solid, (min, max) in local metres, rounded outwards; `None`
    /// for a solid without bounds.
    pub fn bounds(&self) -> Option<(Vec3, Vec3)> {
        let half = match self {
            Self::Sphere { radius } => DVec3::splat(*radius),
            Self::Capsule { half_length, radius } => DVec3::new(*radius, half_length + radius, *radius),
            Self::Box { half_extents } => *half_extents,
            Self::HollowSphere { .. } | Self::Plane => return None,
            Self::Sdf(sdf) => return Some(sdf.bounds()),
            Self::Morph { morph, .. } => return Some(morph.bounds()),
        };
        let half = half.as_vec3() * (1.0 + f32::EPSILON);
        Some((-half, half))
    }
}

/// A solid as a scene has it.
#[derive(Clone, Debug, PartialEq)]
pub struct Collider {
    /// Its shape.
    pub shape: Shape,
    /// Coulomb friction coefficient μ; no unit, 0 slides freely.
    pub friction: f64,
    /// What `pose` is relative to.
    pub attachment: Attachment,
    /// Where the shape is, in the space that `attachment` names, unless a motion moves it.
    pub pose: Pose,
}

/// The space in which a collider stands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "kebab-case"))]
pub enum Attachment {
    /// It stays in the world.
    #[default]
    World,
    /// It moves with the head.
    Head,
}

impl Collider {
    /// The collider during one frame in which the head goes from `head_from` to `head_to`.
    pub fn frame(&self, head_from: &Pose, head_to: &Pose) -> ColliderFrame<'_> {
        let (from, to) = match self.attachment {
            Attachment::World => (Pose::IDENTITY, Pose::IDENTITY),
            Attachment::Head => (*head_from, *head_to),
        };
        ColliderFrame { shape: &self.shape, local: self.pose, from, to, friction: self.friction }
    }
}

/// A solid during one frame, carried by something that moves from pose `from` to pose `to`.
///
/// Carrier and place are apart because interpolating their product would take a solid far from the carrier's origin
/// along the chord instead of the arc, away from the hair that the same carrier moves.
#[derive(Clone, Copy, Debug)]
pub struct ColliderFrame<'a> {
    /// The shape, in local space.
    pub shape: &'a Shape,
    /// Carrier from local: where the shape sits on what carries it.
    pub local: Pose,
    /// World from carrier at the frame's start.
    pub from: Pose,
    /// World from carrier at the frame's end.
    pub to: Pose,
    /// Coulomb friction coefficient μ.
    pub friction: f64,
}

impl ColliderFrame<'_> {
    /// World from local, `fraction` of the way through the frame.
    pub fn pose(&self, fraction: f64) -> Pose {
        self.from.interpolate(&self.to, fraction).after(&self.local)
    }
}

/// A constant in the caller's precision.
#[inline]
fn cast<T: Float>(value: f64) -> T {
    T::from(value).unwrap_or_else(T::nan)
}

#[inline]
fn to_vec3<T: Float>(p: [T; 3]) -> Vec3 {
    Vec3::from_array(p.map(|c| c.to_f32().unwrap_or(f32::NAN)))
}

/// A sample of a field in the caller's precision, its gradient made unit.
#[inline]
fn from_field<T: Float>((distance, gradient): (f32, Vec3)) -> (T, [T; 3]) {
    let to_t = |c: f32| T::from(c).unwrap_or_else(T::nan);
    (to_t(distance), (gradient * gradient.length_recip()).to_array().map(to_t))
}

/// Length and direction of `v`; +y for the zero vector.
#[inline]
fn unit<T: Float>(v: [T; 3]) -> (T, [T; 3]) {
    let length = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
    if length > T::min_positive_value() {
        (length, v.map(|c| c / length))
    } else {
        (T::zero(), [T::zero(), T::one(), T::zero()])
    }
}

/// The distance to a box of `half` extents: to the nearest point outside, to the nearest face inside.
#[inline]
fn sample_box<T: Float>(half: [T; 3], p: [T; 3]) -> (T, [T; 3]) {
    let sign = |c: T| if c < T::zero() { -T::one() } else { T::one() };
    let q: [T; 3] = std::array::from_fn(|axis| p[axis].abs() - half[axis]);
    let (length, direction) = unit(q.map(|c| c.max(T::zero())));
    if length > T::zero() {
        return (length, std::array::from_fn(|axis| sign(p[axis]) * direction[axis]));
    }
    // y first, then x, then z: the fixed rule where faces are equally near.
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

    /// Points off every medial set of the shapes above: an irrational lattice.
    fn points() -> impl Iterator<Item = [f64; 3]> {
        (1..400).map(|i| {
            let i = f64::from(i);
            [0.754_877_666, 0.569_840_291, 0.430_159_709].map(|step| (i * step).fract() * 1.6 - 0.8)
        })
    }

    #[test]
    fn gradients_are_unit_and_the_derivative() {
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
        let [ball, hollow, capsule, cuboid, plane] = &primitives()[..] else { panic!("five primitives") };
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
    fn bounds_hold_the_solid() {
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
        // Halfway it is on the arc about the head, not on the chord.
        let half = frame.pose(0.5).translation - DVec3::new(0.0, 0.5, 0.0);
        assert!((half.length() - 1.0).abs() < 1e-15);
        assert!((frame.pose(1.0).translation - DVec3::new(0.0, 1.0, -1.0)).length() < 1e-15);
    }
}
