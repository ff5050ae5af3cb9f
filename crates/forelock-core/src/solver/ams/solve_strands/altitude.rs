//! Altitude springs of the plain mass-spring baseline (Selle 2008, §4). They keep the tetrahedra of
//! four consecutive particles from collapsing or turning inside out.
//!
//! Of a tetrahedron's seven altitudes (four point–face, three edge–edge) the shortest is the one
//! over the largest parallelogram; its foot lies inside both features, so its weights are stable.
//! The spring acts along it, towards its signed length at rest, and distributes its force to all
//! four particles by those weights. The band's half-width stays 3.

use super::factor::Ring;
use super::terms::{RowTerms, SubstepTerms};
use crate::lane::{Lane, Sym3, V3};

/// A pair of features of a tetrahedron, given by the particles that span them.
enum Feature {
    /// A point p and the face a b c.
    PointFace([usize; 4]),
    /// The line a b and the line c d.
    Lines([usize; 4]),
}

const FEATURES: [Feature; 7] = [
    Feature::PointFace([0, 1, 2, 3]),
    Feature::PointFace([1, 0, 3, 2]),
    Feature::PointFace([2, 0, 1, 3]),
    Feature::PointFace([3, 0, 2, 1]),
    Feature::Lines([0, 1, 2, 3]),
    Feature::Lines([0, 2, 3, 1]),
    Feature::Lines([0, 3, 1, 2]),
];

/// An altitude: the parallelogram's normal, a vector from one feature to the other, and the weights
/// of the four particles.
struct Altitude<L> {
    normal: V3<L>,
    across: V3<L>,
    weights: [L; 4],
}

#[inline(always)]
fn altitude<L: Lane>(feature: &Feature, p: &[V3<L>; 4], tiny: L) -> Altitude<L> {
    let one = L::one();
    let mut weights = [L::zero(); 4];
    match *feature {
        Feature::PointFace([top, a, b, c]) => {
            let (e1, e2, across) = (p[b] - p[a], p[c] - p[a], p[top] - p[a]);
            let normal = e1.cross(e2);
            let scale = one / normal.dot(normal).max(tiny);
            let beta = across.cross(e2).dot(normal) * scale;
            let gamma = e1.cross(across).dot(normal) * scale;
            weights[top] = one;
            weights[a] = beta + gamma - one;
            weights[b] = -beta;
            weights[c] = -gamma;
            Altitude { normal, across, weights }
        }
        Feature::Lines([a, b, c, d]) => {
            let (e1, e2, across) = (p[b] - p[a], p[d] - p[c], p[c] - p[a]);
            let normal = e1.cross(e2);
            let scale = one / normal.dot(normal).max(tiny);
            let s = across.cross(e2).dot(normal) * scale;
            let t = across.cross(e1).dot(normal) * scale;
            weights[a] = s - one;
            weights[b] = -s;
            weights[c] = one - t;
            weights[d] = t;
            Altitude { normal, across, weights }
        }
    }
}

/// Particles `i..i + 4` of a strand.
pub struct Tetrahedron<L> {
    /// Positions.
    pub positions: [V3<L>; 4],
    /// Rest positions.
    pub rest: [V3<L>; 4],
    /// Velocities of the ghosts, which clamped particles take.
    pub ghost_velocities: [V3<L>; 4],
}

/// Adds the altitude spring of the tetrahedron that starts at row `i`.
#[inline(always)]
pub fn add<L: Lane>(
    substep: &SubstepTerms<L>,
    terms: &RowTerms<L>,
    tetrahedron: &Tetrahedron<L>,
    i: usize,
    clamped: usize,
    ring: &mut Ring<L>,
) {
    // Lower bound of the squared area, in m⁴: far below that of any hair, and far above the
    // smallest float32.
    let tiny = L::from_f64(1e-30);
    let mut best = altitude(&FEATURES[0], &tetrahedron.positions, tiny);
    let mut best_rest = altitude(&FEATURES[0], &tetrahedron.rest, tiny);
    let mut largest = best.normal.dot(best.normal);
    for feature in &FEATURES[1..] {
        let candidate = altitude(feature, &tetrahedron.positions, tiny);
        let rest = altitude(feature, &tetrahedron.rest, tiny);
        let area = candidate.normal.dot(candidate.normal);
        let larger = largest.lt(area);
        let pick = |yes: V3<L>, no: V3<L>| V3([0, 1, 2].map(|k| L::select(larger, yes.0[k], no.0[k])));
        best = Altitude {
            normal: pick(candidate.normal, best.normal),
            across: pick(candidate.across, best.across),
            weights: [0, 1, 2, 3].map(|k| L::select(larger, candidate.weights[k], best.weights[k])),
        };
        best_rest.normal = pick(rest.normal, best_rest.normal);
        best_rest.across = pick(rest.across, best_rest.across);
        largest = largest.max(area);
    }
    let direction = best.normal.scale(L::one() / largest.max(tiny).sqrt());
    let rest_area = best_rest.normal.dot(best_rest.normal).max(tiny);
    let rest_height = best_rest.across.dot(best_rest.normal) / rest_area.sqrt();
    let impulse = terms.altitude * substep.h * (best.across.dot(direction) - rest_height);
    let stiffness = Sym3::outer_plus_identity(terms.altitude * substep.h2, direction, L::zero());
    for (k, &weight) in best.weights.iter().enumerate() {
        if i + k < clamped {
            continue;
        }
        ring.add_impulse(i + k, direction.scale(-(impulse * weight)));
        for (l, &other) in best.weights.iter().enumerate() {
            let block = stiffness.scale(weight * other);
            if i + l < clamped {
                ring.add_impulse(i + k, -block.mul(tetrahedron.ghost_velocities[l]));
            } else if k <= l {
                ring.add_block(i + k, i + l, &block);
            }
        }
    }
}
