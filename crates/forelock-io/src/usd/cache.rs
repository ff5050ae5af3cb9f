//! Writing a binary layer with samples, frame by frame.
//!
//! # Theory
//! The arrays of the groom come first, then those of each frame. The tail, see
//! [`crate_tables`](super::crate_tables), lists all frames; with it a frame takes 80 bytes beside
//! its arrays.
//!
//! # Practice
//! Only the times and offsets of the frames are kept in memory. A tail is written behind the frames
//! every 16 frames, in long caches every eighth of them, and at checkpoints; then the offset of the
//! table of contents, in one call. So the file is a complete layer with the frames up to the last
//! tail while it grows, and after its process was killed. Before the first tail it is not a layer,
//! and reading it says so. New frames come behind the tail, whose bytes stay unused.
//!
//! A new cache is the file `hair.usdc.part` until its first
//! [`checkpoint`](UsdCacheWriter::checkpoint) or [`finish`](UsdCacheWriter::finish) renames it; a
//! writer that is dropped before leaves nothing, and one that is killed leaves that file. A
//! [`Lock`] keeps a second writer from the same file.
//!
//! [`resume`](UsdCacheWriter::resume) goes on after frames that are stored. It appends: frames and
//! tails that are no longer listed stay in the file, so its bytes are not those of a cache written
//! in one run. `usdcat` writes a file without them.
//!
//! # Limitations
//! Nothing is compressed, and nothing waits for the disk: after a power failure the file may be
//! damaged.

use std::{
    fs::{self, File, OpenOptions},
    io::{self, Seek, SeekFrom, Write},
    path::{Path, PathBuf},
};

use crc32fast::Hasher;
use forelock_core::groom::Groom;
use glam::Vec3;

use super::{
    attributes,
    crate_tables::{self, Attribute, CONTENTS_AT, Tail, Times},
    resume::Kept,
};
use crate::{
    atomic::{Temporary, check_target},
    error::WriteError,
    lock::Lock,
    npz::{Stored, part, with_suffix},
};

/// Frames from one tail to the next.
const TAIL_FRAMES: usize = 16;

/// A cache of moving hair that is being written, `.usdc` or `.usd`.
///
/// ```
/// use forelock_core::groom::Groom;
/// use forelock_io::{Usd, UsdCacheWriter};
/// use glam::Vec3;
///
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("hair.usdc");
/// let groom = Groom::from_strands([[Vec3::ZERO, Vec3::Y]])?;
/// let mut writer = UsdCacheWriter::create(&path, &groom, 60.0)?;
/// for frame in 0..3 {
///     writer.append(frame as f64 / 60.0, &[Vec3::ZERO, Vec3::Y * frame as f32], None)?;
/// }
/// writer.finish()?;
///
/// let layer = Usd::open(std::fs::File::open(&path)?)?;
/// assert_eq!((layer.times_secs().len(), layer.frame(2)?.positions()[1].y), (3, 2.0));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct UsdCacheWriter {
    path: PathBuf,
    /// The file, until it has its final name.
    part: Option<Temporary>,
    file: File,
    /// The offset of the next byte.
    end: u64,
    particles: usize,
    /// The largest radius of the hair, in metres.
    radius: f32,
    codes_per_second: f64,
    /// The times of the frames, in time codes.
    codes: Vec<f64>,
    /// The checksum of the positions so far.
    crc: Hasher,
    /// The attributes of the groom.
    constants: Vec<Attribute>,
    points: Attribute,
    velocities: Attribute,
    extent: Attribute,
    /// The number of frames that the last tail lists.
    published: usize,
    _lock: Lock,
}

impl UsdCacheWriter {
    /// Starts the cache at `path` for the strands and attributes of `groom`; its positions are not
    /// written. Times are stored as multiples of 1 / `frames_per_second`. An existing file at
    /// `path` stays until the first [`checkpoint`](Self::checkpoint) or [`finish`](Self::finish)
    /// replaces it.
    ///
    /// # Errors
    /// [`WriteError`] if the file cannot be written, another writer has it, the groom has no
    /// particle or attributes of wrong lengths, or the rate is not above 0.
    pub fn create(path: &Path, groom: &Groom, frames_per_second: f64) -> Result<Self, WriteError> {
        let mut writer = Self::open(path, groom, frames_per_second, true)?;
        writer.begin(groom).map_err(WriteError::io(path))?;
        Ok(writer)
    }

    /// Resumes the cache at `path`, which was begun with the same strands and rate, after the
    /// frames of `stored`. The other attributes of `groom` replace those of the cache.
    ///
    /// # Errors
    /// [`WriteError`] if there is no such cache, another writer has it, or it does not begin with
    /// these frames, bit for bit. The file is unchanged then.
    pub fn resume(
        path: &Path,
        groom: &Groom,
        frames_per_second: f64,
        stored: &Stored,
    ) -> Result<Self, WriteError> {
        let mut writer = Self::open(path, groom, frames_per_second, false)?;
        let codes: Vec<f64> = stored.times_secs.iter().map(|&time| writer.code(time)).collect();
        let kept = Kept::read(path, groom, frames_per_second, &codes, stored.checksum);
        let kept = kept.map_err(|problem| {
            let problem = format!("{problem}; start again without resuming");
            WriteError::Resume { path: path.into(), problem }
        })?;
        writer.codes = codes;
        writer.crc = kept.crc;
        writer.points.samples = kept.points;
        writer.velocities.samples = kept.velocities;
        writer.extent.samples = kept.extent;
        writer.begin(groom).and_then(|()| writer.publish()).map_err(WriteError::io(path))?;
        // What a run left that was killed before its first checkpoint.
        let _ = fs::remove_file(part(path));
        Ok(writer)
    }

    /// The writer of a new file or of the one at `path`.
    fn open(path: &Path, groom: &Groom, frames_per_second: f64, is_new: bool) -> Result<Self, WriteError> {
        let unfit = |problem: String| WriteError::Unfit { path: path.into(), problem };
        check_target(path)?;
        groom.check_attributes().map_err(|error| unfit(error.to_string()))?;
        if groom.particle_count() == 0 {
            return Err(unfit("a cache needs at least one particle".into()));
        }
        if !(frames_per_second.is_finite() && frames_per_second > 0.0) {
            return Err(unfit(format!("{frames_per_second} frames per second; the rate must be above 0")));
        }
        let lock = Lock::take(&with_suffix(path, ".lock"), path)?;
        let mut options = OpenOptions::new();
        options.write(true);
        let file =
            if is_new { options.create(true).truncate(true).open(part(path)) } else { options.open(path) };
        let file = file.map_err(|error| match error.kind() {
            io::ErrorKind::NotFound if !is_new => WriteError::Resume {
                path: path.into(),
                problem: "there is none under this name; start again without resuming".into(),
            },
            _ => WriteError::io(path)(error),
        })?;
        let end = file.metadata().map_err(WriteError::io(path))?.len();
        Ok(Self {
            path: path.into(),
            part: is_new.then(|| Temporary::new(part(path))),
            file,
            end,
            particles: groom.particle_count(),
            radius: attributes::radius(groom),
            codes_per_second: frames_per_second,
            codes: Vec::new(),
            crc: Hasher::new(),
            constants: Vec::new(),
            points: Attribute::new("points", "point3f", None),
            velocities: Attribute::new("velocities", "vector3f", None),
            extent: Attribute::new("extent", "float3", None),
            published: 0,
            _lock: lock,
        })
    }

    /// Writes the attributes of `groom`, in a new file after its first bytes.
    fn begin(&mut self, groom: &Groom) -> io::Result<()> {
        let start = self.end;
        let mut bytes = if start == 0 { crate_tables::start() } else { Vec::new() };
        let constants = attributes::of(groom);
        let append = |written| Attribute::append(written, &mut bytes, start);
        self.constants = constants.iter().map(append).collect();
        self.write(&bytes)
    }

    /// The number of frames so far, F.
    pub fn frames(&self) -> usize {
        self.codes.len()
    }

    /// Appends the frame at `time_secs`, later than the one before, with the P `positions` in
    /// metres and, in all frames or in none, the P `velocities` in metres per second.
    ///
    /// # Errors
    /// [`WriteError`] if a number or the time does not fit, or the file cannot be written. The
    /// frames so far are not lost: [`finish`](Self::finish) makes a complete cache of them.
    pub fn append(
        &mut self,
        time_secs: f64,
        positions: &[Vec3],
        velocities: Option<&[Vec3]>,
    ) -> Result<(), WriteError> {
        let code = self.code(time_secs);
        self.check(code, positions, velocities)
            .map_err(|problem| WriteError::Unfit { path: self.path.clone(), problem })?;
        let start = self.end;
        let mut frame = Vec::new();
        let points = crate_tables::append_points(positions, &mut frame, start);
        let velocities = velocities.map(|v| crate_tables::append_points(v, &mut frame, start));
        let extent = attributes::extent(positions, self.radius);
        let extent = crate_tables::append_points(&extent, &mut frame, start);
        if let Err(error) = self.write(&frame) {
            // Frees the space of the part of the frame that was written, which on a full disk is
            // usually enough for the tail. If this fails too, the next write returns an error.
            let _ = self.file.set_len(start);
            return Err(WriteError::io(&self.path)(error));
        }
        self.points.samples.push(points);
        self.velocities.samples.extend(velocities);
        self.extent.samples.push(extent);
        self.codes.push(code);
        self.crc.update(bytemuck::cast_slice(positions));
        if self.frames() - self.published >= TAIL_FRAMES.max(self.published / 8) {
            self.publish().map_err(WriteError::io(&self.path))?;
        }
        Ok(())
    }

    /// The time code of `time_secs`; the nearest whole number where that is the same time but for
    /// rounding.
    fn code(&self, time_secs: f64) -> f64 {
        let code = time_secs * self.codes_per_second;
        let whole = code.round();
        if (code - whole).abs() <= 1e-9 * whole.abs().max(1.0) { whole } else { code }
    }

    /// What does not fit in a frame.
    fn check(&self, code: f64, positions: &[Vec3], velocities: Option<&[Vec3]>) -> Result<(), String> {
        for (name, list) in [("positions", Some(positions)), ("velocities", velocities)] {
            if let Some(list) = list.filter(|list| list.len() != self.particles) {
                return Err(format!(
                    "the frame has {} {name}, but the cache has {} particles",
                    list.len(),
                    self.particles
                ));
            }
        }
        let had_velocities = !self.velocities.samples.is_empty();
        if self.frames() > 0 && had_velocities != velocities.is_some() {
            return Err("velocities must be in all frames or in none".into());
        }
        let is_later = self.codes.last().is_none_or(|&last| code > last);
        if !(code.is_finite() && is_later) {
            return Err(format!("the time code {code} of the frame is not after the one before"));
        }
        Ok(())
    }

    /// Makes the file a complete layer of the frames so far under its final name, and goes on.
    /// Returns the CRC-32 of their positions, for [`Stored`].
    ///
    /// # Errors
    /// [`WriteError`] if the file cannot be written.
    pub fn checkpoint(&mut self) -> Result<u32, WriteError> {
        if self.published < self.frames() || self.published == 0 {
            self.publish().map_err(WriteError::io(&self.path))?;
        }
        if let Some(part) = &self.part {
            check_target(&self.path)?;
            fs::rename(part.path(), &self.path).map_err(WriteError::io(&self.path))?;
            self.part = None;
        }
        Ok(self.crc.clone().finalize())
    }

    /// Completes the cache under its final name. Returns the CRC-32 of the positions, for
    /// [`Stored`].
    ///
    /// # Errors
    /// [`WriteError`] if the file cannot be written.
    pub fn finish(mut self) -> Result<u32, WriteError> {
        self.checkpoint()
    }

    /// Writes a tail for the frames so far, and then where it is.
    fn publish(&mut self) -> io::Result<()> {
        let start = self.end;
        let attributes = self.constants.iter().chain([&self.points, &self.extent]);
        let has_velocities = !self.velocities.samples.is_empty();
        let attributes: Vec<&Attribute> =
            attributes.chain(has_velocities.then_some(&self.velocities)).collect();
        let times = Times { codes: &self.codes, codes_per_second: self.codes_per_second };
        let tail = Tail::new(start, &attributes, Some(&times));
        if let Err(error) = self.write(&tail.bytes) {
            let _ = self.file.set_len(start);
            return Err(error);
        }
        self.file.seek(SeekFrom::Start(CONTENTS_AT as u64))?;
        self.file.write_all(&tail.contents.to_le_bytes())?;
        self.published = self.frames();
        Ok(())
    }

    /// Appends `bytes` to the file.
    fn write(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.file.seek(SeekFrom::Start(self.end))?;
        self.file.write_all(bytes)?;
        self.end += bytes.len() as u64;
        Ok(())
    }
}

impl Drop for UsdCacheWriter {
    fn drop(&mut self) {
        if let Some(part) = &self.part {
            part.remove();
        }
    }
}
