//! Which strands can be drawn: those with two particles or more, all of them finite.

use glam::Vec3;

use crate::scene::{Strands, bounds_of};

/// Whether all particles of `strands` are finite, and the smallest box around the strands that can
/// be drawn.
pub(crate) fn extent(strands: &Strands<'_>) -> (bool, (Vec3, Vec3)) {
    let first = strands.strand_offsets.first().map_or(strands.positions.len(), |&first| first as usize);
    let positions = &strands.positions[first..];
    // A product with 0 is 0 unless a number is not finite.
    let is_finite = positions.iter().fold(Vec3::ZERO, |sum, &p| sum + p * 0.0).is_finite();
    let bounds = if is_finite && strands.strand_offsets.windows(2).all(|w| w[1] - w[0] >= 2) {
        bounds_of(positions.iter().copied())
    } else {
        let drawn = drawable(strands, is_finite, 0..strand_count(strands));
        bounds_of(drawn.flat_map(|(_, particles)| strands.positions[particles].iter().copied()))
    };
    (is_finite, bounds)
}

/// The strands of `strands` that can be drawn: (index, particle range). `is_finite` tells that all
/// particles are known to be finite.
pub(crate) fn drawable<'a>(
    strands: &Strands<'a>,
    is_finite: bool,
    range: std::ops::Range<usize>,
) -> impl Iterator<Item = (usize, std::ops::Range<usize>)> + Clone + use<'a> {
    let (positions, offsets) = (strands.positions, strands.strand_offsets);
    range.filter_map(move |s| {
        let particles = offsets[s] as usize..offsets[s + 1] as usize;
        let are_finite = || is_finite || positions[particles.clone()].iter().all(|p| p.is_finite());
        let usable = particles.len() >= 2 && are_finite();
        usable.then_some((s, particles))
    })
}

pub(crate) fn strand_count(strands: &Strands<'_>) -> usize {
    strands.strand_offsets.len().saturating_sub(1)
}
