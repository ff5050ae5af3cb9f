//! Depths of segments under a closed surface.
//!
//! # Theory
//! Crossings with the surface divide a segment into parts that are inside or outside as a whole. A
//! point of an inside part is no deeper than it is far from any point q of the surface, and the
//! distance from q is convex along the part, so largest at one of its ends. With the q nearest to
//! its middle the bound of a part is close to its depth; parts are halved until it is within the
//! tolerance of the deepest point found.

use glam::Vec3;

use super::{ClosedMesh, Nearest};

/// The depth of a segment is at most this much too small, metres, and never too large. For segments
/// longer than 0.4 m it is the length over 4096, and far from the origin what float32 resolves.
pub const SEGMENT_TOLERANCE_M: f32 = 1e-4;

/// Roundings of a coordinate that distances are not told apart by.
const ROUNDINGS: f32 = 8.0;

/// That tolerance for a segment of `length` metres.
pub fn segment_tolerance(length: f64) -> f64 {
    f64::from(SEGMENT_TOLERANCE_M).max(length / 4096.0)
}

impl ClosedMesh {
    /// The depth in metres of the deepest point of the segment from `a` to `b`, up to
    /// [`SEGMENT_TOLERANCE_M`]; 0 if all of it is outside.
    pub fn segment_depth(&self, a: Vec3, b: Vec3) -> f32 {
        self.depth_between(a, b, &mut Vec::new(), |_| false)
    }

    /// [`ClosedMesh::segment_depth`], faster by `is_outside`, which is true of points that are
    /// known to be outside. `cuts` is scratch.
    pub(in crate::body) fn depth_between(
        &self,
        a: Vec3,
        b: Vec3,
        cuts: &mut Vec<f32>,
        is_outside: impl Fn(Vec3) -> bool,
    ) -> f32 {
        cuts.clear();
        self.surface.crossings(a, b, cuts);
        cuts.extend([0.0, 1.0]);
        cuts.sort_unstable_by(f32::total_cmp);
        let (length, parts) = (a.distance(b), cuts.len() - 1);
        let resolved = ROUNDINGS * f32::EPSILON * a.abs().max(b.abs()).max_element();
        let tolerance = resolved.max(segment_tolerance(length.into()) as f32);
        let mut search = Search { surface: self, tolerance, deepest: 0.0, hint: None };
        for part in cuts.windows(2) {
            // A part is no deeper than its length, since it begins or ends at the surface.
            if parts > 1 && (part[1] - part[0]) * length <= search.tolerance {
                continue;
            }
            let [from, to] = [part[0], part[1]].map(|share| a.lerp(b, share));
            let middle = (from + to) * 0.5;
            if !is_outside(middle) && self.contains(middle) {
                search.part(from, to);
            }
        }
        search.deepest
    }
}

/// A search for the deepest point.
struct Search<'a> {
    surface: &'a ClosedMesh,
    tolerance: f32,
    deepest: f32,
    /// The last nearest point.
    hint: Option<Nearest>,
}

impl Search<'_> {
    /// Searches the inside part from `a` to `b`.
    fn part(&mut self, a: Vec3, b: Vec3) {
        let middle = (a + b) * 0.5;
        let Some(nearest) = self.surface.nearest_from(middle, self.hint.as_ref()) else { return };
        self.deepest = self.deepest.max(nearest.distance_squared.sqrt());
        let bound = a.distance(nearest.point).max(b.distance(nearest.point));
        self.hint = Some(nearest);
        if bound > self.deepest + self.tolerance && middle != a && middle != b {
            self.part(a, middle);
            self.part(middle, b);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::shapes_for_tests::{cuboid, lattice, uv_sphere};
    use super::*;

    #[test]
    fn depths_are_those_of_dense_samples() {
        for mesh in [uv_sphere(0.1, 24, 12), cuboid(Vec3::new(0.1, 0.02, 0.05))] {
            let closed = ClosedMesh::new(&mesh);
            let (mut inside, mut through) = (0, 0);
            for (a, d) in lattice(200, 0.15).zip(lattice(207, 0.2).skip(7)) {
                let b = a + d;
                let samples = (0..=500).map(|i| closed.depth(a.lerp(b, i as f32 / 500.0)));
                let expected = samples.fold(0.0, f32::max);
                let found = closed.segment_depth(a, b);
                // The samples lie up to 0.7 mm apart.
                assert!(found <= expected + 3.5e-4, "{found}, not {expected}");
                assert!(found >= expected - SEGMENT_TOLERANCE_M, "{found}, not {expected}");
                inside += usize::from(found > 0.0);
                through += usize::from(found > 1e-3 && !closed.contains(a) && !closed.contains(b));
            }
            assert!(inside > 20 && through > 3, "{inside} {through}");
        }
    }

    #[test]
    fn far_from_the_origin_it_is_as_exact_as_float32() {
        let [from, to] = [Vec3::new(-0.2, 0.013, 0.021), Vec3::new(0.2, 0.013, 0.021)];
        let near = ClosedMesh::new(&uv_sphere(0.1, 24, 12)).segment_depth(from, to);
        for far in [100.0, 5e3, 1e6] {
            let mut mesh = uv_sphere(0.1, 24, 12);
            mesh.positions.iter_mut().for_each(|p| *p += Vec3::X * far);
            let found = ClosedMesh::new(&mesh).segment_depth(from + Vec3::X * far, to + Vec3::X * far);
            assert!(
                (found - near).abs() < 1e-3 + 16.0 * f32::EPSILON * far,
                "{found}, {near} at 0, at {far} m"
            );
        }
    }

    #[test]
    fn outside_and_beyond_all_numbers_it_is_nothing() {
        let closed = ClosedMesh::new(&uv_sphere(0.1, 24, 12));
        assert_eq!(closed.segment_depth(Vec3::X, Vec3::Y), 0.0);
        assert_eq!(closed.segment_depth(Vec3::NAN, Vec3::Y), 0.0);
        assert!(closed.segment_depth(Vec3::X * -10.0, Vec3::X * 10.0) > 0.09);
    }
}
