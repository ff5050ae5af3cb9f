//! The built-in head: neck and shoulders, scalp and beard, from one function of space.
//!
//! # Theory
//!
//! The head is the zero surface of smooth unions and cuts of ellipsoids and tapered capsules (Quílez, "Distance
//! functions" and "Smooth minimum"), placed by the proportions that drawing teaches: eyes at half height; brow, nose and chin at
//! thirds below the hairline; ears between brow and nose. Size: 23 cm from chin to crown, 15.5 cm wide, 20 cm deep.
//! The origin lies between the ears, y is up, the face looks to +z.
//!
//! # Practice
//!
//! [`Head::builtin`] meshes it at first use and keeps it. The mesh is closed, manifold and of genus 0, finest over
//! face and ears.
//!
//! # Limitations
//!
//! A stylised sculpture, symmetric, with no hair of its own, no teeth and no throat. [`Head::distance`] is a
//! distance to first order near the surface only: within 2 cm of it, its gradient's length is 0.5 to 1.5
//! at 97 % of points and more.

mod implicit;
mod region;
#[cfg(test)]
mod tests;

use std::sync::OnceLock;

use glam::{Vec3, vec3};
use rayon::prelude::*;

use super::{TriMesh, surface_nets};
pub use region::Region;

/// Side of the finest cells of the mesh, in metres.
const CELL: f32 = 2.2e-3;
/// The box of grid points before [`warp`]: it holds the whole head after it.
const BOX: (Vec3, Vec3) = (vec3(-0.166, -0.221, -0.085), vec3(0.166, 0.105, 0.126));
/// A head with neck and shoulders, in metres.
#[derive(Clone, Debug)]
pub struct Head {
    /// The closed surface.
    pub mesh: TriMesh,
    /// Density of the hair of the head, 0 to 1, one a vertex.
    pub scalp: Vec<f32>,
    /// Density of the beard, 0 to 1, one a vertex.
    pub beard: Vec<f32>,
}

impl Head {
    /// Where the head turns on the neck, in metres.
    pub const NECK_PIVOT: Vec3 = vec3(0.0, -0.06, -0.025);

    /// The head; made at the first call, which takes under a second, and kept.
    pub fn builtin() -> &'static Self {
        static HEAD: OnceLock<Head> = OnceLock::new();
        HEAD.get_or_init(Self::build)
    }

    fn build() -> Self {
        let mut mesh = surface_nets::surface_nets(implicit::distance, warp, BOX, CELL);
        mesh.positions
            .par_iter_mut()
            .for_each(|p| *p = surface_nets::project(*p, implicit::distance, 0.4 * CELL));
        let weigh = |region: Region| mesh.positions.par_iter().map(|&p| region.weight(p)).collect();
        Self { scalp: weigh(Region::Scalp), beard: weigh(Region::Beard), mesh }
    }

    /// Density of hair in `region`, 0 to 1, one a vertex.
    pub fn weights(&self, region: Region) -> &[f32] {
        match region {
            Region::Scalp => &self.scalp,
            Region::Beard => &self.beard,
        }
    }

    /// Signed distance from `point` to the head, in metres, negative inside; approximate off the surface.
    pub fn distance(point: Vec3) -> f32 {
        implicit::distance(point)
    }

    /// What hair grown on `region` keeps out of: the head, and for the scalp the space before the face too.
    ///
    /// The function returned gives, for a point and a reach in metres, the distance and its unit gradient where the
    /// distance is under the reach, and nothing elsewhere.
    pub fn keep_out(&self, region: Region) -> impl Fn(Vec3, f32) -> Option<(f32, Vec3)> + Sync + use<> {
        let solid = match region {
            Region::Scalp => implicit::distance_with_face_space,
            Region::Beard => implicit::distance,
        };
        move |point, reach| {
            let distance = solid(point);
            (distance < reach).then(|| {
                let gradient = super::implicit::gradient(solid, point);
                let slope = gradient.length().max(0.1);
                (distance / slope, gradient / slope)
            })
        }
    }
}

/// From grid to space: cells are finest over face and ears, and grow to 2.2 times that to the shoulders and the back.
fn warp(u: Vec3) -> Vec3 {
    let ramp = |t: f32| match t {
        ..0.0 => 0.0,
        0.0..0.04 => t * t / 0.08,
        _ => t - 0.02,
    };
    vec3(
        u.x + (1.2 * ramp(u.x.abs() - 0.085)).copysign(u.x),
        u.y - 1.2 * ramp(-0.12 - u.y) + 0.6 * ramp(u.y - 0.04),
        u.z - 1.2 * ramp(0.02 - u.z),
    )
}
