//! What the command tests share: the command in a folder of its own, and small runs.

#![expect(clippy::unwrap_used, reason = "a test fails where a step fails")]

use std::path::{Path, PathBuf};
use std::process::Output;

use assert_cmd::Command;
use tempfile::TempDir;

/// A folder to work in, and the command run there with a cache folder of its own.
pub struct Workplace {
    folder: TempDir,
}

/// Keys that make a run small and quick.
pub const SMALL: [&str; 7] = [
    "groom.strands=40",
    "groom.vertices_per_strand=8",
    "body.sdf_cells=24",
    "output.width=64",
    "output.height=64",
    "time.frames=6",
    "output.cache_every=1",
];

impl Workplace {
    pub fn new() -> Self {
        Self { folder: tempfile::tempdir().unwrap() }
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> PathBuf {
        let path = self.path(name);
        std::fs::write(&path, bytes).unwrap();
        path
    }

    /// The command, to be given arguments.
    pub fn command(&self) -> Command {
        let mut command = Command::cargo_bin("forelock").unwrap();
        command.current_dir(self.folder.path()).env("XDG_CACHE_HOME", shared_cache()).env_remove("RUST_LOG");
        command
    }

    /// What the command answers to `arguments`.
    pub fn run<S: AsRef<std::ffi::OsStr>>(&self, arguments: impl IntoIterator<Item = S>) -> Output {
        self.command().args(arguments).output().unwrap()
    }

    /// Everything under the folder, to see what a run left.
    pub fn files(&self) -> Vec<PathBuf> {
        let mut files = Vec::new();
        collect(self.folder.path(), &mut files);
        files.sort();
        files
    }
}

fn collect(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            collect(&path, files);
        } else {
            files.push(path);
        }
    }
}

/// Distance grids are kept here between tests.
pub fn shared_cache() -> PathBuf {
    Path::new(env!("CARGO_TARGET_TMPDIR")).join("cache")
}

/// `--set` before each of `keys`.
pub fn sets<'a>(keys: impl IntoIterator<Item = &'a str>) -> Vec<String> {
    keys.into_iter().flat_map(|key| ["--set".to_owned(), key.to_owned()]).collect()
}

/// The arguments of a small demo run into `out`, with `more` after them.
pub fn small_demo(out: &str, more: &[&str]) -> Vec<String> {
    let mut arguments = vec!["demo".to_owned(), "--out".to_owned(), out.to_owned()];
    arguments.extend(sets(SMALL));
    arguments.extend(more.iter().map(|s| (*s).to_owned()));
    arguments
}

pub fn stderr(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}

pub fn stdout(output: &Output) -> String {
    String::from_utf8(output.stdout.clone()).unwrap()
}

/// The JSON object that is all of standard output.
pub fn json(output: &Output) -> serde_json::Value {
    assert!(output.status.success(), "{}", stderr(output));
    serde_json::from_slice(&output.stdout).unwrap_or_else(|error| panic!("{error}: {}", stdout(output)))
}

/// The number of lines of `message`. Work before an error shows its progress where it takes long.
pub fn lines_but_progress(message: &str) -> usize {
    let is_progress = |line: &&str| ["growing", "distance field"].iter().any(|work| line.starts_with(work));
    message.trim_end().lines().filter(|line| !is_progress(line)).count()
}
