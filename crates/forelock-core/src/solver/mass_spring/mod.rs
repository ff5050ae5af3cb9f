//! Plain mass-spring strands: the baseline for comparisons with the augmented model.
//!
//! # Theory
//! Selle, Lentine, Fedkiw (2008), A mass spring model for hair simulation: strands have edge, bend,
//! torsion and altitude springs only, and no ties to a rest shape. Springs between the points of a
//! straight line resist neither twist nor, to first order, bending. So a virtual particle is added
//! off the line between every two particles of the groom: N particles become a chain of 2N − 1
//! particles in which no four consecutive ones are coplanar. Altitude springs keep these tetrahedra
//! from turning inside out. The chain is an AMS strand without ghost ties, with the same band
//! matrix of half-width 3 (AMS, Sec. 3.1 and Fig. 2).
//!
//! # Practice
//! The solver refines the strands and then runs AMS with [`MassSpringParams::ams`]. The direction
//! of a virtual particle is chosen among eight directions around its edge: the one for which the
//! tetrahedra that it completes are the thickest. On a straight strand each direction is a quarter
//! turn from the one before, so the chain winds evenly. Output positions contain the groom's
//! particles; a snapshot contains the whole chain.
//!
//! # Limitations
//! Stiffness is per mass and every particle has the same mass, so a chain with virtual particles
//! has nearly twice the mass and twice the springs. The reduced mass of virtual particles and the
//! stiffening over time of the paper are not implemented. Strands sag, because nothing compensates
//! their weight.

use super::ams::{AmsParams, AngularForm, Jacobian};
use crate::frame::{
    BlockReport, Channels, FrameContext, FrameRules, LaneSolver, Refinement, SolverReal, Step, StepCheck,
    StepRate, StrandSolver,
};
use crate::lane::Real;
use crate::params::{Inextensibility, ParamsError, check};
use crate::strands::{BlockView, Scratch, Strands};
use glam::DVec3;
use std::any::Any;

crate::documented! {
/// Parameters of plain mass-spring strands.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct MassSpringParams {
    /// Edge spring stiffness over mass, particles i and i+1 of the chain. Unit s⁻², default 1e6,
    /// range 0 to 1e12; 0 switches it off.
    pub k_edge: f64,
    /// Bend spring stiffness over mass, particles i and i+2 of the chain. Unit s⁻², default 1e6,
    /// range 0 to 1e12; 0 switches it off.
    pub k_bend: f64,
    /// Torsion spring stiffness over mass, particles i and i+3 of the chain. Unit s⁻², default 1e6,
    /// range 0 to 1e12; 0 switches it off.
    pub k_torsion: f64,
    /// Altitude spring stiffness over mass, across the tetrahedra of four consecutive particles of
    /// the chain. Unit s⁻², default 1e6, range 0 to 1e12; 0 switches it off.
    pub k_altitude: f64,
    /// Stiffness at the tip over stiffness at the root, linear along the strand, for all springs.
    /// No unit, default 1, range 0 to 1; 0 leaves the tip free.
    pub tip_scale_springs: f64,
    /// Whether virtual particles are added between the particles of the groom. Default true.
    pub virtual_particles: bool,
    /// Distance of a virtual particle from the middle of its edge, over the edge's length. No unit,
    /// default 0.25, range 0.01 to 1.
    pub virtual_offset: f64,
    /// Drag rate against the air. Unit s⁻¹, default 2, range 0 to 1e4; 0 is a vacuum.
    pub drag: f64,
    /// Particles of the groom that follow the head exactly, from the root; virtual particles
    /// between them do so too. Unit particles, default 2, range 1 to 1000; 1 makes the root a
    /// hinge, 0 is refused.
    pub clamped: u32,
    /// Longest substep, 1/240 s by default; frames and steps are divided into as many equal ones as
    /// they take. Unit s, default 0.004166666666666667, range 1e-5 to 1.
    pub substep_secs: f64,
    /// How springs enter the matrix: "tension" or "paper". Default "tension".
    pub jacobian: Jacobian,
    /// The pass that restores edge lengths: "projection", "dftl", "limit" or "off". Default
    /// "limit".
    #[cfg_attr(feature = "serde", serde(with = "crate::solver::LengthPass"))]
    pub inextensibility: Inextensibility,
    /// Stretch, over the rest length, to which the pass "limit" shortens edges; it leaves others
    /// alone. No unit, default 0.03, range 0 to 10; 0 lets no edge stretch.
    pub max_stretch: f64,
    /// Distance of particles from solids at a contact. Unit m, default 0.0005, range 0 to 1; 0
    /// touches the skin.
    pub skin_thickness: f64,
    /// Largest speed at which a particle that starts a frame inside a solid is pushed out. Unit
    /// m/s, default 1, range 1e-3 to 1e6; 0 is refused.
    pub depenetration_speed: f64,
}
}

impl Default for MassSpringParams {
    fn default() -> Self {
        let ams = AmsParams::default();
        Self {
            k_edge: ams.k_edge,
            k_bend: ams.k_bend,
            k_torsion: ams.k_torsion,
            k_altitude: 1e6,
            tip_scale_springs: ams.tip_scale_springs,
            virtual_particles: true,
            virtual_offset: 0.25,
            drag: ams.drag,
            clamped: ams.clamped,
            substep_secs: ams.substep_secs,
            jacobian: ams.jacobian,
            inextensibility: Inextensibility::Limit,
            max_stretch: ams.max_stretch,
            skin_thickness: ams.skin_thickness,
            depenetration_speed: ams.depenetration_speed,
        }
    }
}

impl MassSpringParams {
    /// Parameters of the augmented model with the same springs and without ghost ties.
    pub fn ams(&self) -> AmsParams {
        AmsParams {
            k_edge: self.k_edge,
            k_bend: self.k_bend,
            k_torsion: self.k_torsion,
            k_integrity: 0.0,
            k_angular: 0.0,
            k_altitude: self.k_altitude,
            tip_scale_springs: self.tip_scale_springs,
            drag: self.drag,
            // c particles of the groom and the c − 1 between them. 0 stays 0, which is refused.
            clamped: if self.virtual_particles {
                self.clamped.saturating_mul(2).saturating_sub(1)
            } else {
                self.clamped
            },
            substep_secs: self.substep_secs,
            jacobian: self.jacobian,
            angular: AngularForm::Off,
            sag_free: false,
            inextensibility: self.inextensibility,
            max_stretch: self.max_stretch,
            skin_thickness: self.skin_thickness,
            depenetration_speed: self.depenetration_speed,
            ..AmsParams::default()
        }
    }

    /// Checks every parameter against its range.
    ///
    /// # Errors
    /// [`ParamsError::Range`] for the first parameter out of its range.
    pub fn validate(&self) -> Result<(), ParamsError> {
        AmsParams { clamped: self.clamped, ..self.ams() }.validate()?;
        Ok(check::<Self, f64>(&[("virtual_offset", &[self.virtual_offset])])?)
    }
}

/// Runs as [`AmsParams`] without ties to the rest shape, on the refined strands.
impl<T: SolverReal> StrandSolver<T> for MassSpringParams {
    fn name(&self) -> &'static str {
        "mass-spring"
    }

    fn rules(&self) -> FrameRules {
        LaneSolver::rules(&self.ams())
    }

    fn channels(&self) -> Channels {
        Channels::default()
    }

    fn rate(&self) -> StepRate {
        self.ams().rate()
    }

    fn validate(&self) -> Result<(), ParamsError> {
        Self::validate(self)
    }

    fn validate_step(&self, step: &StepCheck) -> Result<(), ParamsError> {
        self.ams().validate_step(step)
    }

    fn refinement(&self) -> Option<Refinement> {
        self.virtual_particles.then_some(Refinement { every: EVERY, offset: self.virtual_offset })
    }

    fn refine(&self, strands: &Strands<'_, T>, refinement: &Refinement) -> Vec<[T; 3]> {
        with_virtual_particles(strands, refinement.offset)
    }

    fn advance(
        &self,
        cx: &FrameContext<'_, T>,
        steps: &[Step],
        view: &mut BlockView<'_, T>,
        live: usize,
        scratch: &mut Scratch<T>,
    ) -> BlockReport {
        self.ams().advance(cx, steps, view, live, scratch)
    }

    fn params(&self) -> &dyn Any {
        self
    }
}

crate::solver_from_params!(MassSpringParams);

/// The chains of 2N − 1 particles of strands of N.
fn with_virtual_particles<T: Real>(strands: &Strands<'_, T>, offset: f64) -> Vec<[T; 3]> {
    let mut positions = Vec::with_capacity(2 * strands.positions.len());
    let mut points = Vec::new();
    for ends in strands.offsets.windows(2) {
        let strand = &strands.positions[ends[0] as usize..ends[1] as usize];
        points.clear();
        points.extend(strand.iter().map(|p| DVec3::from(p.map(|x| x.to_f64().unwrap_or(f64::NAN)))));
        let between = virtual_particles(&points, offset);
        for (i, &point) in strand.iter().enumerate() {
            positions.push(point);
            positions.extend(between.get(i).map(|p| p.to_array().map(crate::strands::number::<T>)));
        }
    }
    positions
}

/// Every `EVERY`-th particle of a chain is from the groom; the others are virtual.
const EVERY: u32 = 2;

/// Candidate directions of a virtual particle around its edge.
const DIRECTIONS: usize = 8;

/// The N − 1 virtual particles between `points`, each at a distance of `offset` times its edge's
/// length from the edge's middle.
fn virtual_particles(points: &[DVec3], offset: f64) -> Vec<DVec3> {
    let mut chosen: Vec<DVec3> = Vec::with_capacity(points.len());
    let (mut normal, mut turn) = (None, 0);
    for (k, edge) in points.windows(2).enumerate() {
        let along = edge[1] - edge[0];
        let tangent = along.normalize();
        // An approximation of parallel transport (Bishop 1975): removes the component along the
        // tangent.
        let carried = normal.unwrap_or_else(|| tangent.any_orthonormal_vector());
        let n =
            carried.reject_from(tangent).try_normalize().unwrap_or_else(|| tangent.any_orthonormal_vector());
        let b = tangent.cross(n);
        normal = Some(n);
        let place = |turn: usize| {
            #[expect(clippy::cast_precision_loss, reason = "one of eight")]
            let (sin, cos) = (std::f64::consts::TAU * turn as f64 / DIRECTIONS as f64).sin_cos();
            edge[0] + 0.5 * along + offset * along.length() * (cos * n + sin * b)
        };
        // The quarter turn from the last direction comes first; on a straight strand it is chosen.
        let mut best = (f64::NEG_INFINITY, 0);
        for step in 0..DIRECTIONS {
            let candidate = (turn + DIRECTIONS / 4 + step) % DIRECTIONS;
            let thickness = thickness(points, k, chosen.last(), place(candidate)) / along.length();
            if thickness > best.0 + 1e-3 * offset {
                best = (thickness, candidate);
            }
        }
        turn = best.1;
        chosen.push(place(turn));
    }
    chosen
}

/// The thickness of the tetrahedra around the virtual particle `p` of edge `k`, metres: the least
/// of the heights over the planes through the three particles before it and around it, and of the
/// distance of `p` from the line of the next edge.
fn thickness(points: &[DVec3], k: usize, before: Option<&DVec3>, p: DVec3) -> f64 {
    let (a, b) = (points[k], points[k + 1]);
    let mut least = f64::INFINITY;
    if let Some(&q) = before {
        for plane in [[points[k - 1], q, a], [q, a, b]] {
            let normal = (plane[1] - plane[0]).cross(plane[2] - plane[0]);
            least = least.min((p - a).dot(normal.normalize_or_zero()).abs());
        }
    }
    if let Some(&c) = points.get(k + 2) {
        least = least.min((p - b).reject_from((c - b).normalize_or(DVec3::X)).length());
    }
    least
}

#[cfg(test)]
mod tests;
