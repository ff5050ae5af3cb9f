//! What a writer wrote, its reader reads back exactly; headers of every kind are understood.

#![expect(clippy::unwrap_used, reason = "a helper of tests fails by panicking")]

use std::io::Cursor;

use crate::common::grooms;
use forelock_core::{
    body::TriMesh,
    groom::{Groom, Import},
};
use forelock_io::{
    Array, Data, alembic,
    animation::{AnimationReader, AnimationWriter},
    ct2hair, hair, npz, obj, ply, read_groom, tfx, usc, write_groom,
};
use glam::Vec3;
use proptest::prelude::*;

/// The same strands without attributes.
fn bare(groom: &Groom) -> Groom {
    Groom::new(groom.positions().to_vec(), groom.strand_offsets().to_vec()).unwrap()
}

/// The strands of `groom` with those attributes that `keep` copies, from the first to the second.
fn only(groom: &Groom, keep: impl Fn(&Groom, &mut Groom)) -> Groom {
    let mut kept = bare(groom);
    keep(groom, &mut kept);
    kept
}

// A test for each row of the table in docs/files.md, with what the row says is lost.
proptest! {
    #[test]
    fn hair(groom in grooms()) {
        let kept = only(&groom, |from, to| {
            to.widths.clone_from(&from.widths);
            to.colours.clone_from(&from.colours);
            to.transparencies.clone_from(&from.transparencies);
        });
        prop_assert_eq!(hair::read(&hair::write(&groom).unwrap()).unwrap(), kept);
    }

    #[test]
    fn data(groom in grooms()) {
        prop_assert_eq!(usc::read(&usc::write(&groom).unwrap()).unwrap(), bare(&groom));
    }

    #[test]
    fn npz(groom in grooms()) {
        prop_assert_eq!(npz::read_groom(Cursor::new(npz::write_groom(&groom))).unwrap(), groom);
    }

    #[test]
    fn abc(groom in grooms()) {
        let bytes = alembic::write(&groom).unwrap();
        let back = alembic::Reader::open(Cursor::new(bytes)).unwrap().read(0).unwrap();
        let kept = only(&groom, |from, to| {
            to.widths.clone_from(&from.widths);
            to.colours.clone_from(&from.colours);
            to.root_uvs.clone_from(&from.root_uvs);
            to.labels.clone_from(&from.labels);
        });
        prop_assert_eq!(back, alembic::Contents { groom: kept, velocities: None });
    }

    #[test]
    fn obj_polylines(groom in grooms()) {
        prop_assert_eq!(obj::read_groom(&obj::write_groom(&groom)).unwrap(), bare(&groom));
    }

    #[test]
    fn ply(groom in grooms()) {
        prop_assert_eq!(ply::read(&ply::write(&groom).unwrap()).unwrap(), bare(&groom));
    }

    #[test]
    fn tfx(groom in grooms()) {
        let each = groom.range(0).len();
        let equal = (0..groom.strand_count()).all(|s| groom.range(s).len() == each);
        let written = tfx::write(&groom);
        prop_assert_eq!(written.is_ok(), equal);
        let Ok(bytes) = written else { return Ok(()) };
        let mut back = tfx::read(&bytes).unwrap();
        let (found, wanted) = (back.widths.take(), groom.widths.clone());
        prop_assert_eq!(found.is_some(), wanted.is_some());
        let strands = wanted.iter().flat_map(|widths| widths.chunks_exact(each));
        for (found, wanted) in found.iter().flat_map(|widths| widths.chunks_exact(each)).zip(strands) {
            let mean = wanted.iter().sum::<f32>() / each as f32;
            prop_assert!(found.iter().all(|width| (width - mean).abs() < 1e-3));
        }
        let kept = only(&groom, |from, to| {
            to.colours.clone_from(&from.colours);
            to.root_uvs.clone_from(&from.root_uvs);
            // The root of a strand is pinned where the groom does not say.
            to.pinned = Some(from.pinned.clone().unwrap_or_else(|| vec![1; from.strand_count()]));
        });
        prop_assert_eq!(back, kept);
    }

    /// All frames of the formats that hold them, with the attributes that these formats keep of a
    /// groom.
    #[test]
    fn moving_strands(groom in grooms(), start in -10.0f64..10.0, frames in 1usize..5) {
        let times: Vec<f64> = (0..frames).map(|frame| start + frame as f64 / 24.0).collect();
        let moved = |frame: usize| -> Vec<Vec3> {
            groom.positions().iter().map(|p| *p + Vec3::X * frame as f32).collect()
        };
        let folder = tempfile::tempdir().unwrap();
        for name in ["a.npz", "a.abc", "a.usdc", "a.USD"] {
            let path = folder.path().join(name);
            let mut writer = AnimationWriter::create(&path, &groom, &times, false).unwrap();
            (0..frames).for_each(|frame| writer.write(&moved(frame)).unwrap());
            writer.finish().unwrap();
            let mut reader = AnimationReader::open(&path, &Import::default()).unwrap();
            let mut positions = Vec::new();
            for (frame, time) in times.iter().enumerate() {
                reader.read(frame, &mut positions).unwrap();
                prop_assert_eq!(&positions, &moved(frame));
                prop_assert!((reader.times_secs()[frame] - time).abs() < 1e-9, "{}", name);
            }
            let back = reader.groom();
            if name != "a.npz" {
                let widths = groom.widths.clone().unwrap_or_else(|| vec![1e-4; groom.particle_count()]);
                prop_assert_eq!(back.widths.as_ref(), Some(&widths));
            }
            prop_assert_eq!(&back.colours, &groom.colours);
            prop_assert_eq!(&back.root_uvs, &groom.root_uvs);
            prop_assert_eq!(&back.labels, &groom.labels);
            if name != "a.abc" {
                prop_assert_eq!(back.transparencies.is_some(), groom.transparencies.is_some());
                prop_assert_eq!(&back.pinned, &groom.pinned);
                prop_assert_eq!(&back.stiffness, &groom.stiffness);
                prop_assert_eq!(&back.bindings, &groom.bindings);
            }
        }
    }

    /// What `forelock convert` does: labels go through every format that keeps them, one after the
    /// other, and through the repair of the strands that are read.
    #[test]
    fn labels_are_carried_from_file_to_file(groom in grooms()) {
        let folder = tempfile::tempdir().unwrap();
        // Strands that no repair drops or thins.
        let straight = |s: usize| (0..groom.range(s).len().max(2)).map(move |i| Vec3::new(s as f32, i as f32, 0.0));
        let strands = (0..groom.strand_count()).map(|s| straight(s).collect::<Vec<_>>());
        let mut now = Groom::from_strands(strands).unwrap();
        now.labels.clone_from(&groom.labels);
        for name in ["a.abc", "b.usda", "c.usdc", "d.npz", "e.abc"] {
            let path = folder.path().join(name);
            write_groom(&path, &now).unwrap();
            now = read_groom(&path, &Import::default()).unwrap().groom;
            prop_assert_eq!(&now.labels, &groom.labels, "{}", name);
        }
    }

    #[test]
    fn obj_mesh(points in prop::collection::vec(prop::array::uniform3(-1e9f32..1e9), 3..20)) {
        let positions: Vec<Vec3> = points.into_iter().map(Vec3::from_array).collect();
        let last = positions.len() as u32 - 1;
        let mesh = TriMesh::new(positions, vec![[0, 1, 2], [last, 0, 1]]).unwrap();
        prop_assert_eq!(obj::read_mesh(&obj::write_mesh(&mesh)).unwrap(), mesh);
    }
}

/// A `.hair` file of two strands of three points with the arrays that `flags` names.
fn hair_bytes(flags: u32, magic: &[u8; 4]) -> Vec<u8> {
    let mut bytes = magic.to_vec();
    for word in [2u32, 6, flags, 2] {
        bytes.extend(word.to_le_bytes());
    }
    for default in [0.5f32, 0.25, 0.1, 0.2, 0.3] {
        bytes.extend(default.to_le_bytes());
    }
    bytes.resize(128, b' ');
    if flags & 1 != 0 {
        bytes.extend([3, 0, 1, 0]);
    }
    let mut floats = |count: usize, base: f32| {
        (0..count).for_each(|i| bytes.extend((base + i as f32).to_le_bytes()));
    };
    floats(18, 100.0);
    for (flag, count, base) in [(4, 6, 200.0), (8, 6, 300.0), (16, 18, 400.0)] {
        if flags & flag != 0 {
            floats(count, base);
        }
    }
    bytes
}

#[test]
fn hair_with_every_combination_of_flags() {
    for flags in (0..32).filter(|flags| flags & 2 != 0) {
        let magic = if flags % 4 == 2 { b"HAIR" } else { b"hair" };
        let groom = hair::read(&hair_bytes(flags, magic)).unwrap();
        let offsets: &[u32] = if flags & 1 != 0 { &[0, 4, 6] } else { &[0, 3, 6] };
        assert_eq!(groom.strand_offsets(), offsets);
        assert_eq!(groom.positions()[5], Vec3::new(115.0, 116.0, 117.0));
        let last = |flag: u32, array: f32, default: f32| if flags & flag != 0 { array } else { default };
        assert_eq!(groom.widths.unwrap()[5], last(4, 205.0, 0.5));
        assert_eq!(groom.transparencies.unwrap()[5], last(8, 305.0, 0.25));
        let colour = [0, 1, 2].map(|i| last(16, 415.0 + i as f32, 0.1 * (i + 1) as f32));
        assert!(groom.colours.unwrap()[5].iter().zip(colour).all(|(a, b)| (a - b).abs() < 1e-6));
    }
    let words = hair::read(&hair_bytes(0, b"HAIR")).unwrap_err().to_string();
    assert!(words.contains("no points"), "{words}");
}

#[test]
fn tressfx_3_with_its_optional_arrays() {
    let mut bytes = Vec::new();
    bytes.extend(3.0f32.to_le_bytes());
    bytes.extend([2u32, 2].iter().flat_map(|n| n.to_le_bytes()));
    bytes.resize(144, 0);
    // positions, thickness, UVs, colours
    bytes.extend([296u32, 344, 352, 368].iter().flat_map(|n| n.to_le_bytes()));
    bytes.resize(296, 0);
    bytes.extend((0..12 + 2 + 4 + 16).flat_map(|i| (i as f32).to_le_bytes()));
    let groom = tfx::read(&bytes).unwrap();
    assert_eq!(groom.strand(1), [Vec3::new(6.0, 7.0, 8.0), Vec3::new(9.0, 10.0, 11.0)]);
    assert_eq!(groom.widths, Some(vec![12.0, 12.0, 13.0, 13.0]));
    assert_eq!(groom.root_uvs, Some(vec![[14.0, 15.0], [16.0, 17.0]]));
    assert_eq!(groom.colours.unwrap()[3], [30.0, 31.0, 32.0]);
    assert_eq!(groom.pinned, None);
}

#[test]
fn ct2hair_with_its_normals_and_labels() {
    let mut bytes = 1i32.to_le_bytes().to_vec();
    bytes.extend(2i32.to_le_bytes());
    for point in 0..2 {
        bytes.extend((0..6).flat_map(|i| ((10 * point + i) as f32).to_le_bytes()));
        bytes.extend([9; 4]);
    }
    let groom = ct2hair::read(&bytes).unwrap();
    assert_eq!(groom.strand(0), [Vec3::new(0.0, 1.0, 2.0), Vec3::new(10.0, 11.0, 12.0)]);
}

#[test]
fn one_point_strands_of_data_files_are_kept_for_repair_to_count() {
    let groom = Groom::from_strands([vec![Vec3::ZERO], vec![Vec3::ZERO, Vec3::Y], vec![]]).unwrap();
    assert_eq!(usc::read(&usc::write(&groom).unwrap()).unwrap(), groom);
}

#[test]
fn obj_faces_of_any_size_and_index_style() {
    let text = b"# caf\xe9\nv 0 0 0 1\nv 1 0 0\r\nv 1 1 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1 4/1\nf -4//1 -3//1 -1//1\n";
    let mesh = obj::read_mesh(text).unwrap();
    assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3], [0, 1, 3]]);
    let lines = b"v 0 0 0\nv 1 0 0\nv 2 0 0\nv 0 1 0\nv 0 2 0\nl 1 2\nl 2 3\nl 4 5\n";
    assert_eq!(obj::read_groom(lines).unwrap().strand_offsets(), [0, 3, 5]);
}

#[test]
fn arrays_of_every_type() {
    let arrays = [
        ("a", Array::new(&[2, 1], vec![1.5f32, -0.0]).unwrap()),
        ("b", Array::vector(vec![1e300f64])),
        ("c", Array::vector(vec![7u8; 300])),
        ("d", Array::vector(vec![u32::MAX])),
        ("e", Array::vector(vec![u64::MAX])),
        ("f", Array::new(&[], vec![-3i32]).unwrap()),
        ("g", Array::new(&[3, 0], Vec::<i64>::new()).unwrap()),
    ];
    let back = npz::read(Cursor::new(npz::write(&arrays))).unwrap();
    assert_eq!(back.len(), arrays.len());
    for (name, array) in &arrays {
        assert_eq!(&back[*name], array, "{name}");
    }
    assert!(Array::new(&[3], vec![1u8]).is_none());
}

/// Written by NumPy 2: `np.savez_compressed(f, positions=p, root_uv=uv)` with p = arange(12) as
/// big-endian float64 of shape [2, 2, 3] in Fortran order, and uv = [[.25, .5], [.75, 1]].
const BY_NUMPY: &[u8] = include_bytes!("../data/numpy_compressed_fortran_big_endian.npz");

#[test]
fn numpy_files_compressed_fortran_ordered_and_big_endian() {
    let groom = npz::read_groom(Cursor::new(BY_NUMPY)).unwrap();
    let numbers: Vec<f32> = groom.positions().iter().flat_map(|p| p.to_array()).collect();
    assert_eq!(numbers, (0..12).map(|i| i as f32).collect::<Vec<_>>());
    assert_eq!(groom.strand_offsets(), [0, 2, 4]);
    assert_eq!(groom.root_uvs, Some(vec![[0.25, 0.5], [0.75, 1.0]]));
    let arrays = npz::read(Cursor::new(BY_NUMPY)).unwrap();
    assert!(matches!(arrays["positions"].data, Data::F64(_)));
}

#[test]
fn labels_of_an_archive_beyond_32_bits_are_refused() {
    let read = |ids: Vec<i64>| {
        let points = vec![0.0f32, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0];
        let positions = Array { shape: vec![2, 2, 3], data: points.into() };
        let bytes = npz::write(&[("positions", positions), ("groom_id", Array::vector(ids))]);
        npz::read_groom(Cursor::new(bytes)).map(|groom| groom.labels.ids).map_err(|error| error.to_string())
    };
    assert_eq!(read(vec![7, -8]), Ok(Some(vec![7, -8])));
    let error = read(vec![7, 5_000_000_000]).unwrap_err();
    assert!(error.contains("`groom_id` of strand 1 is 5000000000, but must be from"), "{error}");
}
