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
    if Format::of(&arguments.file) == Some(Format::Gltf) {
        let character = forelock_io::read_character(&arguments.file, &arguments.import.import())?;
        return character::describe_character(arguments, character);
    }
    if forelock_io::is_motion(&arguments.file) {
        return character::describe_motion(arguments);
    }
    if forelock_io::is_skinning(&arguments.file) {
        return skinning::describe(arguments);
    }
    let imported = match forelock_io::read_groom(&arguments.file, &arguments.import.import()) {
        Ok(imported) => imported,
        Err(ReadError::UnknownEnding { path, known }) => {
            let known = known + " .glb .gltf .bvh .tfxskin .tfxbone";
            return Err(ReadError::UnknownEnding { path, known }.into());
        }
        // Alembic and USD files hold strands, or a body.
        Err(error) => match forelock_io::read_character(&arguments.file, &arguments.import.import()) {
            Ok(character) => return character::describe_character(arguments, character),
            Err(other) if other.to_string() == error.to_string() => return Err(error.into()),
            Err(ReadError::UnknownEnding { .. }) => return Err(error.into()),
            Err(other) => anyhow::bail!("{error}; as a body: {other}"),
        },
    };
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
