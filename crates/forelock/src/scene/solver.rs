//! `[solver]`: which solver, and its parameters.

use forelock_core::lane::Simd;
use forelock_core::solver::{AmsParams, DftlParams, MassSpringParams};
use forelock_core::strands::Masses;
use serde::{Deserialize, Serialize, Serializer};

use super::document::Document;
use super::error::{SceneError, one_of};

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
    /// Position-based Cosserat rods. Not yet available.
    Xpbd,
    /// The learned simulator. Not yet available.
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

/// `[solver]`: which solver, and its parameters.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SolverSection {
    /// "ams", "mass-spring" or "dftl". Default "ams".
    pub kind: SolverKind,
    /// Instructions to use: "auto", "portable", "avx2", "avx512" or "scalar". Default "auto".
    pub simd: SimdChoice,
    /// Whether stiffness may go beyond what float32 solves, to see what happens then. Default
    /// false.
    pub beyond_float32: bool,
    /// Masses of particles: "uniform", or "widths" for masses in proportion to the squares of the
    /// groom's widths. Default "uniform".
    pub masses: Masses,
    /// Parameters of "ams".
    pub ams: AmsParams,
    /// Parameters of "mass-spring".
    pub mass_spring: MassSpringParams,
    /// Parameters of "dftl".
    pub dftl: DftlParams,
    /// Parameters of the registered solver that is chosen, the table `[solver.NAME]`. Default
    /// empty.
    #[serde(skip)]
    pub custom: toml::Table,
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

impl SolverSection {
    /// Substeps a frame, M, of the solver that is chosen.
    pub fn substeps(&self) -> u32 {
        match self.kind {
            SolverKind::MassSpring => self.mass_spring.substeps,
            SolverKind::Dftl | SolverKind::Custom(_) => 1,
            _ => self.ams.substeps,
        }
    }

    /// Particles of a strand, from the root, that the chosen solver fixes to the head.
    pub fn clamped(&self) -> u32 {
        match self.kind {
            SolverKind::Dftl => self.dftl.clamped,
            SolverKind::MassSpring => self.mass_spring.clamped,
            _ => self.ams.clamped,
        }
    }

    /// Substeps a frame, M, for every solver.
    pub(super) fn set_substeps(&mut self, substeps: u32) {
        (self.ams.substeps, self.mass_spring.substeps) = (substeps, substeps);
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
                return Err(document.refuse("solver.kind", one_of(&other, &known)));
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
