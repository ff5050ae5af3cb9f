//! The page with a training's curves.

use super::config::TrainingConfig;
use super::run::{Measured, Note, SHOWN_STEPS};
use crate::html::{escape, page};
use crate::report::plot;

/// The page for a training so far.
pub(super) fn html(config: &TrainingConfig, note: &Note) -> String {
    let of = |part: fn(&Measured) -> f64| note.measured.iter().map(part).collect::<Vec<_>>();
    let drape =
        (f64::from(config.steps.simulator) * config.steps.drape / f64::from(SHOWN_STEPS)).ceil() as usize;
    let (drape, motion) = note.energies.split_at(drape.min(note.energies.len()));
    let least = drape.iter().copied().fold(f64::INFINITY, f64::min);
    let plots = [
        plot(
            "energy of the drape over its least, g cm²/s²",
            &drape.iter().map(|e| e - least).collect::<Vec<_>>(),
        ),
        plot("energy of the motion's residual, g cm²/s²", motion),
        plot("error, over the reference's deviation from rest", &of(|own| own.score.nrmse)),
        plot("error of the motion, over the reference's", &of(|own| own.score.nrmse_dyn)),
        plot("correlation of tips", &of(|own| own.score.corr)),
        plot("correlation of velocities", &of(|own| own.score.corr_vel)),
        plot("motion over the reference's", &of(|own| own.score.motion_ratio)),
        plot("inside the body, %", &of(|own| 100.0 * own.score.inside)),
    ];
    let row = |own: &Measured| {
        let Measured { step, score } = own;
        format!(
            "<tr><td>{step}</td><td>{:.3}</td><td>{:.3}</td><td>{:.3}</td><td>{:.3}</td><td>{:.3}</td>\
             <td>{:.3}</td></tr>",
            score.nrmse,
            score.nrmse_dyn,
            score.corr,
            score.corr_vel,
            score.motion_ratio,
            100.0 * score.inside
        )
    };
    let rows: String = note.measured.iter().rev().map(row).collect();
    let step = note.measured.last().map_or(0, |own| own.step);
    let body = format!(
        "<header><h1>Training</h1><p>step {step} of {}</p></header>\
         <section class=\"plots\">{}</section>\
         <h2>Beside the implicit reference, on strands and motions that are not trained</h2>\
         <table><tr><th>step</th><th>error</th><th>of motion</th><th>correlation</th>\
         <th>of velocities</th><th>motion</th><th>inside, %</th></tr>{rows}</table>\
         <h2>Configuration</h2><pre>{}</pre>",
        config.steps.simulator,
        plots.concat(),
        escape(&config.to_toml()),
    );
    // While it trains, a browser reads the page again.
    let is_done = step >= config.steps.simulator;
    let refresh = if is_done { "" } else { "<meta http-equiv=\"refresh\" content=\"10\">" };
    page("Forelock · training", &body).replace("<title>", &format!("{refresh}<title>"))
}
