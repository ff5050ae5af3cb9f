//! Procedural growth of grooms on any mesh.
//!
//! # Theory
//!
//! Supplement D of the AMS paper: roots are uniformly distributed on the chosen triangles; the
//! first direction is the interpolated normal plus noise. Then, for each particle, a downward pull
//! that grows along the strand (p_γ, Eqs. 4–5) and a helix vector (p_h, p_freq, p_Ω, Eqs. 6–7)
//! change the direction, followed by a step of constant length p_τ. The parameter sheets of its
//! Figs. 13 and 14 are [`sheets`].
//!
//! # Practice
//!
//! The formula alone makes strands that stand out from the head. For combed hair, growth has
//! further parameters: a comb direction with a parting, a rate at which strands turn downwards,
//! layers over the skin, a band that gathers a ponytail, waves and curls with a wavelength and a
//! radius in metres, a level cut, locks, and stray strands. All of them are off by default. While
//! strands grow, they glide along the solid, and no particle is inside. A strand then moves towards
//! the middle strand of its lock, point by point at the same length from the root; a lock ends at
//! the parting. Last, the strand is cut and its particles are placed on it at equal distances.
//! Where hair lies on a shoulder, the cut counts its length instead of its height.
//!
//! [`grow`] works on any mesh, [`grow_on_head`] on the built-in head, for which the presets were
//! tuned.
//!
//! The same seed gives the same groom, bit for bit, on every machine and with any number of
//! threads: random numbers use integer arithmetic, and everything else uses only operations that
//! IEEE 754 defines exactly.
//!
//! # Limitations
//!
//! Strands do not interact with each other. An edge between two particles outside the solid may cut
//! a convex part of it by the edge's sagitta, l²/8R; choose a larger `margin`.

mod curve;
mod guide;
mod locks;
#[cfg(test)]
mod looks;
#[cfg(test)]
mod looks_tests;
mod params;
mod presets;
pub(crate) mod random;
mod roots;
mod sheets;
mod strand;
#[cfg(test)]
mod tests;

use glam::Vec3;
use rayon::prelude::*;

pub use params::GrowParams;
pub use presets::PRESETS;
pub use sheets::{Sheet, sheets};

use super::{Groom, GroomError};
use crate::body::{Head, Region, TriMesh};
use crate::memory::{self, MemoryError};
use crate::meter::Meter;
use crate::params::{OutOfRange, Range};
use curve::Curve;
use locks::Locks;
use strand::{Field, Traits};

/// A solid that strands avoid. The function takes a point and a reach in metres. It returns the
/// signed distance (negative inside) and its unit gradient if the distance is less than the reach,
/// and `None` otherwise.
///
/// The distance may be approximate away from the surface.
pub type Avoid<'a> = dyn Fn(Vec3, f32) -> Option<(f32, Vec3)> + Sync + 'a;

/// Why no groom was grown.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum GrowError {
    /// A parameter is out of range or NaN.
    #[error("growth parameter `{name}` must be {range}, not {value}")]
    Parameter {
        /// Name of the field.
        name: &'static str,
        /// Its value.
        value: f64,
        /// Its range.
        range: Range,
    },
    /// The number of weights differs from the number of vertices.
    #[error("the region has {found} weights, but the mesh has {expected} vertices")]
    WeightCount {
        /// Number of vertices of the mesh.
        expected: usize,
        /// Number of weights given.
        found: usize,
    },
    /// A weight is not in the range 0 to 1.
    #[error("the region's weight at vertex {vertex} must be from 0 to 1, not {value}")]
    Weight {
        /// Index of the vertex.
        vertex: usize,
        /// Its weight.
        value: f32,
    },
    /// A triangle refers to a vertex that does not exist.
    #[error("triangle {0} refers to a vertex that the mesh does not have")]
    Triangle(usize),
    /// The region has no area.
    #[error("the region to grow on is empty")]
    EmptyRegion,
    /// There is no preset of that name.
    #[error("there is no preset `{0}`; the presets are: {names}", names = PRESETS.join(", "))]
    Preset(String),
    /// The groom would be too large.
    #[error(transparent)]
    Groom(#[from] GroomError),
    /// The groom does not fit into the memory.
    #[error(transparent)]
    Memory(#[from] MemoryError),
}

impl From<OutOfRange> for GrowError {
    fn from(error: OutOfRange) -> Self {
        let OutOfRange { name, value, range } = error;
        Self::Parameter { name, value, range }
    }
}

/// Grows strands on the part of `mesh` where `weights` (one for each vertex, 0 to 1) are positive;
/// the density is proportional to the weight.
///
/// Positions are in metres in the mesh's space; root bindings and widths are filled in. `avoid` is
/// the solid that strands must not enter; without it they may pass through the mesh.
///
/// # Errors
/// [`GrowError`] if a parameter or weight is out of range, a triangle refers to a missing vertex,
/// the region is empty, or the groom does not fit into the memory.
///
/// # Example
/// ```
/// use forelock_core::body::TriMesh;
/// use forelock_core::groom::grow::{GrowParams, grow};
/// use glam::Vec3;
///
/// let mesh = TriMesh::new(vec![Vec3::ZERO, Vec3::Z, Vec3::X], vec![[0, 1, 2]]).unwrap();
/// let params = GrowParams { strands: 100, ..GrowParams::default() };
/// let groom = grow(&mesh, &[1.0; 3], &params, None).unwrap();
/// assert_eq!((groom.strand_count(), groom.particle_count()), (100, 2500));
/// ```
pub fn grow(
    mesh: &TriMesh,
    weights: &[f32],
    params: &GrowParams,
    avoid: Option<&Avoid>,
) -> Result<Groom, GrowError> {
    grow_watched(mesh, weights, params, avoid, &Meter::default())
}

/// The same as [`grow`]; `meter` counts strands.
///
/// # Errors
/// The same errors as [`grow`].
pub fn grow_watched(
    mesh: &TriMesh,
    weights: &[f32],
    params: &GrowParams,
    avoid: Option<&Avoid>,
    meter: &Meter,
) -> Result<Groom, GrowError> {
    grow_over(mesh, weights, params, [avoid, avoid], meter)
}

/// The same with two solids: the body, and a drape that contains it.
fn grow_over(
    mesh: &TriMesh,
    weights: &[f32],
    params: &GrowParams,
    [body, drape]: [Option<&Avoid>; 2],
    meter: &Meter,
) -> Result<Groom, GrowError> {
    params.check()?;
    let particles = u64::from(params.strands) * u64::from(params.vertices_per_strand);
    if u32::try_from(particles).is_err() {
        return Err(GroomError::TooManyParticles(usize::try_from(particles).unwrap_or(usize::MAX)).into());
    }
    // Positions before and after strands are clumped, and widths.
    let each = 2 * size_of::<Vec3>() + size_of::<f32>();
    memory::check("growth", particles, each as u64, "lower the number of strands or of their particles")?;
    let roots = roots::draw(mesh, weights, params)?;
    let (low, high) = roots::bounds(mesh, weights);
    let field = Field { params, body, drape, low, high };
    let traits: Vec<Traits> =
        roots.par_iter().enumerate().map(|(strand, root)| field.traits(strand, root)).collect();
    let locks = Locks::new(&field, &roots, &traits);
    let vertices = params.vertices_per_strand as usize;
    let mut positions = vec![Vec3::ZERO; roots.len() * vertices];
    meter.begin("growing", roots.len() as u64);
    positions.par_chunks_mut(vertices).enumerate().for_each_init(Curve::default, |curve, (strand, out)| {
        let (root, traits) = (&roots[strand], &traits[strand]);
        field.grow(root, traits, curve);
        let joined = locks.join(&field, strand, traits, curve);
        let end = field.cut(traits, curve);
        if joined || end < 1.0 || params.hang > 0.0 {
            curve.place(end, out);
        } else {
            out.copy_from_slice(&curve.points);
        }
        meter.add(1);
    });
    let offsets = (0..=params.strands).map(|strand| strand * params.vertices_per_strand).collect();
    let mut groom = Groom::new(positions, offsets)?;
    // Hair is finer where it grows thinly, and tapers to its tip.
    let taper = |i: usize| 1.0 - 2.0 / 3.0 * (i % vertices) as f32 / (vertices - 1) as f32;
    let fine = |i: usize| 0.3 + 0.7 * roots[i / vertices].weight;
    groom.widths = Some((0..groom.particle_count()).map(|i| params.width * taper(i) * fine(i)).collect());
    groom.bindings = Some(roots.iter().map(|root| root.binding).collect());
    Ok(groom)
}

/// Grows strands on the region of the built-in head that `params` selects. Strands avoid the head,
/// neck and shoulders; if the region is the scalp, they also leave the face free.
///
/// # Errors
/// The same errors as [`grow`].
pub fn grow_on_head(params: &GrowParams) -> Result<Groom, GrowError> {
    grow_on_head_watched(params, &Meter::default())
}

/// The same as [`grow_on_head`]; `meter` counts strands.
///
/// # Errors
/// The same errors as [`grow`].
pub fn grow_on_head_watched(params: &GrowParams, meter: &Meter) -> Result<Groom, GrowError> {
    let head = Head::builtin();
    let (body, drape) = (head.keep_out(Region::Beard), head.keep_out(params.region));
    // Short hair and hair that is pulled back do not fall over the ears.
    let length = params.step * (params.vertices_per_strand - 1) as f32;
    let falls = params.gather_radius == 0.0 && length > params.comb_length;
    let drape: &Avoid = if falls { &drape } else { &body };
    grow_over(&head.mesh, head.weights(params.region), params, [Some(&body), Some(drape)], meter)
}
