//! The fields of the pressure and the solid cells.

#![expect(clippy::needless_range_loop, reason = "one index for several arrays is what vectorises")]

use super::relax::{Equation, System};
use crate::body::{ColliderFrame, PACKET, Shape};
use crate::interaction::grid::{Bounds, GridPlacement, GridSolid, Node, density};
use crate::lane::widest;
use crate::scratch::{fill, resize};
use rayon::prelude::*;

/// Mass below which a face is closed, relative to that of a sample.
pub const SPARSE: f32 = 1e-3;
/// Density below which no pressure acts in a cell.
pub const LOOSE: f32 = 0.05;
/// Stands in the field of masses for a cell inside a solid.
const SOLID: f32 = -1.0;
/// Cells that are computed side by side.
const WIDE: usize = 16;

/// Fields on the cells of the box, x fastest.
#[derive(Debug, Default)]
pub(crate) struct Fields {
    /// Cells of each row that are next to hair: `[z][y]`.
    rows: Vec<[u32; 2]>,
    /// Cells of each row with hair.
    filled_rows: Vec<[u32; 2]>,
    /// Mass of each cell, or [`SOLID`].
    pub(super) masses: Vec<f32>,
    /// The solid in the cell, counted from 1; 0 is none. If several solids overlap, the first.
    walls: Vec<u16>,
    /// The solids of the frame.
    solids: Vec<GridSolid>,
    /// The equations of the pressure.
    pub(super) system: System,
    /// Pressures of each cell: for velocities and for displacements.
    pub(super) pressures: [Vec<f32>; 2],
    /// A maximum for each layer.
    partial: Vec<f32>,
}

impl Fields {
    /// Bytes held.
    pub fn bytes(&self) -> usize {
        let floats: usize = self.pressures.iter().chain([&self.masses]).map(|f| 4 * f.capacity()).sum();
        floats
            + 2 * self.walls.capacity()
            + 8 * (self.rows.capacity() + self.filled_rows.capacity())
            + 4 * self.partial.capacity()
            + self.system.bytes()
    }

    /// Resizes the fields to the box, finds the rows with hair, and clears solid cells.
    pub(super) fn fit(&mut self, bounds: &Bounds, nodes: &[Node]) {
        let cells = bounds.cells();
        let [nx, ny, nz] = bounds.dims;
        for field in self.pressures.iter_mut().chain([&mut self.masses]) {
            fill(field, cells + WIDE, 0.0);
        }
        fill(&mut self.walls, cells, 0);
        resize(&mut self.partial, nz, 0.0);
        resize(&mut self.filled_rows, ny * nz, [0; 2]);
        resize(&mut self.rows, ny * nz, [0; 2]);
        let each =
            self.filled_rows.par_iter_mut().zip(self.masses.par_chunks_mut(nx)).zip(nodes.par_chunks(nx));
        each.with_min_len(256).for_each(|((span, masses), nodes)| {
            let is_filled = |node: &Node| node.mass() > 0.0;
            let from = nodes.iter().position(is_filled);
            let to = nodes.iter().rposition(is_filled);
            let Some((from, to)) = from.zip(to) else {
                *span = [0; 2];
                return;
            };
            #[expect(clippy::cast_possible_truncation, reason = "a row has fewer cells")]
            let here = [from as u32, to as u32 + 1];
            *span = here;
            for (mass, node) in masses[from..=to].iter_mut().zip(&nodes[from..=to]) {
                *mass = node.mass();
            }
        });
        let filled_rows = &self.filled_rows;
        let at = |j: usize, k: usize| if j < ny && k < nz { filled_rows[j + ny * k] } else { [0; 2] };
        for (index, row) in self.rows.iter_mut().enumerate() {
            let (j, k) = (index % ny, index / ny);
            let near =
                [at(j, k), at(j.wrapping_sub(1), k), at(j + 1, k), at(j, k.wrapping_sub(1)), at(j, k + 1)];
            let spans = near.into_iter().filter(|[from, to]| from < to);
            *row = spans
                .reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])
                .map_or([0; 2], |[from, to]| [from.saturating_sub(1), to + 1]);
        }
    }

    /// Marks the cells next to hair whose centres are inside one of `solids`.
    pub(super) fn mark_solid_cells(
        &mut self,
        bounds: &Bounds,
        solids: &[ColliderFrame<'_>],
        grid: &GridPlacement<'_>,
    ) {
        let [nx, ny, _] = bounds.dims;
        self.solids.clear();
        self.solids.extend(solids.iter().map(|solid| GridSolid::new(solid, grid, bounds)));
        let Self { walls, rows, solids: placed, masses, .. } = self;
        if placed.is_empty() {
            return;
        }
        let each = walls.par_chunks_mut(nx).zip(masses.par_chunks_mut(nx)).enumerate();
        each.with_min_len(64).for_each(|(row, (walls, masses))| {
            let [from, to] = rows[row];
            for ((number, solid), placed) in (1..=u16::MAX).zip(solids).zip(&*placed) {
                for i in (from as usize..to as usize).step_by(PACKET) {
                    let end = (i + PACKET).min(to as usize);
                    let at = [i, row % ny, row / ny];
                    mark_row(walls, number, at, end, solid.shape, placed, grid.cell as f32);
                }
            }
            let span = from as usize..to as usize;
            for (mass, _) in masses[span.clone()].iter_mut().zip(&walls[span]).filter(|(_, wall)| **wall > 0)
            {
                *mass = SOLID;
            }
        });
    }

    /// Sets up the equations of both pressures. Faces with at most the mass `least` are closed.
    /// `right_hand_sides` is a function of the density and the divergence of a cell. Returns the
    /// density of the densest cell.
    pub(super) fn build_system(
        &mut self,
        bounds: &Bounds,
        nodes: &[Node],
        least: f32,
        right_hand_sides: &(impl Fn(f32, f32) -> [f32; 2] + Sync),
    ) -> f64 {
        let [nx, ny, nz] = bounds.dims;
        let layer = bounds.layer();
        let strides = [1, nx, layer];
        let Self { masses, walls, solids, filled_rows, system, partial, .. } = self;
        let (masses, walls, solids, filled_rows) = (&*masses, &*walls, &*solids, &*filled_rows);
        // The velocity of a wall between the cells `below` and `above`.
        let wall_velocity = |axis: usize, below: usize, above: usize| {
            let wall = if walls[below] > 0 { walls[below] } else { walls[above] };
            let mut middle = [above % nx, above / nx % ny, above / layer].map(|i| i as f32 + 0.5);
            middle[axis] -= 0.5;
            solids[usize::from(wall) - 1].velocity(axis, middle)
        };
        system.fit(bounds, partial, &|k, half, out| {
            let rows: &[[u32; 2]] = match k {
                0 => &[],
                k if k + 1 >= nz => &[],
                k => &filled_rows[ny * k..ny * (k + 1) - 1],
            };
            let mut densest = 0.0f32;
            out.build(bounds, k, half, rows, &mut |here| {
                let index = layer * k + here;
                let density = density(nodes[index].volumes());
                densest = densest.max(density);
                if density < LOOSE || masses[index] < 0.0 {
                    return None;
                }
                let (mut sides, mut divergence) = ([0.0; 6], 0.0);
                for axis in 0..3 {
                    let mut velocity = |side: usize, below: usize, above: usize| {
                        let (a, b) = (masses[below], masses[above]);
                        if a < 0.0 || b < 0.0 {
                            return wall_velocity(axis, below, above);
                        }
                        let inverse = 1.0 / (a + b);
                        // Closed if there is almost no hair.
                        if 0.5 * (a + b) > least {
                            sides[2 * axis + side] = 2.0 * inverse;
                        }
                        (nodes[below].0[axis] + nodes[above].0[axis]) * inverse
                    };
                    let stride = strides[axis];
                    let (below, above) =
                        (velocity(0, index - stride, index), velocity(1, index, index + stride));
                    divergence += above - below;
                }
                Some(Equation { sides, rhs: right_hand_sides(density, divergence) })
            });
            densest
        });
        partial.iter().copied().fold(0.0, f32::max).into()
    }

    /// Copies the pressures of velocities (`which` 0) or displacements (1) to the cells of the box.
    /// Returns the number of cells under pressure.
    pub(super) fn collect_pressures(&mut self, bounds: &Bounds, which: usize) -> usize {
        let mut cells = 0;
        let Self { system, pressures, .. } = self;
        system.pressures(bounds, |cell, value| {
            pressures[which][cell] = value;
            cells += 1;
        });
        cells
    }

    /// Replaces momenta and volumes of the nodes by the velocities to interpolate, with the
    /// fraction `pic` of PIC, and by displacements. Returns an upper bound of the displacements.
    pub(super) fn apply_pressure(
        &mut self,
        bounds: &Bounds,
        nodes: &mut [Node],
        least: f32,
        pic: f32,
    ) -> f64 {
        let [nx, ny, _] = bounds.dims;
        let layer = bounds.layer();
        let Self { pressures, masses, partial, filled_rows, walls, solids, .. } = self;
        let (pressures, masses, filled_rows) = (&*pressures, &*masses, &*filled_rows);
        let strides = [1, nx, layer];
        nodes.par_chunks_mut(layer).zip(partial.par_iter_mut()).enumerate().for_each(
            |(k, (nodes, farthest))| {
                *farthest = 0.0;
                for (j, nodes) in nodes.chunks_mut(nx).enumerate() {
                    let [from, to] = filled_rows[j + ny * k].map(|end| end as usize);
                    for first in (from..to).step_by(WIDE) {
                        let end = (first + WIDE).min(to);
                        let index = layer * k + nx * j + first;
                        let changes = widest(
                            #[inline(always)]
                            || {
                                pressures
                                    .each_ref()
                                    .map(|pressure| changes(pressure, masses, index, strides, least))
                            },
                        );
                        for (n, node) in nodes[first..end].iter_mut().enumerate() {
                            let mass = node.mass();
                            if mass <= 0.0 {
                                continue;
                            }
                            let wall = walls[index + n];
                            let middle = [first + n, j, k].map(|i| i as f32 + 0.5);
                            for axis in 0..3 {
                                let old = match wall {
                                    0 => node.0[axis] / mass,
                                    wall => solids[usize::from(wall) - 1].velocity(axis, middle),
                                };
                                let [change, shift] = [0, 1].map(|which: usize| changes[which][axis][n]);
                                node.0[axis] = change + pic * old;
                                node.0[4 + axis] = shift;
                                *farthest = farthest.max(shift.abs());
                            }
                            node.0[7] = 0.0;
                        }
                    }
                }
            },
        );
        let farthest = f64::from(partial.iter().copied().fold(0.0, f32::max));
        farthest * 3.0f64.sqrt()
    }
}

/// The changes that a pressure causes in [`WIDE`] cells from `index`, along each axis: the mean of
/// the changes at the two faces of a cell, of which walls do not count.
#[inline(always)]
fn changes(
    pressure: &[f32],
    masses: &[f32],
    index: usize,
    strides: [usize; 3],
    least: f32,
) -> [[f32; WIDE]; 3] {
    let at = |field: &[f32], index: usize| -> [f32; WIDE] {
        field[index..index + WIDE].try_into().unwrap_or([0.0; WIDE])
    };
    let (p, m) = (at(pressure, index), at(masses, index));
    strides.map(|stride| {
        let sides = [index - stride, index + stride];
        let [below, above] = sides.map(|index| (at(pressure, index), at(masses, index)));
        let mut out = [0.0; WIDE];
        for n in 0..WIDE {
            let face = |beyond: (f32, f32), sign: f32| -> (f32, f32) {
                let sum = m[n] + beyond.1;
                let is_wall = (m[n] < 0.0) | (beyond.1 < 0.0);
                let is_open = !is_wall & (0.5 * sum > least);
                let change = sign * (beyond.0 - p[n]) * 2.0 / sum;
                (if is_open { change } else { 0.0 }, if is_wall { 0.0 } else { 1.0 })
            };
            let below = face((below.0[n], below.1[n]), 1.0);
            let above = face((above.0[n], above.1[n]), -1.0);
            out[n] = (below.0 + above.0) / (below.1 + above.1).max(1.0);
        }
        out
    })
}

/// Marks the cells of the row `walls` from `at` to `end` whose centres are inside `solid`.
fn mark_row(
    walls: &mut [u16],
    number: u16,
    at: [usize; 3],
    end: usize,
    shape: &Shape,
    solid: &GridSolid,
    cell: f32,
) {
    let middle = |i: usize| [i as f32 + 0.5, at[1] as f32 + 0.5, at[2] as f32 + 0.5];
    let reach = cell * PACKET as f32 * 0.5;
    if shape.sample_near(solid.local(middle(at[0] + PACKET / 2)), reach).is_none() {
        return;
    }
    let mut points = [[0.0; PACKET]; 3];
    for k in 0..PACKET {
        let local = solid.local(middle(at[0] + k));
        for c in 0..3 {
            points[c][k] = local[c];
        }
    }
    let (distances, _) = shape.sample_packet(&points, 1.0);
    for i in at[0]..end {
        if walls[i] == 0 && distances[i - at[0]] < 0.0 {
            walls[i] = number;
        }
    }
}
