//! Milliseconds a frame of the AMS solver, stage by stage: 10,298 strands × 30 particles on the built-in head, with
//! springs, both ghost ties, the length pass and the head's distance field, the head turning.
//!
//! `cargo run --release -p forelock-core --example frame_time -- [threads] [frames] [simd]`

#![expect(clippy::print_stdout, reason = "an example that measures says what")]

use forelock_core::body::{ColliderFrame, Head, Motion, Sdf, Shape};
use forelock_core::groom::grow::{GrowParams, grow_on_head};
use forelock_core::pose::Pose;
use forelock_core::solver::{AmsParams, Frame, Options, Simd, Simulation};
use glam::DVec3;
use std::sync::Arc;
use std::time::Instant;

const STRANDS: u32 = 10_298;
const PARTICLES: u32 = 30;

fn main() -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
    let mut arguments = std::env::args().skip(1);
    let threads = arguments.next().map_or(Ok(2), |a| a.parse())?;
    let frames = arguments.next().map_or(Ok(120), |a| a.parse())?;
    let simd = match arguments.next().as_deref() {
        None => Simd::Auto,
        Some(name) => *Simd::ALL.iter().find(|s| format!("{s:?}") == name).ok_or("no such simd")?,
    };
    rayon::ThreadPoolBuilder::new().num_threads(threads).build()?.install(|| run(threads, frames, simd))
}

fn run(threads: usize, frames: u32, simd: Simd) -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
    let preset = GrowParams::preset("straight")?;
    let groom = grow_on_head(&GrowParams { strands: STRANDS, vertices_per_strand: PARTICLES, ..preset })?;
    let shape = Shape::Sdf(Arc::new(Sdf::from_mesh(&Head::builtin().mesh, 128, 0.02)?));
    let gravity = DVec3::new(0.0, -9.81, 0.0);
    let options = Options { simd, rest_gravity: gravity, ..Options::default() };
    let mut simulation = Simulation::new(&groom, &AmsParams::default(), &options)?;
    let motion = Motion::by_name("turn")?;
    let dt_secs = 1.0 / 60.0;
    let mut times = Vec::new();
    let mut stages: Vec<Vec<f64>> = Vec::new();
    for frame in 0..frames {
        let head = [motion.pose(f64::from(frame) * dt_secs), motion.pose(f64::from(frame + 1) * dt_secs)];
        let collider =
            ColliderFrame { shape: &shape, local: Pose::IDENTITY, from: head[0], to: head[1], friction: 0.3 };
        let air_velocity = DVec3::ZERO;
        let start = Instant::now();
        let report =
            simulation.step_frame(&Frame { head, colliders: &[collider], gravity, air_velocity, dt_secs })?;
        times.push(start.elapsed().as_secs_f64() * 1e3);
        stages.resize(report.stage_secs.len(), Vec::new());
        for (stage, (_, secs)) in stages.iter_mut().zip(report.stage_secs) {
            stage.push(secs * 1e3);
        }
        if frame + 1 == frames {
            let best = |times: &mut Vec<f64>| {
                times.sort_by(f64::total_cmp);
                (times[0], times[times.len() / 2])
            };
            let (least, median) = best(&mut times);
            println!("{STRANDS} x {PARTICLES}, {threads} thread(s), {:?}", simd.resolve());
            println!("frame: least {least:.2} ms, median {median:.2} ms");
            for ((name, _), stage) in report.stage_secs.iter().zip(&mut stages) {
                let (least, median) = best(stage);
                println!("  {name}: least {least:.2}, median {median:.2} ms of all threads together");
            }
            println!(
                "stretch {:.1e}, after solids {:.1e}, penetration {:.1e} m",
                report.max_edge_stretch, report.max_edge_stretch_final, report.max_penetration_m
            );
            println!("state {:016x}", simulation.state_hash());
        }
    }
    Ok(())
}
