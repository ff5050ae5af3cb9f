//! Few files outside a solver's folders name the solver.
//!
//! ARCHITECTURE.md has a table with the header `| solver | own folders | files that name it |`. Its
//! first cell gives the solver's name in scene files (`mass-spring`), and further names that belong
//! to this solver alone. The second cell gives the folders or files of the solver, the third all
//! other files that name it: those that register it. The check searches the sources in
//! [`SEARCHED`], without comments and tests, and compares the list.
//!
//! A name is found in every spelling: `mass-spring`, `mass_spring`, `MassSpring`,
//! `MassSpringParams`.

use std::collections::BTreeSet;
use std::path::Path;

use anyhow::bail;

use super::files::{self, File};
use super::source::{self, Kind};

/// The most files outside its folders that may name a solver.
const MOST_FILES: usize = 4;

/// The folders in which the check looks for names of solvers. Experiments and the command line
/// compare solvers and may name them.
const SEARCHED: [&str; 3] = ["crates/forelock-core/src", "crates/forelock-gpu/src", "crates/forelock/src"];

/// A row of the table.
#[derive(Debug, PartialEq)]
struct Solver {
    /// The name in scene files, then further names that belong to the solver alone.
    names: Vec<String>,
    folders: Vec<String>,
    registry: BTreeSet<String>,
}

/// All differences between the table of solvers and the files that name them, a sentence each.
///
/// # Errors
/// If ARCHITECTURE.md has no table of solvers, or a file cannot be read.
pub fn solver_files(root: &Path) -> anyhow::Result<Vec<String>> {
    let solvers = read_solvers(&files::architecture(root)?)?;
    let mut files = Vec::new();
    for folder in SEARCHED {
        if root.join(folder).is_dir() {
            files::collect(root, folder, &["rs", "wgsl"], &mut files)?;
        }
    }
    let mut faults = Vec::new();
    for solver in &solvers {
        for folder in solver.folders.iter().filter(|folder| !root.join(folder).exists()) {
            faults
                .push(format!("ARCHITECTURE.md: {folder} of the solver {} does not exist", solver.names[0]));
        }
        check_solver(solver, &files, &mut faults);
    }
    Ok(faults)
}

fn check_solver(solver: &Solver, files: &[File], faults: &mut Vec<String>) {
    let name = &solver.names[0];
    let is_own = |path: &str| {
        solver.folders.iter().any(|folder| {
            path.strip_prefix(folder.as_str()).is_some_and(|rest| rest.is_empty() || rest.starts_with('/'))
        })
    };
    let is_test = |path: &str| path.ends_with("/tests.rs") || path.contains("/tests/");
    let mut naming = BTreeSet::new();
    for file in files.iter().filter(|file| !is_own(&file.path) && !is_test(&file.path)) {
        if let Some(line) = solver.names.iter().filter_map(|name| first_line(&file.text, name)).min() {
            naming.insert(file.path.clone());
            if !solver.registry.contains(&file.path) {
                faults.push(format!(
                    "{}:{line} names the solver {name}, which ARCHITECTURE.md does not list; move the line into \
                     the solver's folder",
                    file.path
                ));
            }
        }
    }
    for path in solver.registry.difference(&naming) {
        faults
            .push(format!("ARCHITECTURE.md: {path} does not name the solver {name}; remove it from the row"));
    }
    if naming.len() > MOST_FILES {
        faults.push(format!(
            "{} files outside its folders name the solver {name}, {MOST_FILES} are allowed",
            naming.len()
        ));
    }
}

/// The rows `| `name`, `name` | folders | files |`.
fn read_solvers(text: &str) -> anyhow::Result<Vec<Solver>> {
    let mut solvers = Vec::new();
    for row in files::table(text, &["solver", "own folders", "files that name it"]) {
        let [names, folders, registry, ..] = &row[..] else {
            bail!("ARCHITECTURE.md: a solver without folders: {row:?}")
        };
        let names = files::quoted(names);
        if names.is_empty() {
            bail!("ARCHITECTURE.md: a solver without a name in back-quotes: {row:?}");
        }
        solvers.push(Solver {
            names,
            folders: files::quoted(folders),
            registry: files::quoted(registry).into_iter().collect(),
        });
    }
    if solvers.is_empty() {
        bail!("ARCHITECTURE.md has no table with the header `| solver | own folders | files that name it |`");
    }
    Ok(solvers)
}

/// The first line of `text`, outside comments and tests, that holds `name` in any spelling.
fn first_line(text: &str, name: &str) -> Option<usize> {
    let wanted: Vec<&str> = name.split('-').collect();
    let code = source::mask(text, &[Kind::Code, Kind::Literal]);
    // The tests of a file come last.
    let end = code.find("#[cfg(test)]\nmod ").unwrap_or(code.len());
    for (index, line) in code[..end].lines().enumerate() {
        let names = line.split(|c: char| !source::is_name(c) && c != '-');
        for parts in names.map(parts) {
            if parts.windows(wanted.len()).any(|window| window == wanted) {
                return Some(index + 1);
            }
        }
    }
    None
}

/// The parts of a name in lower case: `MassSpring2`, `mass_spring2` and `mass-spring2` are `mass`,
/// `spring2`.
fn parts(name: &str) -> Vec<String> {
    let mut parts = vec![String::new()];
    let mut after_lower = false;
    for c in name.chars() {
        let is_break = matches!(c, '_' | '-');
        if (is_break || (c.is_uppercase() && after_lower))
            && parts.last().is_some_and(|part| !part.is_empty())
        {
            parts.push(String::new());
        }
        if let Some(last) = parts.last_mut().filter(|_| !is_break) {
            last.extend(c.to_lowercase());
        }
        after_lower = c.is_lowercase() || c.is_numeric();
    }
    parts
}

#[cfg(test)]
mod tests;
