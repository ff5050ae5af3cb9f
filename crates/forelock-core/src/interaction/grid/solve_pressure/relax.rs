//! Projected successive over-relaxation of the pressure in two colours.
//!
//! # Theory
//! The complementarity problem P ≥ 0, ∇·u ≥ t, with equality in one of them for each cell, is
//! solved by sweeps P ← max(P + ω (P* − P), 0), where P* satisfies the equation of the cell with
//! its neighbours as they are (Cryer 1971). Cells of one colour of a chessboard are not neighbours,
//! so the order within a colour does not matter.
//!
//! # Practice
//! The cells of a colour in a row lie side by side, eight to a [`Pack`], and neighbours along y and
//! z have the same index in the other colour. A strip of cells is one pack of each colour. Packs
//! without hair are left out. A pack whose right-hand sides are not positive keeps zero pressure
//! until a neighbour is under pressure, so a sweep only visits packs that have been woken by one.
//! The pressures of velocities and of displacements are solved for side by side.

use crate::interaction::grid::{Bounds, GridParams, STRIP};
use crate::lane::widest;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU8, Ordering::Relaxed};

/// Compressibility of cells, relative to the diagonal: without it the system of a pocket enclosed
/// by walls would be singular.
pub const SLACK: f32 = 3e-6;
/// Sweeps from one check of the convergence to the next.
pub const SWEEPS: u32 = 4;
/// Longest side of the rest shape over the thickness of the hair for which ω is chosen.
const THINNESS: f64 = 7.0;
/// Cells of a pack.
const PACK: usize = STRIP / 2;
/// Packs under pressure from which the layers of a sweep are relaxed in parallel.
const PARALLEL: usize = 4096;
/// States of a pack: all its pressures stay zero; it is relaxed; it has woken its neighbours too.
const ASLEEP: u8 = 0;
const AWAKE: u8 = 1;
const SPREAD: u8 = 2;

/// The over-relaxation ω that is best for hair n cells thick with free cells on both sides, 2/(1 +
/// sin π/n) (Young 1954), for a grid of `resolution` cells along its longest side.
pub fn relaxation(resolution: u32) -> f32 {
    let cells = (f64::from(resolution) / THINNESS).max(2.0);
    (2.0 / (1.0 + (std::f64::consts::PI / cells).sin())) as f32
}

/// Eight cells of one colour of a strip. Cells that take no pressure have zero coefficients.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(super) struct Pack {
    /// Mobilities of the faces below and above along x, y and z, over the diagonal.
    sides: [[f32; PACK]; 6],
    /// Right-hand sides for velocities and for displacements over the diagonal.
    rhs: [[f32; PACK]; 2],
    /// The diagonal of the matrix; 0 if the cell takes no pressure.
    diagonal: [f32; PACK],
}

/// The equations of the cells of a strip, before they are divided by the diagonal.
#[derive(Clone, Copy, Debug)]
pub(super) struct Equations {
    /// Mobilities of the faces below and above along x, y and z.
    pub sides: [[f32; STRIP]; 6],
    /// Their sum with [`SLACK`]; 0 if the cell takes no pressure.
    pub diagonal: [f32; STRIP],
    /// Right-hand sides for velocities and for displacements.
    pub rhs: [[f32; STRIP]; 2],
}

/// The packs of a layer, by colour.
#[derive(Debug, Default)]
pub(super) struct Layer {
    packs: [Vec<Pack>; 2],
    /// The strip of each pack among those of the layer, and whether its first cell lies at an odd
    /// place.
    places: [Vec<(u32, u32)>; 2],
}

/// The system and its pressures.
#[derive(Debug, Default)]
pub(crate) struct System {
    layers: Vec<Layer>,
    /// Those of velocities and of displacements.
    solutions: [Solution; 2],
}

/// One of the two pressures.
#[derive(Debug, Default)]
struct Solution {
    /// Pressures of the cells of each colour, a pack a strip.
    pressure: [Vec<f32>; 2],
    /// State of the pack of each colour in each strip.
    states: [Vec<AtomicU8>; 2],
}

/// The result of a solve.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Convergence {
    pub sweeps: u32,
    /// Largest change in the last sweeps over the largest right-hand side.
    pub residual: f32,
}

impl Pack {
    /// The cells of a strip whose places are odd, or not.
    #[inline(always)]
    fn new(equations: &Equations, odd: usize) -> Self {
        let mut own = Self { sides: [[0.0; PACK]; 6], rhs: [[0.0; PACK]; 2], diagonal: [0.0; PACK] };
        for n in 0..PACK {
            let diagonal = equations.diagonal[2 * n + odd];
            let inverse = if diagonal > 0.0 { 1.0 / diagonal } else { 0.0 };
            own.diagonal[n] = diagonal;
            for side in 0..6 {
                own.sides[side][n] = equations.sides[side][2 * n + odd] * inverse;
            }
            for which in 0..2 {
                own.rhs[which][n] = equations.rhs[which][2 * n + odd] * inverse;
            }
        }
        own
    }
}

impl Layer {
    /// Adds the cells of `strip`; those of the first colour are at odd places if `odd` is 1.
    #[inline(always)]
    pub fn add(&mut self, strip: usize, odd: usize, equations: &Equations) {
        for (colour, (packs, places)) in self.packs.iter_mut().zip(&mut self.places).enumerate() {
            let odd = odd ^ colour;
            let pack = Pack::new(equations, odd);
            if pack.diagonal.iter().any(|diagonal| *diagonal > 0.0) {
                packs.push(pack);
                #[expect(clippy::cast_possible_truncation, reason = "a layer has fewer strips")]
                places.push((strip as u32, odd as u32));
            }
        }
    }

    /// One colour of a sweep. `own` are the pressures of the layer in this colour, `other` those of
    /// the box in the other, `states` those of the packs of both. Returns the largest change times
    /// the diagonal.
    #[inline(always)]
    fn relax(&self, own: &mut [f32], other: &[f32], states: [&[AtomicU8]; 2], at: &Sweep) -> f32 {
        let mut largest = [0.0f32; PACK];
        for (pack, &(strip, odd)) in self.packs[at.colour].iter().zip(&self.places[at.colour]) {
            let strip = strip as usize;
            let place = at.first + strip;
            let state = states[0][place].load(Relaxed);
            if state == ASLEEP {
                continue;
            }
            let along_x = PACK * place + odd as usize;
            assert!(place > at.layer && PACK * (place + at.layer + 1) < other.len(), "a cell has neighbours");
            // SAFETY: a layer is at least a row and a row at least a strip, so this holds the first
            // and the last of the neighbours.
            let beside = |index: usize| unsafe { &*other.as_ptr().add(index).cast::<[f32; PACK]>() };
            let near = [
                beside(along_x - 1),
                beside(along_x),
                beside(PACK * (place - at.row)),
                beside(PACK * (place + at.row)),
                beside(PACK * (place - at.layer)),
                beside(PACK * (place + at.layer)),
            ];
            let own = &mut own[PACK * strip..PACK * (strip + 1)];
            let old: [f32; PACK] = *own.first_chunk().unwrap_or(&[0.0; PACK]);
            let rhs = &pack.rhs[at.which];
            let mut next = [0.0; PACK];
            for n in 0..PACK {
                let below = pack.sides[0][n] * near[0][n]
                    + pack.sides[2][n] * near[2][n]
                    + pack.sides[4][n] * near[4][n];
                let above = pack.sides[1][n] * near[1][n]
                    + pack.sides[3][n] * near[3][n]
                    + pack.sides[5][n] * near[5][n];
                let value = old[n] + at.omega * (rhs[n] + (below + above) - old[n]);
                next[n] = if value > 0.0 { value } else { 0.0 };
            }
            for n in 0..PACK {
                let change = (next[n] - old[n]).abs() * pack.diagonal[n];
                largest[n] = if change > largest[n] { change } else { largest[n] };
            }
            own.copy_from_slice(&next);
            if state == AWAKE && next.iter().any(|pressure| *pressure > 0.0) {
                states[0][place].store(SPREAD, Relaxed);
                let [row, layer] = [at.row, at.layer];
                for near in
                    [place - 1, place, place + 1, place - row, place + row, place - layer, place + layer]
                {
                    let _ = states[1][near].compare_exchange(ASLEEP, AWAKE, Relaxed, Relaxed);
                }
            }
        }
        largest.into_iter().fold(0.0, f32::max)
    }
}

/// One colour of a sweep over a layer.
#[derive(Clone, Copy, Debug)]
struct Sweep {
    colour: usize,
    /// Velocities (0) or displacements (1).
    which: usize,
    /// Over-relaxation.
    omega: f32,
    /// The first strip of the layer.
    first: usize,
    /// Strips of a row and of a layer.
    row: usize,
    layer: usize,
}

impl System {
    pub fn bytes(&self) -> usize {
        let of_layer = |layer: &Layer| {
            let packs: usize = layer.packs.iter().map(Vec::capacity).sum();
            let places: usize = layer.places.iter().map(Vec::capacity).sum();
            packs * size_of::<Pack>() + 8 * places
        };
        let of_solution = |own: &Solution| {
            4 * own.pressure.iter().map(Vec::capacity).sum::<usize>()
                + own.states.iter().map(Vec::capacity).sum::<usize>()
        };
        self.layers.iter().map(of_layer).sum::<usize>()
            + self.solutions.iter().map(of_solution).sum::<usize>()
    }

    /// Fits the system to the box. Returns its layers, without packs.
    pub fn fit(&mut self, bounds: &Bounds) -> &mut [Layer] {
        let (layers, strips) = (bounds.dims[2], bounds.layer_strips());
        for solution in &mut self.solutions {
            for pressure in &mut solution.pressure {
                crate::scratch::resize(pressure, PACK * strips * layers, 0.0);
            }
            for states in &mut solution.states {
                states.resize_with(strips * layers, AtomicU8::default);
            }
        }
        if self.layers.len() < layers {
            self.layers.resize_with(layers, Layer::default);
        }
        for layer in &mut self.layers {
            // Room for all packs of a layer, so that only a larger box allocates.
            for (packs, places) in layer.packs.iter_mut().zip(&mut layer.places) {
                packs.clear();
                places.clear();
                if packs.capacity() < strips {
                    packs.reserve_exact(2 * strips);
                    places.reserve_exact(2 * strips);
                }
            }
        }
        &mut self.layers[..layers]
    }

    /// Solves for the pressures of velocities and, if `displaces`, of displacements, from zero.
    /// `strips` are not zero where pressures are used.
    pub fn solve(
        &mut self,
        bounds: &Bounds,
        strips: &[u8],
        params: &GridParams,
        displaces: bool,
    ) -> [Convergence; 2] {
        let layers = &self.layers[..bounds.dims[2]];
        let [velocities, displacements] = &mut self.solutions;
        let solve = |which: usize, solution: &mut Solution| {
            solution.clear(strips);
            if which == 0 || displaces {
                solution.relax(layers, bounds, params, which)
            } else {
                Convergence::default()
            }
        };
        let (a, b) = rayon::join(|| solve(0, velocities), || solve(1, displacements));
        [a, b]
    }

    /// Writes the pressures `which` of `strip` to `out`. Those of the first colour are at odd
    /// places if `odd` is 1.
    #[inline(always)]
    pub fn pressures(&self, which: usize, strip: usize, odd: usize, out: &mut [f32]) {
        let places = PACK * strip..PACK * (strip + 1);
        let [red, black] = self.solutions[which].pressure.each_ref().map(|own| &own[places.clone()]);
        let [even, odd] = if odd == 0 { [red, black] } else { [black, red] };
        for (pair, (even, odd)) in out.chunks_exact_mut(2).zip(even.iter().zip(odd)) {
            pair.copy_from_slice(&[*even, *odd]);
        }
    }

    /// Calls `f` with the index of each cell that can be under pressure and its right-hand side for
    /// velocities.
    #[cfg(test)]
    pub fn right_hand_sides(&self, bounds: &Bounds, mut f: impl FnMut(usize, f32)) {
        for (k, layer) in self.layers[..bounds.dims[2]].iter().enumerate() {
            for (packs, places) in layer.packs.iter().zip(&layer.places) {
                for (pack, &(strip, odd)) in packs.iter().zip(places) {
                    let first = STRIP * (bounds.layer_strips() * k + strip as usize);
                    for n in (0..PACK).filter(|&n| pack.diagonal[n] > 0.0) {
                        f(first + 2 * n + odd as usize, pack.rhs[0][n] * pack.diagonal[n]);
                    }
                }
            }
        }
    }
}

impl Solution {
    /// Zero pressure in all strips that are used.
    fn clear(&mut self, strips: &[u8]) {
        let used = |strip: &usize| strips[*strip] != 0;
        for (pressure, states) in self.pressure.iter_mut().zip(&mut self.states) {
            for strip in (0..strips.len()).filter(used) {
                pressure[PACK * strip..PACK * (strip + 1)].fill(0.0);
                *states[strip].get_mut() = ASLEEP;
            }
        }
    }

    /// Wakes the packs with positive right-hand sides. Returns the largest of these.
    fn wake(&mut self, layers: &[Layer], per_layer: usize, which: usize) -> f32 {
        let mut lack = 0.0f32;
        for (k, layer) in layers.iter().enumerate() {
            for colour in 0..2 {
                for (pack, &(strip, _)) in layer.packs[colour].iter().zip(&layer.places[colour]) {
                    let given = pack.rhs[which].iter().zip(&pack.diagonal).map(|(rhs, d)| rhs * d);
                    let most = given.fold(0.0, f32::max);
                    if most > 0.0 {
                        *self.states[colour][per_layer * k + strip as usize].get_mut() = AWAKE;
                        lack = lack.max(most);
                    }
                }
            }
        }
        lack
    }

    /// Relaxes until the pressure has converged.
    fn relax(&mut self, layers: &[Layer], bounds: &Bounds, params: &GridParams, which: usize) -> Convergence {
        let (row, layer) = (bounds.strips(), bounds.layer_strips());
        let mut relaxed = Convergence::default();
        let lack = self.wake(layers, layer, which);
        if lack <= 0.0 {
            return relaxed;
        }
        let omega = relaxation(params.resolution);
        let Self { pressure: [red, black], states } = self;
        let states = &*states;
        let mut sweep = |colour: usize, is_parallel: bool| -> f32 {
            let (own, other) = if colour == 0 { (&mut *red, &*black) } else { (&mut *black, &*red) };
            let states = [&states[colour][..], &states[1 - colour][..]];
            let relax = |(k, (own_layer, own)): (usize, (&Layer, &mut [f32]))| {
                let at = Sweep { colour, which, omega, first: layer * k, row, layer };
                widest(
                    #[inline(always)]
                    || own_layer.relax(own, other, states, &at),
                )
            };
            if is_parallel {
                let each = layers.par_iter().zip(own.par_chunks_mut(PACK * layer)).enumerate();
                each.map(relax).reduce(|| 0.0, f32::max)
            } else {
                layers.iter().zip(own.chunks_mut(PACK * layer)).enumerate().map(relax).fold(0.0, f32::max)
            }
        };
        let packs = layers.iter().flat_map(|layer| &layer.packs).map(Vec::len).sum::<usize>();
        for _ in 0..params.iterations.div_ceil(SWEEPS) {
            let is_awake = |state: &&AtomicU8| state.load(Relaxed) != ASLEEP;
            let awake = || states.iter().flatten().filter(is_awake).take(PARALLEL).count();
            let is_parallel = packs >= PARALLEL && awake() == PARALLEL;
            let mut change = 0.0;
            for _ in 0..SWEEPS {
                change = f32::max(change, sweep(0, is_parallel).max(sweep(1, is_parallel)));
            }
            relaxed.sweeps += SWEEPS;
            relaxed.residual = change / lack;
            if f64::from(relaxed.residual) <= params.tolerance {
                break;
            }
        }
        relaxed
    }
}
