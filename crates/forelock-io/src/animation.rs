//! Moving strands in any format that holds them: `.npz`, `.abc`, `.usdc` and `.usd`, and `.glb`,
//! which is only written.
//!
//! # Practice
//! [`AnimationReader`] reads a frame at a time, [`AnimationWriter`] writes one, and [`convert`]
//! does both: memory does not grow with the number of frames.
//!
//! ```
//! use forelock_core::groom::{Groom, Import};
//! use forelock_io::animation::{AnimationReader, AnimationWriter, convert};
//! use glam::Vec3;
//!
//! let folder = tempfile::tempdir()?;
//! let [cache, abc] = ["hair.npz", "hair.abc"].map(|name| folder.path().join(name));
//! let groom = Groom::from_strands([[Vec3::ZERO, Vec3::Y]])?;
//! let times = [0.0, 0.5, 1.0];
//! let mut writer = AnimationWriter::create(&cache, &groom, &times, false)?;
//! for time in times {
//!     writer.write(&[Vec3::ZERO, Vec3::Y * (1.0 + time as f32)])?;
//! }
//! writer.finish()?;
//!
//! let mut reader = AnimationReader::open(&cache, &Import::default())?;
//! convert(&mut reader, &abc, true, &mut |_| {})?;
//! let mut again = AnimationReader::open(&abc, &Import::default())?;
//! let mut positions = Vec::new();
//! again.read(2, &mut positions)?;
//! assert_eq!((again.times_secs(), positions[1]), (&times[..], Vec3::Y * 2.0));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Limitations
//! All frames must have the strands of the first one. Alembic and USD take frames at a constant
//! rate only.

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use forelock_core::groom::{Groom, Import, Unit, ZUp};
use glam::Vec3;

use crate::usd::{Usd, UsdCacheWriter};
use crate::{Cache, CacheWriter, Format, ReadError, WriteError, alembic, gltf, is_text, npz, open};

/// Frames a second of a cache that holds no times.
const UNTIMED_RATE: f64 = 60.0;
/// Width of strands without one, metres: other programs take a centimetre.
const WIDTH: f32 = 1e-4;

/// How far the time of a frame may be from that of a constant rate, in frames.
const JITTER: f64 = 0.01;

/// Why moving strands cannot be converted.
#[derive(Debug, thiserror::Error)]
pub enum AnimationError {
    /// They cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// They cannot be written.
    #[error(transparent)]
    Write(#[from] WriteError),
}

enum Source {
    Npz(Cache),
    Alembic(alembic::Reader<File>),
    Usd(Usd<BufReader<File>>),
}

/// Moving strands in a file, in metres and y up, read frame by frame.
pub struct AnimationReader {
    path: PathBuf,
    source: Source,
    import: Import,
    groom: Groom,
    times_secs: Vec<f64>,
}

impl AnimationReader {
    /// Opens the file at `path`. A unit or axis in `import` counts where the file names none.
    ///
    /// # Errors
    /// [`ReadError`] if it cannot be read, or holds no strands.
    pub fn open(path: &Path, import: &Import) -> Result<Self, ReadError> {
        let mut import = *import;
        let file = || open(path).map(BufReader::new);
        let (source, mut groom, times_secs) = match Format::of(path) {
            Some(Format::Npz) => {
                let cache = Cache::open(path)?;
                let groom = npz::read_groom(file()?).map_err(|e| e.at(path))?;
                let times = (0..cache.frames()).map(|frame| frame as f64 / UNTIMED_RATE).collect();
                let times = cache.times_secs().map_or(times, <[f64]>::to_vec);
                (Source::Npz(cache), groom, times)
            }
            Some(Format::Alembic) => {
                let mut reader = alembic::Reader::open(open(path)?).map_err(|e| e.at(path))?;
                if import.unit == Unit::default() {
                    import.unit = reader.unit();
                }
                let groom = reader.read(0).map_err(|e| e.at(path))?.groom;
                let times = (0..reader.frames()).map(|frame| reader.time_secs(frame)).collect();
                (Source::Alembic(reader), groom, times)
            }
            Some(Format::Usd) => {
                let layer = Usd::open(file()?).map_err(|e| e.at(path))?;
                import = layer.import(&import);
                let groom = layer.frame(0).map_err(|e| e.at(path))?;
                let times = if layer.times_secs().is_empty() { &[0.0][..] } else { layer.times_secs() };
                let times = times.to_vec();
                (Source::Usd(layer), groom, times)
            }
            _ => return Err(ReadError::UnknownEnding { path: path.into(), known: known(is_read) }),
        };
        import.apply(&mut groom, ZUp::Common);
        Ok(Self { path: path.into(), source, import, groom, times_secs })
    }

    /// The same with the attributes of `groom`, if it has the strands of the file.
    #[must_use]
    pub fn with_attributes_of(self, groom: &Groom) -> Self {
        let fits = groom.strand_offsets() == self.groom.strand_offsets();
        Self { groom: if fits { groom.clone() } else { self.groom }, ..self }
    }

    /// The strands of the first frame, with the attributes of the file, metres and y up.
    pub fn groom(&self) -> &Groom {
        &self.groom
    }

    /// The same frames at times `secs` later.
    #[must_use]
    pub fn later(mut self, secs: f64) -> Self {
        self.times_secs.iter_mut().for_each(|time| *time += secs);
        self
    }

    /// The times of the frames in seconds, `[F]`.
    pub fn times_secs(&self) -> &[f64] {
        &self.times_secs
    }

    /// Reads the P positions of frame `frame`, metres and y up, into `out`.
    ///
    /// # Errors
    /// [`ReadError`] if there is no such frame, it cannot be read, or it has other strands than the
    /// first.
    pub fn read(&mut self, frame: usize, out: &mut Vec<Vec3>) -> Result<(), ReadError> {
        let path = &self.path;
        let wrong = |problem| ReadError::Animation { path: path.clone(), problem };
        if frame >= self.times_secs.len() {
            return Err(wrong(format!("there is no frame {frame}: it has {}", self.times_secs.len())));
        }
        let groom = match &mut self.source {
            Source::Npz(cache) => {
                cache.read_frame(frame, out)?;
                out.iter_mut().for_each(|p| *p = self.import.point(*p, ZUp::Common));
                return Ok(());
            }
            Source::Alembic(reader) => {
                let index = u32::try_from(frame).unwrap_or(u32::MAX);
                reader.read(index).map_err(|e| e.at(path))?.groom
            }
            Source::Usd(layer) => layer.frame(frame).map_err(|e| e.at(path))?,
        };
        if groom.strand_offsets() != self.groom.strand_offsets() {
            return Err(wrong(format!("frame {frame} has other strands than the first one")));
        }
        out.clear();
        out.extend(groom.positions().iter().map(|p| self.import.point(*p, ZUp::Common)));
        Ok(())
    }
}

enum Sink {
    Npz(CacheWriter),
    Alembic(alembic::CurvesWriter),
    Usd(UsdCacheWriter),
    Gltf(gltf::LinesWriter),
}

/// Writes moving strands frame by frame.
pub struct AnimationWriter {
    sink: Sink,
    times_secs: Vec<f64>,
    written: usize,
    has_velocities: bool,
    /// The two frames before the next one: velocities need that after them.
    before: [Vec<Vec3>; 2],
}

impl AnimationWriter {
    /// Starts the file at `path` for the strands and attributes of `groom`, with frames at
    /// `times_secs`. `has_velocities`: it gets velocities too, as motion blur needs them; `.npz`
    /// and `.glb` have none. In Alembic and USD strands without widths get 0.1 mm.
    ///
    /// # Errors
    /// [`WriteError`] if the format is unknown, cannot hold frames at these times, or the file
    /// cannot be written.
    pub fn create(
        path: &Path,
        groom: &Groom,
        times_secs: &[f64],
        has_velocities: bool,
    ) -> Result<Self, WriteError> {
        let unfit = |problem: String| WriteError::Unfit { path: path.into(), problem };
        let mut drawn = groom.clone();
        drawn.widths.get_or_insert_with(|| vec![WIDTH; groom.particle_count()]);
        let sink = match Format::of(path) {
            Some(Format::Npz) => {
                groom.check_attributes().map_err(|error| unfit(error.to_string()))?;
                Sink::Npz(CacheWriter::create(path, groom.strand_offsets(), &npz::attributes(groom))?)
            }
            Some(Format::Alembic) => {
                let rate = rate(times_secs).map_err(unfit)?;
                let start = times_secs.first().copied().unwrap_or_default();
                Sink::Alembic(alembic::CurvesWriter::create(path, &drawn, start, rate)?)
            }
            Some(Format::Usd) if is_text(path) => {
                return Err(unfit("text is too large for moving strands: name it .usdc".into()));
            }
            Some(Format::Usd) => {
                let rate = rate(times_secs).map_err(unfit)?;
                Sink::Usd(UsdCacheWriter::create(path, &drawn, rate)?)
            }
            Some(Format::Gltf) if is_text(path) => {
                return Err(unfit("text is too large for moving strands: name it .glb".into()));
            }
            Some(Format::Gltf) => Sink::Gltf(gltf::LinesWriter::create(path, groom, times_secs)?),
            _ => return Err(WriteError::UnknownEnding { path: path.into(), known: known(is_written) }),
        };
        let has_velocities = has_velocities && !matches!(sink, Sink::Npz(_) | Sink::Gltf(_));
        Ok(Self {
            sink,
            times_secs: times_secs.to_vec(),
            written: 0,
            has_velocities,
            before: Default::default(),
        })
    }

    /// Writes the next frame: P positions, metres and y up.
    ///
    /// # Errors
    /// [`WriteError`] if the number of positions is wrong, there are more frames than times, or the
    /// file cannot be written.
    pub fn write(&mut self, positions: &[Vec3]) -> Result<(), WriteError> {
        if !self.has_velocities {
            return self.put(positions, None);
        }
        let seen = self.written + usize::from(!self.before[1].is_empty());
        if seen > 0 {
            let [earlier, now] = std::mem::take(&mut self.before);
            let times = [seen.saturating_sub(2), seen].map(|frame| self.time(frame));
            let from = if earlier.is_empty() { &now } else { &earlier };
            let velocities = velocities(from, positions, times);
            self.put(&now, Some(&velocities))?;
            self.before[0] = now;
        }
        self.before[1] = positions.to_vec();
        Ok(())
    }

    fn time(&self, frame: usize) -> f64 {
        self.times_secs.get(frame).copied().unwrap_or(f64::INFINITY)
    }

    fn put(&mut self, positions: &[Vec3], velocities: Option<&[Vec3]>) -> Result<(), WriteError> {
        let time_secs = self.time(self.written);
        self.written += 1;
        match &mut self.sink {
            Sink::Npz(writer) => writer.append(time_secs, positions),
            Sink::Alembic(writer) => writer.write_frame(positions, velocities),
            Sink::Usd(writer) => writer.append(time_secs, positions, velocities),
            Sink::Gltf(writer) => writer.write_frame(positions),
        }
    }

    /// Completes the file under its name.
    ///
    /// # Errors
    /// [`WriteError`] if it cannot be written.
    pub fn finish(mut self) -> Result<(), WriteError> {
        let [earlier, now] = std::mem::take(&mut self.before);
        if !now.is_empty() {
            let times = [self.written.saturating_sub(1), self.written].map(|frame| self.time(frame));
            let from = if earlier.is_empty() { &now } else { &earlier };
            let velocities = velocities(from, &now, times);
            self.put(&now, Some(&velocities))?;
        }
        match self.sink {
            Sink::Npz(writer) => writer.finish().map(drop),
            Sink::Alembic(writer) => writer.finish(),
            Sink::Usd(writer) => writer.finish().map(drop),
            Sink::Gltf(writer) => writer.finish(),
        }
    }
}

/// Mean velocities between two frames, metres per second; zero if they are one.
fn velocities(from: &[Vec3], to: &[Vec3], [start, end]: [f64; 2]) -> Vec<Vec3> {
    let secs = (end - start) as f32;
    let per_sec = if secs > 0.0 && secs.is_finite() { secs.recip() } else { 0.0 };
    from.iter().zip(to).map(|(from, to)| (*to - *from) * per_sec).collect()
}

/// Frames a second at `times_secs`.
fn rate(times_secs: &[f64]) -> Result<f64, String> {
    let [first, .., last] = times_secs else { return Ok(UNTIMED_RATE) };
    let rate = (times_secs.len() - 1) as f64 / (last - first);
    let is_even = |(frame, time): (usize, &f64)| ((time - first) * rate - frame as f64).abs() < JITTER;
    if rate.is_finite() && rate > 0.0 && times_secs.iter().enumerate().all(is_even) {
        // Times are often written with few digits.
        let whole = rate.round();
        return Ok(if (rate - whole).abs() < 1e-6 * rate { whole } else { rate });
    }
    Err("its frames must follow each other at a constant rate; an .npz holds any times".into())
}

/// Converts all frames of `reader` to the file at `path`, in the format of its ending, and calls
/// `observe` with the number of frames done. Returns the number of frames.
///
/// # Errors
/// [`AnimationError`] if a frame cannot be read or written.
pub fn convert(
    reader: &mut AnimationReader,
    path: &Path,
    has_velocities: bool,
    observe: &mut dyn FnMut(usize),
) -> Result<usize, AnimationError> {
    let times = reader.times_secs().to_vec();
    let mut writer = AnimationWriter::create(path, reader.groom(), &times, has_velocities)?;
    let mut positions = Vec::new();
    for frame in 0..times.len() {
        reader.read(frame, &mut positions)?;
        writer.write(&positions)?;
        observe(frame + 1);
    }
    writer.finish()?;
    Ok(times.len())
}

/// Whether moving strands can be written to a file of the name `path`.
pub fn is_written(path: &Path) -> bool {
    let formats = [Format::Npz, Format::Alembic, Format::Usd, Format::Gltf];
    Format::of(path).is_some_and(|own| formats.contains(&own)) && !is_text(path)
}

/// Whether moving strands can be read from a file of the name `path`.
fn is_read(path: &Path) -> bool {
    let formats = [Format::Npz, Format::Alembic, Format::Usd];
    Format::of(path).is_some_and(|own| formats.contains(&own))
}

/// The endings of the formats of moving strands that `which` accepts, as a list for messages.
fn known(which: fn(&Path) -> bool) -> String {
    let endings = Format::ALL.into_iter().flat_map(Format::endings).map(|ending| format!(".{ending}"));
    endings.filter(|ending| which(Path::new(&format!("a{ending}")))).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAMES: usize = 5;

    fn groom() -> Groom {
        let strand = |x: f32| (0..4).map(|i| Vec3::new(x, -0.01 * i as f32, 0.0)).collect::<Vec<_>>();
        let mut groom = Groom::from_strands((0..3).map(|s| strand(s as f32))).unwrap();
        groom.widths = Some(vec![1e-4; 12]);
        groom
    }

    fn at(frame: usize) -> Vec<Vec3> {
        let time = frame as f32 / 24.0;
        groom().positions().iter().map(|p| *p + Vec3::new(0.5 * time * time, 0.0, time)).collect()
    }

    fn times() -> Vec<f64> {
        (0..FRAMES).map(|frame| frame as f64 / 24.0).collect()
    }

    #[test]
    fn every_format_is_converted_to_every_other() {
        let folder = tempfile::tempdir().unwrap();
        let names = ["a.npz", "b.abc", "c.usdc", "d.usd", "e.npz"];
        let paths = names.map(|name| folder.path().join(name));
        let mut writer = AnimationWriter::create(&paths[0], &groom(), &times(), true).unwrap();
        (0..FRAMES).for_each(|frame| writer.write(&at(frame)).unwrap());
        writer.finish().unwrap();
        for pair in paths.windows(2) {
            let mut reader = AnimationReader::open(&pair[0], &Import::default()).unwrap();
            let mut seen = 0;
            assert_eq!(convert(&mut reader, &pair[1], true, &mut |done| seen = done).unwrap(), FRAMES);
            assert_eq!(seen, FRAMES);
            let mut again = AnimationReader::open(&pair[1], &Import::default()).unwrap();
            assert_eq!(again.groom().strand_offsets(), groom().strand_offsets());
            let mut positions = Vec::new();
            for (frame, time) in times().into_iter().enumerate() {
                again.read(frame, &mut positions).unwrap();
                assert_eq!(positions, at(frame), "{}", pair[1].display());
                assert!((again.times_secs()[frame] - time).abs() < 1e-9);
            }
            assert!(again.read(FRAMES, &mut positions).is_err());
        }
    }

    #[test]
    fn velocities_are_those_between_the_frames_beside() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.abc");
        let mut writer = AnimationWriter::create(&path, &groom(), &times(), true).unwrap();
        (0..FRAMES).for_each(|frame| writer.write(&at(frame)).unwrap());
        writer.finish().unwrap();
        let mut reader = alembic::Reader::open(File::open(&path).unwrap()).unwrap();
        for frame in 0..FRAMES {
            let contents = reader.read(frame as u32).unwrap();
            assert_eq!(contents.groom.positions(), at(frame));
            // x = t²/2: exact in the middle, half a frame off at the ends.
            let shift = [1.0, 0.0, 0.0, 0.0, -1.0][frame] * 0.5 / 24.0;
            let expected = Vec3::new(frame as f32 / 24.0 + shift, 0.0, 1.0);
            for velocity in contents.velocities.unwrap() {
                assert!(velocity.distance(expected) < 1e-4, "frame {frame}: {velocity} {expected}");
            }
        }
    }

    #[test]
    fn what_cannot_be_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let create = |name: &str, times: &[f64]| {
            AnimationWriter::create(&folder.path().join(name), &groom(), times, false).map(drop)
        };
        let message = |own: Result<(), WriteError>| own.unwrap_err().to_string();
        assert!(message(create("a.abc", &[0.0, 1.0, 1.5])).contains("constant rate"));
        assert!(message(create("a.usda", &[0.0])).contains(".usdc"));
        assert!(message(create("a.gltf", &[0.0])).contains(".glb"));
        assert!(message(create("a.glb", &[0.0, 1.0, 1.0])).contains("frame 2 is not later"));
        assert!(message(create("a.obj", &[0.0])).contains(".npz .abc .usdc .usd .glb"));
        let names = [
            "a.npz", "a.ABC", "a.usdc", "a.USD", "a.Glb", "a.usda", "a.UsdA", "a.gltf", "a.obj", "abc", "a.",
        ];
        let written = names.map(|name| is_written(Path::new(name)));
        assert_eq!(written, std::array::from_fn(|i| i < 5));
        let open = AnimationReader::open(&folder.path().join("a.obj"), &Import::default());
        assert!(open.err().unwrap().to_string().ends_with(".npz .abc .usda .usdc .usd"));
        assert_eq!(rate(&[0.0, 0.016_667, 0.033_333]).map(f64::round), Ok(60.0));
    }
}
