//! Shelter inside the hair: the wind falls off on its way through it.
//!
//! # Theory
//! Each metre of strand takes its share of the wind that reaches it, so that along the mean wind's direction s
//!
//! ```text
//! du/ds = −u ρ/(ρ₀ ℓ),   u = U exp(−τ),   τ(x) = 1/(ρ₀ ℓ) ∫ ρ ds from upwind to x
//! ```
//!
//! with ρ the metres of hair in a cubic metre, ρ₀ the density in which half of the hair lies at rest, and ℓ the way in such hair on which the wind falls to 1/e
//! (Cionco 1965, "A mathematical model for air flow in a vegetative canopy": wind in plants falls exponentially with depth). Because of ρ₀ the depth ℓ means the same
//! for a few strands that stand for all hair as for all hair.
//!
//! # Practice
//! A grid of up to 32³ nodes, aligned with the wind, about the hair as it is at the frame's start. Each edge leaves its length at the nodes around samples
//! about a cell apart, trilinear. Then one layer after the other downwind takes the mean of its density and that of the layer before it (the trapezoidal
//! rule). Strands are summed up in sixteen parts, and these in order, whatever the threads. Everything follows from positions alone, so that a resumed run goes
//! on bit for bit, and hair need not meet on a grid for it.
//!
//! # Limitations
//! The flow goes straight on: it neither turns round a lock nor mixes back in behind it, so that the lee of hair goes on to the end of the
//! grid. The direction is that of the mean wind alone. Locks thinner than a cell, 1/29 of the hair's longest side, are smeared over it.

use glam::DVec3;
use rayon::prelude::*;

use crate::lane::{LANES, Real, Row};
use crate::strands::Model;
use crate::scratch::fill;

/// Nodes along the longest side.
pub const NODES: usize = 32;
/// Of which at each end are free of hair.
pub const MARGIN: usize = 1;
/// Parts in which strands are summed up.
const PARTS: usize = 16;

/// How much wind gets to each place around the hair in one frame.
#[derive(Clone, Debug, Default)]
pub struct Canopy {
    /// Whether there is any wind that hair keeps off.
    any: bool,
    grid: Nodes,
    /// Metres of hair at the nodes, one list a part of the strands; the first becomes the sum.
    parts: Vec<Vec<f32>>,
    /// exp(−τ) at the nodes, along the wind slowest.
    open: Vec<f32>,
    /// ρ₀, m⁻²; 0 before the first wind.
    rest_density: f64,
}

/// Where the nodes are.
#[derive(Clone, Debug, Default, PartialEq)]
struct Nodes {
    /// Across, across and along the wind, over the cell: from metres to nodes.
    axes: [[f32; 3]; 3],
    /// The first node, in nodes from the origin.
    low: [f32; 3],
    dims: [usize; 3],
    /// Side of a cell, metres.
    cell: f64,
}

impl Nodes {
    /// Nodes around `positions` of `model`, aligned with the unit vector `along`.
    fn around<T: Real>(model: &Model<T>, positions: &[Row<T>], along: DVec3) -> Self {
        let (u, v) = along.any_orthonormal_pair();
        let axes = [u, v, along].map(|axis| axis.as_vec3().to_array());
        let metres = Self { axes, ..Self::default() };
        let [low, high] = model.extent(|place| metres.coordinates(positions, place));
        let sides = [0, 1, 2].map(|c| (high[c] - low[c]).max(0.0));
        let longest = sides.into_iter().fold(0.0, f32::max).max(1e-6);
        let cell = longest / (NODES - 1 - 2 * MARGIN) as f32;
        Self {
            axes: axes.map(|axis| axis.map(|x| x / cell)),
            low: low.map(|x| x / cell - MARGIN as f32),
            dims: sides.map(|side| ((side / cell).ceil() as usize + 1 + 2 * MARGIN).min(NODES)),
            cell: cell.into(),
        }
    }

    fn layer(&self) -> usize {
        self.dims[0] * self.dims[1]
    }

    fn count(&self) -> usize {
        self.layer() * self.dims[2]
    }

    /// Where the particles of `place` are, in nodes from the first, a lane.
    #[inline(always)]
    fn coordinates<T: Real>(&self, rows: &[Row<T>], place: usize) -> [[f32; LANES]; 3] {
        let [x, y, z] = [0, 1, 2].map(|c| rows[3 * place + c].0.map(|x| x.to_f32().unwrap_or(0.0)));
        let mut at = [[0.0; LANES]; 3];
        for ((at, [a, b, d]), low) in at.iter_mut().zip(self.axes).zip(self.low) {
            for lane in 0..LANES {
                at[lane] = a * x[lane] + b * y[lane] + d * z[lane] - low;
            }
        }
        at
    }

    /// The first of the eight nodes around `at` (nodes), and how far beyond it that is; beyond the grid, of its nearest point.
    #[inline(always)]
    fn corner(&self, at: [f32; 3]) -> (usize, [f32; 3]) {
        let (mut first, mut f) = (0, [0.0; 3]);
        let strides = [1, self.dims[0], self.layer()];
        for c in 0..3 {
            let top = (self.dims[c] - 1) as f32;
            // What is not a number is at 0.
            let at = if at[c] > 0.0 { at[c].min(top) } else { 0.0 };
            let low = (at as usize).min(self.dims[c] - 2);
            f[c] = at - low as f32;
            first += low * strides[c];
        }
        (first, f)
    }
}

impl Canopy {
    /// The shelter of hair at `positions` (rows as in `model`, metres) moved by `shift`, in wind along `wind` that reaches `depth` metres deep; none in no
    /// wind. Allocates at its first calls only.
    pub fn update<T: Real>(
        &mut self,
        model: &Model<T>,
        (positions, shift): (&[Row<T>], DVec3),
        wind: DVec3,
        depth: f64,
    ) {
        self.any = false;
        let Some(along) = wind.try_normalize() else { return };
        if self.rest_density == 0.0 {
            self.measure_rest(model);
        }
        self.splat(model, positions, along);
        self.march(depth);
        let moved = |axis: [f32; 3]| dot(axis, shift.as_vec3().to_array());
        self.grid.low = [0, 1, 2].map(|c| self.grid.low[c] + moved(self.grid.axes[c]));
        self.any = true;
    }

    /// ρ₀ of `model`: the density in which half of its hair lies at rest, m⁻².
    pub fn rest_density<T: Real>(model: &Model<T>) -> f64 {
        let mut own = Self::default();
        own.measure_rest(model);
        own.rest_density
    }

    fn measure_rest<T: Real>(&mut self, model: &Model<T>) {
        self.splat(model, &model.rest, DVec3::Z);
        self.rest_density = self.median_density();
    }

    /// The share of the wind that reaches `x`, metres, moved as the positions were.
    #[inline(always)]
    pub fn open(&self, x: [f32; 3]) -> f32 {
        if !self.any {
            return 1.0;
        }
        let grid = &self.grid;
        let at = [
            dot(grid.axes[0], x) - grid.low[0],
            dot(grid.axes[1], x) - grid.low[1],
            dot(grid.axes[2], x) - grid.low[2],
        ];
        let (first, [fx, fy, fz]) = self.grid.corner(at);
        let (row, layer) = (self.grid.dims[0], self.grid.layer());
        let open = &self.open[first..first + layer + row + 2];
        let lerp = |a: f32, b: f32, t: f32| a + (b - a) * t;
        let along_x = |at: usize| lerp(open[at], open[at + 1], fx);
        let along_y = |at: usize| lerp(along_x(at), along_x(at + row), fy);
        lerp(along_y(0), along_y(layer), fz)
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        4 * (self.parts.iter().map(Vec::capacity).sum::<usize>() + self.open.capacity())
    }

    /// Leaves the metres of hair at the nodes around `positions`, in `parts[0]`.
    fn splat<T: Real>(&mut self, model: &Model<T>, positions: &[Row<T>], along: DVec3) {
        self.grid = Nodes::around(model, positions, along);
        self.parts.resize_with(PARTS, Vec::new);
        let grid = &self.grid;
        self.parts.par_iter_mut().enumerate().for_each(|(part, nodes)| {
            nodes.clear();
            nodes.reserve(NODES.pow(3));
            fill(nodes, grid.count(), 0.0);
            for block in model.parts(PARTS).nth(part).map_or(&[][..], |mine| &model.blocks[mine]) {
                let mut before = grid.coordinates(positions, block.first);
                for place in block.first + 1..block.first + block.particles {
                    let here = grid.coordinates(positions, place);
                    let lengths = &model.rest_lengths[3 * (place - 1)].0;
                    for lane in 0..block.live {
                        let ends = [&before, &here].map(|at| [at[0][lane], at[1][lane], at[2][lane]]);
                        add_edge(grid, nodes, ends, lengths[lane].to_f32().unwrap_or(0.0));
                    }
                    before = here;
                }
            }
        });
        if let [sum, others @ ..] = &mut *self.parts {
            for other in others {
                sum.iter_mut().zip(&*other).for_each(|(sum, more)| *sum += more);
            }
        }
    }

    /// The density in which the median metre of hair lies, m⁻². Unlike a mean it does not feel the hair's edges, where nodes are half empty.
    fn median_density(&self) -> f64 {
        let mut nodes = self.parts[0].clone();
        nodes.sort_unstable_by(f32::total_cmp);
        let all: f64 = nodes.iter().map(|&n| f64::from(n)).sum();
        let mut below = 0.0;
        let median = nodes.into_iter().find(|&n| {
            below += f64::from(n);
            2.0 * below >= all
        });
        f64::from(median.unwrap_or(0.0).max(f32::MIN_POSITIVE)) / self.grid.cell.powi(3)
    }

    /// From the lengths in `parts[0]` to exp(−τ), layer after layer downwind.
    fn march(&mut self, depth: f64) {
        let (grid, lengths) = (&self.grid, &self.parts[0]);
        // Half of what a metre at a node adds to τ over a cell.
        let half = 0.5 / (grid.cell.powi(2) * self.rest_density * depth);
        let (half, layer) = (half as f32, grid.layer());
        self.open.clear();
        self.open.reserve(NODES.pow(3));
        fill(&mut self.open, grid.count(), 0.0);
        for at in layer..grid.count() {
            self.open[at] = self.open[at - layer] + half * (lengths[at] + lengths[at - layer]);
        }
        self.open
            .par_chunks_mut(layer)
            .for_each(|layer| layer.iter_mut().for_each(|tau| *tau = (-*tau).exp()));
    }
}

/// Leaves `length` along the edge between `ends` (nodes).
#[inline(always)]
fn add_edge(grid: &Nodes, nodes: &mut [f32], [a, b]: [[f32; 3]; 2], length: f32) {
    let edge = [b[0] - a[0], b[1] - a[1], b[2] - a[2]];
    let samples = (dot(edge, edge).sqrt() + 0.5).clamp(1.0, 64.0) as u32;
    let share = 1.0 / samples as f32;
    let part = length * share;
    let (row, layer) = (grid.dims[0], grid.layer());
    for k in 0..samples {
        let t = (k as f32 + 0.5) * share;
        let (first, [fx, fy, fz]) = grid.corner([a[0] + t * edge[0], a[1] + t * edge[1], a[2] + t * edge[2]]);
        let cells = &mut nodes[first..first + layer + row + 2];
        let (y, z) = ([part * (1.0 - fy), part * fy], [1.0 - fz, fz]);
        for (from, w) in
            [(0, y[0] * z[0]), (row, y[1] * z[0]), (layer, y[0] * z[1]), (layer + row, y[1] * z[1])]
        {
            cells[from] += w * (1.0 - fx);
            cells[from + 1] += w * fx;
        }
    }
}

#[inline(always)]
fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
