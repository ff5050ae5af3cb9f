//! What a particle meets on its way, where its end alone does not tell.
//!
//! # Theory
//! In the solid's own frame a particle goes straight from q₀ to q₁ in a substep. A particle that is inside at q₁ is taken out to the nearest surface, which is the
//! one it came through as long as it went no deeper than half of the solid's thickness. Beyond that the way itself is traced: σ is 1-Lipschitz, so from a
//! point at distance σ the next σ of the way is free (sphere tracing; Hart 1996). At the first touch the particle stops:
//! what is left of its way in that substep is lost, its velocity along the surface is not.
//!
//! # Practice
//! Only particles that used up their clearance *and* moved by more than the solid's `Shape::thinness` are traced: at ordinary speeds none.
//!
//! # Limitations
//! Particles are traced, not the edges between them: a part of a solid thinner than the distance between two particles can pass between them.
//! Rotation within a substep is taken along the chord.

use crate::body::Shape;
use crate::lane::Real;

use super::dot;

/// Steps of a trace; a way that grazes the surface longer than that counts as free.
pub const SWEEP_STEPS: usize = 48;

/// A way through a solid's own space during a substep.
#[derive(Clone, Copy, Debug)]
pub(super) struct Way<T> {
    /// Its ends.
    pub ends: [[T; 3]; 2],
    /// The frame's fractions at its ends, for shapes that change.
    pub fractions: [f64; 2],
    /// How far such a shape's surface may move meanwhile.
    pub swell: T,
}

impl<T: Real> Way<T> {
    /// How far it goes relative to the surface, at most.
    pub(super) fn length(&self) -> T {
        let [from, to] = self.ends;
        let go = [0, 1, 2].map(|c| to[c] - from[c]);
        dot(go, go).sqrt() + self.swell
    }
}

/// Where a particle that goes `way` first comes within `thickness` of `shape`, and the normal there; none if it touches nothing.
#[inline(never)]
pub(super) fn sweep<T: Real>(shape: &Shape, thickness: T, way: &Way<T>) -> Option<([T; 3], [T; 3])> {
    let number = crate::strands::number::<T>;
    let zero = T::zero();
    let touch = number(TOUCH * shape.thinness());
    let [from, to] = way.ends;
    let go = [0, 1, 2].map(|c| to[c] - from[c]);
    let length = dot(go, go).sqrt();
    // How fast the distance may fall along the way.
    let fall = length * super::lipschitz(shape) + way.swell;
    if fall == zero || fall.is_nan() {
        return None;
    }
    let mut share = zero;
    for _ in 0..SWEEP_STEPS {
        let point = [0, 1, 2].map(|c| from[c] + share * go[c]);
        let time = share.to_f64().unwrap_or(1.0);
        let fraction = way.fractions[0] + (way.fractions[1] - way.fractions[0]) * time;
        let (distance, normal) = shape.sample_at(point, fraction);
        let sigma = distance - thickness;
        if sigma <= touch && (dot(normal, go) < zero || way.swell > zero) {
            // Out to the skin, which a particle that starts in touch may be under by a rounding.
            let out = (-sigma).max(zero);
            return Some(([0, 1, 2].map(|c| point[c] + out * normal[c]), normal));
        }
        share = share + sigma.max(touch) / fall;
        if share >= T::one() || sigma.is_nan() {
            return None;
        }
    }
    None
}

/// Distance that counts as touching, over the thinness.
pub const TOUCH: f64 = 2e-3;
