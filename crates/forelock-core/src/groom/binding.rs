//! Binding of roots to the body: the triangle on which each strand grows.
//!
//! # Practice
//! A root is bound to the nearest triangle of the mesh, at any distance: a strand whose root is not
//! on the scalp (such as at a ponytail's band) is bound to the nearest point of the scalp and
//! follows it rigidly. The sign of the distance is computed from the closed mesh, so that it is
//! right beside holes and folds, where a normal would be misleading.

use rayon::prelude::*;

use super::{Groom, RootBinding};
use crate::body::{Bvh, ClosedMesh, TriMesh};

/// How well the roots of a groom fit a body.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BindingReport {
    /// Number of strands bound: all except those without particles or with a root that is not
    /// finite.
    pub bound: usize,
    /// Number of roots inside the body.
    pub inside: usize,
    /// Median distance of the roots from the surface, in metres.
    pub median_distance: f32,
    /// Largest distance of a root from the surface, in metres.
    pub max_distance: f32,
}

impl std::fmt::Display for BindingReport {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { bound, inside, median_distance, max_distance } = self;
        let (median, max) = (median_distance * 1e3, max_distance * 1e3);
        write!(
            f,
            "{bound} roots bound, {median:.2} mm off the surface (median), {max:.2} mm at most; \
             {inside} inside the body"
        )
    }
}

/// Binds every root of `groom` to the nearest triangle of `mesh`; both must be in the same space,
/// and `closed` is the closed mesh.
///
/// The result has one binding for each strand. A strand without particles, or with a root that is
/// not finite, is bound to the first triangle with infinite distance and is not counted as bound.
pub fn bind_roots(groom: &Groom, mesh: &TriMesh, closed: &ClosedMesh) -> (Vec<RootBinding>, BindingReport) {
    let bvh = Bvh::new(mesh);
    let unbound = RootBinding { triangle: 0, barycentric: [1.0, 0.0, 0.0], distance: f32::INFINITY };
    let bindings: Vec<RootBinding> = (0..groom.strand_count())
        .into_par_iter()
        .map(|strand| {
            let Some(&root) = groom.strand(strand).first() else { return unbound };
            let Some(nearest) = bvh.nearest(root) else { return unbound };
            let distance = nearest.distance_squared.sqrt();
            RootBinding {
                triangle: nearest.triangle,
                barycentric: nearest.barycentric,
                distance: if closed.contains(root) { -distance } else { distance },
            }
        })
        .collect();
    let report = report(&bindings);
    (bindings, report)
}

fn report(bindings: &[RootBinding]) -> BindingReport {
    let mut distances: Vec<f32> =
        bindings.iter().map(|b| b.distance.abs()).filter(|d| d.is_finite()).collect();
    distances.sort_unstable_by(f32::total_cmp);
    BindingReport {
        bound: distances.len(),
        inside: bindings.iter().filter(|b| b.distance < 0.0).count(),
        median_distance: distances.get(distances.len() / 2).copied().unwrap_or(0.0),
        max_distance: distances.last().copied().unwrap_or(0.0),
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::body::shapes_for_tests::cuboid;

    #[test]
    fn roots_are_bound_to_the_nearest_point_with_the_right_sign() {
        let mesh = cuboid(Vec3::ONE);
        let roots = [
            Vec3::new(1.5, 0.2, -0.3),
            Vec3::new(0.2, 0.75, 0.1),
            Vec3::new(-3.0, 0.0, 0.0),
            Vec3::new(f32::NAN, 0.0, 0.0),
        ];
        let groom = Groom::from_strands(roots.map(|r| [r, r + Vec3::Y])).unwrap();
        let (bindings, report) = bind_roots(&groom, &mesh, &ClosedMesh::new(&mesh));
        let expected =
            [(0.5, Vec3::new(1.0, 0.2, -0.3)), (-0.25, Vec3::new(0.2, 1.0, 0.1)), (2.0, Vec3::NEG_X)];
        for (binding, (distance, foot)) in bindings.iter().zip(expected) {
            let corners = mesh.corners(binding.triangle as usize);
            let point: Vec3 = corners.iter().zip(binding.barycentric).map(|(c, w)| *c * w).sum();
            assert!((point - foot).length() < 1e-6 && (binding.distance - distance).abs() < 1e-6);
        }
        assert_eq!((report.bound, report.inside), (3, 1));
        assert_eq!((report.median_distance, report.max_distance), (0.5, 2.0));
        assert_eq!(bindings[3].distance, f32::INFINITY);
    }
}
