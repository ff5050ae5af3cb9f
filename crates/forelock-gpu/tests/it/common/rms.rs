//! How far two sets of vectors are apart.

use glam::Vec3;

/// Root mean square of the difference.
pub fn rms(a: &[[f32; 3]], b: &[[f32; 3]]) -> f64 {
    let squares = a.iter().zip(b).map(|(a, b)| f64::from(Vec3::from(*a).distance_squared(Vec3::from(*b))));
    (squares.sum::<f64>() / a.len() as f64).sqrt()
}
