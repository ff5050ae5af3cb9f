//! The values of a brick's nodes.

use glam::Vec3;

use super::super::sdf::{BRICK_NODES, REFINEMENT};

/// Nodes along a side of a brick.
pub(super) const SIDE: usize = REFINEMENT as usize + 1;
/// [`BRICK_NODES`], padded.
const PADDED: usize = 128;

/// Distances of a brick's nodes from the corners of its cell, metres.
pub(super) struct Apart([[f32; PADDED]; 8]);

impl Apart {
    pub fn new(cell: f32) -> Self {
        let step = cell / REFINEMENT as f32;
        let mut apart = [[0.0; PADDED]; 8];
        for (corner, apart) in apart.iter_mut().enumerate() {
            let place = [corner & 1, corner >> 1 & 1, corner >> 2].map(|at| at as f32 * cell);
            for (node, apart) in apart.iter_mut().enumerate().take(BRICK_NODES) {
                let node = [node % SIDE, node / SIDE % SIDE, node / (SIDE * SIDE)].map(|at| at as f32 * step);
                *apart = Vec3::from_array(node).distance(Vec3::from_array(place));
            }
        }
        Self(apart)
    }
}

/// A brick's nodes: squared distances, then values; and winding numbers.
pub(super) struct Brick {
    pub squared: [f32; PADDED],
    /// Numbers of the nearest triangles.
    pub nearest: [f32; PADDED],
    pub winding: [i32; PADDED],
}

impl Brick {
    #[inline(always)]
    pub fn new() -> Self {
        Self { squared: [0.0; PADDED], nearest: [0.0; PADDED], winding: [0; PADDED] }
    }

    /// Replaces squared distances by values, and returns the smallest. `corners` are the values at
    /// the cell's corners.
    #[inline(always)]
    pub fn finish(&mut self, corners: &[f32], Apart(apart): &Apart, band: f32) -> f32 {
        let (mut low, mut high) = ([f32::NEG_INFINITY; PADDED], [f32::INFINITY; PADDED]);
        for (value, apart) in corners.iter().zip(apart) {
            for node in 0..PADDED {
                let (a, b) = (value - apart[node], value + apart[node]);
                low[node] = if a > low[node] { a } else { low[node] };
                high[node] = if b < high[node] { b } else { high[node] };
            }
        }
        let mut smallest = [f32::INFINITY; PADDED];
        for node in 0..PADDED {
            let squared = self.squared[node];
            let distance = squared.sqrt();
            let beyond = squared >= band * band;
            let outside = if beyond && low[node] > band { low[node] } else { distance };
            let inside = if beyond && high[node] < -band { high[node] } else { -distance };
            let value = if self.winding[node] > 0 { inside } else { outside };
            self.squared[node] = value;
            smallest[node] = if node < BRICK_NODES { value } else { f32::INFINITY };
        }
        let mut least = [f32::INFINITY; 8];
        for values in smallest.as_chunks::<8>().0 {
            for (least, value) in least.iter_mut().zip(values) {
                *least = if value < least { *value } else { *least };
            }
        }
        least.into_iter().fold(f32::INFINITY, f32::min)
    }
}
