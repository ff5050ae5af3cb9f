//! Built-in solids for interaction with hair: a hand, a comb, a hollow sphere with openings.
//!
//! # Theory
//! Each prop is the zero surface of one implicit function (smooth unions and cuts of capsules,
//! boxes and ellipsoids), meshed by surface nets as the built-in head is. The mesh is closed, so
//! any distance field made from it has a well-defined inside.
//!
//! # Practice
//! [`Prop::mesh`] creates the mesh, in metres, in the prop's local space; [`Prop::field_nodes`] is
//! the number of nodes along the longest side with which a distance field resolves the thinnest
//! part by two cells or more. The sizes are those of real objects.
//!
//! # Limitations
//! Props are rigid: the hand's fingers do not bend. Nails and creases are not modelled.

mod comb;
mod hand;
mod holed_sphere;

use glam::Vec3;
use rayon::prelude::*;

use super::surface_nets::Bounds;
use super::{TriMesh, surface_nets};

/// A built-in solid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Prop {
    /// A right hand with spread fingers, 19 cm from the wrist (the origin) to the tip of the middle
    /// finger, and 7 cm of forearm. Fingers point to +y, the palm faces +z, the thumb is at −x.
    Hand,
    /// A comb of 31 round teeth, 3.4 cm long and 3.2 mm thick at their roots, 2.2 mm at their tips,
    /// one every 5.5 mm. The spine lies along x through the origin and is 17.5 cm long; the teeth
    /// point to −y.
    Comb,
    /// A shell centred at the origin with 14 round holes: one in each direction of each axis and
    /// one through each corner of a cube.
    HoledSphere {
        /// Radius of its outer surface in metres.
        radius: f32,
    },
}

impl Prop {
    /// Signed distance in metres from `point` (in the prop's local space), negative inside; exact
    /// to first order near the surface.
    pub fn distance(self, point: Vec3) -> f32 {
        match self {
            Self::Hand => hand::distance_cm(point * 100.0) * 0.01,
            Self::Comb => comb::distance_cm(point * 100.0) * 0.01,
            Self::HoledSphere { radius } => holed_sphere::distance(point / radius) * radius,
        }
    }

    /// The closed surface in metres.
    pub fn mesh(self) -> TriMesh {
        let (bounds, cell) = match self {
            Self::Hand => (hand::BOX, 1.6e-3),
            Self::Comb => (comb::BOX, 7e-4),
            Self::HoledSphere { radius } => {
                let half = Vec3::splat(1.06 * radius);
                (Bounds { min: -half, max: half }, 0.02 * radius)
            }
        };
        let mut mesh = surface_nets::surface_nets(|p| self.distance(p), |u| u, bounds, cell);
        let project = |p: &mut Vec3| *p = surface_nets::project(*p, |q| self.distance(q), 0.4 * cell);
        mesh.positions.par_iter_mut().for_each(project);
        mesh
    }

    /// Number of nodes along the longest side of a distance field that resolves the prop.
    pub fn field_nodes(self) -> u32 {
        match self {
            Self::Hand => 128,
            Self::Comb => 288,
            Self::HoledSphere { .. } => 96,
        }
    }
}

#[cfg(test)]
mod tests;
