//! The coarse grid of a field, sets of its nodes, and lists of triangles by its planes.

use std::collections::HashMap;

use glam::{IVec3, UVec3, Vec2, Vec3, Vec3Swizzles};

use super::triangle::Axis;

/// Cells around the balls that hair can reach: the diagonal of a cell, and what queries of lower
/// bounds look beyond a point.
const MARGIN: f32 = 2.5;

/// The coarse grid.
#[derive(Clone, Debug)]
pub(super) struct Grid {
    pub dims: UVec3,
    pub origin: Vec3,
    pub cell: f32,
    /// The nodes that hair can reach.
    pub reached: Bits,
}

impl Grid {
    pub fn axis(&self, axis: usize, refinement: u32) -> Axis {
        let count = (self.dims[axis] - 1) * refinement + 1;
        Axis { first: self.origin[axis], step: self.cell / refinement as f32, count: count as usize }
    }

    pub fn size(&self) -> [usize; 3] {
        self.dims.to_array().map(|n| n as usize)
    }

    /// Finds the nodes of all cells that are in one of the `balls` (centre and radius) or near one.
    pub fn find_reached(&mut self, balls: &[(Vec3, f32)]) {
        let [columns, rows, planes] = self.size();
        self.reached.reset(columns, rows * planes, false);
        // Balls in the same cell are replaced by one around them.
        let mut merged = HashMap::<[i32; 3], f32>::new();
        let cell_of = |p: Vec3| ((p - self.origin) / self.cell).floor();
        let middle = |cell: Vec3| self.origin + (cell + 0.5) * self.cell;
        for (centre, radius) in balls {
            let cell = cell_of(*centre);
            let own = merged.entry(cell.as_ivec3().to_array()).or_default();
            *own = own.max(radius + centre.distance(middle(cell)));
        }
        let axes = [0, 1, 2].map(|axis| self.axis(axis, 1));
        for (cell, radius) in merged {
            let centre = middle(IVec3::from_array(cell).as_vec3());
            let radius = radius + MARGIN * self.cell;
            let Some([_, y, z]) = nodes_near(&axes, &[centre; 3], radius) else { continue };
            for k in z.0..=z.1 {
                for j in y.0..=y.1 {
                    let away = Vec2::new(axes[1].at(j), axes[2].at(k)) - centre.yz();
                    let half = (radius * radius - away.length_squared()).max(0.0).sqrt();
                    if let Some(within) = axes[0].between(centre.x - half, centre.x + half) {
                        self.reached.set(j + rows * k, *within.start(), *within.end());
                    }
                }
            }
        }
    }
}

/// A set of nodes, or of cells, of the coarse grid: a bit each, by rows in x.
#[derive(Clone, Debug, Default)]
pub(super) struct Bits {
    words: Vec<u64>,
    /// Words a row.
    row: usize,
}

impl Bits {
    pub fn reset(&mut self, columns: usize, rows: usize, value: bool) {
        self.row = columns.div_ceil(64);
        self.words.clear();
        self.words.resize(self.row * rows, if value { u64::MAX } else { 0 });
    }

    /// Adds the entries `from` to `to` of a row.
    #[inline(always)]
    pub fn set(&mut self, row: usize, from: usize, to: usize) {
        let words = &mut self.words[row * self.row..(row + 1) * self.row];
        for (word, bits) in words.iter_mut().enumerate().take(to / 64 + 1).skip(from / 64) {
            *bits |= mask(word, from, to);
        }
    }

    /// Whether the row has one of the entries `from` to `to`.
    #[inline(always)]
    pub fn meets(&self, row: usize, from: usize, to: usize) -> bool {
        let words = &self.words[row * self.row..(row + 1) * self.row];
        let within = words.iter().enumerate().take(to / 64 + 1).skip(from / 64);
        within.map(|(word, bits)| bits & mask(word, from, to)).any(|bits| bits != 0)
    }

    pub fn keep_those_of(&mut self, other: &Self) {
        for (own, other) in self.words.iter_mut().zip(&other.words) {
            *own &= other;
        }
    }

    pub fn remove(&mut self, row: usize, entry: usize) {
        self.words[row * self.row + entry / 64] &= !(1 << (entry % 64));
    }

    #[inline(always)]
    pub fn has(&self, row: usize, entry: usize) -> bool {
        self.words[row * self.row + entry / 64] >> (entry % 64) & 1 != 0
    }
}

/// The bits of a word that are among the entries `from` to `to` of its row.
#[inline(always)]
fn mask(word: usize, from: usize, to: usize) -> u64 {
    let low = from.saturating_sub(64 * word).min(63);
    let high = (to - 64 * word).min(63);
    (u64::MAX >> (63 - high)) & (u64::MAX << low)
}

/// Numbers of triangles, by planes or layers.
#[derive(Debug, Default)]
pub(super) struct Bins {
    starts: Vec<u32>,
    items: Vec<u32>,
}

impl Bins {
    /// Sorts items `0..` into `count` bins; each lies in all of a range.
    pub fn fill(&mut self, count: usize, ranges: impl Iterator<Item = Option<(usize, usize)>> + Clone) {
        self.starts.clear();
        self.starts.resize(count + 1, 0);
        for (first, last) in ranges.clone().flatten() {
            for bin in first..=last {
                self.starts[bin + 1] += 1;
            }
        }
        for bin in 0..count {
            self.starts[bin + 1] += self.starts[bin];
        }
        let mut next = self.starts.clone();
        self.items.clear();
        self.items.resize(next[count] as usize, 0);
        for (item, range) in (0u32..).zip(ranges) {
            let Some((first, last)) = range else { continue };
            for place in &mut next[first..=last] {
                self.items[*place as usize] = item;
                *place += 1;
            }
        }
    }

    pub fn of(&self, bin: usize) -> &[u32] {
        &self.items[self.starts[bin] as usize..self.starts[bin + 1] as usize]
    }
}

/// The first and the last node in each axis.
pub(super) type Nodes = [(usize, usize); 3];

/// The nodes within `band` of the box of a triangle.
#[inline(always)]
pub(super) fn nodes_near(axes: &[Axis; 3], [a, b, c]: &[Vec3; 3], band: f32) -> Option<Nodes> {
    let (low, high) = (a.min(*b).min(*c) - band, a.max(*b).max(*c) + band);
    let mut nodes = [(0, 0); 3];
    for axis in 0..3 {
        let within = axes[axis].between(low[axis], high[axis])?;
        nodes[axis] = (*within.start(), *within.end());
    }
    Some(nodes)
}
