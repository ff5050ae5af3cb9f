//! The fields of the pressure and the solid cells.

#![expect(clippy::needless_range_loop, reason = "one index for several arrays is what vectorises")]

use super::relax::System;
use super::walls::{KnownCells, LayerWalls};
use crate::body::ColliderFrame;
use crate::interaction::grid::{Bounds, GridPlacement, GridSolid, MASS, Node, STRIP, density};
use crate::interaction::transpose::{nodes_of_rows, rows_of_nodes};
use crate::lane::widest;
use crate::scratch::resize;
use rayon::prelude::*;

/// Mass below which a face is closed, relative to that of a sample.
pub const SPARSE: f32 = 1e-3;
/// Density below which no pressure acts in a cell.
pub const LOOSE: f32 = 0.05;
/// Stands in the field of masses for a cell inside a solid.
pub(super) const SOLID: f32 = -1.0;
/// The strip holds hair.
pub(super) const HAIR: u8 = 1;
/// The strip holds hair or lies beside one that does.
pub(super) const NEAR: u8 = 2;

/// Fields on the cells of the box, x fastest, of which only strips near hair are used.
#[derive(Debug, Default)]
pub(crate) struct Fields {
    /// [`HAIR`] and [`NEAR`] of each strip.
    pub(super) strips: Vec<u8>,
    /// The cells of each strip that hold hair, a bit a cell.
    hair: Vec<u16>,
    /// Mass of each cell, or [`SOLID`].
    pub(super) masses: Vec<f32>,
    /// Momentum along each axis.
    pub(super) momentum: [Vec<f32>; 3],
    /// Density of each cell relative to rest.
    pub(in crate::interaction::grid) densities: Vec<f32>,
    /// The solid in the cell, counted from 1; 0 is none. If several solids overlap, the first.
    pub(super) walls: Vec<u16>,
    /// The solids of the frame.
    pub(super) solids: Vec<GridSolid>,
    /// Their cells, as far as they are known from frames before.
    known: Vec<KnownCells>,
    /// The equations of the pressure.
    pub(super) system: System,
    /// Pressures of each cell: for velocities and for displacements.
    pub(in crate::interaction::grid) pressures: [Vec<f32>; 2],
    /// A maximum for each layer.
    pub(super) partial: Vec<f32>,
}

/// The fields of a layer that are set from the nodes.
struct LayerFields<'a> {
    hair: &'a mut [u16],
    masses: &'a mut [f32],
    momentum: [&'a mut [f32]; 3],
    densities: &'a mut [f32],
}

impl Fields {
    /// Bytes held.
    pub fn bytes(&self) -> usize {
        let floats = self.pressures.iter().chain(&self.momentum).chain([&self.masses, &self.densities]);
        floats.map(|field| 4 * field.capacity()).sum::<usize>()
            + 2 * self.walls.capacity()
            + self.strips.capacity()
            + self.known.iter().map(KnownCells::bytes).sum::<usize>()
            + 2 * self.hair.capacity()
            + 4 * self.partial.capacity()
            + self.system.bytes()
    }

    /// Resizes the fields to the box and sets those near hair from the `nodes`, of which strips
    /// with `marks` hold hair. Marks cells whose centres are inside one of `solids`.
    pub(super) fn fit(
        &mut self,
        bounds: &Bounds,
        nodes: &[Node],
        marks: &[u8],
        solids: &[ColliderFrame<'_>],
        grid: &GridPlacement<'_>,
    ) {
        let cells = bounds.cells();
        self.solids.clear();
        self.solids.extend(solids.iter().map(|solid| GridSolid::new(solid, grid, bounds)));
        self.known.resize_with(solids.len(), KnownCells::default);
        self.known.iter_mut().zip(solids).for_each(|(known, solid)| known.fit(solid, grid));
        let Self { strips, hair, masses, momentum, densities, walls, pressures, partial, .. } = self;
        for field in momentum.iter_mut().chain(pressures).chain([&mut *masses, densities]) {
            resize(field, cells, 0.0);
        }
        resize(walls, cells, 0);
        resize(strips, cells / STRIP, 0);
        resize(hair, cells / STRIP, 0);
        resize(partial, bounds.dims[2], 0.0);
        let [_, _, layer] = bounds.strides();
        let [x, y, z] = momentum.each_mut().map(|field| field.par_chunks_mut(layer));
        let layers = hair
            .par_chunks_mut(layer / STRIP)
            .zip(masses.par_chunks_mut(layer))
            .zip(x.zip(y).zip(z))
            .zip(densities.par_chunks_mut(layer))
            .enumerate();
        layers.for_each(|(k, (((hair, masses), ((x, y), z)), densities))| {
            let marks = &marks[layer / STRIP * k..layer / STRIP * (k + 1)];
            let mut fields = LayerFields { hair, masses, momentum: [x, y, z], densities };
            widest(
                #[inline(always)]
                || fields.set(&nodes[layer * k..layer * (k + 1)], marks),
            );
        });
        let (hair, placed, known, cell) = (&*hair, &*self.solids, &*self.known, grid.cell as f32);
        let [x, y, z] = momentum.each_mut().map(|field| field.par_chunks_mut(layer));
        let layers = strips
            .par_chunks_mut(layer / STRIP)
            .zip(masses.par_chunks_mut(layer))
            .zip(x.zip(y).zip(z))
            .zip(walls.par_chunks_mut(layer))
            .enumerate();
        layers.for_each(|(k, (((strips, masses), ((x, y), z)), walls))| {
            let momentum = [x, y, z];
            LayerWalls { strips, masses, momentum, walls, solids, placed, known, cell }.find(bounds, k, hair);
        });
    }

    /// Copies the pressures of both solves to the cells of the box. Returns the number of cells
    /// under the pressure of velocities.
    pub(super) fn collect_pressures(&mut self, bounds: &Bounds) -> usize {
        let [_, _, layer] = bounds.strides();
        let Self { system, pressures: [velocity, displacement], strips, .. } = self;
        let (system, strips) = (&*system, &*strips);
        let layers = velocity.par_chunks_mut(layer).zip(displacement.par_chunks_mut(layer)).enumerate();
        let of_layer = |(k, (velocity, displacement)): (usize, (&mut [f32], &mut [f32]))| {
            let mut held = 0;
            let first = k * (layer / STRIP);
            for (strip, _) in near(&strips[first..first + layer / STRIP]) {
                let cells = STRIP * strip..STRIP * (strip + 1);
                let odd = (strip / bounds.strips() + k) & 1;
                system.pressures(0, first + strip, odd, &mut velocity[cells.clone()]);
                system.pressures(1, first + strip, odd, &mut displacement[cells.clone()]);
                held += velocity[cells].iter().filter(|pressure| **pressure > 0.0).count();
            }
            held
        };
        layers.map(of_layer).sum()
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
        let strides = bounds.strides();
        let [_, row, layer] = strides;
        let Self { pressures, masses, momentum, partial, strips, walls, solids, .. } = self;
        let (pressures, masses, momentum) = (&*pressures, &*masses, &*momentum);
        let (strips, walls, solids) = (&*strips, &*walls, &*solids);
        let layers = nodes.par_chunks_mut(layer).zip(partial.par_iter_mut()).enumerate();
        layers.for_each(|(k, (nodes, farthest))| {
            *farthest = 0.0;
            let first = k * (layer / STRIP);
            for number in filled(&strips[first..first + layer / STRIP]) {
                let (from, index) = (STRIP * number, layer * k + STRIP * number);
                let Some(nodes) = nodes[from..].first_chunk_mut::<STRIP>() else { continue };
                let hair: [f32; STRIP] = std::array::from_fn(|n| nodes[n].mass());
                let most = widest(
                    #[inline(always)]
                    || {
                        let momentum = momentum.each_ref().map(|field| strip(field, index));
                        let changes = [
                            changes(&pressures[0], masses, index, strides, least),
                            changes(&pressures[1], masses, index, strides, least),
                        ];
                        let mass = strip(masses, index);
                        to_interpolate(mass, momentum, &changes, pic, nodes)
                    },
                );
                *farthest = farthest.max(most);
                for n in (0..STRIP).filter(|n| walls[index + n] > 0) {
                    let middle = [(from + n) % row, (from + n) / row, k].map(|i| i as f32 + 0.5);
                    let wall = &solids[usize::from(walls[index + n]) - 1];
                    let velocity =
                        |axis: usize| if hair[n] > 0.0 { wall.velocity(axis, middle) } else { 0.0 };
                    nodes[n] = Node::default();
                    nodes[n].0[MASS] = hair[n];
                    for axis in 0..3 {
                        nodes[n].0[axis] = pic * velocity(axis);
                    }
                }
            }
        });
        let farthest = f64::from(partial.iter().copied().fold(0.0, f32::max));
        farthest * 3.0f64.sqrt()
    }
}

/// Writes to `nodes` the velocities to interpolate, masses and displacements of cells with `mass`
/// and `momentum`, from the `changes` of velocity and displacements. Returns the largest component
/// of a displacement.
#[inline(always)]
fn to_interpolate(
    mass: &[f32; STRIP],
    momentum: [&[f32; STRIP]; 3],
    changes: &[[[f32; STRIP]; 3]; 2],
    pic: f32,
    nodes: &mut [Node; STRIP],
) -> f32 {
    let mut rows = [[0.0; STRIP]; 8];
    let mut farthest = [0.0f32; STRIP];
    rows[MASS] = *mass;
    for axis in 0..3 {
        for n in 0..STRIP {
            let is_hair = mass[n] > 0.0;
            let old = momentum[axis][n] / mass[n];
            let [change, shift] = [changes[0][axis][n] + pic * old, changes[1][axis][n]];
            rows[axis][n] = if is_hair { change } else { 0.0 };
            rows[4 + axis][n] = if is_hair { shift } else { 0.0 };
        }
        for n in 0..STRIP {
            let size = rows[4 + axis][n].abs();
            farthest[n] = if size > farthest[n] { size } else { farthest[n] };
        }
    }
    nodes_of_rows(&rows, nodes);
    farthest.into_iter().fold(0.0, f32::max)
}

impl LayerFields<'_> {
    /// Sets the fields of all strips with hair (`marks`) from the `nodes` of the layer.
    #[inline(always)]
    fn set(&mut self, nodes: &[Node], marks: &[u8]) {
        let mut rows = [[0.0; STRIP]; 8];
        self.hair.fill(0);
        for (strip, _) in near(marks) {
            let cells = STRIP * strip..STRIP * (strip + 1);
            let Some(nodes) = nodes[cells.clone()].first_chunk() else { continue };
            rows_of_nodes(nodes, &mut rows);
            let mut hair = 0;
            for n in 0..STRIP {
                self.densities[cells.start + n] = density([rows[4][n], rows[5][n]]);
                hair |= u16::from(rows[MASS][n] > 0.0) << n;
            }
            self.hair[strip] = hair;
            self.masses[cells.clone()].copy_from_slice(&rows[MASS]);
            for (field, row) in self.momentum.iter_mut().zip(&rows) {
                field[cells.clone()].copy_from_slice(row);
            }
        }
    }
}

/// The strips near hair, each with whether it holds hair.
fn near(strips: &[u8]) -> impl Iterator<Item = (usize, bool)> + '_ {
    let marked = strips.iter().enumerate().filter(|(_, mark)| **mark != 0);
    marked.map(|(strip, mark)| (strip, mark & HAIR != 0))
}

/// The strips that hold hair.
pub(super) fn filled(strips: &[u8]) -> impl Iterator<Item = usize> + '_ {
    near(strips).filter(|(_, is_hair)| *is_hair).map(|(strip, _)| strip)
}

/// The values of a field in the cells of a strip, or of one moved by some cells.
#[inline(always)]
pub(super) fn strip(field: &[f32], index: usize) -> &[f32; STRIP] {
    field[index..].first_chunk().unwrap_or(&[0.0; STRIP])
}

/// The changes that a pressure causes in [`STRIP`] cells from `index`, along each axis: the mean of
/// the changes at the two faces of a cell, of which walls do not count.
#[inline(always)]
fn changes(
    pressure: &[f32],
    masses: &[f32],
    index: usize,
    strides: [usize; 3],
    least: f32,
) -> [[f32; STRIP]; 3] {
    let (p, m) = (strip(pressure, index), strip(masses, index));
    let mut out = [[0.0; STRIP]; 3];
    for axis in 0..3 {
        let mut faces = [0.0; STRIP];
        for (beyond, sign) in [(index - strides[axis], 2.0), (index + strides[axis], -2.0)] {
            let (other, beyond) = (strip(pressure, beyond), strip(masses, beyond));
            for n in 0..STRIP {
                let sum = m[n] + beyond[n];
                let is_wall = (m[n] < 0.0) | (beyond[n] < 0.0);
                let is_open = !is_wall & (0.5 * sum > least);
                let change = sign * (other[n] - p[n]) / sum;
                out[axis][n] += if is_open { change } else { 0.0 };
                faces[n] += if is_wall { 0.0 } else { 1.0 };
            }
        }
        for n in 0..STRIP {
            out[axis][n] /= if faces[n] > 1.0 { faces[n] } else { 1.0 };
        }
    }
    out
}
