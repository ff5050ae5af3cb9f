//! Hair–solid collisions, at the end of every substep and after the lengths are restored (AMS,
//! Sec. 3.3).
//!
//! # Theory
//! With σ the signed distance less the skin's thickness, n = ∇σ, and Δv the velocity relative to
//! the solid at that point: where σ < 0 and Δv approaches (Δv·n < 0), Δv_N = 0 and Coulomb friction
//! leaves Δv_T ← max(0, 1 − μ |Δv_N|/|Δv_T|) Δv_T; then x −= σ n.
//!
//! A particle that was inside at the last query (hair spawned in a solid, or a solid that jumped)
//! is not pushed out at once: its depth decreases by `depenetration_speed`·h a substep, so that the
//! correction adds no large velocities.
//!
//! A particle between two solids is projected out of one after the other until it is outside both
//! (alternating projections). Where they leave no room for it, it stays inside one, and the report
//! states the depth.
//!
//! # Practice
//! σ is 1-Lipschitz, so a particle at distance σ cannot touch a solid before it has moved by σ
//! relative to it. Each particle stores this clearance. Displacements are subtracted from it, and
//! the fields are sampled only when it is used up. The decision is made per lane, so results do not
//! depend on the SIMD width. Trilinear grids can change √3 times as fast along a diagonal: their
//! clearance is divided by √3.
//!
//! A particle with a large displacement in a substep is tested along its whole path (`sweep`), so
//! that fast particles do not tunnel through thin solids. The surface velocity of a shape that
//! changes ([`Shape::Morph`](crate::body::Shape::Morph)) counts in the contact.

mod lay_along;
mod levels;
mod particle;
mod pose;
mod queue;
mod sweep;

use crate::body::{ColliderFrame, PACKET};
use crate::lane::{Lane, Real, V3};
use crate::strands::{BlockView, LaneGroup};
pub use lay_along::{SLIDE_STEPS, STRETCHED, lay_along};
pub use levels::LevelSolids;
pub use particle::{MAX_PUSHES, PROJECTION_ROUNDS};
pub use pose::{SolidMotion, SolidPose};
use queue::{Queue, Queued};
pub use sweep::{SWEEP_STEPS, TOUCH};

/// WGSL of the stage.
pub const WGSL: &str = include_str!("kernel.wgsl");
/// WGSL that resolves the collisions of one particle.
pub const PARTICLE_WGSL: &str = include_str!("particle.wgsl");

/// The solids of one query.
#[derive(Clone, Copy, Debug)]
pub struct Solids<'a, T> {
    /// Shapes and friction.
    pub solids: &'a [ColliderFrame<'a>],
    /// Their poses in this substep.
    pub poses: &'a [SolidPose<T>],
    /// Distance kept from surfaces, metres.
    pub thickness: T,
    /// Largest decrease in this query of the depth of a particle that was inside before, metres.
    pub max_push_out: T,
    /// Substep, seconds.
    pub h: T,
    /// Clamped particles, which are not moved.
    pub clamped: usize,
    /// Whether friction changes positions too, for solvers that derive velocities from positions.
    pub friction_moves: bool,
}

/// The contacts found by a query.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SolidContacts {
    /// Particles that touch or are inside a solid's skin.
    pub touching: u32,
    /// Largest depth under a surface (not the skin) that is left, metres.
    pub deepest: f64,
}

/// What has happened since the last query.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Since {
    /// A substep: particles were at x − h v, and solids moved.
    Substep,
    /// Only displacements that [`reduce_clearances`] has subtracted from the clearances.
    Noted,
}

/// Subtracts the displacements of lanes `first..first + L::WIDTH` since `before` from their
/// clearances. The solids are at rest.
#[inline(always)]
pub fn reduce_clearances<L: Lane>(before: &[V3<L>], view: &mut BlockView<'_, L::Scalar>, first: usize) {
    for (i, &from) in before.iter().enumerate() {
        let d = V3::load(view.positions, i, first) - from;
        reduce_clearances_of::<L>(d.dot(d).sqrt(), view, i, first);
    }
}

/// [`reduce_clearances`] for particles `i`, which moved by `moved`.
#[inline(always)]
fn reduce_clearances_of<L: Lane>(moved: L, view: &mut BlockView<'_, L::Scalar>, i: usize, first: usize) {
    let clearance = L::load(&view.clearance[i], first);
    // Below zero it is a depth, not a distance.
    let left = (clearance - moved).max(L::zero());
    L::select(clearance.lt(L::zero()), clearance, left).store(&mut view.clearance[i], first);
}

/// [`reduce_clearances`] for one particle, for code that does not work on lanes.
#[inline]
pub fn reduce_clearance<T: Real>(clearance: &mut T, moved: T) {
    if *clearance >= T::zero() {
        *clearance = (*clearance - moved).max(T::zero());
    }
}

/// Resolves the collisions of the lanes in `group`.
#[inline(always)]
pub fn resolve<L: Lane>(
    solids: &Solids<'_, L::Scalar>,
    since: Since,
    view: &mut BlockView<'_, L::Scalar>,
    group: LaneGroup,
) -> SolidContacts {
    let LaneGroup { first, live } = group;
    let mut contacts = SolidContacts::default();
    if solids.solids.is_empty() {
        return contacts;
    }
    let start = usize::from(since == Since::Noted);
    let mut queue = Queue::new(start);
    let own = u32::MAX >> (32 - L::WIDTH.min(live - first));
    for i in solids.clamped.min(view.particles)..view.particles {
        let x = V3::<L>::load(view.positions, i, first);
        let last = L::load(&view.clearance[i], first);
        let (from, moved, left) = match since {
            Since::Substep => {
                let from = x.add_scaled(L::splat(-solids.h), V3::load(view.velocities, i, first));
                let (moved, left) = clearance_left(solids, last, from, x);
                (from, moved, left)
            }
            Since::Noted => (x, L::zero(), last),
        };
        let used_up = !L::bits(L::zero().lt(left)) & own;
        queue.push_lanes(used_up, i, first, Queued { last, moved, from });
        left.store(&mut view.clearance[i], first);
        let rest = if i + 1 < view.particles { PACKET } else { 1 };
        while queue.len >= rest {
            queue.resolve_packet(solids, view, &mut contacts);
        }
    }
    contacts
}

/// For particles that moved from `from` to `x` in a substep and had clearance `last`: an upper
/// bound of their displacement relative to the solid that moved most against them, and the
/// clearance that is left.
#[inline(always)]
fn clearance_left<L: Lane>(solids: &Solids<'_, L::Scalar>, last: L, from: V3<L>, x: V3<L>) -> (L, L) {
    let apart = solids.poses.len() > 1;
    let (mut moved, mut left) = (L::zero(), L::from_f64(f64::INFINITY));
    for pose in solids.poses {
        let by = pose.moved(from, x);
        // The distance from this solid at any time of the substep is at least the larger of two
        // bounds, less the relative displacement: the distance from the nearest solid at the start,
        // and the distance from this solid's bounding ball at the end. So the motion of a distant
        // solid does not use up the clearance.
        let distance =
            if apart { last.max(pose.distance_bound(x) - L::splat(solids.thickness)) } else { last };
        left = left.min(distance - by);
        moved = by.max(moved);
    }
    (moved, left)
}

#[inline(always)]
fn dot<T: Real>(a: [T; 3], b: [T; 3]) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
