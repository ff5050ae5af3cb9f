//! AMS and XPBD Cosserat rods at equal error: milliseconds a frame, the largest stretch of an edge,
//! and the distance from the same solver's own limit of small steps.
//!
//! Curls of 25 particles and 30 cm hang from a head that turns by 60° in 0.3 s and stands still
//! until 1 s. Errors are those of 32 strands in float32, against float64 with the finest substep;
//! times are those of 3,008 strands on `threads` threads: medians of runs, the least of `repeats`.
//!
//! `cargo run --release -p forelock-core --example equal_error -- [threads] [repeats]`

#![expect(clippy::print_stdout, reason = "an example that measures says what")]

use std::time::Instant;

use forelock_core::frame::FrameInput;
use forelock_core::lane::Simd;
use forelock_core::pose::Pose;
use forelock_core::simulation::{Options, Simulation, SimulationReal};
use forelock_core::solver::ams::Inextensibility;
use forelock_core::solver::{AmsParams, Solver, XpbdParams};
use forelock_core::strands::Strands;
use glam::{DQuat, DVec3};

type Failure = Box<dyn std::error::Error + Send + Sync>;

const PARTICLES: usize = 25;
const FRAMES: u32 = 60;
const DT_SECS: f64 = 1.0 / 60.0;
const GRAVITY: DVec3 = DVec3::new(0.0, -9.81, 0.0);

fn main() -> Result<(), Failure> {
    let mut arguments = std::env::args().skip(1);
    let threads = arguments.next().map_or(Ok(2), |a| a.parse())?;
    let repeats = arguments.next().map_or(Ok(3), |a| a.parse())?;
    rayon::ThreadPoolBuilder::new().num_threads(threads).build()?.install(|| measure(repeats))
}

fn measure(repeats: u32) -> Result<(), Failure> {
    println!("| solver | lengths | substep, s | ms a frame | largest stretch | from its limit, RMS mm |");
    println!("| --- | --- | ---: | ---: | ---: | ---: |");
    for lengths in [Inextensibility::Projection, Inextensibility::Off] {
        let ams =
            |substep_secs: f64| AmsParams { substep_secs, inextensibility: lengths, ..AmsParams::default() };
        let limit = course::<f64>(&(&ams(1.0 / 7680.0)).into())?.0;
        for per_frame in [1, 2, 4, 8, 16] {
            let substep = DT_SECS / f64::from(per_frame);
            report("AMS", lengths, per_frame, &(&ams(substep)).into(), &limit, repeats)?;
        }
    }
    for lengths in [Inextensibility::Projection, Inextensibility::Off] {
        let xpbd = |substep_secs: f64| XpbdParams {
            substep_secs,
            inextensibility: lengths,
            ..XpbdParams::default()
        };
        let limit = course::<f64>(&(&xpbd(1.0 / 96_000.0)).into())?.0;
        for per_frame in [10, 25, 50, 100, 200] {
            let substep = DT_SECS / f64::from(per_frame);
            report("XPBD", lengths, per_frame, &(&xpbd(substep)).into(), &limit, repeats)?;
        }
    }
    Ok(())
}

fn report(
    name: &str,
    lengths: Inextensibility,
    per_frame: u32,
    solver: &Solver<f32>,
    limit: &[Vec<DVec3>],
    repeats: u32,
) -> Result<(), Failure> {
    let (course, stretch) = course::<f32>(solver)?;
    let (mut sum, mut count) = (0.0, 0.0);
    for (a, b) in course.iter().flatten().zip(limit.iter().flatten()) {
        sum += a.distance_squared(*b);
        count += 1.0;
    }
    let ms = (0..repeats).map(|_| time(solver)).collect::<Result<Vec<_>, _>>()?;
    let ms = ms.into_iter().fold(f64::INFINITY, f64::min);
    println!(
        "| {name} | {} | 1/{} | {ms:.2} | {:.2e} | {:.3} |",
        if lengths == Inextensibility::Off { "springs" } else { "pass" },
        60 * per_frame,
        stretch,
        1e3 * f64::sqrt(sum / count)
    );
    Ok(())
}

/// The head at `secs`: it turns about the vertical, smoothly.
fn head(secs: f64) -> Pose {
    let share = (secs / 0.3).clamp(0.0, 1.0);
    let smooth = share * share * (3.0 - 2.0 * share);
    Pose::new(DQuat::from_rotation_y(smooth * 60f64.to_radians()), DVec3::ZERO)
}

/// `count` curls on a ring around the head's axis.
fn simulation<T: SimulationReal>(count: usize, solver: &Solver<T>) -> Result<Simulation<T>, Failure> {
    let number = |c: f64| T::from(c).ok_or("a number that is too large");
    let mut positions = Vec::new();
    for strand in 0..count {
        let angle = 2.4 * strand as f64;
        let root = DVec3::new(0.09 * angle.cos(), 1e-4 * strand as f64, 0.09 * angle.sin());
        for i in 0..PARTICLES {
            let along = i as f64 / (PARTICLES - 1) as f64;
            let turn = 3.0 * std::f64::consts::TAU * along + angle;
            let out = 0.01 * (along * 4.0).min(1.0);
            let x = root + DVec3::new(out * turn.cos(), -0.25 * along, out * turn.sin());
            positions.push([number(x.x)?, number(x.y)?, number(x.z)?]);
        }
    }
    let offsets: Vec<u32> = (0..=count).map(|strand| (strand * PARTICLES) as u32).collect();
    let options = Options { simd: Simd::Auto, rest_gravity: GRAVITY, ..Options::default() };
    Ok(Simulation::from_strands(&Strands::new(&positions, &offsets), solver.clone(), &options)?)
}

/// Positions after each frame, and the largest stretch of an edge.
fn course<T: SimulationReal>(solver: &Solver<T>) -> Result<(Vec<Vec<DVec3>>, f64), Failure> {
    let mut simulation = simulation(32, solver)?;
    let (mut course, mut stretch) = (Vec::new(), 0.0f64);
    for frame in 0..FRAMES {
        let report = simulation.step_frame(&input(frame))?;
        stretch = stretch.max(report.max_edge_stretch);
        let snapshot = simulation.snapshot();
        let origin = DVec3::from(snapshot.origin);
        let vector = |x: &[T; 3]| DVec3::from(x.map(|c| c.to_f64().unwrap_or(f64::NAN)));
        course.push(snapshot.positions.iter().map(|x| origin + vector(x)).collect());
    }
    Ok((course, stretch))
}

fn input(frame: u32) -> FrameInput<'static> {
    let at = [frame, frame + 1].map(|frame| head(f64::from(frame) * DT_SECS));
    FrameInput { roots: at.into(), gravity: GRAVITY, dt_secs: DT_SECS, ..FrameInput::default() }
}

/// Milliseconds a frame, the median of a run.
fn time(solver: &Solver<f32>) -> Result<f64, Failure> {
    let mut simulation = simulation(3008, solver)?;
    let mut times = Vec::new();
    for frame in 0..FRAMES {
        let clock = Instant::now();
        simulation.step_frame(&input(frame))?;
        times.push(clock.elapsed().as_secs_f64() * 1e3);
    }
    times.sort_by(f64::total_cmp);
    Ok(times[times.len() / 2])
}
