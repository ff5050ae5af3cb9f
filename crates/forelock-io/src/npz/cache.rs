//! Reading a motion cache, one frame at a time.

use std::{
    fs::File,
    io::{self, BufReader, Read},
    path::{Path, PathBuf},
};

use glam::Vec3;

use super::{
    Array, NpzError, invalid,
    npy::{Data, Header},
    zip::{Archive, Entry},
};
use crate::error::{ReadError, check_room};

/// A cache file whose frames are read on demand. Only offsets and times are kept in memory.
///
/// In a stored (uncompressed) cache, reading a frame takes the same time for every frame. A
/// deflated cache is decompressed from its start for each frame. Checksums are not verified, since
/// that needs the whole file.
pub struct Cache {
    path: PathBuf,
    archive: Archive<BufReader<File>>,
    positions: Entry,
    header: Header,
    frames: usize,
    particles: usize,
    strand_offsets: Vec<u32>,
    times: Option<Vec<f64>>,
}

impl Cache {
    /// Opens the cache at `path`.
    ///
    /// # Errors
    /// [`ReadError`] if the file is not a cache. A cache has `positions` `[F, P, 3]` and matching
    /// `strand_offsets` `[S + 1]`.
    pub fn open(path: &Path) -> Result<Self, ReadError> {
        let file = BufReader::new(crate::open(path)?);
        Self::from_file(path, file).map_err(|e| e.at(path))
    }

    fn from_file(path: &Path, file: BufReader<File>) -> Result<Self, NpzError> {
        let mut archive = Archive::open(file)?;
        let positions =
            archive.find("positions.npy").ok_or_else(|| invalid("it has no array `positions`"))?;
        let header = archive.header(&positions)?;
        let [frames, particles, 3] = header.shape[..] else {
            return Err(invalid(format!(
                "`positions` has the shape {:?}, but a cache has [frames, particles, 3]; is it a groom?",
                header.shape
            )));
        };
        if !header.has_frames() {
            return Err(invalid(
                "`positions` must be float32 or float64 in C order; save it with numpy.ascontiguousarray",
            ));
        }
        if header.byte_count()? > positions.size.saturating_sub(header.at as u64) {
            return Err(invalid(format!(
                "`positions` is shorter than its {frames} frames of {particles} particles"
            )));
        }
        let offsets = archive.array("strand_offsets")?;
        let strand_offsets = offsets.as_ref().and_then(Array::counts).map(|v| v.into_owned());
        let strand_offsets = strand_offsets.filter(|offsets| fit(offsets, particles)).ok_or_else(|| {
            invalid(format!(
                "`strand_offsets` is missing, or does not grow from 0 to the {particles} particles"
            ))
        })?;
        let times = match archive.array("times")? {
            Some(Array { data: Data::F64(times), .. }) if times.len() == frames => Some(times),
            None => None,
            Some(_) => return Err(invalid(format!("`times` must be float64 and have {frames} entries"))),
        };
        Ok(Self { path: path.into(), archive, positions, header, frames, particles, strand_offsets, times })
    }

    /// The number of frames, F.
    pub fn frames(&self) -> usize {
        self.frames
    }

    /// The number of particles, P.
    pub fn particles(&self) -> usize {
        self.particles
    }

    /// The index of each strand's first particle, and P at the end, `[S + 1]`.
    pub fn strand_offsets(&self) -> &[u32] {
        &self.strand_offsets
    }

    /// The times of the frames in seconds, `[F]`, if the file has them.
    pub fn times_secs(&self) -> Option<&[f64]> {
        self.times.as_deref()
    }

    /// Another array of the cache, such as one given to
    /// [`CacheWriter::create`](super::CacheWriter::create).
    ///
    /// # Errors
    /// [`ReadError`] if the array cannot be read.
    pub fn array(&mut self, name: &str) -> Result<Option<Array>, ReadError> {
        self.archive.array(name).map_err(|e| e.at(&self.path))
    }

    /// Reads the P positions of frame `frame`, in metres, into `out`.
    ///
    /// # Errors
    /// [`ReadError`] if the frame does not exist or cannot be read.
    pub fn read_frame(&mut self, frame: usize, out: &mut Vec<Vec3>) -> Result<(), ReadError> {
        self.frame(frame, out).map_err(|e| e.at(&self.path))
    }

    fn frame(&mut self, frame: usize, out: &mut Vec<Vec3>) -> Result<(), NpzError> {
        if frame >= self.frames {
            return Err(invalid(format!("there is no frame {frame}: it has {}", self.frames)));
        }
        // `open` has checked that the file contains all frames, so this cannot overflow.
        let bytes = self.particles * 3 * self.header.item_bytes;
        let skipped = self.header.at as u64 + frame as u64 * bytes as u64;
        let raw = if self.positions.is_stored() {
            let start = self.archive.data_start(&self.positions)?;
            self.archive.read_at(start + skipped, bytes as u64)?
        } else {
            let mut member = self.archive.member(&self.positions)?;
            io::copy(&mut member.by_ref().take(skipped), &mut io::sink())?;
            let mut raw = Vec::new();
            check_room(bytes as u64)?;
            member.take(bytes as u64).read_to_end(&mut raw)?;
            raw
        };
        let array = Array { shape: vec![self.particles, 3], data: self.header.decode(&raw) };
        let floats = array.floats().filter(|floats| floats.len() == self.particles * 3);
        let floats = floats.ok_or_else(|| invalid(format!("frame {frame} is cut short")))?;
        out.clear();
        out.extend(floats.as_chunks::<3>().0.iter().map(|&p| Vec3::from_array(p)));
        Ok(())
    }
}

/// Whether `offsets` rise from 0 to `particles`.
fn fit(offsets: &[u32], particles: usize) -> bool {
    offsets.first() == Some(&0)
        && offsets.last().is_some_and(|&last| last as usize == particles)
        && offsets.is_sorted()
}
