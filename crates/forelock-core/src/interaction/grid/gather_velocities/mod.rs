//! The transfer from grid to particles (G2P): adds the change of the grid's velocity to the
//! strands.
//!
//! # Theory
//! A sample is a point on an edge that carries a share of the edge's mass. With the interpolation
//! weights w, the new velocities u at the nodes of the grid and their changes Δu, the velocity v_s
//! of a sample changes by a blend of FLIP, which adds the change of the grid's velocity, and PIC,
//! which replaces the sample's velocity by the grid's:
//!
//! ```text
//! Δv_s = (1 − p) Σ w Δu + p (Σ w u − v_s) = Σ w (Δu + p (u − Δu)) − p v_s ,
//! p = 1 − exp(−pic_rate · dt)
//! ```
//!
//! The velocity of a particle changes by the mean of Δv_s over the samples of its two edges,
//! weighted by the mass m_s and the linear shape function N_i: Δv_i = Σ_s m_s N_i(s) Δv_s / Σ_s m_s
//! N_i(s). This is the transpose of the splat, so momentum is conserved to rounding.
//!
//! # Practice
//! Velocities and displacements come in one pass, and displacements are subtracted from the
//! clearances of the particles that they move.

#![expect(clippy::needless_range_loop, reason = "the index selects one lane of several arrays")]

use crate::interaction::grid::bounds::masked;
use crate::interaction::grid::{
    Grid, GridMoment, Lanes, Lattice, Node, ParticleRows, Stencils, View, between, to_f32,
};
use crate::interaction::transpose::{Rows, rows_of_nodes};
use crate::lane::{LANES, Real, Row, widest};
use crate::strands::{Block, Model};

/// Adds the change of the grid's velocity to the velocities of all particles, except the first
/// `clamped` of each strand, and if `shifts`, the displacements that the grid computes for hair
/// that is too dense to their positions.
pub(crate) fn gather<T: Real>(
    grid: &Grid,
    model: &Model<T>,
    rows: ParticleRows<'_, T>,
    moment: &GridMoment<'_>,
    shifts: bool,
) {
    let gather = Gather {
        grid,
        view: View::new(&moment.frame, &grid.bounds, grid.cell),
        lattice: grid.bounds.lattice(),
        pic: grid.params.pic_share(moment.dt_secs) as f32,
        clamped: moment.clamped,
        shifts,
    };
    rows.split(&grid.patches, &model.blocks, &|patch, mut rows| {
        for (block, &points) in model.blocks[patch.blocks.clone()].iter().zip(&patch.points) {
            let [mut own, rest] = rows.split_at(block.particles);
            rows = rest;
            widest(
                #[inline(always)]
                || gather.block(model, block, points, &mut own),
            );
        }
    });
}

struct Gather<'a> {
    grid: &'a Grid,
    view: View,
    lattice: Lattice,
    /// Fraction p of PIC.
    pic: f32,
    clamped: usize,
    /// Whether hair is displaced.
    shifts: bool,
}

/// Sums over the samples of a particle, lane by lane.
#[derive(Clone, Copy)]
struct Sum {
    /// Weighted changes of velocity.
    change: Lanes,
    /// Weighted displacements.
    shift: Lanes,
    weight: [f32; LANES],
}

const NOTHING: Sum = Sum { change: [[0.0; LANES]; 3], shift: [[0.0; LANES]; 3], weight: [0.0; LANES] };

/// One sample on an edge of each strand of a block, and what the grid gives it.
#[derive(Default)]
struct Found {
    at: Lanes,
    velocity: Lanes,
    stencils: Stencils,
    /// All bits of the lanes that count.
    counts: [u32; LANES],
    nodes: [Node; LANES],
    /// Changes of velocity along the axes of the grid in the first three, displacements from the
    /// fifth on.
    rows: Rows,
}

impl Found {
    /// Sets the changes from what was interpolated, with the fraction `pic` of PIC; zero in lanes
    /// that are not `live` or outside the box.
    #[inline(always)]
    fn blend(&mut self, pic: f32, live: &[u32; LANES]) {
        let Self { velocity, counts, nodes, rows, .. } = self;
        rows_of_nodes(nodes, rows);
        for k in 0..LANES {
            counts[k] &= live[k];
        }
        for c in 0..3 {
            for k in 0..LANES {
                rows[c][k] = masked(rows[c][k] - pic * velocity[c][k], counts[k]);
            }
            for k in 0..LANES {
                rows[4 + c][k] = masked(rows[4 + c][k], counts[k]);
            }
        }
    }
}

impl Sum {
    #[inline(always)]
    fn clear(&mut self) {
        self.weight = [0.0; LANES];
        for row in self.change.iter_mut().chain(&mut self.shift) {
            *row = [0.0; LANES];
        }
    }

    /// Adds changes and displacements with weights `factor` times `mass`.
    #[inline(always)]
    fn add<T: Real>(&mut self, factor: f32, mass: &[T; LANES], found: &Rows) {
        for k in 0..LANES {
            self.weight[k] += factor * to_f32(mass[k]);
        }
        for c in 0..3 {
            for k in 0..LANES {
                self.change[c][k] += factor * to_f32(mass[k]) * found[c][k];
            }
        }
        for c in 0..3 {
            for k in 0..LANES {
                self.shift[c][k] += factor * to_f32(mass[k]) * found[4 + c][k];
            }
        }
    }
}

impl Gather<'_> {
    /// Changes the rows of `block`.
    #[inline(always)]
    fn block<T: Real>(&self, model: &Model<T>, block: &Block, points: usize, rows: &mut ParticleRows<'_, T>) {
        let share = 1.0 / points as f32;
        let mut live = [0; LANES];
        live[..block.live].fill(u32::MAX);
        let Self { view, grid, lattice, .. } = self;
        let mut found = Found::default();
        // The ends of an edge: the first particle is at its number modulo 2.
        let mut at = [[[0.0; LANES]; 3]; 2];
        let mut velocity = at;
        let mut sums = [NOTHING; 2];
        view.place(rows.positions, 0, &mut at[0]);
        view.velocity([&*rows.positions, &*rows.velocities], 0, &mut velocity[0]);
        for edge in 0..block.particles - 1 {
            let (from, to) = (edge & 1, !edge & 1);
            view.place(rows.positions, edge + 1, &mut at[to]);
            view.velocity([&*rows.positions, &*rows.velocities], edge + 1, &mut velocity[to]);
            sums[to].clear();
            let mass = &model.rest_lengths[3 * (block.first + edge)].0;
            for point in 0..points {
                let along = (point as f32 + 0.5) * share;
                between(&at[from], &at[to], along, &mut found.at);
                between(&velocity[from], &velocity[to], along, &mut found.velocity);
                found.stencils.set(lattice, &found.at);
                interpolate(&grid.nodes, lattice.rows(), &found.stencils, &mut found.nodes[..block.live]);
                grid.bounds.hold(&found.at, &mut found.counts);
                found.blend(self.pic, &live);
                let [near, far] = [share * (1.0 - along), share * along];
                sums[from].add(near, mass, &found.rows);
                sums[to].add(far, mass, &found.rows);
            }
            self.add(rows, edge, &sums[from]);
        }
        let last = block.particles - 1;
        self.add(rows, last, &sums[last & 1]);
    }

    /// Adds the weighted means in `sum` to particle `i`, unless it is clamped.
    #[inline(always)]
    fn add<T: Real>(&self, rows: &mut ParticleRows<'_, T>, i: usize, sum: &Sum) {
        if i < self.clamped {
            return;
        }
        let mut inverse = sum.weight;
        for k in 0..LANES {
            let weight = inverse[k];
            inverse[k] = 1.0 / if weight > f32::MIN_POSITIVE { weight } else { f32::MIN_POSITIVE };
        }
        self.add_mean(rows.velocities, i, &sum.change, &inverse);
        if self.shifts {
            let square = self.add_mean(rows.positions, i, &sum.shift, &inverse);
            if let Some(clearance) = rows.clearance.get_mut(i) {
                reduce_clearances(clearance, &square);
            }
        }
    }

    /// Adds the weighted means in `sum` to the rows of particle `i`; their squared lengths.
    #[inline(always)]
    fn add_mean<T: Real>(
        &self,
        rows: &mut [Row<T>],
        i: usize,
        sum: &Lanes,
        inverse: &[f32; LANES],
    ) -> [T; LANES] {
        let mut world = [[0.0; LANES]; 3];
        self.view.to_world(sum, &mut world);
        let mut square = [T::zero(); LANES];
        for c in 0..3 {
            let row = &mut rows[3 * i + c].0;
            for k in 0..LANES {
                let by = T::from(world[c][k] * inverse[k]).unwrap_or_else(T::zero);
                row[k] = row[k] + by;
                square[k] = square[k] + by * by;
            }
        }
        square
    }
}

/// Subtracts displacements, of which the squares are given, from clearances, as
/// [`reduce_clearance`](crate::collide::resolve_solids::reduce_clearance) does.
#[inline(always)]
fn reduce_clearances<T: Real>(clearance: &mut Row<T>, square: &[T; LANES]) {
    for k in 0..LANES {
        let old = clearance.0[k];
        let left = old - square[k].sqrt();
        let left = if left > T::zero() { left } else { T::zero() };
        clearance.0[k] = if old >= T::zero() { left } else { old };
    }
}

/// Interpolates what the nodes store at the samples of `stencils`.
#[inline(always)]
fn interpolate(nodes: &[Node], rows: [usize; 4], stencils: &Stencils, found: &mut [Node]) {
    for (lane, found) in found.iter_mut().enumerate() {
        let first = stencils.first[lane] as usize;
        assert!(first + rows[3] + 1 < nodes.len(), "the box holds all stencils");
        let weight = |n: usize| stencils.weights[n][lane];
        let [mut low, mut high] = [Node::default(); 2];
        for (n, row) in rows.into_iter().enumerate() {
            // SAFETY: the last row was checked.
            let pair = unsafe { nodes.get_unchecked(first + row..first + row + 2) };
            low = low + pair[0] * weight(n);
            high = high + pair[1] * weight(n);
        }
        *found = low * weight(4) + high * weight(5);
    }
}

/// WGSL of the stage.
pub const WGSL: &str = include_str!("kernel.wgsl");
