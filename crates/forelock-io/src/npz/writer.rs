//! Writing a motion cache frame by frame.
//!
//! # Theory
//! The file starts with `strand_offsets` and other constant arrays. The array `positions` follows,
//! the last member that grows. What is known only at the end, the array `times` and the ZIP
//! directory, is the *tail*. While the cache is written, the tail lies some frames beyond the last
//! frame, and new frames fill the gap, which takes no space on most file systems. When the gap is
//! full, or a checkpoint is asked for, a tail that lists all frames so far is written at the end of
//! the file, and then the header of `positions`. So the file is a complete archive while it grows,
//! and after its process was killed, unless that happens between these two writes or within the
//! first; resuming mends it then. The checksum of `positions` is combined from those of its
//! header and of the frames: nothing is read again.
//!
//! # Practice
//! A new cache is the file `hair.npz.part` until its first [`checkpoint`](CacheWriter::checkpoint)
//! or [`finish`](CacheWriter::finish) renames it, so an older `hair.npz` stays until then; a writer
//! that is dropped before leaves nothing. `finish` moves the tail behind the last frame. A cache
//! written in several runs has the same bytes as a cache written in one run. If
//! [`append`](CacheWriter::append) fails, as on a full disk, the frames so far are kept. A [`Lock`]
//! keeps a second writer from the same file.
//!
//! # Limitations
//! Only [`Stored`] says how many frames of a cache are valid; the file may hold more.

use std::{
    fs::{self, File, OpenOptions},
    io::{self, Read, Seek, SeekFrom, Write},
    path::{Path, PathBuf},
};

use crc32fast::Hasher;
use glam::Vec3;

use super::{
    Array,
    npy::{self, HEADER_BYTES},
    zip::{self, Entry},
};
use crate::{
    atomic::{Temporary, check_target},
    error::WriteError,
    lock::Lock,
};

const POSITIONS: &str = "positions.npy";
const TIMES: &str = "times.npy";
/// Frames that fit at least between the last frame and a new tail.
const GAP_FRAMES: u64 = 16;

/// The frames of a cache that a later run keeps.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Stored {
    /// The times of the frames in seconds, `[F]`.
    pub times_secs: Vec<f64>,
    /// The CRC-32 of their positions, from [`CacheWriter::checkpoint`].
    pub checksum: u32,
}

/// A cache that is being written.
///
/// ```
/// use forelock_io::{Cache, CacheWriter};
/// use glam::Vec3;
///
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("hair.npz");
/// let mut writer = CacheWriter::create(&path, &[0, 2], &[])?;
/// for frame in 0..3 {
///     writer.append(frame as f64 / 60.0, &[Vec3::ZERO, Vec3::Y * frame as f32])?;
/// }
/// writer.finish()?;
///
/// let mut cache = Cache::open(&path)?;
/// let mut positions = Vec::new();
/// cache.read_frame(2, &mut positions)?;
/// assert_eq!((cache.frames(), positions[1].y), (3, 2.0));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct CacheWriter {
    path: PathBuf,
    /// The file, until it has its final name.
    part: Option<Temporary>,
    file: File,
    /// The constant members.
    entries: Vec<Entry>,
    /// The offset of the local header of `positions`.
    header_at: u64,
    /// The offset of the first frame.
    frames_at: u64,
    particles: usize,
    times_secs: Vec<f64>,
    /// The checksum of the frames so far.
    crc: Hasher,
    /// The offset of the tail, and of the end of the file.
    tail_at: u64,
    end: u64,
    /// The number of frames that the tail lists.
    published: usize,
    _lock: Lock,
}

impl CacheWriter {
    /// Starts the cache at `path` for strands at `strand_offsets`, `[S + 1]`. `constants` are
    /// further arrays, with any names except `positions`, `strand_offsets` and `times`. An existing
    /// file at `path` stays until the first [`checkpoint`](Self::checkpoint) or
    /// [`finish`](Self::finish) replaces it.
    ///
    /// # Errors
    /// [`WriteError`] if the file cannot be written, another writer has it, or the offsets describe
    /// no particle.
    pub fn create(
        path: &Path,
        strand_offsets: &[u32],
        constants: &[(&str, Array)],
    ) -> Result<Self, WriteError> {
        let (mut writer, start) = Self::open(path, strand_offsets, constants, Opening::New)?;
        let mut begin = || {
            if std::mem::take(&mut writer.end) > 0 {
                writer.file.set_len(0)?;
            }
            writer.file.write_all(&start)?;
            writer.publish()
        };
        begin().map_err(WriteError::io(path))?;
        Ok(writer)
    }

    /// Resumes the cache at `path`, which was begun with the same `strand_offsets` and `constants`,
    /// after the frames of `stored`.
    ///
    /// # Errors
    /// [`WriteError`] if there is no such cache, another writer has it, or it does not begin with
    /// these frames, bit for bit. The file is unchanged then.
    pub fn resume(
        path: &Path,
        strand_offsets: &[u32],
        constants: &[(&str, Array)],
        stored: &Stored,
    ) -> Result<Self, WriteError> {
        let (mut writer, start) = Self::open(path, strand_offsets, constants, Opening::Existing)?;
        let refuse = |problem: &str| {
            let problem = format!("{problem}; start again without resuming");
            WriteError::Resume { path: path.into(), problem }
        };
        let read_error = |error: io::Error| match error.kind() {
            io::ErrorKind::UnexpectedEof => {
                refuse(&format!("it is shorter than the {} frames wanted", stored.times_secs.len()))
            }
            _ => WriteError::io(path)(error),
        };
        let mut found = vec![0; start.len()];
        writer.file.read_exact(&mut found).map_err(read_error)?;
        if found != start {
            return Err(refuse("it was not written by Forelock for these strands, or it is damaged"));
        }
        writer.file.seek(SeekFrom::Start(writer.frames_at)).map_err(read_error)?;
        let bytes = stored.times_secs.len() as u64 * writer.frame_bytes();
        hash_exactly(&mut writer.file, bytes, &mut writer.crc).map_err(read_error)?;
        if writer.checksum() != stored.checksum {
            return Err(refuse("it does not hold the frames of this run, or it is damaged"));
        }
        writer.times_secs.clone_from(&stored.times_secs);
        writer.publish().map_err(WriteError::io(path))?;
        // What a run left that was killed before its first checkpoint.
        let _ = fs::remove_file(part(path));
        Ok(writer)
    }

    /// The writer of a file, and the bytes with which the file starts, up to the local header of
    /// `positions`.
    fn open(
        path: &Path,
        strand_offsets: &[u32],
        constants: &[(&str, Array)],
        opening: Opening,
    ) -> Result<(Self, Vec<u8>), WriteError> {
        check_target(path)?;
        let particles = strand_offsets.last().map_or(0, |&last| last as usize);
        if particles == 0 {
            let problem = "a cache needs at least one particle".into();
            return Err(WriteError::Unfit { path: path.into(), problem });
        }
        let lock = Lock::take(&with_suffix(path, ".lock"), path)?;
        let mut options = OpenOptions::new();
        options.read(true).write(true);
        let file = match opening {
            Opening::New => options.create(true).truncate(false).open(part(path)),
            Opening::Existing => options.open(path),
        };
        let file = file.map_err(|error| match error.kind() {
            io::ErrorKind::NotFound if opening == Opening::Existing => WriteError::Resume {
                path: path.into(),
                problem: "there is none under this name; start again without resuming".into(),
            },
            _ => WriteError::io(path)(error),
        })?;
        let mut entries = Vec::new();
        let mut start = Vec::new();
        let offsets = Array::vector(strand_offsets.to_vec());
        for (name, array) in std::iter::once(&("strand_offsets", offsets)).chain(constants) {
            let npy = array.to_npy();
            let name = format!("{name}.npy");
            let entry = Entry::stored(&name, crc32fast::hash(&npy), npy.len() as u64, start.len() as u64);
            start.extend(entry.local());
            start.extend(npy);
            entries.push(entry);
        }
        let end = file.metadata().map_err(WriteError::io(path))?.len();
        let header_at = start.len() as u64;
        let header_bytes = Entry::stored(POSITIONS, 0, 0, header_at).local_bytes();
        let writer = Self {
            path: path.into(),
            part: (opening == Opening::New).then(|| Temporary::new(part(path))),
            file,
            entries,
            header_at,
            frames_at: header_at + header_bytes + HEADER_BYTES as u64,
            particles,
            times_secs: Vec::new(),
            crc: Hasher::new(),
            tail_at: 0,
            end,
            published: 0,
            _lock: lock,
        };
        Ok((writer, start))
    }

    /// The number of frames so far, F.
    pub fn frames(&self) -> usize {
        self.times_secs.len()
    }

    /// Appends the frame at `time_secs` with the P `positions` in metres.
    ///
    /// # Errors
    /// [`WriteError`] if the number of positions is wrong, or the file cannot be written. The
    /// frames so far are not lost: [`finish`](Self::finish) makes a complete cache of them.
    pub fn append(&mut self, time_secs: f64, positions: &[Vec3]) -> Result<(), WriteError> {
        if positions.len() != self.particles {
            let problem =
                format!("the frame has {} particles, but the cache has {}", positions.len(), self.particles);
            return Err(WriteError::Unfit { path: self.path.clone(), problem });
        }
        let bytes: &[u8] = bytemuck::cast_slice(positions);
        if let Err(error) = self.append_bytes(bytes) {
            // Frees the space of the part of the frame that was written, which on a full disk
            // usually leaves enough for the tail. If this fails too, the next write returns an
            // error.
            let _ = self.close_up();
            return Err(WriteError::io(&self.path)(error));
        }
        self.crc.update(bytes);
        self.times_secs.push(time_secs);
        Ok(())
    }

    fn append_bytes(&mut self, bytes: &[u8]) -> io::Result<()> {
        if self.frames_end() + bytes.len() as u64 > self.tail_at {
            self.publish()?;
        }
        self.file.seek(SeekFrom::Start(self.frames_end()))?;
        self.file.write_all(bytes)
    }

    /// Makes the file a complete cache of the frames so far under its final name, and goes on.
    /// Returns the CRC-32 of their positions, for [`Stored`].
    ///
    /// # Errors
    /// [`WriteError`] if the file cannot be written.
    pub fn checkpoint(&mut self) -> Result<u32, WriteError> {
        if self.published < self.frames() {
            self.publish().map_err(WriteError::io(&self.path))?;
        }
        self.take_name()?;
        Ok(self.checksum())
    }

    /// Completes the cache under its final name. Returns the CRC-32 of the positions, for
    /// [`Stored`].
    ///
    /// # Errors
    /// [`WriteError`] if the file cannot be written.
    pub fn finish(mut self) -> Result<u32, WriteError> {
        // While the tail moves to its final place, the one beyond it is valid.
        let beyond = self.publish().and_then(|()| self.close_up());
        beyond.or_else(|_| self.close_up()).map_err(WriteError::io(&self.path))?;
        self.take_name()?;
        Ok(self.checksum())
    }

    fn checksum(&self) -> u32 {
        self.crc.clone().finalize()
    }

    /// Gives the file its final name.
    fn take_name(&mut self) -> Result<(), WriteError> {
        if let Some(part) = &self.part {
            check_target(&self.path)?;
            fs::rename(part.path(), &self.path).map_err(WriteError::io(&self.path))?;
            self.part = None;
        }
        Ok(())
    }

    /// Writes a tail for the frames so far at the end of the file, a gap beyond the last frame, and
    /// then the header of `positions`.
    fn publish(&mut self) -> io::Result<()> {
        // The tail must fit into the gap as well, see `close_up`.
        let gap = (GAP_FRAMES * self.frame_bytes()).max(1 << 16) + 16 * self.frames() as u64;
        let tail_at = self.end.max(self.frames_end() + gap);
        let tail = self.tail(tail_at);
        self.file.seek(SeekFrom::Start(tail_at))?;
        if let Err(error) = self.file.write_all(&tail) {
            // The tail before stays the last one.
            let _ = self.file.set_len(self.end);
            return Err(error);
        }
        self.write_header()?;
        (self.tail_at, self.end) = (tail_at, tail_at + tail.len() as u64);
        self.published = self.frames();
        Ok(())
    }

    /// Moves the tail behind the last frame and ends the file there.
    fn close_up(&mut self) -> io::Result<()> {
        let tail_at = self.frames_end();
        let tail = self.tail(tail_at);
        let end = tail_at + tail.len() as u64;
        if self.tail_at < end {
            // The old tail is in the way. It may be the only one, on a full disk.
            self.file.set_len(tail_at)?;
        }
        self.file.seek(SeekFrom::Start(tail_at))?;
        self.file.write_all(&tail)?;
        self.write_header()?;
        self.file.set_len(end)?;
        (self.tail_at, self.end) = (tail_at, end);
        Ok(())
    }

    /// The array `times` and the directory, for a tail at byte `at`.
    fn tail(&self, at: u64) -> Vec<u8> {
        let times = Array::vector(self.times_secs.clone()).to_npy();
        let entry = Entry::stored(TIMES, crc32fast::hash(&times), times.len() as u64, at);
        let mut tail = entry.local();
        tail.extend(times);
        let entries = [self.entries.as_slice(), &[self.positions_entry(), entry]].concat();
        tail.extend(zip::directory(&entries, at + tail.len() as u64));
        tail
    }

    fn npy_header(&self) -> Vec<u8> {
        npy::header("<f4", &[self.frames(), self.particles, 3])
    }

    /// The archive member `positions` with the frames so far.
    fn positions_entry(&self) -> Entry {
        let mut crc = Hasher::new();
        crc.update(&self.npy_header());
        crc.combine(&self.crc);
        let size = HEADER_BYTES as u64 + self.frames() as u64 * self.frame_bytes();
        Entry::stored(POSITIONS, crc.finalize(), size, self.header_at)
    }

    /// Writes the local header of `positions` and its `.npy` header in one call.
    fn write_header(&mut self) -> io::Result<()> {
        self.file.seek(SeekFrom::Start(self.header_at))?;
        self.file.write_all(&[self.positions_entry().local(), self.npy_header()].concat())
    }

    fn frame_bytes(&self) -> u64 {
        size_of::<Vec3>() as u64 * self.particles as u64
    }

    /// The offset of the end of the last frame.
    fn frames_end(&self) -> u64 {
        self.frames_at + self.frames() as u64 * self.frame_bytes()
    }
}

impl Drop for CacheWriter {
    fn drop(&mut self) {
        if let Some(part) = &self.part {
            part.remove();
        }
    }
}

/// Whether a cache is begun or resumed.
#[derive(Clone, Copy, PartialEq)]
enum Opening {
    New,
    Existing,
}

/// Hashes the next `count` bytes of `file`, which must exist.
fn hash_exactly(file: &mut File, count: u64, crc: &mut Hasher) -> io::Result<()> {
    let mut buffer = vec![0; 1 << 18];
    let mut left = count;
    while left > 0 {
        let chunk = usize::try_from(left).unwrap_or(usize::MAX).min(buffer.len());
        file.read_exact(&mut buffer[..chunk])?;
        crc.update(&buffer[..chunk]);
        left -= chunk as u64;
    }
    Ok(())
}

pub(crate) fn with_suffix(path: &Path, suffix: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(suffix);
    name.into()
}

pub(crate) fn part(path: &Path) -> PathBuf {
    with_suffix(path, ".part")
}
