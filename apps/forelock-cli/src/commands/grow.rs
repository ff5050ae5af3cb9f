//! `grow`: grows a groom from a preset, or draws the contact sheets of the AMS paper.

use std::path::Path;

use forelock::scene::Override;
use forelock::{Assets, Scene, Studio, write_picture};
use forelock_core::groom::Info;
use serde::Serialize;

use crate::arguments::GrowArgs;
use crate::progress::Reporter;
use crate::terminal;

#[derive(Serialize)]
struct Report {
    preset: String,
    outputs: Vec<String>,
    #[serde(flatten)]
    info: Info,
}

/// Grows the groom and writes it.
pub fn grow(arguments: &GrowArgs) -> anyhow::Result<()> {
    let mut reporter = Reporter::new(arguments.json);
    let mut outputs = Vec::new();
    if let Some(folder) = &arguments.sheets {
        let written = forelock_bench::growth_sheets(folder, &mut |progress| reporter.report(progress))?;
        outputs.extend(written.iter().map(|path| path.display().to_string()));
    }
    let scene = Scene::parse("", Path::new("the command line"), &overrides(arguments)?)?;
    let assets = Assets::load(&scene, &mut |progress| reporter.report(progress))?;
    if let Some(path) = &arguments.out {
        forelock_io::write_groom(path, &assets.groom)?;
        outputs.push(path.display().to_string());
    }
    if let Some(path) = &arguments.picture {
        write_picture(path, &Studio::new(&scene, &assets).picture(assets.groom.positions(), 0.0, 1.0)?)?;
        outputs.push(path.display().to_string());
    }
    let report = Report { preset: arguments.preset.clone(), outputs, info: Info::of(&assets.groom) };
    if arguments.json {
        return terminal::json(&report);
    }
    let Report { preset, outputs, info } = &report;
    let outputs = outputs.join(", ");
    terminal::line(format!("{preset}: {} strands, {} particles → {outputs}", info.strands, info.particles))
}

/// The options as keys of a scene. `--set` changes keys of `[groom.grow]`.
fn overrides(arguments: &GrowArgs) -> anyhow::Result<Vec<Override>> {
    let mut overrides = vec![
        Override::option("--preset", "groom.preset", &arguments.preset),
        Override::option("--strands", "groom.strands", arguments.strands),
        Override::option("--vertices", "groom.vertices_per_strand", arguments.vertices),
        Override::option("--seed", "seed", arguments.seed),
    ];
    for mut over in super::overrides(&arguments.sets)? {
        over.key = format!("groom.grow.{}", over.key);
        overrides.push(over);
    }
    Ok(overrides)
}
