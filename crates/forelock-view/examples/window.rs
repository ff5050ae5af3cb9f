//! Opens the window on the demo with few strands, lets it play, writes a picture of it and closes
//! it.
//!
//! `cargo run --release -p forelock-view --example window -- PICTURE.png [SECS] [key=value ...]`

use forelock::scene::Override;
use forelock::{Backend, Scene};
use forelock_view::Options;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let picture = std::env::args().nth(1).ok_or("name the picture")?;
    let secs = std::env::args().nth(2).map_or(Ok(4.0), |secs| secs.parse())?;
    let small = ["groom.strands=1500", "body.sdf_cells=32", "interaction.kind=none"].map(str::to_owned);
    let sets = small.into_iter().chain(std::env::args().skip(3));
    let sets = sets.map(|set| Override::set(&set)).collect::<Result<Vec<_>, _>>()?;
    let scene = Scene::builtin(&sets)?;
    let screenshot = Some((picture.into(), secs));
    let opened = scene.into();
    let options = Options { opened, backend: Backend::Cpu, draw: Backend::Auto, plays: false, screenshot };
    Ok(forelock_view::run(options).map_err(|error| error.to_string())?)
}
