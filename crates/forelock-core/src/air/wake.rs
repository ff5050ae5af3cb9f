//! The wake of solids: the wind shelter behind them, computed by a march downwind.
//!
//! # Theory
//! The deficit D(x), the fraction of the wind that is missing, is 1 inside a solid. It is advected
//! downwind and spreads sideways as momentum does in a turbulent wake of constant eddy viscosity
//! (Schlichting, "Boundary-Layer Theory", free shear flows): with s along the wind, ∂D/∂s = ε ∇⊥²
//! D. Behind a body of radius R the deficit on the axis falls by half after about R²/(2.8 ε).
//!
//! # Practice
//! The grid has 24³ nodes, is centred at the hair's origin and aligned with the wind, and its side
//! is the diameter of the ball that the hair can reach. Each layer is the layer upwind of it, with
//! the solids added, after one diffusion step with ε = a/5 for cells of side a; wakes therefore
//! scale with the scene. A frame costs one SDF query per node, and most queries are decided by the
//! small table of lower bounds. Between nodes D is interpolated trilinearly.
//!
//! # Limitations
//! Solids outside the grid cast no wake, and solids thinner than a cell (a finger, a tooth of a
//! comb) cast almost none. The flow neither accelerates around a body nor recirculates behind it.
//! The wind upwind of a solid is not changed.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::body::{ColliderFrame, Shape};

/// Nodes along each side of the grid.
pub const NODES: usize = 24;
const LAYER: usize = NODES * NODES;
/// ε divided by the side of a cell.
pub const SPREAD: f32 = 0.2;

/// The velocity deficit around the hair in one frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Wake {
    /// The grid's axes (across, across and along the wind) divided by the cell: they convert metres
    /// to nodes.
    axes: [Vec3; 3],
    /// D at the nodes; the index along the wind varies slowest.
    deficit: Vec<f32>,
    /// The fraction of each node that is inside a solid, 0 to 1.
    solid: Vec<f32>,
    /// Whether any node is inside a solid; if not, D is 0 everywhere.
    casts_shelter: bool,
}

impl Wake {
    /// Computes the wake of `solids` in their poses at the frame's start, inside the ball of
    /// `radius` about `origin` (metres, world space), for a wind along `wind`. Without wind there
    /// is no wake. Allocates at its first call only.
    pub fn update(&mut self, solids: &[ColliderFrame<'_>], origin: DVec3, radius: f64, wind: DVec3) {
        self.casts_shelter = false;
        let Some(along) = wind.try_normalize() else { return };
        self.deficit.resize(LAYER * NODES, 0.0);
        self.solid.resize(LAYER * NODES, 0.0);
        let (axes, cell) = Self::nodes(along, radius);
        self.axes = axes.map(|axis| (axis / cell).as_vec3());
        let node = |at: usize| {
            let [i, j, k] = [at % NODES, at / NODES % NODES, at / LAYER].map(centred);
            origin + (axes[0] * i + axes[1] * j + axes[2] * k) * cell
        };
        let near = 0.5 * cell;
        self.solid.par_chunks_mut(LAYER).enumerate().for_each(|(layer, solid)| {
            for (at, value) in solid.iter_mut().enumerate() {
                let point = node(layer * LAYER + at);
                let inside = |solid: &ColliderFrame<'_>| {
                    let local = solid.pose(0.0).inverse().transform_point(point);
                    let (distance, _) = match solid.shape {
                        // Also sampled at the frame's start.
                        Shape::Morph { .. } | Shape::Bending(_) => {
                            solid.shape.sample_at(local.to_array(), 0.0)
                        }
                        shape => shape.sample_near(local.to_array(), near)?,
                    };
                    Some((0.5 - distance / cell).clamp(0.0, 1.0) as f32)
                };
                *value = solids.iter().filter_map(inside).fold(0.0, f32::max);
            }
        });
        self.casts_shelter = self.solid.iter().any(|&solid| solid > 0.0);
        if self.casts_shelter {
            self.march();
        }
    }

    /// The unit axes of the grid (across, across and along the wind) and the side of a cell in
    /// metres, for a grid that encloses the ball of `radius` (metres) with the wind along the unit
    /// vector `along`.
    pub fn nodes(along: DVec3, radius: f64) -> ([DVec3; 3], f64) {
        let (u, v) = along.any_orthonormal_pair();
        #[expect(clippy::cast_precision_loss, reason = "the constant is twenty-three")]
        let cell = 2.0 * radius / (NODES - 1) as f64;
        ([u, v, along], cell)
    }

    /// Advects and diffuses the deficit, layer by layer downwind.
    fn march(&mut self) {
        self.deficit[..LAYER].fill(0.0);
        let mut upwind = [0.0f32; LAYER];
        for layer in 1..NODES {
            let before = (layer - 1) * LAYER..layer * LAYER;
            for (at, value) in upwind.iter_mut().enumerate() {
                *value = self.deficit[before.start + at].max(self.solid[before.start + at]);
            }
            for j in 0..NODES {
                for i in 0..NODES {
                    let at = i + NODES * j;
                    let here = upwind[at];
                    // No flux through the grid's sides.
                    let left = if i > 0 { upwind[at - 1] } else { here };
                    let right = if i + 1 < NODES { upwind[at + 1] } else { here };
                    let down = if j > 0 { upwind[at - NODES] } else { here };
                    let up = if j + 1 < NODES { upwind[at + NODES] } else { here };
                    self.deficit[layer * LAYER + at] =
                        here + SPREAD * (left + right + down + up - 4.0 * here);
                }
            }
        }
    }

    /// D at `offset` metres from the origin (world axes); outside the grid, the value at the
    /// nearest point of the grid.
    #[inline(always)]
    pub fn deficit(&self, offset: [f32; 3]) -> f32 {
        if !self.casts_shelter {
            return 0.0;
        }
        let top = (NODES - 2) as f32;
        let (mut first, mut f) = (0, [0.0f32; 3]);
        for (axis, stride) in [1, NODES, LAYER].into_iter().enumerate() {
            let along = self.axes[axis];
            let at =
                along.x * offset[0] + along.y * offset[1] + along.z * offset[2] + 0.5 * (NODES - 1) as f32;
            let at = if at > 0.0 { at } else { 0.0 };
            let low = (if at < top { at } else { top }) as usize;
            f[axis] = (at - low as f32).min(1.0);
            first += low * stride;
        }
        let lerp = |a: f32, b: f32, t: f32| a + (b - a) * t;
        let d = &self.deficit;
        let row = |at: usize| lerp(d[at], d[at + 1], f[0]);
        let layer = |at: usize| lerp(row(at), row(at + NODES), f[1]);
        lerp(layer(first), layer(first + LAYER), f[2])
    }

    /// Size of the buffers in bytes.
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.deficit) + size_of_val(&*self.solid)
    }
}

/// The coordinate of a node, in cells from the grid's centre.
#[expect(clippy::cast_precision_loss, reason = "an index below twenty-four")]
fn centred(node: usize) -> f64 {
    node as f64 - 0.5 * (NODES - 1) as f64
}
