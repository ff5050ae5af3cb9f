//! The learned simulator's paper (Neuralocks, 2025): its Table 1, the times in its text, its
//! figures, and ablations.
//!
//! # Practice
//! [`neural_tables`] times the network beside XPBD with collisions and contacts. [`NeuralFigure`]
//! reruns what the paper shows as pictures, measured. Figures that compare trainings train: each
//! variant for a fixed number of steps from the same seed, on the same hair and motions, and is
//! measured beside one implicit reference (`ablations.rs`). Trained models are kept in a folder and
//! used again by later runs with the same configuration.
//!
//! # Limitations
//! The paper's grooms, body, motions and code are not public. Ours are the presets of growth on the
//! built-in head and generated motions. Times are ours on this machine, and the paper's as printed.

mod ablations;
mod comparators;
mod drapes;
mod map;
mod models;
mod rigged;
mod speed;
mod strips;

pub use speed::neural_tables;

use std::path::PathBuf;

use super::study::Study;
use super::table1::Table1Options;
use crate::BenchError;
use forelock::Observer;

/// What to run, and where models are kept.
#[derive(Clone, Debug, PartialEq)]
pub struct NeuralOptions {
    /// Share of the strands that is grown; frames of the tables; whether the learned simulator runs
    /// on a GPU in them.
    pub scenes: Table1Options,
    /// Steps of each training.
    pub steps: u32,
    /// Folder of the trained models.
    pub models: PathBuf,
}

/// A figure of the paper.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NeuralFigure {
    /// Fig. 1: one model moves several styles.
    Styles,
    /// Fig. 3: the energy of the style.
    Style,
    /// Fig. 4: rising adhesion.
    Adhesion,
    /// Fig. 5: beside a network that is trained on drapes, as GroomGen's is.
    Supervised,
    /// Fig. 6: codes of locks.
    Locks,
    /// Fig. 7: transports of the frame along a strand.
    Transport,
    /// Fig. 8: the rigged variant.
    Rigged,
    /// Fig. 9: beside XPBD.
    Xpbd,
    /// Fig. 10: trained on few strands, run on many.
    Generalisation,
    /// Fig. 11: stiffness, beside an older energy.
    Stiffness,
    /// Fig. 12: beside a network for a whole groom, as Quaffure's is.
    Map,
    /// Fig. 13: grooms that were not trained.
    Unseen,
    /// Each energy, head, transport, history and lock code left out.
    Ablations,
}

impl NeuralFigure {
    /// Reruns it.
    ///
    /// # Errors
    /// [`BenchError`] if a training or a scene fails.
    pub fn study(self, options: &NeuralOptions, observer: &mut Observer<'_>) -> Result<Study, BenchError> {
        match self {
            Self::Styles => strips::styles(options, observer),
            Self::Style => ablations::style(options, observer),
            Self::Adhesion => ablations::adhesion(options, observer),
            Self::Supervised => comparators::supervised(options, observer),
            Self::Locks => ablations::locks(options, observer),
            Self::Transport => drapes::transport(options, observer),
            Self::Rigged => rigged::study(observer),
            Self::Xpbd => strips::beside_xpbd(options, observer),
            Self::Generalisation => strips::generalisation(options, observer),
            Self::Stiffness => drapes::stiffness(options, observer),
            Self::Map => map::study(options, observer),
            Self::Unseen => strips::unseen(options, observer),
            Self::Ablations => ablations::all(options, observer),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use models::{Variant, config};

    fn options(models: &std::path::Path) -> NeuralOptions {
        let scenes = Table1Options { warm_up: 0, frames: 2, share: 0.01, on_gpu: false };
        NeuralOptions { scenes, steps: 3, models: models.to_owned() }
    }

    #[test]
    fn the_tables_have_every_size_beside_the_printed_times() {
        let study = neural_tables(&options(std::path::Path::new("")), &mut |_| {}).unwrap();
        let [first, second] = &*study.tables else { panic!() };
        assert_eq!(first.rows.len(), 5);
        assert_eq!(first.rows[4][1..3], ["1,200", "–, 6.872"]);
        for row in &first.rows {
            assert!(row[3].parse::<f64>().unwrap() > 0.0, "{row:?}");
        }
        assert_eq!(second.rows[4][2], "1.106 MB");
        assert_eq!(second.rows.len(), 8);
        assert_eq!(second.rows[7], ["Quaffure-like: size", "692 MB", "3.391 MB"]);
    }

    /// A model is trained once, and again where its configuration has changed.
    #[test]
    fn models_are_kept_for_the_same_configuration() {
        let folder = tempfile::tempdir().unwrap();
        let options = options(folder.path());
        let quick = ["hair.grooms=[\"bob\"]", "motions.count=2", "motions.held_out=1", "motions.secs=1"];
        let keys: &'static [&'static str] = Vec::leak([&quick[..], &["steps.codes=5"]].concat());
        let variant = Variant { name: "quick", label: "quick", keys };
        let train = |options: &NeuralOptions| {
            let mut begun = 0;
            let trained = variant.train(options, &mut |progress| {
                begun += u32::from(matches!(progress, forelock::Progress::Begin { .. }));
            });
            (trained.unwrap().model, begun)
        };
        let (first, begun) = train(&options);
        assert!(begun > 0);
        assert_eq!(first.info().training.config_digest, config(&options, keys).unwrap().digest());
        let (again, begun) = train(&options);
        assert!(begun == 0 && again == first);
        let (longer, begun) = train(&NeuralOptions { steps: 4, ..options });
        assert!(begun > 0 && longer != first);
    }

    #[test]
    fn figures_without_training_have_rows_and_pictures() {
        let options = options(std::path::Path::new(""));
        for (figure, rows) in [
            (NeuralFigure::Styles, 4),
            (NeuralFigure::Transport, 9),
            (NeuralFigure::Stiffness, 6),
            (NeuralFigure::Generalisation, 2),
        ] {
            let study = figure.study(&options, &mut |_| {}).unwrap();
            assert_eq!(study.tables[0].rows.len(), rows, "{figure:?}");
            assert_eq!(study.strips.len(), 1, "{figure:?}");
        }
    }
}
