//! Tests one segment against many candidates at a time.

use super::tree::Tree;
use crate::lane::{LANES, Lane, Row, V3};
use crate::lane::{Simd, on};
use glam::Vec3;

/// Flag in the number of an active segment.
pub(crate) const ACTIVE: u32 = 1 << 31;

/// A segment, or a piece of one, in the middle of a slice; a line of the cache. Metres.
#[derive(Clone, Copy, Debug, Default)]
#[repr(align(64))]
pub(crate) struct Entry {
    /// Number of the segment, with the flag [`ACTIVE`].
    pub segment: u32,
    pub middle: Vec3,
    /// From the centre to the upper end.
    pub half: Vec3,
    /// Inverse square of the length of `half`.
    pub inverse: f32,
    /// Half the contact distance, and half the residual motion in the slice, up to a bound.
    pub reach: f32,
    /// Radius of a ball around the centre: half the length, and `reach`.
    pub radius: f32,
    /// Mean of the displacements of both ends in the slice.
    pub displacement: Vec3,
    /// Distance of the displacements of the ends from their mean.
    pub spread: f32,
}

/// 2, and a margin for rounding.
const NEAR: f32 = 2.01;

/// Rows of the ball of an entry, which is tested first: its centre and radius.
pub(super) const BALL: usize = 4;
/// Rows of the rest of an entry.
pub(super) const REST: usize = 9;

impl Entry {
    /// The centre and the radius.
    #[inline(always)]
    pub fn ball(&self) -> [f32; BALL] {
        [self.middle.x, self.middle.y, self.middle.z, self.radius]
    }

    /// Bounds of the positions of its points in the middle of the slice, and of their displacements
    /// in it: lower and upper corners.
    #[inline(always)]
    pub fn bounds(&self) -> [[Vec3; 2]; 2] {
        let half = self.half.abs();
        [
            [self.middle - half, self.middle + half],
            [self.displacement - self.spread, self.displacement + self.spread],
        ]
    }

    /// All other fields except the number.
    #[inline(always)]
    pub fn rest(&self) -> [f32; REST] {
        let (half, displacement) = (self.half.to_array(), self.displacement.to_array());
        let ([a, b, c], [d, e, f]) = (half, displacement);
        [a, b, c, self.inverse, d, e, f, self.spread, self.reach]
    }
}

/// Collects the segments that may touch an active segment in the slice, given one piece of it; the
/// third argument are the contact distance, and the approach in the slice that is ignored, metres.
/// Of active candidates only those of a smaller radius are collected, so each pair appears once, or
/// once for each pair of pieces.
///
/// # Safety
/// The processor must support the instruction set of the function.
pub(super) type Test = unsafe fn(&Tree, &Entry, [f32; 2], &mut Vec<u32>);

/// The test for `simd`, or the portable one if `simd` is not supported.
#[inline(never)]
pub(super) fn test_for(simd: Simd) -> Test {
    let simd = if simd.is_supported() { simd } else { Simd::Portable };
    on!(simd, test(tree: &Tree, entry: &Entry, limits: [f32; 2], near: &mut Vec<u32>))
}

#[inline(always)]
fn test<L: Lane<Scalar = f32>>(tree: &Tree, entry: &Entry, [distance, slip]: [f32; 2], near: &mut Vec<u32>) {
    let a = EntryLanes::<L>::splat(entry);
    let (wide, slip) = (L::splat(distance), L::splat(slip));
    tree.groups::<L>(entry, distance, |group| {
        let balls = &tree.balls[group];
        for lane in (0..LANES).step_by(L::WIDTH) {
            let mut bits = balls_touch(&a, balls, lane);
            if bits != 0 {
                let b = EntryLanes::load(balls, &tree.rest[group], lane);
                bits &= may_approach(&a, &b, slip) & lines_pass(&a, &b);
                if bits != 0 {
                    bits &= may_touch(&a, &b, wide);
                }
            }
            while bits != 0 {
                let k = lane + bits.trailing_zeros() as usize;
                bits &= bits - 1;
                let (other, radius) = (tree.segments[group][k], balls[3].0[k]);
                let own = other & !ACTIVE;
                if own == other || (radius, other) < (entry.radius, entry.segment) {
                    near.push(own);
                }
            }
        }
    });
}

/// Entries, one in each lane, or one in all lanes.
#[derive(Clone, Copy)]
struct EntryLanes<L> {
    middle: V3<L>,
    half: V3<L>,
    inverse: L,
    displacement: V3<L>,
    spread: L,
    reach: L,
}

impl<L: Lane<Scalar = f32>> EntryLanes<L> {
    #[inline(always)]
    fn load(balls: &[Row<f32>; BALL], rest: &[Row<f32>; REST], first: usize) -> Self {
        Self::from(|k| L::load(&balls[k], first), |k| L::load(&rest[k], first))
    }

    #[inline(always)]
    fn splat(entry: &Entry) -> Self {
        let (ball, rest) = (entry.ball(), entry.rest());
        Self::from(|k| L::splat(ball[k]), |k| L::splat(rest[k]))
    }

    #[inline(always)]
    fn from(ball: impl Fn(usize) -> L, rest: impl Fn(usize) -> L) -> Self {
        Self {
            middle: V3([ball(0), ball(1), ball(2)]),
            half: V3([rest(0), rest(1), rest(2)]),
            inverse: rest(3),
            displacement: V3([rest(4), rest(5), rest(6)]),
            spread: rest(7),
            reach: rest(8),
        }
    }
}

/// The lanes whose balls are within reach of the segment `a`.
#[inline(always)]
fn balls_touch<L: Lane<Scalar = f32>>(a: &EntryLanes<L>, balls: &[Row<f32>; BALL], first: usize) -> u32 {
    let row = |k: usize| L::load(&balls[k], first);
    let r = V3([row(0), row(1), row(2)]) - a.middle;
    let apart = r - a.half.scale(clamp(a.half.dot(r) * a.inverse));
    let radius = a.reach + row(3);
    L::bits(apart.dot(apart).lt(radius * radius))
}

/// The lanes whose segments pass near the line through `a`.
///
/// Seen along `a`, a segment is no nearer to the line than its middle less its half length, h.
/// Both in squares: (D + h)² ≤ 2 D² + 2 h².
#[inline(always)]
fn lines_pass<L: Lane<Scalar = f32>>(a: &EntryLanes<L>, b: &EntryLanes<L>) -> u32 {
    let r = b.middle - a.middle;
    let (ar, ab) = (a.half.dot(r), a.half.dot(b.half));
    let across = r.dot(r) - ar * ar * a.inverse;
    let half_across = b.half.dot(b.half) - ab * ab * a.inverse;
    let distance = a.reach + b.reach;
    let most = L::splat(NEAR) * (distance * distance + half_across.max(L::zero()));
    L::bits(across.lt(most))
}

/// The lanes whose segments may approach `a` by more than `slip` in the slice: no two points do by
/// more than the means of the ends do, and both spreads.
#[inline(always)]
fn may_approach<L: Lane<Scalar = f32>>(a: &EntryLanes<L>, b: &EntryLanes<L>, slip: L) -> u32 {
    let relative = a.displacement - b.displacement;
    let left = (slip - a.spread - b.spread).max(L::zero());
    !L::bits(relative.dot(relative).lt(left * left))
}

/// The lanes whose segments may touch `a` in the slice.
///
/// The vector r between the nearest points of two segments separates them: along r no two of their
/// points are nearer. Before and after the middle of the slice they are therefore farther apart
/// along r than half of their displacements in the slice along r allow.
#[inline(always)]
fn may_touch<L: Lane<Scalar = f32>>(a: &EntryLanes<L>, b: &EntryLanes<L>, distance: L) -> u32 {
    let r = a.middle - b.middle;
    let (ab, ar, br) = (a.half.dot(b.half), a.half.dot(r), b.half.dot(r));
    // As `contact::closest`, from the centres and with inverses: with |a|² = 1/ia, s = (ab br − ar
    // bb)/(aa bb − ab²), numerator and denominator multiplied by ia ib.
    let (ia, ib) = (a.inverse, b.inverse);
    let across = (L::one() - ab * ab * ia * ib).max(L::splat(1e-6));
    let s = clamp((ab * br * ib - ar) * ia / across);
    let t = clamp(ab.mul_add(s, br) * ib);
    let s = clamp((ab.mul_add(t, -ar)) * ia);
    let apart = r + a.half.scale(s) - b.half.scale(t);
    let square = apart.dot(apart);
    let along = apart.dot(a.displacement - b.displacement);
    let half = L::splat(0.5);
    let near = square.sqrt() * half.mul_add(a.spread + b.spread, distance);
    let near = half.mul_add(along.max(-along), near);
    !L::bits(near.lt(square))
}

#[inline(always)]
fn clamp<L: Lane>(x: L) -> L {
    x.max(-L::one()).min(L::one())
}
