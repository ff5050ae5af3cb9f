//! The arrays of a field, for copies of it on other devices.

use std::sync::Arc;

use glam::Vec3;

use super::super::sdf::BRICK_NODES;
use super::{BendingField, Body};

/// What the fields of a body have in common in all its poses.
#[derive(Clone, Debug)]
pub struct BendingBody(Arc<Body>);

/// The field of a body in one pose. Bricks are counted from 1, those of the body at rest first.
#[derive(Clone, Copy, Debug)]
pub struct BendingLevel<'a> {
    /// Distances at the coarse nodes, x fastest, metres.
    pub nodes: &'a [f32],
    /// Distances at the nodes of bricks that the body at rest does not have, metres.
    pub bricks: &'a [f32],
    /// For each of these the nearest triangle; `u32::MAX` beyond the band.
    pub nearest: &'a [u32],
    /// Corners of the triangles, metres.
    pub corners: &'a [Vec3],
    starts: &'a [u32],
}

impl BendingLevel<'_> {
    /// For each coarse node the number of the brick of the cell that starts there; 0 without one.
    pub fn brick_numbers(&self) -> impl ExactSizeIterator<Item = u32> {
        let nodes = self.starts.len();
        self.starts.iter().map(move |&start| number_of(start, nodes))
    }
}

impl BendingBody {
    /// Whether `field` is one of this body.
    pub fn is_of(&self, field: &BendingField) -> bool {
        Arc::ptr_eq(&self.0, &field.body)
    }

    /// Distances at the nodes of the bricks of the body at rest, metres.
    pub fn bricks(&self) -> &[f32] {
        let sdf = &self.0.base.sdf;
        &sdf.values()[sdf.starts().len()..]
    }

    /// For each of these the nearest triangle; `u32::MAX` beyond the band.
    pub fn nearest(&self) -> &[u32] {
        &self.0.base.nearest
    }

    /// The corners of each triangle.
    pub fn triangles(&self) -> impl ExactSizeIterator<Item = [u32; 3]> {
        self.0.faces.triangles().map(|(corners, _)| corners)
    }
}

impl BendingField {
    /// What its poses have in common.
    pub fn body(&self) -> BendingBody {
        BendingBody(self.body.clone())
    }

    /// The field at the step's start (`end` = 0) or at its end (1).
    pub fn level(&self, end: usize) -> BendingLevel<'_> {
        let level = &self.ends[end];
        let (nodes, at_rest) = (level.nodes(), self.body.base.sdf.values().len());
        let values = level.sdf.values();
        BendingLevel {
            nodes: &values[..nodes],
            bricks: &values[at_rest..],
            nearest: &level.nearest[at_rest - nodes..],
            corners: &level.corners,
            starts: level.sdf.starts(),
        }
    }

    /// For each cell how far the field falls at most in the step, metres; negative where it is the
    /// same at both ends.
    pub fn falls(&self) -> &[f32] {
        &self.fall
    }
}

/// The number of the brick whose first value is `start`, in a field of so many coarse `nodes`.
fn number_of(start: u32, nodes: usize) -> u32 {
    match (start as usize).checked_sub(nodes) {
        Some(after) => (after / BRICK_NODES) as u32 + 1,
        None => 0,
    }
}
