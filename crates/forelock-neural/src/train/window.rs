//! What a step lowers for a strand over consecutive frames.
//!
//! # Theory
//! The network predicts x_t at each frame t. Of the **drape** a step lowers the energy without
//! inertia and drag, V, at each frame.
//!
//! Of the **motion** it lowers the residual of the equation of motion, for every three frames:
//!
//! ```text
//! ½ r·(P + s P²) r,   r = ∇V(x_t) + m/Δt² (w_t − 2 w_{t−1} + w_{t−2}) + c m/Δt (w_t − w_{t−1})
//! ```
//!
//! with P the strand's compliance without inertia ([`Compliance`]), held constant. P r is the
//! displacement that r causes: the first part is its work, the second ([`SQUARED`]) its square.
//! With δ = (P + s P²) r and the stiffness of V times P taken as 1, the gradient with respect to
//! the three predictions is
//!
//! ```text
//! r + s P r + (m/Δt² + c m/Δt) δ,   −(2 m/Δt² + c m/Δt) δ,   m/Δt² δ
//! ```
//!
//! The paper lowers the energy of a step of implicit Euler, whose gradient is r with respect to x_t
//! alone. That trains each frame towards a step from the network's own two frames before. Where
//! inertia exceeds the stiffness, above a strand's lowest resonance, errors of those frames come
//! back larger: training improves at first and then grows worse without bound. The residual has the
//! same solution, and its gradient reaches all three frames. The descent is approximate where P is.
//!
//! # Practice
//! A part of the inertia is added to the stiffness of P ([`HELD`]), so that fast motion does not
//! outweigh slow motion: P then underestimates what soft modes weigh, and they swing freely.

use super::between::Between;
use super::compliance::Compliance;
use super::drapes::squared_error;
use super::set::Bust;
use super::{Energies, MOMENTS, STRANDS};
use crate::PARTICLES;
use crate::losses::body::body;
use crate::losses::elastic::{RestStrand, elastic};
use crate::losses::motion::{Inertial, Place};
use crate::losses::style::style;
use crate::losses::{Strand, zero};
use crate::network::head::OutputHead;
use crate::network::rotation::Basis;
use forelock_core::lane::{Lane, V3};

/// The share of the inertia m/Δt² that holds each particle in P.
const HELD: f64 = 1.0 / 3.0;

/// s, the weight of the squared displacement: long hair, which is soft, counts for more with it.
/// g s⁻².
const SQUARED: f64 = 0.03;

/// What motions are trained towards.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Objective {
    /// The least residual of the equation of motion.
    #[default]
    Residual,
    /// The least energy of a step from the frames before, which are held: the paper's.
    Step,
    /// The least squared error beside static drapes, for comparison: GroomGen's. For networks
    /// without a history.
    Drapes,
}

/// What a step of the training lowers.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Goal {
    pub energies: Energies,
    pub objective: Objective,
    pub head: OutputHead,
}

impl Goal {
    /// Frames that count: all of the drape, those with two before them of the motion.
    pub(super) fn samples(&self) -> usize {
        if self.energies.motion.is_dynamic { MOMENTS - 2 } else { MOMENTS }
    }

    /// The basis, if the head has one.
    pub(crate) fn basis<'a>(&self, basis: &'a Basis) -> Option<&'a Basis> {
        (self.head == OutputHead::Rotation).then_some(basis)
    }
}

/// A strand over consecutive frames, the newest first.
pub(super) struct Window<'a, L> {
    pub goal: &'a Goal,
    pub at_rest: &'a Strand<L>,
    pub shape: &'a RestStrand<L>,
    pub places: &'a [Place<L>; MOMENTS],
    pub bodies: &'a [Bust<'a>; MOMENTS],
    pub neighbours: Neighbours<'a>,
    /// What strands should be, in a training by squared error.
    pub drapes: Option<&'a Strands<L>>,
}

/// What neighbouring strands do to those in the lanes.
#[derive(Clone, Copy)]
pub(super) struct Neighbours<'a> {
    /// At each moment that counts; empty without repulsion and adhesion.
    pub moments: &'a [Between],
    /// The number of the first lane's strand.
    pub first: usize,
}

impl Neighbours<'_> {
    /// Adds their gradient and what they hold particles with; the energy a strand.
    #[inline(always)]
    fn add<L: Lane>(&self, ago: usize, gradient: &mut Strand<L>, held: &mut [L; PARTICLES]) -> L {
        let Some(between) = self.moments.get(ago) else { return L::zero() };
        let scalar = |x: f32| <L::Scalar as num_traits::NumCast>::from(x).unwrap_or_default();
        for i in 0..PARTICLES {
            let (mut by, mut stiffness) = (V3::<L>::zero(), L::zero());
            for lane in 0..L::WIDTH {
                let particle = (self.first + lane) * PARTICLES + i;
                by.set(lane, between.gradient[particle].map(scalar));
                stiffness.set(lane, scalar(between.stiffness[particle]));
            }
            gradient[i] += by;
            held[i] += stiffness;
        }
        L::from_f64(between.energy / STRANDS as f64)
    }
}

/// Predictions, or the gradient with respect to them.
pub(super) type Strands<L> = [Strand<L>; MOMENTS];

impl<L: Lane> Window<'_, L> {
    /// The sum over the frames that count; the gradient is added to `by`.
    #[inline(always)]
    pub(super) fn energy(&self, x: &Strands<L>, by: &mut Strands<L>) -> L {
        let is_dynamic = self.goal.energies.motion.is_dynamic;
        let mut sum = L::zero();
        if let Some(drapes) = self.drapes {
            for ago in 0..self.goal.samples() {
                sum += squared_error(&x[ago], &drapes[ago], &mut by[ago]);
            }
            return sum;
        }
        for ago in 0..self.goal.samples() {
            if is_dynamic && self.goal.objective == Objective::Residual {
                sum += self.residual(x, ago, by);
                continue;
            }
            let mut before = [zero(); 2];
            if is_dynamic {
                before = [self.places[ago + 1].world(&x[ago + 1]), self.places[ago + 2].world(&x[ago + 2])];
            }
            let inertial = Inertial { place: self.places[ago], before: [&before[0], &before[1]] };
            let mut held = [L::zero(); PARTICLES];
            sum += self.frame(&x[ago], ago, &inertial, &mut by[ago], &mut held);
        }
        sum
    }

    /// The energy of a frame, its gradient and the stiffness that holds single particles.
    #[inline(always)]
    fn frame(
        &self,
        x: &Strand<L>,
        ago: usize,
        inertial: &Inertial<'_, L>,
        gradient: &mut Strand<L>,
        held: &mut [L; PARTICLES],
    ) -> L {
        let terms = &self.goal.energies;
        let near = &self.bodies[ago];
        let mut energy = elastic(&terms.elastic, self.shape, x, gradient)
            + inertial.energy(&terms.motion, x, gradient)
            + body(&terms.body, near, x, gradient, held);
        if let Some(terms) = &terms.style {
            energy += style(terms, near, [self.at_rest, x], gradient, held);
        }
        energy + self.neighbours.add(ago, gradient, held)
    }

    /// ½ r·(P + s P²) r of the frame `ago` before the newest.
    #[inline(always)]
    fn residual(&self, x: &Strands<L>, ago: usize, by: &mut Strands<L>) -> L {
        let terms = &self.goal.energies.motion;
        let over_dt = terms.mass / terms.dt_secs;
        let mut held = [L::from_f64(HELD * over_dt / terms.dt_secs); PARTICLES];
        // Not mapped: closures are not compiled for the instruction set of the lanes.
        let last = self.places[ago + 1].world(&x[ago + 1]);
        let last_but_one = self.places[ago + 2].world(&x[ago + 2]);
        let inertial = Inertial { place: self.places[ago], before: [&last, &last_but_one] };
        let mut r = zero();
        self.frame(&x[ago], ago, &inertial, &mut r, &mut held);
        let compliance = Compliance::new(self.goal.energies.elastic.bend_twist, &x[ago], &r, &held);
        let moved = compliance.displacement(&r);
        let again = compliance.displacement(&moved);
        let squared = L::from_f64(SQUARED);
        let inertia = L::from_f64(over_dt / terms.dt_secs);
        let drag = L::from_f64(over_dt * terms.drag);
        let mut sum = L::zero();
        for i in 1..PARTICLES {
            let delta = moved[i].add_scaled(squared, again[i]);
            sum += r[i].dot(delta);
            by[ago][i] += r[i].add_scaled(squared, moved[i]).add_scaled(inertia + drag, delta);
            // δ in the axes of the world, then of the frames before.
            let world = V3::zero().add_mul(&self.places[ago].rotation, delta);
            let first = world.scale(-(inertia + inertia + drag));
            by[ago + 1][i] = by[ago + 1][i].add_transposed(&self.places[ago + 1].rotation, first);
            let second = world.scale(inertia);
            by[ago + 2][i] = by[ago + 2][i].add_transposed(&self.places[ago + 2].rotation, second);
        }
        sum * L::from_f64(0.5)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::losses::style::StyleTerms;
    use crate::random::Random;
    use crate::train::tests::ball;
    use forelock_core::lane::Mat3;
    use glam::{DMat3, DVec3};

    /// The energy is ½ r·(P + s P²) r. The gradient with respect to the frames before is exact;
    /// that with respect to the frame is r + s P r and the inertia's and the drag's part of the
    /// derivative of r.
    #[test]
    fn the_residual_and_its_gradient_are_those_of_the_equation_of_motion() {
        let mut random = Random::new(5);
        let mut vector = |size: f64| V3(std::array::from_fn(|_| size * random.signed()));
        let mut at_rest = [V3([0.0, 9.0, 0.0]); PARTICLES];
        for i in 1..PARTICLES {
            at_rest[i] = at_rest[i - 1] + V3([0.6, -0.3, 0.1]) + vector(0.3);
        }
        let mut x = [at_rest; MOMENTS];
        x.iter_mut().for_each(|x| x[1..].iter_mut().for_each(|x| *x += vector(0.1)));
        let places: [Place<f64>; MOMENTS] = std::array::from_fn(|ago| Place {
            rotation: Mat3::splat(DMat3::from_rotation_x(0.1 * ago as f64)),
            origin: V3::splat(DVec3::new(0.3 * ago as f64, 0.0, 0.1)),
        });
        let energies = Energies { style: Some(StyleTerms::default()), ..Energies::default() };
        let shape = RestStrand::new(&at_rest, &energies.elastic);
        let field = ball(8.8);
        let bodies = [Bust { field: &field, parts: &[] }; MOMENTS];
        let goal = Goal { energies, objective: Objective::Residual, head: OutputHead::Rotation };
        let window = Window {
            goal: &goal,
            at_rest: &at_rest,
            shape: &shape,
            places: &places,
            bodies: &bodies,
            neighbours: Neighbours { moments: &[], first: 0 },
            drapes: None,
        };
        let terms = &energies.motion;
        let residual = |x: &Strands<f64>| {
            let (mut r, mut held) = (zero(), [0.03; PARTICLES]);
            let before = [1, 2].map(|ago| places[ago].world(&x[ago]));
            let inertial = Inertial { place: places[0], before: [&before[0], &before[1]] };
            elastic(&energies.elastic, &shape, &x[0], &mut r);
            inertial.energy(terms, &x[0], &mut r);
            body(&energies.body, &field, &x[0], &mut r, &mut held);
            let own = StyleTerms::default();
            style(&own, &field, [&at_rest, &x[0]], &mut r, &mut held);
            (r, held)
        };
        let (r, held) = residual(&x);
        let compliance = Compliance::new(100.0, &x[0], &r, &held);
        let moved = compliance.displacement(&r);
        let again = compliance.displacement(&moved);
        let delta: Strand<f64> = std::array::from_fn(|i| moved[i].add_scaled(SQUARED, again[i]));
        let dot = |a: &Strand<f64>, b: &Strand<f64>| -> f64 { a.iter().zip(b).map(|(a, b)| a.dot(*b)).sum() };
        let mut by = [zero(); MOMENTS];
        let energy = window.residual(&x, 0, &mut by);
        let expected = 0.5 * (dot(&r, &moved) + SQUARED * dot(&moved, &moved));
        assert!((energy / expected - 1.0).abs() < 1e-9, "{energy} {expected}");
        for ago in 1..3 {
            let mut direction = zero();
            direction[1..].iter_mut().for_each(|d: &mut V3<f64>| *d = vector(0.1));
            let mut changed = x;
            changed[ago].iter_mut().zip(&direction).for_each(|(x, d)| *x += *d);
            let (after, _) = residual(&changed);
            let change: Strand<f64> = std::array::from_fn(|i| after[i] - r[i]);
            let [found, expected] = [dot(&by[ago], &direction), dot(&change, &delta)];
            assert!((found / expected - 1.0).abs() < 1e-6, "{ago}: {found} {expected}");
        }
        let inertia = terms.mass / terms.dt_secs * (1.0 / terms.dt_secs + terms.drag);
        for i in 1..PARTICLES {
            let off = by[0][i] - r[i].add_scaled(SQUARED, moved[i]).add_scaled(inertia, delta[i]);
            assert!(off.dot(off) < 1e-18);
        }
    }
}
