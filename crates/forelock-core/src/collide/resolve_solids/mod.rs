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
//! A particle with a large displacement, in a substep or in the length pass, is tested along its
//! whole path (`sweep`), so that it does not tunnel through thin solids. Edges are sampled at
//! points between their particles, which are tested in the same way (`edges`). The surface velocity
//! of a shape that changes ([`Shape::Morph`](crate::body::Shape::Morph),
//! [`Shape::Bending`](crate::body::Shape::Bending)) counts in the contact.

mod bending;
mod edges;
mod lay_along;
mod levels;
mod near;
mod particle;
mod pose;
mod queue;
mod sweep;

use crate::body::{ColliderFrame, PACKET};
use crate::lane::{Lane, Real, V3};
use crate::strands::{BlockView, LaneGroup};
pub use bending::{COINCIDENT, HELD, NOWHERE, OPPOSITE, PINCHED};
pub use edges::{EDGE_ROUNDS, EDGE_SAMPLES, PASSES, REFINEMENTS, SKIN_SHARE, TAKE_BACK_ROUNDS};
pub use lay_along::{
    EXACT, EXACT_ROUNDS, FOLDS, LAG, LEAST_TURN, NEARLY, SHALLOW, SHORTER_STEPS, SLIDE_STEPS, SLIP,
    SPRING_STRETCH, STRETCHED, THIN, lay_along,
};
pub use levels::LevelSolids;
pub use particle::{CCD_MOTION, MAX_PUSHES, PROJECTION_ROUNDS};
pub use pose::{SolidMotion, SolidPose};
use queue::{Queue, Queued};
pub use sweep::{MOST_PARTS, SWEEP_STEPS, TOUCH};

/// WGSL of the stage.
pub const WGSL: &str =
    concat!(include_str!("edges.wgsl"), include_str!("lay_along.wgsl"), include_str!("kernel.wgsl"));
/// WGSL that resolves the collisions of one particle.
pub const PARTICLE_WGSL: &str = concat!(include_str!("particle.wgsl"), include_str!("bending.wgsl"));

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
    /// Share of a solid's thinness that an edge may move in this query without being tested. Slower
    /// edges wait for the frame's final query.
    pub slow_edges: T,
    /// Largest displacement in this query of a point of an edge that was inside before, metres.
    pub max_edge_push: T,
}

/// The contacts found by a query.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SolidContacts {
    /// Particles that touch or are inside a solid's skin.
    pub touching: u32,
    /// Strands of which an edge was moved.
    pub edges: u32,
    /// Lanes of the block, a bit a lane, whose strands touch a solid.
    pub lanes: u32,
    /// Largest depth under a surface (not the skin) that is left, metres.
    pub deepest: f64,
}

/// What has moved particles since the last query.
#[derive(Clone, Copy, Debug)]
pub enum Since<'a, L> {
    /// A substep: particles were at x − h v, and solids moved.
    Substep,
    /// A pass that displaced particles from these positions, an entry a particle. Solids are at
    /// rest.
    Displaced(&'a [V3<L>]),
    /// Interactions, which have subtracted displacements from the clearances
    /// ([`reduce_clearance`]). Solids are at rest.
    Noted,
}

/// The strands of a query: those of the lanes from `first` on whose bits are set in `lanes`.
#[derive(Clone, Copy, Debug)]
pub struct QueriedStrands {
    /// The first lane of the group.
    pub first: usize,
    /// A bit a lane; the lowest is that of `first`.
    pub lanes: u32,
}

impl QueriedStrands {
    /// All strands of a group of `L::WIDTH` lanes.
    #[inline(always)]
    pub fn all<L: Lane>(group: LaneGroup) -> Self {
        let LaneGroup { first, live } = group;
        Self { first, lanes: u32::MAX >> (32 - L::WIDTH.min(live - first)) }
    }
}

/// Vectors of scratch memory that [`resolve`] needs, a particle.
pub const QUERY_VECTORS: usize = 3;

/// Subtracts a displacement by `moved` from the clearances of particles `i`.
#[inline(always)]
fn reduce_clearances_of<L: Lane>(moved: L, view: &mut BlockView<'_, L::Scalar>, i: usize, first: usize) {
    let clearance = L::load(&view.clearance[i], first);
    // Below zero it is a depth, not a distance.
    let left = (clearance - moved).max(L::zero());
    L::select(clearance.lt(L::zero()), clearance, left).store(&mut view.clearance[i], first);
}

/// Subtracts a displacement from a clearance, for code that does not work on lanes.
#[inline]
pub fn reduce_clearance<T: Real>(clearance: &mut T, moved: T) {
    if *clearance >= T::zero() {
        *clearance = (*clearance - moved).max(T::zero());
    }
}

/// Resolves the collisions of the `queried` strands: those of their particles, then those of their
/// edges. `work` is scratch memory of [`QUERY_VECTORS`] vectors a particle.
#[inline(always)]
pub fn resolve<L: Lane>(
    solids: &Solids<'_, L::Scalar>,
    since: Since<'_, L>,
    view: &mut BlockView<'_, L::Scalar>,
    queried: QueriedStrands,
    work: &mut [V3<L>],
) -> SolidContacts {
    let mut contacts = SolidContacts::default();
    if solids.solids.is_empty() {
        return contacts;
    }
    let first_lane = queried.first;
    let (from, rest) = work.split_at_mut(view.particles);
    let (moved, before) = rest.split_at_mut(view.particles);
    resolve_particles(solids, since, view, queried, [&mut *from, &mut *moved], &mut contacts);
    let paths = edges::Paths {
        from: if let Since::Displaced(from) = since { from } else { from },
        moved,
        start: since.start(),
    };
    let moved = edges::resolve(solids, &paths, view, queried, before);
    if moved != 0 {
        // Edges moved particles, perhaps into solids.
        let queried = QueriedStrands { lanes: moved, ..queried };
        let touching = contacts.touching;
        resolve_again(solids, &paths, view, queried, before, &mut contacts);
        contacts.touching = touching;
        contacts.edges += moved.count_ones();
        contacts.lanes |= moved << first_lane;
        edges::take_back(solids, &paths, view, queried, before);
    }
    contacts
}

impl<L> Since<'_, L> {
    /// When the displacements began: at the substep's start (0) or at its end (1).
    fn start(&self) -> usize {
        usize::from(!matches!(self, Self::Substep))
    }
}

/// Resolves the collisions of particles. Writes to `paths` where they came from, and in the first
/// component of the second vector how far they moved relative to the solids.
#[inline(always)]
fn resolve_particles<L: Lane>(
    solids: &Solids<'_, L::Scalar>,
    since: Since<'_, L>,
    view: &mut BlockView<'_, L::Scalar>,
    queried: QueriedStrands,
    [came_from, displacement]: [&mut [V3<L>]; 2],
    contacts: &mut SolidContacts,
) {
    let QueriedStrands { first, lanes } = queried;
    let mut queue = Queue::new(since.start());
    let clamped = solids.clamped.min(view.particles);
    for i in 0..clamped {
        let x = V3::<L>::load(view.positions, i, first);
        let v = V3::load(view.velocities, i, first);
        came_from[i] = if since.start() == 0 { x.add_scaled(L::splat(-solids.h), v) } else { x };
        displacement[i] = V3::zero();
    }
    for i in clamped..view.particles {
        let x = V3::<L>::load(view.positions, i, first);
        let last = L::load(&view.clearance[i], first);
        let (from, moved, left) = match since {
            Since::Substep => {
                let from = x.add_scaled(L::splat(-solids.h), V3::load(view.velocities, i, first));
                let (moved, left) = clearance_left(solids, last, from, x);
                (from, moved, left)
            }
            Since::Displaced(from) => {
                let by = x - from[i];
                let moved = by.dot(by).sqrt();
                (from[i], moved, L::select(last.lt(L::zero()), last, last - moved))
            }
            Since::Noted => (x, L::zero(), last),
        };
        came_from[i] = from;
        displacement[i].0[0] = moved;
        let used_up = !L::bits(L::zero().lt(left)) & lanes;
        queue.push_lanes(used_up, i, first, Queued { last, moved, from });
        left.store(&mut view.clearance[i], first);
        let rest = if i + 1 < view.particles { PACKET } else { 1 };
        while queue.len >= rest {
            queue.resolve_packet(solids, view, contacts);
        }
    }
}

/// Resolves the collisions of particles that edges have moved from where they were `before`. One
/// whose straight path since the last query is free is not swept: an edge that went over the middle
/// of a solid comes back through it, and a sweep from `before` would stop its ends there.
#[inline(always)]
fn resolve_again<L: Lane>(
    solids: &Solids<'_, L::Scalar>,
    paths: &edges::Paths<'_, L>,
    view: &mut BlockView<'_, L::Scalar>,
    queried: QueriedStrands,
    before: &[V3<L>],
    contacts: &mut SolidContacts,
) {
    let QueriedStrands { first, lanes } = queried;
    let mut queue = Queue::new(1);
    for (i, &before) in before.iter().enumerate().take(view.particles).skip(solids.clamped) {
        let x = V3::<L>::load(view.positions, i, first);
        let last = L::load(&view.clearance[i], first);
        let by = x - before;
        let mut moved = by.dot(by).sqrt();
        let left = L::select(last.lt(L::zero()), last, last - moved);
        left.store(&mut view.clearance[i], first);
        let used_up = !L::bits(L::zero().lt(left)) & lanes;
        let mut swept = used_up & L::bits(L::zero().lt(moved));
        while swept != 0 {
            let lane = swept.trailing_zeros() as usize;
            swept &= swept - 1;
            if !is_blocked(solids, paths.start, paths.from[i].get(lane), x.get(lane), moved.get(lane)) {
                moved.set(lane, L::Scalar::default());
            }
        }
        queue.push_lanes(used_up, i, first, Queued { last, moved, from: before });
        let rest = if i + 1 < view.particles { PACKET } else { 1 };
        while queue.len >= rest {
            queue.resolve_packet(solids, view, contacts);
        }
    }
}

/// Whether a solid that is thinner than `moved` lies on the path between two points, of which the
/// first is one at the substep's start (`start` = 0) or end (1).
#[inline(never)]
fn is_blocked<T: Real>(solids: &Solids<'_, T>, start: usize, from: [T; 3], to: [T; 3], moved: T) -> bool {
    solids.solids.iter().zip(solids.poses).any(|(collider, pose)| {
        moved > crate::strands::number(collider.shape.thinness())
            && sweep::sweep(collider.shape, solids.thickness, &pose.sweep_path(start, from, to)).is_some()
    })
}

/// For particles that moved from `from` to `x` in a substep and had clearance `last`: an upper
/// bound of their displacement relative to the solid that moved most against them, and the
/// clearance that is left.
#[inline(always)]
fn clearance_left<L: Lane>(solids: &Solids<'_, L::Scalar>, last: L, from: V3<L>, x: V3<L>) -> (L, L) {
    let apart = solids.poses.len() > 1;
    let (mut moved, mut left) = (L::zero(), L::from_f64(f64::INFINITY));
    for (collider, pose) in solids.solids.iter().zip(solids.poses) {
        let by = pose.moved(from, x);
        // The distance from this solid at any time of the substep is at least the larger of two
        // bounds, less the relative displacement: the distance from the nearest solid at the start,
        // and the distance from this solid's bounding ball at the end. So the motion of a distant
        // solid does not use up the clearance.
        let distance =
            if apart { last.max(pose.distance_bound(x) - L::splat(solids.thickness)) } else { last };
        let mut near = distance - by;
        if pose.falls {
            near -= bending::fall(collider.shape, pose, from);
        }
        left = left.min(near);
        moved = by.max(moved);
    }
    (moved, left)
}

/// Depth of `x` under the surfaces of the solids that it is in.
fn depth<T: Real>(solids: &Solids<'_, T>, x: [T; 3]) -> f64 {
    let depths = solids.solids.iter().zip(solids.poses).map(|(collider, pose)| {
        let (distance, _) = collider.shape.sample_at(pose.local(1, x), pose.fractions[1]);
        distance.to_f64().map_or(0.0, |distance| -distance)
    });
    depths.fold(0.0, f64::max)
}

#[inline(always)]
fn dot<T: Real>(a: [T; 3], b: [T; 3]) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
