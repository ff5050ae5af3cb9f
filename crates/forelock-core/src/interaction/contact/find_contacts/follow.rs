//! Advances two segments through a slice until they touch.
//!
//! # Practice
//! Few pairs touch, so sixteen are advanced at a time to rule most of them out, with a margin for
//! rounding. The rest are advanced again one by one ([`follow`]), which also finds where they touch
//! and knows their distance at rest.

use super::Slice;
use crate::interaction::contact::{Contact, Displacements, closest};
use crate::lane::{LANES, Lane, Real, Row, Simd, V3, on};
use crate::strands::Model;
use crate::strands::vec3;
use glam::Vec3;

/// Maximum number of steps; pairs that have not touched by then only graze.
pub const STEPS: usize = 16;
/// Tolerance of the contact distance, relative to it.
pub const CLOSE: f32 = 0.02;
/// Contact distance of strands that are closer at rest, relative to their rest distance.
pub const REST_SHARE: f32 = 0.95;

/// Steps after which pairs that were advanced together are left to [`follow`].
const SHARED_STEPS: usize = 6;
/// Margins of what is advanced together, for rounding: relative, and in metres.
const MARGIN: f32 = 1e-3;
const ROUNDING: f32 = 5e-7;

/// Paths of sixteen pairs of segments, a pair in each lane: for each segment and each of its ends
/// the position at the start of the frame and the displacement in the frame, axis by axis.
#[derive(Clone, Copy, Debug)]
pub(super) struct Paths([[[[Row<f32>; 3]; 2]; 2]; 2]);

impl Default for Paths {
    fn default() -> Self {
        Self([[[[Row([0.0; LANES]); 3]; 2]; 2]; 2])
    }
}

impl Paths {
    #[inline]
    pub fn set(&mut self, lane: usize, displacements: &Displacements, pair: [u32; 2]) {
        for (rows, p) in self.0.iter_mut().zip(pair) {
            for (rows, p) in rows.iter_mut().zip([p as usize, p as usize + LANES]) {
                for (rows, x) in rows.iter_mut().zip([displacements.start(p), displacements.of(p)]) {
                    rows.iter_mut().zip(x.to_array()).for_each(|(row, x)| row.0[lane] = x);
                }
            }
        }
    }
}

/// Bits of the lanes whose pairs may come within the contact distance, the second argument, in a
/// span of the frame: all pairs for which [`follow`] finds a contact, and some others.
///
/// # Safety
/// The processor must support the instruction set of the function.
pub(super) type ComeNear = unsafe fn(&Paths, f32, [f32; 2]) -> u32;

/// Finds the contacts of pairs of segments in a slice.
#[derive(Clone, Copy, Debug)]
pub(super) struct Follower<'a, T> {
    model: &'a Model<T>,
    displacements: &'a Displacements,
    slice: &'a Slice,
    come_near: ComeNear,
}

impl<'a, T: Real> Follower<'a, T> {
    /// Uses the instruction set `simd`, or the portable one if `simd` is not supported.
    pub fn new(model: &'a Model<T>, displacements: &'a Displacements, slice: &'a Slice, simd: Simd) -> Self {
        Self { model, displacements, slice, come_near: come_near_for(simd) }
    }

    /// Adds the contacts of `pairs`, segments of different strands with the lower number first, to
    /// `found`.
    pub fn follow(&self, pairs: &[[u32; 2]], paths: &mut Paths, found: &mut Vec<Contact>) {
        for pairs in pairs.chunks(LANES) {
            pairs.iter().enumerate().for_each(|(lane, &pair)| paths.set(lane, self.displacements, pair));
            // SAFETY: `come_near_for` returns only functions that the processor supports.
            let near = unsafe { (self.come_near)(paths, self.slice.distance, self.slice.span) };
            let left = pairs.iter().enumerate().filter(|(lane, _)| near >> lane & 1 != 0);
            found.extend(
                left.filter_map(|(_, &pair)| follow(self.model, self.displacements, self.slice, pair)),
            );
        }
    }
}

/// The function for `simd`, or the portable one if `simd` is not supported.
#[inline(never)]
pub(super) fn come_near_for(simd: Simd) -> ComeNear {
    let simd = simd.resolve();
    let simd = if simd.is_supported() { simd } else { Simd::Portable };
    on!(simd, come_near(paths: &Paths, distance: f32, span: [f32; 2]) -> u32)
}

#[inline(always)]
fn come_near<L: Lane<Scalar = f32>>(paths: &Paths, distance: f32, span: [f32; 2]) -> u32 {
    let mut near = 0;
    for first in (0..LANES).step_by(L::WIDTH) {
        near |= may_come_near::<L>(paths, distance, span, first) << first;
    }
    near
}

#[inline(always)]
fn load<L: Lane<Scalar = f32>>(rows: &[Row<f32>; 3], first: usize) -> V3<L> {
    V3([L::load(&rows[0], first), L::load(&rows[1], first), L::load(&rows[2], first)])
}

/// Advances the pairs in the lanes from `first` as [`follow`] does one.
///
/// Advancement stops short of a distance that [`follow`] never exceeds where it finds a contact, so
/// wherever it looks, pairs that are ruled out here are farther apart.
#[inline(always)]
fn may_come_near<L: Lane<Scalar = f32>>(
    paths: &Paths,
    distance: f32,
    [from, to]: [f32; 2],
    first: usize,
) -> u32 {
    let [[[a0, da0], [a1, da1]], [[b0, db0], [b1, db1]]] = &paths.0;
    let [da0, da1, db0, db1] = [load::<L>(da0, first), load(da1, first), load(db0, first), load(db1, first)];
    let [a0, b0] = [load::<L>(a0, first), load(b0, first)];
    let [ea, eb] = [load::<L>(a1, first) - a0, load(b1, first) - b0];
    let (r, dr, dea, deb) = (a0 - b0, da0 - db0, da1 - da0, db1 - db0);
    let reach = distance * (1.0 + CLOSE) * (1.0 + MARGIN) + ROUNDING;
    let (reach, close) = (L::splat(reach), L::splat(reach * (1.0 + CLOSE)));
    let (mut when, to) = (L::splat(from), L::splat(to * (1.0 + MARGIN)));
    let (mut near, mut left) = (0, u32::MAX >> (32 - L::WIDTH));
    for _ in 0..SHARED_STEPS {
        let [r, ea, eb] = [r + dr.scale(when), ea + dea.scale(when), eb + deb.scale(when)];
        let least = L::splat(1e-20);
        let (aa, bb, ab) = (ea.dot(ea).max(least), eb.dot(eb).max(least), ea.dot(eb));
        let (ar, br) = (ea.dot(r), eb.dot(r));
        let across = (aa * bb - ab * ab).max(L::splat(1e-6) * aa * bb);
        let s = fraction((ab * br - ar * bb) / across);
        let t = fraction((ab * s + br) / bb);
        let s = fraction((ab * t - ar) / aa);
        let apart = r + ea.scale(s) - eb.scale(t);
        let apart_by = apart.dot(apart).sqrt();
        let closing = (-apart.dot(da0)).max(-apart.dot(da1)) + apart.dot(db0).max(apart.dot(db1));
        when += apart_by * (apart_by - reach) / closing;
        let is_near = L::bits(apart_by.lt(close));
        near |= left & is_near;
        left &= L::bits(L::zero().lt(closing)) & L::bits(when.lt(to)) & !is_near;
        if left == 0 {
            return near;
        }
    }
    near | left
}

/// `x` from 0 to 1.
#[inline(always)]
fn fraction<L: Lane>(x: L) -> L {
    x.max(L::zero()).min(L::one())
}

/// The contact of two segments of different strands, the lower number first, in a slice, if they
/// touch and approach.
///
/// Conservative advancement: the vector between the nearest points of two segments separates them,
/// so at distance D they cannot touch before the time (D − d)/V, where V is the largest approach of
/// any two of their ends along that vector; if V ≤ 0 they cannot touch at all.
pub(super) fn follow<T: Real>(
    model: &Model<T>,
    displacements: &Displacements,
    slice: &Slice,
    segments: [u32; 2],
) -> Option<Contact> {
    let [a, b] = segments.map(|segment| segment as usize);
    // Each step needs them, so they are read once.
    let [start_a, start_b] = [a, b].map(|p| [displacements.start(p), displacements.start(p + LANES)]);
    let [displacement_a, displacement_b] = [a, b].map(|p| [displacements.of(p), displacements.of(p + LANES)]);
    let at = |start: [Vec3; 2], displacement: [Vec3; 2], when: f32| {
        [start[0] + when * displacement[0], start[1] + when * displacement[1]]
    };
    let mut reach = slice.distance;
    let mut has_rest_distance = false;
    let mut when = slice.span[0];
    for _ in 0..STEPS {
        let (own, other) = (at(start_a, displacement_a, when), at(start_b, displacement_b, when));
        let (along, r) = closest(own, other);
        let distance = r.length();
        if distance <= reach * (1.0 + CLOSE) {
            if !has_rest_distance {
                reach = reach.min(REST_SHARE * rest_distance(model, a, b));
                has_rest_distance = true;
                if distance > reach * (1.0 + CLOSE) {
                    continue;
                }
            }
            let relative = displacement_a[0].lerp(displacement_a[1], along[0])
                - displacement_b[0].lerp(displacement_b[1], along[1]);
            let normal = direction(r, distance, own, other, relative)?;
            let approach = -normal.dot(relative);
            let gap = distance.min(reach);
            return (approach > slice.slip).then_some(Contact {
                segments,
                along,
                normal,
                gap,
                when,
                approach,
            });
        }
        let along = |displacements: [Vec3; 2], side: f32| {
            (side * r.dot(displacements[0])).max(side * r.dot(displacements[1]))
        };
        let closing = along(displacement_a, -1.0) + along(displacement_b, 1.0);
        when += distance * (distance - reach) / closing;
        if closing <= 0.0 || when >= slice.span[1] {
            return None;
        }
    }
    None
}

/// The direction of `r`; for segments that intersect, the direction perpendicular to both, against
/// their approach.
fn direction(r: Vec3, distance: f32, a: [Vec3; 2], b: [Vec3; 2], relative: Vec3) -> Option<Vec3> {
    const TINY: f32 = 1e-9;
    if distance > TINY {
        return Some(r / distance);
    }
    let across = (a[1] - a[0]).cross(b[1] - b[0]).try_normalize()?;
    Some(if across.dot(relative) > 0.0 { -across } else { across })
}

fn rest_distance<T: Real>(model: &Model<T>, a: usize, b: usize) -> f32 {
    let point = |p: usize| vec3(&model.rest, p / LANES, p % LANES);
    let segment = |p: usize| [point(p), point(p + LANES)];
    closest(segment(a), segment(b)).1.length()
}
