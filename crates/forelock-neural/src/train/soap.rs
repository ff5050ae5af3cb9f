//! SOAP (Vyas et al. 2025): Adam along the principal axes of the gradient.
//!
//! # Theory
//! A matrix of weights has the gradient G. With the eigenvectors U of the running mean of GGᵀ and V
//! of that of GᵀG, Adam runs on UᵀGV, and its step is rotated back. The inputs of the network are
//! strongly correlated, for they are neighbouring frames, and hair is stiff in some directions and
//! soft in others: along these axes both are differences of scale, which Adam levels.
//!
//! # Practice
//! A step of power iteration now and then keeps the axes up to date. Adam's moments are rotated
//! with them: left along the old axes, the mean square made frequent changes worse than rare ones.
//! Biases have no axes of their own.

use super::adam::Adam;
use super::layers::{parts, weight_gradient};
use crate::network::Shape;
use crate::network::product::transpose;
use forelock_core::lane::Simd;
use rayon::prelude::*;
use std::ops::Range;

/// Decay of Adam's mean and mean square of the gradient, in a step.
const DECAY: [f64; 2] = [0.95, 0.99];
/// Decay of the means of GGᵀ and GᵀG, in a step.
const KEPT: f32 = 0.99;
/// Steps between two changes of the axes.
const CHANGE_EVERY: u32 = 10;
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
struct Side {
    size: usize,
    /// The running mean of GGᵀ or GᵀG.
    covariance: Vec<f32>,
    /// The axes as columns, and as rows.
    columns: Vec<f32>,
    rows: Vec<f32>,
}

/// A matrix of weights, `[rows, columns]`, and its axes.
#[derive(Clone, Debug)]
struct Matrix {
    range: Range<usize>,
    sides: [Side; 2],
}

/// The state of the descent.
#[derive(Clone, Debug)]
pub(super) struct Soap {
    matrices: [Matrix; 4],
    /// Along the axes.
    adam: Adam<f32>,
}

/// What [`Soap::resume`] takes: Adam's moments, then covariance and axes of all sides.
pub(super) type State = [Vec<f32>; 3];

/// `x`, or 0 if it is [`TINY`], so that products of two such numbers are never subnormal. Means of
/// what has become 0 decay to subnormal numbers within some thousand steps, with which arithmetic
/// is a hundred times slower.
fn without_tiny(x: f32) -> f32 {
    if x.abs() < TINY { 0.0 } else { x }
}

/// AᵀB of A `[k, m]` and B `[k, n]`: `[m, n]`.
fn product(simd: Simd, a: &[f32], b: &[f32], k: usize) -> Vec<f32> {
    let sizes = [a.len() / k, b.len() / k];
    let mut c = vec![0.0; sizes[0] * sizes[1]];
    weight_gradient(simd, [&[a], &[b]], sizes, &mut c);
    c
}

/// `[rows, columns]` to `[columns, rows]`.
fn transposed(from: &[f32], columns: usize) -> Vec<f32> {
    let mut to = vec![0.0; from.len()];
    transpose(from, columns, &mut to);
    to
}

impl Side {
    fn new(size: usize) -> Self {
        let mut identity = vec![0.0; size * size];
        identity.iter_mut().step_by(size + 1).for_each(|x| *x = 1.0);
        Self { size, covariance: vec![0.0; size * size], rows: identity.clone(), columns: identity }
    }

    /// Steps between two updates of the covariance.
    fn interval(&self) -> u32 {
        if self.size > LONG { LESS_OFTEN } else { 1 }
    }

    /// Whether the gradient of `step` counts in the covariance.
    fn is_due(&self, step: u32) -> bool {
        step.is_multiple_of(self.interval())
    }

    /// Updates the covariance with the gradient of `step`, `[k, size]`, and every so many steps the
    /// axes. Returns the new axes in coordinates of the old ones, as columns, if they have changed.
    fn follow(&mut self, simd: Simd, step: u32, gradient: &[f32]) -> Option<Vec<f32>> {
        let interval = self.interval();
        let kept = (0..interval).fold(1.0, |product, _| product * KEPT);
        let new = product(simd, gradient, gradient, gradient.len() / self.size);
        for (mean, x) in self.covariance.iter_mut().zip(&new) {
            *mean = without_tiny(kept * *mean + (1.0 - kept) * x);
        }
        if !step.is_multiple_of(interval * CHANGE_EVERY) {
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

impl Matrix {
    /// UᵀXV: along the axes.
    fn along_axes(&self, simd: Simd, x: &[f32]) -> Vec<f32> {
        let [left, right] = &self.sides;
        let half = product(simd, x, &left.columns, left.size);
        product(simd, &half, &right.columns, right.size)
    }

    /// UXVᵀ: back.
    fn back(&self, simd: Simd, x: &[f32]) -> Vec<f32> {
        let [left, right] = &self.sides;
        let half = product(simd, x, &left.rows, left.size);
        product(simd, &half, &right.rows, right.size)
    }

    /// Updates both sides with the gradient of `step`. Where the axes change, rotates Adam's
    /// moments to the new ones; the mean square as if its components were uncorrelated.
    fn follow(&mut self, simd: Simd, step: u32, gradient: &[f32], [first, second]: [&mut [f32]; 2]) {
        let [left, right] = &mut self.sides;
        let columns = right.size;
        let (of_left, of_right) = rayon::join(
            || left.is_due(step).then(|| left.follow(simd, step, &transposed(gradient, columns))),
            || right.is_due(step).then(|| right.follow(simd, step, gradient)),
        );
        let mut changes = [of_left.flatten(), of_right.flatten()];
        if changes.iter().any(Option::is_some) {
            let sizes = [left.size, right.size];
            turn(simd, first, sizes, &changes);
            changes.iter_mut().flatten().flatten().for_each(|x| *x = without_tiny(*x * *x));
            turn(simd, second, sizes, &changes);
        }
    }
}

/// LᵀXR of the changes L and R.
fn turn(simd: Simd, x: &mut [f32], [rows, columns]: [usize; 2], [left, right]: &[Option<Vec<f32>>; 2]) {
    let half = match left {
        Some(left) => product(simd, x, left, rows),
        None => transposed(x, columns),
    };
    let whole = match right {
        Some(right) => product(simd, &half, right, columns),
        None => transposed(&half, rows),
    };
    x.iter_mut().zip(&whole).for_each(|(x, turned)| *x = without_tiny(*turned));
}

impl Soap {
    /// Of a network of this `shape`.
    pub(super) fn new(shape: &Shape) -> Self {
        let [statics, shared, _, hidden, _, output, _] = shape.ranges();
        let width = shape.width;
        let sizes = [[shape.statics, width], [shape.shared, width], [width, width], [width, shape.outputs]];
        let ranges = [statics, shared, hidden, output];
        let matrix = |k: usize| Matrix { range: ranges[k].clone(), sides: sizes[k].map(Side::new) };
        Self { matrices: std::array::from_fn(matrix), adam: Adam::with_decay(DECAY, shape.parameters()) }
    }

    /// Moves `parameters` along `scale` times the gradient, at `rate`.
    pub(super) fn step(
        &mut self,
        simd: Simd,
        parameters: &mut [f32],
        gradient: &[f32],
        [rate, scale]: [f64; 2],
    ) {
        let step = self.adam.steps();
        let gradient: Vec<f32> = gradient.iter().map(|g| scale as f32 * g).collect();
        let ranges = self.matrices.each_ref().map(|matrix| matrix.range.clone());
        let mut turned = gradient.clone();
        let [first, second] = self.adam.moments_mut().map(|moment| parts(moment, ranges.clone()));
        let own = self.matrices.par_iter_mut().zip(parts(&mut turned, ranges.clone()));
        own.zip(first).zip(second).for_each(|(((matrix, turned), first), second)| {
            let gradient = &gradient[matrix.range.clone()];
            matrix.follow(simd, step, gradient, [first, second]);
            let along = matrix.along_axes(simd, gradient);
            turned.iter_mut().zip(&along).for_each(|(x, along)| *x = without_tiny(*along));
        });
        let mut moved = vec![0.0; parameters.len()];
        self.adam.step(&mut moved, &turned, [rate, 1.0]);
        let own = self.matrices.par_iter().zip(parts(&mut moved, ranges));
        own.for_each(|(matrix, moved)| {
            moved.iter_mut().for_each(|x| *x = without_tiny(*x));
            let from_axes = matrix.back(simd, moved);
            moved.copy_from_slice(&from_axes);
        });
        parameters.iter_mut().zip(&moved).for_each(|(p, moved)| *p += moved);
    }

    /// The mean squares of the gradient along the axes; those of the biases as they are.
    pub(super) fn second_mut(&mut self) -> &mut [f32] {
        let [_, second] = self.adam.moments_mut();
        second
    }

    /// What [`Self::resume`] takes.
    pub(super) fn state(&self) -> State {
        let sides = self.matrices.iter().flat_map(|matrix| &matrix.sides);
        let [first, second] = self.adam.moments().map(<[f32]>::to_vec);
        [first, second, sides.flat_map(|side| side.covariance.iter().chain(&side.rows)).copied().collect()]
    }

    /// The state after `steps` steps; none if it is of another network.
    pub(super) fn resume(shape: &Shape, steps: u32, [first, second, sides]: State) -> Option<Self> {
        let mut own = Self::new(shape);
        let parameters = shape.parameters();
        let mut left = sides.as_slice();
        for side in own.matrices.iter_mut().flat_map(|matrix| &mut matrix.sides) {
            let (covariance, rest) = left.split_at_checked(side.covariance.len())?;
            let (rows, rest) = rest.split_at_checked(side.rows.len())?;
            side.covariance.copy_from_slice(covariance);
            side.rows.copy_from_slice(rows);
            side.columns = transposed(rows, side.size);
            left = rest;
        }
        let lengths = [first.len(), second.len(), left.len()];
        own.adam.resume(steps, [first, second]);
        (lengths == [parameters, parameters, 0]).then_some(own)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    fn rotation(random: &mut Random, size: usize) -> Vec<f32> {
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
            side.follow(Simd::Auto, step, &gradient);
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
            side.follow(Simd::Auto, step, &gradient);
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
                side.follow(Simd::Auto, step, &gradient);
                let off = off_orthonormal(&side.rows, SIZE);
                assert!(off < 1e-3, "{strong}, step {step}: {off}");
            }
        }
    }

    /// Of a quadratic whose axes are none of the parameters', with stiffnesses of 1 to 10⁴.
    #[test]
    fn it_descends_where_adam_is_slow() {
        let shape = Shape { statics: 4, shared: 24, width: 16, outputs: 4 };
        let [_, range, ..] = shape.ranges();
        let mut random = Random::new(4);
        let [left, right] = [shape.shared, shape.width].map(|size| rotation(&mut random, size));
        let stiffness = |i: usize, size: usize| 100f32.powf(i as f32 / (size - 1) as f32);
        let turn = |x: &[f32], [left, right]: [&[f32]; 2]| {
            let half = product(Simd::Auto, x, left, shape.shared);
            product(Simd::Auto, &half, right, shape.width)
        };
        let rows = [left.as_slice(), right.as_slice()];
        let [columns, other] = [transposed(&left, shape.shared), transposed(&right, shape.width)];
        let gradient = |parameters: &[f32]| -> (f32, Vec<f32>) {
            let mut along = turn(&parameters[range.clone()], [&columns, &other]);
            let mut energy = 0.0;
            for (k, x) in along.iter_mut().enumerate() {
                let (i, j) = (k / shape.width, k % shape.width);
                let stiff = stiffness(i, shape.shared) * stiffness(j, shape.width);
                energy += 0.5 * stiff * *x * *x;
                *x *= stiff;
            }
            let mut found = vec![0.0; parameters.len()];
            found[range.clone()].copy_from_slice(&turn(&along, rows));
            (energy, found)
        };
        let start: Vec<f32> = (0..shape.parameters()).map(|_| random.normal() as f32).collect();
        let steps = 800;
        let rate = |step: u32| 0.03 * (1.0 - f64::from(step) / f64::from(steps));
        let [mut by_soap, mut by_adam] = [start.clone(), start.clone()];
        let (mut soap, mut adam) = (Soap::new(&shape), Adam::with_decay(DECAY, shape.parameters()));
        for step in 0..steps {
            let (_, found) = gradient(&by_soap);
            soap.step(Simd::Auto, &mut by_soap, &found, [rate(step), 1.0]);
            let (_, found) = gradient(&by_adam);
            adam.step(&mut by_adam, &found, [rate(step), 1.0]);
        }
        let [start, soap, adam] = [&start, &by_soap, &by_adam].map(|parameters| gradient(parameters).0);
        println!("{start} at first, {soap} by SOAP, {adam} by Adam");
        assert!(soap < 0.1 * adam && adam < 0.1 * start);
    }
}
