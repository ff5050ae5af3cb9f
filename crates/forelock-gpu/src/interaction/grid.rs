//! The grid on the device: particle to grid, pressure, grid to particle.
//!
//! # Practice
//! The device finds the box of the hair, so a frame reads nothing back. There is room for a cube
//! about the ball that holds the hair at rest, for `max_cells` and for what the device can bind,
//! whichever is least; hair beyond it is left alone, as beyond `max_cells` on the CPU. A fixed
//! number of threads iterates over the cells.
//!
//! # Limitations
//! The over-relaxation of the pressure is tuned for hair as thick as a seventh of the longest side
//! of the rest shape; for much thicker hair the allowed sweeps leave a larger residual than on the
//! CPU.

use crate::batch::DeviceStrands;
use crate::collide::{BENDING, MOST_SOLIDS, QueryUniform, SHAPE_CONSTANTS, Solids, queries};
use crate::interaction::{GpuInteraction, InteractionFrame, Kind, boxed};
use crate::kernel::{Bound, Constant, DispatchList, StrandThreads, Threads, bindings, shader};
use crate::report::GpuReport;
use crate::uniforms::{FrameUniform, NO_EXTENT, ReportEntry};
use crate::{Gpu, GpuError};
use bytemuck::{Pod, Zeroable};
use forelock_core::body::SHAPES_WGSL;
use forelock_core::frame::{Exchange, Span};
use forelock_core::interaction::grid::solve_pressure::{LOOSE, SLACK, SPARSE, SWEEPS, relaxation};
use forelock_core::interaction::grid::{
    self, Grid, GridFrame, GridParams, GridPlacement, GridReport, MARGIN, SolidMaps,
};
use forelock_core::interaction::grid::{gather_velocities, solve_pressure, splat_segments};
use glam::{DAffine3, DMat3, DMat4, DVec3, IVec3, Mat4, UVec3};
use wgpu::BufferUsages;

/// Largest speed relative to the head that the grid transfers, m/s.
const FASTEST: f32 = 64.0;
/// Cells from the grid's origin, beyond which hair is left alone.
const MOST_OUT: f32 = 8192.0;
/// Nodes that a workgroup sums in its own memory: 28 bytes each, of the 16 KiB that WebGPU grants.
const SLOTS: u32 = 512;
/// Slots in which a node may lie.
const PROBES: u32 = 8;
/// Edges of each strand that a workgroup sums before it adds the sums to memory.
const FLUSH_EDGES: u32 = 8;
/// Numbers per cell.
const PLANES: u64 = 10;

const GRID_CONSTANTS: &[Constant] = &[Constant::u32("MOST_SOLIDS", MOST_SOLIDS as u32)];

const SPLAT_CONSTANTS: &[Constant] = &[
    Constant::i32("MARGIN", MARGIN),
    Constant::f32("FASTEST", FASTEST),
    Constant::f32("MOST_OUT", MOST_OUT),
    Constant::u32("SLOTS", SLOTS),
    Constant::u32("SLOT_NUMBERS", 6 * SLOTS),
    Constant::u32("PROBES", PROBES),
    Constant::u32("FLUSH_EDGES", FLUSH_EDGES),
];

const PRESSURE_CONSTANTS: &[Constant] =
    &[Constant::u32("SWEEPS", SWEEPS), Constant::f32("LOOSE", LOOSE), Constant::f32("SLACK", SLACK)];

bindings! {
    /// From strands to the grid.
    pub(crate) struct SplatBindings {
        2 blocks: read,
        3 model: read,
        5 positions: read_write,
        6 velocities: read_write,
        12 volumes: read,
        13 cells: read_write,
        14 bounds: read_write,
        16 grid: uniform(GridUniform),
    }
}

bindings! {
    /// The grid alone.
    pub(crate) struct CellBindings {
        10 fields: read,
        11 query: dynamic(QueryUniform),
        13 cells: read_write,
        14 bounds: read_write,
        15 nodes: read_write,
        16 grid: uniform(GridUniform),
    }
}

bindings! {
    /// From the grid to strands.
    pub(crate) struct GatherBindings {
        0 frame: uniform(FrameUniform),
        2 blocks: read,
        3 model: read,
        5 positions: read_write,
        6 velocities: read_write,
        7 memory: read_write,
        14 bounds: read_write,
        15 nodes: read,
        16 grid: uniform(GridUniform),
    }
}

shader! {
    /// `splat_segments`.
    SPLAT: "splat_segments", SplatBindings;
    texts: [grid::WGSL, splat_segments::WGSL];
    constants: [GRID_CONSTANTS, SPLAT_CONSTANTS];
    kernels: {
        /// Measures the extent of the hair.
        MEASURE_HAIR: "measure_hair", Threads::Strands;
        /// Fits the box around it.
        FIT_GRID: "fit_grid", Threads::ONCE;
        /// Clears the box.
        CLEAR_GRID: "clear_grid", Threads::CELLS;
        /// Transfers mass and momentum of segments to the grid.
        SPLAT_SEGMENTS: "splat_segments", Threads::Strands;
    }
}

shader! {
    /// `solve_pressure`.
    SOLVE: "solve_pressure", CellBindings;
    texts: [grid::WGSL, SHAPES_WGSL, solve_pressure::WGSL];
    constants: [SHAPE_CONSTANTS, BENDING, PRESSURE_CONSTANTS];
    kernels: {
        /// Marks cells inside solids.
        MARK_SOLID_CELLS: "mark_solid_cells", Threads::CELLS;
        /// Turns integer sums into momenta, masses and densities.
        NORMALIZE_VELOCITY: "normalize_velocity", Threads::CELLS;
        /// Computes the divergence to be removed from velocities.
        COMPUTE_DIVERGENCE: "compute_divergence", Threads::CELLS;
        /// Computes the excess of volume to be removed by displacements.
        COMPUTE_EXCESS: "compute_excess", Threads::CELLS;
        /// A sweep over the red cells.
        RELAX_RED: "relax_red", Threads::LIST;
        /// A sweep over the black cells.
        RELAX_BLACK: "relax_black", Threads::LIST;
        /// Checks whether sweeps still change the pressure.
        CHECK_CONVERGENCE: "check_convergence", Threads::ONCE;
        /// Applies the pressure to velocities.
        APPLY_VELOCITY_PRESSURE: "apply_velocity_pressure", Threads::CELLS;
        /// Applies the pressure to displacements.
        APPLY_DISPLACEMENT_PRESSURE: "apply_displacement_pressure", Threads::CELLS;
    }
}

shader! {
    /// `gather_velocities`.
    GATHER: "gather_velocities", GatherBindings;
    texts: [grid::WGSL, gather_velocities::WGSL];
    constants: [GRID_CONSTANTS];
    kernels: {
        /// Transfers changes of velocity and displacements to particles.
        GATHER_VELOCITIES: "gather_velocities", Threads::Strands;
    }
}

/// Registers the grid.
pub(crate) static KIND: Kind = Kind {
    name: grid::EXCHANGE.name,
    shaders: &[&SPLAT, &SOLVE, &GATHER],
    make: |gpu, strands, all| boxed(all.grid.as_ref().map(|params| DeviceGrid::new(gpu, strands, params))),
};

/// A solid in the frame of the grid: `GridSolid` in the kernels.
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
    /// Hair below which a face is closed, metres.
    pub least: f32,
    /// Metres of hair that count as one while they are summed.
    pub unit: f32,
    /// Change of a sweep at which the pressure has converged, over the largest right-hand side.
    pub tolerance: f32,
    /// Numbers in a plane: cells at most.
    pub capacity: u32,
    /// Solids.
    pub solids: u32,
    /// Over-relaxation of the pressure.
    pub relaxation: f32,
    /// Cells that count as one while volumes V and V φ₀ are summed.
    pub volumes: [f32; 2],
    /// The first `solids` are used.
    pub each: [GridSolidEntry; MOST_SOLIDS],
}

/// The box and the results of the frame: `Bounds` in the kernels.
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
    /// Bits of the density of the densest cell.
    pub densest: u32,
    /// Bits of the largest right-hand side.
    pub lack: u32,
    /// Bits of the largest change since the last check.
    pub change: u32,
    /// Cells under pressure.
    pub held: u32,
    /// Whether the pressure has converged.
    pub found: u32,
    /// Sweeps of all pressure solves of the frame.
    pub sweeps: u32,
    /// Red and black cells that can be under pressure.
    pub listed: [u32; 2],
    /// Bits of the last change over the largest right-hand side.
    pub ratio: u32,
    /// Bits of the largest such ratio at the end of a pressure solve of the frame.
    pub residual: u32,
}

impl BoundsEntry {
    /// The report of a frame.
    fn report(&self) -> GridReport {
        GridReport {
            cells: self.held as usize,
            iterations: self.sweeps,
            residual: f32::from_bits(self.residual).into(),
            densest: f32::from_bits(self.densest).into(),
            ..GridReport::default()
        }
    }
}

/// The grid of a simulation.
#[derive(Debug)]
struct DeviceGrid {
    params: GridParams,
    uniform: wgpu::Buffer,
    bounds: wgpu::Buffer,
    cells: wgpu::Buffer,
    nodes: wgpu::Buffer,
    /// The volumes of the hair of each edge, two rows a place: a buffer a batch.
    volumes: Vec<wgpu::Buffer>,
    groups: GridGroups,
    host: Box<GridUniform>,
    cell: f64,
    /// Number of a query whose solids are at the frame's end.
    query: u32,
}

#[derive(Debug, Default)]
struct GridGroups {
    splat: Vec<Bound<SplatBindings<'static>>>,
    cells: Vec<Bound<CellBindings<'static>>>,
    gather: Vec<Bound<GatherBindings<'static>>>,
}

impl DeviceGrid {
    /// A grid for `strands`, to be bound before the first frame.
    fn new(gpu: &Gpu, strands: DeviceStrands<'_>, params: &GridParams) -> Result<Self, GpuError> {
        params.validate()?;
        let model = strands.model;
        let own = Grid::new(model, params);
        let cell = own.cell();
        let points: Vec<u32> = own.samples_per_edge().map(|points| points as u32).collect();
        let side = 2.0 * (model.reach / cell).ceil() + f64::from(2 * MARGIN + 1);
        let bindable = gpu.most_bound() / (4 * PLANES);
        let capacity = (side.powi(3) as u64).min(params.max_cells.into()).min(bindable);
        let storage = BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
        let empty = BoundsEntry { extent: NO_EXTENT, ..BoundsEntry::zeroed() };
        let bounds = gpu.filled("bounds", bytemuck::bytes_of(&empty), storage);
        let volumes = strands.batches.iter().map(|batch| {
            batch.set_points(gpu, model, &points);
            gpu.filled("volumes", bytemuck::cast_slice(&own.volumes()[batch.places.clone()]), storage)
        });
        let unit = own.densest().max(own.sample_mass());
        let host = GridUniform {
            cell: cell as f32,
            least: SPARSE * own.sample_mass(),
            unit,
            volumes: own.fullest_at_rest().map(|most| most.max(f32::MIN_POSITIVE)),
            tolerance: params.tolerance as f32,
            capacity: capacity as u32,
            relaxation: relaxation(params.resolution),
            ..GridUniform::zeroed()
        };
        Ok(Self {
            volumes: volumes.collect(),
            params: params.clone(),
            uniform: gpu.buffer(
                "grid",
                size_of::<GridUniform>() as u64,
                BufferUsages::UNIFORM | BufferUsages::COPY_DST,
            ),
            bounds,
            cells: gpu.buffer("cells", 4 * PLANES * capacity, storage),
            nodes: gpu.buffer("nodes", 32 * capacity, storage),
            groups: GridGroups::default(),
            query: 0,
            host: Box::new(host),
            cell,
        })
    }

    /// Appends the sweeps of a pressure, with a check every [`SWEEPS`] and after the last.
    fn relax<'a>(&'a self, list: &mut DispatchList<'a>, query: &[u32]) {
        let cells = &self.groups.cells;
        for sweep in 1..=self.params.iterations.next_multiple_of(SWEEPS) {
            list.run(cells, &RELAX_RED, query);
            list.run(cells, &RELAX_BLACK, query);
            if sweep % SWEEPS == 0 {
                list.run(cells, &CHECK_CONVERGENCE, query);
            }
        }
    }
}

impl GpuInteraction for DeviceGrid {
    fn exchange_plan(&self) -> Exchange {
        grid::EXCHANGE
    }

    fn bind(&mut self, gpu: &Gpu, strands: DeviceStrands<'_>, solids: &Solids) {
        let mut groups = GridGroups::default();
        for (batch, volumes) in strands.batches.iter().zip(&self.volumes) {
            let bindings = SplatBindings {
                blocks: &batch.blocks,
                model: &batch.model,
                positions: &batch.positions,
                velocities: &batch.velocities,
                volumes,
                cells: &self.cells,
                bounds: &self.bounds,
                grid: &self.uniform,
            };
            groups.splat.push(bindings.bind(gpu, batch.threads));
            let bindings = GatherBindings {
                frame: &strands.shared.frame,
                blocks: &batch.blocks,
                model: &batch.model,
                positions: &batch.positions,
                velocities: &batch.velocities,
                memory: &batch.memory,
                bounds: &self.bounds,
                nodes: &self.nodes,
                grid: &self.uniform,
            };
            groups.gather.push(bindings.bind(gpu, batch.threads));
        }
        let bindings = CellBindings {
            fields: &solids.fields,
            query: &solids.queries,
            cells: &self.cells,
            bounds: &self.bounds,
            nodes: &self.nodes,
            grid: &self.uniform,
        };
        groups.cells.push(bindings.bind(gpu, StrandThreads::default()));
        self.groups = groups;
    }

    fn write_frame(&mut self, gpu: &Gpu, frame: &InteractionFrame<'_>) {
        let InteractionFrame { input, poses: [.., before, now], origin, substeps, .. } = *frame else {
            return;
        };
        let (dt, cell, params) = (input.dt_secs, self.cell, &self.params);
        let moving = &GridFrame::new(before, now, dt / f64::from(substeps));
        let axes = moving.rotation.transpose();
        let host = &mut *self.host;
        host.place = matrix(affine(axes * (1.0 / cell), DVec3::ZERO));
        let motion = affine(axes * moving.motion.matrix3, axes * moving.motion.translation);
        host.motion = matrix(motion);
        host.axes = matrix(affine(axes, DVec3::ZERO));
        host.pic = params.pic_share(dt) as f32;
        host.slack = (cell / dt) as f32;
        host.expand = params.expansion(dt) as f32;
        host.solids = input.colliders.len() as u32;
        let last_span = frame.spans.last().copied().unwrap_or(Span::whole(substeps));
        self.query = queries::at_end(last_span, queries::FINAL, substeps);
        let last = 1.0 - 1.0 / f64::from(substeps);
        let h = dt * (1.0 - last);
        let placement = GridPlacement { frame: moving, cell, origin, last_substep: last, h };
        for (entry, solid) in host.each.iter_mut().zip(input.colliders) {
            let maps = SolidMaps::new(solid, &placement);
            *entry = GridSolidEntry { local: matrix(maps.local), velocity: matrix(maps.velocity) };
        }
        gpu.queue().write_buffer(&self.uniform, 0, bytemuck::bytes_of(host));
    }

    fn exchange<'a>(&'a self, list: &mut DispatchList<'a>, _: Span) {
        let GridGroups { splat, cells, gather } = &self.groups;
        let query = &[self.query];
        for kernel in [&MEASURE_HAIR, &FIT_GRID, &CLEAR_GRID, &SPLAT_SEGMENTS] {
            list.run(splat, kernel, &[]);
        }
        for kernel in [&MARK_SOLID_CELLS, &NORMALIZE_VELOCITY, &COMPUTE_DIVERGENCE] {
            list.run(cells, kernel, query);
        }
        self.relax(list, query);
        list.run(cells, &APPLY_VELOCITY_PRESSURE, query);
        list.run(cells, &COMPUTE_EXCESS, query);
        self.relax(list, query);
        list.run(cells, &APPLY_DISPLACEMENT_PRESSURE, query);
        list.run(gather, &GATHER_VELOCITIES, &[]);
    }

    fn report_buffer(&self) -> Option<&wgpu::Buffer> {
        Some(&self.bounds)
    }

    fn add_report(&self, bytes: &[u8], _: &ReportEntry, report: &mut GpuReport) {
        report.grid = Some(bytemuck::pod_read_unaligned::<BoundsEntry>(bytes).report());
    }

    fn rebuild(&self, gpu: &Gpu, strands: DeviceStrands<'_>) -> Result<Box<dyn GpuInteraction>, GpuError> {
        Ok(Box::new(Self::new(gpu, strands, &self.params)?))
    }

    fn bytes(&self) -> u64 {
        let own = [&self.uniform, &self.bounds, &self.cells, &self.nodes];
        own.into_iter().chain(&self.volumes).map(|buffer| buffer.size()).sum()
    }
}

/// A map M x + b.
fn matrix(DAffine3 { matrix3: m, translation: b }: DAffine3) -> Mat4 {
    let column = |c: usize| m.col(c).extend(0.0);
    DMat4::from_cols(column(0), column(1), column(2), b.extend(1.0)).as_mat4()
}

fn affine(matrix3: DMat3, translation: DVec3) -> DAffine3 {
    DAffine3 { matrix3, translation }
}
