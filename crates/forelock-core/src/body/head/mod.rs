//! The built-in head: neck and shoulders, scalp and beard, defined by one implicit function.
//!
//! # Theory
//!
//! The head is the zero surface of smooth unions and cuts of ellipsoids and tapered capsules
//! (Quílez, "Distance functions" and "Smooth minimum"). They are placed by the proportions that
//! drawing courses teach: eyes at half height; brow, nose and chin at thirds below the hairline;
//! ears between brow and nose. Size: 23 cm from chin to crown, 15.5 cm wide, 20 cm deep. The origin
//! is between the ears, y is up, and the face points to +z.
//!
//! # Practice
//!
//! [`Head::builtin`] creates the mesh at first use and keeps it. The mesh is closed, manifold and
//! of genus 0; it is finest at the face and the ears.
//!
//! # Limitations
//!
//! The head is stylised and symmetric, without modelled hair, teeth and throat. [`Head::distance`]
//! is a distance to first order near the surface only: within 2 cm of the surface, the length of
//! its gradient is 0.5 to 1.5 at 97 % or more of the points.

mod features;
mod implicit;
mod region;
#[cfg(test)]
mod tests;

use std::sync::OnceLock;

use glam::{Vec3, vec3};
use rayon::prelude::*;

use super::surface_nets::Bounds;
use super::{TriMesh, surface_nets};
pub use features::Features;
pub use region::Region;

/// Side of the finest cells of the mesh, in metres.
const CELL: f32 = 2.2e-3;
/// The box of grid points before [`warp`] is applied; the warped box contains the whole head.
const BOX: Bounds = Bounds { min: vec3(-0.166, -0.221, -0.085), max: vec3(0.166, 0.105, 0.126) };

/// A head with neck and shoulders, in metres.
#[derive(Clone, Debug)]
pub struct Head {
    /// The closed surface.
    pub mesh: TriMesh,
    /// Density of the hair on the head, 0 to 1, one value for each vertex.
    pub scalp: Vec<f32>,
    /// Density of the beard, 0 to 1, one value for each vertex.
    pub beard: Vec<f32>,
}

impl Head {
    /// The point about which the head turns on the neck, in metres.
    pub const NECK_PIVOT: Vec3 = vec3(0.0, -0.06, -0.025);

    /// The built-in head. The first call creates it, which takes less than a second; later calls
    /// return the same head.
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

    /// Density of hair in `region`, 0 to 1, one value for each vertex.
    pub fn weights(&self, region: Region) -> &[f32] {
        match region {
            Region::Scalp => &self.scalp,
            Region::Beard => &self.beard,
        }
    }

    /// Signed distance from `point` to the head in metres, negative inside; approximate away from
    /// the surface.
    pub fn distance(point: Vec3) -> f32 {
        implicit::distance(point)
    }

    /// What the surface shows at `point`, metres: eyes, brows, lips.
    pub fn features(point: Vec3) -> Features {
        features::features(point)
    }

    /// The solid that hair grown on `region` must avoid: the head and, for the scalp, also the
    /// space in front of the face.
    ///
    /// The returned function takes a point and a reach in metres. It returns the distance and its
    /// unit gradient if the distance is less than the reach, and `None` otherwise.
    pub fn keep_out(&self, region: Region) -> impl Fn(Vec3, f32) -> Option<(f32, Vec3)> + Sync + use<> {
        let solid = match region {
            Region::Scalp => implicit::distance_with_face_space,
            Region::Beard => implicit::distance,
        };
        move |point, reach| {
            let distance = solid(point);
            (distance < reach).then(|| {
                let gradient = super::implicit::forward_gradient(solid, point, distance);
                let slope = gradient.length().max(0.1);
                (distance / slope, gradient / slope)
            })
        }
    }
}

/// Maps grid points to space: cells are finest at the face and the ears and grow to 2.2 times that
/// size towards the shoulders and the back.
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
