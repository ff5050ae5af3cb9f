//! Tests all pairs of segments in a cell, many at a time.

use crate::lane::{LANES, Lane, Pack, Row, V3};
use crate::solver::Simd;
use glam::Vec3;

/// A segment in the middle of a slice; lengths in cells.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Entry {
    pub segment: u32,
    /// Whether its contacts are sought.
    pub active: bool,
    /// Its lower end.
    pub at: Vec3,
    /// From its lower end to its upper.
    pub edge: Vec3,
    /// One over the square of the edge's length.
    pub inverse: f32,
    /// How far it reaches: half the contact distance and what it strays in half a slice.
    pub reach: f32,
    /// Mean of what its ends move in the slice.
    pub way: Vec3,
    /// How far the ends' own ways are from that.
    pub spread: f32,
}

/// Fields of an entry, as rows of a [`Group`].
const FIELDS: usize = 12;

/// The segments of a cell.
#[derive(Debug, Default)]
pub(crate) struct Group {
    segments: Vec<u32>,
    /// Sixteen entries each: field by field, in their order in [`Entry`].
    rows: Vec<[Row<f32>; FIELDS]>,
    hits: Vec<[u16; 2]>,
}

/// What a test is of: the cell's corner, and the contact distance.
type Where = (Vec3, f32);

/// Writes the pairs (lower, higher) of the first `count` entries, the lower one of the first `active`, that may touch and
/// belong to the cell.
///
/// # Safety
/// The processor must have the instruction set that the function was made for.
pub(super) type Test =
    unsafe fn(rows: &[[Row<f32>; FIELDS]], active: usize, count: usize, Where, &mut Vec<[u16; 2]>);

impl Group {
    pub fn bytes(&self) -> usize {
        4 * self.segments.capacity() + self.rows.capacity() * size_of::<[Row<f32>; FIELDS]>()
    }

    pub fn len(&self) -> usize {
        self.segments.len()
    }

    pub fn clear(&mut self) {
        self.segments.clear();
        self.rows.clear();
    }

    #[inline]
    pub fn push(&mut self, entry: &Entry) {
        let lane = self.segments.len() % LANES;
        if lane == 0 {
            // Places left over are empty: no number is near theirs.
            self.rows.push([Row([f32::NAN; LANES]); FIELDS]);
        }
        self.segments.push(entry.segment);
        let Some(rows) = self.rows.last_mut() else { return };
        let (at, edge, way) = (entry.at, entry.edge, entry.way);
        let (inverse, reach, spread) = (entry.inverse, entry.reach, entry.spread);
        let fields = [at.x, at.y, at.z, edge.x, edge.y, edge.z, inverse, reach, way.x, way.y, way.z, spread];
        for (row, value) in rows.iter_mut().zip(fields) {
            row.0[lane] = value;
        }
    }

    /// The pairs that may touch in the slice and belong to the cell, each with one of the first `active`.
    pub fn pairs(&mut self, test: Test, active: usize, place: Where) -> impl Iterator<Item = [u32; 2]> {
        self.hits.clear();
        // SAFETY: `test_for` is asked for what `Simulation` found supported.
        unsafe { test(&self.rows, active, self.segments.len(), place, &mut self.hits) };
        self.hits.iter().map(|pair| pair.map(|k| self.segments[usize::from(k)]))
    }
}

/// The test for `simd`, which must be supported.
pub(super) fn test_for(simd: Simd) -> Test {
    match simd {
        #[cfg(target_arch = "x86_64")]
        Simd::Avx2x1 | Simd::Avx2x4 | Simd::Avx2 | Simd::Avx2x16 => avx2,
        #[cfg(target_arch = "x86_64")]
        Simd::Avx512 => avx512,
        _ => test::<Pack<4, { crate::solver::BASELINE_FMA }>>,
    }
}

macro_rules! instantiate {
    ($($name:ident $features:literal $lane:ty;)*) => {$(
        #[cfg(target_arch = "x86_64")]
        #[target_feature(enable = $features)]
        fn $name(
            rows: &[[Row<f32>; FIELDS]],
            active: usize,
            count: usize,
            place: Where,
            hits: &mut Vec<[u16; 2]>,
        ) {
            test::<$lane>(rows, active, count, place, hits);
        }
    )*};
}
instantiate! {
    avx2 "avx2,fma" crate::lane::Avx2;
    avx512 "avx512f,avx512vl,avx512dq,avx512bw,avx2,fma" crate::lane::Avx512;
}

/// Some entries, one a lane, or one in all lanes.
#[derive(Clone, Copy)]
struct Side<L> {
    at: V3<L>,
    edge: V3<L>,
    inverse: L,
    reach: L,
    way: V3<L>,
    spread: L,
}

impl<L: Lane<Scalar = f32>> Side<L> {
    #[inline(always)]
    fn load(rows: &[Row<f32>; FIELDS], first: usize) -> Self {
        Self {
            at: V3([L::load(&rows[0], first), L::load(&rows[1], first), L::load(&rows[2], first)]),
            edge: V3([L::load(&rows[3], first), L::load(&rows[4], first), L::load(&rows[5], first)]),
            inverse: L::load(&rows[6], first),
            reach: L::load(&rows[7], first),
            way: V3([L::load(&rows[8], first), L::load(&rows[9], first), L::load(&rows[10], first)]),
            spread: L::load(&rows[11], first),
        }
    }

    #[inline(always)]
    fn splat(rows: &[Row<f32>; FIELDS], lane: usize) -> Self {
        let f = |k: usize| rows[k].0[lane];
        Self {
            at: V3([L::splat(f(0)), L::splat(f(1)), L::splat(f(2))]),
            edge: V3([L::splat(f(3)), L::splat(f(4)), L::splat(f(5))]),
            inverse: L::splat(f(6)),
            reach: L::splat(f(7)),
            way: V3([L::splat(f(8)), L::splat(f(9)), L::splat(f(10))]),
            spread: L::splat(f(11)),
        }
    }
}

#[inline(always)]
fn test<L: Lane<Scalar = f32>>(
    rows: &[[Row<f32>; FIELDS]],
    active: usize,
    count: usize,
    (corner, distance): Where,
    hits: &mut Vec<[u16; 2]>,
) {
    let corner = V3([L::splat(corner.x), L::splat(corner.y), L::splat(corner.z)]);
    let distance = L::splat(distance);
    for i in 0..active.min(count - 1) {
        let a = Side::<L>::splat(&rows[i / LANES], i % LANES);
        let mut first = (i + 1) / L::WIDTH * L::WIDTH;
        while first < count {
            let b = Side::<L>::load(&rows[first / LANES], first % LANES);
            let mut bits = near(&a, &b, &corner, distance);
            while bits != 0 {
                let j = first + bits.trailing_zeros() as usize;
                bits &= bits - 1;
                if j > i {
                    #[expect(clippy::cast_possible_truncation, reason = "at most CELL_SEGMENTS")]
                    hits.push([i as u16, j as u16]);
                }
            }
            first += L::WIDTH;
        }
    }
}

/// The lanes whose segments may touch `a` in the slice, where the point that divides their distance is in the cell.
#[inline(always)]
fn near<L: Lane<Scalar = f32>>(a: &Side<L>, b: &Side<L>, corner: &V3<L>, distance: L) -> u32 {
    let r = a.at - b.at;
    let (ab, ar, br) = (a.edge.dot(b.edge), a.edge.dot(r), b.edge.dot(r));
    // As `contact::closest`, by inverses: with |a|² = 1/ia, s = (ab br − ar bb)/(aa bb − ab²), times ia ib above and below.
    let (ia, ib) = (a.inverse, b.inverse);
    let across = (L::one() - ab * ab * ia * ib).max(L::splat(1e-6));
    let s = clamp((ab * br * ib - ar) * ia / across);
    let t = clamp(ab.mul_add(s, br) * ib);
    let s = clamp((ab.mul_add(t, -ar)) * ia);
    let pa = a.at + a.edge.scale(s);
    let apart = pa - b.at - b.edge.scale(t);
    let way = a.way - b.way;
    let reach = L::splat(0.5).mul_add(way.dot(way).sqrt() + a.spread + b.spread, distance);
    let at = pa - apart.scale(a.reach / (a.reach + b.reach)) - *corner;
    let low = at.0[0].min(at.0[1]).min(at.0[2]);
    let high = at.0[0].max(at.0[1]).max(at.0[2]);
    let touch = L::bits(apart.dot(apart).lt(reach * reach));
    // `low ≥ 0` as not `low < 0`: numbers that are none fail the first test.
    touch & !L::bits(low.lt(L::zero())) & L::bits(high.lt(L::one()))
}

#[inline(always)]
fn clamp<L: Lane>(x: L) -> L {
    x.max(L::zero()).min(L::one())
}
