//! Reading at offsets, with every count checked against the size of the file.

use std::{
    cell::RefCell,
    io::{Read, Seek, SeekFrom},
};

use bytemuck::{AnyBitPattern, NoUninit};

use super::{UsdError, coding};
use crate::error::{FormatError, Problem, check_room};

/// Decompressed data may take this many times the size of the file, beside [`FREE`] bytes.
const RATIO: u64 = 64;
const FREE: u64 = 1 << 20;

/// A binary file.
pub(super) struct Source<R> {
    reader: RefCell<R>,
    size: u64,
}

impl<R: Read + Seek> Source<R> {
    pub fn new(mut reader: R) -> Result<Self, UsdError> {
        let size = reader.seek(SeekFrom::End(0))?;
        Ok(Self { reader: RefCell::new(reader), size })
    }

    /// The bytes of the file.
    pub fn size(&self) -> u64 {
        self.size
    }

    pub fn at(&self, offset: u64) -> Cursor<'_, R> {
        Cursor { source: self, at: offset }
    }
}

/// A place in a [`Source`].
pub(super) struct Cursor<'a, R> {
    source: &'a Source<R>,
    pub at: u64,
}

impl<R: Read + Seek> Cursor<'_, R> {
    /// The next `count` times `each` bytes.
    pub fn take(&mut self, count: u64, each: u64, what: &'static str) -> Result<Vec<u8>, UsdError> {
        let needed = count.saturating_mul(each);
        let left = self.source.size.saturating_sub(self.at);
        let bytes = usize::try_from(needed).ok().filter(|_| needed <= left);
        let Some(bytes) = bytes else {
            return Err(self.error(Problem::Short { what, needed, left }));
        };
        check_room(needed)?;
        let mut taken = vec![0; bytes];
        let mut reader = self.source.reader.borrow_mut();
        reader.seek(SeekFrom::Start(self.at))?;
        reader.read_exact(&mut taken)?;
        self.at += needed;
        Ok(taken)
    }

    pub fn array<T: AnyBitPattern + NoUninit>(
        &mut self,
        count: u64,
        what: &'static str,
    ) -> Result<Vec<T>, UsdError> {
        Ok(bytemuck::pod_collect_to_vec(&self.take(count, size_of::<T>() as u64, what)?))
    }

    pub fn value<T: AnyBitPattern>(&mut self, what: &'static str) -> Result<T, UsdError> {
        Ok(bytemuck::pod_read_unaligned(&self.take(1, size_of::<T>() as u64, what)?))
    }

    /// A count of things that take `each` bytes when they are decompressed.
    pub fn count(&mut self, each: u64, what: &'static str) -> Result<usize, UsdError> {
        let count: u64 = self.value(what)?;
        self.check_count(count, each, what)
    }

    /// Returns `count` if so many things of `each` bytes can come from a file of this size.
    pub fn check_count(&self, count: u64, each: u64, what: &'static str) -> Result<usize, UsdError> {
        let room = self.source.size.saturating_mul(RATIO).saturating_add(FREE);
        let needed = count.saturating_mul(each);
        if needed > room {
            let words = format!(
                "{what}: {count} of them take {needed} bytes, too many for a file of {} bytes; the file is \
                 damaged (copy or export it again)",
                self.source.size
            );
            return Err(self.invalid(words));
        }
        check_room(needed)?;
        usize::try_from(count).map_err(|_| self.invalid(format!("{what}: {count} are too many")))
    }

    /// The next compressed buffer, preceded by its size, decompressed to exactly `bytes` bytes.
    pub fn decompressed(&mut self, bytes: usize, what: &'static str) -> Result<Vec<u8>, UsdError> {
        let size: u64 = self.value(what)?;
        let here = self.source.at(self.at);
        let found = coding::decompress(&self.take(size, 1, what)?, bytes);
        let found = found.map_err(|words| here.invalid(format!("{what} cannot be decompressed: {words}")))?;
        if found.len() != bytes {
            return Err(here.invalid(format!("{what} take {bytes} bytes, but {} are there", found.len())));
        }
        Ok(found)
    }

    /// The next `count` compressed integers of `width` bytes, 4 or 8.
    pub fn integers(&mut self, count: usize, width: usize, what: &'static str) -> Result<Vec<i64>, UsdError> {
        let size: u64 = self.value(what)?;
        let here = self.source.at(self.at);
        let found = coding::integers(&self.take(size, 1, what)?, count, width);
        found.map_err(|words| here.invalid(format!("{what} cannot be decompressed: {words}")))
    }

    /// The next `count` compressed integers, as indices.
    pub fn indices(&mut self, count: usize, what: &'static str) -> Result<Vec<u32>, UsdError> {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "they have 4 bytes")]
        Ok(self.integers(count, 4, what)?.into_iter().map(|i| i as u32).collect())
    }

    /// Goes on where the next number says, counted from here.
    pub fn jump(&mut self) -> Result<(), UsdError> {
        let start = self.at;
        let offset: i64 = self.value("an offset")?;
        let target = start.checked_add_signed(offset);
        self.at = target.ok_or_else(|| self.invalid(format!("the offset {offset} leads out of the file")))?;
        Ok(())
    }

    fn error(&self, problem: Problem) -> UsdError {
        FormatError { format: ".usdc", offset: self.at, strand: None, problem }.into()
    }

    pub fn invalid(&self, words: impl Into<String>) -> UsdError {
        self.error(Problem::Invalid(words.into()))
    }
}
