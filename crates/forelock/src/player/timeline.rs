//! Changes of a running simulation, recorded at their frames.

use std::sync::Arc;

use forelock_core::air::WindParams;
use forelock_core::body::Motion;
use forelock_core::groom::edit::Edit;
use forelock_core::pose::Pose;
use forelock_core::simulation::Teleport;
use glam::DVec3;

use super::ColliderId;
use crate::assets::Solid;
use crate::scene::{ColliderSection, InteractionSection, SolverSection};

/// A change of a running simulation.
#[derive(Clone, Debug)]
pub(super) enum Change {
    Solver(Arc<SolverSection>),
    Interaction(Arc<InteractionSection>),
    Gravity(DVec3),
    Wind(WindParams),
    Motion(Arc<Motion>),
    HeadPose(Pose),
    Teleport(Teleport),
    ColliderPose(ColliderId, Pose),
    AddCollider(ColliderId, Arc<Solid>, Arc<ColliderSection>),
    RemoveCollider(ColliderId),
    Edit(Arc<Edit>),
}

impl Change {
    /// Its name for [`Player::undo`](super::Player::undo); none for motions and poses, which are
    /// part of the performance and cannot be undone.
    pub fn undo_name(&self) -> Option<&'static str> {
        match self {
            Self::Solver(_) => Some("solver"),
            Self::Interaction(_) => Some("interaction"),
            Self::Gravity(_) => Some("gravity"),
            Self::Wind(_) => Some("wind"),
            Self::AddCollider(..) => Some("add collider"),
            Self::RemoveCollider(_) => Some("remove collider"),
            Self::Edit(edit) => Some(edit.operation.name()),
            Self::Motion(_) | Self::HeadPose(_) | Self::Teleport(_) | Self::ColliderPose(..) => None,
        }
    }
}

/// A change and when it was made.
#[derive(Clone, Debug)]
pub(super) struct Recorded {
    /// The frame before whose step it takes effect.
    pub frame: u32,
    /// Which change it was, in the order in which they were made.
    pub serial: u64,
    /// Changes of one group are undone together.
    pub group: Option<u64>,
    pub change: Change,
}

impl Recorded {
    fn is_with(&self, other: &Self) -> bool {
        self.group.is_some() && self.group == other.group
    }
}

/// All changes in the order of their frames.
#[derive(Clone, Debug, Default)]
pub(super) struct Timeline {
    changes: Vec<Recorded>,
    /// Changes that were undone, the last one last.
    undone: Vec<Recorded>,
    serial: u64,
    /// The group of new changes.
    pub group: Option<u64>,
}

impl Timeline {
    /// Change number `index` in order of frames, if it takes effect at `frame` or before.
    pub fn due(&self, index: usize, frame: u32) -> Option<&Change> {
        self.changes.get(index).filter(|recorded| recorded.frame <= frame).map(|recorded| &recorded.change)
    }

    /// All changes.
    pub fn all(&self) -> impl Iterator<Item = &Change> {
        self.changes.iter().map(|recorded| &recorded.change)
    }

    /// A number above those of all colliders that were added.
    pub fn next_collider(&self) -> u32 {
        let added = self.changes.iter().chain(&self.undone).filter_map(|recorded| match &recorded.change {
            Change::AddCollider(id, ..) => Some(id.0 + 1),
            _ => None,
        });
        added.max().unwrap_or(0)
    }

    /// What [`Timeline::undo`] and [`Timeline::redo`] would move: the names.
    pub fn next(&self) -> [Option<&'static str>; 2] {
        let last = self.last_undoable().and_then(|index| self.changes.get(index));
        [last, self.undone.last()].map(|recorded| recorded?.change.undo_name())
    }

    /// Records a new change after all of its frame; its index.
    pub fn record(&mut self, frame: u32, change: Change) -> usize {
        if change.undo_name().is_some() {
            self.undone.clear();
        }
        self.serial += 1;
        self.insert(Recorded { frame, serial: self.serial, group: self.group, change })
    }

    fn insert(&mut self, recorded: Recorded) -> usize {
        let index = self.changes.partition_point(|other| other.frame <= recorded.frame);
        self.changes.insert(index, recorded);
        index
    }

    /// Takes the change out that was made last and can be undone, with the others of its group:
    /// where the first of them was.
    pub fn undo(&mut self) -> Option<Moved> {
        let mut moved: Option<Moved> = None;
        while let Some(index) = self.last_undoable() {
            if moved.is_some() && !self.undone.last().is_some_and(|own| own.is_with(&self.changes[index])) {
                break;
            }
            let recorded = self.changes.remove(index);
            moved = Some(Moved::of(index, &recorded).and(moved));
            self.undone.push(recorded);
        }
        moved
    }

    /// Puts the change back that was undone last, with the others of its group: where the first of
    /// them is now.
    pub fn redo(&mut self) -> Option<Moved> {
        let first = self.undone.pop()?;
        let more = self.undone.iter().rev().take_while(|other| other.is_with(&first)).count();
        let rest = self.undone.split_off(self.undone.len() - more);
        let mut moved = None;
        for recorded in std::iter::once(first).chain(rest.into_iter().rev()) {
            let index = self.insert(recorded);
            moved = self.changes.get(index).map(|recorded| Moved::of(index, recorded).and(moved));
        }
        moved
    }

    fn last_undoable(&self) -> Option<usize> {
        let undoable = self.changes.iter().enumerate().filter(|(_, r)| r.change.undo_name().is_some());
        undoable.max_by_key(|(_, recorded)| recorded.serial).map(|(index, _)| index)
    }

    /// Whether the first `count` changes of both are the same.
    pub fn agrees_with(&self, other: &Self, count: usize) -> bool {
        let serials = |timeline: &Self| -> Option<Vec<u64>> {
            Some(timeline.changes.get(..count)?.iter().map(|recorded| recorded.serial).collect())
        };
        let ours = serials(self);
        ours.is_some() && ours == serials(other)
    }
}

/// A change that was taken out or put back.
#[derive(Clone, Copy, Debug)]
pub(super) struct Moved {
    pub index: usize,
    pub frame: u32,
    pub name: &'static str,
}

impl Moved {
    fn of(index: usize, recorded: &Recorded) -> Self {
        Self { index, frame: recorded.frame, name: recorded.change.undo_name().unwrap_or_default() }
    }

    /// The first of both.
    fn and(self, other: Option<Self>) -> Self {
        let Some(other) = other else { return self };
        Self { index: self.index.min(other.index), frame: self.frame.min(other.frame), name: self.name }
    }
}
