//! Continuous collision detection: the first touch of a particle on its path in a substep.
//!
//! # Theory
//! In the solid's local space a particle moves straight from q₀ to q₁ in a substep. A particle that
//! is inside at q₁ is projected onto the nearest surface, which is the one it entered through as
//! long as it is no deeper than half of the solid's thickness. For larger displacements the path
//! itself is traced: σ is 1-Lipschitz, so from a point at distance σ the next σ of the path is free
//! (sphere tracing; Hart 1996). At the first touch the particle stops: the rest of its displacement
//! in that substep is lost, its velocity along the surface is kept.
//!
//! # Practice
//! Only particles that used up their clearance *and* moved by more than the solid's
//! `Shape::thinness` are traced: at ordinary speeds none.
//!
//! # Limitations
//! Rotation within a substep is approximated by the chord.

use crate::body::Shape;
use crate::lane::Real;

use super::dot;
use super::particle::lipschitz;

/// Steps of a trace. A path on which more steps touch nothing counts as free; such a path grazes
/// the surface.
pub const SWEEP_STEPS: usize = 48;

/// The path of a particle during a substep, in a solid's local space.
#[derive(Clone, Copy, Debug)]
pub(super) struct SweepPath<T> {
    /// Start and end point.
    pub ends: [[T; 3]; 2],
    /// The frame's fractions at both ends, for shapes that change.
    pub fractions: [f64; 2],
    /// Upper bound of the displacement meanwhile of such a shape's surface.
    pub swell: T,
}

impl<T: Real> SweepPath<T> {
    /// Upper bound of the displacement relative to the surface.
    pub(super) fn length(&self) -> T {
        let [from, to] = self.ends;
        let go = [0, 1, 2].map(|c| to[c] - from[c]);
        dot(go, go).sqrt() + self.swell
    }
}

/// The first point of `path` within `thickness` of `shape`, and the normal there; `None` if there
/// is none.
#[inline(never)]
pub(super) fn sweep<T: Real>(shape: &Shape, thickness: T, path: &SweepPath<T>) -> Option<([T; 3], [T; 3])> {
    let number = crate::strands::number::<T>;
    let zero = T::zero();
    let touch = number(TOUCH * shape.thinness());
    let [from, to] = path.ends;
    let go = [0, 1, 2].map(|c| to[c] - from[c]);
    let length = dot(go, go).sqrt();
    // Upper bound of the decrease of the distance along the path.
    let fall = length * lipschitz(shape) + path.swell;
    if fall == zero || fall.is_nan() {
        return None;
    }
    let mut share = zero;
    for _ in 0..SWEEP_STEPS {
        let point = [0, 1, 2].map(|c| from[c] + share * go[c]);
        let time = share.to_f64().unwrap_or(1.0);
        let fraction = path.fractions[0] + (path.fractions[1] - path.fractions[0]) * time;
        let (distance, normal) = shape.sample_at(point, fraction);
        let sigma = distance - thickness;
        if sigma <= touch && (dot(normal, go) < zero || path.swell > zero) {
            // Move to the skin: a particle that starts in contact may be under it by a rounding
            // error.
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
