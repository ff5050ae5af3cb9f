//! Signed distance fields (SDFs) on a regular grid.
//!
//! # Theory
//! σ(p) is the distance from p to the solid's surface, negative inside. It is interpolated
//! trilinearly between the nodes, so it is continuous, and its gradient inside a cell is the exact
//! derivative of the returned value. Outside the grid, let c be the nearest point of the grid's
//! box. Every point q of the solid satisfies (p − c)·(q − c) ≤ 0, hence
//! |p − q|² ≥ |p − c|² + |c − q|²: the field returns √(|p − c|² + σ(c)²), a lower bound of the true
//! distance.
//!
//! A refined field has two levels. Cells that the surface passes through or comes near are divided
//! into [`REFINEMENT`]³ smaller ones, whose nodes, a *brick*, store exact distances too. A cell
//! without a brick is at least 0.6 cells outside or a quarter of a cell inside everywhere, so its
//! coarse interpolation has the right sign. The value may jump at the border between both levels,
//! by the coarse level's error there. For a clearance σ/√3 this is harmless: outside, an exact
//! distance has at a distance σ two curvatures of at most 1/σ, so the interpolation is at most
//! cell²/(4 σ) too large, which is less than (√3 − 1) σ for σ ≥ 0.6 cells.
//!
//! # Practice
//! Bricks follow the values of the coarse nodes in one array, and a table with one entry for each
//! coarse cell locates them. A head (0.2 m² of skin) with cells of 2 mm has about a million values,
//! a whole body ten million.
//!
//! # Limitations
//! Features thinner than a cell (near the surface: a cell of a brick) are represented only if a
//! node lies inside them. The error of trilinear interpolation of an exact distance is at most
//! cell²/(8 r) per axis where the surface's radius of curvature is r; sharp edges are rounded by
//! about a third of a cell.

mod bricks;
mod build;
mod bytes;
mod sample;

use glam::{UVec3, Vec3};

use bricks::Bricks;
pub(super) use bricks::NONE as NO_BRICK;
pub use bricks::{BRICK_NODES, REFINEMENT};
pub use bytes::SdfBytesError;

/// Signed distances in metres on the nodes of a regular grid, negative inside; x varies fastest.
#[derive(Clone, Debug, PartialEq)]
pub struct Sdf {
    dims: UVec3,
    origin: Vec3,
    cell: f32,
    /// See [`Sdf::thinness`].
    thinness: f32,
    /// The coarse nodes' values, then those of the bricks.
    values: Vec<f32>,
    /// Where each cell's brick is; empty if the field is not refined.
    bricks: Bricks,
    /// Precomputed from the fields above: 1 / cell, number of nodes in a layer, index of the last
    /// node.
    inv_cell: f32,
    layer: u32,
    top: Vec3,
    /// The smallest value of each block of cells, borders and bricks included; the number of blocks
    /// along x and y; the last block; blocks per metre.
    least: Vec<f32>,
    blocks: [u32; 2],
    top_block: Vec3,
    per_block: f32,
}

/// The arrays of a field whose values change.
pub(super) struct PartsMut<'a> {
    /// See [`Sdf::values`].
    pub values: &'a mut Vec<f32>,
    /// See [`Sdf::starts`].
    pub starts: &'a mut [u32],
    /// See [`Sdf::least`].
    pub least: &'a mut [f32],
}

/// Cells along the side of a block; blocks of a refined field are single cells.
const BLOCK: usize = 2;

/// Why values do not form a field.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SdfError {
    /// There are fewer than two nodes along an axis, or more nodes than 32 bits can index.
    #[error("a grid of {} x {} x {} nodes cannot hold a distance field", .0.x, .0.y, .0.z)]
    Dims(UVec3),
    /// The number of values differs from the number of nodes.
    #[error("the grid has {expected} nodes, but {found} values were given")]
    Length {
        /// Nodes of the grid.
        expected: usize,
        /// Values given.
        found: usize,
    },
    /// The cell is not a positive length, or the origin is not finite.
    #[error("the grid needs a finite origin and a positive cell size, not {origin} and {cell} m")]
    Frame {
        /// The origin given.
        origin: Vec3,
        /// The cell given.
        cell: f32,
    },
    /// The number of nodes is out of range, or the padding is negative or not finite.
    #[error(
        "a distance field needs 8 to 1024 nodes and a padding of 0 m or more, \
         not {nodes} nodes and {padding} m"
    )]
    Resolution {
        /// Nodes along the longest axis.
        nodes: u32,
        /// Padding in metres.
        padding: f32,
    },
    /// The mesh encloses no volume.
    #[error("the mesh encloses no volume, so it has no inside")]
    NothingInside,
    /// This entry of the list of refined cells is no cell of the grid, or not in rising order.
    #[error("{0} in the list of refined cells is no cell of the grid, or is not in rising order")]
    Brick(u32),
    /// The value of this index is not finite.
    #[error("value {0} of the distance field is not finite")]
    NonFinite(usize),
}

impl Sdf {
    /// Creates a field of `values` (metres, x fastest) on `dims` nodes, `cell` metres apart, the
    /// first at `origin`.
    ///
    /// # Errors
    /// [`SdfError`] if there are fewer than two nodes along an axis, the number of values is not
    /// the number of nodes, the cell is not positive, or a number is not finite.
    pub fn new(dims: UVec3, origin: Vec3, cell: f32, values: Vec<f32>) -> Result<Self, SdfError> {
        Self::with_bricks(dims, origin, cell, cell, values, &[])
    }

    /// The same with bricks: `refined` lists the cells that have one (the index of a cell is that
    /// of its first node) in rising order, and their nodes follow the coarse ones in `values`.
    fn with_bricks(
        dims: UVec3,
        origin: Vec3,
        cell: f32,
        thinness: f32,
        values: Vec<f32>,
        refined: &[u32],
    ) -> Result<Self, SdfError> {
        let nodes = node_count(dims).ok_or(SdfError::Dims(dims))?;
        let expected = nodes.saturating_add(refined.len().saturating_mul(BRICK_NODES));
        if u32::try_from(expected).is_err() {
            return Err(SdfError::Dims(dims));
        }
        if !(origin.is_finite()
            && cell > 0.0
            && cell.is_finite()
            && (1.0 / cell).is_finite()
            && thinness > 0.0
            && thinness.is_finite())
        {
            return Err(SdfError::Frame { origin, cell });
        }
        if values.len() != expected {
            return Err(SdfError::Length { expected, found: values.len() });
        }
        if let Some(node) = values.iter().position(|v| !v.is_finite()) {
            return Err(SdfError::NonFinite(node));
        }
        let bricks = Bricks::new(dims, refined)?;
        let block = if refined.is_empty() { BLOCK } else { 1 };
        let (least, blocks) = block_minima(dims, &values, block, &bricks);
        Ok(Self {
            dims,
            origin,
            cell,
            thinness,
            values,
            bricks,
            inv_cell: 1.0 / cell,
            layer: dims.x * dims.y,
            top: (dims - 1).as_vec3(),
            least,
            blocks: [blocks.x, blocks.y],
            top_block: (blocks - 1).as_vec3(),
            per_block: 1.0 / cell * (1.0 / block as f32),
        })
    }

    /// A refined field whose values are to be written ([`Sdf::parts_mut`]): 0 at all nodes, and no
    /// bricks. `None` if there are fewer than two nodes along an axis or too many to index.
    pub(super) fn blank(dims: UVec3, origin: Vec3, cell: f32, thinness: f32) -> Option<Self> {
        let nodes = node_count(dims)?;
        let cells = dims - 1;
        Some(Self {
            dims,
            origin,
            cell,
            thinness,
            values: vec![0.0; nodes],
            bricks: Bricks::blank(nodes),
            inv_cell: 1.0 / cell,
            layer: dims.x * dims.y,
            top: cells.as_vec3(),
            least: vec![0.0; cells.element_product() as usize],
            blocks: [cells.x, cells.y],
            top_block: (cells - 1).as_vec3(),
            per_block: 1.0 / cell,
        })
    }

    /// The arrays of a refined field.
    pub(super) fn parts_mut(&mut self) -> PartsMut<'_> {
        PartsMut { values: &mut self.values, starts: self.bricks.starts_mut(), least: &mut self.least }
    }

    /// The value of each cell's brick, [`NO_BRICK`] without one; one entry for each node.
    pub(super) fn starts(&self) -> &[u32] {
        self.bricks.starts()
    }

    /// The smallest value of each block of cells.
    pub(super) fn least(&self) -> &[f32] {
        &self.least
    }

    /// The number of the block of cells that holds `p`, or of the nearest one.
    #[inline(always)]
    pub(super) fn block_of(&self, p: Vec3) -> usize {
        let at = (p - self.origin) * self.per_block;
        let [i, j, k] = at.clamp(Vec3::ZERO, self.top_block).to_array().map(|c| c as usize);
        i + self.blocks[0] as usize * (j + self.blocks[1] as usize * k)
    }

    /// The value of the node nearest to `p` of the brick in which `p` is; `None` where there is
    /// none.
    pub(super) fn nearest_in_brick(&self, p: Vec3) -> Option<usize> {
        let at = (p - self.origin) * self.inv_cell;
        let cell = at.clamp(Vec3::ZERO, self.top - 1.0).floor();
        let [i, j, k] = cell.to_array().map(|c| c as u32);
        let start = self.bricks.start((i + self.dims.x * j + self.layer * k) as usize)?;
        let node =
            ((at - cell) * REFINEMENT as f32).round().clamp(Vec3::ZERO, Vec3::splat(REFINEMENT as f32));
        let [i, j, k] = node.to_array().map(|c| c as usize);
        Some(start + i + (REFINEMENT as usize + 1) * (j + (REFINEMENT as usize + 1) * k))
    }

    /// Number of nodes along x, y and z, each at least 2.
    pub fn dims(&self) -> UVec3 {
        self.dims
    }

    /// Position of the first node, in metres.
    pub fn origin(&self) -> Vec3 {
        self.origin
    }

    /// Distance between neighbouring nodes, in metres; those of bricks are nearer.
    pub fn cell(&self) -> f32 {
        self.cell
    }

    /// Distance in metres between neighbouring nodes near the surface.
    pub fn near_cell(&self) -> f32 {
        if self.is_refined() { self.cell / REFINEMENT as f32 } else { self.cell }
    }

    /// Half the thickness in metres that the solid's thinnest part is assumed to have: what moves
    /// less is not swept. A cell, of a refined field a cell of the uniform field of the same body,
    /// so that cells near the surface can be small without more sweeps.
    pub fn thinness(&self) -> f32 {
        self.thinness
    }

    /// Upper bound in metres of the difference between a sample near the surface and the exact
    /// distance, if the values at the nodes are exact: a distance is 1-Lipschitz, and the mean
    /// distance to the corners of a cell, with the weights of the interpolation, is at most half
    /// its diagonal.
    pub fn error_bound(&self) -> f32 {
        self.near_cell() * (0.75f32.sqrt() * (1.0 + 1e-3))
    }

    /// Whether some cells have bricks.
    pub fn is_refined(&self) -> bool {
        !self.bricks.is_empty()
    }

    /// Signed distances in metres: one for each node, x fastest, then [`BRICK_NODES`] for each
    /// brick, in the same order.
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// For each node of a refined field, the number of the brick of the cell that starts there,
    /// counted from 1; 0 where there is none. Empty if no cell has one.
    pub fn brick_numbers(&self) -> impl ExactSizeIterator<Item = u32> {
        self.bricks.numbers()
    }

    /// The position of the first node of each brick in metres, and the values of its nodes.
    pub fn bricks(&self) -> impl Iterator<Item = (Vec3, &[f32])> + Send {
        let nodes = (self.layer * self.dims.z) as usize;
        self.bricks.cells().zip(self.values[nodes..].chunks_exact(BRICK_NODES)).map(|(cell, values)| {
            let at = UVec3::new(cell % self.dims.x, cell % self.layer / self.dims.x, cell / self.layer);
            (self.origin + at.as_vec3() * self.cell, values)
        })
    }

    /// The position in metres of a brick's node, relative to its first one.
    pub fn brick_node(&self, node: u32) -> Vec3 {
        let row = REFINEMENT + 1;
        let at = UVec3::new(node % row, node / row % row, node / (row * row));
        at.as_vec3() * (self.cell / REFINEMENT as f32)
    }

    /// Bytes of the field and its tables in memory.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.values[..]) + size_of_val(&self.least[..]) + self.bricks.bytes()
    }

    /// The box of the nodes: (first, last) in metres.
    pub fn bounds(&self) -> (Vec3, Vec3) {
        (self.origin, self.origin + self.top * self.cell)
    }
}

/// The smallest value of each block of `block` cells a side, x fastest, and the number of blocks
/// along each axis.
fn block_minima(dims: UVec3, values: &[f32], block: usize, bricks: &Bricks) -> (Vec<f32>, UVec3) {
    let [width, height, depth] = dims.to_array().map(|n| n as usize);
    let blocks = [width, height, depth].map(|n| (n - 1).div_ceil(block));
    let mut least = Vec::with_capacity(blocks.iter().product());
    let nodes = |number: usize, end: usize| number * block..(number * block + block + 1).min(end);
    for c in 0..blocks[2] {
        for b in 0..blocks[1] {
            for a in 0..blocks[0] {
                let rows =
                    nodes(c, depth).flat_map(|k| nodes(b, height).map(move |j| width * (j + height * k)));
                let value = |row: usize| nodes(a, width).map(move |i| values[row + i]);
                let coarse = rows.flat_map(value).fold(f32::INFINITY, f32::min);
                let brick = bricks.start(a + width * (b + height * c));
                let fine = brick.map_or(&[][..], |start| &values[start..start + BRICK_NODES]);
                least.push(fine.iter().copied().fold(coarse, f32::min));
            }
        }
    }
    (least, UVec3::from_array(blocks.map(|n| n as u32)))
}

/// The number of nodes of a grid of `dims`; `None` if it has fewer than two along an axis or too
/// many to index.
fn node_count(dims: UVec3) -> Option<usize> {
    if dims.min_element() < 2 {
        return None;
    }
    let nodes = u64::from(dims.x).checked_mul(u64::from(dims.y))?.checked_mul(u64::from(dims.z))?;
    usize::try_from(nodes).ok().filter(|&nodes| nodes <= u32::MAX as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn invalid_fields_are_refused() {
        let new = |dims: [u32; 3], cell, values| Sdf::new(dims.into(), Vec3::ZERO, cell, values);
        assert!(matches!(new([1, 8, 1], 1.0, vec![0.0; 8]), Err(SdfError::Dims(_))));
        assert!(matches!(new([u32::MAX; 3], 1.0, vec![]), Err(SdfError::Dims(_))));
        assert!(matches!(new([2; 3], 1.0, vec![0.0; 7]), Err(SdfError::Length { .. })));
        assert!(matches!(new([2; 3], 0.0, vec![0.0; 8]), Err(SdfError::Frame { .. })));
        assert!(matches!(new([2; 3], 1.0, vec![f32::NAN; 8]), Err(SdfError::NonFinite(0))));
    }
}
