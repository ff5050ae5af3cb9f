//! Accelerations by pressure and viscosity between neighbours (Sánchez-Banderas et al. 2015,
//! Algorithm 1, lines 9 and 10).
//!
//! # Theory
//! With p_i = max(0, k (ρ_i − ρ0_i)) and the kernels of [`Fluid`] (Müller et al. 2003, Eqs. 10 and
//! 14):
//!
//! ```text
//! ρ_i a_i = Σ_j m (p_i + p_j)/(2 ρ_j) |W′ₛ| (x_i − x_j)/r  +  μ Σ_j m/ρ_j ∇²Wᵥ (u_j − u_i)
//! ```
//!
//! Each particle has a separate rest density, that of the groom around it, so no force acts on hair
//! at rest. The forces of a pair cancel if each particle is in the list of the other: with `mutual`
//! only such pairs interact, and momentum is conserved; without it, one-sided pairs change the
//! total momentum.

use crate::interaction::sph::Fluid;
use crate::interaction::sph::find_neighbours::{CHUNK, Neighbours, Particle, SearchReal};
use rayon::prelude::*;

/// WGSL of the stage.
pub const WGSL: &str = include_str!("kernel.wgsl");

/// Writes the acceleration of each particle to `out`, in the sorted order of `neighbours`.
/// `rest_density` is by number.
pub fn push<T: SearchReal>(
    neighbours: &Neighbours<T>,
    rest_density: &[T],
    fluid: &Fluid<T>,
    pressure: &mut [T],
    out: &mut [[T; 3]],
) {
    let over = |(p, (density, particle)): (&mut T, (&T, &Particle<T>))| {
        *p = (fluid.pressure * (*density - rest_density[particle.number as usize])).max(T::zero());
    };
    let dense = neighbours.density.par_iter().zip(&neighbours.sorted);
    pressure.par_iter_mut().zip(dense).with_min_len(CHUNK).for_each(over);
    let pressure = &*pressure;
    out.par_iter_mut().enumerate().with_min_len(CHUNK).for_each(|(slot, out)| {
        *out = acceleration(neighbours, pressure, slot, fluid);
    });
}

fn acceleration<T: SearchReal>(
    neighbours: &Neighbours<T>,
    pressure: &[T],
    slot: usize,
    fluid: &Fluid<T>,
) -> [T; 3] {
    let (own, half) = (&neighbours.sorted[slot], crate::strands::number::<T>(0.5));
    let mut force = [T::zero(); 3];
    for &other in neighbours.near(slot, fluid) {
        let j = other as usize;
        let near = &neighbours.sorted[j];
        let d = [0, 1, 2].map(|c| own.x[c] - near.x[c]);
        let d2 = d[0] * d[0] + d[1] * d[1] + d[2] * d[2];
        if fluid.mutual && !neighbours.has_neighbour(j, d2, own.number) {
            continue;
        }
        let distance = d2.sqrt();
        let [spiky, viscous] = fluid.slopes(distance);
        // Particles at the same position exert no pressure on each other.
        let inverse = if distance > T::zero() { distance.recip() } else { T::zero() };
        let push = half * (pressure[slot] + pressure[j]) * spiky * inverse / neighbours.density[j];
        let drag = fluid.viscosity * viscous / neighbours.density[j];
        for c in 0..3 {
            force[c] = force[c] + push * d[c] + drag * (near.u[c] - own.u[c]);
        }
    }
    force.map(|f| f / neighbours.density[slot])
}
