//! Particle to grid: splats mass, momentum and volume of the hair segments to the grid.
//!
//! # Theory
//! Each sample s of a segment adds its mass m_s, its momentum m_s u_s and its rest volumes V_s and
//! V_s φ₀, with trilinear weights w, to the eight nearest nodes (McAdams 2009, Sec. 4.1; Zhu and
//! Bridson 2005). The weights sum to one, so mass and momentum are conserved to rounding.
//!
//! # Practice
//! All numbers of a node lie in one register of eight, and all of a sample too, so a sample costs
//! eight loads, products, sums and stores. Samples are sorted by slabs of two layers. The samples
//! of a slab touch three layers, so all even slabs can be splat in parallel, then all odd ones: no
//! two threads write to the same node, and the order of summation does not depend on the number of
//! threads.

use crate::interaction::grid::{Chunk, Grid, Node, SLAB};
use crate::lane::widest;
use rayon::prelude::*;

/// WGSL of the stage.
pub const WGSL: &str = include_str!("kernel.wgsl");

/// Adds all samples to the nodes of an empty grid.
pub fn splat(grid: &mut Grid) {
    let Grid { bounds, chunks, nodes, .. } = grid;
    let chunks = &*chunks;
    let layer = bounds.layer();
    let rows = bounds.stencil_rows();
    for parity in 0..2 {
        let start = SLAB * parity * layer;
        nodes[start..].par_chunks_mut(2 * SLAB * layer).enumerate().for_each(|(k, nodes)| {
            let slab = 2 * k + parity;
            if slab < bounds.slabs() {
                widest(
                    #[inline(always)]
                    || splat_slab(nodes, SLAB * slab * layer, chunks, slab, rows),
                );
            }
        });
    }
}

/// Adds the samples of a slab to its `nodes`, the first of which has the index `base`.
#[inline(always)]
fn splat_slab(nodes: &mut [Node], base: usize, chunks: &[Chunk], slab: usize, rows: [usize; 4]) {
    let beyond = rows[3] + 1;
    for chunk in chunks {
        for sample in chunk.slab(slab) {
            let first = sample.first as usize - base;
            assert!(first + beyond < nodes.len(), "a sample lies in the layers of its slab");
            let [x, y, z] = sample.offset;
            let share = Node(sample.share);
            let (low, high) = (share * (1.0 - x), share * x);
            let weights = [(1.0 - y) * (1.0 - z), y * (1.0 - z), (1.0 - y) * z, y * z];
            for (row, weight) in rows.into_iter().zip(weights) {
                // SAFETY: the last of the nodes is `beyond` the first.
                let pair = unsafe { nodes.get_unchecked_mut(first + row..first + row + 2) };
                pair[0] = pair[0] + low * weight;
                pair[1] = pair[1] + high * weight;
            }
        }
    }
}
