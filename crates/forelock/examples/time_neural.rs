//! Times frames of a scene that a trained model moves, and says where the time goes:
//! `cargo run --release -p forelock --example time_neural -- STRANDS PARTICLES`
//!
//! The model has random weights, which take the time of trained ones.
#![expect(clippy::print_stdout, reason = "an example prints")]

use std::error::Error;
use std::path::Path;
use std::time::Instant;

use forelock::scene::{Override, Scene};
use forelock::{Player, core};
use forelock_neural::codes::encoder::{CodeOptions, INPUTS, StrandCodes};
use forelock_neural::model::{Model, ModelInfo};
use forelock_neural::network::rotation::basis;
use forelock_neural::network::{Network, Shape};
use forelock_neural::random::Random;
use forelock_neural::train::Energies;

/// Frames that are timed.
const FRAMES: usize = 100;

/// Writes a model of random weights.
fn write_model(path: &Path) -> Result<(), Box<dyn Error>> {
    let (shape, mut random) = (Shape::default(), Random::new(1));
    let weights = (0..shape.parameters()).map(|_| 0.03 * random.signed() as f32).collect();
    let codes =
        StrandCodes::train(&[[0.0; INPUTS]], &CodeOptions { steps: 0, ..CodeOptions::default() }, &mut || ());
    let info = ModelInfo::new(&Energies::default(), 0.3);
    let basis = basis(100.0, 1e-4, 1.0 / 30.0);
    Ok(Model::new(Network::new(shape, weights)?, &basis, codes.encoder(), info)?.write(path)?)
}

fn main() -> Result<(), Box<dyn Error>> {
    let counts: Vec<u32> = std::env::args().skip(1).map(|a| a.parse()).collect::<Result<_, _>>()?;
    let (strands, particles) =
        (counts.first().copied().unwrap_or(10_000), counts.get(1).copied().unwrap_or(25));
    let folder = tempfile::tempdir()?;
    let model = folder.path().join("random.safetensors");
    write_model(&model)?;
    let sets = [
        format!("groom.strands={strands}"),
        format!("groom.vertices_per_strand={particles}"),
        "body.motion=builtin:shake".to_owned(),
        "solver.kind=neural".to_owned(),
        format!("solver.neural.model={}", model.display()),
    ];
    for push_out in [false, true] {
        let push_out = format!("solver.neural.push_out={push_out}");
        let sets: Vec<Override> =
            sets.iter().chain([&push_out]).map(|set| Override::set(set)).collect::<Result<_, _>>()?;
        let scene = Scene::parse("", Path::new("scene.toml"), &sets)?;
        let mut player = Player::builder(scene).without_history().build()?;
        let (mut times, mut stages) = (Vec::new(), core::frame::StageTimes::default());
        for _ in 0..FRAMES {
            let began = Instant::now();
            let report = player.step()?.solver;
            times.push(1e3 * began.elapsed().as_secs_f64());
            stages.add_all(&report.stages);
        }
        times.sort_by(f64::total_cmp);
        println!(
            "{strands} strands of {particles}, {push_out}: least {:.2} ms, median {:.2} ms",
            times[0],
            times[FRAMES / 2]
        );
        for (name, secs) in stages.iter() {
            println!("    {name:18} {:.2} ms a frame, all threads", 1e3 * secs / FRAMES as f64);
        }
    }
    Ok(())
}
