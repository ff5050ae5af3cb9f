//! Meshes and points for the tests of this folder.

use glam::Vec3;

use super::TriMesh;

/// A closed box of `half` extents, two triangles for each face.
pub(crate) fn cuboid(half: Vec3) -> TriMesh {
    let positions = (0..8)
        .map(|i| half * (Vec3::new((i & 1) as f32, (i >> 1 & 1) as f32, (i >> 2 & 1) as f32) * 2.0 - 1.0))
        .collect();
    let quads = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let triangles = quads.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect();
    TriMesh::new(positions, triangles).unwrap()
}

/// A closed sphere of `radius` centred at the origin, poles on the y axis, one vertex for each
/// pole.
pub(crate) fn uv_sphere(radius: f32, around: u32, along: u32) -> TriMesh {
    let mut positions = vec![Vec3::Y * radius, Vec3::NEG_Y * radius];
    for ring in 1..along {
        let (sin, cos) = (std::f32::consts::PI * ring as f32 / along as f32).sin_cos();
        for spoke in 0..around {
            let (z, x) = (std::f32::consts::TAU * spoke as f32 / around as f32).sin_cos();
            positions.push(Vec3::new(sin * x, cos, sin * z) * radius);
        }
    }
    let at = |ring: u32, spoke: u32| 2 + (ring - 1) * around + spoke % around;
    let mut triangles = Vec::new();
    for s in 0..around {
        triangles.push([0, at(1, s + 1), at(1, s)]);
        triangles.push([1, at(along - 1, s), at(along - 1, s + 1)]);
        for ring in 1..along - 1 {
            triangles.push([at(ring, s), at(ring, s + 1), at(ring + 1, s)]);
            triangles.push([at(ring, s + 1), at(ring + 1, s + 1), at(ring + 1, s)]);
        }
    }
    TriMesh::new(positions, triangles).unwrap()
}

/// `count` points of an irrational lattice in the cube of half size `half`.
pub(crate) fn lattice(count: u32, half: f32) -> impl Iterator<Item = Vec3> {
    (1..=count).map(move |i| {
        let i = f64::from(i);
        let [x, y, z] =
            [0.819_172_513, 0.671_043_607, 0.549_700_478].map(|step: f64| (i * step).fract() as f32);
        (Vec3::new(x, y, z) * 2.0 - 1.0) * half
    })
}
