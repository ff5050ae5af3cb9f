//! The modules of the core use only modules of lower floors.
//!
//! The table of ARCHITECTURE.md with the header `| core module | floor |` gives the floor of each
//! top-level module. A path that starts with `crate::`, or with enough `super::` to leave the
//! top-level module, is a use of the module that it names next. A module may use modules of lower
//! floors and itself.
//!
//! Items behind `#[cfg(test)]` may use every module. Comments, and so links in documentation, are
//! not read, and macros (`crate::name!`) belong to no module.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use anyhow::{Context, bail};

use super::files::{self, File};
use super::source::{self, Kind, Token};

/// The folder of the core's sources.
const CORE: &str = "crates/forelock-core/src";

/// A path to a module from the root of the crate.
#[derive(Debug, PartialEq)]
struct Use {
    module: String,
    /// The byte of the code at which the module's name starts.
    at: usize,
}

/// All uses of a module on the same or a higher floor, a sentence each.
///
/// # Errors
/// If ARCHITECTURE.md has no table of the core's modules, or a file cannot be read.
pub fn check(root: &Path) -> anyhow::Result<Vec<String>> {
    let floors = read_floors(&files::architecture(root)?)?;
    let mut files = Vec::new();
    files::collect(root, CORE, &["rs"], &mut files)?;
    files.sort_by(|a, b| a.path.cmp(&b.path));
    let modules: BTreeSet<String> =
        files.iter().filter_map(|file| module_path(&file.path).into_iter().next()).collect();
    let mut faults = Vec::new();
    for name in floors.keys().filter(|name| !modules.contains(*name)) {
        faults.push(format!("ARCHITECTURE.md lists the core module {name}, which does not exist"));
    }
    for name in modules.iter().filter(|name| !floors.contains_key(*name)) {
        faults.push(format!("the core module {name} is not in the table of ARCHITECTURE.md"));
    }
    let tests = test_modules(&files);
    for file in &files {
        let path = module_path(&file.path);
        let is_test = (1..=path.len()).any(|length| tests.contains(&path[..length].join("::")));
        if !is_test {
            check_file(file, &path, &floors, &mut faults);
        }
    }
    Ok(faults)
}

fn check_file(file: &File, path: &[String], floors: &BTreeMap<String, u32>, faults: &mut Vec<String>) {
    let Some((module, &floor)) = path.first().and_then(|module| floors.get_key_value(module)) else { return };
    let code = source::mask(&file.text, &[Kind::Code]);
    for used in uses(&source::tokens(&code), path.len()) {
        let place = format!("{}:{}", file.path, source::line(&code, used.at));
        match floors.get(&used.module) {
            _ if used.module == *module => {}
            Some(&other) if other < floor => {}
            Some(&other) => faults.push(format!(
                "{place}: {module} (floor {floor}) uses {} (floor {other}); a module may use only lower floors",
                used.module
            )),
            None => faults.push(format!(
                "{place}: {module} uses crate::{}, which is no module of the table in ARCHITECTURE.md; \
                 write the path of the module that defines it",
                used.module
            )),
        }
    }
}

/// The rows `| `name` | floor | … |`.
fn read_floors(text: &str) -> anyhow::Result<BTreeMap<String, u32>> {
    let mut floors = BTreeMap::new();
    for row in files::table(text, &["core module", "floor"]) {
        let [modules, floor, ..] = &row[..] else { bail!("ARCHITECTURE.md: a row without a floor: {row:?}") };
        let floor = floor.parse().with_context(|| format!("ARCHITECTURE.md: the floor of {modules}"))?;
        floors.extend(files::quoted(modules).into_iter().map(|module| (module, floor)));
    }
    if floors.is_empty() {
        bail!("ARCHITECTURE.md has no table with the header `| core module | floor |`");
    }
    Ok(floors)
}

/// The names of the modules from the root of the crate to the file at `path`. Empty for `lib.rs`.
fn module_path(path: &str) -> Vec<String> {
    let inner = path.strip_prefix(CORE).unwrap_or(path).trim_start_matches('/');
    let inner = inner.strip_suffix(".rs").unwrap_or(inner);
    let mut names: Vec<String> = inner.split('/').map(str::to_owned).collect();
    if names.last().is_some_and(|last| last == "mod" || (names.len() == 1 && last == "lib")) {
        names.pop();
    }
    names
}

/// The paths of modules in separate files that are declared behind `#[cfg(test)]`.
fn test_modules(files: &[File]) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    for file in files {
        let code = source::mask(&file.text, &[Kind::Code]);
        let tokens = source::tokens(&code);
        for start in 0..tokens.len() {
            if !is_test_attribute(&tokens, start) {
                continue;
            }
            let end = item_end(&tokens, start);
            let name =
                tokens[start..end].windows(3).find(|window| window[0].text == "mod" && window[2].text == ";");
            if let Some(window) = name {
                let mut path = module_path(&file.path);
                path.push(window[1].text.to_owned());
                found.insert(path.join("::"));
            }
        }
    }
    found
}

/// The modules used outside tests by a file that lies `depth` modules below the root of the crate.
fn uses(tokens: &[Token], depth: usize) -> Vec<Use> {
    let mut found = Vec::new();
    // How many braces are open, and how many were open where each inline module began.
    let mut open = 0;
    let mut inline = Vec::new();
    let mut index = 0;
    while index < tokens.len() {
        if is_test_attribute(tokens, index) {
            index = item_end(tokens, index);
            continue;
        }
        match tokens[index].text {
            "mod" if tokens.get(index + 2).is_some_and(|token| token.text == "{") => inline.push(open),
            "{" => open += 1,
            "}" => {
                open -= 1;
                if inline.last() == Some(&open) {
                    inline.pop();
                }
            }
            "crate" | "super" if is_path(tokens, index) => {
                index = read_path(tokens, index, depth + inline.len(), &mut found);
                continue;
            }
            _ => {}
        }
        index += 1;
    }
    found
}

fn is_path(tokens: &[Token], index: usize) -> bool {
    tokens.get(index + 1).is_some_and(|token| token.text == "::")
}

/// Reads the path or the tree of a `use` at `index`, relative to a module `depth` below the root.
/// Returns the index after it.
fn read_path(tokens: &[Token], mut index: usize, mut depth: usize, found: &mut Vec<Use>) -> usize {
    while let Some(token) = tokens.get(index) {
        match token.text {
            "crate" if is_path(tokens, index) => depth = 0,
            "super" if is_path(tokens, index) => depth = depth.saturating_sub(1),
            "self" if is_path(tokens, index) => {}
            "{" => {
                let end = source::closing(tokens, index);
                index += 1;
                while index < end {
                    index = read_path(tokens, index, depth, found);
                    while index < end && tokens[index].text != "," {
                        index += 1;
                    }
                    index += 1;
                }
                return end + 1;
            }
            name => {
                let is_macro = tokens.get(index + 1).is_some_and(|token| token.text == "!");
                let names_module = name == "*" || name.starts_with(source::is_name);
                if depth == 0 && names_module && !is_macro {
                    found.push(Use { module: name.to_owned(), at: token.at });
                }
                return skip_rest(tokens, index);
            }
        }
        index += 2;
    }
    index
}

/// The index after the names `a::b::{…}` at `index`. Inside a `use` tree these belong to one
/// module.
fn skip_rest(tokens: &[Token], mut index: usize) -> usize {
    while is_path(tokens, index) {
        index += 2;
    }
    match tokens.get(index) {
        Some(token) if token.text == "{" && index > 0 && tokens[index - 1].text == "::" => {
            source::closing(tokens, index) + 1
        }
        _ => index + 1,
    }
}

/// Whether `#[cfg(test)]`, or `#[cfg(all(test, …))]`, starts at `index`.
fn is_test_attribute(tokens: &[Token], index: usize) -> bool {
    let starts = |words: &[&str]| {
        let texts = tokens[index..].iter().map(|token| token.text);
        tokens.len() - index >= words.len() && texts.zip(words).all(|(text, &word)| text == word)
    };
    starts(&["#", "[", "cfg", "(", "test", ")"]) || starts(&["#", "[", "cfg", "(", "all", "(", "test", ","])
}

/// The index after the item whose first attribute starts at `index`.
fn item_end(tokens: &[Token], mut index: usize) -> usize {
    while let Some(token) = tokens.get(index) {
        match token.text {
            ";" => return index + 1,
            "{" => return source::closing(tokens, index) + 1,
            "(" | "[" => index = source::closing(tokens, index) + 1,
            _ => index += 1,
        }
    }
    index
}

#[cfg(test)]
mod tests;
