//! Milliseconds a frame on a GPU, from a thousand strands to as many as asked for: strands × 25 particles grown on the built-in head, four substeps, the head turning
//! against its distance field. Each frame's time is that of twenty, waited for at their end; stages are by the device's clock.
//!
//! `cargo run --release -p forelock-gpu --example scaling -- [most strands] [name of the GPU]`

#![expect(clippy::print_stdout, reason = "an example that measures says what")]

use forelock_core::body::{ColliderFrame, Head, Motion, Sdf, Shape};
use forelock_core::groom::grow::{GrowParams, grow_on_head};
use forelock_core::pose::Pose;
use forelock_core::solver::{AmsParams, Frame, Options};
use forelock_gpu::{Choice, Gpu, GpuSimulation};
use glam::DVec3;
use std::sync::Arc;
use std::time::Instant;

const FRAMES: u32 = 20;
const FPS: f64 = 60.0;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let most: u32 = arguments.next().map_or(Ok(120_000), |a| a.parse())?;
    let gpu = Gpu::open(&arguments.next().map_or(Choice::Fastest, Choice::Named))?;
    println!("{}, strands × 25, {} substeps", gpu.name(), AmsParams::default().substeps);
    println!("| strands | ms a frame | bytes a particle | stages, ms |\n| ---: | ---: | ---: | --- |");
    let shape = Shape::Sdf(Arc::new(Sdf::from_mesh(&Head::builtin().mesh, 96, 0.02)?));
    let motion = Motion::by_name("turn")?;
    for strands in [1_000, 10_000, 30_000, 120_000, 400_000, 1_000_000].into_iter().filter(|s| *s <= most) {
        let preset = GrowParams::preset("straight")?;
        let groom = grow_on_head(&GrowParams { strands, vertices_per_strand: 25, ..preset })?;
        let gravity = DVec3::new(0.0, -9.81, 0.0);
        let options = Options { rest_gravity: gravity, ..Options::default() };
        let mut simulation = GpuSimulation::new(&gpu, &groom, &AmsParams::default(), &options)?;
        let step = |simulation: &mut GpuSimulation, number: u32| {
            let times = [number, number + 1].map(|number| f64::from(number) / FPS);
            let head = times.map(|time| motion.pose(time));
            let [from, to] = head;
            let solid = ColliderFrame { shape: &shape, local: Pose::IDENTITY, from, to, friction: 0.3 };
            let (colliders, air_velocity) = ([solid], DVec3::ZERO);
            simulation.step_frame(&Frame {
                head,
                colliders: &colliders,
                gravity,
                air_velocity,
                dt_secs: 1.0 / FPS,
            })
        };
        (0..5).try_for_each(|number| step(&mut simulation, number))?;
        simulation.report()?;
        let started = Instant::now();
        (5..5 + FRAMES).try_for_each(|number| step(&mut simulation, number))?;
        let report = simulation.report()?;
        let ms = started.elapsed().as_secs_f64() * 1e3 / f64::from(FRAMES);
        simulation.time_stages(true);
        step(&mut simulation, 5 + FRAMES)?;
        let secs = simulation.report()?.stage_secs;
        let stages: Vec<_> =
            secs.iter().flatten().map(|(name, secs)| format!("{name} {:.3}", secs * 1e3)).collect();
        let bytes = simulation.bytes() as f64 / simulation.model().particle_count as f64;
        println!("| {strands} | {ms:.3} | {bytes:.0} | {} |", stages.join(", "));
        if report.quarantined_strands > 0 {
            println!("{} strands were put back", report.quarantined_strands);
        }
    }
    Ok(())
}
