//! The light scattering of hair: by a single fibre, and by all that surround it.
//!
//! # Theory
//! A hair is a rough, tinted cylinder with tilted scales (Marschner et al. 2003, *Light scattering
//! from human hair fibers*). Light leaves it along three paths p, each with the scattering function
//! S_p = M_p(θ_i, θ_r) N_p(θ_d, φ):
//!
//! - R is reflected by the surface: a white highlight, shifted towards the root.
//! - TT is transmitted through the fibre: it is visible against the light.
//! - TRT is reflected inside the fibre: a second, tinted highlight, shifted towards the tip.
//!
//! M_p is a Gaussian of sin θ_i + sin θ_r with mean α_p (the shift) and deviation β_p. N_p are
//! closed-form fits of the azimuthal integrals, in the form of Karis 2016, *Physically based hair
//! shading in Unreal* (SIGGRAPH course), and Pekelis et al. 2015, *A data-driven light scattering
//! model for hair* (Pixar). A path of length x in the fibre, in radii, absorbs exp(−σ x); σ follows
//! from the albedo C of much hair as (ln C / 5.89)² ([`crate::colour`]).
//!
//! Light that several hairs scatter is that of dual scattering (Zinke et al. 2008, *Dual scattering
//! approximation for fast multiple scattering in hair*). A fibre scatters the share a_f of the
//! light forward and a_b backward, per channel. At a point that τ strands hide from the light on
//! average:
//!
//! - exp(−τ) of the light comes straight. The rest met n ≥ 1 strands, each of which passed a_f of
//!   it on; n is distributed as Poisson's law says, so exp(−τ (1 − a_f)) − exp(−τ) of the light
//!   arrives, spread lengthwise by the variance τ β².
//! - Of both, the hair behind the point sends A_b back.
//!   Where the paper adds the paths with one and three turns, all paths are taken:
//!   a pile of many layers that pass a_f on and send a_b back reflects R = 2 a_b / (s + √(s² − 4
//!   a_b²)), s = 1 + a_b² − a_f² (Stokes 1862, *On the intensity of the light reflected from or
//!   transmitted through a pile of plates*), of which A_b = R − a_b comes from behind the first. R
//!   is close to C, which comes from a fit to traced paths. Thin hair lets light through instead:
//!   of the hair behind a point, whose depth follows from the share of ambient light that arrives,
//!   1 − exp(−depth (1 − a_f)) counts.
//! - What comes back has the deviation (1 + d a_f²) √(2 β² + β_b²), β_b = 1.5 β for R and TRT
//!   together, without the paper's terms of a_b³; the luminance of a_f² stands for its channels.
//! - Both are multiplied by d = 0.7 for hair that does not fill all directions.
//!
//! Around the fibre, light spreads as 1 ± cos φ instead of evenly over a half circle, whose ends
//! would show.
//!
//! # Practice
//! The code uses sines and cosines of angles only. a_f and a_b are closed forms in cos θ_d, fitted
//! to the integrals of N_p.

use glam::Vec3;

use crate::colour::{absorption, luminance};

/// Tilt of the cuticle's scales, radians.
pub(crate) const SCALE_TILT: f32 = 0.045;
/// Longitudinal roughness β of the R and TT paths. TRT has twice this value.
pub(crate) const ROUGHNESS: f32 = 0.16;
/// Reflectance at normal incidence for an index of refraction of 1.55.
pub(crate) const FRESNEL_0: f32 = 0.0465;
/// The share of the light across a fibre that its surface reflects backward.
pub(crate) const REFLECTED: f32 = 0.033;
/// The share of the directions that hair around a fibre fills (Zinke et al. 2008, d_f and d_b).
pub(crate) const HAIR_DENSITY: f32 = 0.7;
/// Mean paths of TT and TRT in a fibre across which light comes, radii.
pub(crate) const PATHS: [f32; 2] = [1.95, 3.4];

/// A point on a hair, prepared for lighting.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Fibre {
    /// Unit tangent, root to tip.
    pub tangent: Vec3,
    /// Unit vector towards the eye.
    pub to_eye: Vec3,
    /// The albedo of much such hair, linear RGB.
    albedo: Vec3,
    /// Absorption σ of the fibre for each radius of path.
    absorption: Vec3,
    /// Tilt of the cuticle's scales, radians.
    tilt: f32,
    /// The number of strands that hide the surroundings on the side of the point that is hidden.
    behind: f32,
}

fn gaussian(x: f32, variance: f32) -> f32 {
    (-0.5 * x * x / variance).exp() / (variance.sqrt() * 2.506_628_3)
}

fn fresnel(cos: f32) -> f32 {
    let m = (1.0 - cos).clamp(0.0, 1.0);
    FRESNEL_0 + (1.0 - FRESNEL_0) * (m * m) * (m * m) * m
}

/// The angles between light, fibre and eye.
#[derive(Clone, Copy, Debug)]
struct Angles {
    /// sin θ_i + sin θ_r.
    sum: f32,
    /// cos θ_d, of half the difference between θ_i and θ_r.
    cos_d: f32,
    /// cos θ_t, of the inclination of the light in the fibre.
    cos_t: f32,
    /// cos φ, of the azimuth between light and eye.
    cos_phi: f32,
    /// The cosine between light and eye.
    cos_eye: f32,
}

impl Fibre {
    /// A hair with the unit `tangent`, root to tip, seen from the unit direction `to_eye`. `albedo`
    /// is linear RGB in (0, 1). `tilt` radians are added to the tilt of the scales. `openness` is
    /// the share of ambient light that reaches the point.
    pub fn new(tangent: Vec3, to_eye: Vec3, albedo: Vec3, tilt: f32, openness: f32) -> Self {
        let albedo = albedo.clamp(Vec3::splat(1e-4), Vec3::ONE);
        // At the surface of hair all light from half of the directions arrives.
        let behind = -(2.0 * openness - 1.0).clamp(1e-12, 1.0).ln();
        Self { tangent, to_eye, albedo, absorption: absorption(albedo), tilt: SCALE_TILT + tilt, behind }
    }

    /// The share of ambient light that is scattered towards the eye, times π, where `openness` of
    /// that light arrives straight. What other hairs pass on adds to it.
    pub fn ambient(&self, openness: f32) -> Vec3 {
        let [forward, _] = self.scattered(1.0, 1.0);
        let log = openness.clamp(1e-3, 1.0).ln();
        (self.albedo * (1.0 - REFLECTED) + REFLECTED) * ((Vec3::ONE - forward) * log).map(f32::exp)
    }

    /// The radiance towards the eye for unit radiance from `to_light`, which `depth` strands hide
    /// from the light on average.
    pub fn scatter(&self, to_light: Vec3, depth: f32) -> Vec3 {
        let (angles, cos_l) = self.angles(to_light);
        let [forward, backward] = self.scattered(angles.cos_d, angles.cos_t);
        // What comes back from the hair behind, and how far it has spread.
        let hidden = Vec3::ONE - ((forward - 1.0) * self.behind).map(f32::exp);
        let back = from_behind(forward, backward) * hidden * HAIR_DENSITY;
        let deviation = (1.0 + HAIR_DENSITY * luminance(forward * forward)) * (2.06 * ROUGHNESS);
        let spread = depth * ROUGHNESS * ROUGHNESS;
        let (spread_on, spread_back) = (around(-angles.cos_phi), around(angles.cos_phi));

        let straight = (-depth).exp();
        let passed = ((forward - 1.0) * depth).map(f32::exp) - straight;
        let narrow = ROUGHNESS * ROUGHNESS + spread;
        let wide = deviation * deviation;
        let single = self.single(angles) + back * (spread_back * gaussian(angles.sum, wide));
        let many = (forward * spread_on + backward * spread_back) * gaussian(angles.sum, narrow)
            + back * (spread_back * gaussian(angles.sum, wide + spread));
        (single * straight + passed * many * HAIR_DENSITY) * cos_l
    }

    /// The angles to light from `to_light`, and the cosine of its inclination.
    fn angles(&self, to_light: Vec3) -> (Angles, f32) {
        let (t, l, v) = (self.tangent, to_light, self.to_eye);
        let (sin_l, sin_v) = (t.dot(l), t.dot(v));
        let (cos_l, cos_v) = ((1.0 - sin_l * sin_l).max(0.0).sqrt(), (1.0 - sin_v * sin_v).max(0.0).sqrt());
        let cos_d2 = (0.5 + 0.5 * (cos_l * cos_v + sin_l * sin_v)).max(1e-4);
        let angles = Angles {
            sum: sin_l + sin_v,
            cos_d: cos_d2.sqrt(),
            cos_t: (1.0 - (1.0 - cos_d2) * (1.0 / (1.55 * 1.55))).sqrt(),
            cos_phi: (l - t * sin_l).dot(v - t * sin_v) / (cos_l * cos_v).max(1e-4),
            cos_eye: v.dot(l),
        };
        (angles, cos_l)
    }

    /// The shares of the light that the fibre scatters forward and backward.
    fn scattered(&self, cos_d: f32, cos_t: f32) -> [Vec3; 2] {
        let m = 1.0 - cos_d;
        let m4 = (m * m) * (m * m);
        let f = fresnel(0.5 * cos_d);
        let [tt, trt] = PATHS.map(|path| (self.absorption * (-path / cos_t)).map(f32::exp));
        let forward = 0.037 + m * (0.055 + 0.2 * m * m) + tt * (0.875 - 1.226 * m4).max(0.0);
        let backward = REFLECTED + 0.55 * m4 + trt * (0.757 * f * (1.0 - f) * (1.0 - f));
        [forward, backward]
    }

    /// The scattering function of the fibre alone.
    fn single(&self, angles: Angles) -> Vec3 {
        let Angles { sum, cos_d, cos_t, cos_phi, cos_eye } = angles;
        let variance = ROUGHNESS * ROUGHNESS;
        let cos_half = (0.5 + 0.5 * cos_phi).max(0.0).sqrt();
        let passed = |path: f32| (self.absorption * (-path / cos_t)).map(f32::exp);

        let m_r = gaussian(sum + 2.0 * self.tilt, variance);
        let r = m_r * 0.25 * cos_half * fresnel((0.5 + 0.5 * cos_eye).max(0.0).sqrt());

        let m_tt = gaussian(sum - self.tilt, variance);
        let index = 1.19 / cos_d + 0.36 * cos_d;
        let h = cos_half * (1.0 + (0.6 - 0.8 * cos_phi) / index);
        let f = fresnel(cos_d * (1.0 - h * h).max(0.0).sqrt());
        let path = 2.0 * (1.0 - (h / index) * (h / index)).max(0.0).sqrt();
        let tt = passed(path) * (m_tt * (1.0 - f) * (1.0 - f) * (-3.65 * cos_phi - 3.98).exp());

        let m_trt = gaussian(sum - 4.0 * self.tilt, 4.0 * variance);
        let f = fresnel(0.5 * cos_d);
        let trt = passed(PATHS[1]) * (m_trt * (1.0 - f) * (1.0 - f) * f * (17.0 * cos_phi - 16.78).exp());
        Vec3::splat(r) + tt + trt
    }
}

/// The share of light that comes back from behind a fibre, of layers of fibres that scatter the
/// shares `forward` and `backward`.
fn from_behind(forward: Vec3, backward: Vec3) -> Vec3 {
    let s = 1.0 + backward * backward - forward * forward;
    let root = (s * s - 4.0 * backward * backward).max(Vec3::ZERO).map(f32::sqrt);
    2.0 * backward / (s + root) - backward
}

/// The distribution of spread light around a fibre; its integral over φ is 1.
fn around(cos_phi: f32) -> f32 {
    (1.0 + cos_phi) * (0.5 * std::f32::consts::FRAC_1_PI)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::colour::HairColour;

    fn fibre(albedo: Vec3) -> Fibre {
        Fibre::new(Vec3::X, Vec3::Z, albedo, 0.0, 0.5)
    }

    /// Light at the longitudinal angle `theta`, in the plane of the fibre and the eye.
    fn along(theta: f32) -> Vec3 {
        Vec3::new(theta.sin(), 0.0, theta.cos())
    }

    #[test]
    fn the_white_band_lies_towards_the_root_and_the_tinted_one_towards_the_tip() {
        let f = fibre(Vec3::new(0.3, 0.1, 0.03));
        // Light that leans towards the tip reaches the eye from points nearer to the root, and vice
        // versa.
        let (root, tip) = (f.scatter(along(-0.1), 0.0), f.scatter(along(0.25), 0.0));
        assert!(luminance(root) > luminance(tip));
        assert!(root.x / root.z < tip.x / tip.z);
    }

    #[test]
    fn depth_darkens_and_warms() {
        let f = fibre(Vec3::new(0.3, 0.15, 0.06));
        let (open, deep) = (f.scatter(along(0.4), 0.0), f.scatter(along(0.4), 2.0));
        assert!(luminance(deep) < 0.5 * luminance(open));
        assert!(deep.x / deep.z > open.x / open.z);
    }

    /// `f` integrated over all directions, or those with a positive cosine to `half`.
    fn integral(half: Option<Vec3>, f: impl Fn(Vec3) -> Vec3) -> Vec3 {
        let n = 300;
        let mut sum = Vec3::ZERO;
        for i in 0..n {
            let x = (i as f32 + 0.5) / n as f32 * 2.0 - 1.0;
            for j in 0..n {
                let (s, c) = ((j as f32 + 0.5) / n as f32 * std::f32::consts::TAU).sin_cos();
                let rim = (1.0 - x * x).sqrt();
                let direction = Vec3::new(x, rim * s, rim * c);
                if half.is_none_or(|half| half.dot(direction) > 0.0) {
                    sum += f(direction);
                }
            }
        }
        sum * (4.0 * std::f32::consts::PI / (n * n) as f32)
    }

    #[test]
    fn the_shares_are_the_integrals_of_the_scattering_function() {
        for albedo in [Vec3::ONE, HairColour::BLONDE.albedo(), HairColour::DARK_BROWN.albedo()] {
            for angle in [0.0, 0.3, 0.6_f32] {
                let (sin, cos) = angle.sin_cos();
                let light = Vec3::new(-sin, 0.0, cos);
                let part = |half: Vec3| {
                    let mirrored = Fibre { tilt: 0.0, ..fibre(albedo) };
                    integral(Some(half), |to_eye| {
                        let fibre = Fibre { to_eye, ..mirrored };
                        fibre.single(fibre.angles(light).0)
                    })
                };
                let [forward, backward] =
                    fibre(albedo).scattered(cos, (1.0 - sin * sin / (1.55 * 1.55)).sqrt());
                for (share, half) in [(forward, Vec3::NEG_Z), (backward, Vec3::Z)] {
                    let exact = part(half);
                    let off = (share - exact).abs().max_element();
                    assert!(off < 0.03, "{albedo} {angle} {half}: {share} {exact}");
                }
            }
        }
    }

    #[test]
    fn much_hair_has_its_albedo() {
        for name in HairColour::NAMES {
            let albedo = HairColour::by_name(name).map_or(Vec3::ZERO, |colour| colour.albedo());
            let [forward, backward] = fibre(albedo).scattered(1.0, 1.0);
            // The white reflection at the surface is not part of the colour.
            let reflected = from_behind(forward, backward) + backward - REFLECTED;
            let off = (reflected - albedo).abs() - 0.25 * albedo;
            assert!(off.max_element() < 0.01, "{name}: {reflected} {albedo}");
        }
    }

    #[test]
    fn no_more_light_leaves_than_comes() {
        // In a white furnace: a lone white fibre, and one at the surface of much hair, whose other
        // side many hairs hide.
        for tilt in [0.0, 0.3, 0.6_f32] {
            let to_eye = Vec3::new(tilt.sin(), 0.0, tilt.cos());
            let lone = Fibre::new(Vec3::X, to_eye, Vec3::ONE, 0.0, 1.0);
            let total = integral(None, |light| lone.scatter(light, 0.0)).x;
            assert!(total > 0.7 && total <= 1.01, "{tilt}: {total}");
            for depth in [0.25, 0.5, 1.0, 2.0, 4.0, 30.0_f32] {
                let openness = 0.5 + 0.5 * (-1.5 * depth).exp();
                let dense = Fibre::new(Vec3::X, to_eye, Vec3::ONE, 0.0, openness);
                let hidden = |light: Vec3| if light.dot(to_eye) > 0.0 { 0.0 } else { depth };
                let total = integral(None, |light| dense.scatter(light, hidden(light))).x;
                assert!(total > 0.3 && total <= 1.0, "{tilt} {depth}: {total}");
            }
        }
    }
}
