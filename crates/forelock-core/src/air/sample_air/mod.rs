//! Samples the air at every particle, once a frame: mean wind and turbulence, reduced behind solids
//! and inside the hair.
//!
//! # Theory
//! u = [U + Σ_j a_j e_j cos 2π(k_j·x + φ_j)] (1 − s D(x)) e^−τ(x), with the wind of
//! [`air`](crate::air), the deficit D of the wake of solids, and the optical depth τ of the hair.
//!
//! # Practice
//! Phases are computed at the origin of the frame in float64 and reduced to a turn, so float32
//! suffices anywhere in the world. The cosine is a polynomial of degree 9 over a quarter turn with
//! an error of 4e-6. Cost: about 6 ns per particle on AVX2.

use crate::air::{Canopy, MODES, Wake, WindField};
use crate::lane::{Lane, Real, Row, V3};
use crate::strands::number;
use glam::DVec3;

/// WGSL of the stage, of the wake and of the canopy.
pub const WGSL: &str = include_str!("kernel.wgsl");

/// A plane wave of the turbulence.
#[derive(Clone, Copy, Debug)]
struct PlaneWave<T> {
    /// Wave vector, turns a metre.
    wave: [T; 3],
    /// Amplitude, m/s.
    amplitude: [T; 3],
    /// Phase at the origin of the frame, turns.
    phase: T,
}

/// The air during a frame, relative to the origin of the frame.
#[derive(Clone, Copy, Debug)]
pub struct AirTerms<'a, T> {
    mean: DVec3,
    modes: Option<[PlaneWave<T>; MODES]>,
    /// The wake, and the fraction of the wind that it blocks.
    wake: Option<(&'a Wake, f32)>,
    canopy: Option<&'a Canopy>,
}

impl<'a, T: Real> AirTerms<'a, T> {
    /// Creates the air of `wind` relative to `origin`, with the shelter of solids (`wake`) and of
    /// the hair (`canopy`).
    pub fn new(wind: &WindField, wake: &'a Wake, canopy: &'a Canopy, origin: DVec3) -> Self {
        let modes = wind.modes.map(|modes| {
            modes.map(|mode| {
                let vector = |v: DVec3| v.to_array().map(number);
                PlaneWave {
                    wave: vector(mode.wave),
                    amplitude: vector(mode.amplitude),
                    phase: number(mode.phase_at(origin)),
                }
            })
        });
        #[expect(clippy::cast_possible_truncation, reason = "a share")]
        let wake = (wind.shelter > 0.0).then_some((wake, wind.shelter as f32));
        let canopy = (wind.hair_depth > 0.0).then_some(canopy);
        Self { mean: wind.mean, modes, wake, canopy }
    }

    /// The fraction of the wind that shelter leaves at `place`, metres from the origin.
    #[inline(always)]
    fn open(&self, place: [f32; 3]) -> f32 {
        let mut open = 1.0;
        if let Some((wake, shelter)) = self.wake {
            open -= shelter * wake.deficit(place);
        }
        if let Some(canopy) = self.canopy {
            open *= canopy.open(place);
        }
        open
    }
}

/// Writes the velocity of the air at each particle of lanes `first..first + L::WIDTH` to `out`,
/// three rows per particle. `exposure` is empty or has one row per particle.
#[inline(always)]
pub fn sample<L: Lane>(
    air: &AirTerms<'_, L::Scalar>,
    positions: &[Row<L::Scalar>],
    exposure: &[Row<L::Scalar>],
    first: usize,
    out: &mut [Row<L::Scalar>],
) {
    for i in 0..positions.len() / 3 {
        let x = V3::<L>::load(positions, i, first);
        let mut u = V3::splat(air.mean);
        if let Some(modes) = &air.modes {
            for PlaneWave { wave, amplitude, phase } in modes {
                let turns = x.0[2].mul_add(L::splat(wave[2]), L::splat(*phase));
                let turns = x.0[1].mul_add(L::splat(wave[1]), turns);
                let turns = x.0[0].mul_add(L::splat(wave[0]), turns);
                let [a, b, c] = *amplitude;
                u = u.add_scaled(cos_turns(turns), V3([L::splat(a), L::splat(b), L::splat(c)]));
            }
        }
        if air.wake.is_some() || air.canopy.is_some() {
            let mut open = L::one();
            for lane in 0..L::WIDTH {
                let place = x.get(lane).map(|c| num_traits::ToPrimitive::to_f32(&c).unwrap_or(0.0));
                open.set(lane, number(f64::from(air.open(place))));
            }
            u = u.scale(open);
        }
        if let Some(row) = exposure.get(i) {
            u = u.scale(L::load(row, first));
        }
        u.store(out, i, first);
    }
}

/// cos 2πt for |t| up to 2²⁰ in float32.
#[inline(always)]
pub fn cos_turns<L: Lane>(turns: L) -> L {
    // Adding and subtracting 1.5 · 2^(length of the mantissa) rounds to an integer.
    let rounder =
        L::from_f64(if size_of::<L::Scalar>() == 4 { 12_582_912.0 } else { 6_755_399_441_055_744.0 });
    let r = turns - ((turns + rounder) - rounder);
    // cos 2πr = sin 2πq with q = ¼ − |r| in ±¼; Taylor polynomial.
    let q = L::from_f64(0.25) - r.max(-r);
    let z = q * q;
    let mut sum = L::from_f64(42.058_693_944_897_65);
    for coefficient in
        [-76.705_859_753_061_39, 81.605_249_276_075_05, -41.341_702_240_399_76, std::f64::consts::TAU]
    {
        sum = sum.mul_add(z, L::from_f64(coefficient));
    }
    q * sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_polynomial_approximates_the_cosine() {
        for k in -3000..3000 {
            let t = f64::from(k) * 0.017;
            let exact = (std::f64::consts::TAU * t).cos();
            assert!((cos_turns(t) - exact).abs() < 4e-6, "{t}");
            #[expect(clippy::cast_possible_truncation, reason = "the lane's precision")]
            let single = cos_turns(crate::lane::Pack::<1, false>::splat(t as f32)).get(0);
            // Float32 turns of 51 have a rounding of 2e-6, times 2π.
            assert!((f64::from(single) - exact).abs() < 2e-5, "{t}");
        }
    }
}
