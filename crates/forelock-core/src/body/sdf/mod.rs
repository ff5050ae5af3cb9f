//! Signed distance fields on a regular grid: what a solid looks like to a strand.
//!
//! # Theory
//! σ(p) is the distance from p to the solid's surface, negative inside. Between the nodes it is trilinear, so that it
//! is continuous and its gradient inside a cell is the exact derivative of the value returned. Outside the grid, with
//! c the nearest point of the grid's box, every point q of the solid has (p − c)·(q − c) ≤ 0, hence
//! |p − q|² ≥ |p − c|² + |c − q|²: the field answers √(|p − c|² + σ(c)²), a lower bound of the truth.
//!
//! # Limitations
//! Features thinner than a cell are seen only where a node falls into them. Trilinear interpolation of an exact
//! distance errs by at most cell²/(8 r) per axis where the surface's radius of curvature is r, and rounds sharp edges
//! by about a third of a cell.

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
    /// Derived from the above, so that a sample need not: 1 / cell, nodes a layer, the last node's index.
    inv_cell: f32,
    layer: u32,
    top: Vec3,
    /// The least value of each block of `BLOCK` cells a side, borders included; blocks along x and y; the last block.
    least: Vec<f32>,
    blocks: [u32; 2],
    top_block: Vec3,
}

/// Cells along the side of a block.
const BLOCK: usize = 2;
/// Why values do not make a field.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SdfError {
    /// Fewer than two nodes along an axis, or more nodes than 32 bits can count.
    #[error("a grid of {} x {} x {} nodes cannot hold a field", .0.x, .0.y, .0.z)]
    Dims(UVec3),
    /// The number of values is not the number of nodes.
    #[error("the grid has {expected} nodes, but {found} values were given")]
    Length {
        /// Nodes of the grid.
        expected: usize,
        /// Values given.
        found: usize,
    },
    /// The cell is not a positive length, or the origin is not finite.
    #[error("the grid needs a finite origin and a positive cell, not {origin} and {cell} m")]
    Frame {
        /// The origin given.
        origin: Vec3,
        /// The cell given.
        cell: f32,
    },
    /// More or fewer nodes than a field is made with, or a padding that is not a length.
    #[error("a field is made with 8 to 1024 nodes and a padding of 0 m or more, not {nodes} and {padding} m")]
    Resolution {
        /// Nodes along the longest axis.
        nodes: u32,
        /// Padding in metres.
        padding: f32,
    },
    /// The mesh encloses nothing.
    #[error("the mesh encloses no volume, so it has no inside")]
    NothingInside,
    /// A value is not finite.
    #[error("value {0} of the field is not finite")]
    NonFinite(usize),
}

impl Sdf {
    /// A field of `values` (metres, x fastest) on `dims` nodes, the first at `origin`, `cell` metres apart.
    ///
    /// # Errors
    /// [`SdfError`] if there are fewer than two nodes along an axis, the values are not one a node, or anything is
    /// not finite.
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

    /// Nodes along x, y and z, each at least 2.
    pub fn dims(&self) -> UVec3 {
        self.dims
    }

    /// The first node, in metres.
    pub fn origin(&self) -> Vec3 {
        self.origin
    }

    /// Distance between neighbouring nodes, in metres.
    pub fn cell(&self) -> f32 {
        self.cell
    }

    /// Signed distances in metres, one a node, x fastest.
    pub fn values(&self) -> &[f32] {
        &self.values
    }

    /// The box of nodes: (first, last) in metres.
    pub fn bounds(&self) -> (Vec3, Vec3) {
        (self.origin, self.origin + self.top * self.cell)
    }
}

/// The least value of each block, x fastest, and how many blocks there are.
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

/// Nodes of a grid of `dims`, if it has at least two along each axis and memory can index them.
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
    fn fields_that_cannot_be_are_refused() {
        let new = |dims: [u32; 3], cell, values| Sdf::new(dims.into(), Vec3::ZERO, cell, values);
        assert!(matches!(new([1, 8, 1], 1.0, vec![0.0; 8]), Err(SdfError::Dims(_))));
        assert!(matches!(new([u32::MAX; 3], 1.0, vec![]), Err(SdfError::Dims(_))));
        assert!(matches!(new([2; 3], 1.0, vec![0.0; 7]), Err(SdfError::Length { .. })));
        assert!(matches!(new([2; 3], 0.0, vec![0.0; 8]), Err(SdfError::Frame { .. })));
        assert!(matches!(new([2; 3], 1.0, vec![f32::NAN; 8]), Err(SdfError::NonFinite(0))));
    }
}
