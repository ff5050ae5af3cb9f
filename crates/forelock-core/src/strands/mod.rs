//! Strands packed into lanes: constant data ([`Model`]), simulated state ([`State`]), and a stage's
//! view of one block of both ([`BlockView`]).

mod between;
mod block_view;
mod channels;
mod masses;
mod model;
mod sleep;
mod state;
mod strand_frame;

pub use between::Between;
pub(crate) use block_view::{AIR_ROWS, inverse_mass};
pub use block_view::{BlockView, LaneGroup, SCRATCH_ROWS, Scratch};
pub use channels::{BlockChannels, Channel, ChannelKind, ChannelStore};
pub use masses::{MASS_RANGE, Masses};
pub use model::{Block, Model, PackError, PlaceInGroom, Strands};
pub(crate) use sleep::sleeps;
pub use sleep::{SLEEP_SECS, Sleep, SleepPlace, SleepSnapshot};
pub(crate) use state::vec3;
pub use state::{Snapshot, SnapshotError, State, Teleport, number, vector, world_positions};
pub use strand_frame::{StrandFrame, rest_edges};
