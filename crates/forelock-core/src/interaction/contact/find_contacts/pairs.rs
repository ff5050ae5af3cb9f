//! Tests the segments of a row against the active segments near it.

use super::follow::CLOSE;
use super::rows::{Bounds, EntryRows, Motion, Particles, join};
use super::tree::Tree;
use crate::lane::{LANES, Lane, Simd, V3, on};
use crate::scratch::fill;
use crate::strands::Block;
use glam::Vec3;
use std::cmp::Ordering;

/// A segment in the middle of a slice; a line of the cache. Metres.
#[derive(Clone, Copy, Debug, Default)]
#[repr(align(64))]
pub(crate) struct Entry {
    /// Number of the segment.
    pub segment: u32,
    pub middle: Vec3,
    /// From the centre to the upper end.
    pub half: Vec3,
    /// Inverse square of the length of `half`.
    pub inverse: f32,
    /// Half the contact distance, and half the residual motion in the slice, up to a bound.
    pub reach: f32,
    /// Mean of the displacements of both ends in the slice.
    pub displacement: Vec3,
    /// Distance of the displacements of the ends from their mean.
    pub spread: f32,
}

/// 2, and a margin for rounding.
const NEAR: f32 = 2.01;
/// Contact distance with twice the tolerance of a contact, relative to it.
const WIDER: f32 = 1.0 + 2.0 * CLOSE;
/// Margin of a difference of squares, relative to them, for rounding.
const ROUNDING: f32 = 1e-6;

impl Entry {
    /// Bounds of the positions of its points in the middle of the slice, and of their displacements
    /// in it.
    pub fn bounds(&self) -> Bounds {
        let half = self.half.abs();
        [
            [self.middle - half, self.middle + half],
            [self.displacement - self.spread, self.displacement + self.spread],
        ]
    }
}

/// What the search of a slice needs.
#[derive(Clone, Copy, Debug)]
pub(super) struct Search<'a> {
    pub motion: Motion<'a>,
    pub tree: &'a Tree,
    /// Approach in the slice that is ignored, metres.
    pub slip: f32,
}

/// Buffers of the search in a chunk.
#[derive(Debug, Default)]
pub(super) struct RowBuffers {
    /// The particles of two places one after the other. In a search those of an even place come
    /// first.
    particles: [Particles; 2],
    pub segments: EntryRows,
    /// Active segments near a row.
    near: Vec<u32>,
    candidates: Vec<Candidate>,
    /// Pairs of segments that are not followed yet, the lower number first.
    pub pairs: Vec<[u32; 2]>,
}

impl RowBuffers {
    pub fn bytes(&self) -> usize {
        4 * self.near.capacity() + 8 * (self.candidates.capacity() + self.pairs.capacity())
    }
}

/// Adds the pairs of active segments and the segments that end at the particles of a place that may
/// touch in the slice. The places of a block are passed one after the other.
///
/// # Safety
/// The processor must support the instruction set of the function.
pub(super) type SearchPlace = unsafe fn(&Search<'_>, &Block, usize, &mut RowBuffers);

/// The function for `simd`, or the portable one if `simd` is not supported.
#[inline(never)]
pub(super) fn search_place_for(simd: Simd) -> SearchPlace {
    let simd = if simd.is_supported() { simd } else { Simd::Portable };
    on!(simd, search_place(search: &Search<'_>, block: &Block, place: usize, buffers: &mut RowBuffers))
}

#[inline(always)]
fn search_place<L: Lane<Scalar = f32>>(
    search: &Search<'_>,
    block: &Block,
    place: usize,
    buffers: &mut RowBuffers,
) {
    let Search { motion, tree, slip } = search;
    let [even, odd] = &mut buffers.particles;
    let (lower, upper) = if place.is_multiple_of(2) { (odd, even) } else { (even, odd) };
    upper.compute::<L>(motion, place, block.live);
    let counted = lower.counted & upper.counted;
    if place == block.first || counted == 0 {
        return;
    }
    let place = place - 1;
    let residual = lower.residual.max(upper.residual);
    let may_be_active = residual >= motion.slice.active.floor();
    let reach = motion.slice.reach(residual, may_be_active, motion.edge);
    let distance = motion.slice.distance;
    let bounds = join(&lower.bounds, &upper.bounds);
    tree.collect_near::<L>(&bounds, reach, [distance, *slip], &mut buffers.near);
    if buffers.near.is_empty() {
        return;
    }
    let active = if may_be_active { motion.active_lanes(place, block.live) } else { 0 };
    let rows = &mut buffers.segments;
    rows.compute::<L>(motion, [lower, upper], place, active);
    keep_near::<L>(tree, rows, &buffers.near, &mut buffers.candidates);
    let own = OwnRow { place, counted, active, block };
    keep_approaching::<L>(tree, rows, &own, *slip, &mut buffers.candidates);
    for &Candidate { entry, lanes: mut bits } in &buffers.candidates {
        let entry = &tree.entries[entry as usize];
        bits &= may_touch_row::<L>(&EntryLanes::splat(entry), rows, WIDER * distance);
        while bits != 0 {
            let other = (LANES * place) as u32 + bits.trailing_zeros();
            bits &= bits - 1;
            buffers.pairs.push([entry.segment.min(other), entry.segment.max(other)]);
        }
    }
}

/// An active segment, and the bits of the lanes of a row that it may touch.
#[derive(Clone, Copy, Debug, Default)]
struct Candidate {
    entry: u32,
    lanes: u32,
}

/// A row of segments.
#[derive(Debug)]
struct OwnRow<'a> {
    place: usize,
    /// Bits of the lanes that are looked at, and of those that are active.
    counted: u32,
    active: u32,
    block: &'a Block,
}

impl OwnRow<'_> {
    /// Bits of the lanes with which the pairs of an active segment count: each pair of active
    /// segments once, none of one strand.
    #[inline(always)]
    fn wanted(&self, segment: u32) -> u32 {
        let (place, lane) = (segment as usize / LANES, segment as usize % LANES);
        let before = match self.place.cmp(&place) {
            Ordering::Less => self.active,
            Ordering::Equal => self.active & ((1 << lane) - 1),
            Ordering::Greater => 0,
        };
        let strand = u32::from(self.block.range().contains(&place)) << lane;
        self.counted & !before & !strand
    }
}

/// Collects those of the active segments `near` a row whose lines pass near some of its segments.
#[inline(always)]
fn keep_near<L: Lane<Scalar = f32>>(
    tree: &Tree,
    rows: &EntryRows,
    near: &[u32],
    candidates: &mut Vec<Candidate>,
) {
    fill(candidates, near.len(), Candidate::default());
    let mut count = 0;
    for &entry in near {
        let a = EntryLanes::<L>::splat(&tree.entries[entry as usize]);
        let mut lanes = 0;
        for first in (0..LANES).step_by(L::WIDTH) {
            lanes |= lines_pass(&a, &EntryLanes::load(rows, first)) << first;
        }
        // No branch: half of them would be predicted wrongly.
        candidates[count] = Candidate { entry, lanes };
        count += usize::from(lanes != 0);
    }
    candidates.truncate(count);
}

/// Keeps the `candidates` whose balls some segments of the row touch, which approach them by more
/// than `slip`.
#[inline(always)]
fn keep_approaching<L: Lane<Scalar = f32>>(
    tree: &Tree,
    rows: &EntryRows,
    own: &OwnRow<'_>,
    slip: f32,
    candidates: &mut Vec<Candidate>,
) {
    let slip = L::splat(slip);
    let mut count = 0;
    for k in 0..candidates.len() {
        let Candidate { entry, lanes } = candidates[k];
        let of = &tree.entries[entry as usize];
        let a = EntryLanes::<L>::splat(of);
        let mut bits = 0;
        for first in (0..LANES).step_by(L::WIDTH) {
            let approach = may_approach(&a, &EntryLanes::load(rows, first), slip);
            bits |= (approach & balls_touch(&a, rows, first)) << first;
        }
        let lanes = lanes & bits & own.wanted(of.segment);
        candidates[count] = Candidate { entry, lanes };
        count += usize::from(lanes != 0);
    }
    candidates.truncate(count);
}

/// Bits of the lanes of a row whose segments may touch `a` in the slice.
#[inline(always)]
fn may_touch_row<L: Lane<Scalar = f32>>(a: &EntryLanes<L>, rows: &EntryRows, distance: f32) -> u32 {
    let mut bits = 0;
    for first in (0..LANES).step_by(L::WIDTH) {
        bits |= may_touch(a, &EntryLanes::load(rows, first), L::splat(distance)) << first;
    }
    bits
}

/// Computes the segments of a place in `buffers`; those of the lanes in `active`, a set of bits,
/// are active. Returns the bits of the lanes that are looked at.
///
/// # Safety
/// The processor must support the instruction set of the function.
pub(super) type ComputeSegments = unsafe fn(&Motion<'_>, [usize; 2], u32, &mut RowBuffers) -> u32;

/// The function for `simd`, or the portable one if `simd` is not supported.
#[inline(never)]
pub(super) fn compute_segments_for(simd: Simd) -> ComputeSegments {
    let simd = if simd.is_supported() { simd } else { Simd::Portable };
    on!(simd, compute_segments(motion: &Motion<'_>, at: [usize; 2], active: u32, buffers: &mut RowBuffers) -> u32)
}

#[inline(always)]
fn compute_segments<L: Lane<Scalar = f32>>(
    motion: &Motion<'_>,
    [place, live]: [usize; 2],
    active: u32,
    buffers: &mut RowBuffers,
) -> u32 {
    let [lower, upper] = &mut buffers.particles;
    lower.compute::<L>(motion, place, live);
    upper.compute::<L>(motion, place + 1, live);
    buffers.segments.compute::<L>(motion, [lower, upper], place, active);
    lower.counted & upper.counted
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
    fn load(rows: &EntryRows, first: usize) -> Self {
        Self {
            middle: V3::load(&rows.middle, 0, first),
            half: V3::load(&rows.half, 0, first),
            inverse: L::load(&rows.inverse, first),
            displacement: V3::load(&rows.displacement, 0, first),
            spread: L::load(&rows.spread, first),
            reach: L::load(&rows.reach, first),
        }
    }

    #[inline(always)]
    fn splat(entry: &Entry) -> Self {
        Self {
            middle: splat(entry.middle),
            half: splat(entry.half),
            inverse: L::splat(entry.inverse),
            displacement: splat(entry.displacement),
            spread: L::splat(entry.spread),
            reach: L::splat(entry.reach),
        }
    }
}

#[inline(always)]
fn splat<L: Lane<Scalar = f32>>(x: Vec3) -> V3<L> {
    V3([L::splat(x.x), L::splat(x.y), L::splat(x.z)])
}

/// The lanes whose balls are within reach of the segment `a`.
#[inline(always)]
fn balls_touch<L: Lane<Scalar = f32>>(a: &EntryLanes<L>, rows: &EntryRows, first: usize) -> u32 {
    let r = V3::load(&rows.middle, 0, first) - a.middle;
    let apart = r - a.half.scale(clamp(a.half.dot(r) * a.inverse));
    let radius = a.reach + L::load(&rows.radius, first);
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
    // More, for rounding: `across` is a difference.
    L::bits(across.lt(L::splat(ROUNDING).mul_add(r.dot(r), most)))
}

/// The lanes whose segments may approach `a` by more than `slip` in the slice: no two points do by
/// more than the means of the ends do, and both spreads.
#[inline(always)]
fn may_approach<L: Lane<Scalar = f32>>(a: &EntryLanes<L>, b: &EntryLanes<L>, slip: L) -> u32 {
    let relative = a.displacement - b.displacement;
    let left = (slip - a.spread - b.spread).max(L::zero());
    !L::bits(relative.dot(relative).lt(left * left)) & u32::MAX >> (32 - L::WIDTH)
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
    !L::bits(near.lt(square)) & u32::MAX >> (32 - L::WIDTH)
}

#[inline(always)]
fn clamp<L: Lane>(x: L) -> L {
    x.max(-L::one()).min(L::one())
}
