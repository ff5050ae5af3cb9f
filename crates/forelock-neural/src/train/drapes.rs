//! Drapes that a network is trained on by squared error: the data-driven way of GroomGen (2023),
//! kept for comparison.
//!
//! # Theory
//! For windows of frames and strands, drawn once, the static drapes are computed beforehand: the
//! least of stretch, bend–twist, gravity and collision with the body ([`reference`]). A step lowers
//!
//! ```text
//! 1/(2 · 25) Σ_i |x_i − x*_i|²
//! ```
//!
//! the mean over the strands and frames of the windows that it draws from these.
//!
//! # Limitations
//! Style, repulsion and adhesion have no part in the drapes. What a network learns of poses and
//! strands between the drawn ones is not asked for by any energy.
//!
//! [`reference`]: crate::reference

use super::set::{Drawn, TrainingSet};
use super::{Energies, MOMENTS, STRANDS};
use crate::PARTICLES;
use crate::losses::Strand;
use crate::losses::motion::Place;
use crate::network::inference::Positions;
use crate::random::Random;
use crate::reference::{Terms, motion};
use forelock_core::lane::{Lane, Mat3, V3};
use rayon::prelude::*;

/// Windows that are draped: 65,536 drapes.
pub const WINDOWS: usize = 512;
/// The stream of the random numbers that draw them; those of the steps have smaller numbers.
const STREAM: u64 = u64::MAX;

/// Drapes of a window: `[moment][strand]`, the newest moment first.
type Window = [[Positions; STRANDS]; MOMENTS];

/// Windows with their drapes.
#[derive(Debug)]
pub(super) struct Drapes {
    windows: Vec<(Drawn, Box<Window>)>,
}

impl Drapes {
    /// The drapes of `count` windows of `set` under `energies`, drawn by `seed`.
    pub(super) fn new(set: &TrainingSet, energies: &Energies, seed: u64, count: usize) -> Self {
        let mut random = Random::stream(seed, STREAM);
        let mut drawn: Vec<Drawn> = Vec::with_capacity(count);
        while drawn.len() < count {
            let more = set.draw(&mut random, false);
            drawn.extend(more.into_iter().take(count - drawn.len()));
        }
        let mut terms = energies.terms();
        terms.motion.is_dynamic = false;
        let one = |(number, drawn): (usize, Drawn)| {
            let own = Drawn { drape: Some(number), ..drawn };
            (own, Box::new(window(set, &terms, &drawn)))
        };
        Self { windows: drawn.into_par_iter().enumerate().map(one).collect() }
    }

    /// One of the windows.
    pub(super) fn draw(&self, random: &mut Random) -> Drawn {
        self.windows[random.below(self.windows.len())].0
    }

    /// The strands of window `number`.
    #[cfg(test)]
    pub(super) fn strands(&self, number: usize) -> [usize; STRANDS] {
        self.windows[number].0.strands
    }

    /// The drapes of window `number`.
    pub(super) fn of(&self, number: usize) -> &Window {
        &self.windows[number].1
    }
}

/// The drapes of a window.
fn window(set: &TrainingSet, terms: &Terms, drawn: &Drawn) -> Window {
    let clip = &set.clips[drawn.clip];
    // From the oldest: each drape starts where the one before has ended.
    let frames = &clip[drawn.frame + 1 - MOMENTS..=drawn.frame];
    let place = |frame: &super::Frame| Place {
        rotation: Mat3::splat(frame.rotation),
        origin: V3::splat(frame.origin - frames[0].origin),
    };
    let places: Vec<Place<f64>> = frames.iter().map(place).collect();
    let bodies: Vec<_> = frames.iter().map(|frame| frame.body(&set.field)).collect();
    let mut found = [[[[0.0; 3]; PARTICLES]; STRANDS]; MOMENTS];
    for (s, strand) in drawn.strands.iter().enumerate() {
        let rest = set.strands[*strand].rest.map(|x| V3(x.map(f64::from)));
        for (ago, x) in motion(terms, &rest, &places, &bodies).iter().rev().enumerate() {
            found[ago][s] = x.map(|x| x.0.map(|x| x as f32));
        }
    }
    found
}

/// Half the mean square of the distances of particles from `drape`; the gradient is added to `by`.
#[inline(always)]
pub(super) fn squared_error<L: Lane>(x: &Strand<L>, drape: &Strand<L>, by: &mut Strand<L>) -> L {
    let weight = L::from_f64(1.0 / PARTICLES as f64);
    let mut sum = L::zero();
    for i in 1..PARTICLES {
        let off = x[i] - drape[i];
        sum += off.dot(off);
        by[i] += off.scale(weight);
    }
    sum * weight * L::from_f64(0.5)
}
