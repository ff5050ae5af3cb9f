//! How densely hair grows around each vertex of a body, for the colour of the skin between roots.
//!
//! # Practice
//! Hair is simulated and drawn by fewer strands than grow, so that bare skin shows where a scalp
//! looks dark: at partings and whorls. The density of roots at a vertex, relative to the median at
//! the roots themselves, says where hair grows; there the skin takes on some of its colour.

use std::collections::HashMap;

use forelock_core::groom::Groom;
use glam::{DVec3, IVec3, Vec3};

/// The weight of roots that the neighbourhood of a root must hold.
const ENOUGH: f32 = 5.0;
/// The smallest and the largest radius of a neighbourhood, metres.
const RADII: [f32; 2] = [0.003, 0.03];
/// Roots at which the density is measured.
const SAMPLES: usize = 256;
/// Densities over the median at which skin begins to look, and fully looks, overgrown.
const EDGE: [f32; 2] = [0.15, 0.75];

/// Roots in cells of the size of their neighbourhood.
struct Roots {
    radius: f32,
    cells: HashMap<IVec3, Vec<Vec3>>,
}

impl Roots {
    fn new(roots: &[Vec3], radius: f32) -> Self {
        let mut own = Self { radius, cells: HashMap::new() };
        for &root in roots {
            own.cells.entry(own.cell(root)).or_default().push(root);
        }
        own
    }

    fn cell(&self, at: Vec3) -> IVec3 {
        (at / self.radius).floor().as_ivec3()
    }

    /// The median of the densities at some of `roots`; 0 if there are none.
    fn median_density(&self, roots: &[Vec3]) -> f32 {
        let every = roots.len().div_ceil(SAMPLES).max(1);
        let mut densities: Vec<f32> = roots.iter().step_by(every).map(|&root| self.density(root)).collect();
        densities.sort_unstable_by(f32::total_cmp);
        densities.get(densities.len() / 2).copied().unwrap_or(0.0)
    }

    /// The sum of (1 − d²/r²)² over all roots at distances d below the radius r.
    fn density(&self, at: Vec3) -> f32 {
        let middle = self.cell(at);
        let around = (0..27).map(|k| middle + IVec3::new(k % 3, k / 3 % 3, k / 9) - 1);
        let near = around.filter_map(|cell| self.cells.get(&cell)).flatten();
        let weight = |root: &Vec3| (1.0 - root.distance_squared(at) / (self.radius * self.radius)).max(0.0);
        near.map(|root| weight(root) * weight(root)).sum()
    }
}

/// How hair covers a body.
#[derive(Debug)]
pub(crate) struct Cover {
    /// The share of each vertex that is covered, 0 to 1.
    pub shares: Vec<f32>,
    /// The mean colour of the hair, linear RGB, if the groom has colours.
    pub colour: Option<Vec3>,
}

impl Cover {
    /// That of `vertices` by `groom`, metres in the same space.
    pub fn new(vertices: &[Vec3], groom: &Groom) -> Self {
        let colours = groom.colours.as_deref().filter(|colours| !colours.is_empty());
        let mean = |colours: &[[f32; 3]]| {
            let sum: DVec3 = colours.iter().map(|&colour| Vec3::from(colour).as_dvec3()).sum();
            (sum / colours.len() as f64).as_vec3()
        };
        Self { shares: shares(vertices, groom), colour: colours.map(mean) }
    }
}

fn shares(vertices: &[Vec3], groom: &Groom) -> Vec<f32> {
    let roots = groom.strands().filter_map(|strand| strand.first().copied());
    let roots: Vec<Vec3> = roots.filter(|root| root.is_finite()).collect();
    let mut radius = RADII[0];
    let (mut found, mut usual) = (Roots::new(&roots, radius), 0.0);
    while radius < RADII[1] && usual < ENOUGH {
        radius *= 1.3;
        found = Roots::new(&roots, radius);
        usual = found.median_density(&roots);
    }
    // A root is its own neighbour; single strands do not make a scalp.
    if usual < 2.0 {
        return vec![0.0; vertices.len()];
    }
    let share = |&at: &Vec3| {
        let t = ((found.density(at) / usual - EDGE[0]) / (EDGE[1] - EDGE[0])).clamp(0.0, 1.0);
        t * t * (3.0 - 2.0 * t)
    };
    // Not in parallel: this runs within parallel loops over pictures, which wait for the first one.
    vertices.iter().map(share).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use forelock_core::body::{Head, Region};
    use forelock_core::groom::grow::{GrowParams, grow_on_head};

    #[test]
    fn skin_is_covered_where_hair_grows() -> Result<(), Box<dyn std::error::Error>> {
        let head = Head::builtin();
        for strands in [300, 6000] {
            let groom = grow_on_head(&GrowParams { strands, ..GrowParams::preset("wavy")? })?;
            let cover = Cover::new(&head.mesh.positions, &groom).shares;
            let mean = |inside: bool| {
                let own = cover.iter().zip(head.weights(Region::Scalp));
                let own = own.filter(|(_, w)| if inside { **w > 0.95 } else { **w == 0.0 });
                let (sum, count) =
                    own.fold((0.0, 0.0), |(sum, count), (share, _)| (sum + share, count + 1.0));
                sum / count
            };
            assert!(mean(true) > 0.8, "{strands}: {}", mean(true));
            assert!(mean(false) < 0.02, "{strands}: {}", mean(false));
        }
        Ok(())
    }

    #[test]
    fn single_strands_and_none_cover_nothing() -> Result<(), Box<dyn std::error::Error>> {
        let strand = vec![vec![Vec3::ZERO, Vec3::Y]];
        let lonely = Groom::from_strands(&strand)?;
        assert_eq!(Cover::new(&[Vec3::ZERO], &lonely).shares, [0.0]);
        Ok(())
    }
}
