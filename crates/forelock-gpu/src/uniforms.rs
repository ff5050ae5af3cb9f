//! The structs that kernels share. A test compares each with its WGSL counterpart, field by field.

use crate::kernel::Constant;
use bytemuck::{Pod, Zeroable};
use forelock_core::frame::FrameRules;
use forelock_core::params::Inextensibility;
use forelock_core::pose::Pose;
use glam::{DMat4, DVec3, Mat4, UVec2, Vec3, Vec4};

/// Coefficients of a frame: `FrameInput` in `prelude.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct FrameUniform {
    /// κ of edge, bend and torsion springs at the root, s⁻².
    pub k_springs: Vec3,
    /// κ_I at the root.
    pub k_integrity: f32,
    /// Tip over root, for springs, integrity and angular ties.
    pub tip_scales: Vec3,
    /// κ_α at the root.
    pub k_angular: f32,
    /// m/s².
    pub gravity: Vec3,
    /// κ of altitude springs at the root.
    pub k_altitude: f32,
    /// Velocity of the air, m/s.
    pub air: Vec3,
    /// h c, for particles of unit mass.
    pub drag: f32,
    /// Substep, seconds.
    pub h: f32,
    /// 1/h.
    pub inverse_h: f32,
    /// One over the time of a frame, s⁻¹.
    pub inverse_dt: f32,
    /// Share of a length correction that the particle before loses as velocity.
    pub length_damping: f32,
    /// See [`forelock_core::solver::ams::solve_strands::FrameTerms`].
    pub elastic_limit: f32,
    /// The same.
    pub breaking_point: f32,
    /// The same.
    pub breaking_width: f32,
    /// The same.
    pub healing: f32,
    /// The same.
    pub healing_limit: f32,
    /// Clamped particles from the root.
    pub clamped: u32,
    /// [`flags`], the same bits twice: see `has` in the kernels.
    pub flags: UVec2,
    /// The clearance of a particle that has not been queried.
    pub unknown: f32,
    /// Drag along a strand over that across it.
    pub drag_along: f32,
    /// Growth of the drag with speed, times h, 1/m · s.
    pub drag_quadratic: f32,
    /// Of follow the leader, the share of a step in which global shape is restored, at the root.
    pub shape_global: f32,
    /// The same of local shape.
    pub shape_local: f32,
    /// The first at the tip over that at the root.
    pub tip_global: f32,
    /// The same of the second.
    pub tip_local: f32,
    /// Queries of solids after the first.
    pub recheck: u32,
    /// The smallest relative mass of a particle.
    pub least_mass: f32,
    /// Longest edge that `flags::LIMIT_LENGTHS` allows, over its rest length.
    pub length_limit: f32,
    /// Of rods, α̃ l² of stretch–shear constraints.
    pub stretch_compliance: f32,
    /// Of rods, α̃/L of bend–twist constraints, if [`flags::BENDS`].
    pub bend_compliance: f32,
    /// Of rods, β.
    pub rotation_weight: f32,
    /// Of rods, the share of the velocity relative to the air that a substep leaves.
    pub keep: f32,
    /// Of rods, passes over the constraints in a substep.
    pub iterations: u32,
    /// Rows per particle of the solver's channels.
    pub channel_rows: u32,
    /// Distance up to which friction holds strands in still surroundings, metres.
    pub held: f32,
    /// Unused.
    pub pad: Vec3,
}

/// Bits of [`FrameUniform::flags`].
pub mod flags {
    /// Tension acts implicitly across springs.
    pub const TENSION: u32 = 1;
    /// The edge form's angular tie.
    pub const ANGULAR_EDGE: u32 = 1 << 1;
    /// The paper's angular tie.
    pub const ANGULAR_PAPER: u32 = 1 << 2;
    /// The ghost ties' implicit part is κ D instead of κ I.
    pub const DIRECTIONAL: u32 = 1 << 3;
    /// Ghosts carry the weight.
    pub const SAG_FREE: u32 = 1 << 4;
    /// Ties soften and break.
    pub const NON_HOOKEAN: u32 = 1 << 5;
    /// Lengths are restored by dynamic follow the leader, not by projection.
    pub const FOLLOW_THE_LEADER: u32 = 1 << 6;
    /// Collisions are resolved level by level.
    pub const LEVEL_SOLIDS: u32 = 1 << 7;
    /// Drag differs along a strand, or with speed.
    pub const SLENDER: u32 = 1 << 8;
    /// The air is not the same everywhere.
    pub const WIND: u32 = 1 << 9;
    /// Particles have masses.
    pub const MASSES: u32 = 1 << 10;
    /// Lengths are only limited.
    pub const LIMIT_LENGTHS: u32 = 1 << 11;
    /// Rods resist bending and twist.
    pub const BENDS: u32 = 1 << 12;
    /// Strands have motions of their own, relative to the head.
    pub const ROOT_FRAMES: u32 = 1 << 13;
    /// There are integrity ties.
    pub const INTEGRITY: u32 = 1 << 14;
    /// There are altitude springs.
    pub const ALTITUDE: u32 = 1 << 15;
}

/// The same by their WGSL names.
pub const FLAGS: [Constant; 16] = [
    Constant::u32("TENSION", flags::TENSION),
    Constant::u32("ANGULAR_EDGE", flags::ANGULAR_EDGE),
    Constant::u32("ANGULAR_PAPER", flags::ANGULAR_PAPER),
    Constant::u32("DIRECTIONAL", flags::DIRECTIONAL),
    Constant::u32("SAG_FREE", flags::SAG_FREE),
    Constant::u32("NON_HOOKEAN", flags::NON_HOOKEAN),
    Constant::u32("FOLLOW_THE_LEADER", flags::FOLLOW_THE_LEADER),
    Constant::u32("LEVEL_SOLIDS", flags::LEVEL_SOLIDS),
    Constant::u32("SLENDER", flags::SLENDER),
    Constant::u32("WIND", flags::WIND),
    Constant::u32("MASSES", flags::MASSES),
    Constant::u32("LIMIT_LENGTHS", flags::LIMIT_LENGTHS),
    Constant::u32("BENDS", flags::BENDS),
    Constant::u32("ROOT_FRAMES", flags::ROOT_FRAMES),
    Constant::u32("INTEGRITY", flags::INTEGRITY),
    Constant::u32("ALTITUDE", flags::ALTITUDE),
];

/// A substep's poses: `Substep` in `prelude.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct SubstepUniform {
    /// From rest to positions at its start.
    pub start: Mat4,
    /// The same at its end.
    pub end: Mat4,
    /// The weight at rest, turned with the head at its end, m/s².
    pub carried_weight: Vec3,
    /// The particle of each strand that a kernel of one level moves.
    pub level: u32,
    /// What positions are moved by before it, metres.
    pub shift: Vec3,
    /// The share of the frame that has passed at its start.
    pub share_at_start: f32,
    /// The head's rotation at its end, x, y, z, w.
    pub rotation: Vec4,
    /// The head's angular velocity in it, s⁻¹.
    pub spin: Vec3,
    /// The share of the frame that has passed at its end.
    pub share_at_end: f32,
    /// 1 over the length of its span, s⁻¹.
    pub inverse_span: f32,
    /// Unused.
    pub pad: Vec3,
}

/// A row of a solver's channels: `ChannelRow` in `prelude.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct ChannelRowEntry {
    /// Its initial value, turned with the head at the frame's start.
    pub at_start: f32,
    /// The same at the frame's end.
    pub at_end: f32,
    /// 1 if the channel starts in this frame, else 0.
    pub starts: u32,
    /// What the channel's values are: one of [`channel_kinds`].
    pub kind: u32,
    /// Which component of a value the row is.
    pub component: u32,
}

/// Numbers of the kinds of channels.
pub mod channel_kinds {
    /// Numbers.
    pub const SCALAR: u32 = 0;
    /// Vectors.
    pub const VECTOR: u32 = 1;
    /// Rotations.
    pub const ROTATION: u32 = 2;
}

/// The same by their WGSL names.
pub const CHANNEL_KINDS: &[Constant] = &[
    Constant::u32("SCALAR", channel_kinds::SCALAR),
    Constant::u32("VECTOR", channel_kinds::VECTOR),
    Constant::u32("ROTATION_VALUE", channel_kinds::ROTATION),
];

/// A block of strands: `Block` in `prelude.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct BlockEntry {
    /// Place of its first particle within its batch.
    pub first: u32,
    /// Particles per strand.
    pub particles: u32,
    /// Lanes that hold a strand.
    pub live: u32,
    /// Samples that the grid takes of each edge.
    pub points: u32,
    /// Place of its first particle, in the whole model.
    pub place: u32,
    /// Its number, in the whole model.
    pub number: u32,
}

/// The report of frames: `Report` in `prelude.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct ReportEntry {
    /// Bits of the largest |l/l₀ − 1|.
    pub stretch: u32,
    /// Strands reset to their rest shape.
    pub quarantined: u32,
    /// Particles in contact with a solid at the last query of a frame.
    pub touching: u32,
    /// Bits of the largest remaining depth, metres.
    pub deepest: u32,
    /// Bits of the largest |l/l₀ − 1| after the lengths were restored.
    pub restored: u32,
    /// Contacts between strands in the last frame.
    pub contacts: u32,
}

/// An empty extent: smallest and largest coordinates, as integers in the order of floats.
pub(crate) const NO_EXTENT: [u32; 6] = [u32::MAX, u32::MAX, u32::MAX, 0, 0, 0];

/// The clearance of a particle that has not been queried, metres: WGSL has no infinities.
pub const UNKNOWN: f32 = -1e30;

impl FrameUniform {
    /// What all solvers share, of frames of `dt_secs` in air of velocity `air` everywhere;
    /// [`FrameUniform::in_wind`] for a field. The solver adds its coefficients.
    pub fn new(rules: &FrameRules, dt_secs: f64, gravity: DVec3, air: DVec3) -> Self {
        let h = rules.h(dt_secs);
        let single = |x: f64| x as f32;
        let on = [
            (rules.lengths == Inextensibility::FollowTheLeader, flags::FOLLOW_THE_LEADER),
            (rules.lengths == Inextensibility::Limit, flags::LIMIT_LENGTHS),
            (rules.solver_collides, flags::LEVEL_SOLIDS),
        ];
        Self {
            gravity: gravity.as_vec3(),
            air: air.as_vec3(),
            h: single(h),
            inverse_h: single(1.0 / h),
            inverse_dt: single(1.0 / dt_secs),
            length_damping: single(rules.length_damping),
            length_limit: single(1.0 + rules.max_stretch),
            clamped: rules.clamped as u32,
            unknown: UNKNOWN,
            drag_along: 1.0,
            least_mass: 1.0,
            ..Self::zeroed()
        }
        .with_flags(&on)
    }

    /// The same with the flags of those conditions that hold.
    pub(crate) fn with_flags(self, conditions: &[(bool, u32)]) -> Self {
        let flags = conditions.iter().filter(|(holds, _)| *holds).fold(0, |flags, (_, flag)| flags | flag);
        Self { flags: self.flags | flags, ..self }
    }

    /// The same for particles that have masses of at least `least`.
    pub fn with_masses(self, least: f64) -> Self {
        Self { flags: self.flags | flags::MASSES, least_mass: least as f32, ..self }
    }

    /// The same where strands have motions of their own.
    pub fn with_root_frames(self) -> Self {
        Self { flags: self.flags | flags::ROOT_FRAMES, ..self }
    }

    /// The same where the wind is a field: kernels sample it instead of `air`.
    pub fn in_wind(self) -> Self {
        Self { flags: self.flags | flags::WIND, ..self }
    }
}

/// A pose as a matrix.
pub(crate) fn rigid(pose: &Pose) -> Mat4 {
    DMat4::from_rotation_translation(pose.rotation, pose.translation).as_mat4()
}

impl SubstepUniform {
    /// From poses about the model's centre at the start and end of a substep of `h` seconds, which
    /// is a span of its own, and the shares of the frame that have passed then.
    pub fn new(
        [start, end]: [&Pose; 2],
        h: f64,
        shares: [f64; 2],
        rest_gravity: DVec3,
        shift: DVec3,
    ) -> Self {
        let turn = end.rotation * start.rotation.inverse();
        let spin = DVec3::new(turn.x, turn.y, turn.z) * (2.0 / h).copysign(turn.w);
        Self {
            start: rigid(start),
            end: rigid(end),
            carried_weight: end.transform_vector(rest_gravity).as_vec3(),
            level: 0,
            shift: shift.as_vec3(),
            share_at_start: shares[0] as f32,
            rotation: end.rotation.as_quat().into(),
            spin: spin.as_vec3(),
            share_at_end: shares[1] as f32,
            inverse_span: (1.0 / h) as f32,
            pad: Vec3::ZERO,
        }
    }
}
