//! A solid given as a sequence of meshes, from a scene file on disk.

#![expect(clippy::unwrap_used, reason = "in a test a failure to build is a failure of the test")]

use std::fmt::Write as _;
use std::path::Path;
use std::sync::atomic::AtomicBool;

use forelock::{Backend, RunOptions, Scene, Summary, simulate};

/// A box of 30 cm by 30 cm and the thickness `depth`, about the origin, as an OBJ file in
/// centimetres.
fn plate(depth: f64) -> String {
    let mut text = String::new();
    for corner in 0..8 {
        let side = |bit: u32, half: f64| if corner >> bit & 1 == 1 { half } else { -half };
        writeln!(text, "v {} {} {}", side(0, 15.0), side(1, 15.0), side(2, 50.0 * depth)).unwrap();
    }
    for face in ["1 3 4 2", "5 6 8 7", "1 2 6 5", "3 7 8 4", "1 5 7 3", "2 4 8 6"] {
        writeln!(text, "f {face}").unwrap();
    }
    text
}

/// Strands of 40 cm that hang in a row 6 cm before the origin, from 25 cm above it.
fn fringe() -> String {
    let mut text = String::new();
    for strand in 0..20 {
        for particle in 0..20 {
            let (x, y) = (0.01 * f64::from(strand) - 0.1, 0.25 - 0.4 / 19.0 * f64::from(particle));
            writeln!(text, "v {x} {y} 0.06").unwrap();
        }
        let line: Vec<_> = (1..=20).map(|particle| (20 * strand + particle).to_string()).collect();
        writeln!(text, "l {}", line.join(" ")).unwrap();
    }
    text
}

const SCENE: &str = r#"
[groom]
source = "fringe.obj"
[body]
mesh = "none"
motion = "builtin:still"
[[collider]]
shape = "mesh"
mesh_sequence = ["thin.obj", "thicker.obj", "thick.obj"]
sequence_fps = 10
unit = "cm"
friction = 0.0
[time]
frames = 30
[output]
picture = false
report = false
"#;

/// Runs `scene` in `folder`.
fn run(folder: &Path, scene: &str) -> Result<Summary, Box<dyn std::error::Error>> {
    std::fs::write(folder.join("scene.toml"), scene)?;
    let scene = Scene::load(&folder.join("scene.toml"), &[])?;
    let options = RunOptions { out: folder.join("out"), resume: false, backend: Backend::Cpu };
    Ok(simulate(&scene, &options, &mut |_| {}, &AtomicBool::new(false))?)
}

/// The plate grows to ±10 cm within a fifth of a second, and the fringe, 6 cm before its middle,
/// goes with its surface.
#[test]
fn a_sequence_of_meshes_pushes_hair() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: String| std::fs::write(folder.path().join(name), text).unwrap();
    write("fringe.obj", fringe());
    for (name, depth) in [("thin.obj", 0.08), ("thicker.obj", 0.14), ("thick.obj", 0.2)] {
        write(name, plate(depth));
    }
    let summary = run(folder.path(), SCENE).unwrap();
    assert!(summary.max_share_1mm_inside < 1e-3, "{summary:?}");
    let mut cache = forelock::io::Cache::open(&folder.path().join("out/hair.npz")).unwrap();
    let mut positions = Vec::new();
    // Frames of the growth, and after it, by the surface's place then.
    for (frame, surface) in [(3, 0.055), (6, 0.07), (12, 0.1), (30, 0.1)] {
        cache.read_frame(frame, &mut positions).unwrap();
        let before = positions.iter().filter(|p| p.y.abs() < 0.1).map(|p| p.z);
        let least = before.clone().fold(f32::INFINITY, f32::min);
        let mean = before.clone().sum::<f32>() / before.count() as f32;
        println!("frame {frame}: surface {surface} m, nearest {least:.4} m, mean {mean:.4} m");
        assert!(least > surface - 1e-3, "frame {frame}: {least} m");
        assert!(mean < surface.max(0.06) + 0.03, "frame {frame}: {mean} m on average");
    }
    // Without its last mesh it stays where the second one has it: there hair hangs over its rim,
    // once friction between neighbours has faded. A file that is missing is named.
    let two = SCENE.replace(", \"thick.obj\"", "").replace("frames = 30", "frames = 300");
    run(folder.path(), &two).unwrap();
    let mut cache = forelock::io::Cache::open(&folder.path().join("out/hair.npz")).unwrap();
    cache.read_frame(300, &mut positions).unwrap();
    let nearest = positions.chunks(20).map(|strand| strand[12].z).fold(f32::INFINITY, f32::min);
    assert!((nearest - 0.07).abs() < 5e-3, "{nearest} m");
    std::fs::remove_file(folder.path().join("thick.obj")).unwrap();
    let message = run(folder.path(), SCENE).unwrap_err().to_string();
    assert!(message.contains("thick.obj"), "{message}");
}
