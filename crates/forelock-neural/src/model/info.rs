//! What a model's file says about the model: a JSON text in its metadata.

use super::ModelError;
use super::error::one_line;
use crate::codes::LOCAL_SCALE_CM;
use crate::features::{
    ANGULAR_SCALE, GRAVITY, HISTORY, HeadMotion, JOINTS, POSE_NUMBERS, SHAPE_NUMBERS, VELOCITY_NUMBERS,
    VELOCITY_SCALE,
};
use crate::losses::adhesion::AdhesionTerms;
use crate::losses::body::BodyTerms;
use crate::losses::elastic::{ElasticTerms, Transport};
use crate::losses::motion::MotionTerms;
use crate::losses::repulsion::RepulsionTerms;
use crate::losses::style::StyleTerms;
use crate::network::head::OutputHead;
use crate::train::Energies;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// The version of the format that this crate writes, and the only one that it reads.
pub const FORMAT_VERSION: u32 = 1;
/// The units of all models.
pub const UNITS: &str = "cm, g, s";

/// Whether hair has a past.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ModelKind {
    /// Hair follows the pose history, with inertia and drag.
    #[default]
    Dynamic,
    /// Hair hangs at rest in each pose: no history.
    QuasiStatic,
}

/// The map from the roots of strands to uv coordinates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum UvMap {
    /// About the crown ([`crown_uv`](crate::codes::crown_uv)).
    #[default]
    Crown,
}

/// The values that become 1 in the network's inputs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct InputScales {
    /// Of angular velocities, s⁻¹.
    pub angular: f64,
    /// Of velocities, cm s⁻¹.
    pub velocity: f64,
    /// Of the specific force, cm s⁻².
    pub specific_force: f64,
    /// Of the encoder's positions, cm.
    pub encoder: f64,
}

impl Default for InputScales {
    fn default() -> Self {
        Self {
            angular: ANGULAR_SCALE,
            velocity: VELOCITY_SCALE,
            specific_force: GRAVITY,
            encoder: LOCAL_SCALE_CM,
        }
    }
}

/// Coefficients of the energies that training lowered, in units of cm, g and s. The terms are those
/// of [`Energies`]; the frame time, the transport and whether there is inertia are in
/// [`ModelInfo`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct EnergyInfo {
    /// Stiffness of stretch, g s⁻².
    pub stretch: f64,
    /// Stiffness of bending and twist, g cm³ s⁻².
    pub bend_twist: f64,
    /// The least n of an arc.
    pub least_arc: f64,
    /// Whether the first edge is held in its direction at rest.
    pub clamps_root: bool,
    /// Mass of a particle, g.
    pub mass: f64,
    /// Rate of drag, s⁻¹.
    pub drag: f64,
    /// Gravity's acceleration, cm s⁻².
    pub gravity: [f64; 3],
    /// Stiffness of the body, g cm⁻¹ s⁻².
    pub body_stiffness: f64,
    /// Margin of the body, cm.
    pub body_margin: f64,
    /// Where the body's linear tail begins, cm; none without a tail.
    pub body_tail: Option<f64>,
    /// Style; none without it.
    pub style: Option<StyleInfo>,
    /// Repulsion of neighbouring strands; none without it.
    #[serde(default)]
    pub repulsion: Option<RepulsionInfo>,
    /// Adhesion of neighbouring strands; none without it.
    #[serde(default)]
    pub adhesion: Option<AdhesionInfo>,
}

/// Coefficients of the energy of repulsion.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct RepulsionInfo {
    /// Stiffness, in units that make the energy g cm² s⁻².
    pub stiffness: f64,
    /// Half the kernel's support, cm.
    pub smoothing: f64,
}

/// Coefficients of the energy of adhesion.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AdhesionInfo {
    /// Stiffness, g s⁻².
    pub stiffness: f64,
    /// Largest distance of neighbours at rest, cm.
    pub range: f64,
    /// Whether it is the paper's, which pulls neighbours together.
    pub printed: bool,
}

/// Coefficients of the energy of style.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct StyleInfo {
    /// Stiffness, g s⁻².
    pub stiffness: f64,
    /// The distance at which style ends, cm.
    pub range: f64,
}

/// How a model was trained.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TrainingInfo {
    /// Digest of the training's configuration, as text.
    pub config_digest: String,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Steps.
    pub steps: u32,
    /// Names of the grooms whose strands were seen.
    pub grooms: Vec<String>,
    /// Names of the motions that were seen.
    pub motions: Vec<String>,
}

/// What a model's file says about the model. Fields that this version does not know are passed
/// over on reading; a field that is missing is an error, except for those that are optional.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ModelInfo {
    /// Version of the format: [`FORMAT_VERSION`].
    pub version: u32,
    /// Whether hair has a past.
    pub kind: ModelKind,
    /// What the network's outputs are.
    pub head: OutputHead,
    /// How frames were carried along strands in training.
    pub transport: Transport,
    /// How the head's motion enters the history.
    pub head_motion: HeadMotion,
    /// Names of the four joints: root, spine, neck, head.
    pub joints: Vec<String>,
    /// The origin of canonical space in the head's axes, cm.
    pub origin_in_head: [f64; 3],
    /// Time between frames, and between entries of the history, s.
    pub dt_secs: f64,
    /// Entries of the history; 0 for the kind `quasi-static`.
    pub history: usize,
    /// Units: [`UNITS`].
    pub units: String,
    /// The values that become 1 in the inputs.
    pub scales: InputScales,
    /// Coefficients of the energies.
    pub energies: EnergyInfo,
    /// σ_z: the mean deviation of the numbers of codes, by which codes are divided.
    pub code_deviation: f64,
    /// The map from roots to uv.
    pub uv_map: UvMap,
    /// Digest of the body's shape directions, as text; none for a body without them.
    pub shape_digest: Option<String>,
    /// How the model was trained.
    pub training: TrainingInfo,
    /// What was measured, by name.
    pub measures: BTreeMap<String, f64>,
}

impl ModelInfo {
    /// The metadata of a model that was trained with `energies` and whose codes have the deviation
    /// `code_deviation`: rotation head, joints of the usual names, origin at the head joint. The
    /// kind is `quasi-static` where the energies have no inertia.
    ///
    /// ```
    /// use forelock_neural::model::ModelInfo;
    /// use forelock_neural::train::Energies;
    ///
    /// let mut info = ModelInfo::new(&Energies::default(), 0.8);
    /// info.training.seed = 7;
    /// assert_eq!(info.energies(), Energies::default());
    /// ```
    pub fn new(energies: &Energies, code_deviation: f64) -> Self {
        let MotionTerms { dt_secs, is_dynamic, .. } = energies.motion;
        Self {
            version: FORMAT_VERSION,
            kind: if is_dynamic { ModelKind::Dynamic } else { ModelKind::QuasiStatic },
            head: OutputHead::default(),
            transport: energies.elastic.transport,
            head_motion: HeadMotion::default(),
            joints: ["root", "spine", "neck", "head"].map(String::from).into(),
            origin_in_head: [0.0; 3],
            dt_secs,
            history: if is_dynamic { HISTORY } else { 0 },
            units: UNITS.into(),
            scales: InputScales::default(),
            energies: EnergyInfo::of(energies),
            code_deviation,
            uv_map: UvMap::default(),
            shape_digest: None,
            training: TrainingInfo::default(),
            measures: BTreeMap::new(),
        }
    }

    /// The energies that training lowered.
    pub fn energies(&self) -> Energies {
        let own = &self.energies;
        Energies {
            elastic: ElasticTerms {
                stretch: own.stretch,
                bend_twist: own.bend_twist,
                transport: self.transport,
                least_arc: own.least_arc,
                clamps_root: own.clamps_root,
            },
            motion: MotionTerms {
                mass: own.mass,
                dt_secs: self.dt_secs,
                drag: own.drag,
                gravity: own.gravity.into(),
                is_dynamic: self.kind == ModelKind::Dynamic,
            },
            body: BodyTerms {
                stiffness: own.body_stiffness,
                margin: own.body_margin,
                tail: own.body_tail.unwrap_or(f64::INFINITY),
            },
            style: own.style.map(|style| StyleTerms { stiffness: style.stiffness, range: style.range }),
            repulsion: own
                .repulsion
                .map(|own| RepulsionTerms { stiffness: own.stiffness, smoothing: own.smoothing }),
            adhesion: own.adhesion.map(|own| AdhesionTerms { stiffness: own.stiffness, range: own.range }),
            prints_adhesion: own.adhesion.is_some_and(|own| own.printed),
        }
    }

    /// Inputs of a frame: pose, body shape, history. `None` where they are too many to count.
    pub fn shared_inputs(&self) -> Option<usize> {
        self.history.checked_mul(VELOCITY_NUMBERS)?.checked_add(POSE_NUMBERS + SHAPE_NUMBERS)
    }

    /// Checks what does not depend on the weights.
    pub(super) fn check(&self) -> Result<(), ModelError> {
        let refuse = |field: &str, problem: String| Err(ModelError::Info { field: field.into(), problem });
        if self.version != FORMAT_VERSION {
            return Err(ModelError::Version { found: self.version.into() });
        }
        if self.units != UNITS {
            return refuse("units", format!("`{}` must be `{UNITS}`", one_line(&self.units)));
        }
        if self.joints.len() != JOINTS {
            let problem = format!("{} names must be {JOINTS}: root, spine, neck, head", self.joints.len());
            return refuse("joints", problem);
        }
        if (self.history == 0) != (self.kind == ModelKind::QuasiStatic) {
            let problem = format!("{} entries: `dynamic` needs some, `quasi-static` none", self.history);
            return refuse("history", problem);
        }
        if self.scales != InputScales::default() {
            let problem = format!("{:?} must be {:?}", self.scales, InputScales::default());
            return refuse("scales", problem);
        }
        if let Some((field, value)) = self.numbers().into_iter().find(|(_, value)| !value.is_finite()) {
            return refuse(&field, format!("{value} must be finite"));
        }
        for (field, value) in [("dt_secs", self.dt_secs), ("code_deviation", self.code_deviation)] {
            // The network divides by it in float32.
            if value < f64::from(f32::MIN_POSITIVE) || value > f64::from(f32::MAX) {
                return refuse(field, format!("{value} must be positive, and normal in float32"));
            }
        }
        Ok(())
    }

    /// All numbers that are not whole, with the names of their fields.
    fn numbers(&self) -> Vec<(String, f64)> {
        let EnergyInfo {
            stretch,
            bend_twist,
            least_arc,
            clamps_root: _,
            mass,
            drag,
            gravity,
            body_stiffness,
            body_margin,
            body_tail,
            style,
            repulsion,
            adhesion,
        } = self.energies;
        let style = style.map_or([0.0; 2], |style| [style.stiffness, style.range]);
        let repulsion = repulsion.map_or([0.0; 2], |own| [own.stiffness, own.smoothing]);
        let adhesion = adhesion.map_or([0.0; 2], |own| [own.stiffness, own.range]);
        let mut numbers: Vec<(String, f64)> = [
            ("dt_secs", self.dt_secs),
            ("code_deviation", self.code_deviation),
            ("energies.stretch", stretch),
            ("energies.bend_twist", bend_twist),
            ("energies.least_arc", least_arc),
            ("energies.mass", mass),
            ("energies.drag", drag),
            ("energies.body_stiffness", body_stiffness),
            ("energies.body_margin", body_margin),
            ("energies.body_tail", body_tail.unwrap_or_default()),
            ("energies.style.stiffness", style[0]),
            ("energies.style.range", style[1]),
            ("energies.repulsion.stiffness", repulsion[0]),
            ("energies.repulsion.smoothing", repulsion[1]),
            ("energies.adhesion.stiffness", adhesion[0]),
            ("energies.adhesion.range", adhesion[1]),
        ]
        .map(|(name, value)| (name.into(), value))
        .into();
        numbers.extend(self.origin_in_head.map(|x| ("origin_in_head".into(), x)));
        numbers.extend(gravity.map(|x| ("energies.gravity".into(), x)));
        numbers.extend(self.measures.iter().map(|(name, value)| (format!("measures.{name}"), *value)));
        numbers
    }
}

impl EnergyInfo {
    fn of(energies: &Energies) -> Self {
        let Energies { elastic, motion, body, style, repulsion, adhesion, prints_adhesion } = energies;
        Self {
            stretch: elastic.stretch,
            bend_twist: elastic.bend_twist,
            least_arc: elastic.least_arc,
            clamps_root: elastic.clamps_root,
            mass: motion.mass,
            drag: motion.drag,
            gravity: motion.gravity.to_array(),
            body_stiffness: body.stiffness,
            body_margin: body.margin,
            body_tail: (body.tail != f64::INFINITY).then_some(body.tail),
            style: style.map(|style| StyleInfo { stiffness: style.stiffness, range: style.range }),
            repulsion: repulsion
                .map(|own| RepulsionInfo { stiffness: own.stiffness, smoothing: own.smoothing }),
            adhesion: adhesion.map(|own| AdhesionInfo {
                stiffness: own.stiffness,
                range: own.range,
                printed: *prints_adhesion,
            }),
        }
    }
}
