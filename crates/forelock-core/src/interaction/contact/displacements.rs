//! Displacement of every particle in a frame, in the frame of the head.

use crate::lane::{LANES, Lane, Real, Row, Simd, V3, on};
use crate::pose::Pose;
use crate::strands::Model;
use glam::Vec3;
use rayon::prelude::*;

/// Places of a task.
const PLACES: usize = 256;
/// Hair farther from the centre of the groom than this multiple of the groom's rest radius is
/// ignored.
pub const FAR: f32 = 4.0;

/// A box that holds nothing.
const EMPTY: [Vec3; 2] = [Vec3::INFINITY, Vec3::NEG_INFINITY];

/// Coordinates of the particles of a place, axis by axis.
pub(crate) type Place = [Row<f32>; 3];
/// Zeros.
pub(super) const ORIGIN: Place = [Row([0.0; LANES]); 3];

/// Positions of the particles at the start and at the end of the frame, metres in the frame of the
/// head, and their residual motion. The number of a particle is place × [`LANES`] + lane.
#[derive(Debug)]
pub(crate) struct Displacements {
    start: Vec<Place>,
    end: Vec<Place>,
    /// Length of the displacement of each particle relative to the mean motion, metres; a row a
    /// place.
    pub residual_motion: Vec<Row<f32>>,
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
        let lengths = model.rest_lengths.iter().step_by(3).flat_map(|row| row.0);
        let longest = lengths.filter_map(|l| l.to_f32()).fold(0.0, f32::max);
        Self {
            start: vec![ORIGIN; model.places()],
            end: vec![ORIGIN; model.places()],
            residual_motion: vec![Row([0.0; LANES]); model.places()],
            boxes: [EMPTY; 2],
            block,
            longest,
        }
    }

    pub fn bytes(&self) -> usize {
        let places = self.start.capacity() + self.end.capacity();
        places * size_of::<Place>() + size_of_val(&*self.residual_motion) + 4 * self.block.capacity()
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

    /// Positions of the particles of a place at the start and at the end of the frame.
    #[inline]
    pub fn place(&self, place: usize) -> [&Place; 2] {
        [&self.start[place], &self.end[place]]
    }

    /// The larger residual motion of the two particles of segment `a`, metres.
    #[inline]
    pub fn residual_of_segment(&self, a: usize) -> f32 {
        let [lower, upper] = [0, 1].map(|k| self.residual_motion[a / LANES + k].0[a % LANES]);
        lower.max(upper)
    }
}

/// |x|² without fused operations, so that every instruction set rounds alike.
#[inline(always)]
pub(super) fn square<L: Lane>(x: V3<L>) -> L {
    let [x, y, z] = x.0;
    x * x + y * y + z * z
}

#[inline]
fn particle(places: &[Place], p: usize) -> Vec3 {
    let [x, y, z] = &places[p / LANES];
    Vec3::new(x.0[p % LANES], y.0[p % LANES], z.0[p % LANES])
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
    debug_assert_eq!(out.len(), model.places());
    let back = head.inverse();
    let turn = back.matrix().as_mat3().transpose().to_cols_array_2d();
    let far = (FAR * model.reach as f32).powi(2);
    let frame = HeadFrame { turn, shift: back.translation.as_vec3().to_array(), far };
    let transform = transform_for(Simd::Auto.resolve());
    let tasks =
        out.par_chunks_mut(PLACES).zip(positions.par_chunks(3 * PLACES)).zip(block.par_chunks(PLACES));
    let boxes = tasks.map(|((out, positions), block)| {
        let mut live = [0; PLACES];
        live.iter_mut().zip(block).for_each(|(live, &block)| *live = model.blocks[block as usize].live);
        let is_f32 = size_of::<T>() == size_of::<f32>();
        let mut buffer;
        let rows = if is_f32 {
            bytemuck::cast_slice(positions)
        } else {
            buffer = [Row([0.0; LANES]); 3 * PLACES];
            buffer.iter_mut().zip(positions).for_each(|(row, own)| *row = round(own));
            &buffer[..positions.len()]
        };
        // SAFETY: `transform_for` returns only functions that the processor supports.
        let [low, high] = unsafe { transform(&frame, rows, &live, out) };
        let least = |row: Row<f32>| row.0.into_iter().fold(f32::INFINITY, f32::min);
        let most = |row: Row<f32>| row.0.into_iter().fold(f32::NEG_INFINITY, f32::max);
        [Vec3::from_array(low.map(least)), Vec3::from_array(high.map(most))]
    });
    boxes.reduce(|| EMPTY, join)
}

/// The numbers of a row in float32.
fn round<T: Real>(row: &Row<T>) -> Row<f32> {
    Row(row.0.map(|x| x.to_f32().unwrap_or(f32::NAN)))
}

/// How positions get into the frame of the head.
#[derive(Clone, Copy, Debug)]
struct HeadFrame {
    /// Rows of the rotation.
    turn: [[f32; 3]; 3],
    shift: [f32; 3],
    /// Square of the distance from which on positions do not count in the bounding box.
    far: f32,
}

/// Writes positions of places, three rows each, in the frame of the head, given how many lanes of
/// each place hold a strand. Returns one bounding box a lane: lower corners, then upper corners.
///
/// # Safety
/// The processor must support the instruction set of the function.
type Transform = unsafe fn(&HeadFrame, &[Row<f32>], &[usize], &mut [Place]) -> [[Row<f32>; 3]; 2];

/// The function for `simd`, which is supported.
#[inline(never)]
fn transform_for(simd: Simd) -> Transform {
    on!(simd, transform(frame: &HeadFrame, positions: &[Row<f32>], live: &[usize], out: &mut [Place])
        -> [[Row<f32>; 3]; 2])
}

/// For each number of lanes with a strand what is added to the squared distances of a row: 0 in
/// these lanes, infinity in the others.
pub(super) const OUTSIDE: [Row<f32>; LANES + 1] = {
    let mut rows = [Row([0.0; LANES]); LANES + 1];
    let mut live = 0;
    while live < LANES {
        let mut lane = live;
        while lane < LANES {
            rows[live].0[lane] = f32::INFINITY;
            lane += 1;
        }
        live += 1;
    }
    rows
};

#[inline(always)]
fn transform<L: Lane<Scalar = f32>>(
    frame: &HeadFrame,
    positions: &[Row<f32>],
    live: &[usize],
    out: &mut [Place],
) -> [[Row<f32>; 3]; 2] {
    let none = [Row([f32::INFINITY; LANES]), Row([f32::NEG_INFINITY; LANES])];
    let mut bounds = none.map(|row| [row; 3]);
    let far = L::splat(frame.far);
    for first in (0..LANES).step_by(L::WIDTH) {
        let mut low = [L::splat(f32::INFINITY); 3];
        let mut high = [L::splat(f32::NEG_INFINITY); 3];
        for ((out, rows), &live) in out.iter_mut().zip(positions.chunks_exact(3)).zip(live) {
            let [x, y, z] = [L::load(&rows[0], first), L::load(&rows[1], first), L::load(&rows[2], first)];
            let mut own = [L::zero(); 3];
            let mut square = L::load(&OUTSIDE[live], first);
            for c in 0..3 {
                let [tx, ty, tz] = frame.turn[c];
                own[c] = L::splat(tx) * x + L::splat(ty) * y + L::splat(tz) * z + L::splat(frame.shift[c]);
                square += own[c] * own[c];
                own[c].store(&mut out[c], first);
            }
            let counts = square.lt(far);
            for c in 0..3 {
                // The minimum and the maximum of NaN and a number are the number.
                let own = L::select(counts, own[c], L::splat(f32::NAN));
                low[c] = own.min(low[c]);
                high[c] = own.max(high[c]);
            }
        }
        for c in 0..3 {
            low[c].store(&mut bounds[0][c], first);
            high[c].store(&mut bounds[1][c], first);
        }
    }
    bounds
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
