//! The output heads: from a network's outputs, three numbers an edge, to a strand.

use super::rotation::{displace, rotate, rotate_gradient};
use crate::losses::Strand;
use crate::{EDGES, PARTICLES};
use forelock_core::lane::{Lane, V3};

/// What the network's outputs are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum OutputHead {
    /// Rotations of edges ([`rotate`]): strands cannot stretch.
    #[default]
    Rotation,
    /// Displacements of particles ([`displace`]): the paper's.
    Displacement,
}

/// A head for a strand at rest.
pub(crate) enum Head<L> {
    /// Rotations of these edges.
    Rotation([V3<L>; EDGES]),
    /// Displacements of particles at these arc lengths.
    Displacement([L; PARTICLES]),
}

impl<L: Lane> Head<L> {
    #[inline(always)]
    pub(crate) fn new(head: OutputHead, at_rest: &Strand<L>) -> Self {
        let mut edges = [V3::zero(); EDGES];
        let mut arc_lengths = [L::zero(); PARTICLES];
        for i in 0..EDGES {
            edges[i] = at_rest[i + 1] - at_rest[i];
            arc_lengths[i + 1] = arc_lengths[i] + edges[i].dot(edges[i]).sqrt();
        }
        match head {
            OutputHead::Rotation => Self::Rotation(edges),
            OutputHead::Displacement => Self::Displacement(arc_lengths),
        }
    }

    /// The strand of outputs `o`, of ½ B o for rotations.
    #[inline(always)]
    pub(crate) fn strand(&self, at_rest: &Strand<L>, o: &[V3<L>; EDGES]) -> Strand<L> {
        match self {
            Self::Rotation(edges) => rotate(at_rest[0], edges, o),
            Self::Displacement(arc_lengths) => displace(at_rest, arc_lengths, o),
        }
    }

    /// The gradient with respect to `o` from that with respect to the strand.
    #[inline(always)]
    pub(crate) fn gradient(&self, o: &[V3<L>; EDGES], by: &Strand<L>) -> [V3<L>; EDGES] {
        match self {
            Self::Rotation(edges) => rotate_gradient(edges, o, by),
            Self::Displacement(arc_lengths) => {
                let mut by_o = [V3::zero(); EDGES];
                for i in 0..EDGES {
                    by_o[i] = by[i + 1].scale(arc_lengths[i + 1]);
                }
                by_o
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::losses::zero;
    use crate::random::Random;

    #[test]
    fn gradients_of_heads_agree_with_finite_differences() {
        let mut random = Random::new(9);
        let mut vector = || V3(std::array::from_fn(|_| random.signed()));
        let mut at_rest = zero();
        for i in 1..PARTICLES {
            at_rest[i] = at_rest[i - 1] + vector();
        }
        let o: [V3<f64>; EDGES] = std::array::from_fn(|_| vector());
        let by: Strand<f64> = std::array::from_fn(|_| vector());
        for head in [OutputHead::Rotation, OutputHead::Displacement] {
            let head = Head::new(head, &at_rest);
            let value = |o: &[V3<f64>; EDGES]| -> f64 {
                head.strand(&at_rest, o).iter().zip(&by).map(|(x, by)| x.dot(*by)).sum()
            };
            let gradient = head.gradient(&o, &by);
            for k in 0..3 * EDGES {
                let mut ends = [o; 2];
                ends[0][k / 3].0[k % 3] += 1e-6;
                ends[1][k / 3].0[k % 3] -= 1e-6;
                let found = (value(&ends[0]) - value(&ends[1])) / 2e-6;
                let own = gradient[k / 3].0[k % 3];
                assert!((found - own).abs() < 1e-6 * own.abs().max(1.0), "{k}: {found} {own}");
            }
        }
    }
}
