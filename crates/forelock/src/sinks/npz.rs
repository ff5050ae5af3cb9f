//! Caches as `.npz` files.

use std::path::{Path, PathBuf};

use forelock_io::{CacheWriter, Stored, WriteError};

use super::{CacheSink, Finished, FrameView};

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

    /// Continues the cache `path` for strands at `strand_offsets` after the frames of `stored`.
    ///
    /// # Errors
    /// [`WriteError`] if it is not there, or has not these frames.
    pub fn resume(path: &Path, strand_offsets: &[u32], stored: &Stored) -> Result<Self, WriteError> {
        let writer = CacheWriter::resume(path, strand_offsets, &[], stored)?;
        Ok(Self { path: path.to_path_buf(), writer })
    }
}

impl CacheSink for NpzSink {
    fn append(&mut self, frame: &FrameView<'_>) -> Result<(), WriteError> {
        self.writer.append(frame.time_secs, frame.positions)
    }

    fn checkpoint(&mut self) -> Result<u32, WriteError> {
        self.writer.checkpoint()
    }

    fn finish(self: Box<Self>) -> Result<Finished, WriteError> {
        let checksum = self.writer.finish()?;
        Ok(Finished { files: vec![self.path], checksum })
    }
}
