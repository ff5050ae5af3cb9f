//! The grid of hair–hair interaction: its placement, its fields, and the volume of the hair.
//!
//! # Theory
//! Dense hair behaves as a fluid that resists compression (McAdams 2009; AMS, Sec. 3.2). Its
//! segments are splat to a grid of faces and cells that moves rigidly with the head
//! ([`splat_segments`]), a pressure removes the part of the motion that would compress the hair
//! further ([`solve_pressure`]), and the change of velocity is interpolated back to the particles
//! ([`gather_velocities`]).
//!
//! # Practice
//! Cell (i, j, k) spans i..i+1 along x and so on, in units of a cell. Particles exchange mass,
//! momentum and volume with the middles of the cells, the nodes: one stencil for all numbers of a
//! sample. The pressure acts on the faces between cells, whose mass and momentum are the means of
//! the two cells. Velocities are relative to the head: hair that moves rigidly with the head has
//! zero velocity on the grid. Mass is measured in metres of hair, because all strands have the same
//! mass per length.
//!
//! The volume that hair occupies is measured in the rest shape: hair there fills the cells in which
//! it lies, sparse or dense. Where the density at rest is below [`GridParams::rest_density`], hair
//! may gather until it reaches that. A cell at the surface of the hair is only partly full at rest,
//! and the kernel of the samples cannot fill all cells evenly, so each edge also carries the fill
//! fraction φ₀ around it at rest. With the rest volumes V_s of the samples, in cells, the density
//! of a cell relative to that of the same hair at rest is
//!
//! ```text
//! ρ = φ/φ̄₀ = φ² / Σ w V_s φ₀ ,   φ = Σ w V_s ,   φ̄₀ = Σ w V_s φ₀ / φ
//! ```
//!
//! It is nowhere above 1 in a groom at rest, which is therefore left alone.
//!
//! # Limitations
//! Samples outside the largest box ([`GridParams::max_cells`]) do not take part. The noise of
//! single samples counts as density in sparse hair: below about eight strands a cell the grid is
//! coarse.
//!
//! [`splat_segments`]: crate::interaction::grid::splat_segments
//! [`solve_pressure`]: crate::interaction::grid::solve_pressure
//! [`gather_velocities`]: crate::interaction::grid::gather_velocities

mod exchange;
mod frame;
pub mod gather_velocities;
mod params;
mod segments;
pub mod solve_pressure;
pub mod splat_segments;

pub use crate::frame::GridReport;
pub use exchange::EXCHANGE;
pub(crate) use exchange::GridInteraction;
pub use frame::{GridFrame, GridPlacement, GridSolid, SolidMaps};
pub use params::GridParams;
pub(crate) use segments::{Bounds, Chunk, Lanes, Segments, Stencils, View, between, split_rows};

use crate::body::ColliderFrame;
use crate::lane::{LANES, Real, Row};
use crate::scratch::fill;
use crate::strands::Model;
use glam::DVec3;
use rayon::prelude::*;
use std::ops::{Add, Mul};

/// WGSL shared by the kernels of the grid.
pub const WGSL: &str = include_str!("grid.wgsl");

/// Empty cells kept around the hair.
pub const MARGIN: i32 = 3;
/// Layers of cells in a slab. The samples of a slab are splat by one task.
pub(crate) const SLAB: usize = 2;
/// Rounds of each iteration that distributes the rest volume.
const ROUNDS: usize = 8;
/// Least fill fraction at rest φ₀: sparser hair may gather until it fills as much of a cell.
const EMPTIEST: f32 = 0.3;
/// Largest fill fraction at rest φ₀ from the rounds that may lower it too: without a bound they
/// amplify differences between neighbouring edges, up to 1e11 in a groom of few strands.
const FULLEST: f32 = 4.0;
/// Density of hair at rest that keeps its volume, over the mean density of the groom, by default.
const SPARSEST: f32 = 0.1;

/// The grid and its buffers.
#[derive(Debug)]
pub struct Grid {
    pub(crate) params: GridParams,
    /// Side of a cell, metres.
    pub(crate) cell: f64,
    /// Mean mass of a sample, metres of hair.
    pub(crate) sample_mass: f32,
    /// Metres of hair in the densest cell of the rest shape.
    densest: f32,
    /// Largest Σ w V and Σ w V φ₀ in a cell of the rest shape.
    fullest_at_rest: [f32; 2],
    pub(crate) chunks: Vec<Chunk>,
    /// Rest volume V of the hair of each edge, in cells, and V φ₀: `[places]` rows.
    pub(crate) volumes: Vec<[Row<f32>; 2]>,
    pub(crate) bounds: Bounds,
    /// The middles of the cells.
    pub(crate) nodes: Vec<Node>,
    pub(crate) pressure: solve_pressure::Fields,
}

/// Index of the mass in a node.
pub(crate) const MASS: usize = 3;

/// What is known at the middle of a cell: momentum, mass, Σ w V and Σ w V φ₀ after the splat; the
/// velocity Δu + p (u − Δu) to interpolate ([`gather_velocities`]), the mass and the displacement
/// after the solve.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C, align(32))]
pub(crate) struct Node(pub [f32; 8]);

impl Node {
    #[inline(always)]
    pub fn mass(&self) -> f32 {
        self.0[MASS]
    }

    /// Σ w V and Σ w V φ₀.
    #[inline(always)]
    pub fn volumes(&self) -> [f32; 2] {
        [self.0[4], self.0[5]]
    }
}

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

/// What the grid needs of a frame.
#[derive(Clone, Copy, Debug)]
pub struct GridMoment<'a> {
    /// The frame of reference that the grid moves with.
    pub frame: GridFrame,
    /// Solids of the frame, in world space.
    pub solids: &'a [ColliderFrame<'a>],
    /// Start of the last substep, as a fraction of the frame.
    pub last_substep: f64,
    /// World position of the origin of `positions`.
    pub origin: DVec3,
    /// Particles of each strand, counted from the root, that are clamped to the head.
    pub clamped: usize,
    /// Length of the frame, seconds.
    pub dt_secs: f64,
}

impl Grid {
    /// Creates a grid for the strands of `model` and measures their rest volume.
    pub fn new<T: Real>(model: &Model<T>, params: &GridParams) -> Self {
        let frame = GridFrame::at_rest();
        let extent = segments::extent(model, &model.rest, &frame);
        let longest = (0..3).map(|c| extent[1][c] - extent[0][c]).fold(0.0, f32::max);
        let cell = f64::from(longest.max(f32::MIN_POSITIVE)) / f64::from(params.resolution);
        let mut grid = Self {
            params: params.clone(),
            cell,
            sample_mass: 0.0,
            densest: 0.0,
            fullest_at_rest: [1.0; 2],
            chunks: segments::chunks(model, cell),
            volumes: vec![[Row([0.0; LANES]); 2]; model.rest_lengths.len() / 3],
            bounds: Bounds::default(),
            nodes: Vec::new(),
            pressure: solve_pressure::Fields::default(),
        };
        grid.measure_rest(model, &frame);
        grid
    }

    /// The parameters of the grid.
    pub fn params(&self) -> &GridParams {
        &self.params
    }

    /// Side of a cell, metres.
    pub fn cell(&self) -> f64 {
        self.cell
    }

    /// Rest volume V of the hair of each edge, in cells, and V φ₀, with the fill fraction φ₀ around
    /// the edge at rest: two rows for each place of the model.
    pub fn volumes(&self) -> &[[Row<f32>; 2]] {
        &self.volumes
    }

    /// Samples on each edge, one number for each block of the model.
    pub fn samples_per_edge(&self) -> impl Iterator<Item = usize> {
        self.chunks.iter().flat_map(|chunk| &chunk.points).copied()
    }

    /// Mean mass of a sample, metres of hair.
    pub fn sample_mass(&self) -> f32 {
        self.sample_mass
    }

    /// Approximate length of hair in the densest cell of the rest shape, metres.
    pub fn densest(&self) -> f32 {
        self.densest
    }

    /// Largest sum of rest volumes V in a cell of the rest shape, and largest sum of V φ₀, cells.
    pub fn fullest_at_rest(&self) -> [f32; 2] {
        self.fullest_at_rest
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        let chunks: usize = self.chunks.iter().map(Chunk::bytes).sum();
        chunks
            + size_of_val(&*self.volumes)
            + self.nodes.capacity() * size_of::<Node>()
            + self.pressure.bytes()
    }

    /// Fits the box to the hair and clears its fields.
    pub(crate) fn fit<T: Real>(&mut self, model: &Model<T>, positions: &[Row<T>], frame: &GridFrame) {
        let extent = segments::extent(model, positions, frame);
        self.bounds = Bounds::around(extent, self.cell, self.params.max_cells as usize);
        fill(&mut self.nodes, self.bounds.cells(), Node::default());
    }

    /// Splats the hair, solves for the pressure, and changes the velocities of all particles except
    /// the first `clamped` of each strand; where hair is too dense it changes positions too.
    /// Positions are relative to the origin of `moment`.
    pub fn exchange<T: Real>(
        &mut self,
        model: &Model<T>,
        positions: &mut [Row<T>],
        velocities: &mut [Row<T>],
        moment: &GridMoment<'_>,
    ) -> GridReport {
        let clock = std::time::Instant::now();
        self.fit(model, positions, &moment.frame);
        let hair =
            Segments { model, positions: &*positions, velocities: &*velocities, volumes: &self.volumes };
        let (bounds, cell) = (self.bounds, self.cell);
        self.chunks.par_iter_mut().for_each(|chunk| chunk.fill(&hair, &moment.frame, &bounds, cell));
        splat_segments::splat(self);
        let splat = clock.elapsed().as_secs_f64();
        let mut report = solve_pressure::solve(self, moment);
        let solved = clock.elapsed().as_secs_f64();
        let displaces = report.farthest_m > 0.0;
        gather_velocities::gather(self, model, positions, velocities, moment, displaces);
        report.secs = [splat, solved - splat, clock.elapsed().as_secs_f64() - solved];
        report
    }

    /// Measures `volumes`: see Practice in the module documentation.
    fn measure_rest<T: Real>(&mut self, model: &Model<T>, frame: &GridFrame) {
        // The first pass takes the length of an edge as its volume: the density in metres per cell.
        let lengths: Vec<Row<f32>> = model
            .rest_lengths
            .iter()
            .step_by(3)
            .map(|row| Row(row.0.map(|l| l.to_f32().unwrap_or(0.0))))
            .collect();
        for (volumes, lengths) in self.volumes.iter_mut().zip(&lengths) {
            volumes[0] = *lengths;
        }
        let at_edges = self.at_rest(model, frame, |[filled, _]| filled, false);
        let totals = self.chunks.iter().map(Chunk::totals);
        let (count, mass) = totals.fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
        self.sample_mass = (mass / f64::max(count, 1.0)) as f32;
        let sparsest = self.params.rest_density * self.cell.powi(3);
        let sparsest = if sparsest > 0.0 {
            sparsest as f32
        } else {
            SPARSEST * segments::mean(model, &lengths, &at_edges)
        };
        let sparsest = sparsest.max(f32::MIN_POSITIVE);
        self.densest = at_edges.iter().flat_map(|row| row.0).fold(0.0, f32::max);
        // A volume of at most `length / sparsest`: hair may gather until it is as dense as that.
        self.set_volumes(&at_edges, |_, _, [length, _], filled| [length / filled.max(sparsest), 0.0]);
        for _ in 0..ROUNDS {
            let filled = self.at_rest(model, frame, |[filled, _]| filled, false);
            self.set_volumes(&filled, |place, lane, [volume, _], filled| {
                [(volume / filled.max(0.5)).min(lengths[place].0[lane] / sparsest), 0.0]
            });
        }
        let filled = self.at_rest(model, frame, |[filled, _]| filled, false);
        self.set_volumes(&filled, |_, _, [volume, _], filled| [volume, volume * filled.max(EMPTIEST)]);
        // First up and down, until the density is near 1; then up only, until it is nowhere above.
        for round in 0..2 * ROUNDS {
            let largest = round >= ROUNDS;
            let (least, most) = if largest { (1.0, f32::MAX) } else { (0.0, FULLEST) };
            let densities = self.at_rest(model, frame, density, largest);
            self.set_volumes(&densities, |_, _, [volume, at_rest], density| {
                [volume, (at_rest * density.max(least)).clamp(volume * EMPTIEST, volume * most)]
            });
        }
        self.at_rest(model, frame, density, true);
        let largest =
            |f: fn([f32; 2]) -> f32| self.nodes.iter().map(|node| f(node.volumes())).fold(0.0, f32::max);
        // What is left of the last iteration, and rounding.
        let densest = largest(density).max(1.0) * (1.0 + 1e-5);
        self.fullest_at_rest = [largest(|[filled, _]| filled), densest * largest(|[_, at_rest]| at_rest)];
        for [_, at_rest] in &mut self.volumes {
            at_rest.0 = at_rest.0.map(|volume| volume * densest);
        }
    }

    /// Sets the volumes of each edge to `f` of its place, its lane, its volumes, and the value of
    /// `at_edges`.
    fn set_volumes(&mut self, at_edges: &[Row<f32>], f: impl Fn(usize, usize, [f32; 2], f32) -> [f32; 2]) {
        for (place, (volumes, at_edges)) in self.volumes.iter_mut().zip(at_edges).enumerate() {
            for lane in 0..LANES {
                let new = f(place, lane, [0, 1].map(|k| volumes[k].0[lane]), at_edges.0[lane]);
                [volumes[0].0[lane], volumes[1].0[lane]] = new;
            }
        }
    }

    /// A function of the sums of volumes in the cells around each edge of the rest shape,
    /// `[places]` rows.
    fn at_rest<T: Real>(
        &mut self,
        model: &Model<T>,
        frame: &GridFrame,
        f: impl Fn([f32; 2]) -> f32,
        largest: bool,
    ) -> Vec<Row<f32>> {
        self.fit(model, &model.rest, frame);
        let hair =
            Segments { model, positions: &model.rest, velocities: &model.rest, volumes: &self.volumes };
        let (bounds, cell) = (self.bounds, self.cell);
        self.chunks.par_iter_mut().for_each(|chunk| chunk.fill(&hair, frame, &bounds, cell));
        splat_segments::splat(self);
        let cells: Vec<f32> = self.nodes.iter().map(|node| f(node.volumes())).collect();
        segments::at_edges(model, &cells, &self.bounds, self.cell, frame, largest)
    }
}

/// Density ρ of a cell, relative to that of the same hair at rest, from Σ w V and Σ w V φ₀.
#[inline(always)]
pub(crate) fn density([filled, at_rest]: [f32; 2]) -> f32 {
    if at_rest > 0.0 { filled * filled / at_rest } else { 0.0 }
}
