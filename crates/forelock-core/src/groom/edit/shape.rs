//! Shapes for cutting and selecting, described by their signed distances.

use glam::{EulerRot, Quat, Vec3};

use super::EditError;
use super::error::{check, direction};

crate::documented! {
/// A ball.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct Ball {
    /// Centre of the ball. Unit m, no default, range -1e4 to 1e4 each.
    pub centre: Vec3,
    /// Radius of the ball. Unit m, no default, range 1e-6 to 1000.
    pub radius: f32,
}
}

crate::documented! {
/// The half-space on the side of a plane to which its normal points.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct HalfSpace {
    /// A point of the plane. Unit m, no default, range -1e4 to 1e4 each.
    pub point: Vec3,
    /// Normal of the plane, of any non-zero length. No unit, no default, range -1e4 to 1e4 each.
    pub normal: Vec3,
}
}

crate::documented! {
/// A box that may be rotated.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct TurnedBox {
    /// Centre of the box. Unit m, no default, range -1e4 to 1e4 each.
    pub centre: Vec3,
    /// Half the lengths of the sides. Unit m, no default, range 1e-6 to 1000 each.
    pub half_extents: Vec3,
    /// Yaw about y, pitch about x, roll about z, in this order. Unit degrees, default [0, 0, 0],
    /// range -1e6 to 1e6 each.
    #[cfg_attr(feature = "serde", serde(default))]
    pub rotation_degrees: Vec3,
}
}

crate::documented! {
/// A cylinder with hemispherical ends.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct Capsule {
    /// One end of the axis. Unit m, no default, range -1e4 to 1e4 each.
    pub from: Vec3,
    /// The other end of the axis. Unit m, no default, range -1e4 to 1e4 each.
    pub to: Vec3,
    /// Radius. Unit m, no default, range 1e-6 to 1000.
    pub radius: f32,
}
}

crate::documented! {
/// A polyline with a radius, such as a brush stroke.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(deny_unknown_fields))]
pub struct Stroke {
    /// Points of the polyline, two or more. Unit m, no default, range -1e4 to 1e4 each.
    pub points: Vec<Vec3>,
    /// Radius around the polyline. Unit m, no default, range 1e-6 to 1000.
    pub radius: f32,
}
}

/// The shape of a cut; a strand ends where it first enters the shape.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "kebab-case"))]
pub enum CutShape {
    /// The half-space on the side of a plane to which its normal points.
    Plane(HalfSpace),
    /// A ball.
    Sphere(Ball),
    /// A box that may be rotated.
    Box(TurnedBox),
    /// A cylinder with hemispherical ends.
    Capsule(Capsule),
    /// A polyline with a radius.
    Stroke(Stroke),
}

impl Ball {
    pub(super) fn validate(&self) -> Result<(), EditError> {
        check::<Self>(&[("centre", &self.centre.to_array()), ("radius", &[self.radius])])
    }
}

impl HalfSpace {
    pub(super) fn validate(&self) -> Result<(), EditError> {
        check::<Self>(&[("point", &self.point.to_array())])?;
        direction("normal", self.normal)
    }

    /// Signed distance of `p`: positive on the side from which the normal points away.
    pub(super) fn distance(&self, p: Vec3) -> f32 {
        (self.point - p).dot(self.normal.normalize())
    }
}

impl TurnedBox {
    fn validate(&self) -> Result<(), EditError> {
        check::<Self>(&[
            ("centre", &self.centre.to_array()),
            ("rotation_degrees", &self.rotation_degrees.to_array()),
        ])?;
        check::<Self>(&[("half_extents", &self.half_extents.to_array())])
    }
}

impl Capsule {
    fn validate(&self) -> Result<(), EditError> {
        check::<Self>(&[
            ("from", &self.from.to_array()),
            ("to", &self.to.to_array()),
            ("radius", &[self.radius]),
        ])
    }
}

impl Stroke {
    pub(super) fn validate(&self) -> Result<(), EditError> {
        check::<Self>(&[("radius", &[self.radius])])?;
        if self.points.len() < 2 {
            return Err(EditError::new("points", self.points.len(), "two points or more"));
        }
        self.points.iter().try_for_each(|p| check::<Self>(&[("points", &p.to_array())]))?;
        let apart = self.points.windows(2).any(|w| w[0].distance(w[1]) > 0.0);
        if apart { Ok(()) } else { Err(EditError::new("points", "one place", "points that differ")) }
    }

    /// Distance of `p` from the polyline, and the polyline's direction at the nearest point; the
    /// direction is interpolated between the centres of the segments.
    pub(super) fn nearest(&self, p: Vec3) -> (f32, Vec3) {
        let mut best = (f32::INFINITY, 0, 0.0);
        for (segment, ends) in self.points.windows(2).enumerate() {
            let (distance, share) = to_segment(p, ends[0], ends[1]);
            if distance < best.0 {
                best = (distance, segment, share);
            }
        }
        let (distance, segment, share) = best;
        let along = |segment: usize| (self.points[segment + 1] - self.points[segment]).normalize_or_zero();
        let direction = along(segment);
        let (other, weight) = if share < 0.5 {
            (segment.checked_sub(1), 0.5 - share)
        } else {
            (Some(segment + 1).filter(|next| next + 1 < self.points.len()), share - 0.5)
        };
        let mixed = other.map_or(direction, |other| direction.lerp(along(other), weight));
        (distance, mixed.try_normalize().unwrap_or(direction))
    }
}

/// Distance of `p` from the segment from `a` to `b`, and the position of the nearest point as a
/// fraction of the segment.
fn to_segment(p: Vec3, a: Vec3, b: Vec3) -> (f32, f32) {
    let axis = b - a;
    let share = ((p - a).dot(axis) / axis.length_squared().max(f32::MIN_POSITIVE)).clamp(0.0, 1.0);
    (p.distance(a + axis * share), share)
}

impl CutShape {
    pub(super) fn validate(&self) -> Result<(), EditError> {
        match self {
            Self::Plane(plane) => plane.validate().map_err(|e| e.under("plane")),
            Self::Sphere(ball) => ball.validate().map_err(|e| e.under("sphere")),
            Self::Box(cuboid) => cuboid.validate().map_err(|e| e.under("box")),
            Self::Capsule(capsule) => capsule.validate().map_err(|e| e.under("capsule")),
            Self::Stroke(stroke) => stroke.validate().map_err(|e| e.under("stroke")),
        }
    }

    /// Signed distance of `p` in metres, negative inside; a lower bound of the true distance.
    pub(super) fn distance(&self, p: Vec3) -> f32 {
        match self {
            Self::Plane(plane) => plane.distance(p),
            Self::Sphere(ball) => p.distance(ball.centre) - ball.radius,
            Self::Box(cuboid) => {
                let [yaw, pitch, roll] = cuboid.rotation_degrees.to_array().map(f32::to_radians);
                let turn = Quat::from_euler(EulerRot::YXZ, yaw, pitch, roll);
                let over = (turn.inverse() * (p - cuboid.centre)).abs() - cuboid.half_extents;
                over.max(Vec3::ZERO).length() + over.max_element().min(0.0)
            }
            Self::Capsule(capsule) => to_segment(p, capsule.from, capsule.to).0 - capsule.radius,
            Self::Stroke(stroke) => stroke.nearest(p).0 - stroke.radius,
        }
    }

    /// The first point of the segment from `a` to `b` inside the shape, as a fraction of the
    /// segment; `None` if the segment is outside.
    ///
    /// Sphere tracing (Hart 1996): a step of the length of the distance cannot pass through the
    /// shape.
    pub(super) fn first_hit(&self, a: Vec3, b: Vec3) -> Option<f32> {
        let length = a.distance(b);
        let least = 1e-4 * length.max(1e-6);
        let mut travelled = 0.0;
        while travelled < length {
            let distance = self.distance(a.lerp(b, travelled / length));
            if distance <= 0.0 {
                return Some(travelled / length);
            }
            travelled += distance.max(least);
        }
        (self.distance(b) <= 0.0).then_some(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn segments_enter_shapes_at_the_surface() {
        let far = |shape: &CutShape| shape.first_hit(Vec3::ZERO, Vec3::NEG_Y);
        let plane = CutShape::Plane(HalfSpace { point: Vec3::NEG_Y * 0.25, normal: Vec3::NEG_Y * 7.0 });
        let ball = CutShape::Sphere(Ball { centre: Vec3::NEG_Y * 0.5, radius: 0.25 });
        let turned = TurnedBox {
            centre: Vec3::NEG_Y * 0.5,
            half_extents: Vec3::new(0.25, 9.0, 9.0),
            rotation_degrees: Vec3::new(0.0, 0.0, 90.0),
        };
        let capsule =
            Capsule { from: Vec3::new(-1.0, -0.5, 0.0), to: Vec3::new(1.0, -0.5, 0.0), radius: 0.25 };
        let stroke =
            Stroke { points: vec![Vec3::new(-1.0, -0.5, 0.0), Vec3::new(1.0, -0.5, 0.0)], radius: 0.25 };
        for shape in
            [plane, ball, CutShape::Box(turned), CutShape::Capsule(capsule), CutShape::Stroke(stroke)]
        {
            let met = far(&shape).unwrap();
            assert!((met - 0.25).abs() < 2e-4, "{shape:?}: {met}");
            assert_eq!(shape.first_hit(Vec3::ZERO, Vec3::Y), None, "{shape:?}");
        }
        // The shape is thinner than the segment is long, and both ends are outside.
        let wire =
            Stroke { points: vec![Vec3::new(-1.0, -0.5, 0.0), Vec3::new(1.0, -0.5, 0.0)], radius: 1e-3 };
        assert!((far(&CutShape::Stroke(wire)).unwrap() - 0.499).abs() < 2e-4);
    }

    #[test]
    fn the_direction_of_a_stroke_is_interpolated() {
        let stroke = Stroke { points: vec![Vec3::ZERO, Vec3::X, Vec3::X + Vec3::Y], radius: 1.0 };
        assert_eq!(stroke.nearest(Vec3::new(0.5, -0.1, 0.0)), (0.1, Vec3::X));
        let (distance, corner) = stroke.nearest(Vec3::X);
        assert!(distance < 1e-6 && (corner - Vec3::new(1.0, 1.0, 0.0).normalize()).length() < 1e-6);
        assert_eq!(stroke.nearest(Vec3::new(1.0, 0.5, 0.0)).1, Vec3::Y);
    }
}
