//! Parameters of the augmented mass-spring solver.
//!
//! Stiffnesses are rates: stiffness over particle mass, in s⁻². The motion depends only on these
//! ratios, lengths and gravity. They do not depend on the frame rate or the substep.

use crate::frame::{StepCheck, StepRate};
use crate::params::{
    FLOAT32_STIFFNESS_LIMIT, Inextensibility, LEAST_SUBSTEP_SECS, LENGTH_PASS_SECS, PART_TOLERANCE,
    ParamsError, SUBSTEP_SECS, check, check_time, parts,
};

/// How a stretched spring enters the implicit matrix.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "kebab-case"))]
pub enum Jacobian {
    /// κ [D + max(0, 1 − l₀/l)(I − D)]: tension is implicit across the strand too; the substep has
    /// no limit.
    #[default]
    Tension,
    /// κ D, as printed (Eq. 5): stable only for substeps under l/√(L g).
    Paper,
}

/// The angular tie between a particle and its ghost.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "kebab-case"))]
pub enum AngularForm {
    /// A couple that turns the edge towards the ghost's edge; conserves momentum, smooth at rest.
    #[default]
    Edge,
    /// A force on the outer particle towards its ghost, as printed (Eq. 2); oscillates after a
    /// tilt.
    Paper,
    /// No angular tie.
    Off,
}

/// How the integrity tie enters the implicit matrix.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "kebab-case"))]
pub enum IntegrityForm {
    /// κ_I I: the exact Jacobian of a spring of rest length zero.
    #[default]
    Isotropic,
    /// κ_I D, as printed (Eq. 8): jitters for h² κ_I > 4.
    Paper,
}

/// The names of length passes in files.
#[cfg(feature = "serde")]
#[derive(serde::Serialize, serde::Deserialize)]
#[serde(remote = "Inextensibility", rename_all = "kebab-case")]
pub(crate) enum LengthPass {
    Projection,
    #[serde(rename = "dftl")]
    FollowTheLeader,
    Limit,
    Off,
}

crate::documented! {
/// Parameters of the augmented mass-spring solver (AMS). Every default is the project's recommended
/// value.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct AmsParams {
    /// Edge spring stiffness over mass, particles i and i+1. Unit s⁻², default 1e6, range 0 to
    /// 1e12; 0 switches it off.
    pub k_edge: f64,
    /// Bend spring stiffness over mass, particles i and i+2. Unit s⁻², default 1e6, range 0 to
    /// 1e12; 0 switches it off.
    pub k_bend: f64,
    /// Torsion spring stiffness over mass, particles i and i+3. Unit s⁻², default 1e6, range 0 to
    /// 1e12; 0 switches it off.
    pub k_torsion: f64,
    /// Integrity spring stiffness over mass, particle to ghost. Unit s⁻², default 100, range 0 to
    /// 1e12; 0 switches it off.
    pub k_integrity: f64,
    /// Angular spring stiffness over mass, edge to ghost edge. Unit m s⁻² per radian, default 100,
    /// range 0 to 1e6; 0 switches it off.
    pub k_angular: f64,
    /// Altitude spring stiffness over mass, across the tetrahedra of four consecutive particles
    /// (Selle 2008). Unit s⁻², default 0, range 0 to 1e12; 0 switches it off.
    pub k_altitude: f64,
    /// Stiffness at the tip over stiffness at the root, linear along the strand, for edge, bend,
    /// torsion and altitude springs. No unit, default 1, range 0 to 1; 0 leaves the tip free.
    pub tip_scale_springs: f64,
    /// `tip_scale_springs` for the integrity spring. No unit, default 1,
    /// range 0 to 1; 0 leaves the tip free.
    pub tip_scale_integrity: f64,
    /// `tip_scale_springs` for the angular spring. No unit, default 1,
    /// range 0 to 1; 0 leaves the tip free.
    pub tip_scale_angular: f64,
    /// Drag rate against the air. Unit s⁻¹, default 2, range 0 to 1e4; 0 is a vacuum.
    pub drag: f64,
    /// Drag of air flow along the strand over that of air flow across it. No unit, default 1, range
    /// 0 to 1; a thin rod has 0.5, 0 lets air slip along the strand.
    pub drag_along: f64,
    /// Growth of the drag rate with the speed of the air relative to the hair. Unit 1/m, default 0,
    /// range 0 to 1000; 0 is drag in proportion to the speed.
    pub drag_quadratic: f64,
    /// Particles that follow the head exactly, from the root. Unit particles, default 2, range 1 to
    /// 1000; 1 makes the root a hinge, 0 is refused.
    pub clamped: u32,
    /// Longest substep, 1/240 s by default; frames and steps are divided into as many equal ones as
    /// they take. Unit s, default 0.004166666666666667, range 1e-5 to 1.
    pub substep_secs: f64,
    /// How springs enter the matrix: "tension" or "paper". Default "tension".
    pub jacobian: Jacobian,
    /// Form of the angular tie: "edge", "paper" or "off". Default "edge".
    pub angular: AngularForm,
    /// How the integrity tie enters the matrix: "isotropic" or "paper". Default "isotropic".
    pub integrity: IntegrityForm,
    /// Whether ghost ties compensate the weight at rest, so that a groom at rest does not sag.
    /// Default true.
    pub sag_free: bool,
    /// Whether integrity ties soften, take damage and break under large deflections. Default false.
    pub non_hookean: bool,
    /// Deflection, over the strand's length, up to which ties are elastic. No unit, default 0.5,
    /// range 0 to 1; 0 softens from the start.
    pub elastic_limit: f64,
    /// Deflection, over the strand's length, from which ties break. No unit, default 1, range 1e-6
    /// to 1000.
    pub breaking_point: f64,
    /// Further deflection, over the strand's length, at which a tie is fully broken. No unit,
    /// default 0.1, range 1e-6 to 1000.
    pub breaking_width: f64,
    /// Time in which damage heals while the deflection is under `healing_limit`. Unit s, default 0,
    /// range 0 to 1e6; 0 never heals.
    pub healing_secs: f64,
    /// Deflection, over the strand's length, under which ties heal. No unit, default 0.25, range 0
    /// to 1; 0 never heals.
    pub healing_limit: f64,
    /// The pass that restores edge lengths: "projection", "dftl", "limit" or "off". Default
    /// "projection".
    #[cfg_attr(feature = "serde", serde(with = "LengthPass"))]
    pub inextensibility: Inextensibility,
    /// Stretch, over the rest length, to which the pass "limit" shortens edges; it leaves others
    /// alone. No unit, default 0.03, range 0 to 10; 0 lets no edge stretch.
    pub max_stretch: f64,
    /// Share of a follow-the-leader correction that is subtracted from the leader's velocity. No
    /// unit, default 0.9, range 0 to 1; 0 never settles.
    #[cfg_attr(feature = "serde", serde(rename = "dftl_damping"))]
    pub length_damping: f64,
    /// Whether edges that solids stretched at the end of a frame are restored to rest length along
    /// the surface; without a length pass and with "limit", where they are stretched by more than
    /// 4 % and by more than `max_stretch`. Default true; false leaves them stretched, as the paper
    /// does.
    pub lay_along_solids: bool,
    /// Distance of particles from solids at a contact. Unit m, default 0.0005, range 0 to 1; 0
    /// touches the skin.
    pub skin_thickness: f64,
    /// Largest speed at which a particle that starts a frame inside a solid is pushed out. Unit
    /// m/s, default 1, range 1e-3 to 1e6; 0 is refused.
    pub depenetration_speed: f64,
}
}

impl Default for AmsParams {
    fn default() -> Self {
        Self {
            k_edge: 1e6,
            k_bend: 1e6,
            k_torsion: 1e6,
            k_integrity: 1e2,
            k_angular: 1e2,
            k_altitude: 0.0,
            tip_scale_springs: 1.0,
            tip_scale_integrity: 1.0,
            tip_scale_angular: 1.0,
            drag: 2.0,
            drag_along: 1.0,
            drag_quadratic: 0.0,
            clamped: 2,
            substep_secs: SUBSTEP_SECS,
            jacobian: Jacobian::default(),
            angular: AngularForm::default(),
            integrity: IntegrityForm::default(),
            sag_free: true,
            non_hookean: false,
            elastic_limit: 0.5,
            breaking_point: 1.0,
            breaking_width: 0.1,
            healing_secs: 0.0,
            healing_limit: 0.25,
            inextensibility: Inextensibility::default(),
            max_stretch: 0.03,
            length_damping: 0.9,
            lay_along_solids: true,
            skin_thickness: 5e-4,
            depenetration_speed: 1.0,
        }
    }
}

impl AmsParams {
    /// Whether drag depends on the hair's direction or speed.
    pub fn has_local_drag(&self) -> bool {
        self.drag_along != 1.0 || self.drag_quadratic != 0.0
    }

    /// A step each [`LENGTH_PASS_SECS`], or each substep if that is longer.
    pub fn rate(&self) -> StepRate {
        let is_longer = self.substep_secs > LENGTH_PASS_SECS * (1.0 + PART_TOLERANCE);
        StepRate::Fixed(if is_longer { self.substep_secs } else { LENGTH_PASS_SECS })
    }

    /// Checks every parameter against its range.
    ///
    /// # Errors
    /// [`ParamsError::Range`] for the first parameter out of its range.
    pub fn validate(&self) -> Result<(), ParamsError> {
        check::<Self, f64>(&[
            ("k_edge", &[self.k_edge]),
            ("k_bend", &[self.k_bend]),
            ("k_torsion", &[self.k_torsion]),
            ("k_integrity", &[self.k_integrity]),
            ("k_angular", &[self.k_angular]),
            ("k_altitude", &[self.k_altitude]),
            ("tip_scale_springs", &[self.tip_scale_springs]),
            ("tip_scale_integrity", &[self.tip_scale_integrity]),
            ("tip_scale_angular", &[self.tip_scale_angular]),
            ("drag", &[self.drag]),
            ("drag_along", &[self.drag_along]),
            ("drag_quadratic", &[self.drag_quadratic]),
            ("clamped", &[f64::from(self.clamped)]),
            ("substep_secs", &[self.substep_secs]),
            ("elastic_limit", &[self.elastic_limit]),
            ("breaking_point", &[self.breaking_point]),
            ("breaking_width", &[self.breaking_width]),
            ("healing_secs", &[self.healing_secs]),
            ("healing_limit", &[self.healing_limit]),
            ("max_stretch", &[self.max_stretch]),
            ("dftl_damping", &[self.length_damping]),
            ("skin_thickness", &[self.skin_thickness]),
            ("depenetration_speed", &[self.depenetration_speed]),
        ])?;
        if self.breaking_point <= self.elastic_limit {
            let (name, value) = ("breaking_point", self.breaking_point);
            return Err(ParamsError::Range { name, value, expected: "above `elastic_limit`".to_owned() });
        }
        Ok(())
    }

    /// Checks that frames like `step` can be solved: the time is positive and, unless
    /// `beyond_float32`, h² κ over the smallest relative mass is at most
    /// [`FLOAT32_STIFFNESS_LIMIT`].
    ///
    /// # Errors
    /// [`ParamsError`] for the first check that fails.
    pub fn validate_step(&self, step: &StepCheck) -> Result<(), ParamsError> {
        let StepCheck { dt_secs, least_mass, beyond_float32 } = *step;
        check_time(dt_secs)?;
        if beyond_float32 {
            return Ok(());
        }
        let substeps = parts(dt_secs, self.substep_secs);
        let h = dt_secs / f64::from(substeps);
        let stiffest = [
            ("k_edge", self.k_edge),
            ("k_bend", self.k_bend),
            ("k_torsion", self.k_torsion),
            ("k_integrity", self.k_integrity),
            ("k_altitude", self.k_altitude),
        ];
        for (name, value) in stiffest {
            let product = h * h * value / least_mass;
            // The tolerance accepts a limit that was computed from a rounded frame time.
            if product > FLOAT32_STIFFNESS_LIMIT * (1.0 + 1e-9) {
                let longest = (FLOAT32_STIFFNESS_LIMIT * least_mass / value).sqrt() / (1.0 + PART_TOLERANCE);
                let needed_secs = Some(floor_to_three_digits(longest)).filter(|s| *s >= LEAST_SUBSTEP_SECS);
                let allowed = FLOAT32_STIFFNESS_LIMIT * least_mass / (h * h);
                return Err(ParamsError::TooStiff {
                    name,
                    value,
                    substeps,
                    dt_secs,
                    product,
                    needed_secs,
                    allowed,
                });
            }
        }
        Ok(())
    }
}

/// `x`, above 0, rounded down to three digits.
fn floor_to_three_digits(x: f64) -> f64 {
    let unit = 10f64.powf(x.log10().floor() - 2.0);
    // Written in decimal and read back, so that it prints as three digits.
    format!("{:.2e}", (x / unit).floor() * unit).parse().unwrap_or(x)
}
