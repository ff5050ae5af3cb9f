//! Which strands can be drawn: those with two particles or more, all of them finite.

use glam::Vec3;

use crate::scene::Strands;

/// Whether all of `strands` can be drawn, and the smallest box around those that can.
pub(crate) fn extent(strands: &Strands<'_>) -> (bool, (Vec3, Vec3)) {
    let empty = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    let widen = |(lo, hi): (Vec3, Vec3), &p: &Vec3| (lo.min(p), hi.max(p));
    let Some(&first) = strands.strand_offsets.first() else { return (true, empty) };
    let positions = &strands.positions[first as usize..];
    // A product with 0 is 0 unless a number is not finite.
    let zero = positions.iter().fold(Vec3::ZERO, |sum, &p| sum + p * 0.0);
    let is_sound = zero.is_finite() && strands.strand_offsets.windows(2).all(|w| w[1] - w[0] >= 2);
    let bounds = if is_sound {
        positions.iter().fold(empty, widen)
    } else {
        drawable(strands, false, 0..strand_count(strands))
            .fold(empty, |bounds, (_, particles)| strands.positions[particles].iter().fold(bounds, widen))
    };
    (is_sound, bounds)
}

/// The strands of `strands` that can be drawn: (index, particle range). With `is_sound` they all
/// can.
pub(crate) fn drawable<'a>(
    strands: &Strands<'a>,
    is_sound: bool,
    range: std::ops::Range<usize>,
) -> impl Iterator<Item = (usize, std::ops::Range<usize>)> + Clone + use<'a> {
    let (positions, offsets) = (strands.positions, strands.strand_offsets);
    range.filter_map(move |s| {
        let particles = offsets[s] as usize..offsets[s + 1] as usize;
        let can_be_drawn = || positions[particles.clone()].iter().all(|p| p.is_finite());
        let usable = is_sound || particles.len() >= 2 && can_be_drawn();
        usable.then_some((s, particles))
    })
}

pub(crate) fn strand_count(strands: &Strands<'_>) -> usize {
    strands.strand_offsets.len().saturating_sub(1)
}
