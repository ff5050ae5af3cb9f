//! Dependencies go down, and the map is true.
//!
//! The table of crates in ARCHITECTURE.md states each crate's folder and floor. A crate may depend only on crates of
//! lower floors, for tests too, and on no outside crate that its floor forbids ([`FORBIDDEN`]); what tests alone use
//! from outside is free.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use anyhow::{Context, bail};
use toml::{Table, Value};

/// Outside crates that crates of a floor and of those below it may not use, and why. A name stands for its family too:
/// `burn` for `burn-core`.
const FORBIDDEN: [(u32, &str, &[&str]); 3] = [
    (
        0,
        "the core knows no file format",
        &["toml", "serde_json", "png", "image", "flate2", "zip", "gltf", "tobj"],
    ),
    (
        1,
        "files and the CPU's solvers know no GPU, learning or window",
        &["wgpu", "naga", "burn", "cubecl", "winit", "eframe", "egui"],
    ),
    (
        4,
        "libraries know no command line and name their errors",
        &["clap", "indicatif", "ctrlc", "anyhow", "miette", "eyre"],
    ),
];

/// Crates that are there to know what their floor may not.
const EXCEPT: [(&str, &[&str]); 1] = [("forelock-gpu", &["wgpu", "naga"])];

/// The tables of a manifest that name dependencies; whether they are for tests alone.
const KINDS: [(&str, bool); 3] =
    [("dependencies", false), ("build-dependencies", false), ("dev-dependencies", true)];

/// A crate of the workspace.
#[derive(Debug)]
struct Crate {
    folder: String,
    inherits_lints: bool,
    /// Package names, and whether only tests need them.
    dependencies: Vec<(String, bool)>,
}

/// A row of the map.
#[derive(Debug, PartialEq)]
struct Place {
    folder: String,
    floor: u32,
}

/// All that is wrong in the workspace at `root`, a sentence each.
///
/// # Errors
/// If a manifest or the map cannot be read.
pub fn check(root: &Path) -> anyhow::Result<Vec<String>> {
    let map_path = root.join("ARCHITECTURE.md");
    let map = read_map(&fs::read_to_string(&map_path).with_context(|| map_path.display().to_string())?)?;
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
    for (dependency, for_tests) in &krate.dependencies {
        if let Some(place) = map.get(dependency) {
            if place.floor >= floor {
                faults.push(format!(
                    "{name} (floor {floor}) depends on {dependency} (floor {}): arrows go down only",
                    place.floor
                ));
            }
            continue;
        }
        for (highest, reason, families) in FORBIDDEN {
            let belongs = |family: &&str| {
                let rest = dependency.strip_prefix(*family);
                rest.is_some_and(|rest| rest.is_empty() || rest.starts_with(['-', '_']))
            };
            let excepted = EXCEPT.iter().any(|(own, families)| *own == name && families.iter().any(belongs));
            if floor <= highest && !for_tests && !excepted && families.iter().any(belongs) {
                faults.push(format!("{name} (floor {floor}) depends on {dependency}: {reason}"));
            }
        }
    }
}

/// The rows `| [`name`](folder) | floor | … |` of the map.
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

/// The members of the workspace by name.
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

/// The folders that a member's path, which may end in `/*`, stands for.
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

/// The packages that `manifest` depends on, on any platform, under their own names; `shared` are the workspace's.
fn dependencies(manifest: &Table, shared: Option<&Table>) -> Vec<(String, bool)> {
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
                found.push((package.unwrap_or(key).to_owned(), for_tests));
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    const MAP: &str = "| [`low`](crates/low) | 0 | below |\n| [`high`](crates/high) | 3 | above |\n";
    const LINTS: &str = "[lints]\nworkspace = true\n";

    /// A workspace of two crates with these manifests' ends and this map.
    fn faults(map: &str, low: &str, high: &str) -> anyhow::Result<Vec<String>> {
        let root = tempfile::tempdir()?;
        let shared = "[workspace.dependencies]\ngpu = { package = \"wgpu\", version = \"29\" }\n";
        fs::write(
            root.path().join("Cargo.toml"),
            format!("[workspace]\nmembers = [\"crates/*\"]\n{shared}"),
        )?;
        fs::write(root.path().join("ARCHITECTURE.md"), map)?;
        for (name, rest) in [("low", low), ("high", high)] {
            let folder = root.path().join("crates").join(name);
            fs::create_dir_all(&folder)?;
            fs::write(folder.join("Cargo.toml"), format!("[package]\nname = \"{name}\"\n{rest}"))?;
        }
        check(root.path())
    }

    #[test]
    fn this_workspace_holds() -> anyhow::Result<()> {
        assert_eq!(check(&crate::root()?)?, Vec::<String>::new());
        Ok(())
    }

    #[test]
    fn arrows_down_are_free() -> anyhow::Result<()> {
        let high = format!("{LINTS}[dependencies]\nlow.workspace = true\nwgpu = \"29\"\n");
        let low = format!("{LINTS}[dev-dependencies]\ntoml = \"1\"\n");
        assert_eq!(faults(MAP, &low, &high)?, Vec::<String>::new());
        Ok(())
    }

    #[test]
    fn arrows_up_are_refused_of_every_kind() -> anyhow::Result<()> {
        for kind in
            ["dependencies", "dev-dependencies", "build-dependencies", "target.'cfg(unix)'.dependencies"]
        {
            let found = faults(MAP, &format!("{LINTS}[{kind}]\nhigh = {{ path = \"../high\" }}\n"), LINTS)?;
            assert!(
                matches!(&found[..], [one] if one.contains("low") && one.contains("high")),
                "{kind}: {found:?}"
            );
        }
        Ok(())
    }

    #[test]
    fn forbidden_families_are_found_under_any_name() -> anyhow::Result<()> {
        for (line, package) in [
            ("wgpu = \"29\"", "wgpu"),
            ("burn-core = \"1\"", "burn-core"),
            ("x = { package = \"clap\", version = \"4\" }", "clap"),
            ("gpu.workspace = true", "wgpu"),
        ] {
            let found = faults(MAP, &format!("{LINTS}[dependencies]\n{line}\n"), LINTS)?;
            assert!(
                matches!(&found[..], [one] if one.contains(&format!("on {package}:"))),
                "{line}: {found:?}"
            );
        }
        assert!(faults(MAP, &format!("{LINTS}[dependencies]\nburnish = \"1\"\n"), LINTS)?.is_empty());
        Ok(())
    }

    #[test]
    fn the_map_and_the_workspace_agree() -> anyhow::Result<()> {
        let only_low = "| [`low`](crates/low) | 0 | below |\n";
        assert!(faults(only_low, LINTS, LINTS)?[0].contains("high (crates/high) is not in the table"));
        let more = format!("{MAP}| [`ghost`](crates/ghost) | 1 | gone |\n");
        assert!(faults(&more, LINTS, LINTS)?[0].contains("lists ghost"));
        assert!(
            faults(&MAP.replace("crates/high", "apps/high"), LINTS, LINTS)?[0].contains("not in apps/high")
        );
        assert!(faults(MAP, "", LINTS)?[0].contains("lints"));
        assert!(faults("no table", LINTS, LINTS).is_err());
        Ok(())
    }
}
