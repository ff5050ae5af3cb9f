//! Every scene of `scenes/ams` reads and runs, at a few strands.

#![expect(clippy::unwrap_used, reason = "a test that cannot read its input fails")]

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use forelock::scene::{GroomSource, Override};
use forelock::{Backend, RunOptions, Scene, simulate};

/// Keys that make a run small.
const SMALL: [&str; 8] = [
    "groom.strands=20",
    "time.frames=2",
    "body.sdf_cells=32",
    "output.picture=false",
    "output.contact_sheet=false",
    "output.film=false",
    "output.report=false",
    "output.cache=\"\"",
];

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes/ams")
}

fn runs(path: &Path) {
    let sets: Vec<Override> = SMALL.iter().map(|set| Override::set(set).unwrap()).collect();
    let scene = Scene::load(path, &sets).unwrap_or_else(|error| panic!("{error}"));
    let out = tempfile::tempdir().unwrap();
    let options = RunOptions { out: out.path().to_path_buf(), resume: false, backend: Backend::Cpu };
    let summary = simulate(&scene, &options, &mut |_| {}, &AtomicBool::new(false))
        .unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    assert_eq!((summary.frames, summary.quarantined_strands), (2, 0), "{}", path.display());
}

#[test]
fn every_scene_runs() {
    let mut names = Vec::new();
    for entry in std::fs::read_dir(folder()).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|ending| ending != "toml") {
            continue;
        }
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        let scene = Scene::load(&path, &[]).unwrap_or_else(|error| panic!("{error}"));
        let has_data = match &scene.groom.source {
            GroomSource::Grow => true,
            GroomSource::Files(files) => files.iter().all(|file| !file.iter().any(|part| part == "data")),
        };
        if has_data {
            runs(&path);
        }
        names.push(name);
    }
    for name in [
        "asymmetric",
        "beard",
        "figure4",
        "figure5",
        "grooming",
        "hand",
        "roller-coaster",
        "wig-wind",
        "wind",
    ] {
        assert!(names.iter().any(|found| found == name), "{name} is missing: {names:?}");
    }
}

#[test]
#[cfg_attr(not(real_data), ignore = "../shared/data is not there")]
fn the_grooming_scene_runs() {
    runs(&folder().join("grooming.toml"));
}
