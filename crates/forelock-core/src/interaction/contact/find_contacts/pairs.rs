//! Tests a segment against all that are near, many at a time.

use super::cells::Shelf;
use crate::interaction::contact::RUN_SEGMENTS;
use crate::lane::{LANES, Lane, Row, V3};
use crate::lane::{Simd, on};
use glam::Vec3;

/// Set in the number of a segment whose contacts are sought.
pub(crate) const ACTIVE: u32 = 1 << 31;

/// A segment, or a piece of one, in the middle of a slice. Metres.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Entry {
    /// Its number, with [`ACTIVE`].
    pub segment: u32,
    pub middle: Vec3,
    /// From its middle to its upper end.
    pub half: Vec3,
    /// One over the square of that length.
    pub inverse: f32,
    /// Of a ball about its middle: half its length, half the contact distance, and what it strays in half a slice, up to a bound.
    pub radius: f32,
    /// Mean of what its ends move in the slice.
    pub way: Vec3,
    /// How far the ends' own ways are from that.
    pub spread: f32,
}

/// Fields of an entry, as rows.
pub(super) const FIELDS: usize = 12;

impl Entry {
    /// All but its number.
    #[inline]
    pub fn fields(&self) -> [f32; FIELDS] {
        let (at, half, way) = (self.middle, self.half, self.way);
        let (radius, inverse, spread) = (self.radius, self.inverse, self.spread);
        [at.x, at.y, at.z, radius, half.x, half.y, half.z, inverse, way.x, way.y, way.z, spread]
    }
}

/// Writes the segments that may touch an active one, a piece of which is given, in the slice, `distance` the contact distance; of the active ones only those that reach less
/// far, so that each pair comes once, or once for each pair of pieces.
///
/// # Safety
/// The processor must have the instruction set that the function was made for.
pub(super) type Test = unsafe fn(&Shelf, &Entry, f32, &mut Vec<u32>);

/// The test for `simd`, or for what any processor has if `simd` is not supported.
#[inline(never)]
pub(super) fn test_for(simd: Simd) -> Test {
    let simd = if simd.is_supported() { simd } else { Simd::Portable };
    on!(simd, test(shelf: &Shelf, entry: &Entry, distance: f32, near: &mut Vec<u32>))
}

#[inline(always)]
fn test<L: Lane<Scalar = f32>>(shelf: &Shelf, entry: &Entry, distance: f32, near: &mut Vec<u32>) {
    let a = Side::<L>::splat(entry);
    let distance = L::splat(distance);
    let reach = L::splat(entry.radius - entry.half.length());
    shelf.runs(entry.middle, shelf.cells().reach(entry), |run| {
        // What is left out is at the ends.
        let cut = run.len().saturating_sub(RUN_SEGMENTS) / 2;
        let run = run.start + cut..run.end - cut;
        let mut first = run.start / L::WIDTH * L::WIDTH;
        while first < run.end {
            let rows = &shelf.rows[first / LANES];
            let lane = first % LANES;
            // Lanes before and after the run are of other cells.
            let mut bits = near_enough(&a, reach, rows, lane);
            bits &= u32::MAX << run.start.saturating_sub(first);
            bits &= u32::MAX >> (32 - (run.end - first).min(32));
            if bits != 0 {
                bits &= touch(&a, &Side::load(rows, lane), distance);
            }
            while bits != 0 {
                let k = bits.trailing_zeros() as usize;
                bits &= bits - 1;
                let (other, radius) = (shelf.segments[first + k], rows[3].0[lane + k]);
                let own = other & !ACTIVE;
                if own == other || (radius, other) < (entry.radius, entry.segment) {
                    near.push(own);
                }
            }
            first += L::WIDTH;
        }
    });
}

/// Some entries, one a lane, or one in all lanes.
#[derive(Clone, Copy)]
struct Side<L> {
    middle: V3<L>,
    half: V3<L>,
    inverse: L,
    way: V3<L>,
    spread: L,
}

impl<L: Lane<Scalar = f32>> Side<L> {
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
            way: V3([f(8), f(9), f(10)]),
            spread: f(11),
        }
    }
}

/// The lanes whose balls are within `reach` of the segment of `a`.
#[inline(always)]
fn near_enough<L: Lane<Scalar = f32>>(a: &Side<L>, reach: L, rows: &[Row<f32>; FIELDS], first: usize) -> u32 {
    let r = V3([L::load(&rows[0], first), L::load(&rows[1], first), L::load(&rows[2], first)]) - a.middle;
    let apart = r - a.half.scale(clamp(a.half.dot(r) * a.inverse));
    let radius = reach + L::load(&rows[3], first);
    L::bits(apart.dot(apart).lt(radius * radius))
}

/// The lanes whose segments may touch `a` in the slice.
///
/// The vector r between the nearest points of two segments separates them: along it no two of their points are nearer. So at the slice's ends they are
/// farther apart along r than what they move along it, half the slice's way each.
#[inline(always)]
fn touch<L: Lane<Scalar = f32>>(a: &Side<L>, b: &Side<L>, distance: L) -> u32 {
    let r = a.middle - b.middle;
    let (ab, ar, br) = (a.half.dot(b.half), a.half.dot(r), b.half.dot(r));
    // As `contact::closest`, from the middles and by inverses: with |a|² = 1/ia, s = (ab br − ar bb)/(aa bb − ab²), times ia ib above and below.
    let (ia, ib) = (a.inverse, b.inverse);
    let across = (L::one() - ab * ab * ia * ib).max(L::splat(1e-6));
    let s = clamp((ab * br * ib - ar) * ia / across);
    let t = clamp(ab.mul_add(s, br) * ib);
    let s = clamp((ab.mul_add(t, -ar)) * ia);
    let apart = r + a.half.scale(s) - b.half.scale(t);
    let square = apart.dot(apart);
    let along = apart.dot(a.way - b.way);
    let half = L::splat(0.5);
    let near = square.sqrt() * half.mul_add(a.spread + b.spread, distance);
    let near = half.mul_add(along.max(-along), near);
    !L::bits(near.lt(square))
}

#[inline(always)]
fn clamp<L: Lane>(x: L) -> L {
    x.max(-L::one()).min(L::one())
}
