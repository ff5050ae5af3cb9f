//! What a writer wrote, its reader reads back exactly; headers of every kind are understood.

#![expect(clippy::unwrap_used, reason = "a helper of tests fails by panicking")]

use std::io::Cursor;

use crate::common::grooms;
use forelock_core::{body::TriMesh, groom::Groom};
use forelock_io::{Array, Data, alembic, ct2hair, hair, npz, obj, tfx, usc};
use glam::Vec3;
use proptest::prelude::*;

/// The same strands without attributes.
fn bare(groom: &Groom) -> Groom {
    Groom::new(groom.positions().to_vec(), groom.strand_offsets().to_vec()).unwrap()
}

proptest! {
    #[test]
    fn hair(mut groom in grooms()) {
        let back = hair::read(&hair::write(&groom).unwrap()).unwrap();
        (groom.root_uvs, groom.pinned, groom.bindings) = (None, None, None);
        prop_assert_eq!(back, groom);
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
    fn abc(mut groom in grooms(), ids in prop::option::of(any::<u64>())) {
        let strands = groom.strand_count() as u64;
        let labels = alembic::Labels {
            group_ids: ids.map(|id| (0..strands).map(|s| (id >> s) as i32).collect()),
            guides: ids.map(|id| (0..strands).map(|s| id >> s & 1 == 1).collect()),
            ids: ids.map(|id| (0..strands).map(|s| (id ^ s) as i32).collect()),
        };
        let bytes = alembic::write(&groom, &labels).unwrap();
        let back = alembic::Reader::open(Cursor::new(bytes)).unwrap().read(0).unwrap();
        (groom.transparencies, groom.pinned, groom.bindings) = (None, None, None);
        prop_assert_eq!(back, alembic::Contents { groom, velocities: None, labels });
    }

    #[test]
    fn obj_polylines(groom in grooms()) {
        prop_assert_eq!(obj::read_groom(&obj::write_groom(&groom)).unwrap(), bare(&groom));
    }

    #[test]
    fn tfx(mut groom in grooms()) {
        let each = groom.range(0).len();
        let equal = (0..groom.strand_count()).all(|s| groom.range(s).len() == each);
        let written = tfx::write(&groom);
        prop_assert_eq!(written.is_ok(), equal);
        let Ok(bytes) = written else { return Ok(()) };
        let mut back = tfx::read(&bytes).unwrap();
        let (found, wanted) = (back.widths.take(), groom.widths.clone());
        prop_assert_eq!(found.is_some(), wanted.is_some());
        for (found, wanted) in found.iter().flatten().zip(wanted.iter().flat_map(|w| w.chunks_exact(each))) {
            let mean = wanted.iter().sum::<f32>() / each as f32;
            prop_assert!(each > 1 || (found - mean).abs() < 1e-3);
        }
        let strands = groom.strand_count();
        groom.pinned.get_or_insert_with(|| vec![1; strands]);
        (groom.widths, groom.transparencies, groom.bindings) = (None, None, None);
        prop_assert_eq!(back, groom);
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
