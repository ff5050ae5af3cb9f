//! `convert`: converts a groom to another format.

use anyhow::Context;
use forelock_core::groom::resample;
use serde::Serialize;

use crate::arguments::ConvertArgs;
use crate::terminal;

#[derive(Serialize)]
struct Report {
    input: String,
    output: String,
    strands: usize,
    particles: usize,
    repairs: Vec<String>,
}

/// Reads, repairs, resamples and writes the groom.
pub fn convert(arguments: &ConvertArgs) -> anyhow::Result<()> {
    let imported = forelock_io::read_groom(&arguments.input, &arguments.import.import())?;
    let mut groom = imported.groom;
    if let Some(count) = arguments.resample {
        groom = resample(&groom, count as usize).context("the strands cannot be resampled")?;
    }
    forelock_io::write_groom(&arguments.output, &groom)?;
    let report = Report {
        input: arguments.input.display().to_string(),
        output: arguments.output.display().to_string(),
        strands: groom.strand_count(),
        particles: groom.particle_count(),
        repairs: imported.repairs.sentences(),
    };
    if arguments.json {
        return terminal::json(&report);
    }
    for repair in &report.repairs {
        terminal::note(format!("repaired: {repair}"));
    }
    let Report { input, output, strands, particles, repairs } = &report;
    let repaired = if repairs.is_empty() { "nothing to repair" } else { "repaired" };
    terminal::line(format!(
        "{input} → {output}: {strands} strands, {particles} particles, in metres, y up, {repaired}"
    ))
}
