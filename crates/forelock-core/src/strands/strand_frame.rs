//! Frames carried along a strand.

use crate::lane::{Lane, V3};
use glam::DVec3;

/// The frame of a particle: the direction t of the edge before it, a unit vector n across it, and t × n.
///
/// # Theory
/// The frame after an edge is the one before it turned as little as the edges' directions need: F_i = F_{i−1} ⊗ arc(e₁, F_{i−1}⁻¹ t_i), which in world axes is the arc from t_{i−1} to
/// t_i (parallel transport, Bishop 1975). It takes n to its mirror image across the plane normal to s = t_{i−1} + t_i,
///
/// ```text
/// n′ = n − 2 (n·s)/(s·s) s
/// ```
///
/// since n is normal to t_{i−1}; a mirror keeps lengths whatever s, so rounding does not add up. Where an edge turns back on the one before it (s = 0) n stays.
#[derive(Clone, Copy, Debug)]
pub struct StrandFrame<L> {
    /// Direction of the edge.
    pub tangent: V3<L>,
    /// Unit vector across it.
    pub normal: V3<L>,
}

impl<L: Lane> StrandFrame<L> {
    /// The frame of a strand's root, the arc from the first axis to `tangent`: F₀ = arc(e₁, X₁ − X₀).
    #[inline(always)]
    pub fn at_root(tangent: V3<L>) -> Self {
        Self { tangent: V3::splat(DVec3::X), normal: V3::splat(DVec3::Y) }.turned_to(tangent)
    }

    /// The frame turned to the next edge's direction `tangent`.
    #[inline(always)]
    #[must_use]
    pub fn turned_to(self, tangent: V3<L>) -> Self {
        let s = self.tangent + tangent;
        let share = self.normal.dot(s) / s.dot(s).max(L::from_f64(1e-24));
        Self { tangent, normal: self.normal.add_scaled(-(share + share), s) }
    }

    /// A vector of the frame in the world's axes.
    #[inline(always)]
    pub fn world(&self, local: V3<L>) -> V3<L> {
        let binormal = self.tangent.cross(self.normal);
        let [t, n, b] = local.0;
        self.tangent.scale(t).add_scaled(n, self.normal).add_scaled(b, binormal)
    }

    /// A vector of the world in the frame's axes.
    #[inline(always)]
    pub fn local(&self, world: V3<L>) -> V3<L> {
        let binormal = self.tangent.cross(self.normal);
        V3([self.tangent.dot(world), self.normal.dot(world), binormal.dot(world)])
    }
}

/// The edges of a strand through `points` at rest, each in the frame of the particle before it (r_i, \[P\]). The first entry, of which there is no edge, is the unit vector across the
/// root's frame.
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
    fn frames_turn_as_quaternions_do() {
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
    fn an_edge_that_turns_back_leaves_a_frame() {
        let frame = StrandFrame::<f64>::at_root(V3::splat(-DVec3::X));
        let [n, t] = [frame.normal, frame.tangent].map(|v| DVec3::from_array(v.0));
        assert!((n.length() - 1.0).abs() < 1e-15 && n.dot(t).abs() < 1e-15);
        let back = frame.turned_to(V3::splat(DVec3::X));
        assert_eq!(back.normal.0, frame.normal.0);
    }
}
