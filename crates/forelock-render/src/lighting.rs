//! The light that reaches a point through bodies and hair.

use glam::Vec3;
use rayon::prelude::*;

use crate::drawable::strand_count;
use crate::fibre::Fibre;
use crate::hair::{Group, StrandPoint};
use crate::light::{Ambient, Light};
use crate::scene::Scene;
use crate::shadow_map::ShadowMap;
use crate::solids::{Solids, SurfacePoint};
use crate::volume::{Deposits, Grid, Layout, openness};

/// Fewest and most cells along the longest side of the grid for shadows: a quarter of the picture's
/// shorter side.
const SHADOW_CELLS: [u32; 2] = [48, 96];
/// Fewest and most texels along the side of a shadow map: the picture's shorter side.
const MAP_SIDES: [u32; 2] = [256, 768];
/// Cells along the longest side of the grid for ambient occlusion.
const OCCLUSION_CELLS: u32 = 40;
/// Strands that the grid for ambient occlusion is made of, and fewest and most of that for shadows:
/// as many as a sixteenth of the picture's pixels.
pub(crate) const OCCLUSION_STRANDS: usize = 4096;
const SHADOW_STRANDS: [usize; 2] = [OCCLUSION_STRANDS, 16_384];
/// The factor for the optical depth of strands in the light of bodies. It is below 1 because hair
/// scatters mostly forward.
pub(crate) const EXTINCTION: f32 = 0.6;
/// The optical depth of the surface of a body in the grid for ambient occlusion.
pub(crate) const SURFACE_DEPTH: f32 = 1.6;
/// How far light wraps around skin, for each channel. Red light penetrates deepest.
pub(crate) const WRAP: Vec3 = Vec3::new(0.30, 0.18, 0.14);

/// What light is computed on: the lights, and the places of shadow maps and grids.
pub(crate) struct Plan {
    /// Lights with unit directions, and their maps of bodies, which are empty.
    pub lights: Vec<(Light, Option<ShadowMap>)>,
    /// The grid of optical depths towards lights with shadows; there is none without hair.
    pub shadows: Option<Layout>,
    /// Strands that the grid for shadows is made of.
    pub shadow_strands: usize,
    /// The grid of the share of ambient light.
    pub openness: Option<Layout>,
}

impl Plan {
    /// The plan for a picture of `scene` of `size` pixels. `bodies` is the smallest box around the
    /// bodies, empty (min > max) if there is nothing of them.
    pub fn new(scene: &Scene<'_>, bodies: (Vec3, Vec3), groups: &[Group<'_>], size: [u32; 2]) -> Self {
        let short = size[0].min(size[1]);
        let cells = (short / 4).clamp(SHADOW_CELLS[0], SHADOW_CELLS[1]);
        let map_side = short.clamp(MAP_SIDES[0], MAP_SIDES[1]).next_multiple_of(8) as usize;
        let pixels = size[0] as usize * size[1] as usize;
        let (body_lo, body_hi) = bodies;
        let (hair_lo, hair_hi) = hair_bounds(groups);
        let (lo, hi) = (body_lo.min(hair_lo), body_hi.max(hair_hi));
        let anything = lo.is_finite() && hi.is_finite() && lo.cmple(hi).all();
        let has_hair = hair_lo.cmple(hair_hi).all();
        let has_body = body_lo.cmple(body_hi).all();
        // The grids cover the hair and the points close enough to be shaded by it.
        let margin = if has_hair { 0.2 * (hair_hi - hair_lo).length() } else { 0.0 };
        let (grid_lo, grid_hi) =
            if has_hair { ((hair_lo - margin).max(lo), (hair_hi + margin).min(hi)) } else { (lo, hi) };
        let lights = scene.lights.iter().map(|light| {
            let light = Light { direction: light.direction.normalize_or(Vec3::Y), ..*light };
            let map = (light.shadows && has_body).then(|| {
                let (centre, radius) = ((body_lo + body_hi) * 0.5, 0.5 * (body_hi - body_lo).length());
                ShadowMap::empty(light.direction, centre, radius, map_side)
            });
            (light, map)
        });
        Self {
            lights: lights.collect(),
            shadows: (has_hair && scene.lights.iter().any(|light| light.shadows))
                .then(|| Layout::covering(grid_lo, grid_hi, cells)),
            shadow_strands: (pixels / 16).clamp(SHADOW_STRANDS[0], SHADOW_STRANDS[1]),
            openness: anything.then(|| Layout::covering(grid_lo, grid_hi, OCCLUSION_CELLS)),
        }
    }
}

/// The lights of a scene with their shadows.
pub(crate) struct Lighting {
    lights: Vec<(Light, Option<ShadowMap>, Option<Grid>)>,
    ambient: Ambient,
    /// The share of ambient light that reaches a point.
    openness: Option<Grid>,
    eye: Vec3,
}

impl Lighting {
    /// The lights of `scene`, for a picture of `size` pixels.
    pub fn new(scene: &Scene<'_>, solids: &Solids<'_>, groups: &[Group<'_>], size: [u32; 2]) -> Self {
        let plan = Plan::new(scene, solids.bounds(), groups, size);
        let density = plan.shadows.map(|layout| {
            let deposits = Deposits::new(layout);
            deposit_hair(groups, &deposits, plan.shadow_strands);
            deposits.finish()
        });
        let openness = plan.openness.map(|layout| {
            let deposits = Deposits::new(layout);
            deposit_hair(groups, &deposits, OCCLUSION_STRANDS);
            deposit_solids(solids, &deposits);
            openness(&deposits.finish())
        });
        let lit = |(light, map): (Light, Option<ShadowMap>)| {
            let triangles = || (0..solids.triangles.len()).map(|t| solids.corners(t));
            let map = map.map(|map| map.of(triangles()));
            let depths = density.as_ref().filter(|_| light.shadows).map(|g| g.sweep(-light.direction));
            (light, map, depths)
        };
        let lights = plan.lights.into_par_iter().map(lit).collect();
        Self { lights, ambient: scene.ambient, openness, eye: scene.camera.eye }
    }

    /// The radiance of a point on a strand towards the eye.
    pub fn of_hair(&self, point: &StrandPoint) -> Vec3 {
        let to_eye = (self.eye - point.position).normalize_or(Vec3::Z);
        let open = self.openness.as_ref().map_or(1.0, |g| g.sample(point.position));
        let fibre = Fibre::new(point.tangent, to_eye, point.albedo, point.tilt, open);
        let mut radiance = Vec3::ZERO;
        for (light, map, depths) in &self.lights {
            let out = |map: &ShadowMap| point.position + light.direction * (4.0 * map.texel());
            let lit = map.as_ref().map_or(1.0, |map| map.visibility(out(map), 0));
            if lit > 0.0 {
                let depth = depths.as_ref().map_or(0.0, |g| g.sample(point.position));
                radiance +=
                    light.colour * fibre.scatter(light.direction, depth) * (lit * std::f32::consts::PI);
            }
        }
        // Ambient light reaches the side that faces the eye and the upper side.
        let facing =
            (to_eye - point.tangent * point.tangent.dot(to_eye) + Vec3::Y * 0.5).normalize_or(Vec3::Y);
        radiance + self.ambient.at(facing) * fibre.ambient(open)
    }

    /// The radiance of a point on a body towards the eye.
    pub fn of_body(&self, point: &SurfacePoint) -> Vec3 {
        let SurfacePoint { position, normal, albedo, polish } = *point;
        let to_eye = (self.eye - position).normalize_or(Vec3::Z);
        let (mut diffuse, mut gloss) = (Vec3::ZERO, Vec3::ZERO);
        for (light, map, depths) in &self.lights {
            let cos = normal.dot(light.direction);
            // Light wraps around skin where the surface turns away, but not where another surface
            // is in between.
            let wrapped = (Vec3::splat(cos) + WRAP).max(Vec3::ZERO) / (Vec3::ONE + WRAP);
            if wrapped == Vec3::ZERO {
                continue;
            }
            let out = |map: &ShadowMap| position + (normal * 2.5 + light.direction * 2.0) * map.texel();
            let lit = map.as_ref().map_or(1.0, |map| map.visibility(out(map), 2));
            let depth = depths.as_ref().map_or(0.0, |g| g.sample(position)) * EXTINCTION;
            let arriving = light.colour * (lit * (-depth).exp());
            diffuse += arriving * wrapped * wrapped;
            let half = (light.direction + to_eye).normalize_or(normal);
            let m = 1.0 - to_eye.dot(half).clamp(0.0, 1.0);
            let fresnel = 0.028 + 0.972 * (m * m) * (m * m) * m;
            // Normalised (Akenine-Möller et al., Real-Time Rendering, 4th ed., Sec. 9.8).
            let lobe = normal.dot(half).max(0.0).powf(polish) * (0.125 * (polish + 2.0));
            gloss += arriving * (lobe * fresnel * cos.max(0.0));
        }
        let open = self.openness.as_ref().map_or(1.0, |g| {
            // Sample outside the cells that contain the surface.
            let open = g.sample(position + normal * (1.6 * g.layout.cell));
            (open * 1.5).min(1.0)
        });
        albedo * (diffuse + self.ambient.at(normal) * open) + gloss
    }
}

fn hair_bounds(groups: &[Group<'_>]) -> (Vec3, Vec3) {
    let all = groups.iter().map(|group| group.bounds);
    all.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(lo, hi), own| (lo.min(own.0), hi.max(own.1)))
}

/// Of the strands of a group about `most` evenly chosen ones: their distance in the list, how many
/// they are, and for how many each stands.
pub(crate) fn chosen_of(group: &Group<'_>, most: usize) -> (usize, usize, f32) {
    let count = strand_count(&group.strands);
    let every = (count / most).max(1);
    let chosen = count.div_ceil(every);
    (every, chosen, count as f32 / chosen.max(1) as f32)
}

/// Adds the area of all strands, children included, as seen from the side: of about `most` evenly
/// chosen ones, each as often as there are others like it.
fn deposit_hair(groups: &[Group<'_>], deposits: &Deposits, most: usize) {
    let cell = deposits.layout.cell;
    for group in groups {
        let (every, chosen, weight) = chosen_of(group, most);
        (0..chosen.div_ceil(256)).into_par_iter().for_each(|block| {
            let range = block * 256..((block + 1) * 256).min(chosen);
            let strands = range.flat_map(|k| group.drawable(k * every..k * every + 1));
            for (_, particles) in strands {
                let points = &group.strands.positions[particles.clone()];
                let last = (points.len() - 1) as f32;
                for (i, edge) in points.windows(2).enumerate() {
                    let at = i as f32 + 0.5;
                    let length = edge[0].distance(edge[1]);
                    let width = weight * group.width(particles.start, at, at / last) * group.children as f32;
                    let steps = (length / (1.5 * cell)).ceil().clamp(1.0, 64.0);
                    for step in 0..steps as u32 {
                        let point = edge[0].lerp(edge[1], (step as f32 + 0.5) / steps);
                        deposits.add(point, length * width / steps);
                    }
                }
            }
        });
    }
}

/// Adds the surfaces of bodies, opaque from both sides.
fn deposit_solids(solids: &Solids<'_>, deposits: &Deposits) {
    let cell = deposits.layout.cell;
    (0..solids.triangles.len()).into_par_iter().for_each(|triangle| {
        let [a, b, c] = solids.corners(triangle);
        let area = 0.5 * (b - a).cross(c - a).length();
        let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
        let rows = (longest / cell).ceil().clamp(1.0, 64.0) as u32;
        // The centres of rows² equal triangles: the upright ones first, then the inverted ones
        // between them.
        let share = SURFACE_DEPTH * area / (rows * rows) as f32;
        for i in 0..rows {
            for j in 0..rows - i {
                let place = |third: f32| {
                    let (u, v) = ((i as f32 + third) / rows as f32, (j as f32 + third) / rows as f32);
                    a + (b - a) * u + (c - a) * v
                };
                deposits.add(place(1.0 / 3.0), share);
                if i + j + 1 < rows {
                    deposits.add(place(2.0 / 3.0), share);
                }
            }
        }
    });
}
