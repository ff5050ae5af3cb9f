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

#![expect(clippy::needless_range_loop, reason = "the index selects one lane of several arrays")]

use crate::interaction::grid::{Grid, GridMoment, Lanes, Node, Stencils, View, between, split_rows};
use crate::lane::{LANES, Real, Row, widest};
use crate::strands::{Block, Model};

/// Adds the change of the grid's velocity to the velocities of all particles, except the first
/// `clamped` of each strand, and if `shifts`, the displacements that the grid computes for hair
/// that is too dense to their positions.
pub fn gather<T: Real>(
    grid: &Grid,
    model: &Model<T>,
    positions: &mut [Row<T>],
    velocities: &mut [Row<T>],
    moment: &GridMoment<'_>,
    shifts: bool,
) {
    let gather = Gather {
        grid,
        view: View::new(&moment.frame, &grid.bounds, grid.cell),
        pic: grid.params.pic_share(moment.dt_secs) as f32,
        clamped: moment.clamped,
        shifts,
    };
    split_rows(&grid.chunks, &model.blocks, [positions, velocities], &|chunk, [positions, velocities]| {
        let blocks = &model.blocks[chunk.blocks.clone()];
        for (block, &points) in blocks.iter().zip(&chunk.points) {
            let start = 3 * (block.first - blocks[0].first);
            let rows = start..start + 3 * block.particles;
            let (positions, velocities) = (&mut positions[rows.clone()], &mut velocities[rows]);
            widest(
                #[inline(always)]
                || gather.block(model, block, points, positions, velocities),
            );
        }
    });
}

struct Gather<'a> {
    grid: &'a Grid,
    view: View,
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

impl Sum {
    #[inline(always)]
    fn add(&mut self, weight: &[f32; LANES], change: &Lanes, shift: &Lanes) {
        for k in 0..LANES {
            self.weight[k] += weight[k];
        }
        for c in 0..3 {
            for k in 0..LANES {
                self.change[c][k] += weight[k] * change[c][k];
            }
        }
        for c in 0..3 {
            for k in 0..LANES {
                self.shift[c][k] += weight[k] * shift[c][k];
            }
        }
    }
}

impl Gather<'_> {
    /// Changes the rows of `block`.
    #[inline(always)]
    fn block<T: Real>(
        &self,
        model: &Model<T>,
        block: &Block,
        points: usize,
        positions: &mut [Row<T>],
        velocities: &mut [Row<T>],
    ) {
        let share = 1.0 / points as f32;
        let mut from = self.view.place(positions, 0);
        let mut from_velocity = self.view.velocity(positions, velocities, 0);
        let mut from_sum = NOTHING;
        for edge in 0..block.particles - 1 {
            let to = self.view.place(positions, edge + 1);
            let to_velocity = self.view.velocity(positions, velocities, edge + 1);
            let mut to_sum = NOTHING;
            let mass = model.rest_lengths[3 * (block.first + edge)].0.map(|l| l.to_f32().unwrap_or(0.0));
            for point in 0..points {
                let along = (point as f32 + 0.5) * share;
                let at = between(&from, &to, along);
                let velocity = between(&from_velocity, &to_velocity, along);
                let [near, far] = [share * (1.0 - along), share * along].map(|w| mass.map(|m| m * w));
                let [change, shift] = self.change(&at, &velocity, block.live);
                from_sum.add(&near, &change, &shift);
                to_sum.add(&far, &change, &shift);
            }
            self.add(positions, velocities, edge, &from_sum);
            (from, from_velocity, from_sum) = (to, to_velocity, to_sum);
        }
        self.add(positions, velocities, block.particles - 1, &from_sum);
    }

    /// The changes of samples at `at` with velocities `velocity`, along the axes of the grid, and
    /// their displacements.
    #[inline(always)]
    fn change(&self, at: &Lanes, velocity: &Lanes, live: usize) -> [Lanes; 2] {
        let bounds = &self.grid.bounds;
        let inside = bounds.hold(at);
        let stencils = Stencils::new(bounds, at);
        let mut found = [Node::default(); LANES];
        widest(
            #[inline(always)]
            || interpolate(&self.grid.nodes, bounds.stencil_rows(), &stencils, &mut found[..live]),
        );
        let [mut change, mut shift] = [[[0.0; LANES]; 3]; 2];
        for c in 0..3 {
            for k in 0..LANES {
                let blend = found[k].0[c] - self.pic * velocity[c][k];
                let counts = inside[k] & (k < live);
                change[c][k] = if counts { blend } else { 0.0 };
                shift[c][k] = if counts { found[k].0[4 + c] } else { 0.0 };
            }
        }
        [change, shift]
    }

    /// Adds the weighted means in `sum` to particle `i`, unless it is clamped.
    #[inline(always)]
    fn add<T: Real>(&self, positions: &mut [Row<T>], velocities: &mut [Row<T>], i: usize, sum: &Sum) {
        if i < self.clamped {
            return;
        }
        let inverse = sum.weight.map(|w| 1.0 / w.max(f32::MIN_POSITIVE));
        self.add_mean(velocities, i, &sum.change, &inverse);
        if self.shifts {
            self.add_mean(positions, i, &sum.shift, &inverse);
        }
    }

    #[inline(always)]
    fn add_mean<T: Real>(&self, rows: &mut [Row<T>], i: usize, sum: &Lanes, inverse: &[f32; LANES]) {
        let world = self.view.to_world(sum);
        for c in 0..3 {
            let row = &mut rows[3 * i + c].0;
            for k in 0..LANES {
                row[k] = row[k] + T::from(world[c][k] * inverse[k]).unwrap_or_else(T::zero);
            }
        }
    }
}

/// Interpolates what the nodes store at the samples of `stencils`.
#[inline(always)]
fn interpolate(nodes: &[Node], rows: [usize; 4], stencils: &Stencils, found: &mut [Node]) {
    for (lane, found) in found.iter_mut().enumerate() {
        let first = stencils.first[lane] as usize;
        assert!(first + rows[3] + 1 < nodes.len(), "the box holds all stencils");
        let [x, y, z] = [0, 1, 2].map(|c| stencils.offset[c][lane]);
        let weights = [(1.0 - y) * (1.0 - z), y * (1.0 - z), (1.0 - y) * z, y * z];
        let [mut low, mut high] = [Node::default(); 2];
        for (row, weight) in rows.into_iter().zip(weights) {
            // SAFETY: the last row was checked.
            let pair = unsafe { nodes.get_unchecked(first + row..first + row + 2) };
            low = low + pair[0] * weight;
            high = high + pair[1] * weight;
        }
        *found = low * (1.0 - x) + high * x;
    }
}

/// WGSL of the stage.
pub const WGSL: &str = include_str!("kernel.wgsl");
