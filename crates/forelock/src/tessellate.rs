//! Meshes of the primitive solids, for pictures.

use std::f64::consts::{PI, TAU};

use forelock_core::body::TriMesh;
use glam::{DVec3, Vec3};

/// Meridians of a round solid, and parallels from pole to pole.
const MERIDIANS: u32 = 48;
const PARALLELS: u32 = 24;

/// A capsule along y: all within `radius` of the segment of `half_length` to both sides of the
/// origin, in metres. With a half length of 0 it is a sphere.
pub(crate) fn capsule(half_length: f64, radius: f64) -> TriMesh {
    let mut positions = Vec::new();
    // The equator twice: at the foot of the upper cap and at the head of the lower one. A sphere's
    // two would be one line, with one normal on each side: a seam.
    let lower = PARALLELS / 2 + u32::from(half_length == 0.0);
    let rings = (0..=PARALLELS / 2).map(|k| (k, half_length));
    let rings = rings.chain((lower..=PARALLELS).map(|k| (k, -half_length)));
    for (parallel, middle) in rings {
        let (sin, cos) = (PI * f64::from(parallel) / f64::from(PARALLELS)).sin_cos();
        for meridian in 0..MERIDIANS {
            let (z, x) = (TAU * f64::from(meridian) / f64::from(MERIDIANS)).sin_cos();
            let p = DVec3::new(x * sin * radius, cos * radius + middle, z * sin * radius);
            positions.push(p.as_vec3());
        }
    }
    let mut triangles = Vec::new();
    for ring in 0..PARALLELS + PARALLELS / 2 + 1 - lower {
        for meridian in 0..MERIDIANS {
            let at = |down: u32, round: u32| (ring + down) * MERIDIANS + (meridian + round) % MERIDIANS;
            triangles.push([at(0, 0), at(0, 1), at(1, 0)]);
            triangles.push([at(0, 1), at(1, 1), at(1, 0)]);
        }
    }
    TriMesh { positions, triangles }
}

/// The box of `half` extents about the origin, in metres.
pub(crate) fn cuboid(half: Vec3) -> TriMesh {
    let mut mesh = TriMesh::default();
    for axis in 0..3 {
        for sign in [-1.0, 1.0] {
            let normal = Vec3::AXES[axis] * sign;
            let (u, v) = (Vec3::AXES[(axis + 1) % 3] * sign, Vec3::AXES[(axis + 2) % 3]);
            let first = mesh.positions.len() as u32;
            // Faces share no corners, so that each has its normals.
            for (a, b) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
                mesh.positions.push((normal + u * a + v * b) * half);
            }
            mesh.triangles.extend([[0, 1, 2], [0, 2, 3]].map(|corners| corners.map(|v| first + v)));
        }
    }
    mesh
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The volume that a closed mesh encloses; negative if its triangles face inwards.
    fn volume(mesh: &TriMesh) -> f32 {
        (0..mesh.triangles.len())
            .map(|t| {
                let [a, b, c] = mesh.corners(t);
                a.dot(b.cross(c)) / 6.0
            })
            .sum()
    }

    #[test]
    fn meshes_enclose_the_volume_of_their_solids() {
        let cuboid = volume(&cuboid(Vec3::new(1.0, 2.0, 3.0)));
        assert!((cuboid - 48.0).abs() < 1e-4, "{cuboid}");
        // 4/3 π r³ + 2 h π r², less what the facets cut off.
        let (capsule, exact) = (volume(&capsule(1.5, 1.0)), 4.18879 + 9.42478);
        assert!(capsule < exact && capsule > 0.99 * exact, "{capsule}");
        let sphere = volume(&super::capsule(0.0, 1.0));
        assert!(sphere < 4.18879 && sphere > 0.98 * 4.18879, "{sphere}");
    }

    #[test]
    fn a_sphere_has_no_seam() {
        let mut equator: Vec<_> =
            capsule(0.0, 1.0).positions.into_iter().filter(|p| p.y.abs() < 1e-6).collect();
        let points = equator.len();
        equator.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.z.total_cmp(&b.z)));
        equator.dedup_by(|a, b| a.distance(*b) < 1e-6);
        assert_eq!((points, equator.len()), (MERIDIANS as usize, MERIDIANS as usize));
    }
}
