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
//! The grid is staggered: cell (i, j, k) spans i..i+1 along x and so on, in units of a cell, and
//! owns its lower face along each axis. The velocity at a face is its momentum divided by its mass,
//! along the axis of the face. Velocities are relative to the head: hair that moves rigidly with
//! the head has zero velocity on the grid. Mass is measured in metres of hair, because all strands
//! have the same mass per length.
//!
//! The volume that hair occupies is measured in the rest shape: each edge fills its share of the
//! cells in which it lies at rest, but no more than hair of the mean density of the groom would. A
//! groom at rest is therefore nowhere too dense, and loose hair may gather until it reaches the
//! mean density.
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
pub(crate) use segments::{Bounds, Chunk, Sample, Segments, View, between, split_rows};

use crate::body::ColliderFrame;
use crate::lane::{LANES, Real, Row};
use crate::scratch::fill;
use crate::strands::Model;
use glam::DVec3;
use rayon::prelude::*;

/// WGSL shared by the kernels of the grid.
pub const WGSL: &str = include_str!("grid.wgsl");

/// Empty cells kept around the hair.
pub const MARGIN: i32 = 3;
/// Layers of cells in a slab. The samples of a slab are splat by one task.
pub(crate) const SLAB: usize = 2;
/// Rounds that distribute the rest volume until no cell is over-full.
const ROUNDS: usize = 8;

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
    /// Fill fraction of that cell.
    fullest_at_rest: f32,
    pub(crate) chunks: Vec<Chunk>,
    /// Rest volume of the hair of each edge, in cells: `[places]` rows.
    pub(crate) rooms: Vec<Row<f32>>,
    pub(crate) bounds: Bounds,
    /// Lower face of each cell along x, y and z: (mass, momentum) after the splat, (mass, velocity)
    /// during the solve, (new velocity, change of velocity) after it.
    pub(crate) faces: [Vec<[f32; 2]>; 3],
    /// Fraction of each cell that hair fills.
    pub(crate) filled: Vec<f32>,
    pub(crate) pressure: solve_pressure::Fields,
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
            fullest_at_rest: 1.0,
            chunks: segments::chunks(model, cell),
            rooms: vec![Row([0.0; LANES]); model.rest_lengths.len() / 3],
            bounds: Bounds::default(),
            faces: [Vec::new(), Vec::new(), Vec::new()],
            filled: Vec::new(),
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

    /// Rest volume of the hair of each edge in cells, one row for each place of the model.
    pub fn rooms(&self) -> &[Row<f32>] {
        &self.rooms
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

    /// Fill fraction of that cell: 1, or less if [`GridParams::rest_density`] exceeds the density
    /// of the hair at rest.
    pub fn fullest_at_rest(&self) -> f32 {
        self.fullest_at_rest
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        let faces: usize = self.faces.iter().map(|face| 8 * face.capacity()).sum();
        let chunks: usize = self.chunks.iter().map(Chunk::bytes).sum();
        faces + chunks + size_of_val(&*self.rooms) + 4 * self.filled.capacity() + self.pressure.bytes()
    }

    /// Fits the box to the hair and clears its fields.
    pub(crate) fn fit<T: Real>(&mut self, model: &Model<T>, positions: &[Row<T>], frame: &GridFrame) {
        let extent = segments::extent(model, positions, frame);
        self.bounds = Bounds::around(extent, self.cell, self.params.max_cells as usize);
        let cells = self.bounds.cells();
        for face in &mut self.faces {
            fill(face, cells, [0.0; 2]);
        }
        fill(&mut self.filled, cells, 0.0);
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
        let hair = Segments { model, positions: &*positions, velocities: &*velocities, rooms: &self.rooms };
        let (bounds, cell) = (self.bounds, self.cell);
        self.chunks.par_iter_mut().for_each(|chunk| chunk.fill(&hair, &moment.frame, &bounds, cell));
        splat_segments::splat(self);
        let splat = clock.elapsed().as_secs_f64();
        let mut report = solve_pressure::solve_velocities(self, moment);
        let solved = clock.elapsed().as_secs_f64();
        gather_velocities::gather(self, model, positions, velocities, moment);
        let gathered = clock.elapsed().as_secs_f64();
        report.farthest_m = solve_pressure::solve_displacements(self, moment, &mut report);
        let displaced = clock.elapsed().as_secs_f64();
        if report.farthest_m > 0.0 {
            gather_velocities::gather_displacements(self, model, positions, moment);
        }
        let end = clock.elapsed().as_secs_f64();
        report.secs = [splat, solved - splat + displaced - gathered, gathered - solved + end - displaced];
        report
    }

    /// Measures `rooms`: see Practice in the module documentation.
    fn measure_rest<T: Real>(&mut self, model: &Model<T>, frame: &GridFrame) {
        // The first pass takes the length of an edge as its volume: the density in metres per cell.
        let places = 0..model.rest_lengths.len() / 3;
        for place in places.clone() {
            self.rooms[place] = Row(model.rest_lengths[3 * place].0.map(|l| l.to_f32().unwrap_or(0.0)));
        }
        let at_edges = self.filled_at_rest(model, frame);
        let samples = self.chunks.iter().flat_map(|chunk| &chunk.samples);
        let (mass, count) = samples.fold((0.0, 0.0), |(m, n), s| (m + f64::from(s.mass), n + 1.0));
        self.sample_mass = (mass / f64::max(count, 1.0)) as f32;
        let mean = self.params.rest_density * self.cell.powi(3);
        let mean = if mean > 0.0 { mean as f32 } else { segments::mean(model, &self.rooms, &at_edges) };
        self.densest = at_edges.iter().flat_map(|row| row.0).fold(0.0, f32::max);
        self.fullest_at_rest = self.densest / mean.max(self.densest).max(f32::MIN_POSITIVE);
        for place in places.clone() {
            for lane in 0..LANES {
                self.rooms[place].0[lane] /= at_edges[place].0[lane].max(mean).max(f32::MIN_POSITIVE);
            }
        }
        for _ in 0..ROUNDS {
            let at_edges = self.filled_at_rest(model, frame);
            for place in places.clone() {
                for lane in 0..LANES {
                    self.rooms[place].0[lane] /= at_edges[place].0[lane].max(1.0);
                }
            }
        }
    }

    /// Fill fraction of the cells around each edge of the rest shape, `[places]` rows.
    fn filled_at_rest<T: Real>(&mut self, model: &Model<T>, frame: &GridFrame) -> Vec<Row<f32>> {
        self.fit(model, &model.rest, frame);
        let hair = Segments { model, positions: &model.rest, velocities: &model.rest, rooms: &self.rooms };
        let (bounds, cell) = (self.bounds, self.cell);
        self.chunks.par_iter_mut().for_each(|chunk| chunk.fill(&hair, frame, &bounds, cell));
        splat_segments::splat(self);
        segments::at_edges(model, &self.filled, &self.bounds, self.cell, frame)
    }
}
