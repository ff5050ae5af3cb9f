//! The frame of a root, the strand in that frame, and the root's place on the head.
//!
//! # Theory
//! The encoder sees a strand at rest in the frame of its root, so that the code does not depend on
//! where the strand grows (Neuralocks, section on the strand encoder). With the unit normal n of
//! the scalp at the root and the vertical axis e_z, the frame T has the rows
//!
//! ```text
//! t_u = n×e_z / |n×e_z|   (e_x where |n×e_z| < 1e-3),   n,   t_u×n
//! ```
//!
//! and a particle at x has the local position T (x − x₀).
//!
//! The place of a root is its azimuthal equidistant projection about the crown: the distance from
//! the centre of the map is the angle from the crown over π, and the direction is that of the root
//! seen from above.
//!
//! # Practice
//! Everything here is computed once for a groom, in float64.
//!
//! # Limitations
//! Where n is nearly parallel to e_z the frame jumps to e_x, which is not perpendicular to n there:
//! T is a rotation only to the first order in the angle between n and e_z.

use crate::PARTICLES;
use glam::{DMat3, DVec3};
use std::f64::consts::PI;

/// The length in cm that becomes 1 in the inputs of the encoder.
pub const LOCAL_SCALE_CM: f64 = 10.0;

/// |n×e_z| below which the frame takes e_x for its first row.
const LEAST_TANGENT: f64 = 1e-3;

/// Why a root has no frame, local positions or coordinates.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RootFrameError {
    /// A direction is zero or not finite, so it cannot be normalised.
    #[error("the direction ({0}, {1}, {2}) has no unit vector: give a finite vector that is not zero")]
    Direction(f64, f64, f64),
    /// A strand has no particles.
    #[error("the strand has no particles: give at least its root")]
    Empty,
    /// A strand has the wrong number of particles.
    #[error("the strand has {found} particles and the encoder takes {PARTICLES}: resample it by arc length")]
    Particles {
        /// Particles of the strand.
        found: usize,
    },
    /// A particle's position is not finite.
    #[error("particle {0} of the strand is not finite")]
    Position(usize),
}

/// The frame T of a root with the outward `normal` of the scalp, of any positive length: a matrix
/// with the rows t_u, n and t_u×n.
///
/// # Errors
/// If the normal is zero or not finite.
pub fn root_frame(normal: DVec3) -> Result<DMat3, RootFrameError> {
    let n = unit(normal)?;
    let across = n.cross(DVec3::Z);
    let length = across.length();
    let t_u = if length < LEAST_TANGENT { DVec3::X } else { across / length };
    Ok(DMat3::from_cols(t_u, n, t_u.cross(n)).transpose())
}

/// The strand in the frame of its root: T (x_i − x₀) in cm for each particle, so the first is zero.
/// `points` are the particles' positions in cm, root first, and `normal` that of the scalp at the
/// root, in the same space.
///
/// # Errors
/// If there are no particles, one is not finite, or the normal is zero or not finite.
pub fn local_strand(points: &[DVec3], normal: DVec3) -> Result<Vec<DVec3>, RootFrameError> {
    let frame = root_frame(normal)?;
    let root = *points.first().ok_or(RootFrameError::Empty)?;
    if let Some(particle) = points.iter().position(|x| !x.is_finite()) {
        return Err(RootFrameError::Position(particle));
    }
    Ok(points.iter().map(|&x| frame * (x - root)).collect())
}

/// The inputs of the encoder: the local positions over [`LOCAL_SCALE_CM`], three numbers a
/// particle, root first. Arguments as in [`local_strand`].
///
/// # Errors
/// As in [`local_strand`], and if the strand does not have [`PARTICLES`] particles.
///
/// ```
/// use forelock_neural::codes::encoder_inputs;
/// use glam::DVec3;
///
/// // A straight strand of 12 cm that grows sideways, along the scalp's normal.
/// let strand: Vec<DVec3> = (0..25).map(|i| DVec3::X * 0.5 * f64::from(i)).collect();
/// let inputs = encoder_inputs(&strand, DVec3::X)?;
/// assert_eq!(inputs[72..], [0.0, 1.2, 0.0]);
/// # Ok::<(), forelock_neural::codes::RootFrameError>(())
/// ```
pub fn encoder_inputs(points: &[DVec3], normal: DVec3) -> Result<[f32; 3 * PARTICLES], RootFrameError> {
    if points.len() != PARTICLES {
        return Err(RootFrameError::Particles { found: points.len() });
    }
    let mut inputs = [0.0; 3 * PARTICLES];
    for (row, x) in inputs.chunks_exact_mut(3).zip(local_strand(points, normal)?) {
        row.copy_from_slice(&(x / LOCAL_SCALE_CM).as_vec3().to_array());
    }
    Ok(inputs)
}

/// The coordinates of a root on the head, in the unit disk: (0, 0) at the crown, radius ½ on the
/// level of the head's centre. `direction` leads from the head's centre to the root, in the axes of
/// the head (y towards the crown) and of any positive length; u grows with x, v with z.
///
/// The point opposite the crown is the whole rim of the disk; it gets (0, −1).
///
/// # Errors
/// If the direction is zero or not finite.
pub fn crown_uv(direction: DVec3) -> Result<[f64; 2], RootFrameError> {
    let d = unit(direction)?;
    let across = d.x.hypot(d.z);
    if across == 0.0 {
        return Ok(if d.y > 0.0 { [0.0, 0.0] } else { [0.0, -1.0] });
    }
    let radius = across.atan2(d.y) / PI;
    Ok([radius * (d.x / across), radius * (d.z / across)])
}

fn unit(direction: DVec3) -> Result<DVec3, RootFrameError> {
    // Scaled first, so that a length that overflows or underflows does no harm.
    let largest = direction.abs().max_element();
    if !direction.is_finite() || largest == 0.0 {
        return Err(RootFrameError::Direction(direction.x, direction.y, direction.z));
    }
    Ok((direction / largest).normalize())
}
