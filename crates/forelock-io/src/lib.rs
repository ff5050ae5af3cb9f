//! Reading and writing of grooms, meshes, characters, motions and caches. Each format has its own
//! module.
//!
//! | ending | format | read | written |
//! | --- | --- | --- | --- |
//! | `.hair` | [Cem Yuksel's models](hair) | yes | yes |
//! | `.data` | [USC-HairSalon](usc) | yes | yes |
//! | `.tfx` | [TressFX](tfx) 3.0 and 4.0 | yes | 4.0 |
//! | `.npz` | [NumPy](npz): grooms, DiffLocks, caches | yes | yes |
//! | `.obj` | [Wavefront](obj): meshes, polylines | yes | yes |
//! | `.abc` | [Alembic](alembic), the Ogawa kind: grooms, caches; bodies are read | yes | yes |
//! | `.ply` | [Point clouds](ply) of strands | yes | yes |
//! | `.bin` | [CT2Hair](ct2hair) | yes | no |
//! | `.usda`, `.usdc`, `.usd` | [USD](usd): curves, caches; bodies are read | yes | yes |
//! | `.glb`, `.gltf` | [glTF 2.0](gltf): characters and meshes; hair as lines | yes; no | no; yes |
//! | `.tfxskin`, `.tfxbone` | [TressFX skinning](tfx_skin) | yes | no |
//! | `.bvh` | [Biovision](bvh): motions | yes | yes |
//!
//! Readers check every count against the size of the file before they allocate memory, and never
//! panic. Errors name the file, the byte and the strand. Writers are atomic: a file is complete or
//! absent.
//!
//! ```
//! use forelock_core::groom::{Groom, Import, Unit};
//! use glam::Vec3;
//!
//! let folder = tempfile::tempdir()?;
//! let path = folder.path().join("two.data");
//! let strand = |x: f32| vec![Vec3::new(x, 0.0, 0.0), Vec3::new(x, -30.0, 0.0)];
//! forelock_io::write_groom(&path, &Groom::from_strands([strand(0.0), strand(1.0)])?)?;
//!
//! let import = Import { unit: Unit::Centimetre, ..Import::default() };
//! let imported = forelock_io::read_groom(&path, &import)?;
//! assert!(imported.repairs.is_clean());
//! assert!((imported.groom.length(0) - 0.3).abs() < 1e-6);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod atomic;
mod bytes;
mod error;
mod labels;
mod lock;
mod moving_mesh;

pub mod alembic;
pub mod animation;
pub mod bvh;
pub mod ct2hair;
pub mod gltf;
pub mod hair;
pub mod npz;
pub mod obj;
pub mod ply;
pub mod tfx;
pub mod tfx_skin;
pub mod usc;
pub mod usd;

use std::{
    fmt,
    fs::{self, File},
    io::{BufReader, Read},
    path::Path,
};

use forelock_core::{
    body::{TriMesh, character::Character},
    groom::{Groom, Import, RepairReport, Unit, ZUp, repair},
};

use glam::{DAffine3, DVec3, Vec3};

pub use atomic::{atomic_write, remove_leftovers, remove_temporaries};
pub use error::{FormatError, Problem, ReadError, WriteError};
pub use lock::Lock;
pub use npz::{Array, Cache, CacheWriter, Data, Stored, read_npz, write_npz};
pub use usd::{Usd, UsdCacheWriter};

/// A file format for grooms.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Cem Yuksel's `.hair`.
    Hair,
    /// USC-HairSalon's `.data`.
    Usc,
    /// TressFX `.tfx`.
    Tfx,
    /// NumPy's `.npz`.
    Npz,
    /// Wavefront `.obj`.
    Obj,
    /// Alembic `.abc`.
    Alembic,
    /// Strands as a `.ply` point cloud.
    Ply,
    /// CT2Hair's `.bin`.
    Ct2Hair,
    /// Universal Scene Description, `.usda`, `.usdc` or `.usd`.
    Usd,
    /// Lines in glTF 2.0, `.glb` or `.gltf`.
    Gltf,
}

impl Format {
    /// Every format.
    pub const ALL: [Self; 10] = [
        Self::Hair,
        Self::Usc,
        Self::Tfx,
        Self::Npz,
        Self::Obj,
        Self::Alembic,
        Self::Ply,
        Self::Ct2Hair,
        Self::Usd,
        Self::Gltf,
    ];

    /// The endings of file names, without the dot.
    pub fn endings(self) -> &'static [&'static str] {
        match self {
            Self::Hair => &["hair"],
            Self::Usc => &["data"],
            Self::Tfx => &["tfx"],
            Self::Npz => &["npz"],
            Self::Obj => &["obj"],
            Self::Alembic => &["abc"],
            Self::Ply => &["ply"],
            Self::Ct2Hair => &["bin"],
            Self::Usd => &["usda", "usdc", "usd"],
            Self::Gltf => &["glb", "gltf"],
        }
    }

    /// Whether grooms in the format can be read.
    pub fn is_read(self) -> bool {
        self != Self::Gltf
    }

    /// Whether grooms can be written in the format.
    pub fn is_written(self) -> bool {
        self != Self::Ct2Hair
    }

    /// The format for the ending of `path`, in upper or lower case.
    pub fn of(path: &Path) -> Option<Self> {
        let ending = path.extension()?;
        let is_own = |format: &Self| format.endings().iter().any(|own| ending.eq_ignore_ascii_case(own));
        Self::ALL.into_iter().find(is_own)
    }
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Hair => "Cem Yuksel HAIR",
            Self::Usc => "USC-HairSalon data",
            Self::Tfx => "TressFX",
            Self::Npz => "NumPy npz",
            Self::Obj => "Wavefront OBJ polylines",
            Self::Alembic => "Alembic",
            Self::Ply => "PLY point cloud",
            Self::Ct2Hair => "CT2Hair",
            Self::Usd => "Universal Scene Description",
            Self::Gltf => "glTF 2.0 lines",
        })
    }
}

/// A groom read from a file.
#[derive(Clone, Debug)]
pub struct Imported {
    /// The groom in metres, y up, repaired.
    pub groom: Groom,
    /// The repairs that were made.
    pub repairs: RepairReport,
    /// The format of the file.
    pub format: Format,
}

/// Reads the groom at `path`, converts it to metres and y up according to `import`, and repairs it.
/// The ending of the name selects the format.
///
/// # Errors
/// [`ReadError`] if the file cannot be read, is not of that format, or has no usable strand.
pub fn read_groom(path: &Path, import: &Import) -> Result<Imported, ReadError> {
    let unknown = || ReadError::UnknownEnding { path: path.into(), known: known(Format::is_read) };
    let format = Format::of(path).ok_or_else(unknown)?;
    let decode = |read: fn(&[u8]) -> Result<Groom, FormatError>| {
        read(&read_bytes(path)?).map_err(ReadError::format(path))
    };
    let mut import = *import;
    let mut groom = match format {
        Format::Hair => decode(hair::read)?,
        Format::Usc => decode(usc::read)?,
        Format::Tfx => decode(tfx::read)?,
        Format::Obj => decode(obj::read_groom)?,
        Format::Ply => decode(ply::read)?,
        Format::Ct2Hair => decode(ct2hair::read)?,
        // Read from the file, not from memory: only the first frame of a long cache is needed.
        Format::Alembic => read_alembic(path, &mut import)?,
        Format::Npz => npz::read_groom(BufReader::new(open(path)?)).map_err(|e| e.at(path))?,
        Format::Usd => {
            let layer = Usd::open(open(path)?).map_err(|e| e.at(path))?;
            import = layer.import(&import);
            layer.frame(0).map_err(|e| e.at(path))?
        }
        Format::Gltf => return Err(unknown()),
    };
    import.apply(&mut groom, if format == Format::Hair { ZUp::Yuksel } else { ZUp::Common });
    let (groom, repairs) = repair(groom);
    if groom.strand_count() == 0 {
        let found =
            if repairs.strands_before == 0 { "it holds none".into() } else { repairs.sentences().join("; ") };
        return Err(ReadError::NoStrands { path: path.into(), found });
    }
    Ok(Imported { groom, repairs, format })
}

/// Reads the groom in the Alembic file at `path`. Where `import` has the default unit, it gets that
/// of the file.
fn read_alembic(path: &Path, import: &mut Import) -> Result<Groom, ReadError> {
    let at = |error: alembic::AlembicError| error.at(path);
    // Without a buffer: most reads are of 8 bytes, each elsewhere.
    let mut reader = alembic::Reader::open(open(path)?).map_err(at)?;
    if import.unit == Unit::default() {
        import.unit = reader.unit();
    }
    Ok(reader.read(0).map_err(at)?.groom)
}

/// Writes `groom` to `path` in metres, y up, with the attributes that the format supports. The
/// ending of the name selects the format.
///
/// # Errors
/// [`WriteError`] if the format is unknown or cannot be written, cannot store the groom, or the
/// file cannot be written.
pub fn write_groom(path: &Path, groom: &Groom) -> Result<(), WriteError> {
    let unfit = |problem: String| WriteError::Unfit { path: path.into(), problem };
    groom.check_attributes().map_err(|e| unfit(e.to_string()))?;
    let bytes = match Format::of(path) {
        Some(Format::Hair) => hair::write(groom).map_err(unfit)?,
        Some(Format::Usc) => usc::write(groom).map_err(unfit)?,
        Some(Format::Tfx) => tfx::write(groom).map_err(unfit)?,
        Some(Format::Npz) => npz::write_groom(groom),
        Some(Format::Obj) => obj::write_groom(groom),
        Some(Format::Ply) => ply::write(groom).map_err(unfit)?,
        Some(Format::Alembic) => alembic::write(groom).map_err(unfit)?,
        Some(Format::Usd) if is_text(path) => usd::write_text(groom),
        Some(Format::Usd) => usd::write_binary(groom),
        Some(Format::Gltf) if is_text(path) => gltf::write_text(groom).map_err(unfit)?,
        Some(Format::Gltf) => gltf::write_binary(groom).map_err(unfit)?,
        Some(Format::Ct2Hair) | None => {
            return Err(WriteError::UnknownEnding { path: path.into(), known: known(Format::is_written) });
        }
    };
    atomic_write(path, |file| file.write_all(&bytes))
}

/// Whether `path` ends as the name of a text file does, in a format that has both: `.usda`,
/// `.gltf`.
fn is_text(path: &Path) -> bool {
    path.extension().is_some_and(|own| own.eq_ignore_ascii_case("usda") || own.eq_ignore_ascii_case("gltf"))
}

/// A character read from a file.
#[derive(Clone, Debug)]
pub struct ImportedCharacter {
    /// The character in metres, y up.
    pub character: Character,
    /// What was changed or left out, one sentence each.
    pub notes: Vec<String>,
}

/// Whether `path` ends as the name of a file does from which characters are read: `.glb`, `.gltf`,
/// and `.abc`, `.usd`, `.usda`, `.usdc`, which may hold strands as well.
pub fn is_character(path: &Path) -> bool {
    matches!(Format::of(path), Some(Format::Gltf | Format::Alembic | Format::Usd))
}

/// Whether the characters of a file that ends as `path` store all their vertices at each time:
/// `.abc`, `.usd`, `.usda`, `.usdc`.
pub fn is_baked(path: &Path) -> bool {
    matches!(Format::of(path), Some(Format::Alembic | Format::Usd))
}

/// The endings of the files from which characters are read, for messages.
const CHARACTERS: &str = ".glb .gltf .abc .usd .usda .usdc";

/// Whether `path` ends as the name of a motion's file does: `.bvh`.
pub fn is_motion(path: &Path) -> bool {
    path.extension().is_some_and(|own| own.eq_ignore_ascii_case("bvh"))
}

/// Reads the character at `path` (`.glb` or `.gltf`; or the meshes of an `.abc`, `.usd`, `.usda` or
/// `.usdc` file, whose motion becomes the clip "animation") and converts it to metres and y up
/// according to `import` and to what the file says.
///
/// # Errors
/// [`ReadError`] if the file cannot be read, is not of its format, or has no triangles.
pub fn read_character(path: &Path, import: &Import) -> Result<ImportedCharacter, ReadError> {
    let problem = |problem: String| ReadError::Character { path: path.into(), problem };
    let (mut character, notes, import) = match Format::of(path) {
        Some(Format::Alembic) => {
            let read = alembic::read_character(open(path)?);
            let (character, unit, notes) = read.map_err(|error| error.at(path))?;
            let unit = if import.unit == Unit::Metre { unit } else { import.unit };
            (character, notes, Import { unit, ..*import })
        }
        Some(Format::Usd) => {
            let read = usd::read_character(open(path)?, import);
            let (character, own, notes) = read.map_err(|error| error.at(path))?;
            (character, notes, own)
        }
        Some(Format::Gltf) => {
            let folder = path.parent().unwrap_or(Path::new(""));
            let (character, notes) = gltf::read(&read_bytes(path)?, folder).map_err(problem)?;
            (character, notes, *import)
        }
        _ => return Err(ReadError::UnknownEnding { path: path.into(), known: CHARACTERS.into() }),
    };
    let axes = Vec3::AXES.map(|axis| import.point(axis, ZUp::Common).as_dvec3());
    let map = DAffine3::from_cols(axes[0], axes[1], axes[2], DVec3::ZERO);
    if map != DAffine3::IDENTITY {
        character.transform(&map).map_err(|error| problem(error.to_string()))?;
    }
    Ok(ImportedCharacter { character, notes })
}

/// Whether `path` ends as the name of a skinning file of TressFX does: `.tfxskin` or `.tfxbone`.
pub fn is_skinning(path: &Path) -> bool {
    path.extension()
        .is_some_and(|own| own.eq_ignore_ascii_case("tfxskin") || own.eq_ignore_ascii_case("tfxbone"))
}

/// Reads the skinning file at `path` (`.tfxskin` or `.tfxbone`).
///
/// # Errors
/// [`ReadError`] if the file cannot be read or is not of its format.
pub fn read_skinning(path: &Path) -> Result<tfx_skin::Skinning, ReadError> {
    if !is_skinning(path) {
        return Err(ReadError::UnknownEnding { path: path.into(), known: ".tfxskin .tfxbone".into() });
    }
    let bytes = read_bytes(path)?;
    let skinning = if path.extension().is_some_and(|own| own.eq_ignore_ascii_case("tfxskin")) {
        tfx_skin::read_triangles(&bytes).map(tfx_skin::Skinning::Triangles)
    } else {
        tfx_skin::read_bones(&bytes).map(tfx_skin::Skinning::Bones)
    };
    skinning.map_err(ReadError::format(path))
}

/// Reads the motion at `path` (`.bvh`).
///
/// # Errors
/// [`ReadError`] if the file cannot be read or is not a BVH file.
pub fn read_motion(path: &Path) -> Result<bvh::Bvh, ReadError> {
    if !is_motion(path) {
        return Err(ReadError::UnknownEnding { path: path.into(), known: ".bvh".into() });
    }
    bvh::read(&read_bytes(path)?).map_err(ReadError::format(path))
}

/// Reads the mesh at `path` (`.obj`, or that of a character at rest) and converts it to metres and
/// y up according to `import`.
///
/// # Errors
/// [`ReadError`] if the file cannot be read, is not of its format, or has no valid mesh.
pub fn read_mesh(path: &Path, import: &Import) -> Result<TriMesh, ReadError> {
    if is_character(path) {
        return Ok(read_character(path, import)?.character.rest().clone());
    }
    if Format::of(path) != Some(Format::Obj) {
        return Err(ReadError::UnknownEnding { path: path.into(), known: format!(".obj {CHARACTERS}") });
    }
    let mut mesh = obj::read_mesh(&read_bytes(path)?).map_err(ReadError::format(path))?;
    for p in &mut mesh.positions {
        *p = import.point(*p, ZUp::Common);
    }
    Ok(mesh)
}

/// Writes `mesh` to `path` (`.obj`).
///
/// # Errors
/// [`WriteError`] if the name has another ending, or the file cannot be written.
pub fn write_mesh(path: &Path, mesh: &TriMesh) -> Result<(), WriteError> {
    if Format::of(path) != Some(Format::Obj) {
        return Err(WriteError::UnknownEnding { path: path.into(), known: ".obj".into() });
    }
    atomic_write(path, |file| file.write_all(&obj::write_mesh(mesh)))
}

/// The endings of the formats that `which` accepts, as a list for messages.
fn known(which: impl Fn(Format) -> bool) -> String {
    let formats = Format::ALL.into_iter().filter(|&format| which(format));
    let endings: Vec<String> = formats.flat_map(|format| format.endings()).map(|e| format!(".{e}")).collect();
    endings.join(" ")
}

/// Opens `path`, which must be a regular file and not empty.
fn open(path: &Path) -> Result<File, ReadError> {
    let metadata = fs::metadata(path).map_err(ReadError::io(path))?;
    if !metadata.is_file() {
        return Err(ReadError::NotAFile { path: path.into(), what: atomic::kind(&metadata) });
    }
    if metadata.len() == 0 {
        return Err(ReadError::Empty { path: path.into() });
    }
    File::open(path).map_err(ReadError::io(path))
}

fn read_bytes(path: &Path) -> Result<Vec<u8>, ReadError> {
    let mut file = open(path)?;
    let size = file.metadata().map_err(ReadError::io(path))?.len();
    error::check_room(size).map_err(ReadError::io(path))?;
    let mut bytes = Vec::new();
    file.read_to_end(&mut bytes).map_err(ReadError::io(path))?;
    Ok(bytes)
}
