//! Products over a batch that the ways back through networks share.

use crate::network::product::{Factors, PACKET, Rows, Start, TILE_ROWS, product, zero_rows};
use bytemuck::Zeroable;
use forelock_core::lane::{LANES, Row, Simd};
use rayon::prelude::*;
use std::ops::Range;

/// Minimum number of rows of a product that a task copies.
const ROWS: usize = 64;

/// Zero where the activation is: the gradient of ReLU.
pub(crate) fn mask(activations: &[f32], by: &mut [f32]) {
    for (x, by) in activations.iter().zip(by) {
        *by = if *x > 0.0 { *by } else { 0.0 };
    }
}

/// The same for rows of strands.
pub(crate) fn mask_rows(activations: &[Row<f32>], by: &mut [Row<f32>]) {
    mask(bytemuck::cast_slice(activations), bytemuck::cast_slice_mut(by));
}

/// `[rows, columns]` to `[columns, rows]`.
pub(crate) fn transpose(from: &[f32], columns: usize, to: &mut [f32]) {
    // So many rows at a time: their numbers fill whole cache lines of `to`.
    const TOGETHER: usize = 16;
    let rows = from.len() / columns;
    for first in (0..rows).step_by(TOGETHER) {
        let last = rows.min(first + TOGETHER);
        for (c, to) in to.chunks_exact_mut(rows).enumerate() {
            for (r, to) in (first..last).zip(&mut to[first..last]) {
                *to = from[r * columns + c];
            }
        }
    }
}

/// The parts of `whole` at `ranges`, which are inside and do not overlap.
pub(crate) fn parts<const N: usize>(whole: &mut [f32], ranges: [Range<usize>; N]) -> [&mut [f32]; N] {
    match whole.get_disjoint_mut(ranges) {
        Ok(parts) => parts,
        Err(error) => unreachable!("ranges of a network: {error}"),
    }
}

/// Sums over all strands of parts `[strands, units]`.
pub(crate) fn bias_gradient(parts: &[&[f32]], sums: &mut [f32]) {
    sums.fill(0.0);
    let units = sums.len();
    for row in parts.iter().flat_map(|part| part.chunks_exact(units)) {
        sums.iter_mut().zip(row).for_each(|(sum, x)| *sum += x);
    }
}

/// AᵀB of factors in parts, `[strands, m]` and `[strands, n]`: `[m, n]`, the gradient of a layer's
/// weights from its inputs and from the gradient with respect to its sums.
pub(crate) fn weight_gradient(simd: Simd, [a, b]: [&[&[f32]]; 2], [m, n]: [usize; 2], found: &mut [f32]) {
    let a: Vec<f32> = a.concat();
    let blocks: Vec<Rows> = (0..n.div_ceil(PACKET))
        .into_par_iter()
        .map(|block| {
            let columns = block * PACKET..n.min((block + 1) * PACKET);
            let mut rows = Vec::with_capacity(a.len() / m * TILE_ROWS);
            for strand in b.iter().flat_map(|part| part.chunks_exact(n)) {
                let mut packed = [Row::zeroed(); TILE_ROWS];
                for (c, x) in strand[columns.clone()].iter().enumerate() {
                    packed[c / LANES].0[c % LANES] = *x;
                }
                rows.extend(packed);
            }
            let mut c = zero_rows(m);
            product(simd, Factors { a: &a, columns: m, b: &rows }, Start::Zero, &mut c);
            c
        })
        .collect();
    found.par_chunks_exact_mut(n).with_min_len(ROWS).enumerate().for_each(|(row, found)| {
        for (block, found) in blocks.iter().zip(found.chunks_mut(PACKET)) {
            let from: &[f32] = bytemuck::cast_slice(&block[row * TILE_ROWS..(row + 1) * TILE_ROWS]);
            found.copy_from_slice(&from[..found.len()]);
        }
    });
}
