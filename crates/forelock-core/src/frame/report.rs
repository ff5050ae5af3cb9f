//! What a frame reports: times of its stages, stretch, contacts with colliders, and what the
//! interactions did.

use super::plan::{CHECK, COLLIDE, LENGTHS};
use crate::collide::resolve_solids::SolidContacts;

/// Seconds spent in each stage, by the stage's name, in the order in which stages first reported.
#[derive(Clone, Copy, PartialEq)]
pub struct StageTimes {
    entries: [(&'static str, f64); Self::CAPACITY],
    len: usize,
}

impl StageTimes {
    /// The most stages that are told apart; the time of further ones counts for the last.
    pub const CAPACITY: usize = 24;

    /// Adds `secs` to stage `name`. Allocates nothing.
    pub fn add(&mut self, name: &'static str, secs: f64) {
        if let Some((_, sum)) = self.entries[..self.len].iter_mut().find(|(own, _)| *own == name) {
            *sum += secs;
        } else if self.len < Self::CAPACITY {
            self.entries[self.len] = (name, secs);
            self.len += 1;
        } else {
            self.entries[Self::CAPACITY - 1].1 += secs;
        }
    }

    /// Seconds of stage `name`; 0 if it did not run.
    pub fn get(&self, name: &str) -> f64 {
        self.iter().find(|(own, _)| *own == name).map_or(0.0, |(_, secs)| secs)
    }

    /// All stages with their seconds.
    pub fn iter(&self) -> impl Iterator<Item = (&'static str, f64)> + '_ {
        self.entries[..self.len].iter().copied()
    }

    /// Adds all times of `other`.
    pub fn add_all(&mut self, other: &Self) {
        other.iter().for_each(|(name, secs)| self.add(name, secs));
    }
}

impl std::fmt::Debug for StageTimes {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_map().entries(self.iter()).finish()
    }
}

impl Default for StageTimes {
    fn default() -> Self {
        Self { entries: [("", 0.0); Self::CAPACITY], len: 0 }
    }
}

/// What the grid did in a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GridReport {
    /// Cells whose hair was kept from being pressed together.
    pub cells: usize,
    /// Iterations of the pressure solve, all rounds together.
    pub iterations: u32,
    /// Largest change in the last sweeps, over the largest right-hand side.
    pub residual: f64,
    /// Density of the densest cell before the solve, relative to that of the same hair at rest.
    pub densest: f64,
    /// An upper bound of the displacement of hair that was too dense, metres.
    pub farthest_m: f64,
    /// Seconds of splat, solve and gather.
    pub secs: [f64; 3],
}

/// What contacts between strands did in a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ContactReport {
    /// Contacts resolved; of several exchanges in the frame, those of the last.
    pub contacts: usize,
    /// The largest displacement of a particle in that exchange, metres.
    pub farthest_m: f64,
    /// Seconds of finding and of resolving.
    pub secs: [f64; 2],
}

impl ContactReport {
    /// The report of this exchange and a `later` one of the same frame.
    #[must_use]
    pub fn then(self, later: Self) -> Self {
        let secs = [0, 1].map(|k| self.secs[k] + later.secs[k]);
        Self { secs, ..later_of(self, later) }
    }
}

/// What SPH did in a step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SphReport {
    /// The largest density over that at rest.
    pub densest: f64,
    /// Mean count of neighbours.
    pub neighbours: f64,
    /// Seconds of finding neighbours and of computing accelerations.
    pub secs: [f64; 2],
}

/// What a frame did.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameReport {
    /// Largest |l/l₀ − 1| of an edge after the length pass.
    pub max_edge_stretch: f64,
    /// The same at the end of the frame, after the final collision pass.
    pub max_edge_stretch_final: f64,
    /// Deepest particle under a collider's surface, metres.
    pub max_penetration_m: f64,
    /// Particles in contact with a collider.
    pub touching: u32,
    /// Strands that were not finite and were put back to their rest shape.
    pub quarantined_strands: u32,
    /// Strands that slept in this frame; all other numbers are of those that were awake.
    pub sleeping_strands: u32,
    /// What the grid did, if there is one.
    pub grid: GridReport,
    /// What contacts between strands did, if there are any.
    pub strand_contacts: ContactReport,
    /// What SPH did, if it is used.
    pub sph: SphReport,
    /// Seconds of work in each stage, summed over threads (for stages that all threads share, their
    /// time times the threads).
    pub stages: StageTimes,
    /// Seconds of the frame on a device's clock, if it has one.
    pub device_secs: Option<f64>,
}

impl FrameReport {
    /// This report and that of a `later` frame: maxima and sums over both.
    #[must_use]
    pub fn then(self, later: &Self) -> Self {
        let Self { touching, sleeping_strands, .. } = *later;
        Self { touching, sleeping_strands, ..self.and(later) }
    }

    /// This report and that of `other` steps of the same frame.
    #[must_use]
    pub fn and(self, other: &Self) -> Self {
        let mut stages = self.stages;
        stages.add_all(&other.stages);
        Self {
            max_edge_stretch: self.max_edge_stretch.max(other.max_edge_stretch),
            max_edge_stretch_final: self.max_edge_stretch_final.max(other.max_edge_stretch_final),
            max_penetration_m: self.max_penetration_m.max(other.max_penetration_m),
            touching: self.touching + other.touching,
            quarantined_strands: self.quarantined_strands + other.quarantined_strands,
            sleeping_strands: self.sleeping_strands.max(other.sleeping_strands),
            grid: later_of(self.grid, other.grid),
            strand_contacts: self.strand_contacts.then(other.strand_contacts),
            sph: later_of(self.sph, other.sph),
            stages,
            device_secs: self
                .device_secs
                .zip(other.device_secs)
                .map(|(a, b)| a + b)
                .or(self.device_secs)
                .or(other.device_secs),
        }
    }

    /// Adds what the strands of all blocks reported; `solve_stage` names the solver's stage.
    pub(crate) fn add_blocks(&mut self, sum: &BlockReport, solve_stage: &'static str) {
        self.max_edge_stretch = self.max_edge_stretch.max(sum.max_edge_stretch);
        self.max_edge_stretch_final = sum.max_edge_stretch_final;
        self.max_penetration_m = sum.contacts.deepest;
        self.touching = sum.contacts.touching;
        self.quarantined_strands += sum.quarantined;
        let nanos = sum.nanos;
        let stages = [
            (solve_stage, nanos.solve),
            (COLLIDE, nanos.collide),
            (LENGTHS, nanos.lengths),
            (CHECK, nanos.check),
        ];
        for (name, nanos) in stages {
            #[expect(clippy::cast_precision_loss, reason = "nanoseconds of a frame")]
            let secs = nanos as f64 * 1e-9;
            if nanos > 0 {
                self.stages.add(name, secs);
            }
        }
    }
}

/// `later`, or `before` where `later` reports nothing.
fn later_of<R: Default + PartialEq>(before: R, later: R) -> R {
    if later == R::default() { before } else { later }
}

/// Nanoseconds in the stages that blocks of strands run, summed over threads.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BlockNanos {
    /// The solver's own stage.
    pub solve: u64,
    /// Collisions with solids.
    pub collide: u64,
    /// The length pass.
    pub lengths: u64,
    /// Checks.
    pub check: u64,
}

impl BlockNanos {
    fn plus(self, other: Self) -> Self {
        Self {
            solve: self.solve + other.solve,
            collide: self.collide + other.collide,
            lengths: self.lengths + other.lengths,
            check: self.check + other.check,
        }
    }
}

/// What one block of strands, or all blocks together, report of a run of consecutive steps.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BlockReport {
    /// Largest |l/l₀ − 1| after the length pass.
    pub max_edge_stretch: f64,
    /// The same at the frame's end, after the final collision pass.
    pub max_edge_stretch_final: f64,
    /// Contacts with colliders, of the last collision pass.
    pub contacts: SolidContacts,
    /// Strands put back to rest because they were not finite.
    pub quarantined: u32,
    /// Time a stage.
    pub nanos: BlockNanos,
}

impl BlockReport {
    /// This run of steps and the one that comes `after` it.
    #[must_use]
    pub fn then(self, after: &Self) -> Self {
        Self {
            max_edge_stretch: self.max_edge_stretch.max(after.max_edge_stretch),
            quarantined: self.quarantined + after.quarantined,
            nanos: self.nanos.plus(after.nanos),
            ..*after
        }
    }

    /// A block's solver steps and the shared steps after them, among which a final collision pass
    /// replaces the contacts of the substeps (`collided`).
    #[must_use]
    pub fn finished(self, after: Self, collided: bool) -> Self {
        let contacts = if collided { after.contacts } else { self.contacts };
        Self { contacts, ..self.merge(after) }
    }

    /// Two blocks together; the same whatever the order.
    #[must_use]
    pub fn merge(self, other: Self) -> Self {
        Self {
            max_edge_stretch: self.max_edge_stretch.max(other.max_edge_stretch),
            max_edge_stretch_final: self.max_edge_stretch_final.max(other.max_edge_stretch_final),
            contacts: SolidContacts {
                touching: self.contacts.touching + other.contacts.touching,
                edges: self.contacts.edges + other.contacts.edges,
                lanes: self.contacts.lanes | other.contacts.lanes,
                deepest: self.contacts.deepest.max(other.contacts.deepest),
            },
            quarantined: self.quarantined + other.quarantined,
            nanos: self.nanos.plus(other.nanos),
        }
    }
}
