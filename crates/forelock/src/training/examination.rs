//! Measures of a model beside the implicit reference.

use forelock_core::lane::Simd;
use forelock_neural::codes::Encoder;
use forelock_neural::measures::MeasureError;
use forelock_neural::model::Model;
use forelock_neural::network::STATICS;
use forelock_neural::network::inference::Predictor;
use forelock_neural::train::{Clip, Energies};
use forelock_neural::trial::{Score, Trial};
use serde::Serialize;

use super::TrainingError;
use super::config::TrainingConfig;
use super::data::{Hair, Use, motions, recorded_motions};
use super::recorded::Recorded;
use crate::neural::unsupported;
use crate::progress::{Observer, Progress};

/// How good a model is for one kind of hair.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct KindScore {
    /// The groom, with ", recorded" where the motions are those of files.
    pub groom: String,
    /// The measures, beside the implicit reference.
    #[serde(flatten)]
    pub score: Score,
}

/// Measures `model` as [`train`](super::train) does: with hair and motions of `config` that were
/// not trained, if this is the configuration that it was trained with.
///
/// # Errors
/// [`TrainingError`].
pub fn measure(
    config: &TrainingConfig,
    model: &Model,
    observer: &mut Observer<'_>,
) -> Result<Vec<KindScore>, TrainingError> {
    Examination::new(config, &model.info().energies(), model, observer)?.measure(model)
}

/// Strands and motions with the implicit reference of each, to measure several models with.
pub struct Examination {
    hair: Hair,
    trials: Trials,
}

impl Examination {
    /// The strands and motions of `config` that a training with it reports its measures of. The
    /// references lower `energies`; style, repulsion and adhesion have no part in them. The codes
    /// of strands are those of `coder`.
    ///
    /// # Errors
    /// [`TrainingError`] if the hair cannot be loaded or has no codes.
    pub fn new(
        config: &TrainingConfig,
        energies: &Energies,
        coder: &Model,
        observer: &mut Observer<'_>,
    ) -> Result<Self, TrainingError> {
        check(coder)?;
        let hair = Hair::load(config, observer)?;
        let recorded = Recorded::load(&config.motions)?;
        let trials = Trials::new(config, &recorded, energies, &hair, Coded::by(coder), observer)?;
        Ok(Self { hair, trials })
    }

    /// The measures of `model`, one a kind of hair, of generated motions and then of recorded ones.
    ///
    /// # Errors
    /// [`TrainingError`] if a strand has no code, or a prediction is not finite.
    pub fn measure(&self, model: &Model) -> Result<Vec<KindScore>, TrainingError> {
        check(model)?;
        let Coded { encoder, deviation } = Coded::by(model);
        let (strands, _) = self.hair.strands(Use::Measures, encoder, deviation)?;
        let inputs: Vec<f32> = strands.into_iter().flat_map(|strand| strand.statics).collect();
        let predictor = model.predictor(Simd::Auto)?;
        self.trials.scores(&self.hair, &|trial| trial.run_with(&predictor, &inputs))
    }
}

/// Checks that `model` can be measured.
fn check(model: &Model) -> Result<(), TrainingError> {
    let found = model.network().shape().statics;
    let inputs = (found != STATICS).then(|| {
        format!("the model takes {found} inputs a strand, and this version makes {STATICS}: train it again")
    });
    unsupported(model).or(inputs).map_or(Ok(()), |problem| Err(TrainingError::Unsupported(problem)))
}

/// What a result is measured with.
pub(super) struct Trials {
    generated: Trial,
    /// None without files.
    recorded: Option<Trial>,
}

impl Trials {
    pub(super) fn new(
        config: &TrainingConfig,
        recorded: &Recorded,
        energies: &Energies,
        hair: &Hair,
        codes: Coded<'_>,
        observer: &mut Observer<'_>,
    ) -> Result<Self, TrainingError> {
        let generated = motions(config, recorded, Use::Measures)?;
        let recorded = recorded_motions(config, recorded)?;
        let mut new = |clips| trial(clips, energies, hair, codes, Use::Measures, observer);
        Ok(Self {
            generated: new(generated)?,
            recorded: if recorded.is_empty() { None } else { Some(new(recorded)?) },
        })
    }

    /// The measures of `predictor` with the codes that the trials were made with.
    pub(super) fn run(&self, hair: &Hair, predictor: &Predictor) -> Result<Vec<KindScore>, TrainingError> {
        self.scores(hair, &|trial| trial.run(predictor))
    }

    fn scores(
        &self,
        hair: &Hair,
        run: &dyn Fn(&Trial) -> Result<Vec<Score>, MeasureError>,
    ) -> Result<Vec<KindScore>, TrainingError> {
        let mut scores = hair.named(run(&self.generated)?, "");
        if let Some(recorded) = &self.recorded {
            scores.extend(hair.named(run(recorded)?, ", recorded"));
        }
        Ok(scores)
    }
}

/// An encoder, and the deviation of its codes.
#[derive(Clone, Copy)]
pub(super) struct Coded<'a> {
    pub encoder: &'a Encoder,
    pub deviation: f32,
}

impl<'a> Coded<'a> {
    /// The codes of `model`.
    pub(super) fn by(model: &'a Model) -> Self {
        Self { encoder: model.encoder(), deviation: model.info().code_deviation as f32 }
    }
}

/// Strands for a use in `clips`, which are not trained, with their references.
pub(super) fn trial(
    clips: Vec<Clip>,
    energies: &Energies,
    hair: &Hair,
    codes: Coded<'_>,
    purpose: Use,
    observer: &mut Observer<'_>,
) -> Result<Trial, TrainingError> {
    let (strands, counts) = hair.strands(purpose, codes.encoder, codes.deviation)?;
    observer(&Progress::Begin { what: "references", done: 0, total: clips.len() as u64 });
    let mut step = || observer(&Progress::Step);
    let trial = Trial::new(&energies.terms(), hair.field.clone(), &strands, &counts, clips, &mut step);
    observer(&Progress::End);
    Ok(trial)
}
