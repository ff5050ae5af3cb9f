//! The report: one HTML page that needs nothing but itself and the pictures beside it.
//!
//! The picture of the last frame is embedded, so the page can be mailed; the film and the contact
//! sheet, which are large, are shown from the files beside it.

use std::fmt::Write as _;

use crate::html::{base64, escape, page, thousands};
use crate::penetration::Penetration;
use crate::scene::Scene;
use crate::summary::{FrameRow, Summary};

/// The pictures of a run that the report shows.
#[derive(Clone, Debug, Default)]
pub struct Pictures {
    /// The last frame, the bytes of a PNG.
    pub picture: Option<Vec<u8>>,
    /// Name of the film beside the report.
    pub film: Option<String>,
    /// Name of the contact sheet beside the report.
    pub contact_sheet: Option<String>,
}

/// The page for a run of `scene` that `summary` sums up and whose frames were `rows`.
pub fn html(scene: &Scene, summary: &Summary, rows: &[FrameRow], pictures: &Pictures) -> String {
    let mut parts = vec![headline(summary), figures(pictures), cards(summary), plots(rows), stages(summary)];
    if !summary.notes.is_empty() {
        let items: String = summary.notes.iter().map(|note| format!("<li>{}</li>", escape(note))).collect();
        parts.push(format!("<h2>Notes</h2><ul>{items}</ul>"));
    }
    parts.push(settings(scene));
    page(&format!("Forelock · {}", summary.scene), &parts.join("\n"))
}

fn headline(summary: &Summary) -> String {
    let cut = if summary.frames < summary.frames_asked {
        format!(" of {} (interrupted)", summary.frames_asked)
    } else {
        String::new()
    };
    format!(
        "<header><h1>{}</h1><p>{} strands · {} particles · {} frames{cut} at {} fps × {} substeps · {} on {} with {} \
         thread(s), {}</p></header>",
        escape(&summary.scene),
        thousands(summary.strands),
        thousands(summary.particles),
        summary.frames,
        summary.fps,
        summary.substeps,
        escape(&summary.solver),
        escape(&summary.device),
        summary.threads,
        escape(&summary.simd),
    )
}

fn figures(pictures: &Pictures) -> String {
    let mut figures = String::new();
    let mut figure = |source: &str, caption: &str| {
        let _ = write!(
            figures,
            "<figure><img alt=\"{caption}\" src=\"{source}\"><figcaption>{caption}</figcaption></figure>"
        );
    };
    if let Some(png) = &pictures.picture {
        figure(&format!("data:image/png;base64,{}", base64(png)), "The last frame");
    }
    if let Some(film) = &pictures.film {
        figure(&escape(film), "The film");
    }
    let sheet = pictures.contact_sheet.as_ref().map_or_else(String::new, |sheet| {
        format!("<figure class=\"wide\"><img alt=\"Frames over time\" src=\"{}\"></figure>", escape(sheet))
    });
    format!("<section class=\"figures\">{figures}</section>{sheet}")
}

fn cards(summary: &Summary) -> String {
    let bytes = |n: u64| format!("{:.0} MiB", n as f64 / 1048576.0);
    let per_particle = summary.simulation_bytes as f64 / summary.particles.max(1) as f64;
    let cards = [
        (format!("{:.1} ms", summary.ms_per_frame.mean), "a frame by the clock (mean)"),
        (format!("{:.1} ms", summary.solver_ms_per_frame.mean), "of it in the solver"),
        (
            format!("{:.1} / {:.1} ms", summary.ms_per_frame.p95, summary.ms_per_frame.max),
            "95th percentile / longest",
        ),
        (format!("{:.1e}", summary.max_edge_stretch), "largest stretch after the length pass"),
        (format!("{:.1e}", summary.max_edge_stretch_after_solids), "the same after solids"),
        (format!("{:.2} mm", summary.max_penetration_m * 1e3), "deepest particle inside a solid"),
        (format!("{:.3} %", summary.max_share_1mm_inside * 1e2), "of particles more than 1 mm inside"),
        (format!("{:.2} mm", summary.max_edge_penetration_m * 1e3), "deepest edge inside a solid"),
        (format!("{:.3} %", summary.max_edge_share_1mm_inside * 1e2), "of edges more than 1 mm inside"),
        (summary.quarantined_strands.to_string(), "strands reset"),
        (summary.sleeping_strands.to_string(), "strands asleep at the end"),
        (summary.peak_memory_bytes.map_or_else(|| "unknown".into(), bytes), "peak memory"),
        (format!("{per_particle:.0} B"), "a particle in the solver"),
    ];
    let cards: String = cards
        .iter()
        .map(|(value, name)| format!("<div class=\"card\"><b>{value}</b><span>{name}</span></div>"))
        .collect();
    format!("<section class=\"cards\">{cards}</section>")
}

fn plots(rows: &[FrameRow]) -> String {
    let measured = |depth_m: fn(&Penetration) -> f64| {
        rows.iter().filter_map(|row| row.penetration.as_ref()).map(|found| depth_m(found) * 1e3).collect()
    };
    let series: [(&str, Vec<f64>); 5] = [
        ("milliseconds a frame", rows.iter().map(|row| row.ms).collect()),
        ("of it in the solver", rows.iter().map(|row| row.solver_ms).collect()),
        ("largest stretch", rows.iter().map(|row| row.stretch).collect()),
        ("deepest particle inside, mm", measured(|found| found.deepest_m)),
        ("deepest edge inside, mm", measured(|found| found.deepest_edge_m)),
    ];
    let plots: String = series.iter().map(|(name, values)| plot(name, values)).collect();
    format!("<h2>Over time</h2><section class=\"plots\">{plots}</section>")
}

/// A line plot of `values` over their frames, from zero to their maximum.
pub(crate) fn plot(name: &str, values: &[f64]) -> String {
    let top = values.iter().copied().fold(0.0, f64::max);
    let scale = if top > 0.0 { 100.0 / top } else { 0.0 };
    let step = 300.0 / (values.len().max(2) - 1) as f64;
    let points: String = values
        .iter()
        .enumerate()
        .map(|(i, value)| format!("{:.1},{:.1} ", i as f64 * step, 102.0 - value * scale))
        .collect();
    let top = if top > 0.0 && top < 0.01 { format!("{top:.1e}") } else { format!("{top:.2}") };
    format!(
        "<figure><svg viewBox=\"0 0 300 104\" preserveAspectRatio=\"none\" role=\"img\" aria-label=\"{name}\">\
         <polyline points=\"{points}\"/></svg><figcaption>{name}, up to {top}</figcaption></figure>"
    )
}

fn stages(summary: &Summary) -> String {
    let total: f64 = summary.ms_per_stage.values().sum();
    let mut stages: Vec<_> = summary.ms_per_stage.iter().collect();
    stages.sort_by(|a, b| b.1.total_cmp(a.1));
    let rows: String = stages
        .iter()
        .map(|(stage, ms)| {
            let share = if total > 0.0 { 100.0 * **ms / total } else { 0.0 };
            format!(
                "<tr><td>{}</td><td class=\"number\">{ms:.2}</td><td><i style=\"width:{share:.0}%\"></i></td></tr>",
                escape(&stage.replace('_', " "))
            )
        })
        .collect();
    let together = if summary.threads > 1 && summary.backend == "cpu" {
        format!(
            "<p>The solver's stages are summed over {} threads: together they may take longer than a frame.</p>",
            summary.threads
        )
    } else {
        String::new()
    };
    format!(
        "<h2>Time per stage</h2>{together}<table><tr><th>stage</th><th class=\"number\">ms a frame</th><th>share</th></tr>{rows}</table>"
    )
}

fn settings(scene: &Scene) -> String {
    format!(
        "<h2>Settings</h2><details><summary>The scene with every key</summary><pre>{}</pre></details>",
        escape(&scene.to_toml())
    )
}
