//! Products over a batch that the ways back through networks share.

use crate::network::product::{Factors, PACKET, Rows, Start, TILE_ROWS, product, zero_rows};
use bytemuck::Zeroable;
use forelock_core::lane::{LANES, Row, Simd};
use rayon::prelude::*;

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
    let rows = from.len() / columns;
    for (r, row) in from.chunks_exact(columns).enumerate() {
        for (c, x) in row.iter().enumerate() {
            to[c * rows + r] = *x;
        }
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
    for (row, found) in found.chunks_exact_mut(n).enumerate() {
        for (c, found) in found.iter_mut().enumerate() {
            *found = blocks[c / PACKET][row * TILE_ROWS + c % PACKET / LANES].0[c % LANES];
        }
    }
}
