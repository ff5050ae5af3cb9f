//! A frame: what it is given, the order of its steps, the seams of solvers and interactions, and
//! the steps that all solvers share.
//!
//! [`FramePlan`] is the one definition of a frame. It is made from the solver's [`FrameRules`] and
//! the [`Exchange`]s of the interactions, and read by the CPU and by the GPU.

mod acceleration;
mod cells;
mod context;
mod crew;
mod exchange;
pub mod finish;
mod input;
mod plan;
mod report;
pub mod restore_lengths;
mod roots;
mod rules;
mod sleep;
mod solver;

pub use crate::strands::{Channel, ChannelKind, LaneGroup};
pub use acceleration::{ACCELERATION_WGSL, Acceleration, LATTICE};
pub use cells::{GridCell, GridCells};
pub use context::{FrameContext, Substep};
pub(crate) use crew::{Crew, EdgeFlags};
pub(crate) use exchange::shared_secs;
pub use exchange::{ExchangeContext, Interaction, with_motion};
pub use input::{Air, FrameInput, fractions};
pub use plan::{CHECK, COLLIDE, Exchange, FramePlan, LENGTHS, Moves, Phase, PlannedStep, Span, Step};
pub use report::{BlockNanos, BlockReport, ContactReport, FrameReport, GridReport, SphReport, StageTimes};
pub use roots::{FRAME_ROWS, RestMotion, Roots, pack_frames};
pub use rules::{Channels, FrameRules, Refinement, SPANS, StepCheck, StepRate};
pub use sleep::{FASTEST_SHARE, LEAST_FRICTION, LastSolids, PLACE_M, ROUNDING_M, Reach, held_distance};
pub(crate) use sleep::{Stillness, farthest_squared};
pub use solver::{LaneSolver, Solver, SolverReal, StrandSolver};

/// WGSL that every kernel begins with.
pub const PRELUDE_WGSL: &str = include_str!("wgsl/prelude.wgsl");
/// WGSL that stores and restores the load that velocities hold in addition to the motion
/// ([`Channels::previous`]).
pub const LOAD_WGSL: &str = include_str!("wgsl/load.wgsl");
/// WGSL that measures how fast hair moves and slows it down, for its sleep.
pub const SLEEP_WGSL: &str = include_str!("wgsl/sleep.wgsl");
/// WGSL of where the rest shape of a strand is ([`Roots`]).
pub const ROOTS_WGSL: &str = include_str!("wgsl/roots.wgsl");
/// WGSL that packs the motions of strands that a device computes ([`pack_frames`]), after
/// [`SURFACE_WGSL`](crate::groom::SURFACE_WGSL).
pub const PACK_ROOTS_WGSL: &str = include_str!("wgsl/pack_roots.wgsl");
/// WGSL of the initial values of channels ([`Channels::extra`]), after [`ROOTS_WGSL`].
pub const CHANNELS_WGSL: &str = include_str!("wgsl/channels.wgsl");
/// WGSL that starts the channels of a solver.
pub const START_CHANNELS_WGSL: &str = include_str!("wgsl/start_channels.wgsl");
/// Reductions over a workgroup.
pub const REDUCE_WGSL: &str = include_str!("wgsl/reduce.wgsl");
/// The same for devices with subgroups.
pub const REDUCE_SUBGROUPS_WGSL: &str = include_str!("wgsl/reduce_subgroups.wgsl");
