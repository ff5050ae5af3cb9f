//! What a frame of sleeping hair takes, and when hair falls asleep after a shake: 10,298 strands ×
//! 30 particles on the built-in head, alone, with the grid, and with grid and contacts.
//!
//! First the head is at rest: the median of frames in which hair is kept awake (no sleep speed), of
//! those in which it sleeps, and their ratio. With `shake` the head is shaken at 4 g for two
//! seconds and held; each line has the strands that sleep and those that are still.
//!
//! `cargo run --release -p forelock-core --example sleep -- [threads] [shake SECONDS
//! [MOTION [alone|grid|contacts]]]`

#![expect(clippy::print_stdout, reason = "an example that measures says what")]

use forelock_core::body::{ClosedMesh, ColliderFrame, Head, Motion, Sdf, Shape};
use forelock_core::frame::{FrameInput, FrameReport};
use forelock_core::groom::Groom;
use forelock_core::groom::grow::{GrowParams, grow_on_head};
use forelock_core::interaction::Interactions;
use forelock_core::interaction::contact::ContactParams;
use forelock_core::interaction::grid::GridParams;
use forelock_core::pose::Pose;
use forelock_core::simulation::{Options, Simulation};
use forelock_core::solver::AmsParams;
use glam::{DVec3, Vec3};
use std::sync::Arc;
use std::time::Instant;

type AnyError = Box<dyn std::error::Error + Send + Sync>;

const STRANDS: u32 = 10_298;
const PARTICLES: u32 = 30;
const GRAVITY: DVec3 = DVec3::new(0.0, -9.81, 0.0);
const DT_SECS: f64 = 1.0 / 60.0;
/// Motion in a frame below which a strand counts as still in the table, mm.
const STILL_MM: f32 = 0.01;
/// The sleep speed of scenes, m/s.
const SPEED: f64 = 2e-3;

fn main() -> Result<(), AnyError> {
    let mut arguments = std::env::args().skip(1);
    let threads = arguments.next().map_or(Ok(2), |a| a.parse())?;
    let shaken = arguments.next().is_some_and(|a| a == "shake");
    let secs: u32 = arguments.next().map_or(Ok(20), |a| a.parse())?;
    let motion = Motion::by_name(arguments.next().as_deref().unwrap_or("shake"))?;
    let only = arguments.next();
    let field = Sdf::near(&ClosedMesh::new(&Head::builtin().mesh), 128, 0.02, 0.002)?;
    let head = Shape::Sdf(Arc::new(field));
    let preset = GrowParams::preset("straight")?;
    let groom = grow_on_head(&GrowParams { strands: STRANDS, vertices_per_strand: PARTICLES, ..preset })?;
    rayon::ThreadPoolBuilder::new().num_threads(threads).build()?.install(|| {
        println!("{STRANDS} x {PARTICLES}, {threads} thread(s)");
        for (name, interactions) in kinds() {
            if only.as_ref().is_some_and(|only| only != name) {
                continue;
            }
            if shaken {
                shake(name, &groom, &interactions, &head, &motion, secs)?;
            } else {
                rest(name, &groom, &interactions, &head)?;
            }
        }
        Ok(())
    })
}

/// The interactions to measure.
fn kinds() -> [(&'static str, Interactions); 3] {
    let grid = Some(GridParams::default());
    [
        ("alone", Interactions::default()),
        ("grid", Interactions { grid: grid.clone(), ..Interactions::default() }),
        (
            "contacts",
            Interactions { grid, contacts: Some(ContactParams::default()), ..Interactions::default() },
        ),
    ]
}

fn simulation(groom: &Groom, interactions: &Interactions, speed: f64) -> Result<Simulation, AnyError> {
    let options = Options { rest_gravity: GRAVITY, sleep_speed: speed, ..Options::default() };
    let mut simulation = Simulation::new(groom, &AmsParams::default(), &options)?;
    simulation.set_interactions(interactions)?;
    Ok(simulation)
}

/// A frame in which the head moves between two poses; its milliseconds.
fn step(simulation: &mut Simulation, head: &Shape, poses: [Pose; 2]) -> Result<(FrameReport, f64), AnyError> {
    let [from, to] = poses;
    let collider = ColliderFrame { shape: head, local: Pose::IDENTITY, from, to, friction: 0.3 };
    let frame = FrameInput {
        roots: poses.into(),
        colliders: &[collider],
        gravity: GRAVITY,
        dt_secs: DT_SECS,
        ..FrameInput::default()
    };
    let clock = Instant::now();
    let report = simulation.step_frame(&frame)?;
    Ok((report, clock.elapsed().as_secs_f64() * 1e3))
}

/// Frames of hair at rest, kept awake and asleep.
fn rest(name: &str, groom: &Groom, interactions: &Interactions, head: &Shape) -> Result<(), AnyError> {
    let still = [Pose::IDENTITY; 2];
    let mut medians = Vec::new();
    for speed in [0.0, SPEED] {
        let mut simulation = simulation(groom, interactions, speed)?;
        for _ in 0..70 {
            step(&mut simulation, head, still)?;
        }
        let (mut times, mut asleep) = (Vec::new(), u32::MAX);
        for _ in 0..60 {
            let (report, ms) = step(&mut simulation, head, still)?;
            times.push(ms);
            asleep = asleep.min(report.sleeping_strands);
        }
        times.sort_by(f64::total_cmp);
        println!("{name}: {asleep} strands sleep, least {:.4}, median {:.4} ms", times[0], times[30]);
        medians.push(times[30]);
    }
    println!("{name}: asleep over awake {:.5}", medians[1] / medians[0]);
    Ok(())
}

/// Two seconds of a motion, then `secs` in which the head is held.
fn shake(
    name: &str,
    groom: &Groom,
    interactions: &Interactions,
    head: &Shape,
    motion: &Motion,
    secs: u32,
) -> Result<(), AnyError> {
    let mut simulation = simulation(groom, interactions, SPEED)?;
    let pose = |frame: u32| motion.pose(f64::from(frame.min(120)) * DT_SECS);
    let [mut second, mut before, mut now] = [Vec::new(), Vec::new(), Vec::new()];
    simulation.positions(&mut second);
    for frame in 0..120 + 60 * secs {
        simulation.positions(&mut before);
        let (report, ms) = step(&mut simulation, head, [frame, frame + 1].map(pose))?;
        if frame % 60 == 59 {
            let sleep = simulation.snapshot().sleep;
            let still = sleep.map_or(0, |own| own.still_secs.iter().filter(|secs| **secs >= 0.99).count());
            println!(
                "{name}: {} s after the shake {} sleep, {still} are still, {ms:.2} ms, {} contacts",
                (f64::from(frame) + 1.0) / 60.0 - 2.0,
                report.sleeping_strands,
                report.strand_contacts.contacts
            );
            simulation.positions(&mut now);
            print_motion(&now, &before, &second);
            second.clone_from(&now);
        }
    }
    Ok(())
}

/// Prints how many strands moved in a frame, and for those that moved farthest, how far in the
/// frame and in a second.
fn print_motion(now: &[Vec3], before: &[Vec3], second: &[Vec3]) {
    let mm = |from: &[Vec3], p: usize| 1e3 * now[p].distance(from[p]);
    let strands = now.len() / PARTICLES as usize;
    let mut moving: Vec<(f32, usize)> = (0..strands)
        .filter_map(|s| {
            let particles = s * PARTICLES as usize..(s + 1) * PARTICLES as usize;
            let (farthest, p) = particles.map(|p| (mm(before, p), p)).max_by(|a, b| a.0.total_cmp(&b.0))?;
            (farthest > STILL_MM).then_some((farthest, p))
        })
        .collect();
    moving.sort_by(|a, b| b.0.total_cmp(&a.0));
    println!("  {} strands moved by more than {STILL_MM} mm in the last frame", moving.len());
    for (farthest, p) in moving.iter().take(5) {
        let (strand, particle) = (p / PARTICLES as usize, p % PARTICLES as usize);
        let at = now[*p];
        println!(
            "    strand {strand}, particle {particle} at {at:.3}: {farthest:.4} mm, in a second {:.3} mm",
            mm(second, *p)
        );
    }
}
