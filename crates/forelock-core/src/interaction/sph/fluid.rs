//! Constants and smoothing kernels of the fluid.

use crate::interaction::sph::find_neighbours::MOST_NEIGHBOURS;
use crate::lane::Real;
use crate::strands::number;
use std::f64::consts::PI;

/// Constants shared by all particles of the fluid.
///
/// # Theory
/// The smoothing kernels of Müller, Charypar and Gross (2003), with q = r/h: poly6 for densities,
/// the gradient of the spiky kernel for pressure, the Laplacian of their viscosity kernel:
///
/// ```text
/// W(r) = 315/(64 π h³) (1 − q²)³ ,   −W′ₛ(r) = 45/(π h⁴) (1 − q)² ,   ∇²Wᵥ(r) = 45/(π h⁵) (1 − q)
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fluid<T> {
    /// Smoothing length h.
    pub h: T,
    /// h².
    pub h2: T,
    /// Mass of a particle times the factors of the three kernels.
    masses: [T; 3],
    /// Stiffness k of the pressure.
    pub pressure: T,
    /// Viscosity μ.
    pub viscosity: T,
    /// Maximum number of neighbours, K.
    pub neighbours: usize,
    /// Whether particles of one strand are neighbours.
    pub own_strand: bool,
    /// Whether a pair interacts only if each is among the nearest neighbours of the other.
    pub mutual: bool,
}

impl<T: Real> Fluid<T> {
    /// Creates a fluid of particles of mass `mass` and smoothing length `h`, with the neighbour
    /// rules of `params`, and without pressure and viscosity.
    pub fn new(h: f64, mass: f64, params: &super::SphParams) -> Self {
        let factors = [315.0 / (64.0 * PI * h.powi(3)), 45.0 / (PI * h.powi(4)), 45.0 / (PI * h.powi(5))];
        Self {
            h: number(h),
            h2: number(h * h),
            masses: factors.map(|factor| number(mass * factor)),
            pressure: T::zero(),
            viscosity: T::zero(),
            neighbours: (params.neighbours as usize).clamp(1, MOST_NEIGHBOURS),
            own_strand: params.own_strand,
            mutual: params.mutual,
        }
    }

    /// Multiplies the mass of the particles by `factor`.
    #[must_use]
    pub fn heavier(self, factor: f64) -> Self {
        Self { masses: self.masses.map(|mass| mass * number(factor)), ..self }
    }

    /// Mass of a particle times the factors of the kernels of density, pressure and viscosity.
    pub fn masses(&self) -> [T; 3] {
        self.masses
    }

    /// Sets k to `pressure` and μ to `viscosity`.
    #[must_use]
    pub fn pushing(self, pressure: f64, viscosity: f64) -> Self {
        Self { pressure: number(pressure), viscosity: number(viscosity), ..self }
    }

    /// m W of a particle at the squared distance `d2` < h².
    #[inline]
    pub fn density(&self, d2: T) -> T {
        let rest = T::one() - d2 / self.h2;
        self.masses[0] * rest * rest * rest
    }

    /// m |W′ₛ| and m ∇²Wᵥ of a particle at `distance` < h.
    #[inline]
    pub fn slopes(&self, distance: T) -> [T; 2] {
        let rest = T::one() - distance / self.h;
        [self.masses[1] * rest * rest, self.masses[2] * rest]
    }
}
