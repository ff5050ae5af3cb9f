//! Units and axes of files, brought to metres and y up.
//!
//! # Theory
//! A file's point f becomes the groom's point p = m R f: m metres a unit, R a proper rotation (no mirror, so
//! that curls keep their handedness). From z up to y up there are two customs, a quarter turn about y apart:
//!
//! - [`ZUp::Common`]: (x, y, z) → (x, z, −y), what Blender, glTF and Alembic exporters do;
//! - [`ZUp::Yuksel`]: (x, y, z) → (y, z, x), the custom for Cem Yuksel's `.hair` models.
//!
//! # Practice
//! [`Import`] is read from the scene file and the command line alike, and applied once, right after reading.

use std::{fmt, str::FromStr};

use glam::Vec3;

use super::Groom;

/// The length that one unit of a file stands for.
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
    /// Every unit, largest first.
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

/// A word that names no unit or no axis.
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

/// Which rotation brings z up to y up; a property of the format, not of the user's wish.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ZUp {
    /// (x, y, z) → (x, z, −y).
    Common,
    /// (x, y, z) → (y, z, x).
    Yuksel,
}

/// How the numbers of a file become metres, y up.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
pub struct Import {
    /// Unit of the file, default m.
    pub unit: Unit,
    /// Up axis of the file, default y.
    pub up: Up,
    /// Further factor on all lengths, for files in units of their own (0.1 with `in` is right for Yuksel's
    /// models); default 1, finite and above 0.
    pub scale: f64,
}

impl Default for Import {
    fn default() -> Self {
        Self { unit: Unit::Metre, up: Up::Y, scale: 1.0 }
    }
}

impl Import {
    /// Metres in one unit of the file: the unit times the scale.
    pub fn metres(&self) -> f64 {
        self.unit.metres() * self.scale
    }

    /// One point of the file, in metres and y up.
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

    /// Brings a groom as read to metres and y up: positions turned and scaled, widths scaled.
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
    fn words_round_trip_and_wrong_ones_name_the_choices() {
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
