//! Writing of moving hair, frame by frame.
//!
//! # Practice
//! Memory holds frame 0 and the bounds of each frame. The text of the file, which comes first and
//! lists those bounds, is written last, into bytes that were left for it; spaces fill the rest. The
//! file is `hair.glb.part` until [`finish`](LinesWriter::finish) renames it to `hair.glb`; an older
//! `hair.glb` stays until then. A writer that is dropped before leaves nothing. A [`Lock`] keeps a
//! second writer from the same file.
//!
//! # Limitations
//! If the process is killed, `hair.glb.part` is left. It begins with zeros, so that no program
//! takes it for a glTF file, and the next writer replaces it.

use std::{
    fs::{self, File},
    io::{self, BufWriter, Seek, SeekFrom, Write},
    path::{Path, PathBuf},
};

use forelock_core::groom::Groom;
use glam::Vec3;

use super::write::{Layout, bounds};
use crate::{
    atomic::{Temporary, check_target},
    error::WriteError,
    lock::Lock,
    npz::{part, with_suffix},
};

/// Moving hair that is being written, `.glb`: lines, with a morph target for each frame but the
/// first.
///
/// ```
/// use forelock_core::groom::Groom;
/// use forelock_io::gltf::LinesWriter;
/// use glam::Vec3;
///
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("hair.glb");
/// let groom = Groom::from_strands([[Vec3::ZERO, Vec3::Y]])?;
/// let mut writer = LinesWriter::create(&path, &groom, &[0.0, 0.5])?;
/// for frame in 0..2 {
///     writer.write_frame(&[Vec3::ZERO, Vec3::Y * (1.0 + frame as f32)])?;
/// }
/// writer.finish()?;
/// assert_eq!(std::fs::read(&path)?[..4], *b"glTF");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct LinesWriter {
    path: PathBuf,
    /// The file, until it has its final name.
    part: Temporary,
    file: BufWriter<File>,
    layout: Layout,
    /// The bytes that are left for the text.
    reserved: usize,
    /// The positions of frame 0.
    first: Vec<Vec3>,
    /// The bounds of the frames so far: of frame 0, and of the displacements of the others.
    bounds: Vec<[Vec3; 2]>,
    _lock: Lock,
}

impl LinesWriter {
    /// Starts the file at `path` for the strands of `groom` with its attributes, and frames at
    /// `times_secs`; if the first is below 0, which the format forbids, it becomes 0. The positions
    /// of `groom` are not written.
    ///
    /// # Errors
    /// [`WriteError`] if the file cannot be written or would exceed 4 GiB, another writer has it,
    /// the groom has no edge, an attribute is wrong, or the times do not grow.
    pub fn create(path: &Path, groom: &Groom, times_secs: &[f64]) -> Result<Self, WriteError> {
        let unfit = |problem: String| WriteError::Unfit { path: path.into(), problem };
        check_target(path)?;
        let layout = Layout::new(groom, times(times_secs).map_err(unfit)?).map_err(unfit)?;
        let reserved = layout.reserve();
        let room = layout.start(&[], reserved).map_err(unfit)?.len();
        let lock = Lock::take(&with_suffix(path, ".lock"), path)?;
        let part = part(path);
        let file = File::create(&part).map_err(WriteError::io(path))?;
        let part = Temporary::new(part);
        let mut file = BufWriter::with_capacity(1 << 16, file);
        let begin = file.write_all(&vec![0; room]).and_then(|()| layout.write_constants(groom, &mut file));
        begin.map_err(WriteError::io(path)).inspect_err(|_| part.remove())?;
        let (first, bounds) = (Vec::new(), Vec::new());
        Ok(Self { path: path.into(), part, file, layout, reserved, first, bounds, _lock: lock })
    }

    /// The number of frames so far.
    pub fn frames(&self) -> usize {
        self.bounds.len()
    }

    /// Appends a frame: P positions in metres.
    ///
    /// # Errors
    /// [`WriteError`] if the number of positions is wrong or one is not finite, there are more
    /// frames than times, or the file cannot be written; it cannot be completed then.
    pub fn write_frame(&mut self, positions: &[Vec3]) -> Result<(), WriteError> {
        let (found, particles) = (positions.len(), self.layout.particles);
        if found != particles {
            return Err(self.unfit(format!("the frame has {found} positions, but the file has {particles}")));
        }
        if self.frames() == self.layout.frames {
            return Err(self.unfit(format!("it has times for {} frames only", self.layout.frames)));
        }
        let numbers: Vec<Vec3> = if self.frames() == 0 {
            self.first = positions.to_vec();
            self.first.clone()
        } else {
            positions.iter().zip(&self.first).map(|(now, first)| *now - *first).collect()
        };
        let frame = self.frames();
        let bounds = bounds(&numbers).map_err(|problem| self.unfit(format!("frame {frame}: {problem}")))?;
        self.file.write_all(bytemuck::cast_slice(&numbers)).map_err(WriteError::io(&self.path))?;
        self.bounds.push(bounds);
        Ok(())
    }

    /// Completes the file under its final name.
    ///
    /// # Errors
    /// [`WriteError`] if a frame is missing, or the file cannot be written; it is removed then.
    pub fn finish(mut self) -> Result<(), WriteError> {
        let (found, frames) = (self.frames(), self.layout.frames);
        if found != frames {
            return Err(self.unfit(format!("{found} of its {frames} frames were written")));
        }
        let start = self.layout.start(&self.bounds, self.reserved).map_err(|p| self.unfit(p))?;
        let mut write = || -> io::Result<()> {
            self.file.seek(SeekFrom::Start(0))?;
            self.file.write_all(&start)?;
            self.file.flush()
        };
        write().map_err(WriteError::io(&self.path))?;
        check_target(&self.path)?;
        fs::rename(self.part.path(), &self.path).map_err(WriteError::io(&self.path))
    }

    fn unfit(&self, problem: String) -> WriteError {
        WriteError::Unfit { path: self.path.clone(), problem }
    }
}

impl Drop for LinesWriter {
    /// Removes the file if it does not have its final name.
    fn drop(&mut self) {
        self.part.remove();
    }
}

/// `times_secs` from 0 on, in float32 as the format has them.
fn times(times_secs: &[f64]) -> Result<Vec<f32>, String> {
    let first = times_secs.first().map_or(0.0, |first| first.min(0.0));
    let times: Vec<f32> = times_secs.iter().map(|time| (time - first) as f32).collect();
    let is_later = |pair: &[f32]| pair[1].is_finite() && pair[1] > pair[0];
    match times.windows(2).position(|pair| !is_later(pair)) {
        Some(frame) => Err(format!("frame {} is not later than the one before, in float32", frame + 1)),
        None => Ok(times),
    }
}
