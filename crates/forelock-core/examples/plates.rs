//! Thin solids swept through 200 strands × 31 particles: what passes through them.
//!
//! The strands hang from a patch of 5 cm by 10 cm, straight or as a loose zigzag, no two alike. A
//! plate with its upper rim 3 cm below the roots crosses the patch and stops 12 cm behind it
//! (`push`), or goes on until all hair has slipped over its rim (`past`). Or a finger of 16 mm
//! crosses it 15 cm below the roots, or a comb 10 cm below, teeth first. Prints for each thickness
//! and speed:
//!
//! - the largest share of edges that intersect the solid at the end of a frame (the plate without
//!   the outer fifth of its thickness, the others without 0.8 and 0.3 mm);
//! - the share of particles that came from the front of the solid to its back in one frame: of a
//!   plate those so deep below its rim that they cannot have slipped over it, of a finger those of
//!   strands that lay in front of it and then hang behind it, with more of the strand below than
//!   can have slipped over it meanwhile; a comb lets hair through;
//! - the largest stretch of an edge one second after the solid stopped, and that of the same hair
//!   without a solid: springs without a length pass give way under the weight;
//! - the time, in milliseconds per frame.
//!
//! Edges are those of the solver's strands: `mass_spring` adds a particle between each two.
//!
//! `cargo run --release -p forelock-core --example plates -- [ams|dftl|mass_spring]
//! [plates|finger|comb]`

#![expect(clippy::print_stdout, reason = "an example that measures says what")]

use forelock_core::body::{ColliderFrame, Prop, Sdf, Shape};
use forelock_core::frame::{FrameInput, Solver};
use forelock_core::pose::Pose;
use forelock_core::simulation::{Options, Simulation};
use forelock_core::solver::{AmsParams, DftlParams, MassSpringParams};
use forelock_core::strands::Strands;
use glam::{DMat3, DQuat, DVec3};
use std::f64::consts::FRAC_PI_2;
use std::sync::Arc;
use std::time::Instant;

const STRANDS: u32 = 200;
const PARTICLES: u32 = 31;
const LENGTH: f64 = 0.3;
const DT: f64 = 1.0 / 60.0;
/// Depth of the rim below the roots, metres.
const RIM: f64 = 0.03;
const PATCH: f64 = 0.05;
/// Speed at which hair may slip over a finger by itself, m/s.
const OWN_SPEED: f64 = 2.0;

type Failure = Box<dyn std::error::Error + Send + Sync>;

fn main() -> Result<(), Failure> {
    let name = std::env::args().nth(1).unwrap_or_else(|| "ams".into());
    let solver: Solver<f32> = match name.as_str() {
        "ams" => (&AmsParams::default()).into(),
        "dftl" => (&DftlParams::default()).into(),
        "mass_spring" => (&MassSpringParams::default()).into(),
        _ => return Err("no such solver".into()),
    };
    let kind = std::env::args().nth(2).unwrap_or_else(|| "plates".into());
    let thicknesses: &[f64] = match kind.as_str() {
        "plates" => &[2.0, 5.0, 10.0, 20.0, 30.0, 80.0],
        "finger" => &[16.0],
        "comb" => &[2.7],
        _ => return Err("no such solid".into()),
    };
    println!("| hair | path | solid, mm | speed, m/s | edges inside | crossed | stretch after | free | ms |");
    println!("| --- | --- | --- | --- | --- | --- | --- | --- | --- |");
    for taut in [true, false] {
        for travel in [0.12, 0.5] {
            for &millimetres in thicknesses {
                for speed in [0.5, 1.0, 2.0, 5.0, 10.0] {
                    let half = 5e-4 * millimetres;
                    let solid = Solid::new(&kind, half, speed, travel + PATCH)?;
                    let found = sweep(&solver, taut, &solid)?;
                    println!(
                        "| {} | {} | {millimetres} | {speed} | {:.2} % | {:.2} % | {:.1} % | {:.1} % | {:.2} |",
                        if taut { "taut" } else { "slack" },
                        if travel < LENGTH { "push" } else { "past" },
                        100.0 * found.edges,
                        100.0 * found.crossed,
                        100.0 * found.stretch,
                        100.0 * found.free,
                        found.milliseconds,
                    );
                }
            }
        }
    }
    Ok(())
}

/// A solid and its path along x.
struct Solid {
    shape: Shape,
    /// Its place on the carrier.
    local: Pose,
    /// Half the thickness, metres.
    half: f64,
    /// Distance from the carrier to its front, metres.
    front: f64,
    speed: f64,
    travel: f64,
}

impl Solid {
    fn new(kind: &str, half: f64, speed: f64, travel: f64) -> Result<Self, Failure> {
        let (shape, turn, height, front) = match kind {
            "finger" => {
                let shape = Shape::Capsule { half_length: 0.1, radius: half };
                (shape, DQuat::from_rotation_x(FRAC_PI_2), -0.15, half)
            }
            "comb" => {
                let field = Sdf::from_mesh(&Prop::Comb.mesh(), Prop::Comb.field_nodes(), 0.008)?;
                // The spine along z, the teeth to +x.
                let turn = DMat3::from_cols(DVec3::Z, DVec3::NEG_X, DVec3::NEG_Y);
                (Shape::Sdf(Arc::new(field)), DQuat::from_mat3(&turn), -0.1, 0.045)
            }
            _ => {
                let half_extents = DVec3::new(half, 0.25, 0.2);
                (Shape::Box { half_extents }, DQuat::IDENTITY, -RIM - half_extents.y, half)
            }
        };
        let local = Pose::new(turn, DVec3::new(0.0, height, 0.0));
        Ok(Self { shape, local, half, front, speed, travel })
    }

    fn pose(&self, frame: u32) -> Pose {
        let gone = (self.speed * DT * f64::from(frame)).min(self.travel);
        Pose::new(DQuat::IDENTITY, DVec3::new(-0.02 - self.front + gone, 0.0, 0.0))
    }

    /// Whether the edge between two points in its local space is in it.
    fn contains(&self, a: DVec3, b: DVec3) -> bool {
        if let Shape::Box { half_extents } = self.shape {
            return intersects(half_extents - DVec3::splat(0.2 * self.half), a, b);
        }
        let skin = if matches!(self.shape, Shape::Capsule { .. }) { 8e-4 } else { 3e-4 };
        let inside = |k: i32| self.shape.sample(a.lerp(b, 0.125 * f64::from(k)).to_array()).0 < -skin;
        (0..=8).any(inside)
    }

    /// Particles that came from its front to its back. `before` and `now` are the particles of a
    /// strand at two frames' ends, relative to the carrier.
    fn crossed(&self, before: &[DVec3], now: &[DVec3]) -> usize {
        match self.shape {
            Shape::Box { .. } => {
                let is_deep = |x: &DVec3| x.y < -RIM - 0.01 - self.speed * DT && x.x.abs() > 0.2 * self.half;
                let through = |(a, b): &(&DVec3, &DVec3)| is_deep(a) && is_deep(b) && a.x > 0.0 && b.x < 0.0;
                before.iter().zip(now).filter(through).count()
            }
            Shape::Capsule { .. } => {
                let ([in_front, _], below) = self.around(before);
                let ([still, behind], _) = self.around(now);
                let edge = LENGTH / (before.len() - 1) as f64;
                let slips = edge * below as f64 <= self.speed * DT + OWN_SPEED * DT;
                if in_front > 0 && still <= 0 && behind > 0 && !slips { below } else { 0 }
            }
            _ => 0,
        }
    }

    /// How often a strand passes a finger's axis downwards in front of it and behind it, less how
    /// often it does so upwards; and the particles after the last place in front.
    fn around(&self, strand: &[DVec3]) -> ([i32; 2], usize) {
        let (mut passes, mut below) = ([0, 0], 0);
        let axis = self.local.translation;
        for (i, ends) in strand.windows(2).enumerate() {
            let [a, b] = [ends[0] - axis, ends[1] - axis];
            let down = i32::from(a.y > 0.0) - i32::from(b.y > 0.0);
            let is_behind = a.lerp(b, a.y / (a.y - b.y)).x < 0.0;
            passes[usize::from(is_behind)] += down;
            if down > 0 && !is_behind {
                below = strand.len() - 1 - i;
            }
        }
        (passes, below)
    }
}

#[derive(Default)]
struct Found {
    edges: f64,
    crossed: f64,
    stretch: f64,
    /// The same without a solid.
    free: f64,
    milliseconds: f64,
}

fn strands(taut: bool) -> Vec<[f32; 3]> {
    let mut positions = Vec::new();
    for s in 0..STRANDS {
        let along = f64::from(s % 10) + 0.05 * f64::from(s / 10);
        let root = DVec3::new(along * PATCH / 10.0, 0.0, 0.1 * (f64::from(s / 10) / 19.0 - 0.5));
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

fn sweep(solver: &Solver<f32>, taut: bool, solid: &Solid) -> Result<Found, Failure> {
    let rest = strands(taut);
    let offsets: Vec<u32> = (0..=STRANDS).map(|s| s * PARTICLES).collect();
    let gravity = DVec3::new(0.0, -9.81, 0.0);
    let options = Options { rest_gravity: gravity, ..Options::default() };
    let mut simulation = Simulation::from_strands(&Strands::new(&rest, &offsets), solver, &options)?;
    let mut free = Simulation::from_strands(&Strands::new(&rest, &offsets), solver, &options)?;
    let moving = (solid.travel / solid.speed / DT).ceil() as u32;
    let mut found = Found::default();
    // With the particles that a solver adds between those of the groom.
    let rest = chain(&simulation);
    let particles = rest.len() / STRANDS as usize;
    let mut last: Vec<DVec3> = rest.iter().map(|x| solid.pose(0).inverse().transform_point(*x)).collect();
    let mut crossed = 0;
    let clock = Instant::now();
    for frame in 0..moving + 60 {
        let (from, to) = (solid.pose(frame), solid.pose(frame + 1));
        let collider = ColliderFrame { shape: &solid.shape, local: solid.local, from, to, friction: 0.3 };
        let colliders = [collider];
        let input = FrameInput { colliders: &colliders, gravity, dt_secs: DT, ..FrameInput::default() };
        simulation.step_frame(&input)?;
        let positions = chain(&simulation);
        let own = solid.local.inverse().after(&to.inverse());
        let relative: Vec<DVec3> = positions.iter().map(|x| to.inverse().transform_point(*x)).collect();
        for (before, now) in last.chunks(particles).zip(relative.chunks(particles)) {
            crossed += solid.crossed(before, now);
        }
        last = relative;
        let mut inside = 0;
        for strand in positions.chunks(particles) {
            let strand: Vec<DVec3> = strand.iter().map(|x| own.transform_point(*x)).collect();
            inside += strand.windows(2).map(|ends| u32::from(solid.contains(ends[0], ends[1]))).sum::<u32>();
        }
        found.edges = found.edges.max(f64::from(inside) / (rest.len() as f64 - f64::from(STRANDS)));
        found.crossed = crossed as f64 / rest.len() as f64;
    }
    found.stretch = stretch(&chain(&simulation), &rest, particles);
    found.milliseconds = 1e3 * clock.elapsed().as_secs_f64() / f64::from(moving + 60);
    for _ in 0..moving + 60 {
        free.step_frame(&FrameInput { gravity, dt_secs: DT, ..FrameInput::default() })?;
    }
    found.free = stretch(&chain(&free), &rest, particles);
    Ok(found)
}

/// The largest stretch of an edge of strands of `particles`.
fn stretch(x: &[DVec3], rest: &[DVec3], particles: usize) -> f64 {
    let edges = x.chunks(particles).zip(rest.chunks(particles));
    let edges = edges.flat_map(|(x, r)| x.windows(2).zip(r.windows(2)));
    edges.map(|(x, r)| x[0].distance(x[1]) / r[0].distance(r[1]) - 1.0).fold(0.0, f64::max)
}

/// Where all particles of the solver's strands are.
fn chain(simulation: &Simulation) -> Vec<DVec3> {
    let state = simulation.snapshot();
    let place = |x: &[f32; 3]| DVec3::from(x.map(f64::from)) + DVec3::from(state.origin);
    state.positions.iter().map(place).collect()
}

/// Whether the segment from `a` to `b` meets the box of half size `half` about the origin.
fn intersects(half: DVec3, a: DVec3, b: DVec3) -> bool {
    let go = b - a;
    let (p, q) = ((-half - a) / go, (half - a) / go);
    p.min(q).max_element().max(0.0) < p.max(q).min_element().min(1.0)
}
