//! The implicit reference: the least of the training energies at every frame, which is what the
//! network is measured against.
//!
//! # Theory
//! A frame is a step of implicit Euler: the canonical positions x that minimise stretch,
//! bend–twist, gravity, inertia, drag and collision with the body, given the two frames before.
//! Self-collision, style and adhesion are left out. The motion starts from the static drape, the
//! least energy without inertia and drag at the first pose.
//!
//! # Practice
//! Newton's method with the Hessian of finite differences of the gradient, and a backtracking line
//! search. A Hessian costs as much as some dozens of iterations, so it is kept, also from frame to
//! frame, and corrected by the steps taken since (L-BFGS). It is computed anew after some
//! iterations that do not halve the gradient. An indefinite one is shifted until it has Cholesky
//! factors.
//!
//! A search begins where the velocities of the frame before lead; that folds short strands, which
//! are stiffer than they are heavy. If it does not converge it begins again from the shape of the
//! frame before, and from that at rest.

use crate::losses::body::{Body, BodyTerms, body};
use crate::losses::elastic::{ElasticTerms, RestStrand, elastic};
use crate::losses::motion::{Inertial, MotionTerms, Place};
use crate::losses::{Strand, zero};
use crate::{EDGES, PARTICLES};
use forelock_core::lane::V3;

/// Unknowns: the coordinates of all particles but the root.
const UNKNOWNS: usize = 3 * EDGES;
/// The gradient below which the least is found, g cm s⁻².
const CONVERGED: f64 = 1e-8;
/// The gradient below which a search that stops counts as having found it, g cm s⁻².
const NEARLY: f64 = 1e-5;
/// Most iterations of a search.
const MOST_ITERATIONS: usize = 1000;
/// Iterations that do not halve the gradient before the Hessian is computed anew.
const PATIENCE: usize = 8;
/// Most steps that correct a Hessian.
const MOVES: usize = 16;
/// Step of the finite differences, cm.
const STEP: f64 = 1e-6;

/// Coefficients of the energies.
#[derive(Clone, Copy, Debug, Default)]
pub struct Terms {
    /// Stretch and bend–twist.
    pub elastic: ElasticTerms,
    /// Gravity, inertia and drag.
    pub motion: MotionTerms,
    /// Collision with the body.
    pub body: BodyTerms,
}

/// A frame of one strand.
struct Frame<'a, B: ?Sized> {
    terms: &'a Terms,
    rest: &'a RestStrand<f64>,
    inertial: Inertial<'a, f64>,
    body: &'a B,
}

/// The lower Cholesky factor of a Hessian.
type Factors = Vec<[f64; UNKNOWNS]>;

/// What is known of the energy's curvature: a Hessian, and the steps taken since it was computed,
/// each with the change of the gradient.
struct Curvature {
    lower: Factors,
    moves: Vec<[[f64; UNKNOWNS]; 2]>,
    /// Iterations that did not halve the gradient.
    slow: usize,
    /// Whether the Hessian was shifted, and the steps are shorter than Newton's.
    is_shifted: bool,
}

impl Curvature {
    /// From a Hessian; none if no shift makes it positive definite.
    fn new(hessian: &[[f64; UNKNOWNS]]) -> Option<Self> {
        let (lower, shift) = factor(hessian)?;
        Some(Self { lower, moves: Vec::with_capacity(MOVES), slow: 0, is_shifted: shift > 0.0 })
    }

    /// The inverse of the Hessian times `gradient` (Nocedal and Wright 2006, Algorithm 7.4).
    fn step(&self, gradient: &[f64; UNKNOWNS]) -> [f64; UNKNOWNS] {
        let mut left = *gradient;
        let mut shares = [0.0; MOVES];
        for ([by, change], share) in self.moves.iter().zip(&mut shares).rev() {
            *share = dot(by, &left) / dot(by, change);
            left.iter_mut().zip(change).for_each(|(x, change)| *x -= *share * change);
        }
        let mut step = solve(&self.lower, &left);
        for ([by, change], share) in self.moves.iter().zip(shares) {
            let more = share - dot(change, &step) / dot(by, change);
            step.iter_mut().zip(by).for_each(|(x, by)| *x += more * by);
        }
        step
    }

    /// Adds a step `by` and the `change` of the gradient over it, if the energy is convex along it.
    fn learn(&mut self, by: [f64; UNKNOWNS], change: [f64; UNKNOWNS]) {
        let least = 1e-8 * (dot(&by, &by) * dot(&change, &change)).sqrt();
        if dot(&by, &change) > least {
            if self.moves.len() == MOVES {
                self.moves.remove(0);
            }
            self.moves.push([by, change]);
        }
    }
}

/// Where a search has ended.
struct Found {
    x: Strand<f64>,
    energy: f64,
    /// The largest component of the gradient there.
    slope: f64,
}

impl<B: Body<f64> + ?Sized> Frame<'_, B> {
    /// The energy at `x`, and its gradient.
    fn energy(&self, x: &Strand<f64>) -> (f64, [f64; UNKNOWNS]) {
        let mut by_x = zero();
        let energy = self.elastic(x, &mut by_x) + self.own(x, &mut by_x);
        (energy, unknowns(&by_x))
    }

    /// The part in which particles depend on each other.
    fn elastic(&self, x: &Strand<f64>, by_x: &mut Strand<f64>) -> f64 {
        elastic(&self.terms.elastic, self.rest, x, by_x)
    }

    /// The part in which each particle depends on its own place alone.
    fn own(&self, x: &Strand<f64>, by_x: &mut Strand<f64>) -> f64 {
        self.inertial.energy(&self.terms.motion, x, by_x)
            + body(&self.terms.body, self.body, x, by_x, &mut [0.0; PARTICLES])
    }

    /// The least of the energy that Newton's method finds from `x`, with the `curvature` of a
    /// search before, if there is one.
    fn least(&self, mut x: Strand<f64>, curvature: &mut Option<Curvature>) -> Found {
        let (mut energy, mut gradient) = self.energy(&x);
        for _ in 0..MOST_ITERATIONS {
            let before = largest(&gradient);
            if before < CONVERGED {
                break;
            }
            let is_fresh = curvature.is_none();
            if is_fresh {
                *curvature = Curvature::new(&self.hessian(&x));
            }
            // A strand that is not finite has no least.
            let Some(own) = curvature else { break };
            let step = own.step(&gradient);
            let slope = dot(&step, &gradient);
            let mut share = 1.0;
            let found = loop {
                let moved = along(&x, &step, -share);
                let (e, g) = self.energy(&moved);
                // Near the least, energies differ by less than their rounding.
                if e <= energy - 1e-4 * share * slope + 1e-13 * energy.abs() {
                    break Some((moved, e, g));
                }
                share *= 0.5;
                if share < 1e-8 {
                    break None;
                }
            };
            let Some((moved, e, g)) = found else {
                // No direction leads down any more.
                if is_fresh {
                    break;
                }
                *curvature = None;
                continue;
            };
            own.learn(step.map(|x| -share * x), std::array::from_fn(|k| g[k] - gradient[k]));
            (x, energy, gradient) = (moved, e, g);
            own.slow += usize::from(largest(&gradient) > 0.5 * before);
            if own.slow > PATIENCE || own.is_shifted {
                *curvature = None;
            }
        }
        Found { x, energy, slope: largest(&gradient) }
    }

    /// The least of the energy, found from the first of `starts` from which the search converges;
    /// otherwise the lowest that is found from any of them.
    fn least_from<const N: usize>(
        &self,
        starts: [Strand<f64>; N],
        curvature: &mut Option<Curvature>,
    ) -> Strand<f64> {
        let mut best: Option<Found> = None;
        for start in starts {
            let found = self.least(start, curvature);
            let is_found = found.slope < NEARLY;
            if best.as_ref().is_none_or(|best| is_found || found.energy < best.energy || best.energy.is_nan())
            {
                best = Some(found);
            }
            if is_found {
                break;
            }
            *curvature = None;
        }
        best.map_or(zero(), |best| best.x)
    }

    /// The Hessian at `x`.
    fn hessian(&self, x: &Strand<f64>) -> Vec<[f64; UNKNOWNS]> {
        let gradient = |part: fn(&Self, &Strand<f64>, &mut Strand<f64>) -> f64, x: &Strand<f64>| {
            let mut by_x = zero();
            part(self, x, &mut by_x);
            unknowns(&by_x)
        };
        let mut hessian = vec![[0.0; UNKNOWNS]; UNKNOWNS];
        let at = gradient(Self::elastic, x);
        for (k, row) in hessian.iter_mut().enumerate() {
            let mut moved = *x;
            moved[1 + k / 3].0[k % 3] += STEP;
            let there = gradient(Self::elastic, &moved);
            *row = std::array::from_fn(|l| (there[l] - at[l]) / STEP);
        }
        // All particles at once, along one axis after the other.
        let at = gradient(Self::own, x);
        for axis in 0..3 {
            let mut moved = *x;
            moved[1..].iter_mut().for_each(|x| x.0[axis] += STEP);
            let there = gradient(Self::own, &moved);
            for (l, (there, at)) in there.iter().zip(at).enumerate() {
                hessian[l - l % 3 + axis][l] += (there - at) / STEP;
            }
        }
        let mean = |k: usize, l: usize| 0.5 * (hessian[k][l] + hessian[l][k]);
        (0..UNKNOWNS).map(|k| std::array::from_fn(|l| mean(k, l))).collect()
    }
}

/// The coordinates of all particles but the root.
fn unknowns(x: &Strand<f64>) -> [f64; UNKNOWNS] {
    std::array::from_fn(|k| x[1 + k / 3].0[k % 3])
}

/// The sum of products: eight independent sums, so that additions overlap.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    const PARTS: usize = 8;
    let mut sums = [0.0; PARTS];
    let ((a, a_last), (b, b_last)) = (a.as_chunks::<PARTS>(), b.as_chunks::<PARTS>());
    for (a, b) in a.iter().zip(b) {
        sums.iter_mut().zip(a.iter().zip(b)).for_each(|(sum, (a, b))| *sum += a * b);
    }
    let last: f64 = a_last.iter().zip(b_last).map(|(a, b)| a * b).sum();
    sums.iter().sum::<f64>() + last
}

/// The largest number; NaN if one is.
fn largest(of: &[f64; UNKNOWNS]) -> f64 {
    of.iter().fold(0.0, |most: f64, x| if x.is_nan() || most.is_nan() { f64::NAN } else { x.abs().max(most) })
}

fn along(x: &Strand<f64>, step: &[f64; UNKNOWNS], share: f64) -> Strand<f64> {
    let mut moved = *x;
    for (k, step) in step.iter().enumerate() {
        moved[1 + k / 3].0[k % 3] += share * step;
    }
    moved
}

/// The lower Cholesky factor of `hessian`, shifted by a multiple of the identity if it has none,
/// and the shift; nothing if no shift up to 1e12 helps.
fn factor(hessian: &[[f64; UNKNOWNS]]) -> Option<(Factors, f64)> {
    let shifts = std::iter::successors(Some(1e-3), |shift| Some(4.0 * shift)).take_while(|s| *s < 1e12);
    let with = |shift: f64| Some((cholesky(hessian.to_vec(), shift)?, shift));
    std::iter::once(0.0).chain(shifts).find_map(with)
}

fn cholesky(mut a: Factors, shift: f64) -> Option<Factors> {
    for k in 0..UNKNOWNS {
        for l in 0..=k {
            let sum = dot(&a[k][..l], &a[l][..l]);
            let left = a[k][l] - sum + if k == l { shift } else { 0.0 };
            if k > l {
                a[k][l] = left / a[l][l];
            } else if left > 1e-9 {
                a[k][k] = left.sqrt();
            } else {
                return None;
            }
        }
    }
    Some(a)
}

/// Solves L Lᵀ x = b.
fn solve(lower: &[[f64; UNKNOWNS]], b: &[f64; UNKNOWNS]) -> [f64; UNKNOWNS] {
    let mut x = *b;
    for (k, row) in lower.iter().enumerate() {
        x[k] = (x[k] - dot(&row[..k], &x[..k])) / row[k];
    }
    for (k, row) in lower.iter().enumerate().rev() {
        let (before, own) = x.split_at_mut(k);
        own[0] /= row[k];
        before.iter_mut().zip(row).for_each(|(x, factor)| *x -= factor * own[0]);
    }
    x
}

/// The motion of a strand at `rest`, cm, in canonical space, while canonical space is at `places`
/// and the body is `bodies`, one a frame: its canonical positions in every frame.
///
/// The first frame follows two with the static drape at its pose.
///
/// # Panics
/// If there are not as many bodies as places.
pub fn motion<B: Body<f64>>(
    terms: &Terms,
    rest: &Strand<f64>,
    places: &[Place<f64>],
    bodies: &[B],
) -> Vec<Strand<f64>> {
    assert_eq!(places.len(), bodies.len(), "one body a frame");
    let at_rest = RestStrand::new(rest, &terms.elastic);
    let mut found = Vec::with_capacity(places.len());
    let still = Terms { motion: MotionTerms { is_dynamic: false, ..terms.motion }, ..*terms };
    let (mut before, mut curvature) = ([zero(); 2], None);
    for (place, body) in places.iter().zip(bodies) {
        if found.is_empty() {
            let inertial = Inertial { place: *place, before: [&before[0], &before[1]] };
            let drape =
                Frame { terms: &still, rest: &at_rest, inertial, body }.least_from([*rest], &mut None);
            before = [place.world(&drape); 2];
        }
        let mut on = canonical(place, &before);
        on[0] = rest[0];
        let inertial = Inertial { place: *place, before: [&before[0], &before[1]] };
        let along = found.last().copied().unwrap_or(*rest);
        let frame = Frame { terms, rest: &at_rest, inertial, body };
        let x = frame.least_from([on, along, *rest], &mut curvature);
        before = [place.world(&x), before[0]];
        found.push(x);
    }
    found
}

/// Canonical positions of 2 w_{t−1} − w_{t−2}.
fn canonical(place: &Place<f64>, [before, earlier]: &[Strand<f64>; 2]) -> Strand<f64> {
    let next = |i: usize| before[i] + before[i] - earlier[i] - place.origin;
    std::array::from_fn(|i| V3::zero().add_transposed(&place.rotation, next(i)))
}
