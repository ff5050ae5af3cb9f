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
//! # Limitations
//! Features thinner than a cell are represented only if a node lies inside them. The error of
//! trilinear interpolation of an exact distance is at most cell²/(8 r) per axis where the surface's
//! radius of curvature is r; sharp edges are rounded by about a third of a cell.

mod build;
mod bytes;
mod sample;

use glam::{UVec3, Vec3};

pub use bytes::SdfBytesError;

/// Signed distances in metres on the nodes of a regular grid, negative inside; x varies fastest.
#[derive(Clone, Debug, PartialEq)]
pub struct Sdf {
    dims: UVec3,
    origin: Vec3,
    cell: f32,
    values: Vec<f32>,
    /// Precomputed from the fields above: 1 / cell, number of nodes in a layer, index of the last
    /// node.
    inv_cell: f32,
    layer: u32,
    top: Vec3,
    /// The smallest value of each block of `BLOCK` cells a side, borders included; the number of
    /// blocks along x and y; the last block.
    least: Vec<f32>,
    blocks: [u32; 2],
    top_block: Vec3,
}

/// Cells along the side of a block.
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
        let expected = node_count(dims).ok_or(SdfError::Dims(dims))?;
        if !(origin.is_finite() && cell > 0.0 && cell.is_finite() && (1.0 / cell).is_finite()) {
            return Err(SdfError::Frame { origin, cell });
        }
        if values.len() != expected {
            return Err(SdfError::Length { expected, found: values.len() });
        }
        if let Some(node) = values.iter().position(|v| !v.is_finite()) {
            return Err(SdfError::NonFinite(node));
        }
        let (least, blocks) = block_minima(dims, &values);
        Ok(Self {
            dims,
            origin,
            cell,
            values,
            inv_cell: 1.0 / cell,
            layer: dims.x * dims.y,
            top: (dims - 1).as_vec3(),
            least,
            blocks: [blocks.x, blocks.y],
            top_block: (blocks - 1).as_vec3(),
        })
    }

    /// Number of nodes along x, y and z, each at least 2.
    pub fn dims(&self) -> UVec3 {
        self.dims
    }

    /// Position of the first node, in metres.
    pub fn origin(&self) -> Vec3 {
        self.origin
    }

    /// Distance between neighbouring nodes, in metres.
    pub fn cell(&self) -> f32 {
        self.cell
    }

    /// Signed distances in metres, one for each node, x fastest.
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// The box of the nodes: (first, last) in metres.
    pub fn bounds(&self) -> (Vec3, Vec3) {
        (self.origin, self.origin + self.top * self.cell)
    }
}

/// The smallest value of each block, x fastest, and the number of blocks along each axis.
fn block_minima(dims: UVec3, values: &[f32]) -> (Vec<f32>, UVec3) {
    let [width, height, depth] = dims.to_array().map(|n| n as usize);
    let blocks = [width, height, depth].map(|n| (n - 1).div_ceil(BLOCK));
    let mut least = Vec::with_capacity(blocks.iter().product());
    let nodes = |block: usize, end: usize| block * BLOCK..(block * BLOCK + BLOCK + 1).min(end);
    for c in 0..blocks[2] {
        for b in 0..blocks[1] {
            for a in 0..blocks[0] {
                let rows =
                    nodes(c, depth).flat_map(|k| nodes(b, height).map(move |j| width * (j + height * k)));
                let value = |row: usize| nodes(a, width).map(move |i| values[row + i]);
                least.push(rows.flat_map(value).fold(f32::INFINITY, f32::min));
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
