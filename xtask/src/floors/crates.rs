//! Crates depend only on crates of lower floors.
//!
//! The table of crates in ARCHITECTURE.md states the folder and the floor of each crate. A crate
//! may depend only on crates of lower floors, in its tests too, and on no external crate that its
//! floor forbids ([`FORBIDDEN`]). Tests may use any external crate.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use anyhow::{Context, bail};
use toml::{Table, Value};

use super::files;

/// For a floor and all floors below it: the reason, and the external crates that are forbidden
/// there. A name stands for all crates that start with it: `burn` for `burn-core`.
const FORBIDDEN: [(u32, &str, &[&str]); 3] = [
    (
        0,
        "the core does not depend on file formats",
        &["toml", "serde_json", "png", "image", "flate2", "zip", "gltf", "tobj"],
    ),
    (
        1,
        "file formats and CPU solvers do not depend on a GPU, a learning framework or a window",
        &["wgpu", "naga", "burn", "cubecl", "winit", "eframe", "egui"],
    ),
    (
        4,
        "libraries do not depend on a command line and have named error types",
        &["clap", "indicatif", "ctrlc", "anyhow", "miette", "eyre"],
    ),
];

/// Crates whose purpose is an external crate that their floor forbids.
const EXCEPT: [(&str, &[&str]); 1] = [("forelock-gpu", &["wgpu", "naga"])];

/// The tables of a manifest that list dependencies, and whether they are for tests only.
const KINDS: [(&str, bool); 3] =
    [("dependencies", false), ("build-dependencies", false), ("dev-dependencies", true)];

/// A crate of the workspace.
#[derive(Debug)]
struct Crate {
    folder: String,
    inherits_lints: bool,
    dependencies: Vec<Dependency>,
}

/// A package that a crate depends on.
#[derive(Debug)]
struct Dependency {
    package: String,
    for_tests: bool,
}

/// A row of the table of crates.
#[derive(Debug, PartialEq)]
struct Place {
    folder: String,
    floor: u32,
}

/// All faults of the manifests and the table of crates, a sentence each.
///
/// # Errors
/// If a manifest or ARCHITECTURE.md cannot be read.
pub fn check(root: &Path) -> anyhow::Result<Vec<String>> {
    let map = read_map(&files::architecture(root)?)?;
    let crates = read_crates(root)?;
    let mut faults = Vec::new();
    for name in map.keys().filter(|name| !crates.contains_key(*name)) {
        faults.push(format!("ARCHITECTURE.md lists {name}, but the workspace has no such crate"));
    }
    for (name, krate) in &crates {
        match map.get(name) {
            Some(place) if place.folder == krate.folder => {
                check_crate(name, krate, place.floor, &map, &mut faults)
            }
            Some(place) => faults.push(format!(
                "{name} is in {}, not in {} as ARCHITECTURE.md says",
                krate.folder, place.folder
            )),
            None => faults.push(format!("{name} ({}) is not in the table of ARCHITECTURE.md", krate.folder)),
        }
    }
    Ok(faults)
}

fn check_crate(
    name: &str,
    krate: &Crate,
    floor: u32,
    map: &BTreeMap<String, Place>,
    faults: &mut Vec<String>,
) {
    if !krate.inherits_lints {
        faults.push(format!("{name} does not inherit the workspace's lints"));
    }
    for Dependency { package, for_tests } in &krate.dependencies {
        if let Some(place) = map.get(package) {
            if place.floor >= floor {
                faults.push(format!(
                    "{name} (floor {floor}) depends on {package} (floor {}); a crate may depend only on lower floors",
                    place.floor
                ));
            }
            continue;
        }
        for (highest, reason, families) in FORBIDDEN {
            let belongs = |family: &&str| {
                let rest = package.strip_prefix(*family);
                rest.is_some_and(|rest| rest.is_empty() || rest.starts_with(['-', '_']))
            };
            let excepted = EXCEPT.iter().any(|(own, families)| *own == name && families.iter().any(belongs));
            if floor <= highest && !for_tests && !excepted && families.iter().any(belongs) {
                faults.push(format!("{name} (floor {floor}) depends on {package}: {reason}"));
            }
        }
    }
}

/// The rows `| [`name`](folder) | floor | … |` of ARCHITECTURE.md.
fn read_map(text: &str) -> anyhow::Result<BTreeMap<String, Place>> {
    let mut map = BTreeMap::new();
    for line in text.lines() {
        let Some((name, rest)) = line.strip_prefix("| [`").and_then(|row| row.split_once("`](")) else {
            continue;
        };
        let cells =
            rest.split_once(") | ").and_then(|(folder, rest)| Some((folder, rest.split_once(" |")?.0)));
        let (folder, floor) =
            cells.with_context(|| format!("ARCHITECTURE.md: this row has no floor: {line}"))?;
        let floor = floor.trim().parse().with_context(|| format!("ARCHITECTURE.md: the floor of {name}"))?;
        map.insert(name.to_owned(), Place { folder: folder.to_owned(), floor });
    }
    if map.is_empty() {
        bail!("ARCHITECTURE.md has no table of crates");
    }
    Ok(map)
}

/// The crates of the workspace by name.
fn read_crates(root: &Path) -> anyhow::Result<BTreeMap<String, Crate>> {
    let manifest = read_toml(&root.join("Cargo.toml"))?;
    let workspace =
        manifest.get("workspace").and_then(Value::as_table).context("Cargo.toml has no [workspace]")?;
    let shared = workspace.get("dependencies").and_then(Value::as_table);
    let members = workspace.get("members").and_then(Value::as_array).context("[workspace] has no members")?;
    let mut crates = BTreeMap::new();
    for member in members.iter().filter_map(Value::as_str) {
        for folder in expand(root, member)? {
            let manifest = read_toml(&root.join(&folder).join("Cargo.toml"))?;
            let package = manifest.get("package").and_then(Value::as_table);
            let name = package.and_then(|package| package.get("name")?.as_str());
            let name = name.with_context(|| format!("{folder}/Cargo.toml names no package"))?.to_owned();
            let lints = manifest.get("lints").and_then(|lints| lints.get("workspace"));
            let inherits_lints = lints.and_then(Value::as_bool) == Some(true);
            crates.insert(
                name,
                Crate { folder, inherits_lints, dependencies: dependencies(&manifest, shared) },
            );
        }
    }
    Ok(crates)
}

/// The folders that an entry of `members` stands for, which may end in `/*`.
fn expand(root: &Path, member: &str) -> anyhow::Result<Vec<String>> {
    let Some(parent) = member.strip_suffix("/*") else { return Ok(vec![member.to_owned()]) };
    let mut folders = Vec::new();
    for entry in fs::read_dir(root.join(parent)).with_context(|| parent.to_owned())? {
        let entry = entry?;
        if entry.path().join("Cargo.toml").is_file() {
            folders.push(format!("{parent}/{}", entry.file_name().to_string_lossy()));
        }
    }
    Ok(folders)
}

fn read_toml(path: &Path) -> anyhow::Result<Table> {
    let text = fs::read_to_string(path).with_context(|| path.display().to_string())?;
    text.parse().with_context(|| path.display().to_string())
}

/// The packages that `manifest` depends on, on any platform, by the names of the packages
/// themselves. `shared` is the table `[workspace.dependencies]`.
fn dependencies(manifest: &Table, shared: Option<&Table>) -> Vec<Dependency> {
    let targets = manifest.get("target").and_then(Value::as_table);
    let targets = targets.into_iter().flat_map(|targets| targets.values().filter_map(Value::as_table));
    let mut found = Vec::new();
    for table in std::iter::once(manifest).chain(targets) {
        for (kind, for_tests) in KINDS {
            let Some(dependencies) = table.get(kind).and_then(Value::as_table) else { continue };
            for (key, value) in dependencies {
                let inherited = value.get("workspace").and_then(Value::as_bool) == Some(true);
                let value = if inherited { shared.and_then(|shared| shared.get(key)) } else { Some(value) };
                let package = value.and_then(|value| value.get("package")?.as_str());
                found.push(Dependency { package: package.unwrap_or(key).to_owned(), for_tests });
            }
        }
    }
    found
}

#[cfg(test)]
mod tests;
