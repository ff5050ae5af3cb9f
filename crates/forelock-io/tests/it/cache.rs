//! The streamed cache: complete whenever it is finished, the same bytes however it was interrupted.

#![expect(clippy::unwrap_used, reason = "a helper of tests fails by panicking")]

use std::{fs, io::Cursor, path::Path};

use forelock_core::groom::Import;
use forelock_io::{Array, Cache, CacheWriter, Data, Stored, WriteError, npz, read_groom};
use glam::Vec3;

const OFFSETS: [u32; 3] = [0, 2, 5];

fn frame(f: usize) -> Vec<Vec3> {
    (0..5).map(|p| Vec3::new(f as f32, p as f32, 0.5)).collect()
}

fn append(writer: &mut CacheWriter, frames: std::ops::Range<usize>) {
    for f in frames {
        writer.append(f as f64 / 60.0, &frame(f)).unwrap();
    }
}

fn constants() -> [(&'static str, Array); 1] {
    [("fps", Array::vector(vec![60.0f64]))]
}

fn create(path: &Path) -> CacheWriter {
    CacheWriter::create(path, &OFFSETS, &constants()).unwrap()
}

/// The first `frames` frames, as a run remembers them.
fn stored(frames: usize) -> Stored {
    let bytes: Vec<u8> = (0..frames).flat_map(|f| bytemuck::cast_slice(&frame(f)).to_vec()).collect();
    Stored { times_secs: (0..frames).map(|f| f as f64 / 60.0).collect(), checksum: crc32fast::hash(&bytes) }
}

fn resume(path: &Path, frames: usize) -> Result<CacheWriter, WriteError> {
    CacheWriter::resume(path, &OFFSETS, &constants(), &stored(frames))
}

fn write(path: &Path, frames: usize) -> Vec<u8> {
    let mut writer = create(path);
    append(&mut writer, 0..frames);
    assert_eq!(writer.finish().unwrap(), stored(frames).checksum);
    fs::read(path).unwrap()
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn any_number_of_frames_reads_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("hair.npz");
    for frames in [0, 1, 7] {
        let bytes = write(&path, frames);
        let arrays = npz::read(Cursor::new(bytes)).unwrap();
        assert_eq!(arrays["positions"].shape, [frames, 5, 3]);
        assert_eq!(arrays["strand_offsets"].data, Data::U32(OFFSETS.to_vec()));
        assert_eq!(arrays["times"].data, Data::F64((0..frames).map(|f| f as f64 / 60.0).collect()));
        let mut cache = Cache::open(&path).unwrap();
        assert_eq!((cache.frames(), cache.particles(), cache.strand_offsets()), (frames, 5, &OFFSETS[..]));
        assert_eq!(cache.array("fps").unwrap(), Some(Array::vector(vec![60.0f64])));
        let mut positions = Vec::new();
        for f in (0..frames).rev() {
            cache.read_frame(f, &mut positions).unwrap();
            assert_eq!(positions, frame(f));
            assert_eq!(cache.times_secs().unwrap()[f], f as f64 / 60.0);
        }
        assert!(
            cache.read_frame(frames, &mut positions).unwrap_err().to_string().contains("there is no frame")
        );
    }
    assert_eq!(names(folder.path()), ["hair.npz"]);
    let first = read_groom(&path, &Import::default()).unwrap().groom;
    assert_eq!((first.positions(), first.strand_offsets()), (frame(0).as_slice(), &OFFSETS[..]));
}

#[test]
fn resuming_gives_the_bytes_of_an_uninterrupted_run() {
    let folder = tempfile::tempdir().unwrap();
    let whole = write(&folder.path().join("whole.npz"), 9);
    for (stopped, kept) in [(4, 4), (6, 3), (9, 9), (5, 0)] {
        let path = folder.path().join("resumed.npz");
        write(&path, stopped);
        let mut writer = resume(&path, kept).unwrap();
        assert_eq!(writer.frames(), kept);
        append(&mut writer, kept..9);
        writer.finish().unwrap();
        assert!(fs::read(&path).unwrap() == whole, "stopped after {stopped}, resumed at {kept}");
    }
    assert_eq!(names(folder.path()), ["resumed.npz", "whole.npz"]);
}

/// Whatever is killed, and when: the file can be read, and resumed.
#[test]
fn the_cache_is_complete_while_it_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let (path, copy) = (folder.path().join("hair.npz"), folder.path().join("copy.npz"));
    let frames = 4_000;
    let whole = write(&folder.path().join("whole.npz"), frames);
    let mut writer = create(&path);
    let mut checked = 0;
    for f in 0..frames {
        append(&mut writer, f..f + 1);
        if f % 250 != 7 {
            continue;
        }
        // At first under a temporary name, and from the first checkpoint on under its own.
        let asked = f % 500 == 7;
        if asked {
            assert_eq!(writer.checkpoint().unwrap(), stored(f + 1).checksum);
        }
        fs::copy(&path, &copy).unwrap();
        let mut cache = Cache::open(&copy).unwrap();
        let found = cache.frames();
        assert!(found <= f + 1 && (!asked || found == f + 1), "{found} of {}", f + 1);
        assert_eq!(cache.times_secs().unwrap(), stored(found).times_secs);
        let mut positions = Vec::new();
        cache.read_frame(found - 1, &mut positions).unwrap();
        assert_eq!(positions, frame(found - 1));
        // Its members' checksums are right as well.
        assert_eq!(npz::read(fs::File::open(&copy).unwrap()).unwrap()["positions"].shape, [found, 5, 3]);
        let mut resumed = resume(&copy, found).unwrap();
        append(&mut resumed, found..frames);
        resumed.finish().unwrap();
        assert!(fs::read(&copy).unwrap() == whole, "resumed after {found}");
        checked += 1;
    }
    writer.finish().unwrap();
    assert!(fs::read(&path).unwrap() == whole);
    assert_eq!(checked, 16);
    assert_eq!(names(folder.path()), ["copy.npz", "hair.npz", "whole.npz"]);
}

#[test]
fn an_older_cache_stays_until_the_first_checkpoint() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npz");
    let old = write(&path, 3);
    let mut writer = create(&path);
    append(&mut writer, 0..2);
    assert!(fs::read(&path).unwrap() == old);
    // A second writer is refused as long as the first one lives.
    for second in [CacheWriter::create(&path, &OFFSETS, &constants()), resume(&path, 2)] {
        let message = second.map(drop).unwrap_err().to_string();
        assert!(message.contains("a.npz: another run writes here (process "), "{message}");
    }
    writer.checkpoint().unwrap();
    assert_eq!(Cache::open(&path).unwrap().frames(), 2);
    drop(writer);
    // Of a writer that was killed before its first checkpoint, the next one leaves nothing.
    fs::write(folder.path().join("a.npz.part"), &old).unwrap();
    resume(&path, 2).unwrap().finish().unwrap();
    assert_eq!(names(folder.path()), ["a.npz"]);
}

#[test]
fn what_cannot_be_resumed_is_refused_and_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npz");
    let message = |frames| resume(&path, frames).map(drop).unwrap_err().to_string();
    assert!(message(1).contains("there is none under this name"));
    let whole = write(&path, 3);
    let shorter = message(80);
    assert!(shorter.contains("shorter than the 80 frames wanted"), "{shorter}");
    for length in [0, 10, 200, 500] {
        fs::write(&path, &whole[..length]).unwrap();
        let said = message(3);
        assert!(said.contains("cannot go on with this cache"), "{length}: {said}");
        assert_eq!(fs::read(&path).unwrap(), whole[..length]);
    }
    fs::write(&path, npz::write(&[("positions", Array::vector(vec![1.0f32; 2000]))])).unwrap();
    assert!(message(1).contains("was not written by Forelock for these strands"));
    assert_eq!(names(folder.path()), ["a.npz"]);
}

/// A flipped bit anywhere is noticed, or of no consequence.
#[test]
fn a_damaged_cache_is_not_continued() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npz");
    let whole = write(&path, 3);
    let mut refused = 0;
    for byte in 0..whole.len() {
        let mut flipped = whole.clone();
        flipped[byte] ^= 1 << (byte % 8);
        fs::write(&path, &flipped).unwrap();
        match resume(&path, 3) {
            Err(_) => refused += 1,
            Ok(writer) => {
                writer.finish().unwrap();
                assert!(fs::read(&path).unwrap() == whole, "byte {byte}");
            }
        }
    }
    // All of offsets and frames.
    assert!(refused > 4 * OFFSETS.len() + 3 * 5 * 12, "{refused}");
}

#[test]
fn a_writer_that_is_dropped_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    for frames in [0, 3] {
        append(&mut create(&folder.path().join("a.npz")), 0..frames);
    }
    assert!(CacheWriter::create(&folder.path().join("a.npz"), &[0], &[]).is_err());
    assert!(CacheWriter::create(folder.path(), &OFFSETS, &[]).is_err());
    let missing =
        CacheWriter::create(&folder.path().join("no/a.npz"), &OFFSETS, &[]).map(|_| ()).unwrap_err();
    assert!(missing.to_string().contains("no such file or folder"), "{missing}");
    assert_eq!(names(folder.path()), Vec::<String>::new());
}

#[test]
fn a_frame_of_the_wrong_size_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npz");
    let mut writer = create(&path);
    append(&mut writer, 0..1);
    assert!(writer.append(0.0, &frame(1)[1..]).is_err());
    append(&mut writer, 1..2);
    writer.finish().unwrap();
    assert_eq!(Cache::open(&path).unwrap().frames(), 2);
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_said_and_nothing_stands_under_the_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npz");
    std::os::unix::fs::symlink("/dev/full", folder.path().join("a.npz.part")).unwrap();
    let error = CacheWriter::create(&path, &OFFSETS, &[]).map(|_| ()).unwrap_err().to_string();
    assert!(error.contains("the disk is full"), "{error}");
    assert_eq!(names(folder.path()), Vec::<String>::new());
}

#[test]
fn caches_that_do_not_fit_together_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npz");
    let positions = |shape: &[usize]| Array::new(shape, vec![0.0f32; 12]).unwrap();
    let offsets = |last: u32| Array::vector(vec![0, last]);
    for (arrays, words) in [
        (vec![("strand_offsets", offsets(2))], "no array `positions`"),
        (vec![("positions", positions(&[4, 3])), ("strand_offsets", offsets(4))], "is it a groom?"),
        (vec![("positions", positions(&[2, 2, 3]))], "`strand_offsets` is missing"),
        (vec![("positions", positions(&[2, 2, 3])), ("strand_offsets", offsets(3))], "does not grow"),
        (
            vec![
                ("positions", positions(&[2, 2, 3])),
                ("strand_offsets", offsets(2)),
                ("times", Array::vector(vec![0.0f64])),
            ],
            "`times` must be",
        ),
    ] {
        forelock_io::write_npz(&path, &arrays).unwrap();
        let message = Cache::open(&path).map(|_| ()).unwrap_err().to_string();
        assert!(message.contains(words) && message.contains("a.npz"), "{message}");
    }
}
