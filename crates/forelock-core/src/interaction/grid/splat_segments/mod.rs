//! Particle to grid: splats mass, momentum and volume of the hair segments to the grid.
//!
//! # Theory
//! Each sample s of a segment adds its mass m_s, its momentum m_s u_s and its rest volumes V_s and
//! V_s φ₀, with trilinear weights w, to the eight nearest nodes (McAdams 2009, Sec. 4.1; Zhu and
//! Bridson 2005). The weights sum to one, so mass and momentum are conserved to rounding.
//!
//! # Practice
//! All numbers of a node lie in one register of eight, and all of a sample too, so a sample costs
//! eight loads, products, sums and stores. Samples are not sorted: neighbouring strands lie side by
//! side in memory, so their nodes stay in the second-level cache.
//!
//! A number of patches that does not depend on the number of threads divides the strands. Each has
//! nodes of its own around its hair, and marks the clusters of four nodes that it touches. Then
//! the nodes of marked clusters are summed over the patches, layer by layer and always in the same
//! order. Others are neither cleared nor summed.

use crate::interaction::grid::{Bounds, Grid, GridFrame, NOWHERE, Node, STRIP, Segments, join};
use crate::lane::{Real, Row, widest};
use crate::scratch::{fill, resize};
use crate::strands::Model;
use rayon::prelude::*;

/// WGSL of the stage.
pub const WGSL: &str = include_str!("kernel.wgsl");

/// Fits the box to hair with positions and velocities `rows`, and splats it. Returns the box.
pub(crate) fn splat<T: Real>(
    grid: &mut Grid,
    model: &Model<T>,
    rows: [&[Row<T>]; 2],
    frame: &GridFrame,
) -> Bounds {
    let Grid { params, cell, volumes, patches, bounds, nodes, marks, .. } = grid;
    let [positions, velocities] = rows;
    patches.par_iter_mut().for_each(|patch| patch.measure(model, positions, frame));
    let extent = patches.iter().map(|patch| patch.extent).fold(NOWHERE, join);
    // Zero if no coordinate is finite.
    let extent = extent.map(|ends| ends.map(|x| if x.is_finite() { x } else { 0.0 }));
    *bounds = Bounds::around(extent, *cell, params.max_cells as usize);
    let most = patches.iter_mut().map(|patch| patch.place(bounds, *cell)).max().unwrap_or(0);
    patches.iter_mut().for_each(|patch| patch.reserve(most));
    let hair = Segments { model, positions, velocities, volumes };
    patches.par_iter_mut().for_each(|patch| patch.splat(&hair, frame, bounds, *cell));
    resize(nodes, bounds.cells(), Node::default());
    fill(marks, bounds.layer_strips() * bounds.dims[2], 0);
    let layer = bounds.layer_strips();
    let layers = nodes.par_chunks_mut(STRIP * layer).zip(marks.par_chunks_mut(layer)).enumerate();
    layers.for_each(|(k, (nodes, marks))| {
        for patch in &*patches {
            widest(
                #[inline(always)]
                || patch.add_layer(k, bounds, nodes, marks),
            );
        }
    });
    *bounds
}
