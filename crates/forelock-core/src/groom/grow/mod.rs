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
//! strands grow, they are moved around the solid, so that no particle is inside and every edge
//! keeps its length. Locks are a second pass: each strand follows, edge by edge, a weighted mean of
//! itself and the strand in the middle of its lock.
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
use crate::body::{Head, TriMesh};
use crate::memory::{self, MemoryError};
use crate::meter::Meter;
use crate::params::{OutOfRange, Range};
use roots::Root;
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
    params.check()?;
    let particles = u64::from(params.strands) * u64::from(params.vertices_per_strand);
    if u32::try_from(particles).is_err() {
        return Err(GroomError::TooManyParticles(usize::try_from(particles).unwrap_or(usize::MAX)).into());
    }
    // Positions before and after strands are clumped, and widths.
    let each = 2 * size_of::<Vec3>() + size_of::<f32>();
    memory::check("growth", particles, each as u64, "lower the number of strands or of their particles")?;
    let roots = roots::draw(mesh, weights, params)?;
    let (low, high) = roots
        .iter()
        .fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(l, h), r| (l.min(r.position), h.max(r.position)));
    let field = Field { params, avoid, low, high };
    let vertices = params.vertices_per_strand as usize;
    let mut positions = vec![Vec3::ZERO; roots.len() * vertices];
    meter.begin("growing", roots.len() as u64);
    let traits: Vec<Traits> = positions
        .par_chunks_mut(vertices)
        .zip(&roots)
        .enumerate()
        .map(|(strand, (out, root))| {
            let traits = field.traits(strand, root);
            field.grow(root, &traits, out);
            meter.add(1);
            cut(&field, root, traits, out)
        })
        .collect();
    if params.clump > 0.0 {
        positions = clump_locks(&field, &roots, &traits, &positions);
    }
    let offsets = (0..=params.strands).map(|strand| strand * params.vertices_per_strand).collect();
    let mut groom = Groom::new(positions, offsets)?;
    let taper = |i: usize| params.width * (1.0 - 2.0 / 3.0 * (i % vertices) as f32 / (vertices - 1) as f32);
    groom.widths = Some((0..groom.particle_count()).map(taper).collect());
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
    let keep_out = head.keep_out(params.region);
    grow_watched(&head.mesh, head.weights(params.region), params, Some(&keep_out), meter)
}

/// Shortens the edges of a strand that crosses the cut and grows it again, so that its tip is near
/// the cut.
fn cut(field: &Field, root: &Root, mut traits: Traits, out: &mut [Vec3]) -> Traits {
    let p = field.params;
    if p.cut == 0.0 {
        return traits;
    }
    let middle = 0.5 * (field.low.x + field.high.x);
    let height = field.high.y - p.cut * (field.high.y - field.low.y);
    let over = |x: &Vec3| x.y - (height + p.cut_slope * (x.x - middle));
    let variation = traits.step / p.step;
    let edges = (out.len() - 1) as f32;
    for _ in 0..2 {
        let Some(crossing) = (1..out.len()).find(|&i| over(&out[i]) < 0.0) else { break };
        let (before, after) = (over(&out[crossing - 1]), over(&out[crossing]));
        let kept = (crossing - 1) as f32 + (before / (before - after)).clamp(0.0, 1.0);
        // Half of the strand's variation in length is kept, so that the tips do not form a straight
        // line.
        let share = (kept / edges * (0.5 + 0.5 * variation)).max(0.05);
        traits.step *= share.min(1.0);
        field.grow(root, &traits, out);
    }
    traits
}

/// Moves strands towards the middle strand of their lock, increasingly towards the tip.
fn clump_locks(field: &Field, roots: &[Root], traits: &[Traits], grown: &[Vec3]) -> Vec<Vec3> {
    let vertices = field.params.vertices_per_strand as usize;
    let mut order: Vec<u32> = (0..field.params.strands).collect();
    order.par_sort_unstable_by(|&a, &b| {
        let (x, y) = (&roots[a as usize].lock, &roots[b as usize].lock);
        x.key.cmp(&y.key).then(x.distance_squared.total_cmp(&y.distance_squared)).then(a.cmp(&b))
    });
    let mut middle = vec![0u32; roots.len()];
    for lock in order.chunk_by(|&a, &b| roots[a as usize].lock.key == roots[b as usize].lock.key) {
        let chosen = lock.iter().find(|&&s| !traits[s as usize].stray).unwrap_or(&lock[0]);
        for &strand in lock {
            middle[strand as usize] = *chosen;
        }
    }
    let mut clumped = grown.to_vec();
    clumped.par_chunks_mut(vertices).enumerate().for_each(|(strand, out)| {
        let leader = middle[strand] as usize;
        let traits = &traits[strand];
        if traits.stray || leader == strand {
            return;
        }
        for i in 1..vertices {
            let fraction = i as f32 / (vertices - 1) as f32;
            let share = field.params.clump * fraction * (2.0 - fraction);
            let wanted = out[i].lerp(grown[leader * vertices + i], share);
            out[i] = field.advance(out[i - 1], wanted, traits, traits.step * i as f32).0;
        }
    });
    clumped
}
