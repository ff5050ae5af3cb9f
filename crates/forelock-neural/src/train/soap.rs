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
//!
//! The weights of the shared inputs are the largest matrix, 682 × 256, but its gradient is the
//! product of two small factors: the inputs of the 64 frames of a step and the gradients of their
//! sums. The descent rotates the factors, which is less work than to rotate the matrix. The steps
//! of these weights are collected along the axes and rotated back once for all, before axes change;
//! until then [`Soap::frames`] adds what they contribute to the first layer's sums.

use super::adam::Adam;
use super::axes::{CHANGE_EVERY, Side, is_due, product, transposed, without_tiny};
use super::gradient::Found;
use super::layers::parts;
use crate::network::Shape;
use forelock_core::lane::Simd;
use rayon::prelude::*;
use std::ops::Range;

/// Decay of Adam's mean and mean square of the gradient, in a step.
const DECAY: [f64; 2] = [0.95, 0.99];
/// The number of the matrix of the shared inputs.
const SHARED: usize = 1;

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
    /// Steps of the shared inputs' weights along their axes, which are not yet in the parameters.
    pending: Vec<f32>,
    /// Buffers of a step: the gradient along the axes, and what the parameters move by.
    turned: Vec<f32>,
    moved: Vec<f32>,
}

/// The gradient of a matrix of weights, as the matrix or as the product of two factors.
#[derive(Clone, Copy)]
enum Gradient<'a> {
    /// `[rows, columns]`.
    Whole(&'a [f32]),
    /// The inputs of the layer and the gradients of its sums, `[frames, width]`.
    Factors(&'a Frames, &'a [f32]),
}

/// What the axes of a matrix follow.
struct Step<'a> {
    /// Steps done, with this one.
    done: u32,
    gradient: Gradient<'a>,
    /// The square of what the gradient is scaled with.
    square: f32,
}

/// The frames of a step, as the weights of the shared inputs see them.
#[derive(Debug)]
pub(super) struct Frames {
    /// Their inputs, `[frames, shared]`.
    pub inputs: Vec<f32>,
    /// The same along the axes.
    along: Vec<f32>,
    /// The first layer's sums of the inputs, `[frames, width]`.
    pub sums: Vec<f32>,
}

/// What [`Soap::resume`] takes: Adam's moments, then covariance and axes of all sides and the
/// pending steps.
pub(super) type State = [Vec<f32>; 3];

impl Gradient<'_> {
    /// GGᵀ of a matrix with so many columns.
    fn left_covariance(&self, simd: Simd, columns: usize) -> Vec<f32> {
        match self {
            Self::Whole(whole) => {
                let transposed = transposed(whole, columns);
                product(simd, &transposed, &transposed, columns)
            }
            Self::Factors(frames, by_sums) => covariance(simd, &frames.inputs, by_sums, columns),
        }
    }

    /// GᵀG of a matrix with so many rows.
    fn right_covariance(&self, simd: Simd, rows: usize) -> Vec<f32> {
        match self {
            Self::Whole(whole) => product(simd, whole, whole, rows),
            Self::Factors(frames, by_sums) => covariance(simd, by_sums, &frames.inputs, rows),
        }
    }

    /// UᵀGV: along the axes.
    fn along_axes(&self, simd: Simd, [left, right]: &[Side; 2]) -> Vec<f32> {
        match self {
            Self::Whole(whole) => {
                let half = product(simd, whole, &left.columns, left.size);
                product(simd, &half, &right.columns, right.size)
            }
            Self::Factors(frames, by_sums) => {
                let by_sums = product(simd, &transposed(by_sums, right.size), &right.columns, right.size);
                product(simd, &frames.along, &by_sums, by_sums.len() / right.size)
            }
        }
    }
}

/// AᵀBBᵀA of A `[count, _]` and B `[count, units]`.
fn covariance(simd: Simd, a: &[f32], b: &[f32], units: usize) -> Vec<f32> {
    let columns = transposed(b, units);
    let of_rows = product(simd, &columns, &columns, units);
    let count = b.len() / units;
    product(simd, a, &product(simd, &of_rows, a, count), count)
}

impl Matrix {
    /// UXVᵀ: back.
    fn back(&self, simd: Simd, x: &[f32]) -> Vec<f32> {
        let [left, right] = &self.sides;
        let half = product(simd, x, &left.rows, left.size);
        product(simd, &half, &right.rows, right.size)
    }

    /// Updates both sides with the gradient of a step. Where the axes change, rotates Adam's
    /// moments to the new ones; the mean square as if its components were uncorrelated.
    fn follow(&mut self, simd: Simd, step: &Step<'_>, [first, second]: [&mut [f32]; 2]) {
        let Step { done, gradient, square } = *step;
        let [left, right] = &mut self.sides;
        let sizes @ [rows, columns] = [left.size, right.size];
        let (of_left, of_right) = rayon::join(
            || {
                left.counts(done)
                    .then(|| left.follow(simd, done, &gradient.left_covariance(simd, columns), square))
            },
            || {
                right
                    .counts(done)
                    .then(|| right.follow(simd, done, &gradient.right_covariance(simd, rows), square))
            },
        );
        let mut changes = [of_left.flatten(), of_right.flatten()];
        if changes.iter().any(Option::is_some) {
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
        Self {
            matrices: std::array::from_fn(matrix),
            adam: Adam::with_decay(DECAY, shape.parameters()),
            pending: vec![0.0; shape.shared * width],
            turned: vec![0.0; shape.parameters()],
            moved: vec![0.0; shape.parameters()],
        }
    }

    /// The frames with these `inputs`, `[frames, shared]`.
    pub(super) fn frames(&self, simd: Simd, parameters: &[f32], inputs: Vec<f32>) -> Frames {
        let Matrix { range, sides: [left, right] } = &self.matrices[SHARED];
        let columns = transposed(&inputs, left.size);
        let along = product(simd, &columns, &left.columns, left.size);
        let pending = product(simd, &transposed(&along, left.size), &self.pending, left.size);
        let pending = product(simd, &transposed(&pending, right.size), &right.rows, right.size);
        let mut sums = product(simd, &columns, &parameters[range.clone()], left.size);
        sums.iter_mut().zip(&pending).for_each(|(sum, x)| *sum += x);
        Frames { inputs, along, sums }
    }

    /// Moves `parameters` along `scale` times the gradient that was found for these `frames`, at
    /// `rate`. Steps of the shared inputs' weights are pending until [`Self::is_settled`].
    pub(super) fn step(
        &mut self,
        simd: Simd,
        parameters: &mut [f32],
        found: Found<'_>,
        frames: &Frames,
        [rate, scale]: [f64; 2],
    ) {
        let ranges = self.matrices.each_ref().map(|matrix| matrix.range.clone());
        let of_matrix = |number: usize| match number {
            SHARED => Gradient::Factors(frames, found.by_frame_sums),
            _ => Gradient::Whole(&found.gradient[ranges[number].clone()]),
        };
        let Self { matrices, adam, pending, turned, moved } = self;
        turned.copy_from_slice(found.gradient);
        let own = matrices.par_iter().zip(parts(turned, ranges.clone()));
        own.enumerate().for_each(|(number, (matrix, turned))| {
            let along = of_matrix(number).along_axes(simd, &matrix.sides);
            turned.iter_mut().zip(&along).for_each(|(x, along)| *x = without_tiny(*along));
        });
        moved.fill(0.0);
        adam.step(moved, turned, [rate, scale]);
        moved.iter_mut().for_each(|x| *x = without_tiny(*x));
        let shared = &mut moved[ranges[SHARED].clone()];
        pending.iter_mut().zip(&*shared).for_each(|(x, moved)| *x += moved);
        shared.fill(0.0);
        let own = matrices.par_iter().zip(parts(moved, ranges.clone()));
        own.enumerate().filter(|(number, _)| *number != SHARED).for_each(|(_, (matrix, moved))| {
            moved.copy_from_slice(&matrix.back(simd, moved));
        });
        parameters.iter_mut().zip(&*moved).for_each(|(p, moved)| *p += moved);
        if self.is_settled() {
            self.settle(simd, parameters);
        }
        let done = self.adam.steps();
        let [first, second] = self.adam.moments_mut().map(|moment| parts(moment, ranges.clone()));
        let own = self.matrices.par_iter_mut().zip(first).zip(second);
        own.enumerate().for_each(|(number, ((matrix, first), second))| {
            let step = Step { done, gradient: of_matrix(number), square: (scale * scale) as f32 };
            matrix.follow(simd, &step, [first, second]);
        });
    }

    /// Whether the last step has left none pending, for axes have changed after it.
    pub(super) fn is_settled(&self) -> bool {
        is_due(self.adam.steps(), CHANGE_EVERY)
    }

    /// Moves `parameters` by the pending steps.
    pub(super) fn settle(&mut self, simd: Simd, parameters: &mut [f32]) {
        let matrix = &self.matrices[SHARED];
        self.pending.iter_mut().for_each(|x| *x = without_tiny(*x));
        let moved = matrix.back(simd, &self.pending);
        parameters[matrix.range.clone()].iter_mut().zip(&moved).for_each(|(p, moved)| *p += moved);
        self.pending.fill(0.0);
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
        let numbers = sides.flat_map(|side| side.covariance.iter().chain(&side.rows));
        [first, second, numbers.chain(&self.pending).copied().collect()]
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
        own.pending = left.to_vec();
        own.adam.resume(steps, [first, second]);
        (lengths == [parameters, parameters, shape.shared * shape.width]).then_some(own)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use crate::train::axes::tests::rotation;

    /// The same gradient as a matrix and as factors.
    #[test]
    fn a_gradient_is_that_of_its_factors() {
        const FRAMES: usize = 7;
        let mut random = Random::new(8);
        let shape = Shape { statics: 2, shared: 19, width: 13, outputs: 3 };
        let mut soap = Soap::new(&shape);
        let matrix = &mut soap.matrices[SHARED];
        for side in &mut matrix.sides {
            side.rows = rotation(&mut random, side.size);
            side.columns = transposed(&side.rows, side.size);
        }
        let mut numbers = |count: usize| -> Vec<f32> { (0..count).map(|_| random.normal() as f32).collect() };
        let (inputs, by_sums) = (numbers(FRAMES * shape.shared), numbers(FRAMES * shape.width));
        let parameters = numbers(shape.parameters());
        let whole = product(Simd::Auto, &inputs, &by_sums, FRAMES);
        let frames = soap.frames(Simd::Auto, &parameters, inputs);
        let of = |gradient: Gradient<'_>| {
            [
                gradient.along_axes(Simd::Auto, &soap.matrices[SHARED].sides),
                gradient.left_covariance(Simd::Auto, shape.width),
                gradient.right_covariance(Simd::Auto, shape.shared),
            ]
            .concat()
        };
        let [of_factors, of_whole] = [Gradient::Factors(&frames, &by_sums), Gradient::Whole(&whole)].map(of);
        for (a, b) in of_factors.iter().zip(&of_whole) {
            assert!((a - b).abs() < 1e-4 * (1.0 + b.abs()), "{a} {b}");
        }
    }

    /// Pending steps count in the first layer's sums as they do once the parameters have them.
    #[test]
    fn pending_steps_count() {
        const FRAMES: usize = 5;
        let mut random = Random::new(9);
        let shape = Shape { statics: 2, shared: 9, width: 8, outputs: 3 };
        let mut soap = Soap::new(&shape);
        let mut numbers = |count: usize| -> Vec<f32> { (0..count).map(|_| random.normal() as f32).collect() };
        let mut parameters = numbers(shape.parameters());
        for step in 1..25 {
            let (inputs, by_frame_sums) = (numbers(FRAMES * shape.shared), numbers(FRAMES * shape.width));
            let gradient = numbers(shape.parameters());
            let found = Found { gradient: &gradient, by_frame_sums: &by_frame_sums };
            let frames = soap.frames(Simd::Auto, &parameters, inputs);
            soap.step(Simd::Auto, &mut parameters, found, &frames, [0.1, 1.0]);
            assert_eq!(soap.is_settled(), soap.pending.iter().all(|x| *x == 0.0), "step {step}");
            let before = soap.frames(Simd::Auto, &parameters, frames.inputs.clone());
            let (mut settled, mut now) = (soap.clone(), parameters.clone());
            settled.settle(Simd::Auto, &mut now);
            let after = settled.frames(Simd::Auto, &now, frames.inputs);
            for (a, b) in before.sums.iter().zip(&after.sums) {
                assert!((a - b).abs() < 1e-4, "step {step}: {a} {b}");
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
            // Each frame has one input, so the first layer's sums are its weights.
            let mut inputs = vec![0.0; shape.shared * shape.shared];
            inputs.iter_mut().step_by(shape.shared + 1).for_each(|x| *x = 1.0);
            let frames = soap.frames(Simd::Auto, &by_soap, inputs);
            let mut now = by_soap.clone();
            now[range.clone()].copy_from_slice(&frames.sums);
            let (_, found) = gradient(&now);
            let found = Found { gradient: &found, by_frame_sums: &found[range.clone()] };
            soap.step(Simd::Auto, &mut by_soap, found, &frames, [rate(step), 1.0]);
            let (_, found) = gradient(&by_adam);
            adam.step(&mut by_adam, &found, [rate(step), 1.0]);
        }
        soap.settle(Simd::Auto, &mut by_soap);
        let [start, soap, adam] = [&start, &by_soap, &by_adam].map(|parameters| gradient(parameters).0);
        println!("{start} at first, {soap} by SOAP, {adam} by Adam");
        assert!(soap < 0.1 * adam && adam < 0.1 * start);
    }
}
