//! Bytes that are no files: an error, never a panic, and no memory for what is not there.

use std::io::Cursor;

use crate::common::grooms;
use forelock_core::groom::Groom;
use forelock_io::{alembic, ct2hair, hair, npz, obj, ply, tfx, usc};
use glam::Vec3;
use proptest::prelude::*;

type Reader = fn(&[u8]) -> Result<Groom, String>;

const READERS: [(&str, Reader); 8] = [
    ("hair", |b| hair::read(b).map_err(|e| e.to_string())),
    ("data", |b| usc::read(b).map_err(|e| e.to_string())),
    ("bin", |b| ct2hair::read(b).map_err(|e| e.to_string())),
    ("tfx", |b| tfx::read(b).map_err(|e| e.to_string())),
    ("npz", |b| npz::read_groom(Cursor::new(b)).map_err(|e| e.to_string())),
    ("abc", |b| alembic::read(Cursor::new(b)).map_err(|e| e.to_string())),
    ("ply", |b| ply::read(b).map_err(|e| e.to_string())),
    ("obj", |b| obj::read_groom(b).map_err(|e| e.to_string())),
];

/// A whole file of each format that is written.
fn files(groom: &Groom) -> Vec<(&'static str, Reader, Vec<u8>)> {
    let written = [
        hair::write(groom),
        usc::write(groom),
        Ok(Vec::new()),
        tfx::write(groom),
        Ok(npz::write_groom(groom)),
        alembic::write(groom),
        ply::write(groom),
    ];
    let files = READERS.into_iter().zip(written);
    files
        .filter_map(|((name, reader), bytes)| Some((name, reader, bytes.ok()?)))
        .filter(|f| !f.2.is_empty())
        .collect()
}

/// Places in a file and what is written there.
fn spots() -> impl Strategy<Value = Vec<(prop::sample::Index, u8)>> {
    prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8)
}

proptest! {
    #[test]
    fn random_bytes_never_panic(mut bytes in prop::collection::vec(any::<u8>(), 0..400), dress in 0usize..8) {
        let abc = b"Ogawa\xff\0\x01\x10\0\0\0\0\0\0\0\x06\0\0\0\0\0\0\0";
        let ply = b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n";
        let beginnings: [&[u8]; 8] =
            [b"", b"HAIR", &[0, 0, 128, 64], &[0, 0, 64, 64], b"PK\x03\x04", abc, b"v 1 2 3\nl ", ply];
        bytes.splice(..0, beginnings[dress].iter().copied());
        for (_, reader) in READERS {
            let _ = reader(&bytes);
        }
        let _ = obj::read_mesh(&bytes);
    }

    #[test]
    fn damaged_files_never_panic(groom in grooms(), spots in spots()) {
        for (_, reader, mut bytes) in files(&groom) {
            for (spot, value) in &spots {
                let at = spot.index(bytes.len());
                bytes[at] = *value;
            }
            let _ = reader(&bytes);
        }
    }

    #[test]
    fn random_npy_headers_never_panic(text in "[{}()<>'a-z0-9, :_]{0,80}", kind in 0usize..3) {
        let shapes = ["(3,)", "(99999999999999999999, 3)", "(4294967295, 4294967295, 3)"];
        let text = format!("{{'descr': '<f4', 'fortran_order': True, 'shape': {}, {text}}}", shapes[kind]);
        let mut file = npz::write_groom(&Groom::from_strands([[Vec3::ZERO, Vec3::Y]]).unwrap());
        let at = file.windows(6).position(|w| w == b"\x93NUMPY").unwrap() + 10;
        let take = text.len().min(118);
        file[at..at + take].copy_from_slice(&text.as_bytes()[..take]);
        prop_assert!(npz::read_groom(Cursor::new(file)).is_err());
    }
}

#[test]
fn every_truncation_is_an_error_that_says_where() {
    let line = |x: f32| (0..4).map(move |i| Vec3::new(x, i as f32, 0.0)).collect::<Vec<_>>();
    let mut groom = Groom::from_strands([line(0.0), line(1.0), line(2.0)]).unwrap();
    groom.widths = Some(vec![0.1; 12]);
    groom.colours = Some(vec![[0.5; 3]; 12]);
    let files = files(&groom);
    assert_eq!(files.len(), 6);
    for (name, reader, bytes) in files {
        assert!(reader(&bytes).is_ok());
        for length in 0..bytes.len() {
            let words =
                reader(&bytes[..length]).expect_err(&format!("{name} cut to {length} bytes was read"));
            assert!(words.contains("byte "), "{name}: {words}");
        }
    }
}

#[test]
fn counts_of_four_billion_are_refused_before_memory_is_taken() {
    let billions = u32::MAX.to_le_bytes();
    let signed = i32::MAX.to_le_bytes();
    let mut hair = hair::write(&Groom::from_strands([[Vec3::ZERO, Vec3::Y]]).unwrap()).unwrap();
    for (points, flags) in [(u32::MAX, 3u32), (u32::MAX, 2), (2, 3)] {
        hair[4..8].copy_from_slice(&billions);
        hair[8..12].copy_from_slice(&points.to_le_bytes());
        hair[12..16].copy_from_slice(&flags.to_le_bytes());
        hair[16..20].copy_from_slice(&[0; 4]);
        hair::read(&hair).unwrap_err();
    }
    for each in [0u32, 1, u32::MAX] {
        for (version, header) in [(4.0f32, 160), (3.0, 296)] {
            let mut tfx = version.to_le_bytes().to_vec();
            tfx.extend(billions);
            tfx.extend(each.to_le_bytes());
            tfx.resize(144, 0);
            tfx[12..16].copy_from_slice(&160u32.to_le_bytes());
            tfx.extend(296u32.to_le_bytes());
            tfx.resize(header + 64, 0);
            tfx::read(&tfx).unwrap_err();
        }
    }
    let one = 1u32.to_le_bytes();
    for bytes in [signed.to_vec(), billions.to_vec(), [one, signed].concat(), [one, billions].concat()] {
        let words = usc::read(&bytes).unwrap_err().to_string();
        assert!(words.contains("are left") || words.contains("below 0"), "{words}");
        ct2hair::read(&bytes).unwrap_err();
    }
}

#[test]
fn the_strand_and_the_byte_are_named() {
    let mut bytes = usc::write(&Groom::from_strands([[Vec3::ZERO, Vec3::Y]; 3]).unwrap()).unwrap();
    bytes[32..36].copy_from_slice(&(-7i32).to_le_bytes());
    let words = usc::read(&bytes).unwrap_err().to_string();
    assert_eq!(words, ".data file, byte 32, strand 1: the number of points is -7, below 0");
}

#[test]
fn obj_errors_name_the_line() {
    for (text, words) in [
        ("v 1 2\n", "line 1: a vertex needs three numbers"),
        ("v 0 0 0\nf 1 1 9\n", "line 2: it names vertex 9, but the file has 1"),
        ("v 0 0 0\nf 1 0 1\n", "line 2: `0` is no index"),
        ("v 0 0 0\nf 1 -2 1\n", "`-2` is no index"),
        ("v 0 0 0\nf 1 1\n", "at least three corners"),
        ("v 0 0 nan\nf 1 1 1\n", "vertex 0 is not finite"),
        ("v 0 0 0\n", "no triangles"),
        ("f 4294967296 1 1", "vertex 4294967296"),
        ("f 4294967297 1 1", "no index"),
    ] {
        let error = obj::read_mesh(text.as_bytes()).unwrap_err().to_string();
        assert!(error.contains(words), "{text:?}: {error}");
    }
    let error = obj::read_groom(b"v 0 0 0\nf 1 1 1\n").unwrap_err().to_string();
    assert!(error.contains("no polyline"), "{error}");
}
