//! One matrix product, C = AᵀB + C₀, for inference and training.
//!
//! # Theory
//! A is `[K, M]`, B `[K, N]`, C `[M, N]`. A layer of a packet of strands is this product with A the
//! weights `[inputs, outputs]` and B the activations `[inputs, strands]`; the gradients of a layer
//! are the same product with other matrices.
//!
//! # Practice
//! Lanes run along N. A tile of 6 × 64 numbers of C stays in 24 registers of AVX-512 (6 × 16 in 12
//! of AVX2) while K runs; each step loads 64 (16) numbers of B and broadcasts 6 of A. Each number
//! of C is summed in the order of K, whatever the tile and the number of threads.
//!
//! Both factors are stored in the order in which they are read: A tile by tile
//! ([`tile_by_tile`]), B and C in panels of 16 columns. Rows of 256 numbers are a kilobyte apart,
//! so that the lines of a column fall into few sets of a cache and evict each other. With AVX2 a
//! panel of B stays in the first-level cache while all tiles of A pass.

#![expect(clippy::needless_range_loop, reason = "loops with one index for several arrays vectorise")]

use bytemuck::Zeroable;
use forelock_core::lane::{LANES, Lane, Row, Simd, on};

/// Panels of [`LANES`] columns of a packet.
pub const PANELS: usize = 4;
/// Columns of a packet: strands of it.
pub const PACKET: usize = PANELS * LANES;

/// Columns of A in a tile.
const TILE: usize = 6;

/// A matrix as rows of 16 columns, a panel after the other: `[columns / 16, rows]`. The numbers of
/// a packet are `[4, units]` rows of 16 strands, or `[units / 16, 64]` rows of 16 units.
pub(crate) type Panels = Vec<Row<f32>>;

/// `units` numbers of 64 strands, all zero.
pub(crate) fn zero_panels(units: usize) -> Panels {
    vec![Row::zeroed(); units * PANELS]
}

/// `units` numbers of 64 strands as rows of 16 units, all zero.
pub(crate) fn zero_unit_panels(units: usize) -> Panels {
    vec![Row::zeroed(); units.div_ceil(LANES) * PACKET]
}

/// Up to 64 strands, `[units]` each, as panels.
pub(crate) fn to_panels<'a>(strands: impl Iterator<Item = &'a [f32]>, panels: &mut [Row<f32>]) {
    let units = panels.len() / PANELS;
    for (s, strand) in strands.enumerate() {
        debug_assert_eq!(strand.len(), units, "units of a strand");
        let panel = &mut panels[s / LANES * units..][..units];
        panel.iter_mut().zip(strand).for_each(|(row, x)| row.0[s % LANES] = *x);
    }
}

/// Panels of 64 strands to strand by strand, `[64][units]`.
pub(crate) fn by_strand(panels: &[Row<f32>], to: &mut [f32]) {
    assert_eq!(to.len(), LANES * panels.len(), "numbers of 64 strands");
    let units = panels.len() / PANELS;
    for (panel, to) in panels.chunks_exact(units).zip(to.chunks_exact_mut(LANES * units)) {
        transpose(bytemuck::cast_slice(panel), LANES, to);
    }
}

/// Panels of 64 strands to B of a weight's gradient, the matrix `[64, units]` in panels of 16
/// units: `[units / 16, 64]` rows. What is after the last unit stays as it is.
pub(crate) fn units_in_lanes(panels: &[Row<f32>], to: &mut [Row<f32>]) {
    const BLOCK: usize = 4;
    let units = panels.len() / PANELS;
    assert_eq!(to.len(), units.div_ceil(LANES) * PACKET, "rows of 16 units");
    for (p, panel) in panels.chunks_exact(units).enumerate() {
        for (rows, to) in panel.chunks(LANES).zip(to.chunks_exact_mut(PACKET)) {
            let to = &mut to[p * LANES..][..LANES];
            for (first, rows) in (0..LANES).step_by(BLOCK).zip(rows.chunks(BLOCK)) {
                let Some(rows) = rows.as_array::<BLOCK>() else {
                    for (s, to) in to.iter_mut().enumerate() {
                        rows.iter().enumerate().for_each(|(k, row)| to.0[first + k] = row.0[s]);
                    }
                    continue;
                };
                // Blocks of 4 × 4 are transposed in registers.
                for (s, to) in (0..LANES).step_by(BLOCK).zip(to.chunks_exact_mut(BLOCK)) {
                    for k in 0..BLOCK {
                        let strand = rows.each_ref().map(|row| row.0[s + k]);
                        to[k].0[first..first + BLOCK].copy_from_slice(&strand);
                    }
                }
            }
        }
    }
}

/// Panels of 64 strands to A of a weight's gradient, the matrix `[64, units]` tile by tile. What is
/// after the last unit stays as it is.
pub(crate) fn strands_by_tiles(panels: &[Row<f32>], to: &mut [f32]) {
    let units = panels.len() / PANELS;
    assert_eq!(to.len(), size_by_tiles(PACKET, units), "tiles of 64 strands");
    for (first, tile) in (0..units).step_by(TILE).zip(to.chunks_exact_mut(PACKET * TILE)) {
        for (panel, to) in panels.chunks_exact(units).zip(tile.chunks_exact_mut(LANES * TILE)) {
            let rows = &panel[first..units.min(first + TILE)];
            for (s, to) in to.chunks_exact_mut(TILE).enumerate() {
                match rows.as_array::<TILE>() {
                    Some(rows) => to.copy_from_slice(&rows.each_ref().map(|row| row.0[s])),
                    None => to.iter_mut().zip(rows).for_each(|(to, row)| *to = row.0[s]),
                }
            }
        }
    }
}

/// The matrix `b`, `[K, columns]`, as panels of 16 columns: `[panels, K]` rows, with zeros after
/// the last column.
pub(crate) fn in_panels(b: &[f32], columns: usize) -> Panels {
    let depth = b.len() / columns;
    let mut panels = vec![Row::zeroed(); columns.div_ceil(LANES) * depth];
    for (k, row) in b.chunks_exact(columns).enumerate() {
        for (panel, from) in panels.chunks_exact_mut(depth).zip(row.chunks(LANES)) {
            panel[k].0[..from.len()].copy_from_slice(from);
        }
    }
    panels
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

/// Numbers of a matrix with `rows` rows and `columns` columns that is stored tile by tile.
pub(crate) fn size_by_tiles(rows: usize, columns: usize) -> usize {
    rows * columns.next_multiple_of(TILE)
}

/// The matrix `a`, `[K, columns]`, tile by tile: `[tiles, K, 6]`, with zeros after the last column.
pub fn tile_by_tile(a: &[f32], columns: usize) -> Vec<f32> {
    let mut tiles = vec![0.0; size_by_tiles(a.len() / columns, columns)];
    to_tiles(a, columns, &mut tiles);
    tiles
}

/// The transpose of `a`, `[rows, columns]`, tile by tile.
pub(crate) fn transposed_by_tiles(a: &[f32], columns: usize) -> Vec<f32> {
    let mut transposed = vec![0.0; a.len()];
    transpose(a, columns, &mut transposed);
    tile_by_tile(&transposed, a.len() / columns)
}

/// The same as [`tile_by_tile`] into `tiles`, whose numbers after the last column stay as they are.
pub(crate) fn to_tiles(a: &[f32], columns: usize, tiles: &mut [f32]) {
    let rows = a.len() / columns;
    assert_eq!(tiles.len(), size_by_tiles(rows, columns), "tiles of the matrix");
    for (tile, first) in tiles.chunks_exact_mut(rows * TILE).zip((0..columns).step_by(TILE)) {
        let used = TILE.min(columns - first);
        for (to, row) in tile.chunks_exact_mut(TILE).zip(a.chunks_exact(columns)) {
            let row = &row[first..first + used];
            // Whole tiles have a size that the compiler knows.
            match row.as_array::<TILE>() {
                Some(row) => to.copy_from_slice(row),
                None => to[..used].copy_from_slice(row),
            }
        }
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
    /// A, `[K, columns]`, as [`tile_by_tile`] stores it.
    pub a: &'a [f32],
    /// M: columns of A.
    pub columns: usize,
    /// B, `[panels, K]` rows: 16 columns a panel.
    pub b: &'a [Row<f32>],
}

impl Factors<'_> {
    /// K.
    #[inline(always)]
    fn depth(&self) -> usize {
        self.a.len() / self.columns.next_multiple_of(TILE)
    }
}

/// C = AᵀB + C₀: `c` is `[panels, M]` rows, 16 columns a panel.
///
/// # Panics
/// If the lengths of the slices do not agree, or K or M is 0.
pub fn product(simd: Simd, factors: Factors<'_>, start: Start<'_>, c: &mut [Row<f32>]) {
    let Factors { a, columns, b } = factors;
    assert!(columns > 0, "columns of A");
    let depth = factors.depth();
    assert!(depth > 0 && a.len() == size_by_tiles(depth, columns), "tiles of A");
    assert_eq!(b.len() * columns, c.len() * depth, "panels of B and of C");
    assert!(b.len().is_multiple_of(depth), "rows of A and of B");
    let simd = simd.resolve();
    assert!(simd.is_supported(), "{simd:?} is not supported by this processor");
    let run = on!(simd, panels(factors: Factors<'_>, start: Start<'_>, c: &mut [Row<f32>]));
    // SAFETY: the instruction set is supported.
    #[allow(unused_unsafe, clippy::allow_attributes, reason = "only instantiations with features are unsafe")]
    unsafe {
        run(factors, start, c);
    }
}

/// All panels of C.
#[inline(always)]
fn panels<L: Lane<Scalar = f32>>(factors: Factors<'_>, start: Start<'_>, c: &mut [Row<f32>]) {
    let count = factors.b.len() / factors.depth();
    let mut panel = 0;
    if L::WIDTH == LANES {
        // Registers of AVX-512 hold tiles of four panels.
        while panel + 4 <= count {
            tiles::<L, 4, 1>(factors, start, [panel, 0], c);
            panel += 4;
        }
        if panel + 2 <= count {
            tiles::<L, 2, 1>(factors, start, [panel, 0], c);
            panel += 2;
        }
        if panel < count {
            tiles::<L, 1, 1>(factors, start, [panel, 0], c);
        }
    } else {
        for panel in 0..count {
            for lane in (0..LANES).step_by(2 * L::WIDTH) {
                tiles::<L, 1, 2>(factors, start, [panel, lane], c);
            }
        }
    }
}

/// All tiles of C in `P` panels from `at[0]`, `R` registers of each from lane `at[1]`.
#[inline(always)]
fn tiles<L: Lane<Scalar = f32>, const P: usize, const R: usize>(
    factors: Factors<'_>,
    start: Start<'_>,
    at: [usize; 2],
    c: &mut [Row<f32>],
) {
    let mut m = 0;
    while m + TILE <= factors.columns {
        tile::<L, TILE, P, R>(factors, start, m, at, c);
        m += TILE;
    }
    match factors.columns - m {
        1 => tile::<L, 1, P, R>(factors, start, m, at, c),
        2 => tile::<L, 2, P, R>(factors, start, m, at, c),
        3 => tile::<L, 3, P, R>(factors, start, m, at, c),
        4 => tile::<L, 4, P, R>(factors, start, m, at, c),
        5 => tile::<L, 5, P, R>(factors, start, m, at, c),
        _ => {}
    }
}

/// The tile of `M` rows from row `first` of C.
#[inline(always)]
fn tile<L: Lane<Scalar = f32>, const M: usize, const P: usize, const R: usize>(
    factors: Factors<'_>,
    start: Start<'_>,
    first: usize,
    at: [usize; 2],
    c: &mut [Row<f32>],
) {
    let depth = factors.depth();
    let [panel, lane] = at;
    let mut sums = [[[L::zero(); R]; P]; M];
    for m in 0..M {
        for p in 0..P {
            let row = &c[(panel + p) * factors.columns + first + m];
            for r in 0..R {
                sums[m][p][r] = match start {
                    Start::Sums => L::load(row, lane + r * L::WIDTH),
                    _ => L::splat(start.bias(first + m)),
                };
            }
        }
    }
    let mut inputs: [&[Row<f32>]; P] = [&[]; P];
    for p in 0..P {
        inputs[p] = &factors.b[(panel + p) * depth..][..depth];
    }
    let weights = factors.a[first * depth..].chunks_exact(TILE);
    for (k, weights) in (0..depth).zip(weights) {
        let mut loaded = [[L::zero(); R]; P];
        for p in 0..P {
            for r in 0..R {
                loaded[p][r] = L::load(&inputs[p][k], lane + r * L::WIDTH);
            }
        }
        for m in 0..M {
            let weight = L::splat(weights[m]);
            for p in 0..P {
                for r in 0..R {
                    sums[m][p][r] = weight.mul_add(loaded[p][r], sums[m][p][r]);
                }
            }
        }
    }
    let floor = L::splat(if matches!(start, Start::BiasRelu(_)) { 0.0 } else { f32::MIN });
    for m in 0..M {
        for p in 0..P {
            let row = &mut c[(panel + p) * factors.columns + first + m];
            for r in 0..R {
                sums[m][p][r].max(floor).store(row, lane + r * L::WIDTH);
            }
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

    /// Both orders in which the products of weights' gradients read a packet, of numbers of units
    /// that fill neither tiles nor panels.
    #[test]
    fn a_packet_is_stored_in_the_order_of_each_factor() {
        for units in [1, 6, 66, 72] {
            let strands: Vec<f32> = (0..PACKET * units).map(|k| 1.0 + k as f32).collect();
            let mut panels = zero_panels(units);
            to_panels(strands.chunks_exact(units), &mut panels);
            let mut back = vec![f32::NAN; strands.len()];
            by_strand(&panels, &mut back);
            assert_eq!(back, strands, "{units}");
            let mut tiles = vec![0.0; size_by_tiles(PACKET, units)];
            strands_by_tiles(&panels, &mut tiles);
            assert_eq!(tiles, tile_by_tile(&strands, units), "{units}");
            let mut lanes = zero_unit_panels(units);
            units_in_lanes(&panels, &mut lanes);
            assert_eq!(lanes, in_panels(&strands, units), "{units}");
        }
    }
}
