//! Products over a batch that the ways back through networks share.

use crate::network::product::{Factors, PACKET, Rows, Start, TILE_ROWS, product_of_columns, zero_rows};
use forelock_core::lane::{Row, Simd};
use rayon::prelude::*;
use std::ops::Range;

/// Strands that a product sums before the next tile: their numbers stay in the second-level cache.
const DEPTH: usize = 64;
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
/// weights from its inputs and from the gradient with respect to its sums. Each number is summed in
/// the order of the strands.
///
/// # Panics
/// If the parts do not agree in their number and strands.
pub(crate) fn weight_gradient(simd: Simd, [a, b]: [&[&[f32]]; 2], [m, n]: [usize; 2], found: &mut [f32]) {
    let [of_a, of_b] =
        [(a, m), (b, n)].map(|(parts, units)| parts.iter().map(move |part| part.len() / units));
    assert!(of_a.eq(of_b), "parts of the factors");
    let blocks: Vec<Rows> = (0..n.div_ceil(PACKET))
        .into_par_iter()
        .map(|block| {
            let columns = block * PACKET..n.min((block + 1) * PACKET);
            let used = columns.len();
            let (mut packed, mut c) = (zero_rows(DEPTH), zero_rows(m));
            for (a, b) in a.iter().zip(b) {
                for (a, b) in a.chunks(DEPTH * m).zip(b.chunks(DEPTH * n)) {
                    for (packed, strand) in packed.chunks_exact_mut(TILE_ROWS).zip(b.chunks_exact(n)) {
                        let packed: &mut [f32] = bytemuck::cast_slice_mut(packed);
                        packed[..used].copy_from_slice(&strand[columns.clone()]);
                    }
                    let b = &packed[..b.len() / n * TILE_ROWS];
                    product_of_columns(simd, Factors { a, columns: m, b }, used, Start::Sums, &mut c);
                }
            }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    /// Of several parts, of more strands than are summed together, of columns that do not fill a
    /// block.
    #[test]
    fn a_weight_gradient_is_the_sum_over_the_strands_of_all_parts() {
        let mut random = Random::new(5);
        let on_each =
            |sizes| Simd::ALL.iter().filter(|simd| simd.is_supported()).map(move |simd| (sizes, *simd));
        for ([m, n], simd) in [[1, 1], [7, 9], [13, 64], [66, 72], [66, 100]].into_iter().flat_map(on_each) {
            let strands = [3, 64, 2 * DEPTH + 5];
            let mut numbers =
                |of: usize| strands.map(|s| (0..s * of).map(|_| random.signed() as f32).collect());
            let (a, b): ([Vec<f32>; 3], [Vec<f32>; 3]) = (numbers(m), numbers(n));
            let of = |a: &[&[f32]], b: &[&[f32]]| {
                let mut found = vec![f32::NAN; m * n];
                weight_gradient(simd, [a, b], [m, n], &mut found);
                found
            };
            let [slices_a, slices_b] = [&a, &b].map(|parts| parts.each_ref().map(Vec::as_slice));
            let found = of(&slices_a, &slices_b);
            let (a, b) = (a.concat(), b.concat());
            // To the bit: the order does not depend on the parts.
            assert_eq!(found, of(&[&a], &[&b]));
            for (k, found) in found.iter().enumerate() {
                let (i, j) = (k / n, k % n);
                let rows = a.chunks_exact(m).zip(b.chunks_exact(n));
                let expected: f64 = rows.map(|(a, b)| f64::from(a[i]) * f64::from(b[j])).sum();
                assert!(
                    (f64::from(*found) - expected).abs() < 1e-4,
                    "{simd:?} {m} {n} {k}: {found} {expected}"
                );
            }
        }
    }
}
