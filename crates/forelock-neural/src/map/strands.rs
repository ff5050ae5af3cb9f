//! The strands of a map.

use super::{SIDE, TEXELS, texel};
use crate::network::inference::Positions;
use crate::train::TrainingStrand;

/// Strands of a groom in the texels of a map: each has the strand whose root is nearest, so that
/// some strands are in several texels and, in dense places, some in none.
#[derive(Clone, Debug, PartialEq)]
pub struct MapStrands {
    /// The number of each texel's strand, in the order of the quadtree.
    pub(super) own: Vec<usize>,
    /// The strands at rest, cm, canonical space, one a texel.
    pub(super) rest: Vec<Positions>,
    /// Their inputs, `[texels, 66]`.
    pub(super) statics: Vec<f32>,
}

impl MapStrands {
    /// The map of `strands`, over the bounds of their roots' uv, the first two of the static
    /// inputs; nothing for no strands.
    pub fn new(strands: &[TrainingStrand]) -> Option<Self> {
        let own =
            strands_of_texels(&strands.iter().map(|s| [s.statics[0], s.statics[1]]).collect::<Vec<_>>())?;
        let rest = own.iter().map(|s| strands[*s].rest).collect();
        let statics = own.iter().flat_map(|s| strands[*s].statics.iter().copied()).collect();
        Some(Self { own, rest, statics })
    }

    /// The number of the strand in each texel, in the order of the [quadtree](texel).
    pub fn numbers(&self) -> &[usize] {
        &self.own
    }

    /// The strands at rest, cm, canonical space, one a texel.
    pub fn rest(&self) -> &[Positions] {
        &self.rest
    }

    /// The inputs of the strands, `[texels, 66]`.
    pub fn statics(&self) -> &[f32] {
        &self.statics
    }
}

/// The number of the strand whose root, of `uv`, is nearest for each texel, in the order of the
/// quadtree. The map covers the bounds of all roots.
pub(super) fn strands_of_texels(uv: &[[f32; 2]]) -> Option<Vec<usize>> {
    let bound = |of: fn(f32, f32) -> f32| {
        let both = |a: [f32; 2], b: &[f32; 2]| [of(a[0], b[0]), of(a[1], b[1])];
        uv.first().map(|first| uv.iter().fold(*first, both))
    };
    let (least, most) = (bound(f32::min)?, bound(f32::max)?);
    let place = |x: &[f32; 2], k: usize| (x[k] - least[k]) / (most[k] - least[k]).max(1e-6);
    let places: Vec<[f32; 2]> = uv.iter().map(|x| [place(x, 0), place(x, 1)]).collect();
    let mut own = vec![0; TEXELS];
    let middle = |k: usize| (k as f32 + 0.5) / SIDE as f32;
    for (u, v) in (0..SIDE).flat_map(|v| (0..SIDE).map(move |u| (u, v))) {
        let distance = |s: &usize| (places[*s][0] - middle(u)).powi(2) + (places[*s][1] - middle(v)).powi(2);
        own[texel(u, v)] = (0..uv.len()).min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
    }
    Some(own)
}
