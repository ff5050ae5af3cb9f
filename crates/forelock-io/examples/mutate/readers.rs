//! The readers, and the memory that they may take.

use std::fs;
use std::io::Cursor;
use std::path::Path;

use forelock_core::groom::{Groom, Import, Info, repair};
use forelock_io::tfx_skin::{read_bones, read_triangles};
use forelock_io::{Cache, Usd, alembic, bvh, ct2hair, gltf, hair, npz, obj, ply, tfx, usc, usd};

/// A reader of bytes.
pub struct Reader {
    /// Its name: the ending of its files, or what is read: `arrays`, `cache`, `mesh`, `body`.
    pub name: &'static str,
    /// Bytes that it may take for each byte of the file.
    pub times: usize,
    /// And besides.
    pub constant: usize,
    /// Whether the bytes were read.
    pub read: fn(&[u8]) -> bool,
}

const KIB: usize = 1 << 10;
const MIB: usize = 1 << 20;

const fn reader(name: &'static str, times: usize, constant: usize, read: fn(&[u8]) -> bool) -> Reader {
    Reader { name, times, constant, read }
}

/// All readers. Text takes more memory than its bytes: a digit becomes a number. Compressed tables
/// of USD and members of `.npz` may say that they are larger than they are, within a limit. A node
/// of glTF takes 3 bytes of text, `{},`, and some hundred of memory. Meshes of Alembic and USD may
/// share points: 16 MB of them are free.
pub const READERS: [Reader; 19] = [
    reader("hair", 8, 16 * KIB, |b| groom(hair::read(b))),
    reader("data", 8, 16 * KIB, |b| groom(usc::read(b))),
    reader("bin", 8, 16 * KIB, |b| groom(ct2hair::read(b))),
    reader("tfx", 8, 16 * KIB, |b| groom(tfx::read(b))),
    reader("npz", 16, 256 * KIB, |b| groom(npz::read_groom(Cursor::new(b)))),
    reader("arrays", 16, 256 * KIB, |b| npz::read(Cursor::new(b)).is_ok()),
    reader("cache", 16, 256 * KIB, cache),
    reader("obj", 32, 16 * KIB, |b| groom(obj::read_groom(b))),
    reader("mesh", 32, 16 * KIB, |b| obj::read_mesh(b).is_ok()),
    reader("ply", 32, 16 * KIB, |b| groom(ply::read(b))),
    reader("abc", 32, 17 * MIB, archive),
    reader("usda", 64, 64 * KIB, layer),
    reader("usdc", 64, 18 * MIB, |b| body(b) || layer(b)),
    reader("glb", 256, 64 * KIB, |b| gltf::read(b, Path::new("")).is_ok()),
    reader("gltf", 256, 64 * KIB, |b| gltf::read(b, Path::new("")).is_ok()),
    reader("body", 64, 17 * MIB, body),
    reader("bvh", 64, 16 * KIB, |b| bvh::read(b).is_ok()),
    reader("tfxskin", 8, 16 * KIB, |b| read_triangles(b).is_ok()),
    reader("tfxbone", 8, 16 * KIB, |b| read_bones(b).is_ok()),
];

/// Repairs and describes what was read, as `info` does.
fn groom<E>(read: Result<Groom, E>) -> bool {
    let Ok(groom) = read else { return false };
    let (groom, _) = repair(groom);
    if groom.strand_count() > 0 {
        Info::of(&groom);
    }
    true
}

/// Reads the body, or the first and the last frame of the strands.
fn archive(bytes: &[u8]) -> bool {
    if alembic::read_character(Cursor::new(bytes)).is_ok() {
        return true;
    }
    let Ok(mut reader) = alembic::Reader::open(Cursor::new(bytes)) else { return false };
    let last = reader.frames().wrapping_sub(1);
    let _ = reader.time_secs(last);
    let first = groom(reader.read(0).map(|contents| contents.groom));
    reader.read(last).is_ok() && first
}

/// Reads the first and the last frame.
fn layer(bytes: &[u8]) -> bool {
    let Ok(layer) = Usd::open(Cursor::new(bytes)) else { return false };
    let last = layer.times_secs().len().saturating_sub(1);
    groom(layer.frame(0)) && layer.frame(last).is_ok()
}

/// Reads the first and the last frame of a cache.
fn cache(bytes: &[u8]) -> bool {
    at_path(bytes, "npz", |path| {
        let Ok(mut cache) = Cache::open(path) else { return false };
        let mut positions = Vec::new();
        let first = cache.read_frame(0, &mut positions).is_ok();
        first && cache.read_frame(cache.frames() - 1, &mut positions).is_ok()
    })
}

/// Reads the meshes of a layer as a body.
fn body(bytes: &[u8]) -> bool {
    usd::read_character(Cursor::new(bytes), &Import::default()).is_ok()
}

/// Reads what is opened by its name.
fn at_path(bytes: &[u8], ending: &str, read: impl FnOnce(&Path) -> bool) -> bool {
    let name = format!("mutated-{}.{ending}", std::process::id());
    let memory = Path::new("/dev/shm");
    let folder = if memory.is_dir() { memory.to_owned() } else { std::env::temp_dir() };
    let path = folder.join(name);
    let is_read = fs::write(&path, bytes).is_ok() && read(&path);
    let _ = fs::remove_file(&path);
    is_read
}
