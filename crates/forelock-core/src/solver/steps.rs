//! A frame as a list of steps, for whoever runs some of them elsewhere.

use super::params::Inextensibility;
use super::{AmsParams, STAGES};

/// A step of a frame: a stage on all strands. See [`Simulation::step_part`](super::Simulation::step_part).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrameStep {
    /// What contacts need to know of the frame's start.
    NoteStart,
    /// `solve_strands` in a substep; in its first one hair is brought to the frame's origin.
    SolveStrands(u32),
    /// `resolve_solids` in a substep.
    ResolveSolids(u32),
    /// `restore_lengths`.
    RestoreLengths,
    /// Hair on the grid: `splat_segments`, `solve_pressure` and `gather_velocities`.
    Grid,
    /// Contacts between strands: `find_contacts`, `resolve_contacts` and, if there were any, `restore_lengths`.
    Contacts,
    /// `resolve_solids` at the frame's end.
    LastSolids,
    /// `check_strands`.
    CheckStrands,
}

/// Where strands meet in a frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Meeting {
    /// On a grid.
    pub grid: bool,
    /// In contacts.
    pub contacts: bool,
}

impl FrameStep {
    /// All steps of a frame under `params`, in their order.
    pub fn all(params: &AmsParams, meeting: Meeting) -> impl Iterator<Item = Self> {
        let lengths = params.inextensibility != Inextensibility::Off;
        let Meeting { grid, contacts } = meeting;
        let substeps = (0..params.substeps).flat_map(|k| [Self::SolveStrands(k), Self::ResolveSolids(k)]);
        let later = [
            (lengths, Self::RestoreLengths),
            (grid, Self::Grid),
            (contacts, Self::Contacts),
            // Without a length pass the last substep's solids are the last word.
            (lengths || grid || contacts, Self::LastSolids),
            (true, Self::CheckStrands),
        ];
        let first = contacts.then_some(Self::NoteStart);
        first.into_iter().chain(substeps).chain(later.into_iter().filter(|(is, _)| *is).map(|(_, step)| step))
    }

    /// The first of its stages, as reports name it.
    pub fn stage(self) -> &'static str {
        let [solve, solids, lengths, check, grid, _, _, contacts, _] = STAGES;
        match self {
            Self::SolveStrands(_) => solve,
            Self::ResolveSolids(_) | Self::LastSolids => solids,
            Self::RestoreLengths => lengths,
            Self::Grid => grid,
            Self::NoteStart | Self::Contacts => contacts,
            Self::CheckStrands => check,
        }
    }
}
