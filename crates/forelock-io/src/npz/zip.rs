//! The part of ZIP (PKWARE APPNOTE 6.3) that `.npz` needs: stored and deflated members, and sizes
//! beyond 4 GiB.
//!
//! Like NumPy, the writer stores sizes in the ZIP64 extra field of the local header and sets the
//! 32-bit fields to their maximum. So the header of a member has the same length whether or not its
//! size is known yet.

use std::io::{self, Read, Seek, SeekFrom};

use super::{
    NpzError,
    npy::{Array, HEADER_LIMIT, Header},
};
use crate::error::{FormatError, Problem, check_room};

const LOCAL: [u8; 4] = *b"PK\x03\x04";
const CENTRAL: [u8; 4] = *b"PK\x01\x02";
const END: [u8; 4] = *b"PK\x05\x06";
const END64: [u8; 4] = *b"PK\x06\x06";
const LOCATOR64: [u8; 4] = *b"PK\x06\x07";

const STORED: u16 = 0;
const DEFLATED: u16 = 8;
/// The largest ratio of decompressed to compressed bytes that deflate allows.
const MOST_INFLATION: u64 = 1032;
/// 1 January 1980. The date is constant, so that equal arrays give equal bytes.
const DATE: u16 = 0x21;
const SATURATED: u32 = u32::MAX;

/// A member of an archive.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Entry {
    pub name: String,
    method: u16,
    pub crc: u32,
    packed: u64,
    pub size: u64,
    /// The offset of the local header.
    pub header: u64,
}

fn invalid(offset: u64, words: impl Into<String>) -> NpzError {
    FormatError { format: ".npz", offset, strand: None, problem: Problem::Invalid(words.into()) }.into()
}

fn u16_at(bytes: &[u8], at: usize) -> u16 {
    bytemuck::pod_read_unaligned(&bytes[at..at + 2])
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    bytemuck::pod_read_unaligned(&bytes[at..at + 4])
}

fn u64_at(bytes: &[u8], at: usize) -> u64 {
    bytemuck::pod_read_unaligned(&bytes[at..at + 8])
}

impl Entry {
    /// A stored member.
    pub fn stored(name: &str, crc: u32, size: u64, header: u64) -> Self {
        Self { name: name.into(), method: STORED, crc, packed: size, size, header }
    }

    pub fn is_stored(&self) -> bool {
        self.method == STORED
    }

    /// The length of the local header in bytes.
    pub fn local_bytes(&self) -> u64 {
        30 + self.name.len() as u64 + 20
    }

    /// The local header.
    pub fn local(&self) -> Vec<u8> {
        let mut out = LOCAL.to_vec();
        self.common(&mut out, true);
        out.extend((self.name.len() as u16).to_le_bytes());
        out.extend(20u16.to_le_bytes());
        out.extend(self.name.as_bytes());
        out.extend([1, 0, 16, 0]);
        out.extend(self.size.to_le_bytes());
        out.extend(self.packed.to_le_bytes());
        out
    }

    /// Writes the fields that the local and the central header share: from the version needed to
    /// the sizes.
    fn common(&self, out: &mut Vec<u8>, wide: bool) {
        let fit = |size: u64| if wide { SATURATED } else { u32::try_from(size).unwrap_or(SATURATED) };
        for half in [45, 0, self.method, 0, DATE] {
            out.extend(half.to_le_bytes());
        }
        for word in [self.crc, fit(self.packed), fit(self.size)] {
            out.extend(word.to_le_bytes());
        }
    }

    fn central(&self, out: &mut Vec<u8>) {
        let wide = [self.size, self.packed, self.header].iter().any(|&n| n >= SATURATED.into());
        out.extend(CENTRAL);
        out.extend(45u16.to_le_bytes());
        self.common(out, wide);
        let extra: u16 = if wide { 28 } else { 0 };
        for half in [self.name.len() as u16, extra, 0, 0, 0, 0, 0] {
            out.extend(half.to_le_bytes());
        }
        let header = if wide { SATURATED } else { u32::try_from(self.header).unwrap_or(SATURATED) };
        out.extend(header.to_le_bytes());
        out.extend(self.name.as_bytes());
        if wide {
            out.extend([1, 0, 24, 0]);
            for value in [self.size, self.packed, self.header] {
                out.extend(value.to_le_bytes());
            }
        }
    }
}

/// The end of an archive: the central directory of `entries`, which starts at byte `at`, and the
/// end records.
pub(super) fn directory(entries: &[Entry], at: u64) -> Vec<u8> {
    let mut out = Vec::new();
    for entry in entries {
        entry.central(&mut out);
    }
    let (count, size) = (entries.len() as u64, out.len() as u64);
    let wide = at + size >= SATURATED.into() || count >= u16::MAX.into();
    if wide {
        out.extend(END64);
        out.extend(44u64.to_le_bytes());
        out.extend([45, 0, 45, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
        for value in [count, count, size, at] {
            out.extend(value.to_le_bytes());
        }
        out.extend(LOCATOR64);
        out.extend(0u32.to_le_bytes());
        out.extend((at + size).to_le_bytes());
        out.extend(1u32.to_le_bytes());
    }
    out.extend(END);
    let count = if wide { u16::MAX } else { count as u16 };
    for half in [0, 0, count, count] {
        out.extend(half.to_le_bytes());
    }
    for value in [size, at] {
        out.extend((if wide { SATURATED } else { value as u32 }).to_le_bytes());
    }
    out.extend([0, 0]);
    out
}

/// An archive that is open for reading.
pub(super) struct Archive<R> {
    file: R,
    bytes: u64,
    pub entries: Vec<Entry>,
}

/// The place of an archive's directory.
struct DirectoryPlace {
    /// The number of members.
    count: u64,
    /// Bytes of the directory.
    size: u64,
    /// The offset of its first byte.
    at: u64,
}

impl<R: Read + Seek> Archive<R> {
    /// Opens `file` and reads its directory.
    pub fn open(mut file: R) -> Result<Self, NpzError> {
        let bytes = file.seek(SeekFrom::End(0))?;
        let mut archive = Self { file, bytes, entries: Vec::new() };
        let DirectoryPlace { count, size, at } = archive.find_directory()?;
        if count.saturating_mul(46) > size {
            return Err(invalid(at, format!("its directory of {size} bytes cannot list {count} members")));
        }
        let directory = archive.read_at(at, size)?;
        let mut rest = directory.as_slice();
        for _ in 0..count {
            let place = at + (directory.len() - rest.len()) as u64;
            let (entry, after) = central_entry(rest)
                .ok_or_else(|| invalid(place, "its directory is damaged; write the file again"))?;
            archive.entries.push(entry);
            rest = after;
        }
        Ok(archive)
    }

    /// Finds the directory.
    fn find_directory(&mut self) -> Result<DirectoryPlace, NpzError> {
        let tail_bytes = self.bytes.min(22 + u64::from(u16::MAX));
        let tail_at = self.bytes - tail_bytes;
        let tail = self.read_at(tail_at, tail_bytes)?;
        let is_end = |&at: &usize| {
            tail[at..].starts_with(&END) && at + 22 + usize::from(u16_at(&tail, at + 20)) <= tail.len()
        };
        let Some(end) = (0..(tail.len() + 1).saturating_sub(22)).rev().find(is_end) else {
            let words = "its directory, the end of the file, is missing; the file is cut short or not .npz";
            return Err(invalid(self.bytes, words));
        };
        let mut found = DirectoryPlace {
            count: u16_at(&tail, end + 10).into(),
            size: u32_at(&tail, end + 12).into(),
            at: u32_at(&tail, end + 16).into(),
        };
        let end = tail_at + end as u64;
        let saturated =
            found.count == u64::from(u16::MAX) || [found.size, found.at].contains(&SATURATED.into());
        if let Some(locator) = end.checked_sub(20).filter(|_| saturated) {
            let place = self.read_at(locator, 20)?;
            if place.starts_with(&LOCATOR64) {
                let at = u64_at(&place, 8);
                let end64 = self.read_at(at, 56)?;
                if !end64.starts_with(&END64) {
                    return Err(invalid(at, "its ZIP64 directory is damaged; write the file again"));
                }
                found = DirectoryPlace {
                    count: u64_at(&end64, 32),
                    size: u64_at(&end64, 40),
                    at: u64_at(&end64, 48),
                };
            }
        }
        Ok(found)
    }

    /// Reads `count` bytes from byte `at`. Checks that they exist before it allocates memory.
    pub fn read_at(&mut self, at: u64, count: u64) -> Result<Vec<u8>, NpzError> {
        let left = self.bytes.saturating_sub(at);
        if count > left {
            let problem = Problem::Short { what: "its records", needed: count, left };
            return Err(FormatError { format: ".npz", offset: at, strand: None, problem }.into());
        }
        check_room(count)?;
        self.file.seek(SeekFrom::Start(at))?;
        let mut bytes =
            vec![0; usize::try_from(count).map_err(|_| invalid(at, "a member is larger than the memory"))?];
        self.file.read_exact(&mut bytes)?;
        Ok(bytes)
    }

    pub fn find(&self, name: &str) -> Option<Entry> {
        self.entries.iter().find(|entry| entry.name == name).cloned()
    }

    /// The offset of a member's data.
    pub fn data_start(&mut self, entry: &Entry) -> Result<u64, NpzError> {
        let local = self.read_at(entry.header, 30)?;
        if !local.starts_with(&LOCAL) {
            return Err(invalid(entry.header, format!("the header of member `{}` is damaged", entry.name)));
        }
        let start = entry.header + 30 + u64::from(u16_at(&local, 26)) + u64::from(u16_at(&local, 28));
        let left = self.bytes.saturating_sub(start);
        if entry.packed > left {
            let problem = Problem::Short { what: "the bytes of a member", needed: entry.packed, left };
            return Err(FormatError { format: ".npz", offset: start, strand: None, problem }.into());
        }
        Ok(start)
    }

    /// A reader of a member's decompressed bytes.
    pub fn member(&mut self, entry: &Entry) -> Result<Box<dyn Read + '_>, NpzError> {
        let start = self.data_start(entry)?;
        self.file.seek(SeekFrom::Start(start))?;
        let packed = (&mut self.file).take(entry.packed);
        match entry.method {
            STORED if entry.packed == entry.size => Ok(Box::new(packed)),
            DEFLATED if entry.size / MOST_INFLATION <= entry.packed => {
                Ok(Box::new(flate2::read::DeflateDecoder::new(packed).take(entry.size)))
            }
            STORED | DEFLATED => Err(invalid(
                entry.header,
                format!(
                    "member `{}` claims {} bytes, which {} compressed bytes cannot give",
                    entry.name, entry.size, entry.packed
                ),
            )),
            method => Err(invalid(
                entry.header,
                format!("member `{}` is compressed by method {method}; save it with numpy.savez", entry.name),
            )),
        }
    }

    /// Reads a member's decompressed bytes and checks their number and checksum.
    pub fn read(&mut self, entry: &Entry) -> Result<Vec<u8>, NpzError> {
        let mut bytes = Vec::new();
        let damaged = |why: &str| invalid(entry.header, format!("member `{}` is damaged: {why}", entry.name));
        check_room(entry.size)?;
        self.member(entry)?.read_to_end(&mut bytes).map_err(|e| match e.kind() {
            io::ErrorKind::InvalidInput | io::ErrorKind::InvalidData => damaged("it cannot be decompressed"),
            _ => e.into(),
        })?;
        if bytes.len() as u64 != entry.size {
            return Err(damaged("it is shorter than its directory entry states"));
        }
        if crc32fast::hash(&bytes) != entry.crc {
            return Err(damaged("its checksum is wrong"));
        }
        Ok(bytes)
    }
}

impl<R: Read + Seek> Archive<R> {
    /// The array `name`, if there is one.
    pub fn array(&mut self, name: &str) -> Result<Option<Array>, NpzError> {
        let Some(entry) = self.find(&format!("{name}.npy")) else { return Ok(None) };
        Ok(Some(Array::from_npy(&self.read(&entry)?)?))
    }

    /// Reads the header of the array in the member `entry`.
    pub fn header(&mut self, entry: &Entry) -> Result<Header, NpzError> {
        let mut head = Vec::new();
        self.member(entry)?.take(HEADER_LIMIT).read_to_end(&mut head)?;
        Ok(Header::parse(&head)?)
    }
}

/// The first entry of a central directory, and the bytes after it.
fn central_entry(bytes: &[u8]) -> Option<(Entry, &[u8])> {
    let (fixed, rest) = bytes.split_at_checked(46)?;
    if !fixed.starts_with(&CENTRAL) || fixed[8] & 1 != 0 {
        return None;
    }
    let (name, rest) = rest.split_at_checked(u16_at(fixed, 28).into())?;
    let (extra, rest) = rest.split_at_checked(u16_at(fixed, 30).into())?;
    let (_comment, rest) = rest.split_at_checked(u16_at(fixed, 32).into())?;
    let mut wide = wide_values(extra);
    let mut widen = |narrow: u32| if narrow == SATURATED { wide.next() } else { Some(narrow.into()) };
    let size = widen(u32_at(fixed, 24))?;
    let packed = widen(u32_at(fixed, 20))?;
    let header = widen(u32_at(fixed, 42))?;
    let name = String::from_utf8_lossy(name).into_owned();
    Some((Entry { name, method: u16_at(fixed, 10), crc: u32_at(fixed, 16), packed, size, header }, rest))
}

/// The values of the ZIP64 field in the extra fields `extra`.
fn wide_values(mut extra: &[u8]) -> impl Iterator<Item = u64> + '_ {
    let mut values: &[u8] = &[];
    while let Some((head, rest)) = extra.split_at_checked(4) {
        let Some((field, rest)) = rest.split_at_checked(u16_at(head, 2).into()) else { break };
        if u16_at(head, 0) == 1 {
            values = field;
        }
        extra = rest;
    }
    values.chunks_exact(8).map(|value| u64_at(value, 0))
}

#[cfg(test)]
mod tests {
    use std::io::{Cursor, Write};

    use super::*;

    #[test]
    fn members_beyond_four_gibibytes_are_found() {
        let base = 5 << 30;
        let mut file = tempfile::tempfile().unwrap();
        let data = b"hair";
        let entry = Entry::stored("far", crc32fast::hash(data), data.len() as u64, base);
        file.seek(SeekFrom::Start(base)).unwrap();
        file.write_all(&entry.local()).unwrap();
        assert_eq!(entry.local().len() as u64, entry.local_bytes());
        file.write_all(data).unwrap();
        let at = file.stream_position().unwrap();
        file.write_all(&directory(std::slice::from_ref(&entry), at)).unwrap();

        let mut archive = Archive::open(file).unwrap();
        assert_eq!(archive.entries, std::slice::from_ref(&entry));
        assert_eq!(archive.read(&entry).unwrap(), data);
    }

    #[test]
    fn claims_beyond_the_file_are_errors() {
        let mut entry = Entry::stored("a", 0, 4, 0);
        let mut bytes = entry.local();
        bytes.extend(b"hair");
        let at = bytes.len() as u64;
        entry.size = u64::MAX / 2;
        for (method, packed) in [(STORED, u64::MAX / 2), (DEFLATED, 4), (STORED, 4), (99, 4)] {
            (entry.method, entry.packed) = (method, packed);
            let file = [bytes.clone(), directory(std::slice::from_ref(&entry), at)].concat();
            let mut archive = Archive::open(Cursor::new(file)).unwrap();
            assert!(archive.read(&entry).is_err(), "method {method}, {packed} packed bytes");
        }
        let far = Entry { header: u64::MAX - 5, ..Entry::stored("a", 0, 0, 0) };
        let file = [bytes, directory(std::slice::from_ref(&far), at)].concat();
        assert!(Archive::open(Cursor::new(file)).unwrap().read(&far).is_err());
    }
}
