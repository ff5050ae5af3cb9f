//! `info`: describes a groom, a cache, a character, a motion or a skinning file.

mod character;
mod skinning;

use std::path::Path;

use forelock_core::groom::Info;
use forelock_io::{Cache, Format, ReadError};
use serde::Serialize;

use crate::arguments::InfoArgs;
use crate::terminal;

#[derive(Serialize)]
struct Report {
    file: String,
    format: String,
    /// The number of frames, if the file is a cache.
    frames: Option<usize>,
    #[serde(flatten)]
    info: Info,
    repairs: Vec<String>,
}

/// Prints a description of the file.
pub fn info(arguments: &InfoArgs) -> anyhow::Result<()> {
    if forelock_io::is_character(&arguments.file) {
        return character::describe_character(arguments);
    }
    if forelock_io::is_motion(&arguments.file) {
        return character::describe_motion(arguments);
    }
    if forelock_io::is_skinning(&arguments.file) {
        return skinning::describe(arguments);
    }
    let imported =
        forelock_io::read_groom(&arguments.file, &arguments.import.import()).map_err(|mut error| {
            if let ReadError::UnknownEnding { known, .. } = &mut error {
                known.push_str(" .glb .gltf .bvh .tfxskin .tfxbone");
            }
            error
        })?;
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
    terminal::line(format!("{}: {}", report.file, report.format))?;
    if let Some(frames) = report.frames {
        terminal::line(format!("a cache of {frames} frames; the first frame:"))?;
    }
    terminal::line(report.info.to_string())?;
    for repair in &report.repairs {
        terminal::line(format!("repaired: {repair}"))?;
    }
    Ok(())
}

/// The number of frames of an `.npz` file, if it is a cache.
fn frames(path: &Path, format: Format) -> Option<usize> {
    (format == Format::Npz).then(|| Cache::open(path).ok()).flatten().map(|cache| cache.frames())
}
