//! Gravity, inertia and drag: energies of the world positions w = R x + p.
//!
//! # Theory
//! ```text
//! gravity  −m Σ g·w
//! inertia  m/(2 Δt²) Σ |w − 2 w_{t−1} + w_{t−2}|²
//! drag     c m/(2 Δt) Σ |w − w_{t−1}|²
//! ```
//!
//! The least of all energies is a step of implicit Euler. The two frames before are constants: the
//! gradient does not go through them. The drag is ours: without it hair swings on, and the network
//! has to predict a phase that depends on more history than it sees.

use super::Strand;
use crate::PARTICLES;
use forelock_core::lane::{Lane, Mat3, V3};
use glam::DVec3;

/// Gravity's acceleration, cm s⁻².
pub const GRAVITY: DVec3 = DVec3::new(0.0, -981.0, 0.0);

/// Coefficients of [`Inertial::energy`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionTerms {
    /// Mass of a particle, g.
    pub mass: f64,
    /// Time between frames, s.
    pub dt_secs: f64,
    /// Rate at which velocities decay towards the air's, s⁻¹.
    pub drag: f64,
    /// Gravity's acceleration, cm s⁻².
    pub gravity: DVec3,
    /// Whether there are inertia and drag.
    pub is_dynamic: bool,
}

impl Default for MotionTerms {
    fn default() -> Self {
        Self { mass: 1e-4, dt_secs: 1.0 / 30.0, drag: 4.0, gravity: GRAVITY, is_dynamic: true }
    }
}

/// The pose of canonical space in the world.
#[derive(Clone, Copy, Debug)]
pub struct Place<L> {
    /// R.
    pub rotation: Mat3<L>,
    /// p, cm.
    pub origin: V3<L>,
}

impl<L: Lane> Place<L> {
    /// World positions of a strand.
    #[inline(always)]
    pub fn world(&self, x: &Strand<L>) -> Strand<L> {
        let mut world = *x;
        for w in &mut world {
            *w = self.origin.add_mul(&self.rotation, *w);
        }
        world
    }
}

/// The energies of motion of a frame.
#[derive(Clone, Copy, Debug)]
pub struct Inertial<'a, L> {
    /// Canonical space now.
    pub place: Place<L>,
    /// World positions one frame before, and two.
    pub before: [&'a Strand<L>; 2],
}

impl<L: Lane> Inertial<'_, L> {
    /// Gravity, inertia and drag.
    #[inline(always)]
    pub fn energy(&self, terms: &MotionTerms, x: &Strand<L>, gradient: &mut Strand<L>) -> L {
        let weight = V3::<L>::splat(terms.gravity * terms.mass);
        let dynamic = if terms.is_dynamic { terms.mass / terms.dt_secs } else { 0.0 };
        let inertia = L::from_f64(dynamic / terms.dt_secs);
        let drag = L::from_f64(terms.drag * dynamic);
        let half = L::from_f64(0.5);
        let mut energy = L::zero();
        for i in 0..PARTICLES {
            let w = self.place.origin.add_mul(&self.place.rotation, x[i]);
            let moved = w - self.before[0][i];
            let change = moved - (self.before[0][i] - self.before[1][i]);
            energy -= weight.dot(w);
            energy += half * (inertia * change.dot(change) + drag * moved.dot(moved));
            let by_w = change.scale(inertia).add_scaled(drag, moved) - weight;
            gradient[i] = gradient[i].add_transposed(&self.place.rotation, by_w);
        }
        energy
    }
}
