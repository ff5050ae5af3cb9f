//! The tables of a scene file. Every field's doc line is the reference for its key.

use std::fmt;
use std::path::PathBuf;

use forelock_core::body::character::Skinning;
use forelock_core::groom::grow::{GrowParams, PRESETS};
use forelock_core::groom::{Import, Unit, Up};
use forelock_core::interaction::Interactions;
use forelock_core::interaction::contact::ContactParams;
use forelock_core::interaction::grid::GridParams;
use forelock_core::interaction::sph::SphParams;
use serde::de::value::SeqAccessDeserializer;
use serde::de::{Deserializer, SeqAccess, Visitor};
use serde::{Deserialize, Serialize, Serializer};

use super::error::one_of;
use super::motion::MotionSection;

/// Where strands come from.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum GroomSource {
    /// Grown on the body.
    #[default]
    Grow,
    /// Read from files, one groom after another.
    Files(Vec<PathBuf>),
}

impl Serialize for GroomSource {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Grow => serializer.serialize_str("grow"),
            Self::Files(files) => files.serialize(serializer),
        }
    }
}

impl<'de> Deserialize<'de> for GroomSource {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct GrowOrFiles;
        impl<'de> Visitor<'de> for GrowOrFiles {
            type Value = GroomSource;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("\"grow\", a file's path or a list of paths")
            }
            fn visit_str<E>(self, text: &str) -> Result<GroomSource, E> {
                Ok(if text == "grow" { GroomSource::Grow } else { GroomSource::Files(vec![text.into()]) })
            }
            fn visit_seq<A: SeqAccess<'de>>(self, list: A) -> Result<GroomSource, A::Error> {
                Vec::deserialize(SeqAccessDeserializer::new(list)).map(GroomSource::Files)
            }
        }
        deserializer.deserialize_any(GrowOrFiles)
    }
}

/// The preset of scenes that name none.
const PRESET: &str = "wavy";

/// The growth parameters of preset `name` as TOML, but for those that other keys of a scene set.
pub(super) fn preset_toml(name: &str) -> Result<String, String> {
    let params = GrowParams::preset(name).map_err(|_| one_of(name, &PRESETS))?;
    let mut grow = toml::Table::try_from(&params).map_err(|error| error.to_string())?;
    grow.remove("strands");
    grow.remove("seed");
    let groom = toml::Table::from_iter([("grow".to_owned(), toml::Value::Table(grow))]);
    Ok(toml::Table::from_iter([("groom".to_owned(), toml::Value::Table(groom))]).to_string())
}

forelock_core::documented! {
/// `[groom]`: the strands.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GroomSection {
    /// "grow", a file (.hair, .data, .tfx, .npz, .obj, .abc, .usda, .usdc, .usd, .ply, .bin) or a
    /// list of files. Default "grow".
    pub source: GroomSource,
    /// Preset that `grow` starts from: straight, wavy, curly, afro, bob, asymmetric, beard,
    /// short-fur or ponytail; the keys of `[groom.grow]` change single parameters of it. Default
    /// "wavy".
    pub preset: String,
    /// Number of strands to grow; files keep theirs. Unit strands, default 10000, range 1 to
    /// 1000000.
    pub strands: u32,
    /// Particles per strand after resampling by arc length. Unit particles, default 0, range 2 to
    /// 1000 or 0; 0 keeps those of the file or of the growth (25).
    pub vertices_per_strand: u32,
    /// Particles of all strands together, long ones with more of them than short ones, instead of
    /// `vertices_per_strand`; they scale with the strands if `--set groom.strands` changes those.
    /// Unit particles, default 0, range 2 to 1000000000 or 0; 0 leaves that to
    /// `vertices_per_strand`.
    pub vertices: u32,
    /// Unit of length of the files: "m", "cm", "mm" or "in". Default "m".
    pub unit: Unit,
    /// Axis that points up in the files: "y" or "z". Default "y".
    pub up: Up,
    /// Further factor on lengths, for files in other units. No unit, default 1, range 1e-9 to 1e9.
    pub scale: f64,
    /// Whether strands that start inside the body are brought out before the simulation. Default
    /// true.
    pub lift: bool,
    /// Strands that are simulated; all others follow the nearest of them. Unit strands, default 0,
    /// range 0 to 1000000; 0 simulates all.
    pub guides: u32,
    /// Where to grow on a mesh that is not built in: two opposite corners of a box, [[x, y, z], [x,
    /// y, z]]. Unit m, default the whole mesh, range -1e4 to 1e4 each; the built-in head has its
    /// regions.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub region_box: Option<[[f64; 3]; 2]>,
    /// Growth parameters.
    pub grow: GrowParams,
}
}

impl Default for GroomSection {
    fn default() -> Self {
        Self {
            source: GroomSource::Grow,
            preset: PRESET.to_owned(),
            strands: 10_000,
            vertices_per_strand: 0,
            vertices: 0,
            unit: Unit::default(),
            up: Up::default(),
            scale: 1.0,
            lift: true,
            guides: 0,
            region_box: None,
            grow: GrowParams::preset(PRESET).unwrap_or_default(),
        }
    }
}

forelock_core::documented! {
/// `[body]`: what the hair grows on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct BodySection {
    /// "builtin:head", "builtin:horse", "builtin:talker" (the head with a jaw, and the clips "talk"
    /// and "chew"), "builtin:walker" (a figure with the clips "walk", "jump" and "look"), "none" or
    /// a file: .obj, or one that may bend, .glb, .gltf, .abc, .usd, .usda or .usdc. Default
    /// "builtin:head".
    pub mesh: String,
    /// Unit of length of the file: "m", "cm", "mm" or "in". Default "m".
    pub unit: Unit,
    /// Axis that points up in the file: "y" or "z". Default "y".
    pub up: Up,
    /// Further factor on lengths, for files in other units. No unit, default 1, range 1e-9 to 1e9.
    pub scale: f64,
    /// How the body and the roots move: a name such as "builtin:turn", or a table. Default
    /// "builtin:turn".
    pub motion: MotionSection,
    /// Joint of a character that carries the hair: positions are stored relative to it, and
    /// teleports are found by its motion. Default "", the joint that the roots follow most.
    pub joint: String,
    /// How a character's vertices follow its joints: "linear" or "dual-quaternion", which keeps the
    /// girth of limbs that twist. The rest pose is linear. Default "linear".
    pub skinning: Skinning,
    /// Speed of the roots' middle from one step to the next above which a motion counts as a
    /// teleport that is not declared: the hair is carried along in its shape. Unit m/s, default 50,
    /// range 0 to 1e9; 0 never does.
    pub teleport_speed: f64,
    /// Turning speed above which a motion counts as a teleport too. Unit degrees per second,
    /// default 3600 (ten turns a second), range 0 to 1e9; 0 never does.
    pub teleport_turn_degrees: f64,
    /// Whether strands collide with the body. Default true.
    pub collide: bool,
    /// Coulomb friction of the body's surface. No unit, default 0.3, range 0 to 100; 0 is ice.
    pub friction: f64,
    /// Cells of the body's signed distance grid along its longest side. Unit cells, default 128,
    /// range 8 to 512.
    pub sdf_cells: u32,
    /// Largest side of that grid's cells near the surface, however large the body is. A body that
    /// bends has cells twice as large. Unit m, default 0.002, range 0 to 1; 0 leaves all cells
    /// alike.
    pub sdf_near_cell: f64,
}
}

impl GroomSection {
    /// How many particles growth and resampling will give; 0 if that is not known before files are
    /// read.
    pub(crate) fn grown_particles(&self) -> u64 {
        let each = match self.vertices_per_strand {
            0 => self.grow.vertices_per_strand,
            count => count,
        };
        match self.source {
            GroomSource::Grow if self.vertices == 0 => u64::from(self.strands) * u64::from(each),
            GroomSource::Grow => self.vertices.into(),
            GroomSource::Files(_) => 0,
        }
    }

    /// How the files' numbers become metres, y up.
    pub fn import(&self) -> Import {
        Import { unit: self.unit, up: self.up, scale: self.scale }
    }
}

impl BodySection {
    /// How the file's numbers become metres, y up.
    pub fn import(&self) -> Import {
        Import { unit: self.unit, up: self.up, scale: self.scale }
    }

    /// Whether the body is a character, with joints.
    pub fn is_character(&self) -> bool {
        ["builtin:talker", "builtin:walker"].contains(&self.mesh.as_str())
            || !self.is_named() && forelock_io::is_character(self.mesh.as_ref())
    }

    /// Whether `mesh` is a name rather than a file.
    pub fn is_named(&self) -> bool {
        self.mesh == "none" || self.mesh.starts_with("builtin:")
    }
}

impl Default for BodySection {
    fn default() -> Self {
        Self {
            mesh: "builtin:head".to_owned(),
            unit: Unit::default(),
            up: Up::default(),
            scale: 1.0,
            motion: MotionSection::named("builtin:turn"),
            joint: String::new(),
            skinning: Skinning::default(),
            teleport_speed: 50.0,
            teleport_turn_degrees: 3600.0,
            collide: true,
            friction: 0.3,
            sdf_cells: 128,
            sdf_near_cell: NEAR_CELL,
        }
    }
}

/// The solids that a `[[collider]]` can be.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ShapeKind {
    /// A ball of `radius`.
    #[default]
    Sphere,
    /// A cylinder along y of `half_length` with round ends of `radius`.
    Capsule,
    /// A box of `half_extents`.
    Box,
    /// All below y = 0 in local space.
    Plane,
    /// A closed mesh, as a signed distance grid.
    Mesh,
    /// All outside a ball of `radius`: hair is kept within.
    HollowSphere,
    /// The built-in open hand, fingers to +y, palm to +z, wrist at the origin.
    Hand,
    /// The built-in comb, teeth to −y.
    Comb,
    /// The built-in shell of `radius` with round openings.
    HoledSphere,
}

impl ShapeKind {
    /// The name in scene files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Sphere => "sphere",
            Self::HollowSphere => "hollow-sphere",
            Self::Capsule => "capsule",
            Self::Box => "box",
            Self::Plane => "plane",
            Self::Mesh => "mesh",
            Self::Hand => "hand",
            Self::Comb => "comb",
            Self::HoledSphere => "holed-sphere",
        }
    }

    /// Whether it has a `radius`.
    pub(super) fn is_round(self) -> bool {
        matches!(self, Self::Sphere | Self::HollowSphere | Self::Capsule | Self::HoledSphere)
    }

    /// Whether it becomes a distance grid.
    pub(super) fn has_grid(self) -> bool {
        matches!(self, Self::Mesh | Self::Hand | Self::Comb | Self::HoledSphere)
    }
}

forelock_core::documented! {
/// `[[collider]]`: one further solid.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ColliderSection {
    /// "sphere", "hollow-sphere", "capsule", "box", "plane", "mesh", or one of the built-in "hand",
    /// "comb" and "holed-sphere". Default "sphere".
    pub shape: ShapeKind,
    /// Where its centre is at the start, [x, y, z]. Unit m, default [0, 0, 0], range -1e4 to 1e4
    /// each.
    pub position: [f64; 3],
    /// How it is turned at the start: yaw about y, pitch about x, roll about z, in this order. Unit
    /// degrees, default [0, 0, 0], range -1e6 to 1e6 each.
    pub rotation_degrees: [f64; 3],
    /// Radius of a sphere, hollow or holed sphere, or capsule. Unit m, default 0.1, range 1e-4 to
    /// 1e4.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub radius: Option<f64>,
    /// Half the length of a capsule's axis. Unit m, default 0.1, range 0 to 1e4; 0 is a sphere.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub half_length: Option<f64>,
    /// Half the sides of a box, [x, y, z]. Unit m, default [0.1, 0.1, 0.1], range 1e-4 to 1e4 each.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub half_extents: Option<[f64; 3]>,
    /// The file of a mesh: .obj, or at rest .glb, .gltf, .abc, .usd, .usda or .usdc. No default: a
    /// mesh needs one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mesh: Option<PathBuf>,
    /// The .obj files of a mesh that changes its shape, in order, instead of `mesh`. Parts must
    /// move by less than half their thickness from one to the next. Default none.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub mesh_sequence: Vec<PathBuf>,
    /// Meshes of `mesh_sequence` a second; the last one stays. Unit s⁻¹, default 24, range 1e-3 to
    /// 1e4.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sequence_fps: Option<f64>,
    /// Unit of length of that file: "m", "cm", "mm" or "in". Default "m".
    pub unit: Unit,
    /// Axis that points up in that file: "y" or "z". Default "y".
    pub up: Up,
    /// Further factor on that file's lengths. No unit, default 1, range 1e-9 to 1e9.
    pub scale: f64,
    /// Cells of a mesh's, hand's, comb's or holed sphere's distance grid along its longest side.
    /// Unit cells, default 96 and what a built-in one needs, range 8 to 512.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sdf_cells: Option<u32>,
    /// Largest side of that grid's cells near the surface; a `mesh_sequence` ignores it. Unit m,
    /// default 0.002, range 0 to 1; 0 leaves all cells alike.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sdf_near_cell: Option<f64>,
    /// Whether it is fixed to the body and moves with it; otherwise it stands in the world. Default
    /// false.
    pub on_body: bool,
    /// How it moves: a name such as "builtin:nod", or a table. Default "builtin:still".
    pub motion: MotionSection,
    /// When it appears. Unit s, default 0, range 0 to 1e6.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub from_secs: Option<f64>,
    /// When it disappears, after `from_secs`. Unit s, default never, range 0 to 1e6.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub until_secs: Option<f64>,
    /// Coulomb friction of its surface. No unit, default 0.3, range 0 to 100; 0 is ice.
    pub friction: f64,
    /// Whether pictures show it; what stands in for a part of the body need not be seen. Default
    /// true.
    pub visible: bool,
}
}

/// The default largest side of a distance grid's cells near the surface, metres.
pub(crate) const NEAR_CELL: f64 = 0.002;

impl ColliderSection {
    /// How the file's numbers become metres, y up.
    pub fn import(&self) -> Import {
        Import { unit: self.unit, up: self.up, scale: self.scale }
    }
}

impl Default for ColliderSection {
    fn default() -> Self {
        Self {
            shape: ShapeKind::default(),
            position: [0.0; 3],
            rotation_degrees: [0.0; 3],
            radius: None,
            half_length: None,
            half_extents: None,
            mesh: None,
            mesh_sequence: Vec::new(),
            sequence_fps: None,
            unit: Unit::default(),
            up: Up::default(),
            scale: 1.0,
            sdf_cells: None,
            sdf_near_cell: None,
            on_body: false,
            motion: MotionSection::default(),
            from_secs: None,
            until_secs: None,
            friction: 0.3,
            visible: true,
        }
    }
}

/// How hair interacts with hair.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum InteractionKind {
    /// Strands pass through each other.
    None,
    /// Through a grid: pressed together, it pushes apart.
    #[default]
    Grid,
    /// Through smoothed particles: it pushes itself apart and shares its speed.
    Sph,
}

forelock_core::documented! {
/// `[interaction]`: hair against hair.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct InteractionSection {
    /// "none": strands pass through each other; "grid": they keep their volume; "sph": as smoothed
    /// particles. Default "grid".
    pub kind: InteractionKind,
    /// Parameters of the grid.
    pub grid: GridParams,
    /// Parameters of the smoothed particles.
    pub sph: SphParams,
    /// Whether segments of strands touch, one by one, so that locks do not pass through each other.
    /// Default true.
    pub contacts: bool,
    /// Parameters of the contacts.
    pub contact: ContactParams,
}
}

impl Default for InteractionSection {
    fn default() -> Self {
        Self {
            kind: InteractionKind::default(),
            grid: GridParams::default(),
            sph: SphParams::default(),
            contacts: true,
            contact: ContactParams::default(),
        }
    }
}

impl InteractionSection {
    /// The interactions that are on.
    pub fn interactions(&self) -> Interactions {
        let Self { kind, grid, sph, contacts, contact } = self;
        Interactions {
            grid: (*kind == InteractionKind::Grid).then(|| grid.clone()),
            sph: (*kind == InteractionKind::Sph).then(|| sph.clone()),
            contacts: contacts.then(|| contact.clone()),
        }
    }
}

forelock_core::documented! {
/// `[time]`: frames and substeps.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TimeSection {
    /// Frames a second. Unit s⁻¹, default 60, range 1 to 10000.
    pub fps: f64,
    /// Longest substep; the same as `substep_secs` of the solver, where it has one. Unit s, default
    /// that of the solver, range 1e-5 to 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub substep_secs: Option<f64>,
    /// Frames to simulate after the start. Unit frames, default 240, range 1 to 1000000.
    pub frames: u32,
}
}

impl Default for TimeSection {
    fn default() -> Self {
        Self { fps: 60.0, substep_secs: None, frames: 240 }
    }
}

/// What draws pictures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Renderer {
    /// All threads of the processor.
    #[default]
    Cpu,
    /// The fastest GPU.
    Gpu,
}

forelock_core::documented! {
/// `[output]`: what is written into the output folder.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct OutputSection {
    /// Whether to take a picture of the last frame, `picture.png`. Default true.
    pub picture: bool,
    /// Whether to make a sheet of frames over time, `contact-sheet.png`. Default false.
    pub contact_sheet: bool,
    /// Whether to make an animated PNG, `film.png`. Default false.
    pub film: bool,
    /// Frames from one picture of the film to the next. Unit frames, default 4, range 1 to 1000.
    pub film_every: u32,
    /// Width of the picture; the film is half as wide. Unit pixels, default 900, range 16 to 4096.
    pub width: u32,
    /// Height of the picture; the film is half as high. Unit pixels, default 900, range 16 to 4096.
    pub height: u32,
    /// Name of the cache, an .npz file. Default "hair.npz"; empty writes none.
    pub cache: PathBuf,
    /// Frames from one in the cache to the next; films and sheets show frames of the cache. Unit
    /// frames, default 1, range 1 to 1000.
    pub cache_every: u32,
    /// Files for other programs with the frames of the cache, made when the run is done: names that
    /// end in .abc, .usdc, .usd or .glb. Default [].
    pub exports: Vec<PathBuf>,
    /// Number of the first frame in these files, whose time is that many frames after 0: the first
    /// frame of the body's motion in the program that they are for. Unit frames, default 0, range 0
    /// to 1000000.
    pub first_frame: u32,
    /// What draws pictures and films: "cpu" or "gpu", which is refused where there is no GPU.
    /// Default "cpu".
    pub renderer: Renderer,
    /// Whether to write the page `report.html`. Default true.
    pub report: bool,
    /// Name of the groom that `forelock groom` writes; its ending picks the format. Default
    /// "groom.npz".
    pub groom: PathBuf,
}
}

impl Default for OutputSection {
    fn default() -> Self {
        Self {
            picture: true,
            contact_sheet: false,
            film: false,
            film_every: 4,
            width: 900,
            height: 900,
            cache: PathBuf::from("hair.npz"),
            cache_every: 1,
            exports: Vec::new(),
            first_frame: 0,
            renderer: Renderer::Cpu,
            report: true,
            groom: PathBuf::from("groom.npz"),
        }
    }
}

forelock_core::documented! {
/// `[camera]`: from where pictures are taken.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CameraSection {
    /// Angle around the body from its front towards its left side. Unit degrees, default 30, range
    /// -1e6 to 1e6.
    pub yaw_degrees: f64,
    /// Angle above the horizon. Unit degrees, default 5, range -89 to 89.
    pub pitch_degrees: f64,
    /// Distance over that at which body and hair just fill the picture. No unit, default 1, range
    /// 0.01 to 100.
    pub distance: f64,
    /// The point in the middle of the picture, [x, y, z], where body and hair are at rest. Unit m,
    /// default their middle, range -1e4 to 1e4 each.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub look_at: Option<[f64; 3]>,
    /// Whether the camera goes where the body goes, without turning with it, so that the body stays
    /// in the picture's middle. Default false.
    pub follow: bool,
}
}

impl Default for CameraSection {
    fn default() -> Self {
        Self { yaw_degrees: 30.0, pitch_degrees: 5.0, distance: 1.0, look_at: None, follow: false }
    }
}
