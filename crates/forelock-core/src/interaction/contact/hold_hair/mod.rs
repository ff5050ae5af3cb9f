//! Friction between neighbouring hair: holds what moves slowly relative to its neighbours.
//!
//! # Theory
//! In dense hair every strand touches its neighbours all along, and Coulomb friction holds it as
//! long as the other forces on it accelerate it by less than some a relative to them. Over a frame
//! such an acceleration moves it by a dt². So the displacement u of each particle relative to the
//! mean around it, r = (1 − G) u, is shortened by that much, s = min(1, a dt²/|r|), and the mean of
//! the changes is subtracted from them:
//!
//! ```text
//! Δx = −(1 − G) s (1 − G) u ,   Δv = Δx/dt
//! ```
//!
//! Strands that are slower than a dt² relative to the mean are held, others are slowed down by a.
//! Contacts alone would stop each approach that is faster than
//! [`ContactParams::slip`](super::ContactParams::slip) and none that is slower, so strands that
//! press on others would slip and stick and never come to rest.
//!
//! G sums to nodes, divides by the sum of the weights at each node, and interpolates with the same
//! weights: it is symmetric, its eigenvalues lie in [0, 1], and those of (1 − G) s (1 − G) as well.
//! So friction never enlarges Σ u², whatever s. With another mean in one of the two places, wider
//! or of fewer particles, it would: rounding would grow tenfold in 20 frames, until strands at rest
//! moved by millimetres.
//!
//! # Practice
//! Neighbouring strands lie in neighbouring lanes. The displacements of [`GROUP`] of them at a
//! place are summed to the nodes around their middle, and the mean is interpolated there. Of a
//! group only particles within [`SPACING`] of the middle count; friction holds no others. The sum
//! of all changes is zero to rounding, and with it the change of momentum.
//!
//! The stage comes before the length pass, which restores the edges that it stretched.
//!
//! Friction holds a strand at up to d = a/ω² from where its ties draw it, 20 mm by default (ω = 10
//! s⁻¹). Hair that was shaken would stay that far from its shape. So where strands sleep, a fades
//! within [`CREEP_SECS`](super::CREEP_SECS) while head, gravity, air and colliders are still
//! ([`ContactParams::hold_after`](super::ContactParams::hold_after)), and no strand sleeps before:
//! hair creeps back to its shape, and friction at rest ([`crate::frame`]) then ends what slips and
//! sticks.
//!
//! # Limitations
//! Friction does not depend on how hard strands press on each other, and hair that is alone is held
//! by nothing. The mean motion is an average over some centimetres. A particle that is half a metre
//! from the seven others of its group moves their middle so far that none of them is held.

#![expect(clippy::needless_range_loop, reason = "one index for several arrays is what vectorises")]

use super::displacements::{ORIGIN, OUTSIDE, Place, square};
use super::mean_motion::{PARTS, sum_parts};
use super::{ContactMoment, Displacements, MeanMotion, ParticleRows};
use crate::lane::{LANES, Lane, Real, Row, Simd, V3, on, widest};
use crate::scratch::fill;
use crate::strands::{Block, Model, number};
use glam::{Vec3, Vec4};
use rayon::prelude::*;

/// WGSL of the kernels that compute the changes.
pub const WGSL: &str = include_str!("kernel.wgsl");
/// WGSL of the kernel that applies them.
pub const APPLY_WGSL: &str = include_str!("apply.wgsl");

/// Minimum distance between nodes, metres; also how far a particle may be from its group's middle.
pub const SPACING: f32 = 0.05;
/// Lanes that are summed together.
pub const GROUP: usize = 8;
/// Groups of a place.
const GROUPS: usize = LANES / GROUP;

/// Friction and its buffers.
#[derive(Debug)]
pub(crate) struct Friction {
    /// The nodes; the field on them is in `motion`.
    field: MeanMotion,
    places: Vec<HeldPlace>,
    /// Sums at each node, of each part: Σ w u and Σ w, then those of the changes.
    parts: Vec<Vec<Vec4>>,
    /// The mean displacement at each node.
    motion: Vec<Vec4>,
    /// The mean change at each node.
    changes: Vec<Vec4>,
}

/// What friction holds of a place.
#[derive(Clone, Copy, Debug)]
struct HeldPlace {
    /// 1 for particles that it holds, 0 for others.
    held: Row<f32>,
    groups: [Group; GROUPS],
}

/// Neighbouring lanes of a place.
#[derive(Clone, Copy, Debug, Default)]
struct Group {
    /// The middle of its particles, halfway through the frame.
    middle: Vec3,
    /// Number of its particles that are held.
    count: f32,
    /// Mean motion at the middle.
    mean: Vec3,
}

impl HeldPlace {
    const NONE: Self = Self {
        held: Row([0.0; LANES]),
        groups: [Group { middle: Vec3::ZERO, count: 0.0, mean: Vec3::ZERO }; GROUPS],
    };

    fn holds_any(&self) -> bool {
        self.groups.iter().any(|group| group.count > 0.0)
    }
}

impl Friction {
    /// Friction between the strands of `model`.
    pub fn new<T: Real>(model: &Model<T>) -> Self {
        Self {
            field: MeanMotion::new(SPACING),
            places: vec![HeldPlace::NONE; model.places()],
            parts: Vec::new(),
            motion: Vec::new(),
            changes: Vec::new(),
        }
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        let nodes = self.parts.iter().chain([&self.motion, &self.changes]).map(Vec::capacity).sum::<usize>();
        size_of::<Vec4>() * nodes + size_of_val(&*self.places) + self.field.bytes()
    }

    /// Changes positions and velocities of all particles except the clamped ones, and subtracts the
    /// distances from their clearances. `displacements` are those of the frame, `acceleration` is
    /// the largest that is held, m/s².
    pub fn hold<T: Real>(
        &mut self,
        model: &Model<T>,
        displacements: &Displacements,
        rows: ParticleRows<'_, T>,
        moment: &ContactMoment<'_>,
        acceleration: f64,
    ) {
        self.field.fit(displacements);
        let Self { field, places, parts, motion, changes } = self;
        let (field, most) = (&*field, (acceleration * moment.dt_secs * moment.dt_secs) as f32);
        let hold = Hold { displacements, field, most };
        let simd = Simd::up_to_eight();
        let (gather, shorten, settle) = (gather_for(simd), shorten_for(simd), settle_for(simd));
        let per_part = model.places().div_ceil(PARTS).max(1);
        let used = model.places().div_ceil(per_part);
        parts.resize_with(PARTS, Vec::new);
        let block = |place: usize| &model.blocks[displacements.block[place] as usize];
        let is_clamped = |block: &Block, place: usize| place - block.first < moment.clamped;
        places.par_chunks_mut(per_part).zip(&mut *parts).enumerate().for_each(|(part, (places, nodes))| {
            fill(nodes, field.count(), Vec4::ZERO);
            for (own, place) in places.iter_mut().zip(per_part * part..) {
                let block = block(place);
                if is_clamped(block, place) {
                    *own = HeldPlace::NONE;
                } else {
                    // SAFETY: the processor supports what `up_to_eight` returns.
                    unsafe { gather(&hold, [place, block.live], own, nodes) };
                }
            }
        });
        average(&parts[..used], motion);
        let means = &**motion;
        places.par_chunks_mut(per_part).zip(&mut *parts).enumerate().for_each(|(part, (places, nodes))| {
            fill(nodes, field.count(), Vec4::ZERO);
            let places = places.iter_mut().zip(per_part * part..);
            for (own, place) in places.filter(|(own, _)| own.holds_any()) {
                // SAFETY: as above.
                unsafe { shorten(&hold, place, means, own, nodes) };
            }
        });
        average(&parts[..used], changes);
        let (changes, per_dt) = (&**changes, 1.0 / moment.dt_secs);
        let axes = moment.head.matrix().as_mat3().transpose().to_cols_array_2d();
        let ParticleRows { positions, velocities, clearance } = rows;
        let rows = positions.par_chunks_mut(3 * per_part).zip(velocities.par_chunks_mut(3 * per_part));
        let rows = rows.zip(clearance.par_chunks_mut(per_part)).zip(places.par_chunks(per_part));
        rows.enumerate().for_each(|(part, (((positions, velocities), clearance), places))| {
            for (k, own) in places.iter().enumerate().filter(|(_, own)| own.holds_any()) {
                let rows = [&mut positions[3 * k..][..3], &mut velocities[3 * k..][..3]];
                let mut change = ORIGIN;
                // SAFETY: as above.
                let moved = unsafe { settle(&hold, per_part * part + k, own, changes, &axes, &mut change) };
                widest(
                    #[inline(always)]
                    || add(&change, &moved, number(per_dt), rows, &mut clearance[k]),
                );
            }
        });
    }
}

/// Writes to `nodes` the mean at each, from the sums of the parts.
fn average(parts: &[Vec<Vec4>], nodes: &mut Vec<Vec4>) {
    sum_parts(parts, nodes);
    nodes.iter_mut().for_each(|sum| *sum /= sum.w.max(f32::MIN_POSITIVE));
}

/// What is needed of a frame.
#[derive(Clone, Copy, Debug)]
struct Hold<'a> {
    displacements: &'a Displacements,
    field: &'a MeanMotion,
    /// The largest displacement that is held, metres.
    most: f32,
}

/// Finds the particles of a place that are held, given its number and its number of strands: those
/// in the box and within [`SPACING`] of the middle of their group. Adds their displacements to the
/// nodes.
///
/// # Safety
/// The processor must support the instruction set of the function.
type Gather = unsafe fn(&Hold<'_>, [usize; 2], &mut HeldPlace, &mut [Vec4]);

/// The function for `simd`, which the processor must support.
#[inline(never)]
fn gather_for(simd: Simd) -> Gather {
    on!(simd, gather(hold: &Hold<'_>, at: [usize; 2], own: &mut HeldPlace, nodes: &mut [Vec4]))
}

// No closures in what follows: the compiler does not inline instructions of other sets into them.
// Registers have at most GROUP lanes.
#[inline(always)]
fn gather<L: Lane<Scalar = f32>>(
    hold: &Hold<'_>,
    [place, live]: [usize; 2],
    own: &mut HeldPlace,
    nodes: &mut [Vec4],
) {
    let Hold { displacements, field, .. } = *hold;
    let [start, end] = displacements.place(place);
    let [low, high] = field.extent;
    let (zero, one) = (L::zero(), L::one());
    let mut middle = ORIGIN;
    for first in (0..LANES).step_by(L::WIDTH) {
        let (start, end): (V3<L>, V3<L>) = (V3::load(start, 0, first), V3::load(end, 0, first));
        // Not finite where there is no strand.
        let size = square(end - start) + L::load(&OUTSIDE[live], first);
        let mut held = L::select(size.lt(L::splat(f32::INFINITY)), one, zero);
        for c in 0..3 {
            held = L::select(start.0[c].min(end.0[c]).lt(L::splat(low[c])), zero, held);
            held = L::select(L::splat(high[c]).lt(start.0[c].max(end.0[c])), zero, held);
        }
        for c in 0..3 {
            let at = L::splat(0.5) * (start.0[c] + end.0[c]);
            L::select(zero.lt(held), at, zero).store(&mut middle[c], first);
        }
        held.store(&mut own.held, first);
    }
    let counts = sums(&own.held.0);
    let sums_of = [sums(&middle[0].0), sums(&middle[1].0), sums(&middle[2].0)];
    for k in 0..GROUPS {
        own.groups[k].middle = Vec3::new(sums_of[0][k], sums_of[1][k], sums_of[2][k]) / counts[k].max(1.0);
    }
    let mut motion = ORIGIN;
    for first in (0..LANES).step_by(L::WIDTH) {
        let (start, end): (V3<L>, V3<L>) = (V3::load(start, 0, first), V3::load(end, 0, first));
        let mut away: V3<L> = V3::load(&middle, 0, first);
        for c in 0..3 {
            away.0[c] -= L::splat(own.groups[first / GROUP].middle[c]);
        }
        let mut held = L::load(&own.held, first);
        held = L::select(square(away).lt(L::splat(SPACING * SPACING)), held, zero);
        held.store(&mut own.held, first);
        for c in 0..3 {
            L::select(zero.lt(held), end.0[c] - start.0[c], zero).store(&mut motion[c], first);
        }
    }
    add_groups(own, &motion, field, nodes);
}

/// Sums `values` of the particles that are held, zero for others, group by group and to the nodes.
#[inline(always)]
fn add_groups(own: &mut HeldPlace, values: &Place, field: &MeanMotion, nodes: &mut [Vec4]) {
    let counts = sums(&own.held.0);
    let sums_of = [sums(&values[0].0), sums(&values[1].0), sums(&values[2].0)];
    for k in 0..GROUPS {
        own.groups[k].count = counts[k];
        if counts[k] > 0.0 {
            let sum = Vec4::new(sums_of[0][k], sums_of[1][k], sums_of[2][k], counts[k]);
            field.add(nodes, own.groups[k].middle, sum);
        }
    }
}

/// The sum of the lanes of each group.
#[inline(always)]
fn sums(row: &[f32; LANES]) -> [f32; GROUPS] {
    let mut sums = *row;
    let mut width = GROUP / 2;
    while width > 0 {
        let from = sums;
        for k in 0..LANES - width {
            sums[k] = from[k] + from[k + width];
        }
        width /= 2;
    }
    let mut out = [0.0; GROUPS];
    for group in 0..GROUPS {
        out[group] = sums[GROUP * group];
    }
    out
}

/// −s (u − mean motion) of the particles of a place that are held, zero for others.
#[inline(always)]
fn changes_of<L: Lane<Scalar = f32>>(hold: &Hold<'_>, place: usize, own: &HeldPlace) -> Place {
    let [start, end] = hold.displacements.place(place);
    let (zero, one, most) = (L::zero(), L::one(), L::splat(hold.most));
    let mut changes = ORIGIN;
    for first in (0..LANES).step_by(L::WIDTH) {
        let (start, end): (V3<L>, V3<L>) = (V3::load(start, 0, first), V3::load(end, 0, first));
        let mut residual = end - start;
        for c in 0..3 {
            residual.0[c] -= L::splat(own.groups[first / GROUP].mean[c]);
        }
        let share = (most / square(residual).sqrt().max(L::splat(f32::MIN_POSITIVE))).min(one);
        let is_held = zero.lt(L::load(&own.held, first));
        for c in 0..3 {
            L::select(is_held, -(share * residual.0[c]), zero).store(&mut changes[c], first);
        }
    }
    changes
}

/// Interpolates the mean motion at the groups of the place of the given number, and adds the
/// changes of their particles to the nodes.
///
/// # Safety
/// The processor must support the instruction set of the function.
type Shorten = unsafe fn(&Hold<'_>, usize, &[Vec4], &mut HeldPlace, &mut [Vec4]);

/// The function for `simd`, which the processor must support.
#[inline(never)]
fn shorten_for(simd: Simd) -> Shorten {
    on!(simd, shorten(hold: &Hold<'_>, place: usize, motion: &[Vec4], own: &mut HeldPlace,
        nodes: &mut [Vec4]))
}

#[inline(always)]
fn shorten<L: Lane<Scalar = f32>>(
    hold: &Hold<'_>,
    place: usize,
    motion: &[Vec4],
    own: &mut HeldPlace,
    nodes: &mut [Vec4],
) {
    for k in 0..GROUPS {
        if own.groups[k].count > 0.0 {
            own.groups[k].mean = hold.field.interpolate(motion, own.groups[k].middle).truncate();
        }
    }
    let changes = changes_of::<L>(hold, place, own);
    add_groups(own, &changes, hold.field, nodes);
}

/// Writes the changes of the place of the given number, from which it subtracts their means at the
/// nodes, turned by the axes. Returns their lengths.
///
/// # Safety
/// The processor must support the instruction set of the function.
type Settle = unsafe fn(&Hold<'_>, usize, &HeldPlace, &[Vec4], &[[f32; 3]; 3], &mut Place) -> Row<f32>;

/// The function for `simd`, which the processor must support.
#[inline(never)]
fn settle_for(simd: Simd) -> Settle {
    on!(simd, settle(hold: &Hold<'_>, place: usize, own: &HeldPlace, nodes: &[Vec4],
        axes: &[[f32; 3]; 3], change: &mut Place) -> Row<f32>)
}

#[inline(always)]
fn settle<L: Lane<Scalar = f32>>(
    hold: &Hold<'_>,
    place: usize,
    own: &HeldPlace,
    nodes: &[Vec4],
    axes: &[[f32; 3]; 3],
    change: &mut Place,
) -> Row<f32> {
    let mut moved = Row([0.0; LANES]);
    let mut means = [Vec4::ZERO; GROUPS];
    for k in 0..GROUPS {
        means[k] = hold.field.interpolate(nodes, own.groups[k].middle);
    }
    let changes = changes_of::<L>(hold, place, own);
    for first in (0..LANES).step_by(L::WIDTH) {
        let mut left: V3<L> = V3::load(&changes, 0, first);
        let is_held = L::zero().lt(L::load(&own.held, first));
        for c in 0..3 {
            let balanced = left.0[c] - L::splat(means[first / GROUP][c]);
            left.0[c] = L::select(is_held, balanced, L::zero());
        }
        square(left).sqrt().store(&mut moved, first);
        for c in 0..3 {
            let [x, y, z] = axes[c];
            let turned = L::splat(x) * left.0[0] + L::splat(y) * left.0[1] + L::splat(z) * left.0[2];
            turned.store(&mut change[c], first);
        }
    }
    moved
}

/// Adds `change` to positions and its `per_dt` to velocities, and subtracts the lengths `moved`
/// from clearances.
#[inline(always)]
fn add<T: Real>(
    change: &Place,
    moved: &Row<f32>,
    per_dt: T,
    [positions, velocities]: [&mut [Row<T>]; 2],
    clearance: &mut Row<T>,
) {
    // Loops read and write copies: the compiler vectorises only what cannot overlap.
    for (c, (position, velocity)) in positions.iter_mut().zip(velocities).enumerate() {
        let (change, mut x, mut v) = (change[c].0, position.0, velocity.0);
        for lane in 0..LANES {
            let by = T::from(change[lane]).unwrap_or_else(T::zero);
            x[lane] = x[lane] + by;
            v[lane] = v[lane] + by * per_dt;
        }
        (position.0, velocity.0) = (x, v);
    }
    let (mut left, moved) = (clearance.0, moved.0);
    for lane in 0..LANES {
        let moved = T::from(moved[lane]).unwrap_or_else(T::zero);
        let old = left[lane];
        let new = if old > moved { old - moved } else { T::zero() };
        // Below zero it is a depth, not a distance.
        left[lane] = if old >= T::zero() { new } else { old };
    }
    clearance.0 = left;
}
