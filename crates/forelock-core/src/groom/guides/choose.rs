//! Selection of the guides, and of the guides that each strand follows.

use glam::Vec3;
use rayon::prelude::*;

use super::{GUIDES_PER_STRAND, Influence, Place};
use crate::groom::grow::random::Random;
use crate::groom::nearest::Nearest;
use crate::groom::{Groom, arc_lengths};

/// Selects `count` strands of `groom` whose roots cover it evenly: each is the one farthest from
/// those selected before it, and the first is drawn at random with `seed`.
///
/// Returns all strands in their order if there are no more than `count`.
pub fn choose_guides(groom: &Groom, count: usize, seed: u64) -> Vec<usize> {
    let strands = groom.strand_count();
    if count >= strands {
        return (0..strands).collect();
    }
    let roots: Vec<Vec3> = groom.strands().map(|s| s.first().copied().unwrap_or(Vec3::NAN)).collect();
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of the strands")]
    let mut next = ((Random::new(seed, 0).unit() * strands as f32) as usize).min(strands - 1);
    let mut distances = vec![f32::INFINITY; strands];
    let mut chosen = Vec::with_capacity(count);
    while chosen.len() < count {
        chosen.push(next);
        // A strand is never selected twice, even if all remaining roots coincide with selected
        // ones.
        distances[next] = f32::NEG_INFINITY;
        let root = roots[next];
        let farthest = |a: (f32, usize), b: (f32, usize)| {
            if a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)).is_ge() { a } else { b }
        };
        let candidates =
            distances.par_iter_mut().zip(&roots).enumerate().map(|(strand, (distance, other))| {
                *distance = distance.min(root.distance_squared(*other));
                (*distance, strand)
            });
        next = candidates.reduce(|| (f32::NEG_INFINITY, usize::MAX), farthest).1;
    }
    chosen.sort_unstable();
    chosen
}

/// The guides that a strand with its root at `root` follows, nearest first, and their weights.
pub(super) fn influence(tree: &Nearest, root: Vec3, guides: usize) -> Influence {
    let mut found = Vec::with_capacity(GUIDES_PER_STRAND + 2);
    tree.find(root, GUIDES_PER_STRAND + 1, f32::INFINITY, &mut found);
    let distance = |k: usize| found.get(k).map_or(0.0, |&(squared, _)| squared.sqrt());
    let count = GUIDES_PER_STRAND.min(guides).min(found.len());
    let farthest = distance(count - 1);
    // If there is no next guide, a reach beyond the farthest guide gives that guide a small weight.
    let reach = if found.len() > count { distance(count) } else { 1.5 * farthest };
    let mut influence = Influence::default();
    for (k, &(_, guide)) in found.iter().take(count).enumerate() {
        influence.guides[k] = guide;
        let d = distance(k);
        influence.weights[k] = if d > 0.0 { ((reach - d) / (reach * d)).powi(2) } else { f32::INFINITY };
    }
    let sum: f32 = influence.weights.iter().sum();
    if influence.weights[0].is_infinite() || !sum.is_normal() {
        // The root coincides with a guide's root, or all guides are equally far: use the nearest
        // only.
        influence.weights = [0.0; GUIDES_PER_STRAND];
        influence.weights[0] = 1.0;
        return influence;
    }
    influence.weights.iter_mut().for_each(|weight| *weight /= sum);
    influence
}

/// The fraction of the strand's length at each of its particles.
pub(super) fn fractions(strand: &[Vec3]) -> Vec<f32> {
    let arcs = arc_lengths(strand);
    let length = arcs[arcs.len() - 1];
    let last = (strand.len() - 1) as f64;
    // A strand without length is treated as evenly spaced.
    let share = |i: usize, at: f64| if length > 0.0 { at / length } else { i as f64 / last };
    #[expect(clippy::cast_possible_truncation, reason = "fractions in [0, 1]")]
    arcs.iter().enumerate().map(|(i, at)| share(i, *at) as f32).collect()
}

/// The positions on the guides of a particle at fraction `at` of its strand; `fractions` are those
/// of the guides' particles.
pub(super) fn place(guides: &Groom, fractions: &[Vec<f32>], influence: &Influence, at: f32) -> Place {
    let mut place = Place::default();
    for (k, &guide) in influence.guides.iter().enumerate() {
        let along = &fractions[guide as usize];
        let edge = along.partition_point(|&f| f <= at).saturating_sub(1).min(along.len() - 2);
        let width = along[edge + 1] - along[edge];
        #[expect(clippy::cast_possible_truncation, reason = "particles are indexed with 32 bits")]
        let particle = (guides.range(guide as usize).start + edge) as u32;
        place.particles[k] = particle;
        place.fractions[k] = if width > 0.0 { ((at - along[edge]) / width).clamp(0.0, 1.0) } else { 0.0 };
    }
    place
}
