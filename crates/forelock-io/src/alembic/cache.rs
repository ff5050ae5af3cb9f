//! Writing of a motion cache, frame by frame.
//!
//! # Theory
//! The samples of a frame are written when it comes. The groups that list them, and the header that
//! says that the file is complete, follow at the end, for Ogawa stores a list in one piece.
//!
//! # Practice
//! Memory grows by 16 bytes for each frame, 24 with velocities: the offsets of its samples. The
//! file is `hair.abc.part` until [`finish`](CurvesWriter::finish) renames it to `hair.abc`; an
//! older `hair.abc` stays until then. A writer that is dropped before leaves nothing. A [`Lock`]
//! keeps a second writer from the same file.
//!
//! # Limitations
//! If the process is killed, `hair.abc.part` is left, with the samples but without their list. Its
//! first bytes say that it was not completed, so no reader opens it, and the next writer replaces
//! it: nothing of it can be read, and there is no resuming. A run that must survive this writes an
//! [`.npz`](crate::CacheWriter), which can be read at any moment.

use std::{
    fs::{self, File},
    io::{self, BufWriter},
    path::{Path, PathBuf},
};

use forelock_core::groom::Groom;
use glam::Vec3;

use super::writer::{Clock, Strands, check};
use crate::{
    atomic::{Temporary, check_target},
    error::WriteError,
    lock::Lock,
};

/// A motion cache that is being written.
///
/// ```
/// use forelock_core::groom::Groom;
/// use forelock_io::alembic::{CurvesWriter, Reader};
/// use glam::Vec3;
///
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("hair.abc");
/// let groom = Groom::from_strands([[Vec3::ZERO, Vec3::Y]])?;
/// let mut writer = CurvesWriter::create(&path, &groom, 0.5, 60.0)?;
/// for frame in 0..3 {
///     writer.write_frame(&[Vec3::ZERO, Vec3::Y * frame as f32], None)?;
/// }
/// writer.finish()?;
///
/// let mut reader = Reader::open(std::fs::File::open(&path)?)?;
/// assert_eq!((reader.frames(), reader.time_secs(0)), (3, 0.5));
/// assert_eq!(reader.read(2)?.groom.positions()[1].y, 2.0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct CurvesWriter {
    path: PathBuf,
    /// The file, until it has its final name.
    part: Temporary,
    /// `None` after a write failed.
    strands: Option<Strands<BufWriter<File>>>,
    clock: Clock,
    particles: usize,
    /// Whether the frames have velocities.
    has_velocities: Option<bool>,
    frames: usize,
    _lock: Lock,
}

impl CurvesWriter {
    /// Starts the cache at `path` for the strands of `groom` with its attributes, at `fps` frames
    /// per second, the first at `start_secs`. The positions of `groom` are not written.
    ///
    /// # Errors
    /// [`WriteError`] if the file cannot be written, another writer has it, the groom has no
    /// points, an attribute does not match it, the start is not finite, or `fps` is not above 0.
    pub fn create(path: &Path, groom: &Groom, start_secs: f64, fps: f64) -> Result<Self, WriteError> {
        let unfit = |problem: String| WriteError::Unfit { path: path.into(), problem };
        check_target(path)?;
        check(groom).map_err(unfit)?;
        if !(fps > 0.0 && fps.is_finite()) {
            return Err(unfit(format!("{fps} frames per second; the rate must be above 0")));
        }
        if !start_secs.is_finite() {
            return Err(unfit(format!("a start at {start_secs} s; it must be finite")));
        }
        let with = |suffix: &str| {
            let mut name = path.as_os_str().to_owned();
            name.push(suffix);
            PathBuf::from(name)
        };
        let lock = Lock::take(&with(".lock"), path)?;
        let part = with(".part");
        let file = File::create(&part).map_err(WriteError::io(path))?;
        let part = Temporary::new(part);
        let file = BufWriter::with_capacity(1 << 16, file);
        let strands = Strands::new(file, groom).map_err(WriteError::io(path));
        let strands = strands.inspect_err(|_| part.remove())?;
        Ok(Self {
            path: path.into(),
            part,
            strands: Some(strands),
            clock: Clock { start_secs, fps },
            particles: groom.particle_count(),
            has_velocities: None,
            frames: 0,
            _lock: lock,
        })
    }

    /// The number of frames so far.
    pub fn frames(&self) -> usize {
        self.frames
    }

    /// Appends a frame: the P `positions` in metres, and if all frames have them, the P
    /// `velocities` in metres per second.
    ///
    /// # Errors
    /// [`WriteError`] if the number of positions or velocities is wrong, or the file cannot be
    /// written. In the second case the cache cannot be completed.
    pub fn write_frame(&mut self, positions: &[Vec3], velocities: Option<&[Vec3]>) -> Result<(), WriteError> {
        let has_velocities = *self.has_velocities.get_or_insert(velocities.is_some());
        if has_velocities != velocities.is_some() {
            return Err(self.unfit("some frames have velocities and some have none".into()));
        }
        for (what, count) in
            [("positions", Some(positions.len())), ("velocities", velocities.map(<[_]>::len))]
        {
            if let Some(count) = count.filter(|&count| count != self.particles) {
                let particles = self.particles;
                return Err(
                    self.unfit(format!("the frame has {count} {what}, but the cache has {particles}"))
                );
            }
        }
        if u32::try_from(self.frames + 1).is_err() {
            return Err(self.unfit("over 4,294,967,295 frames".into()));
        }
        let mut strands = self.take()?;
        strands.push(positions, velocities).map_err(WriteError::io(&self.path))?;
        self.strands = Some(strands);
        self.frames += 1;
        Ok(())
    }

    /// Completes the cache under its final name.
    ///
    /// # Errors
    /// [`WriteError`] if there are no frames, or the file cannot be written; it is removed then.
    pub fn finish(mut self) -> Result<(), WriteError> {
        if self.frames == 0 {
            return Err(self.unfit("a cache needs at least one frame".into()));
        }
        let file = self.take()?.finish(Some(self.clock)).map_err(WriteError::io(&self.path))?;
        file.into_inner().map_err(io::IntoInnerError::into_error).map_err(WriteError::io(&self.path))?;
        check_target(&self.path)?;
        fs::rename(self.part.path(), &self.path).map_err(WriteError::io(&self.path))
    }

    fn take(&mut self) -> Result<Strands<BufWriter<File>>, WriteError> {
        self.strands.take().ok_or_else(|| self.unfit("an earlier frame could not be written".into()))
    }

    fn unfit(&self, problem: String) -> WriteError {
        WriteError::Unfit { path: self.path.clone(), problem }
    }
}

impl Drop for CurvesWriter {
    /// Removes the file if it does not have its final name.
    fn drop(&mut self) {
        self.part.remove();
    }
}
