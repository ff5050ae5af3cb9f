//! The doc lines of `AmsParams`, `MassSpringParams`, `DftlParams`, `GridParams`, `SphParams` and
//! `ContactParams` are the reference that users read: each default they state is the one that
//! holds, and each range they state is the one that scenes are held to.

#![expect(clippy::unwrap_used, reason = "a test fails where its source is not as expected")]

use std::path::Path;

use forelock::Scene;
use forelock::scene::Override;
use forelock_core::interaction::contact::ContactParams;
use forelock_core::interaction::grid::GridParams;
use forelock_core::interaction::sph::SphParams;
use forelock_core::solver::{AmsParams, DftlParams, MassSpringParams};

/// Kind of solver, the parameters' table in scenes, and their source.
const TABLES: [(&str, &str, &str); 6] = [
    ("ams", "solver.ams", include_str!("../../../forelock-core/src/solver/ams/params.rs")),
    (
        "mass-spring",
        "solver.mass_spring",
        include_str!("../../../forelock-core/src/solver/mass_spring/mod.rs"),
    ),
    ("dftl", "solver.dftl", include_str!("../../../forelock-core/src/solver/dftl/params.rs")),
    ("ams", "interaction.grid", include_str!("../../../forelock-core/src/interaction/grid/params.rs")),
    ("ams", "interaction.sph", include_str!("../../../forelock-core/src/interaction/sph/params.rs")),
    ("ams", "interaction.contact", include_str!("../../../forelock-core/src/interaction/contact/params.rs")),
];

/// Name in scenes, stated default and stated range of every field of the parameters in `source`.
fn documented(source: &str) -> Vec<(String, String, Option<String>)> {
    let (_, body) = source.split_once("Params {").unwrap();
    let (body, _) = body.split_once("\n}").unwrap();
    let mut doc = String::new();
    let mut renamed = None;
    let mut fields = Vec::new();
    for line in body.lines().map(str::trim) {
        if let Some(text) = line.strip_prefix("///") {
            doc.push_str(text);
        } else if let Some((_, rest)) = line.split_once("serde(rename = \"") {
            renamed = rest.split_once('"').map(|(name, _)| name);
        } else if let Some((name, _)) = line.strip_prefix("pub ").and_then(|rest| rest.split_once(':')) {
            let name = renamed.take().unwrap_or(name);
            let default = after(&doc, "efault ").unwrap_or_else(|| panic!("`{name}` states no default"));
            fields.push((name.to_owned(), default.trim_end_matches('.').to_owned(), after(&doc, "range ")));
            doc.clear();
        }
    }
    fields
}

/// What follows `word` up to the next comma, semicolon or end of sentence.
fn after(doc: &str, word: &str) -> Option<String> {
    let rest = doc.split_once(word)?.1;
    let end = [", ", "; ", ". "].iter().filter_map(|stop| rest.find(stop)).min().unwrap_or(rest.len());
    Some(rest[..end].trim_end_matches('.').to_owned())
}

#[test]
fn every_documented_default_holds() {
    let defaults = [
        toml::Table::try_from(AmsParams::default()).unwrap(),
        toml::Table::try_from(MassSpringParams::default()).unwrap(),
        toml::Table::try_from(DftlParams::default()).unwrap(),
        toml::Table::try_from(GridParams::default()).unwrap(),
        toml::Table::try_from(SphParams::default()).unwrap(),
        toml::Table::try_from(ContactParams::default()).unwrap(),
    ];
    for ((_, _, source), defaults) in TABLES.into_iter().zip(defaults) {
        let fields = documented(source);
        assert_eq!(fields.len(), defaults.len(), "every field is documented");
        for (name, stated, _) in fields {
            let stated: toml::Value =
                toml::from_str::<toml::Table>(&format!("x = {stated}")).unwrap()["x"].clone();
            let number = |v: &toml::Value| v.as_float().or(v.as_integer().map(|i| i as f64));
            match (number(&stated), number(&defaults[&name])) {
                (Some(stated), Some(held)) => assert_eq!(stated, held, "{name}"),
                _ => assert_eq!(stated, defaults[&name], "{name}"),
            }
        }
    }
}

#[test]
fn the_length_passes_have_their_names_in_scenes() {
    for table in ["solver.ams", "solver.mass_spring"] {
        for name in ["projection", "dftl", "off"] {
            let set = Override::set(&format!("{table}.inextensibility={name}")).unwrap();
            let scene = Scene::parse("", Path::new("scene.toml"), &[set]).unwrap();
            assert!(scene.to_toml().contains(&format!("inextensibility = \"{name}\"")), "{table}: {name}");
        }
        let unknown = Override::set(&format!("{table}.inextensibility=follow-the-leader")).unwrap();
        assert!(Scene::parse("", Path::new("scene.toml"), &[unknown]).is_err());
    }
}

#[test]
fn every_documented_range_is_held_to() {
    for (kind, table, source) in TABLES {
        let accepts = |name: &str, value: String| {
            let sets = [format!("solver.kind={kind}"), format!("{table}.{name}={value}")];
            let sets = sets.map(|set| Override::set(&set).unwrap());
            Scene::parse("", Path::new("scene.toml"), &sets).is_ok()
        };
        let mut ranges = 0;
        for (name, _, range) in documented(source) {
            let Some(range) = range else { continue };
            ranges += 1;
            let whole = [
                "clamped",
                "resolution",
                "iterations",
                "max_cells",
                "budget",
                "rounds",
                "per_segment",
                "recheck",
                "neighbours",
            ]
            .contains(&name.as_str());
            let write = |value: f64| if whole { format!("{value}") } else { format!("{value:?}") };
            let (inside, outside) = match range.as_str() {
                "0 or more" => (vec![0.0, 1e3], vec![-1e-3, f64::NAN]),
                "0 to the float32 bound" => (vec![0.0, 5.76e7], vec![-1.0, 5.77e7]),
                "8 or more" => (vec![8.0, 1e6], vec![7.0, -1.0]),
                "0 to 10" => (vec![0.0, 10.0], vec![-1e-3, 10.1]),
                "1e-6 to 0.1" => (vec![1e-6, 0.1], vec![9e-7, 0.11]),
                "0 to 16" => (vec![0.0, 16.0], vec![-1.0, 17.0]),
                "0 to 0.5" => (vec![0.0, 0.5], vec![-1e-3, 0.51]),
                "0 to 0.2" => (vec![0.0, 0.2], vec![-1e-3, 0.21]),
                "1 to 64" => (vec![1.0, 64.0], vec![0.0, 65.0]),
                "1 to 1024" => (vec![1.0, 1024.0], vec![0.0, 1025.0]),
                "0 to 1" => (vec![0.0, 0.9, 1.0], vec![-1e-3, 1.001]),
                "1e-5 to 1" => (vec![1e-5, 0.03], vec![9e-6, 1.1]),
                "0.01 to 1" => (vec![0.01, 1.0], vec![0.0099, 1.001]),
                "1 to 1000" => (vec![1.0, 1000.0], vec![0.0, 1001.0]),
                "8 to 512" => (vec![8.0, 512.0], vec![7.0, 513.0]),
                "1 to 10000" => (vec![1.0, 10000.0], vec![0.0, 10001.0]),
                "4096 to 1000000000" => (vec![4096.0, 1e9], vec![4095.0, 1e9 + 1.0]),
                "above 0 and below 1" => (vec![1e-6, 0.5], vec![0.0, 1.0]),
                "above 0" => (vec![1e-3], vec![0.0, -1.0]),
                "above `elastic_limit`" => (vec![0.501], vec![0.5]),
                other => panic!("`{name}`: no test knows the range {other:?}"),
            };
            for value in inside.into_iter().filter(|v| name != "elastic_limit" || *v < 1.0) {
                assert!(accepts(&name, write(value)), "{name} = {value} is in its range");
            }
            for value in outside {
                assert!(!accepts(&name, write(value)), "{name} = {value} is not in its range");
            }
        }
        assert!(ranges > 4, "only {ranges} ranges of {table} were found");
    }
}
