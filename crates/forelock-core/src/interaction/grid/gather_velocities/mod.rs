//! The transfer from grid to particles (G2P): adds the change of the grid's velocity to the
//! strands.
//!
//! # Theory
//! A sample is a point on an edge that carries a share of the edge's mass. With the interpolation
//! weights w, the new velocities u at the faces of the grid and their changes Δu, the velocity v_s
//! of a sample changes by a blend of FLIP, which adds the change of the grid's velocity, and PIC,
//! which replaces the sample's velocity by the grid's:
//!
//! ```text
//! Δv_s = (1 − p) Σ w Δu + p (Σ w u − v_s) ,   p = 1 − exp(−pic_rate · dt)
//! ```
//!
//! The velocity of a particle changes by the mean of Δv_s over the samples of its two edges,
//! weighted by the mass m_s and the linear shape function N_i: Δv_i = Σ_s m_s N_i(s) Δv_s / Σ_s m_s
//! N_i(s). This is the transpose of the splat, so momentum is conserved to rounding.

#![expect(clippy::needless_range_loop, reason = "the index selects one lane of several arrays")]

use crate::interaction::grid::splat_segments::{Corner, Stencils, stencils, weights};
use crate::interaction::grid::{Bounds, Grid, GridMoment, View, between, split_rows};
use crate::lane::{LANES, Quad, Real, Row};
use crate::strands::{Block, Model};

/// Adds the change of the grid's velocity to the velocities of all particles, except the first
/// `clamped` of each strand.
pub fn gather<T: Real>(
    grid: &Grid,
    model: &Model<T>,
    positions: &[Row<T>],
    velocities: &mut [Row<T>],
    moment: &GridMoment<'_>,
) {
    let pic = grid.params.pic_share(moment.dt_secs) as f32;
    let gather = Gather::new(grid, moment, Some(pic));
    split_rows(&grid.chunks, &model.blocks, velocities, &|chunk, velocities| {
        let blocks = &model.blocks[chunk.blocks.clone()];
        for (block, &points) in blocks.iter().zip(&chunk.points) {
            let start = 3 * (block.first - blocks[0].first);
            let velocities = &mut velocities[start..start + 3 * block.particles];
            let positions = &positions[3 * block.first..3 * (block.first + block.particles)];
            gather.block(model, block, points, Some(positions), velocities);
        }
    });
}

/// Adds the displacements that the grid computes for hair that is too dense to the positions of all
/// particles, except the first `clamped` of each strand.
pub fn gather_displacements<T: Real>(
    grid: &Grid,
    model: &Model<T>,
    positions: &mut [Row<T>],
    moment: &GridMoment<'_>,
) {
    let gather = Gather::new(grid, moment, None);
    split_rows(&grid.chunks, &model.blocks, positions, &|chunk, positions| {
        let blocks = &model.blocks[chunk.blocks.clone()];
        for (block, &points) in blocks.iter().zip(&chunk.points) {
            let start = 3 * (block.first - blocks[0].first);
            gather.block(model, block, points, None, &mut positions[start..start + 3 * block.particles]);
        }
    });
}

struct Gather<'a> {
    grid: &'a Grid,
    view: View,
    /// Fraction p of PIC. `None` to gather displacements: these are zero in most cells, which are
    /// skipped.
    pic: Option<f32>,
    clamped: usize,
}

/// Weighted sum of the changes of a particle (x, y, z), and sum of the weights, in each lane.
type Sum = [[f32; LANES]; 4];

/// The face at index `at` and the next one along x.
#[inline(always)]
fn pair(faces: &[[f32; 2]], at: usize) -> &[[f32; 2]; 2] {
    &bytemuck::cast_slice(&faces[at..at + 2])[0]
}

impl<'a> Gather<'a> {
    fn new(grid: &'a Grid, moment: &GridMoment<'_>, pic: Option<f32>) -> Self {
        Self { grid, view: View::new(&moment.frame, &grid.bounds, grid.cell), pic, clamped: moment.clamped }
    }

    /// Adds the changes to `rows`. These are velocities if `positions` is given, and positions
    /// otherwise.
    fn block<T: Real>(
        &self,
        model: &Model<T>,
        block: &Block,
        points: usize,
        positions: Option<&[Row<T>]>,
        rows: &mut [Row<T>],
    ) {
        let place = |rows: &[Row<T>], i| self.view.place(positions.unwrap_or(rows), i);
        let velocity = |rows: &[Row<T>], i| match positions {
            Some(positions) => self.view.velocity(positions, rows, i),
            None => [[0.0; LANES]; 3],
        };
        let share = 1.0 / points as f32;
        let mut from = place(rows, 0);
        let mut from_velocity = velocity(rows, 0);
        let mut from_sum: Sum = [[0.0; LANES]; 4];
        for edge in 0..block.particles - 1 {
            let to = place(rows, edge + 1);
            let to_velocity = velocity(rows, edge + 1);
            let mut to_sum: Sum = [[0.0; LANES]; 4];
            let lengths = &model.rest_lengths[3 * (block.first + edge)].0;
            for point in 0..points {
                let along = (point as f32 + 0.5) * share;
                let at = between(&from, &to, along);
                let velocity = between(&from_velocity, &to_velocity, along);
                for lane in 0..block.live {
                    let mass = lengths[lane].to_f32().unwrap_or(0.0) * share;
                    let (near, far) = (mass * (1.0 - along), mass * along);
                    from_sum[3][lane] += near;
                    to_sum[3][lane] += far;
                    let at = [at[0][lane], at[1][lane], at[2][lane]];
                    let Some(change) =
                        self.change(at, [velocity[0][lane], velocity[1][lane], velocity[2][lane]])
                    else {
                        continue;
                    };
                    for c in 0..3 {
                        from_sum[c][lane] += near * change[c];
                        to_sum[c][lane] += far * change[c];
                    }
                }
            }
            self.add(rows, edge, block.live, &from_sum);
            (from, from_velocity, from_sum) = (to, to_velocity, to_sum);
        }
        self.add(rows, block.particles - 1, block.live, &from_sum);
    }

    /// The change of a sample at `at` with velocity `velocity`, along the axes of the grid; `None`
    /// if nothing changes there.
    #[inline]
    fn change(&self, at: [f32; 3], velocity: [f32; 3]) -> Option<[f32; 3]> {
        let bounds: &Bounds = &self.grid.bounds;
        if !bounds.holds(at) {
            return None;
        }
        let stencils = stencils(at);
        let Some(pic) = self.pic else {
            if !self.grid.pressure.is_touched(bounds, stencils.cell_of()) {
                return None;
            }
            return Some([
                self.face::<0>(&stencils)[1],
                self.face::<1>(&stencils)[1],
                self.face::<2>(&stencils)[1],
            ]);
        };
        let blend = |[new, change]: [f32; 2], velocity: f32| change + pic * (new - change - velocity);
        Some([
            blend(self.face::<0>(&stencils), velocity[0]),
            blend(self.face::<1>(&stencils), velocity[1]),
            blend(self.face::<2>(&stencils), velocity[2]),
        ])
    }

    /// Interpolates the two values that the faces store along `AXIS`: the new velocity, and the
    /// change of velocity or the displacement.
    #[inline(always)]
    fn face<const AXIS: usize>(&self, stencils: &Stencils) -> [f32; 2] {
        let Corner { first, fraction: [fx, fy, fz], strides } = stencils.face::<AXIS>(&self.grid.bounds);
        let faces = &self.grid.faces[AXIS][first..first + strides[1] + strides[0] + 2];
        let mut sum = Quad::splat(0.0);
        for (from, w) in weights(fy, fz, strides) {
            sum = sum + Quad::splat(w) * Quad::load(pair(faces, from));
        }
        let sum = sum.to_array();
        [sum[0] + fx * (sum[2] - sum[0]), sum[1] + fx * (sum[3] - sum[1])]
    }

    /// Adds the weighted mean in `sum` to particle `i`, unless it is clamped.
    #[inline]
    fn add<T: Real>(&self, rows: &mut [Row<T>], i: usize, live: usize, sum: &Sum) {
        if i < self.clamped {
            return;
        }
        for lane in 0..live {
            let inverse = 1.0 / sum[3][lane].max(f32::MIN_POSITIVE);
            let world = self.view.to_world([0, 1, 2].map(|c| sum[c][lane] * inverse));
            for c in 0..3 {
                let x = &mut rows[3 * i + c].0[lane];
                *x = *x + T::from(world[c]).unwrap_or_else(T::zero);
            }
        }
    }
}

/// WGSL of the stage.
pub const WGSL: &str = include_str!("kernel.wgsl");
