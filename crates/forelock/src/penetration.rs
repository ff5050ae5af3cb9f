//! How much hair lies inside solids, measured on positions.

use forelock_core::body::ColliderFrame;
use glam::Vec3;
use rayon::prelude::*;

/// Depth under a surface from which a particle counts as inside, metres.
const INSIDE_M: f64 = 1e-3;

/// How particles are divided into strands.
#[derive(Clone, Copy, Debug)]
pub struct Layout<'a> {
    /// First particle of each strand, and the number of all particles, `[S + 1]`.
    pub strand_offsets: &'a [u32],
    /// Particles of each strand, from the root, that are fixed to the head.
    pub clamped: u32,
}

/// What lies inside solids.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Penetration {
    /// Share of the particles that are more than 1 mm inside a solid. Clamped particles do not
    /// count.
    pub share_inside: f64,
    /// Depth of the deepest particle, metres.
    pub deepest_m: f64,
}

/// Sums over strands.
#[derive(Clone, Copy, Default)]
struct Tally {
    inside: usize,
    all: usize,
    deepest_m: f64,
}

impl Tally {
    fn merge(self, other: Self) -> Self {
        Self {
            inside: self.inside + other.inside,
            all: self.all + other.all,
            deepest_m: self.deepest_m.max(other.deepest_m),
        }
    }
}

impl Penetration {
    /// Measures `positions` (metres, world space) against `solids` at the end of their frame.
    pub fn measure(positions: &[Vec3], layout: Layout<'_>, solids: &[ColliderFrame<'_>]) -> Self {
        let local: Vec<_> = solids.iter().map(|solid| (solid.shape, solid.pose(1.0).inverse())).collect();
        let depth = |p: &Vec3| {
            let depths = local.iter().map(|(shape, local_from_world)| {
                let p = local_from_world.transform_point(p.as_dvec3()).as_vec3().to_array();
                shape.sample_near(p, 0.0).map_or(0.0, |(distance, _)| -f64::from(distance))
            });
            depths.fold(0.0, f64::max)
        };
        let of_strand = |ends: &[u32]| {
            let free = (ends[0] + layout.clamped) as usize..ends[1] as usize;
            let free = positions.get(free).unwrap_or_default();
            free.iter().map(depth).fold(Tally { all: free.len(), ..Tally::default() }, |tally, depth| Tally {
                inside: tally.inside + usize::from(depth > INSIDE_M),
                deepest_m: tally.deepest_m.max(depth),
                ..tally
            })
        };
        let strands = layout.strand_offsets.par_windows(2).with_min_len(256).map(of_strand);
        let sum = strands.reduce(Tally::default, Tally::merge);
        Self { share_inside: sum.inside as f64 / sum.all.max(1) as f64, deepest_m: sum.deepest_m }
    }
}
