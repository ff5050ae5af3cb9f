//! What continuous integration runs, in its order; the first step that fails ends it.
//!
//! Every step uses the release profile, so that build scripts and procedural macros are compiled
//! once for all. The README's test command runs in tiers ([`TIERS`]). Each tier is a choice of
//! tests of the whole workspace, so that no crate is compiled a second time with other features.

use std::io::{BufRead, BufReader, Write as _};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Instant;

use anyhow::{Context, ensure};

/// Names of the steps before the tests, and their arguments to cargo.
const CHECKS: [(&str, &str); 5] = [
    ("lock file", "fetch --locked"),
    ("format", "fmt --all --check"),
    ("floors", "xtask floors"),
    ("lints", "clippy --release --workspace --all-targets -- -D warnings"),
    ("documents", "doc --release --workspace --no-deps"),
];

/// The README's test command.
const TEST: &str = "test --release --workspace";

/// A part of the tests.
#[derive(Debug)]
struct Tier {
    name: &'static str,
    /// Arguments to cargo after [`TEST`].
    arguments: &'static str,
    /// Fewer tests than this that pass are an error.
    at_least: usize,
}

/// All tests that are not ignored, each in one tier. Tests that need a GPU are in a module `gpu`.
const TIERS: [Tier; 5] = [
    Tier { name: "unit", arguments: "--lib --bins", at_least: 250 },
    Tier {
        name: "CPU",
        arguments: "--test it --test allocations --test random_input -- --skip gpu::",
        at_least: 222,
    },
    Tier { name: "GPU", arguments: "--test it --test cli -- gpu::", at_least: 60 },
    Tier { name: "command", arguments: "--test cli -- --skip gpu::", at_least: 27 },
    Tier { name: "documentation", arguments: "--doc", at_least: 17 },
];

/// Long tests: their names begin with `long_`, and they are ignored in all other tiers.
const NIGHTLY: Tier =
    Tier { name: "long", arguments: "--lib --bins --tests -- --ignored long_", at_least: 5 };

/// What a step took.
#[derive(Debug, Default)]
struct Done {
    secs: f64,
    passed: usize,
    ignored: usize,
}

/// Runs all steps in `root`, with `nightly` the long tests as well, and prints the time of each.
pub fn run(root: &Path, nightly: bool) -> anyhow::Result<()> {
    let mut lines = Vec::new();
    let build = format!("{TEST} --no-run");
    for (name, arguments) in CHECKS.into_iter().chain([("build of all tests", &*build)]) {
        lines.push(format!("{name:>18} {:>6.0} s", cargo(root, name, arguments)?.secs));
    }
    for tier in TIERS.iter().chain(nightly.then_some(&NIGHTLY)) {
        let done = cargo(root, tier.name, &format!("{TEST} {}", tier.arguments))?;
        let Done { secs, passed, ignored } = done;
        lines.push(format!("{:>18} {secs:>6.0} s  {passed} tests passed, {ignored} ignored", tier.name));
        ensure!(
            passed >= tier.at_least,
            "── {passed} tests of the tier {} passed, where there should be {} at least",
            tier.name,
            tier.at_least
        );
    }
    eprintln!("── all passed\n{}", lines.join("\n"));
    Ok(())
}

/// Runs cargo, shows what it prints, and counts tests.
fn cargo(root: &Path, name: &str, arguments: &str) -> anyhow::Result<Done> {
    eprintln!("── {name}: cargo {arguments}");
    let started = Instant::now();
    let mut command = Command::new("cargo");
    command.args(arguments.split(' ')).env("RUSTDOCFLAGS", "-D warnings").current_dir(root);
    let mut child = command.stdout(Stdio::piped()).spawn().context("cargo cannot be started")?;
    let mut done = Done::default();
    for line in child.stdout.take().map(BufReader::new).into_iter().flat_map(BufRead::lines) {
        let line = line.context("what cargo prints cannot be read")?;
        done.passed += count(&line, " passed");
        done.ignored += count(&line, " ignored");
        // To standard output, where cargo wrote it.
        writeln!(std::io::stdout(), "{line}").context("standard output is closed")?;
    }
    let status = child.wait().context("cargo cannot be waited for")?;
    done.secs = started.elapsed().as_secs_f64();
    ensure!(status.success(), "── {name} failed after {:.0} s: cargo {arguments}", done.secs);
    Ok(done)
}

/// The number before `what` in a line that ends a program of tests, 0 in any other line.
fn count(line: &str, what: &str) -> usize {
    let Some(result) = line.strip_prefix("test result: ") else { return 0 };
    let before = result.split_once(what).map_or("", |(before, _)| before);
    before.rsplit(' ').next().and_then(|number| number.parse().ok()).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;
    use std::path::PathBuf;

    #[test]
    fn the_tiers_are_the_readme_s_test_command() -> anyhow::Result<()> {
        let readme = fs::read_to_string(crate::root()?.join("README.md"))?;
        assert!(readme.lines().any(|line| line.trim() == format!("cargo {TEST}")), "{TEST}");
        Ok(())
    }

    #[test]
    fn results_are_counted() {
        let line = "test result: ok. 12 passed; 0 failed; 3 ignored; 0 measured; 1 filtered out";
        assert_eq!((count(line, " passed"), count(line, " ignored")), (12, 3));
        assert_eq!(count("12 passed", " passed"), 0);
    }

    /// All Rust files of the members' tests and sources.
    fn sources() -> anyhow::Result<Vec<PathBuf>> {
        let root = crate::root()?;
        let (mut folders, mut files) = (vec![root.join("crates"), root.join("apps")], Vec::new());
        while let Some(folder) = folders.pop() {
            for entry in fs::read_dir(folder)? {
                let path = entry?.path();
                if path.is_dir() {
                    folders.push(path);
                } else if path.extension().is_some_and(|ending| ending == "rs") {
                    files.push(path);
                }
            }
        }
        Ok(files)
    }

    /// A test program with another name than those of the tiers would be left out.
    #[test]
    fn every_test_program_is_in_a_tier() -> anyhow::Result<()> {
        let mut programs = 0;
        for path in sources()? {
            let parts: Vec<_> = path.iter().map(|part| part.to_string_lossy()).collect();
            let [.., a, b, c] = &parts[..] else { continue };
            let program = if b == "tests" { Some(c.trim_end_matches(".rs")) } else { None };
            let program = program.or((a == "tests" && c == "main.rs").then_some(&**b));
            programs += usize::from(program.is_some());
            let known = ["it", "allocations", "random_input"];
            let is_known = program.is_none_or(|name| known.contains(&name));
            // Modules of unit tests are in folders of that name too.
            assert!(is_known || parts.iter().any(|part| part == "src"), "{}", path.display());
        }
        assert!(programs > 5, "{programs}");
        Ok(())
    }

    #[test]
    fn long_tests_are_named_so() -> anyhow::Result<()> {
        let mut long = 0;
        for path in sources()? {
            let text = fs::read_to_string(&path)?;
            let lines: Vec<&str> = text.lines().map(str::trim).collect();
            for (number, line) in lines.iter().enumerate() {
                if line.starts_with("fn long_") {
                    long += 1;
                    let marks = &lines[number.saturating_sub(4)..number];
                    let mark = "#[ignore = \"long: cargo xtask ci --nightly\"]";
                    assert!(marks.contains(&mark), "{}: {line}", path.display());
                }
                if line.starts_with("#[ignore = \"long") {
                    let is_named = lines[number..].iter().take(4).any(|line| line.starts_with("fn long_"));
                    assert!(is_named, "{}, line {}", path.display(), number + 1);
                }
            }
        }
        assert!(long >= NIGHTLY.at_least, "{long}");
        Ok(())
    }
}
