//! `convert`: converts a groom to another format.

use std::path::Path;

use anyhow::Context;
use forelock::Progress;
use forelock_core::groom::resample;
use forelock_io::animation::{self, AnimationReader};
use serde::Serialize;

use crate::arguments::ConvertArgs;
use crate::progress::Reporter;
use crate::terminal;

#[derive(Serialize)]
struct Report {
    input: String,
    output: String,
    strands: usize,
    particles: usize,
    frames: usize,
    repairs: Vec<String>,
}

/// Reads, repairs, resamples and writes the groom.
pub fn convert(arguments: &ConvertArgs) -> anyhow::Result<()> {
    if arguments.animated {
        return convert_frames(arguments);
    }
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
        frames: 1,
        repairs: imported.repairs.sentences(),
    };
    if arguments.json {
        return terminal::json(&report);
    }
    for repair in &report.repairs {
        terminal::note(format!("repaired: {repair}"));
    }
    let Report { input, output, strands, particles, repairs, .. } = &report;
    let repaired = if repairs.is_empty() { "nothing to repair" } else { "repaired" };
    terminal::line(format!(
        "{input} → {output}: {strands} strands, {particles} particles, in metres, y up, {repaired}"
    ))
}

/// Converts all frames.
fn convert_frames(arguments: &ConvertArgs) -> anyhow::Result<()> {
    let ConvertArgs { input, output, velocities, .. } = arguments;
    let mut reader = AnimationReader::open(input, &arguments.import.import())?;
    let beside = |input: &Path| input.with_file_name("scene.toml").is_file();
    if input.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("npz")) && beside(input) {
        terminal::note(
            "the cache of a run holds positions and times; `output.exports` of its scene writes widths, \
             colours, root UVs and labels too",
        );
    }
    let mut reporter = Reporter::new(arguments.json);
    let total = reader.times_secs().len() as u64;
    reporter.report(&Progress::Begin { what: "converting", done: 0, total });
    let frames =
        animation::convert(&mut reader, output, *velocities, &mut |_| reporter.report(&Progress::Step))?;
    reporter.report(&Progress::End);
    let report = Report {
        input: input.display().to_string(),
        output: output.display().to_string(),
        strands: reader.groom().strand_count(),
        particles: reader.groom().particle_count(),
        frames,
        repairs: Vec::new(),
    };
    if arguments.json {
        return terminal::json(&report);
    }
    let Report { input, output, strands, particles, .. } = &report;
    terminal::line(format!(
        "{input} → {output}: {frames} frames of {strands} strands, {particles} particles, in metres, y up"
    ))
}
