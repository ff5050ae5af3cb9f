//! Displacement of every particle in a frame, in the frame of the head.

use crate::lane::{LANES, Real, Row, widest};
use crate::pose::Pose;
use crate::strands::Model;
use glam::{Mat3, Vec3};
use rayon::prelude::*;

/// Places of a task.
const PLACES: usize = 256;
/// Hair farther from the centre of the groom than this multiple of the groom's rest radius is
/// ignored.
pub const FAR: f32 = 4.0;

/// A box that holds nothing.
const EMPTY: [Vec3; 2] = [Vec3::INFINITY, Vec3::NEG_INFINITY];

/// Coordinates of the particles of a place, axis by axis.
pub(crate) type Place = [[f32; LANES]; 3];

/// Positions of the particles at the start and at the end of the frame, metres in the frame of the
/// head, and their residual motion. The number of a particle is place × [`LANES`] + lane.
#[derive(Debug)]
pub(crate) struct Displacements {
    start: Vec<Place>,
    end: Vec<Place>,
    /// Length of the displacement of each particle relative to the mean motion, metres; by number.
    pub residual_motion: Vec<f32>,
    /// Bounding boxes of the positions at the start and at the end that are not [`FAR`] from the
    /// centre of the model, `[low, high]`.
    boxes: [[Vec3; 2]; 2],
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
            start: vec![[[0.0; LANES]; 3]; model.places()],
            end: vec![[[0.0; LANES]; 3]; model.places()],
            residual_motion: vec![0.0; particles],
            boxes: [EMPTY; 2],
            block,
            longest,
        }
    }

    pub fn bytes(&self) -> usize {
        let places = self.start.capacity() + self.end.capacity();
        places * size_of::<Place>() + 4 * (self.residual_motion.capacity() + self.block.capacity())
    }

    pub fn record_start<T: Real>(&mut self, model: &Model<T>, positions: &[Row<T>], head: &Pose) {
        self.boxes[0] = to_head_frame(model, &self.block, positions, head, &mut self.start);
    }

    pub fn record_end<T: Real>(&mut self, model: &Model<T>, positions: &[Row<T>], head: &Pose) {
        self.boxes[1] = to_head_frame(model, &self.block, positions, head, &mut self.end);
    }

    /// Bounding box of the hair at the start and at the end of the frame.
    pub fn extent(&self) -> [Vec3; 2] {
        let extent = join(self.boxes[0], self.boxes[1]);
        if extent[0].is_finite() { extent } else { [Vec3::ZERO; 2] }
    }

    /// The position of particle `p` at the start of the frame.
    #[inline]
    pub fn start(&self, p: usize) -> Vec3 {
        particle(&self.start, p)
    }

    /// The position of particle `p` at the end of the frame.
    #[inline]
    pub fn end(&self, p: usize) -> Vec3 {
        particle(&self.end, p)
    }

    /// The displacement of particle `p` in the frame.
    #[inline]
    pub fn of(&self, p: usize) -> Vec3 {
        self.end(p) - self.start(p)
    }

    /// The position of particle `p` at a fraction of the frame.
    #[inline]
    pub fn at(&self, p: usize, fraction: f32) -> Vec3 {
        self.start(p) + fraction * self.of(p)
    }

    /// Positions of the particles of a place at the start and at the end of the frame.
    #[inline]
    pub fn place(&self, place: usize) -> [&Place; 2] {
        [&self.start[place], &self.end[place]]
    }

    /// Whether two segments belong to the same strand.
    #[inline]
    pub fn same_strand(&self, a: u32, b: u32) -> bool {
        let (a, b) = (a as usize, b as usize);
        a % LANES == b % LANES && self.block[a / LANES] == self.block[b / LANES]
    }
}

#[inline]
fn particle(places: &[Place], p: usize) -> Vec3 {
    let [x, y, z] = &places[p / LANES];
    Vec3::new(x[p % LANES], y[p % LANES], z[p % LANES])
}

/// The box around two boxes.
fn join(a: [Vec3; 2], b: [Vec3; 2]) -> [Vec3; 2] {
    [a[0].min(b[0]), a[1].max(b[1])]
}

/// Positions in the head's frame: x' = Rᵀ (x − p). Returns the bounding box of those that are not
/// [`FAR`]: distant outliers must not make the nodes of a field coarse. `block` is that of each
/// place.
fn to_head_frame<T: Real>(
    model: &Model<T>,
    block: &[u32],
    positions: &[Row<T>],
    head: &Pose,
    out: &mut [Place],
) -> [Vec3; 2] {
    let back = head.inverse();
    let (turn, shift): (Mat3, Vec3) = (back.matrix().as_mat3(), back.translation.as_vec3());
    let (turn, shift) = (turn.transpose().to_cols_array_2d(), shift.to_array());
    let far = (FAR * model.reach as f32).powi(2);
    debug_assert_eq!(out.len(), model.places());
    let number = |x: T| x.to_f32().unwrap_or(f32::NAN);
    let tasks =
        out.par_chunks_mut(PLACES).zip(positions.par_chunks(3 * PLACES)).zip(block.par_chunks(PLACES));
    let boxes = tasks.map(|((out, positions), block)| {
        let (mut low, mut high) = ([[f32::INFINITY; LANES]; 3], [[f32::NEG_INFINITY; LANES]; 3]);
        widest(
            #[inline(always)]
            || {
                for ((out, x), &block) in out.iter_mut().zip(positions.chunks_exact(3)).zip(block) {
                    let mut squares = [0.0; LANES];
                    for c in 0..3 {
                        for lane in 0..LANES {
                            let (x, y, z) =
                                (number(x[0].0[lane]), number(x[1].0[lane]), number(x[2].0[lane]));
                            let own = turn[c][0] * x + turn[c][1] * y + turn[c][2] * z + shift[c];
                            out[c][lane] = own;
                            squares[lane] += own * own;
                        }
                    }
                    // Lanes without a strand of their own do not count.
                    squares[model.blocks[block as usize].live..].fill(f32::INFINITY);
                    for c in 0..3 {
                        for lane in 0..LANES {
                            let own = out[c][lane];
                            let counts = squares[lane] < far;
                            low[c][lane] = if counts & (own < low[c][lane]) { own } else { low[c][lane] };
                            high[c][lane] = if counts & (own > high[c][lane]) { own } else { high[c][lane] };
                        }
                    }
                }
            },
        );
        let least = |row: [f32; LANES]| row.into_iter().fold(f32::INFINITY, f32::min);
        let most = |row: [f32; LANES]| row.into_iter().fold(f32::NEG_INFINITY, f32::max);
        [Vec3::from_array(low.map(least)), Vec3::from_array(high.map(most))]
    });
    boxes.reduce(|| EMPTY, join)
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
