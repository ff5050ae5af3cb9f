//! Digital grooming: cutting, combing, curling and other operations on a [`Groom`].
//!
//! # Theory
//! A strand is a chain of edges, and most grooming operations rotate edges without changing their
//! lengths. Such an operation computes the direction of each edge; the strand is then rebuilt from
//! its root, with each edge at its original length. (Lengths change by the rounding of float32
//! positions only, and the error does not accumulate along the strand, because each particle is
//! placed from the rounded position of the previous one.) [`Trim`], [`Cut`] and [`Lengthen`] change
//! lengths on purpose, [`Density`] and [`Mirror`] the number of strands.
//!
//! # Practice
//! An [`Edit`] is an operation and a [`Selection`] of the strands to which it applies.
//! [`Edit::apply`] changes a groom once; [`EditHistory`] keeps a groom whose edits can be undone
//! and redone. Attributes are preserved: attributes of particles are interpolated where a strand is
//! cut or extended, attributes of strands are copied. Roots and pinned particles are not moved. If
//! a [`Body`] is given, strands that an edit moved into it are moved out again.
//!
//! Strands that are not finite are not changed. If an operation would make a strand non-finite, the
//! strand is left unchanged and counted. The same edit of the same groom gives bit-identical
//! results with any number of threads.
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
//! Operations are geometric: strands do not push each other aside. If a strand had to be moved out
//! of a body, its edges keep their lengths to a tenth of a per cent.

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
use crate::memory;
use change::Change;
use glam::Vec3;

/// An operation on the selected strands.
#[derive(Clone, Debug, PartialEq)]
pub enum Operation {
    /// `trim`: shortens strands by length.
    Trim(Trim),
    /// `cut`: shortens strands where they enter a shape.
    Cut(Cut),
    /// `lengthen`: extends strands, continuing their curl.
    Lengthen(Lengthen),
    /// `resample`: the same curves with another number of particles.
    Resample(Resample),
    /// `comb`: rotates strands along a stroke.
    Comb(Comb),
    /// `attract`: moves hair towards a point.
    Attract(Pull),
    /// `repel`: moves hair away from a point.
    Repel(Pull),
    /// `curl`: curls strands.
    Curl(Curl),
    /// `straighten`: removes curls.
    Straighten(Straighten),
    /// `clump`: gathers strands into locks.
    Clump(Clump),
    /// `density`: removes strands, or adds strands between the existing ones.
    Density(Density),
    /// `mirror`: mirrors strands at a plane.
    Mirror(Mirror),
    /// `smooth`: smooths along strands and between neighbours.
    Smooth(Smooth),
}

impl Operation {
    /// Names of all operations, as used in scripts.
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

    /// The name of the operation, one of [`Operation::NAMES`].
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
    /// [`EditError::Parameter`] for the first parameter that is out of range.
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

    /// The most particles that `groom` will have after the operation; lengthened strands have a few
    /// more.
    fn foreseen_particles(&self, groom: &Groom) -> u64 {
        let (strands, particles) = (groom.strand_count() as u64, groom.particle_count() as u64);
        match self {
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a factor up to 100")]
            Self::Density(op) => (particles as f64 * f64::from(op.factor.max(1.0))) as u64,
            Self::Resample(op) => (strands * u64::from(op.particles)).max(particles),
            Self::Mirror(_) => 2 * particles,
            _ => particles,
        }
    }

    /// The change that the operation would make to `groom`.
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

/// An operation and the strands to which it applies.
#[derive(Clone, Debug, PartialEq)]
pub struct Edit {
    /// The operation.
    pub operation: Operation,
    /// The strands to which it applies; the default is all.
    pub only: Selection,
}

/// The body on which the hair grows; edits keep strands outside of it.
#[derive(Clone, Copy, Debug)]
pub struct Body<'a> {
    /// Distance field of the body, in the groom's space.
    pub sdf: &'a Sdf,
    /// Mesh of the body, to which new strands are bound. Without it a groom loses its root bindings
    /// when strands are added.
    pub mesh: Option<&'a TriMesh>,
    /// Distance in metres at which strands are kept from the body.
    pub margin: f32,
}

impl Edit {
    /// `operation` applied to all strands.
    pub fn all(operation: Operation) -> Self {
        Self { operation, only: Selection::default() }
    }

    /// Checks the parameters of the operation and the selection.
    ///
    /// # Errors
    /// [`EditError::Parameter`] for the first parameter that is out of range.
    pub fn validate(&self) -> Result<(), EditError> {
        self.operation.validate()?;
        self.only.validate().map_err(|error| error.under("only"))
    }

    /// Applies the edit to `groom`, in whose space all points of the edit are given, and keeps
    /// strands outside `body`.
    ///
    /// # Errors
    /// [`EditError`] if a parameter is out of range or the result is too large; `groom` is then
    /// unchanged.
    pub fn apply(&self, groom: &mut Groom, body: Option<&Body<'_>>) -> Result<EditReport, EditError> {
        self.validate()?;
        groom.check_attributes()?;
        let each = size_of::<change::Particle>() + size_of::<Vec3>();
        let foreseen = self.operation.foreseen_particles(groom);
        memory::check("the edited groom", foreseen, each as u64, "lower its strands or their particles")?;
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

/// The strands that an edit changed, by their indices after it.
#[derive(Clone, Debug, Default)]
struct Touched {
    /// Strands that existed before.
    changed: Vec<usize>,
    /// New strands, whose roots may be moved too.
    fresh: Vec<usize>,
}

/// Moves the strands that an edit changed out of the body.
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
