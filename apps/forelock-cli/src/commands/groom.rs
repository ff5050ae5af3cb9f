//! `groom`: applies the edits of a script to a groom.

use forelock::{Grooming, GroomingOptions, Scene};

use crate::arguments::GroomArgs;
use crate::progress::Reporter;
use crate::terminal;

/// Edits the groom and writes it.
pub fn groom(arguments: &GroomArgs) -> anyhow::Result<()> {
    let scene = Scene::load(&arguments.script, &super::overrides(&arguments.sets)?)?;
    let out = arguments.out.clone().unwrap_or_else(|| super::simulate::default_folder(&scene.name));
    let options = GroomingOptions { out, steps: arguments.steps };
    let mut reporter = Reporter::new(arguments.json);
    let done = forelock::groom(&scene, &options, &mut |progress| reporter.report(progress))?;
    if arguments.json {
        return terminal::json(&done);
    }
    let Grooming { scene, before, after, edits, outputs, .. } = &done;
    for (number, edit) in edits.iter().enumerate() {
        terminal::line(format!("{:>3}  {:<10} {:>7.1} ms  {}", number + 1, edit.op, edit.ms, edit.report))?;
    }
    terminal::line(format!(
        "{scene}: {} strands of {} particles became {} of {}",
        before.strands, before.particles, after.strands, after.particles
    ))?;
    for path in outputs {
        terminal::line(format!("  {}", path.display()))?;
    }
    Ok(())
}
