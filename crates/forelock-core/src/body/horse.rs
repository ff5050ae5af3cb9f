//! The built-in horse: a body on which a mane and a tail can be grown.
//!
//! # Practice
//! The horse is a smooth union of tapered capsules, meshed at first use as the built-in head is.
//! The origin is at the height of the withers above the forelegs, y is up, and the horse faces +z;
//! it is 1.9 m long from muzzle to tail. Hair can collide with its distance field or with capsules,
//! one for each of [`Horse::PARTS`].
//!
//! # Limitations
//! A toy: the ears are not hollow, and there are no hooves and no eyes. It is rigid; moving legs
//! must be separate colliders.

use std::sync::OnceLock;

use glam::{Vec3, vec3};

use super::implicit::{cone, join};
use super::surface_nets::Bounds;
use super::{TriMesh, surface_nets};

/// Side of the mesh's cells, metres.
const CELL: f32 = 0.014;
/// The box that contains the horse, metres.
const BOX: Bounds = Bounds { min: vec3(-0.32, -1.3, -1.15), max: vec3(0.32, 0.75, 0.95) };
/// Width of the smooth blend between parts, metres.
const BLEND: f32 = 0.06;

/// A horse, in metres.
#[derive(Clone, Debug)]
pub struct Horse {
    /// The closed surface.
    pub mesh: TriMesh,
}

/// A tapered capsule.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Part {
    /// Ends of the axis, metres.
    pub ends: [[f32; 3]; 2],
    /// Radii at the ends, metres.
    pub radii: [f32; 2],
}

/// Shorthand for [`Part`].
const fn part(from: [f32; 3], to: [f32; 3], from_radius: f32, to_radius: f32) -> Part {
    Part { ends: [from, to], radii: [from_radius, to_radius] }
}

impl Horse {
    /// The point about which the horse turns, metres: between shoulders and hips.
    pub const PIVOT: Vec3 = vec3(0.0, -0.3, -0.35);

    /// The parts in this order: trunk, neck, head and muzzle, ears, dock, shoulders and hips, then
    /// the upper and lower part of each leg.
    pub const PARTS: [Part; 18] = [
        part([0.0, -0.28, 0.02], [0.0, -0.3, -0.42], 0.24, 0.25),
        part([0.0, -0.3, -0.42], [0.0, -0.24, -0.78], 0.25, 0.22),
        part([0.0, -0.12, 0.16], [0.0, 0.36, 0.46], 0.17, 0.1),
        part([0.0, 0.4, 0.5], [0.0, 0.3, 0.66], 0.1, 0.085),
        part([0.0, 0.3, 0.66], [0.0, 0.17, 0.82], 0.075, 0.06),
        part([0.05, 0.5, 0.44], [0.07, 0.58, 0.45], 0.025, 0.012),
        part([-0.05, 0.5, 0.44], [-0.07, 0.58, 0.45], 0.025, 0.012),
        part([0.0, -0.12, -0.94], [0.0, -0.2, -1.04], 0.05, 0.03),
        part([0.12, -0.3, 0.08], [0.12, -0.52, 0.06], 0.12, 0.1),
        part([-0.12, -0.3, 0.08], [-0.12, -0.52, 0.06], 0.12, 0.1),
        part([0.12, -0.52, 0.06], [0.12, -0.82, 0.05], 0.085, 0.055),
        part([-0.12, -0.52, 0.06], [-0.12, -0.82, 0.05], 0.085, 0.055),
        part([0.12, -0.82, 0.05], [0.12, -1.2, 0.07], 0.05, 0.045),
        part([-0.12, -0.82, 0.05], [-0.12, -1.2, 0.07], 0.05, 0.045),
        part([0.12, -0.34, -0.78], [0.12, -0.78, -0.84], 0.16, 0.07),
        part([-0.12, -0.34, -0.78], [-0.12, -0.78, -0.84], 0.16, 0.07),
        part([0.12, -0.78, -0.84], [0.12, -1.2, -0.8], 0.055, 0.045),
        part([-0.12, -0.78, -0.84], [-0.12, -1.2, -0.8], 0.055, 0.045),
    ];

    /// The built-in horse. The first call creates it; later calls return the same horse.
    pub fn builtin() -> &'static Self {
        static HORSE: OnceLock<Horse> = OnceLock::new();
        HORSE.get_or_init(|| {
            let mut mesh = surface_nets::surface_nets(distance, |p| p, BOX, CELL);
            mesh.positions.iter_mut().for_each(|p| *p = surface_nets::project(*p, distance, 0.4 * CELL));
            Self { mesh }
        })
    }
}

/// Approximate signed distance, metres.
fn distance(p: Vec3) -> f32 {
    Horse::PARTS.iter().fold(f32::INFINITY, |d, part| {
        let [from, to] = part.ends.map(Vec3::from_array);
        let part = cone(p, from, to, part.radii[0], part.radii[1]);
        if d.is_finite() { join(d, part, BLEND) } else { part }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mesh_is_closed_and_contains_its_parts() {
        let mesh = &Horse::builtin().mesh;
        assert!(mesh.positions.len() > 5000, "{}", mesh.positions.len());
        let mut edges = std::collections::HashMap::new();
        for t in &mesh.triangles {
            for i in 0..3 {
                *edges.entry((t[i], t[(i + 1) % 3])).or_insert(0) += 1;
            }
        }
        assert!(edges.iter().all(|(&(a, b), &count)| count == 1 && edges.get(&(b, a)) == Some(&1)));
        for part in Horse::PARTS {
            for end in part.ends {
                assert!(distance(Vec3::from_array(end)) < 0.0, "{end:?}");
            }
        }
    }
}
