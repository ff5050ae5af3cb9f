//! Caches as `.npz` files.

use std::path::{Path, PathBuf};

use forelock_io::{CacheWriter, WriteError};

use super::{CacheSink, FrameView};

/// A cache that is written as an `.npz` file.
pub struct NpzSink {
    path: PathBuf,
    writer: CacheWriter,
}

impl NpzSink {
    /// Begins the cache `path` for strands at `strand_offsets`, `[S + 1]`.
    ///
    /// # Errors
    /// [`WriteError`] if it cannot be written.
    pub fn create(path: &Path, strand_offsets: &[u32]) -> Result<Self, WriteError> {
        let writer = CacheWriter::create(path, strand_offsets, &[])?;
        Ok(Self { path: path.to_path_buf(), writer })
    }

    /// Continues the cache `path` after its first `frames` frames.
    ///
    /// # Errors
    /// [`WriteError`] if it is not there, or has not that many frames.
    pub fn resume(path: &Path, frames: usize) -> Result<Self, WriteError> {
        Ok(Self { path: path.to_path_buf(), writer: CacheWriter::resume(path, frames)? })
    }
}

impl CacheSink for NpzSink {
    fn append(&mut self, frame: &FrameView<'_>) -> Result<(), WriteError> {
        self.writer.append(frame.time_secs, frame.positions)
    }

    fn finish(self: Box<Self>) -> Result<Vec<PathBuf>, WriteError> {
        self.writer.finish()?;
        Ok(vec![self.path])
    }
}
