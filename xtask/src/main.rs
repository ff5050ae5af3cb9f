//! The checks of the project: `cargo xtask floors` and `cargo xtask ci`.

mod ci;
mod floors;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, bail};

const USAGE: &str = "\
usage: cargo xtask COMMAND
  floors [--all]  check dependencies, file sizes, signatures, comments and the tables of
                  ARCHITECTURE.md; --all also lists what the checks that are postponed find
  ci              run all steps of continuous integration, in order";

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
            let floors::Findings { faults, not_yet } = floors::check(&root)?;
            if std::env::args().any(|argument| argument == "--all") {
                not_yet.iter().for_each(|fault| eprintln!("{fault}"));
            }
            if !faults.is_empty() {
                bail!("the checks found:\n  {}", faults.join("\n  "));
            }
            eprintln!("all checks passed; those that are postponed found {} faults", not_yet.len());
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
