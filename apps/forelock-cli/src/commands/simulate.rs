//! `demo` and `simulate`: run a scene.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use forelock::scene::Override;
use forelock::{Progress, RunOptions, SIMULATING, Scene, Summary};

use crate::arguments::{DemoArgs, RunArgs, SimulateArgs};
use crate::progress::Reporter;
use crate::{interrupt, terminal};

/// Runs a built-in scene.
pub fn demo(arguments: &DemoArgs) -> anyhow::Result<ExitCode> {
    let DemoArgs { scene, run } = arguments;
    simulate_scene(&scene.scene(&overrides(run)?)?, run)
}

/// Runs the scene in a file.
pub fn simulate(arguments: &SimulateArgs) -> anyhow::Result<ExitCode> {
    simulate_scene(&Scene::load(&arguments.scene, &overrides(&arguments.run)?)?, &arguments.run)
}

/// The overrides of `--set`, then those of separate options, which take precedence.
fn overrides(run: &RunArgs) -> anyhow::Result<Vec<Override>> {
    let mut overrides = super::overrides(&run.sets)?;
    overrides.extend(run.frames.map(|frames| Override::option("--frames", "time.frames", frames)));
    overrides.extend(run.solver.as_ref().map(|name| Override::option("--solver", "solver.kind", name)));
    if let Some(file) = &run.cache {
        let absolute = std::path::absolute(file).unwrap_or_else(|_| file.clone());
        overrides.push(Override::option("--cache", "output.cache", absolute.display()));
    }
    Ok(overrides)
}

fn simulate_scene(scene: &Scene, run: &RunArgs) -> anyhow::Result<ExitCode> {
    let out = run.out.clone().unwrap_or_else(|| default_folder(&scene.name));
    let options = RunOptions { out, resume: run.resume, backend: run.backend() };
    let mut reporter = Reporter::new(run.json);
    let mut observer = |progress: &Progress<'_>| {
        match progress {
            Progress::Begin { what, .. } => interrupt::set_watched(*what == SIMULATING),
            Progress::End => interrupt::set_watched(false),
            Progress::Note(_) | Progress::Step => {}
        }
        reporter.report(progress);
    };
    let summary = forelock::simulate(scene, &options, &mut observer, interrupt::asked())?;
    if run.json {
        terminal::json(&summary)?;
    } else {
        print(&summary)?;
    }
    if summary.frames < summary.frames_asked {
        terminal::note(format!(
            "interrupted after frame {} of {}; the output so far is complete; the same command with --resume goes on",
            summary.frames, summary.frames_asked
        ));
        return Ok(ExitCode::from(interrupt::STATUS));
    }
    Ok(ExitCode::SUCCESS)
}

/// `forelock-out/NAME`. Characters of the name that do not suit a folder are replaced.
pub(super) fn default_folder(name: &str) -> PathBuf {
    Path::new("forelock-out").join(forelock::folder_name(name, "scene"))
}

fn print(summary: &Summary) -> anyhow::Result<()> {
    terminal::line(format!(
        "{}: {} strands, {} particles, {} frames with {} on {} ({} threads, {})",
        summary.scene,
        summary.strands,
        summary.particles,
        summary.frames,
        summary.solver,
        summary.device,
        summary.threads,
        summary.simd,
    ))?;
    terminal::line(format!(
        "{:.1} ms per frame by the clock (95 % within {:.1}), {:.1} of it in the solver, \
         stretch {:.1e} ({:.1e} after collisions), {} strands reset, state {}",
        summary.ms_per_frame.mean,
        summary.ms_per_frame.p95,
        summary.solver_ms_per_frame.mean,
        summary.max_edge_stretch,
        summary.max_edge_stretch_after_solids,
        summary.quarantined_strands,
        summary.state_hash,
    ))?;
    if summary.penetration_measured_every == 0 {
        terminal::line("inside solids: not measured, hair collides with nothing")?;
    } else {
        terminal::line(penetration(summary))?;
    }
    for path in &summary.outputs {
        terminal::line(format!("  {}", path.display()))?;
    }
    Ok(())
}

fn penetration(summary: &Summary) -> String {
    format!(
        "inside solids: particles up to {:.2} mm, {:.3} % by more than 1 mm; edges between them up to \
         {:.2} mm, {:.3} % (every {} frames)",
        summary.max_penetration_m * 1e3,
        summary.max_share_1mm_inside * 1e2,
        summary.max_edge_penetration_m * 1e3,
        summary.max_edge_share_1mm_inside * 1e2,
        summary.penetration_measured_every,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_stay_below_the_default() {
        for (name, folder) in
            [("demo", "demo"), ("../../etc", "-..-etc"), ("..", "scene"), ("", "scene"), ("a/b", "a-b")]
        {
            assert_eq!(default_folder(name), Path::new("forelock-out").join(folder));
        }
    }
}
