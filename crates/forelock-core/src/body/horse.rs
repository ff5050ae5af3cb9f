//! The built-in horse: a body with a mane and a tail to grow, made of as many parts as it is collided with.
//!
//! # Practice
//! A smooth union of tapered capsules, meshed at first use as the built-in head is. The origin lies at the withers' height over the forelegs, y is up, it looks to +z: 1.9 m from muzzle to tail. What hair collides with can be its
//! distance field, or capsules, one for each of [`Horse::PARTS`].
//!
//! # Limitations
//! A toy: no ears' hollows, no hooves, no eyes. It is rigid; legs swing as colliders of their own.

use std::sync::OnceLock;

use glam::{Vec3, vec3};

use super::implicit::{cone, join};
use super::{TriMesh, surface_nets};

/// Side of the mesh's cells, metres.
const CELL: f32 = 0.014;
/// The box around it.
const BOX: (Vec3, Vec3) = (vec3(-0.32, -1.3, -1.15), vec3(0.32, 0.75, 0.95));
/// How far parts flow into each other, metres.
const BLEND: f32 = 0.06;

/// A horse, in metres.
#[derive(Clone, Debug)]
pub struct Horse {
    /// The closed surface.
    pub mesh: TriMesh,
}

/// A part: two ends and the radii there, metres.
pub type Part = ([f32; 3], [f32; 3], f32, f32);

impl Horse {
    /// Where it turns, metres: between shoulders and hips.
    pub const PIVOT: Vec3 = vec3(0.0, -0.3, -0.35);

    /// Trunk, neck, head and muzzle, ears, dock, shoulders and hips, then the upper and lower part of each leg.
    pub const PARTS: [Part; 18] = [
        ([0.0, -0.28, 0.02], [0.0, -0.3, -0.42], 0.24, 0.25),
        ([0.0, -0.3, -0.42], [0.0, -0.24, -0.78], 0.25, 0.22),
        ([0.0, -0.12, 0.16], [0.0, 0.36, 0.46], 0.17, 0.1),
        ([0.0, 0.4, 0.5], [0.0, 0.3, 0.66], 0.1, 0.085),
        ([0.0, 0.3, 0.66], [0.0, 0.17, 0.82], 0.075, 0.06),
        ([0.05, 0.5, 0.44], [0.07, 0.58, 0.45], 0.025, 0.012),
        ([-0.05, 0.5, 0.44], [-0.07, 0.58, 0.45], 0.025, 0.012),
        ([0.0, -0.12, -0.94], [0.0, -0.2, -1.04], 0.05, 0.03),
        ([0.12, -0.3, 0.08], [0.12, -0.52, 0.06], 0.12, 0.1),
        ([-0.12, -0.3, 0.08], [-0.12, -0.52, 0.06], 0.12, 0.1),
        ([0.12, -0.52, 0.06], [0.12, -0.82, 0.05], 0.085, 0.055),
        ([-0.12, -0.52, 0.06], [-0.12, -0.82, 0.05], 0.085, 0.055),
        ([0.12, -0.82, 0.05], [0.12, -1.2, 0.07], 0.05, 0.045),
        ([-0.12, -0.82, 0.05], [-0.12, -1.2, 0.07], 0.05, 0.045),
        ([0.12, -0.34, -0.78], [0.12, -0.78, -0.84], 0.16, 0.07),
        ([-0.12, -0.34, -0.78], [-0.12, -0.78, -0.84], 0.16, 0.07),
        ([0.12, -0.78, -0.84], [0.12, -1.2, -0.8], 0.055, 0.045),
        ([-0.12, -0.78, -0.84], [-0.12, -1.2, -0.8], 0.055, 0.045),
    ];

    /// The horse; made at the first call and kept.
    pub fn builtin() -> &'static Self {
        static HORSE: OnceLock<Horse> = OnceLock::new();
        HORSE.get_or_init(|| {
            let mut mesh = surface_nets::surface_nets(distance, |p| p, BOX, CELL);
            mesh.positions.iter_mut().for_each(|p| *p = surface_nets::project(*p, distance, 0.4 * CELL));
            Self { mesh }
        })
    }
}

/// Signed distance, about, metres.
fn distance(p: Vec3) -> f32 {
    Horse::PARTS.iter().fold(f32::INFINITY, |d, (a, b, from, to)| {
        let part = cone(p, Vec3::from_array(*a), Vec3::from_array(*b), *from, *to);
        if d.is_finite() { join(d, part, BLEND) } else { part }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_one_closed_surface_around_its_parts() {
        let mesh = &Horse::builtin().mesh;
        assert!(mesh.positions.len() > 5000, "{}", mesh.positions.len());
        let mut edges = std::collections::HashMap::new();
        for t in &mesh.triangles {
            for i in 0..3 {
                *edges.entry((t[i], t[(i + 1) % 3])).or_insert(0) += 1;
            }
        }
        assert!(edges.iter().all(|(&(a, b), &count)| count == 1 && edges.get(&(b, a)) == Some(&1)));
        for (a, b, ..) in Horse::PARTS {
            for end in [a, b] {
                assert!(distance(Vec3::from_array(end)) < 0.0, "{end:?}");
            }
        }
    }
}
