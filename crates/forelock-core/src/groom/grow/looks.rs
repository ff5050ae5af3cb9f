//! Measures of how grown hair looks.

use glam::Vec3;

use crate::body::Head;
use crate::groom::{Groom, length};

pub(super) fn mean_length(groom: &Groom) -> f32 {
    groom.strands().map(length).sum::<f32>() / groom.strand_count() as f32
}

/// The point of `strand` at the length `arc` from its root.
fn at(strand: &[Vec3], arc: f32) -> Vec3 {
    let place = (arc / strand[0].distance(strand[1])).min((strand.len() - 1) as f32);
    let before = (place as usize).min(strand.len() - 2);
    strand[before].lerp(strand[before + 1], place - before as f32)
}

/// The share of particles at which a strand turns by more than 60°.
pub(super) fn folds(groom: &Groom) -> f32 {
    let sharp = |w: &&[Vec3]| (w[1] - w[0]).normalize_or_zero().dot((w[2] - w[1]).normalize_or_zero()) < 0.5;
    let count: usize = groom.strands().map(|strand| strand.windows(3).filter(sharp).count()).sum();
    count as f32 / groom.particle_count() as f32
}

/// The share of strands whose part below the jaw is crumpled: less than half as far from end to end
/// as it is long, with 2 cm or more of it within 2 cm of the body.
pub(super) fn nests(groom: &Groom) -> f32 {
    let crumpled = |strand: &&[Vec3]| {
        let Some(first) = strand.iter().position(|p| p.y < -0.08) else { return false };
        let part = &strand[first..];
        let close: f32 =
            part.windows(2).filter(|w| Head::distance(w[0]) < 0.02).map(|w| w[0].distance(w[1])).sum();
        close > 0.02 && part[0].distance(part[part.len() - 1]) < 0.5 * length(part)
    };
    groom.strands().filter(crumpled).count() as f32 / groom.strand_count() as f32
}

/// The share of hair in front of the throat.
pub(super) fn strings(groom: &Groom) -> f32 {
    let throat = |p: &&Vec3| p.x.abs() < 0.045 && (-0.2..-0.115).contains(&p.y) && p.z > -0.01;
    groom.positions().iter().filter(throat).count() as f32 / groom.particle_count() as f32
}

/// The share of hair beside the top of the ears that runs outwards, at more than 45° to the side of
/// the head, as from a shelf.
pub(super) fn shelves(groom: &Groom) -> f32 {
    let beside = |p: Vec3| p.x.abs() > 0.078 && (0.0..0.035).contains(&p.y) && (-0.05..0.02).contains(&p.z);
    let edges = groom.strands().flat_map(|strand| strand.windows(2)).filter(|w| beside(w[1]));
    let (out, all) = edges.fold((0, 0), |(out, all), w| {
        let steep = (w[1] - w[0]).normalize_or_zero().x * w[1].x.signum() > 0.7;
        (out + u32::from(steep), all + 1)
    });
    out as f32 / all.max(1) as f32
}

/// The share of strands that, within 20 cm of their roots, move 5 cm away from the strand whose
/// root is nearest, unless a parting lies between them.
pub(super) fn cracks(groom: &Groom, parting: f32) -> f32 {
    let strands: Vec<&[Vec3]> = groom.strands().collect();
    let side = |p: Vec3| p.x < parting;
    let parts = |strand: &&[Vec3]| {
        let neighbours = strands.iter().filter(|other| side(other[0]) == side(strand[0]));
        let others = neighbours.filter(|other| other[0] != strand[0]);
        let near = others.min_by(|a, b| a[0].distance(strand[0]).total_cmp(&b[0].distance(strand[0])));
        near.is_some_and(|near| {
            let arc = length(strand).min(length(near)).min(0.2);
            at(near, arc).distance(at(strand, arc)) > 0.05 + near[0].distance(strand[0])
        })
    };
    strands.iter().filter(|strand| parts(strand)).count() as f32 / strands.len() as f32
}
