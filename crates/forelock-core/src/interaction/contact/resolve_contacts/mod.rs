//! Resolves contacts: removes the approach of touching segments.
//!
//! # Theory
//! A contact of two segments is one between the points p_a = (1−s) x_i + s x_{i+1} and p_b on them,
//! with the normal n from b to a. With the weights w = (1−s, s, t−1, −t) of the four particles, of
//! equal mass, the distance along the normal is g = n · Σ w x. The constraint on positions is g ≥
//! gap, that on velocities u = Σ w v is n · u ≥ 0: inelastic, with Coulomb friction |j_T| ≤ μ j_N
//! in the tangent plane.
//!
//! The strand distributes the push of a contact on a particle: the response to forces f along the
//! strand is S f with (I − ℓ² ∂²/∂s²) S = I (`spread`), as of a strand under tension. A push thus
//! bends the strand over a length ℓ; it does not displace single particles, which the pass that
//! restores lengths would undo. ℓ is several times the approach, so the bend shortens the strand
//! little. A round of all contacts in parallel is
//!
//! ```text
//! λ ← max(0, λ + (gap − g)/W) ,   j_N ← max(0, j_N − n·u/W) ,   j_T ← cut(j_T − u_T/W, μ j_N)
//! W_c = Σ_k |w_k| z_k ,   z = S Σ_c |w_c|
//! ```
//!
//! after which each strand moves by S of the sum over its contacts. W bounds the row sums of the
//! matrix J S Jᵀ of the contacts, so rounds converge in any order. Impulses come in pairs and S
//! preserves sums, so momentum is conserved to rounding (except for the share of clamped roots). A
//! correction of positions never exceeds the approach of the pair, so the motion of the frame
//! bounds it.
//!
//! # Practice
//! Contacts write their contributions, particles gather them: two passes a round, no two threads
//! write to the same place, and each sum has a fixed order.

mod spread;

use crate::collide::resolve_solids::reduce_clearance;
use crate::interaction::contact::{
    Contact, ContactMoment, ContactParams, ContactReport, Displacements, NONE, ParticleRows,
};
use crate::lane::{LANES, Real, Row};
use crate::scratch::fill;
use crate::strands::Model;
use crate::strands::{number, vec3};
use glam::Vec3;
use rayon::prelude::*;
use spread::{Body, Strand};

/// WGSL of the kernels that run strand by strand.
pub const STRANDS_WGSL: &str = include_str!("strands.wgsl");
/// WGSL of the kernels that run joint by joint.
pub const JOINTS_WGSL: &str = include_str!("joints.wgsl");

/// Minimum number of contacts of a task.
const TASK: usize = 512;

/// Length over which a contact bends a strand, relative to the approach.
pub const BEND: f32 = 3.0;

/// Remaining violation of the gap at which the rounds stop, relative to the contact distance.
pub const CLOSE: f32 = 0.1;

/// A contact in the solve.
#[derive(Clone, Copy, Debug)]
pub(super) struct Joint {
    /// Indices of the bodies of its particles, and their weights.
    bodies: [u32; 4],
    weights: [f32; 4],
    normal: Vec3,
    gap: f32,
    /// Inverse of W; zero if no particle can move.
    inverse: f32,
    /// λ, j_N and j_T: after the last round, and as extrapolated for this one.
    lambda: [f32; 2],
    normal_impulse: [f32; 2],
    tangent_impulse: [Vec3; 2],
    /// Contributions of this round: n Δλ, and the impulse.
    moves: Vec3,
    impulses: Vec3,
}

/// Constants of a round.
#[derive(Clone, Copy, Debug)]
struct RoundTerms {
    friction: f32,
    /// Momentum of Nesterov's method.
    momentum: f32,
    dt_secs: f32,
}

/// Resolves contacts; holds the buffers of the solve.
#[derive(Debug, Default)]
pub(crate) struct Resolver {
    /// Segment, time, other segment and contact, for both segments of each contact.
    sides: Vec<[u32; 4]>,
    /// How many of its two segments keep each contact.
    kept: Vec<u8>,
    joints: Vec<Joint>,
    strands: Vec<Strand>,
    bodies: Vec<Body>,
    /// Corners of joints, 4 × joint + corner, sorted by body.
    corners: Vec<u32>,
    /// Index in `strands` of the strand in each lane of each block.
    slots: Vec<u32>,
}

impl Resolver {
    pub fn bytes(&self) -> usize {
        16 * self.sides.capacity()
            + self.kept.capacity()
            + self.joints.capacity() * size_of::<Joint>()
            + self.strands.capacity() * size_of::<Strand>()
            + self.bodies.capacity() * size_of::<Body>()
            + 4 * (self.corners.capacity() + self.slots.capacity())
    }

    /// Those of `found`, the contacts that were resolved last, that both segments kept.
    pub fn kept<'a>(&self, found: &'a [Contact]) -> impl Iterator<Item = &'a Contact> {
        kept(found, &self.kept)
    }

    /// The blocks of the strands that were moved last; some more than once.
    pub fn moved_blocks(&self) -> impl Iterator<Item = usize> {
        self.strands.iter().map(|strand| strand.slot / LANES)
    }

    /// Resolves the contacts `found`: see [`crate::interaction::contact::Contacts::resolve`].
    pub fn resolve<T: Real>(
        &mut self,
        params: &ContactParams,
        model: &Model<T>,
        found: &[Contact],
        displacements: &Displacements,
        rows: ParticleRows<'_, T>,
        moment: &ContactMoment<'_>,
    ) -> ContactReport {
        let ParticleRows { positions, velocities, clearance } = rows;
        let &ContactMoment { head, clamped, dt_secs } = moment;
        self.select_kept(found, params.per_segment as usize);
        self.create_joints(model, found, displacements);
        let back = head.rotation.inverse().as_quat();
        let velocity = |place: usize, lane: usize| back * vec3(velocities, place, lane);
        spread::each(&self.strands, &mut self.bodies, &|strand, bodies| {
            strand.prepare(bodies, model, clamped, strand.bend.max(params.spread as f32));
            for (body, place) in bodies.iter_mut().zip(strand.place..) {
                body.position = displacements.end(LANES * place + strand.lane());
                body.velocity = velocity(place, strand.lane());
            }
        });
        for joint in &mut self.joints {
            let shares = joint.bodies.iter().zip(joint.weights);
            let w: f32 = shares.map(|(&k, w)| w.abs() * self.bodies[k as usize].share).sum();
            joint.inverse = if w > 1e-6 { 1.0 / w } else { 0.0 };
        }
        let close = CLOSE * params.distance as f32;
        let mut converged = false;
        for k in 0..params.rounds {
            // Momentum of Nesterov's method; the last round has none, so its result is feasible.
            let last = converged || k + 1 == params.rounds;
            let momentum = if last { 0.0 } else { k as f32 / (k + 3) as f32 };
            let terms = RoundTerms { friction: params.friction as f32, momentum, dt_secs: dt_secs as f32 };
            let lack = self.round(terms);
            if last {
                break;
            }
            converged = lack < close;
        }
        let forth = head.rotation.as_quat();
        let mut farthest = 0.0f32;
        for strand in &self.strands {
            for (body, place) in strand.of(&self.bodies).iter().zip(strand.place..).skip(clamped) {
                let lane = strand.lane();
                let moved = body.position - displacements.end(LANES * place + lane);
                let changed = body.velocity - back * vec3(velocities, place, lane);
                if !(moved.is_finite() && changed.is_finite()) {
                    continue;
                }
                add(positions, place, lane, forth * moved);
                add(velocities, place, lane, forth * changed);
                let distance = moved.length();
                farthest = farthest.max(distance);
                reduce_clearance(&mut clearance[place].0[lane], number(f64::from(distance)));
            }
        }
        ContactReport { contacts: self.joints.len(), farthest_m: farthest.into(), secs: [0.0; 2] }
    }

    /// Marks the contacts that both segments keep: each segment keeps the first `most` in time, and
    /// of several with the same other segment the first.
    fn select_kept(&mut self, found: &[Contact], most: usize) {
        self.sides.clear();
        for (contact, k) in found.iter().zip(0u32..) {
            let [a, b] = contact.segments;
            // Times are positive, so their bits have the same order.
            let when = contact.when.to_bits();
            self.sides.extend([[a, when, b, k], [b, when, a, k]]);
        }
        self.sides.par_sort_unstable();
        fill(&mut self.kept, found.len(), 0);
        for own in self.sides.chunk_by(|x, y| x[0] == y[0]) {
            let mut kept = 0;
            for (i, &[_, _, other, k]) in own.iter().enumerate() {
                if kept < most && own[..i].iter().all(|side| side[2] != other) {
                    self.kept[k as usize] += 1;
                    kept += 1;
                }
            }
        }
    }

    /// Creates joints for the contacts that are kept, and bodies for the particles of their
    /// strands.
    fn create_joints<T: Real>(&mut self, model: &Model<T>, found: &[Contact], displacements: &Displacements) {
        self.slots.resize(LANES * model.blocks.len(), NONE);
        self.joints.clear();
        self.strands.clear();
        let mut bodies = 0;
        for contact in kept(found, &self.kept) {
            let mut joint = Joint {
                bodies: [0; 4],
                weights: [0.0; 4],
                normal: contact.normal,
                gap: contact.gap,
                inverse: 0.0,
                lambda: [0.0; 2],
                normal_impulse: [0.0; 2],
                tangent_impulse: [Vec3::ZERO; 2],
                moves: Vec3::ZERO,
                impulses: Vec3::ZERO,
            };
            for (corner, (p, w)) in contact.particles().into_iter().enumerate() {
                let (place, lane) = (p as usize / LANES, p as usize % LANES);
                let number = displacements.block[place] as usize;
                let block = &model.blocks[number];
                let slot = &mut self.slots[LANES * number + lane];
                if *slot == NONE {
                    *slot = self.strands.len() as u32;
                    let (place, particles) = (block.first, block.particles);
                    let slot = LANES * number + lane;
                    self.strands.push(Strand { slot, place, first: bodies, particles, bend: 0.0 });
                    bodies += particles;
                }
                let strand = &mut self.strands[*slot as usize];
                strand.bend = strand.bend.max(BEND * contact.approach);
                joint.bodies[corner] = (strand.first + place - block.first) as u32;
                joint.weights[corner] = w;
            }
            self.joints.push(joint);
        }
        for strand in &self.strands {
            self.slots[strand.slot] = NONE;
        }
        fill(&mut self.bodies, bodies, Body::default());
        for joint in &self.joints {
            for (&k, w) in joint.bodies.iter().zip(joint.weights) {
                let body = &mut self.bodies[k as usize];
                body.count += 1;
                body.share += w.abs();
            }
        }
        let mut sum = 0;
        for body in &mut self.bodies {
            body.first = sum;
            sum += body.count;
            body.count = 0;
        }
        fill(&mut self.corners, sum as usize, 0);
        for (joint, k) in self.joints.iter().zip(0u32..) {
            for (&p, corner) in joint.bodies.iter().zip(0u32..) {
                let body = &mut self.bodies[p as usize];
                self.corners[(body.first + body.count) as usize] = 4 * k + corner;
                body.count += 1;
            }
        }
    }

    /// One round: computes the contributions of all joints, then moves the strands. Returns the
    /// largest violation of a gap, or approach in a frame, of any pair.
    fn round(&mut self, terms: RoundTerms) -> f32 {
        let bodies = &*self.bodies;
        let joints = self.joints.par_iter_mut().with_min_len(TASK);
        let lack = joints.map(|joint| joint.relax(bodies, terms)).reduce(|| 0.0, f32::max);
        let (joints, corners) = (&*self.joints, &*self.corners);
        spread::each(&self.strands, &mut self.bodies, &|strand, bodies| {
            for body in &mut *bodies {
                (body.moves, body.impulses) = (Vec3::ZERO, Vec3::ZERO);
                for &corner in &corners[body.first as usize..(body.first + body.count) as usize] {
                    let (joint, corner) = (&joints[corner as usize / 4], corner as usize % 4);
                    body.moves += joint.weights[corner] * joint.moves;
                    body.impulses += joint.weights[corner] * joint.impulses;
                }
            }
            strand.apply(bodies);
        });
        lack
    }
}

/// Those of `found` that both of their segments keep, of which `kept` is the count.
fn kept<'a>(found: &'a [Contact], kept: &[u8]) -> impl Iterator<Item = &'a Contact> {
    found.iter().zip(kept).filter(|(_, kept)| **kept == 2).map(|(contact, _)| contact)
}

impl Joint {
    #[inline]
    fn relax(&mut self, bodies: &[Body], terms: RoundTerms) -> f32 {
        let RoundTerms { friction, momentum, dt_secs } = terms;
        let (mut apart, mut u) = (Vec3::ZERO, Vec3::ZERO);
        for (&k, w) in self.bodies.iter().zip(self.weights) {
            let body = &bodies[k as usize];
            apart += w * body.position;
            u += w * body.velocity;
        }
        let lack = self.gap - self.normal.dot(apart);
        let lambda = (self.lambda[1] + lack * self.inverse).max(0.0);
        let along = self.normal.dot(u);
        let normal_impulse = (self.normal_impulse[1] - along * self.inverse).max(0.0);
        let tangent_impulse = self.tangent_impulse[1] - (u - along * self.normal) * self.inverse;
        let tangent_impulse = tangent_impulse.clamp_length_max(friction * normal_impulse);
        let next = [
            lambda + momentum * (lambda - self.lambda[0]),
            normal_impulse + momentum * (normal_impulse - self.normal_impulse[0]),
        ];
        let next_tangent_impulse = tangent_impulse + momentum * (tangent_impulse - self.tangent_impulse[0]);
        self.moves = (next[0] - self.lambda[1]) * self.normal;
        self.impulses = (next[1] - self.normal_impulse[1]) * self.normal
            + (next_tangent_impulse - self.tangent_impulse[1]);
        self.lambda = [lambda, next[0]];
        self.normal_impulse = [normal_impulse, next[1]];
        self.tangent_impulse = [tangent_impulse, next_tangent_impulse];
        if self.inverse > 0.0 { lack.max(-along * dt_secs) } else { 0.0 }
    }
}

#[inline]
fn add<T: Real>(rows: &mut [Row<T>], place: usize, lane: usize, v: Vec3) {
    for c in 0..3 {
        let x = &mut rows[3 * place + c].0[lane];
        *x = *x + number(f64::from(v[c]));
    }
}
