use std::fs;

use super::*;

const CORE: &str = "crates/forelock-core/src";

/// The faults of a tree with these files and this third cell of the row for the solver
/// `mass-spring`, which is also called `springy`.
fn faults(registry: &str, files: &[(&str, &str)]) -> anyhow::Result<Vec<String>> {
    let root = tempfile::tempdir()?;
    let header = "| solver | own folders | files that name it |\n| --- | --- | --- |\n";
    let row = format!("| `mass-spring`, `springy` | `{CORE}/solver/mass_spring` | {registry} |\n");
    fs::write(root.path().join("ARCHITECTURE.md"), format!("{header}{row}"))?;
    for (path, text) in [("solver/mass_spring/mod.rs", "struct MassSpring;")].iter().chain(files) {
        let path = root.path().join(CORE).join(path);
        fs::create_dir_all(path.parent().unwrap_or(root.path()))?;
        fs::write(path, text)?;
    }
    solver_files(root.path())
}

#[test]
fn listed_files_are_allowed() -> anyhow::Result<()> {
    let list = format!("`{CORE}/solver/mod.rs`");
    let comments = "// MassSpring\nfn masses(spring: f32) {}\n#[cfg(test)]\nmod tests { use MassSpring; }";
    let files =
        [("solver/mod.rs", "use mass_spring::X;"), ("other.rs", comments), ("solver/tests.rs", "MassSpring")];
    assert_eq!(faults(&list, &files)?, Vec::<String>::new());
    Ok(())
}

#[test]
fn every_spelling_outside_the_list_is_named() -> anyhow::Result<()> {
    for text in [
        "MassSpring",
        "x.mass_spring()",
        "MassSpringParams",
        "MASS_SPRING",
        "\"mass-spring\"",
        "is_MassSpring2(MassSpring)",
        "fn is_springy() {}",
    ] {
        let found = faults("", &[("a.rs", &format!("\n{text}"))])?;
        assert!(matches!(&found[..], [one] if one.contains("src/a.rs:2 names")), "{text}: {found:?}");
    }
    Ok(())
}

#[test]
fn old_entries_and_long_lists_are_refused() -> anyhow::Result<()> {
    let found = faults(&format!("`{CORE}/gone.rs`"), &[])?;
    assert!(matches!(&found[..], [one] if one.contains("gone.rs does not name")), "{found:?}");

    let names: Vec<String> = (0..5).map(|i| format!("{i}.rs")).collect();
    let list: Vec<String> = names.iter().map(|name| format!("`{CORE}/{name}`")).collect();
    let files: Vec<(&str, &str)> = names.iter().map(|name| (name.as_str(), "MassSpring")).collect();
    assert_eq!(faults(&list[..4].join(", "), &files[..4])?, Vec::<String>::new());
    let found = faults(&list.join(", "), &files)?;
    assert!(matches!(&found[..], [one] if one.starts_with("5 files")), "{found:?}");
    Ok(())
}

#[test]
fn folders_must_exist() -> anyhow::Result<()> {
    let root = tempfile::tempdir()?;
    fs::write(root.path().join("ARCHITECTURE.md"), "no table")?;
    assert!(solver_files(root.path()).is_err());
    let table = "| solver | own folders | files that name it |\n| --- | --- | --- |\n| `ams` | `a` | |\n";
    fs::write(root.path().join("ARCHITECTURE.md"), table)?;
    assert!(solver_files(root.path())?[0].contains("a of the solver ams does not exist"));
    Ok(())
}
