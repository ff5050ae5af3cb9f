//! Attenuation of the wind inside the hair.
//!
//! # Theory
//! Each metre of strand absorbs a part of the wind that reaches it, so that along the direction s
//! of the mean wind
//!
//! ```text
//! du/ds = −u ρ/(ρ₀ ℓ),   u = U exp(−τ),   τ(x) = 1/(ρ₀ ℓ) ∫ ρ ds from upwind to x
//! ```
//!
//! where ρ is the length of hair in a cubic metre, ρ₀ the density in which half of the hair lies at
//! rest, and ℓ the distance in hair of density ρ₀ over which the wind falls to 1/e (Cionco 1965, "A
//! mathematical model for air flow in a vegetative canopy": wind in plants falls exponentially with
//! depth). Dividing by ρ₀ makes ℓ independent of the number of strands: a groom of few guide
//! strands and a full groom have the same attenuation.
//!
//! # Practice
//! The grid has up to 32³ nodes, is aligned with the wind and encloses the hair at the frame's
//! start. Each edge is sampled about once per cell, and its length is distributed trilinearly to
//! the nodes around each sample. Then each layer, in order downwind, adds the mean of its own
//! density and the density of the layer before it (the trapezoidal rule). Strands are summed in
//! sixteen partial sums, which are added in a fixed order, so that the result does not depend on
//! the number of threads. The result depends on the positions alone, so that a resumed run
//! continues bit for bit; the grid interaction need not be enabled.
//!
//! # Limitations
//! The flow keeps its direction: it neither turns around a lock nor mixes again behind it, so that
//! the lee of hair extends to the end of the grid. The direction is that of the mean wind only.
//! Locks thinner than a cell, 1/29 of the hair's longest side, are blurred over the cell.

use glam::DVec3;
use rayon::prelude::*;

use crate::lane::{LANES, Real, Row};
use crate::scratch::fill;
use crate::strands::Model;

/// Nodes along the longest side of the grid.
pub const NODES: usize = 32;
/// Layers of nodes at each end that contain no hair.
pub const MARGIN: usize = 1;
/// Number of partial sums over the strands.
const PARTS: usize = 16;

/// The fraction of the wind that reaches each point around the hair in one frame.
#[derive(Clone, Debug, Default)]
pub struct Canopy {
    /// Whether the wind is attenuated at all; `false` without wind.
    attenuates: bool,
    grid: Nodes,
    /// Length of hair at the nodes in metres, one list for each partial sum; the first becomes the
    /// total.
    parts: Vec<Vec<f32>>,
    /// exp(−τ) at the nodes; the index along the wind varies slowest.
    open: Vec<f32>,
    /// ρ₀, m⁻²; 0 before the first update with wind.
    rest_density: f64,
}

/// Positions of hair and the translation that places them in the space of the queries.
#[derive(Clone, Copy, Debug)]
pub struct PlacedHair<'a, T> {
    /// Rows of positions as in the model, metres.
    pub positions: &'a [Row<T>],
    /// Translation added to all positions, metres.
    pub shift: DVec3,
}

/// The nodes of the grid.
#[derive(Clone, Debug, Default, PartialEq)]
struct Nodes {
    /// The grid's axes (across, across and along the wind) divided by the cell: they convert metres
    /// to nodes.
    axes: [[f32; 3]; 3],
    /// The first node, in cells from the origin.
    low: [f32; 3],
    dims: [usize; 3],
    /// Side of a cell, metres.
    cell: f64,
}

impl Nodes {
    /// The grid that encloses `positions` of `model`, aligned with the unit vector `along`.
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

    /// The grid coordinates (in nodes from the first) of the particles at `place`, one for each
    /// lane.
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

    /// The first of the eight nodes around `at` (in nodes), and the fractional offset from it. A
    /// point outside the grid is moved to the nearest point of the grid.
    #[inline(always)]
    fn corner(&self, at: [f32; 3]) -> (usize, [f32; 3]) {
        let (mut first, mut f) = (0, [0.0; 3]);
        let strides = [1, self.dims[0], self.layer()];
        for c in 0..3 {
            let top = (self.dims[c] - 1) as f32;
            // NaN becomes 0.
            let at = if at[c] > 0.0 { at[c].min(top) } else { 0.0 };
            let low = (at as usize).min(self.dims[c] - 2);
            f[c] = at - low as f32;
            first += low * strides[c];
        }
        (first, f)
    }
}

impl Canopy {
    /// Computes the attenuation by `hair` in a wind along `wind` with penetration depth `depth`
    /// (metres). Without wind nothing is attenuated. Allocates at its first calls only.
    pub fn update<T: Real>(&mut self, model: &Model<T>, hair: &PlacedHair<'_, T>, wind: DVec3, depth: f64) {
        self.attenuates = false;
        let Some(along) = wind.try_normalize() else { return };
        if self.rest_density == 0.0 {
            self.measure_rest(model);
        }
        self.splat(model, hair.positions, along);
        self.march(depth);
        let moved = |axis: [f32; 3]| dot(axis, hair.shift.as_vec3().to_array());
        self.grid.low = [0, 1, 2].map(|c| self.grid.low[c] + moved(self.grid.axes[c]));
        self.attenuates = true;
    }

    /// The density ρ₀ of `model`, in which half of its hair lies at rest, m⁻².
    pub fn rest_density<T: Real>(model: &Model<T>) -> f64 {
        let mut canopy = Self::default();
        canopy.measure_rest(model);
        canopy.rest_density
    }

    fn measure_rest<T: Real>(&mut self, model: &Model<T>) {
        self.splat(model, &model.rest, DVec3::Z);
        self.rest_density = self.median_density();
    }

    /// The fraction of the wind that reaches `x` (metres), in the space of the shifted positions.
    #[inline(always)]
    pub fn open(&self, x: [f32; 3]) -> f32 {
        if !self.attenuates {
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

    /// Size of the buffers in bytes.
    pub fn bytes(&self) -> usize {
        4 * (self.parts.iter().map(Vec::capacity).sum::<usize>() + self.open.capacity())
    }

    /// Distributes the lengths of the edges at `positions` to the nodes; the total is in
    /// `parts[0]`.
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

    /// The density at which the median metre of hair lies, m⁻². Unlike a mean, it does not depend
    /// on the nodes at the surface of the hair, which are partly empty.
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

    /// Integrates the lengths in `parts[0]` to exp(−τ), layer by layer downwind.
    fn march(&mut self, depth: f64) {
        let (grid, lengths) = (&self.grid, &self.parts[0]);
        // Half of what a metre of hair at a node adds to τ over one cell.
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

/// Distributes `length` along the edge between `ends` (in nodes).
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
