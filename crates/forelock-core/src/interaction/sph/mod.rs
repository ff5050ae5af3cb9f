//! Smoothed-particle hydrodynamics (SPH): pressure and viscosity between nearby hair particles.
//!
//! # Theory
//! Dense hair is treated as a fluid of the particles of its strands (Hadap, Magnenat-Thalmann 2001;
//! Sánchez-Banderas et al. 2015, Sec. 3.2): the nearest neighbours of each particle are found
//! ([`find_neighbours`]), the pressure and viscosity between them yield accelerations
//! ([`push_particles`]), and these change the velocities before the strands are solved. It is an
//! alternative to the [`grid`](crate::interaction::grid): it needs no cells and works where only a
//! few neighbours are near, but its pressure is soft and it has no solid boundaries.
//!
//! # Practice
//! All particles have the same mass, chosen such that the mean density at rest is 1. The rest
//! density of a particle is the density of the groom around it, so no force acts on a groom at
//! rest. Velocities are those of the motion of the strands, not the velocities that
//! follow-the-leader stores.
//!
//! # Limitations
//! Steps are explicit: in the upper half of the ranges of [`SphParams`] hair jitters, and with
//! steps much longer than 16 ms it does so earlier.
//!
//! [`find_neighbours`]: crate::interaction::sph::find_neighbours
//! [`push_particles`]: crate::interaction::sph::push_particles

mod exchange;
pub mod find_neighbours;
mod fluid;
mod params;
pub mod push_particles;

pub use crate::frame::SphReport;
pub use exchange::EXCHANGE;
pub use fluid::Fluid;
pub use params::SphParams;

use crate::lane::Simd;
use crate::lane::{LANES, Real, Row};
use crate::params::STATED_STEP_SECS;
use crate::strands::Model;
use crate::strands::{State, number, vector};
use find_neighbours::{CHUNK, Neighbours, Particle, SearchReal};
use rayon::prelude::*;

/// WGSL shared by the kernels of SPH.
pub const WGSL: &str = include_str!("fluid.wgsl");

/// SPH particles and their buffers.
#[derive(Debug)]
pub struct Sph<T: SearchReal> {
    params: SphParams,
    fluid: Fluid<T>,
    /// Rest density of each particle, by number, including the factor [`SphParams::rest_density`].
    rest_density: Vec<T>,
    /// Place × [`LANES`] + lane of each particle, by number.
    places: Vec<u32>,
    /// The number of the particle in each lane of each place.
    numbers: Vec<Row<u32>>,
    particles: Vec<Particle<T>>,
    neighbours: Neighbours<T>,
    pressure: Vec<T>,
    accelerations: Vec<[T; 3]>,
}

/// Number of particles whose neighbours determine the smoothing length.
const SAMPLES: usize = 128;

impl<T: SearchReal> Sph<T> {
    /// Creates the SPH particles of `model`, measures their rest densities, and searches neighbours
    /// with the instruction set `simd`.
    pub fn new(model: &Model<T>, params: &SphParams, simd: Simd) -> Self {
        let mut places = vec![0; model.particle_count];
        let mut numbers = vec![Row([0; LANES]); model.places()];
        let mut particles = vec![Particle::default(); model.particle_count];
        #[expect(clippy::cast_possible_truncation, reason = "particle numbers are 32-bit")]
        for block in &model.blocks {
            for (lane, &strand) in block.strands.iter().enumerate() {
                let first = model.offsets[strand as usize];
                for (number, place) in (first..).zip(block.range()) {
                    numbers[place].0[lane] = number;
                    if lane < block.live {
                        places[number as usize] = (place * LANES + lane) as u32;
                        let x = vector(&model.rest, place, lane);
                        particles[number as usize] = Particle { x, u: [T::zero(); 3], number, strand };
                    }
                }
            }
        }
        let h = if params.smoothing_length > 0.0 {
            params.smoothing_length
        } else {
            smoothing_length(&particles, params).unwrap_or(0.1 * model.reach).max(1e-6)
        };
        let mut neighbours = Neighbours::on(simd);
        let fluid = Fluid::new(h, 1.0, params);
        neighbours.find(&particles, &fluid);
        let sum: f64 = neighbours.density.iter().filter_map(|density| density.to_f64()).sum();
        let mass = neighbours.density.len() as f64 / sum;
        let rest = |slot: &u32| neighbours.density[*slot as usize] * number(mass * params.rest_density);
        let rest_density = neighbours.slots.iter().map(rest).collect();
        let count = particles.len();
        Self {
            params: params.clone(),
            fluid: fluid.heavier(mass).pushing(
                params.pressure * (h / STATED_STEP_SECS).powi(2),
                params.viscosity * h * h / STATED_STEP_SECS,
            ),
            rest_density,
            places,
            numbers,
            particles,
            neighbours,
            pressure: vec![T::zero(); count],
            accelerations: vec![[T::zero(); 3]; count],
        }
    }

    /// The parameters.
    pub fn params(&self) -> &SphParams {
        &self.params
    }

    /// The constants of the fluid.
    pub fn fluid(&self) -> &Fluid<T> {
        &self.fluid
    }

    /// Rest density of each particle, by number.
    pub fn rest_density(&self) -> &[T] {
        &self.rest_density
    }

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.rest_density)
            + size_of_val(&*self.places)
            + size_of_val(&*self.numbers)
            + size_of_val(&*self.particles)
            + size_of_val(&*self.pressure)
            + size_of_val(&*self.accelerations)
            + self.neighbours.bytes()
    }

    /// Applies pressure and viscosity for `dt_secs` to the velocities. The velocities of clamped
    /// particles change too; the strand solver overwrites them.
    pub fn push(&mut self, state: &mut State<T>, dt_secs: f64) -> SphReport {
        let clock = std::time::Instant::now();
        let (dt, inverse_dt) = (number::<T>(dt_secs), number::<T>(1.0 / dt_secs));
        let moving = |(particle, &at): (&mut Particle<T>, &u32)| {
            let (place, lane) = (at as usize / LANES, at as usize % LANES);
            particle.x = vector(&state.positions, place, lane);
            particle.u = if state.previous.is_empty() {
                vector(&state.velocities, place, lane)
            } else {
                let before = vector(&state.previous, place, lane);
                [0, 1, 2].map(|c| (particle.x[c] - before[c]) * inverse_dt)
            };
        };
        self.particles.par_iter_mut().zip(&self.places).with_min_len(CHUNK).for_each(moving);
        self.neighbours.find(&self.particles, &self.fluid);
        let found = clock.elapsed().as_secs_f64();
        let (fluid, rest) = (&self.fluid, &self.rest_density);
        push_particles::push(&self.neighbours, rest, fluid, &mut self.pressure, &mut self.accelerations);
        let (slots, accelerations) = (&self.neighbours.slots, &self.accelerations);
        let kick = |(rows, numbers): (&mut [Row<T>], &Row<u32>)| {
            for (lane, &number) in numbers.0.iter().enumerate() {
                let a = &accelerations[slots[number as usize] as usize];
                for c in 0..3 {
                    rows[c].0[lane] = rows[c].0[lane] + dt * a[c];
                }
            }
        };
        let rows = state.velocities.par_chunks_exact_mut(3).zip(&self.numbers);
        rows.with_min_len(CHUNK / LANES).for_each(kick);
        self.report([found, clock.elapsed().as_secs_f64() - found])
    }

    fn report(&self, secs: [f64; 2]) -> SphReport {
        let over = |(density, particle): (&T, &Particle<T>)| {
            (*density / self.rest_density[particle.number as usize]).to_f64().unwrap_or(0.0)
        };
        let dense = self.neighbours.density.par_iter().zip(&self.neighbours.sorted).with_min_len(CHUNK);
        let densest = dense.map(over).reduce(|| 0.0, f64::max);
        let neighbours: u64 = self.neighbours.counts.iter().map(|&count| u64::from(count)).sum();
        SphReport { densest, neighbours: neighbours as f64 / self.particles.len().max(1) as f64, secs }
    }
}

/// The distance within which half of the particles have as many neighbours as `params` asks for,
/// metres; `None` if no particle has neighbours.
fn smoothing_length<T: Real>(particles: &[Particle<T>], params: &SphParams) -> Option<f64> {
    let every = particles.len().div_ceil(SAMPLES).max(1);
    let farthest = |own: &Particle<T>| {
        let others = particles
            .iter()
            .filter(|other| other.number != own.number && (params.own_strand || other.strand != own.strand));
        let square = |other: &Particle<T>| {
            (0..3).map(|c| (other.x[c] - own.x[c]).to_f64().unwrap_or(f64::INFINITY).powi(2)).sum::<f64>()
        };
        let mut squares: Vec<f64> = others.map(square).collect();
        let last = (params.neighbours as usize).min(squares.len()).checked_sub(1)?;
        Some(squares.select_nth_unstable_by(last, f64::total_cmp).1.sqrt())
    };
    let mut found: Vec<f64> = particles.par_iter().step_by(every).filter_map(farthest).collect();
    found.sort_by(f64::total_cmp);
    found.get(found.len() / 2).copied().filter(|h| *h > 0.0)
}
