//! A groom with undo and redo.

use glam::Vec3;

use super::{Body, Edit, EditError, EditReport};
use crate::groom::Groom;

/// A groom and the edits that were applied to it.
///
/// Undo restores every bit. For an edit that only moved particles the old positions are stored; for
/// any other edit the previous groom is stored.
#[derive(Clone, Debug)]
pub struct EditHistory {
    groom: Groom,
    done: Vec<Step>,
    undone: Vec<Step>,
}

/// An edit and the data that reverts it (or, after an undo, reapplies it).
#[derive(Clone, Debug)]
struct Step {
    edit: Edit,
    other: Other,
}

#[derive(Clone, Debug)]
enum Other {
    /// Indices of strands, and the positions of their particles one after another.
    Moved {
        strands: Vec<u32>,
        positions: Vec<Vec3>,
    },
    Whole(Box<Groom>),
}

impl EditHistory {
    /// A history that starts with `groom`.
    pub fn new(groom: Groom) -> Self {
        Self { groom, done: Vec::new(), undone: Vec::new() }
    }

    /// The current groom.
    pub fn groom(&self) -> &Groom {
        &self.groom
    }

    /// The current groom, without its history.
    pub fn into_groom(self) -> Groom {
        self.groom
    }

    /// The edits applied to the groom, oldest first.
    pub fn edits(&self) -> impl ExactSizeIterator<Item = &Edit> {
        self.done.iter().map(|step| &step.edit)
    }

    /// Applies `edit`. Edits that were undone before can no longer be redone.
    ///
    /// # Errors
    /// The same errors as [`Edit::apply`]; the history is unchanged in this case.
    pub fn apply(&mut self, edit: &Edit, body: Option<&Body<'_>>) -> Result<EditReport, EditError> {
        let mut after = self.groom.clone();
        let report = edit.apply(&mut after, body)?;
        let before = std::mem::replace(&mut self.groom, after);
        let other = Other::before(before, &self.groom);
        self.undone.clear();
        self.done.push(Step { edit: edit.clone(), other });
        Ok(report)
    }

    /// Reverts the last edit and returns it; `None` if there is no edit to undo.
    pub fn undo(&mut self) -> Option<&Edit> {
        let mut step = self.done.pop()?;
        step.other.swap(&mut self.groom);
        self.undone.push(step);
        self.undone.last().map(|step| &step.edit)
    }

    /// Reapplies the edit that was undone last and returns it; `None` if there is no edit to redo.
    pub fn redo(&mut self) -> Option<&Edit> {
        let mut step = self.undone.pop()?;
        step.other.swap(&mut self.groom);
        self.done.push(step);
        self.done.last().map(|step| &step.edit)
    }

    /// Drops all but the last `steps` edits and all undone edits, to limit memory.
    pub fn keep_last(&mut self, steps: usize) {
        self.done.drain(..self.done.len().saturating_sub(steps));
        self.undone.clear();
    }

    /// Approximate size in bytes of the history, without the groom.
    pub fn bytes(&self) -> usize {
        self.done.iter().chain(&self.undone).map(|step| step.other.bytes()).sum()
    }
}

impl Other {
    /// The data needed to revert `after` to `before`.
    fn before(mut before: Groom, after: &Groom) -> Self {
        if before.strand_offsets() != after.strand_offsets() {
            return Self::Whole(Box::new(before));
        }
        let bits = |points: &[Vec3]| bytemuck::cast_slice::<Vec3, u32>(points).to_vec();
        let moved = (0..after.strand_count()).filter(|&s| bits(before.strand(s)) != bits(after.strand(s)));
        let moved: Vec<usize> = moved.collect();
        let positions: Vec<Vec3> = moved.iter().flat_map(|&s| before.strand(s).iter().copied()).collect();
        // The grooms now have the same positions, so only attributes can differ. NaN is not equal
        // to itself, so a groom with NaN is stored whole.
        for &strand in &moved {
            let range = before.range(strand);
            before.positions_mut()[range].copy_from_slice(after.strand(strand));
        }
        if before == *after {
            #[expect(clippy::cast_possible_truncation, reason = "offsets are 32-bit, so strand indices fit")]
            let strands = moved.iter().map(|&s| s as u32).collect();
            return Self::Moved { strands, positions };
        }
        let mut from = 0;
        for &strand in &moved {
            let range = before.range(strand);
            let count = range.len();
            before.positions_mut()[range].copy_from_slice(&positions[from..from + count]);
            from += count;
        }
        Self::Whole(Box::new(before))
    }

    /// Exchanges this data with that of `groom`.
    fn swap(&mut self, groom: &mut Groom) {
        match self {
            Self::Whole(other) => std::mem::swap(other.as_mut(), groom),
            Self::Moved { strands, positions } => {
                let mut from = 0;
                for &strand in strands.iter() {
                    let range = groom.range(strand as usize);
                    let count = range.len();
                    groom.positions_mut()[range].swap_with_slice(&mut positions[from..from + count]);
                    from += count;
                }
            }
        }
    }

    fn bytes(&self) -> usize {
        match self {
            Self::Moved { strands, positions } => size_of_val(&**strands) + size_of_val(&**positions),
            Self::Whole(groom) => {
                // Positions, offsets and the attributes of particles that are present.
                let attributes = usize::from(groom.widths.is_some())
                    + usize::from(groom.transparencies.is_some())
                    + 3 * usize::from(groom.colours.is_some());
                groom.particle_count() * (12 + 4 * attributes) + size_of_val(groom.strand_offsets())
            }
        }
    }
}
