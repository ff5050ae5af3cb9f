//! The run of a training.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use forelock_core::lane::Simd;
use forelock_io::{Lock, atomic_write};
use forelock_neural::model::{Model, ModelInfo, OutputHead};
use forelock_neural::network::Network;
use forelock_neural::network::inference::Predictor;
use forelock_neural::train::{
    DRAPED, MOMENTS, Objective, Options, Resumed, STRANDS as SET_STRANDS, Trainer, TrainingSet,
};
use forelock_neural::trial::{Score, Trial};
use serde::{Deserialize, Serialize};

use super::config::{TrainedMotions, TrainingConfig};
use super::data::{Codes, Hair, Use, motions};
use super::examination::{Coded, KindScore, Trials, trial};
use super::recorded::Recorded;
use super::{TrainingError, page};
use crate::progress::{Observer, Progress};

/// Changes with what a step of a training computes, so that no checkpoint goes on in another way.
const TRAINING_VERSION: u32 = 3;

/// The name under which the steps of the simulator report their progress: a training that is asked
/// to stop ends soon while they run, and can be resumed.
pub const TRAINING: &str = "training";

const MODEL: &str = "model.safetensors";
const CONFIG: &str = "training.toml";
const PAGE: &str = "training.html";
const CHECKPOINT: &str = "checkpoint.safetensors";
const LOCK: &str = ".lock";
/// First line of the configuration that a training writes.
const HEADER: &str = "# Written by forelock: the configuration of a training with every key.\n";
/// Time between two checkpoints.
const CHECKPOINT_EVERY: Duration = Duration::from_secs(15);
/// Steps of which the page shows the mean energy.
pub(super) const SHOWN_STEPS: u32 = 50;
/// Most particles inside the body of a network that is kept, a share.
const MOST_INSIDE: f64 = 1e-3;

/// Where a training writes.
#[derive(Clone, Debug)]
pub struct TrainingOptions {
    /// The output folder, which is made.
    pub out: PathBuf,
    /// Whether to go on from the checkpoint in it.
    pub resume: bool,
}

/// What a training did.
#[derive(Clone, Debug, Serialize)]
pub struct TrainingSummary {
    /// Steps done.
    pub steps: u32,
    /// Steps asked for.
    pub steps_asked: u32,
    /// The step whose network was kept.
    pub best_step: u32,
    /// Strands that were trained.
    pub strands: usize,
    /// Motions that were trained.
    pub motions: usize,
    /// RMS error of the strand codes, cm a coordinate: of trained strands and of others.
    pub code_errors_cm: [f64; 2],
    /// Measures of strands and motions that neither were trained nor chose the step; empty if the
    /// training was interrupted.
    pub scores: Vec<KindScore>,
    /// Bytes of the simulator's part of the model.
    pub simulator_bytes: usize,
    /// Files written.
    pub outputs: Vec<PathBuf>,
}

/// A measurement while training.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(super) struct Measured {
    pub step: u32,
    pub score: Score,
}

/// What a checkpoint keeps beside the trainer.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(super) struct Note {
    digest: String,
    version: String,
    /// Digest of the strands and of recorded motions; empty until they are there.
    hair: String,
    simd: String,
    best: Option<Measured>,
    pub measured: Vec<Measured>,
    /// Mean energies of [`SHOWN_STEPS`] steps, and the sum of those since.
    pub energies: Vec<f64>,
    sum: f64,
}

/// A training that runs.
struct Run<'a> {
    config: &'a TrainingConfig,
    out: &'a Path,
    trainer: Trainer,
    best: Option<Network<f32>>,
    note: Note,
    /// Strands and motions that choose the best network, if one is chosen.
    choice: Option<Trial>,
}

/// Trains what `config` says until it is done or `stop` is set.
///
/// # Errors
/// [`TrainingError`].
pub fn train(
    config: &TrainingConfig,
    options: &TrainingOptions,
    observer: &mut Observer<'_>,
    stop: &AtomicBool,
) -> Result<TrainingSummary, TrainingError> {
    let out = &options.out;
    fs::create_dir_all(out).map_err(|error| TrainingError::Read { path: out.clone(), error })?;
    let _lock = Lock::take(&out.join(LOCK), out)?;
    forelock_io::remove_leftovers(out);
    check_config_file(&out.join(CONFIG))?;
    let mut resumed = resumed(config, options, observer)?;
    let recorded = Recorded::load(&config.motions)?;
    let clips = motions(config, &recorded, Use::Training)?;
    let hair = Hair::load(config, observer)?;
    let digest = format!("{}{:016x}", hair.digest(), recorded.hash());
    if resumed.1.hair.is_empty() {
        resumed.1.hair = digest;
        // The model and the checkpoint of an earlier training are not those of this configuration.
        for name in [MODEL, CHECKPOINT] {
            remove(&out.join(name))?;
        }
    } else if resumed.1.hair != digest {
        let what = "its hair or its recorded motions were others; train without --resume".to_owned();
        return Err(TrainingError::Other { path: out.join(CHECKPOINT), what });
    }
    write(&out.join(CONFIG), format!("{HEADER}{}", config.to_toml()).as_bytes())?;
    let codes = hair.codes(config, observer)?;
    let [trained, of_strands] = codes.errors;
    observer(&Progress::Note(&format!(
        "codes: error {trained:.3} cm a coordinate, {of_strands:.3} of strands that were not trained"
    )));
    let (strands, counts) = hair.strands(Use::Training, &codes.encoder, codes.deviation)?;
    let sizes = [strands.len(), clips.len()];
    let mut set = TrainingSet::new(strands, &counts, clips, hair.field.clone())?;
    if config.method.objective == Objective::Drapes {
        let drapes = DRAPED * MOMENTS * SET_STRANDS;
        observer(&Progress::Note(&format!("computing {drapes} drapes to train on")));
    }
    resumed.0.trainer.prepare(&mut set);
    let own = &config.options().energies;
    let coded = Coded { encoder: &codes.encoder, deviation: codes.deviation };
    let choice = if config.steps.choose_best {
        Some(trial(motions(config, &recorded, Use::Choice)?, own, &hair, coded, Use::Choice, observer)?)
    } else {
        None
    };
    let Resumed { trainer, best } = resumed.0;
    let mut run = Run { config, out, trainer, best, note: resumed.1, choice };
    run.steps(&set, observer, stop)?;
    let mut summary = TrainingSummary {
        steps: run.trainer.done(),
        steps_asked: config.steps.simulator,
        best_step: run.note.best.map_or(run.trainer.done(), |best| best.step),
        strands: sizes[0],
        motions: sizes[1],
        code_errors_cm: codes.errors,
        scores: Vec::new(),
        simulator_bytes: 0,
        outputs: [PAGE, CONFIG, CHECKPOINT].map(|name| out.join(name)).into(),
    };
    if summary.steps < summary.steps_asked {
        return Ok(summary);
    }
    let last = (!config.steps.choose_best).then(|| run.trainer.average());
    let best = run.best.as_ref().or(last).ok_or(TrainingError::NoneKept(100.0 * MOST_INSIDE))?;
    let trials = Trials::new(config, &recorded, own, &hair, coded, observer)?;
    summary.scores = trials.run(&hair, &predictor(&run.trainer, best)?)?;
    let model = model(config, &codes, &run, best, &summary, &hair.names)?;
    summary.simulator_bytes = 4 * (best.parameters().len() + forelock_neural::EDGES.pow(2));
    write(&out.join(MODEL), &model.to_bytes()?)?;
    summary.outputs.insert(0, out.join(MODEL));
    Ok(summary)
}

/// The trainer at its start or, if that is asked for, at its checkpoint.
fn resumed(
    config: &TrainingConfig,
    options: &TrainingOptions,
    observer: &mut Observer<'_>,
) -> Result<(Resumed, Note), TrainingError> {
    let own: Options = config.options();
    let simd = format!("{:?}", Simd::Auto.resolve()).to_lowercase();
    let version = format!("{}, training {TRAINING_VERSION}", env!("CARGO_PKG_VERSION"));
    let begun = Note { digest: config.digest(), version, simd, ..Note::default() };
    let path = options.out.join(CHECKPOINT);
    let start = |note: Note| {
        let trainer = Trainer::new(own);
        (Resumed { trainer, best: None }, note)
    };
    if !options.resume {
        return Ok(start(begun));
    }
    let bytes = match fs::read(&path) {
        Ok(bytes) => bytes,
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            let folder = options.out.display();
            let text = format!("there is nothing to resume in {folder}: the training starts anew");
            observer(&Progress::Note(&text));
            return Ok(start(begun));
        }
        Err(error) => return Err(TrainingError::Read { path, error }),
    };
    let broken = |error| TrainingError::Checkpoint { path: path.clone(), error };
    let note = Trainer::note(&bytes).map_err(broken)?;
    let note: Note = serde_json::from_str(&note).map_err(|_| TrainingError::Other {
        path: path.clone(),
        what: "train without --resume".to_owned(),
    })?;
    let what = if note.version != begun.version {
        "another version of Forelock wrote it; train without --resume".to_owned()
    } else if note.simd != begun.simd {
        "its instruction set is another one; train without --resume".to_owned()
    } else if note.digest != begun.digest {
        let before = TrainingConfig::load(&options.out.join(CONFIG), &[]);
        let keys = before.map(|before| config.keys_that_differ(&before)).unwrap_or_default();
        let what = match keys.as_slice() {
            [] => String::new(),
            [key] => format!("`{key}` had another value; "),
            keys => format!("`{}` had other values; ", keys.join("`, `")),
        };
        format!("{what}give the same configuration and --set options, or train without --resume")
    } else {
        return Ok((Trainer::resume(own, &bytes).map_err(broken)?, note));
    };
    Err(TrainingError::Other { path, what })
}

fn predictor(trainer: &Trainer, network: &Network<f32>) -> Result<Predictor, TrainingError> {
    let shape = *network.shape();
    let predictor = match trainer.options().head {
        OutputHead::Rotation => Predictor::new(network, trainer.basis(), Simd::Auto),
        OutputHead::Displacement => Predictor::displacing(network, Simd::Auto),
    };
    predictor.map_err(|_| {
        TrainingError::Model(forelock_neural::model::ModelError::Shape {
            tensor: "simulator.output".to_owned(),
            found: vec![shape.width, shape.outputs],
            expected: "three numbers an edge".to_owned(),
        })
    })
}

/// Checks that `path` is missing or was written by a training.
fn check_config_file(path: &Path) -> Result<(), TrainingError> {
    match fs::read(path) {
        Ok(bytes) if !bytes.starts_with(HEADER.as_bytes()) => Err(TrainingError::Overwrites(path.into())),
        _ => Ok(()),
    }
}

/// Removes a file, if it is there.
fn remove(path: &Path) -> Result<(), TrainingError> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => {
            Err(TrainingError::Read { path: path.into(), error })
        }
        _ => Ok(()),
    }
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), TrainingError> {
    Ok(atomic_write(path, |file| file.write_all(bytes))?)
}

impl Run<'_> {
    /// The steps that are left, until `stop`.
    fn steps(
        &mut self,
        set: &TrainingSet,
        observer: &mut Observer<'_>,
        stop: &AtomicBool,
    ) -> Result<(), TrainingError> {
        let total = self.config.steps.simulator;
        let done = self.trainer.done();
        observer(&Progress::Begin { what: TRAINING, done: done.into(), total: total.into() });
        let mut kept = Instant::now();
        while self.trainer.done() < total && !stop.load(Ordering::Relaxed) {
            self.note.sum += self.trainer.step(set)?.energy;
            let done = self.trainer.done();
            if done.is_multiple_of(SHOWN_STEPS) {
                self.note.energies.push(self.note.sum / f64::from(SHOWN_STEPS));
                self.note.sum = 0.0;
            }
            if done.is_multiple_of(self.config.steps.measure_every) || done == total {
                self.measure(observer)?;
            }
            if kept.elapsed() > CHECKPOINT_EVERY {
                self.keep()?;
                kept = Instant::now();
            }
            observer(&Progress::Step);
        }
        self.keep()?;
        observer(&Progress::End);
        Ok(())
    }

    /// Compares the network with the reference and keeps it if it is the best.
    fn measure(&mut self, observer: &mut Observer<'_>) -> Result<(), TrainingError> {
        let Some(choice) = &self.choice else { return self.show() };
        let predictor = predictor(&self.trainer, self.trainer.average())?;
        let score = Score::mean(&choice.run(&predictor)?);
        let step = self.trainer.done();
        let measured = Measured { step, score };
        self.note.measured.push(measured);
        let least = self.note.best.map_or(f64::INFINITY, |best| best.score.nrmse_dyn);
        let is_best = score.inside <= MOST_INSIDE && score.nrmse_dyn < least;
        if is_best {
            self.best = Some(self.trainer.average().clone());
            self.note.best = Some(measured);
        }
        observer(&Progress::Note(&format!(
            "step {step}: error {:.3} ({:.3} of the motion), correlation {:.3} ({:.3} of velocities), \
             motion {:.2} of the reference's, {:.3} % inside{}",
            score.nrmse,
            score.nrmse_dyn,
            score.corr,
            score.corr_vel,
            score.motion_ratio,
            100.0 * score.inside,
            if is_best { "" } else { "; not kept" },
        )));
        self.show()
    }

    /// Writes the page.
    fn show(&self) -> Result<(), TrainingError> {
        write(&self.out.join(PAGE), page::html(self.config, &self.note).as_bytes())
    }

    /// Writes a checkpoint.
    fn keep(&self) -> Result<(), TrainingError> {
        let path = self.out.join(CHECKPOINT);
        let note = serde_json::to_string(&self.note).unwrap_or_default();
        let bytes = self
            .trainer
            .checkpoint(self.best.as_ref(), &note)
            .map_err(|error| TrainingError::Checkpoint { path: path.clone(), error })?;
        write(&path, &bytes)
    }
}

/// What motions `config` trains, for the model's file.
fn motions_trained(config: &TrainingConfig) -> Vec<String> {
    let TrainedMotions { count, files, recorded, .. } = &config.motions;
    if files.is_empty() {
        return vec![format!("{count} generated motions")];
    }
    let names = files.iter().map(|path| path.file_name().unwrap_or_default().to_string_lossy().into_owned());
    let first = format!("{count} motions, {recorded} of them pieces of the following files");
    std::iter::once(first).chain(names).collect()
}

/// The model of what was trained.
fn model(
    config: &TrainingConfig,
    codes: &Codes,
    run: &Run<'_>,
    best: &Network<f32>,
    summary: &TrainingSummary,
    grooms: &[String],
) -> Result<Model, TrainingError> {
    let mut info = ModelInfo::new(&config.options().energies, codes.deviation.into());
    info.head = config.method.head;
    info.training.config_digest = config.digest();
    info.training.seed = config.seed;
    info.training.steps = config.steps.simulator;
    info.training.grooms = grooms.to_vec();
    info.training.motions = motions_trained(config);
    info.measures.insert("step".to_owned(), summary.best_step.into());
    for (name, error) in ["code_error_cm", "code_error_held_out_cm"].into_iter().zip(codes.errors) {
        info.measures.insert(name.to_owned(), error);
    }
    for KindScore { groom, score } in &summary.scores {
        for (name, value) in score.numbers() {
            info.measures.insert(format!("{groom}.{name}"), value);
        }
    }
    Ok(Model::new(best.clone(), run.trainer.basis(), codes.encoder.clone(), info)?)
}
