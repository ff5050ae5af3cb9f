//! Coefficients of a frame, a substep and a row.

use crate::frame::RestMotion;
use crate::lane::{Lane, Mat3, V3};
use crate::params::parts;
use crate::solver::ams::{AmsParams, AngularForm, IntegrityForm, Jacobian};
use glam::DVec3;

/// The softening and breaking curve of the integrity ties.
#[derive(Clone, Copy, Debug)]
pub struct NonHookean {
    /// Deflection over strand length up to which ties are elastic.
    pub elastic_limit: f64,
    /// Deflection over strand length above which ties break.
    pub breaking_point: f64,
    /// Further deflection over strand length at which ties are fully broken.
    pub breaking_width: f64,
    /// Share of the damage that heals in a substep.
    pub healing: f64,
    /// Deflection over strand length below which ties heal.
    pub healing_limit: f64,
}

/// Coefficients of a frame, in float64.
#[derive(Clone, Debug)]
pub struct FrameTerms {
    /// Substep, seconds.
    pub h: f64,
    /// Clamped particles from the root.
    pub clamped: usize,
    /// κ of edge, bend, torsion springs at the root, s⁻².
    pub k_springs: [f64; 3],
    /// κ_I at the root.
    pub k_integrity: f64,
    /// κ_α at the root.
    pub k_angular: f64,
    /// κ of altitude springs at the root.
    pub k_altitude: f64,
    /// Values at the tip over those at the root, for springs, integrity ties and angular ties.
    pub tip_scales: [f64; 3],
    /// Drag rate, s⁻¹.
    pub drag: f64,
    /// Drag along the strand over that across it.
    pub drag_along: f64,
    /// Growth of the drag rate with the relative speed, 1/m.
    pub drag_quadratic: f64,
    /// Whether drag depends on direction or speed.
    pub slender: bool,
    /// Whether tension acts implicitly across springs.
    pub tension: bool,
    /// Whether the angular tie has the edge form.
    pub angular_edge: bool,
    /// Whether the angular tie has the paper's form.
    pub angular_paper: bool,
    /// Whether the implicit part of ghost ties is κ D instead of κ I.
    pub directional: bool,
    /// Whether ghost ties compensate the weight at rest.
    pub sag_free: bool,
    /// The non-Hookean curve, if it is used.
    pub non_hookean: Option<NonHookean>,
}

impl FrameTerms {
    /// The terms of `params` for frames of `dt_secs`.
    pub fn new(params: &AmsParams, dt_secs: f64) -> Self {
        let h = dt_secs / f64::from(parts(dt_secs, params.substep_secs));
        let healing = if params.healing_secs > 0.0 { (h / params.healing_secs).min(1.0) } else { 0.0 };
        Self {
            h,
            clamped: params.clamped as usize,
            k_springs: [params.k_edge, params.k_bend, params.k_torsion],
            k_integrity: params.k_integrity,
            k_angular: params.k_angular,
            k_altitude: params.k_altitude,
            tip_scales: [params.tip_scale_springs, params.tip_scale_integrity, params.tip_scale_angular],
            drag: params.drag,
            drag_along: params.drag_along,
            drag_quadratic: params.drag_quadratic,
            slender: params.has_local_drag(),
            tension: params.jacobian == Jacobian::Tension,
            angular_edge: params.angular == AngularForm::Edge && params.k_angular > 0.0,
            angular_paper: params.angular == AngularForm::Paper && params.k_angular > 0.0,
            directional: params.integrity == IntegrityForm::Paper,
            sag_free: params.sag_free,
            non_hookean: params.non_hookean.then_some(NonHookean {
                elastic_limit: params.elastic_limit,
                breaking_point: params.breaking_point,
                breaking_width: params.breaking_width,
                healing,
                healing_limit: params.healing_limit,
            }),
        }
    }

    /// The coefficients of row `i` of `n`, for strands of relative `stiffness` and
    /// particles of relative `mass`.
    #[inline(always)]
    pub fn row<L: Lane>(&self, i: usize, n: usize, stiffness: L, mass: L) -> RowTerms<L> {
        #[expect(clippy::cast_precision_loss, reason = "particle numbers are small")]
        let fraction = i as f64 / (n - 1) as f64;
        let springs = 1.0 + (self.tip_scales[0] - 1.0) * fraction;
        let integrity = 1.0 + (self.tip_scales[1] - 1.0) * fraction;
        let angular = 1.0 + (self.tip_scales[2] - 1.0) * fraction;
        let [edge, bend, torsion] = self.k_springs;
        RowTerms {
            mass,
            springs: [
                L::from_f64(edge * springs) * stiffness,
                L::from_f64(bend * springs) * stiffness,
                L::from_f64(torsion * springs) * stiffness,
            ],
            integrity: L::from_f64(self.k_integrity * integrity) * stiffness,
            angular: L::from_f64(self.k_angular * angular) * stiffness,
            altitude: L::from_f64(self.k_altitude * springs) * stiffness,
            drag: L::from_f64(self.h * self.drag),
        }
    }
}

/// Coefficients of one row. Stiffnesses and drag are rates of particles of unit mass.
#[derive(Clone, Copy, Debug)]
pub struct RowTerms<L> {
    /// Relative mass.
    pub mass: L,
    /// κ of the springs that start at this particle.
    pub springs: [L; 3],
    /// κ_I.
    pub integrity: L,
    /// κ_α.
    pub angular: L,
    /// κ of the altitude spring that starts here.
    pub altitude: L,
    /// h c, for particles of unit mass.
    pub drag: L,
}

/// Coefficients of a substep, the same in all lanes.
#[derive(Clone, Copy, Debug)]
pub struct SubstepTerms<L> {
    /// h.
    pub h: L,
    /// h².
    pub h2: L,
    /// 1/h.
    pub inverse_h: L,
    /// Lower bound of squared lengths: the force of a collapsed spring is zero instead of infinite.
    pub tiny: L,
    /// Gravity, m/s².
    pub gravity: V3<L>,
    /// Velocity of the air, m/s.
    pub air: V3<L>,
    /// R g_head: the weight at rest, rotated with the head at the end of the substep.
    pub carried_weight: V3<L>,
    start: (Mat3<L>, V3<L>),
    end: (Mat3<L>, V3<L>),
}

impl<L: Lane> SubstepTerms<L> {
    /// The terms of a substep of `h` seconds with the rest shape at `start` and at `end`, whose
    /// `carried_weight` is the gravity that it carries, turned with it.
    #[inline(always)]
    pub fn new(
        h: f64,
        [start, end]: [&RestMotion<L>; 2],
        gravity: DVec3,
        carried_weight: V3<L>,
        air: DVec3,
    ) -> Self {
        Self {
            h: L::from_f64(h),
            h2: L::from_f64(h * h),
            inverse_h: L::from_f64(1.0 / h),
            tiny: L::from_f64(1e-24),
            gravity: V3::splat(gravity),
            air: V3::splat(air),
            carried_weight,
            start: start.map,
            end: end.map,
        }
    }

    /// A ghost's position at the start of the substep.
    #[inline(always)]
    pub fn ghost_at_start(&self, rest: V3<L>) -> V3<L> {
        self.start.1.add_mul(&self.start.0, rest)
    }

    /// A ghost's position at the end of the substep.
    #[inline(always)]
    pub fn ghost_at_end(&self, rest: V3<L>) -> V3<L> {
        self.end.1.add_mul(&self.end.0, rest)
    }
}
