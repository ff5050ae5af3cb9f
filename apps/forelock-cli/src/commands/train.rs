//! `train`: trains the learned simulator.

use std::process::ExitCode;

use forelock::Progress;
use forelock::training::{
    KindScore, TRAINING, TrainingConfig, TrainingOptions, TrainingSummary, measure, train,
};

use crate::arguments::TrainArgs;
use crate::progress::Reporter;
use crate::{interrupt, terminal};

/// Trains what the configuration says.
pub fn run(arguments: &TrainArgs) -> anyhow::Result<ExitCode> {
    let overrides = super::overrides(&arguments.sets)?;
    let config = match &arguments.config {
        Some(path) => TrainingConfig::load(path, &overrides)?,
        None => TrainingConfig::builtin(&overrides)?,
    };
    if let Some(name) = &arguments.measure {
        let model = forelock::read_model(name)?;
        let mut reporter = Reporter::new(arguments.json);
        let scores = measure(&config, &model, &mut |progress| reporter.report(progress))?;
        if arguments.json {
            terminal::json(&scores)?;
        } else {
            print_scores(&scores)?;
        }
        return Ok(ExitCode::SUCCESS);
    }
    let name = arguments.config.as_deref().and_then(|path| path.file_stem());
    let name = name.map_or("training".into(), |name| name.to_string_lossy());
    let out = arguments.out.clone().unwrap_or_else(|| super::simulate::default_folder(&name));
    let options = TrainingOptions { out, resume: arguments.resume };
    let mut reporter = Reporter::new(arguments.json);
    let mut observer = |progress: &Progress<'_>| {
        match progress {
            Progress::Begin { what, .. } => interrupt::set_watched(*what == TRAINING),
            Progress::End => interrupt::set_watched(false),
            Progress::Note(_) | Progress::Step => {}
        }
        reporter.report(progress);
    };
    let summary = train(&config, &options, &mut observer, interrupt::asked())?;
    if arguments.json {
        terminal::json(&summary)?;
    } else {
        print(&summary)?;
    }
    if summary.steps < summary.steps_asked {
        terminal::note(format!(
            "interrupted after step {} of {}; the same command with --resume goes on",
            summary.steps, summary.steps_asked
        ));
        return Ok(ExitCode::from(interrupt::STATUS));
    }
    Ok(ExitCode::SUCCESS)
}

fn print(summary: &TrainingSummary) -> anyhow::Result<()> {
    terminal::line(format!(
        "{} steps with {} strands and {} motions; codes {:.3} cm a coordinate, {:.3} of other strands",
        summary.steps, summary.strands, summary.motions, summary.code_errors_cm[0], summary.code_errors_cm[1]
    ))?;
    if !summary.scores.is_empty() {
        terminal::line(format!(
            "step {} was best; strands and motions that were not trained, beside the implicit reference:",
            summary.best_step
        ))?;
        print_scores(&summary.scores)?;
    }
    for path in &summary.outputs {
        terminal::line(format!("  {}", path.display()))?;
    }
    Ok(())
}

/// The measures of a model as a table.
fn print_scores(scores: &[KindScore]) -> anyhow::Result<()> {
    let width = scores.iter().map(|own| own.groom.chars().count()).max().unwrap_or_default().max(14);
    let head = ["corr", "corr_vel", "nrmse", "nrmse_dyn", "motion", "inside %", "stretch"];
    terminal::line(format!("{:width$}{}", "", head.map(|name| format!("{name:>10}")).concat()))?;
    for KindScore { groom, score } in scores {
        terminal::line(format!(
            "{groom:width$}{:10.3}{:10.3}{:10.3}{:10.3}{:10.3}{:10.3}{:10.1e}",
            score.corr,
            score.corr_vel,
            score.nrmse,
            score.nrmse_dyn,
            score.motion_ratio,
            100.0 * score.inside,
            score.stretch
        ))?;
    }
    Ok(())
}
