//! `bench`: the papers' tables and figures, rerun, solvers compared, and scaling.

use std::path::Path;

use anyhow::Context as _;
use forelock_bench::paper::{
    Figure, GUIDES, GuidesTable, NeuralOptions, Study, Table1Options, compare, dftl_tables, neural_tables,
    table1, volume,
};
use forelock_bench::rendering::{RenderingOptions, rendering};
use forelock_bench::scaling::{ScalingOptions, scaling};
use serde::Serialize;

use crate::arguments::{BenchArgs, BenchBackend, BenchCommand, PaperFigure, WhichPaper};
use crate::progress::Reporter;
use crate::terminal;

/// Runs what is asked for and prints its table.
pub fn bench(arguments: &BenchArgs) -> anyhow::Result<()> {
    let (json, out, name) = match &arguments.what {
        BenchCommand::Paper { paper, figure, out, json, .. } => {
            (*json, out, name_of(*paper, figure.as_deref()))
        }
        BenchCommand::Solvers { out, json, .. } => (*json, out, "solvers".to_owned()),
        BenchCommand::Render { out, json, .. } => (*json, out, "render".to_owned()),
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
        BenchCommand::Paper { paper, figure, share, frames, warm_up, steps, backend, .. } => {
            let figure = figure.as_deref().map(|name| PaperFigure::of(*paper, name));
            let figure = figure.transpose().map_err(anyhow::Error::msg)?;
            let models = report.out.map_or_else(
                || super::simulate::default_folder("neuralocks"),
                |folder| folder.join("models"),
            );
            let on_gpu = *backend == BenchBackend::Gpu;
            let scenes = Table1Options { warm_up: *warm_up, frames: *frames, share: *share, on_gpu };
            let options = NeuralOptions { scenes, steps: *steps, models };
            match figure {
                None => run_tables(&report, *paper, &options, &mut observer),
                Some(figure) => run_figure(&report, figure, &options, &mut observer),
            }
        }
        BenchCommand::Solvers { share, .. } => {
            // A failure to write now is reported when the final result is written.
            let keep = &mut |so_far: &Study| drop(report.keep(so_far, so_far));
            let study = compare(*share, &mut observer, keep)?;
            report.study(&study, &study)
        }
        BenchCommand::Render { most, frames, width, height, .. } => {
            let options = RenderingOptions { most: *most, frames: *frames, width: *width, height: *height };
            let found = rendering(&options, &mut observer)?;
            report.study(&found.study(), &found)
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

/// What files of a result are called.
fn name_of(paper: WhichPaper, figure: Option<&str>) -> String {
    match (figure, paper) {
        (Some(figure), _) => format!("{}-figure-{figure}", paper.name()),
        (None, WhichPaper::Dftl) => "dftl-tables".to_owned(),
        (None, WhichPaper::Ams | WhichPaper::Neuralocks) => format!("{}-table1", paper.name()),
    }
}

/// The tables of a paper with `options`.
fn run_tables(
    report: &Report<'_>,
    paper: WhichPaper,
    options: &NeuralOptions,
    observer: &mut forelock::Observer<'_>,
) -> anyhow::Result<()> {
    match paper {
        WhichPaper::Dftl => {
            let tables = dftl_tables(&options.scenes, observer)?;
            report.study(&tables.study(), &tables)
        }
        WhichPaper::Ams => {
            let table = table1(&options.scenes, observer)?;
            report.study(&table.study(), &table)
        }
        WhichPaper::Neuralocks => {
            let study = neural_tables(options, observer)?;
            report.study(&study, &study)
        }
    }
}

/// A figure with the share of strands of `options`.
fn run_figure(
    report: &Report<'_>,
    figure: PaperFigure,
    options: &NeuralOptions,
    observer: &mut forelock::Observer<'_>,
) -> anyhow::Result<()> {
    let study = match figure {
        PaperFigure::Variants(figure) => return report.ablation(figure),
        PaperFigure::Guides => {
            let table = GuidesTable::run(&GUIDES, options.scenes.share, &[], report.out.is_some(), observer)?;
            if let (Some(folder), Some(picture)) = (report.out, &table.picture) {
                forelock::write_picture(&folder.join(format!("{}.png", report.name)), picture)?;
            }
            return report.tell(&table.to_markdown(), &table);
        }
        PaperFigure::Study(experiment) => experiment.study(options.scenes.share, observer)?,
        PaperFigure::Volume => volume(options.scenes.share, observer)?,
        PaperFigure::Learned(figure) => figure.study(options, observer)?,
    };
    report.study(&study, &study)
}

/// Where and how results are reported.
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
            forelock::write_picture(&folder.join(format!("{}.png", self.name)), &figure.picture(&table)?)?;
        }
        self.tell(&table.to_markdown(), &table)
    }

    /// A study, of which `data` is what JSON holds.
    fn study(&self, study: &Study, data: &impl Serialize) -> anyhow::Result<()> {
        self.keep(study, data)?;
        self.show(&study.to_markdown(), data)
    }

    /// Its files.
    fn keep(&self, study: &Study, data: &impl Serialize) -> anyhow::Result<()> {
        if let Some(folder) = self.out {
            self.write(".html", &study.to_html())?;
            for (plot, _, svg) in study.pictures() {
                self.write(&format!("-{plot}.svg"), &svg)?;
            }
            for strip in &study.strips {
                let path = folder.join(format!("{}-{}.png", self.name, strip.name));
                forelock::write_picture(&path, &strip.image)?;
            }
        }
        self.texts(&study.to_markdown(), data)
    }

    fn tell(&self, markdown: &str, data: &impl Serialize) -> anyhow::Result<()> {
        self.texts(markdown, data)?;
        self.show(markdown, data)
    }

    fn texts(&self, markdown: &str, data: &impl Serialize) -> anyhow::Result<()> {
        self.write(".md", markdown)?;
        self.write(".json", &serde_json::to_string_pretty(data)?)
    }

    fn show(&self, markdown: &str, data: &impl Serialize) -> anyhow::Result<()> {
        if self.json {
            return terminal::json(data);
        }
        terminal::line(markdown.trim_end())
    }

    fn write(&self, ending: &str, text: &str) -> anyhow::Result<()> {
        let Some(folder) = self.out else { return Ok(()) };
        let path = folder.join(format!("{}{ending}", self.name));
        Ok(forelock_io::atomic_write(&path, |file| file.write_all(text.as_bytes()))?)
    }
}
