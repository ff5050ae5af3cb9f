//! Restores the lengths of edges that collisions stretched, by moving particles along the surfaces
//! of solids.

use super::particle::{Solid, lipschitz};
use super::{Solids, dot};
use crate::lane::{Lane, Real, V3};
use crate::strands::{BlockView, LaneGroup};

/// Restores the lengths of edges that collisions stretched. In each strand whose `stretch` is over
/// [`STRETCHED`], the free particles are visited from root to tip. Each is moved along its edge to
/// the rest length l from the particle before it (the leader). If this position is inside a solid,
/// the particle is moved to a point of the solid's surface at distance l from the leader.
///
/// # Theory
/// A point of the surface at distance l from the leader is found by alternating projections onto
/// the surface and onto the sphere of radius l about the leader, each to the nearest point. No
/// iteration moves the particle farther than its current error, so a small change of the start
/// position changes the result only a little. (The closed form for a flat surface divides by the
/// component of the edge along the surface; it makes strands that rest on a ridge jump from one
/// side to the other.) Where surface and sphere do not intersect, the particle stays on the surface
/// and the edge stays stretched.
///
/// Afterwards the particle's velocity relative to the leader loses its component along the edge, as
/// in the length pass, so that the edge can turn but does not change its length.
#[inline(always)]
pub fn lay_along<L: Lane>(
    solids: &Solids<'_, L::Scalar>,
    stretch: L,
    view: &mut BlockView<'_, L::Scalar>,
    group: LaneGroup,
) {
    let LaneGroup { first, live } = group;
    let stretched = L::from_f64(STRETCHED);
    if L::all(stretch.lt(stretched)) {
        return;
    }
    for i in solids.clamped.max(1)..view.particles {
        let leader = V3::<L>::load(view.positions, i - 1, first);
        let old = V3::load(view.positions, i, first);
        let rest_length = L::load(&view.rest_lengths[3 * (i - 1)], first);
        let d = old - leader;
        let inverse = L::one() / d.dot(d).max(L::from_f64(1e-24)).sqrt();
        let mut x = leader.add_scaled(rest_length * inverse, d);
        let back = old - x;
        let mut clearance = L::load(&view.clearance[i], first);
        let left = clearance - back.dot(back).sqrt();
        for lane in 0..L::WIDTH.min(live - first) {
            let is_stretched = stretch.get(lane) > stretched.get(lane);
            if !is_stretched {
                x.set(lane, old.get(lane));
                continue;
            }
            if left.get(lane) > <L::Scalar as num_traits::Zero>::zero() {
                clearance.set(lane, left.get(lane));
            } else if clearance.get(lane) >= <L::Scalar as num_traits::Zero>::zero() {
                let (place, bound) = slide(solids, leader.get(lane), x.get(lane), rest_length.get(lane));
                x.set(lane, place);
                clearance.set(lane, bound);
            }
        }
        clearance.store(&mut view.clearance[i], first);
        x.store(view.positions, i, first);
        let edge = x - leader;
        let edge = edge.scale(L::one() / edge.dot(edge).max(L::from_f64(1e-24)).sqrt());
        let v = V3::<L>::load(view.velocities, i, first);
        let separation = edge.dot(v - V3::load(view.velocities, i - 1, first));
        let separation = L::select(stretched.lt(stretch), separation, L::zero());
        v.add_scaled(-separation, edge).store(view.velocities, i, first);
    }
}

/// Stretch, relative to the rest length, above which the edges of a strand are restored.
pub const STRETCHED: f64 = 1e-5;

/// Searches for a point near `x`, at distance `length` from `leader`, that is outside all solids.
/// Returns the last point of the search and its clearance, which is 0 if the point may be inside a
/// solid.
fn slide<T: Real>(solids: &Solids<'_, T>, leader: [T; 3], mut x: [T; 3], length: T) -> ([T; 3], T) {
    // The projection out of one solid can end inside another. It is repeated if it moved the point
    // farther than the clearance from the solids before.
    for _ in 0..3 {
        let (mut clearance, mut repeats) = (T::infinity(), false);
        for (collider, pose) in solids.solids.iter().zip(solids.poses) {
            let (place, bound) = slide_along(solids, Solid { collider, pose }, leader, x, length);
            let step = [0, 1, 2].map(|c| place[c] - x[c]);
            repeats |= clearance < dot(step, step).sqrt();
            (x, clearance) = (place, clearance.min(bound));
        }
        if !repeats {
            return (x, clearance);
        }
    }
    (x, T::zero())
}

/// Maximum number of iterations in the search for a point on the surface of one solid.
pub const SLIDE_STEPS: usize = 4;

/// Searches for a point near `x`, at distance `length` from `leader`, that is outside `solid`.
/// Returns the point and its clearance. If none is found, the point is on the surface at another
/// distance.
#[inline]
fn slide_along<T: Real>(
    solids: &Solids<'_, T>,
    solid: Solid<'_, T>,
    leader: [T; 3],
    mut x: [T; 3],
    length: T,
) -> ([T; 3], T) {
    let Solid { collider, pose } = solid;
    for _ in 0..SLIDE_STEPS {
        let (distance, gradient) = collider.shape.sample_at(pose.local(1, x), pose.fractions[1]);
        let sigma = distance - solids.thickness;
        if sigma >= T::zero() || sigma.is_nan() {
            return (x, sigma / lipschitz(collider.shape));
        }
        let n = pose.turn(1, gradient);
        let edge = [0, 1, 2].map(|c| x[c] - sigma * n[c] - leader[c]);
        let scale = length / dot(edge, edge).sqrt().max(T::min_positive_value());
        x = [0, 1, 2].map(|c| leader[c] + scale * edge[c]);
    }
    let (distance, gradient) = collider.shape.sample_at(pose.local(1, x), pose.fractions[1]);
    let sigma = distance - solids.thickness;
    if sigma >= T::zero() || sigma.is_nan() {
        return (x, sigma / lipschitz(collider.shape));
    }
    // No point was found: the collision takes precedence over the length.
    let n = pose.turn(1, gradient);
    ([0, 1, 2].map(|c| x[c] - sigma * n[c]), T::zero())
}
