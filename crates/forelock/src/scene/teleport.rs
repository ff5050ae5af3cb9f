//! `[[teleport]]`: jumps of the body that are not motion.

use forelock_core::simulation::Teleport;
use serde::{Deserialize, Serialize};

forelock_core::documented! {
/// `[[teleport]]`: one declared jump of the body.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TeleportSection {
    /// When. What the body's motion does in the step that holds this time is a jump: its keyframe
    /// with `jump = true`, or without one the whole step. Unit s, no default, range 1e-6 to 1e6.
    pub at_secs: f64,
    /// "reset": the hair is at rest afterwards; "carry-shape": it keeps its shape and is at rest
    /// relative to the world; "carry-shape-and-velocity": it keeps its motion too. Default
    /// "carry-shape".
    pub mode: Teleport,
}
}
