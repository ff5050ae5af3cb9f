//! Shelter: the wake of solids, marched downwind.
//!
//! # Theory
//! The deficit D(x), the share of the wind that is missing, is 1 in a solid and is carried downwind, where it spreads
//! sideways as momentum does in a turbulent wake of constant eddy viscosity (Schlichting, "Boundary-Layer Theory", free shear flows): with s along the wind,
//! ∂D/∂s = ε ∇⊥² D. Behind a body of radius R the deficit on the axis falls by half after about R²/(2.8 ε).
//!
//! # Practice
//! A grid of 24³ nodes about the hair's origin, aligned with the wind, its side that of the ball in which the hair can be. Each layer is the one before it, solids
//! included, after one step of diffusion with ε = a/5 for cells of side a: wakes scale with the scene. A frame costs one look at the solids a node,
//! most of them at the small table of lower bounds. Between the nodes D is trilinear.
//!
//! # Limitations
//! Solids outside the grid cast no wake, and those thinner than a cell (a finger, a comb's tooth) hardly any. The flow does not speed up around a body, nor turn back
//! behind it. All that matters upwind of a solid is left as it was.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::body::{ColliderFrame, Shape};

/// Nodes along each side.
pub const NODES: usize = 24;
const LAYER: usize = NODES * NODES;
/// ε over the cell.
pub const SPREAD: f32 = 0.2;

/// The deficit around the hair in one frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Wake {
    /// Across, across and along the wind, over the cell: from metres to nodes.
    axes: [Vec3; 3],
    /// D at the nodes, along the wind slowest.
    deficit: Vec<f32>,
    /// Whether a node is in a solid, 0 to 1.
    solid: Vec<f32>,
    /// Whether anything shelters at all.
    any: bool,
}

impl Wake {
    /// The wake of `solids` as they are at the frame's start, in the ball of `radius` about `origin` (metres, world), in wind along
    /// `wind`; none in no wind. Allocates at its first call only.
    pub fn update(&mut self, solids: &[ColliderFrame<'_>], origin: DVec3, radius: f64, wind: DVec3) {
        self.any = false;
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
                        // As it is now, too.
                        Shape::Morph { .. } => solid.shape.sample_at(local.to_array(), 0.0),
                        shape => shape.sample_near(local.to_array(), near)?,
                    };
                    Some((0.5 - distance / cell).clamp(0.0, 1.0) as f32)
                };
                *value = solids.iter().filter_map(inside).fold(0.0, f32::max);
            }
        });
        self.any = self.solid.iter().any(|&solid| solid > 0.0);
        if self.any {
            self.march();
        }
    }

    /// Axes across, across and along the wind, and the side of a cell, metres, of nodes in the ball of `radius` (metres) in wind along the unit vector `along`.
    pub fn nodes(along: DVec3, radius: f64) -> ([DVec3; 3], f64) {
        let (u, v) = along.any_orthonormal_pair();
        #[expect(clippy::cast_precision_loss, reason = "twenty-three")]
        let cell = 2.0 * radius / (NODES - 1) as f64;
        ([u, v, along], cell)
    }

    /// Layer after layer downwind.
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
                    // Nothing flows through the grid's sides.
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

    /// D at `offset` metres from the origin (world axes); beyond the grid that of its nearest point.
    #[inline(always)]
    pub fn deficit(&self, offset: [f32; 3]) -> f32 {
        if !self.any {
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

    /// Bytes held.
    pub fn bytes(&self) -> usize {
        size_of_val(&*self.deficit) + size_of_val(&*self.solid)
    }
}

/// A node's number from the grid's middle.
#[expect(clippy::cast_precision_loss, reason = "under twenty-four")]
fn centred(node: usize) -> f64 {
    node as f64 - 0.5 * (NODES - 1) as f64
}
