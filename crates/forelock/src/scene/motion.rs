//! How the body or a collider moves, as a scene says it: a name, or a table.

use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;

use forelock_core::body::KeyframeInterpolation;
use forelock_core::body::character::Playback;
use serde::de::value::MapAccessDeserializer;
use serde::de::{Deserialize, Deserializer, MapAccess, Visitor};

forelock_core::documented! {
/// A motion: `motion = "builtin:turn"`, or a table `[body.motion]` with these keys.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct MotionSection {
    /// "builtin:still", "builtin:turn", "builtin:nod", "builtin:shake", "builtin:spin",
    /// "builtin:jump", "builtin:shake-and-jump" or "builtin:roller-coaster"; of a body from a
    /// .glb or .gltf file also the name of one of its clips, or a .bvh file; of one from an .abc
    /// or USD file "animation". Default "builtin:still".
    pub name: String,
    /// How a clip or a .bvh file is played, `[body.motion.clip]`.
    #[serde(skip_serializing_if = "ClipSection::is_default")]
    pub clip: ClipSection,
    /// Factor on the motion's angles and lengths. No unit, default 1, range 0 to 100; 0 stands
    /// still.
    pub amplitude: f64,
    /// How often the motion repeats. Unit Hz, default that of the named motion, range 1e-6 to 1000.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frequency_hz: Option<f64>,
    /// When the motion comes to rest. Unit s, default 0, range 0 to 1e6; 0 never rests.
    pub rest_after_secs: f64,
    /// The point about which rotations turn, [x, y, z]. Unit m, default the neck of the body or the
    /// collider's position, range -1e4 to 1e4 each.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pivot: Option<[f64; 3]>,
    /// How keyframes are interpolated: "smooth" (never beyond them, starting and stopping at rest),
    /// "linear" or "hold" (rest until the next one, and a jump there). Default "smooth".
    pub interpolation: KeyframeInterpolation,
    /// Poses to pass through instead of a named motion, in order of time. Default none.
    #[serde(rename = "keyframe", skip_serializing_if = "Vec::is_empty")]
    pub keyframes: Vec<Keyframe>,
}
}

forelock_core::documented! {
/// `[body.motion.clip]`: how a clip of a character is played.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ClipSection {
    /// The clip's time at the start. Unit s, default 0, range 0 to 1e6.
    pub start_secs: f64,
    /// Seconds of the clip a second. No unit, default 1, range 0 to 100; 0 holds its start.
    pub speed: f64,
    /// Whether the clip is repeated; otherwise the body stays at its end. Default true, for the
    /// motion in an .abc or USD file false.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub repeat: Option<bool>,
    /// Time over which the end of a repeated clip fades into its start, at most half of the clip.
    /// Unit s, default 0, range 0 to 1000; 0 is for clips that end as they start.
    pub seam_secs: f64,
    /// Time over which the body goes from rest to the clip. Unit s, default 0.5 and for the motion
    /// in an .abc or USD file 0, range 0 to 1000; 0 starts in the clip.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub blend_secs: Option<f64>,
    /// Whether left and right are exchanged. Default false.
    pub mirrored: bool,
    /// Joints of the body with the joints of the .bvh file that they follow, where their names
    /// differ: `{ Head = "head", Tail = "" }`; "" follows none. Default none.
    pub joints: BTreeMap<String, String>,
}
}

impl Default for ClipSection {
    fn default() -> Self {
        let Playback { start_secs, speed, seam_secs, mirrored, .. } = Playback::default();
        let joints = BTreeMap::new();
        Self { start_secs, speed, repeat: None, seam_secs, blend_secs: None, mirrored, joints }
    }
}

impl ClipSection {
    fn is_default(&self) -> bool {
        *self == Self::default()
    }

    /// The same as what a performance takes. The motion of a file that stores all vertices at each
    /// time, `is_baked`, is played as it is there, unless keys say otherwise.
    pub fn playback(&self, is_baked: bool) -> Playback {
        let usual = Playback::default();
        Playback {
            start_secs: self.start_secs,
            speed: self.speed,
            repeats: self.repeat.unwrap_or(usual.repeats && !is_baked),
            seam_secs: self.seam_secs,
            blend_secs: self.blend_secs.unwrap_or(if is_baked { 0.0 } else { usual.blend_secs }),
            mirrored: self.mirrored,
        }
    }
}

forelock_core::documented! {
/// One pose of a motion by keyframes, a `[[body.motion.keyframe]]` table.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Keyframe {
    /// When. Unit s, default 0, range 0 to 1e6; the first must be 0.
    pub time_secs: f64,
    /// Where, as a shift from rest, [x, y, z]. Unit m, default [0, 0, 0], range -1e4 to 1e4 each.
    pub translation: [f64; 3],
    /// How turned from rest about the pivot: yaw about y, pitch about x, roll about z, in this
    /// order. Angles count as given, 720 is two turns. Unit degrees, default [0, 0, 0], range -1e6
    /// to 1e6 each.
    pub rotation_degrees: [f64; 3],
    /// Interpolation from here to the next keyframe: "smooth", "linear" or "hold". Default that of
    /// the motion.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub interpolation: Option<KeyframeInterpolation>,
    /// Whether the pose jumps here, as if the keyframe before were to "hold"; its time may be the
    /// same. A jump of the body is simulated as motion unless a `[[teleport]]` declares
    /// it or `body.teleport_speed` finds it. Default false.
    pub jump: bool,
}
}

impl Default for MotionSection {
    fn default() -> Self {
        Self::named("builtin:still")
    }
}

impl MotionSection {
    /// The motion called `name`, unchanged.
    pub fn named(name: &str) -> Self {
        Self {
            name: name.to_owned(),
            clip: ClipSection::default(),
            amplitude: 1.0,
            frequency_hz: None,
            rest_after_secs: 0.0,
            pivot: None,
            interpolation: KeyframeInterpolation::default(),
            keyframes: Vec::new(),
        }
    }

    /// Whether it is a .bvh file.
    pub fn is_file(&self) -> bool {
        forelock_io::is_motion(Path::new(&self.name))
    }

    /// The name after `builtin:`.
    pub fn builtin_name(&self) -> Option<&str> {
        self.name.strip_prefix("builtin:")
    }
}

/// The table form, with the same keys.
#[derive(serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Table {
    name: String,
    clip: ClipSection,
    amplitude: f64,
    frequency_hz: Option<f64>,
    rest_after_secs: f64,
    pivot: Option<[f64; 3]>,
    interpolation: KeyframeInterpolation,
    #[serde(rename = "keyframe")]
    keyframes: Vec<Keyframe>,
}

impl Default for Table {
    fn default() -> Self {
        MotionSection::default().into()
    }
}

impl From<MotionSection> for Table {
    fn from(section: MotionSection) -> Self {
        let MotionSection {
            name,
            clip,
            amplitude,
            frequency_hz,
            rest_after_secs,
            pivot,
            interpolation,
            keyframes,
        } = section;
        Self { name, clip, amplitude, frequency_hz, rest_after_secs, pivot, interpolation, keyframes }
    }
}

impl From<Table> for MotionSection {
    fn from(table: Table) -> Self {
        let Table { name, clip, amplitude, frequency_hz, rest_after_secs, pivot, interpolation, keyframes } =
            table;
        Self { name, clip, amplitude, frequency_hz, rest_after_secs, pivot, interpolation, keyframes }
    }
}

impl<'de> Deserialize<'de> for MotionSection {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct NameOrTable;
        impl<'de> Visitor<'de> for NameOrTable {
            type Value = MotionSection;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a motion's name in quotes or a table with one")
            }
            fn visit_str<E>(self, name: &str) -> Result<MotionSection, E> {
                Ok(MotionSection::named(name))
            }
            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<MotionSection, A::Error> {
                Table::deserialize(MapAccessDeserializer::new(map)).map(MotionSection::from)
            }
        }
        deserializer.deserialize_any(NameOrTable)
    }
}
