//! Finds the files that are checked, and the tables of ARCHITECTURE.md.

use std::fs;
use std::path::Path;

use anyhow::Context;

/// The folders of the repository that hold source files.
const FOLDERS: [&str; 4] = ["crates", "apps", "bindings", "xtask"];

/// A text file of the repository.
#[derive(Debug)]
pub struct File {
    /// The path relative to the repository, with `/` between its parts.
    pub path: String,
    pub text: String,
}

impl File {
    /// The part of the file name after the last dot.
    pub fn ending(&self) -> &str {
        self.path.rsplit_once('.').map_or("", |(_, ending)| ending)
    }
}

/// The `.rs` and `.wgsl` files of all crates, sorted by path.
///
/// # Errors
/// If a folder or file cannot be read.
pub fn sources(root: &Path) -> anyhow::Result<Vec<File>> {
    let mut found = Vec::new();
    for folder in FOLDERS {
        if root.join(folder).is_dir() {
            collect(root, folder, &["rs", "wgsl"], &mut found)?;
        }
    }
    found.sort_by(|a, b| a.path.cmp(&b.path));
    Ok(found)
}

/// Adds the files below `folder` whose names end in one of `endings`. Hidden folders and `target`
/// are left out.
///
/// # Errors
/// If a folder or file cannot be read.
pub fn collect(root: &Path, folder: &str, endings: &[&str], found: &mut Vec<File>) -> anyhow::Result<()> {
    for entry in fs::read_dir(root.join(folder)).with_context(|| folder.to_owned())? {
        let entry = entry?;
        let name = entry.file_name().to_string_lossy().into_owned();
        let path = format!("{folder}/{name}");
        if entry.file_type()?.is_dir() {
            if !name.starts_with('.') && name != "target" {
                collect(root, &path, endings, found)?;
            }
        } else if endings.iter().any(|ending| name.ends_with(&format!(".{ending}"))) {
            let text = fs::read_to_string(entry.path()).with_context(|| path.clone())?;
            found.push(File { path, text });
        }
    }
    Ok(())
}

/// The text of ARCHITECTURE.md.
///
/// # Errors
/// If it cannot be read.
pub fn architecture(root: &Path) -> anyhow::Result<String> {
    let path = root.join("ARCHITECTURE.md");
    fs::read_to_string(&path).with_context(|| path.display().to_string())
}

/// The rows of the first Markdown table of `text` whose header starts with the cells `header`.
///
/// Cells come without their spaces. A text without such a table gives no rows.
pub fn table(text: &str, header: &[&str]) -> Vec<Vec<String>> {
    let mut lines = text.lines().skip_while(|line| !cells(line).starts_with(&own(header)));
    lines.next();
    let rows = lines.take_while(|line| line.trim_start().starts_with('|')).map(cells);
    rows.filter(|row| !row.iter().all(|cell| cell.chars().all(|c| "-: ".contains(c)))).collect()
}

/// The words between back-quotes.
pub fn quoted(cell: &str) -> Vec<String> {
    cell.split('`').skip(1).step_by(2).map(str::to_owned).collect()
}

fn own(cells: &[&str]) -> Vec<String> {
    cells.iter().map(|&cell| cell.to_owned()).collect()
}

fn cells(line: &str) -> Vec<String> {
    let line = line.trim();
    let Some(inner) = line.strip_prefix('|') else { return Vec::new() };
    let inner = inner.strip_suffix('|').unwrap_or(inner);
    inner.split('|').map(|cell| cell.trim().to_owned()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_are_found_by_their_header() {
        let text = "| a | b |\n| --- | --- |\n| 1 | 2 |\n\n| c | d |\n| :-- | --: |\n| `x`, `y` | 4 |\nend\n| 5 | 6 |\n";
        assert_eq!(table(text, &["c"]), [own(&["`x`, `y`", "4"])]);
        assert_eq!(table(text, &["a", "b"]), [own(&["1", "2"])]);
        assert!(table(text, &["b"]).is_empty());
        assert_eq!(quoted("`x`, `y`"), ["x", "y"]);
    }

    #[test]
    fn hidden_folders_and_outputs_are_left_out() -> anyhow::Result<()> {
        let root = tempfile::tempdir()?;
        for path in
            ["crates/a/src/lib.rs", "crates/a/target/x.rs", "crates/.b/y.rs", "apps/z.txt", "xtask/k.wgsl"]
        {
            let path = root.path().join(path);
            fs::create_dir_all(path.parent().context("a folder")?)?;
            fs::write(path, "")?;
        }
        let found = sources(root.path())?;
        let paths: Vec<&str> = found.iter().map(|file| file.path.as_str()).collect();
        assert_eq!(paths, ["crates/a/src/lib.rs", "xtask/k.wgsl"]);
        assert_eq!(found[1].ending(), "wgsl");
        Ok(())
    }
}
