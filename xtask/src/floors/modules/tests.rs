use std::fs;

use super::*;

const MAP: &str = "\
| core module | floor | what it holds |
| --- | --- | --- |
| `low`, `base` | 0 | below |
| `high` | 1 | above |
";

/// The faults of a core with these files, whose modules are `low`, `base` and `high`.
fn faults(files: &[(&str, &str)]) -> anyhow::Result<Vec<String>> {
    let root = tempfile::tempdir()?;
    fs::write(root.path().join("ARCHITECTURE.md"), MAP)?;
    let modules = [("lib.rs", "pub use high::A;"), ("low.rs", ""), ("base.rs", ""), ("high/mod.rs", "")];
    for (path, text) in modules.iter().chain(files) {
        let path = root.path().join(CORE).join(path);
        fs::create_dir_all(path.parent().context("a folder")?)?;
        fs::write(path, text)?;
    }
    check(root.path())
}

#[test]
fn lower_modules_and_the_module_itself_are_allowed() -> anyhow::Result<()> {
    let text = "use crate::{low::{A, high::B}, base as b, low as high};\n\
                use super::super::low;\nuse crate::high::inner::C;\n\
                pub(crate) fn f(x: crate::low::D) { super::g() }\nmod a { use super::super::g; }";
    assert_eq!(faults(&[("high/inner.rs", text)])?, Vec::<String>::new());
    Ok(())
}

#[test]
fn uses_of_the_same_or_a_higher_floor_are_named() -> anyhow::Result<()> {
    for (text, line, used) in [
        ("\nuse crate::high::A;", 2, "high (floor 1)"),
        ("use super::high;", 1, "high (floor 1)"),
        ("use crate::{low::A,\n\n    high::{B, C}};", 3, "high (floor 1)"),
        ("fn f() -> u32 { 1 }\nfn g() { crate::high::h() }", 2, "high (floor 1)"),
        ("mod a { mod b {} fn f() { super::super::high::h() } }", 1, "high (floor 1)"),
        ("use super::{super::low, high};", 1, "high (floor 1)"),
        ("macro_rules! m { () => { $crate::high::h() } }", 1, "high (floor 1)"),
        ("use crate::base::A;", 1, "base (floor 0)"),
        ("use crate::A;", 1, "crate::A"),
        ("use crate::*;", 1, "crate::*"),
    ] {
        let found = faults(&[("low.rs", text)])?;
        let place = format!("{CORE}/low.rs:{line}: low ");
        assert!(
            matches!(&found[..], [one] if one.starts_with(&place) && one.contains(used)),
            "{text}: {found:?}"
        );
    }
    Ok(())
}

#[test]
fn a_file_in_a_folder_belongs_to_its_top_module() -> anyhow::Result<()> {
    let found =
        faults(&[("low/a/b.rs", "use super::c;\nuse super::super::c;\nuse super::super::super::high;")])?;
    assert!(matches!(&found[..], [one] if one.contains("low/a/b.rs:3: low ")), "{found:?}");
    Ok(())
}

#[test]
fn tests_comments_and_macros_may_name_every_module() -> anyhow::Result<()> {
    let text = "//! [`crate::high::A`]\nconst A: &str = \"crate::high\";\nfn f() { crate::m!() }\n\
                #[cfg(test)]\nmod tests { use crate::high::A; fn f(x: [u8; 4]) {} }\n\
                #[cfg(test)]\nmod more;\n#[cfg(test)]\nuse crate::high::B;\n";
    let more = "use crate::high::A;";
    assert_eq!(
        faults(&[("low.rs", text), ("low/more.rs", more), ("low/more/a.rs", more)])?,
        Vec::<String>::new()
    );
    // The same without the attributes fails four times.
    let found = faults(&[
        ("low.rs", &text.replace("#[cfg(test)]", "")),
        ("low/more.rs", more),
        ("low/more/a.rs", more),
    ])?;
    assert_eq!(found.len(), 4, "{found:?}");
    // Another feature is no test.
    let feature = "#[cfg(any(test, feature = \"x\"))]\nuse crate::high::B;";
    assert_eq!(faults(&[("low.rs", feature)])?.len(), 1);
    Ok(())
}

#[test]
fn the_table_and_the_folder_agree() -> anyhow::Result<()> {
    let found = faults(&[("new.rs", "")])?;
    assert!(matches!(&found[..], [one] if one.contains("new is not in the table")), "{found:?}");
    let root = tempfile::tempdir()?;
    fs::create_dir_all(root.path().join(CORE))?;
    fs::write(root.path().join("ARCHITECTURE.md"), MAP)?;
    let found = check(root.path())?;
    assert_eq!(found.len(), 3);
    assert!(found[0].contains("lists the core module base"), "{found:?}");
    fs::write(root.path().join("ARCHITECTURE.md"), "no table")?;
    assert!(check(root.path()).is_err());
    Ok(())
}
