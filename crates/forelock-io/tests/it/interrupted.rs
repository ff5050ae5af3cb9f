//! Caches whose writer is killed, and files that are cut off: frames that are read are right, the
//! rest is refused with a reason.

#![expect(clippy::unwrap_used, reason = "a helper of tests fails by panicking")]

use std::fs;
use std::path::Path;

use forelock_core::groom::{Groom, Import};
use forelock_io::animation::{AnimationReader, AnimationWriter};
use glam::Vec3;

const FPS: f64 = 50.0;

/// Strands with `particles` particles in all, ten each.
fn groom(particles: usize) -> Groom {
    let positions: Vec<Vec3> = (0..particles).map(|i| Vec3::new(i as f32, 0.0, 1.0)).collect();
    Groom::from_strands(positions.chunks(10)).unwrap()
}

/// Frame `frame` of the moving strands.
fn at(frame: usize, particles: usize) -> Vec<Vec3> {
    (0..particles).map(|i| Vec3::new(i as f32, frame as f32, 1.0)).collect()
}

fn times(frames: usize) -> Vec<f64> {
    (0..frames).map(|frame| frame as f64 / FPS).collect()
}

/// The frames of the file at `path` that can be read, and why no more. Each must be the right one.
fn readable(path: &Path, particles: usize) -> (usize, Option<String>) {
    let mut reader = match AnimationReader::open(path, &Import::default()) {
        Ok(reader) => reader,
        Err(error) => return (0, Some(error.to_string())),
    };
    let mut positions = Vec::new();
    for frame in 0..reader.times_secs().len() {
        if let Err(error) = reader.read(frame, &mut positions) {
            return (frame, Some(error.to_string()));
        }
        assert!(positions == at(frame, particles), "{}: frame {frame} is wrong", path.display());
        assert!((reader.times_secs()[frame] - frame as f64 / FPS).abs() < 1e-9);
    }
    (reader.times_secs().len(), None)
}

#[test]
fn a_cache_that_is_cut_off_is_read_up_to_there_or_refused() {
    let folder = tempfile::tempdir().unwrap();
    let frames = 9;
    for ending in ["npz", "abc", "usdc", "usd"] {
        let path = folder.path().join(format!("whole.{ending}"));
        let mut writer = AnimationWriter::create(&path, &groom(20), &times(frames), false).unwrap();
        (0..frames).for_each(|frame| writer.write(&at(frame, 20)).unwrap());
        writer.finish().unwrap();
        assert_eq!(readable(&path, 20), (frames, None));
        let whole = fs::read(&path).unwrap();
        let cut = folder.path().join(format!("cut.{ending}"));
        // From where a format can be told.
        for length in (16..whole.len()).step_by(7).chain([whole.len() - 1]) {
            fs::write(&cut, &whole[..length]).unwrap();
            let (_, reason) = readable(&cut, 20);
            let reason = reason.unwrap_or_else(|| panic!("{ending} cut to {length} bytes is whole"));
            assert!(reason.contains("cut.") && !reason.contains('\n'), "{reason}");
            let is_clear = ["cut short", "cut off", "was not completed", "copied", "bytes"];
            assert!(is_clear.iter().any(|words| reason.contains(words)), "{ending}, {length}: {reason}");
        }
    }
}

/// Writers that are killed. A child process runs the test [`writer`](kill::writer), which writes
/// what the environment says until it dies.
#[cfg(unix)]
mod kill {
    use std::path::PathBuf;
    use std::process::{Child, Command, Stdio};
    use std::time::{Duration, Instant};

    use forelock_io::{
        Cache, CacheWriter, UsdCacheWriter, read_character, read_groom, remove_leftovers, write_groom,
    };

    use super::*;

    const PARTICLES: usize = 500;
    /// The most frames: a writer that no one kills ends.
    const FRAMES: usize = 20_000;
    const CHECKPOINT_FRAMES: usize = 25;
    const VARIABLE: &str = "FORELOCK_TEST_WRITES";

    /// Writes the file that the environment names, with checkpoints if it says so.
    #[test]
    #[ignore = "runs in a process that another test kills"]
    fn writer() {
        let Ok(task) = std::env::var(VARIABLE) else { return };
        let (kind, path) = task.split_once(' ').unwrap();
        let path = Path::new(path);
        let groom = groom(PARTICLES);
        let pause = || std::thread::sleep(Duration::from_micros(200));
        match kind {
            "checkpoints" if path.extension().unwrap() == "npz" => {
                let mut writer = CacheWriter::create(path, groom.strand_offsets(), &[]).unwrap();
                for frame in 0..FRAMES {
                    writer.append(frame as f64 / FPS, &at(frame, PARTICLES)).unwrap();
                    if frame % CHECKPOINT_FRAMES == 0 {
                        writer.checkpoint().unwrap();
                    }
                    pause();
                }
            }
            "checkpoints" => {
                let mut writer = UsdCacheWriter::create(path, &groom, FPS).unwrap();
                for frame in 0..FRAMES {
                    writer.append(frame as f64 / FPS, &at(frame, PARTICLES), None).unwrap();
                    if frame % CHECKPOINT_FRAMES == 0 {
                        writer.checkpoint().unwrap();
                    }
                    pause();
                }
            }
            "frames" => {
                // The limit of `.glb` allows fewer.
                let frames = FRAMES / 4;
                let mut writer = AnimationWriter::create(path, &groom, &times(frames), false).unwrap();
                for frame in 0..frames {
                    writer.write(&at(frame, PARTICLES)).unwrap();
                    pause();
                }
            }
            _ => {
                let mut moved = groom;
                for turn in 0..FRAMES {
                    moved.positions_mut().copy_from_slice(&at(turn, PARTICLES));
                    write_groom(path, &moved).unwrap();
                }
            }
        }
    }

    /// Starts a writer of `path`.
    fn start(kind: &str, path: &Path) -> Child {
        Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "interrupted::kill::writer", "--ignored"])
            .env(VARIABLE, format!("{kind} {}", path.display()))
            .stdout(Stdio::null())
            .spawn()
            .unwrap()
    }

    /// Waits until `is_ready`, and kills the writer.
    fn kill(mut writer: Child, is_ready: impl Fn() -> bool) {
        let begin = Instant::now();
        while !is_ready() {
            assert!(begin.elapsed() < Duration::from_secs(60), "the writer does not come that far");
            assert!(writer.try_wait().unwrap().is_none(), "the writer ended by itself");
            std::thread::sleep(Duration::from_micros(300));
        }
        // SIGKILL.
        writer.kill().unwrap();
        let status = writer.wait().unwrap();
        assert_eq!(std::os::unix::process::ExitStatusExt::signal(&status), Some(9));
    }

    fn size(path: &Path) -> usize {
        fs::metadata(path).map_or(0, |own| own.len() as usize)
    }

    fn part(path: &Path) -> PathBuf {
        path.with_extension(format!("{}.part", path.extension().unwrap().display()))
    }

    /// Bytes of `frames` frames.
    fn bytes(frames: usize) -> usize {
        frames * PARTICLES * 12
    }

    #[test]
    fn a_cache_with_checkpoints_is_read_up_to_the_last_one() {
        for ending in ["npz", "usdc"] {
            let mut whole = 0;
            for frames in [30, 71, 160] {
                let folder = tempfile::tempdir().unwrap();
                let path = folder.path().join(format!("hair.{ending}"));
                kill(start("checkpoints", &path), || size(&path) > bytes(frames));
                assert!(!part(&path).exists());
                let (found, reason) = readable(&path, PARTICLES);
                // An `.npz` may be killed within the two writes of a checkpoint: that is told.
                let torn = reason.is_some();
                assert!(!torn || ending == "npz", "{reason:?}");
                assert!(torn || found > 0, "{found} frames of {frames}");
                whole += usize::from(!torn);
                // The lock of the killed process is none.
                let mut again = AnimationWriter::create(&path, &groom(PARTICLES), &times(1), false).unwrap();
                again.write(&at(0, PARTICLES)).unwrap();
                again.finish().unwrap();
                assert_eq!(readable(&path, PARTICLES), (1, None));
            }
            assert!(whole > 0, "{ending}");
        }
    }

    #[test]
    fn an_export_that_is_killed_leaves_nothing_under_its_name() {
        for ending in ["npz", "abc", "usdc", "glb"] {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join(format!("hair.{ending}"));
            fs::write(&path, "older").unwrap();
            // Beyond the weights that a `.glb` begins with.
            let weights = if ending == "glb" { 4 * (FRAMES / 4).pow(2) } else { 0 };
            let left = part(&path);
            kill(start("frames", &path), || size(&left) > bytes(70) + weights);
            assert_eq!(fs::read(&path).unwrap(), b"older", "{ending}");
            // What is left is read up to the last list of its frames, or refused.
            let found = folder.path().join(format!("found.{ending}"));
            fs::copy(&left, &found).unwrap();
            let (frames, reason) = match ending {
                "glb" => (0, read_character(&found, &Import::default()).err().map(|error| error.to_string())),
                _ => readable(&found, PARTICLES),
            };
            match ending {
                "abc" => assert!(reason.unwrap().contains("was not completed")),
                "glb" => assert!(reason.unwrap().contains("found.glb")),
                "usdc" => assert!(frames >= 16 && reason.is_none(), "{frames} frames, {reason:?}"),
                _ => assert!(frames > 0 || reason.is_some(), "{ending}: {reason:?}"),
            }
            let mut again = AnimationWriter::create(&path, &groom(PARTICLES), &times(2), false).unwrap();
            (0..2).for_each(|frame| again.write(&at(frame, PARTICLES)).unwrap());
            again.finish().unwrap();
            assert!(!left.exists(), "{ending}");
            assert!(size(&path) > bytes(2) && size(&path) < bytes(40), "{ending}");
        }
    }

    #[test]
    fn a_groom_is_the_older_or_the_newer_one() {
        for ending in ["usda", "usdc", "abc", "npz"] {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join(format!("hair.{ending}"));
            let begin = Instant::now();
            kill(start("grooms", &path), || size(&path) > 0 && begin.elapsed().as_millis() > 40);
            let found = read_groom(&path, &Import::default()).unwrap().groom;
            let turn = found.positions()[0].y;
            assert!(found.positions() == at(turn as usize, PARTICLES), "{ending}, turn {turn}");
            remove_leftovers(folder.path());
            assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "{ending}");
        }
    }

    /// The frames of a killed cache are resumed by what the run remembers of them.
    #[test]
    fn a_killed_cache_is_resumed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("hair.npz");
        kill(start("checkpoints", &path), || size(&path) > bytes(90));
        // The checkpoint before the last frames.
        let kept = 2 * CHECKPOINT_FRAMES + 1;
        let frames: Vec<Vec<Vec3>> = (0..kept).map(|frame| at(frame, PARTICLES)).collect();
        let mut checksum = crc32fast::Hasher::new();
        frames.iter().for_each(|frame| checksum.update(bytemuck::cast_slice(frame)));
        let stored = forelock_io::Stored { times_secs: times(kept), checksum: checksum.finalize() };
        let mut writer = CacheWriter::resume(&path, groom(PARTICLES).strand_offsets(), &[], &stored).unwrap();
        writer.append(kept as f64 / FPS, &at(kept, PARTICLES)).unwrap();
        writer.finish().unwrap();
        assert_eq!(Cache::open(&path).unwrap().frames(), kept + 1);
        assert_eq!(readable(&path, PARTICLES), (kept + 1, None));
    }
}
