//! Distances of grid nodes from a triangle.
//!
//! # Theory
//! In the plane of a triangle let (L, s) be the coordinates of a point along an edge, from its
//! first end, and across it, positive towards the inside; h is the height over the plane. A point
//! over the triangle (s ≥ 0 at all edges) is |h| away. Otherwise its squared distance is h² plus
//! the least over the edges of s² + (L − clamp(L, 0, length))².
//!
//! # Practice
//! Nodes are computed in tiles of [`TILE`]² in x and y. L, s and h are affine functions of the
//! position, so on a tile each is that at its first node plus what is the same on all tiles.

use std::ops::RangeInclusive;

use glam::Vec3;

use crate::lane::{LANES, Lane, Row, Simd, on};

/// Functions of a triangle, and one that is not used.
const FUNCTIONS: usize = 8;
/// Nodes along a side of a tile.
pub(super) const TILE: usize = 4;

/// A triangle as the affine functions of its distance, and its box.
#[derive(Clone, Copy, Debug)]
pub(super) struct Triangle {
    pub number: u32,
    pub low: Vec3,
    pub high: Vec3,
    /// Slopes along x, y and z and the constant of L and s at each edge in turn, and of h.
    functions: [[f32; FUNCTIONS]; 4],
    lengths: [f32; 3],
}

/// Shorter edges have no direction, metres.
const SHORT: f32 = 1e-9;
/// The coordinate across an edge without a direction, metres: far away, on the inside.
const FAR: f32 = 1e3;

impl Triangle {
    pub fn new(number: u32, corners: [Vec3; 3]) -> Self {
        let [a, b, c] = corners;
        let mut functions = [[0.0; FUNCTIONS]; 4];
        let mut set = |which: usize, slope: Vec3, at: Vec3| {
            (functions[0][which], functions[1][which], functions[2][which]) = slope.into();
            functions[3][which] = -slope.dot(at);
        };
        let edges = [b - a, c - b, a - c];
        let cross = edges[0].cross(c - a);
        // A triangle without area lies in any plane through its longest edge.
        let longest = edges.into_iter().fold(Vec3::ZERO, |longest, edge| {
            if edge.length_squared() > longest.length_squared() { edge } else { longest }
        });
        let has_area = cross.length() > 1e-7 * longest.length_squared();
        let normal =
            if has_area { cross.normalize() } else { longest.normalize_or(Vec3::X).any_orthonormal_vector() };
        let mut lengths = [0.0; 3];
        for (edge, along) in edges.into_iter().enumerate() {
            lengths[edge] = along.length();
            if lengths[edge] > SHORT {
                let along = along / lengths[edge];
                set(2 * edge, along, corners[edge]);
                set(2 * edge + 1, normal.cross(along), corners[edge]);
            }
        }
        set(6, normal, a);
        for edge in 0..3 {
            if lengths[edge] <= SHORT {
                functions[3][2 * edge + 1] = FAR;
            }
        }
        Self { number, low: a.min(b).min(c), high: a.max(b).max(c), functions, lengths }
    }
}

/// Nodes along one axis.
#[derive(Clone, Debug)]
pub(super) struct Axis {
    pub first: f32,
    pub step: f32,
    pub count: usize,
}

impl Axis {
    #[inline(always)]
    pub fn at(&self, node: usize) -> f32 {
        self.first + node as f32 * self.step
    }

    /// The nodes between two coordinates.
    #[inline(always)]
    pub fn between(&self, low: f32, high: f32) -> Option<RangeInclusive<usize>> {
        let (low, high) = ((low - self.first) / self.step, (high - self.first) / self.step);
        // Also false for a coordinate that is not a number.
        if !(high >= 0.0 && low <= (self.count - 1) as f32) {
            return None;
        }
        let low = if low > 0.0 { low } else { 0.0 };
        let first = low as usize + usize::from((low as usize as f32) < low);
        let last = (high as usize).min(self.count - 1);
        (first <= last).then_some(first..=last)
    }
}

/// Squared distances of the nodes of a plane across z from the nearest triangle, and its number.
#[derive(Debug, Default)]
pub(super) struct Plane {
    /// A tile each, its rows one after the other.
    squared: Vec<Row<f32>>,
    nearest: Vec<Row<f32>>,
    /// Tiles in x, and in y.
    tiles: [usize; 2],
    /// The tiles of each row of tiles that are not empty: from the first number on, before the
    /// second.
    written: Vec<[usize; 2]>,
}

/// Of a row of tiles that is empty.
const NOTHING: [usize; 2] = [usize::MAX, 0];
/// The number of no triangle. Float32 holds all smaller numbers exactly.
pub(super) const NO_TRIANGLE: f32 = 16_777_216.0;

/// Triangles that are added to planes.
pub(super) struct Added<'a> {
    pub triangles: &'a [Triangle],
    /// Which of them.
    pub numbers: &'a [u32],
    /// The distance up to which they count, metres.
    pub band: f32,
    pub columns: &'a Axis,
    pub rows: &'a Axis,
    /// The planes' coordinates.
    pub zs: &'a [f32],
}

/// Adds triangles to planes.
///
/// # Safety
/// The processor must support the instruction set of the function.
pub(super) type Add = unsafe fn(&mut [Plane], &Added<'_>);

/// The function for the best instruction set of the processor.
#[inline(never)]
pub(super) fn add_for_this_processor() -> Add {
    let simd = Simd::Auto.resolve();
    on!(simd, add(planes: &mut [Plane], added: &Added<'_>))
}

impl Plane {
    /// No triangle within `band` metres of any of `rows` rows of `nodes` nodes. The plane is new or
    /// was emptied by [`Plane::forget`].
    pub fn prepare(&mut self, nodes: usize, rows: usize, band: f32) {
        let tiles = [nodes, rows].map(|nodes| nodes.div_ceil(TILE));
        if self.tiles != tiles {
            let count = tiles[0] * tiles[1];
            *self = Self {
                squared: vec![Row([band * band; LANES]); count],
                nearest: vec![Row([NO_TRIANGLE; LANES]); count],
                tiles,
                written: vec![NOTHING; tiles[1]],
            };
        }
    }

    /// Empties the plane.
    pub fn forget(&mut self, band: f32) {
        for (row, written) in self.written.iter_mut().enumerate() {
            let [from, to] = std::mem::replace(written, NOTHING);
            if from < to {
                let tiles = row * self.tiles[0] + from..row * self.tiles[0] + to;
                self.squared[tiles.clone()].fill(Row([band * band; LANES]));
                self.nearest[tiles].fill(Row([NO_TRIANGLE; LANES]));
            }
        }
    }

    /// The squared distance of a node.
    #[inline(always)]
    pub fn squared(&self, column: usize, row: usize) -> f32 {
        let tile = column / TILE + row / TILE * self.tiles[0];
        self.squared[tile].0[column % TILE + TILE * (row % TILE)]
    }

    /// Squared distances and nearest triangles of [`TILE`] + 1 nodes of a row, of which the first
    /// is the first in its tile.
    #[inline(always)]
    pub fn nodes(&self, column: usize, row: usize) -> [[f32; TILE + 1]; 2] {
        let tile = column / TILE + row / TILE * self.tiles[0];
        let at = TILE * (row % TILE);
        let of = |values: &[Row<f32>]| {
            let (own, next) = (&values[tile].0[at..at + TILE], values[tile + 1].0[at]);
            [own[0], own[1], own[2], own[3], next]
        };
        [of(&self.squared), of(&self.nearest)]
    }
}

#[inline(always)]
fn add<L: Lane<Scalar = f32>>(planes: &mut [Plane], added: &Added<'_>) {
    let &Added { triangles, numbers, band, columns, rows, zs } = added;
    let across: Row<f32> = Row(std::array::from_fn(|lane| (lane % TILE) as f32 * columns.step));
    let up: Row<f32> = Row(std::array::from_fn(|lane| (lane / TILE) as f32 * rows.step));
    for &number in numbers {
        let triangle = &triangles[number as usize];
        let (low, high) = (triangle.low - band, triangle.high + band);
        let Some(along) = columns.between(low.x, high.x) else { continue };
        let Some(over) = rows.between(low.y, high.y) else { continue };
        let [gx, gy, gz, constant] = &triangle.functions;
        let [first, last] = [along.start() / TILE, along.end() / TILE];
        let [lowest, highest] = [over.start() / TILE, over.end() / TILE];
        let (x, y) = (columns.at(TILE * first), rows.at(TILE * lowest));
        let (step_x, step_y) = (columns.step * TILE as f32, rows.step * TILE as f32);
        let mut corner = [0.0; FUNCTIONS];
        for k in 0..FUNCTIONS {
            corner[k] = constant[k] + gx[k] * x + gy[k] * y;
        }
        let [length0, length1, length2] = triangle.lengths.map(L::splat);
        let own = L::splat(number as f32);
        // How much the height changes at most on a tile.
        let rise = (TILE - 1) as f32 * (gx[6].abs() * columns.step + gy[6].abs() * rows.step);
        for lane in (0..LANES).step_by(L::WIDTH) {
            let (dx, dy) = (L::load(&across, lane), L::load(&up, lane));
            let mut slopes = [L::zero(); FUNCTIONS];
            for k in 0..FUNCTIONS {
                slopes[k] = L::splat(gx[k]).mul_add(dx, L::splat(gy[k]) * dy);
            }
            for (plane, &z) in planes.iter_mut().zip(zs) {
                if z < low.z || z > high.z {
                    continue;
                }
                let height = corner[6] + gz[6] * z;
                for tile_row in lowest..=highest {
                    let [from, to] = &mut plane.written[tile_row];
                    (*from, *to) = ((*from).min(first), (*to).max(last + 1));
                    let dy = (tile_row - lowest) as f32 * step_y;
                    let height = height + gy[6] * dy;
                    for column in first..=last {
                        let dx = (column - first) as f32 * step_x;
                        let height = height + gx[6] * dx;
                        if height - rise > band || height + rise < -band {
                            continue;
                        }
                        let mut base = [0.0; FUNCTIONS];
                        for k in 0..FUNCTIONS {
                            base[k] = corner[k] + gz[k] * z + gx[k] * dx + gy[k] * dy;
                        }
                        let f = |k: usize| slopes[k] + L::splat(base[k]);
                        // Beside an edge: the coordinate across it, and how far beyond its ends.
                        let beside = |l: L, s: L, length: L| {
                            let beyond = l - l.min(length).max(L::zero());
                            beyond.mul_add(beyond, s * s)
                        };
                        let (s0, s1, s2) = (f(1), f(3), f(5));
                        let edges = beside(f(0), s0, length0).min(beside(f(2), s1, length1));
                        let edges = edges.min(beside(f(4), s2, length2));
                        let is_beside = s0.min(s1).min(s2).lt(L::zero());
                        let h = f(6);
                        let found = h.mul_add(h, L::select(is_beside, edges, L::zero()));
                        let tile = column + tile_row * plane.tiles[0];
                        let before = L::load(&plane.squared[tile], lane);
                        let nearer = found.lt(before);
                        if L::bits(nearer) != 0 {
                            L::select(nearer, found, before).store(&mut plane.squared[tile], lane);
                            let nearest = L::load(&plane.nearest[tile], lane);
                            L::select(nearer, own, nearest).store(&mut plane.nearest[tile], lane);
                        }
                    }
                }
            }
        }
    }
}
