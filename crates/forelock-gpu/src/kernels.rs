//! The kernels: texts beside the stages that they are twins of, constants from here, pipelines from both.

use crate::air::AirUniform;
use crate::contacts::{
    BODY_ROWS, FOUND, HALF_PIECE, MEET_GROUPS, MeetUniform, QUEUE, ROW_CELLS, ROW_GROUPS, SLOTS, WAY_ROWS,
};
use crate::grid::{CELLS_GROUP, CELLS_THREADS, FASTEST, GridUniform, LIST_THREADS, MOST_OUT, SWEEPS};
use crate::layout::{FLAGS, FrameUniform, SubstepUniform};
use crate::particles::FluidUniform;
use crate::skinning::SkinUniform;
use crate::solids::{FAR, FIELD_NUMBERS, HOW, KINDS, LookUniform, MOST_SOLIDS};
use forelock_core::air::{MODES, canopy, wake};
use forelock_core::interaction::contact::{RUN_SEGMENTS, drift, fastest};
use forelock_core::interaction::grid::MARGIN;
use forelock_core::lane::{ASIN_RATIO, LANES};
use forelock_core::strands::SCRATCH_ROWS;
use forelock_core::interaction::contact::find_contacts::{CLOSE, PIECES, REACH, REST_SHARE, SLICES, STEPS};
use forelock_core::interaction::sph::find_neighbours::MOST_NEIGHBOURS;
use forelock_core::interaction::contact::resolve_contacts::BEND;
use forelock_core::collide::resolve_solids::{LOOKS, ROUNDS, SLIDES, STRETCHED, SWEEP_STEPS, TOUCH};
use forelock_core::frame::restore_lengths::NEWTON_STEPS;
use forelock_core::interaction::grid::solve_pressure::{LOOSE, SLACK};
use forelock_core::solver::ams::solve_strands::PIVOT_FLOOR;
use std::fmt::Write as _;

/// Strands of a workgroup.
pub const WORKGROUP: u32 = 64;
/// Rows of the model a particle.
pub const MODEL_ROWS: u32 = 7;
/// Numbers of a smoothed particle before its list.
pub(crate) const LIST_NUMBERS: u32 = 14;

/// A stage that runs on the GPU.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// The air at every particle.
    SampleAir,
    /// One implicit substep.
    SolveStrands,
    /// The same with factors kept in 16 bits.
    SolveHalved,
    /// What a wind that is not the same everywhere does to followers.
    BlowStrands,
    /// One step of follow the leader, solids included.
    FollowLeader,
    /// The same where some of them change their shape.
    FollowChanging,
    /// The load that followers' velocities hold.
    CarryLoad,
    /// Smoothed particles, strand by strand.
    EnterParticles,
    /// What is near each, and how dense it is there.
    FindNeighbours,
    /// Pressure and viscosity.
    PushParticles,
    /// Hair against solids.
    ResolveSolids,
    /// The same where some of them change their shape.
    ResolveChanging,
    /// Edges back to their lengths.
    RestoreLengths,
    /// Segments leave their mass and momentum on the grid.
    SplatSegments,
    /// What would press hair together is taken out.
    SolvePressure,
    /// What the grid changed goes back to the particles.
    GatherVelocities,
    /// Contacts between strands, strand by strand: what moves how, and where it is.
    EnterSegments,
    /// The same among all strands: what meets.
    FindContacts,
    /// Contacts resolved, strand by strand.
    BendStrands,
    /// The same contact by contact.
    ResolveContacts,
    /// Stretch, and strands that are not finite.
    CheckStrands,
    /// The motion of each particle of the guides.
    FollowGuides,
    /// Guides carry all strands.
    CarryStrands,
}

/// A kernel: an entry point of a stage's text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kernel {
    /// Solids in the wind.
    FillWake,
    /// The wind behind them.
    MarchWake,
    /// Extent of the hair along the wind.
    MeasureCanopy,
    /// The nodes around it.
    FitCanopy,
    /// Empties them.
    ClearCanopy,
    /// Hair at the nodes.
    SplatCanopy,
    /// The wind behind it.
    MarchCanopy,
    /// [`Stage::SampleAir`].
    SampleAir,
    /// [`Stage::SolveStrands`].
    SolveStrands,
    /// [`Stage::SolveHalved`].
    SolveHalved,
    /// [`Stage::BlowStrands`].
    BlowStrands,
    /// [`Stage::FollowLeader`], all in one.
    FollowLeader,
    /// Where particles go by themselves.
    PredictParticles,
    /// What is left of [`Stage::FollowLeader`] then, strand by strand.
    FollowStrands,
    /// One level of it.
    FollowLevel,
    /// [`Stage::FollowChanging`].
    FollowChanging,
    /// Before strands meet, the load is laid aside.
    LayLoadAside,
    /// It comes back.
    TakeLoadBack,
    /// How many smoothed particles there are in each bucket.
    CountParticles,
    /// Which.
    EnterParticles,
    /// What pushed them becomes velocity.
    KickStrands,
    /// Empties the buckets.
    ClearBuckets,
    /// Where each one's particles begin.
    LayBuckets,
    /// [`Stage::FindNeighbours`].
    FindNeighbours,
    /// [`Stage::PushParticles`].
    PushParticles,
    /// [`Stage::ResolveSolids`].
    ResolveSolids,
    /// [`Stage::ResolveChanging`].
    ResolveChanging,
    /// [`Stage::RestoreLengths`].
    RestoreLengths,
    /// The same once more, if contacts moved hair.
    RestoreAgain,
    /// Extent of the hair on the grid.
    MeasureHair,
    /// The box around it.
    FitGrid,
    /// Empties the box.
    ClearGrid,
    /// [`Stage::SplatSegments`].
    SplatSegments,
    /// Cells inside solids.
    WallOff,
    /// From sums to velocities.
    Divide,
    /// What velocities lack.
    AimVelocities,
    /// What displacements lack.
    AimDisplacements,
    /// Half a sweep.
    RelaxEven,
    /// The other half.
    RelaxOdd,
    /// Whether sweeps still change anything.
    Judge,
    /// Pressure on velocities.
    PushVelocities,
    /// Pressure on displacements.
    PushDisplacements,
    /// [`Stage::GatherVelocities`].
    GatherVelocities,
    /// The same of displacements.
    GatherDisplacements,
    /// Where hair is at the frame's start.
    NoteStart,
    /// Where it is at its end, and the box around both.
    NoteEnd,
    /// The motion that neighbours share.
    SplatDrift,
    /// How far each particle strays from it.
    MeasureStrays,
    /// Segments whose contacts are sought.
    ListActive,
    /// How many segments there are in each cell, and then which.
    EnterSegments,
    /// The box, and the nodes of the drift in it.
    FitDrift,
    /// Empties them.
    ClearDrift,
    /// From sums to means.
    SmoothDrift,
    /// What counts as active, and how many slices the frame takes.
    ChooseActive,
    /// Empties the cells.
    ClearCells,
    /// Where each cell's segments begin.
    LayOut,
    /// Active segments and what is near them.
    MeetSegments,
    /// The next slice of the frame.
    NextSlice,
    /// How fast what was found approaches.
    CountFound,
    /// What of it there is a budget for.
    ChooseFound,
    /// Empties the lists of contacts.
    ClearLinks,
    /// Contacts that are to be resolved.
    TakeUp,
    /// Factors of the strands that they bend.
    PrepareStrands,
    /// What a round gives to a strand.
    TakeMoves,
    /// What all rounds gave.
    ApplyMoves,
    /// Room for the list of each segment's contacts.
    ReserveLists,
    /// The lists.
    LinkJoints,
    /// In order of time.
    OrderJoints,
    /// How much each contact moves.
    WeighJoints,
    /// What a round adds.
    PressJoints,
    /// Whether it was the last.
    JudgeRound,
    /// [`Stage::CheckStrands`].
    CheckStrands,
    /// [`Stage::FollowGuides`].
    FollowGuides,
    /// [`Stage::CarryStrands`].
    CarryStrands,
}

/// What the threads of a kernel are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Over {
    /// Strands of a batch; run for each.
    Strands,
    /// The same, and along y particles of the longest strand.
    Particles,
    /// One workgroup.
    Once,
    /// So many threads.
    Count(u32),
    /// [`CELLS_THREADS`].
    Cells,
    /// [`LIST_THREADS`].
    List,
    /// So many workgroups.
    Groups(u32),
}

impl Over {
    /// Workgroups that they take, of a batch whose strands take `strands`.
    pub fn groups(self, strands: u32) -> u32 {
        match self {
            Self::Strands | Self::Particles => strands,
            Self::Once => 1,
            Self::Count(threads) => threads.div_ceil(WORKGROUP),
            Self::Cells => CELLS_THREADS / CELLS_GROUP,
            Self::List => LIST_THREADS / CELLS_GROUP,
            Self::Groups(groups) => groups,
        }
    }
}

const WAKE_COUNT: u32 = wake::NODES.pow(3) as u32;
const CANOPY_LAYER: u32 = canopy::NODES.pow(2) as u32;
const CANOPY_COUNT: u32 = canopy::NODES.pow(3) as u32;

/// A row of the table of stages.
#[derive(Clone, Copy, Debug)]
pub struct StageKernels {
    /// Which.
    pub stage: Stage,
    /// Its name, also of labels; rows of one stage have the same.
    pub name: &'static str,
    /// Its texts, to come after constants and prelude.
    pub texts: &'static [&'static str],
    /// Its kernels, each with its entry point and what its threads are.
    pub kernels: &'static [(Kernel, &'static str, Over)],
    /// What they bind, of group 0.
    pub group: Group,
}

/// What all kernels begin with.
const PRELUDE: &str = include_str!("../../forelock-core/src/stage/prelude.wgsl");
const REDUCE: &str = include_str!("../../forelock-core/src/stage/reduce.wgsl");
const REDUCE_SUBGROUPS: &str = include_str!("../../forelock-core/src/stage/reduce_subgroups.wgsl");
const SHAPES: &str = include_str!("../../forelock-core/src/body/shapes.wgsl");
const GRID: &str = include_str!("../../forelock-core/src/grid/grid.wgsl");
const CONTACT: &str = include_str!("../../forelock-core/src/contact/contact.wgsl");
const TABLE: &str = include_str!("../../forelock-core/src/contact/table.wgsl");
const FLUID: &str = include_str!("../../forelock-core/src/sph/fluid.wgsl");
const SOLVE: &str = include_str!("../../forelock-core/src/stage/solve_strands/kernel.wgsl");
const LINKS: &str = include_str!("../../forelock-core/src/stage/solve_strands/links.wgsl");
const LINKS_HALVED: &str = include_str!("../../forelock-core/src/stage/solve_strands/links_halved.wgsl");
const PARTICLE: &str = include_str!("../../forelock-core/src/stage/resolve_solids/particle.wgsl");
const LEVEL: &str = include_str!("../../forelock-core/src/stage/follow_leader/level.wgsl");
const FOLLOW: &str = include_str!("../../forelock-core/src/stage/follow_leader/kernel.wgsl");
const SKIN: &str = include_str!("../../forelock-core/src/groom/guides/skin.wgsl");

/// All stages.
pub const STAGES: [StageKernels; 23] = [
    StageKernels {
        stage: Stage::SampleAir,
        name: "sample_air",
        texts: &[SHAPES, include_str!("../../forelock-core/src/stage/sample_air/kernel.wgsl")],
        kernels: &[
            (Kernel::FillWake, "fill_wake", Over::Count(WAKE_COUNT)),
            (Kernel::MarchWake, "march_wake", Over::Once),
            (Kernel::MeasureCanopy, "measure_canopy", Over::Strands),
            (Kernel::FitCanopy, "fit_canopy", Over::Once),
            (Kernel::ClearCanopy, "clear_canopy", Over::Count(CANOPY_COUNT)),
            (Kernel::SplatCanopy, "splat_canopy", Over::Strands),
            (Kernel::MarchCanopy, "march_canopy", Over::Count(CANOPY_LAYER)),
            (Kernel::SampleAir, "sample_air", Over::Strands),
        ],
        group: Group::Air,
    },
    StageKernels {
        stage: Stage::SolveStrands,
        name: "solve_strands",
        texts: &[LINKS, SOLVE],
        kernels: &[(Kernel::SolveStrands, "solve_strands", Over::Strands)],
        group: Group::Solve,
    },
    StageKernels {
        stage: Stage::SolveHalved,
        name: "solve_strands",
        texts: &[LINKS_HALVED, SOLVE],
        kernels: &[(Kernel::SolveHalved, "solve_strands", Over::Strands)],
        group: Group::Solve,
    },
    StageKernels {
        stage: Stage::BlowStrands,
        name: "follow_leader",
        texts: &[include_str!("../../forelock-core/src/stage/follow_leader/blow.wgsl")],
        kernels: &[(Kernel::BlowStrands, "blow_strands", Over::Strands)],
        group: Group::Solve,
    },
    StageKernels {
        stage: Stage::FollowLeader,
        name: "follow_leader",
        texts: &[
            SHAPES,
            PARTICLE,
            LEVEL,
            FOLLOW,
            include_str!("../../forelock-core/src/stage/follow_leader/schedules.wgsl"),
        ],
        kernels: &[
            (Kernel::FollowLeader, "follow_leader", Over::Strands),
            (Kernel::PredictParticles, "predict_particles", Over::Particles),
            (Kernel::FollowStrands, "follow_strands", Over::Strands),
            (Kernel::FollowLevel, "follow_level_of_all", Over::Strands),
        ],
        group: Group::Follow,
    },
    StageKernels {
        stage: Stage::FollowChanging,
        name: "follow_leader",
        texts: &[SHAPES, PARTICLE, LEVEL, FOLLOW],
        kernels: &[(Kernel::FollowChanging, "follow_leader", Over::Strands)],
        group: Group::Follow,
    },
    StageKernels {
        stage: Stage::CarryLoad,
        name: "follow_leader",
        texts: &[include_str!("../../forelock-core/src/stage/follow_leader/load.wgsl")],
        kernels: &[
            (Kernel::LayLoadAside, "lay_load_aside", Over::Strands),
            (Kernel::TakeLoadBack, "take_load_back", Over::Strands),
        ],
        group: Group::Strands,
    },
    StageKernels {
        stage: Stage::EnterParticles,
        name: "find_neighbours",
        texts: &[FLUID, include_str!("../../forelock-core/src/stage/find_neighbours/strands.wgsl")],
        kernels: &[
            (Kernel::CountParticles, "count_particles", Over::Strands),
            (Kernel::EnterParticles, "enter_particles", Over::Strands),
            (Kernel::KickStrands, "kick_strands", Over::Strands),
        ],
        group: Group::Wet,
    },
    StageKernels {
        stage: Stage::FindNeighbours,
        name: "find_neighbours",
        texts: &[FLUID, TABLE, include_str!("../../forelock-core/src/stage/find_neighbours/kernel.wgsl")],
        kernels: &[
            (Kernel::ClearBuckets, "clear_buckets", Over::List),
            (Kernel::LayBuckets, "lay_buckets", Over::Groups(ROW_GROUPS)),
            (Kernel::FindNeighbours, "find_neighbours", Over::List),
        ],
        group: Group::Cloud,
    },
    StageKernels {
        stage: Stage::PushParticles,
        name: "push_particles",
        texts: &[FLUID, include_str!("../../forelock-core/src/stage/push_particles/kernel.wgsl")],
        kernels: &[(Kernel::PushParticles, "push_particles", Over::List)],
        group: Group::Cloud,
    },
    StageKernels {
        stage: Stage::ResolveSolids,
        name: "resolve_solids",
        texts: &[SHAPES, PARTICLE, include_str!("../../forelock-core/src/stage/resolve_solids/kernel.wgsl")],
        kernels: &[(Kernel::ResolveSolids, "resolve_solids", Over::Strands)],
        group: Group::Solids,
    },
    StageKernels {
        stage: Stage::ResolveChanging,
        name: "resolve_solids",
        texts: &[SHAPES, PARTICLE, include_str!("../../forelock-core/src/stage/resolve_solids/kernel.wgsl")],
        kernels: &[(Kernel::ResolveChanging, "resolve_solids", Over::Strands)],
        group: Group::Solids,
    },
    StageKernels {
        stage: Stage::RestoreLengths,
        name: "restore_lengths",
        texts: &[include_str!("../../forelock-core/src/stage/restore_lengths/kernel.wgsl")],
        kernels: &[
            (Kernel::RestoreLengths, "restore_lengths", Over::Strands),
            (Kernel::RestoreAgain, "restore_again", Over::Strands),
        ],
        group: Group::Strands,
    },
    StageKernels {
        stage: Stage::SplatSegments,
        name: "splat_segments",
        texts: &[GRID, include_str!("../../forelock-core/src/stage/splat_segments/kernel.wgsl")],
        kernels: &[
            (Kernel::MeasureHair, "measure_hair", Over::Strands),
            (Kernel::FitGrid, "fit_grid", Over::Once),
            (Kernel::ClearGrid, "clear_grid", Over::Cells),
            (Kernel::SplatSegments, "splat_segments", Over::Strands),
        ],
        group: Group::Splat,
    },
    StageKernels {
        stage: Stage::SolvePressure,
        name: "solve_pressure",
        texts: &[GRID, SHAPES, include_str!("../../forelock-core/src/stage/solve_pressure/kernel.wgsl")],
        kernels: &[
            (Kernel::WallOff, "wall_off", Over::Cells),
            (Kernel::Divide, "divide", Over::Cells),
            (Kernel::AimVelocities, "aim_velocities", Over::Cells),
            (Kernel::AimDisplacements, "aim_displacements", Over::Cells),
            (Kernel::RelaxEven, "relax_even", Over::List),
            (Kernel::RelaxOdd, "relax_odd", Over::List),
            (Kernel::Judge, "judge", Over::Once),
            (Kernel::PushVelocities, "push_velocities", Over::Cells),
            (Kernel::PushDisplacements, "push_displacements", Over::Cells),
        ],
        group: Group::Cells,
    },
    StageKernels {
        stage: Stage::GatherVelocities,
        name: "gather_velocities",
        texts: &[GRID, include_str!("../../forelock-core/src/stage/gather_velocities/kernel.wgsl")],
        kernels: &[
            (Kernel::GatherVelocities, "gather_velocities", Over::Strands),
            (Kernel::GatherDisplacements, "gather_displacements", Over::Strands),
        ],
        group: Group::Gather,
    },
    StageKernels {
        stage: Stage::EnterSegments,
        name: "find_contacts",
        texts: &[CONTACT, include_str!("../../forelock-core/src/stage/find_contacts/strands.wgsl")],
        kernels: &[
            (Kernel::NoteStart, "note_start", Over::Strands),
            (Kernel::NoteEnd, "note_end", Over::Strands),
            (Kernel::SplatDrift, "splat_drift", Over::Strands),
            (Kernel::MeasureStrays, "measure_strays", Over::Strands),
            (Kernel::ListActive, "list_active", Over::Strands),
            (Kernel::EnterSegments, "enter_segments", Over::Strands),
        ],
        group: Group::Enter,
    },
    StageKernels {
        stage: Stage::FindContacts,
        name: "find_contacts",
        texts: &[CONTACT, TABLE, include_str!("../../forelock-core/src/stage/find_contacts/pairs.wgsl")],
        kernels: &[
            (Kernel::FitDrift, "fit_drift", Over::Once),
            (Kernel::ClearDrift, "clear_drift", Over::List),
            (Kernel::SmoothDrift, "smooth_drift", Over::List),
            (Kernel::ChooseActive, "choose_active", Over::Once),
            (Kernel::ClearCells, "clear_cells", Over::List),
            (Kernel::LayOut, "lay_out", Over::Groups(ROW_GROUPS)),
            (Kernel::MeetSegments, "meet_segments", Over::Groups(MEET_GROUPS)),
            (Kernel::NextSlice, "next_slice", Over::Once),
            (Kernel::CountFound, "count_found", Over::List),
            (Kernel::ChooseFound, "choose_found", Over::Once),
            (Kernel::ClearLinks, "clear_links", Over::List),
            (Kernel::TakeUp, "take_up", Over::List),
        ],
        group: Group::Touch,
    },
    StageKernels {
        stage: Stage::BendStrands,
        name: "resolve_contacts",
        texts: &[CONTACT, include_str!("../../forelock-core/src/stage/resolve_contacts/strands.wgsl")],
        kernels: &[
            (Kernel::PrepareStrands, "prepare_strands", Over::Strands),
            (Kernel::TakeMoves, "take_moves", Over::Strands),
            (Kernel::ApplyMoves, "apply_moves", Over::Strands),
        ],
        group: Group::Bend,
    },
    StageKernels {
        stage: Stage::ResolveContacts,
        name: "resolve_contacts",
        texts: &[CONTACT, include_str!("../../forelock-core/src/stage/resolve_contacts/joints.wgsl")],
        kernels: &[
            (Kernel::ReserveLists, "reserve_lists", Over::List),
            (Kernel::LinkJoints, "link_joints", Over::List),
            (Kernel::OrderJoints, "order_joints", Over::List),
            (Kernel::WeighJoints, "weigh_joints", Over::List),
            (Kernel::PressJoints, "press_joints", Over::List),
            (Kernel::JudgeRound, "judge_round", Over::Once),
        ],
        group: Group::Touch,
    },
    StageKernels {
        stage: Stage::CheckStrands,
        name: "check_strands",
        texts: &[include_str!("../../forelock-core/src/stage/check_strands/kernel.wgsl")],
        kernels: &[(Kernel::CheckStrands, "check_strands", Over::Strands)],
        group: Group::Strands,
    },
    StageKernels {
        stage: Stage::FollowGuides,
        name: "follow_guides",
        texts: &[SKIN, include_str!("../../forelock-core/src/groom/guides/follow.wgsl")],
        kernels: &[(Kernel::FollowGuides, "follow_guides", Over::Strands)],
        group: Group::Guides,
    },
    StageKernels {
        stage: Stage::CarryStrands,
        name: "carry_strands",
        texts: &[SKIN, include_str!("../../forelock-core/src/groom/guides/carry.wgsl")],
        kernels: &[(Kernel::CarryStrands, "carry_strands", Over::Cells)],
        group: Group::Carried,
    },
];

impl Kernel {
    /// The stage that it belongs to.
    pub fn stage(self) -> &'static StageKernels {
        let of = |row: &&StageKernels| row.kernels.iter().any(|(kernel, ..)| *kernel == self);
        // Every kernel is in the table, which a test checks.
        STAGES.iter().find(of).unwrap_or(&STAGES[0])
    }

    /// What its threads are.
    pub fn over(self) -> Over {
        let own = self.stage().kernels.iter().find(|(kernel, ..)| *kernel == self);
        own.map_or(Over::Strands, |(_, _, over)| *over)
    }
}

/// What a binding is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Binding {
    /// Uniform of a frame.
    Frame,
    /// Uniform of a substep, at a dynamic offset.
    Substep,
    /// Uniform of a look at solids, at a dynamic offset.
    Look,
    /// Uniform of the grid.
    Grid,
    /// Uniform of the air.
    Air,
    /// Uniform of guides that carry strands.
    Skin,
    /// Uniform of contacts.
    Meet,
    /// Uniform of smoothed particles.
    Fluid,
    /// Storage that kernels read.
    Read(&'static str),
    /// Storage that kernels change.
    Change(&'static str),
}

/// What kernels bind together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Group {
    /// From strands and solids to the air.
    Air,
    /// Strands in the air.
    Solve,
    /// Strands alone.
    Strands,
    /// Strands that meet solids on their way.
    Follow,
    /// From strands to smoothed particles and back.
    Wet,
    /// Smoothed particles alone.
    Cloud,
    /// Strands among solids.
    Solids,
    /// From strands to the grid.
    Splat,
    /// The grid alone.
    Cells,
    /// From the grid to strands.
    Gather,
    /// From strands to what they may touch.
    Enter,
    /// What touches, of all strands.
    Touch,
    /// Strands that touch.
    Bend,
    /// Guides alone.
    Guides,
    /// From guides to the strands that they carry.
    Carried,
}

/// All groups, in their order.
pub const GROUPS: [Group; 15] = [
    Group::Air,
    Group::Solve,
    Group::Strands,
    Group::Follow,
    Group::Wet,
    Group::Cloud,
    Group::Solids,
    Group::Splat,
    Group::Cells,
    Group::Gather,
    Group::Enter,
    Group::Touch,
    Group::Bend,
    Group::Guides,
    Group::Carried,
];

impl Group {
    /// Number and what of each binding. Up to eight of storage, as many as WebGPU grants.
    pub const fn bindings(self) -> &'static [(u32, Binding)] {
        match self {
            Self::Air => &[
                (2, Binding::Read("blocks")),
                (3, Binding::Read("model")),
                (5, Binding::Change("positions")),
                (10, Binding::Read("fields")),
                (11, Binding::Look),
                (17, Binding::Change("wind")),
                (18, Binding::Change("nodes")),
                (19, Binding::Change("canopy")),
                (20, Binding::Air),
            ],
            Self::Solve => &[
                (0, Binding::Frame),
                (1, Binding::Substep),
                (2, Binding::Read("blocks")),
                (3, Binding::Read("model")),
                (4, Binding::Read("strands")),
                (5, Binding::Change("positions")),
                (6, Binding::Change("velocities")),
                (7, Binding::Change("memory")),
                (8, Binding::Change("scratch")),
                (17, Binding::Read("wind")),
            ],
            Self::Strands => &[
                (0, Binding::Frame),
                (1, Binding::Substep),
                (2, Binding::Read("blocks")),
                (3, Binding::Read("model")),
                (5, Binding::Change("positions")),
                (6, Binding::Change("velocities")),
                (7, Binding::Change("memory")),
                (8, Binding::Change("scratch")),
                (9, Binding::Change("report")),
            ],
            Self::Follow => &[
                (0, Binding::Frame),
                (1, Binding::Substep),
                (2, Binding::Read("blocks")),
                (3, Binding::Read("model")),
                (4, Binding::Read("strands")),
                (5, Binding::Change("positions")),
                (6, Binding::Change("velocities")),
                (7, Binding::Change("memory")),
                (9, Binding::Change("report")),
                (10, Binding::Read("fields")),
                (11, Binding::Look),
            ],
            Self::Wet => &[
                (2, Binding::Read("blocks")),
                (5, Binding::Change("positions")),
                (6, Binding::Change("velocities")),
                (27, Binding::Change("table")),
                (32, Binding::Fluid),
                (33, Binding::Change("cloud")),
                (34, Binding::Read("names")),
            ],
            Self::Cloud => &[
                (27, Binding::Change("table")),
                (32, Binding::Fluid),
                (33, Binding::Change("cloud")),
                (34, Binding::Read("names")),
            ],
            Self::Solids => &[
                (0, Binding::Frame),
                (2, Binding::Read("blocks")),
                (3, Binding::Read("model")),
                (5, Binding::Change("positions")),
                (6, Binding::Change("velocities")),
                (7, Binding::Change("memory")),
                (9, Binding::Change("report")),
                (10, Binding::Read("fields")),
                (11, Binding::Look),
            ],
            Self::Splat => &[
                (2, Binding::Read("blocks")),
                (3, Binding::Read("model")),
                (5, Binding::Change("positions")),
                (6, Binding::Change("velocities")),
                (12, Binding::Read("rooms")),
                (13, Binding::Change("cells")),
                (14, Binding::Change("bounds")),
                (16, Binding::Grid),
            ],
            Self::Cells => &[
                (10, Binding::Read("fields")),
                (11, Binding::Look),
                (13, Binding::Change("cells")),
                (14, Binding::Change("bounds")),
                (15, Binding::Change("faces")),
                (16, Binding::Grid),
            ],
            Self::Gather => &[
                (0, Binding::Frame),
                (2, Binding::Read("blocks")),
                (3, Binding::Read("model")),
                (5, Binding::Change("positions")),
                (6, Binding::Change("velocities")),
                (7, Binding::Change("memory")),
                (14, Binding::Change("bounds")),
                (15, Binding::Read("faces")),
                (16, Binding::Grid),
            ],
            Self::Enter => &[
                (2, Binding::Read("blocks")),
                (3, Binding::Read("model")),
                (5, Binding::Change("positions")),
                (25, Binding::Change("starts")),
                (26, Binding::Change("work")),
                (27, Binding::Change("table")),
                (28, Binding::Change("touch")),
                (29, Binding::Meet),
            ],
            Self::Touch => &[
                (9, Binding::Change("report")),
                (25, Binding::Change("starts")),
                (26, Binding::Change("work")),
                (27, Binding::Change("table")),
                (28, Binding::Change("touch")),
                (29, Binding::Meet),
                (30, Binding::Read("rest")),
                (31, Binding::Read("owners")),
            ],
            Self::Bend => &[
                (2, Binding::Read("blocks")),
                (3, Binding::Read("model")),
                (5, Binding::Change("positions")),
                (6, Binding::Change("velocities")),
                (7, Binding::Change("memory")),
                (26, Binding::Change("work")),
                (27, Binding::Change("table")),
                (28, Binding::Change("touch")),
                (29, Binding::Meet),
            ],
            Self::Guides => &[
                (2, Binding::Read("blocks")),
                (3, Binding::Read("model")),
                (5, Binding::Change("positions")),
                (21, Binding::Change("motions")),
                (22, Binding::Skin),
            ],
            Self::Carried => &[
                (21, Binding::Change("motions")),
                (22, Binding::Skin),
                (23, Binding::Read("carried")),
                (24, Binding::Change("placed")),
            ],
        }
    }
}

/// The whole text of a stage: constants, prelude, kernels; for a device that has `subgroups` or not.
pub fn text(stage: &StageKernels, subgroups: bool) -> String {
    let mut text = String::new();
    let mut constant = |name: &str, kind: &str, value: &dyn std::fmt::Display, end: &str| {
        // Writing to a string does not fail.
        let _ = writeln!(text, "const {name}: {kind} = {value}{end};");
    };
    let counts = [
        ("LANES", LANES as u32),
        ("WORKGROUP", WORKGROUP),
        ("SCRATCH", SCRATCH_ROWS as u32),
        ("MODEL_ROWS", MODEL_ROWS),
        ("NEWTON_STEPS", NEWTON_STEPS as u32),
        ("LOOKS", LOOKS as u32),
        ("ROUNDS", ROUNDS as u32),
        ("SLIDES", SLIDES as u32),
        ("SWEEP_STEPS", SWEEP_STEPS as u32),
        ("MOST_SOLIDS", MOST_SOLIDS as u32),
        ("FIELD_NUMBERS", FIELD_NUMBERS),
        ("CELLS_GROUP", CELLS_GROUP),
        ("CELLS_THREADS", CELLS_THREADS),
        ("LIST_THREADS", LIST_THREADS),
        ("SWEEPS", SWEEPS),
        ("MOST_MODES", MODES as u32),
        ("WAKE_NODES", wake::NODES as u32),
        ("CANOPY_NODES", canopy::NODES as u32),
        ("CANOPY_MARGIN", canopy::MARGIN as u32),
        ("DRIFT_NODES", drift::NODES as u32),
        ("EVERY", drift::EVERY as u32),
        ("BINS", fastest::BINS as u32),
        ("BIN_BITS", fastest::BIN_BITS),
        ("SLICES", SLICES),
        ("MEET_STEPS", STEPS as u32),
        ("MEET_GROUPS", MEET_GROUPS),
        ("ROW_CELLS", ROW_CELLS),
        ("ROW_GROUPS", ROW_GROUPS),
        ("OWN_CELLS", ROW_CELLS / CELLS_GROUP),
        ("SLOTS", SLOTS),
        ("FOUND", FOUND),
        ("QUEUE", QUEUE),
        ("WAY_ROWS", WAY_ROWS as u32),
        ("BODY_ROWS", BODY_ROWS as u32),
        ("RUN_SEGMENTS", RUN_SEGMENTS as u32),
        ("MOST_NEIGHBOURS", MOST_NEIGHBOURS as u32),
        ("NO_SLOT", u32::MAX),
    ];
    for (name, value) in counts.into_iter().chain(FLAGS).chain(KINDS).chain(HOW) {
        constant(name, "u32", &value, "u");
    }
    constant("MARGIN", "i32", &MARGIN, "");
    let changes = !matches!(stage.stage, Stage::ResolveSolids | Stage::FollowLeader);
    constant("CHANGES", "bool", &changes, "");
    let follows = matches!(stage.stage, Stage::FollowLeader | Stage::FollowChanging);
    constant("DRAGS", "bool", &follows, "");
    let singles = [PIVOT_FLOOR, FAR, TOUCH, STRETCHED].map(|value| value as f32);
    let names = ["PIVOT_FLOOR", "FAR", "TOUCH", "STRETCHED"];
    let grid = [
        ("LOOSE", LOOSE),
        ("SLACK", SLACK),
        ("SPREAD", wake::SPREAD),
        ("FASTEST", FASTEST),
        ("MOST_OUT", MOST_OUT),
        ("PIECES", PIECES),
        ("HALF_PIECE", HALF_PIECE),
        ("REACH_ACTIVE", REACH[0]),
        ("REACH_OTHER", REACH[1]),
        ("MEET_CLOSE", CLOSE),
        ("REST_SHARE", REST_SHARE),
        ("BEND", BEND),
        ("DRIFT_UNIT", (1u32 << 22) as f32),
        ("SQUARE_UNIT", (1u32 << 16) as f32),
    ];
    for (name, value) in names.into_iter().zip(singles).chain(grid) {
        constant(name, "f32", &format_args!("{value:e}"), "f");
    }
    for (k, value) in ASIN_RATIO.iter().enumerate() {
        constant(&format!("ASIN_RATIO_{k}"), "f32", value, "f");
    }
    text.push_str(PRELUDE);
    text.push_str(if subgroups { REDUCE_SUBGROUPS } else { REDUCE });
    stage.texts.iter().for_each(|own| text.push_str(own));
    text
}

/// Pipelines of all kernels, and their layouts.
#[derive(Debug)]
pub(crate) struct Kernels {
    layouts: [wgpu::BindGroupLayout; GROUPS.len()],
    pipelines: Vec<wgpu::ComputePipeline>,
}

impl Kernels {
    pub fn new(device: &wgpu::Device) -> Self {
        let layouts = GROUPS.map(|group| {
            let entries: Vec<_> = group.bindings().iter().map(entry).collect();
            let described = wgpu::BindGroupLayoutDescriptor { label: None, entries: &entries };
            device.create_bind_group_layout(&described)
        });
        let subgroups = device.features().contains(wgpu::Features::SUBGROUP);
        let mut pipelines = Vec::new();
        for stage in &STAGES {
            let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some(stage.name),
                source: wgpu::ShaderSource::Wgsl(text(stage, subgroups).into()),
            });
            let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: Some(stage.name),
                bind_group_layouts: &[Some(&layouts[stage.group as usize])],
                immediate_size: 0,
            });
            // In the order of `Kernel`, which a test checks.
            for (_, name, _) in stage.kernels {
                pipelines.push(device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                    label: Some(name),
                    layout: Some(&layout),
                    module: &module,
                    entry_point: Some(name),
                    // Kernels set what they read there.
                    compilation_options: wgpu::PipelineCompilationOptions {
                        zero_initialize_workgroup_memory: false,
                        ..Default::default()
                    },
                    cache: None,
                }));
            }
        }
        Self { layouts, pipelines }
    }

    /// How many pipelines there are.
    pub fn count(&self) -> u32 {
        self.pipelines.len() as u32
    }

    pub fn layout(&self, group: Group) -> &wgpu::BindGroupLayout {
        &self.layouts[group as usize]
    }

    pub fn pipeline(&self, kernel: Kernel) -> &wgpu::ComputePipeline {
        &self.pipelines[kernel as usize]
    }
}

fn entry(&(binding, what): &(u32, Binding)) -> wgpu::BindGroupLayoutEntry {
    let uniform = wgpu::BufferBindingType::Uniform;
    let storage = |read_only| wgpu::BufferBindingType::Storage { read_only };
    let (ty, has_dynamic_offset, size) = match what {
        Binding::Frame => (uniform, false, size_of::<FrameUniform>()),
        Binding::Grid => (uniform, false, size_of::<GridUniform>()),
        Binding::Air => (uniform, false, size_of::<AirUniform>()),
        Binding::Skin => (uniform, false, size_of::<SkinUniform>()),
        Binding::Meet => (uniform, false, size_of::<MeetUniform>()),
        Binding::Fluid => (uniform, false, size_of::<FluidUniform>()),
        Binding::Substep => (uniform, true, size_of::<SubstepUniform>()),
        Binding::Look => (uniform, true, size_of::<LookUniform>()),
        Binding::Read(_) => (storage(true), false, 0),
        Binding::Change(_) => (storage(false), false, 0),
    };
    wgpu::BindGroupLayoutEntry {
        binding,
        visibility: wgpu::ShaderStages::COMPUTE,
        ty: wgpu::BindingType::Buffer {
            ty,
            has_dynamic_offset,
            min_binding_size: std::num::NonZeroU64::new(size as u64),
        },
        count: None,
    }
}

/// Binds what `find` gives for each of the group's storage and uniforms.
pub(crate) fn bind<'a>(
    device: &wgpu::Device,
    (kernels, group): (&Kernels, Group),
    find: &dyn Fn(Binding) -> &'a wgpu::Buffer,
) -> wgpu::BindGroup {
    let entry = |&(binding, what): &(u32, Binding)| {
        let buffer = find(what);
        let size = match what {
            Binding::Substep => std::num::NonZeroU64::new(size_of::<SubstepUniform>() as u64),
            Binding::Look => std::num::NonZeroU64::new(size_of::<LookUniform>() as u64),
            _ => None,
        };
        let resource = wgpu::BindingResource::Buffer(wgpu::BufferBinding { buffer, offset: 0, size });
        wgpu::BindGroupEntry { binding, resource }
    };
    let entries: Vec<_> = group.bindings().iter().map(entry).collect();
    let described =
        wgpu::BindGroupDescriptor { label: None, layout: kernels.layout(group), entries: &entries };
    device.create_bind_group(&described)
}
