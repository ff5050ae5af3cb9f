//! Takes from segments that touch what brought them together.
//!
//! # Theory
//! A contact of two segments is one between the points p_a = (1−s) x_i + s x_{i+1} and p_b on them, with the normal n
//! from b to a. With the weights w = (1−s, s, t−1, −t) of the four particles, of equal mass, the distance along the
//! normal is g = n · Σ w x. Positions are to keep g ≥ gap, velocities u = Σ w v are to keep n · u ≥ 0: inelastic, with
//! Coulomb friction |j_T| ≤ μ j_N across.
//!
//! What a contact gives a particle its strand hands on: the response to forces f along it is S f with
//! (I − ℓ² ∂²/∂s²) S = I (`spread`), as of a strand under tension. A push then bends the strand
//! over a length ℓ and does not tear single particles out of it, which the pass that restores lengths would undo: ℓ is
//! several times the approach, so that the bend takes little length. A round of all contacts at once is
//!
//! ```text
//! λ ← max(0, λ + (gap − g)/W) ,   j_N ← max(0, j_N − n·u/W) ,   j_T ← cut(j_T − u_T/W, μ j_N)
//! W_c = Σ_k |w_k| z_k ,   z = S Σ_c |w_c|
//! ```
//!
//! and then all strands move by S of what their contacts added. W bounds each row's sum of the contacts' matrix
//! J S Jᵀ, so that rounds converge whatever the order. Impulses come in pairs and S hands on all it gets, so momentum is kept to rounding (but
//! for what clamped roots take). A correction of positions never exceeds the way by which the two approached: it is bounded by the frame's
//! motion.
//!
//! # Practice
//! Contacts write what they add, particles gather it: two passes a round, no two threads write one place, and each sum
//! has one order.

mod spread;

use crate::collide::resolve_solids::reduce_clearance;
use crate::interaction::contact::{Contact, ContactParams, ContactReport, NONE, Rows, Ways};
use crate::lane::{LANES, Real, Row};
use crate::pose::Pose;
use crate::scratch::fill;
use crate::strands::Model;
use crate::strands::{number, vec3};
use glam::Vec3;
use rayon::prelude::*;
use spread::{Body, Strand};

/// WGSL of the work strand by strand.
pub const STRANDS_WGSL: &str = include_str!("strands.wgsl");
/// WGSL of the work joint by joint.
pub const JOINTS_WGSL: &str = include_str!("joints.wgsl");

/// Contacts that one task takes at least.
const TASK: usize = 512;

/// The length over which a strand is bent, over how far it and another approach.
pub const BEND: f32 = 3.0;

/// What a pair may lack to its gap when the rounds end, over the contact distance.
pub const CLOSE: f32 = 0.1;

/// A contact in the solve.
#[derive(Clone, Copy, Debug)]
pub(super) struct Joint {
    /// Its particles, as numbers of bodies, and their weights.
    bodies: [u32; 4],
    weights: [f32; 4],
    normal: Vec3,
    gap: f32,
    /// One over W; zero if nothing can move.
    inverse: f32,
    /// λ, then j_N and j_T: after the last round, and as extrapolated for this one.
    push: [f32; 2],
    press: [f32; 2],
    rub: [Vec3; 2],
    /// What this round adds to n λ, and to the impulse.
    moves: Vec3,
    kicks: Vec3,
}

/// Resolves contacts; holds the scratch for it.
#[derive(Debug, Default)]
pub(crate) struct Resolver {
    /// Segment, time, other segment, contact: both ways.
    sides: Vec<[u32; 4]>,
    /// How many of its two segments keep each contact.
    kept: Vec<u8>,
    joints: Vec<Joint>,
    strands: Vec<Strand>,
    bodies: Vec<Body>,
    /// Corners of joints, 4 × joint + corner, by body.
    corners: Vec<u32>,
    /// The place in `strands` of the strand in each lane of each block.
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

    /// Resolves what was found: see [`crate::interaction::contact::Contacts::resolve`].
    pub fn resolve<T: Real>(
        &mut self,
        params: &ContactParams,
        (model, found, ways): (&Model<T>, &[Contact], &Ways),
        (positions, velocities, clearance): Rows<'_, T>,
        head: &Pose,
        (clamped, dt_secs): (usize, f64),
    ) -> ContactReport {
        self.choose(found, params.per_segment as usize);
        self.join(model, found, ways);
        let back = head.rotation.inverse().as_quat();
        let velocity = |place: usize, lane: usize| back * vec3(velocities, place, lane);
        spread::each(&self.strands, &mut self.bodies, &|strand, bodies| {
            strand.prepare(bodies, (model, clamped), strand.bend.max(params.spread as f32));
            for (body, place) in bodies.iter_mut().zip(strand.place..) {
                body.position = ways.end[LANES * place + strand.lane()];
                body.velocity = velocity(place, strand.lane());
            }
        });
        for joint in &mut self.joints {
            let shares = joint.bodies.iter().zip(joint.weights);
            let w: f32 = shares.map(|(&k, w)| w.abs() * self.bodies[k as usize].share).sum();
            joint.inverse = if w > 1e-6 { 1.0 / w } else { 0.0 };
        }
        let close = CLOSE * params.distance as f32;
        let mut settled = false;
        for k in 0..params.rounds {
            // Nesterov's sequence; the last round ends on what is feasible.
            let last = settled || k + 1 == params.rounds;
            let momentum = if last { 0.0 } else { k as f32 / (k + 3) as f32 };
            let lack = self.round((params.friction as f32, momentum, dt_secs as f32));
            if last {
                break;
            }
            settled = lack < close;
        }
        let forth = head.rotation.as_quat();
        let mut farthest = 0.0f32;
        for strand in &self.strands {
            for (body, place) in strand.of(&self.bodies).iter().zip(strand.place..).skip(clamped) {
                let lane = strand.lane();
                let moved = body.position - ways.end[LANES * place + lane];
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

    /// Marks the contacts that both segments keep: each keeps the first so many in time, and of several with one other
    /// segment the first.
    fn choose(&mut self, found: &[Contact], most: usize) {
        self.sides.clear();
        for (contact, k) in found.iter().zip(0u32..) {
            let [a, b] = contact.segments;
            // Times are positive, and then their bits are in their order.
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

    /// Makes joints of the contacts that are kept, and bodies of their strands' particles.
    fn join<T: Real>(&mut self, model: &Model<T>, found: &[Contact], ways: &Ways) {
        self.slots.resize(LANES * model.blocks.len(), NONE);
        self.joints.clear();
        self.strands.clear();
        let mut bodies = 0;
        for (contact, _) in found.iter().zip(&self.kept).filter(|(_, kept)| **kept == 2) {
            let mut joint = Joint {
                bodies: [0; 4],
                weights: [0.0; 4],
                normal: contact.normal,
                gap: contact.gap,
                inverse: 0.0,
                push: [0.0; 2],
                press: [0.0; 2],
                rub: [Vec3::ZERO; 2],
                moves: Vec3::ZERO,
                kicks: Vec3::ZERO,
            };
            for (corner, (p, w)) in contact.particles().into_iter().enumerate() {
                let (place, lane) = (p as usize / LANES, p as usize % LANES);
                let number = ways.block[place] as usize;
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

    /// One round: what all contacts add, then how each strand takes it. Returns the most that a pair lacked to its gap, or
    /// would come nearer in a frame.
    fn round(&mut self, terms: (f32, f32, f32)) -> f32 {
        let bodies = &*self.bodies;
        let joints = self.joints.par_iter_mut().with_min_len(TASK);
        let lack = joints.map(|joint| joint.press(bodies, terms)).reduce(|| 0.0, f32::max);
        let (joints, corners) = (&*self.joints, &*self.corners);
        spread::each(&self.strands, &mut self.bodies, &|strand, bodies| {
            for body in &mut *bodies {
                (body.moves, body.kicks) = (Vec3::ZERO, Vec3::ZERO);
                for &corner in &corners[body.first as usize..(body.first + body.count) as usize] {
                    let (joint, corner) = (&joints[corner as usize / 4], corner as usize % 4);
                    body.moves += joint.weights[corner] * joint.moves;
                    body.kicks += joint.weights[corner] * joint.kicks;
                }
            }
            strand.take(bodies);
        });
        lack
    }
}

impl Joint {
    #[inline]
    fn press(&mut self, bodies: &[Body], (friction, momentum, dt_secs): (f32, f32, f32)) -> f32 {
        let (mut apart, mut u) = (Vec3::ZERO, Vec3::ZERO);
        for (&k, w) in self.bodies.iter().zip(self.weights) {
            let body = &bodies[k as usize];
            apart += w * body.position;
            u += w * body.velocity;
        }
        let lack = self.gap - self.normal.dot(apart);
        let push = (self.push[1] + lack * self.inverse).max(0.0);
        let along = self.normal.dot(u);
        let press = (self.press[1] - along * self.inverse).max(0.0);
        let rub = self.rub[1] - (u - along * self.normal) * self.inverse;
        let rub = rub.clamp_length_max(friction * press);
        let next = [push + momentum * (push - self.push[0]), press + momentum * (press - self.press[0])];
        let next_rub = rub + momentum * (rub - self.rub[0]);
        self.moves = (next[0] - self.push[1]) * self.normal;
        self.kicks = (next[1] - self.press[1]) * self.normal + (next_rub - self.rub[1]);
        self.push = [push, next[0]];
        self.press = [press, next[1]];
        self.rub = [rub, next_rub];
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
