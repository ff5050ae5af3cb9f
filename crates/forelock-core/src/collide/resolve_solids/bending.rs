//! Collisions with a body that bends: skin that comes towards other skin may leave no room between
//! them, and a clearance is valid until the step's end, or counts on the skin's motion.

use super::edges::distance;
use super::lay_along::{EXACT_ROUNDS, at_distance, project};
use super::particle::{
    MAX_PUSHES, Particle, Sample, Solid, allowed_clearance, apply_friction, lipschitz, surface_displacement,
};
use super::{SolidPose, Solids, dot};
use crate::body::{BendingField, ColliderFrame, PACKET, Shape};
use crate::lane::{Lane, Real, V3};
use crate::strands::{BlockView, number, vector};
use glam::Vec3;

/// The squared length of a gradient below which it does not say where it is outside.
pub const NOWHERE: f64 = 0.2;
/// The depth under the skin, over its thickness, of a particle that is held.
pub const HELD: f64 = 1.001;
/// The length of an edge, over that at rest, below which it has no direction.
pub const COINCIDENT: f64 = 1e-3;
/// Stretch of an edge that skin of a body that bends may leave.
pub const PINCHED: f64 = 0.02;
/// The product of the directions out of two surfaces between which there may be no room.
pub const OPPOSITE: f64 = -0.8;

/// [`resolve_penetration`](super::particle::resolve_penetration) of a particle inside the skin of a
/// body that bends. One that is held between two parts which press into each other moves with the
/// skin.
#[inline(never)]
pub(super) fn resolve_penetration<T: Real>(
    solids: &Solids<'_, T>,
    solid: Solid<'_, T>,
    field: &BendingField,
    sample: Sample<T>,
    particle: &mut Particle<T>,
) -> T {
    let Solid { collider, pose } = solid;
    let (mut sigma, mut gradient) = (sample.distance - solids.thickness, sample.gradient);
    // Parts that come towards each other may leave no room between them.
    let bends = !field.is_still(at_f32(pose.local(1, particle.x)));
    let normal = pose.turn(1, gradient);
    let displacement = surface_displacement(solid, particle.x, normal);
    if leads_nowhere(gradient) {
        particle.v = displacement.map(|d| d / solids.h);
        return held(solids, sigma, particle);
    }
    apply_friction(solids, collider.friction, displacement, normal, particle, false);
    for _ in 0..MAX_PUSHES {
        let allowed = allowed_clearance(solids, particle, sigma);
        let push = allowed - sigma;
        if push <= T::zero() {
            return sigma;
        }
        if leads_nowhere(gradient) {
            return held(solids, sigma, particle);
        }
        let normal = pose.turn(1, gradient);
        particle.x = [0, 1, 2].map(|c| particle.x[c] + push * normal[c]);
        let is_small = push < number(0.1 * f64::from(field.cell()));
        if is_small && !bends {
            return allowed;
        }
        let (distance, there) = collider.shape.sample_at(pose.local(1, particle.x), pose.fractions[1]);
        sigma = distance - solids.thickness;
        if sigma >= T::zero() || sigma.is_nan() {
            return if is_small { allowed } else { sigma };
        }
        if bends && dot(there, gradient) < number(OPPOSITE) {
            // It has passed the middle of a gap that is narrower than the skins.
            particle.x = [0, 1, 2].map(|c| particle.x[c] - number::<T>(0.5) * push * normal[c]);
            particle.v = displacement.map(|d| d / solids.h);
            return held(solids, sigma, particle);
        }
        gradient = there;
    }
    sigma
}

/// Whether no direction leads out: two parts of the body press into each other there.
#[inline(always)]
fn leads_nowhere<T: Real>(gradient: [T; 3]) -> bool {
    dot(gradient, gradient) < number(NOWHERE)
}

/// The clearance of a particle that parts of the body hold: that of one which is being pushed out,
/// so that its strand is not laid around the body. Where the skin touched it first in the substep
/// there is no room any more, so it is not stopped there.
#[inline(always)]
fn held<T: Real>(solids: &Solids<'_, T>, sigma: T, particle: &mut Particle<T>) -> T {
    particle.is_held = true;
    sigma.min(-solids.thickness * number(HELD))
}

/// Whether hair may be held between parts of a body.
#[inline(always)]
pub(super) fn may_hold<T: Real>(solids: &Solids<'_, T>) -> bool {
    bending(solids).next().is_some()
}

/// Limits the stretch of the edges of the strand in `lane` that are beside skin that bends, and of
/// those after them, to the larger of [`PINCHED`] and `limit`: lengths have precedence over such
/// skin. Particles before `from` are clamped. Where skin folds, and where it moves fast, it may
/// push neighbouring particles out to different sides. They are brought out again as far as their
/// lengths allow, and the rest in the next step. Returns the largest depth of a particle that was
/// moved.
#[inline(never)]
pub(super) fn limit_stretch<T: Real>(
    solids: &Solids<'_, T>,
    limit: f64,
    view: &mut BlockView<'_, T>,
    [lane, from]: [usize; 2],
) -> f64 {
    let by = number::<T>(limit.max(PINCHED));
    let (mut deepest, mut has_moved) = (0.0f64, false);
    for i in from..view.particles {
        let [leader, mut x] = [i - 1, i].map(|i| vector(view.positions, i, lane));
        let (rest, now) = (view.rest_lengths[3 * (i - 1)].0[lane], distance(leader, x));
        let [least, most] = [T::one() - by, T::one() + by].map(|share| share * rest);
        // What was brought out lies at the skin's thickness.
        let reach = rest + solids.thickness;
        if (now >= least && now <= most) || !(has_moved || distance_from_skin(solids, x) < reach) {
            continue;
        }
        has_moved = true;
        if now < number::<T>(COINCIDENT) * rest {
            // It has no direction of its own: that of the edge before, if there is one.
            let before = vector(view.positions, i.max(2) - 2, lane);
            x = [0, 1, 2].map(|c| leader[c] + (leader[c] - before[c]));
        }
        let length = if now < least { least } else { most };
        let x = at_distance(leader, x, length);
        let x = (0..EXACT_ROUNDS).fold(x, |x, _| at_distance(leader, project(solids, x), length));
        for (row, x) in view.positions[3 * i..3 * i + 3].iter_mut().zip(x) {
            row.0[lane] = x;
        }
        let clearance = clearance_at(solids, x);
        let until_end = if clearance > T::zero() { clearance_at_end(solids, x) } else { clearance };
        view.clearance[i].0[lane] = clearance.min(until_end);
        deepest = deepest.max((-(clearance + solids.thickness)).to_f64().unwrap_or(0.0));
    }
    deepest
}

/// The bodies that bend.
#[inline(always)]
fn bending<'a, T: Real>(
    solids: &'a Solids<'_, T>,
) -> impl Iterator<Item = (&'a ColliderFrame<'a>, &'a SolidPose<T>)> {
    let all = solids.solids.iter().zip(solids.poses);
    all.filter(|(collider, _)| matches!(collider.shape, Shape::Bending(_)))
}

/// The distance from skin that bends at `x`, metres.
fn distance_from_skin<T: Real>(solids: &Solids<'_, T>, x: [T; 3]) -> T {
    let distances = bending(solids)
        .map(|(collider, pose)| collider.shape.sample_at(pose.local(1, x), pose.fractions[1]).0);
    distances.fold(T::infinity(), T::min)
}

/// The clearance at `x`; below zero a depth.
fn clearance_at<T: Real>(solids: &Solids<'_, T>, x: [T; 3]) -> T {
    let clearances = solids.solids.iter().zip(solids.poses).map(|(collider, pose)| {
        let (distance, _) = collider.shape.sample_at(pose.local(1, x), pose.fractions[1]);
        let sigma = distance - solids.thickness;
        if sigma > T::zero() { sigma / lipschitz(collider.shape) } else { sigma }
    });
    clearances.fold(T::infinity(), T::min)
}

/// Displacement in the substep of the skin nearest to `x` relative to the body, in world axes.
#[inline(never)]
pub(super) fn displacement<T: Real>(field: &BendingField, pose: &SolidPose<T>, x: [T; 3]) -> Option<[T; 3]> {
    let bent = field.displacement(at_f32(pose.local(1, x)))?;
    let share = pose.fractions[1] - pose.fractions[0];
    Some(pose.turn(1, bent.to_array().map(|c| number(f64::from(c) * share))))
}

/// How far the distance from a shape falls at most in the frame, for particles at `from` at its
/// start; 0 for one that does not bend.
#[inline(never)]
pub(super) fn fall<L: Lane>(shape: &Shape, pose: &SolidPose<L::Scalar>, from: V3<L>) -> L {
    let mut fall = L::zero();
    if let Shape::Bending(field) = shape {
        for lane in 0..L::WIDTH {
            fall.set(lane, number(field.fall(at_f32(pose.local(0, from.get(lane)))).into()));
        }
    }
    fall
}

/// Bounds clearances at `x` that are over 0 by that from a body that bends at the frame's end: they
/// hold until then.
#[inline(never)]
pub(super) fn bound_until_end<T: Real>(
    solids: &Solids<'_, T>,
    solid: Solid<'_, T>,
    x: &[[T; PACKET]; 3],
    clearances: &mut [T; PACKET],
) {
    let Solid { collider, pose } = solid;
    let (distances, _) = collider.shape.sample_packet(&pose.local_packet(1, x), 1.0);
    for (clearance, distance) in clearances.iter_mut().zip(distances) {
        if *clearance > T::zero() {
            let at_end = (distance - solids.thickness).max(T::zero()) / lipschitz(collider.shape);
            *clearance = clearance.min(at_end);
        }
    }
}

/// The clearance at `x` from bodies that bend at the frame's end, 0 inside.
pub(super) fn clearance_at_end<T: Real>(solids: &Solids<'_, T>, x: [T; 3]) -> T {
    let clearances = bending(solids).map(|(collider, pose)| {
        let distance = collider.shape.sample(pose.local(1, x)).0 - solids.thickness;
        distance.max(T::zero()) / lipschitz(collider.shape)
    });
    clearances.fold(T::infinity(), T::min)
}

/// A point in the precision of fields.
#[inline(always)]
fn at_f32<T: Real>(p: [T; 3]) -> Vec3 {
    p.map(|c| c.to_f32().unwrap_or(f32::NAN)).into()
}
