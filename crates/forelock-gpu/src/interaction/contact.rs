//! Contacts between segments of strands on the device.
//!
//! # Practice
//! The result is that of the CPU, the search differs: entries lie in a table of cells, sorted by
//! counting, in which cells that are neighbours along x are adjacent; each active segment is one
//! workgroup, whose threads share the entries near it. A frame reads nothing back, and no result
//! depends on the order of threads: sums are of integers; where a list is full, what is kept
//! depends on the entries, not on their order; each sum of floats is computed by one thread, over a
//! list sorted by time. Lists have room for more than the budget selects on average, by many
//! standard deviations.
//!
//! Memory: 12 bytes per particle, and a table of 8 or more. The rest, 76 bytes per particle or more
//! and what the budget needs (10 MB by default), lies in the scratch of the strands where that is
//! large enough: from 230,000 particles on, if they are one batch; several batches need a second
//! copy of the model, 28 bytes per particle.
//!
//! # Limitations
//! One binding bounds the strands: 76 bytes per particle, 1.7 million particles where a device
//! binds 128 MiB. Of an active segment the [`SLOTS`] contacts of the fastest approach are resolved,
//! where the CPU resolves all; of those each segment keeps the first `per_segment` on both. Of
//! contacts that approach about as fast as the slowest within the budget an evenly spread share is
//! selected, another one than on the CPU; the budget is that of the whole frame, where the CPU
//! keeps it slice by slice. A share is also selected of a run of more than `RUN_SEGMENTS` segments.
//! A residual motion of more than 64 edges counts as 64 when the frame is cut into slices. Of a
//! segment stretched by more than a quarter of its rest length only the middle may be found.

use crate::batch::{DeviceStrands, model_rows};
use crate::collide::Solids;
use crate::frame::MODEL_ROWS;
use crate::interaction::table::{self, ROW_CELLS};
use crate::interaction::{GpuInteraction, InteractionFrame, Kind, boxed};
use crate::kernel::{Bound, Constant, DispatchList, StrandThreads, Threads, bindings, shader};
use crate::report::GpuReport;
use crate::uniforms::{NO_EXTENT, ReportEntry, rigid};
use crate::{Gpu, GpuError};
use bytemuck::{Pod, Zeroable};
use forelock_core::frame::{Exchange, SPANS, Span};
use forelock_core::interaction::contact::find_contacts::{self, FEW, SEGMENT_CONTACTS, SLICES, search_edge};
use forelock_core::interaction::contact::{
    self, ContactParams, ContactReport, histogram, hold_hair, mean_motion, resolve_contacts,
};
use forelock_core::lane::{LANES, Row};
use glam::{Mat4, UVec3, Vec3};
use wgpu::BufferUsages;

/// Contacts that are resolved of an active segment.
pub const SLOTS: u32 = 64;
/// Contacts that an active segment may find in a slice, with those of earlier slices.
const FOUND: u32 = 512;
/// Entries that the threads of an active segment queue before they test them.
const QUEUE: u32 = 512;
/// Workgroups that share the active segments.
const PAIR_GROUPS: u32 = 2048;
/// Maximum length of an entry, over the length that the search is made for. Longer segments are
/// split into pieces.
const PIECE: f32 = 1.25;
/// Maximum number of pieces of a segment.
const PIECES: f32 = 256.0;
/// Maximum number of segments in a row of cells against which an active segment is tested.
const RUN_SEGMENTS: u32 = 4096;
/// Rows of `work` a place that hold displacements.
const MOTION_ROWS: u64 = 4;
/// Rows of bodies in `work` a place.
const BODY_ROWS: u64 = 15;
/// Numbers of a joint.
const JOINT_NUMBERS: u64 = 28;
/// Numbers of both sides of a joint.
const SIDE_NUMBERS: u64 = 8;

const CONSTANTS: &[Constant] = &[
    Constant::u32("BINS", histogram::BINS as u32),
    Constant::u32("BIN_BITS", histogram::BIN_BITS),
    Constant::u32("MOTION_ROWS", MOTION_ROWS as u32),
    Constant::u32("BODY_ROWS", BODY_ROWS as u32),
    Constant::f32("PIECES", PIECES),
    Constant::f32("HALF_PIECE", 0.5 * 1.25 * PIECE), // Pieces may be stretched by a quarter.
    Constant::f32("REACH_ACTIVE", find_contacts::REACH[0]),
    Constant::f32("REACH_OTHER", find_contacts::REACH[1]),
    Constant::f32("FRICTION_SPACING", hold_hair::SPACING),
    Constant::f32("SQUARE_UNIT", (1u32 << 16) as f32),
];

const STRAND_CONSTANTS: &[Constant] = &[
    Constant::u32("EVERY", mean_motion::EVERY as u32),
    Constant::f32("MEAN_MOTION_UNIT", (1u32 << 22) as f32),
    Constant::u32("GROUP", hold_hair::GROUP as u32),
];

const PAIR_CONSTANTS: &[Constant] = &[
    Constant::u32("MEAN_MOTION_NODES", mean_motion::NODES as u32),
    Constant::u32("SLICES", SLICES),
    Constant::u32("FOLLOW_STEPS", find_contacts::STEPS as u32),
    Constant::u32("PAIR_GROUPS", PAIR_GROUPS),
    Constant::u32("SLOTS", SLOTS),
    Constant::u32("FOUND", FOUND),
    Constant::u32("QUEUE", QUEUE),
    Constant::u32("RUN_SEGMENTS", RUN_SEGMENTS),
    Constant::f32("FOLLOW_CLOSE", find_contacts::CLOSE),
    Constant::f32("REST_SHARE", find_contacts::REST_SHARE),
];

const JOINT_CONSTANTS: &[Constant] = &[Constant::f32("BEND", resolve_contacts::BEND)];

bindings! {
    /// From strands to segments in cells.
    pub(crate) struct InsertBindings {
        2 blocks: read,
        3 model: read,
        5 positions: read_write,
        25 starts: read_write,
        26 work: read_write,
        27 table: read_write,
        28 touch: read_write,
        29 contacts: dynamic(ContactUniform),
    }
}

bindings! {
    /// Segments and joints of all strands.
    pub(crate) struct PairBindings {
        9 report: read_write,
        25 starts: read_write,
        26 work: read_write,
        27 table: read_write,
        28 touch: read_write,
        29 contacts: dynamic(ContactUniform),
        30 rest: read,
        31 owners: read,
    }
}

bindings! {
    /// Strands that contacts move.
    pub(crate) struct MoveBindings {
        2 blocks: read,
        3 model: read,
        5 positions: read_write,
        6 velocities: read_write,
        7 memory: read_write,
        26 work: read_write,
        27 table: read_write,
        28 touch: read_write,
        29 contacts: dynamic(ContactUniform),
    }
}

shader! {
    /// `find_contacts`, strand by strand.
    INSERT: "find_contacts", InsertBindings;
    texts: [contact::WGSL, find_contacts::STRANDS_WGSL, hold_hair::WGSL];
    constants: [CONSTANTS, STRAND_CONSTANTS];
    kernels: {
        /// Records positions at the frame's start.
        RECORD_START: "record_start", Threads::Strands;
        /// Records positions at the frame's end and measures their extent.
        RECORD_END: "record_end", Threads::Strands;
        /// Sums displacements at the nodes of the mean motion.
        SPLAT_MEAN_MOTION: "splat_mean_motion", Threads::Strands;
        /// Measures how far each particle moves relative to the mean motion.
        MEASURE_RESIDUAL_MOTION: "measure_residual_motion", Threads::Strands;
        /// Sums at the nodes what friction averages.
        SUM_MOTION: "sum_motion", Threads::Strands;
        /// Sums what friction changes at the nodes.
        SUM_CHANGES: "sum_changes", Threads::Strands;
        /// Writes the changes of each particle, the mean of which is zero.
        BALANCE_CHANGES: "balance_changes", Threads::Strands;
        /// Lists the segments whose contacts are searched.
        LIST_ACTIVE: "list_active", Threads::Strands;
        /// Counts the segments of each cell the first time, stores them the second.
        INSERT_SEGMENTS: "insert_segments", Threads::Strands;
    }
}

shader! {
    /// `find_contacts`, over all strands.
    FIND: "find_contacts", PairBindings;
    texts: [
        contact::WGSL,
        contact::TABLE_WGSL,
        find_contacts::ACTIVE_WGSL,
        find_contacts::PAIRS_WGSL,
        find_contacts::BUDGET_WGSL,
    ];
    constants: [CONSTANTS, table::CONSTANTS, PAIR_CONSTANTS];
    kernels: {
        /// Fits the nodes of the mean motion to the extent of the hair.
        FIT_MEAN_MOTION: "fit_mean_motion", Threads::ONCE;
        /// Fits those of friction.
        FIT_FRICTION: "fit_friction", Threads::ONCE;
        /// Clears them.
        CLEAR_MEAN_MOTION: "clear_mean_motion", Threads::LIST;
        /// Turns sums into means over neighbouring nodes.
        SMOOTH_MEAN_MOTION: "smooth_mean_motion", Threads::LIST;
        /// Turns sums into means at each node.
        AVERAGE_NODES: "average_nodes", Threads::LIST;
        /// Selects active segments and the number of slices.
        SELECT_ACTIVE: "select_active", Threads::ONCE;
        /// Clears the cells.
        CLEAR_CELLS: "clear_cells", Threads::LIST;
        /// Turns the counts of cells into their first entries.
        SCAN_CELLS: "scan_cells", table::ROWS;
        /// Finds the pairs of active segments.
        FIND_PAIRS: "find_pairs", Threads::Workgroups(PAIR_GROUPS);
        /// Advances to the next slice.
        NEXT_SLICE: "next_slice", Threads::ONCE;
        /// Counts found contacts by their speed of approach.
        COUNT_FOUND: "count_found", Threads::LIST;
        /// Selects those within the budget.
        SELECT_FOUND: "select_found", Threads::ONCE;
        /// Clears the lists of joints.
        CLEAR_LINKS: "clear_links", Threads::LIST;
        /// Creates the joints of the selected contacts.
        CREATE_JOINTS: "create_joints", Threads::LIST;
    }
}

shader! {
    /// `resolve_contacts`, strand by strand.
    MOVE: "resolve_contacts", MoveBindings;
    texts: [contact::WGSL, resolve_contacts::STRANDS_WGSL, hold_hair::APPLY_WGSL];
    constants: [CONSTANTS];
    kernels: {
        /// Applies the changes of friction to positions and velocities.
        APPLY_CHANGES: "apply_changes", Threads::Strands;
        /// Factors the matrices of strands that have joints.
        PREPARE_STRANDS: "prepare_strands", Threads::Strands;
        /// Moves bodies by what a round adds to their joints.
        GATHER_MOVES: "gather_moves", Threads::Strands;
        /// Applies the moves of all rounds to positions and velocities.
        APPLY_MOVES: "apply_moves", Threads::Strands;
    }
}

shader! {
    /// `resolve_contacts`, joint by joint.
    RESOLVE: "resolve_contacts", PairBindings;
    texts: [contact::WGSL, resolve_contacts::JOINTS_WGSL];
    constants: [CONSTANTS, JOINT_CONSTANTS];
    kernels: {
        /// Reserves the list of each segment's joints.
        RESERVE_LISTS: "reserve_lists", Threads::LIST;
        /// Fills the lists.
        LINK_JOINTS: "link_joints", Threads::LIST;
        /// Sorts them by time.
        ORDER_JOINTS: "order_joints", Threads::LIST;
        /// Computes the effective mass of each joint.
        WEIGHT_JOINTS: "weight_joints", Threads::LIST;
        /// One round of relaxation.
        RELAX_JOINTS: "relax_joints", Threads::LIST;
        /// Checks whether the round was the last.
        CHECK_ROUND: "check_round", Threads::ONCE;
    }
}

/// Registers contacts.
pub(crate) static KIND: Kind = Kind {
    name: contact::EXCHANGE.name,
    shaders: &[&INSERT, &FIND, &MOVE, &RESOLVE],
    make: |gpu, strands, all| {
        boxed(all.contacts.as_ref().map(|params| DeviceContacts::new(gpu, strands, params)))
    },
};

/// Contacts in a frame: `Contacts` in the kernels, where its fields are documented.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[expect(missing_docs, reason = "documented in WGSL")]
pub struct ContactUniform {
    pub from_start: Mat4,
    pub from_end: Mat4,
    pub edge: f32,
    pub distance: f32,
    pub slip: f32,
    pub friction: f32,
    pub spread: f32,
    pub dt: f32,
    pub close: f32,
    pub far: f32,
    pub spacing: f32,
    pub inverse_piece: f32,
    pub inverse_particles: f32,
    pub hold: f32,
    pub budget: u32,
    pub most_active: u32,
    pub few: u32,
    pub per_segment: u32,
    pub rounds: u32,
    pub clamped: u32,
    pub cells: u32,
    pub entries: u32,
    pub numbers: u32,
    pub bodies: u32,
    pub found: u32,
    pub joints: u32,
    pub sides: u32,
    pub most_actives: u32,
    pub most_joints: u32,
    pub strands: u32,
}

/// The state of the search in a frame: the beginning of `Touch` in the kernels, where its fields
/// are documented.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[expect(missing_docs, reason = "documented in WGSL")]
pub struct TouchEntry {
    pub low: Vec3,
    pub spacing: f32,
    pub high: Vec3,
    pub slices: u32,
    pub dims: UVec3,
    pub slice: u32,
    pub extent: [u32; 6],
    pub squares: [u32; 2],
    pub fastest: u32,
    pub actives: u32,
    pub joints: u32,
    pub taken: u32,
    pub least: f32,
    pub bin: u32,
    pub share: f32,
    pub found_bin: u32,
    pub found_share: f32,
    pub momentum: f32,
    pub round: u32,
    pub last: u32,
    pub done: u32,
    pub lack: u32,
    pub farthest: u32,
    pub stores_entries: u32,
}

/// The contacts of a simulation.
#[derive(Debug)]
struct DeviceContacts {
    params: ContactParams,
    /// A `ContactUniform` a span, each at a multiple of `stride`.
    uniform: wgpu::Buffer,
    stride: u32,
    starts: wgpu::Buffer,
    work: wgpu::Buffer,
    table: wgpu::Buffer,
    touch: wgpu::Buffer,
    /// The model of all strands: that of the only batch, or a copy.
    rest: wgpu::Buffer,
    owners: wgpu::Buffer,
    groups: ContactGroups,
    /// Bytes of the buffers that it owns.
    bytes: u64,
    host: Box<ContactUniform>,
}

#[derive(Debug, Default)]
struct ContactGroups {
    insert: Vec<Bound<InsertBindings<'static>>>,
    pairs: Vec<Bound<PairBindings<'static>>>,
    moves: Vec<Bound<MoveBindings<'static>>>,
}

impl DeviceContacts {
    /// Contacts of `strands`, to be bound before the first frame.
    fn new(gpu: &Gpu, strands: DeviceStrands<'_>, params: &ContactParams) -> Result<Self, GpuError> {
        params.validate()?;
        let DeviceStrands { model, shared, batches } = strands;
        let edge = search_edge(model, params);
        let inverse_piece = 1.0 / (PIECE * edge);
        let (mut segments, mut entries, mut longest) = (0, 0, 0.0f32);
        for block in &model.blocks {
            for place in block.first..block.first + block.particles - 1 {
                for length in &model.rest_lengths[3 * place].0[..block.live] {
                    segments += 1;
                    entries += (length * inverse_piece).ceil().clamp(1.0, PIECES) as u64;
                    longest = longest.max(*length);
                }
            }
        }
        let budget = u64::from(params.budget);
        let most_active = budget / SEGMENT_CONTACTS as u64;
        // A particle has two segments; what the last bin has by its share may be some more.
        let most_actives = (2 * most_active + most_active / 8 + 256).min(segments).max(1);
        let most_joints = (budget + budget / 8 + 1024).min(most_actives * u64::from(SLOTS));
        let cells = entries.next_power_of_two().max(u64::from(ROW_CELLS));
        let (numbers, slots) = ((LANES * model.places()) as u64, (LANES * model.blocks.len()) as u64);
        let nodes = (mean_motion::NODES as u64 + 1).pow(3);
        let bodies = MOTION_ROWS * numbers;
        let found = bodies + (BODY_ROWS * numbers).max(5 * entries).max(4 * nodes);
        let joints = found + 2 * u64::from(SLOTS) * most_actives;
        let sides = joints + JOINT_NUMBERS * most_joints;
        let work = 4 * (sides + SIDE_NUMBERS * most_joints);
        let table = 4 * (2 * cells).max(2 * numbers + slots).max(8 * nodes);
        let room = u64::MAX;
        gpu.check_room(
            "contacts between so many strands, or within so large a budget,",
            work.max(table),
            room,
        )?;
        gpu.check_room("contacts between so many strands", numbers * u64::from(MODEL_ROWS) * 4, room)?;
        let storage = BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
        let starts = gpu.buffer("starts", 12 * numbers, storage);
        let table = gpu.buffer("table", table, storage);
        let mut touch =
            bytemuck::bytes_of(&TouchEntry { extent: NO_EXTENT, ..TouchEntry::zeroed() }).to_vec();
        touch.resize(touch.len() + 4 * (histogram::BINS + most_actives as usize), 0);
        let touch = gpu.filled("touch", &touch, storage);
        let owners = gpu.filled("owners", bytemuck::cast_slice(&model.block_of_places()), storage);
        let mut bytes = [&starts, &table, &touch, &owners].iter().map(|buffer| buffer.size()).sum::<u64>();
        let work = if shared.scratch.size() >= work {
            shared.scratch.clone()
        } else {
            bytes += work;
            gpu.buffer("work", work, storage)
        };
        let rest = if let [only] = batches {
            only.model.clone()
        } else {
            let rows: Vec<Row<f32>> =
                (0..model.places()).flat_map(|place| model_rows(model, place)).collect();
            let rest = gpu.filled("rest", bytemuck::cast_slice(&rows), storage);
            bytes += rest.size();
            rest
        };
        let host = ContactUniform {
            edge,
            distance: params.distance as f32,
            friction: params.friction as f32,
            spread: params.spread as f32,
            close: resolve_contacts::CLOSE * params.distance as f32,
            far: mean_motion::FAR * model.reach as f32,
            spacing: mean_motion::SPACING.max(mean_motion::SPACING_PER_EDGE * longest),
            inverse_piece,
            inverse_particles: 1.0 / model.particle_count.max(1) as f32,
            budget: params.budget,
            most_active: most_active as u32,
            few: (model.particle_count / FEW) as u32,
            per_segment: params.per_segment,
            rounds: params.rounds,
            cells: cells as u32,
            entries: entries as u32,
            numbers: numbers as u32,
            bodies: bodies as u32,
            found: found as u32,
            joints: joints as u32,
            sides: sides as u32,
            most_actives: most_actives as u32,
            most_joints: most_joints as u32,
            strands: slots as u32,
            ..ContactUniform::zeroed()
        };
        let uniform = BufferUsages::UNIFORM | BufferUsages::COPY_DST;
        let stride = gpu.uniform_stride(size_of::<ContactUniform>());
        let uniform = gpu.buffer("contacts", u64::from(stride) * u64::from(SPANS), uniform);
        bytes += uniform.size();
        let (params, host, groups) = (params.clone(), Box::new(host), ContactGroups::default());
        Ok(Self { params, uniform, stride, starts, work, table, touch, rest, owners, groups, bytes, host })
    }
}

impl GpuInteraction for DeviceContacts {
    fn exchange_plan(&self) -> Exchange {
        contact::EXCHANGE
    }

    fn bind(&mut self, gpu: &Gpu, strands: DeviceStrands<'_>, _: &Solids) {
        let mut groups = ContactGroups::default();
        for batch in strands.batches {
            let bindings = InsertBindings {
                blocks: &batch.blocks,
                model: &batch.model,
                positions: &batch.positions,
                starts: &self.starts,
                work: &self.work,
                table: &self.table,
                touch: &self.touch,
                contacts: &self.uniform,
            };
            groups.insert.push(bindings.bind(gpu, batch.threads));
            let bindings = MoveBindings {
                blocks: &batch.blocks,
                model: &batch.model,
                positions: &batch.positions,
                velocities: &batch.velocities,
                memory: &batch.memory,
                work: &self.work,
                table: &self.table,
                touch: &self.touch,
                contacts: &self.uniform,
            };
            groups.moves.push(bindings.bind(gpu, batch.threads));
        }
        let bindings = PairBindings {
            report: &strands.shared.report,
            starts: &self.starts,
            work: &self.work,
            table: &self.table,
            touch: &self.touch,
            contacts: &self.uniform,
            rest: &self.rest,
            owners: &self.owners,
        };
        groups.pairs.push(bindings.bind(gpu, StrandThreads::default()));
        self.groups = groups;
    }

    fn write_frame(&mut self, gpu: &Gpu, frame: &InteractionFrame<'_>) {
        let Self { params, host, .. } = self;
        host.clamped = frame.clamped;
        for span in frame.spans {
            let dt_secs = span.secs(frame.substeps, frame.input.dt_secs);
            let [first, end] = [span.first, span.end].map(|k| k as usize);
            let start = if first == 0 { &frame.start } else { &frame.poses[first] };
            [host.from_start, host.from_end] = [start, &frame.poses[end]].map(|pose| rigid(&pose.inverse()));
            host.slip = params.slip_distance(dt_secs);
            host.hold = (params.hold_after(frame.calm_secs) * dt_secs * dt_secs) as f32;
            host.dt = dt_secs as f32;
            let place = u64::from(span.number * self.stride);
            gpu.queue().write_buffer(&self.uniform, place, bytemuck::bytes_of(&**host));
        }
    }

    fn record_start<'a>(&'a self, list: &mut DispatchList<'a>, span: Span) {
        list.run(&self.groups.insert, &RECORD_START, &[span.number]);
    }

    fn exchange<'a>(&'a self, list: &mut DispatchList<'a>, span: Span) {
        let span = &[span.number];
        let ContactGroups { insert, pairs, moves } = &self.groups;
        list.run(insert, &RECORD_END, span);
        list.run(pairs, &FIT_MEAN_MOTION, span);
        list.run(pairs, &CLEAR_MEAN_MOTION, span);
        list.run(insert, &SPLAT_MEAN_MOTION, span);
        list.run(pairs, &SMOOTH_MEAN_MOTION, span);
        list.run(insert, &MEASURE_RESIDUAL_MOTION, span);
        list.run(pairs, &SELECT_ACTIVE, span);
        list.run(insert, &LIST_ACTIVE, span);
        // The device decides how many slices the frame has; kernels of further ones do nothing.
        for _ in 0..SLICES {
            list.run(pairs, &CLEAR_CELLS, span);
            list.run(insert, &INSERT_SEGMENTS, span);
            list.run(pairs, &SCAN_CELLS, span);
            list.run(insert, &INSERT_SEGMENTS, span);
            list.run(pairs, &FIND_PAIRS, span);
            list.run(pairs, &NEXT_SLICE, span);
        }
        let select = [&COUNT_FOUND, &SELECT_FOUND, &CLEAR_LINKS, &CREATE_JOINTS];
        for kernel in select.into_iter().chain([&RESERVE_LISTS, &LINK_JOINTS, &ORDER_JOINTS]) {
            list.run(pairs, kernel, span);
        }
        list.run(moves, &PREPARE_STRANDS, span);
        list.run(pairs, &WEIGHT_JOINTS, span);
        for _ in 0..self.params.rounds {
            list.run(pairs, &RELAX_JOINTS, span);
            list.run(moves, &GATHER_MOVES, span);
            list.run(pairs, &CHECK_ROUND, span);
        }
        list.run(moves, &APPLY_MOVES, span);
    }

    fn early_exchange(&self) -> Option<Exchange> {
        (self.params.hold > 0.0).then_some(contact::FRICTION)
    }

    fn exchange_early<'a>(&'a self, list: &mut DispatchList<'a>, span: Span) {
        if self.host.hold == 0.0 {
            return;
        }
        let span = &[span.number];
        let ContactGroups { insert, pairs, moves } = &self.groups;
        list.run(insert, &RECORD_END, span);
        list.run(pairs, &FIT_FRICTION, span);
        list.run(pairs, &CLEAR_MEAN_MOTION, span);
        list.run(insert, &SUM_MOTION, span);
        list.run(pairs, &AVERAGE_NODES, span);
        list.run(pairs, &CLEAR_MEAN_MOTION, span);
        list.run(insert, &SUM_CHANGES, span);
        list.run(insert, &BALANCE_CHANGES, span);
        list.run(moves, &APPLY_CHANGES, span);
    }

    fn report_buffer(&self) -> Option<&wgpu::Buffer> {
        Some(&self.touch)
    }

    fn add_report(&self, bytes: &[u8], shared: &ReportEntry, report: &mut GpuReport) {
        let touch: TouchEntry = bytemuck::pod_read_unaligned(&bytes[..size_of::<TouchEntry>()]);
        let (contacts, farthest_m) = (shared.contacts as usize, f32::from_bits(touch.farthest).into());
        report.strand_contacts = Some(ContactReport { contacts, farthest_m, ..ContactReport::default() });
    }

    fn settle_secs(&self) -> f64 {
        self.params.settle_secs()
    }

    fn rebuild(&self, gpu: &Gpu, strands: DeviceStrands<'_>) -> Result<Box<dyn GpuInteraction>, GpuError> {
        Ok(Box::new(Self::new(gpu, strands, &self.params)?))
    }

    fn bytes(&self) -> u64 {
        self.bytes
    }
}
