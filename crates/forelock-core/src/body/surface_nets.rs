//! Meshing of an implicit surface.
//!
//! # Theory
//!
//! Naive surface nets (Gibson 1998, "Constrained elastic surface nets"): every grid cell that the
//! surface passes through contains one vertex, and every grid edge that it crosses gives one quad
//! between the four cells around that edge. Each edge of a quad is shared with exactly one other
//! quad unless the signs at the corners of a cell face alternate, so the mesh is closed and
//! manifold if the grid is fine enough for the shape. Vertices start at the mean of the edge
//! crossings and are then moved onto the surface by Newton's method along the gradient.
//!
//! # Practice
//!
//! The grid is processed in blocks of 4³ cells. A block whose centre is farther from the surface
//! than its corners can be is skipped, so the work is proportional to the area, not to the volume.
//! Blocks run in parallel; vertices are numbered in block order, so the mesh does not depend on the
//! number of threads.
//!
//! # Limitations
//!
//! The surface must lie within the box. Features thinner than a cell are lost or merge.

use glam::{UVec3, Vec3};
use rayon::prelude::*;

use crate::body::TriMesh;

/// Cells along a block's side.
const BLOCK: u32 = 4;
/// Samples along a block's side.
const SAMPLES: u32 = BLOCK + 1;
/// Upper bound of how much faster than the true distance the function may change; the test that
/// skips blocks uses this factor.
const LIPSCHITZ: f32 = 1.3;
/// Marks a cell without a vertex.
const NONE: u32 = u32::MAX;

/// An axis-aligned box.
#[derive(Clone, Copy, Debug)]
pub struct Bounds {
    pub min: Vec3,
    pub max: Vec3,
}

/// A grid of cubes over a box, and the map from grid points to space.
struct Grid<W> {
    origin: Vec3,
    cell: f32,
    blocks: UVec3,
    warp: W,
}

/// The result of one block: inside flags and the vertices of its cells.
struct Block {
    at: UVec3,
    /// For each sample: whether it is inside.
    inside: Vec<bool>,
    /// For each cell: the index of its vertex in `vertices`, or [`NONE`].
    cells: Vec<u32>,
    vertices: Vec<Vec3>,
}

/// Meshes the zero surface of `distance` (negative inside) on a grid of cubes of side `cell` over
/// the box `bounds`.
///
/// `warp` maps grid points to space, each axis independently and monotonically, so that cells can
/// be finer where detail is needed. All lengths have the same unit. Triangles are counter-clockwise
/// seen from the positive side.
pub fn surface_nets<W: Fn(Vec3) -> Vec3 + Sync>(
    distance: impl Fn(Vec3) -> f32 + Sync,
    warp: W,
    bounds: Bounds,
    cell: f32,
) -> TriMesh {
    let side = cell * BLOCK as f32;
    let blocks = ((bounds.max - bounds.min) / side).ceil().as_uvec3().max(UVec3::ONE);
    let grid = Grid { origin: bounds.min, cell, blocks, warp };
    let count = grid.blocks.x * grid.blocks.y * grid.blocks.z;
    let blocks: Vec<Option<Block>> = (0..count)
        .into_par_iter()
        .map(|index| {
            let at = grid.block_at(index);
            let (low, high) = (grid.point(at * BLOCK), grid.point((at + 1) * BLOCK));
            (distance(0.5 * (low + high)).abs() <= LIPSCHITZ * 0.5 * low.distance(high))
                .then(|| sample_block(&grid, at, &distance))
        })
        .collect();

    let mut first_vertex = Vec::with_capacity(blocks.len());
    let mut positions = Vec::new();
    for block in &blocks {
        first_vertex.push(positions.len() as u32);
        positions.extend(block.iter().flat_map(|b| &b.vertices));
    }
    let vertex = |cell: UVec3| {
        let at = cell / BLOCK;
        let index = grid.block_index(at);
        let local = blocks[index].as_ref()?.cells[cell_index(cell % BLOCK)];
        (local != NONE).then(|| first_vertex[index] + local)
    };
    let mut triangles = Vec::with_capacity(2 * positions.len());
    for block in blocks.iter().flatten() {
        add_quads(block, &vertex, &positions, &mut triangles);
    }
    TriMesh { positions, triangles }
}

/// Moves `point` onto the zero surface of `distance` by at most `reach`: one Newton step, and a
/// second one along the same gradient.
pub fn project(point: Vec3, distance: impl Fn(Vec3) -> f32, reach: f32) -> Vec3 {
    let gradient = super::implicit::gradient(&distance, point);
    let step = gradient / gradient.length_squared().max(1e-6);
    let moved = point - step * distance(point);
    let moved = moved - step * distance(moved);
    point + (moved - point).clamp_length_max(reach)
}

impl<W: Fn(Vec3) -> Vec3> Grid<W> {
    fn block_at(&self, index: u32) -> UVec3 {
        let row = index / self.blocks.x;
        UVec3::new(index % self.blocks.x, row % self.blocks.y, row / self.blocks.y)
    }

    fn block_index(&self, at: UVec3) -> usize {
        (at.x + self.blocks.x * (at.y + self.blocks.y * at.z)) as usize
    }

    fn point(&self, sample: UVec3) -> Vec3 {
        (self.warp)(self.origin + sample.as_vec3() * self.cell)
    }
}

fn cell_index(at: UVec3) -> usize {
    (at.x + BLOCK * (at.y + BLOCK * at.z)) as usize
}

fn sample_index(at: UVec3) -> usize {
    (at.x + SAMPLES * (at.y + SAMPLES * at.z)) as usize
}

/// All points of a cube of side `n`, x fastest.
fn cube(n: u32) -> impl Iterator<Item = UVec3> {
    (0..n * n * n).map(move |i| UVec3::new(i % n, i / n % n, i / (n * n)))
}

fn sample_block(grid: &Grid<impl Fn(Vec3) -> Vec3>, at: UVec3, distance: &impl Fn(Vec3) -> f32) -> Block {
    let base = at * BLOCK;
    let values: Vec<f32> = cube(SAMPLES).map(|local| distance(grid.point(base + local))).collect();
    let mut cells = vec![NONE; (BLOCK * BLOCK * BLOCK) as usize];
    let mut vertices = Vec::new();
    for local in cube(BLOCK) {
        let (mut sum, mut crossings) = (Vec3::ZERO, 0.0);
        for corner in cube(2) {
            for axis in [UVec3::X, UVec3::Y, UVec3::Z] {
                if corner.dot(axis) == 1 {
                    continue;
                }
                let (from, to) = (local + corner, local + corner + axis);
                let (a, b) = (values[sample_index(from)], values[sample_index(to)]);
                if (a < 0.0) != (b < 0.0) {
                    sum += grid.point(base + from).lerp(grid.point(base + to), a / (a - b));
                    crossings += 1.0;
                }
            }
        }
        if crossings > 0.0 {
            cells[cell_index(local)] = vertices.len() as u32;
            vertices.push(sum / crossings);
        }
    }
    Block { at, inside: values.iter().map(|&v| v < 0.0).collect(), cells, vertices }
}

/// Adds the two triangles of each crossed grid edge that starts in `block`.
fn add_quads(
    block: &Block,
    vertex: &impl Fn(UVec3) -> Option<u32>,
    positions: &[Vec3],
    triangles: &mut Vec<[u32; 3]>,
) {
    let axes = [UVec3::X, UVec3::Y, UVec3::Z];
    for local in cube(BLOCK) {
        let from_inside = block.inside[sample_index(local)];
        let sample = block.at * BLOCK + local;
        for axis in 0..3 {
            let (u, v) = (axes[(axis + 1) % 3], axes[(axis + 2) % 3]);
            let crossed = from_inside != block.inside[sample_index(local + axes[axis])];
            if !crossed || sample.dot(u) == 0 || sample.dot(v) == 0 {
                continue;
            }
            let around = [sample - u - v, sample - v, sample, sample - u];
            let [Some(a), Some(b), Some(c), Some(d)] = around.map(vertex) else { continue };
            let [a, b, c, d] = if from_inside { [a, b, c, d] } else { [d, c, b, a] };
            let length = |i: u32, j: u32| positions[i as usize].distance_squared(positions[j as usize]);
            if length(a, c) <= length(b, d) {
                triangles.extend([[a, b, c], [a, c, d]]);
            } else {
                triangles.extend([[b, c, d], [b, d, a]]);
            }
        }
    }
}
