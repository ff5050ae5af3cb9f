//! The core layer of Alembic: objects, their properties, samples and times.
//!
//! # Theory
//! The root group has six children: version of the layer, version of the library, the top object,
//! metadata of the archive, time samplings, and the list of metadata that headers refer to.
//!
//! - An *object* is a group: its compound property, its child objects, and data with the headers of
//!   the child objects, which end with two checksums (32 bytes).
//! - A *compound property* is a group: its properties, and data with their headers.
//! - A *scalar* or *array property* is a group of samples. Each sample is data that begins with a
//!   checksum (16 bytes); an array has the data of its dimensions behind each sample.
//!
//! The header of a property begins with a u32 of flags:
//!
//! | bits | meaning |
//! | --- | --- |
//! | 0–1 | 0 compound, 1 scalar, 2 and 3 array |
//! | 2–3 | bytes of the following numbers: 1, 2 or 4 |
//! | 4–7 | type of the values |
//! | 8 | the index of the time sampling is written |
//! | 9 | first and last sample that differ from the one before are written |
//! | 11 | all samples are equal |
//! | 12–19 | values of one item, such as 3 for a point |
//! | 20–27 | index of the metadata, 255 if it is written |
//!
//! The number of samples follows, then what bits 8 and 9 announce, the name and the metadata. Only
//! samples 0 and first..=last are stored. (Sources: `AbcCoreOgawa` of the Alembic library.)
//!
//! # Practice
//! Names and metadata that are not UTF-8 are read with replacement characters.
//!
//! # Limitations
//! Checksums are not verified. Ranks above 1 are read as a flat array.

use std::{
    io::{Read, Seek},
    sync::Arc,
};

use glam::{DVec3, Vec3};

use super::{
    AlembicError,
    ogawa::{Child, Ogawa, invalid},
    times::TimeSampling,
};
use crate::{bytes::Bytes, error::FormatError};

/// The bytes of the checksums behind the headers of child objects.
const OBJECT_CHECKSUMS: usize = 32;
/// The bytes of the checksum before a sample.
const CHECKSUM: usize = 16;

/// An Alembic archive.
pub(super) struct Archive<R> {
    ogawa: Ogawa<R>,
    /// Metadata of the archive, `key=value;…`.
    pub metadata: Arc<str>,
    /// The group of the top object.
    pub top: Child,
    samplings: Vec<TimeSampling>,
    indexed: Vec<Arc<str>>,
}

/// An object: its compound property and its children.
pub(super) struct Object {
    pub properties: Child,
    pub children: Vec<ObjectHeader>,
}

/// The header of an object, and its group.
pub(super) struct ObjectHeader {
    pub name: String,
    pub metadata: Arc<str>,
    pub group: Child,
}

/// The header of a property, and its group.
#[derive(Clone, Debug)]
pub(super) struct Property {
    pub name: String,
    pub group: Child,
    /// `None` for a compound.
    pub samples: Option<Samples>,
}

/// What the header of a scalar or array property says of its samples.
#[derive(Clone, Copy, Debug)]
pub(super) struct Samples {
    is_array: bool,
    type_code: u8,
    /// The number of samples.
    pub count: u32,
    /// The first and last sample that differ from the one before; 0 and 0 if none does.
    changed: [u32; 2],
    sampling: usize,
}

impl Samples {
    /// The index among the stored samples, and that of the child, of sample `index`.
    fn child(&self, index: u32) -> u64 {
        let [first, last] = self.changed;
        let stored = if index < first || last == 0 { 0 } else { u64::from(index.min(last) - first) + 1 };
        stored * if self.is_array { 2 } else { 1 }
    }
}

/// One sample.
pub(super) struct Sample {
    type_code: u8,
    bytes: Vec<u8>,
    /// Where it lies in the file.
    pub offset: u64,
}

impl<R: Read + Seek> Archive<R> {
    pub fn open(file: R) -> Result<Self, AlembicError> {
        let (mut ogawa, root) = Ogawa::open(file)?;
        let children = ogawa.group(root)?;
        let [version, library, top, metadata, samplings, indexed] = match children[..] {
            [a, b, c, d, e, f, ..] => [a, b, c, d, e, f],
            _ => return Err(invalid(root.offset(), "the root group does not have the parts of an archive")),
        };
        if ogawa.header(version)? != [0; 4] {
            let words = "the version of the core layer is not 0, the only one that is known";
            return Err(invalid(version.offset(), words));
        }
        // The version of the library that wrote the file does not change the layout.
        ogawa.header(library)?;
        let metadata = String::from_utf8_lossy(&ogawa.header(metadata)?).into();
        let samplings = TimeSampling::read_all(&ogawa.header(samplings)?)
            .map_err(|error| place(error, samplings.offset() + 8))?;
        let indexed = read_indexed(&ogawa.header(indexed)?, indexed.offset())?;
        Ok(Self { ogawa, metadata, top, samplings, indexed })
    }

    /// Reads the object in `group`.
    pub fn object(&mut self, group: Child) -> Result<Object, AlembicError> {
        let mut parts = self.ogawa.group(group)?;
        let headers = parts.pop_if(|last| last.is_data());
        let properties = parts.first().copied().unwrap_or(Child(0));
        let mut children = Vec::new();
        if let Some(at) = headers {
            let bytes = self.ogawa.header(at)?;
            let bytes = &bytes[..bytes.len().saturating_sub(OBJECT_CHECKSUMS)];
            let mut cursor = Headers { bytes: Bytes::new(bytes, ".abc"), base: at.offset() + 8, wide: 4 };
            while cursor.bytes.left() > 0 {
                let name = cursor.text()?;
                let index = cursor.number(1)?;
                let metadata = self.metadata(index, &mut cursor)?;
                let group = parts.get(children.len() + 1).copied();
                let group = group.ok_or_else(|| cursor.invalid(format!("object `{name}` has no group")))?;
                children.push(ObjectHeader { name, metadata, group });
            }
        }
        Ok(Object { properties, children })
    }

    /// Reads the headers of the properties of the compound in `group`.
    pub fn properties(&mut self, group: Child) -> Result<Vec<Property>, AlembicError> {
        let parts = self.ogawa.group(group)?;
        let Some((&at, parts)) = parts.split_last() else { return Ok(Vec::new()) };
        let bytes = self.ogawa.header(at)?;
        let mut cursor = Headers { bytes: Bytes::new(&bytes, ".abc"), base: at.offset() + 8, wide: 4 };
        let mut properties = Vec::new();
        while cursor.bytes.left() > 0 {
            let flags = cursor.number(4)?;
            cursor.wide = match flags >> 2 & 3 {
                0 => 1,
                1 => 2,
                2 => 4,
                _ => return Err(cursor.invalid("the size of numbers in a header is unknown")),
            };
            let samples = (flags & 3 != 0).then(|| self.samples(flags, &mut cursor)).transpose()?;
            let name = cursor.text()?;
            self.metadata(flags >> 20 & 0xff, &mut cursor)?;
            let group = parts.get(properties.len()).copied();
            let group = group.ok_or_else(|| cursor.invalid(format!("property `{name}` has no group")))?;
            properties.push(Property { name, group, samples });
        }
        Ok(properties)
    }

    fn samples(&self, flags: u32, cursor: &mut Headers<'_>) -> Result<Samples, AlembicError> {
        let count = cursor.number(cursor.wide)?;
        let changed = if flags & 0x200 != 0 {
            [cursor.number(cursor.wide)?, cursor.number(cursor.wide)?]
        } else if flags & 0x800 != 0 || count < 2 {
            [0, 0]
        } else {
            [1, count - 1]
        };
        if changed[0] > changed[1] {
            return Err(cursor.invalid(format!("samples {} to {} are in no order", changed[0], changed[1])));
        }
        let sampling = if flags & 0x100 != 0 { cursor.number(cursor.wide)? as usize } else { 0 };
        if sampling >= self.samplings.len() {
            return Err(cursor.invalid(format!("time sampling {sampling} does not exist")));
        }
        let type_code = (flags >> 4 & 15) as u8;
        Ok(Samples { is_array: flags & 2 != 0, type_code, count, changed, sampling })
    }

    fn metadata(&self, index: u32, cursor: &mut Headers<'_>) -> Result<Arc<str>, AlembicError> {
        if index == 255 {
            return Ok(cursor.text()?.into());
        }
        let metadata = self.indexed.get(index as usize).cloned();
        metadata.ok_or_else(|| cursor.invalid(format!("metadata {index} does not exist")))
    }

    /// The time of sample `index` of `samples` in seconds.
    pub fn time_secs(&self, samples: Samples, index: u32) -> f64 {
        self.samplings[samples.sampling].time_secs(index)
    }

    /// Allows the samples of one groom to be read.
    pub fn begin_samples(&mut self) {
        self.ogawa.begin_samples();
    }

    /// Counts the path of the object in `group`.
    pub fn spend_path(&mut self, path: &str, group: Child) -> Result<(), AlembicError> {
        self.ogawa.spend_path(path.len() as u64, group)
    }

    /// The bytes of the file.
    pub fn size(&self) -> u64 {
        self.ogawa.size()
    }

    /// The times of the first sample of `property`, of the one before its first change, and of all
    /// from there to its last change; none if it does not change. Fails if the last one is not in
    /// the file, so there are at most as many times as samples in the file, and one.
    pub fn changes(&mut self, property: &Property) -> Result<Vec<f64>, AlembicError> {
        let Some(samples) = property.samples.filter(|own| own.count > 1 && own.changed[1] > 0) else {
            return Ok(Vec::new());
        };
        let [first, last] = samples.changed.map(|index| index.min(samples.count - 1));
        self.ogawa.child(property.group, samples.child(last))?;
        let indices = std::iter::once(0).chain(first.saturating_sub(1)..=last);
        Ok(indices.map(|sample| self.time_secs(samples, sample)).collect())
    }

    /// Where the sample of `property` is that is nearest to `time_secs`. It is `None` where there
    /// is no sample, or the property is a compound.
    pub fn place(&mut self, property: &Property, time_secs: f64) -> Result<Option<Child>, AlembicError> {
        let Some(samples) = property.samples.filter(|samples| samples.count > 0) else { return Ok(None) };
        let index = self.samplings[samples.sampling].nearest(time_secs, samples.count);
        Ok(Some(self.ogawa.child(property.group, samples.child(index))?))
    }

    /// Reads the sample of `property` at `place`.
    pub fn sample_at(&mut self, property: &Property, place: Child) -> Result<Sample, AlembicError> {
        let type_code = property.samples.map_or(u8::MAX, |samples| samples.type_code);
        Ok(Sample { type_code, bytes: self.ogawa.sample(place)?, offset: place.offset() })
    }

    /// Reads the sample of `property` that is nearest to `time_secs`, as [`place`](Self::place).
    pub fn sample(&mut self, property: &Property, time_secs: f64) -> Result<Option<Sample>, AlembicError> {
        let place = self.place(property, time_secs)?;
        place.map(|place| self.sample_at(property, place)).transpose()
    }
}

/// The list of metadata that headers refer to. Entry 0 is empty.
fn read_indexed(bytes: &[u8], offset: u64) -> Result<Vec<Arc<str>>, AlembicError> {
    let mut cursor = Headers { bytes: Bytes::new(bytes, ".abc"), base: offset + 8, wide: 1 };
    let mut indexed = vec![Arc::from("")];
    while cursor.bytes.left() > 0 {
        indexed.push(cursor.text()?.into());
    }
    Ok(indexed)
}

/// A cursor over headers.
struct Headers<'a> {
    bytes: Bytes<'a>,
    /// The offset of the bytes in the file.
    base: u64,
    /// The bytes of the lengths of texts.
    wide: u64,
}

impl Headers<'_> {
    fn number(&mut self, wide: u64) -> Result<u32, AlembicError> {
        let taken = self.bytes.take(wide, 1, "the numbers of a header");
        let bytes = taken.map_err(|error| self.place(error))?;
        Ok(bytes.iter().rev().fold(0, |sum, &byte| sum << 8 | u32::from(byte)))
    }

    fn text(&mut self) -> Result<String, AlembicError> {
        let length = self.number(self.wide)?;
        let taken = self.bytes.take(u64::from(length), 1, "the texts of a header");
        Ok(String::from_utf8_lossy(taken.map_err(|error| self.place(error))?).into_owned())
    }

    fn invalid(&self, words: impl Into<String>) -> AlembicError {
        self.place(self.bytes.invalid(words))
    }

    fn place(&self, error: FormatError) -> AlembicError {
        place(error, self.base)
    }
}

/// The error of bytes that begin at `base` in the file.
fn place(mut error: FormatError, base: u64) -> AlembicError {
    error.offset = error.offset.saturating_add(base);
    error.into()
}

impl Property {
    /// The property with `name` among `all`.
    pub fn find<'a>(all: &'a [Self], name: &str) -> Option<&'a Self> {
        all.iter().find(|property| property.name == name)
    }
}

impl Sample {
    fn values(&self) -> &[u8] {
        self.bytes.get(CHECKSUM..).unwrap_or_default()
    }

    /// The values as points, if they are floating-point numbers.
    pub fn points(&self) -> Option<Vec<Vec3>> {
        let values = self.values();
        match self.type_code {
            10 => Some(each(values, |p: [u8; 12]| Vec3::from_slice(&bytemuck::cast::<_, [f32; 3]>(p)))),
            11 => Some(each(values, |p: [u8; 24]| DVec3::from_array(bytemuck::cast(p)).as_vec3())),
            _ => None,
        }
    }

    /// The values as float32, if they are numbers.
    pub fn floats(&self) -> Option<Vec<f32>> {
        let doubles = |v: [u8; 8]| f64::from_le_bytes(v) as f32;
        Some(match self.type_code {
            10 => each(self.values(), f32::from_le_bytes),
            11 => each(self.values(), doubles),
            _ => self.integers()?.into_iter().map(|v| v as f32).collect(),
        })
    }

    /// The values as float64, if they are numbers.
    pub fn doubles(&self) -> Option<Vec<f64>> {
        match self.type_code {
            11 => Some(each(self.values(), f64::from_le_bytes)),
            _ => Some(self.floats()?.into_iter().map(f64::from).collect()),
        }
    }

    /// The values as int64, if they are integers. Larger ones become the largest.
    pub fn wide_integers(&self) -> Option<Vec<i64>> {
        match self.type_code {
            5 => Some(each(self.values(), |v| u32::from_le_bytes(v).into())),
            7 => Some(each(self.values(), |v| i64::try_from(u64::from_le_bytes(v)).unwrap_or(i64::MAX))),
            8 => Some(each(self.values(), i64::from_le_bytes)),
            _ => Some(self.integers()?.into_iter().map(i64::from).collect()),
        }
    }

    /// The values as int32, if they are integers. Larger ones become the largest.
    pub fn integers(&self) -> Option<Vec<i32>> {
        let values = self.values();
        Some(match self.type_code {
            0 | 1 => values.iter().map(|&v| i32::from(v)).collect(),
            2 => each(values, |v| i32::from(i8::from_le_bytes(v))),
            3 => each(values, |v| i32::from(u16::from_le_bytes(v))),
            4 => each(values, |v| i32::from(i16::from_le_bytes(v))),
            5 => each(values, |v| i32::try_from(u32::from_le_bytes(v)).unwrap_or(i32::MAX)),
            6 => each(values, i32::from_le_bytes),
            7 => each(values, |v| i32::try_from(u64::from_le_bytes(v)).unwrap_or(i32::MAX)),
            8 => each(values, |v| i32::try_from(i64::from_le_bytes(v)).unwrap_or(i32::MAX)),
            _ => return None,
        })
    }
}

fn each<const N: usize, T>(bytes: &[u8], value: impl Fn([u8; N]) -> T) -> Vec<T> {
    bytes.as_chunks().0.iter().map(|&chunk| value(chunk)).collect()
}
