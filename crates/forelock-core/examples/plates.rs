//! Thin plates swept through 200 strands × 31 particles: what passes through them.
//!
//! The strands hang from a patch of 5 cm by 10 cm, straight or as a loose zigzag. A plate with its
//! upper rim 3 cm below the roots crosses the patch and stops 12 cm behind it (`push`), or goes on
//! until all hair has slipped over its rim (`past`). Prints for each thickness and speed:
//!
//! - the largest share of edges that intersect the plate at the end of a frame (the plate without
//!   the outer fifth of its thickness);
//! - the share of particles that came from the front of the plate to its back in one frame, so deep
//!   below the rim that they cannot have slipped over it;
//! - the largest stretch of an edge one second after the plate stopped;
//! - the time, in milliseconds per frame.
//!
//! `cargo run --release -p forelock-core --example plates -- [ams|dftl|mass_spring]`

#![expect(clippy::print_stdout, reason = "an example that measures says what")]

use forelock_core::body::{ColliderFrame, Shape};
use forelock_core::frame::{FrameInput, Solver};
use forelock_core::pose::Pose;
use forelock_core::simulation::{Options, Simulation};
use forelock_core::solver::{AmsParams, DftlParams, MassSpringParams};
use forelock_core::strands::Strands;
use glam::{DQuat, DVec3};
use std::time::Instant;

const STRANDS: u32 = 200;
const PARTICLES: u32 = 31;
const LENGTH: f64 = 0.3;
const DT: f64 = 1.0 / 60.0;
/// Depth of the rim below the roots, metres.
const RIM: f64 = 0.03;
const PATCH: f64 = 0.05;

type Failure = Box<dyn std::error::Error + Send + Sync>;

fn main() -> Result<(), Failure> {
    let name = std::env::args().nth(1).unwrap_or_else(|| "ams".into());
    let solver: Solver<f32> = match name.as_str() {
        "ams" => (&AmsParams::default()).into(),
        "dftl" => (&DftlParams::default()).into(),
        "mass_spring" => (&MassSpringParams::default()).into(),
        _ => return Err("no such solver".into()),
    };
    println!("| hair | path | plate, mm | speed, m/s | edges inside | crossed | stretch after | ms |");
    println!("| --- | --- | --- | --- | --- | --- | --- | --- |");
    for taut in [true, false] {
        for travel in [0.12, 0.5] {
            for millimetres in [2.0, 5.0, 10.0, 20.0, 30.0, 80.0] {
                for speed in [0.5, 1.0, 2.0, 5.0, 10.0] {
                    let plate = Plate { half: 5e-4 * millimetres, speed, travel: travel + PATCH };
                    let found = sweep(&solver, taut, &plate)?;
                    println!(
                        "| {} | {} | {millimetres} | {speed} | {:.2} % | {:.2} % | {:.1} % | {:.2} |",
                        if taut { "taut" } else { "slack" },
                        if travel < LENGTH { "push" } else { "past" },
                        100.0 * found.edges,
                        100.0 * found.crossed,
                        100.0 * found.stretch,
                        found.milliseconds,
                    );
                }
            }
        }
    }
    Ok(())
}

/// A plate and its path along x.
struct Plate {
    /// Half the thickness, metres.
    half: f64,
    speed: f64,
    travel: f64,
}

impl Plate {
    fn pose(&self, frame: u32) -> Pose {
        let gone = (self.speed * DT * f64::from(frame)).min(self.travel);
        Pose::new(DQuat::IDENTITY, DVec3::new(-0.02 - self.half + gone, 0.0, 0.0))
    }
}

#[derive(Default)]
struct Found {
    edges: f64,
    crossed: f64,
    stretch: f64,
    milliseconds: f64,
}

fn strands(taut: bool) -> Vec<[f32; 3]> {
    let mut positions = Vec::new();
    for s in 0..STRANDS {
        let root = DVec3::new(f64::from(s % 10) * PATCH / 9.0, 0.0, 0.1 * (f64::from(s / 10) / 19.0 - 0.5));
        let (mut x, edge) = (root, LENGTH / f64::from(PARTICLES - 1));
        for i in 0..PARTICLES {
            positions.push(x.as_vec3().to_array());
            let side = if i / 2 % 2 == 0 { 0.9 } else { -0.9 };
            let bend: f64 = if taut || i == 0 { 0.0 } else { side };
            x += edge * DVec3::new(0.0, -bend.cos(), bend.sin());
        }
    }
    positions
}

fn sweep(solver: &Solver<f32>, taut: bool, plate: &Plate) -> Result<Found, Failure> {
    let rest = strands(taut);
    let offsets: Vec<u32> = (0..=STRANDS).map(|s| s * PARTICLES).collect();
    let gravity = DVec3::new(0.0, -9.81, 0.0);
    let options = Options { rest_gravity: gravity, ..Options::default() };
    let mut simulation = Simulation::from_strands(&Strands::new(&rest, &offsets), solver, &options)?;
    let half_extents = DVec3::new(plate.half, 0.25, 0.2);
    let shape = Shape::Box { half_extents };
    let local = Pose::new(DQuat::IDENTITY, DVec3::new(0.0, -RIM - half_extents.y, 0.0));
    let moving = (plate.travel / plate.speed / DT).ceil() as u32;
    let mut found = Found::default();
    let mut positions = Vec::new();
    let (mut sides, mut crossed) = (vec![0.0; rest.len()], 0);
    let clock = Instant::now();
    for frame in 0..moving + 60 {
        let (from, to) = (plate.pose(frame), plate.pose(frame + 1));
        let collider = ColliderFrame { shape: &shape, local, from, to, friction: 0.3 };
        let colliders = [collider];
        let input = FrameInput { colliders: &colliders, gravity, dt_secs: DT, ..FrameInput::default() };
        simulation.step_frame(&input)?;
        simulation.positions(&mut positions);
        let inverse = to.after(&local).inverse();
        let core = DVec3::new(0.8 * plate.half, half_extents.y - 0.2 * plate.half, half_extents.z);
        let (mut inside, mut place) = (0, 0);
        for strand in positions.chunks(PARTICLES as usize) {
            let strand: Vec<DVec3> = strand.iter().map(|x| inverse.transform_point(x.as_dvec3())).collect();
            inside +=
                strand.windows(2).map(|ends| u32::from(intersects(core, ends[0], ends[1]))).sum::<u32>();
            // A particle that was deep in front of the plate and is deep behind it has not come
            // over the rim in one frame.
            let deep = half_extents.y - 0.01 - plate.speed * DT;
            for x in &strand {
                let side = if x.y < deep && x.x.abs() > 0.2 * plate.half { x.x.signum() } else { 0.0 };
                crossed += u32::from(side < 0.0 && sides[place] > 0.0);
                sides[place] = side;
                place += 1;
            }
        }
        found.edges = found.edges.max(f64::from(inside) / f64::from(STRANDS * (PARTICLES - 1)));
        found.crossed = f64::from(crossed) / f64::from(STRANDS * PARTICLES);
        if frame + 1 == moving + 60 {
            for (x, r) in positions.chunks(PARTICLES as usize).zip(rest.chunks(PARTICLES as usize)) {
                for i in 1..x.len() {
                    let l = glam::Vec3::from(r[i]).distance(glam::Vec3::from(r[i - 1]));
                    found.stretch = found.stretch.max(f64::from((x[i].distance(x[i - 1]) / l - 1.0).abs()));
                }
            }
        }
    }
    found.milliseconds = 1e3 * clock.elapsed().as_secs_f64() / f64::from(moving + 60);
    Ok(found)
}

/// Whether the segment from `a` to `b` meets the box of half size `half` about the origin.
fn intersects(half: DVec3, a: DVec3, b: DVec3) -> bool {
    let go = b - a;
    let (p, q) = ((-half - a) / go, (half - a) / go);
    p.min(q).max_element().max(0.0) < p.max(q).min_element().min(1.0)
}
