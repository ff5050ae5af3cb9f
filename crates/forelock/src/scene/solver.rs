//! `[solver]`: which solver, and its parameters.

use forelock_core::lane::Simd;
use forelock_core::solver::{AmsParams, DftlParams, MassSpringParams, PrescribedParams, Solver, XpbdParams};
use forelock_core::strands::Masses;
use serde::{Deserialize, Serialize, Serializer};

use super::document::Document;
use super::error::{SceneError, one_of};
use super::reference::{Section, with};

/// The solvers that a scene can name.
#[derive(Clone, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SolverKind {
    /// Augmented mass-spring.
    #[default]
    Ams,
    /// The plain mass-spring baseline: no ties to the rest shape.
    MassSpring,
    /// Dynamic follow the leader, with preserved shape.
    Dftl,
    /// Cosserat rods under extended position-based dynamics.
    Xpbd,
    /// A trained model.
    Neural,
    /// A solver that is registered with the player under this name: see
    /// [`Scene::load_with`](crate::Scene::load_with).
    #[serde(skip_deserializing)]
    Custom(String),
}

impl Serialize for SolverKind {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name())
    }
}

impl SolverKind {
    /// The names that every scene file may use.
    pub const NAMES: [&'static str; 5] = ["ams", "mass-spring", "dftl", "xpbd", "neural"];

    /// The name in scene files.
    pub fn name(&self) -> &str {
        match self {
            Self::Ams => "ams",
            Self::MassSpring => "mass-spring",
            Self::Dftl => "dftl",
            Self::Xpbd => "xpbd",
            Self::Neural => "neural",
            Self::Custom(name) => name,
        }
    }
}

/// Which instructions the solver may use.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SimdChoice {
    /// The widest that the processor has.
    #[default]
    Auto,
    /// No more than every processor of the kind has.
    Portable,
    /// AVX2 with fused multiply-add.
    Avx2,
    /// AVX-512.
    Avx512,
    /// One strand at a time.
    Scalar,
}

forelock_core::documented! {
/// `[solver.neural]`: a trained model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct NeuralSection {
    /// File of the trained model, or "builtin:head", which knows hair of the built-in head. Default
    /// "builtin:head".
    pub model: String,
    /// The point of the groom's space that the model takes for the head's centre, between the ears
    /// of the built-in head: [x, y, z]. Unit m, default [0, 0, 0], range -1000 to 1000 each.
    pub origin: [f64; 3],
    /// Whether solids push hair out at the end of each frame. The model knows no solids but the
    /// head that it was trained on. Default false.
    pub push_out: bool,
    /// Whether a GPU stores the network in 16 bits, which is up to 0.02 cm off. The CPU has it in
    /// 32 bits always. Default false.
    pub half: bool,
}
}

impl Default for NeuralSection {
    fn default() -> Self {
        Self { model: crate::neural::DEFAULT.to_owned(), origin: [0.0; 3], push_out: false, half: false }
    }
}

impl NeuralSection {
    /// Whether the model is none of a file.
    pub(crate) fn is_builtin(&self) -> bool {
        self.model.starts_with("builtin:")
    }
}

forelock_core::documented! {
/// `[solver]`: which solver, and its parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SolverSection {
    /// "ams", "mass-spring", "dftl", "xpbd" or "neural". Default "ams".
    pub kind: SolverKind,
    /// Instructions to use: "auto", "portable", "avx2", "avx512" or "scalar". Default "auto".
    pub simd: SimdChoice,
    /// Whether stiffness may go beyond what float32 solves, to see what happens then. Default
    /// false.
    pub beyond_float32: bool,
    /// Masses of particles: "uniform", or "widths" for masses in proportion to the squares of the
    /// groom's widths. Default "uniform".
    pub masses: Masses,
    /// Speed below which a strand is still. Strands that are still for a second sleep: they are not
    /// simulated until something wakes them. Unit m/s, default 0.002, range 0 to 1; 0 lets none
    /// sleep.
    pub sleep_speed: f64,
    /// Parameters of "ams".
    pub ams: AmsParams,
    /// Parameters of "mass-spring".
    pub mass_spring: MassSpringParams,
    /// Parameters of "dftl".
    pub dftl: DftlParams,
    /// Parameters of "xpbd".
    pub xpbd: XpbdParams,
    /// The model of "neural".
    pub neural: NeuralSection,
    /// Parameters of the registered solver that is chosen, the table `[solver.NAME]`. Default
    /// empty.
    #[serde(skip)]
    pub custom: toml::Table,
}
}

impl Default for SolverSection {
    fn default() -> Self {
        Self {
            kind: SolverKind::default(),
            simd: SimdChoice::default(),
            beyond_float32: false,
            masses: Masses::default(),
            sleep_speed: 2e-3,
            ams: AmsParams::default(),
            mass_spring: MassSpringParams::default(),
            dftl: DftlParams::default(),
            xpbd: XpbdParams::default(),
            neural: NeuralSection::default(),
            custom: toml::Table::default(),
        }
    }
}

impl From<SimdChoice> for Simd {
    fn from(choice: SimdChoice) -> Self {
        match choice {
            SimdChoice::Auto => Self::Auto,
            SimdChoice::Scalar => Self::Scalar,
            SimdChoice::Portable => Self::Portable,
            SimdChoice::Avx2 => Self::Avx2,
            SimdChoice::Avx512 => Self::Avx512,
        }
    }
}

const AMS_NOTE: &str = "Stiffness is also bounded by float32: h²κ ≤ 1000 for the substep h; the message \
    names a substep that would do.";
const DFTL_NOTE: &str = "Shares are those of a step of 0.016 s; for other steps they are converted.";
const XPBD_NOTE: &str = "`time.substep_secs` does not apply: rods need far shorter substeps than springs.";

const NEURAL_NOTE: &str = "Wind, interaction between strands and bodies that bend are not for this solver; \
    [Solvers](solvers.md#neural) has the rest.";

/// The sections of the reference for the tables of solvers.
pub(super) fn sections() -> [Section; 5] {
    [
        with::<AmsParams>("solver.ams", "## `[solver.ams]`: augmented mass-spring", AMS_NOTE),
        with::<MassSpringParams>(
            "solver.mass_spring",
            "## `[solver.mass_spring]`: plain mass-spring",
            AMS_NOTE,
        ),
        with::<DftlParams>("solver.dftl", "## `[solver.dftl]`: dynamic follow the leader", DFTL_NOTE),
        with::<XpbdParams>("solver.xpbd", "## `[solver.xpbd]`: XPBD Cosserat rods", XPBD_NOTE),
        with::<NeuralSection>("solver.neural", "## `[solver.neural]`: a trained model", NEURAL_NOTE),
    ]
}

/// A built-in solver with the parameters of a scene.
#[derive(Debug)]
pub(crate) struct BuiltIn {
    kind: SolverKind,
    /// The key of its parameters.
    pub(super) table: &'static str,
    pub(crate) solver: Solver<f32>,
}

impl SolverSection {
    /// The keys of the substep of solvers, which mean the same as `time.substep_secs`.
    pub(super) const SUBSTEP: [&str; 2] = ["solver.ams.substep_secs", "solver.mass_spring.substep_secs"];

    /// The keys that these replace: a number of substeps a frame.
    pub(super) const FORMER: [&str; 3] =
        ["time.substeps", "solver.ams.substeps", "solver.mass_spring.substeps"];

    /// The built-in solvers, in the order of their stages. The registered ones are known to the
    /// player only, and a trained model has no stages of its own.
    pub(crate) fn built_in(&self) -> [BuiltIn; 4] {
        let built_in = |kind, table, solver| BuiltIn { kind, table, solver };
        [
            built_in(SolverKind::Ams, "solver.ams", (&self.ams).into()),
            built_in(SolverKind::MassSpring, "solver.mass_spring", (&self.mass_spring).into()),
            built_in(SolverKind::Dftl, "solver.dftl", (&self.dftl).into()),
            built_in(SolverKind::Xpbd, "solver.xpbd", (&self.xpbd).into()),
        ]
    }

    /// Whether a trained model moves the strands.
    pub(crate) fn is_learned(&self) -> bool {
        self.kind == SolverKind::Neural
    }

    /// Whether `other` has the same trained model, or neither has one.
    pub(crate) fn has_model_of(&self, other: &Self) -> bool {
        let of = |own: &Self| own.is_learned().then(|| (own.neural.model.clone(), own.neural.origin));
        of(self) == of(other)
    }

    /// The chosen solver, if it is built in.
    pub(crate) fn chosen(&self) -> Option<BuiltIn> {
        if self.is_learned() {
            let params = PrescribedParams { push_out: self.neural.push_out };
            let solver = (&params).into();
            return Some(BuiltIn { kind: SolverKind::Neural, table: "solver.neural", solver });
        }
        self.built_in().into_iter().find(|own| own.kind == self.kind)
    }

    /// The chosen solver; the first one in place of a registered solver.
    fn chosen_or_first(&self) -> Solver<f32> {
        let [first, ..] = self.built_in();
        self.chosen().unwrap_or(first).solver
    }

    /// Substeps of a frame of `dt_secs`, M, of the solver that is chosen.
    pub fn substeps(&self, dt_secs: f64) -> u32 {
        self.chosen().map_or(1, |own| own.solver.rules().substeps(dt_secs))
    }

    /// Particles of a strand, from the root, that the chosen solver fixes to the head.
    pub fn clamped(&self) -> u32 {
        self.chosen_or_first().clamped() as u32
    }

    /// Distance that the chosen solver keeps hair from solids, metres.
    pub(crate) fn skin_thickness(&self) -> f64 {
        self.chosen_or_first().rules().skin_thickness
    }

    /// The key that would have to be false for strands to have the particles of the groom only, if
    /// they have others.
    pub(super) fn refining_key(&self) -> Option<&'static str> {
        let own = self.chosen().and_then(|own| own.solver.refinement());
        own.map(|_| "solver.mass_spring.virtual_particles")
    }

    /// The longest substep of the solver that is chosen, seconds; none if it has one a frame.
    pub(crate) fn substep_secs(&self) -> Option<f64> {
        match self.kind {
            SolverKind::Ams => Some(self.ams.substep_secs),
            SolverKind::MassSpring => Some(self.mass_spring.substep_secs),
            _ => None,
        }
    }

    /// Sets the longest substep, seconds, of every solver that has one.
    pub(super) fn set_substep_secs(&mut self, secs: f64) {
        (self.ams.substep_secs, self.mass_spring.substep_secs) = (secs, secs);
    }
}

/// The choice of a registered solver, as it stands in a document.
pub(super) struct Registered {
    name: String,
    table: toml::Table,
}

impl Registered {
    /// Takes everything about the solvers `names` out of `document`; the one that is chosen, if one
    /// is.
    pub(super) fn take(document: &mut Document<'_>, names: &[&str]) -> Result<Option<Self>, SceneError> {
        if names.is_empty() {
            return Ok(None);
        }
        let chosen = document.text_at("solver", "kind");
        let mut found = None;
        for &name in names {
            let table = document.take_table("solver", name)?;
            if chosen.as_deref() == Some(name) {
                found = Some(Self { name: name.to_owned(), table: table.unwrap_or_default() });
            }
        }
        match chosen {
            Some(_) if found.is_some() => document.remove("solver", "kind"),
            Some(other) if !SolverKind::NAMES.contains(&other.as_str()) => {
                let known: Vec<&str> = SolverKind::NAMES.iter().chain(names).copied().collect();
                let message = one_of(&other, &known);
                let own = "a solver of your own is registered with a player, see Scene::load_with";
                return Err(document.refuse("solver.kind", format!("{message} ({own})")));
            }
            _ => {}
        }
        Ok(found)
    }

    /// Makes it the solver of `section`.
    pub(super) fn put(self, section: &mut SolverSection) {
        section.kind = SolverKind::Custom(self.name);
        section.custom = self.table;
    }
}
