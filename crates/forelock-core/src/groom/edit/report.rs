//! What an edit tells.

use crate::groom::LiftReport;

/// What an edit did.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct EditReport {
    /// Strands selected.
    pub selected: usize,
    /// Strands changed.
    pub changed: usize,
    /// Strands added.
    pub added: usize,
    /// Strands removed.
    pub removed: usize,
    /// Strands left as they were because they, or what would have become of them, is not finite.
    pub refused: usize,
    /// Strands whose curl is too fine for their particles: fewer than six edges a turn.
    pub coarse: usize,
    /// Whether root bindings were dropped because new strands could not be bound.
    pub bindings_dropped: bool,
    /// How strands were brought out of the body.
    pub lift: LiftReport,
    /// Where each strand comes from, one a strand of the edited groom.
    pub sources: Vec<Source>,
}

/// Where a strand of an edited groom comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Source {
    /// The strand before the edit that it was, or was made from.
    pub strand: u32,
    /// Whether it is a new strand.
    pub fresh: bool,
}

impl std::fmt::Display for EditReport {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { selected, changed, .. } = self;
        write!(f, "{changed} of {selected} strands changed")?;
        for (count, word) in
            [(self.added, "added"), (self.removed, "removed"), (self.refused, "not finite and left")]
        {
            if count > 0 {
                write!(f, ", {count} {word}")?;
            }
        }
        if self.coarse > 0 {
            write!(
                f,
                "; {} strands have fewer than six particles a turn: `resample` them first",
                self.coarse
            )?;
        }
        if self.bindings_dropped {
            write!(f, "; root bindings dropped")?;
        }
        if self.lift.inside_before > 0 {
            write!(f, "; {}", self.lift)?;
        }
        Ok(())
    }
}
