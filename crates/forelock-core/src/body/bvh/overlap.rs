//! Boxes and segments that meet the triangles of a tree.

use glam::{DVec3, Vec3};

use super::{Bvh, Node};

/// How far outside a triangle or beyond the ends of a segment a crossing still counts, as a share
/// of their size: rounding must not let a segment slip through between two triangles.
const SLACK: f64 = 1e-5;

impl Bvh {
    /// Calls `visit` with the index of each triangle whose bounding box meets the box from `low` to
    /// `high`, metres. Boxes are triangles here: see [`Bvh::from_boxes`].
    pub fn overlapping(&self, low: Vec3, high: Vec3, mut visit: impl FnMut(u32)) {
        self.visit(apart(low, high), |slot, corners| {
            let [a, b, c] = corners;
            let meets = a.min(*b).min(*c).cmple(high).all() && a.max(*b).max(*c).cmpge(low).all();
            if meets {
                visit(self.sources[slot]);
            }
        });
    }

    /// A tree over boxes (low, high), metres, for [`Bvh::overlapping`].
    pub fn from_boxes(boxes: &[(Vec3, Vec3)]) -> Self {
        Self::from_triangles(boxes.iter().map(|(low, high)| [*low, *high, *high]).collect())
    }

    /// Appends to `shares` where the segment from `a` to `b` crosses triangles, 0 to 1; not sorted,
    /// and twice where it crosses an edge between two triangles.
    pub(in crate::body) fn crossings(&self, a: Vec3, b: Vec3, shares: &mut Vec<f32>) {
        let (from, along) = (a.as_dvec3(), (b - a).as_dvec3());
        self.visit(apart(a.min(b), a.max(b)), |_, corners| {
            shares.extend(share_of_crossing(from, along, &corners.map(|c| c.as_dvec3())));
        });
    }
}

/// Whether a box of the tree does not meet the box from `low` to `high`.
fn apart(low: Vec3, high: Vec3) -> impl Fn(&Node) -> bool {
    move |node| !(node.low.cmple(high).all() && node.high.cmpge(low).all())
}

/// Where along the segment a triangle is crossed (Möller and Trumbore 1997), with some slack.
fn share_of_crossing(from: DVec3, along: DVec3, [a, b, c]: &[DVec3; 3]) -> Option<f32> {
    let (ab, ac) = (*b - *a, *c - *a);
    let p = along.cross(ac);
    let inverse = 1.0 / ab.dot(p);
    // A segment in the plane of the triangle crosses its neighbours.
    if !inverse.is_finite() {
        return None;
    }
    let s = from - *a;
    let u = s.dot(p) * inverse;
    let q = s.cross(ab);
    let (v, share) = (along.dot(q) * inverse, ac.dot(q) * inverse);
    let crosses = u >= -SLACK && v >= -SLACK && u + v <= 1.0 + SLACK;
    (crosses && (-SLACK..=1.0 + SLACK).contains(&share)).then_some(share.clamp(0.0, 1.0) as f32)
}

#[cfg(test)]
mod tests {
    use super::super::super::shapes_for_tests::{lattice, uv_sphere};
    use super::*;

    #[test]
    fn boxes_that_meet_are_found() {
        let sizes = lattice(300, 0.2).map(Vec3::abs);
        let boxes: Vec<_> = lattice(300, 1.0).zip(sizes).map(|(p, size)| (p - size, p + size)).collect();
        let tree = Bvh::from_boxes(&boxes);
        let mut met = 0;
        for p in lattice(200, 1.1) {
            let (low, high) = (p - 0.15, p + 0.05);
            let mut found = Vec::new();
            tree.overlapping(low, high, |index| found.push(index));
            found.sort_unstable();
            let meets = |(l, h): &(Vec3, Vec3)| l.cmple(high).all() && h.cmpge(low).all();
            let expected: Vec<u32> =
                (0..).zip(&boxes).filter(|(_, own)| meets(own)).map(|(i, _)| i).collect();
            met += expected.len();
            assert_eq!(found, expected);
        }
        assert!(met > 300, "{met}");
        Bvh::from_boxes(&[]).overlapping(Vec3::ZERO, Vec3::ONE, |_| panic!("there is nothing"));
    }

    #[test]
    fn segments_from_inside_to_outside_cross() {
        let ball = Bvh::new(&uv_sphere(1.0, 24, 12));
        let mut shares = Vec::new();
        // Some of them run through vertices and edges.
        for to in lattice(500, 1.0).chain([Vec3::X, Vec3::Y, Vec3::Z]) {
            shares.clear();
            ball.crossings(Vec3::ZERO, to.normalize() * 2.0, &mut shares);
            assert!(!shares.is_empty() && shares.iter().all(|share| (0.46..=0.501).contains(share)));
            shares.clear();
            ball.crossings(Vec3::ZERO, to.normalize() * 0.9, &mut shares);
            assert!(shares.is_empty());
        }
    }
}
