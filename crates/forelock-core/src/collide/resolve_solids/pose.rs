//! Poses and motions of solids over a substep.

use super::dot;
use super::sweep::SweepPath;
use crate::body::{ColliderFrame, PACKET, Shape};
use crate::lane::{Lane, Mat3, Real, V3};
use crate::pose::Pose;
use glam::{DVec3, Vec3};

/// Pose of a solid at the start and the end of a substep, relative to the frame's origin.
#[derive(Clone, Copy, Debug)]
pub struct SolidPose<T> {
    rotations: [[[T; 3]; 3]; 2],
    translations: [[T; 3]; 2],
    /// Maps the position at the start of a point fixed to the solid to its position at the end, in
    /// world axes.
    carry: ([[T; 3]; 3], [T; 3]),
    /// The carrier: its position at the end, and its rotation vector and translation over the
    /// substep.
    carrier: [[T; 3]; 3],
    /// A bounding ball of the solid at the end; its radius is infinite where there is none.
    ball: ([T; 3], T),
    /// The substep's start and end as fractions of the frame.
    pub(super) fractions: [f64; 2],
    /// Upper bound of the surface's displacement in the substep where the shape changes.
    pub(super) swell: T,
    /// The part of it by which the distance from the surface may fall. That from a body that bends
    /// falls by less (`BendingField::fall`).
    sinks: T,
    /// Whether the clearances at the substep's start count on the skin of a body that bends as it
    /// is then, not until the frame's end.
    pub(super) falls: bool,
}

/// Motion of a solid in a substep in float64, relative to the frame's origin. [`SolidPose`] holds
/// the same in the solver's precision.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SolidMotion {
    /// The solid's poses at the substep's start and end.
    pub poses: [Pose; 2],
    /// Maps the position at the start of a point fixed to the solid to its position at the end, in
    /// world axes.
    pub carry: Pose,
    /// Position of the carrier at the end.
    pub pivot: DVec3,
    /// The carrier's rotation vector over the substep.
    pub spin: DVec3,
    /// The carrier's translation over the substep, metres.
    pub travel: DVec3,
    /// A bounding ball of the solid at the end, if there is one: centre and radius, metres.
    pub ball: Option<(DVec3, f64)>,
    /// Upper bound of the surface's displacement in the substep where the shape changes, metres.
    pub swell: f64,
}

impl SolidMotion {
    /// The motion of `solid` between two `fractions` of its frame, relative to `origin`.
    pub fn new(solid: &ColliderFrame<'_>, fractions: [f64; 2], origin: DVec3) -> Self {
        let carrier = fractions.map(|fraction| solid.from.interpolate(&solid.to, fraction));
        let poses = carrier.map(|pose| {
            let own = pose.after(&solid.local);
            Pose { translation: own.translation - origin, ..own }
        });
        let ball = |(low, high): (Vec3, Vec3)| {
            let (low, high) = (low.as_dvec3(), high.as_dvec3());
            (poses[1].transform_point(0.5 * (low + high)), 0.5 * low.distance(high))
        };
        Self {
            poses,
            carry: poses[1].after(&poses[0].inverse()),
            pivot: carrier[1].translation - origin,
            spin: (carrier[1].rotation * carrier[0].rotation.conjugate()).to_scaled_axis(),
            travel: carrier[1].translation - carrier[0].translation,
            ball: solid.shape.bounds().map(ball),
            swell: match solid.shape {
                Shape::Morph { morph, phases: [from, to] } => {
                    let phases = (to - from).abs() * (fractions[1] - fractions[0]);
                    f64::from(morph.change()) * phases
                }
                Shape::Bending(field) => f64::from(field.motion()) * (fractions[1] - fractions[0]),
                _ => 0.0,
            },
        }
    }
}

impl<T: Real> SolidPose<T> {
    /// The poses of `solid` at `fractions` of its frame, relative to `origin`.
    pub fn new(solid: &ColliderFrame<'_>, fractions: [f64; 2], origin: DVec3) -> Self {
        let motion = SolidMotion::new(solid, fractions, origin);
        let number = crate::strands::number::<T>;
        let vector = |v: DVec3| v.to_array().map(number);
        let matrix = |pose: &Pose| {
            let m = pose.matrix();
            [m.row(0), m.row(1), m.row(2)].map(vector)
        };
        Self {
            rotations: [matrix(&motion.poses[0]), matrix(&motion.poses[1])],
            translations: motion.poses.map(|pose| vector(pose.translation)),
            carry: (matrix(&motion.carry), vector(motion.carry.translation)),
            carrier: [motion.pivot, motion.spin, motion.travel].map(vector),
            ball: motion
                .ball
                .map_or(([T::zero(); 3], T::infinity()), |(centre, radius)| (vector(centre), number(radius))),
            fractions,
            swell: number(motion.swell),
            sinks: if matches!(solid.shape, Shape::Bending(_)) { T::zero() } else { number(motion.swell) },
            falls: match solid.shape {
                Shape::Bending(field) => fractions[0] == 0.0 && field.changes(),
                _ => false,
            },
        }
    }

    /// Transforms a point from the solid's local space to the world at `end` (0: the substep's
    /// start, 1: its end).
    #[inline(always)]
    pub(super) fn world(&self, end: usize, q: [T; 3]) -> [T; 3] {
        let (turned, p) = (self.turn(end, q), self.translations[end]);
        [0, 1, 2].map(|c| turned[c] + p[c])
    }

    /// The path, in the solid's local space, of a particle from `from` to `to`. The particle is at
    /// `from` at `start` (0: the substep's start, 1: its end) and at `to` at the substep's end.
    pub(super) fn sweep_path(&self, start: usize, from: [T; 3], to: [T; 3]) -> SweepPath<T> {
        SweepPath {
            ends: [self.local(start, from), self.local(1, to)],
            fractions: [self.fractions[start], self.fractions[1]],
            swell: if start == 0 { self.swell } else { T::zero() },
        }
    }

    /// A lower bound of each lane's distance from the solid at the end of the substep: the distance
    /// from its bounding ball.
    #[inline(always)]
    pub(super) fn distance_bound<L: Lane<Scalar = T>>(&self, x: V3<L>) -> L {
        let ([a, b, c], radius) = self.ball;
        let d = x - V3([L::splat(a), L::splat(b), L::splat(c)]);
        d.dot(d).sqrt() - L::splat(radius)
    }

    /// [`SolidPose::distance_bound`] of one particle.
    #[inline(always)]
    pub(super) fn distance_bound_at(&self, x: [T; 3]) -> T {
        let (centre, radius) = &self.ball;
        let d = [0, 1, 2].map(|c| x[c] - centre[c]);
        dot(d, d).sqrt() - *radius
    }

    /// Transforms a point from the world to the solid's local space at `end`.
    #[inline(always)]
    pub(super) fn local(&self, end: usize, x: [T; 3]) -> [T; 3] {
        let (r, p) = (&self.rotations[end], &self.translations[end]);
        let d = [x[0] - p[0], x[1] - p[1], x[2] - p[2]];
        [0, 1, 2].map(|c| r[0][c] * d[0] + r[1][c] * d[1] + r[2][c] * d[2])
    }

    /// Transforms a packet of points to the solid's local space at `end`.
    #[inline(always)]
    pub(super) fn local_packet(&self, end: usize, x: &[[T; PACKET]; 3]) -> [[T; PACKET]; 3] {
        let (r, p) = (&self.rotations[end], &self.translations[end]);
        let mut local = [[T::zero(); PACKET]; 3];
        for c in 0..3 {
            for k in 0..PACKET {
                let (d0, d1, d2) = (x[0][k] - p[0], x[1][k] - p[1], x[2][k] - p[2]);
                local[c][k] = r[0][c] * d0 + r[1][c] * d1 + r[2][c] * d2;
            }
        }
        local
    }

    /// Rotates a vector from the solid's local space to the world at `end`.
    #[inline(always)]
    pub(super) fn turn(&self, end: usize, v: [T; 3]) -> [T; 3] {
        self.rotations[end].map(|row| dot(row, v))
    }

    /// Displacement in h of the solid's point at `x` by the carrier's rigid motion:
    /// h (ω × (x − p) + dp/dt) at the substep's end.
    #[inline(always)]
    pub(super) fn displacement(&self, x: [T; 3]) -> [T; 3] {
        let [p, spin, travel] = &self.carrier;
        let r = [x[0] - p[0], x[1] - p[1], x[2] - p[2]];
        [
            travel[0] + spin[1] * r[2] - spin[2] * r[1],
            travel[1] + spin[2] * r[0] - spin[0] * r[2],
            travel[2] + spin[0] * r[1] - spin[1] * r[0],
        ]
    }

    /// An upper bound of each lane's displacement relative to the solid's surface.
    #[inline(always)]
    pub(super) fn moved<L: Lane<Scalar = T>>(&self, from: V3<L>, to: V3<L>) -> L {
        let ([a, b, c], [x, y, z]) = &self.carry;
        let carried = V3([L::splat(*x), L::splat(*y), L::splat(*z)])
            .add_mul(&Mat3([splat_row(a), splat_row(b), splat_row(c)]), from);
        let d = to - carried;
        d.dot(d).sqrt() + L::splat(self.sinks)
    }
}

#[inline(always)]
fn splat_row<L: Lane>([x, y, z]: &[L::Scalar; 3]) -> [L; 3] {
    [L::splat(*x), L::splat(*y), L::splat(*z)]
}
