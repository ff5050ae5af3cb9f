//! Writing of archives: groups, data, properties and their headers. The layout is described in
//! [`ogawa`](super::ogawa) and [`archive`](super::archive).
//!
//! # Theory
//! A group lists the offsets of its children, so children are written first. Samples are written
//! when they come; groups and headers, which need the number of samples, at the end. Between the
//! two a property remembers the offset of each sample that differs from the one before.
//!
//! # Practice
//! Memory grows by 8 bytes for each sample that differs. Equal consecutive samples are stored once
//! where they are the first or the last of a property.
//!
//! # Limitations
//! Checksums of objects are MurmurHash3 over headers and samples; those of the Alembic library are
//! SpookyHash. They serve the same purpose: objects of equal checksums are equal.

use std::io::{self, Seek, SeekFrom, Write};

use super::{
    hash::checksum,
    ogawa::{Child, DATA, HEADER_BYTES},
};

/// An Ogawa file that is being written.
pub(super) struct Output<W> {
    file: W,
    at: u64,
}

impl<W: Write + Seek> Output<W> {
    pub fn new(mut file: W) -> io::Result<Self> {
        file.write_all(b"Ogawa\0\0\x01\0\0\0\0\0\0\0\0")?;
        Ok(Self { file, at: HEADER_BYTES })
    }

    /// Writes data that consists of `parts`.
    pub fn data(&mut self, parts: &[&[u8]]) -> io::Result<Child> {
        let size: u64 = parts.iter().map(|part| part.len() as u64).sum();
        if size == 0 {
            return Ok(Child(DATA));
        }
        self.file.write_all(&size.to_le_bytes())?;
        parts.iter().try_for_each(|part| self.file.write_all(part))?;
        Ok(Child(self.advance(8 + size) | DATA))
    }

    pub fn group(&mut self, children: &[Child]) -> io::Result<Child> {
        if children.is_empty() {
            return Ok(Child(0));
        }
        let count = children.len() as u64;
        self.file.write_all(&count.to_le_bytes())?;
        children.iter().try_for_each(|child| self.file.write_all(&child.0.to_le_bytes()))?;
        Ok(Child(self.advance(8 + 8 * count)))
    }

    /// Completes the file, whose root group is `root`.
    pub fn finish(mut self, root: Child) -> io::Result<W> {
        self.file.flush()?;
        self.file.seek(SeekFrom::Start(8))?;
        self.file.write_all(&root.0.to_le_bytes())?;
        self.file.seek(SeekFrom::Start(5))?;
        self.file.write_all(&[0xff])?;
        self.file.flush()?;
        Ok(self.file)
    }

    /// Adds `bytes` to the offset and returns the offset before.
    fn advance(&mut self, bytes: u64) -> u64 {
        let start = self.at;
        self.at += bytes;
        start
    }
}

/// The types of values that are written.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(u8)]
pub(super) enum Type {
    U8 = 1,
    I16 = 4,
    I32 = 6,
    F32 = 10,
    F64 = 11,
}

impl Type {
    fn bytes(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::I16 => 2,
            Self::I32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }
}

/// What the header of a scalar or array property says, apart from its samples.
#[derive(Clone, Copy, Debug)]
pub(super) struct Kind {
    pub name: &'static str,
    pub metadata: &'static str,
    pub is_array: bool,
    pub type_: Type,
    /// Values of one item.
    pub extent: u8,
}

/// A scalar or array property that is being written.
pub(super) struct Track {
    kind: Kind,
    /// The samples that are stored.
    stored: Vec<Child>,
    count: u32,
    changed: [u32; 2],
    /// Whether each sample has one item.
    is_single: bool,
    /// The checksum of the last sample, and of all samples.
    last: [u8; 16],
    all: [u8; 16],
}

impl Track {
    pub fn new(kind: Kind) -> Self {
        let (last, all) = ([0; 16], [0; 16]);
        Self { kind, stored: Vec::new(), count: 0, changed: [0; 2], is_single: true, last, all }
    }

    /// The number of samples.
    pub fn count(&self) -> u32 {
        self.count
    }

    /// Appends a sample.
    pub fn push<W: Write + Seek>(&mut self, out: &mut Output<W>, bytes: &[u8]) -> io::Result<()> {
        let sum = checksum(bytes);
        if self.count == 0 || sum != self.last {
            let data = out.data(&[&sum, bytes])?;
            if let (true, Some(&before)) = (self.changed[1] > 0, self.stored.last()) {
                // Between two changes, every sample has an entry.
                self.stored.extend((self.changed[1] + 1..self.count).map(|_| before));
            }
            self.stored.push(data);
            if self.changed[0] == 0 {
                self.changed[0] = self.count;
            }
            self.changed[1] = self.count;
            self.is_single &= bytes.len() == self.kind.type_.bytes() * usize::from(self.kind.extent);
            self.last = sum;
        }
        self.all = checksum(&[self.all, sum].concat());
        self.count += 1;
        Ok(())
    }

    /// Repeats the last sample until there are `count`.
    pub fn repeat_to(&mut self, count: u32) {
        self.count = self.count.max(count);
    }

    fn flags(&self) -> u32 {
        let mut flags = if self.kind.is_array { 2 | u32::from(self.is_single) } else { 1 };
        flags |= (self.kind.type_ as u32) << 4 | u32::from(self.kind.extent) << 12;
        // All samples have the same number of items.
        flags |= 0x400;
        match self.changed {
            [0, 0] => flags | 0x800,
            [1, last] if last == self.count - 1 => flags,
            _ => flags | 0x200,
        }
    }
}

/// The metadata that headers refer to. Entry 0 is empty and not stored.
#[derive(Default)]
pub(super) struct Indexed(Vec<&'static str>);

impl Indexed {
    pub fn index(&mut self, metadata: &'static str) -> u8 {
        if metadata.is_empty() {
            return 0;
        }
        let found = self.0.iter().position(|own| *own == metadata);
        let position = found.unwrap_or_else(|| {
            self.0.push(metadata);
            self.0.len() - 1
        });
        // There are a dozen kinds of metadata.
        position as u8 + 1
    }

    /// The bytes of the list. Each text is shorter than 256 bytes.
    pub fn bytes(&self) -> Vec<u8> {
        self.0.iter().flat_map(|text| std::iter::once(text.len() as u8).chain(text.bytes())).collect()
    }
}

/// A compound property that is being written: its group, and the checksum of its contents.
pub(super) struct Compound<'a, W> {
    out: &'a mut Output<W>,
    indexed: &'a mut Indexed,
    children: Vec<Child>,
    headers: Vec<u8>,
    sums: Vec<u8>,
}

impl<'a, W: Write + Seek> Compound<'a, W> {
    pub fn new(out: &'a mut Output<W>, indexed: &'a mut Indexed) -> Self {
        Self { out, indexed, children: Vec::new(), headers: Vec::new(), sums: Vec::new() }
    }

    /// Adds the property `track`, whose samples are at the times of sampling `sampling`.
    pub fn add(&mut self, track: &Track, sampling: u8) -> io::Result<()> {
        let each = if track.kind.is_array { 2 } else { 1 };
        // The dimensions of an array follow from the size of the sample.
        let parts = track.stored.iter().flat_map(|&sample| [sample, Child(DATA)].into_iter().take(each));
        let group = self.out.group(&parts.collect::<Vec<_>>())?;
        let has_sampling = u32::from(sampling != 0) << 8;
        // All numbers take 4 bytes: hint 2.
        let flags = track.flags() | 2 << 2 | has_sampling | self.metadata(track.kind.metadata);
        let mut numbers = vec![flags, track.count];
        if flags & 0x200 != 0 {
            numbers.extend(track.changed);
        }
        if sampling != 0 {
            numbers.push(u32::from(sampling));
        }
        self.push(group, &numbers, track.kind.name);
        self.sums.extend(track.all);
        Ok(())
    }

    /// Adds the compound property `name` with the properties that `fill` adds to it.
    pub fn add_compound(
        &mut self,
        name: &'static str,
        metadata: &'static str,
        fill: impl FnOnce(&mut Compound<'_, W>) -> io::Result<()>,
    ) -> io::Result<()> {
        let mut inner = Compound::new(self.out, self.indexed);
        fill(&mut inner)?;
        let (group, sum) = inner.finish()?;
        let flags = 2 << 2 | self.metadata(metadata);
        self.push(group, &[flags], name);
        self.sums.extend(sum);
        Ok(())
    }

    /// Writes the group. Returns it with the checksum of its contents.
    pub fn finish(mut self) -> io::Result<(Child, [u8; 16])> {
        self.children.push(self.out.data(&[&self.headers])?);
        let group = self.out.group(&self.children)?;
        Ok((group, checksum(&[self.headers, self.sums].concat())))
    }

    fn metadata(&mut self, metadata: &'static str) -> u32 {
        u32::from(self.indexed.index(metadata)) << 20
    }

    fn push(&mut self, group: Child, numbers: &[u32], name: &str) {
        self.children.push(group);
        self.headers.extend(numbers.iter().flat_map(|number| number.to_le_bytes()));
        self.headers.extend((name.len() as u32).to_le_bytes());
        self.headers.extend(name.bytes());
    }
}
