//! Conjugate gradients with a diagonal preconditioner, in the active cells.

use super::fields::Fields;
use crate::interaction::grid::{Bounds, GridParams};
use rayon::prelude::*;
use std::ops::Range;

/// Minimum number of layers of a task.
const GRAIN: usize = 4;

/// Compressibility of active cells, relative to the diagonal: without it the system of a pocket
/// enclosed by walls would be singular.
pub const SLACK: f32 = 3e-6;

/// Solves A P = rhs in the active cells, starting from the present pressure. Returns the number of
/// iterations, and the residual relative to the right-hand side. If the residual exceeds the
/// right-hand side, the pressure is reset to zero.
pub(super) fn solve(fields: &mut Fields, bounds: &Bounds, params: &GridParams) -> (u32, f64) {
    let (iterations, residual) = iterate(fields, bounds, params);
    if residual > 1.0 {
        fields.pressure.fill(0.0);
        return (iterations, 1.0);
    }
    (iterations, residual)
}

fn iterate(fields: &mut Fields, bounds: &Bounds, params: &GridParams) -> (u32, f64) {
    let &GridParams { iterations, tolerance, .. } = params;
    let size = multiply(fields, bounds, Factor::Pressure);
    let (mut left, mut rz) = start(fields, bounds);
    let target = tolerance * tolerance * size;
    for iteration in 0..iterations {
        if left <= target || rz <= 0.0 {
            return (iteration, (left / size).sqrt());
        }
        let curvature = multiply(fields, bounds, Factor::Direction);
        if curvature <= 0.0 {
            return (iteration, (left / size).sqrt());
        }
        let before = rz;
        (left, rz) = step(fields, bounds, (before / curvature) as f32);
        update_direction(fields, bounds, (rz / before) as f32);
    }
    (iterations, (left / size).sqrt())
}

#[derive(Clone, Copy)]
enum Factor {
    Pressure,
    Direction,
}

/// product = A x; returns x · A x for the direction, |rhs|² over the active cells for the pressure.
fn multiply(fields: &mut Fields, bounds: &Bounds, factor: Factor) -> f64 {
    let (nx, layer) = (bounds.dims[0], bounds.layer());
    let Fields { mobility: [mx, my, mz], inverse, rhs, pressure, direction, product, spans, partial, .. } =
        fields;
    let x = match factor {
        Factor::Pressure => &*pressure,
        Factor::Direction => &*direction,
    };
    let layers = product.par_chunks_mut(layer).zip(partial.par_iter_mut());
    layers.enumerate().with_min_len(GRAIN).for_each(|(k, (product, sums))| {
        *sums = [0.0; 2];
        for (here, all) in rows(spans, bounds, k) {
            let (a, b) = (all.start, all.end);
            let (out, held) = (&mut product[here], &inverse[a..b]);
            let (xl, xr) = (&mx[a..b], &mx[a + 1..b + 1]);
            let (yl, yr) = (&my[a..b], &my[a + nx..b + nx]);
            let (zl, zr) = (&mz[a..b], &mz[a + layer..b + layer]);
            let (left, mid, right) = (&x[a - 1..b - 1], &x[a..b], &x[a + 1..b + 1]);
            let (below, above) = (&x[a - nx..b - nx], &x[a + nx..b + nx]);
            let (behind, before) = (&x[a - layer..b - layer], &x[a + layer..b + layer]);
            for i in 0..out.len() {
                let flow = xl[i] * (mid[i] - left[i])
                    + xr[i] * (mid[i] - right[i])
                    + yl[i] * (mid[i] - below[i])
                    + yr[i] * (mid[i] - above[i])
                    + zl[i] * (mid[i] - behind[i])
                    + zr[i] * (mid[i] - before[i]);
                let diagonal = xl[i] + xr[i] + yl[i] + yr[i] + zl[i] + zr[i];
                out[i] = if held[i] > 0.0 { flow + SLACK * diagonal * mid[i] } else { 0.0 };
            }
            sums[0] += match factor {
                Factor::Direction => dot(mid, out),
                Factor::Pressure => {
                    let rhs = rhs[a..b].iter().zip(held).filter(|(_, held)| **held > 0.0);
                    rhs.map(|(l, _)| f64::from(l * l)).sum()
                }
            };
        }
    });
    total(partial).0
}

/// residual = rhs − product, direction = residual / diagonal; returns |residual|² and residual ·
/// direction.
fn start(fields: &mut Fields, bounds: &Bounds) -> (f64, f64) {
    let layer = bounds.layer();
    let Fields { rhs, inverse, product, residual, direction, spans, partial, .. } = fields;
    let (rhs, inverse, product) = (&*rhs, &*inverse, &*product);
    let layers =
        residual.par_chunks_mut(layer).zip(direction.par_chunks_mut(layer)).zip(partial.par_iter_mut());
    layers.enumerate().with_min_len(GRAIN).for_each(|(k, ((residual, direction), sums))| {
        *sums = [0.0; 2];
        for (here, all) in rows(spans, bounds, k) {
            let (residual, direction) = (&mut residual[here.clone()], &mut direction[here]);
            let (rhs, held, product) = (&rhs[all.clone()], &inverse[all.clone()], &product[all]);
            for i in 0..residual.len() {
                residual[i] = if held[i] > 0.0 { rhs[i] - product[i] } else { 0.0 };
                direction[i] = held[i] * residual[i];
            }
            sums[0] += dot(residual, residual);
            sums[1] += dot(residual, direction);
        }
    });
    total(partial)
}

/// pressure += α direction, residual −= α product; returns |residual|² and residual · residual /
/// diagonal.
fn step(fields: &mut Fields, bounds: &Bounds, alpha: f32) -> (f64, f64) {
    let layer = bounds.layer();
    let Fields { inverse, pressure, product, residual, direction, spans, partial, .. } = fields;
    let (inverse, product, direction) = (&*inverse, &*product, &*direction);
    let layers =
        residual.par_chunks_mut(layer).zip(pressure.par_chunks_mut(layer)).zip(partial.par_iter_mut());
    layers.enumerate().with_min_len(GRAIN).for_each(|(k, ((residual, pressure), sums))| {
        *sums = [0.0; 2];
        for (here, all) in rows(spans, bounds, k) {
            let (residual, pressure) = (&mut residual[here.clone()], &mut pressure[here]);
            let (held, product, direction) = (&inverse[all.clone()], &product[all.clone()], &direction[all]);
            for i in 0..residual.len() {
                pressure[i] += alpha * direction[i];
                residual[i] -= alpha * product[i];
            }
            sums[0] += dot(residual, residual);
            sums[1] += dot_weighted(residual, held);
        }
    });
    total(partial)
}

/// direction = residual / diagonal + β direction.
fn update_direction(fields: &mut Fields, bounds: &Bounds, beta: f32) {
    let layer = bounds.layer();
    let Fields { inverse, residual, direction, spans, .. } = fields;
    let (inverse, residual) = (&*inverse, &*residual);
    direction.par_chunks_mut(layer).enumerate().with_min_len(GRAIN).for_each(|(k, direction)| {
        for (here, all) in rows(spans, bounds, k) {
            let direction = &mut direction[here];
            let (held, residual) = (&inverse[all.clone()], &residual[all]);
            for i in 0..direction.len() {
                direction[i] = held[i] * residual[i] + beta * direction[i];
            }
        }
    });
}

/// The rows of layer `k` with active cells: their index ranges in the layer and in the box.
fn rows(spans: &[[u32; 2]], bounds: &Bounds, k: usize) -> impl Iterator<Item = (Range<usize>, Range<usize>)> {
    let ([nx, ny, _], layer) = (bounds.dims, bounds.layer());
    spans[ny * k..ny * (k + 1)].iter().enumerate().filter(|(_, [from, to])| from < to).map(
        move |(j, &[from, to])| {
            let (a, b) = (nx * j + from as usize, nx * j + to as usize);
            (a..b, layer * k + a..layer * k + b)
        },
    )
}

fn total(partial: &[[f64; 2]]) -> (f64, f64) {
    partial.iter().fold((0.0, 0.0), |(a, b), p| (a + p[0], b + p[1]))
}

/// Σ a b, in eight parallel sums.
fn dot(a: &[f32], b: &[f32]) -> f64 {
    let mut sums = [0.0f32; 8];
    let (a8, b8) = (a.chunks_exact(8), b.chunks_exact(8));
    let rest: f32 = a8.remainder().iter().zip(b8.remainder()).map(|(a, b)| a * b).sum();
    for (a, b) in a8.zip(b8) {
        for k in 0..8 {
            sums[k] += a[k] * b[k];
        }
    }
    f64::from(sums.iter().sum::<f32>() + rest)
}

/// Σ a² w, likewise.
fn dot_weighted(a: &[f32], w: &[f32]) -> f64 {
    let mut sums = [0.0f32; 8];
    let (a8, w8) = (a.chunks_exact(8), w.chunks_exact(8));
    let rest: f32 = a8.remainder().iter().zip(w8.remainder()).map(|(a, w)| a * a * w).sum();
    for (a, w) in a8.zip(w8) {
        for k in 0..8 {
            sums[k] += a[k] * a[k] * w[k];
        }
    }
    f64::from(sums.iter().sum::<f32>() + rest)
}
