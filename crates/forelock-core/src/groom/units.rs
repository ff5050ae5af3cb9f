//! Conversion of the units and axes of files to metres and y up.
//!
//! # Theory
//! A point f of a file becomes the point p = m R f of the groom, where m is the number of metres
//! per unit and R a proper rotation (without reflection, so that curls keep their handedness). Two
//! conventions are in use for the rotation from z up to y up; they differ by a quarter turn about
//! y:
//!
//! - [`ZUp::Common`]: (x, y, z) → (x, z, −y), used by Blender, glTF and Alembic exporters;
//! - [`ZUp::Yuksel`]: (x, y, z) → (y, z, x), used for Cem Yuksel's `.hair` models.
//!
//! # Practice
//! [`Import`] is read from the scene file or the command line and is applied once, right after the
//! file was read.

use std::{fmt, str::FromStr};

use glam::Vec3;

use super::Groom;

/// The length of one unit of a file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(try_from = "String", into = "String"))]
pub enum Unit {
    /// `m`.
    #[default]
    Metre,
    /// `cm`.
    Centimetre,
    /// `mm`.
    Millimetre,
    /// `in`, 0.0254 m.
    Inch,
}

impl Unit {
    /// All units, largest first.
    pub const ALL: [Self; 4] = [Self::Metre, Self::Inch, Self::Centimetre, Self::Millimetre];

    /// Metres in one unit.
    pub fn metres(self) -> f64 {
        match self {
            Self::Metre => 1.0,
            Self::Centimetre => 1e-2,
            Self::Millimetre => 1e-3,
            Self::Inch => 0.0254,
        }
    }
}

impl fmt::Display for Unit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Metre => "m",
            Self::Centimetre => "cm",
            Self::Millimetre => "mm",
            Self::Inch => "in",
        })
    }
}

/// The axis that points up in a file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(try_from = "String", into = "String"))]
pub enum Up {
    /// `y`, as in Forelock.
    #[default]
    Y,
    /// `z`.
    Z,
}

impl fmt::Display for Up {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Y => "y",
            Self::Z => "z",
        })
    }
}

/// A word that is not the name of a unit or an axis.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("`{word}` is not a {kind}: use {choices}")]
pub struct UnknownWord {
    word: String,
    kind: &'static str,
    choices: &'static str,
}

impl FromStr for Unit {
    type Err = UnknownWord;

    fn from_str(word: &str) -> Result<Self, UnknownWord> {
        match word.trim().to_ascii_lowercase().as_str() {
            "m" | "metre" | "metres" | "meter" | "meters" => Ok(Self::Metre),
            "cm" | "centimetre" | "centimetres" | "centimeter" | "centimeters" => Ok(Self::Centimetre),
            "mm" | "millimetre" | "millimetres" | "millimeter" | "millimeters" => Ok(Self::Millimetre),
            "in" | "inch" | "inches" => Ok(Self::Inch),
            _ => Err(UnknownWord { word: word.into(), kind: "unit of length", choices: "m, cm, mm or in" }),
        }
    }
}

impl FromStr for Up {
    type Err = UnknownWord;

    fn from_str(word: &str) -> Result<Self, UnknownWord> {
        match word.trim() {
            "y" | "Y" => Ok(Self::Y),
            "z" | "Z" => Ok(Self::Z),
            _ => Err(UnknownWord { word: word.into(), kind: "up axis", choices: "y or z" }),
        }
    }
}

impl TryFrom<String> for Unit {
    type Error = UnknownWord;

    fn try_from(word: String) -> Result<Self, UnknownWord> {
        word.parse()
    }
}

impl TryFrom<String> for Up {
    type Error = UnknownWord;

    fn try_from(word: String) -> Result<Self, UnknownWord> {
        word.parse()
    }
}

impl From<Unit> for String {
    fn from(unit: Unit) -> Self {
        unit.to_string()
    }
}

impl From<Up> for String {
    fn from(up: Up) -> Self {
        up.to_string()
    }
}

/// The rotation from z up to y up; a property of the file format, not a choice of the user.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ZUp {
    /// (x, y, z) → (x, z, −y).
    Common,
    /// (x, y, z) → (y, z, x).
    Yuksel,
}

/// The conversion of a file's numbers to metres, y up.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
pub struct Import {
    /// Unit of the file, default m.
    pub unit: Unit,
    /// Up axis of the file, default y.
    pub up: Up,
    /// Additional factor on all lengths, for files with non-standard units (0.1 with `in` is right
    /// for Yuksel's models); default 1, finite and above 0.
    pub scale: f64,
}

impl Default for Import {
    fn default() -> Self {
        Self { unit: Unit::Metre, up: Up::Y, scale: 1.0 }
    }
}

impl Import {
    /// Metres per unit of the file: the unit times the scale.
    pub fn metres(&self) -> f64 {
        self.unit.metres() * self.scale
    }

    /// Converts one point of the file to metres and y up.
    pub fn point(&self, p: Vec3, z_up: ZUp) -> Vec3 {
        #[expect(clippy::cast_possible_truncation, reason = "positions are float32")]
        let metres = self.metres() as f32;
        let turned = match (self.up, z_up) {
            (Up::Y, _) => p,
            (Up::Z, ZUp::Common) => Vec3::new(p.x, p.z, -p.y),
            (Up::Z, ZUp::Yuksel) => Vec3::new(p.y, p.z, p.x),
        };
        turned * metres
    }

    /// Converts a groom as read from the file to metres and y up: rotates and scales positions,
    /// scales widths.
    pub fn apply(&self, groom: &mut Groom, z_up: ZUp) {
        if *self == Self::default() {
            return;
        }
        for p in groom.positions_mut() {
            *p = self.point(*p, z_up);
        }
        #[expect(clippy::cast_possible_truncation, reason = "widths are float32")]
        let metres = self.metres() as f32;
        for width in groom.widths.iter_mut().flatten() {
            *width *= metres;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_z_up_rotations_are_proper_and_bring_z_to_y() {
        let import = Import { up: Up::Z, ..Import::default() };
        for custom in [ZUp::Common, ZUp::Yuksel] {
            let [x, y, z] = [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| import.point(axis, custom));
            assert_eq!(z, Vec3::Y);
            assert_eq!(x.cross(y), z, "{custom:?} mirrors");
        }
    }

    #[test]
    fn names_round_trip_and_errors_list_the_choices() {
        for unit in Unit::ALL {
            assert_eq!(unit.to_string().parse(), Ok(unit));
        }
        assert_eq!(" Inches ".parse(), Ok(Unit::Inch));
        let message = "furlong".parse::<Unit>().unwrap_err().to_string();
        assert_eq!(message, "`furlong` is not a unit of length: use m, cm, mm or in");
        assert!("x".parse::<Up>().is_err());
    }

    #[test]
    fn apply_scales_positions_and_widths() {
        let mut groom = Groom::from_strands([[Vec3::ZERO, Vec3::new(1.0, 2.0, 3.0)]]).unwrap();
        groom.widths = Some(vec![1.0, 0.5]);
        let import = Import { unit: Unit::Inch, up: Up::Z, scale: 10.0 };
        import.apply(&mut groom, ZUp::Yuksel);
        assert!(groom.positions()[1].distance(Vec3::new(0.508, 0.762, 0.254)) < 1e-6);
        assert_eq!(groom.widths, Some(vec![0.254, 0.127]));
    }
}
