//! The project's own checks: `cargo xtask floors` and `cargo xtask ci`.

mod ci;
mod floors;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, bail};

const USAGE: &str = "\
usage: cargo xtask COMMAND
  floors  dependencies go down, and the map in ARCHITECTURE.md is true
  ci      all that continuous integration runs, in its order; with --nightly the long tests too";

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match run(&arguments.iter().map(String::as_str).collect::<Vec<_>>()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error:#}");
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: &[&str]) -> anyhow::Result<()> {
    let root = root()?;
    match arguments {
        ["floors"] => {
            let faults = floors::check(&root)?;
            if !faults.is_empty() {
                bail!("the floors do not hold:\n  {}", faults.join("\n  "));
            }
            eprintln!("the floors hold, and ARCHITECTURE.md knows every crate");
            Ok(())
        }
        ["ci"] => ci::run(&root, false),
        ["ci", "--nightly"] => ci::run(&root, true),
        [] => bail!("{USAGE}"),
        other => bail!("no such command: {}\n{USAGE}", other.join(" ")),
    }
}

/// The folder of the workspace.
fn root() -> anyhow::Result<PathBuf> {
    let parent = Path::new(env!("CARGO_MANIFEST_DIR")).parent();
    Ok(parent.context("xtask lies in the workspace")?.to_path_buf())
}
