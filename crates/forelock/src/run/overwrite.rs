//! Files of the user that outputs must not replace.
//!
//! A run replaces the files of an earlier run in its output folder. It does not replace a file that
//! its scene reads, nor a `scene.toml` that no run has written.

use std::fs;
use std::io::Read as _;
use std::path::{Path, PathBuf};

use super::RunError;
use crate::scene::Scene;

/// First line of the `scene.toml` of a run.
pub(super) const SCENE_HEADER: &str = "# Written by forelock: the scene of a run with every key.\n";

/// Checks that none of `outputs` is a file that `scene` reads, and that no two are the same.
///
/// # Errors
/// [`RunError::Overwrites`].
pub(crate) fn check_outputs(scene: &Scene, outputs: &[&Path]) -> Result<(), RunError> {
    let inputs: Vec<PathBuf> = scene.inputs().iter().map(|path| location(path)).collect();
    for (number, path) in outputs.iter().enumerate() {
        let own = location(path);
        if inputs.contains(&own) {
            return Err(overwrites(path, "which the scene reads"));
        }
        if outputs[..number].iter().any(|other| location(other) == own) {
            return Err(overwrites(path, "which is another output of the run"));
        }
    }
    Ok(())
}

/// Checks that the scene file `path` is missing or was written by a run.
///
/// # Errors
/// [`RunError::Overwrites`].
pub(super) fn check_scene_file(path: &Path) -> Result<(), RunError> {
    let Ok(file) = fs::File::open(path) else { return Ok(()) };
    let mut start = Vec::new();
    let read = file.take(SCENE_HEADER.len() as u64).read_to_end(&mut start);
    match read {
        Ok(_) if start != SCENE_HEADER.as_bytes() => {
            Err(overwrites(path, "a scene file that no run has written"))
        }
        _ => Ok(()),
    }
}

fn overwrites(path: &Path, what: &'static str) -> RunError {
    RunError::Overwrites { path: path.to_path_buf(), what }
}

/// Where `path` leads, whatever it is called: without links if it exists, and otherwise in a folder
/// without links.
fn location(path: &Path) -> PathBuf {
    let in_folder = || {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
        let folder = fs::canonicalize(folder.unwrap_or(Path::new("."))).ok()?;
        Some(folder.join(path.file_name()?))
    };
    fs::canonicalize(path).ok().or_else(in_folder).unwrap_or_else(|| path.to_path_buf())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::backend::Backend;
    use crate::run::{RunOptions, simulate};
    use crate::scene::Override;
    use std::sync::atomic::AtomicBool;

    /// Simulates hair of `source` into `out` with the cache `cache`; the error, if there is one.
    fn run(source: &str, out: &Path, cache: &str) -> Option<String> {
        let source = format!("groom.source={source}");
        let cache = format!("output.cache={cache}");
        let small = ["groom.strands=20", "body.sdf_cells=32", "time.frames=1", "output.picture=false"];
        let sets = small.iter().copied().chain([&*source, &*cache]);
        let sets: Vec<Override> = sets.map(|set| Override::set(set).unwrap()).collect();
        let options = RunOptions { out: out.to_path_buf(), resume: false, backend: Backend::Cpu };
        let scene = Scene::builtin(&sets).unwrap();
        simulate(&scene, &options, &mut |_| {}, &AtomicBool::new(false)).err().map(|e| e.to_string())
    }

    #[test]
    fn files_of_the_user_are_not_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path();
        let at = |name: &str| out.join(name).display().to_string();
        // A run replaces what a run has written.
        for _ in 0..2 {
            assert_eq!(run("grow", out, "hair.npz"), None);
        }
        fs::rename(out.join("hair.npz"), out.join("mine.npz")).unwrap();
        let mine = fs::read(out.join("mine.npz")).unwrap();
        let other_name = format!("{}/../{}/mine.npz", at(""), out.file_name().unwrap().display());
        for cache in ["mine.npz", &other_name] {
            let error = run(&at("mine.npz"), out, cache).unwrap();
            assert!(error.contains("which the scene reads"), "{error}");
        }
        assert_eq!(run(&at("mine.npz"), out, "hair.npz"), None);
        let error = run("grow", out, "./snapshot.npz").unwrap();
        assert!(error.contains("another output of the run"), "{error}");
        fs::write(out.join("scene.toml"), "# mine").unwrap();
        let error = run("grow", out, "hair.npz").unwrap();
        assert!(error.contains("a scene file that no run has written"), "{error}");
        assert_eq!(fs::read(out.join("mine.npz")).unwrap(), mine);
        assert_eq!(fs::read_to_string(out.join("scene.toml")).unwrap(), "# mine");
    }
}
