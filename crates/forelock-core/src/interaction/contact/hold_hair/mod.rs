//! Friction between neighbouring hair: holds what moves slowly relative to its neighbours.
//!
//! # Theory
//! In dense hair every strand touches its neighbours all along, and Coulomb friction holds it as
//! long as the other forces on it accelerate it by less than some a relative to them. Over a frame
//! such an acceleration moves it by a dt², so the displacement of a particle relative to the mean
//! motion around it, r, is shortened by that much:
//!
//! ```text
//! Δx = −min(1, a dt²/|r|) r ,   Δv = Δx/dt
//! ```
//!
//! Strands that move with the mean are held, others are slowed down by a. Contacts alone would stop
//! each approach that is faster than [`ContactParams::slip`](super::ContactParams::slip) and none
//! that is slower, so strands that press on others would slip and stick and never come to rest.
//!
//! # Practice
//! Neighbouring strands lie in neighbouring lanes. The changes of [`GROUP`] of them at a place are
//! summed to the nodes around their middle, and the mean of the changes at the nodes, interpolated
//! in the same way, is subtracted from those of the group. So the sum of all changes is zero to
//! rounding, and with it the change of momentum.
//!
//! The stage comes before the length pass, which restores the edges that it stretched.
//!
//! Friction holds a strand at up to d = a/ω² from where its ties draw it, 12 mm by default (ω = 10
//! s⁻¹). Hair that was shaken would stay that far from its shape. So where strands sleep, a fades
//! within [`CREEP_SECS`](super::CREEP_SECS) while head, gravity, air and colliders are still
//! ([`ContactParams::hold_after`](super::ContactParams::hold_after)): hair creeps back to its
//! shape, and friction at rest ([`crate::frame`]) then ends what slips and sticks.
//!
//! # Limitations
//! Where friction holds all strands so well that they are still for a second, they sleep before it
//! has faded, and keep their distance from their shape.
//!
//! The mean motion is one of every eighth lane over 27 nodes, the mean of the changes one of all
//! lanes over eight. The two together can enlarge small motions: in tufts of up to about a thousand
//! strands at rest, rounding grows to millimetres within seconds unless strands sleep.
//!
//! Friction does not depend on how hard strands press on each other, and hair that is alone is held
//! by nothing. The mean motion is an average over some centimetres.

#![expect(clippy::needless_range_loop, reason = "one index for several arrays is what vectorises")]

use super::displacements::{ORIGIN, OUTSIDE, Place, square};
use super::mean_motion::{PARTS, SPACING, sum_parts};
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

/// Lanes whose changes are summed together.
pub const GROUP: usize = 8;
/// Groups of a place.
const GROUPS: usize = LANES / GROUP;

/// Friction and its buffers.
#[derive(Debug)]
pub(crate) struct Friction {
    mean_motion: MeanMotion,
    /// Changes of the positions of each place, metres in the frame of the head.
    changes: Vec<(Place, [Group; GROUPS])>,
    /// Σ w Δx and Σ w at each node, of each part; then the sums of all.
    parts: Vec<Vec<Vec4>>,
    nodes: Vec<Vec4>,
}

impl Friction {
    /// Friction between the strands of `model`.
    pub fn new<T: Real>(model: &Model<T>) -> Self {
        Self {
            mean_motion: MeanMotion::new(SPACING),
            changes: vec![(ORIGIN, [Group::default(); GROUPS]); model.places()],
            parts: Vec::new(),
            nodes: Vec::new(),
        }
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        let nodes = self.nodes.capacity() + self.parts.iter().map(Vec::capacity).sum::<usize>();
        size_of::<Vec4>() * nodes + size_of_val(&*self.changes) + self.mean_motion.bytes()
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
        self.mean_motion.measure_field(model, displacements);
        let Self { mean_motion, changes, parts, nodes } = self;
        let hold = Hold {
            model,
            displacements,
            field: mean_motion,
            most: (acceleration * moment.dt_secs * moment.dt_secs) as f32,
            clamped: moment.clamped,
        };
        let count = mean_motion.count();
        let shorten = shorten_for(Simd::up_to_eight());
        let per_part = model.places().div_ceil(PARTS).max(1);
        parts.resize_with(PARTS, Vec::new);
        changes.par_chunks_mut(per_part).zip(&mut *parts).enumerate().for_each(|(part, (changes, nodes))| {
            fill(nodes, count, Vec4::ZERO);
            for ((change, groups), place) in changes.iter_mut().zip(per_part * part..) {
                if hold.is_clamped(place) {
                    *groups = [Group::default(); GROUPS];
                    continue;
                }
                // SAFETY: the processor supports what `up_to_eight` returns.
                unsafe { shorten(&hold.of(place), change, groups, nodes) };
            }
        });
        sum_parts(&parts[..model.places().div_ceil(per_part)], nodes);
        nodes.iter_mut().for_each(|sum| *sum /= sum.w.max(f32::MIN_POSITIVE));
        let (nodes, per_dt) = (&*nodes, 1.0 / moment.dt_secs);
        let turn = moment.head.matrix().as_mat3();
        let axes = turn.transpose().to_cols_array_2d();
        let settle = settle_for(Simd::up_to_eight());
        let ParticleRows { positions, velocities, clearance } = rows;
        let rows = positions.par_chunks_mut(3 * per_part).zip(velocities.par_chunks_mut(3 * per_part));
        let rows = rows.zip(clearance.par_chunks_mut(per_part)).zip(changes.par_chunks(per_part));
        rows.for_each(|(((positions, velocities), clearance), changes)| {
            for (own, (change, groups)) in changes.iter().enumerate() {
                if groups.iter().all(|group| group.sum.w == 0.0) {
                    continue;
                }
                let rows = [&mut positions[3 * own..][..3], &mut velocities[3 * own..][..3]];
                let mut change = *change;
                // SAFETY: the processor supports what `up_to_eight` returns.
                let moved = unsafe { settle(&mut change, groups, mean_motion, nodes, &axes) };
                widest(
                    #[inline(always)]
                    || add(&change, &moved, number(per_dt), rows, &mut clearance[own]),
                );
            }
        });
    }
}

/// What is needed of a frame.
struct Hold<'a, T> {
    model: &'a Model<T>,
    displacements: &'a Displacements,
    field: &'a MeanMotion,
    /// The largest displacement that is held, metres.
    most: f32,
    clamped: usize,
}

impl<T: Real> Hold<'_, T> {
    fn block(&self, place: usize) -> &Block {
        &self.model.blocks[self.displacements.block[place] as usize]
    }

    /// Whether the particles of a place follow the head.
    fn is_clamped(&self, place: usize) -> bool {
        place - self.block(place).first < self.clamped
    }

    fn of(&self, place: usize) -> HoldPlace<'_> {
        let Self { displacements, field, most, .. } = *self;
        HoldPlace { displacements, field, most, place, live: self.block(place).live }
    }
}

/// What is needed of a place.
#[derive(Clone, Copy, Debug)]
struct HoldPlace<'a> {
    displacements: &'a Displacements,
    field: &'a MeanMotion,
    most: f32,
    place: usize,
    live: usize,
}

/// Writes the changes Δx of a place, zero for hair outside the box and for padding lanes, and its
/// groups, and adds the groups to the nodes.
///
/// # Safety
/// The processor must support the instruction set of the function.
type Shorten = unsafe fn(&HoldPlace<'_>, &mut Place, &mut [Group; GROUPS], &mut [Vec4]);

/// The function for `simd`, which the processor must support.
#[inline(never)]
fn shorten_for(simd: Simd) -> Shorten {
    on!(simd, shorten(hold: &HoldPlace<'_>, change: &mut Place, groups: &mut [Group; GROUPS],
        nodes: &mut [Vec4]))
}

// No closures in what follows: the compiler does not inline instructions of other sets into them.
#[inline(always)]
fn shorten<L: Lane<Scalar = f32>>(
    hold: &HoldPlace<'_>,
    change: &mut Place,
    groups: &mut [Group; GROUPS],
    nodes: &mut [Vec4],
) {
    let HoldPlace { displacements, field, most, place, live } = *hold;
    let [start, end] = displacements.place(place);
    let mut residual = ORIGIN;
    field.residual::<L>(displacements, place, &mut residual);
    let [low, high] = field.extent;
    let (mut held, mut middle) = (Row([0.0; LANES]), ORIGIN);
    let (zero, one) = (L::zero(), L::one());
    for first in (0..LANES).step_by(L::WIDTH) {
        let (start, end): (V3<L>, V3<L>) = (V3::load(start, 0, first), V3::load(end, 0, first));
        let residual: V3<L> = V3::load(&residual, 0, first);
        // Not finite where there is no strand.
        let length = square(residual).sqrt() + L::load(&OUTSIDE[live], first);
        let mut share = (L::splat(most) / length).min(one);
        share = L::select(zero.lt(length), share, zero);
        share = L::select(length.lt(L::splat(f32::INFINITY)), share, zero);
        for c in 0..3 {
            let (low, high) = (L::splat(low[c]), L::splat(high[c]));
            share = L::select(start.0[c].min(end.0[c]).lt(low), zero, share);
            share = L::select(high.lt(start.0[c].max(end.0[c])), zero, share);
        }
        let is_held = zero.lt(share);
        for c in 0..3 {
            let by = -(share * residual.0[c]);
            L::select(is_held, by, zero).store(&mut change[c], first);
            let at = L::splat(0.5) * (start.0[c] + end.0[c]);
            L::select(is_held, at, zero).store(&mut middle[c], first);
        }
        L::select(is_held, one, zero).store(&mut held, first);
    }
    let counts = sums(&held.0);
    let mut of_axes = [[[0.0; GROUPS]; 2]; 3];
    for c in 0..3 {
        of_axes[c] = [sums(&middle[c].0), sums(&change[c].0)];
    }
    for k in 0..GROUPS {
        let count = counts[k];
        let middle = Vec3::new(of_axes[0][0][k], of_axes[1][0][k], of_axes[2][0][k]) / count.max(1.0);
        let sum = Vec4::new(of_axes[0][1][k], of_axes[1][1][k], of_axes[2][1][k], count);
        groups[k] = Group { middle, sum };
        if count > 0.0 {
            field.add(nodes, middle, sum);
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

/// Neighbouring lanes of a place.
#[derive(Clone, Copy, Debug, Default)]
struct Group {
    /// The mean of the places of those that are held in the middle of the frame.
    middle: Vec3,
    /// The sum of their changes, and their number.
    sum: Vec4,
}

/// Subtracts from the changes of a place, where there are any, what the nodes hold around its
/// groups, and turns them by the axes. Returns their lengths.
///
/// # Safety
/// The processor must support the instruction set of the function.
type Settle = unsafe fn(&mut Place, &[Group; GROUPS], &MeanMotion, &[Vec4], &[[f32; 3]; 3]) -> Row<f32>;

/// The function for `simd`, which the processor must support.
#[inline(never)]
fn settle_for(simd: Simd) -> Settle {
    on!(simd, settle(change: &mut Place, groups: &[Group; GROUPS], field: &MeanMotion, nodes: &[Vec4],
        axes: &[[f32; 3]; 3]) -> Row<f32>)
}

#[inline(always)]
fn settle<L: Lane<Scalar = f32>>(
    change: &mut Place,
    groups: &[Group; GROUPS],
    field: &MeanMotion,
    nodes: &[Vec4],
    axes: &[[f32; 3]; 3],
) -> Row<f32> {
    let mut moved = Row([0.0; LANES]);
    let mut means = [Vec4::ZERO; GROUPS];
    for k in 0..GROUPS {
        means[k] = field.interpolate(nodes, groups[k].middle);
    }
    for first in (0..LANES).step_by(L::WIDTH) {
        let own: V3<L> = V3::load(change, 0, first);
        let is_held = L::zero().lt(square(own));
        let mut left = V3::<L>::zero();
        for c in 0..3 {
            let mut mean = L::splat(means[first / GROUP][c]);
            for lane in GROUP..L::WIDTH {
                mean.set(lane, means[lane / GROUP][c]);
            }
            left.0[c] = L::select(is_held, own.0[c] - mean, L::zero());
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
