//! Distributes the contributions of contacts along a strand.
//!
//! # Theory
//! Forces f on the particles of a strand, of equal masses, move it by x with
//!
//! ```text
//! x_i + α_{i−1} (x_i − x_{i−1}) + α_i (x_i − x_{i+1}) = f_i ,
//! α_i = (ℓ/l_i)² ,   x = 0 where clamped
//! ```
//!
//! the discrete form of (I − ℓ² ∂²/∂s²) x = f. The inverse decays as exp(−s/ℓ), is symmetric, and
//! its columns sum to one, so the sum of f is preserved. The matrix is tridiagonal: one sweep
//! forwards and one backwards solve it.

use crate::lane::{LANES, Real};
use crate::strands::Model;
use glam::Vec3;

/// Minimum number of strands of a task.
const TASK: usize = 32;

/// A strand in the solve.
#[derive(Clone, Copy, Debug)]
pub(super) struct Strand {
    /// Block × [`LANES`] + lane.
    pub slot: usize,
    /// Place of the first particle.
    pub place: usize,
    /// Index of the first body, and number of bodies.
    pub first: usize,
    pub particles: usize,
    /// Minimum length over which the contacts bend the strand, metres.
    pub bend: f32,
}

/// A particle in the solve.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Body {
    pub position: Vec3,
    pub velocity: Vec3,
    /// Sums over the contacts in a round: displacement and impulse.
    pub moves: Vec3,
    pub impulses: Vec3,
    /// Σ |w| of the contacts, then S of that.
    pub share: f32,
    /// α to the next particle, and the inverse pivot; zero where clamped.
    alpha: f32,
    inverse: f32,
    /// First corner of a joint, and number of corners.
    pub first: u32,
    pub count: u32,
}

impl Strand {
    pub fn lane(&self) -> usize {
        self.slot % LANES
    }

    pub fn of<'a>(&self, bodies: &'a [Body]) -> &'a [Body] {
        &bodies[self.first..self.first + self.particles]
    }

    /// Factorises the matrix of the strand, and applies S to the shares.
    pub fn prepare<T: Real>(&self, bodies: &mut [Body], model: &Model<T>, clamped: usize, spread: f32) {
        let last = self.particles - 1;
        let mut before = Body::default();
        // The pivot without α to the next particle: a sum of positive terms, which avoids the
        // cancellation in the pivot.
        let mut own = 0.0;
        for (i, body) in bodies.iter_mut().enumerate() {
            let length = model.rest_lengths[3 * (self.place + i)].0[self.lane()].to_f32().unwrap_or(0.0);
            let ratio = if i < last { spread / length } else { 0.0 };
            body.alpha = ratio * ratio;
            if i < clamped {
                (body.inverse, body.share) = (0.0, 0.0);
            } else {
                let held = if before.inverse > 0.0 { own * before.inverse } else { 1.0 };
                own = 1.0 + before.alpha * held;
                body.inverse = 1.0 / (own + body.alpha);
                body.share += before.alpha * before.inverse * before.share;
            }
            before = *body;
        }
        let mut next = 0.0;
        for body in bodies.iter_mut().rev() {
            body.share = (body.share + body.alpha * next) * body.inverse;
            next = body.share;
        }
    }

    /// Moves the strand by S of the sums over its contacts.
    pub fn apply(&self, bodies: &mut [Body]) {
        let mut before = Body::default();
        for body in &mut *bodies {
            let share = before.alpha * before.inverse;
            body.moves += share * before.moves;
            body.impulses += share * before.impulses;
            before = *body;
        }
        let (mut moves, mut impulses) = (Vec3::ZERO, Vec3::ZERO);
        for body in bodies.iter_mut().rev() {
            moves = (body.moves + body.alpha * moves) * body.inverse;
            impulses = (body.impulses + body.alpha * impulses) * body.inverse;
            body.position += moves;
            body.velocity += impulses;
        }
    }
}

/// Calls `f` for each strand and its bodies, in parallel.
pub(super) fn each(strands: &[Strand], bodies: &mut [Body], f: &(impl Fn(&Strand, &mut [Body]) + Sync)) {
    if strands.len() <= TASK {
        let mut rest = bodies;
        for strand in strands {
            let (own, others) = rest.split_at_mut(strand.particles);
            f(strand, own);
            rest = others;
        }
        return;
    }
    let (left, right) = strands.split_at(strands.len() / 2);
    let (left_bodies, right_bodies) = bodies.split_at_mut(right[0].first - left[0].first);
    rayon::join(|| each(left, left_bodies, f), || each(right, right_bodies, f));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::strands::Strands;

    /// A free strand preserves the sum of its loads for any length ℓ; a clamped one does not.
    #[test]
    fn the_sum_is_preserved() {
        let positions: Vec<[f32; 3]> = (0..40u8).map(|i| [0.0, -1e-3 * f32::from(i), 0.0]).collect();
        let model = Model::new(&Strands::new(&positions, &[0, 40])).unwrap();
        let strand = Strand { slot: 0, place: 0, first: 0, particles: 40, bend: 0.0 };
        for (clamped, spread, whole) in
            [(0, 0.0, 1.0), (0, 0.01, 1.0), (0, 1.0, 1.0), (0, 10.0, 1.0), (2, 1.0, 0.0)]
        {
            let mut bodies = vec![Body::default(); 40];
            strand.prepare(&mut bodies, &model, clamped, spread);
            bodies[17].moves = Vec3::X;
            strand.apply(&mut bodies);
            let sum: f32 = bodies.iter().map(|body| body.position.x).sum();
            assert!((sum - whole).abs() < 1e-3, "clamped {clamped}, over {spread} m: {sum}");
        }
    }
}
