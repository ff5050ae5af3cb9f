//! Models for the figures: the built-in one, and variants that are trained where they are needed.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use forelock::scene::Override;
use forelock::training::{Examination, KindScore, TrainingConfig, TrainingOptions, train};
use forelock::{Assets, Observer, Scene};
use forelock_neural::model::Model;
use forelock_neural::trial::Score;

use super::NeuralOptions;
use crate::BenchError;
use crate::paper::study::{Table, percent};

/// Strands that are grown of each kind of hair in a training.
const GROWN: f64 = 1024.0;
/// Fewest of them that a training takes.
const FEWEST: f64 = 64.0;

/// A training that differs from the others in some keys.
#[derive(Clone, Copy, Debug)]
pub(super) struct Variant {
    /// The folder of its model.
    pub name: &'static str,
    /// What it is, in a table.
    pub label: &'static str,
    /// Keys over [`config`].
    pub keys: &'static [&'static str],
}

/// A variant that was trained.
pub(super) struct Trained {
    pub label: &'static str,
    pub path: PathBuf,
    pub model: Model,
}

fn overrides(keys: &[String]) -> Result<Vec<Override>, BenchError> {
    Ok(keys.iter().map(|key| Override::set(key)).collect::<Result<_, _>>()?)
}

/// The configuration that all variants share, with `keys` over it.
pub(super) fn config(options: &NeuralOptions, keys: &[&str]) -> Result<TrainingConfig, BenchError> {
    let grown = (GROWN * options.scenes.share).round().max(FEWEST);
    let mut all = vec![
        "hair.grooms=[\"straight\", \"wavy\", \"curly\"]".to_owned(),
        "hair.lengths=[1.0]".to_owned(),
        format!("hair.grown={grown}"),
        "hair.held_out=4".to_owned(),
        "motions.count=1024".to_owned(),
        "motions.held_out=4".to_owned(),
        "steps.codes=2000".to_owned(),
        format!("steps.simulator={}", options.steps),
        "steps.choose_best=false".to_owned(),
    ];
    all.extend(keys.iter().map(|key| (*key).to_owned()));
    Ok(TrainingConfig::builtin(&overrides(&all)?)?)
}

impl Variant {
    /// Trains it, or reads its model if an earlier run has trained the same.
    pub fn train(&self, options: &NeuralOptions, observer: &mut Observer<'_>) -> Result<Trained, BenchError> {
        let config = config(options, self.keys)?;
        let out = options.models.join(self.name);
        let path = out.join("model.safetensors");
        let is_same = |model: &Model| model.info().training.config_digest == config.digest();
        let model = match Model::read(&path).ok().filter(is_same) {
            Some(model) => model,
            None => {
                observer(&forelock::Progress::Note(&format!("variant: {}", self.label)));
                let resume = out.join("checkpoint.safetensors").exists();
                let training = TrainingOptions { out, resume };
                // The checkpoint of another configuration is not gone on from.
                let never = AtomicBool::new(false);
                if train(&config, &training, observer, &never).is_err() {
                    train(&config, &TrainingOptions { resume: false, ..training }, observer, &never)?;
                }
                Model::read(&path)?
            }
        };
        Ok(Trained { label: self.label, path, model })
    }
}

/// A table of measures beside the implicit reference, with `first` as its first column.
pub(super) fn score_table(title: &str, first: &str) -> Table {
    Table::new(
        title,
        &[first, "corr", "corr_vel", "nrmse", "nrmse_dyn", "motion", "over 1 mm inside", "edges off by"],
    )
}

/// A row of it.
pub(super) fn score_row(label: &str, score: &Score) -> Vec<String> {
    let three = |x: f64| format!("{x:.3}");
    vec![
        label.to_owned(),
        three(score.corr),
        three(score.corr_vel),
        three(score.nrmse),
        three(score.nrmse_dyn),
        three(score.motion_ratio),
        format!("{:.3} %", 100.0 * score.inside),
        if score.stretch < 1e-4 { format!("{:.0e}", score.stretch) } else { percent(score.stretch) },
    ]
}

/// What the columns of a [`score_table`] mean.
pub(super) const SCORES: &str = "Strands and motions that were not trained, beside the implicit \
    reference: corr and corr_vel are correlations of positions and velocities, nrmse and nrmse_dyn \
    errors over the size of the displacement and of its motion, motion the length of the way over \
    the reference's; edges off by at most so much.";

/// The mean score of `model` over all kinds of hair.
pub(super) fn mean_score(examination: &Examination, model: &Model) -> Result<Score, BenchError> {
    let scores: Vec<Score> =
        examination.measure(model)?.into_iter().map(|KindScore { score, .. }| score).collect();
    Ok(Score::mean(&scores))
}

/// The demo's scene of `strands` strands of `preset` without wind, with `keys` over it, and its
/// assets.
pub(super) fn demo(
    preset: &str,
    strands: f64,
    keys: &[String],
    observer: &mut Observer<'_>,
) -> Result<(Scene, Arc<Assets>), BenchError> {
    let mut all = vec![
        format!("groom.preset={preset}"),
        format!("groom.strands={}", strands.round().max(1.0)),
        "groom.vertices_per_strand=25".to_owned(),
        "wind.velocity=[0, 0, 0]".to_owned(),
        "interaction.kind=none".to_owned(),
        "interaction.contacts=false".to_owned(),
        "time.frames=150".to_owned(),
    ];
    all.extend_from_slice(keys);
    let scene = Scene::builtin(&overrides(&all)?)?;
    let assets = Arc::new(Assets::load(&scene, observer)?);
    Ok((scene, assets))
}

/// Keys that run `model`.
pub(super) fn runs(model: &Path) -> Vec<String> {
    let path = std::path::absolute(model).unwrap_or_else(|_| model.to_owned());
    vec!["solver.kind=neural".to_owned(), format!("solver.neural.model={}", path.display())]
}

/// Keys that run the built-in model.
pub(super) fn runs_builtin() -> Vec<String> {
    vec!["solver.kind=neural".to_owned()]
}

/// Keys that run XPBD with collisions among strands.
pub(super) fn xpbd_with_contacts() -> Vec<String> {
    ["solver.kind=xpbd", "interaction.kind=grid", "interaction.contacts=true"].map(String::from).into()
}
