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
//! z have the same index in the other colour. Packs without hair are left out. A pack whose
//! right-hand sides are not positive keeps zero pressure until a neighbour is under pressure, so a
//! sweep only visits packs that have been woken by one.

use crate::interaction::grid::{Bounds, GridParams};
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
pub(super) const PACK: usize = 8;
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

/// Eight cells of one colour of a row. Cells that take no pressure have zero coefficients.
#[derive(Clone, Copy, Debug, Default)]
#[repr(C, align(64))]
pub(super) struct Pack {
    /// Mobilities of the faces below and above along x, y and z, over the diagonal.
    sides: [[f32; PACK]; 6],
    /// Right-hand sides for velocities and for displacements over the diagonal.
    rhs: [[f32; PACK]; 2],
    /// The diagonal of the matrix; 0 if the cell takes no pressure.
    pub diagonal: [f32; PACK],
    /// Index of the first cell among the cells of its colour in the layer.
    first: u32,
    /// 1 if the first cell lies at an odd place of its row, otherwise 0.
    odd: u32,
}

/// The packs of a layer, by colour.
#[derive(Debug, Default)]
pub(super) struct Layer {
    packs: [Vec<Pack>; 2],
}

/// The system and its pressures.
#[derive(Debug, Default)]
pub(crate) struct System {
    layers: Vec<Layer>,
    /// Pressures of the cells of each colour, `[z][y][half]`.
    pressure: [Vec<f32>; 2],
    /// State of the pack at each place of each colour.
    states: [Vec<AtomicU8>; 2],
    /// Cells of one colour in a row.
    half: usize,
}

/// The result of a solve.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Convergence {
    pub sweeps: u32,
    /// Largest change in the last sweeps over the largest right-hand side.
    pub residual: f32,
}

impl System {
    pub fn bytes(&self) -> usize {
        let packs: usize = self.layers.iter().flat_map(|layer| &layer.packs).map(Vec::capacity).sum();
        packs * size_of::<Pack>()
            + 4 * self.pressure.iter().map(Vec::capacity).sum::<usize>()
            + self.states.iter().map(Vec::capacity).sum::<usize>()
    }
}

/// The equation of a cell, before it is divided by the diagonal.
#[derive(Clone, Copy, Debug)]
pub(super) struct Equation {
    /// Mobilities of the faces below and above along x, y and z.
    pub sides: [f32; 6],
    /// Right-hand sides for velocities and for displacements.
    pub rhs: [f32; 2],
}

impl Layer {
    /// Sets up the packs of a layer of `bounds` from the `equation` of the cell at each index of
    /// the layer. `rows` are the cells of each row that can have one.
    pub fn build(
        &mut self,
        bounds: &Bounds,
        k: usize,
        half: usize,
        rows: &[[u32; 2]],
        equation: &mut impl FnMut(usize) -> Option<Equation>,
    ) {
        self.packs.iter_mut().for_each(Vec::clear);
        let nx = bounds.dims[0];
        for (j, &[from, to]) in rows.iter().enumerate() {
            let [from, to] = [from as usize, to as usize];
            // Open packs of both colours.
            let mut open: [Option<Pack>; 2] = [None; 2];
            for i in from.max(1)..to.min(nx - 1) {
                let Some(equation) = equation(nx * j + i) else { continue };
                let colour = (i + j + k) & 1;
                let (place, odd) = (i / 2, i & 1);
                let first = half * j + place / PACK * PACK;
                let pack = &mut open[colour];
                if pack.as_ref().is_none_or(|pack| pack.first as usize != first) {
                    self.packs[colour].extend(pack.take());
                    #[expect(clippy::cast_possible_truncation, reason = "a layer has fewer cells")]
                    let new = Pack { first: first as u32, odd: odd as u32, ..Pack::default() };
                    *pack = Some(new);
                }
                if let Some(pack) = pack {
                    pack.put(place % PACK, &equation);
                }
            }
            for (packs, pack) in self.packs.iter_mut().zip(open) {
                packs.extend(pack);
            }
        }
    }

    /// One colour of a sweep. `own` are the pressures of the layer in this colour, `other` those of
    /// the box in the other, `states` those of the packs of both. Returns the largest change times
    /// the diagonal.
    #[inline(always)]
    fn relax(&self, own: &mut [f32], other: &[f32], states: [&[AtomicU8]; 2], at: &Sweep) -> f32 {
        let mut largest = [0.0f32; PACK];
        for pack in &self.packs[at.colour] {
            let first = pack.first as usize;
            let here = at.start + first;
            let state = states[0][here / PACK].load(Relaxed);
            if state == ASLEEP {
                continue;
            }
            let beside = |index: usize| -> &[f32; PACK] {
                other[index..index + PACK].try_into().unwrap_or(&[0.0; PACK])
            };
            let along_x = here + pack.odd as usize;
            let near = [
                beside(along_x - 1),
                beside(along_x),
                beside(here - at.half),
                beside(here + at.half),
                beside(here - at.layer),
                beside(here + at.layer),
            ];
            let own = &mut own[first..first + PACK];
            let old: [f32; PACK] = (&*own).try_into().unwrap_or([0.0; PACK]);
            let rhs = &pack.rhs[at.which];
            let mut next = [0.0; PACK];
            for n in 0..PACK {
                let below = pack.sides[0][n] * near[0][n]
                    + pack.sides[2][n] * near[2][n]
                    + pack.sides[4][n] * near[4][n];
                let above = pack.sides[1][n] * near[1][n]
                    + pack.sides[3][n] * near[3][n]
                    + pack.sides[5][n] * near[5][n];
                next[n] = (old[n] + at.omega * (rhs[n] + (below + above) - old[n])).max(0.0);
            }
            for n in 0..PACK {
                largest[n] = largest[n].max((next[n] - old[n]).abs() * pack.diagonal[n]);
            }
            own.copy_from_slice(&next);
            if state == AWAKE && next.iter().any(|pressure| *pressure > 0.0) {
                states[0][here / PACK].store(SPREAD, Relaxed);
                let place = here / PACK;
                let [row, layer] = [at.half / PACK, at.layer / PACK];
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
    /// Where the layer begins among the pressures of a colour.
    start: usize,
    /// Cells of one colour in a row and in a layer.
    half: usize,
    layer: usize,
}

impl Pack {
    fn put(&mut self, n: usize, equation: &Equation) {
        let diagonal = equation.sides.iter().sum::<f32>() * (1.0 + SLACK);
        if diagonal <= 0.0 {
            return;
        }
        let inverse = 1.0 / diagonal;
        for (side, mobility) in self.sides.iter_mut().zip(equation.sides) {
            side[n] = mobility * inverse;
        }
        self.rhs[0][n] = equation.rhs[0] * inverse;
        self.rhs[1][n] = equation.rhs[1] * inverse;
        self.diagonal[n] = diagonal;
    }
}

impl System {
    /// Fits the system to the box. `build` sets up layer k with the given number of cells of one
    /// colour in a row.
    /// What it returns goes to `results`, one for each layer.
    pub fn fit(
        &mut self,
        bounds: &Bounds,
        results: &mut [f32],
        build: &(impl Fn(usize, usize, &mut Layer) -> f32 + Sync),
    ) {
        let [nx, ny, nz] = bounds.dims;
        self.half = nx.div_ceil(2).next_multiple_of(PACK);
        let half = self.half;
        if self.layers.len() < nz {
            self.layers.resize_with(nz, Layer::default);
        }
        for layer in &mut self.layers[nz..] {
            layer.packs.iter_mut().for_each(Vec::clear);
        }
        for pressure in &mut self.pressure {
            crate::scratch::resize(pressure, half * ny * nz, 0.0);
        }
        for states in &mut self.states {
            states.resize_with(half / PACK * ny * nz, AtomicU8::default);
        }
        let each = self.layers[..nz].par_iter_mut().zip(results).enumerate();
        // Room for all packs of a layer, so that only a larger box allocates.
        let most = half / PACK * ny;
        each.for_each(|(k, (layer, result))| {
            for packs in &mut layer.packs {
                packs.clear();
                packs.reserve(most);
            }
            *result = build(k, half, layer);
        });
    }

    /// Solves for the pressure of velocities (`which` 0) or displacements (1), from zero.
    pub fn solve(&mut self, bounds: &Bounds, params: &GridParams, which: usize) -> Convergence {
        let Self { layers, pressure: [red, black], states, half } = self;
        red.fill(0.0);
        black.fill(0.0);
        for state in states.iter_mut().flatten() {
            *state.get_mut() = ASLEEP;
        }
        let (half, size) = (*half, *half * bounds.dims[1]);
        let layers = &layers[..bounds.dims[2]];
        let mut lack = 0.0f32;
        for (k, layer) in layers.iter().enumerate() {
            for (packs, states) in layer.packs.iter().zip(&mut *states) {
                for pack in packs {
                    let given = pack.rhs[which].iter().zip(&pack.diagonal).map(|(rhs, d)| rhs * d);
                    let most = given.fold(0.0, f32::max);
                    if most > 0.0 {
                        *states[(size * k + pack.first as usize) / PACK].get_mut() = AWAKE;
                        lack = lack.max(most);
                    }
                }
            }
        }
        let mut relaxed = Convergence::default();
        if lack <= 0.0 {
            return relaxed;
        }
        let omega = relaxation(params.resolution);
        let states = &*states;
        let mut sweep = |colour: usize, is_parallel: bool| -> f32 {
            let (own, other) = if colour == 0 { (&mut *red, &*black) } else { (&mut *black, &*red) };
            let states = [&states[colour][..], &states[1 - colour][..]];
            let relax = |(k, (layer, own)): (usize, (&Layer, &mut [f32]))| {
                let at = Sweep { colour, which, omega, start: size * k, half, layer: size };
                widest(
                    #[inline(always)]
                    || layer.relax(own, other, states, &at),
                )
            };
            if is_parallel {
                let each = layers.par_iter().zip(own.par_chunks_mut(size)).enumerate();
                each.map(relax).reduce(|| 0.0, f32::max)
            } else {
                layers.iter().zip(own.chunks_mut(size)).enumerate().map(relax).fold(0.0, f32::max)
            }
        };
        for _ in 0..params.iterations.div_ceil(SWEEPS) {
            let is_awake = |state: &&AtomicU8| state.load(Relaxed) != ASLEEP;
            let is_parallel = states.iter().flatten().filter(is_awake).take(PARALLEL).count() == PARALLEL;
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

    /// Calls `f` with the index of each cell under pressure and its pressure.
    pub fn pressures(&self, bounds: &Bounds, mut f: impl FnMut(usize, f32)) {
        self.visit(bounds, true, |cell, _, pressure| {
            if pressure > 0.0 {
                f(cell, pressure);
            }
        });
    }

    /// Calls `f` with the index of each cell that can be under pressure and its right-hand side for
    /// velocities.
    #[cfg(test)]
    pub fn right_hand_sides(&self, bounds: &Bounds, mut f: impl FnMut(usize, f32)) {
        self.visit(bounds, false, |cell, rhs, _| f(cell, rhs));
    }

    /// Calls `f` with the index of each cell, its right-hand side for velocities and its pressure.
    fn visit(&self, bounds: &Bounds, only_pressed: bool, mut f: impl FnMut(usize, f32, f32)) {
        let [nx, ny, _] = bounds.dims;
        for (k, layer) in self.layers[..bounds.dims[2]].iter().enumerate() {
            for ((packs, pressure), states) in layer.packs.iter().zip(&self.pressure).zip(&self.states) {
                for pack in packs {
                    let first = pack.first as usize;
                    let start = self.half * ny * k + first;
                    if only_pressed && states[start / PACK].load(Relaxed) != SPREAD {
                        continue;
                    }
                    let (j, place) = (first / self.half, first % self.half);
                    for n in (0..PACK).filter(|&n| pack.diagonal[n] > 0.0) {
                        let cell = nx * (j + ny * k) + 2 * (place + n) + pack.odd as usize;
                        let rhs = pack.rhs[0][n] * pack.diagonal[n];
                        f(cell, rhs, pressure[start + n]);
                    }
                }
            }
        }
    }
}
