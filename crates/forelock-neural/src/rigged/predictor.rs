//! Inference of the network of a rig, on the CPU.
//!
//! # Practice
//! Lanes run along the units of a layer: a row of 16 for each hidden layer, four rows for the 60
//! angles. Sums are split in up to four, so that additions need not wait for each other. A pose
//! takes 0.1 µs where the processor has AVX2.

#![expect(clippy::needless_range_loop, reason = "loops with one index for several arrays vectorise")]

use super::chain::Angles;
use super::network::{HIDDEN, PoseNetwork};
use super::pose::RigPose;
use super::{ANGLES, INPUTS};
use bytemuck::Zeroable;
use forelock_core::lane::{LANES, Lane, Row, Simd, on};

/// Rows of angles.
const LAST: usize = ANGLES.div_ceil(LANES);
/// Rows of the layers: a row of weights for each input, then the biases.
const ROWS: [usize; 3] = [INPUTS + 1, HIDDEN + 1, (HIDDEN + 1) * LAST];
const ALL_ROWS: usize = ROWS[0] + ROWS[1] + ROWS[2];
const _: () = assert!(HIDDEN == LANES, "a hidden layer is a row");

/// A [`PoseNetwork`] made ready for inference.
#[derive(Clone, Debug)]
pub struct PosePredictor {
    simd: Simd,
    rows: Box<[Row<f32>; ALL_ROWS]>,
}

impl PosePredictor {
    /// A predictor of `network`.
    ///
    /// # Panics
    /// If this processor does not support `simd`.
    pub fn new(network: &PoseNetwork<f32>, simd: Simd) -> Self {
        let simd = simd.resolve();
        assert!(simd.is_supported(), "{simd:?} is not supported by this processor");
        let mut rows = Box::new([Row::zeroed(); ALL_ROWS]);
        let (first, rest) = rows.split_at_mut(ROWS[0]);
        let (second, last) = rest.split_at_mut(ROWS[1]);
        let mut weights = network.weights();
        for (rows, units) in [(first, HIDDEN), (second, HIDDEN), (last, ANGLES)] {
            let of_input = units.div_ceil(LANES);
            let (own, others) = weights.split_at(rows.len() / of_input * units);
            for (rows, own) in rows.chunks_exact_mut(of_input).zip(own.chunks_exact(units)) {
                for (row, own) in rows.iter_mut().zip(own.chunks(LANES)) {
                    row.0[..own.len()].copy_from_slice(own);
                }
            }
            weights = others;
        }
        Self { simd, rows }
    }

    /// The angles of the rig in a pose: [`PoseNetwork::angles`] but for roundings.
    pub fn angles(&self, pose: &RigPose<f32>) -> Angles<f32> {
        let simd = self.simd;
        let mut found = [Row::zeroed(); LAST];
        let run = on!(
            simd,
            evaluate(rows: &[Row<f32>; ALL_ROWS], inputs: &[f32; INPUTS], found: &mut [Row<f32>; LAST])
        );
        // SAFETY: the instruction set is supported.
        #[allow(
            unused_unsafe,
            clippy::allow_attributes,
            reason = "only instantiations with features are unsafe"
        )]
        unsafe {
            run(&self.rows, &pose.inputs(), &mut found);
        }
        let mut angles = [0.0; ANGLES];
        for (angles, row) in angles.chunks_mut(LANES).zip(&found) {
            angles.copy_from_slice(&row.0[..angles.len()]);
        }
        angles
    }
}

#[inline(always)]
fn evaluate<L: Lane<Scalar = f32>>(
    rows: &[Row<f32>; ALL_ROWS],
    inputs: &[f32; INPUTS],
    found: &mut [Row<f32>; LAST],
) {
    let (first, rest) = rows.split_at(ROWS[0]);
    let (second, last) = rest.split_at(ROWS[1]);
    let mut hidden = Row::zeroed();
    for lane in (0..LANES).step_by(L::WIDTH) {
        tanh(sums::<L, 2>(first, inputs, lane)).store(&mut hidden, lane);
    }
    let inputs = hidden.0;
    for lane in (0..LANES).step_by(L::WIDTH) {
        tanh(sums::<L, 4>(second, &inputs, lane)).store(&mut hidden, lane);
    }
    for lane in (0..LANES).step_by(L::WIDTH) {
        let (weights, biases) = last.split_at(LAST * HIDDEN);
        let mut sums = [L::zero(); LAST];
        for r in 0..LAST {
            sums[r] = L::load(&biases[r], lane);
        }
        for (rows, x) in weights.chunks_exact(LAST).zip(hidden.0) {
            for r in 0..LAST {
                sums[r] = L::splat(x).mul_add(L::load(&rows[r], lane), sums[r]);
            }
        }
        for r in 0..LAST {
            sums[r].store(&mut found[r], lane);
        }
    }
}

/// x W + b in the lanes from `lane` on, in `N` partial sums.
#[inline(always)]
fn sums<L: Lane<Scalar = f32>, const N: usize>(rows: &[Row<f32>], x: &[f32], lane: usize) -> L {
    let (weights, bias) = rows.split_at(x.len());
    let mut sums = [L::zero(); N];
    sums[0] = L::load(&bias[0], lane);
    for i in 0..x.len() {
        sums[i % N] = L::splat(x[i]).mul_add(L::load(&weights[i], lane), sums[i % N]);
    }
    let mut sum = sums[0];
    for n in 1..N {
        sum += sums[n];
    }
    sum
}

/// The tanh of [`PoseNetwork`] in float32: with a/b for tanh z, tanh 2z = 2ab/(a² + b²), so that it
/// takes one division.
#[inline(always)]
fn tanh<L: Lane<Scalar = f32>>(x: L) -> L {
    let z = x.max(L::from_f64(-9.0)).min(L::from_f64(9.0)) * L::from_f64(0.25);
    let q = z * z;
    let constant = L::from_f64;
    let above = (q + constant(378.0)).mul_add(q, constant(17_325.0)).mul_add(q, constant(135_135.0));
    let below = q.mul_add(constant(28.0), constant(3150.0)).mul_add(q, constant(62_370.0));
    let (a, b) = (z * above, below.mul_add(q, constant(135_135.0)));
    let (a, b) = ((a + a) * b, a.mul_add(a, b * b));
    ((a + a) * b) / a.mul_add(a, b * b)
}
