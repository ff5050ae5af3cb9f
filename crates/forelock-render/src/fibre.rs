//! The light scattering of a single hair.
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
//! model for hair* (Pixar). Light scattered by many hairs is modelled as a soft, saturated diffuse
//! term: a wrapped cosine about the normal that faces the eye, tinted by a power of the albedo.
//!
//! # Practice
//! The code uses sines and cosines of angles only. Absorption is a power of the albedo, with one
//! `exp` per channel.

use glam::Vec3;

use crate::colour::luminance;

/// Tilt of the cuticle's scales, radians.
pub(crate) const SCALE_TILT: f32 = 0.045;
/// Longitudinal roughness β of the R and TT paths. TRT has twice this value.
pub(crate) const ROUGHNESS: f32 = 0.16;
/// The exponent of the albedo that gives the tint of the diffuse term.
pub(crate) const REMAINDER_POWER: f32 = 0.7;
/// Reflectance at normal incidence for an index of refraction of 1.55.
pub(crate) const FRESNEL_0: f32 = 0.0465;

/// A point on a hair, prepared for lighting.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Fibre {
    /// Unit tangent, root to tip.
    pub tangent: Vec3,
    /// Unit vector towards the eye.
    pub to_eye: Vec3,
    /// Logarithm of the albedo, linear RGB.
    log_albedo: Vec3,
    /// The tint of light that many hairs have scattered.
    tint: Vec3,
    /// The rate at which optical depth attenuates each channel of that light.
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
    /// A hair with the unit `tangent`, root to tip, seen from the unit direction `to_eye`. `albedo`
    /// is linear RGB in (0, 1). `tilt` radians are added to the tilt of the scales.
    pub fn new(tangent: Vec3, to_eye: Vec3, albedo: Vec3, tilt: f32) -> Self {
        let albedo = albedo.max(Vec3::splat(1e-4));
        let log_albedo = albedo.map(f32::ln);
        let tint = (log_albedo * REMAINDER_POWER).map(f32::exp);
        let fading = 0.75 - 0.12 * (albedo / luminance(albedo)).min(Vec3::splat(2.0));
        Self { tangent, to_eye, log_albedo, tint, fading, tilt: SCALE_TILT + tilt }
    }

    /// The share of ambient light that is scattered towards the eye, times π.
    pub fn ambient(&self) -> Vec3 {
        self.tint * 0.6
    }

    /// The radiance towards the eye for unit radiance from `to_light` that has crossed the optical
    /// depth `depth` of other hair. The transmitted part is scattered once by this hair; the rest
    /// adds to the diffuse term.
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

    /// Light scattered by many hairs. Optical depth attenuates it least in the channels that hair
    /// absorbs least.
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

    #[test]
    fn no_more_light_leaves_than_comes() {
        // ∫ S dω over all light directions, for white hair. It must not exceed the cross-section of
        // a fibre.
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
