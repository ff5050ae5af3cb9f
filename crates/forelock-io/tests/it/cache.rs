//! The streamed cache: complete whenever it is finished, the same bytes however it was interrupted.

#![expect(clippy::unwrap_used, reason = "a helper of tests fails by panicking")]

use std::{fs, io::Cursor, path::Path};

use forelock_core::groom::Import;
use forelock_io::{Array, Cache, CacheWriter, Data, npz, read_groom};
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

fn create(path: &Path) -> CacheWriter {
    CacheWriter::create(path, &OFFSETS, &[("fps", Array::vector(vec![60.0f64]))]).unwrap()
}

fn write(path: &Path, frames: usize) -> Vec<u8> {
    let mut writer = create(path);
    append(&mut writer, 0..frames);
    assert_eq!(writer.finish().unwrap(), frames);
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
        let mut writer = CacheWriter::resume(&path, kept).unwrap();
        assert_eq!(writer.frames(), kept);
        append(&mut writer, kept..9);
        writer.finish().unwrap();
        assert!(fs::read(&path).unwrap() == whole, "stopped after {stopped}, resumed at {kept}");
    }
    assert_eq!(names(folder.path()), ["resumed.npz", "whole.npz"]);
}

#[test]
fn a_killed_run_is_resumed_from_its_whole_frames() {
    let folder = tempfile::tempdir().unwrap();
    let whole = write(&folder.path().join("whole.npz"), 9);
    let path = folder.path().join("killed.npz");
    for torn_bytes in [0, 31] {
        let mut writer = create(&path);
        append(&mut writer, 0..6);
        drop(writer);
        let part = folder.path().join("killed.npz.part");
        let mut bytes = fs::read(&part).unwrap();
        bytes.extend(vec![7; torn_bytes]);
        fs::write(&part, bytes).unwrap();
        assert!(!path.exists(), "a broken file under the final name");
        let message = CacheWriter::resume(&path, 7).map(|_| ()).unwrap_err().to_string();
        assert!(message.contains("it holds 6 frames and the first 7 are wanted"), "{message}");
        let mut writer = CacheWriter::resume(&path, 5).unwrap();
        append(&mut writer, 5..9);
        writer.finish().unwrap();
        assert!(fs::read(&path).unwrap() == whole);
        fs::remove_file(&path).unwrap();
    }
}

#[test]
fn what_cannot_be_resumed_is_refused_and_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npz");
    let message = |path| CacheWriter::resume(path, 1).map(|_| ()).unwrap_err().to_string();
    assert!(message(&path).contains("there is none under this name"));
    let whole = write(&path, 3);
    for length in [0, 10, 200, 500, whole.len() / 2] {
        fs::write(&path, &whole[..length]).unwrap();
        let said = message(&path);
        assert!(said.contains("cannot go on with this cache"), "{length}: {said}");
        assert_eq!(fs::read(&path).unwrap(), whole[..length]);
    }
    fs::write(&path, npz::write(&[("positions", Array::vector(vec![1.0f32]))])).unwrap();
    assert!(message(&path).contains("was not written by Forelock"));
    assert_eq!(names(folder.path()), ["a.npz"]);
}

#[test]
fn a_writer_without_a_frame_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    drop(create(&folder.path().join("a.npz")));
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
