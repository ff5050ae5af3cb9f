//! Tests one segment against many candidates at a time.

use super::cells::SoaCells;
use crate::interaction::contact::RUN_SEGMENTS;
use crate::lane::{LANES, Lane, Row, V3};
use crate::lane::{Simd, on};
use glam::Vec3;

/// Flag in the number of an active segment.
pub(crate) const ACTIVE: u32 = 1 << 31;

/// A segment, or a piece of one, in the middle of a slice. Metres.
#[derive(Clone, Copy, Debug, Default)]
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

/// Number of rows of an entry.
pub(super) const FIELDS: usize = 13;

impl Entry {
    /// All fields except the number.
    #[inline]
    pub fn fields(&self) -> [f32; FIELDS] {
        let (at, half, displacement) = (self.middle, self.half, self.displacement);
        let (radius, inverse, spread) = (self.radius, self.inverse, self.spread);
        [
            at.x,
            at.y,
            at.z,
            radius,
            half.x,
            half.y,
            half.z,
            inverse,
            displacement.x,
            displacement.y,
            displacement.z,
            spread,
            self.reach,
        ]
    }
}

/// Collects the segments that may touch an active segment in the slice, given one piece of it; the
/// third argument are the contact distance, and the approach in the slice that is ignored, metres.
/// Of active candidates only those of a smaller radius are
/// collected, so each pair appears once, or once for each pair of pieces.
///
/// # Safety
/// The processor must support the instruction set of the function.
pub(super) type Test = unsafe fn(&SoaCells, &Entry, [f32; 2], &mut Vec<u32>);

/// The test for `simd`, or the portable one if `simd` is not supported.
#[inline(never)]
pub(super) fn test_for(simd: Simd) -> Test {
    let simd = if simd.is_supported() { simd } else { Simd::Portable };
    on!(simd, test(soa: &SoaCells, entry: &Entry, limits: [f32; 2], near: &mut Vec<u32>))
}

#[inline(always)]
fn test<L: Lane<Scalar = f32>>(
    soa: &SoaCells,
    entry: &Entry,
    [distance, slip]: [f32; 2],
    near: &mut Vec<u32>,
) {
    let a = EntryLanes::<L>::splat(entry);
    let (distance, slip) = (L::splat(distance), L::splat(slip));
    let reach = L::splat(entry.reach);
    // Of active candidates, only those of a smaller radius are considered.
    let widest = if soa.holds_active { entry.radius.min(soa.widest) } else { soa.widest };
    soa.runs(entry.middle, entry.half, entry.reach + widest, |run| {
        // The entries at the ends of a long run are skipped.
        let cut = run.len().saturating_sub(RUN_SEGMENTS) / 2;
        let run = run.start + cut..run.end - cut;
        let mut first = run.start / L::WIDTH * L::WIDTH;
        while first < run.end {
            let rows = &soa.rows[first / LANES];
            let lane = first % LANES;
            // Excludes the lanes before and after the run, which belong to other cells.
            let mut bits = may_approach(&a, rows, lane, slip);
            bits &= u32::MAX << run.start.saturating_sub(first);
            bits &= u32::MAX >> (32 - (run.end - first).min(32));
            if bits != 0 {
                bits &= balls_touch(&a, reach, rows, lane);
            }
            if bits != 0 {
                bits &= may_touch(&a, &EntryLanes::load(rows, lane), distance);
            }
            while bits != 0 {
                let k = bits.trailing_zeros() as usize;
                bits &= bits - 1;
                let (other, radius) = (soa.segments[first + k], rows[3].0[lane + k]);
                let own = other & !ACTIVE;
                if own == other || (radius, other) < (entry.radius, entry.segment) {
                    near.push(own);
                }
            }
            first += L::WIDTH;
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
}

impl<L: Lane<Scalar = f32>> EntryLanes<L> {
    #[inline(always)]
    fn load(rows: &[Row<f32>; FIELDS], first: usize) -> Self {
        Self::from(|k| L::load(&rows[k], first))
    }

    #[inline(always)]
    fn splat(entry: &Entry) -> Self {
        let fields = entry.fields();
        Self::from(|k| L::splat(fields[k]))
    }

    #[inline(always)]
    fn from(f: impl Fn(usize) -> L) -> Self {
        Self {
            middle: V3([f(0), f(1), f(2)]),
            half: V3([f(4), f(5), f(6)]),
            inverse: f(7),
            displacement: V3([f(8), f(9), f(10)]),
            spread: f(11),
        }
    }
}

/// The lanes whose balls are within `reach` of the segment `a`, and whose segments pass near the
/// line through `a`.
///
/// Seen along `a`, a segment is no nearer to the line than its middle less its half length, h.
/// Both in squares: (D + h)² ≤ 2 D² + 2 h².
#[inline(always)]
fn balls_touch<L: Lane<Scalar = f32>>(
    a: &EntryLanes<L>,
    reach: L,
    rows: &[Row<f32>; FIELDS],
    first: usize,
) -> u32 {
    let row = |k: usize| L::load(&rows[k], first);
    let r = V3([row(0), row(1), row(2)]) - a.middle;
    let ar = a.half.dot(r);
    let apart = r - a.half.scale(clamp(ar * a.inverse));
    let radius = reach + row(3);
    let is_near = apart.dot(apart).lt(radius * radius);
    let half = V3([row(4), row(5), row(6)]);
    let ab = a.half.dot(half);
    let across = r.dot(r) - ar * ar * a.inverse;
    let half_across = half.dot(half) - ab * ab * a.inverse;
    let distance = reach + row(12);
    let most = L::splat(NEAR) * (distance * distance + half_across.max(L::zero()));
    L::bits(is_near) & L::bits(across.lt(most))
}

/// The lanes whose segments may approach `a` by more than `slip` in the slice: no two points do by
/// more than the means of the ends do, and both spreads.
#[inline(always)]
fn may_approach<L: Lane<Scalar = f32>>(
    a: &EntryLanes<L>,
    rows: &[Row<f32>; FIELDS],
    first: usize,
    slip: L,
) -> u32 {
    let row = |k: usize| L::load(&rows[k], first);
    let relative = a.displacement - V3([row(8), row(9), row(10)]);
    let left = (slip - a.spread - row(11)).max(L::zero());
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
