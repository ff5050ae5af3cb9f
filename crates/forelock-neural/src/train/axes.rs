//! Principal axes of a gradient's rows or columns, for [`Soap`](super::soap).

use super::layers::weight_gradient;
use crate::network::product::transpose;
use forelock_core::lane::Simd;

/// Decay of the means of GGᵀ and GᵀG, in a step.
const KEPT: f32 = 0.99;
/// Steps between two changes of the axes.
pub(super) const CHANGE_EVERY: u32 = 10;
/// A matrix with more rows (or columns) than this has its left (or right) axes updated less often.
const LONG: usize = 300;
/// How many times less often.
const LESS_OFTEN: u32 = 4;
/// The share of the mean eigenvalue that an axis has at least: the next one where rounding would
/// lose axes.
const LEAST: [f32; 3] = [1e-6, 0.1, 1e3];
/// Numbers of a smaller size are taken for 0.
const TINY: f32 = 1e-18;
/// Axes that are made orthonormal together.
const BLOCK: usize = 32;

/// The axes of the rows of a matrix (its left side) or of its columns (its right side).
#[derive(Clone, Debug)]
pub(super) struct Side {
    pub size: usize,
    /// The running mean of GGᵀ or GᵀG.
    pub covariance: Vec<f32>,
    /// The axes as columns, and as rows.
    pub columns: Vec<f32>,
    pub rows: Vec<f32>,
}

/// `x`, or 0 if it is [`TINY`], so that products of two such numbers are never subnormal. Means of
/// what has become 0 decay to subnormal numbers within some thousand steps, with which arithmetic
/// is a hundred times slower.
pub(super) fn without_tiny(x: f32) -> f32 {
    if x.abs() < TINY { 0.0 } else { x }
}

/// AᵀB of A `[k, m]` and B `[k, n]`: `[m, n]`.
pub(super) fn product(simd: Simd, a: &[f32], b: &[f32], k: usize) -> Vec<f32> {
    let sizes = [a.len() / k, b.len() / k];
    let mut c = vec![0.0; sizes[0] * sizes[1]];
    weight_gradient(simd, [&[a], &[b]], sizes, &mut c);
    c
}

/// `[rows, columns]` to `[columns, rows]`.
pub(super) fn transposed(from: &[f32], columns: usize) -> Vec<f32> {
    let mut to = vec![0.0; from.len()];
    transpose(from, columns, &mut to);
    to
}

/// Whether what happens every so many steps, and after the first one, happens after step `done`.
pub(super) fn is_due(done: u32, every: u32) -> bool {
    done == 1 || done.is_multiple_of(every)
}

impl Side {
    pub(super) fn new(size: usize) -> Self {
        let mut identity = vec![0.0; size * size];
        identity.iter_mut().step_by(size + 1).for_each(|x| *x = 1.0);
        Self { size, covariance: vec![0.0; size * size], rows: identity.clone(), columns: identity }
    }

    /// Steps between two updates of the covariance.
    fn interval(&self) -> u32 {
        if self.size > LONG { LESS_OFTEN } else { 1 }
    }

    /// Whether the gradient of step `done` counts in the covariance.
    pub(super) fn counts(&self, done: u32) -> bool {
        is_due(done, self.interval())
    }

    /// Updates the covariance with the GGᵀ or GᵀG of step `done`, which is `square` times `new`,
    /// and every so many steps the axes. Returns the new axes in coordinates of the old ones, as
    /// columns, if they have changed.
    pub(super) fn follow(&mut self, simd: Simd, done: u32, new: &[f32], square: f32) -> Option<Vec<f32>> {
        let interval = self.interval();
        let kept = (0..interval).fold(1.0, |product, _| product * KEPT);
        let taken = (1.0 - kept) * square;
        for (mean, x) in self.covariance.iter_mut().zip(new) {
            *mean = without_tiny(kept * *mean + taken * x);
        }
        if !is_due(done, interval * CHANGE_EVERY) {
            return None;
        }
        let before = self.iterate(simd)?;
        Some(product(simd, &before, &self.columns, self.size))
    }

    /// A power iteration. Returns the axes before, as columns.
    fn iterate(&mut self, simd: Simd) -> Option<Vec<f32>> {
        let trace: f32 = self.covariance.iter().step_by(self.size + 1).sum();
        if trace <= 0.0 {
            return None;
        }
        let moved = product(simd, &self.columns, &self.covariance, self.size);
        for share in LEAST {
            let least = share * trace / self.size as f32;
            let along = |(moved, axis): (&f32, &f32)| (moved + least * axis) / trace;
            let mut rows: Vec<f32> = moved.iter().zip(&self.rows).map(along).collect();
            // Twice is enough.
            (0..2).for_each(|_| orthonormalize(simd, &mut rows, self.size));
            rows.iter_mut().for_each(|x| *x = without_tiny(*x));
            let columns = transposed(&rows, self.size);
            if off_identity(&product(simd, &columns, &columns, self.size), self.size) < 1e-3 {
                self.rows = rows;
                return Some(std::mem::replace(&mut self.columns, columns));
            }
        }
        None
    }
}

/// The largest difference of a matrix from the identity.
fn off_identity(matrix: &[f32], size: usize) -> f32 {
    let off = |(k, x): (usize, &f32)| (x - f32::from(u8::from(k % (size + 1) == 0))).abs();
    matrix.iter().enumerate().map(off).fold(0.0, f32::max)
}

/// Makes rows of `size` numbers orthonormal, each with respect to those before it.
fn orthonormalize(simd: Simd, mut rows: &mut [f32], size: usize) {
    while !rows.is_empty() {
        let (block, rest) = rows.split_at_mut(rows.len().min(BLOCK * size));
        (0..2).for_each(|_| orthonormalize_block(block, size));
        if !rest.is_empty() {
            let [columns, of_rest] = [&*block, &*rest].map(|rows| transposed(rows, size));
            let along = product(simd, &columns, &of_rest, size);
            let taken = product(simd, &along, block, block.len() / size);
            rest.iter_mut().zip(&taken).for_each(|(x, taken)| *x -= taken);
        }
        rows = rest;
    }
}

/// The same for few rows.
fn orthonormalize_block(rows: &mut [f32], size: usize) {
    for i in 0..rows.len() / size {
        let (row, later) = rows[i * size..].split_at_mut(size);
        let over_norm = 1.0 / dot(row, row).sqrt().max(f32::MIN_POSITIVE);
        row.iter_mut().for_each(|x| *x *= over_norm);
        for other in later.chunks_exact_mut(size) {
            let along = dot(row, other);
            other.iter_mut().zip(&*row).for_each(|(x, axis)| *x -= along * axis);
        }
    }
}

/// The sum of products, in sixteen parts.
fn dot(a: &[f32], b: &[f32]) -> f32 {
    const PARTS: usize = 16;
    let mut sums = [0.0; PARTS];
    let ((a, a_last), (b, b_last)) = (a.as_chunks::<PARTS>(), b.as_chunks::<PARTS>());
    for (a, b) in a.iter().zip(b) {
        sums.iter_mut().zip(a.iter().zip(b)).for_each(|(sum, (a, b))| *sum += a * b);
    }
    let last: f32 = a_last.iter().zip(b_last).map(|(a, b)| a * b).sum();
    sums.iter().sum::<f32>() + last
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::random::Random;

    pub(crate) fn rotation(random: &mut Random, size: usize) -> Vec<f32> {
        let mut rows: Vec<f32> = (0..size * size).map(|_| random.normal() as f32).collect();
        orthonormalize(Simd::Auto, &mut rows, size);
        rows
    }

    fn off_orthonormal(rows: &[f32], size: usize) -> f32 {
        let columns = transposed(rows, size);
        off_identity(&product(Simd::Auto, &columns, &columns, size), size)
    }

    #[test]
    fn rows_of_very_different_lengths_become_orthonormal() {
        let mut random = Random::new(2);
        for size in [3, 32, 100] {
            let mut rows: Vec<f32> = (0..size * size).map(|_| random.normal() as f32).collect();
            for (i, row) in rows.chunks_exact_mut(size).enumerate() {
                row.iter_mut().for_each(|x| *x *= 10f32.powi(-(i as i32 % 7)));
            }
            // A row that is nearly the first.
            let first = rows[..size].to_vec();
            rows[2 * size..3 * size].iter_mut().zip(&first).for_each(|(x, first)| *x = first + 1e-4 * *x);
            (0..2).for_each(|_| orthonormalize(Simd::Auto, &mut rows, size));
            assert!(off_orthonormal(&rows, size) < 2e-6, "{size}: {}", off_orthonormal(&rows, size));
        }
    }

    /// Axes of a covariance with known eigenvectors are found, and stay orthonormal; what no
    /// gradient reaches keeps its axes exactly.
    #[test]
    fn axes_become_eigenvectors() {
        const SIZE: usize = 40;
        let mut random = Random::new(3);
        let vectors = rotation(&mut random, SIZE);
        let mut side = Side::new(SIZE + 1);
        for step in 0..4_000 {
            let mut gradient = vec![0.0; SIZE + 1];
            for (i, vector) in vectors.chunks_exact(SIZE).enumerate() {
                let size = 0.8f32.powi(i as i32) * random.normal() as f32;
                gradient.iter_mut().zip(vector).for_each(|(g, x)| *g += size * x);
            }
            side.follow(Simd::Auto, step + 1, &product(Simd::Auto, &gradient, &gradient, 1), 1.0);
        }
        assert!(off_orthonormal(&side.rows, SIZE + 1) < 2e-6);
        // The mean has about a hundred gradients in it, so the axes are those of a sample.
        for (axis, vector) in side.rows.chunks_exact(SIZE + 1).zip(vectors.chunks_exact(SIZE)).take(2) {
            let along = dot(&axis[..SIZE], vector).abs();
            assert!(along > 0.6, "{along}");
        }
        let last = &side.rows[SIZE * (SIZE + 1)..];
        assert!(last[..SIZE].iter().all(|x| *x == 0.0) && last[SIZE] == 1.0);
    }

    /// What no longer has a gradient decays to 0, not to subnormal numbers, with which products
    /// take a hundred times as long.
    #[test]
    fn what_has_no_gradient_any_more_becomes_zero() {
        const SIZE: usize = 24;
        let mut random = Random::new(4);
        let mut side = Side::new(SIZE);
        for step in 0..10_000 {
            let size = if step < 50 { SIZE } else { SIZE / 2 };
            let mut gradient = vec![0.0; SIZE];
            gradient[..size].iter_mut().for_each(|x| *x = 1e-3 * random.normal() as f32);
            side.follow(Simd::Auto, step + 1, &product(Simd::Auto, &gradient, &gradient, 1), 1.0);
        }
        let numbers = side.covariance.iter().chain(&side.rows).chain(&side.columns);
        assert_eq!(numbers.filter(|x| x.is_subnormal()).count(), 0);
        let last = &side.covariance[SIZE * SIZE / 2..];
        assert!(last.iter().all(|x| *x == 0.0), "{last:?}");
        assert!(side.covariance[0] > 1e-8);
    }

    /// Two equal numbers that are most of the gradient leave one axis without any of it.
    #[test]
    fn no_axis_is_lost_where_numbers_are_equal() {
        const SIZE: usize = 256;
        for strong in [0.1f32, 3.0, 1e3] {
            let mut random = Random::new(6);
            let mut side = Side::new(SIZE);
            for step in 0..100 {
                let mut gradient: Vec<f32> = (0..SIZE).map(|_| random.normal() as f32).collect();
                gradient[9] = strong * gradient[9] * (SIZE as f32).sqrt();
                gradient[77] = gradient[9];
                side.follow(Simd::Auto, step + 1, &product(Simd::Auto, &gradient, &gradient, 1), 1.0);
                let off = off_orthonormal(&side.rows, SIZE);
                assert!(off < 1e-3, "{strong}, step {step}: {off}");
            }
        }
    }
}
