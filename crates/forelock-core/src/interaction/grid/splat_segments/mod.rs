//! Particle to grid: splats mass, momentum and volume of the hair segments to the grid.
//!
//! # Theory
//! Each sample s of a segment adds its mass m_s, its momentum m_s u_s and its rest volume, with
//! trilinear weights w, to the eight nearest faces of each axis and to the eight nearest cells
//! (McAdams 2009, Sec. 4.1; Zhu and Bridson 2005). The weights sum to one, so mass and momentum are
//! conserved to rounding.
//!
//! # Practice
//! Samples are sorted by slabs of two layers. The samples of a slab touch four layers, so all even
//! slabs can be splat in parallel, then all odd ones: no two threads write to the same face, and
//! the order of summation does not depend on the number of threads.

use crate::interaction::grid::{Bounds, Grid, SLAB, Sample};
use crate::lane::Quad;
use rayon::prelude::*;

/// WGSL of the stage.
pub const WGSL: &str = include_str!("kernel.wgsl");

/// Layers touched by the samples of a slab.
const REACH: usize = SLAB + 2;

/// Adds all samples to the faces and cells of an empty grid.
pub fn splat(grid: &mut Grid) {
    let Grid { bounds, chunks, faces, filled, .. } = grid;
    let chunks = &*chunks;
    let layer = bounds.layer();
    let [x, y, z] = faces;
    for parity in 0..2 {
        // The lowest layer of a slab is the one below its first: −1 + 2 slab. Slab 0 is empty,
        // because the box has a margin.
        let first_slab = if parity == 0 { 2 } else { 1 };
        let skip = (SLAB * first_slab - 1) * layer;
        let size = REACH * layer;
        let arrays = (
            x[skip..].par_chunks_mut(size),
            y[skip..].par_chunks_mut(size),
            z[skip..].par_chunks_mut(size),
            filled[skip..].par_chunks_mut(size),
        );
        arrays.into_par_iter().enumerate().for_each(|(k, (x, y, z, filled))| {
            let slab = first_slab + 2 * k;
            if slab >= bounds.slabs() {
                return;
            }
            let mut part = Part { faces: [x, y, z], filled, base: (SLAB * slab - 1) * layer, bounds };
            for sample in chunks.iter().flat_map(|chunk| chunk.slab(slab)) {
                part.add(sample);
            }
        });
    }
}

/// The layers of a slab; the index of their first cell is `base`.
struct Part<'a> {
    faces: [&'a mut [[f32; 2]]; 3],
    filled: &'a mut [f32],
    base: usize,
    bounds: &'a Bounds,
}

impl Part<'_> {
    #[inline]
    fn add(&mut self, sample: &Sample) {
        let stencils = stencils(sample.at);
        self.add_face::<0>(&stencils, sample);
        self.add_face::<1>(&stencils, sample);
        self.add_face::<2>(&stencils, sample);
        let Corner { first, fraction: [fx, fy, fz], strides } = stencils.cell(self.bounds);
        let first = first - self.base;
        let cells = &mut self.filled[first..first + strides[1] + strides[0] + 2];
        let room = [sample.room * (1.0 - fx), sample.room * fx];
        for (from, w) in weights(fy, fz, strides) {
            cells[from] += w * room[0];
            cells[from + 1] += w * room[1];
        }
    }

    #[inline(always)]
    fn add_face<const AXIS: usize>(&mut self, stencils: &Stencils, sample: &Sample) {
        let Corner { first, fraction: [fx, fy, fz], strides } = stencils.face::<AXIS>(self.bounds);
        let first = first - self.base;
        let faces = &mut self.faces[AXIS][first..first + strides[1] + strides[0] + 2];
        let momentum = sample.mass * sample.velocity[AXIS];
        let (low, high) = (1.0 - fx, fx);
        let share = Quad::new([sample.mass * low, momentum * low, sample.mass * high, momentum * high]);
        for (from, w) in weights(fy, fz, strides) {
            let pair: &mut [[f32; 2]; 2] = &mut bytemuck::cast_slice_mut(&mut faces[from..from + 2])[0];
            (Quad::load(pair) + Quad::splat(w) * share).store(pair);
        }
    }
}

/// Offsets of the four pairs of entries of a stencil, and their weights.
#[inline(always)]
pub(crate) fn weights(fy: f32, fz: f32, [row, layer]: [usize; 2]) -> [(usize, f32); 4] {
    let (gy, gz) = (1.0 - fy, 1.0 - fz);
    [(0, gy * gz), (row, fy * gz), (layer, gy * fz), (layer + row, fy * fz)]
}

/// The cells around a point: the cell that holds it (`whole`), the cell whose centre is below it
/// (`half`), and its distances from the lower side and from the centre, respectively. A face lies
/// at whole cells along the axis it belongs to and at half cells along the others; cell centres lie
/// at half cells along all axes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stencils {
    whole: [usize; 3],
    beyond_whole: [f32; 3],
    half: [usize; 3],
    beyond_half: [f32; 3],
}

/// The stencils at `at`, which lies in the box: coordinates are positive, so a cast is the floor.
#[inline(always)]
pub(crate) fn stencils(at: [f32; 3]) -> Stencils {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few thousand at most")]
    let cut = |x: f32| x as i32 as usize;
    let whole = [cut(at[0]), cut(at[1]), cut(at[2])];
    let shifted = [at[0] - 0.5, at[1] - 0.5, at[2] - 0.5];
    let half = [cut(shifted[0]), cut(shifted[1]), cut(shifted[2])];
    let beyond = |x: [f32; 3], low: [usize; 3]| {
        [x[0] - low[0] as i32 as f32, x[1] - low[1] as i32 as f32, x[2] - low[2] as i32 as f32]
    };
    Stencils { whole, beyond_whole: beyond(at, whole), half, beyond_half: beyond(shifted, half) }
}

/// A trilinear stencil of eight entries: the index of the first, the fraction along each axis, and
/// the strides of rows and layers.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Corner {
    pub first: usize,
    pub fraction: [f32; 3],
    pub strides: [usize; 2],
}

impl Stencils {
    #[inline(always)]
    pub(crate) fn face<const AXIS: usize>(&self, bounds: &Bounds) -> Corner {
        let (mut low, mut beyond) = (self.half, self.beyond_half);
        low[AXIS] = self.whole[AXIS];
        beyond[AXIS] = self.beyond_whole[AXIS];
        corner(low, beyond, bounds)
    }

    /// The cell that holds the point.
    #[inline(always)]
    pub(crate) fn cell_of(&self) -> [usize; 3] {
        self.whole
    }

    #[inline(always)]
    fn cell(&self, bounds: &Bounds) -> Corner {
        corner(self.half, self.beyond_half, bounds)
    }
}

#[inline(always)]
fn corner(low: [usize; 3], beyond: [f32; 3], bounds: &Bounds) -> Corner {
    let (row, layer) = (bounds.dims[0], bounds.layer());
    Corner { first: low[0] + row * low[1] + layer * low[2], fraction: beyond, strides: [row, layer] }
}

/// Trilinear interpolation of a field of cells at `at`.
pub(crate) fn interpolate(cells: &[f32], bounds: &Bounds, at: [f32; 3]) -> f32 {
    let Corner { first, fraction: [fx, fy, fz], strides } = stencils(at).cell(bounds);
    weights(fy, fz, strides)
        .into_iter()
        .map(|(from, w)| w * (cells[first + from] + fx * (cells[first + from + 1] - cells[first + from])))
        .sum()
}
