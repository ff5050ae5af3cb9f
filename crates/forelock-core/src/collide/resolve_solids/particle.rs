//! Collisions of one particle: penetration, tunnelling and friction.

use super::sweep::sweep;
use super::{SolidPose, Solids, bending, dot};
use crate::body::{ColliderFrame, Shape};
use crate::lane::Real;

/// Factor by which a shape's field can change faster than the distance does.
#[inline(always)]
pub(super) fn lipschitz<T: Real>(shape: &Shape) -> T {
    if shape.cell().is_some() { T::from(3.0).unwrap_or_else(T::one).sqrt() } else { T::one() }
}

/// Motion relative to `shape` above which continuous collision detection is needed. A particle that
/// stops near the middle of a ball or a box would leave it by any side.
#[inline(always)]
pub(super) fn ccd_motion<T: Real>(shape: &Shape) -> T {
    let share = if shape.cell().is_some() { 1.0 } else { CCD_MOTION };
    crate::strands::number(share * shape.thinness())
}

/// Share of the thinness of a primitive in `ccd_motion`.
pub const CCD_MOTION: f64 = 0.5;

/// The state of a particle during a query.
pub(super) struct Particle<T> {
    pub x: [T; 3],
    pub v: [T; 3],
    /// Clearance after the last query.
    pub last_clearance: T,
    /// Whether parts of a body that bends hold it in this query.
    pub is_held: bool,
}

impl<T> Particle<T> {
    #[inline(always)]
    pub fn new(x: [T; 3], v: [T; 3], last_clearance: T) -> Self {
        Self { x, v, last_clearance, is_held: false }
    }
}

/// A solid and its pose in the substep.
#[derive(Clone, Copy)]
pub(super) struct Solid<'a, T> {
    pub collider: &'a ColliderFrame<'a>,
    pub pose: &'a SolidPose<T>,
}

/// A sample of a signed distance field.
#[derive(Clone, Copy)]
pub(super) struct Sample<T> {
    pub distance: T,
    /// In the solid's local space.
    pub gradient: [T; 3],
}

/// Pushes a particle out of one solid and applies friction. `sample` is the solid's field at the
/// particle. Returns the distance to the solid's skin that is left.
#[inline(always)]
pub(super) fn resolve_penetration<T: Real>(
    solids: &Solids<'_, T>,
    solid: Solid<'_, T>,
    sample: Sample<T>,
    particle: &mut Particle<T>,
) -> T {
    let Solid { collider, pose } = solid;
    let (mut sigma, mut gradient) = (sample.distance - solids.thickness, sample.gradient);
    if sigma >= T::zero() || sigma.is_nan() {
        return sigma;
    }
    if let Shape::Bending(field) = collider.shape {
        return bending::resolve_penetration(solids, solid, field, sample, particle);
    }
    let normal = pose.turn(1, gradient);
    let displacement = surface_displacement(solid, particle.x, normal);
    apply_friction(solids, collider.friction, displacement, normal, particle, false);
    // A grid's gradient is not exactly the direction to the surface: sample again after a push that
    // is not small against a cell. Primitives are exact.
    let small_push =
        collider.shape.cell().map_or(T::infinity(), |cell| T::from(0.1 * cell).unwrap_or_else(T::zero));
    for _ in 0..MAX_PUSHES {
        let allowed = allowed_clearance(solids, particle, sigma);
        let push = allowed - sigma;
        if push <= T::zero() {
            return sigma;
        }
        let normal = pose.turn(1, gradient);
        particle.x = [0, 1, 2].map(|c| particle.x[c] + push * normal[c]);
        if push < small_push {
            return allowed;
        }
        let (distance, there) = collider.shape.sample_at(pose.local(1, particle.x), pose.fractions[1]);
        (sigma, gradient) = (distance - solids.thickness, there);
        if sigma >= T::zero() || sigma.is_nan() {
            return sigma;
        }
    }
    sigma
}

/// The clearance to which this query may bring a particle that has clearance `sigma`: 0, or less
/// for one that was inside at the last query.
#[inline(always)]
pub(super) fn allowed_clearance<T: Real>(solids: &Solids<'_, T>, particle: &Particle<T>, sigma: T) -> T {
    if particle.last_clearance < T::zero() {
        (particle.last_clearance.max(sigma) + solids.max_push_out).min(T::zero())
    } else {
        T::zero()
    }
}

/// Pushes out of a distance field in one query. The field is sampled after the last one too: a
/// particle that is still inside is not taken for one that is out.
pub const MAX_PUSHES: usize = 3;

/// Pushes a particle out of one solid after the other until it is outside all. Returns the
/// clearance that is left; it is negative where the solids leave no room between them.
#[inline(never)]
pub(super) fn resolve_penetrations<T: Real>(solids: &Solids<'_, T>, particle: &mut Particle<T>) -> T {
    for round in 0..=PROJECTION_ROUNDS {
        let mut clearance = T::infinity();
        for (collider, pose) in solids.solids.iter().zip(solids.poses) {
            let (distance, gradient) = collider.shape.sample_at(pose.local(1, particle.x), pose.fractions[1]);
            let sigma = distance - solids.thickness;
            let rise = if sigma > T::zero() { lipschitz(collider.shape) } else { T::one() };
            clearance = clearance.min(sigma / rise);
            // The last round only measures.
            if round < PROJECTION_ROUNDS && sigma < T::zero() {
                resolve_penetration(
                    solids,
                    Solid { collider, pose },
                    Sample { distance, gradient },
                    particle,
                );
            }
        }
        // Outside, up to rounding.
        if clearance > -crate::strands::number::<T>(1e-6) {
            return clearance.max(T::zero());
        }
        if round == PROJECTION_ROUNDS {
            return clearance;
        }
    }
    T::zero()
}

/// Rounds of projections of a particle between solids; each round projects it out of every solid.
pub const PROJECTION_ROUNDS: usize = 8;

/// Continuous collision detection. Stops a particle at the surface that it passed through on its
/// path from `from` (at `start`; 0: the substep's start, 1: its end), if it is outside on another
/// side or would be pushed out there. `sample` is the solid's field at the particle. Returns
/// whether the particle was stopped.
#[inline(never)]
pub(super) fn resolve_ccd_hit<T: Real>(
    solids: &Solids<'_, T>,
    solid: Solid<'_, T>,
    sample: Sample<T>,
    start: usize,
    from: [T; 3],
    particle: &mut Particle<T>,
) -> bool {
    let Solid { collider, pose } = solid;
    let path = pose.sweep_path(start, from, particle.x);
    if path.length() <= ccd_motion(collider.shape) {
        return false;
    }
    // A particle that was inside at the last query is being pushed out. One that has not been
    // queried may have been outside.
    if particle.last_clearance < T::zero() {
        let was_outside = |point| collider.shape.sample_at(point, path.fractions[0]).0 >= solids.thickness;
        if particle.last_clearance > T::neg_infinity() || !was_outside(path.ends[0]) {
            return false;
        }
    }
    let Some(touch) = sweep(collider.shape, solids.thickness, &path) else { return false };
    // Deep inside a field its gradient does not say where the particle came from.
    let sigma = sample.distance - solids.thickness;
    let is_shallow = sigma > -crate::strands::number::<T>(collider.shape.thinness());
    let same_side = dot(sample.gradient, touch.1) > crate::strands::number(0.5);
    if sigma < T::zero() && same_side && is_shallow {
        return false;
    }
    stop(solids, solid, touch, particle);
    true
}

/// Continuous collision detection of a particle at `particle.x` that came from outside and that
/// pushes have not brought out again. Stops it where it entered the solid. Returns whether it did.
#[inline(never)]
pub(super) fn stop_at_entry<T: Real>(
    solids: &Solids<'_, T>,
    solid: Solid<'_, T>,
    start: usize,
    from: [T; 3],
    particle: &mut Particle<T>,
) -> bool {
    let path = solid.pose.sweep_path(start, from, particle.x);
    let Some(touch) = sweep(solid.collider.shape, solids.thickness, &path) else { return false };
    stop(solids, solid, touch, particle);
    true
}

/// Stops a particle at a place in the solid's local space, where the surface has a normal.
#[inline(always)]
fn stop<T: Real>(
    solids: &Solids<'_, T>,
    solid: Solid<'_, T>,
    touch: ([T; 3], [T; 3]),
    particle: &mut Particle<T>,
) {
    let Solid { collider, pose } = solid;
    let (place, normal) = touch;
    particle.x = pose.world(1, place);
    let normal = pose.turn(1, normal);
    let displacement = surface_displacement(solid, particle.x, normal);
    apply_friction(solids, collider.friction, displacement, normal, particle, true);
}

/// Displacement in the substep of the solid's surface at `x`, where its normal is `normal`: the
/// rigid motion, plus that of skin that bends, or the motion along the normal of a shape that
/// changes.
#[inline(always)]
pub(super) fn surface_displacement<T: Real>(solid: Solid<'_, T>, x: [T; 3], normal: [T; 3]) -> [T; 3] {
    let Solid { collider, pose } = solid;
    let moved = pose.displacement(x);
    if pose.swell == T::zero() {
        return moved;
    }
    if let Shape::Bending(field) = collider.shape
        && let Some(bent) = bending::displacement(field, pose, x)
    {
        return [0, 1, 2].map(|c| moved[c] + bent[c]);
    }
    let [before, now] = pose.fractions.map(|fraction| collider.shape.sample_at(pose.local(1, x), fraction).0);
    [0, 1, 2].map(|c| moved[c] + (before - now) * normal[c])
}

/// Removes the velocity at which a particle approaches a surface that moves by `displacement` in h,
/// and applies Coulomb friction. `is_ccd_hit` says that the particle was stopped on its path.
#[inline(always)]
pub(super) fn apply_friction<T: Real>(
    solids: &Solids<'_, T>,
    friction: f64,
    displacement: [T; 3],
    normal: [T; 3],
    particle: &mut Particle<T>,
    is_ccd_hit: bool,
) {
    let solid_velocity = displacement.map(|d| d / solids.h);
    let relative = [0, 1, 2].map(|c| particle.v[c] - solid_velocity[c]);
    let approach = dot(relative, normal);
    if approach >= T::zero() || approach.is_nan() {
        return;
    }
    let tangential = [0, 1, 2].map(|c| relative[c] - approach * normal[c]);
    let speed = dot(tangential, tangential).sqrt();
    let mu = T::from(friction).unwrap_or_else(T::zero);
    let kept = if speed > T::zero() { (T::one() + mu * approach / speed).max(T::zero()) } else { T::zero() };
    for c in 0..3 {
        particle.v[c] = solid_velocity[c] + kept * tangential[c];
        // A particle stopped on its path has no tangential displacement left to reduce.
        if solids.friction_moves && !is_ccd_hit {
            particle.x[c] = particle.x[c] - solids.h * (T::one() - kept) * tangential[c];
        }
    }
}
