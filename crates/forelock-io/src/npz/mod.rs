//! NumPy's `.npz`: grooms, small sets of arrays, and motion caches.
//!
//! # Theory
//! The file is a ZIP archive of `.npy` files. Lengths are in metres, y up. The arrays are:
//!
//! | | array | type and shape |
//! | --- | --- | --- |
//! | groom | `positions` | float32 `[P, 3]`, or `[S, N, 3]` without offsets |
//! | | `strand_offsets` | uint32 `[S + 1]` |
//! | | `widths`, `transparencies` | float32 `[P]` |
//! | | `colours` | float32 `[P, 3]` |
//! | | `root_uv` | float32 `[S, 2]` |
//! | | `pinned` | uint32 `[S]` |
//! | | `stiffness` | float32 `[S]` |
//! | | `binding_triangles`, `binding_barycentric`, `binding_distances` | uint32 `[S]`, float32 `[S, 3]`, float32 `[S]` |
//! | | `groom_id`, `groom_group_id` | int32 `[S]` |
//! | | `groom_guide` | uint8 `[S]` |
//! | | `groom_closest_guides`, `groom_guide_weights` | int32 `[S, 3]`, float32 `[S, 3]` |
//! | cache | `positions` | float32 `[F, P, 3]` |
//! | | `strand_offsets` | uint32 `[S + 1]` |
//! | | `times` | float64 `[F]`, seconds |
//! | | any of a groom's other arrays | |
//!
//! The root of strand s in frame f is `positions[f, strand_offsets[s]]`.
//!
//! # Practice
//! The reader accepts stored and deflated members, float32, float64 and all integer types, both
//! byte orders and both array orders. It reads DiffLocks files (`positions` `[S, N, 3]`, `root_uv`)
//! without conversion, and the first frame of a cache as a groom. The writer uses stored members in
//! NumPy's layout. Equal arrays give equal bytes.
//!
//! # Limitations
//! float16, structured types and encrypted archives are not supported.

mod cache;
mod npy;
mod writer;
mod zip;

use std::{
    borrow::Cow,
    collections::BTreeMap,
    io::{self, BufReader, Read, Seek, Write},
    path::Path,
};

use forelock_core::groom::{Groom, GroomError, RootBinding};
use glam::Vec3;
use zip::{Archive, Entry};

pub use cache::Cache;
pub use npy::{Array, Data};
pub use writer::{CacheWriter, Stored};
pub(crate) use writer::{part, with_suffix};

use crate::{
    atomic::atomic_write,
    error::{FormatError, Problem, ReadError, WriteError, check_room},
    labels,
};

/// Why an `.npz` cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum NpzError {
    /// A read failed.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// The bytes do not follow the format.
    #[error(transparent)]
    Format(#[from] FormatError),
}

impl NpzError {
    pub(crate) fn at(self, path: &Path) -> ReadError {
        match self {
            Self::Io(error) => ReadError::Io { path: path.into(), error },
            Self::Format(error) => ReadError::Format { path: path.into(), error },
        }
    }
}

fn invalid(words: impl Into<String>) -> NpzError {
    FormatError { format: ".npz", offset: 0, strand: None, problem: Problem::Invalid(words.into()) }.into()
}

fn from_groom(error: GroomError) -> NpzError {
    FormatError { format: ".npz", offset: 0, strand: None, problem: error.into() }.into()
}

/// Reads all arrays of an archive, by name, into memory.
///
/// # Errors
/// [`NpzError`] if the bytes are not such an archive, or an array has an unsupported type.
pub fn read(file: impl Read + Seek) -> Result<BTreeMap<String, Array>, NpzError> {
    let mut archive = Archive::open(file)?;
    let entries = archive.entries.clone();
    let mut arrays = BTreeMap::new();
    for entry in &entries {
        if let Some(name) = entry.name.strip_suffix(".npy") {
            arrays.insert(name.to_owned(), Array::from_npy(&archive.read(entry)?)?);
        }
    }
    Ok(arrays)
}

/// Reads all arrays of the file at `path`, by name; see [`read`].
///
/// # Errors
/// [`ReadError`], which names the file.
pub fn read_npz(path: &Path) -> Result<BTreeMap<String, Array>, ReadError> {
    read(BufReader::new(crate::open(path)?)).map_err(|e| e.at(path))
}

/// The bytes of an archive with `arrays`, in their order.
pub fn write(arrays: &[(&str, Array)]) -> Vec<u8> {
    let mut out = Vec::new();
    // A vector takes all bytes.
    let _ = write_to(&mut out, arrays);
    out
}

/// Writes an archive with `arrays`, in their order, to `out`.
fn write_to(out: &mut dyn Write, arrays: &[(&str, Array)]) -> io::Result<()> {
    let mut entries = Vec::new();
    let mut at = 0;
    for (name, array) in arrays {
        let (header, bytes) = (array.npy_header(), array.data.bytes());
        let mut crc = crc32fast::Hasher::new();
        crc.update(&header);
        crc.update(bytes);
        let size = (header.len() + bytes.len()) as u64;
        let entry = Entry::stored(&format!("{name}.npy"), crc.finalize(), size, at);
        out.write_all(&entry.local())?;
        out.write_all(&header)?;
        out.write_all(bytes)?;
        at += entry.local_bytes() + size;
        entries.push(entry);
    }
    out.write_all(&zip::directory(&entries, at))
}

/// Writes `arrays` to `path` atomically.
///
/// # Errors
/// [`WriteError`] if the file cannot be written.
pub fn write_npz(path: &Path, arrays: &[(&str, Array)]) -> Result<(), WriteError> {
    atomic_write(path, |file| write_to(file, arrays))
}

/// Reads the groom in an archive, or the first frame of a cache. Units and axes are those of the
/// file.
///
/// # Errors
/// [`NpzError`] if arrays are missing, have the wrong type, or do not match each other.
pub fn read_groom(file: impl Read + Seek) -> Result<Groom, NpzError> {
    let mut archive = Archive::open(file)?;
    let offsets = archive.array("strand_offsets")?;
    let positions = read_positions(&mut archive, offsets.as_ref())?;
    let mut groom = assemble(&positions, offsets.as_ref()).map_err(|e| match e {
        Ok(words) => invalid(words),
        Err(error) => from_groom(error),
    })?;
    groom.widths = archive.floats("widths")?;
    groom.transparencies = archive.floats("transparencies")?;
    groom.colours = archive.floats("colours")?.map(groups);
    groom.root_uvs = archive.floats("root_uv")?.map(groups);
    groom.pinned = archive
        .counts("pinned")?
        .map(|pins| pins.into_iter().map(|count| u16::try_from(count).unwrap_or(u16::MAX)).collect());
    groom.stiffness = archive.floats("stiffness")?;
    let (triangles, barycentric) =
        (archive.counts("binding_triangles")?, archive.floats("binding_barycentric")?);
    if let (Some(triangles), Some(barycentric), Some(distances)) =
        (triangles, barycentric, archive.floats("binding_distances")?)
    {
        let bound = triangles.into_iter().zip(groups::<3, _>(barycentric)).zip(distances);
        groom.bindings = Some(
            bound
                .map(|((triangle, barycentric), distance)| RootBinding { triangle, barycentric, distance })
                .collect(),
        );
    }
    groom.labels = labels::read(&mut archive, labels::NAMES)?;
    groom.check_attributes().map_err(from_groom)?;
    Ok(groom)
}

impl<R: Read + Seek> Archive<R> {
    /// The array `name` as `convert` makes it, if it is there.
    fn converted<T: Clone>(
        &mut self,
        name: &str,
        convert: impl Fn(&Array) -> Option<Cow<'_, [T]>>,
    ) -> Result<Option<Vec<T>>, NpzError> {
        let Some(array) = self.array(name)? else { return Ok(None) };
        let wrong = || invalid(format!("the array `{name}` has the wrong type"));
        convert(&array).map(|values| Some(values.into_owned())).ok_or_else(wrong)
    }

    fn floats(&mut self, name: &str) -> Result<Option<Vec<f32>>, NpzError> {
        self.converted(name, Array::floats)
    }

    fn counts(&mut self, name: &str) -> Result<Option<Vec<u32>>, NpzError> {
        self.converted(name, Array::counts)
    }
}

impl<R: Read + Seek> labels::Attributes for Archive<R> {
    type Error = NpzError;

    fn integers<const N: usize>(&mut self, name: &str) -> Result<Option<Vec<[i64; N]>>, NpzError> {
        Ok(self.converted(name, Array::integers)?.map(groups))
    }

    fn floats<const N: usize>(&mut self, name: &str) -> Result<Option<Vec<[f32; N]>>, NpzError> {
        Ok(self.converted(name, Array::floats)?.map(groups))
    }

    fn invalid(&self, words: String) -> NpzError {
        invalid(words)
    }
}

/// Reads the array `positions`. If it has a frame axis, only the first frame is read. `offsets`
/// show whether it has one: they end with the number of particles.
fn read_positions<R: Read + Seek>(
    archive: &mut Archive<R>,
    offsets: Option<&Array>,
) -> Result<Array, NpzError> {
    let entry = archive.find("positions.npy").ok_or_else(|| invalid("it has no array `positions`"))?;
    let last = offsets.and_then(Array::counts).and_then(|offsets| offsets.last().copied());
    let header = archive.header(&entry)?;
    if let [_, particles, 3] = header.shape[..]
        && last.is_some_and(|last| last as usize == particles)
        && header.has_frames()
    {
        let mut raw = Vec::new();
        let bytes = (particles as u64).saturating_mul(3 * header.item_bytes as u64);
        check_room(bytes)?;
        let mut member = archive.member(&entry)?;
        io::copy(&mut member.by_ref().take(header.at as u64), &mut io::sink())?;
        member.take(bytes).read_to_end(&mut raw)?;
        if raw.len() as u64 == bytes {
            return Ok(Array { shape: vec![1, particles, 3], data: header.decode(&raw) });
        }
    }
    Ok(Array::from_npy(&archive.read(&entry)?)?)
}

/// Splits `positions` into strands. The error is a message or an error of the groom.
fn assemble(positions: &Array, offsets: Option<&Array>) -> Result<Groom, Result<String, GroomError>> {
    let shape = &positions.shape;
    let all =
        positions.floats().ok_or_else(|| Ok("the array `positions` must be float32 or float64".into()))?;
    let mut points: Vec<Vec3> = groups::<3, _>(all.into_owned()).into_iter().map(Vec3::from_array).collect();
    let offsets = match (shape.as_slice(), offsets) {
        ([.., 3], Some(offsets)) => {
            let offsets = offsets.counts().ok_or_else(|| {
                Ok("the array `strand_offsets` must hold integers from 0 to 4,294,967,295".into())
            })?;
            // [F, P, 3] is a cache. Keep frame 0.
            if let [_, particles, 3] = shape.as_slice()
                && offsets.last().is_some_and(|&last| last as usize == *particles)
            {
                points.truncate(*particles);
            }
            offsets.into_owned()
        }
        ([.., each, 3], None) if shape.len() > 2 && *each > 0 => {
            let count =
                u32::try_from(points.len()).map_err(|_| Err(GroomError::TooManyParticles(points.len())))?;
            let each = u32::try_from(*each).map_err(|_| Err(GroomError::TooManyParticles(points.len())))?;
            (0..=count / each).map(|strand| strand * each).collect()
        }
        _ => {
            return Err(Ok(format!(
                "`positions` has the shape {shape:?}; it must be [P, 3] with `strand_offsets`, or [S, N, 3]"
            )));
        }
    };
    Groom::new(points, offsets).map_err(Err)
}

/// The values in groups of `N`. An incomplete last group is dropped.
fn groups<const N: usize, T: Clone>(values: Vec<T>) -> Vec<[T; N]> {
    values.as_chunks::<N>().0.to_vec()
}

fn shaped(n: usize, each: usize, values: impl Into<Data>) -> Array {
    Array { shape: vec![n, each], data: values.into() }
}

/// The bytes of an archive with `groom` and all its attributes.
pub fn write_groom(groom: &Groom) -> Vec<u8> {
    let offsets = if groom.strand_offsets().is_empty() { vec![0] } else { groom.strand_offsets().to_vec() };
    let positions: Vec<f32> = bytemuck::cast_slice(groom.positions()).to_vec();
    let mut arrays = vec![
        ("positions", shaped(groom.particle_count(), 3, positions)),
        ("strand_offsets", Array::vector(offsets)),
    ];
    arrays.extend(attributes(groom));
    write(&arrays)
}

/// The arrays of all attributes of `groom`, for archives of grooms and caches alike.
pub(crate) fn attributes(groom: &Groom) -> Vec<(&'static str, Array)> {
    let (particles, strands) = (groom.particle_count(), groom.strand_count());
    let mut arrays = Vec::new();
    let mut add = |name, array: Option<Array>| arrays.extend(array.map(|array| (name, array)));
    add("widths", groom.widths.clone().map(Array::vector));
    add("transparencies", groom.transparencies.clone().map(Array::vector));
    add("colours", groom.colours.as_ref().map(|c| shaped(particles, 3, c.as_flattened().to_vec())));
    add("root_uv", groom.root_uvs.as_ref().map(|uv| shaped(strands, 2, uv.as_flattened().to_vec())));
    let pins = |pins: &Vec<u16>| pins.iter().map(|&count| u32::from(count)).collect::<Vec<_>>();
    add("pinned", groom.pinned.as_ref().map(|p| Array::vector(pins(p))));
    add("stiffness", groom.stiffness.clone().map(Array::vector));
    if let Some(bindings) = &groom.bindings {
        let triangles: Vec<u32> = bindings.iter().map(|b| b.triangle).collect();
        let distances: Vec<f32> = bindings.iter().map(|b| b.distance).collect();
        add("binding_triangles", Some(Array::vector(triangles)));
        let barycentric: Vec<f32> = bindings.iter().flat_map(|b| b.barycentric).collect();
        add("binding_barycentric", Some(shaped(strands, 3, barycentric)));
        add("binding_distances", Some(Array::vector(distances)));
    }
    let labels = &groom.labels;
    let [id, group, guide, closest, weights] = labels::NAMES;
    add(id, labels.ids.clone().map(Array::vector));
    add(group, labels.group_ids.clone().map(Array::vector));
    let guides = labels.guides.as_ref().map(|all| all.iter().map(|&guide| u8::from(guide)).collect());
    add(guide, guides.map(|guides: Vec<u8>| Array::vector(guides)));
    let ids = labels.closest_guides.as_ref();
    add(closest, ids.map(|ids| shaped(strands, 3, ids.as_flattened().to_vec())));
    let own = labels.guide_weights.as_ref();
    add(weights, own.map(|w| shaped(strands, 3, w.as_flattened().to_vec())));
    arrays
}
