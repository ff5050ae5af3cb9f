//! The experiments of the papers, rerun: tables, series over time, plots and pictures.
//!
//! # Practice
//! [`Figure`] reruns the ablations of Figs. 4 and 5 on one strand and a wisp. [`Experiment`] reruns
//! what the paper shows as film strips and leaves to the eye (Figs. 8 to 11 and the asymmetric
//! style), measured: how far hair is from its rest shape, over time. [`table1()`] runs every scene
//! of Table 1 and puts our times beside the paper's. [`dftl_tables`] and [`volume`] do the same for
//! the follow-the-leader paper, [`neural_tables`] and [`NeuralFigure`] for the learned simulator's.
//! [`compare`] runs all solvers on its scenes. The scenes are those of
//! `scenes/ams` and `scenes/dftl`, built in; only what they read from files must be there.

mod ablations;
mod coaster;
mod dftl;
mod followed;
mod guides;
mod hollow;
mod keeping;
mod neuralocks;
mod scenes;
mod solvers;
mod strand;
mod study;
mod table1;
mod trim;
mod watch;

pub use ablations::{Figure, Measures, PaperRow, PaperTable};
pub use dftl::{DftlTables, SceneRow, SizeRow, dftl_tables, volume};
pub use guides::{GUIDES, GuidesRow, GuidesTable};
pub use neuralocks::{NeuralFigure, NeuralOptions, neural_tables};
pub use solvers::compare;
pub use study::{Strip, Study, Table};
pub use table1::{Table1, Table1Options, Table1Row, table1};

use crate::BenchError;
use forelock::Observer;

/// An experiment whose outcome the paper shows in pictures only.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Experiment {
    /// Fig. 8: a sphere with openings, in hair that guides carry and in hair that is simulated.
    HollowSphere,
    /// Fig. 9: a beard under AMS and under plain mass-spring.
    Beard,
    /// Fig. 1, middle: a style that is long on one side and short on the other, under both.
    Asymmetric,
    /// Fig. 10: a ride that damages the ties to the rest shape, and what is left of the shape after
    /// it.
    RollerCoaster,
    /// Fig. 11: a trim, purely geometric and simulated.
    Grooming,
}

impl Experiment {
    /// Runs it with `share` (0 to 1) of its strands, where they are grown.
    ///
    /// # Errors
    /// [`BenchError`] if its scene cannot be simulated, for one because a groom's file is missing.
    pub fn study(self, share: f64, observer: &mut Observer<'_>) -> Result<Study, BenchError> {
        match self {
            Self::HollowSphere => hollow::study(share, observer),
            Self::Beard => keeping::study(&keeping::BEARD, share, &[], observer),
            Self::Asymmetric => keeping::study(&keeping::ASYMMETRIC, share, &[], observer),
            Self::RollerCoaster => coaster::study(share, &[], observer),
            Self::Grooming => trim::study(observer),
        }
    }
}
