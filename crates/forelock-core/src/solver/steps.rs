//! A frame as a list of steps, for whoever runs some of them elsewhere.

use super::params::Inextensibility;
use super::{STAGES, SolverParams};

/// A step of a frame: a stage on all strands. See [`Simulation::step_part`](super::Simulation::step_part).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrameStep {
    /// What contacts need to know of the frame's start.
    NoteStart,
    /// Hair as smoothed particles: `find_neighbours` and `push_particles`.
    Particles,
    /// `solve_strands` in a substep; in its first one hair is brought to the frame's origin.
    SolveStrands(u32),
    /// `follow_leader`, solids included; it brings hair to the frame's origin.
    FollowLeader,
    /// `resolve_solids` in a substep.
    ResolveSolids(u32),
    /// `restore_lengths`.
    RestoreLengths,
    /// Hair on the grid: `splat_segments`, `solve_pressure` and `gather_velocities`; where leaders are followed and no contacts come after it, `restore_lengths` too.
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
    /// As smoothed particles.
    pub particles: bool,
    /// In contacts.
    pub contacts: bool,
}

impl FrameStep {
    /// All steps of a frame under `params`, in their order.
    pub fn all(params: &SolverParams, meeting: Meeting) -> impl Iterator<Item = Self> {
        let Meeting { grid, particles, contacts } = meeting;
        let (lengths, substeps, follows) = match params {
            SolverParams::Ams(params) => {
                (params.inextensibility != Inextensibility::Off, params.substeps, false)
            }
            SolverParams::Dftl(_) => (false, 0, true),
        };
        let substeps = (0..substeps).flat_map(|k| [Self::SolveStrands(k), Self::ResolveSolids(k)]);
        let later = [
            (lengths, Self::RestoreLengths),
            (grid, Self::Grid),
            (contacts, Self::Contacts),
            // Without a length pass the last substep's solids are the last word.
            (lengths || grid || contacts, Self::LastSolids),
            (true, Self::CheckStrands),
        ];
        let first =
            [(contacts, Self::NoteStart), (particles, Self::Particles), (follows, Self::FollowLeader)];
        let some = |(is, step): (bool, Self)| is.then_some(step);
        first.into_iter().filter_map(some).chain(substeps).chain(later.into_iter().filter_map(some))
    }

    /// The first of its stages, as reports name it.
    pub fn stage(self) -> &'static str {
        let [solve, follow, solids, lengths, check, grid, _, _, contacts, _, particles, _] = STAGES;
        match self {
            Self::SolveStrands(_) => solve,
            Self::FollowLeader => follow,
            Self::ResolveSolids(_) | Self::LastSolids => solids,
            Self::RestoreLengths => lengths,
            Self::Grid => grid,
            Self::Particles => particles,
            Self::NoteStart | Self::Contacts => contacts,
            Self::CheckStrands => check,
        }
    }
}
