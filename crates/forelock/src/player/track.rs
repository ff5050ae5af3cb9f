//! Poses over time of the head and of solids: a motion, or a drag from outside.

use std::sync::Arc;

use forelock_core::body::Motion;
use forelock_core::pose::Pose;

/// A pose as a function of time.
#[derive(Clone, Debug)]
pub(super) enum Track {
    /// As a scene describes it.
    Motion(Arc<Motion>),
    /// From one pose to another at constant speed; at rest before and after.
    Drag(Drag),
}

/// A drag.
#[derive(Clone, Copy, Debug)]
pub(super) struct Drag {
    pub from: Pose,
    pub to: Pose,
    pub start_secs: f64,
    pub end_secs: f64,
}

impl Track {
    /// The pose at `secs`.
    pub fn pose(&self, secs: f64) -> Pose {
        match self {
            Self::Motion(motion) => motion.pose(secs),
            Self::Drag(drag) => {
                let share = (secs - drag.start_secs) / (drag.end_secs - drag.start_secs);
                match share {
                    share if share >= 1.0 => drag.to,
                    share if share > 0.0 => drag.from.interpolate(&drag.to, share),
                    _ => drag.from,
                }
            }
        }
    }

    /// The discontinuity of the pose after the first and not after the second of `times`.
    pub fn jump_between(&self, times: [f64; 2]) -> Option<Pose> {
        match self {
            Self::Motion(motion) => motion.jump_between(times),
            Self::Drag(_) => None,
        }
    }
}
