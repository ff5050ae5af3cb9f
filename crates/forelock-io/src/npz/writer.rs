//! Writing a cache of motion frame by frame.
//!
//! # Theory
//! `strand_offsets` and other constant arrays come first, then `positions`, whose header has room for any
//! number of frames, then what is only known at the end: `times` and the directory. At the end the header of
//! `positions` is patched with F, sizes and CRC-32; the checksum of header + frames is combined from the two,
//! so that nothing is read twice.
//!
//! # Practice
//! While it grows, the cache `hair.npz` is `hair.npz.part`, with the times beside it in
//! `hair.npz.times.part`: memory does not grow with frames, and a run that was killed can be resumed from its
//! whole frames. [`CacheWriter::finish`] renames it. Finishing early gives a complete cache of the frames so
//! far, even after a failed [`append`](CacheWriter::append): that takes back what it wrote of its frame,
//! which as a rule makes room for the end on a full disk. A cache written in several goes has the same bytes
//! as one written in one.
//!
//! # Limitations
//! One writer a name at a time. A writer dropped unfinished leaves its `.part` files if they hold a frame.

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
/// Bytes a time takes.
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
    /// Where the local header of `positions` begins.
    header_at: u64,
    particles: usize,
    frames: u64,
    /// Of all frames so far.
    crc: Hasher,
    finished: bool,
}

impl CacheWriter {
    /// Begins the cache `path` for strands at `strand_offsets`, `[S + 1]`, with further constant arrays by
    /// name (any but `positions`, `strand_offsets` and `times`). What stands under the name stays until
    /// [`finish`](Self::finish).
    ///
    /// # Errors
    /// [`WriteError`] if the place cannot be written to, or the offsets hold no particle.
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

    /// Goes on with the cache `path`, finished or left as `.part`, after its first `keep_frames` frames.
    ///
    /// # Errors
    /// [`WriteError`] if there is none, it was not written here, or it holds fewer frames.
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
                        "{} was not written by Forelock; start anew",
                        from.display()
                    )));
                }
                Err(e) => return Err(WriteError::io(&from)(e)),
            }
        }
        Err(refuse(match held {
            Some(held) => format!("it holds {held} frames and the first {keep} are wanted; start anew"),
            None => "there is none under this name; start anew".into(),
        }))
    }

    /// Frames so far, F.
    pub fn frames(&self) -> usize {
        usize::try_from(self.frames).unwrap_or(usize::MAX)
    }

    /// Adds the frame at `time_secs` with the P `positions` in metres.
    ///
    /// # Errors
    /// [`WriteError`] if the number of positions is wrong, or the disk refuses; the frames so far are safe
    /// then, and [`finish`](Self::finish) makes a complete cache of them.
    pub fn append(&mut self, time_secs: f64, positions: &[Vec3]) -> Result<(), WriteError> {
        if positions.len() != self.particles {
            let problem =
                format!("a frame has {} particles, and the cache {}", positions.len(), self.particles);
            return Err(WriteError::Unfit { path: self.path.clone(), problem });
        }
        let bytes: &[u8] = bytemuck::cast_slice(positions);
        let written =
            self.file.write_all(bytes).and_then(|()| self.times.write_all(&time_secs.to_le_bytes()));
        if let Err(error) = written {
            // If this fails too, the next write will say so.
            let _ = self.seek_end();
            return Err(WriteError::io(&self.path)(error));
        }
        self.crc.update(bytes);
        self.frames += 1;
        Ok(())
    }

    /// Completes the cache and gives it its name. Returns the number of frames.
    ///
    /// # Errors
    /// [`WriteError`] if the disk refuses; the `.part` files are left then, and can be resumed.
    pub fn finish(mut self) -> Result<usize, WriteError> {
        atomic::check_target(&self.path)?;
        self.complete().map_err(WriteError::io(&self.path))?;
        // Windows renames no open file, so the handles go first.
        let (path, frames) = (self.path.clone(), self.frames());
        self.finished = true;
        drop(self);
        fs::rename(part(&path), &path).map_err(WriteError::io(&path))?;
        // A leftover file of times does no harm.
        let _ = fs::remove_file(times_part(&path));
        Ok(frames)
    }

    /// Writes the end, then patches the header.
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

    /// The member `positions` as it is with the frames so far.
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

    /// Cuts both files behind the last whole frame, and goes there.
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
    /// Walks through the members of a cache from its beginning. Where its bytes are no cache's, the error's
    /// kind is `InvalidData` or `UnexpectedEof`.
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

    /// A writer behind the first `keep` frames, which must be there.
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

/// Hashes the next `count` bytes of `file`, which must be there.
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
