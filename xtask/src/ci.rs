//! What continuous integration runs, in its order; the first step that fails ends it.
//!
//! Every step uses the release profile, so that build scripts and procedural macros are compiled once for all.

use std::path::Path;
use std::process::Command;
use std::time::Instant;

use anyhow::{Context, bail};

/// Name and arguments to cargo. The last is the README's second command.
const STEPS: [(&str, &str); 6] = [
    ("lock file", "fetch --locked"),
    ("format", "fmt --all --check"),
    ("floors", "xtask floors"),
    ("lints", "clippy --release --workspace --all-targets -- -D warnings"),
    ("documents", "doc --release --workspace --no-deps"),
    ("tests", "test --release --workspace"),
];

/// Runs all steps in `root` and tells how long each took.
pub fn run(root: &Path) -> anyhow::Result<()> {
    let mut times = Vec::new();
    for (name, arguments) in STEPS {
        eprintln!("── {name}: cargo {arguments}");
        let started = Instant::now();
        let mut command = Command::new("cargo");
        command.args(arguments.split(' ')).env("RUSTDOCFLAGS", "-D warnings").current_dir(root);
        let status = command.status().context("cargo cannot be started")?;
        let secs = started.elapsed().as_secs_f64();
        if !status.success() {
            bail!("── {name} failed after {secs:.0} s: cargo {arguments}");
        }
        times.push(format!("{name} {secs:.0} s"));
    }
    eprintln!("── all passed: {}", times.join(", "));
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_step_is_the_readme_s_test_command() -> anyhow::Result<()> {
        let readme = std::fs::read_to_string(crate::root()?.join("README.md"))?;
        let (_, last) = STEPS[STEPS.len() - 1];
        assert!(readme.lines().any(|line| line.trim() == format!("cargo {last}")), "{last}");
        Ok(())
    }
}
