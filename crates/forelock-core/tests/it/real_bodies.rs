//! Distance fields of real bodies: compared with a published field, and checked for what holds of
//! every head.

#![expect(clippy::unwrap_used, reason = "a test that cannot read its input fails")]

use forelock_core::body::{ClosedMesh, Sdf, TriMesh};
use glam::Vec3;

fn data(path: &str) -> std::path::PathBuf {
    std::path::Path::new(option_env!("REAL_DATA").unwrap_or_default()).join(path)
}

/// Positions and faces of an OBJ file, faces split into fans.
fn read_obj(path: &str) -> TriMesh {
    let text = std::fs::read_to_string(data(path)).unwrap();
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for line in text.lines() {
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => {
                let c: Vec<f32> = words.map(|word| word.parse().unwrap()).collect();
                positions.push(Vec3::new(c[0], c[1], c[2]));
            }
            Some("f") => {
                let index = |word: &str| word.split('/').next().unwrap().parse::<u32>().unwrap() - 1;
                let corners: Vec<u32> = words.map(index).collect();
                triangles.extend(corners.windows(2).skip(1).map(|pair| [corners[0], pair[0], pair[1]]));
            }
            _ => {}
        }
    }
    TriMesh::new(positions, triangles).unwrap()
}

#[test]
#[cfg_attr(not(real_data), ignore = "../shared/data is not there")]
fn a_closed_collider_has_the_distances_that_came_with_it() {
    // 64³ values at the centres of the cells of a box.
    let bytes = std::fs::read(data("sintel/sintel-sdf.bin")).unwrap();
    let floats: Vec<f32> = bytes[8..].as_chunks().0.iter().map(|word| f32::from_le_bytes(*word)).collect();
    let (low, high) = (Vec3::from_slice(&floats), Vec3::from_slice(&floats[3..]));
    let closed = ClosedMesh::new(&read_obj("sintel/sintel-collider.obj"));
    let (mut worst, mut sum) = (0.0f32, 0.0f64);
    for (node, &expected) in floats[6..].iter().enumerate() {
        let cell = Vec3::new((node % 64) as f32, (node / 64 % 64) as f32, (node / 4096) as f32);
        let got = closed.signed_distance(low + (high - low) * (cell + 0.5) / 64.0);
        assert_eq!(got < 0.0, expected < 0.0, "node {node}: {got} m for {expected} m");
        worst = worst.max((got - expected).abs());
        sum += f64::from((got - expected).abs());
    }
    assert!(worst < 2e-4 && sum / 262_144.0 < 1e-6, "{worst} m at worst, {} m in the mean", sum / 262_144.0);
}

#[test]
#[cfg_attr(not(real_data), ignore = "../shared/data is not there")]
fn open_busts_are_solid_heads() {
    // A point in the middle of the skull, and a lower bound of its distance from the skin, in the
    // file's unit.
    let busts = [
        ("sintel/sintel.obj", Vec3::new(0.0, 1.57, -0.01), 0.05),
        ("harolongo/Retopologised_Female_Head_01_mod.obj", Vec3::new(0.0, 8.0, -9.0), 5.0),
        ("ponytail/ponytail_mesh.obj", Vec3::new(0.0, 95.0, 0.0), 18.0),
    ];
    for (path, middle, depth) in busts {
        let mesh = read_obj(path);
        let sdf = Sdf::from_mesh(&mesh, 64, 0.0).unwrap();
        assert!(sdf.sample(middle).0 < -depth, "{path}: {} in the skull", sdf.sample(middle).0);
        let (low, high) = mesh.bounds();
        // Nothing beyond the mesh is inside, the open neck least of all.
        let margin = (high - low) * 0.01;
        for (value, node) in sdf.values().iter().zip(0u32..) {
            let (i, j, k) = (
                node % sdf.dims().x,
                node / sdf.dims().x % sdf.dims().y,
                node / (sdf.dims().x * sdf.dims().y),
            );
            let p = sdf.origin() + Vec3::new(i as f32, j as f32, k as f32) * sdf.cell();
            let beyond = p.cmplt(low - margin).any() || p.cmpgt(high + margin).any();
            assert!(!beyond || *value > 0.0, "{path}: {value} at {p}");
        }
    }
}
