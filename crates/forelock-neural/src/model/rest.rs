//! Strands at rest as the network sees them, from a groom.

use super::StrandAtRest;
use crate::PARTICLES;
use crate::network::packed::is_even;
use forelock_core::groom::{Groom, ResampleError, resample};
use glam::{DVec3, Vec3};

/// The strands of `groom` as the network sees them: resampled by arc length, but for those that are
/// the network's own ([`is_even`]); those are taken as they are.
///
/// `origin` is that of canonical space in the groom's, metres. `normals` are the scalp's outward
/// normals at the roots, one a strand, of any positive length. The head's centre is the origin of
/// canonical space.
///
/// # Errors
/// If a strand has no length, or the result does not fit into the memory.
///
/// # Panics
/// If there are fewer normals than strands.
pub fn strands_at_rest(
    groom: &Groom,
    origin: DVec3,
    normals: &[DVec3],
) -> Result<Vec<StrandAtRest>, ResampleError> {
    let resampled = resample(groom, PARTICLES)?;
    let one = |s: usize| {
        let own = groom.strand(s);
        let lengths: Vec<f64> = own.windows(2).map(|x| f64::from(x[0].distance(x[1]))).collect();
        let strand = if is_even(&lengths) { own } else { resampled.strand(s) };
        let place = |x: &Vec3| 100.0 * (x.as_dvec3() - origin);
        StrandAtRest {
            particles: std::array::from_fn(|i| place(&strand[i]).as_vec3().to_array()),
            normal: normals[s],
            direction: place(&strand[0]),
        }
    };
    Ok((0..groom.strand_count()).map(one).collect())
}
