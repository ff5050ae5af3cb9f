//! Mean motion: a smooth field of the displacements of the hair in a frame.

use super::Displacements;
use super::histogram::{Cutoff, Histogram};
use crate::lane::{LANES, Real};
use crate::scratch::fill;
use crate::strands::Model;
use glam::{Vec3, Vec4};
use rayon::prelude::*;
use std::cmp::Ordering;

/// Minimum distance between nodes, metres.
pub const SPACING: f32 = 0.03;
/// Hair farther from the centre of the groom than this multiple of the groom's rest radius is
/// ignored.
pub const FAR: f32 = 4.0;
/// Maximum number of nodes along an axis.
pub const NODES: usize = 48;
/// Number of partial sums; it is fixed so that sums do not depend on the number of threads.
const PARTS: usize = 16;
/// Stride of the lanes that are summed.
pub const EVERY: usize = 4;

/// Trilinear field of displacements a frame, on a grid of nodes.
#[derive(Debug, Default)]
pub(crate) struct MeanMotion {
    low: Vec3,
    spacing: f32,
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

impl MeanMotion {
    pub fn bytes(&self) -> usize {
        let nodes = 16 * (self.nodes.capacity() + self.parts.iter().map(Vec::capacity).sum::<usize>());
        nodes + self.part_histograms.iter().map(Histogram::bytes).sum::<usize>()
    }

    /// Measures the field, and the residual motion of every particle.
    pub fn measure<T: Real>(&mut self, model: &Model<T>, displacements: &mut Displacements) {
        self.fit(model, displacements);
        let count = self.dims.iter().product();
        let per_part = model.places().div_ceil(PARTS).max(1);
        self.parts.resize_with(PARTS, Vec::new);
        let mut parts = std::mem::take(&mut self.parts);
        parts.par_iter_mut().enumerate().for_each(|(k, nodes)| {
            fill(nodes, count, Vec4::ZERO);
            for place in k * per_part..((k + 1) * per_part).min(model.places()) {
                for lane in (0..model.blocks[displacements.block[place] as usize].live).step_by(EVERY) {
                    let p = LANES * place + lane;
                    let displacement = displacements.of(p);
                    // Particles outside the box would count at its boundary.
                    let is_near = self.holds(displacements.start[p]) && self.holds(displacements.end[p]);
                    if is_near && displacement.is_finite() {
                        self.add(nodes, displacements.at(p, 0.5), displacement);
                    }
                }
            }
        });
        fill(&mut self.nodes, count, Vec4::ZERO);
        for part in &parts {
            for (sum, x) in self.nodes.iter_mut().zip(part) {
                *sum += *x;
            }
        }
        self.smooth(&mut parts[0]);
        self.parts = parts;
        self.measure_residual_motion(model, displacements, per_part);
    }

    /// The residual motion that at most `most` particles exceed, to an eighth, metres.
    pub fn exceeded_by(&self, most: usize) -> f32 {
        self.part_histograms[0].cutoff(most).bound()
    }

    /// Selects the `most` particles of the largest residual motion among those that exceed `least`
    /// metres.
    pub fn largest_residuals(&self, most: usize, least: f32) -> LargestResiduals {
        let last = self.part_histograms[0].cutoff(most);
        let share = if last.count == 0 { 1.0 } else { last.selected as f32 / last.count as f32 };
        LargestResiduals { least, last_bin: last, share }
    }

    /// Fits the box to the start and end positions of all particles, and the nodes to the box.
    fn fit<T: Real>(&mut self, model: &Model<T>, displacements: &Displacements) {
        const EMPTY: [Vec3; 2] = [Vec3::INFINITY, Vec3::NEG_INFINITY];
        let join = |a: [Vec3; 2], b: [Vec3; 2]| [a[0].min(b[0]), a[1].max(b[1])];
        // Distant outliers must not make the nodes coarse.
        let far = FAR * model.reach as f32;
        let around = |k: usize| {
            let live = model.blocks[displacements.block[k] as usize].live;
            let range = LANES * k..LANES * k + live;
            let points = displacements.start[range.clone()].iter().chain(&displacements.end[range]);
            points.filter(|x| x.length_squared() < far * far).fold(EMPTY, |sum, &x| join(sum, [x, x]))
        };
        let extent = (0..model.places()).into_par_iter().with_min_len(256).map(around).reduce(|| EMPTY, join);
        self.extent = if extent[0].is_finite() { extent } else { [Vec3::ZERO; 2] };
        let side = (self.extent[1] - self.extent[0]).max_element();
        self.spacing = SPACING.max(4.0 * displacements.longest).max(side / (NODES - 2) as f32);
        self.low = self.extent[0];
        let nodes = (self.extent[1] - self.low) / self.spacing;
        self.dims = nodes.to_array().map(|nodes| (nodes as usize + 2).min(NODES + 1));
    }

    #[inline]
    fn holds(&self, at: Vec3) -> bool {
        at.cmpge(self.extent[0]).all() && at.cmple(self.extent[1]).all()
    }

    #[inline]
    fn index(&self, node: [usize; 3]) -> usize {
        node[0] + self.dims[0] * (node[1] + self.dims[1] * node[2])
    }

    #[inline]
    fn corner(&self, at: Vec3) -> Corner {
        let u = ((at - self.low) / self.spacing).max(Vec3::ZERO);
        let node = |u: f32, nodes: usize| (u as usize).min(nodes - 2);
        let [x, y, z] = [node(u.x, self.dims[0]), node(u.y, self.dims[1]), node(u.z, self.dims[2])];
        let below = Vec3::new(x as f32, y as f32, z as f32);
        Corner { node: [x, y, z], fraction: (u - below).min(Vec3::ONE) }
    }

    /// The eight nodes around a point, and their weights.
    #[inline]
    fn about(&self, at: Vec3) -> [(usize, f32); 8] {
        let Corner { node, fraction: f } = self.corner(at);
        let (first, g) = (self.index(node), 1.0 - f);
        let (y, z) = (self.dims[0], self.dims[0] * self.dims[1]);
        let [low, high] = [[g.y * g.z, f.y * g.z], [g.y * f.z, f.y * f.z]];
        [
            (first, g.x * low[0]),
            (first + 1, f.x * low[0]),
            (first + y, g.x * low[1]),
            (first + y + 1, f.x * low[1]),
            (first + z, g.x * high[0]),
            (first + z + 1, f.x * high[0]),
            (first + z + y, g.x * high[1]),
            (first + z + y + 1, f.x * high[1]),
        ]
    }

    fn add(&self, nodes: &mut [Vec4], at: Vec3, displacement: Vec3) {
        for (node, w) in self.about(at) {
            nodes[node] += w * displacement.extend(1.0);
        }
    }

    /// Replaces the sums at each node by the mean over the node and its neighbours; `work` is a
    /// buffer.
    fn smooth(&mut self, work: &mut Vec<Vec4>) {
        for axis in 0..3 {
            let stride = [1, self.dims[0], self.dims[0] * self.dims[1]][axis];
            work.clone_from(&self.nodes);
            for (k, sum) in self.nodes.iter_mut().enumerate() {
                let along = k / stride % self.dims[axis];
                for (beside, there) in
                    [(k.wrapping_sub(stride), along > 0), (k + stride, along + 1 < self.dims[axis])]
                {
                    if there {
                        *sum += work[beside];
                    }
                }
            }
        }
        for sum in &mut self.nodes {
            *sum /= sum.w.max(f32::MIN_POSITIVE);
        }
    }

    fn measure_residual_motion<T: Real>(
        &mut self,
        model: &Model<T>,
        displacements: &mut Displacements,
        per_part: usize,
    ) {
        let Displacements { start, end, residual_motion, block, .. } = displacements;
        let (start, end, block) = (&*start, &*end, &*block);
        let mut sums = [(0.0, 0.0); PARTS];
        let mut histograms = std::mem::take(&mut self.part_histograms);
        histograms.resize_with(PARTS, Histogram::default);
        let field = &*self;
        residual_motion
            .par_chunks_mut(LANES * per_part)
            .zip(&mut sums)
            .zip(&mut histograms)
            .enumerate()
            .for_each(|(k, ((residual_motion, sums), histograms))| {
                histograms.clear();
                let (mut sum, mut most) = (0.0f64, 0.0f32);
                for (own, residual_motion) in residual_motion.chunks_mut(LANES).enumerate() {
                    let place = k * per_part + own;
                    for (lane, residual_motion) in
                        residual_motion[..model.blocks[block[place] as usize].live].iter_mut().enumerate()
                    {
                        let p = LANES * place + lane;
                        let at = 0.5 * (start[p] + end[p]);
                        let mut displacement = end[p] - start[p];
                        for (node, w) in field.about(at) {
                            displacement -= w * field.nodes[node].truncate();
                        }
                        *residual_motion = displacement.length();
                        if !residual_motion.is_finite() {
                            *residual_motion = 0.0;
                            continue;
                        }
                        sum += f64::from(*residual_motion) * f64::from(*residual_motion);
                        most = most.max(*residual_motion);
                        histograms.add(*residual_motion);
                    }
                }
                *sums = (sum, most);
            });
        if let [all, others @ ..] = &mut *histograms {
            others.iter().for_each(|other| all.merge(other));
        }
        self.part_histograms = histograms;
        let squares = sums.iter().map(|s| s.0).sum::<f64>();
        self.rms_residual = ((squares / model.particle_count.max(1) as f64).sqrt()) as f32;
        self.largest_residual = sums.iter().map(|s| s.1).fold(0.0, f32::max);
    }
}
