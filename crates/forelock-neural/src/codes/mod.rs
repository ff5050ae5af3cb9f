//! Where a strand is and what it looks like at rest: the root's frame and coordinates, and the
//! locks whose mean code each of their strands receives.

mod encode;
pub mod encoder;
mod locks;
mod root_frame;
mod statics;

pub use encode::Encoder;
pub use locks::{LOCK_SIZE, Locks, LocksError};
pub use root_frame::{LOCAL_SCALE_CM, RootFrameError, crown_uv, encoder_inputs, local_strand, root_frame};
pub use statics::static_inputs;
