//! Where the bricks of a refined field are.

use glam::UVec3;

use super::{SdfError, node_count};

/// Cells of a brick along an axis.
pub const REFINEMENT: u32 = 4;
/// Nodes of a brick; those on its faces belong to neighbouring bricks too.
pub const BRICK_NODES: usize = (BRICK_LAYER * BRICK_ROW) as usize;
/// Values from one row of a brick's nodes to the next, and from one layer to the next.
pub(super) const BRICK_ROW: u32 = REFINEMENT + 1;
pub(super) const BRICK_LAYER: u32 = BRICK_ROW * BRICK_ROW;
/// The entry of a cell without a brick. No brick starts at the first value.
pub(in crate::body) const NONE: u32 = 0;

/// The table of bricks: the index of each brick's first value.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Bricks {
    /// One entry for each node, that of the cell which starts there; empty without bricks.
    starts: Vec<u32>,
}

impl Bricks {
    /// The table of a grid of `dims` nodes, of which the cells in `refined` have bricks, one after
    /// the other behind the values of the nodes.
    pub fn new(dims: UVec3, refined: &[u32]) -> Result<Self, SdfError> {
        if refined.is_empty() {
            return Ok(Self::default());
        }
        let nodes = node_count(dims).ok_or(SdfError::Dims(dims))?;
        let mut starts = vec![NONE; nodes];
        let is_cell = |cell: u32| {
            let layer = dims.x * dims.y;
            let at = UVec3::new(cell % dims.x, cell % layer / dims.x, cell / layer);
            at.cmplt(dims - 1).all()
        };
        let mut start = nodes;
        let mut before = None;
        for &cell in refined {
            if !is_cell(cell) || before >= Some(cell) {
                return Err(SdfError::Brick(cell));
            }
            before = Some(cell);
            starts[cell as usize] = u32::try_from(start).map_err(|_| SdfError::Dims(dims))?;
            start += BRICK_NODES;
        }
        Ok(Self { starts })
    }

    /// A table for `nodes` nodes without bricks, to be written.
    pub fn blank(nodes: usize) -> Self {
        Self { starts: vec![NONE; nodes] }
    }

    pub fn starts(&self) -> &[u32] {
        &self.starts
    }

    pub fn starts_mut(&mut self) -> &mut [u32] {
        &mut self.starts
    }

    #[inline(always)]
    pub fn is_empty(&self) -> bool {
        self.starts.is_empty()
    }

    /// The first value of the brick of `cell`, if it has one.
    #[inline(always)]
    pub fn start(&self, cell: usize) -> Option<usize> {
        self.starts.get(cell).filter(|start| **start != NONE).map(|start| *start as usize)
    }

    /// The same, [`NONE`] if it has none.
    #[inline(always)]
    pub fn start_or_none(&self, cell: u32) -> u32 {
        self.starts[cell as usize]
    }

    /// The number of each cell's brick, from 1; 0 without one.
    pub fn numbers(&self) -> impl ExactSizeIterator<Item = u32> {
        let nodes = self.starts.len() as u32;
        let number = move |start: &u32| {
            if *start == NONE { 0 } else { (start - nodes) / BRICK_NODES as u32 + 1 }
        };
        self.starts.iter().map(number)
    }

    /// The cells that have bricks, in the order of their bricks.
    pub fn cells(&self) -> impl Iterator<Item = u32> {
        (0u32..).zip(&self.starts).filter(|(_, start)| **start != NONE).map(|(cell, _)| cell)
    }

    pub fn bytes(&self) -> usize {
        size_of_val(&self.starts[..])
    }
}
