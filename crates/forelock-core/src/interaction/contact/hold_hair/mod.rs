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
//! # Limitations
//! Friction does not depend on how hard strands press on each other, and hair that is alone is held
//! by nothing. The mean motion is an average over some centimetres.

#![expect(clippy::needless_range_loop, reason = "one index for several arrays is what vectorises")]

use super::displacements::{ORIGIN, Place};
use super::mean_motion::{PARTS, SPACING, sum_parts};
use super::{ContactMoment, Displacements, MeanMotion, ParticleRows};
use crate::lane::{LANES, Real, Row, widest};
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
        let per_part = model.places().div_ceil(PARTS).max(1);
        parts.resize_with(PARTS, Vec::new);
        changes.par_chunks_mut(per_part).zip(&mut *parts).enumerate().for_each(|(part, (changes, nodes))| {
            fill(nodes, count, Vec4::ZERO);
            for ((change, groups), place) in changes.iter_mut().zip(per_part * part..) {
                widest(
                    #[inline(always)]
                    || {
                        hold.shorten(place, change, groups);
                        for group in groups.iter().filter(|group| group.sum.w > 0.0) {
                            mean_motion.add(nodes, group.middle, group.sum);
                        }
                    },
                );
            }
        });
        sum_parts(&parts[..model.places().div_ceil(per_part)], nodes);
        nodes.iter_mut().for_each(|sum| *sum /= sum.w.max(f32::MIN_POSITIVE));
        let (nodes, per_dt) = (&*nodes, 1.0 / moment.dt_secs);
        let turn = moment.head.matrix().as_mat3();
        let axes = turn.transpose().to_cols_array_2d();
        let ParticleRows { positions, velocities, clearance } = rows;
        let rows = positions.par_chunks_mut(3 * per_part).zip(velocities.par_chunks_mut(3 * per_part));
        let rows = rows.zip(clearance.par_chunks_mut(per_part)).zip(changes.par_chunks(per_part));
        rows.for_each(|(((positions, velocities), clearance), changes)| {
            for (own, (change, groups)) in changes.iter().enumerate() {
                if groups.iter().all(|group| group.sum.w == 0.0) {
                    continue;
                }
                let rows = [&mut positions[3 * own..][..3], &mut velocities[3 * own..][..3]];
                widest(
                    #[inline(always)]
                    || {
                        let means = groups.map(|group| mean_motion.interpolate(nodes, group.middle));
                        apply(change, &means, &axes, number(per_dt), rows, &mut clearance[own]);
                    },
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

    /// Writes the changes Δx of a place, zero for hair outside the box and for padding lanes, and
    /// what its groups add to the nodes.
    #[inline(always)]
    fn shorten(&self, place: usize, change: &mut Place, groups: &mut [Group; GROUPS]) {
        if self.is_clamped(place) {
            *groups = [Group::default(); GROUPS];
            return;
        }
        let [start, end] = self.displacements.place(place);
        let residual = self.field.residual(self.displacements, place);
        let live = self.block(place).live;
        let [low, high] = [self.field.extent[0].to_array(), self.field.extent[1].to_array()];
        let mut share = [0.0f32; LANES];
        for lane in 0..LANES {
            let (x, y, z) = (residual[0].0[lane], residual[1].0[lane], residual[2].0[lane]);
            let length = (x * x + y * y + z * z).sqrt();
            let mut counts = (length > 0.0) & (length < f32::INFINITY) & (lane < live);
            for c in 0..3 {
                let [a, b] = [start[c].0[lane], end[c].0[lane]];
                counts &= (a >= low[c]) & (b >= low[c]) & (a <= high[c]) & (b <= high[c]);
            }
            let own = self.most / length;
            let own = if own < 1.0 { own } else { 1.0 };
            share[lane] = if counts { own } else { 0.0 };
        }
        for c in 0..3 {
            for lane in 0..LANES {
                change[c].0[lane] = if share[lane] > 0.0 { -share[lane] * residual[c].0[lane] } else { 0.0 };
            }
        }
        let mut held = [0.0f32; LANES];
        let mut middle = [[0.0f32; LANES]; 3];
        for lane in 0..LANES {
            held[lane] = if share[lane] > 0.0 { 1.0 } else { 0.0 };
        }
        for c in 0..3 {
            for lane in 0..LANES {
                let own = 0.5 * (start[c].0[lane] + end[c].0[lane]);
                middle[c][lane] = if share[lane] > 0.0 { own } else { 0.0 };
            }
        }
        let counts = sums(&held);
        let mut of_axes = [[[0.0; GROUPS]; 2]; 3];
        for c in 0..3 {
            of_axes[c] = [sums(&middle[c]), sums(&change[c].0)];
        }
        for k in 0..GROUPS {
            let count = counts[k];
            let middle = Vec3::new(of_axes[0][0][k], of_axes[1][0][k], of_axes[2][0][k]) / count.max(1.0);
            let sum = Vec4::new(of_axes[0][1][k], of_axes[1][1][k], of_axes[2][1][k], count);
            groups[k] = Group { middle, sum };
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

/// Adds `change`, from which the `means` of its groups are subtracted, turned by `axes`, to
/// positions and its `per_dt` to velocities, and subtracts its length from the clearances.
#[inline(always)]
fn apply<T: Real>(
    change: &Place,
    means: &[Vec4; GROUPS],
    axes: &[[f32; 3]; 3],
    per_dt: T,
    [positions, velocities]: [&mut [Row<T>]; 2],
    clearance: &mut Row<T>,
) {
    // Loops read and write copies: the compiler vectorises only what cannot overlap.
    let (old, mut change) = (*change, ORIGIN);
    for c in 0..3 {
        let mut mean = [0.0f32; LANES];
        mean.chunks_exact_mut(GROUP).zip(means).for_each(|(lanes, mean)| lanes.fill(mean[c]));
        for lane in 0..LANES {
            let held = (old[0].0[lane] != 0.0) | (old[1].0[lane] != 0.0) | (old[2].0[lane] != 0.0);
            change[c].0[lane] = if held { old[c].0[lane] - mean[lane] } else { 0.0 };
        }
    }
    for (c, (position, velocity)) in positions.iter_mut().zip(velocities).enumerate() {
        let ([ax, ay, az], mut x, mut v) = (axes[c], position.0, velocity.0);
        for lane in 0..LANES {
            let by = ax * change[0].0[lane] + ay * change[1].0[lane] + az * change[2].0[lane];
            let by = T::from(by).unwrap_or_else(T::zero);
            x[lane] = x[lane] + by;
            v[lane] = v[lane] + by * per_dt;
        }
        (position.0, velocity.0) = (x, v);
    }
    let mut left = clearance.0;
    for lane in 0..LANES {
        let (x, y, z) = (change[0].0[lane], change[1].0[lane], change[2].0[lane]);
        let moved = T::from((x * x + y * y + z * z).sqrt()).unwrap_or_else(T::zero);
        let old = left[lane];
        let new = if old > moved { old - moved } else { T::zero() };
        // Below zero it is a depth, not a distance.
        left[lane] = if old >= T::zero() { new } else { old };
    }
    clearance.0 = left;
}
