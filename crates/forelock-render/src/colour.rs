//! Colours: hair from melanin, the tone curve, and sRGB.
//!
//! # Theory
//! Hair is coloured by two pigments. The absorption of a fibre is σ = c_e (0.419, 0.697, 1.37) +
//! c_p (0.187, 0.4, 1.05) for concentrations c_e of eumelanin and c_p of pheomelanin (d'Eon et al.
//! 2011, *An energy-conserving hair reflectance model*). Hair made of such fibres has the albedo C
//! = exp(−D √σ), D = 5.89 at a roughness of 0.3 (Chiang et al. 2016, *A practical and controllable
//! hair and fur model*, eq. 9 solved for C).
//!
//! Light is summed in linear RGB. Exposure, tone curve and the sRGB transfer function are applied
//! last.

use glam::Vec3;

/// D of Chiang et al. 2016 at azimuthal roughness 0.3.
pub(crate) const ALBEDO_FROM_ABSORPTION: f32 = 5.89;

/// The colour of hair, as concentrations of melanin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HairColour {
    /// Brown-black pigment: 0 none, 0.06 blonde, 0.3 chestnut, 0.8 dark brown, 2.4 black.
    pub eumelanin: f32,
    /// Yellow-red pigment: 0 none, 1 red.
    pub pheomelanin: f32,
}

impl Default for HairColour {
    fn default() -> Self {
        Self::DARK_BROWN
    }
}

impl HairColour {
    /// Black hair.
    pub const BLACK: Self = Self { eumelanin: 2.4, pheomelanin: 0.1 };
    /// Dark brown hair.
    pub const DARK_BROWN: Self = Self { eumelanin: 0.75, pheomelanin: 0.25 };
    /// Chestnut hair.
    pub const CHESTNUT: Self = Self { eumelanin: 0.32, pheomelanin: 0.4 };
    /// Blonde hair.
    pub const BLONDE: Self = Self { eumelanin: 0.045, pheomelanin: 0.16 };
    /// Red hair.
    pub const RED: Self = Self { eumelanin: 0.06, pheomelanin: 1.1 };
    /// White hair.
    pub const WHITE: Self = Self { eumelanin: 0.008, pheomelanin: 0.004 };

    /// The names that [`by_name`](Self::by_name) accepts.
    pub const NAMES: [&'static str; 6] = ["black", "dark-brown", "chestnut", "blonde", "red", "white"];

    /// The preset with the name `name`, if there is one.
    pub fn by_name(name: &str) -> Option<Self> {
        let presets = [Self::BLACK, Self::DARK_BROWN, Self::CHESTNUT, Self::BLONDE, Self::RED, Self::WHITE];
        Self::NAMES.iter().position(|&known| known == name).map(|i| presets[i])
    }

    /// The albedo of many such hairs, linear RGB in 0–1.
    pub fn albedo(&self) -> Vec3 {
        let absorption = Vec3::new(0.419, 0.697, 1.37) * self.eumelanin.max(0.0)
            + Vec3::new(0.187, 0.4, 1.05) * self.pheomelanin.max(0.0);
        absorption.map(|sigma| (-ALBEDO_FROM_ABSORPTION * sigma.sqrt()).exp())
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn more_melanin_is_darker_and_hair_is_warm() {
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
    }
}
