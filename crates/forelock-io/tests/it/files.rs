//! Whole files: names, endings, units, and what is said when the system refuses.

#![expect(clippy::unwrap_used, reason = "a helper of tests fails by panicking")]

use std::fs;

use forelock_core::groom::{Groom, Import, Unit, Up};
use forelock_io::{ReadError, WriteError, atomic_write, read_groom, read_mesh, write_groom, write_mesh};
use glam::Vec3;

fn groom() -> Groom {
    Groom::from_strands([[Vec3::ZERO, Vec3::new(0.1, 0.2, 0.3)]]).unwrap()
}

#[test]
fn every_written_format_reads_back() {
    let folder = tempfile::tempdir().unwrap();
    for ending in ["hair", "data", "tfx", "npz", "obj", "abc", "ply", "usda", "usdc", "usd", "HAIR"] {
        let path = folder.path().join(format!("a.{ending}"));
        write_groom(&path, &groom()).unwrap();
        let back = read_groom(&path, &Import::default()).unwrap();
        assert_eq!(back.groom.positions(), groom().positions(), "{ending}");
        assert!(back.repairs.is_clean());
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 11, "a temporary file was left");
}

#[test]
fn units_and_axes_are_applied() {
    let folder = tempfile::tempdir().unwrap();
    let import = Import { unit: Unit::Centimetre, up: Up::Z, scale: 2.0 };
    for (name, expected) in [("a.hair", [0.2, 0.3, 0.1]), ("a.data", [0.1, 0.3, -0.2])] {
        let path = folder.path().join(name);
        write_groom(&path, &groom()).unwrap();
        let tip = read_groom(&path, &import).unwrap().groom.positions()[1];
        assert!(tip.distance(Vec3::from_array(expected) * 0.02) < 1e-7, "{name}: {tip}");
    }
}

#[test]
fn each_bad_name_gets_one_clear_message() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    fs::create_dir(at("folder.hair")).unwrap();
    fs::write(at("empty.tfx"), "").unwrap();
    fs::write(at("points.data"), [1, 0, 0, 0, 0, 0, 0, 0]).unwrap();
    fs::write(at("none.data"), [0; 4]).unwrap();
    for (name, words) in [
        ("missing.hair", "no such file or folder"),
        ("folder.hair", "this is a folder"),
        ("empty.tfx", "the file is empty"),
        (
            "groom.xyz",
            "files ending in .xyz are not known; these can be read: .hair .data .tfx .npz .obj .abc .ply .bin .usda .usdc \
             .usd",
        ),
        ("groom", "no ending"),
        ("points.data", "no usable strand in the file (1 strand of 1 dropped: fewer than two points"),
        ("none.data", "no usable strand in the file (it holds none)"),
    ] {
        let message = read_groom(&at(name), &Import::default()).unwrap_err().to_string();
        assert!(message.contains(words) && message.contains(name), "{message}");
        assert!(!message.contains('\n'), "{message}");
    }
    assert!(matches!(read_mesh(&at("a.stl"), &Import::default()), Err(ReadError::UnknownEnding { .. })));
    for (name, words) in [
        ("folder.hair", "this is a folder"),
        ("no/such/folder.hair", "no such file or folder"),
        ("a.bin", "these can be written: .hair .data .tfx .npz .obj .abc .ply .usda .usdc .usd"),
    ] {
        let message = write_groom(&at(name), &groom()).unwrap_err().to_string();
        assert!(message.contains(words) && message.contains(name), "{message}");
    }
}

#[cfg(unix)]
#[test]
fn devices_are_neither_read_nor_replaced() {
    let device = std::path::Path::new("/dev/null");
    assert!(matches!(atomic_write(device, |_| Ok(())), Err(WriteError::NotAFile { .. })));
    let folder = tempfile::tempdir().unwrap();
    let link = folder.path().join("endless.data");
    std::os::unix::fs::symlink("/dev/zero", &link).unwrap();
    assert!(matches!(read_groom(&link, &Import::default()), Err(ReadError::NotAFile { .. })));
}

#[test]
fn a_failed_write_leaves_the_old_file_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.txt");
    atomic_write(&path, |file| file.write_all(b"old")).unwrap();
    let full = || Err(std::io::ErrorKind::StorageFull.into());
    let message =
        atomic_write(&path, |file| file.write_all(b"new").and_then(|()| full())).unwrap_err().to_string();
    assert!(message.contains("the disk is full"), "{message}");
    assert_eq!(fs::read(&path).unwrap(), b"old");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[cfg(unix)]
#[test]
fn written_files_have_ordinary_rights() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let [ours, plain] = ["ours", "plain"].map(|name| folder.path().join(name));
    atomic_write(&ours, |_| Ok(())).unwrap();
    fs::write(&plain, "").unwrap();
    let mode = |path| fs::metadata(path).unwrap().permissions().mode();
    assert_eq!(mode(&ours), mode(&plain));
}

#[test]
fn what_a_format_cannot_hold_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let uneven = Groom::from_strands([vec![Vec3::ZERO, Vec3::Y], vec![Vec3::X; 3]]).unwrap();
    let path = folder.path().join("a.tfx");
    let message = write_groom(&path, &uneven).unwrap_err().to_string();
    assert!(
        message.contains("strand 1 has 3 points and strand 0 has 2") && message.contains("resample"),
        "{message}"
    );
    let long = Groom::from_strands([vec![Vec3::ZERO; 65_537]]).unwrap();
    write_groom(&folder.path().join("a.hair"), &long).unwrap_err();
    let mut wrong = groom();
    wrong.widths = Some(vec![0.0]);
    let message = write_groom(&folder.path().join("a.npz"), &wrong).unwrap_err().to_string();
    assert!(message.contains("`widths` has 1 entries, but 2 were expected"), "{message}");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn meshes_round_trip_through_files() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.obj");
    let mesh =
        forelock_core::body::TriMesh::new(vec![Vec3::ZERO, Vec3::X, Vec3::Z], vec![[0, 1, 2]]).unwrap();
    write_mesh(&path, &mesh).unwrap();
    assert_eq!(read_mesh(&path, &Import::default()).unwrap(), mesh);
    let turned = read_mesh(&path, &Import { up: Up::Z, ..Import::default() }).unwrap();
    assert_eq!(turned.positions[2], Vec3::Y);
}
