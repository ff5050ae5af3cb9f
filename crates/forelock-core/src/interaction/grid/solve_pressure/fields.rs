//! The fields of the linear system, the solid cells and the active set.

#![expect(clippy::needless_range_loop, reason = "one index for several arrays is what vectorises")]

use crate::body::PACKET;
use crate::interaction::grid::{Bounds, GridSolid};
use crate::scratch::{fill, resize};
use rayon::prelude::*;

/// Mass below which a face is closed, relative to that of a sample.
pub const SPARSE: f32 = 1e-3;
/// Fill fraction below which no pressure acts in a cell.
pub const LOOSE: f32 = 0.05;

/// Fields on the cells of the box, x fastest.
#[derive(Debug, Default)]
pub(crate) struct Fields {
    /// Inverse mass of each lower face, 0 where nothing flows.
    pub(super) mobility: [Vec<f32>; 3],
    /// The solid in the cell, counted from 1; 0 is none. If several solids overlap, the first.
    walls: Vec<u16>,
    /// Right-hand side: the divergence that the pressure must add, m/s; −∞ where no pressure can
    /// act.
    pub(super) rhs: Vec<f32>,
    /// Whether the cell is active in the next round.
    active: Vec<bool>,
    /// Inverse diagonal of the matrix; 0 in inactive cells.
    pub(super) inverse: Vec<f32>,
    /// The unknown, and conjugate gradients' residual, direction and product.
    pub(super) pressure: Vec<f32>,
    pub(super) residual: Vec<f32>,
    pub(super) direction: Vec<f32>,
    pub(super) product: Vec<f32>,
    /// Range of the active cells in each row.
    pub(super) spans: Vec<[u32; 2]>,
    /// Blocks of cells with faces that the pressure accelerates.
    touched: Vec<bool>,
    /// Two sums a layer.
    pub(super) partial: Vec<[f64; 2]>,
}

impl Fields {
    /// Bytes held.
    pub fn bytes(&self) -> usize {
        let fields =
            [&self.rhs, &self.inverse, &self.pressure, &self.residual, &self.direction, &self.product];
        let floats: usize = fields.into_iter().chain(&self.mobility).map(|f| 4 * f.capacity()).sum();
        floats
            + self.active.capacity()
            + 2 * self.walls.capacity()
            + 8 * self.spans.capacity()
            + 16 * self.partial.capacity()
            + self.touched.capacity()
    }

    /// Resizes the fields to the box and clears solid cells and pressure.
    pub(super) fn fit(&mut self, bounds: &Bounds) {
        let cells = bounds.cells();
        let fields =
            [&mut self.rhs, &mut self.inverse, &mut self.residual, &mut self.direction, &mut self.product];
        for field in fields.into_iter().chain(&mut self.mobility) {
            resize(field, cells, 0.0);
        }
        fill(&mut self.pressure, cells, 0.0);
        fill(&mut self.walls, cells, 0);
        resize(&mut self.active, cells, false);
        resize(&mut self.spans, bounds.dims[1] * bounds.dims[2], [0; 2]);
        resize(&mut self.partial, bounds.dims[2], [0.0; 2]);
    }

    /// Divides the momenta of the faces by their masses and computes the mobilities; `mass` is that
    /// of a sample.
    pub(super) fn normalize_velocity(&mut self, bounds: &Bounds, faces: &mut [Vec<[f32; 2]>; 3], mass: f32) {
        let least = SPARSE * mass;
        for (faces, mobility) in faces.iter_mut().zip(&mut self.mobility) {
            let layers = faces.par_chunks_mut(bounds.layer()).zip(mobility.par_chunks_mut(bounds.layer()));
            layers.for_each(|(faces, mobility)| {
                for (face, mobility) in faces.iter_mut().zip(mobility) {
                    let [mass, momentum] = *face;
                    let inverse = if mass > least { 1.0 / mass } else { 0.0 };
                    *mobility = inverse;
                    face[1] = if mass > 0.0 { momentum / mass } else { 0.0 };
                }
            });
        }
    }

    /// Marks the cells next to hair whose centres are inside `solid`, the `number`th counted from
    /// 1, gives their faces the velocity of the solid and sets their mobility to zero.
    pub(super) fn mark_solid_cells(
        &mut self,
        bounds: &Bounds,
        faces: &mut [Vec<[f32; 2]>; 3],
        filled: &[f32],
        cell: f64,
        number: u16,
        solid: &GridSolid<'_>,
    ) {
        let [nx, ny, nz] = bounds.dims;
        let layer = bounds.layer();
        self.walls.par_chunks_mut(layer).enumerate().for_each(|(k, walls)| {
            if k == 0 || k + 1 >= nz {
                return;
            }
            for j in 1..ny - 1 {
                for i in (1..nx - 1).step_by(PACKET) {
                    let end = (i + PACKET).min(nx - 1);
                    let row = nx * (j + ny * k);
                    let has_hair = |from: usize, to: usize| filled[from..to].iter().any(|&f| f > 0.0);
                    let beside = [row - nx, row + nx, row - layer, row + layer];
                    if has_hair(row + i - 1, row + end + 1) || beside.iter().any(|r| has_hair(r + i, r + end))
                    {
                        mark_row(walls, number, nx * j, [i, j, k], end, solid, cell as f32);
                    }
                }
            }
        });
        for k in 1..nz - 1 {
            for j in 1..ny - 1 {
                let row = nx * (j + ny * k);
                for i in 1..nx - 1 {
                    if self.walls[row + i] == number {
                        self.close_faces(faces, [i, j, k], row + i, [1, nx, layer], solid);
                    }
                }
            }
        }
    }

    /// Gives the six faces of a solid cell the velocity of the solid and closes them.
    fn close_faces(
        &mut self,
        faces: &mut [Vec<[f32; 2]>; 3],
        at: [usize; 3],
        index: usize,
        strides: [usize; 3],
        solid: &GridSolid<'_>,
    ) {
        for axis in 0..3 {
            for side in 0..2 {
                let mut middle = at.map(|i| i as f32 + 0.5);
                middle[axis] = (at[axis] + side) as f32;
                let face = index + side * strides[axis];
                faces[axis][face][1] = solid.velocity(axis, middle);
                self.mobility[axis][face] = 0.0;
            }
        }
    }

    /// Computes the right-hand side of each cell by `right_hand_side`, a function of the fill
    /// fraction and the divergence. Returns the fill fraction of the fullest cell.
    pub(super) fn compute_divergence(
        &mut self,
        bounds: &Bounds,
        faces: &[Vec<[f32; 2]>; 3],
        filled: &[f32],
        right_hand_side: &(impl Fn(f32, f32) -> f32 + Sync),
    ) -> f64 {
        let [nx, ny, nz] = bounds.dims;
        let strides = [1, nx, bounds.layer()];
        let Self { mobility, rhs, active, walls, partial, .. } = self;
        let (mobility, walls) = (&*mobility, &*walls);
        let layers =
            rhs.par_chunks_mut(strides[2]).zip(active.par_chunks_mut(strides[2])).zip(partial.par_iter_mut());
        layers.enumerate().for_each(|(k, ((rhs, active), [fullest, _]))| {
            rhs.fill(f32::NEG_INFINITY);
            active.fill(false);
            *fullest = 0.0;
            if k == 0 || k + 1 >= nz {
                return;
            }
            for i in nx..nx * (ny - 1) {
                let index = strides[2] * k + i;
                let share = filled[index];
                *fullest = f64::max(*fullest, share.into());
                if share < LOOSE || walls[index] > 0 {
                    continue;
                }
                // A side with neither hair nor a solid cannot sustain pressure.
                let open = |axis: usize| {
                    let (low, high) = (index, index + strides[axis]);
                    let pushes = |face: usize, beyond: usize| mobility[axis][face] > 0.0 || walls[beyond] > 0;
                    !(pushes(low, index - strides[axis]) && pushes(high, high))
                };
                if open(0) || open(1) || open(2) {
                    continue;
                }
                let mut divergence = 0.0;
                for axis in 0..3 {
                    divergence += faces[axis][index + strides[axis]][1] - faces[axis][index][1];
                }
                rhs[i] = right_hand_side(share, divergence);
                active[i] = rhs[i] > 0.0;
            }
        });
        partial.iter().map(|p| p[0]).fold(0.0, f64::max)
    }

    /// Builds the system of the active cells: inverse diagonal and row ranges. Returns the number
    /// of active cells.
    pub(super) fn build_system(&mut self, bounds: &Bounds) -> usize {
        let [nx, ny, _] = bounds.dims;
        let (layer, [mx, my, mz]) = (bounds.layer(), &self.mobility);
        let active = &self.active;
        self.direction.fill(0.0);
        let layers = self.inverse.par_chunks_mut(layer).zip(self.pressure.par_chunks_mut(layer));
        let layers = layers.zip(self.spans.par_chunks_mut(ny)).zip(self.partial.par_iter_mut());
        layers.enumerate().for_each(|(k, (((inverse, pressure), spans), [count, _]))| {
            *count = 0.0;
            for j in 0..ny {
                let (mut from, mut to) = (nx, 0);
                for i in 0..nx {
                    let (here, index) = (nx * j + i, layer * k + nx * j + i);
                    inverse[here] = 0.0;
                    if active[index] {
                        let diagonal = mx[index]
                            + mx[index + 1]
                            + my[index]
                            + my[index + nx]
                            + mz[index]
                            + mz[index + layer];
                        if diagonal > 0.0 {
                            inverse[here] = 1.0 / diagonal;
                            (from, to) = (from.min(i), i + 1);
                            *count += 1.0;
                            continue;
                        }
                    }
                    pressure[here] = 0.0;
                }
                #[expect(clippy::cast_possible_truncation, reason = "a row has fewer cells")]
                let span = [from.min(to) as u32, to as u32];
                spans[j] = span;
            }
        });
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a count")]
        let count = self.partial.iter().map(|p| p[0]).sum::<f64>() as usize;
        count
    }

    /// Deactivates cells of negative pressure and activates cells that are still compressed.
    /// Returns whether the active set changed.
    pub(super) fn update_active_set(&mut self, bounds: &Bounds) -> bool {
        let [nx, ny, nz] = bounds.dims;
        let (layer, [mx, my, mz]) = (bounds.layer(), &self.mobility);
        let (p, rhs, inverse) = (&self.pressure, &self.rhs, &self.inverse);
        let layers = self.active.par_chunks_mut(layer).zip(self.partial.par_iter_mut());
        layers.enumerate().for_each(|(k, (active, [changed, _]))| {
            *changed = 0.0;
            if k == 0 || k + 1 >= nz {
                return;
            }
            for here in nx..nx * (ny - 1) {
                let index = layer * k + here;
                if rhs[index] == f32::NEG_INFINITY {
                    continue;
                }
                let is_active = if inverse[index] > 0.0 {
                    p[index] >= 0.0
                } else {
                    let given = mx[index] * p[index - 1]
                        + mx[index + 1] * p[index + 1]
                        + my[index] * p[index - nx]
                        + my[index + nx] * p[index + nx]
                        + mz[index] * p[index - layer]
                        + mz[index + layer] * p[index + layer];
                    rhs[index] + given > 0.0
                };
                if is_active != active[here] {
                    active[here] = is_active;
                    *changed += 1.0;
                }
            }
        });
        self.partial.iter().any(|p| p[0] > 0.0)
    }

    /// Replaces (mass, velocity) of the faces by (new velocity, change of velocity). Returns an
    /// upper bound of the changes.
    pub(super) fn apply_pressure(&mut self, bounds: &Bounds, faces: &mut [Vec<[f32; 2]>; 3]) -> f64 {
        let layer = bounds.layer();
        let Self { pressure, mobility, partial, .. } = self;
        let pressure = &*pressure;
        let mut bound = 0.0;
        for ((faces, mobility), stride) in faces.iter_mut().zip(mobility).zip([1, bounds.dims[0], layer]) {
            let layers = faces.par_chunks_mut(layer).zip(partial.par_iter_mut()).enumerate();
            layers.for_each(|(k, (faces, [most, _]))| {
                *most = 0.0;
                if k == 0 {
                    return;
                }
                for (face, index) in faces.iter_mut().zip(layer * k..) {
                    // Negative pressures are dropped, also after the last round.
                    let [under, over] = [pressure[index - stride], pressure[index]].map(|p| p.max(0.0));
                    let change = mobility[index] * (under - over);
                    *face = [face[1] + change, change];
                    *most = f64::max(*most, change.abs().into());
                }
            });
            bound += partial.iter().map(|p| p[0]).fold(0.0, f64::max).powi(2);
        }
        bound.sqrt()
    }

    /// Marks the blocks of cells in which a sample may touch a face that the pressure accelerates.
    pub(super) fn mark_touched(&mut self, bounds: &Bounds) {
        let [nx, ny, nz] = bounds.dims;
        let blocks = touched_blocks(bounds);
        fill(&mut self.touched, blocks.iter().product(), false);
        for k in 0..nz {
            for j in 0..ny {
                let [from, to] = self.spans[ny * k + j].map(|i| i as usize);
                for i in from..to {
                    if self.pressure[nx * (j + ny * k) + i] > 0.0 {
                        let near = |x: usize, last: usize| {
                            [x.saturating_sub(2) / BLOCK, ((x + 2) / BLOCK).min(last - 1)]
                        };
                        for c in near(k, blocks[2]) {
                            for b in near(j, blocks[1]) {
                                for a in near(i, blocks[0]) {
                                    self.touched[a + blocks[0] * (b + blocks[1] * c)] = true;
                                }
                            }
                        }
                    }
                }
            }
        }
    }

    /// Whether a sample in cell `at` may touch a face that the pressure accelerates.
    #[inline]
    pub fn is_touched(&self, bounds: &Bounds, at: [usize; 3]) -> bool {
        let blocks = touched_blocks(bounds);
        self.touched[at[0] / BLOCK + blocks[0] * (at[1] / BLOCK + blocks[1] * (at[2] / BLOCK))]
    }
}

/// Cells along the side of a block: at least 4, so that the stencil of a cell, which reaches 2
/// cells, spans at most two blocks.
const BLOCK: usize = 4;

fn touched_blocks(bounds: &Bounds) -> [usize; 3] {
    bounds.dims.map(|n| n.div_ceil(BLOCK))
}

/// Marks the cells of a row from `at` to `end` whose centres are inside `solid`. `row` is the index
/// of the row in the layer `walls`.
fn mark_row(
    walls: &mut [u16],
    number: u16,
    row: usize,
    at: [usize; 3],
    end: usize,
    solid: &GridSolid<'_>,
    cell: f32,
) {
    let middle = |i: usize| [i as f32 + 0.5, at[1] as f32 + 0.5, at[2] as f32 + 0.5];
    let reach = cell * PACKET as f32 * 0.5;
    if solid.shape.sample_near(solid.local(middle(at[0] + PACKET / 2)), reach).is_none() {
        return;
    }
    let mut points = [[0.0; PACKET]; 3];
    for k in 0..PACKET {
        let local = solid.local(middle(at[0] + k));
        for c in 0..3 {
            points[c][k] = local[c];
        }
    }
    let (distances, _) = solid.shape.sample_packet(&points, 1.0);
    for i in at[0]..end {
        if walls[row + i] == 0 && distances[i - at[0]] < 0.0 {
            walls[row + i] = number;
        }
    }
}
