//! `bench`: the papers' tables and figures, rerun.

use std::path::Path;

use anyhow::Context as _;
use clap::ValueEnum;
use forelock::paper::{Experiment, Figure, GUIDES, GuidesTable, Study, Table1Options, table1};
use forelock::scaling::{ScalingOptions, scaling};
use serde::Serialize;

use crate::arguments::{BenchArgs, BenchBackend, BenchCommand, PaperFigure};
use crate::progress::Reporter;
use crate::terminal;

/// Runs what is asked for and prints its table.
pub fn bench(arguments: &BenchArgs) -> anyhow::Result<()> {
    let (json, out, name) = match &arguments.what {
        BenchCommand::Paper { figure, out, json, .. } => {
            let figure = figure.as_ref().and_then(ValueEnum::to_possible_value);
            (
                *json,
                out,
                figure.map_or_else(|| "ams-table1".to_owned(), |f| format!("ams-figure-{}", f.get_name())),
            )
        }
        BenchCommand::Scaling { backend, out, json, .. } => {
            let device = if *backend == BenchBackend::Gpu { "gpu" } else { "cpu" };
            (*json, out, format!("scaling-{device}"))
        }
    };
    let mut reporter = Reporter::new(json);
    let mut observer = |progress: &forelock::Progress<'_>| reporter.report(progress);
    let report = Report { out: out.as_deref(), name, json };
    // Before minutes of work, not after them.
    if let Some(folder) = report.out {
        std::fs::create_dir_all(folder)
            .with_context(|| format!("cannot make the folder {}", folder.display()))?;
    }
    match &arguments.what {
        BenchCommand::Paper { figure, share, frames, warm_up, backend, .. } => {
            let on_gpu = *backend == BenchBackend::Gpu;
            let options = Table1Options { warm_up: *warm_up, frames: *frames, share: *share, on_gpu };
            paper(&report, *figure, &options, &mut observer)
        }
        BenchCommand::Scaling { backend, most, frames, apart, contacts, half_factors, .. } => {
            let on_gpu = *backend == BenchBackend::Gpu;
            anyhow::ensure!(on_gpu || !half_factors, "--half-factors is for a GPU: add --backend gpu");
            let options = ScalingOptions {
                on_gpu,
                most: *most,
                frames: *frames,
                grid: !apart,
                contacts: *contacts,
                half_factors: *half_factors,
            };
            let found = scaling(&options, &mut observer)?;
            report.study(&found.study(), &found)
        }
    }
}

/// Table 1 with `options`, or one figure with their share of strands.
fn paper(
    report: &Report<'_>,
    figure: Option<PaperFigure>,
    options: &Table1Options,
    observer: &mut forelock::Observer<'_>,
) -> anyhow::Result<()> {
    let experiment = match figure {
        None => {
            let table = table1(options, observer)?;
            return report.study(&table.study(), &table);
        }
        Some(PaperFigure::Sag) => return report.ablation(Figure::Sag),
        Some(PaperFigure::Angular) => return report.ablation(Figure::Angular),
        Some(PaperFigure::Guides) => {
            let table = GuidesTable::run(&GUIDES, (options.share, &[]), report.out.is_some(), observer)?;
            if let (Some(folder), Some(picture)) = (report.out, &table.picture) {
                forelock::write_png(&folder.join(format!("{}.png", report.name)), picture)?;
            }
            return report.tell(&table.to_markdown(), &table);
        }
        Some(PaperFigure::Beard) => Experiment::Beard,
        Some(PaperFigure::RollerCoaster) => Experiment::RollerCoaster,
        Some(PaperFigure::Grooming) => Experiment::Grooming,
        Some(PaperFigure::Asymmetric) => Experiment::Asymmetric,
    };
    let study = experiment.study(options.share, observer)?;
    report.study(&study, &study)
}

/// Where and how results are told.
struct Report<'a> {
    out: Option<&'a Path>,
    name: String,
    json: bool,
}

impl Report<'_> {
    /// One of the ablations: a table, and a picture of every variant.
    fn ablation(&self, figure: Figure) -> anyhow::Result<()> {
        let table = figure.table()?;
        if let Some(folder) = self.out {
            forelock::write_png(&folder.join(format!("{}.png", self.name)), &figure.picture(&table)?)?;
        }
        self.tell(&table.to_markdown(), &table)
    }

    /// A study, of which `data` is what JSON holds.
    fn study(&self, study: &Study, data: &impl Serialize) -> anyhow::Result<()> {
        if self.out.is_some() {
            self.write(".html", &study.to_html())?;
            for (plot, _, svg) in study.pictures() {
                self.write(&format!("-{plot}.svg"), &svg)?;
            }
        }
        self.tell(&study.to_markdown(), data)
    }

    fn tell(&self, markdown: &str, data: &impl Serialize) -> anyhow::Result<()> {
        self.write(".md", markdown)?;
        self.write(".json", &serde_json::to_string_pretty(data)?)?;
        if self.json {
            return terminal::json(data);
        }
        terminal::line(markdown.trim_end());
        Ok(())
    }

    fn write(&self, ending: &str, text: &str) -> anyhow::Result<()> {
        let Some(folder) = self.out else { return Ok(()) };
        let path = folder.join(format!("{}{ending}", self.name));
        Ok(forelock_io::atomic_write(&path, |file| file.write_all(text.as_bytes()))?)
    }
}
