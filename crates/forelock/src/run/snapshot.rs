//! Snapshots: what a later run needs to go on bit for bit, as an `.npz` file.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use forelock_core::strands::{SleepSnapshot, Snapshot as State};
use forelock_io::npz::{Array, Data, read_npz, write_npz};

use crate::hash::Fnv;
use crate::penetration::Penetration;
use crate::summary::FrameRow;

/// What each frame until one took, and the worst values of all of them; a file holds the state
/// after that frame as well.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Snapshot {
    /// What it belongs to: see [`Assets::fingerprint`](crate::assets::Assets::fingerprint).
    pub(crate) fingerprint: u64,
    /// Frames done.
    pub(crate) frame: u32,
    pub(crate) quarantined_strands: u64,
    /// Largest stretch after the length pass, the same after solids, most contacts between strands.
    pub(crate) worst: [f64; 3],
    /// The largest values of the frames that were measured.
    pub(crate) penetration: Penetration,
    /// What each frame took and found.
    pub(crate) rows: Vec<FrameRow>,
    /// Where `rows` were timed, as a hash.
    pub(crate) machine: u64,
    /// The checksum of the cache's frames until then; 0 without a cache.
    pub(crate) cache_checksum: u32,
}

/// Why a run cannot be resumed.
#[derive(Debug, thiserror::Error)]
pub enum SnapshotError {
    /// The snapshot cannot be read.
    #[error("the run cannot be resumed: {0}; run once without --resume")]
    Read(#[from] forelock_io::ReadError),
    /// It holds something else.
    #[error("{}: this is no snapshot of a run: {problem}; run once without --resume", .path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        problem: String,
    },
    /// It belongs to another scene.
    #[error("{}: the scene or a file that it names has changed since; run once without --resume", .0.display())]
    Other(PathBuf),
}

/// Name of the array of what each frame took and found.
const ROWS: &str = "frames";

/// Numbers of a row of [`ROWS`]: milliseconds by the clock and of the solver, stretch, and those of
/// the penetration, which are NaN where it was not measured.
const ROW: usize = 7;

/// Name of the array of the largest penetration.
const PENETRATION: &str = "penetration";

fn numbers(penetration: &Penetration) -> [f64; 4] {
    let Penetration { share_inside, deepest_m, edge_share_inside, deepest_edge_m } = *penetration;
    [share_inside, deepest_m, edge_share_inside, deepest_edge_m]
}

fn penetration_of([share_inside, deepest_m, edge_share_inside, deepest_edge_m]: [f64; 4]) -> Penetration {
    Penetration { share_inside, deepest_m, edge_share_inside, deepest_edge_m }
}

fn row_numbers(row: &FrameRow) -> [f64; ROW] {
    let [a, b, c, d] = row.penetration.as_ref().map_or([f64::NAN; 4], numbers);
    [row.ms, row.solver_ms, row.stretch, a, b, c, d]
}

fn row_of(&[ms, solver_ms, stretch, a, b, c, d]: &[f64; ROW]) -> FrameRow {
    let penetration = (!a.is_nan()).then(|| penetration_of([a, b, c, d]));
    FrameRow { ms, solver_ms, stretch, penetration, stages: Vec::new() }
}

/// Name of the array of the machine on which the frames were timed.
const MACHINE: &str = "machine";

/// Name of the array of the cache's checksum.
const CACHE: &str = "cache_checksum";

/// Name of the array of the hash of the other arrays' names. Checksums protect the arrays, but not
/// their names, and some arrays may be missing.
const NAMES: &str = "names";

/// Names of the arrays of the seconds for which strands have been still, of where, and of the
/// seconds for which their surroundings have been; all are missing if these are not still.
const SLEEP: [&str; 3] = ["still_secs", "sleep_place", "calm_secs"];

/// What the name of an array of a stage's times begins with.
const STAGE: &str = "stage_";

/// What the name of an array of a solver's channel begins with.
const CHANNEL: &str = "channel.";

/// What the name of an array begins with that a simulator keeps, but not for each particle.
const ARRAY: &str = "array.";

impl Snapshot {
    /// Before the first frame.
    pub(crate) fn begin(fingerprint: u64) -> Self {
        Self {
            fingerprint,
            frame: 0,
            quarantined_strands: 0,
            worst: [0.0; 3],
            penetration: Penetration::default(),
            rows: Vec::new(),
            machine: 0,
            cache_checksum: 0,
        }
    }

    /// Writes the snapshot and `state`, whole or not at all.
    ///
    /// # Errors
    /// [`forelock_io::WriteError`] if the disk refuses.
    pub(crate) fn write(&self, path: &Path, state: State<f32>) -> Result<(), forelock_io::WriteError> {
        let rows = &self.rows;
        let of_rows: Vec<f64> = rows.iter().flat_map(row_numbers).collect();
        let mut arrays = vec![
            (ROWS, Array { shape: vec![rows.len(), ROW], data: Data::F64(of_rows) }),
            ("counters", Array::vector(vec![self.fingerprint, self.frame.into(), self.quarantined_strands])),
            ("worst", Array::vector(self.worst.to_vec())),
            (PENETRATION, Array::vector(numbers(&self.penetration).to_vec())),
            (MACHINE, Array::vector(vec![self.machine])),
            (CACHE, Array::vector(vec![self.cache_checksum])),
        ];
        let mut stages: Vec<&str> = Vec::new();
        for (name, _) in rows.iter().flat_map(|row| &row.stages) {
            if !stages.contains(&&**name) {
                stages.push(name);
            }
        }
        let names: Vec<String> = stages.iter().map(|stage| format!("{STAGE}{stage}")).collect();
        for (stage, name) in stages.iter().zip(&names) {
            let ms =
                |row: &FrameRow| row.stages.iter().find(|(own, _)| own == stage).map_or(0.0, |(_, ms)| *ms);
            arrays.push((name, Array::vector(rows.iter().map(ms).collect::<Vec<f64>>())));
        }
        let particles = state.positions.len();
        let flat = |vectors: Vec<[f32; 3]>| Array {
            shape: vec![vectors.len(), 3],
            data: Data::F32(vectors.into_flattened()),
        };
        if !state.previous.is_empty() {
            arrays.push(("previous", flat(state.previous)));
        }
        if let Some(sleep) = state.sleep {
            arrays.push((SLEEP[0], Array::vector(sleep.still_secs)));
            arrays.push((SLEEP[1], Array::vector(sleep.place.to_vec())));
            arrays.push((SLEEP[2], Array::vector(vec![sleep.calm_secs])));
        }
        arrays.extend([
            ("positions", flat(state.positions)),
            ("velocities", flat(state.velocities)),
            ("integrity", Array::vector(state.integrity)),
            ("clearance", Array::vector(state.clearance)),
            ("origin", Array::vector(state.origin.to_vec())),
        ]);
        let extra = state.extra.into_iter().map(|(name, values)| {
            let rows = values.len() / particles.max(1);
            let (prefix, shape) = if rows * particles == values.len() {
                (CHANNEL, vec![particles, rows])
            } else {
                (ARRAY, vec![values.len()])
            };
            (format!("{prefix}{name}"), Array { shape, data: Data::F32(values) })
        });
        let extra: Vec<_> = extra.collect();
        arrays.extend(extra.iter().map(|(name, array)| (name.as_str(), array.clone())));
        let names = sum_of_names(arrays.iter().map(|&(name, _)| name));
        arrays.push((NAMES, Array::vector(vec![names])));
        write_npz(path, &arrays)
    }

    /// Reads the snapshot of the run with `fingerprint`, and its state.
    ///
    /// # Errors
    /// [`SnapshotError`] if there is none, or it is of another run.
    pub(crate) fn read(path: &Path, fingerprint: u64) -> Result<(Self, State<f32>), SnapshotError> {
        let arrays = read_npz(path)?;
        let (snapshot, state) = Self::from_arrays(&arrays).map_err(|name| SnapshotError::Content {
            path: path.to_path_buf(),
            problem: format!("the array `{name}` is missing or malformed"),
        })?;
        if snapshot.fingerprint != fingerprint {
            return Err(SnapshotError::Other(path.to_path_buf()));
        }
        Ok((snapshot, state))
    }

    /// The snapshot and the state in `arrays`, or the name of one that is missing or malformed.
    fn from_arrays(arrays: &BTreeMap<String, Array>) -> Result<(Self, State<f32>), Cow<'static, str>> {
        let data = |name: &'static str| arrays.get(name).map(|array| &array.data).ok_or(name);
        let floats = |name| match data(name)? {
            Data::F32(values) => Ok(values.clone()),
            _ => Err(name),
        };
        let doubles = |name| match data(name)? {
            Data::F64(values) => Ok(values.as_slice()),
            _ => Err(name),
        };
        let vectors = |name| {
            let (vectors, rest) = {
                let values = floats(name)?;
                (values.as_chunks::<3>().0.to_vec(), values.len() % 3)
            };
            if rest == 0 { Ok(vectors) } else { Err(name) }
        };
        let others = arrays.keys().map(String::as_str).filter(|&name| name != NAMES);
        if data(NAMES)? != &Data::U64(vec![sum_of_names(others)]) {
            return Err(NAMES.into());
        }
        let cache_checksum = match data(CACHE)? {
            Data::U32(values) => *values.first().ok_or(CACHE)?,
            _ => return Err(CACHE.into()),
        };
        let &[fingerprint, frame, quarantined_strands] = (match data("counters")? {
            Data::U64(values) => values.as_slice(),
            _ => return Err("counters".into()),
        }) else {
            return Err("counters".into());
        };
        let mut rows = Vec::new();
        if arrays.contains_key(ROWS) {
            let (whole, []) = doubles(ROWS)?.as_chunks::<ROW>() else { return Err(ROWS.into()) };
            rows = whole.iter().map(row_of).collect();
        }
        for (stage, array) in
            arrays.iter().filter_map(|(name, array)| Some((name.strip_prefix(STAGE)?, array)))
        {
            // A stage that took no time did not run.
            let Data::F64(times) = &array.data else { return Err(format!("{STAGE}{stage}").into()) };
            if times.len() != rows.len() {
                return Err(format!("{STAGE}{stage}").into());
            }
            let ran = rows.iter_mut().zip(times).filter(|(_, ms)| **ms > 0.0);
            ran.for_each(|(row, ms)| row.stages.push((stage.to_owned().into(), *ms)));
        }
        let machine = match arrays.get(MACHINE).map(|array| &array.data) {
            Some(Data::U64(values)) => values.first().copied().unwrap_or_default(),
            _ => 0,
        };
        let positions = vectors("positions")?;
        let mut extra = BTreeMap::new();
        for (name, array) in arrays {
            let Some(channel) = name.strip_prefix(CHANNEL) else { continue };
            match (&array.data, array.shape.as_slice()) {
                (Data::F32(values), [particles, _]) if *particles == positions.len() => {
                    extra.insert(channel.to_owned(), values.clone());
                }
                _ => return Err(name.clone().into()),
            }
        }
        for (name, array) in arrays {
            let Some(own) = name.strip_prefix(ARRAY) else { continue };
            let Data::F32(values) = &array.data else { return Err(name.clone().into()) };
            extra.insert(own.to_owned(), values.clone());
        }
        let sleep = if SLEEP.into_iter().any(|name| arrays.contains_key(name)) {
            let place = doubles(SLEEP[1])?.try_into().map_err(|_| SLEEP[1])?;
            let [calm_secs] = doubles(SLEEP[2])?.try_into().map_err(|_| SLEEP[2])?;
            Some(SleepSnapshot { still_secs: floats(SLEEP[0])?, place, calm_secs })
        } else {
            None
        };
        let snapshot = Self {
            fingerprint,
            machine,
            cache_checksum,
            rows,
            frame: u32::try_from(frame).map_err(|_| "counters")?,
            quarantined_strands,
            worst: doubles("worst")?.try_into().map_err(|_| "worst")?,
            penetration: penetration_of(doubles(PENETRATION)?.try_into().map_err(|_| PENETRATION)?),
        };
        let state = State {
            positions,
            velocities: vectors("velocities")?,
            integrity: floats("integrity")?,
            clearance: floats("clearance")?,
            previous: if arrays.contains_key("previous") { vectors("previous")? } else { Vec::new() },
            origin: doubles("origin")?.try_into().map_err(|_| "origin")?,
            extra,
            sleep,
        };
        Ok((snapshot, state))
    }
}

/// The hash of `names`, in any order.
fn sum_of_names<'a>(names: impl Iterator<Item = &'a str>) -> u64 {
    let mut names: Vec<&str> = names.collect();
    names.sort_unstable();
    Fnv::new().bytes(names.join("\n").as_bytes()).value()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A snapshot with every kind of array, and its state.
    fn example() -> (Snapshot, State<f32>) {
        let snapshot = Snapshot {
            fingerprint: u64::MAX,
            frame: 7,
            quarantined_strands: 2,
            worst: [1e-7, 0.1, 300.0],
            penetration: penetration_of([0.25, f64::MIN_POSITIVE, 0.5, 1e-3]),
            machine: 1 << 63,
            cache_checksum: u32::MAX,
            rows: vec![
                FrameRow {
                    ms: 1.5,
                    solver_ms: 1.0,
                    stretch: 1e-7,
                    penetration: None,
                    stages: vec![("solve_strands".into(), 1.0), ("write_cache".into(), 0.5)],
                },
                FrameRow {
                    ms: 2.5,
                    solver_ms: 2.25,
                    stretch: 1e-6,
                    penetration: Some(penetration_of([0.0, 0.1, 0.5, 0.2])),
                    stages: vec![("resolve_solids".into(), 2.0)],
                },
            ],
        };
        let state = State {
            positions: vec![[-0.0, f32::MIN_POSITIVE, 3.0]; 2],
            velocities: vec![[1.0, 2.0, 3.0]; 2],
            integrity: vec![0.5; 2],
            clearance: vec![f32::NEG_INFINITY; 2],
            previous: vec![[0.5, -0.0, 3.0]; 2],
            origin: [1.0, 2.0, 0.1],
            extra: [
                ("frame", vec![0.0, -0.0, f32::NEG_INFINITY, 1.0]),
                ("later", Vec::new()),
                ("history", vec![-0.0, 5.0, 7.0]),
            ]
            .map(|(name, values)| (name.to_owned(), values))
            .into(),
            sleep: Some(SleepSnapshot { still_secs: vec![f32::INFINITY], place: [0.5; 10], calm_secs: 7.5 }),
        };
        (snapshot, state)
    }

    #[test]
    fn comes_back_bit_for_bit_and_only_to_its_own_run() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("snapshot.npz");
        let (snapshot, state) = example();
        snapshot.write(&path, state.clone()).unwrap();
        assert_eq!(Snapshot::read(&path, u64::MAX).unwrap(), (snapshot, state));
        assert!(matches!(Snapshot::read(&path, 1), Err(SnapshotError::Other(_))));
        // A channel is [P, rows] of float32.
        for wrong in [
            Array { shape: vec![1, 4], data: Data::F32(vec![0.0; 4]) },
            Array::vector(vec![0.0f32; 4]),
            Array { shape: vec![2, 2], data: Data::F64(vec![0.0; 4]) },
        ] {
            let mut arrays = read_npz(&path).unwrap();
            arrays.insert("channel.frame".into(), wrong);
            let found = Snapshot::from_arrays(&arrays).unwrap_err();
            assert_eq!(found, "channel.frame");
        }
        std::fs::write(&path, b"no archive").unwrap();
        assert!(matches!(Snapshot::read(&path, 1), Err(SnapshotError::Read(_))));
    }

    #[test]
    fn a_flipped_bit_is_noticed_or_has_no_effect() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("snapshot.npz");
        let (snapshot, state) = example();
        snapshot.write(&path, state.clone()).unwrap();
        let whole = std::fs::read(&path).unwrap();
        let expected = (snapshot, state);
        let mut refused = 0;
        for byte in 0..whole.len() {
            let mut flipped = whole.clone();
            flipped[byte] ^= 1 << (byte % 8);
            let arrays = forelock_io::npz::read(std::io::Cursor::new(flipped));
            match arrays.ok().map(|arrays| Snapshot::from_arrays(&arrays)) {
                None | Some(Err(_)) => refused += 1,
                Some(Ok(read)) => assert_eq!(read, expected, "byte {byte}"),
            }
        }
        // Dates and other fields of the archive have no effect.
        assert!(refused > whole.len() / 2, "{refused} of {}", whole.len());
    }
}
