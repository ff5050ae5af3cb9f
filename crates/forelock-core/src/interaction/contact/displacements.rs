//! Displacement of every particle in a frame, in the frame of the head.

#![expect(clippy::needless_range_loop, reason = "one index for several arrays is what vectorises")]

use crate::lane::{LANES, Real, Row};
use crate::pose::Pose;
use crate::strands::Model;
use glam::{Mat3, Vec3};
use rayon::prelude::*;

/// Positions of the particles at the start and at the end of the frame, metres in the frame of the
/// head, and their residual motion. Indexed by particle number: place × [`LANES`] + lane.
#[derive(Debug)]
pub(crate) struct Displacements {
    pub start: Vec<Vec3>,
    pub end: Vec<Vec3>,
    /// Length of the displacement of each particle relative to the mean motion, metres.
    pub residual_motion: Vec<f32>,
    /// The block of each place.
    pub block: Vec<u32>,
    /// The longest edge at rest, metres.
    pub longest: f32,
}

impl Displacements {
    pub fn new<T: Real>(model: &Model<T>) -> Self {
        let block = model.block_of_places();
        let particles = LANES * model.places();
        let lengths = model.rest_lengths.iter().step_by(3).flat_map(|row| row.0);
        let longest = lengths.filter_map(|l| l.to_f32()).fold(0.0, f32::max);
        Self {
            start: vec![Vec3::ZERO; particles],
            end: vec![Vec3::ZERO; particles],
            residual_motion: vec![0.0; particles],
            block,
            longest,
        }
    }

    pub fn bytes(&self) -> usize {
        28 * self.start.capacity() + 4 * self.block.capacity()
    }

    pub fn record_start<T: Real>(&mut self, model: &Model<T>, positions: &[Row<T>], head: &Pose) {
        to_head_frame(model, positions, head, &mut self.start);
    }

    pub fn record_end<T: Real>(&mut self, model: &Model<T>, positions: &[Row<T>], head: &Pose) {
        to_head_frame(model, positions, head, &mut self.end);
    }

    /// The displacement of particle `p` in the frame.
    #[inline]
    pub fn of(&self, p: usize) -> Vec3 {
        self.end[p] - self.start[p]
    }

    /// The position of particle `p` at a fraction of the frame.
    #[inline]
    pub fn at(&self, p: usize, fraction: f32) -> Vec3 {
        self.start[p] + fraction * self.of(p)
    }

    /// Positions of the particles of a place at the start and at the end of the frame, axis by axis.
    #[inline(always)]
    pub fn rows(&self, place: usize) -> [[[f32; LANES]; 3]; 2] {
        [&self.start, &self.end].map(|positions| {
            let own = &positions[LANES * place..LANES * (place + 1)];
            let mut rows = [[0.0; LANES]; 3];
            for lane in 0..LANES {
                let [x, y, z] = own[lane].to_array();
                (rows[0][lane], rows[1][lane], rows[2][lane]) = (x, y, z);
            }
            rows
        })
    }

    /// Whether two segments belong to the same strand.
    #[inline]
    pub fn same_strand(&self, a: u32, b: u32) -> bool {
        let (a, b) = (a as usize, b as usize);
        a % LANES == b % LANES && self.block[a / LANES] == self.block[b / LANES]
    }
}

/// Positions in the head's frame: x' = Rᵀ (x − p).
fn to_head_frame<T: Real>(model: &Model<T>, positions: &[Row<T>], head: &Pose, out: &mut [Vec3]) {
    let back = head.inverse();
    let (turn, shift): (Mat3, Vec3) = (back.matrix().as_mat3(), back.translation.as_vec3());
    debug_assert_eq!(out.len(), LANES * model.places());
    out.par_chunks_mut(LANES).zip(positions.par_chunks(3)).with_min_len(256).for_each(|(out, x)| {
        let number = |x: T| x.to_f32().unwrap_or(f32::NAN);
        for (lane, out) in out.iter_mut().enumerate() {
            let x = Vec3::new(number(x[0].0[lane]), number(x[1].0[lane]), number(x[2].0[lane]));
            *out = turn * x + shift;
        }
    });
}

/// The nearest points of two segments: the fraction along each, and the vector from the second
/// point to the first.
///
/// The minimum over the line of the first segment is clamped to the second, then projected back
/// (Ericson 2005, Sec. 5.1.9).
#[inline]
pub(crate) fn closest(a: [Vec3; 2], b: [Vec3; 2]) -> ([f32; 2], Vec3) {
    let (ea, eb, r) = (a[1] - a[0], b[1] - b[0], a[0] - b[0]);
    let (aa, bb, ab) = (ea.length_squared().max(1e-20), eb.length_squared().max(1e-20), ea.dot(eb));
    let (ar, br) = (ea.dot(r), eb.dot(r));
    let across = (aa * bb - ab * ab).max(1e-6 * aa * bb);
    let s = ((ab * br - ar * bb) / across).clamp(0.0, 1.0);
    let t = ((ab * s + br) / bb).clamp(0.0, 1.0);
    let s = ((ab * t - ar) / aa).clamp(0.0, 1.0);
    ([s, t], r + s * ea - t * eb)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nearest_points_are_no_farther_than_any() {
        let mut seed = 1u32;
        let mut next = || {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (seed >> 8) as f32 / 16_777_216.0
        };
        let mut point = || Vec3::new(next(), next(), next());
        for _ in 0..2000 {
            let (a, b) = ([point(), point()], [point(), point()]);
            let ([s, t], r) = closest(a, b);
            let apart = |s: f32, t: f32| a[0].lerp(a[1], s).distance(b[0].lerp(b[1], t));
            assert!((apart(s, t) - r.length()).abs() < 1e-5);
            for k in 0..=400 {
                let (u, v) = ((k % 21) as f32 / 20.0, (k / 21) as f32 / 20.0);
                assert!(r.length() <= apart(u, v.min(1.0)) + 1e-4, "{a:?} {b:?}");
            }
        }
    }
}
