//! Hair as a participating medium: a density grid, swept once for each light.
//!
//! # Theory
//! A strand of width w and length ℓ in a cell of side h blocks the share w ℓ / h² of the light that
//! crosses the cell. This share is the optical depth of the cell. Along a direction d the depths
//! add up, τ(x) = ∫ ρ(x − s d) ds, and the transmittance is exp(−τ). The method corresponds to deep
//! opacity maps (Yuksel & Keyser 2008) with as many layers as the grid has slabs.
//!
//! # Practice
//! The integral is computed slab by slab along the axis nearest to d. For each cell, τ is
//! interpolated bilinearly at the point where the light ray crossed the previous slab, and the mean
//! of both densities times the path between them is added. The cost is O(cells) for each light. No
//! rendering from the light is needed, and there is no shadow acne. The same sweep over a coarse
//! grid in 14 directions, bodies included, gives ambient occlusion. Deposits are integers, so that
//! their order does not change the sum.
//!
//! # Limitations
//! Bilinear interpolation blurs a shadow by about √n cells after n slabs. Objects outside the grid
//! cast no shadow.

use std::sync::atomic::{AtomicU64, Ordering};

use glam::{UVec3, Vec3};

/// The fixed-point value of a deposit of 1. 2³² of them fit.
const ONE: f32 = 4_294_967_296.0;

/// The layout of a grid: cubic cells of side `cell`, with the centre of the first at `origin`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Layout {
    pub origin: Vec3,
    pub cell: f32,
    pub size: UVec3,
}

impl Layout {
    /// A grid over a box: `resolution` cells along its longest side, and a margin of one empty
    /// cell.
    pub fn covering(lo: Vec3, hi: Vec3, resolution: u32) -> Self {
        let cell = ((hi - lo).max_element() / resolution as f32).max(1e-9);
        let size = ((hi - lo) / cell).ceil().max(Vec3::ONE).as_uvec3() + 2;
        Self { origin: lo - 0.5 * cell, cell, size }
    }

    pub fn len(&self) -> usize {
        self.size.x as usize * self.size.y as usize * self.size.z as usize
    }

    /// `point` in units of cells, relative to the centre of the first cell.
    fn locate(&self, point: Vec3) -> Vec3 {
        (point - self.origin) / self.cell
    }

    /// The distance in memory between neighbours along each axis.
    fn strides(&self) -> [usize; 3] {
        [1, self.size.x as usize, self.size.x as usize * self.size.y as usize]
    }

    /// The eight cells around a point, with their weights. Points outside are moved to the border.
    fn corners(&self, point: Vec3) -> [(usize, f32); 8] {
        // A side has at least three cells and the clamped value is not negative, so the cast is
        // `floor`.
        let scaled = self.locate(point).clamp(Vec3::ZERO, (self.size - 1).as_vec3());
        let base = scaled.as_uvec3().min(self.size - 2);
        let f = scaled - base.as_vec3();
        let [_, sy, sz] = self.strides();
        let first = base.x as usize + base.y as usize * sy + base.z as usize * sz;
        let (x, y, z) = ([1.0 - f.x, f.x], [1.0 - f.y, f.y], [1.0 - f.z, f.z]);
        std::array::from_fn(|i| {
            let (dx, dy, dz) = (i & 1, i >> 1 & 1, i >> 2);
            (first + dx + dy * sy + dz * sz, x[dx] * y[dy] * z[dz])
        })
    }
}

/// The optical depth of each cell, while many threads add to it.
pub(crate) struct Deposits {
    pub layout: Layout,
    cells: Vec<AtomicU64>,
}

impl Deposits {
    pub fn new(layout: Layout) -> Self {
        Self { layout, cells: (0..layout.len()).map(|_| AtomicU64::new(0)).collect() }
    }

    /// Distributes `area` (m²) to the cells around `point`. Points outside the grid are ignored.
    pub fn add(&self, point: Vec3, area: f32) {
        let depth = area / (self.layout.cell * self.layout.cell);
        let at = self.layout.locate(point);
        let inside = at.cmpge(Vec3::ZERO).all() && at.cmple((self.layout.size - 1).as_vec3()).all();
        if inside && depth.is_finite() {
            for (cell, weight) in self.layout.corners(point) {
                self.cells[cell].fetch_add((depth * weight * ONE) as u64, Ordering::Relaxed);
            }
        }
    }

    pub fn finish(self) -> Grid {
        let values = self.cells.into_iter().map(|c| c.into_inner() as f32 / ONE).collect();
        Grid { layout: self.layout, values }
    }
}

/// One number for each cell.
#[derive(Clone, Debug)]
pub(crate) struct Grid {
    pub layout: Layout,
    pub values: Vec<f32>,
}

impl Grid {
    /// The trilinearly interpolated value at `point`. Points outside the grid have the value of its
    /// border.
    pub fn sample(&self, point: Vec3) -> f32 {
        self.layout.corners(point).iter().map(|&(cell, weight)| self.values[cell] * weight).sum()
    }

    /// For a grid of optical depths per cell: the depth that light along `direction` has crossed
    /// when it reaches the centre of each cell.
    pub fn sweep(&self, direction: Vec3) -> Self {
        let size = self.layout.size.to_array().map(|n| n as usize);
        let strides = self.layout.strides();
        let [a, b, c] = match direction.abs().max_position() {
            0 => [0, 1, 2],
            1 => [1, 0, 2],
            _ => [2, 0, 1],
        };
        // The offset of the ray at the previous slab, in cells, and the path between the slabs, in
        // cell sides.
        let back = [b, c].map(|axis| -direction[axis] / direction[a].abs());
        let path = (1.0 + back[0] * back[0] + back[1] * back[1]).sqrt();
        let mut depths = vec![0.0_f32; self.values.len()];
        let slab = |k: usize| if direction[a] > 0.0 { k } else { size[a] - 1 - k } * strides[a];
        for k in 1..size[a] {
            let (from, to) = (slab(k - 1), slab(k));
            for j in 0..size[c] {
                for i in 0..size[b] {
                    let cell = i * strides[b] + j * strides[c];
                    let mut depth = 0.5 * path * self.values[to + cell];
                    let taps = bilinear([i, j], back, [size[b], size[c]]);
                    for (x, y, weight) in taps {
                        let tap = from + x * strides[b] + y * strides[c];
                        depth += weight * (depths[tap] + 0.5 * path * self.values[tap]);
                    }
                    depths[to + cell] = depth;
                }
            }
        }
        Self { layout: self.layout, values: depths }
    }
}

/// The four cells of a slab around `cell + offset`, |offset| ≤ 1. Cells outside have weight 0.
fn bilinear(cell: [usize; 2], offset: [f32; 2], size: [usize; 2]) -> [(usize, usize, f32); 4] {
    let axis = |i: usize, offset: f32, size: usize| {
        let base = offset.floor();
        let f = offset - base;
        let tap = |shift: i32, weight: f32| {
            let at = i as i32 + base as i32 + shift;
            if (0..size as i32).contains(&at) { (at as usize, weight) } else { (i, 0.0) }
        };
        [tap(0, 1.0 - f), tap(1, f)]
    };
    let [x, y] = [axis(cell[0], offset[0], size[0]), axis(cell[1], offset[1], size[1])];
    std::array::from_fn(|i| (x[i & 1].0, y[i >> 1].0, x[i & 1].1 * y[i >> 1].1))
}

/// The number of [`open_directions`].
pub(crate) const OPEN_DIRECTIONS: usize = 14;

/// The directions to the 6 faces and 8 corners of a cube.
pub(crate) fn open_directions() -> Vec<Vec3> {
    (0..27)
        .map(|i| Vec3::new((i % 3) as f32, (i / 3 % 3) as f32, (i / 9) as f32) - 1.0)
        .filter(|d| matches!(d.length_squared() as u32, 1 | 3))
        .collect()
}

/// The share of ambient light that reaches each cell, in 0–1: exp(−τ) averaged over
/// [`open_directions`].
pub(crate) fn openness(depths: &Grid) -> Grid {
    use rayon::prelude::*;
    let share = 1.0 / OPEN_DIRECTIONS as f32;
    let swept: Vec<Grid> = open_directions().par_iter().map(|&d| depths.sweep(d)).collect();
    let values =
        (0..depths.values.len()).map(|i| swept.iter().map(|g| (-g.values[i]).exp() * share).sum()).collect();
    Grid { layout: depths.layout, values }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn slab_grid() -> Grid {
        let layout = Layout::covering(Vec3::ZERO, Vec3::ONE, 16);
        let size = layout.size;
        let mut values = vec![0.0; layout.len()];
        // A wall of optical depth 0.5 across x, in the middle of the grid.
        for (i, value) in values.iter_mut().enumerate() {
            if i as u32 % size.x == 8 {
                *value = 0.5;
            }
        }
        Grid { layout, values }
    }

    #[test]
    fn a_wall_shades_what_is_behind_it_by_its_depth() {
        let grid = slab_grid();
        let before = Vec3::new(0.2, 0.5, 0.5);
        let behind = Vec3::new(0.8, 0.5, 0.5);
        for (direction, lit, dark) in [(Vec3::X, before, behind), (Vec3::NEG_X, behind, before)] {
            let swept = grid.sweep(direction);
            assert!(swept.sample(lit).abs() < 1e-6);
            assert!((swept.sample(dark) - 0.5).abs() < 1e-5);
        }
        // Oblique light crosses 1/cos of this depth.
        let swept = grid.sweep(Vec3::new(1.0, 0.5, 0.0));
        assert!((swept.sample(behind) - 0.5 * 1.25_f32.sqrt()).abs() < 1e-3);
    }

    #[test]
    fn deposits_keep_their_area() {
        let layout = Layout::covering(Vec3::ZERO, Vec3::ONE, 10);
        let deposits = Deposits::new(layout);
        deposits.add(Vec3::new(0.33, 0.71, 0.5), 0.002);
        deposits.add(Vec3::splat(7.0), 1.0);
        let total: f32 = deposits.finish().values.iter().sum();
        assert!((total * layout.cell * layout.cell - 0.002).abs() < 1e-6);
    }

    #[test]
    fn the_middle_of_a_cloud_is_less_open_than_its_rim() {
        let layout = Layout::covering(Vec3::NEG_ONE, Vec3::ONE, 16);
        let grid = Grid { layout, values: vec![0.2; layout.len()] };
        let open = openness(&grid);
        let (middle, rim) = (open.sample(Vec3::ZERO), open.sample(Vec3::X));
        assert_eq!(open_directions().len(), OPEN_DIRECTIONS);
        assert!(middle < 0.3 && rim > middle + 0.2 && rim <= 1.0, "{middle} {rim}");
    }
}
