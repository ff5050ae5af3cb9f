use super::*;

const MAP: &str = "| [`low`](crates/low) | 0 | below |\n| [`high`](crates/high) | 3 | above |\n";
const LINTS: &str = "[lints]\nworkspace = true\n";

/// The faults of a workspace of two crates with this table and these ends of their manifests.
fn faults(map: &str, low: &str, high: &str) -> anyhow::Result<Vec<String>> {
    let root = tempfile::tempdir()?;
    let shared = "[workspace.dependencies]\ngpu = { package = \"wgpu\", version = \"29\" }\n";
    fs::write(root.path().join("Cargo.toml"), format!("[workspace]\nmembers = [\"crates/*\"]\n{shared}"))?;
    fs::write(root.path().join("ARCHITECTURE.md"), map)?;
    for (name, rest) in [("low", low), ("high", high)] {
        let folder = root.path().join("crates").join(name);
        fs::create_dir_all(&folder)?;
        fs::write(folder.join("Cargo.toml"), format!("[package]\nname = \"{name}\"\n{rest}"))?;
    }
    check(root.path())
}

#[test]
fn dependencies_on_lower_floors_are_allowed() -> anyhow::Result<()> {
    let high = format!("{LINTS}[dependencies]\nlow.workspace = true\nwgpu = \"29\"\n");
    let low = format!("{LINTS}[dev-dependencies]\ntoml = \"1\"\n");
    assert_eq!(faults(MAP, &low, &high)?, Vec::<String>::new());
    Ok(())
}

#[test]
fn dependencies_on_higher_floors_are_refused_of_every_kind() -> anyhow::Result<()> {
    for kind in ["dependencies", "dev-dependencies", "build-dependencies", "target.'cfg(unix)'.dependencies"]
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
        assert!(matches!(&found[..], [one] if one.contains(&format!("on {package}:"))), "{line}: {found:?}");
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
    assert!(faults(&MAP.replace("crates/high", "apps/high"), LINTS, LINTS)?[0].contains("not in apps/high"));
    assert!(faults(MAP, "", LINTS)?[0].contains("lints"));
    assert!(faults("no table", LINTS, LINTS).is_err());
    Ok(())
}
