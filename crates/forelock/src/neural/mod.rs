//! `solver.kind = "neural"`: a trained model moves the strands of a head.
//!
//! # Theory
//! The network predicts each strand in canonical space from its code and the head's pose history
//! (Neuralocks, 2025). It has no state but that history, so a frame is: note the head's pose, ask
//! the network, take the strands to the world with the head. The strands are simulated by the
//! solver that goes where it is told, which gives them velocities, snapshots, edits and, if asked
//! for, collisions.
//!
//! # Practice
//! Canonical space is the groom's, from `solver.neural.origin` and the origin in the model, in cm.
//! The model's four joints all move with the head. Codes, locks and the rest shape are prepared
//! once a groom, and again after an edit. On a body that bends strands move with the joint that
//! carries the hair, and their roots with the skin. Before the first frame strands hang as the
//! network predicts for a head that has always been there. On a GPU the network runs in the frame's
//! own submission, after the first layer's sums of the frame, which the CPU computes.
//!
//! # Limitations
//! No interaction between strands, no wind. Gravity is that of the training. Skin that moves
//! relative to the head's joint, as of a jaw, stretches the first edges of its hair.

mod error;
mod host;
mod past;
mod scalp;
mod simulator;

pub use error::NeuralError;
pub(crate) use host::OnGpu;
pub(crate) use simulator::NeuralSimulator;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use forelock_core::air::WindParams;
use forelock_core::groom::Groom;
use forelock_core::interaction::Interactions;
use forelock_core::lane::Simd;
use forelock_core::pose::Pose;
use forelock_neural::features::{
    Features, HISTORY, PoseHistory, SHAPE_NUMBERS, SHARED_NUMBERS, SPACING_SECS,
};
use forelock_neural::model::{Model, ModelError, strands_at_rest};
use forelock_neural::network::inference::Predictor;
use glam::DVec3;

use crate::assets::Assets;
use crate::scene::{InteractionSection, Scene};
pub(crate) use scalp::Scalp;

/// The model that scenes use by default.
pub(crate) const DEFAULT: &str = "builtin:head";
/// The models that are built in: their names and their bytes.
const BUILTIN: [(&str, &[u8]); 1] = [(DEFAULT, include_bytes!("../../models/head.safetensors"))];

/// The names of the built-in models.
pub(crate) fn builtin_names() -> impl Iterator<Item = &'static str> {
    BUILTIN.iter().map(|(name, _)| *name)
}

/// The model that scenes use by default, `builtin:head`.
///
/// # Errors
/// None in a build that passes its tests.
pub fn builtin_model() -> Result<Model, ModelError> {
    read(DEFAULT)
}

/// The model `name`: a built-in one (`builtin:head`) or that of a file.
///
/// # Errors
/// [`ModelError`] if the file cannot be read or is no model.
pub fn read(name: &str) -> Result<Model, ModelError> {
    match BUILTIN.iter().find(|(own, _)| name == *own) {
        Some((_, bytes)) => Model::from_bytes(bytes),
        None => Model::read(name),
    }
}

/// Why this version cannot run `model`, and what to do; none if it can.
pub(crate) fn unsupported(model: &Model) -> Option<String> {
    let info = model.info();
    if info.history > HISTORY {
        let found = info.history;
        Some(format!(
            "the model has a history of {found} entries, and this version {HISTORY}: train it again"
        ))
    } else if (info.dt_secs / SPACING_SECS - 1.0).abs() > 0.01 {
        let found = info.dt_secs;
        Some(format!("the model steps by {found} s, and this version by 1/30 s: train it again"))
    } else {
        None
    }
}

/// The stage of the network, as reports name it.
pub(crate) const STAGE: &str = "predict_strands";

/// Distance of the roots from the head's centre, on average, that no head has, metres.
pub(crate) const FAR_M: f64 = 0.4;
/// Largest difference from the gravity of the training, over that.
const GRAVITY_TOLERANCE: f64 = 0.01;

/// What a learned simulator is built from besides its strands.
#[derive(Debug)]
pub(crate) struct Learned {
    model: Arc<Model>,
    path: PathBuf,
    /// Where the model's head joint is in the groom's space, metres.
    joint: DVec3,
    scalp: Scalp,
    /// Whether a GPU stores the network in 16 bits.
    halved: bool,
    /// What the user should know, one sentence each.
    pub(crate) notes: Vec<String>,
}

impl Learned {
    /// What `scene` asks for, if it asks for a learned solver.
    pub(crate) fn of(scene: &Scene, assets: &Assets) -> Result<Option<Self>, NeuralError> {
        let section = &scene.solver.neural;
        if !scene.solver.is_learned() {
            return Ok(None);
        }
        let name = &section.model;
        // Assets of another scene may be without it.
        let model = assets.model(name).map_or_else(|| read(name).map(Arc::new), Ok)?;
        let learned = Self {
            model,
            path: Path::new(name).to_path_buf(),
            joint: section.origin.into(),
            scalp: Scalp::new(assets.body_mesh()),
            halved: section.half,
            notes: notes(scene),
        };
        learned.check()?;
        Ok(Some(learned))
    }

    /// Checks that this version can run the model.
    fn check(&self) -> Result<(), NeuralError> {
        match unsupported(&self.model) {
            Some(problem) => Err(NeuralError::Unsupported { path: self.path.clone(), problem }),
            None => Ok(()),
        }
    }

    /// Checks that hair under `gravity`, m/s², is what the model knows.
    fn check_gravity(&self, gravity: DVec3) -> Result<(), NeuralError> {
        let trained = 0.01 * DVec3::from_array(self.model.info().energies.gravity);
        if gravity.distance(trained) <= GRAVITY_TOLERANCE * trained.length() {
            return Ok(());
        }
        Err(NeuralError::Gravity { found: gravity, trained })
    }

    /// The pose of the model's head joint, cm, with the head at `head`.
    fn joint(&self, head: &Pose) -> Pose {
        let translation = 100.0 * head.transform_point(self.joint);
        Pose { rotation: head.rotation.normalize(), translation }
    }

    /// The network's inputs of a frame after `history`: at most as many as this version computes.
    fn shared(&self, history: &PoseHistory, features: &Features) -> Vec<f32> {
        let mut inputs = history.inputs(features, &[0.0; SHAPE_NUMBERS]).to_vec();
        inputs.truncate(self.model.network().shape().shared.min(SHARED_NUMBERS));
        inputs
    }

    /// The network, ready for inference.
    fn predictor(&self, simd: Simd) -> Result<Predictor, NeuralError> {
        let in_file = |error| ModelError::File { path: self.path.clone(), error: Box::new(error) };
        Ok(self.model.predictor(simd).map_err(in_file)?)
    }

    /// The numbers of the network's inputs of a frame.
    fn features(&self) -> Result<Features, NeuralError> {
        let info = self.model.info();
        Ok(Features::new(info.origin_in_head.into(), info.head_motion)?)
    }

    /// The static inputs of the strands of `groom`, `[strands, statics]`.
    fn inputs(&self, groom: &Groom, simd: Simd) -> Result<Vec<f32>, NeuralError> {
        let origin = self.joint + 0.01 * DVec3::from_array(self.model.info().origin_in_head);
        self.check_place(groom, origin)?;
        let strands = strands_at_rest(groom, origin, &self.scalp.normals(groom, origin))?;
        Ok(self.model.strand_inputs(&strands, simd)?)
    }

    /// Checks that the roots of `groom` can be those of a head with its centre at `origin`.
    fn check_place(&self, groom: &Groom, origin: DVec3) -> Result<(), NeuralError> {
        let roots = || groom.strands().filter_map(|strand| strand.first()).map(|root| root.as_dvec3());
        let count = roots().count().max(1) as f64;
        let distance_m = roots().map(|root| root.distance(origin)).sum::<f64>() / count;
        if distance_m <= FAR_M {
            return Ok(());
        }
        let middle = (1e3 * roots().sum::<DVec3>() / count).round() / 1e3;
        Err(NeuralError::Far { distance_m, middle })
    }
}

/// What of `scene` has no effect.
fn notes(scene: &Scene) -> Vec<String> {
    let usual = InteractionSection::default();
    let is_set = scene.interaction != usual && scene.interaction.interactions() != Interactions::default();
    let passed_over = [("interaction", is_set), ("wind", scene.wind != WindParams::default())];
    let note = |name| format!("`{name}` has no effect: the learned solver moves each strand by itself");
    passed_over.into_iter().filter(|(_, is_set)| *is_set).map(|(name, _)| note(name)).collect()
}
