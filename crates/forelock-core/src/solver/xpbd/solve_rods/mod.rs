//! One substep of XPBD Cosserat rods (Kugelstadt and Schömer 2016; Macklin et al. 2016).
//!
//! # Theory
//! Edge i joins the particles x_i and x_{i+1}, has the rest length l and the direction t_i at rest,
//! in the head's frame, and the rotation r_i from rest, so that a rigidly carried strand has r_i =
//! Q, the head's rotation. With T_k the shortest rotation from t_{k−1} to t_k, the material frames
//! q_i of the literature are r_i times those at rest, and nothing depends on the choice of these:
//!
//! ```text
//! stretch–shear  C = (x_{i+1} − x_i)/l − r_i t_i r̄_i            α = 1/(k_s l²)
//! bend–twist     C = Im(r̄_a r_b T) − s Im T                      α = L/(4 k_bt)
//!
//! Δλ = −(C + α̃λ)/(S + α̃),   λ += Δλ,   α̃ = α/h²
//! stretch–shear  S = (w_i + w_{i+1})/l² + 4 w_q     x_i −= w_i Δλ/l,  x_{i+1} += w_{i+1} Δλ/l,
//!                                                   r_i += 2 w_q (0,Δλ) r_i (0,t_i)
//! bend–twist     S = w_a + w_b                      r_a −= w_a r_b T (0,Δλ),
//!                                                   r_b += w_b r_a (0,Δλ) T̄
//! ```
//!
//! Here a = k−1 and b = k, L is the mean of their lengths, and s = −1 if r̄_a r_b T and T are in
//! opposite hemispheres of the unit quaternions, otherwise 1. The root's a is the head: r_a = Q,
//! w_a = 0, T = 1, L = l_0/2. The weight of rotations is w_q = β w_{i+1}/(2l²). Rotations are
//! normalised after each correction. The energies are ½ k_s l² |C|² and (2 k_bt/L) |C|².
//!
//! ```text
//! v += h g,  x += h v,  r = normalise(r + (h/2) (0,ω) r),  λ = 0
//! n times: for each edge from the root: stretch–shear, bend–twist
//! v = e^{−ch} (x − x_old)/h,   ω = e^{−ch} 2σ Im(r r̄_old)/h,  σ the sign of the real part
//! ```
//!
//! Velocities are damped towards the air's, angular velocities towards the head's.
//!
//! # Practice
//! A strand is a lane. One pass over the strand does an iteration, since an edge is done with once
//! the next one has been coupled to it; the first pass predicts, and the last one writes
//! velocities. Differences of float32 positions over such short substeps are noise, so each
//! correction Δx adds Δx/h to the velocity instead, and r − r_old is the sum of the changes of r.
//! With one iteration λ is not stored.

use crate::frame::RestMotion;
use crate::lane::{Lane, Mat3, Quat, V3};
use crate::solver::XpbdParams;
use crate::strands::BlockView;
use glam::DVec3;

/// The WGSL of the stage.
pub const WGSL: &str = include_str!("kernel.wgsl");
/// The stage's name in reports.
pub const STAGE: &str = "solve_rods";

/// Index of the channel of rotations.
const ROTATION: usize = 0;
/// Index of the channel of angular velocities.
const SPIN: usize = 1;
/// Vectors of scratch an edge: both λ, the rotation before the substep and its change, each a
/// vector part and a scalar part.
const KEPT: usize = 6;
/// α̃ beyond which a constraint does nothing: next to no stiffness is none.
pub const SOFTEST: f64 = 1e30;
/// The smallest relative stiffness of a strand.
pub const LEAST_STIFFNESS: f64 = 1e-12;

/// Coefficients of a substep, in float64.
#[derive(Clone, Copy, Debug)]
pub struct RodTerms {
    /// Substep, seconds.
    pub h: f64,
    /// Clamped particles from the root.
    pub clamped: usize,
    /// α̃ l² of stretch–shear constraints, 1/(k_s h²).
    pub stretch: f64,
    /// α̃/L of bend–twist constraints, 1/(4 k_bt h²); infinite without stiffness.
    pub bend_twist: f64,
    /// β.
    pub rotation_weight: f64,
    /// Share of the velocity relative to the air that a substep leaves.
    pub keep: f64,
    /// Iterations of a substep.
    pub iterations: u32,
}

impl RodTerms {
    /// The terms of `params` for substeps of `h` seconds.
    pub fn new(params: &XpbdParams, h: f64) -> Self {
        Self {
            h,
            clamped: params.clamped as usize,
            stretch: 1.0 / (params.k_stretch * h * h),
            bend_twist: 1.0 / (4.0 * params.k_bend_twist * h * h),
            rotation_weight: params.rotation_weight,
            keep: (-params.drag * h).exp(),
            iterations: params.iterations,
        }
    }
}

/// Inputs of a substep that are the same for all lanes.
#[derive(Clone, Copy, Debug)]
pub struct RodStep<L> {
    h: L,
    inverse_h: L,
    keep: L,
    /// Maps rest positions to where they are at the substep's end.
    ghost: (Mat3<L>, V3<L>),
    /// The head's rotation at the substep's end, and its angular velocity.
    head: (Quat<L>, V3<L>),
    /// h g.
    fall: V3<L>,
    air: V3<L>,
}

impl<L: Lane> RodStep<L> {
    /// The inputs of a substep at whose end the rest shape is at `rest` and turns at `spin`, s⁻¹.
    #[inline(always)]
    pub fn new(terms: &RodTerms, rest: &RestMotion<L>, spin: V3<L>, gravity: DVec3, air: DVec3) -> Self {
        Self {
            h: L::from_f64(terms.h),
            inverse_h: L::from_f64(1.0 / terms.h),
            keep: L::from_f64(terms.keep),
            ghost: rest.map,
            head: (rest.rotation, spin),
            fall: V3::splat(gravity * terms.h),
            air: V3::splat(air),
        }
    }
}

/// A particle in a substep.
#[derive(Clone, Copy, Debug)]
struct Particle<L> {
    x: V3<L>,
    v: V3<L>,
    /// Inverse mass, 0 if clamped.
    w: L,
}

/// A rotation in a substep.
#[derive(Clone, Copy, Debug)]
struct Rotation<L> {
    now: Quat<L>,
    /// Its change since the substep's start.
    change: Quat<L>,
}

impl<L: Lane> Rotation<L> {
    /// Adds `step` and normalises.
    #[inline(always)]
    fn add(&mut self, step: Quat<L>) {
        let sum = self.now + step;
        let length = sum.dot(sum).sqrt();
        let inverse = L::one() / (length + length * length);
        // 1/length, and the same less 1: the rotation was of unit length but for rounding.
        let scale = (L::one() + length) * inverse;
        let longer = step.dot(self.now + self.now + step);
        self.change = self.change + step.scale(scale) + self.now.scale(-(longer * inverse));
        self.now = sum.scale(scale);
    }
}

/// An edge in a substep.
#[derive(Clone, Copy, Debug)]
struct Edge<L> {
    rotation: Rotation<L>,
    /// Its rotation before the substep.
    before: Quat<L>,
    /// Inverse mass of the rotation, 0 if clamped.
    weight: L,
    length: L,
    /// Its direction at rest.
    tangent: V3<L>,
}

/// Advances the lanes from `first` on by a substep. `scratch` holds six vectors an edge.
#[inline(always)]
pub fn advance<L: Lane>(
    terms: &RodTerms,
    step: &RodStep<L>,
    view: &mut BlockView<'_, L::Scalar>,
    first: usize,
    scratch: &mut [V3<L>],
) {
    let stretch = L::from_f64(terms.stretch);
    let stiffness = L::load(view.stiffness, first).max(L::from_f64(LEAST_STIFFNESS));
    let bend_twist = (L::from_f64(terms.bend_twist) / stiffness).min(L::from_f64(SOFTEST));
    let bends = terms.bend_twist.is_finite();
    for pass in 0..terms.iterations {
        let is = Pass { first: pass == 0, last: pass + 1 == terms.iterations };
        let rods = Rods { terms, step, is, first };
        let mut lower = rods.particle(view, 0);
        let mut before: Option<Edge<L>> = None;
        for i in 0..view.particles - 1 {
            let mut upper = rods.particle(view, i + 1);
            let kept = &mut scratch[KEPT * i..KEPT * (i + 1)];
            let mut edge = rods.edge(view, i, kept);
            let [of_stretch, of_bend] = if is.first { [V3::zero(); 2] } else { [kept[0], kept[1]] };
            let inverse = L::load(&view.inverse_edges[i], first);
            let sum = rods.stretch_shear([&mut lower, &mut upper], &mut edge, inverse, stretch, of_stretch);
            if !is.last {
                kept[0] = sum;
            }
            if bends {
                let half = L::from_f64(0.5);
                let sum = match &mut before {
                    Some(before) => {
                        let arc = Quat::arc(before.tangent, edge.tangent);
                        let alpha = (before.length + edge.length) * half * bend_twist;
                        let [a, b] = [&mut before.rotation, &mut edge.rotation];
                        couple([a, b], arc, [before.weight, edge.weight], alpha, of_bend)
                    }
                    None => {
                        let mut head = Rotation { now: step.head.0, change: Quat::zero() };
                        let one = Quat { v: V3::zero(), w: L::one() };
                        let alpha = edge.length * half * bend_twist;
                        couple([&mut head, &mut edge.rotation], one, [L::zero(), edge.weight], alpha, of_bend)
                    }
                };
                if !is.last {
                    kept[1] = sum;
                }
            }
            if let Some(before) = before.replace(edge) {
                rods.store_edge(view, i - 1, &before, scratch);
            }
            rods.store_particle(view, i, &lower);
            lower = upper;
        }
        if let Some(edge) = before {
            rods.store_edge(view, view.particles - 2, &edge, scratch);
            if is.last {
                // The tip has the values of its edge: edits interpolate them between particles.
                rods.store_edge(view, view.particles - 1, &edge, scratch);
            }
        }
        rods.store_particle(view, view.particles - 1, &lower);
    }
}

/// Which pass over a strand it is.
#[derive(Clone, Copy)]
struct Pass {
    first: bool,
    last: bool,
}

/// A pass over the rods of a group of lanes.
struct Rods<'a, L> {
    terms: &'a RodTerms,
    step: &'a RodStep<L>,
    is: Pass,
    /// The first lane.
    first: usize,
}

impl<L: Lane> Rods<'_, L> {
    /// Particle `i`, predicted in the first pass.
    #[inline(always)]
    fn particle(&self, view: &BlockView<'_, L::Scalar>, i: usize) -> Particle<L> {
        let x = V3::<L>::load(view.positions, i, self.first);
        let v = V3::<L>::load(view.velocities, i, self.first);
        let clamped = i < self.terms.clamped;
        let w = if clamped { L::zero() } else { view.inverse_mass(i, self.first) };
        if !self.is.first {
            return Particle { x, v, w };
        }
        if clamped {
            let (turn, shift) = &self.step.ghost;
            let on_head = shift.add_mul(turn, V3::load(view.rest, i, self.first));
            return Particle { x: on_head, v: (on_head - x).scale(self.step.inverse_h), w };
        }
        let v = v + self.step.fall;
        Particle { x: x.add_scaled(self.step.h, v), v, w }
    }

    /// Edge `i`, predicted in the first pass.
    #[inline(always)]
    fn edge(&self, view: &BlockView<'_, L::Scalar>, i: usize, kept: &[V3<L>]) -> Edge<L> {
        let first = self.first;
        let inverse = L::load(&view.inverse_edges[i], first);
        let length = L::load(&view.rest_lengths[3 * i], first);
        let at_rest = V3::<L>::load(view.rest, i + 1, first) - V3::load(view.rest, i, first);
        let tangent = at_rest.scale(inverse);
        if i + 1 < self.terms.clamped {
            let before = self.step.head.0;
            let rotation = Rotation { now: before, change: Quat::zero() };
            return Edge { rotation, before, weight: L::zero(), length, tangent };
        }
        let half_weight = L::from_f64(0.5 * self.terms.rotation_weight);
        let weight = half_weight * inverse * inverse * view.inverse_mass(i + 1, first);
        let stored = Quat::load(view.extra.rows(ROTATION, i), first);
        if self.is.first {
            let spin = V3::<L>::load(view.extra.rows(SPIN, i), 0, first);
            let mut rotation = Rotation { now: stored, change: Quat::zero() };
            rotation.add((Quat::pure(spin) * stored).scale(L::from_f64(0.5 * self.terms.h)));
            return Edge { rotation, before: stored, weight, length, tangent };
        }
        let [before, change] = [2, 4].map(|k| Quat { v: kept[k], w: kept[k + 1].0[0] });
        Edge { rotation: Rotation { now: stored, change }, before, weight, length, tangent }
    }

    /// Corrects the stretch–shear constraint of an edge, of which λ so far is `sum` and α̃ l² is
    /// `stretch`; returns λ.
    #[inline(always)]
    fn stretch_shear(
        &self,
        [lower, upper]: [&mut Particle<L>; 2],
        edge: &mut Edge<L>,
        inverse: L,
        stretch: L,
        sum: V3<L>,
    ) -> V3<L> {
        let alpha = stretch * inverse * inverse;
        let ends = [lower.x, upper.x];
        let change = stretch_shear(ends, edge, [lower.w, upper.w], inverse, alpha, sum);
        for (particle, side) in [(lower, -inverse), (upper, inverse)] {
            let moved = change.scale(particle.w * side);
            particle.x += moved;
            particle.v = particle.v.add_scaled(self.step.inverse_h, moved);
        }
        sum + change
    }

    /// Writes particle `i`, after the last pass with its velocity damped.
    #[inline(always)]
    fn store_particle(&self, view: &mut BlockView<'_, L::Scalar>, i: usize, particle: &Particle<L>) {
        let mut v = particle.v;
        if self.is.last && i >= self.terms.clamped {
            let air = if view.wind.is_empty() { self.step.air } else { V3::load(view.wind, i, self.first) };
            v = air.add_scaled(self.step.keep, v - air);
        }
        particle.x.store(view.positions, i, self.first);
        v.store(view.velocities, i, self.first);
    }

    /// Writes edge `i`, after the last pass with its angular velocity.
    #[inline(always)]
    fn store_edge(
        &self,
        view: &mut BlockView<'_, L::Scalar>,
        i: usize,
        edge: &Edge<L>,
        scratch: &mut [V3<L>],
    ) {
        let Edge { rotation, before, .. } = edge;
        rotation.now.store(view.extra.rows_mut(ROTATION, i), self.first);
        if !self.is.last {
            let kept = &mut scratch[KEPT * i..KEPT * (i + 1)];
            for (k, own) in [(2, before), (4, &rotation.change)] {
                (kept[k], kept[k + 1]) = (own.v, V3([own.w; 3]));
            }
            return;
        }
        // r r̄_old = 1 + (r − r_old) r̄_old
        let turn = rotation.change * before.conjugate();
        let scale = self.step.inverse_h + self.step.inverse_h;
        let scale = L::select(turn.w.lt(-L::one()), -scale, scale);
        let head = self.step.head.1;
        let spin = if i + 1 < self.terms.clamped {
            head
        } else {
            head.add_scaled(self.step.keep, turn.v.scale(scale) - head)
        };
        spin.store(view.extra.rows_mut(SPIN, i), 0, self.first);
    }
}

/// Δλ of the stretch–shear constraint between `ends`, with inverse masses `w`, which it applies to
/// the rotation of the edge. `inverse` is 1/l, `alpha` α̃ and `sum` λ so far.
#[inline(always)]
fn stretch_shear<L: Lane>(
    ends: [V3<L>; 2],
    edge: &mut Edge<L>,
    w: [L; 2],
    inverse: L,
    alpha: L,
    sum: V3<L>,
) -> V3<L> {
    let stretch = (ends[1] - ends[0]).scale(inverse) - edge.rotation.now.rotate(edge.tangent);
    let four = L::from_f64(4.0);
    let response = four.mul_add(edge.weight, (w[0] + w[1]) * inverse * inverse) + alpha;
    let change = (stretch.add_scaled(alpha, sum)).scale(-(L::one() / response));
    let turned = Quat::pure(change) * (edge.rotation.now * Quat::pure(edge.tangent));
    edge.rotation.add(turned.scale(edge.weight + edge.weight));
    change
}

/// Corrects the bend–twist constraint between two rotations with inverse masses `w`. `arc` is T,
/// `alpha` α̃ and `sum` λ so far; returns λ.
#[inline(always)]
fn couple<L: Lane>([a, b]: [&mut Rotation<L>; 2], arc: Quat<L>, w: [L; 2], alpha: L, sum: V3<L>) -> V3<L> {
    let turned = b.now * arc;
    let now = a.now.conjugate() * turned;
    let is_opposite = now.dot(arc).lt(L::zero());
    let at_rest = V3::select(is_opposite, -arc.v, arc.v);
    let change = ((now.v - at_rest).add_scaled(alpha, sum)).scale(-(L::one() / (w[0] + w[1] + alpha)));
    let of_a = (turned * Quat::pure(change)).scale(-w[0]);
    let of_b = (a.now * Quat::pure(change) * arc.conjugate()).scale(w[1]);
    a.add(of_a);
    b.add(of_b);
    sum + change
}

#[cfg(test)]
mod tests;
