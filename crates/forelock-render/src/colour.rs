//! Colours: hair from melanin, the tone curve, and sRGB.
//!
//! # Theory
//! Hair is coloured by two pigments. The absorption of a fibre is σ = c_e (0.419, 0.697, 1.37) +
//! c_p (0.187, 0.4, 1.05) for concentrations c_e of eumelanin and c_p of pheomelanin (d'Eon et al.
//! 2011, *An energy-conserving hair reflectance model*). Hair made of such fibres has the albedo C
//! = exp(−D √σ), D = 5.89 at a roughness of 0.3 (Chiang et al. 2016, *A practical and controllable
//! hair and fur model*, eq. 9 solved for C). The absorption of a dye adds to it. Grey hair is a
//! mixture of hairs with pigment and hairs without.
//!
//! Light is summed in linear RGB. Exposure, tone curve and the sRGB transfer function are applied
//! last.

use glam::Vec3;

/// D of Chiang et al. 2016 at azimuthal roughness 0.3.
pub(crate) const ALBEDO_FROM_ABSORPTION: f32 = 5.89;

/// The colour of hair, as concentrations of melanin, with dye and white hairs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HairColour {
    /// Brown-black pigment: 0 none, 0.06 blonde, 0.3 chestnut, 0.8 dark brown, 2.4 black.
    pub eumelanin: f32,
    /// Yellow-red pigment: 0 none, 1 red.
    pub pheomelanin: f32,
    /// The share of hairs without pigment, 0–1.
    pub greying: f32,
    /// The albedo of hair without melanin that has this dye, linear RGB in 0–1; 1 is no dye.
    pub dye: Vec3,
}

impl Default for HairColour {
    fn default() -> Self {
        Self::DARK_BROWN
    }
}

impl HairColour {
    /// Black hair.
    pub const BLACK: Self = Self::natural(2.4, 0.1);
    /// Dark brown hair.
    pub const DARK_BROWN: Self = Self::natural(0.75, 0.25);
    /// Chestnut hair.
    pub const CHESTNUT: Self = Self::natural(0.32, 0.4);
    /// Blonde hair.
    pub const BLONDE: Self = Self::natural(0.045, 0.16);
    /// Red hair.
    pub const RED: Self = Self::natural(0.06, 1.1);
    /// Grey hair: dark brown, of which two in five hairs are white.
    pub const GREY: Self = Self { greying: 0.4, ..Self::DARK_BROWN };
    /// White hair.
    pub const WHITE: Self = Self::natural(0.008, 0.004);

    /// Hair with these pigments in all hairs, and without dye.
    #[must_use]
    pub const fn natural(eumelanin: f32, pheomelanin: f32) -> Self {
        Self { eumelanin, pheomelanin, greying: 0.0, dye: Vec3::ONE }
    }

    /// The names that [`by_name`](Self::by_name) accepts.
    pub const NAMES: [&'static str; 7] =
        ["black", "dark-brown", "chestnut", "blonde", "red", "grey", "white"];

    /// The preset with the name `name`, if there is one.
    pub fn by_name(name: &str) -> Option<Self> {
        let presets =
            [Self::BLACK, Self::DARK_BROWN, Self::CHESTNUT, Self::BLONDE, Self::RED, Self::GREY, Self::WHITE];
        Self::NAMES.iter().position(|&known| known == name).map(|i| presets[i])
    }

    /// The albedo of many such hairs, linear RGB in 0–1.
    pub fn albedo(&self) -> Vec3 {
        let [pigmented, white] = self.albedos();
        pigmented.lerp(white, self.greying.clamp(0.0, 1.0))
    }

    /// The albedo of hairs with pigment and of those without.
    pub(crate) fn albedos(&self) -> [Vec3; 2] {
        let dye = absorption(self.dye.clamp(Vec3::splat(1e-4), Vec3::ONE));
        [*self, Self::WHITE].map(|of| {
            let melanin = Vec3::new(0.419, 0.697, 1.37) * of.eumelanin.max(0.0)
                + Vec3::new(0.187, 0.4, 1.05) * of.pheomelanin.max(0.0);
            (melanin + dye).map(|sigma| (-ALBEDO_FROM_ABSORPTION * sigma.sqrt()).exp())
        })
    }
}

/// The absorption of the fibres, for each radius of path, of hair that has `albedo` where there is
/// much of it: the inverse of [`HairColour::albedo`].
pub(crate) fn absorption(albedo: Vec3) -> Vec3 {
    let root = albedo.map(f32::ln) / ALBEDO_FROM_ABSORPTION;
    root * root
}

/// Relative luminance of linear sRGB.
pub(crate) fn luminance(colour: Vec3) -> f32 {
    colour.dot(Vec3::new(0.2126, 0.7152, 0.0722))
}

/// The tone curve from scene-linear to display-linear. It keeps dark tones and compresses
/// highlights towards white. It acts on the largest channel, which preserves hue, and slightly
/// desaturates the brightest colours.
pub(crate) fn film_curve(colour: Vec3) -> Vec3 {
    const KNEE: f32 = 0.55;
    let peak = colour.max_element();
    if peak <= KNEE {
        return colour;
    }
    let room = 1.0 - KNEE;
    let shaped = 1.0 - room * room / (peak - KNEE + room);
    let kept = colour * (shaped / peak);
    kept.lerp(Vec3::splat(shaped), 1.0 - 1.0 / (0.12 * (peak - shaped) + 1.0))
}

/// The sRGB transfer function (IEC 61966-2-1) of a linear value.
pub(crate) fn srgb_encode(linear: f32) -> f32 {
    if linear <= 0.003_130_8 { linear * 12.92 } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// Linear RGB of an sRGB colour, whose channels are 0–1: the inverse of the transfer function.
#[must_use]
pub fn from_srgb(colour: Vec3) -> Vec3 {
    colour.map(|v| if v <= 0.040_45 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn more_melanin_is_darker_and_hair_is_warm() {
        let order = [HairColour::WHITE, HairColour::GREY, HairColour::CHESTNUT, HairColour::DARK_BROWN];
        for pair in order.windows(2) {
            assert!(luminance(pair[0].albedo()) > luminance(pair[1].albedo()));
        }
        let order = [HairColour::WHITE, HairColour::BLONDE, HairColour::CHESTNUT, HairColour::DARK_BROWN];
        for pair in order.windows(2) {
            assert!(luminance(pair[0].albedo()) > luminance(pair[1].albedo()));
        }
        for name in HairColour::NAMES {
            let c = HairColour::by_name(name).unwrap().albedo();
            assert!(c.x >= c.y && c.y >= c.z && c.max_element() < 1.0 && c.min_element() > 0.0);
        }
        assert!(HairColour::by_name("plaid").is_none());
    }

    #[test]
    fn white_hair_takes_a_dye_and_dark_hair_hardly_does() {
        let dye = Vec3::new(0.1, 0.3, 0.6);
        let dyed = |colour: HairColour| HairColour { dye, ..colour }.albedo();
        let white = dyed(HairColour { eumelanin: 0.0, pheomelanin: 0.0, ..HairColour::WHITE });
        assert!(white.distance(dye) < 1e-5, "{white}");
        let black = dyed(HairColour::BLACK);
        assert!(black.max_element() < 0.01 && black.distance(HairColour::BLACK.albedo()) < 0.005);
    }

    #[test]
    fn the_film_curve_rises_and_stays_below_white() {
        let mut last = -1.0;
        for i in 0..400 {
            let y = film_curve(Vec3::splat(i as f32 * 0.02)).x;
            assert!(y > last && y < 1.0);
            last = y;
        }
        assert_eq!(film_curve(Vec3::splat(0.3)), Vec3::splat(0.3));
        assert!((srgb_encode(1.0) - 1.0).abs() < 1e-6 && srgb_encode(0.0) == 0.0);
        assert!((srgb_encode(0.214_04) - 0.5).abs() < 1e-4);
        for v in [0.0, 0.01, 0.2, 0.7, 1.0] {
            assert!((srgb_encode(from_srgb(Vec3::splat(v)).x) - v).abs() < 1e-5);
        }
    }
}
