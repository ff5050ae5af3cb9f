//! Mean motion: a smooth field of the displacements of the hair in a frame.

#![expect(clippy::needless_range_loop, reason = "one index for several arrays is what vectorises")]

pub use super::displacements::FAR;
use super::displacements::{Displacements, ORIGIN, OUTSIDE, Place, square};
use super::histogram::{Cutoff, Histogram};
use crate::interaction::transpose::{Node, rows_of_nodes};
use crate::lane::{LANES, Lane, Real, Row, Simd, V3, on, widest};
use crate::scratch::fill;
use crate::strands::Model;
use glam::{Vec3, Vec4};
use rayon::prelude::*;
use std::cmp::Ordering;

/// Minimum distance between nodes, metres.
pub const SPACING: f32 = 0.03;
/// Minimum distance between nodes for the search of contacts, over the longest edge.
pub const SPACING_PER_EDGE: f32 = 4.0;
/// Maximum number of nodes along an axis.
pub const NODES: usize = 48;
/// Number of partial sums; it is fixed so that sums do not depend on the number of threads.
pub(super) const PARTS: usize = 16;
/// Nodes of a task.
const TASK: usize = 512;
/// Stride of the lanes that are summed.
pub const EVERY: usize = 8;

/// 2²³: float32 from there on are whole, and below twice that their last bits are the excess.
const ROUNDER: f32 = 8_388_608.0;
/// The bits of that excess.
const MANTISSA: u32 = (1 << 23) - 1;

/// Trilinear field of displacements a frame, on a grid of nodes.
#[derive(Debug, Default)]
pub(crate) struct MeanMotion {
    /// Minimum distance between nodes, metres.
    least_spacing: f32,
    low: Vec3,
    /// Inverse of the distance between nodes.
    inverse: f32,
    dims: [usize; 3],
    /// Σ w Δx, Σ w; then the mean over each node and its neighbours.
    nodes: Vec<Vec4>,
    parts: Vec<Vec<Vec4>>,
    /// Histograms of the residual motion of the particles; the first becomes the sum.
    part_histograms: Vec<Histogram>,
    /// Root mean square of the residual motion, metres.
    pub rms_residual: f32,
    /// Largest residual motion, metres.
    pub largest_residual: f32,
    /// Bounding box of the hair at the start and at the end of the frame.
    pub extent: [Vec3; 2],
}

/// The node below a point, and the fraction along each axis.
struct Corner {
    node: [usize; 3],
    fraction: Vec3,
}

/// Selects the particles of the largest residual motion: see [`MeanMotion::largest_residuals`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct LargestResiduals {
    /// Residual motion below which no particle is selected, metres.
    pub least: f32,
    last_bin: Cutoff,
    /// Fraction of the particles in the last bin that are selected.
    share: f32,
}

impl LargestResiduals {
    /// No particle of a smaller residual motion is selected, metres.
    pub fn floor(&self) -> f32 {
        self.least.max(self.last_bin.floor())
    }

    /// Whether the particle `a` with the given residual motion is selected; of the last bin an
    /// evenly spread fraction is.
    #[inline]
    pub fn includes(&self, a: usize, residual_motion: f32) -> bool {
        // The fractional parts of the multiples of the golden ratio are evenly distributed.
        let chance = (a as u32).wrapping_mul(0x9e37_79b9) as f32 * (0.5f32).powi(32);
        residual_motion > self.least
            && match self.last_bin.compare(residual_motion) {
                Ordering::Greater => true,
                Ordering::Equal => chance < self.share,
                Ordering::Less => false,
            }
    }
}

/// Writes the sum of the `parts` at each node to `nodes`, in the order of the parts.
pub(super) fn sum_parts(parts: &[Vec<Vec4>], nodes: &mut Vec<Vec4>) {
    fill(nodes, parts.first().map_or(0, Vec::len), Vec4::ZERO);
    nodes.par_chunks_mut(TASK).enumerate().for_each(|(k, sums)| {
        for part in parts {
            sums.iter_mut().zip(&part[TASK * k..]).for_each(|(sum, own)| *sum += *own);
        }
    });
}

impl MeanMotion {
    /// A field whose nodes are at least `least_spacing` apart, metres.
    pub fn new(least_spacing: f32) -> Self {
        Self { least_spacing, ..Self::default() }
    }

    /// A field for the search of contacts between edges of up to `longest` metres.
    pub fn for_edges(longest: f32) -> Self {
        Self::new(SPACING.max(SPACING_PER_EDGE * longest))
    }

    pub fn bytes(&self) -> usize {
        let nodes = 16 * (self.nodes.capacity() + self.parts.iter().map(Vec::capacity).sum::<usize>());
        nodes + self.part_histograms.iter().map(Histogram::bytes).sum::<usize>()
    }

    /// Measures the field, and the residual motion of every particle. Particles can be selected by
    /// residual motions of more than `least`, metres.
    pub fn measure<T: Real>(&mut self, model: &Model<T>, displacements: &mut Displacements, least: f32) {
        self.measure_field(model, displacements);
        self.measure_residual_motion(model, displacements, least);
    }

    /// The number of nodes.
    pub fn count(&self) -> usize {
        self.dims.iter().product()
    }

    /// Measures the field.
    fn measure_field<T: Real>(&mut self, model: &Model<T>, displacements: &Displacements) {
        self.fit(displacements);
        let count = self.count();
        let per_part = model.places().div_ceil(PARTS).max(1);
        self.parts.resize_with(PARTS, Vec::new);
        let mut parts = std::mem::take(&mut self.parts);
        parts.par_iter_mut().enumerate().for_each(|(k, nodes)| {
            fill(nodes, count, Vec4::ZERO);
            widest(
                #[inline(always)]
                || {
                    for place in k * per_part..((k + 1) * per_part).min(model.places()) {
                        let live = model.blocks[displacements.block[place] as usize].live;
                        self.add_place(nodes, displacements.place(place), live);
                    }
                },
            );
        });
        sum_parts(&parts, &mut self.nodes);
        self.smooth(&mut parts[0]);
        self.parts = parts;
    }

    /// The residual motion that at most `most` particles exceed, to an eighth, metres; about zero
    /// if it is less than the least that was measured.
    pub fn exceeded_by(&self, most: usize) -> f32 {
        self.part_histograms[0].cutoff(most).bound()
    }

    /// Selects the `most` particles of the largest residual motion among those that exceed `least`
    /// metres, which is not less than the least that was measured.
    pub fn largest_residuals(&self, most: usize, least: f32) -> LargestResiduals {
        let last = self.part_histograms[0].cutoff(most);
        let share = if last.count == 0 { 1.0 } else { last.selected as f32 / last.count as f32 };
        LargestResiduals { least, last_bin: last, share }
    }

    /// Fits the box to the start and end positions of all particles, and the nodes to the box.
    pub(super) fn fit(&mut self, displacements: &Displacements) {
        self.extent = displacements.extent();
        let side = (self.extent[1] - self.extent[0]).max_element();
        self.inverse = 1.0 / self.least_spacing.max(side / (NODES - 2) as f32);
        self.low = self.extent[0];
        let nodes = (self.extent[1] - self.low) * self.inverse;
        self.dims = nodes.to_array().map(|nodes| (nodes as usize + 2).min(NODES + 1));
    }

    #[inline(always)]
    fn holds(&self, at: Vec3) -> bool {
        at.cmpge(self.extent[0]).all() && at.cmple(self.extent[1]).all()
    }

    #[inline(always)]
    fn index(&self, node: [usize; 3]) -> usize {
        node[0] + self.dims[0] * (node[1] + self.dims[1] * node[2])
    }

    #[inline(always)]
    fn corner(&self, at: Vec3) -> Corner {
        let u = ((at - self.low) * self.inverse).max(Vec3::ZERO);
        let node = |u: f32, nodes: usize| (u as usize).min(nodes - 2);
        let [x, y, z] = [node(u.x, self.dims[0]), node(u.y, self.dims[1]), node(u.z, self.dims[2])];
        let below = Vec3::new(x as f32, y as f32, z as f32);
        Corner { node: [x, y, z], fraction: (u - below).min(Vec3::ONE) }
    }

    /// Adds the displacements of every [`EVERY`]th of the first `live` particles of a place to
    /// `nodes`. Particles outside the box would count at its boundary, so they are left out.
    #[inline(always)]
    fn add_place(&self, nodes: &mut [Vec4], [start, end]: [&Place; 2], live: usize) {
        for lane in (0..live).step_by(EVERY) {
            let [start, end] =
                [start, end].map(|row| Vec3::new(row[0].0[lane], row[1].0[lane], row[2].0[lane]));
            if self.holds(start) && self.holds(end) {
                let displacement = end - start;
                self.add(nodes, start + 0.5 * displacement, displacement.extend(1.0));
            }
        }
    }

    /// Where the nodes around a point are among the numbers of all nodes, four each: the index of
    /// the first number of the node below it; the fraction along the first axis; and, for each
    /// pair of nodes along that axis, its offset from there and its weight.
    #[inline(always)]
    fn pairs(&self, at: Vec3) -> (usize, f32, [(usize, f32); 4]) {
        let Corner { node, fraction: f } = self.corner(at);
        let (y, z) = (4 * self.dims[0], 4 * self.dims[0] * self.dims[1]);
        let g = 1.0 - f;
        let pairs = [(0, g.y * g.z), (y, f.y * g.z), (z, g.y * f.z), (y + z, f.y * f.z)];
        (4 * self.index(node), f.x, pairs)
    }

    /// Distributes `value` to the `nodes` around a point.
    #[inline(always)]
    pub fn add(&self, nodes: &mut [Vec4], at: Vec3, value: Vec4) {
        let (first, x, pairs) = self.pairs(at);
        let numbers: &mut [f32] = bytemuck::cast_slice_mut(nodes);
        let (low, high) = ((1.0 - x) * value, x * value);
        let both = [low.x, low.y, low.z, low.w, high.x, high.y, high.z, high.w];
        for (pair, weight) in pairs {
            let pair = &mut numbers[first + pair..][..8];
            for c in 0..8 {
                pair[c] += weight * both[c];
            }
        }
    }

    /// The value of `nodes` at a point.
    #[inline(always)]
    pub fn interpolate(&self, nodes: &[Vec4], at: Vec3) -> Vec4 {
        let (first, x, pairs) = self.pairs(at);
        let numbers: &[f32] = bytemuck::cast_slice(nodes);
        let mut sum = [0.0f32; 8];
        for (pair, weight) in pairs {
            let pair = &numbers[first + pair..][..8];
            for c in 0..8 {
                sum[c] += weight * pair[c];
            }
        }
        let [low, high] = [Vec4::from_slice(&sum[..4]), Vec4::from_slice(&sum[4..])];
        low + x * (high - low)
    }

    /// Replaces the sums at each node by the mean over the node and its neighbours; `work` is a
    /// buffer.
    fn smooth(&mut self, work: &mut Vec<Vec4>) {
        let mut stride = 1;
        for length in self.dims {
            work.clone_from(&self.nodes);
            let lines = self.nodes.chunks_exact_mut(length * stride);
            for (sums, from) in lines.zip(work.chunks_exact(length * stride)) {
                // Nodes beside each other along the axis are `stride` apart.
                sums[stride..].iter_mut().zip(from).for_each(|(sum, beside)| *sum += *beside);
                sums.iter_mut().zip(&from[stride..]).for_each(|(sum, beside)| *sum += *beside);
            }
            stride *= length;
        }
        for sum in &mut self.nodes {
            *sum /= sum.w.max(f32::MIN_POSITIVE);
        }
    }

    /// Writes the displacement of each particle of a place relative to the mean motion, metres.
    #[inline(always)]
    pub fn residual<L: Lane<Scalar = f32>>(
        &self,
        displacements: &Displacements,
        place: usize,
        residual: &mut Place,
    ) {
        let [start, end] = displacements.place(place);
        let strides = [1, self.dims[0], self.dims[0] * self.dims[1]];
        let row = Row([0.0f32; LANES]);
        // The node below the middle of each displacement, in the last bits of a float; the weights
        // of four pairs of nodes, and the fraction along the first axis.
        let (mut nodes, mut weights, mut fractions) = (row, [row; 4], row);
        for first in (0..LANES).step_by(L::WIDTH) {
            let middle = (V3::<L>::load(start, 0, first) + V3::load(end, 0, first)).scale(L::splat(0.5));
            let (rounder, one) = (L::splat(ROUNDER), L::one());
            let (mut node, mut fraction) = (rounder, [L::zero(); 3]);
            for c in 0..3 {
                let last = L::splat((self.dims[c] - 2) as f32);
                let u = (middle.0[c] - L::splat(self.low[c])) * L::splat(self.inverse);
                // A number added to 2²³ is rounded to a whole one. If the two nodes beside it are
                // as near, either will do.
                let below = (u - L::splat(0.5)).max(L::zero()).min(last) + rounder - rounder;
                fraction[c] = (u - below).max(L::zero()).min(one);
                node += L::splat(strides[c] as f32) * below;
            }
            node.store(&mut nodes, first);
            let [x, y, z] = fraction;
            let of_pairs = [(one - y) * (one - z), y * (one - z), (one - y) * z, y * z];
            for k in 0..4 {
                of_pairs[k].store(&mut weights[k], first);
            }
            x.store(&mut fractions, first);
        }
        // Two nodes that are neighbours along the first axis are one register.
        let pairs = [0, 4 * strides[1], 4 * strides[2], 4 * (strides[1] + strides[2])];
        let numbers: &[f32] = bytemuck::cast_slice(&self.nodes);
        let mut means = [Node::default(); LANES];
        for lane in 0..LANES {
            let first = 4 * (nodes.0[lane].to_bits() & MANTISSA) as usize;
            let near = &numbers[first..first + pairs[3] + 8];
            let mut sum = [0.0f32; 8];
            for k in 0..4 {
                let pair = &near[pairs[k]..pairs[k] + 8];
                for c in 0..8 {
                    sum[c] += weights[k].0[lane] * pair[c];
                }
            }
            means[lane] = Node(sum);
        }
        let mut rows = [row; 8];
        rows_of_nodes(&means, bytemuck::cast_mut(&mut rows));
        for first in (0..LANES).step_by(L::WIDTH) {
            let x = L::load(&fractions, first);
            for c in 0..3 {
                let (low, high) = (L::load(&rows[c], first), L::load(&rows[4 + c], first));
                let mean = low + x * (high - low);
                let displacement = L::load(&end[c], first) - L::load(&start[c], first);
                (displacement - mean).store(&mut residual[c], first);
            }
        }
    }

    fn measure_residual_motion<T: Real>(
        &mut self,
        model: &Model<T>,
        displacements: &mut Displacements,
        least: f32,
    ) {
        let per_part = model.places().div_ceil(PARTS).max(1);
        let mut residual_motion = std::mem::take(&mut displacements.residual_motion);
        let now = &*displacements;
        let mut sums = [(0.0, 0.0); PARTS];
        let mut histograms = std::mem::take(&mut self.part_histograms);
        histograms.resize_with(PARTS, Histogram::default);
        let field = &*self;
        let measure = measure_for(Simd::up_to_eight());
        residual_motion.par_chunks_mut(per_part).zip(&mut sums).zip(&mut histograms).enumerate().for_each(
            |(k, ((residual_motion, sums), histograms))| {
                histograms.clear();
                let mut squares = [0.0f64; LANES];
                let mut most = 0.0f32;
                for (residual_motion, place) in residual_motion.iter_mut().zip(k * per_part..) {
                    let live = model.blocks[now.block[place] as usize].live;
                    // SAFETY: the processor supports what `up_to_eight` returns.
                    let fastest = unsafe { measure(field, now, [place, live], residual_motion) };
                    for (sum, x) in squares.iter_mut().zip(residual_motion.0) {
                        *sum += f64::from(x) * f64::from(x);
                    }
                    most = most.max(fastest);
                    if fastest > least {
                        residual_motion
                            .0
                            .iter()
                            .filter(|own| **own > least)
                            .for_each(|own| histograms.add(*own));
                    }
                }
                *sums = (squares.iter().sum(), most);
            },
        );
        displacements.residual_motion = residual_motion;
        if let [all, others @ ..] = &mut *histograms {
            others.iter().for_each(|other| all.merge(other));
        }
        self.part_histograms = histograms;
        let squares = sums.iter().map(|s| s.0).sum::<f64>();
        self.rms_residual = ((squares / model.particle_count.max(1) as f64).sqrt()) as f32;
        self.largest_residual = sums.iter().map(|s| s.1).fold(0.0, f32::max);
    }
}

/// Writes the length of the displacement relative to the mean motion of each particle of a place,
/// given its number and its number of strands, metres: 0 in other lanes, and where it is not
/// finite. Returns the largest.
///
/// # Safety
/// The processor must support the instruction set of the function.
type Measure = unsafe fn(&MeanMotion, &Displacements, [usize; 2], &mut Row<f32>) -> f32;

/// The function for `simd`, which the processor must support.
#[inline(never)]
fn measure_for(simd: Simd) -> Measure {
    on!(simd, measure_place(field: &MeanMotion, displacements: &Displacements, at: [usize; 2],
        residual_motion: &mut Row<f32>) -> f32)
}

#[inline(always)]
fn measure_place<L: Lane<Scalar = f32>>(
    field: &MeanMotion,
    displacements: &Displacements,
    [place, live]: [usize; 2],
    residual_motion: &mut Row<f32>,
) -> f32 {
    let mut residual = ORIGIN;
    field.residual::<L>(displacements, place, &mut residual);
    let mut fastest = L::zero();
    for first in (0..LANES).step_by(L::WIDTH) {
        let square = square(V3::<L>::load(&residual, 0, first)) + L::load(&OUTSIDE[live], first);
        let length = L::select(square.lt(L::splat(f32::INFINITY)), square.sqrt(), L::zero());
        length.store(residual_motion, first);
        fastest = fastest.max(length);
    }
    let mut most = 0.0;
    for lane in 0..L::WIDTH {
        let own = fastest.get(lane);
        most = if own > most { own } else { most };
    }
    most
}
