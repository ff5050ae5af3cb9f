//! Milliseconds a frame of a solver on the CPU, stage by stage: 10,298 strands × 30 particles on the built-in head, with
//! springs, both ghost ties, the length pass and the head's distance field, the head turning or in another built-in motion.
//!
//! Every frame is timed in each of `repeats` runs from the same start, and its least time counts: on a machine that is
//! shared, the rest is other people's work.
//!
//! `cargo run --release -p forelock-core --example frame_time -- [threads] [frames] [repeats] [none|sph|RESOLUTION of the grid] [contacts|free] [motion] [SIMD|Auto] [ams|dftl]`

#![expect(clippy::print_stdout, reason = "an example that measures says what")]

use forelock_core::body::{ColliderFrame, Head, Motion, Sdf, Shape};
use forelock_core::contact::ContactParams;
use forelock_core::grid::GridParams;
use forelock_core::groom::grow::{GrowParams, grow_on_head};
use forelock_core::pose::Pose;
use forelock_core::solver::{
    AmsParams, DftlParams, Frame, FrameReport, Options, STAGES, Simd, Simulation, SolverParams,
};
use forelock_core::sph::SphParams;
use glam::DVec3;
use std::sync::Arc;
use std::time::Instant;

const STRANDS: u32 = 10_298;
const PARTICLES: u32 = 30;

fn main() -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
    let mut arguments = std::env::args().skip(1);
    let threads = arguments.next().map_or(Ok(2), |a| a.parse())?;
    let frames = arguments.next().map_or(Ok(120), |a| a.parse())?;
    let repeats = arguments.next().map_or(Ok(3), |a| a.parse())?;
    let mut meets = Meets::default();
    match arguments.next().as_deref() {
        None | Some("none") => {}
        Some("sph") => meets.particles = Some(SphParams::default()),
        Some(resolution) => {
            meets.grid = Some(GridParams { resolution: resolution.parse()?, ..GridParams::default() });
        }
    }
    meets.contacts = arguments.next().is_some_and(|a| a == "contacts").then(ContactParams::default);
    let motion = Motion::by_name(arguments.next().as_deref().unwrap_or("turn"))?;
    let simd = match arguments.next().as_deref() {
        None | Some("Auto") => Simd::Auto,
        Some(name) => *Simd::ALL.iter().find(|s| format!("{s:?}") == name).ok_or("no such simd")?,
    };
    let solver = match arguments.next().as_deref() {
        None | Some("ams") => SolverParams::from(&AmsParams::default()),
        Some("dftl") => (&DftlParams::default()).into(),
        Some(_) => return Err("no such solver".into()),
    };
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()?
        .install(|| run(threads, (frames, repeats), (&solver, &meets), &motion, simd))
}

/// Where strands meet.
#[derive(Default)]
struct Meets {
    grid: Option<GridParams>,
    particles: Option<SphParams>,
    contacts: Option<ContactParams>,
}

fn run(
    threads: usize,
    (frames, repeats): (u32, u32),
    (solver, meets): (&SolverParams, &Meets),
    motion: &Motion,
    simd: Simd,
) -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
    let preset = GrowParams::preset("straight")?;
    let groom = grow_on_head(&GrowParams { strands: STRANDS, vertices_per_strand: PARTICLES, ..preset })?;
    let shape = Shape::Sdf(Arc::new(Sdf::from_mesh(&Head::builtin().mesh, 128, 0.02)?));
    let gravity = DVec3::new(0.0, -9.81, 0.0);
    let options = Options { simd, rest_gravity: gravity, ..Options::default() };
    let mut simulation = Simulation::new(&groom, solver, &options)?;
    simulation.set_grid(meets.grid.as_ref())?;
    simulation.set_particles(meets.particles.as_ref())?;
    simulation.set_contacts(meets.contacts.as_ref())?;
    let start = simulation.snapshot();
    let dt_secs = 1.0 / 60.0;
    // Milliseconds: the whole frame, then each stage; a row a frame, the least of all runs.
    let mut times = vec![[f64::INFINITY; 1 + STAGES.len()]; frames as usize];
    let mut last = FrameReport::default();
    for _ in 0..repeats {
        simulation.restore(&start)?;
        for (frame, least) in (0..frames).zip(&mut times) {
            let head = [frame, frame + 1].map(|f| motion.pose(f64::from(f) * dt_secs));
            let collider = ColliderFrame {
                shape: &shape,
                local: Pose::IDENTITY,
                from: head[0],
                to: head[1],
                friction: 0.3,
            };
            let air_velocity = DVec3::ZERO;
            let clock = Instant::now();
            last = simulation.step_frame(&Frame {
                head,
                colliders: &[collider],
                gravity,
                air_velocity,
                dt_secs,
            })?;
            least[0] = least[0].min(clock.elapsed().as_secs_f64() * 1e3);
            for (least, (_, secs)) in least[1..].iter_mut().zip(last.stage_secs) {
                *least = least.min(secs * 1e3);
            }
        }
    }
    println!(
        "{STRANDS} x {PARTICLES}, {threads} thread(s), {:?}, {frames} frames, {repeats} run(s)",
        simd.resolve()
    );
    for (k, name) in ["frame"].iter().chain(&STAGES).enumerate() {
        let mut column: Vec<f64> = times.iter().map(|row| row[k]).collect();
        column.sort_by(f64::total_cmp);
        let at = |share: usize| column[(column.len() - 1) * share / 100];
        let whose = if k == 0 { "" } else { ", all threads together" };
        println!("{name}: least {:.2}, median {:.2}, 95 % {:.2} ms{whose}", at(0), at(50), at(95));
    }
    println!(
        "stretch {:.1e}, after solids {:.1e}, penetration {:.1e} m",
        last.max_edge_stretch, last.max_edge_stretch_final, last.max_penetration_m
    );
    if meets.particles.is_some() {
        println!("particles {:?}", last.particles);
    }
    if meets.grid.is_some() {
        println!("grid {:?}", last.grid);
    }
    if meets.contacts.is_some() {
        println!("contacts {:?}", last.strand_contacts);
    }
    println!("state {:016x}", simulation.state_hash());
    Ok(())
}
