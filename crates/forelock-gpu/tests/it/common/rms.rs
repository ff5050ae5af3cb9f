//! How far two sets of vectors are apart.

use glam::Vec3;

/// Root mean square of the difference.
pub fn rms(a: &[[f32; 3]], b: &[[f32; 3]]) -> f64 {
    let squares = a.iter().zip(b).map(|(a, b)| f64::from(Vec3::from(*a).distance_squared(Vec3::from(*b))));
    (squares.sum::<f64>() / a.len() as f64).sqrt()
}

/// [`rms`] without the `share` of the vectors that are farthest apart.
pub fn trimmed_rms(a: &[[f32; 3]], b: &[[f32; 3]], share: f64) -> f64 {
    let squares = a.iter().zip(b).map(|(a, b)| f64::from(Vec3::from(*a).distance_squared(Vec3::from(*b))));
    let mut squares: Vec<f64> = squares.collect();
    squares.sort_by(f64::total_cmp);
    squares.truncate(((1.0 - share) * squares.len() as f64) as usize);
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}
