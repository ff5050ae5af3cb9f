//! Measures what runs left in their folders, without the solver: `measure_run FOLDER…` prints a
//! table's rows.
#![expect(clippy::print_stdout, reason = "a program for developers")]

use std::path::PathBuf;

#[path = "../tests/it/measure/mod.rs"]
mod measure;

fn main() {
    println!(
        "| run | strands | particles | stretch | start > 1 mm inside | > 1 mm inside | deepest | measured: > 1 mm inside (reported) | deepest (reported) | edges > 1 mm inside (reported) | deepest edge (reported) | clamped | drift (median) | jitter (rms) |"
    );
    println!("| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |");
    for folder in std::env::args_os().skip(1).map(PathBuf::from) {
        let shown = measure::shown(&folder, 1);
        assert_eq!(shown.non_finite, 0, "{} is not finite throughout", folder.display());
        println!(
            "| {} | {} | {} | {:.1e} | {:.4} % | {:.4} % | {:.2} mm | {:.4} % ({:.4} %) | {:.2} ({:.2}) mm | {:.4} % ({:.4} %) | {:.2} ({:.2}) mm | {:.2} mm | {:.3} ({:.4}) mm | {:.1e} ({:.1e}) g |",
            folder.file_name().unwrap_or_default().display(),
            shown.strands,
            shown.particles,
            shown.stretch,
            shown.share_inside_at_start * 1e2,
            shown.share_inside * 1e2,
            shown.deepest_m * 1e3,
            shown.measured[0] * 1e2,
            shown.reported[0] * 1e2,
            shown.measured[1] * 1e3,
            shown.reported[1] * 1e3,
            shown.edge_share_inside * 1e2,
            shown.reported[2] * 1e2,
            shown.deepest_edge_m * 1e3,
            shown.reported[3] * 1e3,
            shown.deepest_clamped_m * 1e3,
            shown.drift_m * 1e3,
            shown.median_drift_m * 1e3,
            shown.jitter_g,
            shown.jitter_rms_g
        );
    }
}
