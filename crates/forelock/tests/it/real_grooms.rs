//! The real grooms of `scenes/real` on their bodies: three seconds in which the head comes to shake
//! with up to 4 g, and one second of rest. `docs/real-grooms.md` has the whole runs.

#![expect(clippy::unwrap_used, clippy::expect_used, reason = "a test that cannot read its input fails")]

use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::AtomicBool;

use crate::measure::{self, Shown};
use forelock::scene::Override;
use forelock::{Backend, RunOptions, Scene, Summary, simulate};

/// One run at a time: its cache takes 400 MB of the disk.
static DISK: Mutex<()> = Mutex::new(());

/// Runs scene `name` with `sets` and without pictures.
fn run(name: &str, sets: &[&str]) -> (Summary, Shown) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("../../scenes/real/{name}.toml"));
    let quiet = ["output.picture=false", "output.contact_sheet=false", "output.report=false"];
    let mut sets: Vec<Override> = quiet.iter().chain(sets).map(|set| Override::set(set).unwrap()).collect();
    if let Some(data) = option_env!("REAL_DATA") {
        sets.extend(elsewhere(&path, Path::new(data)));
    }
    let scene = Scene::load(&path, &sets).unwrap();
    let turn = DISK.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    let folder = tempfile::tempdir().unwrap();
    let options = RunOptions { out: folder.path().to_path_buf(), resume: false, backend: Backend::Cpu };
    let summary = simulate(&scene, &options, &mut |_| {}, &AtomicBool::new(false)).unwrap();
    let shown = measure::shown(folder.path(), 1);
    drop(turn);
    (summary, shown)
}

/// Overrides that find the files of the scene at `path` in the folder `data`.
fn elsewhere(path: &Path, data: &Path) -> Vec<Override> {
    let scene = Scene::load(path, &[]).unwrap();
    let moved = |path: &Path| {
        let parts: Vec<_> = path.iter().collect();
        let under = parts.iter().rposition(|part| *part == "data").expect("a file of the data folder");
        data.join(parts[under + 1..].iter().collect::<std::path::PathBuf>())
    };
    let mut sets = Vec::new();
    if let forelock::scene::GroomSource::Files(files) = &scene.groom.source {
        let files: Vec<_> = files.iter().map(|file| moved(file)).collect();
        sets.push(Override::set(&format!("groom.source={files:?}")).unwrap());
    }
    if !scene.body.is_named() {
        let mesh = moved(scene.body.mesh.as_ref());
        sets.push(Override::set(&format!("body.mesh={mesh:?}")).unwrap());
    }
    sets
}

/// The bounds that every real groom must hold.
fn check(name: &str) {
    let (summary, shaken) = run(name, &["time.frames=180", "body.motion.rest_after_secs=0"]);
    eprintln!("{name} shaken: {shaken:?}");
    assert_eq!((summary.quarantined_strands, shaken.non_finite), (0, 0));
    assert!(summary.max_edge_stretch <= 1e-5, "stretch {} after the pass", summary.max_edge_stretch);
    assert!(shaken.share_inside <= 1e-3, "{} of the particles more than 1 mm inside", shaken.share_inside);
    let [share, deepest_m, edge_share, deepest_edge_m] = shaken.reported;
    assert!((share - shaken.measured[0]).abs() < 1e-6, "{share} reported for {:?}", shaken.measured);
    assert!(
        (deepest_m - shaken.measured[1]).abs() < 2e-5,
        "{deepest_m} m reported for {:?}",
        shaken.measured
    );
    assert!((edge_share - shaken.edge_share_inside).abs() < 1e-5, "{edge_share} reported");
    assert!((deepest_edge_m - shaken.deepest_edge_m).abs() < 2e-4, "{deepest_edge_m} m reported");
    assert!(shaken.jitter_g > 0.5, "at 4 g the hair moves");
    assert_eq!((summary.strands, summary.particles), (shaken.strands, shaken.particles));

    let (_, still) = run(name, &["time.frames=60", "body.motion=builtin:still"]);
    eprintln!("{name} at rest: {still:?}");
    assert!(still.drift_m <= 2e-3, "sags by {} m", still.drift_m);
    assert!(still.jitter_rms_g <= 1e-3, "jitters at {} g", still.jitter_rms_g);
}

#[test]
#[cfg(real_data)]
#[ignore = "long: cargo xtask ci --nightly"]
fn long_sintel() {
    check("sintel");
}

#[test]
#[cfg(real_data)]
#[ignore = "long: cargo xtask ci --nightly"]
fn long_harolongo() {
    check("harolongo");
}

#[test]
#[cfg(real_data)]
#[ignore = "long: cargo xtask ci --nightly"]
fn long_ponytail() {
    check("ponytail");
}

#[test]
#[cfg_attr(not(real_data), ignore = "../shared/data is not there")]
fn yuksel_straight() {
    check("yuksel-straight");
}
