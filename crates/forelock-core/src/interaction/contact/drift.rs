//! The motion that neighbours share: a smooth field of how far hair moves in a frame.

use super::Ways;
use super::fastest::{Histogram, Last};
use crate::lane::{LANES, Real};
use crate::scratch::fill;
use crate::strands::Model;
use glam::{Vec3, Vec4};
use rayon::prelude::*;
use std::cmp::Ordering;

/// Least distance of nodes, metres.
pub const SPACING: f32 = 0.03;
/// Hair farther from the groom's middle than so many times its own reach is left alone.
pub const FAR: f32 = 4.0;
/// Nodes along an axis at most.
pub const NODES: usize = 48;
/// Parts in which hair is summed: a fixed count, for sums must not depend on threads.
const PARTS: usize = 16;
/// One lane in so many is summed.
pub const EVERY: usize = 4;

/// Trilinear field of displacements a frame, on nodes.
#[derive(Debug, Default)]
pub(crate) struct Drift {
    low: Vec3,
    spacing: f32,
    dims: [usize; 3],
    /// Σ w Δx, Σ w; then the mean over the nodes about each.
    nodes: Vec<Vec4>,
    parts: Vec<Vec<Vec4>>,
    /// How many particles stray how far; the first becomes the sum.
    parts_strays: Vec<Histogram>,
    /// Root mean square and largest stray, metres.
    pub strays: (f32, f32),
    /// The box of hair, start and end.
    pub extent: [Vec3; 2],
}

/// A point's node below, and how far beyond it.
type Corner = ([usize; 3], Vec3);

/// Which particles stray farthest: see [`Drift::farthest`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Farthest {
    /// What counts as a stray at all, metres.
    pub least: f32,
    last: Last,
    /// How many of those in the last bin belong.
    share: f32,
}

impl Farthest {
    /// Whether number `a`, that strays so far, belongs: in the last bin a share of all, spread evenly.
    #[inline]
    pub fn has(&self, a: usize, stray: f32) -> bool {
        // The fractional parts of multiples of the golden ratio are even.
        let chance = (a as u32).wrapping_mul(0x9e37_79b9) as f32 * (0.5f32).powi(32);
        stray > self.least
            && match self.last.against(stray) {
                Ordering::Greater => true,
                Ordering::Equal => chance < self.share,
                Ordering::Less => false,
            }
    }
}

impl Drift {
    pub fn bytes(&self) -> usize {
        let nodes = 16 * (self.nodes.capacity() + self.parts.iter().map(Vec::capacity).sum::<usize>());
        nodes + self.parts_strays.iter().map(Histogram::bytes).sum::<usize>()
    }

    /// Measures the field, and with it how far every particle strays from it.
    pub fn measure<T: Real>(&mut self, model: &Model<T>, ways: &mut Ways) {
        self.fit(model, ways);
        let count = self.dims.iter().product();
        let per_part = model.places().div_ceil(PARTS).max(1);
        self.parts.resize_with(PARTS, Vec::new);
        let mut parts = std::mem::take(&mut self.parts);
        parts.par_iter_mut().enumerate().for_each(|(k, nodes)| {
            fill(nodes, count, Vec4::ZERO);
            for place in k * per_part..((k + 1) * per_part).min(model.places()) {
                for lane in (0..model.blocks[ways.block[place] as usize].live).step_by(EVERY) {
                    let p = LANES * place + lane;
                    let way = ways.way(p);
                    // What was thrown far away would count as the motion of what is at the box's edge.
                    let is_near = self.holds(ways.start[p]) && self.holds(ways.end[p]);
                    if is_near && way.is_finite() {
                        self.add(nodes, ways.at(p, 0.5), way);
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
        self.measure_strays(model, ways, per_part);
    }

    /// The stray that at most `most` particles exceed, to an eighth, metres.
    pub fn exceeded_by(&self, most: usize) -> f32 {
        self.parts_strays[0].last_of(most).bound()
    }

    /// The `most` particles that stray farthest, of those that stray farther than `least` metres.
    pub fn farthest(&self, most: usize, least: f32) -> Farthest {
        let last = self.parts_strays[0].last_of(most);
        let share = if last.own == 0 { 1.0 } else { last.room as f32 / last.own as f32 };
        Farthest { least, last, share }
    }

    /// The box about all ways, and nodes that fill it.
    fn fit<T: Real>(&mut self, model: &Model<T>, ways: &Ways) {
        const EMPTY: [Vec3; 2] = [Vec3::INFINITY, Vec3::NEG_INFINITY];
        let join = |a: [Vec3; 2], b: [Vec3; 2]| [a[0].min(b[0]), a[1].max(b[1])];
        // What was thrown far away must not make the cells of all others coarse.
        let far = FAR * model.reach as f32;
        let around = |k: usize| {
            let live = model.blocks[ways.block[k] as usize].live;
            let range = LANES * k..LANES * k + live;
            let points = ways.start[range.clone()].iter().chain(&ways.end[range]);
            points.filter(|x| x.length_squared() < far * far).fold(EMPTY, |sum, &x| join(sum, [x, x]))
        };
        let extent = (0..model.places()).into_par_iter().with_min_len(256).map(around).reduce(|| EMPTY, join);
        self.extent = if extent[0].is_finite() { extent } else { [Vec3::ZERO; 2] };
        let side = (self.extent[1] - self.extent[0]).max_element();
        self.spacing = SPACING.max(4.0 * ways.longest).max(side / (NODES - 2) as f32);
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
        ([x, y, z], (u - Vec3::new(x as f32, y as f32, z as f32)).min(Vec3::ONE))
    }

    /// The eight nodes about a point and their weights.
    #[inline]
    fn about(&self, at: Vec3) -> [(usize, f32); 8] {
        let (node, f) = self.corner(at);
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

    fn add(&self, nodes: &mut [Vec4], at: Vec3, way: Vec3) {
        for (node, w) in self.about(at) {
            nodes[node] += w * way.extend(1.0);
        }
    }

    /// Sums become means over the nodes about each, `work` is scratch.
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

    fn measure_strays<T: Real>(&mut self, model: &Model<T>, ways: &mut Ways, per_part: usize) {
        let Ways { start, end, stray, block, .. } = ways;
        let (start, end, block) = (&*start, &*end, &*block);
        let mut sums = [(0.0, 0.0); PARTS];
        let mut strays = std::mem::take(&mut self.parts_strays);
        strays.resize_with(PARTS, Histogram::default);
        let field = &*self;
        stray.par_chunks_mut(LANES * per_part).zip(&mut sums).zip(&mut strays).enumerate().for_each(
            |(k, ((stray, sums), strays))| {
                strays.clear();
                let (mut sum, mut most) = (0.0f64, 0.0f32);
                for (own, stray) in stray.chunks_mut(LANES).enumerate() {
                    let place = k * per_part + own;
                    for (lane, stray) in
                        stray[..model.blocks[block[place] as usize].live].iter_mut().enumerate()
                    {
                        let p = LANES * place + lane;
                        let at = 0.5 * (start[p] + end[p]);
                        let mut way = end[p] - start[p];
                        for (node, w) in field.about(at) {
                            way -= w * field.nodes[node].truncate();
                        }
                        *stray = way.length();
                        if !stray.is_finite() {
                            *stray = 0.0;
                            continue;
                        }
                        sum += f64::from(*stray) * f64::from(*stray);
                        most = most.max(*stray);
                        strays.add(*stray);
                    }
                }
                *sums = (sum, most);
            },
        );
        if let [all, others @ ..] = &mut *strays {
            others.iter().for_each(|other| all.join(other));
        }
        self.parts_strays = strays;
        self.strays = (
            ((sums.iter().map(|s| s.0).sum::<f64>() / model.particle_count.max(1) as f64).sqrt()) as f32,
            sums.iter().map(|s| s.1).fold(0.0, f32::max),
        );
    }
}
