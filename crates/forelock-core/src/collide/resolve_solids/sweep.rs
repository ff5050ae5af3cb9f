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
//! `Shape::thinness`, of a primitive half of it, are traced: at ordinary speeds none. The path
//! of one in a field is sampled first, unless it is long or the field changes, and traced only if a
//! sample is inside.
//!
//! # Limitations
//! Rotation within a substep is approximated by the chord.

use crate::body::Shape;
use crate::lane::Real;

use super::dot;
use super::edges::{count_of, lerp};
use super::particle::lipschitz;

/// Steps of a trace. A path on which more steps touch nothing grazes the surface. It ends at the
/// last of them if it still approaches there, as between the teeth of a comb; otherwise it leaves.
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
    let mut last = None;
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
        last = (sigma > zero && dot(normal, go) < zero).then_some((point, normal));
    }
    last
}

/// Whether a point that ends at `sigma` over the skin of `thickness` may have passed through
/// `shape` on its `path`, or have entered it at another place than where it is nearest to the
/// surface. A field is sampled at places of the path that are its thinness apart.
pub(super) fn may_pass<T: Real>(shape: &Shape, thickness: T, sigma: T, path: &SweepPath<T>) -> bool {
    let number = crate::strands::number::<T>;
    let length = path.length();
    if sigma > length * lipschitz(shape) + number(TOUCH * shape.thinness()) {
        return false;
    }
    let Some(parts) = parts_of(shape, length, path.swell) else { return true };
    (1..parts).any(|part| {
        let point = lerp(path.ends[0], path.ends[1], count_of::<T>(part) / count_of::<T>(parts));
        shape.sample_at(point, path.fractions[1]).0 <= thickness
    })
}

/// Into how many parts the path of a point is divided to see whether it passed through a field,
/// whose surface moves by `swell` meanwhile. `None`: it is traced.
#[inline(always)]
pub(super) fn parts_of<T: Real>(shape: &Shape, length: T, swell: T) -> Option<usize> {
    if shape.cell().is_none() || swell > T::zero() {
        return None;
    }
    let parts = (length / crate::strands::number(shape.thinness())).ceil().to_usize()?;
    (parts <= MOST_PARTS).then_some(parts)
}

/// Most parts of a path that is not traced.
pub const MOST_PARTS: usize = 9;

/// Distance that counts as touching, over the thinness.
pub const TOUCH: f64 = 2e-3;
