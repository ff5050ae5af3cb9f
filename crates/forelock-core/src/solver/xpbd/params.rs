//! Parameters of XPBD Cosserat rods.
//!
//! [`solve_rods`](crate::solver::xpbd::solve_rods) has the equations.

use crate::params::{Inextensibility, ParamsError, check};

crate::documented! {
/// Parameters of Cosserat rods under extended position-based dynamics. Stiffnesses are over the
/// unit mass, so that the motion does not depend on the mass of hair.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct XpbdParams {
    /// Stiffness against stretch and shear, k_s over mass: an edge of length l that holds N
    /// particles is longer by the share N g/(l k_s). Unit s⁻², default 2e6, range 1 to 1e12.
    pub k_stretch: f64,
    /// Stiffness against bending and twist, k_bt over mass, times the relative stiffness of the
    /// strand: the bending stiffness EI over the mass of a particle. Unit m³ s⁻², default 1, range
    /// 0 to 1e9; 0 is a chain.
    pub k_bend_twist: f64,
    /// Weight of an edge's rotation relative to that of its particles (β): large values follow the
    /// motion of an exact rod and converge slowly, small ones converge fast to a motion that is too
    /// slow. No unit, default 0.5, range 1e-3 to 100.
    pub rotation_weight: f64,
    /// Longest substep; frames are divided into as many equal ones as they take. Unit s, default
    /// 0.00016666666666666666, range 1e-5 to 1. Work spent on substeps gains more than work spent
    /// on iterations.
    pub substep_secs: f64,
    /// Passes over the constraints in a substep. Unit passes, default 1, range 1 to 1000.
    pub iterations: u32,
    /// Drag rate of particles against the air, and of rotations against the head's. Unit s⁻¹,
    /// default 2, range 0 to 1e4; 0 is a vacuum.
    pub drag: f64,
    /// The pass over edge lengths at the end of a step: "projection", "dftl", "limit" or "off".
    /// Default "projection"; "off" is the method as published.
    #[cfg_attr(feature = "serde", serde(with = "crate::solver::LengthPass"))]
    pub inextensibility: Inextensibility,
    /// Stretch, over the rest length, to which the pass "limit" shortens edges; it leaves others
    /// alone. No unit, default 0.03, range 0 to 10; 0 lets no edge stretch.
    pub max_stretch: f64,
    /// Particles that follow the head exactly, from the root. Unit particles, default 1, range 1 to
    /// 1000; with 1 the first edge bends from the head's frame, 0 is refused.
    pub clamped: u32,
    /// Distance of particles from solids at a contact. Unit m, default 0.0005, range 0 to 1; 0
    /// touches the skin.
    pub skin_thickness: f64,
    /// Largest speed at which a particle that starts a frame inside a solid is pushed out. Unit
    /// m/s, default 1, range 1e-3 to 1e6; 0 is refused.
    pub depenetration_speed: f64,
}
}

impl Default for XpbdParams {
    fn default() -> Self {
        Self {
            k_stretch: 2e6,
            k_bend_twist: 1.0,
            rotation_weight: 0.5,
            substep_secs: 1.0 / 6000.0,
            iterations: 1,
            drag: 2.0,
            inextensibility: Inextensibility::Projection,
            max_stretch: 0.03,
            clamped: 1,
            skin_thickness: 5e-4,
            depenetration_speed: 1.0,
        }
    }
}

impl XpbdParams {
    /// Checks every parameter against its range.
    ///
    /// # Errors
    /// [`ParamsError::Range`] for the first parameter out of its range.
    pub fn validate(&self) -> Result<(), ParamsError> {
        Ok(check::<Self, f64>(&[
            ("k_stretch", &[self.k_stretch]),
            ("k_bend_twist", &[self.k_bend_twist]),
            ("rotation_weight", &[self.rotation_weight]),
            ("substep_secs", &[self.substep_secs]),
            ("iterations", &[f64::from(self.iterations)]),
            ("drag", &[self.drag]),
            ("max_stretch", &[self.max_stretch]),
            ("clamped", &[f64::from(self.clamped)]),
            ("skin_thickness", &[self.skin_thickness]),
            ("depenetration_speed", &[self.depenetration_speed]),
        ])?)
    }
}
