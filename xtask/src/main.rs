//! The project's own checks: `cargo xtask floors` and `cargo xtask ci`.

mod ci;
mod floors;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, bail};

const USAGE: &str = "\
usage: cargo xtask COMMAND
  floors  dependencies go down, and the map in ARCHITECTURE.md is true
  ci      all that continuous integration runs, in its order";

fn main() -> ExitCode {
    match run(std::env::args().nth(1).as_deref()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error:#}");
            ExitCode::FAILURE
        }
    }
}

fn run(command: Option<&str>) -> anyhow::Result<()> {
    let root = root()?;
    match command {
        Some("floors") => {
            let faults = floors::check(&root)?;
            if !faults.is_empty() {
                bail!("the floors do not hold:\n  {}", faults.join("\n  "));
            }
            eprintln!("the floors hold, and ARCHITECTURE.md knows every crate");
            Ok(())
        }
        Some("ci") => ci::run(&root),
        Some(other) => bail!("no such command: {other}\n{USAGE}"),
        None => bail!("{USAGE}"),
    }
}

/// The folder of the workspace.
fn root() -> anyhow::Result<PathBuf> {
    let parent = Path::new(env!("CARGO_MANIFEST_DIR")).parent();
    Ok(parent.context("xtask lies in the workspace")?.to_path_buf())
}
