//! The file of a training.

use std::collections::{BTreeMap, HashSet};
use std::path::{Path, PathBuf};

use forelock_core::lane::Simd;
use forelock_core::params::Short;
use forelock_neural::codes::encoder::CodeOptions;
use forelock_neural::losses::adhesion::AdhesionTerms;
use forelock_neural::losses::body::BodyTerms;
use forelock_neural::losses::elastic::{ElasticTerms, Transport};
use forelock_neural::losses::motion::MotionTerms;
use forelock_neural::losses::repulsion::RepulsionTerms;
use forelock_neural::losses::style::StyleTerms;
use forelock_neural::model::{ModelKind, OutputHead};
use forelock_neural::train::{Energies, MOMENTS, Objective, Options};
use serde::{Deserialize, Serialize};

use crate::hash::Fnv;
use crate::scene::document::{Document, Layer};
use crate::scene::reference::{self, Section, with};
use crate::scene::{Override, SceneError};

forelock_core::documented! {
/// A training: what hair, what motions, which energies, how many steps. Every key has a default.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrainingConfig {
    /// What the defaults of the other keys are: "default", or "paper" for those of the paper where
    /// they differ, which move little: displacements, direct transport, the energy of a step with
    /// repulsion and printed adhesion but without drag, tail and extra margin, no steps for the
    /// drape, and a lower learning rate.
    /// Default "default".
    pub preset: TrainingPreset,
    /// Seed of everything random. No unit, default 1, range 0 or more; 0 is a seed like any other.
    pub seed: u64,
    /// How the network predicts, and what it is trained towards.
    pub method: TrainedMethod,
    /// The hair that is trained.
    pub hair: TrainedHair,
    /// The motions of the body.
    pub motions: TrainedMotions,
    /// What the network lowers, in cm, g and s.
    pub energies: TrainedEnergies,
    /// Steps and rates.
    pub steps: TrainingSteps,
}
}

/// Where the defaults of a training come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TrainingPreset {
    /// Ours.
    #[default]
    Default,
    /// The paper's.
    Paper,
}

impl TrainingPreset {
    /// The defaults that differ from ours, as TOML.
    fn keys(self) -> &'static str {
        match self {
            Self::Default => "",
            Self::Paper => {
                "method = { head = \"displacement\", objective = \"step\", transport = \"direct\" }\n\
                 energies = { drag = 0, extra_margin = 0, tail = 100, repulsion = 5, adhesion = 2, \
                 adhesion_printed = true }\n\
                 steps = { rate = 5e-4, drape = 0 }\n"
            }
        }
    }
}

forelock_core::documented! {
/// `[method]`: how the network predicts, and what it is trained towards.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrainedMethod {
    /// "dynamic", which follows the history of poses, or "quasi-static", which hangs at rest in
    /// each pose. Default "dynamic".
    pub kind: ModelKind,
    /// What the network's outputs are: "rotation" of edges, which cannot stretch, or
    /// "displacement" of particles (the paper's). Default "rotation".
    pub head: OutputHead,
    /// What motions are trained towards: the least "residual" of the equation of motion, or the
    /// least energy of a "step" from the network's own frames before (the paper's). "drapes" is for
    /// comparison, and for kind "quasi-static" alone: the least squared error beside 65,536
    /// computed drapes, as in GroomGen. Default "residual".
    pub objective: Objective,
    /// How frames are carried along strands: "sequential", "direct" (the paper's) or "chord".
    /// Default "sequential".
    pub transport: Transport,
    /// Whether the network knows the mean code of the lock that a strand is in. Default true.
    pub lock_codes: bool,
}
}

forelock_core::documented! {
/// `[hair]`: the strands.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrainedHair {
    /// A scene file whose body and groom keys are used; its motion, wind and solver are not.
    /// Default "", the built-in head.
    pub scene: PathBuf,
    /// Presets of growth and files of grooms, one kind of hair each. Default straight, wavy, curly
    /// and bob.
    pub grooms: Vec<String>,
    /// Shares of their length to which the strands of each groom are cut, each one kind of hair. No
    /// unit, default [1, 0.5], range 0.05 to 1 each.
    pub lengths: Vec<f64>,
    /// Strands that are grown of each preset. Unit strands, default 4096, range 64 to 200000.
    pub grown: u32,
    /// Strands of each groom that choose the best step, and as many that the result is measured
    /// with; neither are trained. Unit strands, default 8, range 1 to 1000.
    pub held_out: u32,
}
}

forelock_core::documented! {
/// `[motions]`: motions of root, spine, neck and head, generated and recorded.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrainedMotions {
    /// Motions that are trained. Generated ones are sines, turns and holds, half of them with the
    /// body as one piece, half of a body that travels. Unit motions, default 2048, range 1 to
    /// 100000.
    pub count: u32,
    /// Length of a motion. Unit s, default 5, range 1 to 600.
    pub secs: f64,
    /// Generated motions that choose the best step, and as many that the result is measured with;
    /// neither are trained. Unit motions, default 6, range 1 to 1000.
    pub held_out: u32,
    /// Files of recorded motions, .bvh. Three quarters of each are trained, in pieces, mirrored or
    /// not, 0.7 to 1.4 times as fast; of the last quarter at most `held_out` pieces are measured.
    /// Default none.
    pub files: Vec<PathBuf>,
    /// Share of the trained motions that are pieces of the files, if there are any. No unit,
    /// default 0.5, range 0 to 1.
    pub recorded: f64,
    /// The files' names of root, spine, neck and head; of several with | between them the first
    /// that a file has. Default "Hips", "Spine1|Chest2|Chest", "Neck1|Neck" and "Head", as in
    /// files of the CMU.
    pub joints: [String; 4],
    /// Length of a unit of the files. Unit m, default 0, range 0 to 1000; 0 finds it: the head is
    /// 1.5 m above the lowest joint of the first frame.
    pub unit: f64,
}
}

forelock_core::documented! {
/// `[energies]`: what the network lowers, in cm, g and s.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrainedEnergies {
    /// Stiffness of bending and twist. Unit g cm³/s², default 100, range 0.001 to 1e6.
    pub bend_twist: f64,
    /// Mass of a particle. Unit g, default 1e-4, range 1e-7 to 1.
    pub mass: f64,
    /// Gravity, [x, y, z]; scenes that the model moves have the same. Unit cm/s², default
    /// [0, -981, 0], range -100000 to 100000 each.
    pub gravity: [f64; 3],
    /// Rate at which velocities decay. Unit 1/s, default 4, range 0 to 100.
    pub drag: f64,
    /// Stiffness of the body. Unit g/(cm s²), default 100, range 0 to 1e6.
    pub body: f64,
    /// Distance at which the body begins to push. Unit cm, default 0.5, range 0 to 10.
    pub margin: f64,
    /// Added to `margin` in training alone, so that the network's errors leave less hair inside the
    /// body; "drapes" are computed without it. Unit cm, default 0.02, range 0 to 10.
    pub extra_margin: f64,
    /// Depth at which its push stops growing. Unit cm, default 1.5, range 0.01 to 100.
    pub tail: f64,
    /// Stiffness that keeps hair near the body in its rest shape. Unit g/s², default 0, range 0 to
    /// 1e6; 0 leaves it out.
    pub style: f64,
    /// Distance from the body at which style ends. Unit cm, default 4, range 0.1 to 1000.
    pub style_range: f64,
    /// Stiffness of hair that is denser than at rest, between neighbouring strands. Unit g cm¹¹/s²,
    /// default 0, range 0 to 1e6; 0 leaves it out, the paper has 5.
    pub repulsion: f64,
    /// Half the distance at which particles count for the density. Unit cm, default 0.6, range 0.01
    /// to 10.
    pub smoothing: f64,
    /// Stiffness that keeps neighbouring particles of other strands together. Unit g/s², default 0,
    /// range 0 to 1e6; 0 leaves it out, the paper has 2.
    pub adhesion: f64,
    /// Distance at rest up to which particles are neighbours. Unit cm, default 0.25, range 0.001 to
    /// 10.
    pub adhesion_range: f64,
    /// Whether adhesion pulls neighbours together as in the paper, instead of keeping them at their
    /// distances at rest. Default false.
    pub adhesion_printed: bool,
}
}

forelock_core::documented! {
/// `[steps]`: steps and rates.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrainingSteps {
    /// Steps of the strand codes. Unit steps, default 4000, range 1 to 1000000.
    pub codes: u32,
    /// Steps of the simulator. Unit steps, default 21000, range 1 to 10000000.
    pub simulator: u32,
    /// Learning rate at the start, after a rise over at most 300 steps. No unit, default 0.002,
    /// range 1e-7 to 1.
    pub rate: f64,
    /// Learning rate in the end, as a share of that. No unit, default 0.02, range 0 to 1.
    pub last_rate: f64,
    /// Share of the steps that train the drape, without inertia and drag. No unit, default 0.03,
    /// range 0 to 1.
    pub drape: f64,
    /// Steps between two measurements on strands and motions that are not trained. Unit steps,
    /// default 1000, range 1 to 1000000.
    pub measure_every: u32,
    /// Whether the network of the best of those measurements is the result, rather than the last
    /// one, for which nothing is measured until the end. Default true.
    pub choose_best: bool,
}
}

impl Default for TrainingConfig {
    fn default() -> Self {
        Self {
            preset: TrainingPreset::default(),
            seed: 1,
            method: TrainedMethod::default(),
            hair: TrainedHair::default(),
            motions: TrainedMotions::default(),
            energies: TrainedEnergies::default(),
            steps: TrainingSteps::default(),
        }
    }
}

impl Default for TrainedMethod {
    fn default() -> Self {
        Self {
            kind: ModelKind::default(),
            head: OutputHead::default(),
            objective: Objective::default(),
            transport: Transport::default(),
            lock_codes: true,
        }
    }
}

impl Default for TrainedHair {
    fn default() -> Self {
        let grooms = ["straight", "wavy", "curly", "bob"].map(String::from).into();
        Self { scene: PathBuf::new(), grooms, lengths: vec![1.0, 0.5], grown: 4096, held_out: 8 }
    }
}

impl Default for TrainedMotions {
    fn default() -> Self {
        Self {
            count: 2048,
            secs: 5.0,
            held_out: 6,
            files: Vec::new(),
            recorded: 0.5,
            joints: ["Hips", "Spine1|Chest2|Chest", "Neck1|Neck", "Head"].map(str::to_owned),
            unit: 0.0,
        }
    }
}

impl Default for TrainedEnergies {
    fn default() -> Self {
        let (elastic, motion) = (ElasticTerms::default(), MotionTerms::default());
        let (body, style) = (BodyTerms::default(), StyleTerms::default());
        let (repulsion, adhesion) = (RepulsionTerms::default(), AdhesionTerms::default());
        Self {
            bend_twist: elastic.bend_twist,
            mass: motion.mass,
            gravity: motion.gravity.to_array(),
            drag: motion.drag,
            body: body.stiffness,
            margin: body.margin,
            extra_margin: Options::default().extra_margin,
            tail: body.tail,
            style: 0.0,
            style_range: style.range,
            repulsion: 0.0,
            smoothing: repulsion.smoothing,
            adhesion: 0.0,
            adhesion_range: adhesion.range,
            adhesion_printed: false,
        }
    }
}

impl Default for TrainingSteps {
    fn default() -> Self {
        let Options { steps, rate, last_rate, warm_start, .. } = Options::default();
        Self {
            codes: 4000,
            simulator: steps,
            rate,
            last_rate,
            drape: warm_start,
            measure_every: 1000,
            choose_best: true,
        }
    }
}

impl TrainingConfig {
    /// Reads the file at `path` with `overrides` laid over it.
    ///
    /// # Errors
    /// [`SceneError`] if the file cannot be read, is not TOML, holds an unknown key or a value that
    /// is wrong.
    pub fn load(path: &Path, overrides: &[Override]) -> Result<Self, SceneError> {
        let text = std::fs::read_to_string(path)
            .map_err(|error| SceneError::Read { path: path.to_path_buf(), error })?;
        Self::parse(&text, path, overrides)
    }

    /// The training of the built-in head's hair, with `overrides` laid over it.
    ///
    /// # Errors
    /// [`SceneError`] if an override holds an unknown key or a value that is wrong.
    pub fn builtin(overrides: &[Override]) -> Result<Self, SceneError> {
        Self::parse("", Path::new("the built-in training"), overrides)
    }

    /// Reads a configuration from `text`. `path` names the text in messages, and paths inside it
    /// are taken relative to the folder that holds `path`.
    ///
    /// # Errors
    /// The same errors as [`TrainingConfig::load`], except that nothing is read from disk.
    pub fn parse(text: &str, path: &Path, overrides: &[Override]) -> Result<Self, SceneError> {
        let layers = Layer::stack(text.len(), overrides)?;
        let document = Document::parse(text, path, &layers, "")?;
        let mut config: Self = document.deserialize()?;
        let defaults = document.below(config.preset.keys());
        if config.preset != TrainingPreset::default() {
            config = Document::parse(text, path, &layers, &defaults)?.deserialize()?;
        }
        // Absolute, so that the text that a training writes means the same wherever it is kept.
        let folder = path.parent().unwrap_or(Path::new(""));
        let place = |own: &Path| std::path::absolute(folder.join(own)).unwrap_or_else(|_| folder.join(own));
        if !config.hair.scene.as_os_str().is_empty() {
            config.hair.scene = place(&config.hair.scene);
        }
        for groom in config.hair.grooms.iter_mut().filter(|groom| !is_preset(groom)) {
            *groom = place(groom.as_ref()).to_string_lossy().into_owned();
        }
        config.motions.files.iter_mut().for_each(|file| *file = place(file));
        config.check().map_err(|(key, message)| document.refuse(&key, message))?;
        Ok(config)
    }

    /// The key of the first wrong value, and what is wrong.
    fn check(&self) -> Result<(), (String, String)> {
        let all = toml::Table::try_from(self).unwrap_or_default();
        for section in sections() {
            let own = all.get(section.table).and_then(toml::Value::as_table);
            let values = if section.table.is_empty() { Some(&all) } else { own };
            values.map_or(Ok(()), |values| check_table(&section, values))?;
        }
        if self.hair.grooms.is_empty() {
            return Err(("hair.grooms".to_owned(), "is empty: name at least one preset or file".to_owned()));
        }
        if self.hair.lengths.is_empty() || !self.hair.lengths.iter().all(|x| (0.05..=1.0).contains(x)) {
            let message = "should be shares of the length from 0.05 to 1, one at least".to_owned();
            return Err(("hair.lengths".to_owned(), message));
        }
        let names: HashSet<_> = self.hair.grooms.iter().map(|groom| Path::new(groom).file_stem()).collect();
        let lengths: HashSet<_> = self.hair.lengths.iter().map(|share| share.to_bits()).collect();
        if names.len() < self.hair.grooms.len() || lengths.len() < self.hair.lengths.len() {
            let key = if names.len() < self.hair.grooms.len() { "hair.grooms" } else { "hair.lengths" };
            return Err((
                key.to_owned(),
                "names something twice: each is a kind of hair of its own".to_owned(),
            ));
        }
        if self.method.objective == Objective::Drapes && self.method.kind == ModelKind::Dynamic {
            let message = "is \"drapes\", which do not move: set method.kind = \"quasi-static\"".to_owned();
            return Err(("method.objective".to_owned(), message));
        }
        let secs = f64::from(self.motions.count) * self.motions.secs;
        if secs > MOST_SECS {
            let message = format!(
                "is {}: with motions.secs that is more than {MOST_SECS} s in all",
                self.motions.count
            );
            return Err(("motions.count".to_owned(), message));
        }
        Ok(())
    }

    /// Frames of a motion.
    pub(super) fn frames(&self) -> usize {
        ((self.motions.secs * 30.0).round() as usize).max(MOMENTS)
    }

    /// How the codes are trained.
    pub(super) fn code_options(&self) -> CodeOptions {
        CodeOptions { seed: self.seed, steps: self.steps.codes, ..CodeOptions::default() }
    }

    /// How the simulator is trained.
    pub fn options(&self) -> Options {
        let own = &self.energies;
        let energies = Energies {
            elastic: ElasticTerms {
                bend_twist: own.bend_twist,
                transport: self.method.transport,
                ..ElasticTerms::default()
            },
            motion: MotionTerms {
                mass: own.mass,
                gravity: own.gravity.into(),
                drag: own.drag,
                is_dynamic: self.method.kind == ModelKind::Dynamic,
                ..MotionTerms::default()
            },
            body: BodyTerms { stiffness: own.body, margin: own.margin, tail: own.tail },
            style: (own.style > 0.0).then_some(StyleTerms { stiffness: own.style, range: own.style_range }),
            repulsion: (own.repulsion > 0.0)
                .then_some(RepulsionTerms { stiffness: own.repulsion, smoothing: own.smoothing }),
            adhesion: (own.adhesion > 0.0)
                .then_some(AdhesionTerms { stiffness: own.adhesion, range: own.adhesion_range }),
            prints_adhesion: own.adhesion_printed,
        };
        Options {
            seed: self.seed,
            steps: self.steps.simulator,
            rate: self.steps.rate,
            last_rate: self.steps.last_rate,
            warm_start: self.steps.drape,
            energies,
            extra_margin: own.extra_margin,
            objective: self.method.objective,
            head: self.method.head,
            lock_codes: self.method.lock_codes,
            simd: Simd::Auto,
            ..Options::default()
        }
    }

    /// The training as a TOML document with every key written out.
    pub fn to_toml(&self) -> String {
        toml::to_string(self).unwrap_or_else(|error| format!("# this cannot be written as TOML: {error}\n"))
    }

    /// A hash of all keys, 16 hexadecimal digits; where files lie is no part of it.
    pub fn digest(&self) -> String {
        format!("{:016x}", Fnv::new().bytes(self.without_folders().to_toml().as_bytes()).value())
    }

    /// The configuration with names in place of the paths of its files.
    fn without_folders(&self) -> Self {
        let mut own = self.clone();
        let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        own.hair.scene = name(&own.hair.scene).into();
        own.hair.grooms.iter_mut().for_each(|groom| *groom = name(groom.as_ref()));
        own.motions.files.iter_mut().for_each(|file| *file = name(file).into());
        own
    }

    /// The keys, as `section.key`, whose values differ from those of `other`; where files lie is no
    /// part of them.
    pub(super) fn keys_that_differ(&self, other: &Self) -> Vec<String> {
        let keys = |config: &Self| -> BTreeMap<String, toml::Value> {
            let table: toml::Table = config.without_folders().to_toml().parse().unwrap_or_default();
            let sections = table.into_iter().flat_map(|(name, value)| match value {
                toml::Value::Table(keys) => {
                    keys.into_iter().map(|(key, value)| (format!("{name}.{key}"), value)).collect()
                }
                value => vec![(name, value)],
            });
            sections.collect()
        };
        let before = keys(other);
        let differs = |(key, value): &(String, toml::Value)| before.get(key) != Some(value);
        keys(self).into_iter().filter(differs).map(|(key, _)| key).collect()
    }
}

/// Most seconds of all motions together: their frames take a gigabyte then.
const MOST_SECS: f64 = 1e5;

const REFERENCE: &str = "# Training reference\n\n\
    Every key of the file that `forelock train` takes, with its unit, default and range. Unknown keys\n\
    and values out of range are refused with the line. [Training](training.md) explains how to use\n\
    them. Every training writes its file with all keys spelt out, as `training.toml`.\n\n\
    The program writes this page: `forelock help training --markdown`.\n";

fn sections() -> [Section; 6] {
    [
        with::<TrainingConfig>("", "## Top level", ""),
        with::<TrainedMethod>("method", "## `[method]`: how the network predicts", ""),
        with::<TrainedHair>("hair", "## `[hair]`: the strands", ""),
        with::<TrainedMotions>("motions", "## `[motions]`: motions of the body", ""),
        with::<TrainedEnergies>("energies", "## `[energies]`: what the network lowers", ""),
        with::<TrainingSteps>("steps", "## `[steps]`: steps and rates", ""),
    ]
}

/// Every key of a training's file as a page in Markdown.
pub fn markdown() -> String {
    reference::tables(REFERENCE, &sections())
}

/// Every key of a training's file for a terminal.
pub fn help() -> String {
    reference::listed(sections().iter())
}

/// Whether `groom` is the name of a preset of growth.
pub(super) fn is_preset(groom: &str) -> bool {
    forelock_core::groom::grow::PRESETS.contains(&groom)
}

/// The first key of `section` whose number is out of its range, and what is wrong.
fn check_table(section: &Section, values: &toml::Table) -> Result<(), (String, String)> {
    for entry in &section.entries {
        let name = entry.key.rsplit('.').next().unwrap_or_default();
        let Some((range, value)) = entry.range.zip(values.get(name)) else { continue };
        let list = value.as_array().map_or(std::slice::from_ref(value), Vec::as_slice);
        let number =
            |value: &toml::Value| value.as_float().or(value.as_integer().map(|number| number as f64));
        if let Some(wrong) = list.iter().filter_map(number).find(|number| !range.contains(*number)) {
            return Err((entry.key.clone(), format!("should be {range}, not {}", Short(wrong))));
        }
    }
    Ok(())
}
