//! Restores the lengths of edges that collisions stretched, by moving particles along the surfaces
//! of solids.

use super::edges::{Samples, distance, lerp, passes};
use super::particle::{Solid, lipschitz};
use super::sweep::sweep;
use super::{Solids, bending, depth, dot};
use crate::body::Shape;
use crate::lane::{Lane, Real, V3};
use crate::strands::{BlockView, LaneGroup, number, vector};

/// Restores the lengths of edges that collisions stretched. In each strand whose `stretch` is over
/// `limit`, the free particles are visited from root to tip. Each is moved towards the particle
/// before it (the leader) to the rest length l. Where a solid is in the way it follows the old
/// curve of the strand instead. Where the new edge is in a solid, it is turned about the leader
/// until it touches the solid. `old` is scratch memory of a vector a particle. Returns the largest
/// depth of a particle that was left in a solid.
///
/// The limit is one of three. [`STRETCHED`]: a length pass precedes, and surfaces have precedence
/// over lengths, except for skin that bends ([`PINCHED`](super::PINCHED)). [`EXACT`]: lengths have
/// precedence. [`SPRING_STRETCH`], for strands whose lengths only springs keep: edges keep the
/// lengths that they have, up to that stretch.
///
/// # Theory
/// The old curve is outside all solids. The part of the strand that has been placed, the way back
/// from its end to the old curve, and the rest of that curve stay outside too, so that no solid
/// passes through the strand: a strand that a plate pulls taut slips over the plate's rim at its
/// length.
///
/// A point of the edge at distance s from the leader and at depth −σ in a solid comes out where the
/// edge turns by asin(−σ/s) towards the normal of the surface through which it entered. Turns are
/// repeated for the point that needs the largest one, up to [`SLIDE_STEPS`] times. Where no
/// direction is free, as where the rim of a thin plate lies between the leader and the follower,
/// the edge is made as little shorter as it takes ([`SHORTER_STEPS`]), until it is laid again;
/// where that does not help it stays stretched or in the solid, as the limit says.
///
/// Afterwards the particle's velocity relative to the leader loses its component along the edge, as
/// in the length pass, so that the edge can turn but does not change its length.
#[inline(always)]
pub fn lay_along<L: Lane>(
    solids: &Solids<'_, L::Scalar>,
    stretch: L,
    limit: f64,
    view: &mut BlockView<'_, L::Scalar>,
    group: LaneGroup,
    old: &mut [V3<L>],
) -> f64 {
    let LaneGroup { first, live } = group;
    let mut deepest = 0.0f64;
    let most = L::from_f64(limit);
    if L::all(stretch.lt(most)) {
        return deepest;
    }
    let n = view.particles;
    let from = solids.clamped.max(1);
    for (i, x) in old.iter_mut().enumerate().take(n) {
        *x = V3::load(view.positions, i, first);
    }
    // The old curve of a strand that is being pushed out of a solid is not outside: it waits, if
    // another pass keeps its lengths.
    let mut least = L::zero();
    for i in from..n {
        least = L::load(&view.clearance[i], first).min(least);
    }
    let is_pushed_out = least.lt(-L::splat(solids.thickness));
    // Hair that parts of a body that bends hold between them is marked as being pushed out, and it
    // has no other place.
    let may_hold = bending::may_hold(solids);
    let asked = stretch;
    let waits = may_hold || follows_pass(limit);
    let mut stretch = if waits { L::select(is_pushed_out, L::zero(), stretch) } else { stretch };
    for lane in 0..L::WIDTH.min(live - first) {
        if stretch.get(lane) > most.get(lane) {
            let mut curve = Curve {
                points: &old[..n],
                lane,
                is_outside: least.get(lane) >= -solids.thickness,
                edge: from - 1,
                share: L::Scalar::default(),
            };
            deepest = deepest.max(lay_strand(solids, limit, view, [first + lane, from], &mut curve));
        }
    }
    if may_hold {
        for lane in (0..L::WIDTH.min(live - first)).filter(|&lane| asked.get(lane) > most.get(lane)) {
            let left = bending::limit_stretch(solids, limit, view, [first + lane, from]);
            deepest = deepest.max(left);
        }
        stretch = asked;
    }
    for i in from..n {
        let edge = V3::<L>::load(view.positions, i, first) - V3::load(view.positions, i - 1, first);
        let edge = edge.scale(L::one() / edge.dot(edge).max(L::from_f64(1e-24)).sqrt());
        let v = V3::<L>::load(view.velocities, i, first);
        let separation = edge.dot(v - V3::load(view.velocities, i - 1, first));
        let separation = L::select(most.lt(stretch), separation, L::zero());
        v.add_scaled(-separation, edge).store(view.velocities, i, first);
    }
    deepest
}

/// Stretch, relative to the rest length, above which the edges of a strand are restored.
pub const STRETCHED: f64 = 1e-5;

/// The limit of strands of which every edge must have its rest length.
pub const EXACT: f64 = 0.0;

/// Stretch of an edge that a pass may be left to restore, where no direction is free at its length.
pub const NEARLY: f64 = 0.02;

/// Bisections in the search for the longest edge for which a direction is free, for a frame where
/// none is at its length, as at a rim between its ends: the curve up to there is outside.
pub const SHORTER_STEPS: usize = 5;

/// Thinness of a solid, over the length of an edge that is left in it, below which the edge is made
/// shorter although lengths have precedence: the solid would cut the strand.
pub const THIN: f64 = 0.3;

/// Rounds of projections onto the surfaces and onto the rest length of a particle for which no
/// direction is free, where no length pass follows.
pub const EXACT_ROUNDS: usize = 8;

/// The limit of strands without a length pass. Their springs give way by less under their weight.
pub const SPRING_STRETCH: f64 = 0.04;

/// Distance from the leader to the next place on the old curve, over the edge's length, below which
/// the particle follows the curve.
pub const FOLDS: f64 = 0.7;

/// Distance of a leader from its place on the old curve, over the edge's length, above which the
/// particle follows the curve, if no solid is thinner than [`THIN`].
pub const LAG: f64 = 1.0;

/// Distance by which a leader may be ahead of its place on the old curve, over the edge's length,
/// without the next edge being turned back towards that place. A rim around which a strand has
/// been pulled lies farther back.
pub const SLIP: f64 = 0.1;

/// Whether `limit` is that of strands which a length pass precedes.
fn follows_pass(limit: f64) -> bool {
    limit > 0.0 && limit <= STRETCHED
}

/// Restores the lengths of the strand in `lane`, of which the particles before `from` are clamped.
/// Returns the largest depth that is left.
#[inline(never)]
fn lay_strand<L: Lane>(
    solids: &Solids<'_, L::Scalar>,
    limit: f64,
    view: &mut BlockView<'_, L::Scalar>,
    [lane, from]: [usize; 2],
    curve: &mut Curve<'_, L>,
) -> f64 {
    let zero = L::Scalar::default();
    let mut deepest = 0.0f64;
    let has_pass = follows_pass(limit);
    let thinness = solids.solids.iter().map(|solid| solid.shape.thinness());
    let thinnest = number::<L::Scalar>(thinness.fold(f64::INFINITY, f64::min));
    let mut leader = vector(view.positions, from - 1, lane);
    let mut before = vector(view.positions, from.max(2) - 2, lane);
    let mut leader_clearance = if solids.clamped > 0 { zero } else { view.clearance[from - 1].0[lane] };
    for i in from..view.particles {
        let mut length = view.rest_lengths[3 * (i - 1)].0[lane];
        if limit > STRETCHED {
            let now = distance(curve.point(i - 1), curve.point(i));
            let [least, most] = [-limit, limit].map(|by| length * (number::<L::Scalar>(1.0) + number(by)));
            length = if now < least {
                least
            } else if now > most {
                most
            } else {
                now
            };
        }
        let goal = curve.next();
        let mut x = at_distance(leader, goal, length);
        let moved = distance(x, goal);
        // A leader that has slipped past its place would fold the strand; between one that is far
        // from its place and the goal, the way along the curve may lead around a solid.
        let leaves = distance(leader, goal) < number::<L::Scalar>(FOLDS) * length
            || (distance(leader, curve.place()) > number::<L::Scalar>(LAG) * length
                && thinnest >= number::<L::Scalar>(THIN) * length);
        // Where the strand has slipped, the goal is between two particles of the old curve.
        let known = if curve.edge + 1 == i && curve.share == zero { view.clearance[i].0[lane] } else { zero };
        let mut clearance = known - moved;
        let is_near = clearance <= zero || clearance + leader_clearance <= length;
        if known >= zero && (is_near || leaves) {
            let turn = Turn { corner: None, leader, length, is_root: i <= solids.clamped };
            let found = if leaves { None } else { turn.find(solids, x).ok() };
            let found = found.filter(|(x, _)| !is_between(solids, goal, *x));
            (x, clearance) = if let Some(found) = found {
                curve.edge += 1;
                found
            } else {
                curve.search(solids, &turn, before, limit).unwrap_or_else(|x| {
                    // Where no direction is free the length has precedence, unless a pass restores
                    // it.
                    if has_pass {
                        return (project(solids, x), zero);
                    }
                    let x = (0..EXACT_ROUNDS).fold(x, |x, _| at_distance(leader, project(solids, x), length));
                    deepest = deepest.max(depth(solids, x));
                    (x, zero)
                })
            };
        } else {
            curve.edge += 1;
            // Below zero it is a depth, not a distance.
            clearance = if known < zero { known } else { clearance };
        }
        view.clearance[i].0[lane] = clearance;
        for (row, x) in view.positions[3 * i..3 * i + 3].iter_mut().zip(x) {
            row.0[lane] = x;
        }
        (before, leader, leader_clearance) = (leader, x, clearance);
    }
    deepest
}

/// Whether a solid lies between two points. One that is too thick to fit between them does not.
#[inline(always)]
fn is_between<T: Real>(solids: &Solids<'_, T>, from: [T; 3], to: [T; 3]) -> bool {
    solids.solids.iter().zip(solids.poses).any(|(collider, pose)| {
        let path = pose.sweep_path(1, from, to);
        path.length() > number(collider.shape.thinness())
            && sweep(collider.shape, solids.thickness, &path).is_some()
    })
}

/// The old curve of a strand, and the place on it up to which the strand has been placed.
struct Curve<'a, L: Lane> {
    points: &'a [V3<L>],
    /// Lane of the points.
    lane: usize,
    /// Whether it is not being pushed out of a solid.
    is_outside: bool,
    /// The edge of the curve on which the place is, and where on it, 0 to 1.
    edge: usize,
    share: L::Scalar,
}

impl<L: Lane> Curve<'_, L> {
    fn point(&self, i: usize) -> [L::Scalar; 3] {
        self.points[i].get(self.lane)
    }

    /// The place up to which the strand has been placed.
    fn place(&self) -> [L::Scalar; 3] {
        let last = self.points.len() - 1;
        if self.edge < last {
            lerp(self.point(self.edge), self.point(self.edge + 1), self.share)
        } else {
            self.point(last)
        }
    }

    /// The place one edge on. Beyond its end the curve goes on straight.
    #[inline(always)]
    fn next(&self) -> [L::Scalar; 3] {
        let last = self.points.len() - 1;
        if self.edge + 1 < last {
            return lerp(self.point(self.edge + 1), self.point(self.edge + 2), self.share);
        }
        let beyond = number::<L::Scalar>((self.edge + 1 - last) as f64) + self.share;
        lerp(self.point(last - 1), self.point(last), number::<L::Scalar>(1.0) + beyond)
    }

    /// Searches along the curve for the place of the next particle of `turn`, at shorter distances
    /// if no direction is free at its length. `before` is the particle before the leader. Returns
    /// the place and its clearance, or the last place that was tried at its length.
    #[inline(never)]
    fn search(
        &mut self,
        solids: &Solids<'_, L::Scalar>,
        turn: &Turn<L::Scalar>,
        before: [L::Scalar; 3],
        limit: f64,
    ) -> Place<L::Scalar> {
        let from = (self.edge, self.share);
        let (place, corner) = self.follow([before, turn.leader], turn.length);
        let free = |turn: &Turn<L::Scalar>, place| {
            let found = turn.find(solids, place);
            found.and_then(|(x, own)| if is_between(solids, place, x) { Err(x) } else { Ok((x, own)) })
        };
        let mut found = free(&Turn { corner, ..*turn }, place);
        if found.is_err() && corner.is_some() {
            // The corner may lie beside the edge on the solid's side.
            found = free(turn, place).or(found);
        }
        if let (Err(x), true) = (found, follows_pass(limit)) {
            // Nearly at its length on the surface.
            let x = project(solids, x);
            let nearly = Turn { corner: None, length: distance(turn.leader, x), ..*turn };
            if nearly.stays_within(turn.length)
                && let Ok(clearance) = nearly.test_all(solids, x)
                && !is_between(solids, place, x)
            {
                return Ok((x, clearance));
            }
        }
        let Err(x) = found else { return found };
        let is_cut = limit > EXACT || turn.meets_thin(solids, x);
        if !is_cut || !self.is_outside || !self.is_free(solids, from.0) {
            return found;
        }
        // The longest edge for which a direction is free, by bisection.
        let mut end = (self.edge, self.share);
        let mut shorter = Turn { corner: None, ..*turn };
        let (mut least, mut most) = (L::Scalar::default(), turn.length);
        for _ in 0..SHORTER_STEPS {
            (self.edge, self.share) = from;
            shorter.length = (least + most) * number(0.5);
            let (place, _) = self.follow([before, turn.leader], shorter.length);
            if let Ok(place) = free(&shorter, place) {
                (found, end) = (Ok(place), (self.edge, self.share));
                least = shorter.length;
            } else {
                most = shorter.length;
            }
        }
        (self.edge, self.share) = end;
        found
    }

    /// Whether the curve is outside all solids from edge `from` on to its place.
    fn is_free(&self, solids: &Solids<'_, L::Scalar>, from: usize) -> bool {
        let last = self.edge.min(self.points.len() - 2);
        (from..=last).all(|edge| {
            let ends = [self.point(edge), self.point(edge + 1)];
            let poses = solids.solids.iter().zip(solids.poses);
            !poses.into_iter().any(|(collider, pose)| passes(solids, Solid { collider, pose }, 1, ends))
        })
    }

    /// Moves on to the first place at distance `length` from `leader`, on the way back to the curve
    /// and then along it. Returns the place, and the corner of that way that the straight edge cuts
    /// off most, if there is one. Beyond the curve's end the strand goes on straight: `placed` are
    /// the last two particles.
    #[inline(always)]
    fn follow(
        &mut self,
        placed: [[L::Scalar; 3]; 2],
        length: L::Scalar,
    ) -> ([L::Scalar; 3], Option<[L::Scalar; 3]>) {
        let tip = self.points.len() - 1;
        let [before, leader] = placed;
        if self.edge >= tip {
            return (at_distance(leader, lerp(before, leader, number(2.0)), length), None);
        }
        let back = lerp(self.point(self.edge), self.point(self.edge + 1), self.share);
        if distance(leader, back) > length {
            return (at_distance(leader, back, length), None);
        }
        let passed = self.edge + 1;
        let mut place = self.point(tip);
        while self.edge < tip {
            let ends = [self.edge, self.edge + 1].map(|i| self.point(i));
            if let Some(share) = leaves_sphere(leader, length, ends) {
                // It does not move back.
                self.share = if share > self.share { share } else { self.share };
                place = lerp(ends[0], ends[1], self.share);
                break;
            }
            self.edge += 1;
            self.share = L::Scalar::default();
        }
        let x = at_distance(leader, place, length);
        let (mut corner, mut most) = (None, number::<L::Scalar>(1e-3) * length);
        for i in passed - 1..=self.edge.min(tip - 1) {
            let point = if i < passed { back } else { self.point(i) };
            let beside = distance_to_line(leader, x, point);
            if beside > most {
                // A turn towards the place that the leader has slipped from would fold the strand.
                let [to_point, to_x] = [point, x].map(|p| [0, 1, 2].map(|c| p[c] - leader[c]));
                let slipped = i < passed
                    && dot(to_point, to_x) <= L::Scalar::default()
                    && distance(leader, point) < number::<L::Scalar>(SLIP) * length;
                (corner, most) = ((!slipped).then_some(point), beside);
            }
        }
        (x, corner)
    }
}

/// Distance of `point` from the line through `a` and `b`.
fn distance_to_line<T: Real>(a: [T; 3], b: [T; 3], point: [T; 3]) -> T {
    let (d, p) = ([0, 1, 2].map(|c| b[c] - a[c]), [0, 1, 2].map(|c| point[c] - a[c]));
    let along = dot(p, d) / dot(d, d);
    let across = [0, 1, 2].map(|c| p[c] - along * d[c]);
    dot(across, across).sqrt()
}

/// Where the segment between two `ends` leaves the sphere about `centre`, 0 to 1, if its second end
/// is outside.
#[inline(always)]
fn leaves_sphere<T: Real>(centre: [T; 3], radius: T, ends: [[T; 3]; 2]) -> Option<T> {
    let [a, b] = ends.map(|end| [0, 1, 2].map(|c| end[c] - centre[c]));
    if dot(b, b) < radius * radius {
        return None;
    }
    // |a + u g| = radius: the larger root, without cancellation.
    let g = [0, 1, 2].map(|c| b[c] - a[c]);
    let (square, half, rest) = (dot(g, g), dot(a, g), dot(a, a) - radius * radius);
    let root = (half * half - square * rest).max(T::zero()).sqrt();
    let share = if half > T::zero() { -rest / (half + root) } else { (root - half) / square };
    Some(if share.is_nan() { T::one() } else { share.min(T::one()) })
}

/// The point in the direction of `x` at distance `length` from `leader`.
pub(super) fn at_distance<T: Real>(leader: [T; 3], x: [T; 3], length: T) -> [T; 3] {
    let edge = [0, 1, 2].map(|c| x[c] - leader[c]);
    let scale = length / dot(edge, edge).sqrt().max(T::min_positive_value());
    [0, 1, 2].map(|c| leader[c] + scale * edge[c])
}

/// `x` moved to the surfaces of the solids that it is in.
pub(super) fn project<T: Real>(solids: &Solids<'_, T>, mut x: [T; 3]) -> [T; 3] {
    for (collider, pose) in solids.solids.iter().zip(solids.poses) {
        let (distance, gradient) = collider.shape.sample_at(pose.local(1, x), pose.fractions[1]);
        let sigma = distance - solids.thickness;
        if sigma < T::zero() {
            let n = pose.turn(1, gradient);
            x = [0, 1, 2].map(|c| x[c] - sigma * n[c]);
        }
    }
    x
}

/// Most turns of an edge in the search for a direction in which it is outside all solids.
pub const SLIDE_STEPS: usize = 16;

/// Depth in a rigid field, over its thinness, up to which its gradient is the normal of the surface
/// through which an edge enters it.
pub const SHALLOW: f64 = 0.25;

/// Least angle of a turn, radians.
pub const LEAST_TURN: f64 = 1e-3;

/// The search for a place of a particle at `length` from its leader where the edge is outside all
/// solids.
struct Turn<T> {
    /// A place that the edge cuts off, and towards which it turns; `None`: it turns towards the
    /// surface's normal.
    corner: Option<[T; 3]>,
    leader: [T; 3],
    length: T,
    /// The leader may be inside a solid.
    is_root: bool,
}

/// A particle's place and its clearance, or the last place that was tried if none is free.
type Place<T> = Result<([T; 3], T), [T; 3]>;

/// The point of an edge that is inside a solid and needs the largest turn.
struct Inside<'a, T> {
    /// Sine of the turn that brings it out, if the edge turns towards the normal.
    sine: T,
    solid: Solid<'a, T>,
    point: [T; 3],
    /// The solid's gradient there.
    gradient: [T; 3],
    /// Distance kept from the surface.
    thickness: T,
    /// Depth under that distance.
    depth: T,
}

impl<T: Real> Inside<'_, T> {
    /// The normal of the surface through which the edge enters the solid, seen from the leader.
    fn normal(&self, leader: [T; 3]) -> [T; 3] {
        let Solid { collider, pose } = self.solid;
        // Near the surface of a rigid field no other one is nearer; parts of a body that bends may
        // press into each other.
        let is_rigid = matches!(collider.shape, Shape::Sdf(_));
        if is_rigid && self.depth < number(SHALLOW * collider.shape.thinness()) {
            return pose.turn(1, self.gradient);
        }
        let path = pose.sweep_path(1, leader, self.point);
        let touch = sweep(collider.shape, self.thickness, &path);
        pose.turn(1, touch.map_or(self.gradient, |(_, normal)| normal))
    }
}

impl<T: Real> Turn<T> {
    /// Searches from the direction of `x`. Returns the particle's place and its clearance, or the
    /// last place if no direction is free.
    #[inline(never)]
    fn find(&self, solids: &Solids<'_, T>, mut x: [T; 3]) -> Place<T> {
        for _ in 0..SLIDE_STEPS {
            let inside = match self.test_all(solids, x) {
                Ok(clearance) => return Ok((x, clearance)),
                Err(inside) => inside,
            };
            let Some(turned) = self.turned(x, &inside) else { break };
            x = turned;
        }
        Err(x)
    }

    /// Whether the edge with the particle at `x` passes through a solid that is thin beside it.
    fn meets_thin(&self, solids: &Solids<'_, T>, x: [T; 3]) -> bool {
        solids.solids.iter().zip(solids.poses).any(|(collider, pose)| {
            let thinness = number::<T>(collider.shape.thinness());
            thinness < number::<T>(THIN) * self.length
                && passes(solids, Solid { collider, pose }, 1, [self.leader, x])
        })
    }

    /// Whether the edge is as long as one of `length`, up to [`NEARLY`].
    fn stays_within(&self, length: T) -> bool {
        (self.length - length).abs() < number::<T>(NEARLY) * length
    }

    /// Tests the edge with the particle at `x` against all solids. Returns the particle's
    /// clearance, or the point of the edge that needs the largest turn.
    #[inline(always)]
    fn test_all<'a>(&self, solids: &Solids<'a, T>, x: [T; 3]) -> Result<T, Inside<'a, T>> {
        let (mut clearance, mut inside) = (T::infinity(), None);
        for (collider, pose) in solids.solids.iter().zip(solids.poses) {
            clearance = clearance.min(self.test(solids, Solid { collider, pose }, x, &mut inside));
        }
        inside.map_or(Ok(clearance), Err)
    }

    /// The place of the particle at `x` after a turn about the leader; `None` if it cannot turn.
    fn turned(&self, x: [T; 3], inside: &Inside<'_, T>) -> Option<[T; 3]> {
        let normal = inside.normal(self.leader);
        let inverse = T::one() / self.length;
        let d = [0, 1, 2].map(|c| (x[c] - self.leader[c]) * inverse);
        let across = |v: [T; 3]| {
            let along = dot(v, d);
            [0, 1, 2].map(|c| v[c] - along * d[c])
        };
        let (e, limit) = if let Some(corner) = self.corner {
            let to_corner = [0, 1, 2].map(|c| corner[c] - self.leader[c]);
            let e = across(to_corner);
            (e, (dot(e, e) / dot(to_corner, to_corner)).sqrt())
        } else {
            (across(normal), number(0.7))
        };
        let size = dot(e, e).sqrt();
        // The edge points straight into the surface or at the corner.
        let least = if self.corner.is_none() { number(1e-3) } else { T::zero() };
        if size <= least || size.is_nan() {
            return None;
        }
        let rise = (dot(e, normal) / size).max(number(0.25));
        let sine = (inside.sine / rise + number(LEAST_TURN)).min(limit).min(number(0.7));
        let cosine = (T::one() - sine * sine).sqrt();
        let turned = [0, 1, 2].map(|c| self.leader[c] + cosine * d[c] + sine / size * e[c]);
        Some(at_distance(self.leader, turned, self.length))
    }

    /// Tests the edge with the particle at `x` against `solid`: replaces `inside` by the point that
    /// needs a larger turn. Returns the particle's clearance from the solid.
    fn test<'a>(
        &self,
        solids: &Solids<'a, T>,
        solid: Solid<'a, T>,
        x: [T; 3],
        inside: &mut Option<Inside<'a, T>>,
    ) -> T {
        let Solid { collider, pose } = solid;
        let bound = pose.distance_bound_at(x) - solids.thickness;
        if bound > self.length {
            return bound;
        }
        let samples = Samples::of_edge(solids, solid, 1, [self.leader, x], true);
        let mut clearance = T::zero();
        for k in 0..samples.count {
            let t = samples.parameters[k];
            let is_particle = k + 1 == samples.count;
            let thickness = if is_particle { solids.thickness } else { samples.thickness };
            let sigma = samples.distances[k] - thickness;
            if is_particle {
                clearance = sigma.max(T::zero()) / lipschitz(collider.shape);
            }
            let sine = -sigma / (t * self.length);
            // Rounding does not count.
            if sigma >= number(-1e-6)
                || sigma.is_nan()
                || inside.as_ref().is_some_and(|inside| inside.sine >= sine)
            {
                continue;
            }
            // Roots may be inside a solid, and so may be the start of their edges.
            if self.is_root && !is_particle && t < number(0.5) {
                continue;
            }
            let (point, gradient) = (samples.point(k), samples.gradient(k));
            *inside = Some(Inside { sine, solid, point, gradient, thickness, depth: -sigma });
        }
        clearance
    }
}
