//! How often a strand is drawn.
//!
//! # Theory
//! The energies of long, soft strands are the largest part of the mean energy, and of its variance
//! over what is drawn. They are drawn more often, with a chance that grows with the square of the
//! length, and count for less each time: the expected mean is that of all strands (importance
//! sampling). Neighbouring strands that act on each other are drawn together instead, all runs with
//! the same chance.

use crate::PARTICLES;
use crate::random::Random;

/// The share of draws in which all strands have the same chance. No weight exceeds its inverse.
const ALIKE: f64 = 0.25;

/// The chances of all strands of a training.
#[derive(Debug)]
pub(super) struct Chances {
    /// The sum of the chances of the strands up to each.
    sums: Vec<f64>,
    /// The uniform chance over a strand's own.
    weights: Vec<f32>,
}

impl Chances {
    /// Of strands with these rest positions, at least one.
    pub(super) fn new<'a>(strands: impl Iterator<Item = &'a [[f32; 3]; PARTICLES]>) -> Self {
        let square = |strand: &[[f32; 3]; PARTICLES]| {
            let edge = |[a, b]: &[[f32; 3]; 2]| (0..3).map(|c| f64::from(b[c] - a[c]).powi(2)).sum::<f64>();
            strand.array_windows().map(|ends| edge(ends).sqrt()).sum::<f64>().powi(2)
        };
        let squares: Vec<f64> = strands.map(square).collect();
        let mean = squares.iter().sum::<f64>() / squares.len() as f64;
        let (mut sums, mut weights, mut sum) = (Vec::new(), Vec::new(), 0.0);
        for square in squares {
            let chance = ALIKE + (1.0 - ALIKE) * square / mean;
            sum += chance;
            sums.push(sum);
            weights.push((1.0 / chance) as f32);
        }
        Self { sums, weights }
    }

    /// The number of a strand.
    pub(super) fn draw(&self, random: &mut Random) -> usize {
        let last = self.sums.len() - 1;
        let at = random.unit() * self.sums[last];
        self.sums.partition_point(|sum| *sum <= at).min(last)
    }

    /// What a strand counts for when it is drawn.
    pub(super) fn weight(&self, strand: usize) -> f32 {
        self.weights[strand]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Long strands come more often; the mean of any number over the draws is that over all
    /// strands.
    #[test]
    fn weights_make_up_for_the_chances() {
        let strand = |length: f32| std::array::from_fn(|i| [0.0, length * i as f32 / 24.0, 0.0]);
        let strands: Vec<[[f32; 3]; PARTICLES]> =
            (0..100).map(|k| strand(1.0 + 40.0 * (k % 2) as f32)).collect();
        let chances = Chances::new(strands.iter());
        let mut random = Random::new(5);
        let (mut counts, mut sums) = ([0, 0], [0.0, 0.0]);
        for _ in 0..100_000 {
            let drawn = chances.draw(&mut random);
            counts[drawn % 2] += 1;
            sums[drawn % 2] += f64::from(chances.weight(drawn)) / 100_000.0;
        }
        // A quarter of the draws are uniform, and half of them draw short strands.
        assert!((counts[0] as f64 / 100_000.0 - 0.125).abs() < 0.01, "{counts:?}");
        assert!(sums.iter().all(|sum| (sum - 0.5).abs() < 0.01), "{sums:?}");
        assert!((0..100).all(|strand| chances.weight(strand) <= 4.0));
    }
}
