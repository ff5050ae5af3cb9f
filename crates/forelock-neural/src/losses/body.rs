//! Collision with the body.
//!
//! # Theory
//! ```text
//! k_bc Σ_{i≥2} f(max(D − d_i, 0)),   f(q) = q³,  beyond q_l its tangent q_l² (3 q − 2 q_l)
//! ```
//!
//! d is the signed distance from the body. The straight tail bounds the gradient of hair that
//! starts deep inside; the paper has q³ alone. Particles 0 and 1 are at the root, inside the margin
//! D.

use super::Strand;
use crate::PARTICLES;
use forelock_core::lane::{Lane, V3};

/// Coefficients of [`body`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyTerms {
    /// k_bc, g cm⁻¹ s⁻².
    pub stiffness: f64,
    /// D, cm.
    pub margin: f64,
    /// q_l, cm; infinite for no tail.
    pub tail: f64,
}

impl Default for BodyTerms {
    fn default() -> Self {
        Self { stiffness: 100.0, margin: 0.5, tail: 1.5 }
    }
}

/// The first particle that collides.
pub const FIRST: usize = 2;

/// A distance and its gradient.
#[derive(Clone, Copy, Debug)]
pub struct Near<L> {
    /// Signed distance, cm; negative inside.
    pub distance: L,
    /// Its gradient.
    pub gradient: V3<L>,
}

impl<L: Lane> Near<L> {
    /// The nearer one in each lane.
    #[inline(always)]
    pub fn min(self, other: Self) -> Self {
        let mask = self.distance.lt(other.distance);
        Self {
            distance: L::select(mask, self.distance, other.distance),
            gradient: V3::select(mask, self.gradient, other.gradient),
        }
    }
}

/// A body in canonical space.
pub trait Body<L: Lane> {
    /// The signed distance at `x`, cm, and its gradient.
    fn near(&self, x: V3<L>) -> Near<L>;
}

/// The energy of collision with `body`. The second derivative with respect to the distance of each
/// particle is added to `stiffness`.
#[inline(always)]
pub fn body<L: Lane, B: Body<L> + ?Sized>(
    terms: &BodyTerms,
    body: &B,
    x: &Strand<L>,
    gradient: &mut Strand<L>,
    stiffness: &mut [L; PARTICLES],
) -> L {
    let [k, margin, tail] = [terms.stiffness, terms.margin, terms.tail.min(1e9)].map(L::from_f64);
    let [two, three] = [2.0, 3.0].map(L::from_f64);
    let mut energy = L::zero();
    for ((x, gradient), stiffness) in x.iter().zip(gradient).zip(stiffness).skip(FIRST) {
        let near = body.near(*x);
        let q = (margin - near.distance).max(L::zero());
        let cubic = q.min(tail);
        // Both forms agree up to the tail: there q is its own bound.
        energy += k * cubic * cubic * (three * q - two * cubic);
        let slope = three * k * cubic * cubic;
        *gradient = gradient.add_scaled(-slope, near.gradient);
        *stiffness += two * three * k * cubic;
    }
    energy
}

/// A sphere.
#[derive(Clone, Copy, Debug)]
pub struct Sphere<L> {
    /// Centre, cm.
    pub centre: V3<L>,
    /// Radius, cm.
    pub radius: L,
}

impl<L: Lane> Body<L> for Sphere<L> {
    #[inline(always)]
    fn near(&self, x: V3<L>) -> Near<L> {
        Capsule { ends: [self.centre; 2], radius: self.radius }.near(x)
    }
}

/// A capsule.
#[derive(Clone, Copy, Debug)]
pub struct Capsule<L> {
    /// The ends of its axis, cm.
    pub ends: [V3<L>; 2],
    /// Radius, cm.
    pub radius: L,
}

impl<L: Lane> Body<L> for Capsule<L> {
    #[inline(always)]
    fn near(&self, x: V3<L>) -> Near<L> {
        let [axis, from] = [self.ends[1] - self.ends[0], x - self.ends[0]];
        let tiny = L::from_f64(1e-20);
        let share = (axis.dot(from) / axis.dot(axis).max(tiny)).max(L::zero()).min(L::one());
        let out = from.add_scaled(-share, axis);
        let length = out.dot(out).max(tiny).sqrt();
        Near { distance: length - self.radius, gradient: out.scale(L::one() / length) }
    }
}

/// An ellipsoid about the origin: d = k₀ (k₀ − 1)/k₁ with k₀ = |x/r| and k₁ = |x/r²|, which is the
/// distance to first order near the surface.
#[derive(Clone, Copy, Debug)]
pub struct Ellipsoid<L> {
    /// Half axes r, cm.
    pub radii: V3<L>,
}

impl<L: Lane> Body<L> for Ellipsoid<L> {
    #[inline(always)]
    fn near(&self, x: V3<L>) -> Near<L> {
        let [rx, ry, rz] = self.radii.0;
        let over = V3([L::one() / rx, L::one() / ry, L::one() / rz]);
        let times = |a: V3<L>, b: V3<L>| V3([a.0[0] * b.0[0], a.0[1] * b.0[1], a.0[2] * b.0[2]]);
        let once = times(x, over);
        let twice = times(once, over);
        let tiny = L::from_f64(1e-20);
        let [k0, k1] = [once, twice].map(|v| v.dot(v).max(tiny).sqrt());
        let inverse = L::one() / k1;
        // ∇k₀ = x/r²/k₀,  ∇k₁ = x/r⁴/k₁
        let by_k0 = times(once, over).scale(L::one() / k0);
        let by_k1 = times(times(twice, over), over).scale(inverse);
        let excess = k0 - L::one();
        let slope = (k0 + excess) * inverse;
        Near {
            distance: k0 * excess * inverse,
            gradient: by_k0.scale(slope).add_scaled(-(k0 * excess * inverse * inverse), by_k1),
        }
    }
}

/// The union of several bodies.
impl<L: Lane, B: Body<L>> Body<L> for [B] {
    #[inline(always)]
    fn near(&self, x: V3<L>) -> Near<L> {
        let mut nearest = Near { distance: L::from_f64(1e9), gradient: V3::zero() };
        for body in self {
            nearest = body.near(x).min(nearest);
        }
        nearest
    }
}
