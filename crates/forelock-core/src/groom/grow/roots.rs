//! Roots of strands on the skin, and the locks to which they belong.

use glam::{IVec3, Vec3};
use rayon::prelude::*;

use super::random::{Random, mix};
use super::{GrowError, GrowParams};
use crate::body::TriMesh;
use crate::groom::RootBinding;

/// The root of one strand.
#[derive(Clone, Copy, Debug)]
pub(super) struct Root {
    pub(super) position: Vec3,
    pub(super) normal: Vec3,
    /// Weight of the region at the root, 0 to 1.
    pub(super) weight: f32,
    pub(super) binding: RootBinding,
    pub(super) lock: Lock,
}

/// The lock of a root: the nearest of points scattered one per cell of a grid (Worley 1996, "A
/// cellular texture basis function"), so that it is found without a search over roots.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lock {
    /// Identifies the lock and seeds the random numbers that its strands share.
    pub(super) key: u64,
    /// Squared distance from the root to the lock's point, m².
    pub(super) distance_squared: f32,
}

/// Draws the roots: uniform in area times weight, stratified, in the order of the triangles.
pub(super) fn draw(mesh: &TriMesh, weights: &[f32], params: &GrowParams) -> Result<Vec<Root>, GrowError> {
    let vertices = mesh.positions.len();
    if weights.len() != vertices {
        return Err(GrowError::WeightCount { expected: vertices, found: weights.len() });
    }
    if let Some(vertex) = weights.iter().position(|w| !(0.0..=1.0).contains(w)) {
        return Err(GrowError::Weight { vertex, value: weights[vertex] });
    }
    if let Some(triangle) = mesh.triangles.iter().position(|t| t.iter().any(|&v| v as usize >= vertices)) {
        return Err(GrowError::Triangle(triangle));
    }
    let mut total = 0.0f64;
    let cumulative: Vec<f64> = (0..mesh.triangles.len())
        .map(|triangle| {
            let [a, b, c] = mesh.corners(triangle);
            let weight: f32 = mesh.triangles[triangle].iter().map(|&v| weights[v as usize]).sum();
            total += f64::from((b - a).cross(c - a).length()) * f64::from(weight);
            total
        })
        .collect();
    if !(total > 0.0 && total.is_finite()) {
        return Err(GrowError::EmptyRegion);
    }
    let normals = mesh.vertex_normals();
    let root = |strand: u32| {
        let mut random = Random::new(params.seed, 2 * u64::from(strand));
        let at = total * (f64::from(strand) + f64::from(random.unit())) / f64::from(params.strands);
        let triangle = cumulative.partition_point(|&sum| sum <= at).min(cumulative.len() - 1);
        let (r, q) = (random.unit().sqrt(), random.unit());
        let barycentric = [1.0 - r, r * (1.0 - q), r * q];
        let corners = mesh.triangles[triangle].map(|v| v as usize);
        let position = blend(barycentric, corners.map(|v| mesh.positions[v]));
        Root {
            position,
            normal: blend(barycentric, corners.map(|v| normals[v])).normalize_or(Vec3::Y),
            weight: (0..3).map(|i| barycentric[i] * weights[corners[i]]).sum(),
            binding: RootBinding { triangle: triangle as u32, barycentric, distance: 0.0 },
            lock: nearest_lock(position, params),
        }
    };
    Ok((0..params.strands).into_par_iter().map(root).collect())
}

/// The bounding box of the triangles of the region.
pub(super) fn bounds(mesh: &TriMesh, weights: &[f32]) -> (Vec3, Vec3) {
    let vertices = mesh.triangles.iter().flatten().filter(|&&v| weights[v as usize] > 0.0);
    let positions = vertices.map(|&v| mesh.positions[v as usize]);
    positions.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)))
}

fn blend(barycentric: [f32; 3], [a, b, c]: [Vec3; 3]) -> Vec3 {
    a * barycentric[0] + b * barycentric[1] + c * barycentric[2]
}

fn nearest_lock(position: Vec3, params: &GrowParams) -> Lock {
    let scaled = position / params.lock_size;
    let home = scaled.floor();
    let mut nearest = Lock { key: 0, distance_squared: f32::INFINITY };
    for index in 0..27 {
        let offset = IVec3::new(index % 3 - 1, index / 3 % 3 - 1, index / 9 - 1);
        let cell = home.as_ivec3().wrapping_add(offset);
        let key = [cell.x, cell.y, cell.z]
            .iter()
            .fold(params.seed, |key, &c| mix(key ^ u64::from(c.cast_unsigned())));
        let point = home + offset.as_vec3() + 0.5 + 0.5 * Random::new(key, 0).cube();
        let distance_squared = (point - scaled).length_squared() * params.lock_size * params.lock_size;
        if distance_squared < nearest.distance_squared {
            nearest = Lock { key, distance_squared };
        }
    }
    nearest
}
