//! Hair against solids, at the end of every substep and after the lengths are restored (AMS, Sec. 3.3).
//!
//! # Theory
//! With σ the signed distance less the skin's thickness, n = ∇σ, and Δv the velocity relative to the solid at that
//! point: where σ < 0 and Δv approaches (Δv·n < 0), Δv_N = 0 and Coulomb friction leaves
//! Δv_T ← max(0, 1 − μ |Δv_N|/|Δv_T|) Δv_T; then x −= σ n.
//!
//! A particle that was inside at the last look (hair spawned in a solid, or a solid that jumped) is not pushed out at
//! once: it gains `depenetration_speed`·h of depth a substep, so that nothing explodes.
//!
//! Between two solids a particle is taken out of one after the other until it is in none (projections onto sets in turn); where they leave it no room it stays in one, and the
//! report says how deep.
//!
//! # Practice
//! σ is 1-Lipschitz, so a particle at distance σ cannot touch before it has moved σ relative to the solid. Each
//! particle carries that clearance, less what it has moved since, and is sampled only when it is used up. The decision
//! is a lane's own, so results do not depend on the SIMD width. Trilinear grids can rise √3 times as fast along a
//! diagonal: their clearance counts 1/√3.
//!
//! What moves far in a substep is looked for on its whole way (`sweep`), so that thin solids may be fast. A shape that changes
//! ([`Shape::Morph`]) meets hair with its surface's own velocity.

mod sweep;

use crate::body::{ColliderFrame, PACKET, Shape};
use crate::lane::{LANES, Lane, Mat3, Real, V3};
use crate::pose::Pose;
use crate::strands::BlockView;
use glam::{DVec3, Vec3};
pub use sweep::{SWEEP_STEPS, TOUCH};
use sweep::{Way, sweep};

/// WGSL of the stage.
pub const WGSL: &str = include_str!("kernel.wgsl");
/// WGSL that resolves the collisions of one particle.
pub const PARTICLE_WGSL: &str = include_str!("particle.wgsl");

/// Where a solid is at the start and the end of a substep, relative to the frame's origin.
#[derive(Clone, Copy, Debug)]
pub struct SolidPose<T> {
    rotations: [[[T; 3]; 3]; 2],
    translations: [[T; 3]; 2],
    /// World to world, from the start to the end, for a point that moves with the solid.
    carry: ([[T; 3]; 3], [T; 3]),
    /// The carrier at the end: where it is, its rotation vector and its translation over the substep.
    carrier: [[T; 3]; 3],
    /// A ball that holds the solid at the end; of infinite radius where there is none.
    ball: ([T; 3], T),
    /// The substep's start and end as fractions of the frame.
    fractions: [f64; 2],
    /// How far a shape that changes may move its surface in the substep.
    swell: T,
}

/// How a solid moves in a substep, relative to the frame's origin: what [`SolidPose`] holds in the solver's precision.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SolidMotion {
    /// Its poses at the substep's start and end.
    pub poses: [Pose; 2],
    /// World to world, from the start to the end, for a point that moves with the solid.
    pub carry: Pose,
    /// Where its carrier is at the end.
    pub pivot: DVec3,
    /// The carrier's rotation vector over the substep.
    pub spin: DVec3,
    /// The carrier's translation over the substep, metres.
    pub travel: DVec3,
    /// A ball that holds the solid at the end, if there is one: middle and radius, metres.
    pub ball: Option<(DVec3, f64)>,
    /// How far a shape that changes may move its surface in the substep, metres.
    pub swell: f64,
}

impl SolidMotion {
    /// The motion of `solid` between two `fractions` of its frame, relative to `origin`.
    pub fn new(solid: &ColliderFrame<'_>, fractions: [f64; 2], origin: DVec3) -> Self {
        let carrier = fractions.map(|fraction| solid.from.interpolate(&solid.to, fraction));
        let poses = carrier.map(|pose| {
            let own = pose.after(&solid.local);
            Pose { translation: own.translation - origin, ..own }
        });
        let ball = |(low, high): (Vec3, Vec3)| {
            let (low, high) = (low.as_dvec3(), high.as_dvec3());
            (poses[1].transform_point(0.5 * (low + high)), 0.5 * low.distance(high))
        };
        Self {
            poses,
            carry: poses[1].after(&poses[0].inverse()),
            pivot: carrier[1].translation - origin,
            spin: (carrier[1].rotation * carrier[0].rotation.conjugate()).to_scaled_axis(),
            travel: carrier[1].translation - carrier[0].translation,
            ball: solid.shape.bounds().map(ball),
            swell: match solid.shape {
                Shape::Morph { morph, phases: [from, to] } => {
                    let phases = (to - from).abs() * (fractions[1] - fractions[0]);
                    f64::from(morph.change()) * phases
                }
                _ => 0.0,
            },
        }
    }
}

impl<T: Real> SolidPose<T> {
    /// The poses of `solid` at `fractions` of its frame, relative to `origin`.
    pub fn new(solid: &ColliderFrame<'_>, fractions: [f64; 2], origin: DVec3) -> Self {
        let motion = SolidMotion::new(solid, fractions, origin);
        let number = crate::strands::number::<T>;
        let vector = |v: DVec3| v.to_array().map(number);
        let matrix = |pose: &Pose| {
            let m = pose.matrix();
            [m.row(0), m.row(1), m.row(2)].map(vector)
        };
        Self {
            rotations: [matrix(&motion.poses[0]), matrix(&motion.poses[1])],
            translations: motion.poses.map(|pose| vector(pose.translation)),
            carry: (matrix(&motion.carry), vector(motion.carry.translation)),
            carrier: [motion.pivot, motion.spin, motion.travel].map(vector),
            ball: motion
                .ball
                .map_or(([T::zero(); 3], T::infinity()), |(centre, radius)| (vector(centre), number(radius))),
            fractions,
            swell: number(motion.swell),
        }
    }

    #[inline(always)]
    fn world(&self, end: usize, q: [T; 3]) -> [T; 3] {
        let (turned, p) = (self.turn(end, q), self.translations[end]);
        [0, 1, 2].map(|c| turned[c] + p[c])
    }

    /// The way in the solid's space of a particle that goes from `from` (where it is at `start`: 0 the substep's start, 1 its end) to `to` at the
    /// substep's end.
    fn way(&self, start: usize, from: [T; 3], to: [T; 3]) -> Way<T> {
        Way {
            ends: [self.local(start, from), self.local(1, to)],
            fractions: [self.fractions[start], self.fractions[1]],
            swell: if start == 0 { self.swell } else { T::zero() },
        }
    }

    /// A lower bound of the distance of particles at `x` from the solid at the end of the substep, a lane.
    #[inline(always)]
    fn outside<L: Lane<Scalar = T>>(&self, x: V3<L>) -> L {
        let ([a, b, c], radius) = self.ball;
        let d = x - V3([L::splat(a), L::splat(b), L::splat(c)]);
        d.dot(d).sqrt() - L::splat(radius)
    }

    /// The same for one particle.
    #[inline(always)]
    fn outside_at(&self, x: [T; 3]) -> T {
        let (centre, radius) = &self.ball;
        let d = [0, 1, 2].map(|c| x[c] - centre[c]);
        dot(d, d).sqrt() - *radius
    }

    #[inline(always)]
    fn local(&self, end: usize, x: [T; 3]) -> [T; 3] {
        let (r, p) = (&self.rotations[end], &self.translations[end]);
        let d = [x[0] - p[0], x[1] - p[1], x[2] - p[2]];
        [0, 1, 2].map(|c| r[0][c] * d[0] + r[1][c] * d[1] + r[2][c] * d[2])
    }

    /// The same for a packet of points.
    #[inline(always)]
    fn local_packet(&self, x: &[[T; PACKET]; 3]) -> [[T; PACKET]; 3] {
        let (r, p) = (&self.rotations[1], &self.translations[1]);
        let mut local = [[T::zero(); PACKET]; 3];
        for c in 0..3 {
            for k in 0..PACKET {
                let (d0, d1, d2) = (x[0][k] - p[0], x[1][k] - p[1], x[2][k] - p[2]);
                local[c][k] = r[0][c] * d0 + r[1][c] * d1 + r[2][c] * d2;
            }
        }
        local
    }

    #[inline(always)]
    fn turn(&self, end: usize, v: [T; 3]) -> [T; 3] {
        self.rotations[end].map(|row| dot(row, v))
    }

    /// Velocity at the end, times h, of the solid's point at `x`: ω × (x − p) + dp/dt of what carries it.
    #[inline(always)]
    fn displacement(&self, x: [T; 3]) -> [T; 3] {
        let [p, spin, travel] = &self.carrier;
        let r = [x[0] - p[0], x[1] - p[1], x[2] - p[2]];
        [
            travel[0] + spin[1] * r[2] - spin[2] * r[1],
            travel[1] + spin[2] * r[0] - spin[0] * r[2],
            travel[2] + spin[0] * r[1] - spin[1] * r[0],
        ]
    }

    /// How far a particle moved relative to the solid, a lane.
    #[inline(always)]
    fn moved<L: Lane<Scalar = T>>(&self, from: V3<L>, to: V3<L>) -> L {
        let ([a, b, c], [x, y, z]) = &self.carry;
        let carried = V3([L::splat(*x), L::splat(*y), L::splat(*z)])
            .add_mul(&Mat3([splat_row(a), splat_row(b), splat_row(c)]), from);
        let d = to - carried;
        d.dot(d).sqrt() + L::splat(self.swell)
    }
}

#[inline(always)]
fn splat_row<L: Lane>([x, y, z]: &[L::Scalar; 3]) -> [L; 3] {
    [L::splat(*x), L::splat(*y), L::splat(*z)]
}

#[inline(always)]
fn dot<T: Real>(a: [T; 3], b: [T; 3]) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// The solids during one look at them.
#[derive(Clone, Copy, Debug)]
pub struct Solids<'a, T> {
    /// Shapes and friction.
    pub solids: &'a [ColliderFrame<'a>],
    /// Their poses in this substep.
    pub poses: &'a [SolidPose<T>],
    /// Distance kept from surfaces, metres.
    pub thickness: T,
    /// Depth that a particle which was inside may lose now, metres.
    pub way_out: T,
    /// Substep, seconds.
    pub h: T,
    /// Clamped particles, left alone.
    pub clamped: usize,
    /// Whether friction changes places too, for particles whose velocities follow from them.
    pub drags: bool,
}

/// What was found.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SolidContacts {
    /// Particles that touch or are inside a solid's skin.
    pub touching: u32,
    /// Greatest depth under a surface (not the skin) that is left, metres.
    pub deepest: f64,
}

/// What has happened since the last look.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Since {
    /// A substep: particles were at x − h v, and solids moved.
    Substep,
    /// Nothing that [`note_moves`] did not take off the clearances.
    Noted,
}

/// Takes off the clearances of lanes `first..first + L::WIDTH` what their particles moved from where they were `before`,
/// with solids where they are.
#[inline(always)]
pub fn note_moves<L: Lane>(before: &[V3<L>], view: &mut BlockView<'_, L::Scalar>, first: usize) {
    for (i, &from) in before.iter().enumerate() {
        let d = V3::load(view.positions, i, first) - from;
        note::<L>(d.dot(d).sqrt(), view, i, first);
    }
}

#[inline(always)]
fn note<L: Lane>(moved: L, view: &mut BlockView<'_, L::Scalar>, i: usize, first: usize) {
    let clearance = L::load(&view.clearance[i], first);
    // Below zero it is a depth, not a distance.
    let left = (clearance - moved).max(L::zero());
    L::select(clearance.lt(L::zero()), clearance, left).store(&mut view.clearance[i], first);
}

/// The same for one particle, outside the strands' own stages.
#[inline]
pub fn note_one<T: Real>(clearance: &mut T, moved: T) {
    if *clearance >= T::zero() {
        *clearance = (*clearance - moved).max(T::zero());
    }
}

/// Resolves lanes `first..first + L::WIDTH`, of which those from `live` on are padding.
#[inline(always)]
pub fn resolve<L: Lane>(
    solids: &Solids<'_, L::Scalar>,
    since: Since,
    view: &mut BlockView<'_, L::Scalar>,
    first: usize,
    live: usize,
) -> SolidContacts {
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
        let mut used_up = !L::bits(L::zero().lt(left)) & own;
        while used_up != 0 {
            let lane = used_up.trailing_zeros() as usize;
            queue.push((i, first + lane), (last.get(lane), moved.get(lane)), from.get(lane));
            used_up &= used_up - 1;
        }
        left.store(&mut view.clearance[i], first);
        let rest = if i + 1 < view.particles { PACKET } else { 1 };
        while queue.len >= rest {
            queue.settle(solids, view, &mut contacts);
        }
    }
    contacts
}

/// How far particles that went from `from` to `x` in a substep, and were `last` from the nearest solid, moved relative to the solid that moved most against them, and what that leaves of
/// their clearance.
#[inline(always)]
fn clearance_left<L: Lane>(solids: &Solids<'_, L::Scalar>, last: L, from: V3<L>, x: V3<L>) -> (L, L) {
    let apart = solids.poses.len() > 1;
    let (mut moved, mut left) = (L::zero(), L::from_f64(f64::INFINITY));
    for pose in solids.poses {
        let by = pose.moved(from, x);
        // On all its way a particle is as far from this solid as it was from the nearest, or as it is now from the ball around this one, less the way: what moves far off costs nothing.
        let distance = if apart { last.max(pose.outside(x) - L::splat(solids.thickness)) } else { last };
        left = left.min(distance - by);
        moved = by.max(moved);
    }
    (moved, left)
}

/// Solids that particles meet level by level along their strands, each level before the next is placed.
#[derive(Debug)]
pub struct LevelSolids<'a, T> {
    solids: Solids<'a, T>,
    queue: Queue<T>,
    /// What was found so far. The depth is one that no particle exceeds.
    pub contacts: SolidContacts,
}

impl<'a, T: Real> LevelSolids<'a, T> {
    /// Before the first level; none where there are no solids. Friction changes places too.
    #[inline(always)]
    pub fn new(solids: Solids<'a, T>) -> Option<Self> {
        let own = Self {
            solids: Solids { drags: true, ..solids },
            queue: Queue::new(0),
            contacts: SolidContacts::default(),
        };
        (!own.solids.solids.is_empty()).then_some(own)
    }

    /// Takes particles `i` of lanes `first..first + L::WIDTH`, of which those from `live` on are padding, out of solids on their way from `was`; the lanes that it moved.
    #[inline(always)]
    pub fn look<L: Lane<Scalar = T>>(
        &mut self,
        (i, was): (usize, V3<L>),
        view: &mut BlockView<'_, T>,
        (first, live): (usize, usize),
    ) -> L::Mask {
        let x = V3::<L>::load(view.positions, i, first);
        let last = L::load(&view.clearance[i], first);
        let (moved, left) = clearance_left(&self.solids, last, was, x);
        left.store(&mut view.clearance[i], first);
        let own = u32::MAX >> (32 - L::WIDTH.min(live - first));
        self.enter::<L>((i, first), !L::bits(L::zero().lt(left)) & own, (last, moved, was));
        self.settle(0, view);
        let by = V3::load(view.positions, i, first) - x;
        L::zero().lt(by.dot(by))
    }

    /// The same again for the lanes of `mask`, with solids where they are.
    #[inline(always)]
    pub fn look_again<L: Lane<Scalar = T>>(
        &mut self,
        i: usize,
        mask: L::Mask,
        view: &mut BlockView<'_, T>,
        first: usize,
    ) {
        let last = L::load(&view.clearance[i], first);
        let x = V3::<L>::load(view.positions, i, first);
        self.enter::<L>((i, first), !L::bits(L::zero().lt(last)) & L::bits(mask), (last, L::zero(), x));
        let touching = self.contacts.touching;
        self.settle(1, view);
        self.contacts.touching = touching;
    }

    /// Moves the lanes of `mask` to `x`.
    #[inline(always)]
    pub fn move_to<L: Lane<Scalar = T>>(
        &mut self,
        (i, x): (usize, V3<L>),
        mask: L::Mask,
        view: &mut BlockView<'_, T>,
        first: usize,
    ) {
        let old = V3::<L>::load(view.positions, i, first);
        let new = V3::select(mask, x, old);
        let by = new - old;
        let moved = by.dot(by).sqrt();
        let deeper = moved - L::load(&view.clearance[i], first) - L::splat(self.solids.thickness);
        let mut lanes = L::bits(mask);
        while lanes != 0 {
            let depth = deeper.get(lanes.trailing_zeros() as usize).to_f64().unwrap_or(0.0);
            self.contacts.deepest = self.contacts.deepest.max(depth);
            lanes &= lanes - 1;
        }
        note(moved, view, i, first);
        new.store(view.positions, i, first);
    }

    #[inline(always)]
    fn enter<L: Lane<Scalar = T>>(
        &mut self,
        (i, first): (usize, usize),
        mut lanes: u32,
        (last, moved, from): (L, L, V3<L>),
    ) {
        while lanes != 0 {
            let lane = lanes.trailing_zeros() as usize;
            self.queue.push((i, first + lane), (last.get(lane), moved.get(lane)), from.get(lane));
            lanes &= lanes - 1;
        }
    }

    #[inline(always)]
    fn settle(&mut self, start: usize, view: &mut BlockView<'_, T>) {
        self.queue.start = start;
        while self.queue.len > 0 {
            self.queue.settle(&self.solids, view, &mut self.contacts);
        }
    }
}

/// Particles that need a look, taken [`PACKET`] at a time, so that their lookups share instructions and wait together.
#[derive(Debug)]
struct Queue<T> {
    /// Where the solids were when the particles set out: at the substep's start (0) or end (1).
    start: usize,
    len: usize,
    /// Place in the block and lane.
    at: [(usize, usize); PACKET + LANES],
    /// Clearance at the last look.
    last: [T; PACKET + LANES],
    /// From where the particle came, and how far, relative to the solid that moved most against it.
    from: [[T; 3]; PACKET + LANES],
    moved: [T; PACKET + LANES],
}

impl<T: Real> Queue<T> {
    #[inline(always)]
    fn new(start: usize) -> Self {
        let none = [T::zero(); PACKET + LANES];
        let from = [[T::zero(); 3]; PACKET + LANES];
        Self { start, len: 0, at: [(0, 0); PACKET + LANES], last: none, from, moved: none }
    }

    #[inline(always)]
    fn push(&mut self, at: (usize, usize), (last, moved): (T, T), from: [T; 3]) {
        self.at[self.len] = at;
        self.last[self.len] = last;
        self.from[self.len] = from;
        self.moved[self.len] = moved;
        self.len += 1;
    }

    /// Takes a packet from the end and resolves it against all solids. A function of its own: most of its time is loads
    /// and rubbing, and inlined into the frame it costs the strand solve its registers. Made for AVX2 it
    /// gained 3 %.
    #[inline(never)]
    fn settle(&mut self, solids: &Solids<'_, T>, view: &mut BlockView<'_, T>, contacts: &mut SolidContacts) {
        let taken = self.len.min(PACKET);
        self.len -= taken;
        let at = &self.at[self.len..self.len + taken];
        let mut x = [[T::zero(); PACKET]; 3];
        let mut v = [[T::zero(); PACKET]; 3];
        for (k, &(i, lane)) in at.iter().enumerate() {
            for c in 0..3 {
                x[c][k] = view.positions[3 * i + c].0[lane];
                v[c][k] = view.velocities[3 * i + c].0[lane];
            }
        }
        let beyond_rounding = crate::strands::number(0.999);
        let mut clearance = [T::infinity(); PACKET];
        let mut touches = [false; PACKET];
        // Whether what took it out of one solid may have put it into another.
        let mut between = [false; PACKET];
        for (solid, pose) in solids.solids.iter().zip(solids.poses) {
            let thin = crate::strands::number(solid.shape.thinness());
            // What is nearer to another one already, did not come far, and is outside the ball around this one by more than that, neither touches it nor learns anything.
            let rise = lipschitz::<T>(solid.shape);
            let is_far = |k: usize| {
                let outside = pose.outside_at([x[0][k], x[1][k], x[2][k]]) - solids.thickness;
                self.moved[self.len + k] <= thin
                    && outside * beyond_rounding > clearance[k].max(T::zero()) * rise
            };
            if (0..taken).all(is_far) {
                continue;
            }
            let (distances, gradients) = solid.shape.sample_packet(&pose.local_packet(&x), pose.fractions[1]);
            for k in 0..taken {
                let place = [x[0][k], x[1][k], x[2][k]];
                let mut particle =
                    Particle { x: place, v: [v[0][k], v[1][k], v[2][k]], was: self.last[self.len + k] };
                let found = (distances[k], [gradients[0][k], gradients[1][k], gradients[2][k]]);
                let way = (self.start, self.from[self.len + k]);
                let caught = self.moved[self.len + k] > thin
                    && catch(solids, (solid, pose), found, way, &mut particle);
                let sigma =
                    if caught { T::zero() } else { settle(solids, (solid, pose), found, &mut particle) };
                if caught || found.0 < solids.thickness {
                    touches[k] = true;
                    let gone = [0, 1, 2].map(|c| particle.x[c] - place[c]);
                    between[k] |= clearance[k] < dot(gone, gone).sqrt();
                    for c in 0..3 {
                        x[c][k] = particle.x[c];
                        v[c][k] = particle.v[c];
                    }
                }
                let rise = if sigma > T::zero() { lipschitz(solid.shape) } else { T::one() };
                clearance[k] = clearance[k].min(sigma / rise);
            }
        }
        for k in 0..taken {
            // What was inside at the last look comes out by and by.
            if between[k] && self.last[self.len + k] >= T::zero() {
                let (place, velocity) = ([x[0][k], x[1][k], x[2][k]], [v[0][k], v[1][k], v[2][k]]);
                let mut particle = Particle { x: place, v: velocity, was: T::zero() };
                clearance[k] = settle_among(solids, &mut particle);
                for c in 0..3 {
                    x[c][k] = particle.x[c];
                    v[c][k] = particle.v[c];
                }
            }
        }
        for (k, &(i, lane)) in at.iter().enumerate() {
            view.clearance[i].0[lane] = clearance[k];
            if touches[k] {
                for c in 0..3 {
                    view.positions[3 * i + c].0[lane] = x[c][k];
                    view.velocities[3 * i + c].0[lane] = v[c][k];
                }
            }
            contacts.touching += u32::from(touches[k]);
            let depth = -(clearance[k] + solids.thickness).to_f64().unwrap_or(0.0);
            contacts.deepest = contacts.deepest.max(depth);
        }
    }
}

/// Gives edges back the length that solids took: root to tip, each particle of a strand whose `stretch` is over
/// `STRETCHED` goes to its rest length from the one before, and where that is inside a solid, along the surface.
///
/// # Theory
/// The points of the surface at distance l from the leader are found by projecting in turn onto the surface and onto
/// the sphere about the leader, each time to the nearest point: no round moves the particle further than it is wrong, so
/// that a small change of the start is a small change of the end. (The formula for a flat surface, which divides by the
/// part of the edge along it, makes strands that stand on a ridge jump from one side to the other.) Where the two do not
/// meet the length gives way.
///
/// The edge then turns but does not stretch: the follower's velocity relative to the leader loses its part along the
/// edge, as in the length pass.
#[inline(always)]
pub fn lay_along<L: Lane>(
    solids: &Solids<'_, L::Scalar>,
    stretch: L,
    view: &mut BlockView<'_, L::Scalar>,
    first: usize,
    live: usize,
) {
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
        let parting = edge.dot(v - V3::load(view.velocities, i - 1, first));
        let parting = L::select(stretched.lt(stretch), parting, L::zero());
        v.add_scaled(-parting, edge).store(view.velocities, i, first);
    }
}

/// Stretch, over the rest length, from which a strand's edges are laid anew.
pub const STRETCHED: f64 = 1e-5;

/// The point at `length` from `leader` near `x` that is outside all solids, if there is one, and its clearance.
fn slide<T: Real>(solids: &Solids<'_, T>, leader: [T; 3], mut x: [T; 3], length: T) -> ([T; 3], T) {
    // Once more where the way out of one solid may have ended in another.
    for _ in 0..3 {
        let (mut clearance, mut between) = (T::infinity(), false);
        for (solid, pose) in solids.solids.iter().zip(solids.poses) {
            let (place, bound) = slide_along(solids, (solid, pose), leader, x, length);
            let gone = [0, 1, 2].map(|c| place[c] - x[c]);
            between |= clearance < dot(gone, gone).sqrt();
            (x, clearance) = (place, clearance.min(bound));
        }
        if !between {
            return (x, clearance);
        }
    }
    (x, T::zero())
}

/// Looks for a point along one solid.
pub const SLIDES: usize = 4;

/// The same among one solid.
#[inline]
fn slide_along<T: Real>(
    solids: &Solids<'_, T>,
    (solid, pose): (&ColliderFrame<'_>, &SolidPose<T>),
    leader: [T; 3],
    mut x: [T; 3],
    length: T,
) -> ([T; 3], T) {
    for _ in 0..SLIDES {
        let (distance, gradient) = solid.shape.sample_at(pose.local(1, x), pose.fractions[1]);
        let sigma = distance - solids.thickness;
        if sigma >= T::zero() || sigma.is_nan() {
            return (x, sigma / lipschitz(solid.shape));
        }
        let n = pose.turn(1, gradient);
        let edge = [0, 1, 2].map(|c| x[c] - sigma * n[c] - leader[c]);
        let scale = length / dot(edge, edge).sqrt().max(T::min_positive_value());
        x = [0, 1, 2].map(|c| leader[c] + scale * edge[c]);
    }
    let (distance, gradient) = solid.shape.sample_at(pose.local(1, x), pose.fractions[1]);
    let sigma = distance - solids.thickness;
    if sigma >= T::zero() || sigma.is_nan() {
        return (x, sigma / lipschitz(solid.shape));
    }
    // No such point: solids go before lengths.
    let n = pose.turn(1, gradient);
    ([0, 1, 2].map(|c| x[c] - sigma * n[c]), T::zero())
}

/// How much faster than distance a shape's field can rise.
#[inline(always)]
fn lipschitz<T: Real>(shape: &Shape) -> T {
    if shape.cell().is_some() { T::from(3.0).unwrap_or_else(T::one).sqrt() } else { T::one() }
}

struct Particle<T> {
    x: [T; 3],
    v: [T; 3],
    /// Clearance at the last look.
    was: T,
}

/// One particle against one solid, of which distance and gradient were `found` where it is; the distance to its skin
/// that is left.
#[inline(always)]
fn settle<T: Real>(
    solids: &Solids<'_, T>,
    (solid, pose): (&ColliderFrame<'_>, &SolidPose<T>),
    found: (T, [T; 3]),
    particle: &mut Particle<T>,
) -> T {
    let zero = T::zero();
    let (mut sigma, mut gradient) = (found.0 - solids.thickness, found.1);
    if sigma >= zero || sigma.is_nan() {
        return sigma;
    }
    let normal = pose.turn(1, gradient);
    rub(solids, solid.friction, carried(solid, pose, particle.x, normal), normal, particle, false);
    // A grid's gradient is not exactly its direction to the surface: look again after a push that is not small
    // against a cell. Primitives are exact.
    let small_push =
        solid.shape.cell().map_or(T::infinity(), |cell| T::from(0.1 * cell).unwrap_or_else(T::zero));
    for look in 1..=LOOKS {
        let allowed =
            if particle.was < zero { (particle.was.max(sigma) + solids.way_out).min(zero) } else { zero };
        let push = allowed - sigma;
        if push <= zero {
            return sigma;
        }
        let normal = pose.turn(1, gradient);
        particle.x = [0, 1, 2].map(|c| particle.x[c] + push * normal[c]);
        if push < small_push || look == LOOKS {
            return allowed;
        }
        let (distance, there) = solid.shape.sample_at(pose.local(1, particle.x), pose.fractions[1]);
        (sigma, gradient) = (distance - solids.thickness, there);
        if sigma >= zero || sigma.is_nan() {
            return sigma;
        }
    }
    sigma
}

/// Pushes out of a field at one look.
pub const LOOKS: usize = 3;

/// Takes a particle out of one solid after the other until it is in none; the clearance that is left, negative where solids leave no room between them.
#[inline(never)]
fn settle_among<T: Real>(solids: &Solids<'_, T>, particle: &mut Particle<T>) -> T {
    for round in 0..=ROUNDS {
        let mut clearance = T::infinity();
        for (solid, pose) in solids.solids.iter().zip(solids.poses) {
            let found = solid.shape.sample_at(pose.local(1, particle.x), pose.fractions[1]);
            let sigma = found.0 - solids.thickness;
            let rise = if sigma > T::zero() { lipschitz(solid.shape) } else { T::one() };
            clearance = clearance.min(sigma / rise);
            // The last round only looks.
            if round < ROUNDS && sigma < T::zero() {
                settle(solids, (solid, pose), found, particle);
            }
        }
        // Out to rounding.
        if clearance > -crate::strands::number::<T>(1e-6) {
            return clearance.max(T::zero());
        }
        if round == ROUNDS {
            return clearance;
        }
    }
    T::zero()
}

/// Rounds in which a particle between solids is taken out of each.
pub const ROUNDS: usize = 8;

/// Stops a particle at the surface that it went through on its way from `from`, if it came out elsewhere or would be pushed out elsewhere; whether it did.
#[inline(never)]
fn catch<T: Real>(
    solids: &Solids<'_, T>,
    (solid, pose): (&ColliderFrame<'_>, &SolidPose<T>),
    found: (T, [T; 3]),
    (start, from): (usize, [T; 3]),
    particle: &mut Particle<T>,
) -> bool {
    // What was inside at the last look is on its way out.
    if particle.was < T::zero() {
        return false;
    }
    let way = pose.way(start, from, particle.x);
    if way.length() <= crate::strands::number(solid.shape.thinness()) {
        return false;
    }
    let Some((place, normal)) = sweep(solid.shape, solids.thickness, &way) else { return false };
    let same_side = dot(found.1, normal) > crate::strands::number(0.5);
    if found.0 < solids.thickness && same_side {
        return false;
    }
    particle.x = pose.world(1, place);
    let normal = pose.turn(1, normal);
    rub(solids, solid.friction, carried(solid, pose, particle.x, normal), normal, particle, true);
    true
}

/// How far the solid's surface at `x`, of normal `normal`, moves in the substep: with the solid, and along the normal where its shape changes.
#[inline(always)]
fn carried<T: Real>(solid: &ColliderFrame<'_>, pose: &SolidPose<T>, x: [T; 3], normal: [T; 3]) -> [T; 3] {
    let moved = pose.displacement(x);
    if pose.swell == T::zero() {
        return moved;
    }
    let [before, now] = pose.fractions.map(|fraction| solid.shape.sample_at(pose.local(1, x), fraction).0);
    [0, 1, 2].map(|c| moved[c] + (before - now) * normal[c])
}

/// Stops the approach to a solid whose point moves by `displacement` in h, with Coulomb friction.
#[inline(always)]
fn rub<T: Real>(
    solids: &Solids<'_, T>,
    friction: f64,
    displacement: [T; 3],
    normal: [T; 3],
    particle: &mut Particle<T>,
    caught: bool,
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
        // What was stopped on its way has lost what was left of it.
        if solids.drags && !caught {
            particle.x[c] = particle.x[c] - solids.h * (T::one() - kept) * tangential[c];
        }
    }
}
