//! Files are at most 600 lines long, and comments and pages at most 100 columns wide.

use std::path::Path;

use super::files::{self, File};
use super::source::{self, Kind};

/// The most lines of a source file.
const MOST_LINES: usize = 600;

/// The most characters of a line with a comment, and of a line of a page of documentation.
const MOST_COLUMNS: usize = 100;

/// The source files with too many lines, a sentence each.
pub fn check_lines(files: &[File]) -> Vec<String> {
    let long = files.iter().map(|file| (file, file.text.lines().count()));
    long.filter(|(_, lines)| *lines > MOST_LINES)
        .map(|(file, lines)| {
            format!("{}: {lines} lines, {MOST_LINES} are allowed; split the file", file.path)
        })
        .collect()
}

/// The comments of source files that are too wide, a sentence each.
///
/// The width of a line includes the code before its comment. Rows of tables and lines with a web
/// address may be wider.
pub fn check_comments(files: &[File]) -> Vec<String> {
    let mut faults = Vec::new();
    for file in files {
        let comments = source::mask(&file.text, &[Kind::Comment]);
        for (index, (line, comment)) in file.text.lines().zip(comments.lines()).enumerate() {
            let words = comment.trim_start().trim_start_matches(['/', '!', '*']);
            if !comment.trim().is_empty() && is_too_wide(line, words) {
                faults.push(too_wide(&file.path, index, line));
            }
        }
    }
    faults
}

/// The lines that are too wide in Markdown pages, and in the comments of scene files and scripts, a
/// sentence each.
///
/// Rows of tables, code blocks and lines with a web address may be wider.
///
/// # Errors
/// If a folder or file cannot be read.
pub fn check_pages(root: &Path) -> anyhow::Result<Vec<String>> {
    let mut found = Vec::new();
    for folder in ["docs", "scenes", "tools"] {
        if root.join(folder).is_dir() {
            files::collect(root, folder, &["md", "toml", "sh"], &mut found)?;
        }
    }
    for name in ["README.md", "ARCHITECTURE.md", "CHANGELOG.md", "CONTRIBUTING.md", "STATUS.md"] {
        if let Ok(text) = std::fs::read_to_string(root.join(name)) {
            found.push(File { path: name.into(), text });
        }
    }
    let mut faults = Vec::new();
    for file in &found {
        let is_page = file.ending() == "md";
        let mut is_code = false;
        for (index, line) in file.text.lines().enumerate() {
            let words = line.trim_start();
            is_code ^= is_page && words.starts_with("```");
            let is_prose = if is_page { !is_code } else { line.contains('#') };
            if is_prose && is_too_wide(line, words) {
                faults.push(too_wide(&file.path, index, line));
            }
        }
    }
    Ok(faults)
}

/// Whether `line`, whose prose starts with `words`, is wider than it may be.
fn is_too_wide(line: &str, words: &str) -> bool {
    line.chars().count() > MOST_COLUMNS && !words.trim_start().starts_with('|') && !words.contains("://")
}

fn too_wide(path: &str, index: usize, line: &str) -> String {
    format!(
        "{path}:{}: {} columns, {MOST_COLUMNS} are allowed; wrap the text",
        index + 1,
        line.chars().count()
    )
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    fn file(path: &str, text: String) -> File {
        File { path: path.into(), text }
    }

    #[test]
    fn long_files_are_refused() {
        let files = [file("a.rs", "\n".repeat(600)), file("b.wgsl", "\n".repeat(601))];
        let found = check_lines(&files);
        assert!(matches!(&found[..], [one] if one.starts_with("b.wgsl: 601 lines")), "{found:?}");
    }

    #[test]
    fn wide_comments_are_refused() {
        let words = |count: usize| "ä".repeat(count);
        for text in [
            format!("\n// {}", words(98)),
            format!("\n    /// {}", words(93)),
            format!("\nlet x = 1; /* {} */", words(84)),
            format!("/*\n{}\n*/", words(101)),
        ] {
            let found = check_comments(&[file("a.rs", text.clone())]);
            assert!(matches!(&found[..], [one] if one.starts_with("a.rs:2: 101")), "{text}: {found:?}");
        }
        for text in [
            format!("// {}", words(97)),
            format!("let x = \"// {}\";", words(100)),
            format!("//! | {} |", words(120)),
            format!("/// https://{}", words(120)),
        ] {
            assert!(check_comments(&[file("a.rs", text.clone())]).is_empty(), "{text}");
        }
    }

    #[test]
    fn wide_pages_are_refused() -> anyhow::Result<()> {
        let root = tempfile::tempdir()?;
        fs::create_dir(root.path().join("docs"))?;
        fs::create_dir(root.path().join("scenes"))?;
        let wide = "x".repeat(101);
        fs::write(root.path().join("README.md"), format!("| {wide} |\n```\n{wide}\n```\n"))?;
        fs::write(root.path().join("scenes/a.toml"), format!("x = \"{wide}\"\n# {}\n", &wide[3..]))?;
        assert_eq!(check_pages(root.path())?, Vec::<String>::new());
        fs::write(root.path().join("docs/A.md"), format!("```\n```\n{wide}\n"))?;
        fs::write(root.path().join("scenes/a.toml"), format!("# {wide}\n"))?;
        let found = check_pages(root.path())?;
        assert_eq!(found.len(), 2, "{found:?}");
        assert!(found[0].starts_with("docs/A.md:3: 101 columns"), "{found:?}");
        assert!(found[1].starts_with("scenes/a.toml:1: 103 columns"), "{found:?}");
        Ok(())
    }
}
