//! Collisions of the edges between particles.
//!
//! # Theory
//! Points x(t) = (1 − t) x_a + t x_b of an edge are tested as particles are: swept along their path
//! where they moved far, projected onto the surface where they are inside. A displacement Δ of such
//! a point is shared by the ends a and b, of inverse masses w, so that the point moves by Δ and the
//! ends' common momentum changes as little as possible:
//!
//! ```text
//! Δ_a = w_a (1 − t) Δ / s ,   Δ_b = w_b t Δ / s ,   s = w_a (1 − t)² + w_b t²
//! ```
//!
//! Friction changes the velocity of the point, and the change is shared in the same way.
//!
//! # Practice
//! An edge of length l whose ends have the clearances c_a and c_b can touch a solid only if c_a +
//! c_b < l, since σ is 1-Lipschitz. Up to [`EDGE_SAMPLES`] points are tested: of a field, which is
//! smooth over a cell, about one a cell; of a primitive, which may have sharp edges, all, and the
//! deepest one is refined by bisection. Edges keep a tenth of the skin's thickness: a chord of 1 cm
//! between particles that lie on a head is 0.2 mm deeper than they are, and stays free.
//!
//! # Limitations
//! Parts of solids that are thinner than the distance between two points can pass between them.

use super::near::{CHUNK, Nearby};
use super::particle::{Particle, Sample, Solid, ccd_motion, lipschitz, resolve_ccd_hit, resolve_penetration};
use super::sweep::{SweepPath, TOUCH, parts_of};
use super::{QueriedStrands, Solids, dot};
use crate::body::{PACKET, Shape};
use crate::lane::{Lane, Real, V3, widest};
use crate::strands::{BlockView, number};

/// Most points of an edge that are tested.
pub const EDGE_SAMPLES: usize = PACKET - 1;

/// Rounds in which an edge is pushed out at the point that has to move farthest.
pub const EDGE_ROUNDS: usize = 6;

/// Skin of edges over that of particles.
pub const SKIN_SHARE: f64 = 0.1;

/// Where particles came from in a query, an entry a particle.
pub(super) struct Paths<'a, L> {
    pub from: &'a [V3<L>],
    /// How far they moved relative to the solids: the first component.
    pub moved: &'a [V3<L>],
    /// When the displacements began: at the substep's start (0) or at its end (1).
    pub start: usize,
}

/// Resolves the collisions of the edges of the `queried` strands, from root to tip. Writes to
/// `before` where the particles of the strands were, if any edge was moved. Returns the lanes in
/// which one was.
#[inline(always)]
pub(super) fn resolve<L: Lane>(
    solids: &Solids<'_, L::Scalar>,
    paths: &Paths<'_, L>,
    view: &mut BlockView<'_, L::Scalar>,
    queried: QueriedStrands,
    before: &mut [V3<L>],
) -> u32 {
    let first = queried.first;
    let mut changed = 0;
    let nearby = Nearby::new(solids, paths.moved, queried);
    let from = solids.clamped.clamp(1, view.particles);
    for start in (from..view.particles).step_by(CHUNK) {
        let tested = nearby.select(solids, view, start);
        if tested == [0; CHUNK] {
            continue;
        }
        // Lanes in which the edge before was moved: what was selected does not hold there.
        let mut moved = 0;
        for i in start..(start + CHUNK).min(view.particles) {
            let mut own = tested[i - start] & !moved;
            if moved != 0 {
                own |= nearby.select_again(solids, view, i, moved);
            }
            moved = 0;
            while own != 0 {
                let lane = own.trailing_zeros() as usize;
                own &= own - 1;
                let mut edge = Edge::load(view, i, first + lane, solids.clamped);
                edge.from = [paths.from[i - 1].get(lane), paths.from[i].get(lane)];
                if edge.resolve(solids, paths.start) {
                    if changed == 0 {
                        for (k, place) in before.iter_mut().enumerate().take(view.particles) {
                            *place = V3::load(view.positions, k, first);
                        }
                    }
                    changed |= 1 << lane;
                    moved |= 1 << lane;
                    edge.store(view, i, first + lane);
                }
            }
        }
    }
    changed
}

/// Takes edges of the strands in `lanes` that still pass through a solid back to where they came
/// from, carried by the solid: they were free there. `before`: positions before edges were moved.
#[inline(always)]
pub(super) fn take_back<L: Lane>(
    solids: &Solids<'_, L::Scalar>,
    paths: &Paths<'_, L>,
    view: &mut BlockView<'_, L::Scalar>,
    queried: QueriedStrands,
    before: &[V3<L>],
) {
    let mut lanes = queried.lanes;
    while lanes != 0 {
        let lane = lanes.trailing_zeros() as usize;
        lanes &= lanes - 1;
        for _ in 0..TAKE_BACK_ROUNDS {
            let mut found = false;
            for i in solids.clamped.max(1)..view.particles {
                let is_moved = |i: usize| {
                    before[i].get(lane) != crate::strands::vector(view.positions, i, queried.first + lane)
                };
                if !is_moved(i - 1) && !is_moved(i) {
                    continue;
                }
                let from = [paths.from[i - 1].get(lane), paths.from[i].get(lane)];
                found |= take_edge_back(solids, paths.start, view, i, queried.first + lane, from);
            }
            if !found {
                break;
            }
        }
    }
}

/// Takes the edge to particle `i` back, if it passes through a solid and did not before. Returns
/// whether it did.
#[inline(never)]
fn take_edge_back<T: Real>(
    solids: &Solids<'_, T>,
    start: usize,
    view: &mut BlockView<'_, T>,
    i: usize,
    lane: usize,
    from: [[T; 3]; 2],
) -> bool {
    let clearances = [i - 1, i].map(|i| view.clearance[i].0[lane]);
    let known = if i <= solids.clamped { T::zero() } else { clearances[0] };
    let mut edge = Edge::load(view, i, lane, solids.clamped);
    if known + clearances[1] >= distance(edge.ends[0], edge.ends[1]) || known.min(clearances[1]) < T::zero() {
        return false;
    }
    edge.from = from;
    let found = solids.solids.iter().zip(solids.poses).find(|(collider, pose)| {
        let solid = Solid { collider, pose };
        passes(solids, solid, 1, edge.ends) && !passes(solids, solid, start, edge.from)
    });
    let Some((_, pose)) = found else { return false };
    for (end, p) in [(0, i - 1), (1, i)] {
        if edge.inverse_masses[end] == T::zero() {
            continue;
        }
        let from = edge.from[end];
        let place = pose.world(1, pose.local(start, from));
        for (c, (x, was)) in place.into_iter().zip(from).enumerate() {
            if start == 0 {
                view.velocities[3 * p + c].0[lane] = (x - was) / solids.h;
            }
            view.positions[3 * p + c].0[lane] = x;
        }
        view.clearance[p].0[lane] = T::zero();
    }
    true
}

/// Whether the edge between two `ends` passes through a solid at the substep's start (`when` = 0)
/// or end (1).
#[inline(always)]
pub(super) fn passes<T: Real>(
    solids: &Solids<'_, T>,
    solid: Solid<'_, T>,
    when: usize,
    ends: [[T; 3]; 2],
) -> bool {
    let samples = Samples::of_edge(solids, solid, when, ends, false);
    samples.distances[..samples.count].iter().any(|d| *d < number(-PASSES))
}

/// Most passes over a strand in which edges are taken back.
pub const TAKE_BACK_ROUNDS: usize = 4;

/// Depth of an edge under a surface that counts as passing through, metres.
pub const PASSES: f64 = 1e-5;

/// An edge during a query.
struct Edge<T> {
    ends: [[T; 3]; 2],
    velocities: [[T; 3]; 2],
    from: [[T; 3]; 2],
    inverse_masses: [T; 2],
}

/// A collision of a point of an edge.
struct Hit<T> {
    /// The point's parameter on the edge.
    t: T,
    /// Displacement that moves the point out of the solid.
    push: [T; 3],
    length: T,
    velocity_change: [T; 3],
}

impl<T: Real> Edge<T> {
    /// The edge from particle `i − 1` to `i`.
    fn load(view: &BlockView<'_, T>, i: usize, lane: usize, clamped: usize) -> Self {
        let vector = crate::strands::vector::<T>;
        let inverse_mass = |i: usize| match view.masses.get(i) {
            _ if i < clamped => T::zero(),
            None => T::one(),
            Some(row) => T::one() / row.0[lane],
        };
        Self {
            ends: [vector(view.positions, i - 1, lane), vector(view.positions, i, lane)],
            velocities: [vector(view.velocities, i - 1, lane), vector(view.velocities, i, lane)],
            from: [[T::zero(); 3]; 2],
            inverse_masses: [inverse_mass(i - 1), inverse_mass(i)],
        }
    }

    /// Writes the free ends back.
    fn store(&self, view: &mut BlockView<'_, T>, i: usize, lane: usize) {
        for (end, p) in [(0, i - 1), (1, i)] {
            if self.inverse_masses[end] == T::zero() {
                continue;
            }
            let old = crate::strands::vector(view.positions, p, lane);
            let by = [0, 1, 2].map(|c| self.ends[end][c] - old[c]);
            super::reduce_clearance(&mut view.clearance[p].0[lane], dot(by, by).sqrt());
            for c in 0..3 {
                view.positions[3 * p + c].0[lane] = self.ends[end][c];
                view.velocities[3 * p + c].0[lane] = self.velocities[end][c];
            }
        }
    }

    /// Pushes the edge out of the solids. Returns whether it has moved.
    #[inline(never)]
    fn resolve(&mut self, solids: &Solids<'_, T>, start: usize) -> bool {
        let mut moved = false;
        for _ in 0..EDGE_ROUNDS {
            let mut hit: Option<Hit<T>> = None;
            for (collider, pose) in solids.solids.iter().zip(solids.poses) {
                self.find_hit(solids, Solid { collider, pose }, start, &mut hit);
            }
            let Some(hit) = hit else { break };
            self.apply(&hit);
            moved = true;
        }
        moved
    }

    /// Searches for the point of the edge that has to move farthest out of `solid`; replaces `hit`
    /// if it has to move farther than that.
    fn find_hit(&self, solids: &Solids<'_, T>, solid: Solid<'_, T>, start: usize, hit: &mut Option<Hit<T>>) {
        let Solid { collider, pose } = solid;
        let thickness = solids.thickness * number(SKIN_SHARE);
        let own = Solids { thickness, ..*solids };
        let length = distance(self.ends[0], self.ends[1]);
        let paths = [0, 1].map(|end| pose.sweep_path(start, self.from[end], self.ends[end]));
        let moved = paths[0].length().max(paths[1].length());
        let middle = [0, 1, 2].map(|c| (self.ends[0][c] + self.ends[1][c]) * number(0.5));
        let reach = length * number(0.5) + moved + solids.thickness;
        let thinness = number::<T>(collider.shape.thinness());
        if pose.distance_bound_at(middle) > reach || moved <= thinness * solids.slow_edges {
            return;
        }
        let samples = Samples::of_edge(solids, solid, 1, self.ends, false);
        let passed = samples.may_pass(collider.shape, &paths, moved);
        for (k, passed) in passed.into_iter().enumerate().take(samples.count) {
            let inside = samples.distances[k] < thickness;
            if !inside && !passed {
                continue;
            }
            let t = samples.parameters[k];
            let from = lerp(self.from[0], self.from[1], t);
            let place = samples.point(k);
            let velocity = lerp(self.velocities[0], self.velocities[1], t);
            let before = || collider.shape.sample_at(pose.local(start, from), pose.fractions[start]).0;
            // Roots may be inside a solid: points of their edges that start inside are left there.
            if self.inverse_masses[0] == T::zero() && before() <= thickness {
                continue;
            }
            let sample = Sample { distance: samples.distances[k], gradient: samples.gradient(k) };
            let mut point = Particle::new(place, velocity, T::zero());
            let is_ccd_hit = passed && resolve_ccd_hit(&own, solid, sample, start, from, &mut point);
            if !is_ccd_hit {
                if !inside {
                    continue;
                }
                resolve_penetration(&own, solid, sample, &mut point);
            }
            let mut length = distance(point.x, place);
            if !is_ccd_hit && length > solids.max_edge_push && before() < T::zero() {
                // It was inside before: it comes out little by little.
                point.x = lerp(place, point.x, solids.max_edge_push / length);
                length = solids.max_edge_push;
            }
            if hit.as_ref().is_none_or(|hit| hit.length < length) {
                let difference = |a: [T; 3], b: [T; 3]| [0, 1, 2].map(|c| a[c] - b[c]);
                *hit = Some(Hit {
                    t,
                    push: difference(point.x, place),
                    length,
                    velocity_change: difference(point.v, velocity),
                });
            }
        }
    }

    /// Shares the displacement and the velocity change of a point by the ends.
    fn apply(&mut self, hit: &Hit<T>) {
        let shares = [T::one() - hit.t, hit.t];
        let [a, b] = [0, 1].map(|end| self.inverse_masses[end] * shares[end]);
        let scale = a * shares[0] + b * shares[1];
        for (end, weight) in [a, b].into_iter().enumerate() {
            for c in 0..3 {
                self.ends[end][c] = self.ends[end][c] + hit.push[c] * weight / scale;
                self.velocities[end][c] = self.velocities[end][c] + hit.velocity_change[c] * weight / scale;
            }
        }
    }
}

/// A solid's field at points of an edge.
pub(super) struct Samples<T> {
    /// Points.
    pub count: usize,
    /// Skin of the edge.
    pub thickness: T,
    pub distances: [T; PACKET],
    /// Their parameters on the edge, 0 to 1.
    pub parameters: [T; PACKET],
    points: [[T; PACKET]; 3],
    gradients: [[T; PACKET]; 3],
}

impl<T: Real> Samples<T> {
    /// Samples the edge with these `ends`, at the second one too if `with_end`, at the substep's
    /// start (`when` = 0) or end (1).
    #[inline(always)]
    pub fn of_edge(
        solids: &Solids<'_, T>,
        solid: Solid<'_, T>,
        when: usize,
        ends: [[T; 3]; 2],
        with_end: bool,
    ) -> Self {
        let Solid { collider, pose } = solid;
        let thickness = solids.thickness * number(SKIN_SHARE);
        // A field is smooth over a cell; primitives may have sharp edges.
        let cell = collider.shape.cell();
        let spacing = thickness + number::<T>(f64::from(cell.unwrap_or(0.0)));
        let parts = (distance(ends[0], ends[1]) / spacing).ceil().to_usize().unwrap_or(usize::MAX);
        let parts = parts.clamp(2, EDGE_SAMPLES + 1);
        let count = if with_end { parts } else { parts - 1 };
        let inverse = T::one() / count_of(parts);
        let mut parameters = [T::zero(); PACKET];
        let mut points = [[T::zero(); PACKET]; 3];
        for k in 0..PACKET {
            parameters[k] = count_of::<T>((k + 1).min(parts)) * inverse;
            let point = lerp(ends[0], ends[1], parameters[k]);
            for c in 0..3 {
                points[c][k] = point[c];
            }
        }
        let (distances, gradients) = widest(
            #[inline(always)]
            || collider.shape.sample_packet(&pose.local_packet(when, &points), pose.fractions[when]),
        );
        let mut samples = Self { count, thickness, distances, parameters, points, gradients };
        if cell.is_none() {
            samples.refine(solid, when, ends, inverse, with_end);
        }
        samples
    }

    /// Moves the deepest point along the edge to where it is deepest, if the edge may touch the
    /// solid there. `spacing`: of the parameters.
    #[inline(always)]
    fn refine(&mut self, solid: Solid<'_, T>, when: usize, ends: [[T; 3]; 2], spacing: T, keeps_end: bool) {
        let deepest =
            (0..self.count).fold(0, |a, b| if self.distances[b] < self.distances[a] { b } else { a });
        let length = distance(ends[0], ends[1]);
        if self.distances[deepest] - self.thickness > number::<T>(0.5) * spacing * length {
            return;
        }
        let Solid { collider, pose } = solid;
        let edge = [0, 1, 2].map(|c| ends[1][c] - ends[0][c]);
        let slope = |gradient: [T; 3]| dot(pose.turn(when, gradient), edge);
        let falls = slope(self.gradient(deepest)) < T::zero();
        let step = if falls { spacing } else { -spacing };
        // The field is deepest between these.
        let mut near = self.parameters[deepest];
        let mut far = (near + step).min(T::one()).max(T::zero());
        let slot = if keeps_end && deepest + 1 == self.count { deepest - 1 } else { deepest };
        let mut least = self.distances[deepest];
        for _ in 0..REFINEMENTS {
            let t = (near + far) * number(0.5);
            let point = lerp(ends[0], ends[1], t);
            let (distance, gradient) =
                collider.shape.sample_at(pose.local(when, point), pose.fractions[when]);
            if distance < least {
                least = distance;
                self.distances[slot] = distance;
                self.parameters[slot] = t;
                for c in 0..3 {
                    self.points[c][slot] = point[c];
                    self.gradients[c][slot] = gradient[c];
                }
            }
            if (slope(gradient) < T::zero()) == falls {
                near = t;
            } else {
                far = t;
            }
        }
    }

    /// Which points may have passed through `shape`, or have entered it at another place than where
    /// they are nearest to the surface, while the edge's ends moved along `paths`, by `moved` at
    /// most. A solid is as thick as twice its thinness, so points that moved by no more than that
    /// are inside if they entered it. Paths in a field are sampled at places its thinness apart.
    #[inline(always)]
    fn may_pass(&self, shape: &Shape, paths: &[SweepPath<T>; 2], moved: T) -> [bool; PACKET] {
        let thinness = number::<T>(shape.thinness());
        let mut passed = [false; PACKET];
        if moved <= ccd_motion(shape) {
            return passed;
        }
        // A point that is farther off than it moved cannot have touched the solid.
        let reach = if moved <= thinness + thinness {
            self.thickness
        } else {
            moved * lipschitz::<T>(shape) + number::<T>(TOUCH) * thinness + self.thickness
        };
        for (passed, distance) in passed.iter_mut().zip(&self.distances[..self.count]) {
            *passed = *distance <= reach;
        }
        let Some(parts) = parts_of(shape, moved, paths[0].swell).filter(|_| passed.contains(&true)) else {
            return passed;
        };
        let mut touched = [false; PACKET];
        for part in 1..parts {
            let share = count_of::<T>(part) / count_of::<T>(parts);
            let ends = [0, 1].map(|end| lerp(paths[end].ends[0], paths[end].ends[1], share));
            let places = self.parameters.map(|t| lerp(ends[0], ends[1], t));
            let points = [0, 1, 2].map(|c| places.map(|place| place[c]));
            let (distances, _) = shape.sample_packet(&points, paths[0].fractions[1]);
            for (touched, distance) in touched.iter_mut().zip(distances) {
                *touched |= distance <= self.thickness;
            }
        }
        std::array::from_fn(|k| passed[k] && touched[k])
    }

    /// Point `k`.
    #[inline(always)]
    pub fn point(&self, k: usize) -> [T; 3] {
        [0, 1, 2].map(|c| self.points[c][k])
    }

    /// The gradient at point `k`, in the solid's local space.
    #[inline(always)]
    pub fn gradient(&self, k: usize) -> [T; 3] {
        [0, 1, 2].map(|c| self.gradients[c][k])
    }
}

/// Bisections in the search for the deepest point between two samples.
pub const REFINEMENTS: usize = 4;

#[expect(clippy::cast_precision_loss, reason = "counts are small")]
pub(super) fn count_of<T: Real>(n: usize) -> T {
    number(n as f64)
}

pub(super) fn lerp<T: Real>(a: [T; 3], b: [T; 3], t: T) -> [T; 3] {
    [0, 1, 2].map(|c| a[c] + t * (b[c] - a[c]))
}

pub(super) fn distance<T: Real>(a: [T; 3], b: [T; 3]) -> T {
    let d = [0, 1, 2].map(|c| a[c] - b[c]);
    dot(d, d).sqrt()
}
