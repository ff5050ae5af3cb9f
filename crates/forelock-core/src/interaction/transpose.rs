//! Nodes of eight numbers, one register; rows of sixteen samples to nodes, and back.

use crate::lane::LANES;
use std::ops::{Add, Mul};

/// Eight numbers of a node.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C, align(32))]
pub(crate) struct Node(pub [f32; 8]);

impl Add for Node {
    type Output = Self;
    #[inline(always)]
    fn add(mut self, other: Self) -> Self {
        for k in 0..8 {
            self.0[k] += other.0[k];
        }
        self
    }
}

impl Mul<f32> for Node {
    type Output = Self;
    #[inline(always)]
    fn mul(mut self, factor: f32) -> Self {
        for k in 0..8 {
            self.0[k] *= factor;
        }
        self
    }
}

/// One number of each sample in a row.
pub(crate) type Rows = [[f32; LANES]; 8];

/// Number k of node n becomes number n of row k.
#[inline(always)]
pub(crate) fn rows_of_nodes(nodes: &[Node; LANES], rows: &mut Rows) {
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("avx2") {
        for half in [0, 8] {
            // SAFETY: the processor has AVX2; eight nodes and half of a row are touched.
            unsafe {
                let from = std::array::from_fn(|n| nodes[half + n].0.as_ptr());
                let to = rows.each_mut().map(|row| row.as_mut_ptr().add(half));
                x86::transpose(from, to);
            }
        }
        return;
    }
    for (n, node) in nodes.iter().enumerate() {
        for (row, value) in rows.iter_mut().zip(node.0) {
            row[n] = value;
        }
    }
}

/// Number n of row k becomes number k of node n.
#[inline(always)]
pub(crate) fn nodes_of_rows(rows: &Rows, nodes: &mut [Node; LANES]) {
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("avx2") {
        for half in [0, 8] {
            // SAFETY: the processor has AVX2; half of a row and eight nodes are touched.
            unsafe {
                let from = rows.each_ref().map(|row| row.as_ptr().add(half));
                let first = nodes.as_mut_ptr().add(half);
                let to = std::array::from_fn(|n| first.add(n).cast::<f32>());
                x86::transpose(from, to);
            }
        }
        return;
    }
    for (n, node) in nodes.iter_mut().enumerate() {
        for (value, row) in node.0.iter_mut().zip(rows) {
            *value = row[n];
        }
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use std::arch::x86_64::{
        __m256, _mm256_loadu_ps, _mm256_permute2f128_ps, _mm256_shuffle_ps, _mm256_storeu_ps,
        _mm256_unpackhi_ps, _mm256_unpacklo_ps,
    };

    /// Reads eight rows of eight numbers and writes the columns.
    ///
    /// # Safety
    /// The pointers are to eight numbers each; those of `to` may be written.
    #[target_feature(enable = "avx2")]
    #[inline]
    pub unsafe fn transpose(from: [*const f32; 8], to: [*mut f32; 8]) {
        // SAFETY: the caller's promise.
        let m: [__m256; 8] = from.map(|row| unsafe { _mm256_loadu_ps(row) });
        // Pairs of rows, then quadruples, then all eight.
        let low = |a: usize| _mm256_unpacklo_ps(m[a], m[a + 1]);
        let high = |a: usize| _mm256_unpackhi_ps(m[a], m[a + 1]);
        let pairs = [low(0), high(0), low(2), high(2), low(4), high(4), low(6), high(6)];
        let near = |a: usize| _mm256_shuffle_ps::<0x44>(pairs[a], pairs[a + 2]);
        let far = |a: usize| _mm256_shuffle_ps::<0xee>(pairs[a], pairs[a + 2]);
        let quads = [near(0), far(0), near(1), far(1), near(4), far(4), near(5), far(5)];
        for k in 0..4 {
            let below = _mm256_permute2f128_ps::<0x20>(quads[k], quads[k + 4]);
            let above = _mm256_permute2f128_ps::<0x31>(quads[k], quads[k + 4]);
            // SAFETY: the caller's promise.
            unsafe {
                _mm256_storeu_ps(to[k], below);
                _mm256_storeu_ps(to[k + 4], above);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_become_nodes_and_nodes_rows() {
        let rows: Rows = std::array::from_fn(|k| std::array::from_fn(|n| (16 * k + n) as f32));
        let mut nodes = [Node::default(); LANES];
        nodes_of_rows(&rows, &mut nodes);
        for (n, node) in nodes.iter().enumerate() {
            for (k, value) in node.0.into_iter().enumerate() {
                assert_eq!(value, rows[k][n]);
            }
        }
        let mut back = [[0.0; LANES]; 8];
        rows_of_nodes(&nodes, &mut back);
        assert_eq!(back, rows);
    }
}
