//! `[hair]`: how hair looks in pictures.

use forelock_render::{HairColour, from_srgb};
use glam::Vec3;
use serde::{Deserialize, Serialize};

forelock_core::documented! {
/// `[hair]`: how the hair looks in pictures.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct HairSection {
    /// Colour: black, dark-brown, chestnut, blonde, red, grey or white. Default "dark-brown".
    pub colour: String,
    /// Share of the hairs that are white. A groom with colours of its own has neither white hairs
    /// nor dye. No unit, default that of `colour`: 0.4 of grey hair and
    /// else 0, range 0 to 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub greying: Option<f64>,
    /// Colour that white hair takes by a dye: red, green and blue, as on a screen. On other hair it
    /// adds to the colour. No unit, default no dye, range 0 to 1 each.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dye: Option<[f64; 3]>,
    /// Width of a drawn strand. Unit m, default 0, range 0 to 0.01; 0 chooses one by the number of
    /// strands.
    pub width: f64,
    /// Colour of the body beneath: "clay", or that of a hide with hair of a colour, named as for
    /// `colour`. Default "clay".
    pub body_colour: String,
}
}

/// Name of the body's colour that is not one of hair.
pub(super) const CLAY: &str = "clay";

impl Default for HairSection {
    fn default() -> Self {
        let (colour, body_colour) = ("dark-brown".to_owned(), CLAY.to_owned());
        Self { colour, greying: None, dye: None, width: 0.0, body_colour }
    }
}

impl HairSection {
    /// The colour of the hair. A name that is not known is dark brown.
    pub(crate) fn hair_colour(&self) -> HairColour {
        let named = HairColour::by_name(&self.colour).unwrap_or_default();
        HairColour {
            greying: self.greying.map_or(named.greying, |share| share as f32),
            dye: self.dye.map_or(named.dye, |dye| from_srgb(Vec3::from(dye.map(|part| part as f32)))),
            ..named
        }
    }
}
