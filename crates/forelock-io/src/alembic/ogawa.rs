//! Reading of Ogawa, the container of Alembic files.
//!
//! # Theory
//! The file starts with 16 bytes: `Ogawa`, 0xff once the file is complete, the version 1 as a
//! big-endian u16, and the offset of the root group as a u64. Everything else is one of two things:
//!
//! | | bytes | reference to it |
//! | --- | --- | --- |
//! | group | u64 n, then n references | its offset; 0 for the empty group |
//! | data | u64 n, then n bytes | its offset + 2⁶³; 2⁶³ for empty data |
//!
//! # Practice
//! A count is compared with the bytes of the file behind it before memory is allocated. The groups
//! and headers of a file do not overlap, so those that are read may take no more bytes than the
//! file has. This stops cycles, and groups that are children of many groups.
//!
//! # Limitations
//! A file that was not completed is refused, for its root group is missing.

use std::io::{self, Read, Seek, SeekFrom};

use super::AlembicError;
use crate::error::{FormatError, Problem, check_room};

/// The bit of a reference that stands for data.
pub(super) const DATA: u64 = 1 << 63;

/// The bytes before the first group or data.
pub(super) const HEADER_BYTES: u64 = 16;

/// Samples may be shared, so reading all of them can take more bytes than the file has. A groom
/// that takes more than this many times the file is refused.
const SHARING: u64 = 8;

/// A reference to a group or to data.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Child(pub u64);

impl Child {
    pub fn is_data(self) -> bool {
        self.0 & DATA != 0
    }

    pub fn offset(self) -> u64 {
        self.0 & !DATA
    }
}

/// An Ogawa file.
pub(super) struct Ogawa<R> {
    file: R,
    size: u64,
    /// The bytes of groups and headers that may still be read.
    structure_left: u64,
    /// The bytes of samples that may still be read for one groom.
    samples_left: u64,
    /// The bytes that paths of objects may still take.
    paths_left: u64,
}

impl<R: Read + Seek> Ogawa<R> {
    /// Opens `file` and returns it with its root group.
    pub fn open(mut file: R) -> Result<(Self, Child), AlembicError> {
        let size = file.seek(SeekFrom::End(0))?;
        let mut ogawa = Self { file, size, structure_left: size, samples_left: 0, paths_left: size };
        let header = ogawa.bytes(0, HEADER_BYTES, "the fields of the header")?;
        if header.starts_with(b"\x89HDF") {
            return Err(invalid(0, "this is the HDF5 kind of Alembic; convert it to Ogawa"));
        }
        if !header.starts_with(b"Ogawa") {
            return Err(invalid(0, "this is not an Alembic file: it does not begin with `Ogawa`"));
        }
        if header[5] != 0xff {
            return Err(invalid(5, "the file was not completed; export it again"));
        }
        if header[6..8] != [0, 1] {
            return Err(invalid(6, "the version of Ogawa is not 1, the only one that is known"));
        }
        let root = Child(ogawa.number(8)?);
        Ok((ogawa, root))
    }

    /// The bytes of the file.
    pub fn size(&self) -> u64 {
        self.size
    }

    /// The children of `group`.
    pub fn group(&mut self, group: Child) -> Result<Vec<Child>, AlembicError> {
        let count = self.count(group)?;
        // The count was compared with the size of the file.
        let bytes = 8 * count + 8;
        self.spend_structure(bytes, group)?;
        let children = self.bytes(group.offset(), bytes, "the children of a group")?;
        Ok(children.as_chunks().0.iter().skip(1).map(|&child| Child(u64::from_le_bytes(child))).collect())
    }

    /// The number of children of `group`.
    fn count(&mut self, group: Child) -> Result<u64, AlembicError> {
        if group.is_data() {
            return Err(invalid(group.offset(), "data, where a group is expected"));
        }
        if group.offset() == 0 {
            return Ok(0);
        }
        let count = self.number(group.offset())?;
        self.check(group.offset() + 8, count.saturating_mul(8), "the children of a group")?;
        Ok(count)
    }

    /// Child `index` of `group`.
    pub fn child(&mut self, group: Child, index: u64) -> Result<Child, AlembicError> {
        let count = self.count(group)?;
        if index >= count {
            let words = format!("child {index} of a group is missing: it has {count}");
            return Err(invalid(group.offset(), words));
        }
        Ok(Child(self.number(group.offset() + 8 + 8 * index)?))
    }

    /// The bytes of a header.
    pub fn header(&mut self, data: Child) -> Result<Vec<u8>, AlembicError> {
        let bytes = self.data(data, "a header")?;
        self.spend_structure(bytes.len() as u64, data)?;
        Ok(bytes)
    }

    /// The bytes of a sample, which begin with a checksum of 16 bytes.
    pub fn sample(&mut self, data: Child) -> Result<Vec<u8>, AlembicError> {
        let size = self.data_size(data)?;
        self.check(data.offset() + 8, size, "a sample")?;
        self.samples_left = self.samples_left.checked_sub(size).ok_or_else(|| {
            let words = format!("the samples take over {SHARING} times the bytes of the file");
            invalid(data.offset(), words)
        })?;
        self.data(data, "a sample")
    }

    /// Allows the samples of one groom to be read.
    pub fn begin_samples(&mut self) {
        self.samples_left = self.size.saturating_mul(SHARING);
    }

    fn data_size(&mut self, data: Child) -> Result<u64, AlembicError> {
        if !data.is_data() {
            return Err(invalid(data.offset(), "a group, where data is expected"));
        }
        if data.offset() == 0 { Ok(0) } else { self.number(data.offset()) }
    }

    fn data(&mut self, data: Child, what: &'static str) -> Result<Vec<u8>, AlembicError> {
        let size = self.data_size(data)?;
        if size == 0 { Ok(Vec::new()) } else { self.bytes(data.offset() + 8, size, what) }
    }

    fn spend_structure(&mut self, bytes: u64, at: Child) -> Result<(), AlembicError> {
        self.structure_left = self
            .structure_left
            .checked_sub(bytes)
            .ok_or_else(|| invalid(at.offset(), "groups contain each other or overlap"))?;
        Ok(())
    }

    /// Counts `bytes` of a path. An object takes more bytes than its path, unless names are long
    /// and many objects lie below them.
    pub fn spend_path(&mut self, bytes: u64, at: Child) -> Result<(), AlembicError> {
        let left = self.paths_left.checked_sub(bytes);
        let words = "the paths of the objects take more bytes than the file; shorten their names";
        self.paths_left = left.ok_or_else(|| invalid(at.offset(), words))?;
        Ok(())
    }

    fn number(&mut self, offset: u64) -> Result<u64, AlembicError> {
        self.check(offset, 8, "a count or an offset")?;
        let mut bytes = [0; 8];
        self.file.seek(SeekFrom::Start(offset))?;
        self.file.read_exact(&mut bytes)?;
        Ok(u64::from_le_bytes(bytes))
    }

    fn bytes(&mut self, offset: u64, size: u64, what: &'static str) -> Result<Vec<u8>, AlembicError> {
        self.check(offset, size, what)?;
        check_room(size)?;
        let mut bytes = vec![0; usize::try_from(size).map_err(|_| io::ErrorKind::OutOfMemory)?];
        self.file.seek(SeekFrom::Start(offset))?;
        self.file.read_exact(&mut bytes)?;
        Ok(bytes)
    }

    /// Checks that the file has `needed` bytes at `offset`.
    fn check(&self, offset: u64, needed: u64, what: &'static str) -> Result<(), AlembicError> {
        let left = self.size.saturating_sub(offset);
        if needed > left {
            return Err(error(offset, Problem::Short { what, needed, left }));
        }
        Ok(())
    }
}

pub(super) fn error(offset: u64, problem: Problem) -> AlembicError {
    FormatError { format: ".abc", offset, strand: None, problem }.into()
}

pub(super) fn invalid(offset: u64, words: impl Into<String>) -> AlembicError {
    error(offset, Problem::Invalid(words.into()))
}
