//! What a training draws from, for networks that are trained and measured for comparison.

use forelock_neural::losses::field::SmoothField;
use forelock_neural::model::Model;
use forelock_neural::train::{Clip, TrainingStrand};

use super::TrainingError;
use super::config::TrainingConfig;
use super::data::{Hair, Use, motions};
use super::examination::Coded;
use super::recorded::Recorded;
use crate::progress::Observer;

/// The strands and motions of a training.
#[derive(Debug)]
pub struct Material {
    /// The strands that are trained, of one kind after the other, with the codes of a model.
    pub strands: Vec<TrainingStrand>,
    /// How many are of each kind.
    pub counts: Vec<usize>,
    /// The rigid part of the body.
    pub field: SmoothField,
    /// The motions that are trained.
    pub motions: Vec<Clip>,
    /// The motions that a training reports its measures of.
    pub unseen: Vec<Clip>,
}

impl Material {
    /// The strands and motions of `config`. The codes of strands are those of `coder`.
    ///
    /// # Errors
    /// [`TrainingError`] if the hair cannot be loaded or has no codes.
    pub fn load(
        config: &TrainingConfig,
        coder: &Model,
        observer: &mut Observer<'_>,
    ) -> Result<Self, TrainingError> {
        let hair = Hair::load(config, observer)?;
        let Coded { encoder, deviation } = Coded::by(coder);
        let (strands, counts) = hair.strands(Use::Training, encoder, deviation)?;
        let recorded = Recorded::load(&config.motions)?;
        let [motions, unseen] =
            [Use::Training, Use::Measures].map(|purpose| motions(config, &recorded, purpose));
        Ok(Self { strands, counts, field: hair.field, motions: motions?, unseen: unseen? })
    }
}
