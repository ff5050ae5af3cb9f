//! Products over a batch that the ways back through networks share.

use crate::network::product::{Factors, PANELS, Panels, Start, in_panels, product, tile_by_tile};
use bytemuck::Zeroable;
use forelock_core::lane::{LANES, Row, Simd};
use rayon::prelude::*;
use std::ops::Range;

/// Rows of factors that come whole which a product sums before the next tile: they stay in the
/// second-level cache.
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

/// The same of parts in panels, `[units / 16, strands]` rows of 16 units.
pub(crate) fn bias_gradient_of_panels(parts: &[&[Row<f32>]], sums: &mut [f32]) {
    sums.fill(0.0);
    let panels = sums.len().div_ceil(LANES);
    for part in parts {
        let panels = part.chunks_exact(part.len() / panels);
        for (sums, panel) in sums.chunks_mut(LANES).zip(panels) {
            panel.iter().for_each(|row| sums.iter_mut().zip(row.0).for_each(|(sum, x)| *sum += x));
        }
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
    let chunks: Vec<[&[f32]; 2]> = a
        .iter()
        .zip(b)
        .flat_map(|(a, b)| a.chunks(DEPTH * m).zip(b.chunks(DEPTH * n)).map(|(a, b)| [a, b]))
        .collect();
    let stored: Vec<(Vec<f32>, Panels)> =
        chunks.into_par_iter().map(|[a, b]| (tile_by_tile(a, m), in_panels(b, n))).collect();
    let (a, b): (Vec<&[f32]>, Vec<&[Row<f32>]>) =
        stored.iter().map(|(a, b)| (a.as_slice(), b.as_slice())).unzip();
    weight_gradient_of_panels(simd, &a, &b, [m, n], found);
}

/// The same of factors as products read them: parts of A `[strands, m]` tile by tile, those of B in
/// panels, `[n / 16, strands]` rows of 16 columns.
///
/// # Panics
/// If the strands of a part do not agree.
pub(crate) fn weight_gradient_of_panels(
    simd: Simd,
    a: &[&[f32]],
    b: &[&[Row<f32>]],
    [m, n]: [usize; 2],
    found: &mut [f32],
) {
    assert_eq!(a.len(), b.len(), "parts of the factors");
    let all = n.div_ceil(LANES);
    let blocks: Vec<Panels> = (0..all.div_ceil(PANELS))
        .into_par_iter()
        .map(|block| {
            let panels = block * PANELS..all.min((block + 1) * PANELS);
            let mut c = vec![Row::zeroed(); panels.len() * m];
            for (a, b) in a.iter().zip(b) {
                let strands = b.len() / all;
                let b = &b[panels.start * strands..panels.end * strands];
                product(simd, Factors { a, columns: m, b }, Start::Sums, &mut c);
            }
            c
        })
        .collect();
    found.par_chunks_exact_mut(n).with_min_len(ROWS).enumerate().for_each(|(row, found)| {
        let panels = blocks.iter().flat_map(|block| block.chunks_exact(m));
        for (panel, found) in panels.zip(found.chunks_mut(LANES)) {
            found.copy_from_slice(&panel[row].0[..found.len()]);
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
