//! The distance field of a body in one pose, made anew for every step.
//!
//! # Theory
//! Nodes within a band of the surface store their exact distance from its triangles; the sign is
//! that of the winding number ([`super::winding`]). Beyond the band a node stores a bound, which is
//! nearer to zero than the distance: the band, or at nodes of bricks what the coarse nodes around
//! them imply, since a distance is 1-Lipschitz.
//!
//! Triangles that a pose leaves where they are at rest need no work. A coarse node is *touched* if
//! a triangle that has moved is in its band, in this pose or at rest. Untouched nodes and the
//! bricks between eight of them are those of the body at rest.
//!
//! # Practice
//! Each plane of nodes and each layer of cells is one task, with the triangles near it. A field is
//! a function of the pose alone: it does not depend on threads or on the poses before.

use std::slice;
use std::sync::Mutex;

use glam::Vec3;
use rayon::prelude::*;

use super::super::ClosedFaces;
use super::super::sdf::{BRICK_NODES, NO_BRICK, REFINEMENT, Sdf};
use super::brick::{Apart, Brick, SIDE};
use super::grid::{Bins, Bits, Grid, Nodes, nodes_near};
use super::triangle::{Add, Added, Axis, NO_TRIANGLE, Plane, Triangle, add_for_this_processor};
use super::winding::Crossings;
use crate::lane::widest;

/// Coarse nodes within this distance of the surface store their distance, in coarse cells.
const BAND: f32 = 1.25;
/// Nodes of bricks within this distance of the surface store their distance, in cells of bricks:
/// all nodes of a cell through which the surface passes.
const FINE_BAND: f32 = 1.75;
/// A cell has a brick if the box of a triangle is nearer than this, in coarse cells.
const BRICK_BAND: f32 = 0.6;

/// The field of the body in one pose.
#[derive(Clone, Debug)]
pub(super) struct Level {
    pub sdf: Sdf,
    /// For each value of a brick, the triangle nearest to its node; `u32::MAX` outside the band.
    pub nearest: Vec<u32>,
    /// The corners of the closed surface, metres.
    pub corners: Vec<Vec3>,
}

impl Level {
    pub fn nodes(&self) -> usize {
        self.sdf.starts().len()
    }
}

/// The bricks of a layer of cells.
#[derive(Debug, Default)]
struct LayerBricks {
    cells: Vec<u32>,
    values: Vec<f32>,
    nearest: Vec<u32>,
}

/// Buffers of one task.
#[derive(Debug, Default)]
struct Scratch {
    coarse: Plane,
    fine: [Plane; SIDE],
    crossings: Crossings,
    cells: Bits,
}

/// Buffers that are kept from step to step.
#[derive(Debug, Default)]
pub(super) struct Work {
    moved: Vec<bool>,
    touched: Bits,
    /// Triangles in whose band touched nodes are.
    active: Vec<Triangle>,
    /// The triangles in whose band each plane is.
    near: Bins,
    /// The triangles for whose sake cells of each layer may have bricks.
    beside: Bins,
    /// All triangles that each layer meets.
    crossed: Bins,
    layers: Vec<LayerBricks>,
    scratch: Mutex<Vec<Scratch>>,
}

/// What all tasks read.
struct Context<'a> {
    grid: &'a Grid,
    faces: &'a ClosedFaces,
    corners: &'a [Vec3],
    base: Option<&'a Level>,
    touched: &'a Bits,
    active: &'a [Triangle],
    near: &'a Bins,
    beside: &'a Bins,
    crossed: &'a Bins,
    /// Coordinates of nodes in x: of the coarse grid and of the refined one.
    xs: [Vec<f32>; 2],
    add: Add,
}

/// Writes the field of the surface with its corners at `level.corners`; `base` is that of the
/// surface at rest.
pub(super) fn build(
    grid: &Grid,
    faces: &ClosedFaces,
    base: Option<&Level>,
    level: &mut Level,
    work: &mut Work,
) {
    let [columns, rows, planes] = grid.size();
    let Work { moved, touched, active, near, beside, crossed, layers, scratch } = work;
    let Level { sdf, nearest, corners } = level;
    moved.clear();
    moved
        .extend(corners.iter().enumerate().map(|(at, now)| base.is_none_or(|base| base.corners[at] != *now)));
    let band = BAND * grid.cell;
    mark_touched(grid, faces, base, corners, moved, touched);
    let axes = [0, 1, 2].map(|axis| grid.axis(axis, 1));
    let is_active = |number: u32| {
        let at = faces.corners_of(number).map(|corner| corners[corner as usize]);
        // A touched node has bricks beside it that reach a cell farther.
        let nodes = nodes_near(&axes, &at, (1.0 + BRICK_BAND) * grid.cell)?;
        (faces.is_bounding(number) && any_touched(touched, rows, &nodes)).then(|| Triangle::new(number, at))
    };
    active.clear();
    active.par_extend((0..faces.len()).into_par_iter().with_min_len(1024).filter_map(is_active));
    let z = &axes[2];
    near.fill(
        planes,
        active.iter().map(|own| {
            let within = z.between(own.low.z - band, own.high.z + band)?;
            Some((*within.start(), *within.end()))
        }),
    );
    // A layer lies between its plane and the next one, both included.
    let layers_of = |low: f32, high: f32| {
        let [low, high] = [low, high].map(|at| ((at - z.first) / z.step).floor());
        let some = high >= 0.0 && low <= (planes - 1) as f32;
        some.then(|| (low.max(0.0) as usize, (high as usize).min(planes - 1)))
    };
    let reach = BRICK_BAND * grid.cell;
    beside.fill(planes, active.iter().map(|own| layers_of(own.low.z - reach, own.high.z + reach)));
    let slack = 1e-3 * z.step;
    crossed.fill(
        planes,
        faces.triangles().map(|([a, b, c], _)| {
            let [a, b, c] = [corners[a as usize].z, corners[b as usize].z, corners[c as usize].z];
            layers_of(min(min(a, b), c) - slack, a.max(b).max(c) + slack)
        }),
    );
    let xs = [1, REFINEMENT].map(|refinement| {
        let axis = grid.axis(0, refinement);
        (0..axis.count).map(|node| axis.at(node)).collect()
    });
    let context = Context {
        grid,
        faces,
        corners: &corners[..],
        base,
        touched: &*touched,
        active: &active[..],
        near: &*near,
        beside: &*beside,
        crossed: &*crossed,
        xs,
        add: add_for_this_processor(),
    };
    let pool: &Mutex<Vec<Scratch>> = scratch;
    let with_scratch = |task: &mut dyn FnMut(&mut Scratch)| {
        let taken = pool.lock().map_or(None, |mut pool| pool.pop());
        let mut own = taken.unwrap_or_default();
        task(&mut own);
        if let Ok(mut pool) = pool.lock() {
            pool.push(own);
        }
    };
    let nodes = columns * rows * planes;
    let kept = base.map_or(nodes, |base| base.sdf.values().len());
    let parts = sdf.parts_mut();
    parts.values.truncate(kept);
    nearest.truncate(kept - nodes);
    let planes_of_values = parts.values[..nodes].par_chunks_mut(columns * rows).enumerate();
    planes_of_values.for_each(|(k, values)| {
        with_scratch(&mut |scratch| {
            widest(
                #[inline(always)]
                || context.plane(k, values, scratch),
            )
        });
    });
    layers.resize_with(planes - 1, LayerBricks::default);
    let values = &parts.values[..nodes];
    let tables = parts
        .starts
        .par_chunks_mut(columns * rows)
        .zip(parts.least.par_chunks_mut((columns - 1) * (rows - 1)));
    tables.zip(layers.par_iter_mut()).enumerate().for_each(|(k, ((starts, least), bricks))| {
        with_scratch(&mut |scratch| {
            widest(
                #[inline(always)]
                || context.layer(k, values, starts, least, bricks, scratch),
            );
        });
    });
    for layer in layers {
        for (number, cell) in layer.cells.iter().enumerate() {
            parts.starts[*cell as usize] = (parts.values.len() + number * BRICK_NODES) as u32;
        }
        parts.values.extend_from_slice(&layer.values);
        nearest.extend_from_slice(&layer.nearest);
    }
}

fn any_touched(touched: &Bits, rows: usize, &[x, y, z]: &Nodes) -> bool {
    (z.0..=z.1).any(|k| (y.0..=y.1).any(|j| touched.meets(j + rows * k, x.0, x.1)))
}

/// Finds the touched nodes.
fn mark_touched(
    grid: &Grid,
    faces: &ClosedFaces,
    base: Option<&Level>,
    corners: &[Vec3],
    moved: &[bool],
    touched: &mut Bits,
) {
    let [columns, rows, planes] = grid.size();
    let Some(base) = base else { return touched.clone_from(&grid.reached) };
    touched.reset(columns, rows * planes, false);
    let axes = [0, 1, 2].map(|axis| grid.axis(axis, 1));
    for (triangle, _) in faces.triangles() {
        if !triangle.iter().any(|&corner| moved[corner as usize]) {
            continue;
        }
        for positions in [corners, &base.corners[..]] {
            let at = triangle.map(|corner| positions[corner as usize]);
            let Some([x, y, z]) = nodes_near(&axes, &at, BAND * grid.cell) else { continue };
            for k in z.0..=z.1 {
                for j in y.0..=y.1 {
                    touched.set(j + rows * k, x.0, x.1);
                }
            }
        }
    }
    touched.keep_those_of(&grid.reached);
}

impl Context<'_> {
    #[inline(always)]
    fn corners_of(&self, [a, b, c]: [u32; 3]) -> [Vec3; 3] {
        [self.corners[a as usize], self.corners[b as usize], self.corners[c as usize]]
    }

    /// Adds triangles to planes at `zs`.
    fn add(&self, planes: &mut [Plane], numbers: &[u32], band: f32, [columns, rows]: [&Axis; 2], zs: &[f32]) {
        let added = Added { triangles: self.active, numbers, band, columns, rows, zs };
        // SAFETY: the function is the one for this processor.
        unsafe { (self.add)(planes, &added) }
    }

    /// Writes the distances of the coarse nodes of plane `k`.
    #[inline(always)]
    fn plane(&self, k: usize, values: &mut [f32], scratch: &mut Scratch) {
        let [columns, rows, _] = self.grid.size();
        let [x, y, z] = [0, 1, 2].map(|axis| self.grid.axis(axis, 1));
        let (band, at) = (BAND * self.grid.cell, z.at(k));
        let Scratch { coarse, crossings, .. } = scratch;
        coarse.prepare(columns, rows, band);
        self.add(slice::from_mut(coarse), self.near.of(k), band, [&x, &y], &[at]);
        crossings.clear();
        for &face in self.crossed.of(k) {
            crossings.add(&self.corners_of(self.faces.corners_of(face)), &y, at, 0);
        }
        crossings.sort(rows);
        let before = self.base.map(|base| &base.sdf.values()[k * columns * rows..]);
        let mut winding = vec![0i32; columns];
        for row in 0..rows {
            winding.fill(0);
            for &(first, change) in crossings.of_row(row) {
                for (number, x) in winding.iter_mut().zip(&self.xs[0]) {
                    *number += if *x >= first { change } else { 0 };
                }
            }
            for (column, winding) in winding.iter().enumerate() {
                let at = row * columns + column;
                let inside = *winding > 0;
                let signed = |distance: f32| if inside { -distance } else { distance };
                let touched = self.touched.has(row + rows * k, column);
                values[at] = match before.map(|before| before[at]) {
                    _ if !touched && !self.grid.reached.has(row + rows * k, column) => band,
                    // Near the surface at rest, and no part of it has moved.
                    Some(value) if !touched => signed(value.abs()),
                    _ => {
                        let squared = coarse.squared(column, row);
                        signed(if squared < band * band { squared.sqrt() } else { band })
                    }
                };
            }
        }
        coarse.forget(band);
    }

    /// Writes the tables of layer `k` of cells, and its bricks. `values` are those of all coarse
    /// nodes.
    #[inline(always)]
    fn layer(
        &self,
        k: usize,
        values: &[f32],
        starts: &mut [u32],
        least: &mut [f32],
        bricks: &mut LayerBricks,
        scratch: &mut Scratch,
    ) {
        let [columns, rows, _] = self.grid.size();
        self.find_bricks(k, &mut scratch.cells);
        let plane = columns * rows;
        let [below, above] = [k, k + 1].map(|k| &values[k * plane..(k + 1) * plane]);
        bricks.cells.clear();
        for row in 0..rows - 1 {
            let first = row * columns;
            let of_corners = [below, above].map(|values| [&values[first..], &values[first + columns..]]);
            let own = &mut least[row * (columns - 1)..(row + 1) * (columns - 1)];
            for (column, least) in own.iter_mut().enumerate() {
                let [[a, b], [c, d]] = of_corners;
                let at = |row: &[f32]| min(row[column], row[column + 1]);
                *least = min(min(at(a), at(b)), min(at(c), at(d)));
            }
            for (column, least) in own.iter_mut().enumerate() {
                let at = first + column;
                starts[at] = NO_BRICK;
                if scratch.cells.has(row, column) {
                    bricks.cells.push((k * plane + at) as u32);
                } else if let Some(base) = self.base {
                    let start = base.sdf.starts()[k * plane + at];
                    if start != NO_BRICK && !self.is_touched([column, row, k]) {
                        starts[at] = start;
                        let block = column + (columns - 1) * (row + (rows - 1) * k);
                        *least = least.min(base.sdf.least()[block]);
                    }
                }
            }
        }
        bricks.values.clear();
        bricks.nearest.clear();
        if !bricks.cells.is_empty() {
            self.write_bricks(k, [below, above], least, bricks, scratch);
        }
    }

    /// Whether one of the corners of a cell is touched.
    fn is_touched(&self, [i, j, k]: [usize; 3]) -> bool {
        let rows = self.grid.size()[1];
        let of_row = |row: usize| self.touched.meets(row, i, i + 1);
        [(j, k), (j + 1, k), (j, k + 1), (j + 1, k + 1)].into_iter().any(|(j, k)| of_row(j + rows * k))
    }

    /// The touched cells of layer `k` that have a brick.
    #[inline(always)]
    fn find_bricks(&self, k: usize, cells: &mut Bits) {
        let [columns, rows, _] = self.grid.size();
        let cell = self.grid.cell;
        cells.reset(columns, rows - 1, false);
        let reach = BRICK_BAND * cell;
        let (low_z, high_z) = (self.grid.axis(2, 1).at(k) - reach, self.grid.axis(2, 1).at(k + 1) + reach);
        for &own in self.beside.of(k) {
            let Triangle { low, high, .. } = &self.active[own as usize];
            if high.z < low_z || low.z > high_z {
                continue;
            }
            let low = ((*low - reach - self.grid.origin) / cell).floor().max(Vec3::ZERO);
            let high = ((*high + reach - self.grid.origin) / cell).floor();
            let last = high.min(Vec3::new((columns - 2) as f32, (rows - 2) as f32, f32::INFINITY));
            if last.x < low.x || last.y < low.y {
                continue;
            }
            for row in low.y as usize..=last.y as usize {
                cells.set(row, low.x as usize, last.x as usize);
            }
        }
        for row in 0..rows - 1 {
            for column in 0..columns - 1 {
                if cells.has(row, column) && !self.is_touched([column, row, k]) {
                    cells.remove(row, column);
                }
            }
        }
    }

    /// Writes the values of the `bricks` of layer `k`, whose coarse nodes have the values of two
    /// planes.
    #[inline(always)]
    fn write_bricks(
        &self,
        k: usize,
        planes: [&[f32]; 2],
        least: &mut [f32],
        bricks: &mut LayerBricks,
        scratch: &mut Scratch,
    ) {
        let [columns, rows, _] = self.grid.size();
        let [x, y, z] = [0, 1, 2].map(|axis| self.grid.axis(axis, REFINEMENT));
        let band = FINE_BAND * x.step;
        let Scratch { fine, crossings, .. } = scratch;
        crossings.clear();
        fine.iter_mut().for_each(|plane| plane.prepare(x.count, y.count, band));
        let heights: [f32; SIDE] = std::array::from_fn(|at| z.at(k * REFINEMENT as usize + at));
        self.add(fine, self.beside.of(k), band, [&x, &y], &heights);
        for &face in self.crossed.of(k) {
            let corners = self.corners_of(self.faces.corners_of(face));
            for (at, height) in heights.into_iter().enumerate() {
                crossings.add(&corners, &y, height, at * y.count);
            }
        }
        crossings.sort(SIDE * y.count);
        let apart = Apart::new(self.grid.cell);
        for cell in &bricks.cells {
            let at = *cell as usize - k * columns * rows;
            let (i, j) = (at % columns, at / columns);
            let corners = planes
                .map(|values| [values[at], values[at + 1], values[at + columns], values[at + columns + 1]]);
            let mut brick = Brick::new();
            for (dz, plane) in fine.iter().enumerate() {
                for dy in 0..SIDE {
                    let row = j * REFINEMENT as usize + dy;
                    let from = i * REFINEMENT as usize;
                    let to = SIDE * (dy + SIDE * dz);
                    let [squared, nearest] = plane.nodes(from, row);
                    brick.squared[to..to + SIDE].copy_from_slice(&squared);
                    brick.nearest[to..to + SIDE].copy_from_slice(&nearest);
                    let nodes = &self.xs[1][from..from + SIDE];
                    for &(first, change) in crossings.of_row(dz * y.count + row) {
                        for (number, x) in brick.winding[to..to + SIDE].iter_mut().zip(nodes) {
                            *number += if *x >= first { change } else { 0 };
                        }
                    }
                }
            }
            let smallest = brick.finish(corners.as_flattened(), &apart, band);
            bricks.values.extend_from_slice(&brick.squared[..BRICK_NODES]);
            let number =
                |own: &f32| if *own == NO_TRIANGLE { u32::MAX } else { self.active[*own as usize].number };
            bricks.nearest.extend(brick.nearest[..BRICK_NODES].iter().map(number));
            let least = &mut least[i + (columns - 1) * j];
            *least = least.min(smallest);
        }
        fine.iter_mut().for_each(|plane| plane.forget(band));
    }
}

/// The smaller of two numbers.
#[inline(always)]
fn min(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}
