//! `info`: what a groom or cache holds.

use std::path::Path;

use forelock_core::groom::Info;
use forelock_io::{Cache, Format};
use serde::Serialize;

use crate::arguments::InfoArgs;
use crate::terminal;

#[derive(Serialize)]
struct Report {
    file: String,
    format: String,
    /// Frames, where the file is a cache.
    frames: Option<usize>,
    #[serde(flatten)]
    info: Info,
    repairs: Vec<String>,
}

/// Tells what the file holds.
pub fn info(arguments: &InfoArgs) -> anyhow::Result<()> {
    let imported = forelock_io::read_groom(&arguments.file, &arguments.import.import())?;
    let report = Report {
        file: arguments.file.display().to_string(),
        format: imported.format.to_string(),
        frames: frames(&arguments.file, imported.format),
        info: Info::of(&imported.groom),
        repairs: imported.repairs.sentences(),
    };
    if arguments.json {
        return terminal::json(&report);
    }
    terminal::line(format!("{}: {}", report.file, report.format));
    if let Some(frames) = report.frames {
        terminal::line(format!("a cache of {frames} frames; the first one holds"));
    }
    terminal::line(report.info.to_string());
    for repair in &report.repairs {
        terminal::line(format!("repaired: {repair}"));
    }
    Ok(())
}

/// Frames of an `.npz` file that is a cache.
fn frames(path: &Path, format: Format) -> Option<usize> {
    (format == Format::Npz).then(|| Cache::open(path).ok()).flatten().map(|cache| cache.frames())
}
