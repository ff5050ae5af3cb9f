//! Frames transported along a strand.

use crate::lane::{Lane, V3};
use glam::DVec3;

/// The frame of a particle: the direction t of the edge before it, a unit vector n across it, and t
/// × n.
///
/// # Theory
/// The frame after an edge is the frame before it, rotated by the smallest rotation that aligns the
/// tangents: F_i = F_{i−1} ⊗ arc(e₁, F_{i−1}⁻¹ t_i), which in world axes is the arc from t_{i−1} to
/// t_i (parallel transport, Bishop 1975). It maps n to its mirror image in the plane normal to s =
/// t_{i−1} + t_i,
///
/// ```text
/// n′ = n − 2 (n·s)/(s·s) s
/// ```
///
/// since n is normal to t_{i−1}. A reflection preserves lengths for any s, so rounding errors do
/// not accumulate. Where an edge is opposite to the edge before it (s = 0), n does not change.
#[derive(Clone, Copy, Debug)]
pub struct StrandFrame<L> {
    /// Direction of the edge.
    pub tangent: V3<L>,
    /// Unit vector across it.
    pub normal: V3<L>,
}

impl<L: Lane> StrandFrame<L> {
    /// The frame of a strand's root, the arc from the first axis to `tangent`: F₀ = arc(e₁, X₁ −
    /// X₀).
    #[inline(always)]
    pub fn at_root(tangent: V3<L>) -> Self {
        Self { tangent: V3::splat(DVec3::X), normal: V3::splat(DVec3::Y) }.turned_to(tangent)
    }

    /// The frame transported to the next edge, of direction `tangent`.
    #[inline(always)]
    #[must_use]
    pub fn turned_to(self, tangent: V3<L>) -> Self {
        let s = self.tangent + tangent;
        let share = self.normal.dot(s) / s.dot(s).max(L::from_f64(1e-24));
        Self { tangent, normal: self.normal.add_scaled(-(share + share), s) }
    }

    /// Rotates a vector from the frame to world axes.
    #[inline(always)]
    pub fn world(&self, local: V3<L>) -> V3<L> {
        let binormal = self.tangent.cross(self.normal);
        let [t, n, b] = local.0;
        self.tangent.scale(t).add_scaled(n, self.normal).add_scaled(b, binormal)
    }

    /// Rotates a vector from world axes to the frame.
    #[inline(always)]
    pub fn local(&self, world: V3<L>) -> V3<L> {
        let binormal = self.tangent.cross(self.normal);
        V3([self.tangent.dot(world), self.normal.dot(world), binormal.dot(world)])
    }
}

/// The edges of a strand through `points` at rest, each in the frame of the particle before it
/// (r_i, \[P\]). The first entry, which has no edge, is the normal of the root's frame.
pub fn rest_edges(points: &[DVec3]) -> Vec<DVec3> {
    let Some(first) = points.windows(2).next() else { return Vec::new() };
    let direction = |edge: DVec3| V3::splat(edge.normalize_or(DVec3::X));
    let mut frame = StrandFrame::<f64>::at_root(direction(first[1] - first[0]));
    let mut edges = vec![DVec3::from_array(frame.normal.0)];
    for ends in points.windows(2) {
        let edge = ends[1] - ends[0];
        edges.push(DVec3::from_array(frame.local(V3::splat(edge)).0));
        frame = frame.turned_to(direction(edge));
    }
    edges
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    #[test]
    fn transport_agrees_with_quaternions() {
        let edges = [
            DVec3::new(0.3, -0.8, 0.2),
            DVec3::new(-0.9, -0.1, 0.4),
            DVec3::new(0.9, 0.1, -0.38),
            DVec3::new(0.01, 0.02, 1.0),
        ];
        let mut q = DQuat::from_rotation_arc(DVec3::X, edges[0].normalize());
        let mut frame = StrandFrame::<f64>::at_root(V3::splat(edges[0].normalize()));
        for edge in edges {
            let direction = edge.normalize();
            q *= DQuat::from_rotation_arc(DVec3::X, (q.inverse() * direction).normalize());
            frame = frame.turned_to(V3::splat(direction));
            let v = DVec3::new(0.2, 0.5, -0.7);
            let (a, b) = (q * v, DVec3::from_array(frame.world(V3::splat(v)).0));
            assert!((a - b).length() < 1e-12, "{a} {b}");
            assert!((DVec3::from_array(frame.local(V3::splat(b)).0) - v).length() < 1e-12);
        }
    }

    #[test]
    fn the_frame_stays_orthonormal_where_an_edge_reverses() {
        let frame = StrandFrame::<f64>::at_root(V3::splat(-DVec3::X));
        let [n, t] = [frame.normal, frame.tangent].map(|v| DVec3::from_array(v.0));
        assert!((n.length() - 1.0).abs() < 1e-15 && n.dot(t).abs() < 1e-15);
        let back = frame.turned_to(V3::splat(DVec3::X));
        assert_eq!(back.normal.0, frame.normal.0);
    }
}
