//! The grid on the device.
//!
//! # Practice
//! Its box is found on the device, so that nothing comes back in a frame. There is room for a cube about the ball that holds the hair at rest, for `max_cells` and for what the device binds at once,
//! whichever is least; of hair that spreads farther the ends are left alone, as beyond `max_cells` on the CPU. Cells are gone through by a fixed count of threads, each of which takes one in so
//! many.
//!
//! # Limitations
//! The pressure's over-relaxation is made for hair as thick as a seventh of the rest shape's longest side; of much thicker hair the allowed sweeps leave more of the pressure out than on the CPU.

use crate::batch::Batch;
use crate::layout::NO_EXTENT;
use crate::solids::MOST_SOLIDS;
use crate::{Gpu, GpuError};
use bytemuck::{Pod, Zeroable};
use forelock_core::interaction::grid::{Grid, GridFrame, GridParams, GridReport, MARGIN, SolidMaps};
use forelock_core::strands::Model;
use forelock_core::frame::Frame;
use forelock_core::interaction::grid::solve_pressure::SPARSE;
use glam::{DMat3, DMat4, DVec3, IVec3, Mat4, UVec3};
use wgpu::BufferUsages;

/// Threads of a workgroup that goes through cells.
pub const CELLS_GROUP: u32 = 256;
/// Threads of a dispatch over cells.
pub const CELLS_THREADS: u32 = 512 * CELLS_GROUP;
/// Threads of a dispatch over a list: of cells that can be held, of contacts.
pub const LIST_THREADS: u32 = 128 * CELLS_GROUP;
/// The rest shape's longest side over the thickness of its hair, about.
const THINNESS: f64 = 7.0;
/// Sweeps after which the pressure is looked at.
pub(crate) const SWEEPS: u32 = 4;
/// Speed relative to the head with which hair counts at most, m/s.
pub const FASTEST: f32 = 64.0;
/// Cells from the grid's origin, beyond which hair is left alone.
pub const MOST_OUT: f32 = 8192.0;
/// Planes of numbers a cell.
const PLANES: u64 = 11;

/// A solid as the grid sees it: `GridSolid` in the kernels.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct GridSolidEntry {
    /// Its own space from cells.
    pub local: Mat4,
    /// Its velocity relative to the grid from cells, m/s.
    pub velocity: Mat4,
}

/// The grid in a frame: `Grid` in the kernels.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct GridUniform {
    /// Cells from positions.
    pub place: Mat4,
    /// Velocity of the grid along its axes, from positions.
    pub motion: Mat4,
    /// Grid axes from world axes.
    pub axes: Mat4,
    /// Side of a cell, metres.
    pub cell: f32,
    /// Share of PIC.
    pub pic: f32,
    /// Cell over the frame's time, m/s.
    pub slack: f32,
    /// Share of an excess that expands in the frame.
    pub expand: f32,
    /// Hair under which a face lets nothing through, metres.
    pub least: f32,
    /// Metres of hair that count as one while they are summed.
    pub unit: f32,
    /// Change of a sweep at which the pressure is found, over what lacks at most.
    pub tolerance: f32,
    /// Numbers in a plane: cells at most.
    pub capacity: u32,
    /// Solids.
    pub solids: u32,
    /// Over-relaxation of the pressure.
    pub relaxation: f32,
    /// Share of a cell that counts as one while rooms are summed.
    pub room: f32,
    /// Nothing.
    pub pad_0: u32,
    /// The first `solids` are there.
    pub each: [GridSolidEntry; MOST_SOLIDS],
}

/// The box and what is found on it: `Bounds` in the kernels.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct BoundsEntry {
    /// The first cell.
    pub low: IVec3,
    /// Cells.
    pub count: u32,
    /// Cells along each axis.
    pub dims: UVec3,
    /// Cells in a layer.
    pub layer: u32,
    /// Extent of the hair, ordered as integers.
    pub extent: [u32; 6],
    /// Bits of the fullest cell's share.
    pub fullest: u32,
    /// Bits of the largest lack.
    pub lack: u32,
    /// Bits of the largest change since it was last looked at.
    pub change: u32,
    /// Cells under pressure.
    pub held: u32,
    /// Whether the pressure is found.
    pub found: u32,
    /// Sweeps that the frame's pressures took.
    pub sweeps: u32,
    /// Even and odd cells that can be held.
    pub listed: [u32; 2],
    /// Bits of the last change over the largest lack.
    pub ratio: u32,
    /// Bits of the largest such ratio with which a pressure of the frame was left.
    pub residual: u32,
}

impl BoundsEntry {
    /// What it says of a frame.
    pub(crate) fn report(&self) -> GridReport {
        GridReport {
            cells: self.held as usize,
            iterations: self.sweeps,
            residual: f32::from_bits(self.residual).into(),
            fullest: f32::from_bits(self.fullest).into(),
            ..GridReport::default()
        }
    }
}

/// The grid of a simulation.
#[derive(Debug)]
pub(crate) struct DeviceGrid {
    pub params: GridParams,
    pub uniform: wgpu::Buffer,
    pub bounds: wgpu::Buffer,
    pub cells: wgpu::Buffer,
    pub faces: wgpu::Buffer,
    /// Cells that the hair of each edge fills at rest, a row a place: a buffer a batch.
    pub rooms: Vec<wgpu::Buffer>,
    host: Box<GridUniform>,
    cell: f64,
}

impl DeviceGrid {
    /// A grid for the strands of `model`, which are on the device in `batches`.
    pub fn new(
        gpu: &Gpu,
        model: &Model<f32>,
        batches: &[&Batch],
        params: &GridParams,
    ) -> Result<Self, GpuError> {
        params.validate()?;
        let own = Grid::new(model, params);
        let cell = own.cell();
        let points: Vec<u32> = own.samples_per_edge().map(|points| points as u32).collect();
        let side = 2.0 * (model.reach / cell).ceil() + f64::from(2 * MARGIN + 1);
        let room = gpu.most_bound() / (4 * PLANES);
        let capacity = (side.powi(3) as u64).min(params.max_cells.into()).min(room);
        let storage = BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
        let empty = BoundsEntry { extent: NO_EXTENT, ..BoundsEntry::zeroed() };
        let bounds = gpu.filled("bounds", bytemuck::bytes_of(&empty), storage);
        let rooms = batches.iter().map(|batch| {
            batch.set_points(gpu, model, &points);
            gpu.filled("rooms", bytemuck::cast_slice(&own.rooms()[batch.places.clone()]), storage)
        });
        let unit = own.densest().max(own.sample_mass());
        let host = GridUniform {
            cell: cell as f32,
            least: SPARSE * own.sample_mass(),
            unit,
            room: own.fullest_at_rest().max(f32::MIN_POSITIVE),
            tolerance: params.tolerance as f32,
            capacity: capacity as u32,
            relaxation: relaxation(params.resolution),
            ..GridUniform::zeroed()
        };
        Ok(Self {
            rooms: rooms.collect(),
            params: params.clone(),
            uniform: gpu.buffer(
                "grid",
                size_of::<GridUniform>() as u64,
                BufferUsages::UNIFORM | BufferUsages::COPY_DST,
            ),
            bounds,
            cells: gpu.buffer("cells", 4 * PLANES * capacity, storage),
            faces: gpu.buffer("faces", 8 * 3 * capacity, storage),
            host: Box::new(host),
            cell,
        })
    }

    /// Bytes held on the device.
    pub fn bytes(&self) -> u64 {
        let own = [&self.uniform, &self.bounds, &self.cells, &self.faces];
        own.into_iter().chain(&self.rooms).map(|buffer| buffer.size()).sum()
    }

    /// Brings a frame of `substeps` to the device, in which the grid moves as `moving` has it, positions being relative to `origin`.
    pub fn place(
        &mut self,
        gpu: &Gpu,
        (frame, substeps): (&Frame<'_>, u32),
        moving: &GridFrame,
        origin: DVec3,
    ) {
        let (dt, cell, params) = (frame.dt_secs, self.cell, &self.params);
        let axes = moving.rotation.transpose();
        let host = &mut *self.host;
        host.place = matrix((axes * (1.0 / cell), DVec3::ZERO));
        host.motion = matrix((axes * moving.motion.0, axes * moving.motion.1));
        host.axes = matrix((axes, DVec3::ZERO));
        host.pic = params.pic_share(dt) as f32;
        host.slack = (cell / dt) as f32;
        host.expand = params.expansion(dt) as f32;
        host.solids = frame.colliders.len() as u32;
        let last = 1.0 - 1.0 / f64::from(substeps);
        for (entry, solid) in host.each.iter_mut().zip(frame.colliders) {
            let maps = SolidMaps::new(solid, (last, dt * (1.0 - last)), origin, (moving, cell));
            *entry = GridSolidEntry { local: matrix(maps.local), velocity: matrix(maps.velocity) };
        }
        gpu.queue().write_buffer(&self.uniform, 0, bytemuck::bytes_of(host));
    }
}

/// The best ω for hair n cells thick with free cells on both sides: 2/(1 + sin π/n) (Young 1954).
fn relaxation(resolution: u32) -> f32 {
    let cells = (f64::from(resolution) / THINNESS).max(2.0);
    (2.0 / (1.0 + (std::f64::consts::PI / cells).sin())) as f32
}

/// A map M x + b.
fn matrix((m, b): (DMat3, DVec3)) -> Mat4 {
    let column = |c: usize| m.col(c).extend(0.0);
    DMat4::from_cols(column(0), column(1), column(2), b.extend(1.0)).as_mat4()
}
