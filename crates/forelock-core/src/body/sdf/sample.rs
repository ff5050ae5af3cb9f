//! Sampling of a distance field at one point (the specification) and at a packet of points.
//!
//! # Practice
//! A packet of 8 takes 12 ns per point with AVX2, a single point 29 ns (long hair around a head,
//! 128 nodes). Each step is a loop over lanes, so that the compiler vectorises everything except
//! the eight loads wherever the function is inlined into a function with target features. Fused
//! multiply-add is not used: the results of a lane and of a single point are bit-identical.

use glam::Vec3;

use super::Sdf;
use super::bricks::{BRICK_LAYER, BRICK_ROW, NONE, REFINEMENT};

/// 2²³: adding it to a float from 0 to 2²² rounds the float to an integer, which is then in the
/// mantissa.
const INTEGER: f32 = 8_388_608.0;
/// A gradient whose squared length is below this is treated as zero.
const FLAT: f32 = 1e-12;
/// Number of the last cell of a brick along an axis.
const LAST_IN_BRICK: f32 = (REFINEMENT - 1) as f32;

/// How far outwards from a point the cells are whose nodes bound its distance from below, in cells
/// near the surface.
const BOUND_CELLS: [f32; 3] = [1.5, 0.0, 3.0];

/// Where a sample is taken.
struct Place {
    /// From the nearest point of the grid's box to the point, in cells.
    away: Vec3,
    /// The cell's first value, and the values from one row to the next and from one layer to the
    /// next.
    first: usize,
    row: usize,
    layer: usize,
    /// The position in the cell, 0 to 1.
    f: Vec3,
    /// Such cells per metre.
    inv_cell: f32,
}

impl Sdf {
    /// The signed distance in metres at `p` and its gradient. The gradient is not of unit length,
    /// but never zero: where the interpolant is flat, it is +y.
    ///
    /// Outside the grid the distance is a positive lower bound.
    #[inline]
    pub fn sample(&self, p: Vec3) -> (f32, Vec3) {
        let Place { away, first, row, layer, f, inv_cell } = self.place(p);
        let block = &self.values[first..first + layer + row + 2];
        let pair = |at: usize| {
            let slope = block[at + 1] - block[at];
            (block[at] + slope * f.x, slope)
        };
        let ((v00, d00), (v10, d10)) = (pair(0), pair(row));
        let ((v01, d01), (v11, d11)) = (pair(layer), pair(layer + row));
        let (e0, e1) = (v10 - v00, v11 - v01);
        let (v0, v1) = (v00 + e0 * f.y, v01 + e1 * f.y);
        let (d0, d1) = (d00 + (d10 - d00) * f.y, d01 + (d11 - d01) * f.y);
        let value = v0 + (v1 - v0) * f.z;
        let slope = Vec3::new(d0 + (d1 - d0) * f.z, e0 + (e1 - e0) * f.z, v1 - v0) * inv_cell;
        let slope = if slope.length_squared() > FLAT { slope } else { Vec3::Y };
        if away == Vec3::ZERO { (value, slope) } else { self.beyond(away * self.cell, value, slope) }
    }

    /// Where the sample at `p` is taken.
    #[inline(always)]
    fn place(&self, p: Vec3) -> Place {
        let at = (p - self.origin) * self.inv_cell;
        let inside = at.clamp(Vec3::ZERO, self.top);
        // Subtracting half a cell and rounding gives the cell's first node without the slow
        // saturating conversion. On a node both adjacent cells give the same value.
        let low = (inside - 0.5).clamp(Vec3::ZERO, self.top - 1.0) + INTEGER;
        let [i, j, k] = low.to_array().map(|c| mantissa(c) as usize);
        let mut f = inside - (low - INTEGER);
        let (mut row, mut layer) = (self.dims.x as usize, self.layer as usize);
        let (mut first, mut inv_cell) = (i + row * j + layer * k, self.inv_cell);
        if let Some(start) = self.bricks.start(first) {
            let within = f * REFINEMENT as f32;
            let low = (within - 0.5).clamp(Vec3::ZERO, Vec3::splat(LAST_IN_BRICK)) + INTEGER;
            let [i, j, k] = low.to_array().map(|c| mantissa(c) as usize);
            f = within - (low - INTEGER);
            (row, layer) = (BRICK_ROW as usize, BRICK_LAYER as usize);
            (first, inv_cell) = (start + i + row * j + layer * k, inv_cell * REFINEMENT as f32);
        }
        Place { away: at - inside, first, row, layer, f, inv_cell }
    }

    /// The sample at `away` from the nearest point of the grid's box, from the value and gradient
    /// at that point.
    #[cold]
    fn beyond(&self, away: Vec3, value: f32, slope: Vec3) -> (f32, Vec3) {
        let distance = (away.length_squared() + value * value).sqrt();
        let along = Vec3::select(away.cmpeq(Vec3::ZERO), slope * value.max(0.0), Vec3::ZERO);
        (distance, (away + along) / distance)
    }

    /// [`Sdf::sample`] if the distance may be at most `reach` metres; `None` if it is certainly
    /// greater. The decision takes one read of a small table; for long hair at rest on a head, four
    /// particles in five need nothing more.
    #[inline]
    pub fn sample_near(&self, p: Vec3, reach: f32) -> Option<(f32, Vec3)> {
        let [least] = self.least_lanes(p.to_array().map(|c| [c]));
        if least > reach { None } else { Some(self.sample(p)) }
    }

    /// A lower bound in metres of the exact distance at `p`, if the values at the nodes are exact:
    /// the distance at a node, less the distance from that node. The nodes are those of the cell of
    /// `p` and of cells outwards from it. Over a smooth surface, the farther a node is in that
    /// direction, the nearer its bound is to the distance, much nearer than a sample less
    /// [`Sdf::error_bound`]. The search ends with the first bound above 0.
    pub fn lower_bound(&self, p: Vec3) -> f32 {
        self.lower_bound_along(p, self.sample(p).1)
    }

    /// [`Sdf::lower_bound`] at a point where the field's gradient is `slope`.
    pub(in crate::body) fn lower_bound_along(&self, p: Vec3, slope: Vec3) -> f32 {
        let outwards = slope.normalize_or_zero() * self.near_cell();
        let mut bound = f32::NEG_INFINITY;
        for cells in BOUND_CELLS {
            if let Some(found) = self.bound_from_cell(p + outwards * cells, p) {
                bound = bound.max(found);
            }
            if bound > 0.0 {
                return bound;
            }
        }
        // All of these cells are outside the grid only where the point is.
        if bound == f32::NEG_INFINITY { self.sample(p).0 } else { bound }
    }

    /// The best lower bound of the distance at `p` from the corners of the cell of `q`; `None` if
    /// `q` is outside the grid.
    fn bound_from_cell(&self, q: Vec3, p: Vec3) -> Option<f32> {
        let Place { away, first, row, layer, f, inv_cell } = self.place(q);
        if away != Vec3::ZERO {
            return None;
        }
        let corners = [0, 1, row, row + 1, layer, layer + 1, layer + row, layer + row + 1];
        let bounds = corners.into_iter().zip(0u8..).map(|(at, corner)| {
            let node = Vec3::new((corner & 1).into(), (corner >> 1 & 1).into(), (corner >> 2).into());
            self.values[first + at] - ((f - node) / inv_cell + (p - q)).length()
        });
        Some(bounds.fold(f32::NEG_INFINITY, f32::max))
    }

    /// [`Sdf::sample`] at `W` points, component-major: distances in metres and gradients.
    #[inline(always)]
    pub fn sample_lanes<const W: usize>(&self, p: [[f32; W]; 3]) -> ([f32; W], [[f32; W]; 3]) {
        let (mut first, mut away, mut f) = ([0u32; W], [[0.0; W]; 3], [[0.0; W]; 3]);
        let strides = [1, self.dims.x, self.layer];
        let mut outside = false;
        for axis in 0..3 {
            let (origin, top) = (self.origin[axis], self.top[axis]);
            for lane in 0..W {
                let at = (p[axis][lane] - origin) * self.inv_cell;
                let inside = clamp(at, top);
                // Subtracting half a cell and rounding gives the cell's first node. On a node both
                // adjacent cells give the same value.
                let low = clamp(inside - 0.5, top - 1.0) + INTEGER;
                first[lane] += mantissa(low) * strides[axis];
                f[axis][lane] = inside - (low - INTEGER);
                away[axis][lane] = (at - inside) * self.cell;
                outside |= at != inside;
            }
        }
        let mut inv_cell = [self.inv_cell; W];
        let starts = if self.bricks.is_empty() {
            [NONE; W]
        } else {
            first.map(|cell| self.bricks.start_or_none(cell))
        };
        let in_bricks = starts.iter().filter(|start| **start != NONE).count();
        // Most packets are on one level.
        let corners = if in_bricks == 0 {
            self.corners(first, [self.dims.x; W], [self.layer; W])
        } else if in_bricks == W {
            (first, f) = in_brick(starts, &f);
            inv_cell = inv_cell.map(|inverse| inverse * REFINEMENT as f32);
            self.corners(first, [BRICK_ROW; W], [BRICK_LAYER; W])
        } else {
            let (at, within) = in_brick(starts, &f);
            let (mut rows, mut layers) = ([self.dims.x; W], [self.layer; W]);
            for lane in 0..W {
                if starts[lane] != NONE {
                    (first[lane], rows[lane], layers[lane]) = (at[lane], BRICK_ROW, BRICK_LAYER);
                    inv_cell[lane] *= REFINEMENT as f32;
                    for axis in 0..3 {
                        f[axis][lane] = within[axis][lane];
                    }
                }
            }
            self.corners(first, rows, layers)
        };
        let (mut value, mut slope) = ([0.0; W], [[0.0; W]; 3]);
        for lane in 0..W {
            let [x, y, z] = [f[0][lane], f[1][lane], f[2][lane]];
            let v = |corner: usize| corners[corner][lane];
            // Interpolation along x on the four rows, then along y on the two layers, then along z.
            let (a, b, c, d) = (v(1) - v(0), v(3) - v(2), v(5) - v(4), v(7) - v(6));
            let (v0, v1) = (v(0) + a * x, v(2) + b * x);
            let (v2, v3) = (v(4) + c * x, v(6) + d * x);
            let dy = [v1 - v0, v3 - v2];
            let on_layer = [v0 + dy[0] * y, v2 + dy[1] * y];
            let dx = [a + (b - a) * y, c + (d - c) * y];
            value[lane] = on_layer[0] + (on_layer[1] - on_layer[0]) * z;
            let g = [
                (dx[0] + (dx[1] - dx[0]) * z) * inv_cell[lane],
                (dy[0] + (dy[1] - dy[0]) * z) * inv_cell[lane],
                (on_layer[1] - on_layer[0]) * inv_cell[lane],
            ];
            let steep = g[0] * g[0] + g[1] * g[1] + g[2] * g[2] > FLAT;
            slope[0][lane] = if steep { g[0] } else { 0.0 };
            slope[1][lane] = if steep { g[1] } else { 1.0 };
            slope[2][lane] = if steep { g[2] } else { 0.0 };
        }
        if outside {
            beyond(&away, &mut value, &mut slope);
        }
        (value, slope)
    }

    /// Lower bounds in metres of the distances at `W` points, from one read of a small table for
    /// each: the smallest value of the block of cells that contains the point, or of the nearest
    /// block.
    #[inline(always)]
    pub fn least_lanes<const W: usize>(&self, p: [[f32; W]; 3]) -> [f32; W] {
        let strides = [1, self.blocks[0], self.blocks[0] * self.blocks[1]];
        let (per_block, mut at) = (self.per_block, [0u32; W]);
        for axis in 0..3 {
            let (origin, top, stride) = (self.origin[axis], self.top_block[axis], strides[axis]);
            // Two loops, which the compiler vectorises; it does not vectorise one of both.
            let mut low = [0.0; W];
            for lane in 0..W {
                low[lane] = clamp((p[axis][lane] - origin) * per_block - 0.5, top) + INTEGER;
            }
            for (at, low) in at.iter_mut().zip(&low) {
                *at += mantissa(*low) * stride;
            }
        }
        at.map(|block| self.least[block as usize])
    }

    /// The eight values of the cells whose first nodes are `first`, from rows and layers that lie
    /// `rows` and `layers` values apart; x fastest, then y, then z.
    #[inline(always)]
    fn corners<const W: usize>(&self, first: [u32; W], rows: [u32; W], layers: [u32; W]) -> [[f32; W]; 8] {
        let mut corners = [[0.0; W]; 8];
        for lane in 0..W {
            let (first, row, layer) = (first[lane] as usize, rows[lane] as usize, layers[lane] as usize);
            let block = &self.values[first..first + layer + row + 2];
            corners[0][lane] = block[0];
            corners[1][lane] = block[1];
            corners[2][lane] = block[row];
            corners[3][lane] = block[row + 1];
            corners[4][lane] = block[layer];
            corners[5][lane] = block[layer + 1];
            corners[6][lane] = block[layer + row];
            corners[7][lane] = block[layer + row + 1];
        }
        corners
    }
}

/// For positions `f` in cells whose bricks begin at `starts`: the first nodes of their cells in the
/// bricks, and the positions in those.
#[inline(always)]
fn in_brick<const W: usize>(starts: [u32; W], f: &[[f32; W]; 3]) -> ([u32; W], [[f32; W]; 3]) {
    let (mut at, mut within) = (starts, [[0.0; W]; 3]);
    for (axis, stride) in [1, BRICK_ROW, BRICK_LAYER].into_iter().enumerate() {
        for lane in 0..W {
            let place = f[axis][lane] * REFINEMENT as f32;
            let low = clamp(place - 0.5, LAST_IN_BRICK) + INTEGER;
            at[lane] += mantissa(low) * stride;
            within[axis][lane] = place - (low - INTEGER);
        }
    }
    (at, within)
}

/// Converts values and gradients at the nearest points of the grid's box to those of points `away`
/// from it.
#[inline(always)]
fn beyond<const W: usize>(away: &[[f32; W]; 3], value: &mut [f32; W], slope: &mut [[f32; W]; 3]) {
    for lane in 0..W {
        let [x, y, z] = [away[0][lane], away[1][lane], away[2][lane]];
        let squared = x * x + y * y + z * z;
        if squared == 0.0 {
            continue;
        }
        let near = value[lane];
        let distance = (squared + near * near).sqrt();
        value[lane] = distance;
        for axis in 0..3 {
            let along = if away[axis][lane] == 0.0 { slope[axis][lane] * near.max(0.0) } else { 0.0 };
            slope[axis][lane] = (away[axis][lane] + along) / distance;
        }
    }
}

/// Clamps `value` to 0..=`high`; NaN gives 0.
#[inline(always)]
fn clamp(value: f32, high: f32) -> f32 {
    let value = if value > 0.0 { value } else { 0.0 };
    if value < high { value } else { high }
}

/// The integer in the mantissa of a float to which [`INTEGER`] was added.
#[inline(always)]
fn mantissa(value: f32) -> u32 {
    value.to_bits() & 0x007f_ffff
}

#[cfg(test)]
mod tests {
    use super::super::super::ClosedMesh;
    use super::super::super::shapes_for_tests::{lattice, uv_sphere};
    use glam::UVec3;

    use super::*;

    /// A ball of radius 0.4 on a grid that extends from −0.5 to 0.5.
    fn ball() -> Sdf {
        let values = (0..21 * 21 * 21)
            .map(|i| {
                let p = UVec3::new(i % 21, i / 21 % 21, i / 441).as_vec3() * 0.05 - 0.5;
                p.length() - 0.4
            })
            .collect();
        Sdf::new(UVec3::splat(21), Vec3::splat(-0.5), 0.05, values).unwrap()
    }

    #[test]
    fn the_gradient_is_the_derivative_of_the_value() {
        let (sdf, h) = (ball(), 1e-3);
        let mut compared = 0;
        for p in lattice(3000, 0.7) {
            let at = (p + 0.5) / 0.05;
            // Only inside cells: the gradient is discontinuous between cells.
            if (at - at.round()).abs().min_element() < 0.05 {
                continue;
            }
            let (_, gradient) = sdf.sample(p);
            let slope = Vec3::from_array(std::array::from_fn(|axis| {
                let step = Vec3::AXES[axis] * h;
                (sdf.sample(p + step).0 - sdf.sample(p - step).0) / (2.0 * h)
            }));
            assert!((slope - gradient).length() < 2e-3, "{p}: {gradient} instead of {slope}");
            compared += 1;
        }
        assert!(compared > 1000);
    }

    /// The same ball in two levels: cells of 40 mm, near the surface of 10 mm.
    fn refined_ball() -> Sdf {
        let mesh = uv_sphere(0.4, 48, 24);
        Sdf::near(&ClosedMesh::new(&mesh), 20, 0.1, 0.01).unwrap()
    }

    #[test]
    fn skipped_points_are_farther_than_the_reach() {
        for sdf in [ball(), refined_ball()] {
            skips_only_what_is_far(&sdf);
        }
    }

    fn skips_only_what_is_far(sdf: &Sdf) {
        for reach in [-0.1, 0.0, 0.03] {
            let mut skipped = 0;
            for p in lattice(3000, 0.7) {
                match sdf.sample_near(p, reach) {
                    Some(found) => assert_eq!(found, sdf.sample(p)),
                    None => {
                        skipped += 1;
                        assert!(sdf.sample(p).0 > reach, "{p}");
                    }
                }
            }
            assert!(skipped > 1000, "{skipped}");
        }
    }

    #[test]
    fn outside_the_grid_the_distance_is_a_positive_lower_bound() {
        let sdf = ball();
        for p in lattice(3000, 4.0) {
            if p.abs().max_element() > 0.5 {
                let (distance, gradient) = sdf.sample(p);
                assert!(distance > 0.0 && distance <= p.length() - 0.4 + 1e-3, "{p}: {distance}");
                assert!(gradient.dot(p) > 0.0);
            }
        }
        let (distance, _) = sdf.sample(Vec3::X * 3.0);
        assert!(distance > 2.5, "{distance}");
    }

    #[test]
    fn a_flat_field_has_a_gradient() {
        let flat = Sdf::new(UVec3::splat(2), Vec3::ZERO, 1.0, vec![-1.0; 8]).unwrap();
        assert_eq!(flat.sample(Vec3::splat(0.5)), (-1.0, Vec3::Y));
        assert!(flat.sample(Vec3::NAN).1.is_finite() || flat.sample(Vec3::NAN).0.is_nan());
    }

    /// Compares packets with single points; some of the points are outside the grid.
    fn lanes_agree<const W: usize>(sdf: &Sdf) {
        let points = lattice(W as u32 * 50, 0.8).collect::<Vec<_>>();
        for points in points.chunks_exact(W) {
            let p = std::array::from_fn(|axis| std::array::from_fn(|lane| points[lane][axis]));
            let (distances, gradients) = sdf.sample_lanes::<W>(p);
            for (lane, p) in points.iter().enumerate() {
                let gradient = Vec3::from_array(gradients.map(|g| g[lane]));
                assert_eq!((distances[lane], gradient), sdf.sample(*p), "{p}");
            }
        }
    }

    #[test]
    fn packets_and_single_points_are_bit_identical() {
        for sdf in [ball(), refined_ball()] {
            lanes_agree::<1>(&sdf);
            lanes_agree::<8>(&sdf);
            lanes_agree::<16>(&sdf);
        }
    }
}
