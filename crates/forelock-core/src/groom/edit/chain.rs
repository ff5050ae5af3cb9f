//! The representation of one strand in operations: float64 points, edges and arc lengths.

use glam::{DQuat, DVec3, Vec3};

use crate::groom::Groom;

/// A strand to be edited.
#[derive(Clone, Debug)]
pub(super) struct Chain {
    /// Index of the strand in the groom.
    pub(super) strand: usize,
    /// Particles, metres.
    pub(super) points: Vec<DVec3>,
    /// Lengths of the edges, metres.
    pub(super) lengths: Vec<f64>,
    /// Number of particles at the root that are not moved: 1 or more.
    pub(super) hold: usize,
}

impl Chain {
    /// Strand `strand` of `groom`, which must have two particles or more.
    pub(super) fn of(groom: &Groom, strand: usize) -> Self {
        let points: Vec<DVec3> = groom.strand(strand).iter().map(|p| p.as_dvec3()).collect();
        let lengths = points.windows(2).map(|w| w[0].distance(w[1])).collect();
        let pinned = groom.pinned.as_ref().map_or(1, |pinned| usize::from(pinned[strand]));
        Self { strand, points, lengths, hold: pinned.max(1) }
    }

    /// Length of the strand, metres.
    pub(super) fn length(&self) -> f64 {
        self.lengths.iter().sum()
    }

    /// Arc length from the root to each particle, metres.
    pub(super) fn arcs(&self) -> Vec<f64> {
        let mut arc = 0.0;
        let mut arcs = Vec::with_capacity(self.points.len());
        arcs.push(0.0);
        for length in &self.lengths {
            arc += length;
            arcs.push(arc);
        }
        arcs
    }

    /// Direction of each edge; zero for an edge of zero length.
    pub(super) fn directions(&self) -> Vec<DVec3> {
        self.points.windows(2).map(|w| (w[1] - w[0]).normalize_or_zero()).collect()
    }

    /// Smoothed direction of each edge: the mean over all edges within `reach` metres of arc
    /// length, with the weights (1 − (Δs/reach)²)². With a reach of 0 it is the direction of the
    /// edge alone.
    pub(super) fn smoothed_directions(&self, reach: f64) -> Vec<DVec3> {
        let directions = self.directions();
        let arcs = self.arcs();
        let middle = |edge: usize| 0.5 * (arcs[edge] + arcs[edge + 1]);
        let (mut first, edges) = (0, directions.len());
        let mut smoothed = Vec::with_capacity(edges);
        for edge in 0..edges {
            while middle(edge) - middle(first) > reach {
                first += 1;
            }
            let mut sum = DVec3::ZERO;
            let near = (first..edges).take_while(|&other| middle(other) - middle(edge) <= reach);
            for other in near {
                let away = (middle(other) - middle(edge)) / reach;
                let weight = if other == edge { 1.0 } else { falloff(away) };
                sum += directions[other] * (weight * self.lengths[other]);
            }
            smoothed.push(sum.try_normalize().unwrap_or(directions[edge]));
        }
        smoothed
    }

    /// The strand rebuilt from the particles that are not moved: the direction of each edge is
    /// `direction(edge, start of the edge)`.
    pub(super) fn rebuilt(&self, mut direction: impl FnMut(usize, DVec3) -> DVec3) -> Vec<DVec3> {
        let mut out = self.points.clone();
        for edge in self.hold - 1..self.lengths.len() {
            out[edge + 1] = out[edge] + direction(edge, out[edge]) * self.lengths[edge];
        }
        out
    }

    /// The strand moved towards `targets` by follow the leader: every particle is at its edge's
    /// length from the previous one, in the direction of its target.
    pub(super) fn following(&self, targets: &[DVec3]) -> Vec<DVec3> {
        let directions = self.directions();
        self.rebuilt(|edge, from| (targets[edge + 1] - from).try_normalize().unwrap_or(directions[edge]))
    }

    /// The point at arc length `arc` of the strand's curve, extended straight beyond the tip.
    pub(super) fn at(&self, arcs: &[f64], arc: f64) -> DVec3 {
        let edge = arcs.partition_point(|&a| a <= arc).saturating_sub(1).min(self.lengths.len() - 1);
        let along = (self.points[edge + 1] - self.points[edge]).normalize_or_zero();
        self.points[edge] + along * (arc - arcs[edge])
    }

    /// Rounds `targets` to float32: each particle is placed from the rounded position of the
    /// previous one, at the length of its edge. Particles before the first that moves keep their
    /// bits.
    pub(super) fn rounded(&self, old: &[Vec3], targets: &[DVec3]) -> Vec<Vec3> {
        let still = targets.iter().zip(&self.points).take_while(|(a, b)| a == b).count().max(1);
        let mut out = old[..still.min(old.len())].to_vec();
        for i in still..targets.len() {
            let along = (targets[i] - targets[i - 1]).normalize_or_zero();
            out.push((out[i - 1].as_dvec3() + along * self.lengths[i - 1]).as_vec3());
        }
        out
    }
}

/// A weight that is 1 at 0 and falls smoothly to 0 at 1 and beyond: (1 − x²)².
pub(super) fn falloff(x: f64) -> f64 {
    let y = (1.0 - x * x).max(0.0);
    y * y
}

/// A weight that is 0 up to 0 and rises smoothly to 1 at 1 and beyond.
pub(super) fn rise(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}

/// The fraction `share` of the rotation from direction `from` to direction `to`.
pub(super) fn turn(from: DVec3, to: DVec3, share: f64) -> DQuat {
    DQuat::IDENTITY.lerp(DQuat::from_rotation_arc(from, to), share)
}
