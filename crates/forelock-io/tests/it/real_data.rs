//! Grooms, heads and caches that other programs wrote. Tests are ignored where the files are
//! missing.

#![expect(clippy::unwrap_used, reason = "a helper of tests fails by panicking")]

use std::path::{Path, PathBuf};

use forelock_core::groom::{Groom, Import, Info, Unit, Up, resample};
use forelock_io::{read_groom, read_mesh};
use glam::Vec3;

fn data(name: &str) -> PathBuf {
    Path::new(option_env!("REAL_DATA").unwrap_or_default()).join(name)
}

fn read(name: &str, import: &Import) -> Groom {
    let imported = read_groom(&data(name), import).unwrap();
    eprintln!("{name}: {}\n{}\n", imported.repairs, Info::of(&imported.groom));
    imported.groom
}

#[test]
#[cfg_attr(not(real_data), ignore = "no real data: set FORELOCK_DATA to its folder")]
fn strand_counts_are_those_of_the_files() {
    for (name, strands, each) in [
        ("sintel/SintelHairOriginal-sintel_hair.16points.tfx", 11_400, 16),
        ("sintel/sintel_lite_228x32.tfx", 228, 32),
        ("harolongo/harolongo.data", 7_905, 21),
        ("ponytail/back.tfx", 517, 16),
        ("ponytail/front_top.tfx", 876, 16),
        ("ponytail/side.tfx", 3_066, 16),
        ("ponytail/tail.tfx", 474, 16),
        ("yuksel/straight.hair", 10_000, 16),
    ] {
        let groom = read(name, &Import::default());
        assert_eq!(groom.strand_count(), strands, "{name}");
        assert_eq!(groom.particle_count(), strands * each, "{name}");
    }
}

#[test]
#[cfg_attr(not(real_data), ignore = "no real data: set FORELOCK_DATA to its folder")]
fn units_axes_and_attributes_are_right() {
    let sintel = read("sintel/SintelHairOriginal-sintel_hair.16points.tfx", &Import::default());
    assert_eq!(Info::of(&sintel).unit_guess.unit, Some(Unit::Metre));
    assert!(sintel.pinned.unwrap().iter().all(|&n| n == 1));

    let centimetres = Import { unit: Unit::Centimetre, ..Import::default() };
    let harolongo = read("harolongo/harolongo.data", &centimetres);
    assert_eq!(Info::of(&harolongo).unit_guess.unit, Some(Unit::Metre));
    let as_metres = read("harolongo/harolongo.data", &Import::default());
    assert_eq!(Info::of(&as_metres).unit_guess.unit, Some(Unit::Centimetre));

    let import = Import { unit: Unit::Inch, up: Up::Z, scale: 0.1 };
    let straight = read("yuksel/straight.hair", &import);
    let info = Info::of(&straight);
    assert!((0.09..0.3).contains(&info.root_extent), "{info}");
    // Hair hangs: its lowest point is far below the roots only if the axes are right.
    let lowest_root = straight.strands().map(|s| s[0].y).fold(f32::INFINITY, f32::min);
    assert!(info.min.y < lowest_root - 0.1 && info.max.y - lowest_root < 0.3, "{info}");
}

#[test]
#[cfg_attr(not(real_data), ignore = "no real data: set FORELOCK_DATA to its folder")]
fn resampling_keeps_the_curls_of_a_real_groom() {
    let groom = read("harolongo/harolongo.data", &Import { unit: Unit::Centimetre, ..Import::default() });
    let mean = |groom: &Groom| Info::of(groom).length.mean;
    for (n, kept) in [(16, 0.975), (21, 0.995), (30, 0.999), (64, 1.0)] {
        let ratio = mean(&resample(&groom, n).unwrap()) / mean(&groom);
        eprintln!("{n} particles keep {ratio:.4} of the length");
        assert!(ratio > kept && ratio < 1.01, "{n} particles keep {ratio} of the length");
    }
}

/// Blender turned the groom to its own axes when it read it, and back when it wrote Alembic.
#[test]
#[cfg_attr(not(real_data), ignore = "no real data: set FORELOCK_DATA to its folder")]
fn what_blender_wrote_is_the_groom_that_it_read() {
    let original = read("sintel/SintelHairOriginal-sintel_hair.16points.tfx", &Import::default());
    let written = read("written-by-blender/sintel_hair_blender.abc", &Import::default());
    assert_eq!(written.strand_offsets(), original.strand_offsets());
    let size = Info::of(&original).max.distance(Info::of(&original).min);
    let pairs = || written.positions().iter().zip(original.positions());
    let worst = pairs().map(|(a, b)| a.distance(*b)).fold(0.0, f32::max);
    eprintln!("the largest difference is {worst} m, {} of the size of {size} m", worst / size);
    assert!(worst < 1e-6 * size);
    let widths = written.widths.as_ref().unwrap();
    // They taper from 0.1 mm at the roots to 0.02 mm at the tips.
    for strand in 0..written.strand_count() {
        let own = &widths[written.range(strand)];
        assert!((own[0] - 1e-4).abs() < 1e-9 && (own[15] - 2e-5).abs() < 1e-9);
    }
    // The comparison fails where one axis is turned the wrong way.
    let turned = pairs().map(|(a, b)| (*a * Vec3::new(1.0, 1.0, -1.0)).distance(*b)).fold(0.0, f32::max);
    assert!(turned > 0.1 * size);
}

#[test]
#[cfg_attr(not(real_data), ignore = "no real data: set FORELOCK_DATA to its folder")]
fn heads_are_read() {
    for name in [
        "sintel/sintel.obj",
        "sintel/sintel-collider.obj",
        "sintel/sintel_lite.obj",
        "ponytail/ponytail_mesh.obj",
        "harolongo/Retopologised_Female_Head_01_mod.obj",
        "harolongo/hand.obj",
        "makehuman/base.obj",
        "collision/bunny_10k.obj",
    ] {
        let mesh = read_mesh(&data(name), &Import::default()).unwrap();
        eprintln!("{name}: {} vertices, {} triangles", mesh.positions.len(), mesh.triangles.len());
        assert!(mesh.triangles.len() > 100);
    }
    let bunny = read_mesh(&data("collision/bunny_10k.obj"), &Import::default()).unwrap();
    assert_eq!(bunny.triangles.len(), 10_000);
}

/// Blender's groom is the same hair in Blender's axes, below a prim that turns it.
#[test]
#[cfg_attr(not(real_data), ignore = "no real data: set FORELOCK_DATA to its folder")]
fn the_layer_of_blender_is_the_groom_that_it_was_made_from() {
    let wanted = read("sintel/SintelHairOriginal-sintel_hair.16points.tfx", &Import::default());
    let found = read("written-by-blender/sintel_hair_blender.usdc", &Import::default());
    assert_eq!(found.strand_offsets(), wanted.strand_offsets());
    let pairs = || found.positions().iter().zip(wanted.positions());
    let error = pairs().map(|(a, b)| a.distance(*b)).fold(0.0, f32::max);
    let info = Info::of(&wanted);
    let size = info.max.distance(info.min);
    eprintln!("the largest distance is {error:e} m in a groom of {size} m");
    assert!(error <= 1e-6 * size);
    // The comparison sees a quarter turn.
    assert!(pairs().any(|(a, b)| Vec3::new(a.x, -a.z, a.y).distance(*b) > 0.1 * size));
    assert!(found.widths.unwrap().iter().all(|&w| w > 0.0 && w <= 1.01e-4));
}
