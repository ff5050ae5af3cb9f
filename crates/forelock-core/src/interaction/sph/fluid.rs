//! The fluid's constants and its kernels.

use crate::interaction::sph::find_neighbours::MOST_NEIGHBOURS;
use crate::lane::Real;
use crate::strands::number;
use std::f64::consts::PI;

/// What every particle of the fluid has in common.
///
/// # Theory
/// The kernels of Müller, Charypar and Gross (2003), with q = r/h: poly6 for densities, the gradient of the spiky kernel for pressure, the Laplacian of their viscosity kernel:
///
/// ```text
/// W(r) = 315/(64 π h³) (1 − q²)³        −W′ₛ(r) = 45/(π h⁴) (1 − q)²        ∇²Wᵥ(r) = 45/(π h⁵) (1 − q)
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fluid<T> {
    /// Smoothing length h.
    pub h: T,
    /// h².
    pub h2: T,
    /// Mass of a particle times the factors of the three kernels.
    masses: [T; 3],
    /// Pressure k over density, and viscosity μ.
    pub pressure: T,
    /// See `pressure`.
    pub viscosity: T,
    /// Neighbours, K.
    pub neighbours: usize,
    /// Whether particles of one strand are neighbours.
    pub own_strand: bool,
    /// Whether pairs push each other only if each is among the other's nearest.
    pub mutual: bool,
}

impl<T: Real> Fluid<T> {
    /// Particles of `mass` that feel each other up to `h`, with neighbours as `params` have it, and as yet without pressure and viscosity.
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

    /// The same fluid of particles `factor` times as heavy.
    #[must_use]
    pub fn heavier(self, factor: f64) -> Self {
        Self { masses: self.masses.map(|mass| mass * number(factor)), ..self }
    }

    /// Mass of a particle times the factors of the three kernels: of densities, of pressure, of viscosity.
    pub fn masses(&self) -> [T; 3] {
        self.masses
    }

    /// The same fluid with k = `pressure` and μ = `viscosity`.
    #[must_use]
    pub fn pushing(self, pressure: f64, viscosity: f64) -> Self {
        Self { pressure: number(pressure), viscosity: number(viscosity), ..self }
    }

    /// m W of a particle at the square `d2` of a distance, under h².
    #[inline]
    pub fn density(&self, d2: T) -> T {
        let rest = T::one() - d2 / self.h2;
        self.masses[0] * rest * rest * rest
    }

    /// m |W′ₛ| and m ∇²Wᵥ of a particle at `distance`, under h.
    #[inline]
    pub fn slopes(&self, distance: T) -> [T; 2] {
        let rest = T::one() - distance / self.h;
        [self.masses[1] * rest * rest, self.masses[2] * rest]
    }
}
