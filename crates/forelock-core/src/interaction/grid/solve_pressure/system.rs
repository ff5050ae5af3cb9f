//! The equations of the pressure, from the fields.

use super::fields::{Fields, LOOSE, filled, strip};
use super::relax::{Equations, Layer, SLACK};
use crate::interaction::grid::{Bounds, GridSolid, STRIP};
use crate::lane::widest;
use rayon::prelude::*;

/// What the equations need to know of the frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Terms {
    /// Mass at most which a face is closed.
    pub least: f32,
    /// Side of a cell, metres, and over the length of the frame, m/s.
    pub cell: f32,
    pub slack: f32,
    /// Fraction of an excess volume that expands in the frame.
    pub expansion: f32,
}

impl Terms {
    /// Right-hand sides for velocities and for displacements of a cell.
    #[inline(always)]
    fn right_hand_sides(&self, density: f32, divergence: f32) -> [f32; 2] {
        let excess = (density - 1.0) / density;
        let shift = if excess > 0.0 { self.expansion * excess } else { excess };
        [self.slack * excess.min(0.0) - divergence, self.cell * shift]
    }
}

/// The fields that equations are made of.
struct Sources<'a> {
    bounds: &'a Bounds,
    strides: [usize; 3],
    masses: &'a [f32],
    momentum: [&'a [f32]; 3],
    densities: &'a [f32],
    walls: &'a [u16],
    solids: &'a [GridSolid],
    terms: Terms,
}

impl Fields {
    /// Sets up the equations of both pressures. Returns the density of the densest cell.
    pub(super) fn build_system(&mut self, bounds: &Bounds, terms: Terms) -> f64 {
        let Self { masses, momentum, densities, walls, solids, strips, system, partial, .. } = self;
        let sources = Sources {
            bounds,
            strides: bounds.strides(),
            masses,
            momentum: momentum.each_ref().map(Vec::as_slice),
            densities,
            walls,
            solids,
            terms,
        };
        let (strips, per_layer) = (&*strips, bounds.layer_strips());
        let layers = system.fit(bounds).par_iter_mut().zip(partial.par_iter_mut()).enumerate();
        layers.for_each(|(k, (layer, densest))| {
            *densest = 0.0;
            for number in filled(&strips[per_layer * k..per_layer * (k + 1)]) {
                let most = widest(
                    #[inline(always)]
                    || sources.add_strip(layer, k, number),
                );
                *densest = densest.max(most);
            }
        });
        partial.iter().copied().fold(0.0, f32::max).into()
    }
}

impl Sources<'_> {
    /// Adds the equations of a strip of layer `k`. Returns the density of its densest cell.
    #[inline(always)]
    fn add_strip(&self, layer: &mut Layer, k: usize, number: usize) -> f32 {
        let index = STRIP * (self.bounds.layer_strips() * k + number);
        let densities = strip(self.densities, index);
        let densest = densities.iter().copied().fold(0.0, f32::max);
        if densest >= LOOSE {
            layer.add(number, (number / self.bounds.strips() + k) & 1, &self.equations(index));
        }
        densest
    }

    #[inline(always)]
    fn equations(&self, index: usize) -> Equations {
        let (mass, density) = (strip(self.masses, index), strip(self.densities, index));
        let mut out = Equations { sides: [[0.0; STRIP]; 6], diagonal: [0.0; STRIP], rhs: [[0.0; STRIP]; 2] };
        let mut divergence = [0.0; STRIP];
        let mut beside_wall = false;
        for side in 0..6 {
            let (stride, sign) = (self.strides[side / 2], if side & 1 == 0 { -1.0 } else { 1.0 });
            let beyond = if side & 1 == 0 { index - stride } else { index + stride };
            let other = strip(self.masses, beyond);
            let field = self.momentum[side / 2];
            let momentum = [strip(field, index), strip(field, beyond)];
            for n in 0..STRIP {
                let sum = mass[n] + other[n];
                let is_wall = (mass[n] < 0.0) | (other[n] < 0.0);
                beside_wall |= is_wall;
                let inverse = 1.0 / sum;
                let velocity = (momentum[0][n] + momentum[1][n]) * inverse;
                // Closed if there is almost no hair.
                let is_open = !is_wall & (0.5 * sum > self.terms.least);
                out.sides[side][n] = if is_open { 2.0 * inverse } else { 0.0 };
                divergence[n] += if is_wall | (sum <= 0.0) { 0.0 } else { sign * velocity };
            }
        }
        if beside_wall {
            self.add_walls(index, &mut divergence);
        }
        for n in 0..STRIP {
            let [mut velocity, mut shift] = self.terms.right_hand_sides(density[n], divergence[n]);
            let sum = out.sides.iter().fold(0.0, |sum, side| sum + side[n]) * (1.0 + SLACK);
            let takes = (density[n] >= LOOSE) & (mass[n] > 0.0) & (sum > 0.0);
            if !takes {
                (velocity, shift) = (0.0, 0.0);
            }
            out.diagonal[n] = if takes { sum } else { 0.0 };
            out.rhs[0][n] = velocity;
            out.rhs[1][n] = shift;
        }
        out
    }

    /// Adds the velocities of walls at the faces of the cells with hair from `index` on.
    #[inline(never)]
    fn add_walls(&self, index: usize, divergence: &mut [f32; STRIP]) {
        let [_, row, layer] = self.strides;
        for (n, divergence) in divergence.iter_mut().enumerate() {
            let here = index + n;
            if self.masses[here] <= 0.0 {
                continue;
            }
            let middle = [here % row, here % layer / row, here / layer].map(|i| i as f32 + 0.5);
            for side in 0..6 {
                let (axis, sign) = (side / 2, if side & 1 == 0 { -1.0 } else { 1.0 });
                let beyond =
                    if side & 1 == 0 { here - self.strides[axis] } else { here + self.strides[axis] };
                if self.masses[beyond] < 0.0 {
                    let mut at = middle;
                    at[axis] += 0.5 * sign;
                    let wall = &self.solids[usize::from(self.walls[beyond]) - 1];
                    *divergence += sign * wall.velocity(axis, at);
                }
            }
        }
    }
}
