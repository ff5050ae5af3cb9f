//! Milliseconds per frame of a solver on the CPU, stage by stage: 10,298 strands × 30 particles on
//! the built-in head, with springs, both ghost ties, the length pass and the head's distance field
//! (128 cells, refined near the surface as in scenes, or all alike). The head turns or follows
//! another built-in motion.
//!
//! Every frame is timed in each of `repeats` runs from the same start, and the smallest time
//! counts, since other programs only add to it.
//!
//! `cargo run --release -p forelock-core --example frame_time -- [threads] [frames] [repeats]
//! [none|sph|RESOLUTION of the grid] [contacts|free] [motion] [SIMD|Auto] [ams|dftl]
//! [METRES of the largest cell near the surface; inf: all cells alike] [preset of growth]`

#![expect(clippy::print_stdout, reason = "an example that measures says what")]

use forelock_core::body::{ClosedMesh, ColliderFrame, Head, Motion, Sdf, Shape};
use forelock_core::frame::{Air, FrameInput, FrameReport};
use forelock_core::groom::grow::{GrowParams, grow_on_head};
use forelock_core::interaction::contact::ContactParams;
use forelock_core::interaction::grid::GridParams;
use forelock_core::interaction::sph::SphParams;
use forelock_core::lane::Simd;
use forelock_core::pose::Pose;
use forelock_core::simulation::{Options, Simulation};
use forelock_core::solver::{AmsParams, DftlParams, Solver};
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
    let mut interactions = Interactions::default();
    match arguments.next().as_deref() {
        None | Some("none") => {}
        Some("sph") => interactions.sph = Some(SphParams::default()),
        Some(resolution) => {
            interactions.grid = Some(GridParams { resolution: resolution.parse()?, ..GridParams::default() });
        }
    }
    interactions.contacts = arguments.next().is_some_and(|a| a == "contacts").then(ContactParams::default);
    let motion = Motion::by_name(arguments.next().as_deref().unwrap_or("turn"))?;
    let simd = match arguments.next().as_deref() {
        None | Some("Auto") => Simd::Auto,
        Some(name) => *Simd::ALL.iter().find(|s| format!("{s:?}") == name).ok_or("no such simd")?,
    };
    let solver = match arguments.next().as_deref() {
        None | Some("ams") => Solver::from(&AmsParams::default()),
        Some("dftl") => (&DftlParams::default()).into(),
        Some(_) => return Err("no such solver".into()),
    };
    let near = arguments.next().map_or(Ok(0.002), |a| a.parse())?;
    let preset = arguments.next().unwrap_or_else(|| "straight".to_owned());
    let closed = ClosedMesh::new(&Head::builtin().mesh);
    let clock = Instant::now();
    let field = Sdf::near(&closed, 128, 0.02, near)?;
    println!(
        "field: {:.1} MB in {:.2} s, cells of {:.2} mm near the surface",
        field.bytes() as f64 * 1e-6,
        clock.elapsed().as_secs_f64(),
        field.near_cell() * 1e3
    );
    let shape = Shape::Sdf(Arc::new(field));
    rayon::ThreadPoolBuilder::new().num_threads(threads).build()?.install(|| {
        run(
            threads,
            Count { frames, repeats, preset: &preset },
            &solver,
            &interactions,
            &motion,
            &shape,
            simd,
        )
    })
}

/// What is timed.
#[derive(Clone, Copy)]
struct Count<'a> {
    frames: u32,
    /// Runs from the same start.
    repeats: u32,
    /// Preset of growth.
    preset: &'a str,
}

/// The interactions of strands.
#[derive(Default)]
struct Interactions {
    grid: Option<GridParams>,
    sph: Option<SphParams>,
    contacts: Option<ContactParams>,
}

fn run(
    threads: usize,
    count: Count<'_>,
    solver: &Solver<f32>,
    interactions: &Interactions,
    motion: &Motion,
    shape: &Shape,
    simd: Simd,
) -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
    let Count { frames, repeats, preset } = count;
    let growth =
        GrowParams { strands: STRANDS, vertices_per_strand: PARTICLES, ..GrowParams::preset(preset)? };
    let groom = grow_on_head(&growth)?;
    let gravity = DVec3::new(0.0, -9.81, 0.0);
    let options = Options { simd, rest_gravity: gravity, ..Options::default() };
    let mut simulation = Simulation::new(&groom, solver, &options)?;
    simulation.set_grid(interactions.grid.as_ref())?;
    simulation.set_sph(interactions.sph.as_ref())?;
    simulation.set_contacts(interactions.contacts.as_ref())?;
    let start = simulation.snapshot();
    let dt_secs = 1.0 / 60.0;
    // Milliseconds: the whole frame, then each stage; one row per frame, the shortest time of all
    // runs.
    let mut times = vec![f64::INFINITY; frames as usize];
    let mut stages: Vec<(&str, Vec<f64>)> = Vec::new();
    let mut last = FrameReport::default();
    for _ in 0..repeats {
        simulation.restore(&start)?;
        for (frame, least) in (0..frames).zip(&mut times) {
            let head = [frame, frame + 1].map(|f| motion.pose(f64::from(f) * dt_secs));
            let collider =
                ColliderFrame { shape, local: Pose::IDENTITY, from: head[0], to: head[1], friction: 0.3 };
            let air_velocity = DVec3::ZERO;
            let clock = Instant::now();
            last = simulation.step_frame(&FrameInput {
                roots: head.into(),
                colliders: &[collider],
                gravity,
                air: Air::uniform(air_velocity),
                dt_secs,
                ..FrameInput::default()
            })?;
            *least = least.min(clock.elapsed().as_secs_f64() * 1e3);
            for (name, secs) in last.stages.iter() {
                if !stages.iter().any(|(own, _)| *own == name) {
                    stages.push((name, vec![f64::INFINITY; frames as usize]));
                }
                for (_, column) in stages.iter_mut().filter(|(own, _)| *own == name) {
                    let least = &mut column[frame as usize];
                    *least = least.min(secs * 1e3);
                }
            }
        }
    }
    println!(
        "{preset}, {STRANDS} x {PARTICLES}, {threads} thread(s), {:?}, {frames} frames, {repeats} run(s)",
        simd.resolve()
    );
    print_column("frame", "", times);
    stages.into_iter().for_each(|(name, column)| print_column(name, ", all threads together", column));
    println!(
        "stretch {:.1e}, after solids {:.1e}, penetration {:.1e} m",
        last.max_edge_stretch, last.max_edge_stretch_final, last.max_penetration_m
    );
    if interactions.sph.is_some() {
        println!("sph {:?}", last.sph);
    }
    if interactions.grid.is_some() {
        println!("grid {:?}", last.grid);
    }
    if interactions.contacts.is_some() {
        println!("contacts {:?}", last.strand_contacts);
    }
    println!("state {:016x}", simulation.state_hash());
    Ok(())
}

/// Prints the least, the median and the 95th percentile of `column`, milliseconds.
fn print_column(name: &str, note: &str, mut column: Vec<f64>) {
    column.sort_by(f64::total_cmp);
    let at = |share: usize| column[(column.len() - 1) * share / 100];
    println!("{name}: least {:.2}, median {:.2}, 95 % {:.2} ms{note}", at(0), at(50), at(95));
}
