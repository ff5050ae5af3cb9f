//! How a single hair scatters light.
//!
//! # Theory
//! A hair is a rough, tinted, tilted-scaled cylinder (Marschner et al. 2003, *Light scattering from human hair fibers*). Light
//! leaves it along three paths p, each S_p = M_p(θ_i, θ_r) N_p(θ_d, φ): R mirrors off the surface, a white band shifted towards
//! the root; TT passes through, seen against the light; TRT is mirrored inside, a second, tinted band shifted towards the tip.
//! M_p is a Gaussian of sin θ_i + sin θ_r about the shift α_p with deviation β_p, and N_p closed fits of the azimuthal integrals,
//! in the form of Karis 2016, *Physically based hair shading in Unreal* (SIGGRAPH course), and Pekelis et al. 2015,
//! *A data-driven light scattering model for hair* (Pixar).
//! Light that many hairs have passed on is a soft, saturated remainder, here a wrapped cosine about the normal that faces the
//! eye, with the albedo's root as its tint.
//!
//! # Practice
//! Angles come as sines and cosines only; absorption enters as powers of the albedo, one `exp` a channel.

use glam::Vec3;

use crate::colour::luminance;

/// Tilt of the cuticle's scales, radians.
const SCALE_TILT: f32 = 0.045;
/// Longitudinal roughness β of the R path; TT has the same, TRT twice of it.
const ROUGHNESS: f32 = 0.16;
/// The remainder's tint is this power of the albedo.
const REMAINDER_POWER: f32 = 0.7;
/// Index of refraction 1.55: mirrored share at normal incidence.
const FRESNEL_0: f32 = 0.0465;

/// One point of one hair, ready to be lit.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Fibre {
    /// Unit tangent, root to tip.
    pub tangent: Vec3,
    /// Unit vector to the eye.
    pub to_eye: Vec3,
    /// Logarithm of the albedo, linear RGB.
    log_albedo: Vec3,
    /// What light that many hairs passed on is multiplied with.
    tint: Vec3,
    /// How fast depth takes each channel of it.
    fading: Vec3,
    /// Tilt of the cuticle's scales, radians.
    tilt: f32,
}

fn gaussian(x: f32, deviation: f32) -> f32 {
    (-0.5 * x * x / (deviation * deviation)).exp() / (deviation * 2.506_628_3)
}

fn fresnel(cos: f32) -> f32 {
    let m = (1.0 - cos).clamp(0.0, 1.0);
    FRESNEL_0 + (1.0 - FRESNEL_0) * (m * m) * (m * m) * m
}

impl Fibre {
    /// A hair of unit `tangent`, root to tip, seen from the unit direction `to_eye`, with `albedo` in linear RGB in (0, 1) and
    /// `tilt` radians added to the tilt of its scales.
    pub fn new(tangent: Vec3, to_eye: Vec3, albedo: Vec3, tilt: f32) -> Self {
        let albedo = albedo.max(Vec3::splat(1e-4));
        let log_albedo = albedo.map(f32::ln);
        let tint = (log_albedo * REMAINDER_POWER).map(f32::exp);
        let fading = 0.75 - 0.12 * (albedo / luminance(albedo)).min(Vec3::splat(2.0));
        Self { tangent, to_eye, log_albedo, tint, fading, tilt: SCALE_TILT + tilt }
    }

    /// The share of light from all around that leaves towards the eye, times π.
    pub fn ambient(&self) -> Vec3 {
        self.tint * 0.6
    }

    /// Radiance towards the eye for unit radiance from `to_light` that has crossed the optical depth `depth` of
    /// other hair: what the depth lets through is scattered once, the rest softens into the diffuse remainder.
    pub fn scatter(&self, to_light: Vec3, depth: f32) -> Vec3 {
        let (t, l, v) = (self.tangent, to_light, self.to_eye);
        let (sin_l, sin_v) = (t.dot(l), t.dot(v));
        let (cos_l, cos_v) = ((1.0 - sin_l * sin_l).max(0.0).sqrt(), (1.0 - sin_v * sin_v).max(0.0).sqrt());
        let cos_d = (0.5 + 0.5 * (cos_l * cos_v + sin_l * sin_v)).max(1e-4).sqrt();
        let (l_flat, v_flat) = (l - t * sin_l, v - t * sin_v);
        let cos_phi = l_flat.dot(v_flat) / (cos_l * cos_v).max(1e-4);
        let cos_half = (0.5 + 0.5 * cos_phi).max(0.0).sqrt();

        let tinted = |power: f32| (self.log_albedo * power).map(f32::exp);
        let (sum, tilt) = (sin_l + sin_v, self.tilt);

        let m_r = gaussian(sum + 2.0 * tilt, ROUGHNESS);
        let r = m_r * 0.25 * cos_half * fresnel((0.5 + 0.5 * v.dot(l)).max(0.0).sqrt());

        let m_tt = gaussian(sum - tilt, ROUGHNESS);
        let index = 1.19 / cos_d + 0.36 * cos_d;
        let h = cos_half * (1.0 + (0.6 - 0.8 * cos_phi) / index);
        let f = fresnel(cos_d * (1.0 - h * h).max(0.0).sqrt());
        let through = 0.5 * (1.0 - (h / index) * (h / index)).max(0.0).sqrt() / cos_d;
        let tt = tinted(through) * (m_tt * (1.0 - f) * (1.0 - f) * (-3.65 * cos_phi - 3.98).exp());

        let m_trt = gaussian(sum - 4.0 * tilt, 2.0 * ROUGHNESS);
        let f = fresnel(0.5 * cos_d);
        let trt = tinted(0.8 / cos_d) * (m_trt * (1.0 - f) * (1.0 - f) * f * (17.0 * cos_phi - 16.78).exp());

        let direct = (-depth).exp();
        (Vec3::splat(r) + tt + trt) * (direct * cos_l) + self.remainder(l, v - t * sin_v, depth)
    }

    /// Light passed on by many hairs: what depth takes from it, it takes less from the channels that hair lets pass.
    fn remainder(&self, to_light: Vec3, facing: Vec3, depth: f32) -> Vec3 {
        let normal = facing.normalize_or(self.to_eye);
        let wrapped = 0.25 * (1.0 + normal.dot(to_light));
        let passed = (self.fading * -depth).map(f32::exp);
        self.tint * passed * (wrapped * std::f32::consts::FRAC_1_PI)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fibre(albedo: Vec3) -> Fibre {
        Fibre::new(Vec3::X, Vec3::Z, albedo, 0.0)
    }

    /// Light from an angle `theta` along the fibre, in the eye's plane.
    fn along(theta: f32) -> Vec3 {
        Vec3::new(theta.sin(), 0.0, theta.cos())
    }

    #[test]
    fn the_white_band_lies_towards_the_root_and_the_tinted_one_towards_the_tip() {
        let f = fibre(Vec3::new(0.3, 0.1, 0.03));
        // A light that leans to the tip reaches the eye from points nearer the root, and the other way round.
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

    #[test]
    fn no_more_light_leaves_than_comes() {
        // ∫ S dω over the sphere of lights, white hair: at most the share of one fibre's cross-section.
        let f = fibre(Vec3::ONE);
        let (n, mut sum) = (200, 0.0);
        for i in 0..n {
            let z = (i as f32 + 0.5) / n as f32 * 2.0 - 1.0;
            for j in 0..n {
                let (s, c) = ((j as f32 + 0.5) / n as f32 * std::f32::consts::TAU).sin_cos();
                let rim = (1.0 - z * z).sqrt();
                sum += f.scatter(Vec3::new(rim * c, rim * s, z), 0.0).y;
            }
        }
        let total = sum * 4.0 * std::f32::consts::PI / (n * n) as f32;
        assert!(total > 0.5 && total < 2.0, "{total}");
    }
}
