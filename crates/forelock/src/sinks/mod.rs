//! Where the frames of a run go: caches of positions.
//!
//! # Practice
//! A [`CacheSink`] receives every frame, the start included. [`open_cache`] picks the format by the
//! ending of the name. Pictures and films are not sinks: they are drawn from the finished cache, so
//! that an interrupted run gets them when it has been resumed.

mod npz;

use std::path::{Path, PathBuf};

use forelock_core::pose::Pose;
use forelock_io::{Stored, WriteError};
use glam::Vec3;

pub use npz::NpzSink;

/// The endings of caches that can be written.
pub const CACHE_ENDINGS: [&str; 1] = ["npz"];

/// One frame of a run.
#[derive(Clone, Copy, Debug)]
pub struct FrameView<'a> {
    /// Frames done; 0 is the start.
    pub frame: u32,
    /// Its time, seconds.
    pub time_secs: f64,
    /// World from head.
    pub head: Pose,
    /// First particle of each strand, and the number of all particles, `[S + 1]`.
    pub strand_offsets: &'a [u32],
    /// All strands in world space, metres, `[P]`.
    pub positions: &'a [Vec3],
}

/// Receives the frames of a run.
pub trait CacheSink {
    /// Takes a frame. Frames come in order, the first is the start; of a resumed run, the first
    /// that is not stored yet.
    ///
    /// # Errors
    /// [`WriteError`] if it cannot be stored.
    fn append(&mut self, frame: &FrameView<'_>) -> Result<(), WriteError>;

    /// Makes the frames so far readable, even if the process is killed after this, and goes on. The
    /// checksum of these frames.
    ///
    /// # Errors
    /// [`WriteError`] if that fails.
    fn checkpoint(&mut self) -> Result<u32, WriteError>;

    /// Completes what is stored.
    ///
    /// # Errors
    /// [`WriteError`] if that fails.
    fn finish(self: Box<Self>) -> Result<Finished, WriteError>;
}

/// A cache that is complete.
#[derive(Clone, Debug)]
pub struct Finished {
    /// The files written.
    pub files: Vec<PathBuf>,
    /// The checksum of all frames.
    pub checksum: u32,
}

/// Opens the cache `path` for strands at `strand_offsets` in the format of its ending. With
/// `stored` the cache is there, and keeps these frames.
///
/// # Errors
/// [`WriteError`] if it cannot be written, another run writes it, or it has not these frames.
pub fn open_cache(
    path: &Path,
    strand_offsets: &[u32],
    stored: Option<&Stored>,
) -> Result<Box<dyn CacheSink>, WriteError> {
    // The one format so far; scenes are refused that name another.
    Ok(match stored {
        None => Box::new(NpzSink::create(path, strand_offsets)?),
        Some(stored) => Box::new(NpzSink::resume(path, strand_offsets, stored)?),
    })
}
