//! The grid on which hair meets hair: where it stands, what it holds, how much room each strand takes.
//!
//! # Theory
//! Dense hair behaves as a fluid that resists being pressed together (McAdams 2009; AMS, Sec. 3.2). Its segments are
//! splat to a grid of faces and cells that moves rigidly with the head ([`splat_segments`]), a pressure takes out the
//! part of the motion that would press it together ([`solve_pressure`]), and the change goes back to the particles
//! ([`gather_velocities`]).
//!
//! # Practice
//! A staggered grid: cell (i, j, k) spans i..i+1 along x and so on, in units of a cell, and owns its lower face along
//! each axis. Along an axis the face's momentum divided by its mass is the velocity there. Everything is relative to
//! the head: hair that moves with it has no velocity on the grid. Mass is counted in metres of hair, for strands are
//! alike.
//!
//! How much room hair takes is measured in the rest shape: an edge fills, at rest, its share of the cells it lies in,
//! but no more than hair of the groom's mean density would. So a groom at rest is nowhere too dense, and hair that
//! hangs loose may gather until it is as dense as the mean.
//!
//! # Limitations
//! Samples outside the largest box ([`GridParams::max_cells`]) are left alone. Single-sample noise of sparse hair
//! counts as density: below about eight strands a cell the grid is coarse.
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
pub use frame::{GridFrame, GridSolid, SolidMaps};
pub use params::GridParams;
pub(crate) use segments::{Bounds, Chunk, Sample, Segments, View, between, split_rows};

use crate::body::ColliderFrame;
use crate::lane::{LANES, Real, Row};
use crate::scratch::fill;
use crate::strands::Model;
use glam::DVec3;
use rayon::prelude::*;

/// WGSL that the kernels of the grid share.
pub const WGSL: &str = include_str!("grid.wgsl");

/// Empty cells kept around the hair.
pub const MARGIN: i32 = 3;
/// Layers of cells whose samples are splat together.
pub(crate) const SLAB: usize = 2;
/// Rounds that spread the room of the rest shape until no cell is too full.
const ROUNDS: usize = 8;

/// The grid and its scratch.
#[derive(Debug)]
pub struct Grid {
    pub(crate) params: GridParams,
    /// Side of a cell, metres.
    pub(crate) cell: f64,
    /// Mean mass of a sample, metres of hair.
    pub(crate) sample_mass: f32,
    /// Metres of hair in the densest cell of the rest shape.
    densest: f32,
    /// How full that cell is.
    fullest_at_rest: f32,
    pub(crate) chunks: Vec<Chunk>,
    /// Cells that the hair of each edge fills at rest, `[places]` rows.
    pub(crate) rooms: Vec<Row<f32>>,
    pub(crate) bounds: Bounds,
    /// Each cell's lower face along x, y and z: (mass, momentum) after the splat, (mass, velocity) in the solve, (new
    /// velocity, change) after it.
    pub(crate) faces: [Vec<[f32; 2]>; 3],
    /// Share of each cell that hair fills.
    pub(crate) filled: Vec<f32>,
    pub(crate) pressure: solve_pressure::Fields,
}

/// A frame as the grid needs it.
#[derive(Clone, Copy, Debug)]
pub struct GridMoment<'a> {
    /// The frame that the grid moves with.
    pub frame: GridFrame,
    /// Solids of the frame, in the world.
    pub solids: &'a [ColliderFrame<'a>],
    /// Where the last substep starts, as a fraction of the frame.
    pub last_substep: f64,
    /// The point of the world that positions are relative to.
    pub origin: DVec3,
    /// Particles of each strand, from the root, that follow the head.
    pub clamped: usize,
    /// Length of the frame, seconds.
    pub dt_secs: f64,
}

impl Grid {
    /// A grid for the strands of `model`, with the room they take measured in their rest shape.
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

    /// Its parameters.
    pub fn params(&self) -> &GridParams {
        &self.params
    }

    /// Side of a cell, metres.
    pub fn cell(&self) -> f64 {
        self.cell
    }

    /// Cells that the hair of each edge fills at rest, a row a place of the model.
    pub fn rooms(&self) -> &[Row<f32>] {
        &self.rooms
    }

    /// Samples taken of each edge, a number a block of the model.
    pub fn samples_per_edge(&self) -> impl Iterator<Item = usize> {
        self.chunks.iter().flat_map(|chunk| &chunk.points).copied()
    }

    /// Mean mass of a sample, metres of hair.
    pub fn sample_mass(&self) -> f32 {
        self.sample_mass
    }

    /// Metres of hair in the densest cell of the rest shape, about.
    pub fn densest(&self) -> f32 {
        self.densest
    }

    /// How full that cell is: 1, but less where [`GridParams::rest_density`] is more than the hair has at rest.
    pub fn fullest_at_rest(&self) -> f32 {
        self.fullest_at_rest
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        let faces: usize = self.faces.iter().map(|face| 8 * face.capacity()).sum();
        let chunks: usize = self.chunks.iter().map(Chunk::bytes).sum();
        faces + chunks + size_of_val(&*self.rooms) + 4 * self.filled.capacity() + self.pressure.bytes()
    }

    /// Makes the box fit the hair and empties it.
    pub(crate) fn fit<T: Real>(&mut self, model: &Model<T>, positions: &[Row<T>], frame: &GridFrame) {
        let extent = segments::extent(model, positions, frame);
        self.bounds = Bounds::around(extent, self.cell, self.params.max_cells as usize);
        let cells = self.bounds.cells();
        for face in &mut self.faces {
            fill(face, cells, [0.0; 2]);
        }
        fill(&mut self.filled, cells, 0.0);
    }

    /// Lets hair meet: splats it, solves, and changes velocities, and positions where hair is too dense, of all particles
    /// but the first `clamped` of each strand. Positions are relative to the moment's origin.
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
        gather_velocities::gather(self, (model, positions), velocities, moment);
        let gathered = clock.elapsed().as_secs_f64();
        report.farthest_m = solve_pressure::solve_displacements(self, moment, &mut report);
        let again = clock.elapsed().as_secs_f64();
        if report.farthest_m > 0.0 {
            gather_velocities::gather_displacements(self, model, positions, moment);
        }
        let end = clock.elapsed().as_secs_f64();
        report.secs = [splat, solved - splat + again - gathered, gathered - solved + end - again];
        report
    }

    /// Fills `rooms`: see the module's Practice.
    fn measure_rest<T: Real>(&mut self, model: &Model<T>, frame: &GridFrame) {
        // First with an edge's length as its room: the density in metres a cell.
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

    /// How full cells are about each edge of the rest shape, `[places]` rows.
    fn filled_at_rest<T: Real>(&mut self, model: &Model<T>, frame: &GridFrame) -> Vec<Row<f32>> {
        self.fit(model, &model.rest, frame);
        let hair = Segments { model, positions: &model.rest, velocities: &model.rest, rooms: &self.rooms };
        let (bounds, cell) = (self.bounds, self.cell);
        self.chunks.par_iter_mut().for_each(|chunk| chunk.fill(&hair, frame, &bounds, cell));
        splat_segments::splat(self);
        segments::at_edges(model, &self.filled, &self.bounds, self.cell, frame)
    }
}
