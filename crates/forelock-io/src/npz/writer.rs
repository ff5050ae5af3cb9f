//! Writing a motion cache frame by frame.
//!
//! # Theory
//! The file starts with `strand_offsets` and other constant arrays. The array `positions` follows;
//! its header has space for any number of frames. The array `times` and the ZIP directory, which
//! are known only at the end, come last. When the cache is finished, the writer overwrites the
//! header of `positions` with the number of frames F, the sizes and the CRC-32. It combines the
//! checksum from those of the header and of the frames, so it does not read the frames again.
//!
//! # Practice
//! Until it is finished, the cache `hair.npz` is the file `hair.npz.part`, and its times are in
//! `hair.npz.times.part`. So memory does not grow with the number of frames, and a run that was
//! killed can be resumed after its last complete frame. [`CacheWriter::finish`] renames the file.
//! It can be called at any time and gives a complete cache of the frames so far, even after
//! [`append`](CacheWriter::append) failed: `append` removes the incomplete frame, which on a full
//! disk usually leaves enough space for the end of the file. A cache written in several runs has
//! the same bytes as a cache written in one run.
//!
//! # Limitations
//! Only one writer may use a file name at a time. A writer that is dropped before it is finished
//! leaves its `.part` files if they contain a frame.

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
use crate::{atomic, error::WriteError};

const POSITIONS: &str = "positions.npy";
const TIMES: &str = "times.npy";
/// Bytes per entry of `times`.
const TIME_BYTES: u64 = 8;

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
    file: File,
    times: File,
    /// The constant members.
    entries: Vec<Entry>,
    /// The offset of the local header of `positions`.
    header_at: u64,
    particles: usize,
    frames: u64,
    /// The checksum of all frames so far.
    crc: Hasher,
    finished: bool,
}

impl CacheWriter {
    /// Starts the cache at `path` for strands at `strand_offsets`, `[S + 1]`. `constants` are
    /// further arrays, with any names except `positions`, `strand_offsets` and `times`. An existing
    /// file at `path` stays until [`finish`](Self::finish) replaces it.
    ///
    /// # Errors
    /// [`WriteError`] if the file cannot be written, or the offsets describe no particle.
    pub fn create(
        path: &Path,
        strand_offsets: &[u32],
        constants: &[(&str, Array)],
    ) -> Result<Self, WriteError> {
        atomic::check_target(path)?;
        let particles = strand_offsets.last().map_or(0, |&last| last as usize);
        if particles == 0 {
            let problem = "a cache needs at least one particle".into();
            return Err(WriteError::Unfit { path: path.into(), problem });
        }
        let mut open = OpenOptions::new();
        open.read(true).write(true).create(true).truncate(true);
        let open = |path: &Path| open.open(path).map_err(WriteError::io(path));
        let mut writer = Self {
            path: path.into(),
            file: open(&part(path))?,
            times: open(&times_part(path))?,
            entries: Vec::new(),
            header_at: 0,
            particles,
            frames: 0,
            crc: Hasher::new(),
            finished: false,
        };
        writer.begin(strand_offsets, constants).map_err(WriteError::io(path))?;
        Ok(writer)
    }

    fn begin(&mut self, strand_offsets: &[u32], constants: &[(&str, Array)]) -> io::Result<()> {
        let offsets = Array::vector(strand_offsets.to_vec());
        for (name, array) in std::iter::once(&("strand_offsets", offsets)).chain(constants) {
            let npy = array.to_npy();
            let name = format!("{name}.npy");
            let entry = Entry::stored(&name, crc32fast::hash(&npy), npy.len() as u64, self.header_at);
            self.file.write_all(&entry.local())?;
            self.file.write_all(&npy)?;
            self.header_at += entry.local_bytes() + entry.size;
            self.entries.push(entry);
        }
        self.write_header()?;
        self.seek_end()
    }

    /// Resumes the cache at `path`, finished or left as `.part`, after its first `keep_frames`
    /// frames.
    ///
    /// # Errors
    /// [`WriteError`] if there is no such cache, Forelock did not write it, or it has fewer frames.
    pub fn resume(path: &Path, keep_frames: usize) -> Result<Self, WriteError> {
        atomic::check_target(path)?;
        let keep = keep_frames as u64;
        let refuse = |problem: String| WriteError::Resume { path: path.into(), problem };
        let mut held = None;
        for from in [part(path), path.to_path_buf()] {
            match Found::open(&from, from != path, &times_part(path)) {
                Ok(found) if found.frames >= keep => return found.go_on(path, keep),
                Ok(found) => held = Some(held.unwrap_or(0).max(found.frames)),
                Err(e) if e.kind() == io::ErrorKind::NotFound => {}
                Err(e) if matches!(e.kind(), io::ErrorKind::InvalidData | io::ErrorKind::UnexpectedEof) => {
                    return Err(refuse(format!(
                        "{} was not written by Forelock; start again without resuming",
                        from.display()
                    )));
                }
                Err(e) => return Err(WriteError::io(&from)(e)),
            }
        }
        Err(refuse(match held {
            Some(held) => format!(
                "it holds {held} frames and the first {keep} are wanted; start again without resuming"
            ),
            None => "there is none under this name; start again without resuming".into(),
        }))
    }

    /// The number of frames so far, F.
    pub fn frames(&self) -> usize {
        usize::try_from(self.frames).unwrap_or(usize::MAX)
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
        let written =
            self.file.write_all(bytes).and_then(|()| self.times.write_all(&time_secs.to_le_bytes()));
        if let Err(error) = written {
            // If this fails too, the next write returns an error.
            let _ = self.seek_end();
            return Err(WriteError::io(&self.path)(error));
        }
        self.crc.update(bytes);
        self.frames += 1;
        Ok(())
    }

    /// Completes the cache and renames it to its final name. Returns the number of frames.
    ///
    /// # Errors
    /// [`WriteError`] if the file cannot be written. The `.part` files remain and can be resumed.
    pub fn finish(mut self) -> Result<usize, WriteError> {
        atomic::check_target(&self.path)?;
        self.complete().map_err(WriteError::io(&self.path))?;
        // Windows cannot rename an open file, so close both files first.
        let (path, frames) = (self.path.clone(), self.frames());
        self.finished = true;
        drop(self);
        fs::rename(part(&path), &path).map_err(WriteError::io(&path))?;
        // If this fails, the file of times remains, which does no harm.
        let _ = fs::remove_file(times_part(&path));
        Ok(frames)
    }

    /// Writes the end of the file, then overwrites the header of `positions`.
    fn complete(&mut self) -> io::Result<()> {
        self.seek_end()?;
        let mut entries = self.entries.clone();
        let positions = self.positions_entry();
        let times_at = positions.header + positions.local_bytes() + positions.size;
        entries.push(positions);

        let header = npy::header("<f8", &[self.frames()]);
        let mut crc = Hasher::new();
        crc.update(&header);
        self.times.rewind()?;
        hash_exactly(&mut self.times, self.frames * TIME_BYTES, &mut crc)?;
        let size = header.len() as u64 + self.frames * TIME_BYTES;
        let times = Entry::stored(TIMES, crc.finalize(), size, times_at);
        self.file.write_all(&times.local())?;
        self.file.write_all(&header)?;
        self.times.rewind()?;
        io::copy(&mut (&self.times).take(self.frames * TIME_BYTES), &mut self.file)?;
        let end = times.header + times.local_bytes() + times.size;
        entries.push(times);
        self.file.write_all(&zip::directory(&entries, end))?;
        self.write_header()?;
        self.file.flush()
    }

    fn npy_header(&self) -> Vec<u8> {
        npy::header("<f4", &[self.frames(), self.particles, 3])
    }

    /// The archive member `positions` with the frames so far.
    fn positions_entry(&self) -> Entry {
        let mut crc = Hasher::new();
        crc.update(&self.npy_header());
        crc.combine(&self.crc);
        let size = HEADER_BYTES as u64 + self.frames * self.frame_bytes();
        Entry::stored(POSITIONS, crc.finalize(), size, self.header_at)
    }

    fn write_header(&mut self) -> io::Result<()> {
        self.file.seek(SeekFrom::Start(self.header_at))?;
        self.file.write_all(&self.positions_entry().local())?;
        self.file.write_all(&self.npy_header())
    }

    fn frame_bytes(&self) -> u64 {
        size_of::<Vec3>() as u64 * self.particles as u64
    }

    /// Truncates both files after the last complete frame and seeks to their ends.
    fn seek_end(&mut self) -> io::Result<()> {
        let entry = self.positions_entry();
        let end = entry.header + entry.local_bytes() + entry.size;
        for (file, end) in [(&mut self.file, end), (&mut self.times, self.frames * TIME_BYTES)] {
            file.set_len(end)?;
            file.seek(SeekFrom::Start(end))?;
        }
        Ok(())
    }
}

impl Drop for CacheWriter {
    fn drop(&mut self) {
        if !self.finished && self.frames == 0 {
            let _ = fs::remove_file(part(&self.path));
            let _ = fs::remove_file(times_part(&self.path));
        }
    }
}

/// A cache that can be resumed, complete or not.
struct Found {
    file: File,
    is_part: bool,
    entries: Vec<Entry>,
    header_at: u64,
    particles: usize,
    frames: u64,
    times: Vec<u8>,
}

impl Found {
    /// Reads the members of a cache from its start. If the bytes are not those of a cache, the kind
    /// of the error is `InvalidData` or `UnexpectedEof`.
    fn open(path: &Path, is_part: bool, times_path: &Path) -> io::Result<Self> {
        let mut file = OpenOptions::new().read(true).write(true).open(path)?;
        let length = file.metadata()?.len();
        let mut entries = Vec::new();
        let mut at = 0;
        let positions = loop {
            file.seek(SeekFrom::Start(at))?;
            let entry = Entry::read_local(&mut file, at)?;
            if entry.name == POSITIONS {
                break entry;
            }
            at = at.saturating_add(entry.local_bytes()).saturating_add(entry.size);
            entries.push(entry);
        };
        let mut head = [0; HEADER_BYTES];
        file.read_exact(&mut head)?;
        let header = npy::Header::parse(&head).map_err(|e| io::Error::new(io::ErrorKind::InvalidData, e))?;
        let [stated, particles @ 1..=usize::MAX, 3] = header.shape[..] else {
            return Err(io::ErrorKind::InvalidData.into());
        };
        let frame_bytes = (particles as u64).saturating_mul(size_of::<Vec3>() as u64);
        let data_at = at + positions.local_bytes() + HEADER_BYTES as u64;
        let mut frames = length.saturating_sub(data_at) / frame_bytes;
        let mut times = Vec::new();
        if is_part {
            File::open(times_path)?.read_to_end(&mut times)?;
            frames = frames.min(times.len() as u64 / TIME_BYTES);
        } else {
            frames = frames.min(stated as u64);
            file.seek(SeekFrom::Start(data_at + frames * frame_bytes))?;
            let here = file.stream_position()?;
            let entry = Entry::read_local(&mut file, here)?;
            let size = entry.size.checked_sub(frames * TIME_BYTES).filter(|_| entry.name == TIMES);
            let skipped = size.and_then(|n| i64::try_from(n).ok()).ok_or(io::ErrorKind::InvalidData)?;
            file.seek_relative(skipped)?;
            (&file).take(frames * TIME_BYTES).read_to_end(&mut times)?;
        }
        Ok(Self { file, is_part, entries, header_at: at, particles, frames, times })
    }

    /// A writer that continues after the first `keep` frames, which must exist.
    fn go_on(self, path: &Path, keep: u64) -> Result<CacheWriter, WriteError> {
        let at_times = |keep: u64| usize::try_from(keep * TIME_BYTES).unwrap_or(usize::MAX);
        let times_path = times_part(path);
        let open_times = || {
            let mut times =
                OpenOptions::new().read(true).write(true).create(true).truncate(true).open(&times_path)?;
            times.write_all(self.times.get(..at_times(keep)).unwrap_or(&self.times))?;
            Ok(times)
        };
        let times = open_times().map_err(WriteError::io(&times_path))?;
        if !self.is_part {
            fs::rename(path, part(path)).map_err(WriteError::io(path))?;
        }
        let mut writer = CacheWriter {
            path: path.into(),
            file: self.file,
            times,
            entries: self.entries,
            header_at: self.header_at,
            particles: self.particles,
            frames: 0,
            crc: Hasher::new(),
            finished: false,
        };
        let start = writer.header_at + writer.positions_entry().local_bytes() + HEADER_BYTES as u64;
        writer.frames = keep;
        let bytes = keep * writer.frame_bytes();
        let mut recount = || {
            writer.file.seek(SeekFrom::Start(start))?;
            hash_exactly(&mut writer.file, bytes, &mut writer.crc)?;
            writer.seek_end()
        };
        recount().map_err(WriteError::io(path))?;
        Ok(writer)
    }
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

fn with_suffix(path: &Path, suffix: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(suffix);
    name.into()
}

fn part(path: &Path) -> PathBuf {
    with_suffix(path, ".part")
}

fn times_part(path: &Path) -> PathBuf {
    with_suffix(path, ".times.part")
}
