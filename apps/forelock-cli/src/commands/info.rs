//! `info`: describes a groom, a cache, a character, a motion or a skinning file.

mod character;
mod skinning;

use forelock_core::groom::Info;
use forelock_io::animation::AnimationReader;
use forelock_io::{Format, ReadError};
use serde::Serialize;

use crate::arguments::InfoArgs;
use crate::terminal;

#[derive(Serialize)]
struct Report {
    file: String,
    format: String,
    #[serde(flatten)]
    motion: Option<Motion>,
    #[serde(flatten)]
    info: Info,
    repairs: Vec<String>,
}

/// The frames of a file of moving hair.
#[derive(Clone, Copy, Serialize)]
struct Motion {
    frames: usize,
    first_secs: f64,
    last_secs: f64,
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
        motion: motion(arguments, imported.format),
        info: Info::of(&imported.groom),
        repairs: imported.repairs.sentences(),
    };
    if arguments.json {
        return terminal::json(&report);
    }
    terminal::line(format!("{}: {}", report.file, report.format))?;
    if let Some(Motion { frames, first_secs, last_secs }) = report.motion {
        terminal::line(format!(
            "moving hair: {frames} frames from {first_secs:.3} to {last_secs:.3} s; the first frame:"
        ))?;
    }
    terminal::line(report.info.to_string())?;
    for repair in &report.repairs {
        terminal::line(format!("repaired: {repair}"))?;
    }
    Ok(())
}

/// Frames and times of a cache, or of an Alembic or USD file with several frames.
fn motion(arguments: &InfoArgs, format: Format) -> Option<Motion> {
    if !matches!(format, Format::Npz | Format::Alembic | Format::Usd) {
        return None;
    }
    let reader = AnimationReader::open(&arguments.file, &arguments.import.import()).ok()?;
    let times = reader.times_secs();
    let (&first_secs, &last_secs) = (times.first()?, times.last()?);
    let moves = format == Format::Npz || times.len() > 1;
    moves.then_some(Motion { frames: times.len(), first_secs, last_secs })
}
