//! How far forces displace a strand at rest.
//!
//! # Theory
//! Edges do not stretch, so only the forces across them move a strand, f_i on edge i. With the
//! lengths l_i, directions t_i and tensions T_i of the edges, D the difference of neighbouring
//! particles, C = D⁻¹ the sum along the strand and Π the projection across each edge:
//!
//! ```text
//! P = C Π D K⁻¹ Dᵀ Π Cᵀ
//! K = Σ_i k_bt/l_i³ (x_{i+1} − 2 x_i + x_{i−1})² + Σ_i T_i/l_i (x_{i+1} − x_i)² + Σ_i s_i x_i²
//! ```
//!
//! K is the stiffness of bending, of the tension that gravity or motion keeps up, and of what holds
//! single particles, s: contact, style, and the least stiffness that the caller gives. It is the
//! same for all three coordinates, and pentadiagonal. P is symmetric and not negative.
//!
//! # Limitations
//! K is exact for small deflections of straight strands. Training uses P as a metric only: any
//! other that is not negative has the same solution.

use crate::losses::{Strand, zero};
use crate::{EDGES, PARTICLES};
use forelock_core::lane::{Lane, V3};

/// The edges of a strand.
struct Edges<L> {
    lengths: [L; EDGES],
    directions: [V3<L>; EDGES],
}

/// Forces on the edges of a strand; zero beyond the last.
struct Load<L> {
    /// Forces on what lies beyond each edge, across it.
    across: [V3<L>; EDGES + 1],
    /// Tensions over lengths, not negative.
    tensions: [L; EDGES + 1],
}

impl<L: Lane> Edges<L> {
    #[inline(always)]
    fn new(x: &Strand<L>) -> Self {
        let mut own = Self { lengths: [L::zero(); EDGES], directions: [V3::zero(); EDGES] };
        for i in 0..EDGES {
            let edge = x[i + 1] - x[i];
            own.lengths[i] = edge.dot(edge).max(L::from_f64(1e-20)).sqrt();
            own.directions[i] = edge.scale(L::one() / own.lengths[i]);
        }
        own
    }

    /// What `gradient` does to the edges.
    #[inline(always)]
    fn load(&self, gradient: &Strand<L>) -> Load<L> {
        let mut load = Load { across: [V3::zero(); EDGES + 1], tensions: [L::zero(); EDGES + 1] };
        let mut later = V3::zero();
        for i in (0..EDGES).rev() {
            later += gradient[i + 1];
            let along = self.directions[i].dot(later);
            load.across[i] = later.add_scaled(-along, self.directions[i]);
            load.tensions[i] = (-along).max(L::zero()) / self.lengths[i];
        }
        load
    }

    /// C Π D K⁻¹ Dᵀ of forces across the edges.
    #[inline(always)]
    fn displacement(&self, stiffness: &Eliminated<L>, across: &[V3<L>; EDGES + 1]) -> Strand<L> {
        let mut moved = [V3::zero(); EDGES];
        for i in 0..EDGES {
            moved[i] = across[i] - across[i + 1];
        }
        stiffness.solve(&mut moved);
        let mut displacement = zero();
        let mut before = V3::zero();
        for i in 0..EDGES {
            let (edge, t) = (moved[i] - before, self.directions[i]);
            displacement[i + 1] = displacement[i] + edge.add_scaled(-t.dot(edge), t);
            before = moved[i];
        }
        displacement
    }
}

/// A symmetric matrix with two diagonals beside the main one.
struct Pentadiagonal<L> {
    main: [L; EDGES],
    next: [L; EDGES],
    second: [L; EDGES],
}

impl<L: Lane> Pentadiagonal<L> {
    /// K, whose row i belongs to particle i + 1.
    #[inline(always)]
    fn stiffness(edges: &Edges<L>, tensions: &[L; EDGES + 1], bend_twist: L, held: &[L; PARTICLES]) -> Self {
        let mut own = Self { main: [L::zero(); EDGES], next: [L::zero(); EDGES], second: [L::zero(); EDGES] };
        for i in 0..EDGES {
            own.main[i] = held[i + 1] + tensions[i] + tensions[i + 1];
            own.next[i] = -tensions[i + 1];
        }
        for i in 0..EDGES {
            let length = edges.lengths[i];
            let mut bend = bend_twist / (length * length * length);
            if i == 0 {
                // The span of the first pair is half an edge.
                bend += bend;
            }
            let two = bend + bend;
            own.main[i] += bend;
            if i > 0 {
                own.main[i - 1] += two + two;
                own.next[i - 1] -= two;
            }
            if i > 1 {
                own.main[i - 2] += bend;
                own.next[i - 2] -= two;
                own.second[i - 2] += bend;
            }
        }
        own
    }

    /// Eliminates what is below the main diagonal.
    #[inline(always)]
    fn eliminated(mut self) -> Eliminated<L> {
        for i in 0..EDGES {
            self.main[i] = L::one() / self.main[i];
            if i + 1 < EDGES {
                let share = self.next[i] * self.main[i];
                self.main[i + 1] -= share * self.next[i];
                self.next[i + 1] -= share * self.second[i];
            }
            if i + 2 < EDGES {
                let share = self.second[i] * self.main[i];
                self.main[i + 2] -= share * self.second[i];
            }
        }
        Eliminated(self)
    }
}

/// A matrix after elimination, its main diagonal inverted.
struct Eliminated<L>(Pentadiagonal<L>);

impl<L: Lane> Eliminated<L> {
    /// Solves for `b`, in its place.
    #[inline(always)]
    fn solve(&self, b: &mut [V3<L>; EDGES]) {
        let Pentadiagonal { main, next, second } = &self.0;
        for i in 0..EDGES {
            if i + 1 < EDGES {
                b[i + 1] = b[i + 1].add_scaled(-(next[i] * main[i]), b[i]);
            }
            if i + 2 < EDGES {
                b[i + 2] = b[i + 2].add_scaled(-(second[i] * main[i]), b[i]);
            }
        }
        for i in (0..EDGES).rev() {
            if i + 1 < EDGES {
                b[i] = b[i].add_scaled(-next[i], b[i + 1]);
            }
            if i + 2 < EDGES {
                b[i] = b[i].add_scaled(-second[i], b[i + 2]);
            }
            b[i] = b[i].scale(main[i]);
        }
    }
}

/// P of a strand.
pub(super) struct Compliance<L> {
    edges: Edges<L>,
    stiffness: Eliminated<L>,
}

impl<L: Lane> Compliance<L> {
    /// Of the strand at `x` with the bending stiffness `bend_twist`. `gradient` is that of the
    /// energy: it gives the tensions. `held` is the stiffness that holds single particles.
    #[inline(always)]
    pub fn new(bend_twist: f64, x: &Strand<L>, gradient: &Strand<L>, held: &[L; PARTICLES]) -> Self {
        let edges = Edges::new(x);
        let tensions = edges.load(gradient).tensions;
        let stiffness = Pentadiagonal::stiffness(&edges, &tensions, L::from_f64(bend_twist), held);
        Self { edges, stiffness: stiffness.eliminated() }
    }

    /// P times `gradient`: minus the displacement, cm.
    #[inline(always)]
    pub fn displacement(&self, gradient: &Strand<L>) -> Strand<L> {
        self.edges.displacement(&self.stiffness, &self.edges.load(gradient).across)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    /// A random curved strand, and random forces on it.
    fn random(seed: u64) -> [Strand<f64>; 3] {
        let mut random = Random::new(seed);
        let mut vector = || V3(std::array::from_fn(|_| random.signed()));
        let mut x = zero();
        let mut out = V3([0.0, -1.0, 0.0]);
        for i in 0..EDGES {
            out = out.add_scaled(0.5, vector());
            x[i + 1] = x[i].add_scaled(0.9 / out.dot(out).sqrt(), out);
        }
        [x, std::array::from_fn(|_| vector()), std::array::from_fn(|_| vector())]
    }

    fn dot(a: &Strand<f64>, b: &Strand<f64>) -> f64 {
        a.iter().zip(b).map(|(a, b)| a.dot(*b)).sum()
    }

    #[test]
    fn edges_keep_their_length_and_the_work_is_not_negative() {
        for seed in 0..20 {
            let [x, f, _] = random(seed);
            let moved = Compliance::new(100.0, &x, &f, &[1e-3; PARTICLES]).displacement(&f);
            assert!(dot(&moved, &f) > 0.0);
            assert!(moved[0].dot(moved[0]) == 0.0);
            for i in 0..EDGES {
                let (edge, change) = (x[i + 1] - x[i], moved[i + 1] - moved[i]);
                assert!(edge.dot(change).abs() < 1e-9 * change.dot(change).sqrt().max(1e-9));
            }
        }
    }

    #[test]
    fn it_is_symmetric() {
        for seed in 0..20 {
            let [x, f, g] = random(seed);
            let compliance = Compliance::new(100.0, &x, &f, &[1e-3; PARTICLES]);
            let [of_f, of_g] = [&f, &g].map(|x| compliance.displacement(x));
            let [one, other] = [dot(&of_f, &g), dot(&of_g, &f)];
            let size = (dot(&of_f, &f) * dot(&of_g, &g)).sqrt();
            assert!((one - other).abs() < 1e-9 * size, "{one} {other} of {size}");
        }
    }

    /// A clamped beam of length L bends by F L³/(3 EI) under a force at its end; here the clamp is
    /// a spring of twice the stiffness of the other joints, and the beam has 24 joints.
    #[test]
    fn a_straight_strand_bends_as_a_beam() {
        let x: Strand<f64> = std::array::from_fn(|i| V3([0.5 * i as f64, 0.0, 0.0]));
        let mut f = zero();
        f[EDGES] = V3([0.0, 0.01, 0.0]);
        let moved = Compliance::new(100.0, &x, &f, &[0.0; PARTICLES]).displacement(&f);
        // Joint i has the arm 0.5 (24 − i) and turns by the moment over its stiffness k_bt/l.
        let turn = |i: usize| 0.01 * 0.5 * (24 - i) as f64 / (200.0 * if i == 0 { 2.0 } else { 1.0 });
        let expected: f64 = (0..EDGES).map(|i| turn(i) * 0.5 * (24 - i) as f64).sum();
        assert!((moved[EDGES].0[1] / expected - 1.0).abs() < 1e-9, "{} {expected}", moved[EDGES].0[1]);
    }

    /// A force F at the end of a pendulum of length L and weight W at its end displaces it by
    /// F L/W, if it does not resist bending.
    #[test]
    fn a_hanging_strand_swings_as_a_pendulum() {
        let x: Strand<f64> = std::array::from_fn(|i| V3([0.0, -0.5 * i as f64, 0.0]));
        let mut f = zero();
        f[EDGES] = V3([0.001, 2.0, 0.0]);
        let moved = Compliance::new(0.0, &x, &f, &[0.0; PARTICLES]).displacement(&f);
        assert!((moved[EDGES].0[0] - 0.001 * 12.0 / 2.0).abs() < 1e-12);
    }
}
