//! A cursor over a byte slice. It checks every count against the bytes that are left before it
//! reads.

use bytemuck::AnyBitPattern;

use crate::error::{FormatError, Problem};

const _: () =
    assert!(cfg!(target_endian = "little"), "the formats are little-endian and read without swapping");

/// A cursor over `all` that adds its offset, and the strand, to errors.
pub(crate) struct Bytes<'a> {
    all: &'a [u8],
    at: usize,
    format: &'static str,
    strand: Option<usize>,
}

impl<'a> Bytes<'a> {
    pub fn new(all: &'a [u8], format: &'static str) -> Self {
        Self { all, at: 0, format, strand: None }
    }

    /// A cursor over the same bytes at `offset`. The offset may lie beyond the end: then the next
    /// read fails.
    pub fn at(&self, offset: u64) -> Self {
        let at = usize::try_from(offset).unwrap_or(usize::MAX).min(self.all.len());
        Self { at, ..*self }
    }

    /// Sets the strand that later errors name.
    pub fn enter_strand(&mut self, strand: usize) {
        self.strand = Some(strand);
    }

    /// The offset of the next byte.
    pub fn offset(&self) -> u64 {
        self.at as u64
    }

    pub fn left(&self) -> usize {
        self.all.len() - self.at
    }

    pub fn take(&mut self, count: u64, each: usize, what: &'static str) -> Result<&'a [u8], FormatError> {
        let needed = count.saturating_mul(each as u64);
        let taken = usize::try_from(needed).ok().and_then(|n| self.all[self.at..].get(..n));
        let Some(taken) = taken else {
            return Err(self.error(Problem::Short { what, needed, left: self.left() as u64 }));
        };
        self.at += taken.len();
        Ok(taken)
    }

    /// Reads `count` values into a new vector.
    pub fn array<T>(&mut self, count: u64, what: &'static str) -> Result<Vec<T>, FormatError>
    where
        T: AnyBitPattern + bytemuck::NoUninit,
    {
        Ok(bytemuck::pod_collect_to_vec(self.take(count, size_of::<T>(), what)?))
    }

    pub fn value<T: AnyBitPattern>(&mut self, what: &'static str) -> Result<T, FormatError> {
        Ok(bytemuck::pod_read_unaligned(self.take(1, size_of::<T>(), what)?))
    }

    /// Reads the number of `what` that follow, which the format stores as a signed integer.
    pub fn count(&mut self, what: &'static str) -> Result<u64, FormatError> {
        let here = Self { ..*self };
        let count: i32 = self.value("the counts")?;
        u64::try_from(count).map_err(|_| here.invalid(format!("the number of {what} is {count}, below 0")))
    }

    pub fn error(&self, problem: Problem) -> FormatError {
        FormatError { format: self.format, offset: self.at as u64, strand: self.strand, problem }
    }

    pub fn invalid(&self, words: impl Into<String>) -> FormatError {
        self.error(Problem::Invalid(words.into()))
    }
}
