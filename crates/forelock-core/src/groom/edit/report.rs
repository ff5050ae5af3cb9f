//! The report of an edit.

use crate::groom::LiftReport;

/// Statistics of an edit.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct EditReport {
    /// Number of strands selected.
    pub selected: usize,
    /// Number of strands changed.
    pub changed: usize,
    /// Number of strands added.
    pub added: usize,
    /// Number of strands removed.
    pub removed: usize,
    /// Number of strands left unchanged because they are not finite, or the result would not be.
    pub refused: usize,
    /// Number of strands that have too few particles for their curl: fewer than six edges per turn.
    pub coarse: usize,
    /// Whether root bindings were dropped because new strands could not be bound.
    pub bindings_dropped: bool,
    /// How strands were moved out of the body.
    pub lift: LiftReport,
    /// The origin of each strand, one entry for each strand of the edited groom.
    pub sources: Vec<Source>,
}

/// The origin of a strand in an edited groom.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Source {
    /// Index before the edit of the strand that it was, or from which it was made.
    pub strand: u32,
    /// Whether it is a new strand.
    pub fresh: bool,
}

impl std::fmt::Display for EditReport {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { selected, changed, .. } = self;
        write!(f, "{changed} of {selected} strands changed")?;
        for (count, word) in [
            (self.added, "added"),
            (self.removed, "removed"),
            (self.refused, "not finite and left unchanged"),
        ] {
            if count > 0 {
                write!(f, ", {count} {word}")?;
            }
        }
        if self.coarse > 0 {
            write!(
                f,
                "; {} strands have fewer than six particles per turn: `resample` them first",
                self.coarse
            )?;
        }
        if self.bindings_dropped {
            write!(f, "; root bindings dropped")?;
        }
        if self.lift.inside_before + self.lift.edges_before > 0 {
            write!(f, "; {}", self.lift)?;
        }
        Ok(())
    }
}
