//! One matrix product, C = AᵀB + C₀, for inference and training.
//!
//! # Theory
//! A is `[K, M]`, B `[K, N]`, C `[M, N]`. A layer of a packet of strands is this product with A the
//! weights `[inputs, outputs]` and B the activations `[inputs, strands]`; the gradients of a layer
//! are the same product with other matrices.
//!
//! # Practice
//! Lanes run along N. A tile of 6 × 64 numbers of C stays in 24 registers of AVX-512 (6 × 16 in 12
//! of AVX2) while K runs; each step loads 64 numbers of B and broadcasts 6 of A. Each number of C
//! is summed in the order of K, whatever the tile and the number of threads.

#![expect(clippy::needless_range_loop, reason = "loops with one index for several arrays vectorise")]

use bytemuck::Zeroable;
use forelock_core::lane::{LANES, Lane, Row, Simd, on};

/// Rows of [`LANES`] numbers of a tile of C: 64 columns.
pub const TILE_ROWS: usize = 4;
/// Columns of a packet: strands of it.
pub const PACKET: usize = TILE_ROWS * LANES;

/// Rows of A's columns in a tile.
const TILE: usize = 6;

/// Rows of 64 strands.
pub(crate) type Rows = Vec<Row<f32>>;

/// `units` rows of 64 strands, all zero.
pub(crate) fn zero_rows(units: usize) -> Rows {
    vec![Row::zeroed(); units * TILE_ROWS]
}

/// Up to 64 strands, `[units]` each, as rows.
pub(crate) fn to_rows<'a>(strands: impl Iterator<Item = &'a [f32]>, rows: &mut [Row<f32>]) {
    for (s, strand) in strands.enumerate() {
        for (k, x) in strand.iter().enumerate() {
            rows[k * TILE_ROWS + s / LANES].0[s % LANES] = *x;
        }
    }
}

/// Rows of 64 strands to strand by strand, `[64][units]`.
pub(crate) fn by_strand(rows: &[Row<f32>], to: &mut [f32]) {
    transpose(bytemuck::cast_slice(rows), PACKET, to);
}

/// `[rows, columns]` to `[columns, rows]`.
pub(crate) fn transpose(from: &[f32], columns: usize, to: &mut [f32]) {
    // Blocks of 4 × 4 are transposed in registers.
    const BLOCK: usize = 4;
    let rows = from.len() / columns;
    let whole = [rows, columns].map(|count| count / BLOCK * BLOCK);
    for r in (0..whole[0]).step_by(BLOCK) {
        for c in (0..whole[1]).step_by(BLOCK) {
            let mut block = [[0.0; BLOCK]; BLOCK];
            for k in 0..BLOCK {
                block[k].copy_from_slice(&from[(r + k) * columns + c..][..BLOCK]);
            }
            for k in 0..BLOCK {
                let column = block.map(|row| row[k]);
                to[(c + k) * rows + r..][..BLOCK].copy_from_slice(&column);
            }
        }
    }
    for r in 0..rows {
        let first = if r < whole[0] { whole[1] } else { 0 };
        (first..columns).for_each(|c| to[c * rows + r] = from[r * columns + c]);
    }
}

/// What a product starts from, and what becomes of its sums.
#[derive(Clone, Copy, Debug)]
pub enum Start<'a> {
    /// C₀ = 0.
    Zero,
    /// Row m of C₀ is `bias[m]`.
    Bias(&'a [f32]),
    /// The same, and each sum below zero becomes zero.
    BiasRelu(&'a [f32]),
    /// C₀ is what C holds.
    Sums,
}

impl Start<'_> {
    #[inline(always)]
    fn bias(&self, m: usize) -> f32 {
        match self {
            Self::Zero | Self::Sums => 0.0,
            Self::Bias(bias) | Self::BiasRelu(bias) => bias[m],
        }
    }
}

/// The two factors of a product.
#[derive(Clone, Copy, Debug)]
pub struct Factors<'a> {
    /// A, row-major `[K, columns]`.
    pub a: &'a [f32],
    /// M: columns of A.
    pub columns: usize,
    /// B, `[K, 4]` rows: 64 columns.
    pub b: &'a [Row<f32>],
}

/// C = AᵀB + C₀ for 64 columns: `c` is `[M, 4]` rows.
///
/// # Panics
/// If the lengths of the slices do not agree.
pub fn product(simd: Simd, factors: Factors<'_>, start: Start<'_>, c: &mut [Row<f32>]) {
    product_of_columns(simd, factors, PACKET, start, c);
}

/// The same for at least the first `used` columns; the others are computed too or left as they are.
pub(crate) fn product_of_columns(
    simd: Simd,
    factors: Factors<'_>,
    used: usize,
    start: Start<'_>,
    c: &mut [Row<f32>],
) {
    assert_eq!(factors.a.len() * TILE_ROWS, factors.b.len() * factors.columns, "rows of A and of B");
    assert_eq!(c.len(), TILE_ROWS * factors.columns, "rows of C");
    let simd = simd.resolve();
    assert!(simd.is_supported(), "{simd:?} is not supported by this processor");
    let run = on!(simd, tiles(factors: Factors<'_>, start: Start<'_>, used: usize, c: &mut [Row<f32>]));
    // SAFETY: the instruction set is supported.
    #[allow(unused_unsafe, clippy::allow_attributes, reason = "only instantiations with features are unsafe")]
    unsafe {
        run(factors, start, used, c);
    }
}

/// All tiles of C.
#[inline(always)]
fn tiles<L: Lane<Scalar = f32>>(factors: Factors<'_>, start: Start<'_>, used: usize, c: &mut [Row<f32>]) {
    let mut m = 0;
    while m + TILE <= factors.columns {
        rows::<L, TILE>(factors, start, m, used, c);
        m += TILE;
    }
    match factors.columns - m {
        1 => rows::<L, 1>(factors, start, m, used, c),
        2 => rows::<L, 2>(factors, start, m, used, c),
        3 => rows::<L, 3>(factors, start, m, used, c),
        4 => rows::<L, 4>(factors, start, m, used, c),
        5 => rows::<L, 5>(factors, start, m, used, c),
        _ => {}
    }
}

/// `M` rows of C from row `first`, `used` columns of them.
#[inline(always)]
fn rows<L: Lane<Scalar = f32>, const M: usize>(
    factors: Factors<'_>,
    start: Start<'_>,
    first: usize,
    used: usize,
    c: &mut [Row<f32>],
) {
    let lanes = used.min(PACKET).div_ceil(L::WIDTH);
    // Registers of AVX-512 hold twice as many tiles as those of AVX2; 32 columns do not need them.
    if L::WIDTH == LANES && lanes > 2 {
        tile::<L, M, 4>(factors, start, [first, 0], c);
    } else {
        for column in (0..lanes).step_by(2) {
            tile::<L, M, 2>(factors, start, [first, column], c);
        }
    }
}

/// The tile of `M` rows from row `at[0]` and `R` lanes from lane `at[1]` of C.
#[inline(always)]
fn tile<L: Lane<Scalar = f32>, const M: usize, const R: usize>(
    factors: Factors<'_>,
    start: Start<'_>,
    at: [usize; 2],
    c: &mut [Row<f32>],
) {
    let [first, column] = at;
    let mut sums = [[L::zero(); R]; M];
    for m in 0..M {
        for r in 0..R {
            let lane = (column + r) * L::WIDTH;
            sums[m][r] = match start {
                Start::Sums => L::load(&c[(first + m) * TILE_ROWS + lane / LANES], lane % LANES),
                _ => L::splat(start.bias(first + m)),
            };
        }
    }
    let weights = factors.a.chunks_exact(factors.columns);
    for (weights, inputs) in weights.zip(factors.b.chunks_exact(TILE_ROWS)) {
        let mut loaded = [L::zero(); R];
        for r in 0..R {
            let lane = (column + r) * L::WIDTH;
            loaded[r] = L::load(&inputs[lane / LANES], lane % LANES);
        }
        let weights = &weights[first..first + M];
        for m in 0..M {
            let weight = L::splat(weights[m]);
            for r in 0..R {
                sums[m][r] = weight.mul_add(loaded[r], sums[m][r]);
            }
        }
    }
    let floor = L::splat(if matches!(start, Start::BiasRelu(_)) { 0.0 } else { f32::MIN });
    for m in 0..M {
        for r in 0..R {
            let lane = (column + r) * L::WIDTH;
            sums[m][r].max(floor).store(&mut c[(first + m) * TILE_ROWS + lane / LANES], lane % LANES);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_matrix_of_any_size_is_transposed() {
        for [rows, columns] in [[1, 1], [3, 2], [4, 8], [5, 7], [64, 66], [9, 4]] {
            let from: Vec<f32> = (0..rows * columns).map(|k| k as f32).collect();
            let mut to = vec![f32::NAN; from.len()];
            transpose(&from, columns, &mut to);
            for (k, x) in to.iter().enumerate() {
                assert_eq!(*x, from[k % rows * columns + k / rows], "{rows} {columns} {k}");
            }
        }
    }
}
