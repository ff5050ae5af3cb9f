//! Alembic caches: frames, shared samples, and what is said when they cannot be written.

#![expect(clippy::unwrap_used, reason = "a helper of tests fails by panicking")]

use std::{fs, io::Cursor, path::Path};

use forelock_core::groom::{Groom, Import, Labels, Unit};
use forelock_io::{
    WriteError,
    alembic::{self, CurvesWriter, Reader},
    read_groom,
};
use glam::Vec3;

const FPS: f64 = 24.0;
const START: f64 = 1.25;

fn groom() -> Groom {
    let strand = |x: f32| (0..5).map(|i| Vec3::new(x, -0.1 * i as f32, 0.0)).collect::<Vec<_>>();
    let mut groom = Groom::from_strands((0..10).map(|s| strand(0.01 * s as f32))).unwrap();
    groom.widths = Some(vec![1e-4; 50]);
    groom.root_uvs = Some(vec![[0.25, 0.5]; 10]);
    groom
}

/// The positions of frame `frame`. From `still` on they stay.
fn frame_of(groom: &Groom, frame: usize, still: usize) -> Vec<Vec3> {
    let swing = 0.01 * frame.min(still) as f32;
    groom.positions().iter().map(|p| Vec3::new(p.x + swing * p.y, p.y, swing)).collect()
}

fn write(path: &Path, frames: usize, still: usize) {
    let groom = groom();
    let mut writer = CurvesWriter::create(path, &groom, START, FPS).unwrap();
    for frame in 0..frames {
        writer.write_frame(&frame_of(&groom, frame, still), Some(&vec![Vec3::X; 50])).unwrap();
    }
    assert_eq!(writer.frames(), frames);
    writer.finish().unwrap();
}

#[test]
fn every_frame_of_a_cache_reads_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.abc");
    // All samples differ; the last ones are equal; all are equal.
    for (frames, still) in [(7, 7), (7, 3), (7, 0), (1, 0)] {
        write(&path, frames, still);
        let mut reader = Reader::open(fs::File::open(&path).unwrap()).unwrap();
        assert_eq!(reader.frames() as usize, frames);
        assert_eq!(reader.names().collect::<Vec<_>>(), ["/hair"]);
        for frame in 0..frames {
            assert!((reader.time_secs(frame as u32) - START - frame as f64 / FPS).abs() < 1e-12);
            let contents = reader.read(frame as u32).unwrap();
            assert_eq!(contents.groom.positions(), frame_of(&groom(), frame, still), "{frame}");
            assert_eq!(contents.groom.strand_offsets(), groom().strand_offsets());
            assert_eq!(contents.groom.widths, groom().widths);
            assert_eq!(contents.groom.root_uvs, groom().root_uvs);
            assert_eq!(contents.velocities.unwrap(), [Vec3::X; 50]);
        }
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "a temporary file was left");
}

#[test]
fn samples_that_come_back_are_found() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.abc");
    let groom = groom();
    let mut writer = CurvesWriter::create(&path, &groom, START, FPS).unwrap();
    let pattern = [0, 0, 0, 1, 1, 2, 2, 2, 0, 3, 3];
    for frame in pattern {
        writer.write_frame(&frame_of(&groom, frame, 9), None).unwrap();
    }
    writer.finish().unwrap();
    let mut reader = Reader::open(fs::File::open(&path).unwrap()).unwrap();
    for (index, &frame) in pattern.iter().enumerate() {
        let contents = reader.read(index as u32).unwrap();
        assert_eq!(contents.groom.positions(), frame_of(&groom, frame, 9), "{index}");
        assert_eq!(contents.velocities, None);
    }
}

#[test]
fn constant_samples_are_shared() {
    let folder = tempfile::tempdir().unwrap();
    let size = |frames, still| {
        let path = folder.path().join("a.abc");
        write(&path, frames, still);
        fs::metadata(&path).unwrap().len()
    };
    assert_eq!(size(100, 0), size(2, 0));
    // Points and bounds: checksums, sizes and references.
    let frame = (50 * 12 + 16 + 8 + 16) + (48 + 16 + 8 + 8);
    assert_eq!(size(100, 100) - size(99, 99), frame);
}

#[test]
fn a_writer_that_is_dropped_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.abc");
    fs::write(&path, "old").unwrap();
    let mut writer = CurvesWriter::create(&path, &groom(), START, FPS).unwrap();
    let second = CurvesWriter::create(&path, &groom(), START, FPS);
    assert!(matches!(second, Err(WriteError::Locked { .. })));
    writer.write_frame(groom().positions(), None).unwrap();
    drop(writer);
    assert_eq!(fs::read(&path).unwrap(), b"old");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
}

/// What is left of a process that was killed.
#[test]
fn a_file_that_was_not_completed_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.abc");
    write(&path, 3, 3);
    let mut bytes = fs::read(&path).unwrap();
    bytes[5] = 0;
    let words = alembic::read(Cursor::new(bytes)).unwrap_err().to_string();
    assert_eq!(words, ".abc file, byte 5: the file was not completed; export it again");
}

#[test]
fn what_cannot_be_written_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.abc");
    let create = |groom: &Groom, start: f64, fps: f64| CurvesWriter::create(&path, groom, start, fps);
    let refused = |result: Result<CurvesWriter, WriteError>| result.err().unwrap().to_string();
    for fps in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(refused(create(&groom(), START, fps)).contains("must be above 0"));
    }
    assert!(refused(create(&Groom::default(), START, FPS)).contains("no points"));
    assert!(refused(create(&groom(), f64::NAN, FPS)).contains("must be finite"));
    let short = Labels { ids: Some(vec![1]), ..Labels::default() };
    let mut labelled = groom();
    labelled.labels = short;
    assert!(refused(create(&labelled, START, FPS)).contains("`ids` has 1 entries, but 10 were expected"));
    let mut writer = create(&groom(), START, FPS).unwrap();
    let words = writer.write_frame(&[Vec3::ZERO], None).unwrap_err().to_string();
    assert!(words.contains("the frame has 1 positions, but the cache has 50"), "{words}");
    let words = writer.write_frame(groom().positions(), Some(&[Vec3::ZERO; 50])).unwrap_err().to_string();
    assert!(words.contains("some frames have velocities"), "{words}");
    let words = writer.finish().unwrap_err().to_string();
    assert!(words.contains("at least one frame"), "{words}");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn the_unit_of_the_file_holds_where_the_user_names_none() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.abc");
    let bytes = alembic::write(&groom()).unwrap();
    let check = |bytes: &[u8], import: &Import, metres: f32| {
        fs::write(&path, bytes).unwrap();
        let tip = read_groom(&path, import).unwrap().groom.positions()[4].y;
        assert!((tip / -0.4 - metres).abs() < 1e-6 * metres, "{tip}");
    };
    let millimetres = Import { unit: Unit::Millimetre, ..Import::default() };
    check(&bytes, &Import::default(), 1.0);
    check(&bytes, &millimetres, 1e-3);
    // Without the note of the unit, the version of Unreal's schema decides.
    let at = bytes.windows(13).position(|window| window == b"forelock_unit").unwrap();
    let mut unnoted = bytes.clone();
    unnoted[at] = b'F';
    check(&unnoted, &Import::default(), 1e-2);
    check(&unnoted, &millimetres, 1e-3);
}
