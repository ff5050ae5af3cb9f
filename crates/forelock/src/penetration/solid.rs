//! A solid in its own space, and what is inside it.

use std::slice;

use forelock_core::body::{ColliderFrame, Depths, Shape, segment_tolerance};
use forelock_core::pose::Pose;
use glam::{DVec3, Vec3};

use super::MeasuredSolid;
use super::nearby::Span;

/// A solid in its own space.
pub(super) struct Local<'a> {
    frame: ColliderFrame<'a>,
    world_from_local: Pose,
    local_from_world: Pose,
    /// Of a mesh.
    depths: Option<Depths<'a>>,
}

impl<'a> Local<'a> {
    pub fn new(solid: &MeasuredSolid<'a>) -> Self {
        let world_from_local = solid.frame.pose(1.0);
        let depths = match (solid.frame.shape, solid.surface) {
            (Shape::Sdf(field), Some(surface)) => Some(Depths::new(field, surface, &world_from_local)),
            (Shape::Bending(field), Some(surface)) => {
                Some(Depths::new(field.end(), surface, &world_from_local))
            }
            _ => None,
        };
        Self { frame: solid.frame, world_from_local, local_from_world: world_from_local.inverse(), depths }
    }

    /// Its box in world space, (low, high) in metres, unless it has no bounds.
    pub fn world_bounds(&self) -> Option<(Vec3, Vec3)> {
        let (low, high) = self.frame.shape.bounds()?;
        let (low, high) = (low.as_dvec3(), high.as_dvec3());
        let middle = self.world_from_local.transform_point((low + high) * 0.5);
        let axes = self.world_from_local.matrix();
        let half = (high - low) * 0.5;
        let half = axes.x_axis.abs() * half.x + axes.y_axis.abs() * half.y + axes.z_axis.abs() * half.z;
        Some(((middle - half).as_vec3(), (middle + half).as_vec3()))
    }

    /// Appends the free particles of `spans` that are inside to `inside`, with their depths in
    /// metres.
    pub fn find(&self, positions: &[Vec3], spans: &[Span], inside: &mut Vec<(usize, f64)>) {
        if let Some(depths) = &self.depths {
            let free: Vec<_> = spans.iter().map(Span::free).collect();
            return depths.find(positions, &free, inside);
        }
        for particle in spans.iter().flat_map(Span::free) {
            let distance = self.distance(self.local(positions[particle]));
            if distance < 0.0 {
                inside.push((particle, -distance));
            }
        }
    }

    /// Appends the edges of `spans` that are inside to `inside`: the first particle of each,
    /// and its greatest depth in metres. An edge from a clamped particle that is inside is left
    /// out.
    pub fn find_edges(&self, positions: &[Vec3], spans: &[Span], inside: &mut Vec<(usize, f64)>) {
        let before = inside.len();
        if let Some(depths) = &self.depths {
            let ranges: Vec<_> = spans.iter().map(|span| span.all.clone()).collect();
            depths.find_edges(positions, &ranges, inside);
        } else {
            for span in spans {
                self.find_edges_of(&positions[span.all.clone()], span.all.start, inside);
            }
        }
        let rooted = spans.iter().filter(|span| span.begins_clamped);
        let rooted: Vec<usize> = rooted.map(|span| span.all.start).collect();
        let is_rooted = |edge: &usize| rooted.binary_search(edge).is_ok();
        let found = inside.split_off(before);
        let counts = |(edge, _): &(usize, f64)| !(is_rooted(edge) && self.contains(positions, *edge));
        inside.extend(found.into_iter().filter(counts));
    }

    /// Appends the edges between `points` that are inside to `inside`; the first of them has the
    /// index `first`.
    fn find_edges_of(&self, points: &[Vec3], first: usize, inside: &mut Vec<(usize, f64)>) {
        let mut before: Option<(DVec3, f64)> = None;
        for (point, edge) in points.iter().zip(first..) {
            let b = self.local(*point);
            let distance = self.distance(b);
            if let Some((a, own)) = before {
                let length = a.distance(b);
                let along = |share: f64| self.distance(a.lerp(b, share));
                let can_reach = length > own + distance;
                let depth = if can_reach { deepest_along(length, [own, distance], along) } else { 0.0 };
                if depth > 0.0 {
                    inside.push((edge - 1, depth));
                }
            }
            before = Some((b, distance));
        }
    }

    fn contains(&self, positions: &[Vec3], particle: usize) -> bool {
        match &self.depths {
            None => self.distance(self.local(positions[particle])) < 0.0,
            Some(depths) => {
                let mut inside = Vec::new();
                depths.find(positions, slice::from_ref(&(particle..particle + 1)), &mut inside);
                !inside.is_empty()
            }
        }
    }

    fn local(&self, position: Vec3) -> DVec3 {
        self.local_from_world.transform_point(position.as_dvec3())
    }

    fn distance(&self, p: DVec3) -> f64 {
        self.frame.shape.sample(p.to_array()).0
    }
}

/// The depth in metres of the deepest point of an edge of `length` metres between two points at
/// distances `ends` from a surface; `distance` is that at a share of the edge. A distance is
/// 1-Lipschitz, so a part is no deeper than half of its length less the distances of its ends.
fn deepest_along(length: f64, ends: [f64; 2], distance: impl Fn(f64) -> f64) -> f64 {
    let tolerance = segment_tolerance(length);
    let mut deepest = ends.iter().fold(0.0f64, |deepest, distance| deepest.max(-distance));
    let mut parts = vec![([0.0, 1.0], ends)];
    while let Some((shares, ends)) = parts.pop() {
        let bound = 0.5 * (length * (shares[1] - shares[0]) - ends[0] - ends[1]);
        if bound.is_finite() && bound > deepest + tolerance {
            let share = 0.5 * (shares[0] + shares[1]);
            let middle = distance(share);
            deepest = deepest.max(-middle);
            parts.push(([shares[0], share], [ends[0], middle]));
            parts.push(([share, shares[1]], [middle, ends[1]]));
        }
    }
    deepest
}
