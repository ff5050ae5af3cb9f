//! Where the frames of a run go: caches of positions.
//!
//! # Practice
//! A [`CacheSink`] receives every frame, the start included. [`open_cache`] picks the format by the
//! ending of the name. Pictures and films are not sinks: they are drawn from the finished cache, so
//! that an interrupted run gets them when it has been resumed.

mod npz;

use std::path::{Path, PathBuf};

use forelock_core::pose::Pose;
use forelock_io::WriteError;
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

    /// Completes what is stored; the files written.
    ///
    /// # Errors
    /// [`WriteError`] if that fails.
    fn finish(self: Box<Self>) -> Result<Vec<PathBuf>, WriteError>;
}

/// Opens the cache `path` for strands at `strand_offsets` in the format of its ending. With
/// `stored_frames` the cache is there, and keeps that many frames.
///
/// # Errors
/// [`WriteError`] if it cannot be written, or has not that many frames.
pub fn open_cache(
    path: &Path,
    strand_offsets: &[u32],
    stored_frames: Option<usize>,
) -> Result<Box<dyn CacheSink>, WriteError> {
    // The one format so far; scenes are refused that name another.
    Ok(match stored_frames {
        None => Box::new(NpzSink::create(path, strand_offsets)?),
        Some(frames) => Box::new(NpzSink::resume(path, frames)?),
    })
}
