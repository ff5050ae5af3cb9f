//! The segments of a row, computed in lanes.

use super::Slice;
use super::pairs::Entry;
use crate::interaction::contact::Displacements;
use crate::interaction::contact::displacements::{ORIGIN, Place, square};
use crate::lane::{LANES, Lane, Row, V3};
use glam::Vec3;

/// Bounds of positions in the middle of the slice, and of displacements in it, lower and upper
/// corners.
pub(super) type Bounds = [[Vec3; 2]; 2];

/// Bounds that hold nothing.
const NOTHING: Bounds = [[Vec3::INFINITY, Vec3::NEG_INFINITY]; 2];

/// The motion of the hair in a slice.
#[derive(Clone, Copy, Debug)]
pub(super) struct Motion<'a> {
    pub displacements: &'a Displacements,
    pub slice: &'a Slice,
    /// Segments are ignored of which a particle is farther than `edge` outside this box. Metres.
    pub extent: [Vec3; 2],
    /// See [`search_edge`](super::search_edge).
    pub edge: f32,
}

impl Motion<'_> {
    /// The first `live` lanes of `place` whose segments are active.
    pub fn active_lanes(&self, place: usize, live: usize) -> u32 {
        let floor = self.slice.active.floor();
        let [lower, upper] = [place, place + 1].map(|place| &self.displacements.residual_motion[place].0);
        let mut is_fast = [false; LANES];
        for lane in 0..LANES {
            is_fast[lane] = lower[lane].max(upper[lane]) >= floor;
        }
        if is_fast == [false; LANES] {
            return 0;
        }
        let mut active = 0;
        for lane in (0..live).filter(|&lane| is_fast[lane]) {
            let segment = LANES * place + lane;
            let residual = self.displacements.residual_of_segment(segment);
            active |= u32::from(self.slice.active.includes(segment, residual)) << lane;
        }
        active
    }
}

/// The particles of a place in a slice.
#[derive(Debug)]
pub(super) struct Particles {
    /// Positions in the middle of the slice.
    middle: Place,
    /// Displacements in the slice.
    displacement: Place,
    /// Bits of the lanes that are looked at: those of strands, inside the box.
    pub counted: u32,
    /// Bounds of the particles of these lanes.
    pub bounds: Bounds,
    /// Largest residual motion of the frame, metres.
    pub residual: f32,
}

impl Default for Particles {
    fn default() -> Self {
        Self { middle: ORIGIN, displacement: ORIGIN, counted: 0, bounds: NOTHING, residual: 0.0 }
    }
}

impl Particles {
    /// Computes the particles of `place`, of which the first `live` lanes hold strands. Lanes that
    /// are not looked at repeat one that is.
    #[inline(always)]
    pub fn compute<L: Lane<Scalar = f32>>(&mut self, motion: &Motion<'_>, place: usize, live: usize) {
        let [from, to] = motion.displacements.place(place);
        let (when, length) = (L::splat(motion.slice.middle()), L::splat(motion.slice.length()));
        // No closures: the compiler does not inline instructions of other sets into them.
        let mut inside = 0;
        for first in (0..LANES).step_by(L::WIDTH) {
            let start = V3::<L>::load(from, 0, first);
            let moved = V3::load(to, 0, first) - start;
            let middle = start + moved.scale(when);
            let mut own = u32::MAX;
            for c in 0..3 {
                // Wider for rounding. NaN is not inside.
                let [low, high] = [motion.extent[0][c] - motion.edge, motion.extent[1][c] + motion.edge];
                own &= L::bits(L::splat(low).lt(middle.0[c])) & L::bits(middle.0[c].lt(L::splat(high)));
            }
            inside |= (own & u32::MAX >> (32 - L::WIDTH)) << first;
            middle.store(&mut self.middle, 0, first);
            moved.scale(length).store(&mut self.displacement, 0, first);
        }
        self.counted = inside & u32::MAX >> (32 - live);
        self.bounds = NOTHING;
        self.residual = 0.0;
        if self.counted == 0 {
            return;
        }
        if self.counted != u32::MAX >> (32 - LANES) {
            self.repeat_counted();
        }
        for c in 0..3 {
            let [low, high] = bounds(&self.middle[c]);
            (self.bounds[0][0][c], self.bounds[0][1][c]) = (low, high);
            let [low, high] = bounds(&self.displacement[c]);
            (self.bounds[1][0][c], self.bounds[1][1][c]) = (low, high);
        }
        self.residual = bounds(&motion.displacements.residual_motion[place])[1];
    }

    /// Copies the first lane that is looked at to those that are not.
    #[cold]
    fn repeat_counted(&mut self) {
        let from = self.counted.trailing_zeros() as usize;
        for lane in (0..LANES).filter(|lane| self.counted >> lane & 1 == 0) {
            for row in self.middle.iter_mut().chain(&mut self.displacement) {
                row.0[lane] = row.0[from];
            }
        }
    }
}

/// The least and the largest number of a row.
#[inline(always)]
fn bounds(row: &Row<f32>) -> [f32; 2] {
    let (mut low, mut high) = (row.0, row.0);
    let mut width = LANES;
    while width > 1 {
        width /= 2;
        for k in 0..width {
            low[k] = if low[k + width] < low[k] { low[k + width] } else { low[k] };
            high[k] = if high[k + width] > high[k] { high[k + width] } else { high[k] };
        }
    }
    [low[0], high[0]]
}

/// The box around two boxes of bounds.
#[inline(always)]
pub(super) fn join(a: &Bounds, b: &Bounds) -> Bounds {
    let mut both = *a;
    for k in 0..2 {
        both[k] = [a[k][0].min(b[k][0]), a[k][1].max(b[k][1])];
    }
    both
}

/// The segments between the particles of two places, an [`Entry`] in each lane.
#[derive(Debug)]
pub(super) struct EntryRows {
    pub middle: Place,
    pub half: Place,
    pub displacement: Place,
    pub radius: Row<f32>,
    pub inverse: Row<f32>,
    pub reach: Row<f32>,
    pub spread: Row<f32>,
}

impl Default for EntryRows {
    fn default() -> Self {
        let row = Row([0.0; LANES]);
        let (radius, inverse, reach, spread) = (row, row, row, row);
        Self { middle: ORIGIN, half: ORIGIN, displacement: ORIGIN, radius, inverse, reach, spread }
    }
}

impl EntryRows {
    /// Computes the segments from the particles of `place` to those of the next place. In the lanes
    /// whose bits are set in `active` segments are active.
    #[inline(always)]
    pub fn compute<L: Lane<Scalar = f32>>(
        &mut self,
        motion: &Motion<'_>,
        [lower, upper]: [&Particles; 2],
        place: usize,
        active: u32,
    ) {
        let half = L::splat(0.5);
        let [base, slope, most] = motion.slice.reach_terms(false, motion.edge);
        let residual = &motion.displacements.residual_motion;
        for first in (0..LANES).step_by(L::WIDTH) {
            let (a, b) = (V3::<L>::load(&lower.middle, 0, first), V3::load(&upper.middle, 0, first));
            (a + b).scale(half).store(&mut self.middle, 0, first);
            let along = (b - a).scale(half);
            along.store(&mut self.half, 0, first);
            let half_squared = square(along);
            (L::one() / half_squared.max(L::splat(1e-20))).store(&mut self.inverse, first);
            let (a, b) =
                (V3::<L>::load(&lower.displacement, 0, first), V3::load(&upper.displacement, 0, first));
            (a + b).scale(half).store(&mut self.displacement, 0, first);
            square((b - a).scale(half)).sqrt().store(&mut self.spread, first);
            let residual = L::load(&residual[place], first).max(L::load(&residual[place + 1], first));
            let reach = (L::splat(base) + L::splat(slope) * residual).min(L::splat(most));
            reach.store(&mut self.reach, first);
            (half_squared.sqrt() + reach).store(&mut self.radius, first);
        }
        if active != 0 {
            self.widen(motion, place, active);
        }
    }

    /// Gives active segments their larger reach.
    fn widen(&mut self, motion: &Motion<'_>, place: usize, active: u32) {
        for lane in lanes(active) {
            let residual = motion.displacements.residual_of_segment(LANES * place + lane);
            let reach = motion.slice.reach(residual, true, motion.edge);
            self.radius.0[lane] += reach - self.reach.0[lane];
            self.reach.0[lane] = reach;
        }
    }

    /// The segment in a lane.
    pub fn entry(&self, place: usize, lane: usize) -> Entry {
        let vector = |rows: &Place| Vec3::new(rows[0].0[lane], rows[1].0[lane], rows[2].0[lane]);
        Entry {
            segment: (LANES * place + lane) as u32,
            middle: vector(&self.middle),
            half: vector(&self.half),
            inverse: self.inverse.0[lane],
            reach: self.reach.0[lane],
            displacement: vector(&self.displacement),
            spread: self.spread.0[lane],
        }
    }
}

/// The lanes whose bits are set.
pub(super) fn lanes(mut bits: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let lane = bits.trailing_zeros() as usize;
        bits &= bits.wrapping_sub(1);
        (lane < 32).then_some(lane)
    })
}
