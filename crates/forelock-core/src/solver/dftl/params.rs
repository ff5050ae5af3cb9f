//! Parameters of dynamic follow the leader with preserved shape.
//!
//! [`follow_leader`](crate::solver::dftl::follow_leader) has the equations.

use crate::params::{ParamsError, STATED_STEP_SECS, check};

/// How a GPU processes strands. The CPU always processes one strand a lane.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(rename_all = "kebab-case"))]
pub enum Schedule {
    /// One kernel: a thread steps its strand from root to tip and holds frames in registers, so
    /// that the state is read and written once.
    #[default]
    Fused,
    /// A kernel predicts all particles, then a thread steps its strand: the paper's strand-level
    /// parallelism.
    Strands,
    /// A kernel predicts all particles, then one dispatch per level places that level of all
    /// strands: the paper's particle-level parallelism.
    Particles,
}

crate::documented! {
/// Parameters of dynamic follow the leader with global and local shape (Sánchez-Banderas et al.
/// 2015). Shares s refer to a step of 0.016 s, as in the paper; for another step the solver uses 1
/// − (1 − s)^(step/0.016 s), which compensates the change in part.
#[derive(Clone, Debug, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct DftlParams {
    /// Fixed step, independent of the frame rate; a run takes as many steps as its frames need.
    /// Unit s, default 0.016, range 1e-4 to 1 or 0; 0 takes one step a frame, other values under
    /// 1e-4 are refused.
    pub step_secs: f64,
    /// Share of the displacement to its rest position in the head's frame that a particle makes in
    /// a step, at the root (s_g). No unit, default 0.05, range 0 to 1; 0 switches it off, above 0.1
    /// hair is stiff.
    pub shape_global: f64,
    /// Share of the displacement to its rest position in the frame of the particle before it that a
    /// particle makes in a step, at the root (s_l). No unit, default 0.2, range 0 to 1; 0 switches
    /// it off, above 0.3 hair is stiff.
    pub shape_local: f64,
    /// `shape_global` at the tip over that at the root, linear along the strand. No unit, default
    /// 0, range 0 to 1; 0 leaves the tip free.
    pub tip_scale_global: f64,
    /// `shape_local` at the tip over that at the root, linear along the strand. No unit, default 0,
    /// range 0 to 1; 0 leaves the tip free.
    pub tip_scale_local: f64,
    /// Share of each particle's corrections that is subtracted from the velocity of the particle
    /// before it (s_d). No unit, default 0.9, range 0 to 1; 0 never settles.
    pub damping: f64,
    /// Whether the weight at rest is compensated, in the head's frame, so that a groom at rest does
    /// not sag; in the paper it sags. Default false.
    pub sag_free: bool,
    /// Drag rate against the air. Unit s⁻¹, default 2, range 0 to 1e4; 0 is a vacuum.
    pub drag: f64,
    /// Particles that follow the head exactly, from the root. Unit particles, default 1, range 1 to
    /// 1000; 0 is refused.
    pub clamped: u32,
    /// Whether collisions are resolved level by level, as in the paper: thin moving solids then cut
    /// through strands, and `recheck` counts. Otherwise they are resolved after each step, along
    /// the paths of particles and edges, and strands are laid along solids at their lengths.
    /// Default false.
    pub level_collisions: bool,
    /// With `level_collisions`, repetitions of the length correction and the collision query for an
    /// edge that a solid has stretched. Unit times, default 2, range 0 to 16; 0 leaves edges
    /// stretched, as the paper does.
    pub recheck: u32,
    /// Distance of particles from solids at a contact. Unit m, default 0.0005, range 0 to 1; 0
    /// touches the skin.
    pub skin_thickness: f64,
    /// Largest speed at which a particle that starts a frame inside a solid is pushed out. Unit
    /// m/s, default 1, range 1e-3 to 1e6; 0 is refused.
    pub depenetration_speed: f64,
    /// How a GPU processes strands: "fused", "strands" or "particles". Default "fused", the
    /// fastest; the others are the paper's.
    pub schedule: Schedule,
}
}

impl Default for DftlParams {
    fn default() -> Self {
        Self {
            step_secs: STATED_STEP_SECS,
            shape_global: 0.05,
            shape_local: 0.2,
            tip_scale_global: 0.0,
            tip_scale_local: 0.0,
            damping: 0.9,
            sag_free: false,
            drag: 2.0,
            clamped: 1,
            level_collisions: false,
            recheck: 2,
            skin_thickness: 5e-4,
            depenetration_speed: 1.0,
            schedule: Schedule::default(),
        }
    }
}

impl DftlParams {
    /// Checks every parameter against its range.
    ///
    /// # Errors
    /// [`ParamsError::Range`] for the first parameter out of its range.
    pub fn validate(&self) -> Result<(), ParamsError> {
        Ok(check::<Self, f64>(&[
            ("step_secs", &[self.step_secs]),
            ("shape_global", &[self.shape_global]),
            ("shape_local", &[self.shape_local]),
            ("tip_scale_global", &[self.tip_scale_global]),
            ("tip_scale_local", &[self.tip_scale_local]),
            ("damping", &[self.damping]),
            ("drag", &[self.drag]),
            ("clamped", &[f64::from(self.clamped)]),
            ("recheck", &[f64::from(self.recheck)]),
            ("skin_thickness", &[self.skin_thickness]),
            ("depenetration_speed", &[self.depenetration_speed]),
        ])?)
    }
}
