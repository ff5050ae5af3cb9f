//! Opens the window on a small scene, writes a picture of it and closes it.
//!
//! `cargo run --release -p forelock-view --example window -- PICTURE.png`

use forelock::scene::Override;
use forelock::{Backend, Scene};
use forelock_view::Options;

/// Seconds until the picture is taken.
const AFTER_SECS: f64 = 4.0;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let picture = std::env::args().nth(1).ok_or("name the picture")?;
    let sets = ["groom.strands=1500", "body.sdf_cells=32", "interaction.kind=none"].map(Override::set);
    let scene = Scene::builtin(&sets.into_iter().collect::<Result<Vec<_>, _>>()?)?;
    let screenshot = Some((picture.into(), AFTER_SECS));
    let options = Options { opened: scene.into(), backend: Backend::Cpu, screenshot };
    Ok(forelock_view::run(options).map_err(|error| error.to_string())?)
}
