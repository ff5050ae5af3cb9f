//! The checks of the project: `cargo xtask floors` and `cargo xtask ci`.

mod ci;
mod floors;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, bail};

const USAGE: &str = "\
usage: cargo xtask COMMAND
  floors [--all]    check dependencies, file sizes, signatures, comments and the tables of
                    ARCHITECTURE.md; --all also lists what the checks that are postponed find
  ci [--nightly]    run all steps of continuous integration, in order; with --nightly the long tests too";

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
        ["floors"] | ["floors", "--all"] => {
            let floors::Findings { faults, not_yet } = floors::check(&root)?;
            if arguments.len() > 1 {
                not_yet.iter().for_each(|fault| eprintln!("{fault}"));
            }
            if !faults.is_empty() {
                bail!("the checks found:\n  {}", faults.join("\n  "));
            }
            eprintln!("all checks passed; those that are postponed found {} faults", not_yet.len());
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
