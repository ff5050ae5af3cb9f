//! How much hair lies inside solids, measured on positions.
//!
//! # Practice
//! Depths of particles are exact: those inside primitives in closed form, those inside meshes
//! against their triangles. Depths of edges, the segments between particles, are at most 0.1 mm too
//! small ([`SEGMENT_TOLERANCE_M`]) and never too large. Boxes around the solids tell which of them
//! eight particles may touch (`nearby`), and the distance grid of a mesh which particles and
//! edges need its triangles ([`Depths`](forelock_core::body::Depths)).
//!
//! # Limitations
//! A mesh that changes (`mesh_sequence`) is measured by its grids, since between two meshes of the
//! sequence there are no triangles.
//!
//! [`SEGMENT_TOLERANCE_M`]: forelock_core::body::SEGMENT_TOLERANCE_M

mod nearby;
mod solid;
#[cfg(test)]
mod tests;

use forelock_core::body::{ClosedMesh, ColliderFrame};
use glam::Vec3;
use rayon::prelude::*;

use nearby::{Nearby, Span};
use solid::Local;

/// Depth under a surface from which a particle or an edge counts as inside, metres.
const INSIDE_M: f64 = 1e-3;

/// Strands that a thread measures at once.
const STRANDS_AT_ONCE: usize = 256;

/// How particles are divided into strands.
#[derive(Clone, Copy, Debug)]
pub struct Layout<'a> {
    /// First particle of each strand, and the number of all particles, `[S + 1]`.
    pub strand_offsets: &'a [u32],
    /// Particles of each strand, from the root, that are fixed to the head.
    pub clamped: u32,
}

/// A solid at the end of its frame.
#[derive(Clone, Copy, Debug)]
pub struct MeasuredSolid<'a> {
    /// Its shape and pose.
    pub frame: ColliderFrame<'a>,
    /// The surface of which its shape is the distance grid, if there is one.
    pub surface: Option<&'a ClosedMesh>,
}

/// What lies inside solids.
///
/// Clamped particles do not count. Edges between two of them do not either, nor does the edge from
/// a clamped particle that is inside itself, because hair grows out of the skin.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Penetration {
    /// Share of the particles that are more than 1 mm inside a solid.
    pub share_inside: f64,
    /// Depth of the deepest particle, metres.
    pub deepest_m: f64,
    /// Share of the edges that are more than 1 mm inside a solid anywhere along them.
    pub edge_share_inside: f64,
    /// Depth of the deepest point of an edge, metres.
    pub deepest_edge_m: f64,
}

/// Sums over particles, or over edges.
#[derive(Clone, Copy, Default)]
struct Tally {
    inside: usize,
    all: usize,
    deepest_m: f64,
}

impl Tally {
    /// Of what was found `inside`, with depths, one or more times; `all` were looked at.
    fn of(mut inside: Vec<(usize, f64)>, all: usize) -> Self {
        let deepest_m = inside.iter().map(|(_, depth)| *depth).fold(0.0, f64::max);
        inside.retain(|(_, depth)| *depth > INSIDE_M);
        inside.sort_unstable_by_key(|(index, _)| *index);
        inside.dedup_by_key(|(index, _)| *index);
        Self { inside: inside.len(), all, deepest_m }
    }

    fn merge(self, other: Self) -> Self {
        Self {
            inside: self.inside + other.inside,
            all: self.all + other.all,
            deepest_m: self.deepest_m.max(other.deepest_m),
        }
    }

    fn share(&self) -> f64 {
        self.inside as f64 / self.all.max(1) as f64
    }
}

impl Penetration {
    /// Measures `positions` (metres, world space) against `solids` at the end of their frame.
    pub fn measure(positions: &[Vec3], layout: Layout<'_>, solids: &[MeasuredSolid<'_>]) -> Self {
        let solids: Vec<_> = solids.iter().map(Local::new).collect();
        let nearby = Nearby::new(&solids);
        let strands = layout.strand_offsets.len().saturating_sub(1);
        let of_strands = |first: usize| {
            let ends = &layout.strand_offsets[first..=(first + STRANDS_AT_ONCE).min(strands)];
            let strands: Vec<Span> =
                ends.windows(2).filter_map(|ends| Span::of_strand(ends, layout.clamped, positions)).collect();
            let (mut particles, mut edges) = (Vec::new(), Vec::new());
            for (solid, spans) in nearby.of_strands(positions, &strands) {
                solids[solid].find(positions, &spans, &mut particles);
                solids[solid].find_edges(positions, &spans, &mut edges);
            }
            [
                Tally::of(particles, strands.iter().map(|strand| strand.free().len()).sum()),
                Tally::of(edges, strands.iter().map(|strand| strand.all.len() - 1).sum()),
            ]
        };
        let parts = (0..strands).into_par_iter().step_by(STRANDS_AT_ONCE).map(of_strands);
        let merge = |a: [Tally; 2], b: [Tally; 2]| [a[0].merge(b[0]), a[1].merge(b[1])];
        let [particles, edges] = parts.reduce(Default::default, merge);
        Self {
            share_inside: particles.share(),
            deepest_m: particles.deepest_m,
            edge_share_inside: edges.share(),
            deepest_edge_m: edges.deepest_m,
        }
    }

    /// The larger value of each of both.
    #[must_use]
    pub fn max(&self, other: &Self) -> Self {
        Self {
            share_inside: self.share_inside.max(other.share_inside),
            deepest_m: self.deepest_m.max(other.deepest_m),
            edge_share_inside: self.edge_share_inside.max(other.edge_share_inside),
            deepest_edge_m: self.deepest_edge_m.max(other.deepest_edge_m),
        }
    }
}
