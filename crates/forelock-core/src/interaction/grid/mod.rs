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

mod bounds;
mod exchange;
mod frame;
pub mod gather_velocities;
mod params;
mod patch;
mod rest;
mod segments;
pub mod solve_pressure;
pub mod splat_segments;

pub use crate::frame::GridReport;
pub(crate) use bounds::{Bounds, Lattice, STRIP, Stencils};
pub use exchange::EXCHANGE;
pub(crate) use exchange::GridInteraction;
pub(crate) use frame::RowMap;
pub use frame::{GridFrame, GridPlacement, GridSolid, SolidMaps};
pub use params::GridParams;
pub(crate) use patch::{NOWHERE, Patch, join};
pub(crate) use segments::{Lanes, ParticleRows, Segments, View, between, to_f32};
use solve_pressure::{Fields, LOOSE};

pub(crate) use crate::interaction::transpose::Node;

use crate::body::ColliderFrame;
use crate::frame::GridCell;
use crate::lane::{LANES, Real, Row};
use crate::strands::Model;
use glam::DVec3;

/// WGSL shared by the kernels of the grid.
pub const WGSL: &str = include_str!("grid.wgsl");

/// Empty cells kept around the hair.
pub const MARGIN: i32 = 3;
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
    pub(crate) patches: Vec<Patch>,
    /// Rest volume V of the hair of each edge, in cells, and V φ₀: `[places]` rows.
    pub(crate) volumes: Vec<[Row<f32>; 2]>,
    pub(crate) bounds: Bounds,
    /// The middles of the cells, of which only those of marked strips are used: momentum, mass,
    /// Σ w V and Σ w V φ₀ after the splat; the velocity Δu + p (u − Δu) to interpolate
    /// ([`gather_velocities`]), the mass and the displacement after the solve.
    pub(crate) nodes: Vec<Node>,
    /// 1 for each strip of cells that holds hair.
    pub(crate) marks: Vec<u8>,
    pub(crate) pressure: Fields,
}

/// Index of the mass in a node.
pub(crate) const MASS: usize = 3;

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
        let view = View::new(&frame, &Bounds::default(), 1.0);
        let extents = model.blocks.iter().map(|block| view.extent(&model.rest, block));
        let extent = extents.fold(NOWHERE, join);
        let longest = (0..3).map(|c| extent[1][c] - extent[0][c]).fold(0.0, f32::max);
        let cell = f64::from(longest.max(f32::MIN_POSITIVE)) / f64::from(params.resolution);
        let mut grid = Self {
            params: params.clone(),
            cell,
            sample_mass: 0.0,
            densest: 0.0,
            fullest_at_rest: [1.0; 2],
            patches: patch::patches(model, cell),
            volumes: vec![[Row([0.0; LANES]); 2]; model.rest_lengths.len() / 3],
            bounds: Bounds::default(),
            nodes: Vec::new(),
            marks: Vec::new(),
            pressure: Fields::default(),
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
        self.patches.iter().flat_map(|patch| &patch.points).copied()
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
        let patches: usize = self.patches.iter().map(Patch::bytes).sum();
        patches
            + size_of_val(&*self.volumes)
            + self.nodes.capacity() * size_of::<Node>()
            + self.marks.capacity()
            + self.pressure.bytes()
    }

    /// The nodes of strips with hair, each with its index.
    pub(crate) fn filled_nodes(&self) -> impl Iterator<Item = (usize, &Node)> {
        let marked = self.marks.iter().enumerate().filter(|(_, mark)| **mark != 0);
        marked.flat_map(|(strip, _)| {
            let first = STRIP * strip;
            (first..).zip(&self.nodes[first..first + STRIP])
        })
    }

    /// The cells that held hair in the last exchange, without those of less than [`LOOSE`] of the
    /// density at rest, in which no pressure acts.
    ///
    /// [`LOOSE`]: solve_pressure::LOOSE
    pub fn cells(&self) -> impl Iterator<Item = GridCell> {
        let Fields { densities, pressures: [pressure, _], .. } = &self.pressure;
        let filled = self.filled_nodes().filter(|(_, node)| node.mass() > 0.0);
        filled.filter(|(index, _)| densities[*index] >= LOOSE).map(|(index, _)| {
            let place = self.bounds.place(index);
            let at = [0, 1, 2].map(|c| self.bounds.low[c] + place[c] as i32);
            GridCell { at, density: densities[index], is_pressed: pressure[index] > 0.0 }
        })
    }

    /// Splats the hair, solves for the pressure, and changes the velocities of all particles except
    /// the first `clamped` of each strand; where hair is too dense it changes positions too, and
    /// subtracts the displacements from `clearance` (a row a place, or empty). Positions are
    /// relative to the origin of `moment`.
    pub fn exchange<T: Real>(
        &mut self,
        model: &Model<T>,
        positions: &mut [Row<T>],
        velocities: &mut [Row<T>],
        clearance: &mut [Row<T>],
        moment: &GridMoment<'_>,
    ) -> GridReport {
        let clock = std::time::Instant::now();
        splat_segments::splat(self, model, [&*positions, &*velocities], &moment.frame);
        let splat = clock.elapsed().as_secs_f64();
        let mut report = solve_pressure::solve(self, moment);
        let solved = clock.elapsed().as_secs_f64();
        let displaces = report.farthest_m > 0.0;
        let rows = ParticleRows { positions, velocities, clearance };
        gather_velocities::gather(self, model, rows, moment, displaces);
        report.secs = [splat, solved - splat, clock.elapsed().as_secs_f64() - solved];
        report
    }
}

/// Density ρ of a cell, relative to that of the same hair at rest, from Σ w V and Σ w V φ₀.
#[inline(always)]
pub(crate) fn density([filled, at_rest]: [f32; 2]) -> f32 {
    if at_rest > 0.0 { filled * filled / at_rest } else { 0.0 }
}
