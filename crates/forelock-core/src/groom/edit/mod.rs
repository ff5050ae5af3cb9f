//! Digital grooming: cutting, combing, curling and the like, as operations on a [`Groom`].
//!
//! # Theory
//! A strand is a chain of edges, and most of grooming turns edges without making them longer. Such operations work out
//! where each edge should point; the strand is then laid anew from its root, each edge at the length it had (to the
//! rounding of float32 positions, and it does not add up along the strand, since each particle is placed from where the
//! one before it came to lie). [`Trim`], [`Cut`] and [`Lengthen`] change lengths on purpose, [`Density`] and [`Mirror`]
//! the number of strands.
//!
//! # Practice
//! An [`Edit`] is an operation and a [`Selection`] of the strands it works on. [`Edit::apply`] changes a groom once;
//! [`EditHistory`] keeps one that can be undone and redone. Attributes follow: those of a particle are interpolated where
//! a strand is cut or continued, those of a strand go along with it. Roots and pinned particles stay where they are. With a
//! [`Body`] at hand strands that came to lie inside it are brought out again.
//!
//! Strands that are not finite are left alone, and no edit makes one: a strand for which an operation would, is left as it was
//! and counted. The same edit of the same groom gives the same bits, with any number of threads.
//!
//! ```
//! use forelock_core::groom::Groom;
//! use forelock_core::groom::edit::{Edit, EditHistory, Operation, Trim};
//! use glam::Vec3;
//!
//! let strand: Vec<Vec3> = (0..11).map(|i| Vec3::NEG_Y * 0.02 * i as f32).collect();
//! let mut history = EditHistory::new(Groom::from_strands([strand])?);
//! let bob = Operation::Trim(Trim { to: 0.15, ..Trim::default() });
//! history.apply(&Edit::all(bob), None)?;
//! assert!((history.groom().length(0) - 0.15).abs() < 1e-6);
//! history.undo();
//! assert!((history.groom().length(0) - 0.20).abs() < 1e-6);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Limitations
//! Operations are geometric: hair does not push hair aside. Edges of a strand that had to be brought out of a body keep
//! their length to a tenth of a per cent.

mod chain;
mod change;
mod clump;
mod comb;
mod curl;
mod cut;
mod density;
mod error;
mod history;
mod lengthen;
mod locks;
mod mirror;
mod pull;
mod report;
mod selection;
mod shape;
mod smooth;
#[cfg(test)]
mod tests;

pub use clump::Clump;
pub use comb::Comb;
pub use curl::{Curl, CurlKind, Straighten};
pub use cut::{Cut, Trim};
pub use density::Density;
pub use error::EditError;
pub use history::EditHistory;
pub use lengthen::{Lengthen, Resample};
pub use mirror::{Mirror, MirrorMode};
pub use pull::Pull;
pub use report::{EditReport, Source};
pub use selection::{Cuboid, Selection};
pub use shape::{Ball, Capsule, CutShape, HalfSpace, Stroke, TurnedBox};
pub use smooth::Smooth;

use super::{Groom, LiftParams, LiftReport, lift_out};
use crate::body::{Sdf, TriMesh};
use change::Change;

/// What is done to the selected strands.
#[derive(Clone, Debug, PartialEq)]
pub enum Operation {
    /// `trim`: shorten by length.
    Trim(Trim),
    /// `cut`: shorten where a shape is met.
    Cut(Cut),
    /// `lengthen`: grow on as the tips curl.
    Lengthen(Lengthen),
    /// `resample`: the same curves with another number of particles.
    Resample(Resample),
    /// `comb`: turn along a stroke.
    Comb(Comb),
    /// `attract`: draw to a point.
    Attract(Pull),
    /// `repel`: push from a point.
    Repel(Pull),
    /// `curl`: wind up.
    Curl(Curl),
    /// `straighten`: take the curl out.
    Straighten(Straighten),
    /// `clump`: draw together into locks.
    Clump(Clump),
    /// `density`: fewer strands, or more between those there are.
    Density(Density),
    /// `mirror`: across a plane.
    Mirror(Mirror),
    /// `smooth`: even out along strands and between neighbours.
    Smooth(Smooth),
}

impl Operation {
    /// Names of all operations, as scripts write them.
    pub const NAMES: [&'static str; 13] = [
        "trim",
        "cut",
        "lengthen",
        "resample",
        "comb",
        "attract",
        "repel",
        "curl",
        "straighten",
        "clump",
        "density",
        "mirror",
        "smooth",
    ];

    /// The name, one of [`Operation::NAMES`].
    pub fn name(&self) -> &'static str {
        match self {
            Self::Trim(_) => "trim",
            Self::Cut(_) => "cut",
            Self::Lengthen(_) => "lengthen",
            Self::Resample(_) => "resample",
            Self::Comb(_) => "comb",
            Self::Attract(_) => "attract",
            Self::Repel(_) => "repel",
            Self::Curl(_) => "curl",
            Self::Straighten(_) => "straighten",
            Self::Clump(_) => "clump",
            Self::Density(_) => "density",
            Self::Mirror(_) => "mirror",
            Self::Smooth(_) => "smooth",
        }
    }

    /// Checks every parameter against its documented range.
    ///
    /// # Errors
    /// [`EditError::Parameter`] for the first that is outside.
    pub fn validate(&self) -> Result<(), EditError> {
        match self {
            Self::Trim(op) => op.validate(),
            Self::Cut(op) => op.validate(),
            Self::Lengthen(op) => op.validate(),
            Self::Resample(op) => op.validate(),
            Self::Comb(op) => op.validate(),
            Self::Attract(op) | Self::Repel(op) => op.validate(),
            Self::Curl(op) => op.validate(),
            Self::Straighten(op) => op.validate(),
            Self::Clump(op) => op.validate(),
            Self::Density(op) => op.validate(),
            Self::Mirror(op) => op.validate(),
            Self::Smooth(op) => op.validate(),
        }
    }

    /// What it would change of `groom`.
    fn change(&self, groom: &Groom, selected: &[bool]) -> Change {
        match self {
            Self::Trim(op) => op.change(groom, selected),
            Self::Cut(op) => op.change(groom, selected),
            Self::Lengthen(op) => op.change(groom, selected),
            Self::Resample(op) => op.change(groom, selected),
            Self::Comb(op) => op.change(groom, selected),
            Self::Attract(op) => op.change(groom, selected, 1.0),
            Self::Repel(op) => op.change(groom, selected, -1.0),
            Self::Curl(op) => op.change(groom, selected),
            Self::Straighten(op) => op.change(groom, selected),
            Self::Clump(op) => op.change(groom, selected),
            Self::Density(op) => op.change(groom, selected),
            Self::Mirror(op) => op.change(groom, selected),
            Self::Smooth(op) => op.change(groom, selected),
        }
    }
}

/// An operation and the strands it works on.
#[derive(Clone, Debug, PartialEq)]
pub struct Edit {
    /// What is done.
    pub operation: Operation,
    /// To which strands; the default is all.
    pub only: Selection,
}

/// What hair grows on, so that edits keep out of it.
#[derive(Clone, Copy, Debug)]
pub struct Body<'a> {
    /// Its distance field, in the groom's space.
    pub sdf: &'a Sdf,
    /// Its mesh, to which new strands are bound. Without it a groom loses its root bindings when it gets new strands.
    pub mesh: Option<&'a TriMesh>,
    /// Distance in metres at which strands are kept from it.
    pub margin: f32,
}

impl Edit {
    /// `operation` on all strands.
    pub fn all(operation: Operation) -> Self {
        Self { operation, only: Selection::default() }
    }

    /// Checks the operation's and the selection's parameters.
    ///
    /// # Errors
    /// [`EditError::Parameter`] for the first outside its range.
    pub fn validate(&self) -> Result<(), EditError> {
        self.operation.validate()?;
        self.only.validate().map_err(|error| error.under("only"))
    }

    /// Does it to `groom`, in whose space all its points are, and keeps strands out of `body`.
    ///
    /// # Errors
    /// [`EditError`] if a parameter is out of range or the result is too large; `groom` is as it was then.
    pub fn apply(&self, groom: &mut Groom, body: Option<&Body<'_>>) -> Result<EditReport, EditError> {
        self.validate()?;
        groom.check_attributes()?;
        let chosen = self.only.strands(groom);
        let finite = |s: usize| groom.strand(s).len() >= 2 && groom.strand(s).iter().all(|p| p.is_finite());
        let selected: Vec<bool> = chosen.iter().enumerate().map(|(s, &chosen)| chosen && finite(s)).collect();
        let count = |flags: &[bool]| flags.iter().filter(|&&flag| flag).count();
        let change = self.operation.change(groom, &selected);
        let mut report = EditReport {
            selected: count(&chosen),
            refused: count(&chosen) - count(&selected),
            coarse: change.coarse,
            ..EditReport::default()
        };
        let touched = change.write(groom, body, &mut report)?;
        if let Some(body) = body {
            report.lift = lift(groom, body, &touched);
        }
        Ok(report)
    }
}

/// Which strands an edit touched, by their number after it.
#[derive(Clone, Debug, Default)]
struct Touched {
    /// Strands that were there before.
    changed: Vec<usize>,
    /// New ones, whose roots may move too.
    fresh: Vec<usize>,
}

/// Brings the strands that an edit touched out of the body.
fn lift(groom: &mut Groom, body: &Body<'_>, touched: &Touched) -> LiftReport {
    let mut sum = LiftReport::default();
    for (strands, move_roots) in [(&touched.changed, false), (&touched.fresh, true)] {
        if strands.is_empty() {
            continue;
        }
        let mut part = groom.only(strands);
        let params = LiftParams { margin: body.margin, move_roots, ..LiftParams::default() };
        let report = lift_out(&mut part, body.sdf, &params);
        for (index, &strand) in strands.iter().enumerate() {
            let range = groom.range(strand);
            groom.positions_mut()[range].copy_from_slice(part.strand(index));
        }
        sum = sum.and(&report);
    }
    sum
}
