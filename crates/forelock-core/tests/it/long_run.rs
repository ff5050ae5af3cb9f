//! Hair that is thrown about for a long time: nothing breaks, nothing leaks, nothing builds up.
//!
//! A head moves at random, alternating between gentle and wild, in gusts and turbulence, while a
//! ball moves through the hair. Strands interact on the grid, and in the short run through contacts
//! as well. The short run is part of the daily tests. The long one is ten minutes at 60 frames a
//! second:
//!
//! ```sh
//! cargo test --release -p forelock-core --test it -- --ignored long_ten_minutes --nocapture
//! ```

#![expect(clippy::unwrap_used, reason = "in a test a failure to build is a failure of the test")]
#![expect(clippy::print_stdout, reason = "a long run says how it goes")]

use forelock_core::air::{Wind, WindParams};
use forelock_core::body::{ColliderFrame, Head, Sdf, Shape};
use forelock_core::frame::{Air, FrameInput};
use forelock_core::groom::grow::{GrowParams, grow_on_head};
use forelock_core::interaction::contact::ContactParams;
use forelock_core::interaction::grid::GridParams;
use forelock_core::pose::Pose;
use forelock_core::simulation::{Options, Simulation};
use forelock_core::solver::AmsParams;
use forelock_core::strands::vector;
use glam::{DQuat, DVec3};
use std::f64::consts::TAU;
use std::sync::Arc;

const FPS: f64 = 60.0;

/// A value that wanders about 0 with a standard deviation of 1: seven cosines of seeded phases.
struct Wander([(f64, f64); 7]);

impl Wander {
    /// Frequencies of `slowest` Hz to five times that.
    fn new(seed: &mut u64, slowest: f64) -> Self {
        let mut unit = || {
            // SplitMix64 (Steele, Lea, Flood 2014).
            *seed = seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
            let z = (*seed ^ (*seed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
        };
        Self(std::array::from_fn(|_| (slowest * 5f64.powf(unit()), TAU * unit())))
    }

    fn at(&self, t: f64) -> f64 {
        let sum: f64 = self.0.iter().map(|(hertz, phase)| (TAU * hertz * t + phase).cos()).sum();
        sum * (2.0 / self.0.len() as f64).sqrt()
    }
}

fn wander3(seed: &mut u64, slowest: f64) -> [Wander; 3] {
    std::array::from_fn(|_| Wander::new(seed, slowest))
}

fn vector_of(wander: &[Wander; 3], t: f64) -> DVec3 {
    DVec3::from_array([0, 1, 2].map(|c| wander[c].at(t)))
}

/// What moves.
struct World {
    /// Time from gentle to wild and back, seconds.
    swell_secs: f64,
    place: [Wander; 3],
    turn: [Wander; 3],
    ball: [Wander; 3],
}

impl World {
    fn new(mut seed: u64, swell_secs: f64) -> Self {
        let seed = &mut seed;
        Self { swell_secs, place: wander3(seed, 0.5), turn: wander3(seed, 0.4), ball: wander3(seed, 0.15) }
    }

    /// The head moves by 7 cm and half a radian where it is wild, and by a twentieth of that where
    /// it is gentle.
    fn head(&self, t: f64) -> Pose {
        let wild = 0.525 - 0.475 * (TAU * t / self.swell_secs).cos();
        let pivot = Head::NECK_PIVOT.as_dvec3();
        let turned = DQuat::from_scaled_axis(vector_of(&self.turn, t) * (0.5 * wild));
        Pose::new(turned, pivot - turned * pivot + vector_of(&self.place, t) * (0.07 * wild))
    }

    /// The ball about the back of the neck, where the hair hangs.
    fn ball(&self, t: f64) -> Pose {
        let around = vector_of(&self.ball, t) * DVec3::new(0.12, 0.08, 0.08);
        Pose::new(DQuat::IDENTITY, DVec3::new(0.0, -0.12, -0.1) + around)
    }
}

/// Resident memory of this process in bytes, where the system tells (Linux).
fn resident_bytes() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    line.trim().strip_suffix("kB")?.trim().parse::<f64>().ok().map(|kib| kib * 1024.0)
}

/// Kinetic energy over mass of a particle, mean over all, m²/s².
fn energy(simulation: &Simulation) -> f64 {
    let model = simulation.model();
    let square = |place: usize, lane: usize| {
        vector(&simulation.state().velocities, place, lane).iter().map(|&v| f64::from(v).powi(2)).sum::<f64>()
    };
    let of = |block: &forelock_core::strands::Block| {
        block.range().flat_map(|place| (0..block.live).map(move |lane| square(place, lane))).sum::<f64>()
    };
    0.5 * model.blocks.iter().map(of).sum::<f64>() / model.particle_count as f64
}

/// What a run found, part by part of its time.
#[derive(Debug, Default)]
struct Found {
    /// Largest energy in each part, m²/s².
    energies: Vec<f64>,
    /// Resident memory at each part's end, bytes.
    resident: Vec<f64>,
    quarantined: u32,
    /// Largest speed of the head, m/s.
    fastest_head: f64,
    /// Deepest particle in a solid, metres.
    deepest: f64,
}

/// `frames` frames of `strands` strands, in `parts` parts. The motion goes from gentle to wild and
/// back in `swell_secs`.
fn run(strands: u32, frames: u32, parts: u32, swell_secs: f64, contacts: bool) -> Found {
    let preset = GrowParams::preset("wavy").unwrap();
    let groom = grow_on_head(&GrowParams { strands, ..preset }).unwrap();
    let gravity = DVec3::new(0.0, -9.81, 0.0);
    let options = Options { rest_gravity: gravity, ..Options::default() };
    let mut simulation = Simulation::new(&groom, &AmsParams::default(), &options).unwrap();
    simulation.set_grid(Some(&GridParams { resolution: 32, ..GridParams::default() })).unwrap();
    simulation.set_contacts(contacts.then(ContactParams::default).as_ref()).unwrap();
    let wind = WindParams {
        velocity: DVec3::new(3.0, 0.0, -2.0),
        gust_strength: 0.5,
        turbulence: 0.3,
        shelter: 0.8,
        hair_depth: 0.03,
        ..WindParams::default()
    };
    let wind = Wind::new(&wind).unwrap();
    let world = World::new(11, swell_secs);
    let shapes = [
        Shape::Sdf(Arc::new(Sdf::from_mesh(&Head::builtin().mesh, 96, 0.02).unwrap())),
        Shape::Sphere { radius: 0.05 },
    ];
    let mut found = Found::default();
    for frame in 0..frames {
        let times = [frame, frame + 1].map(|frame| f64::from(frame) / FPS);
        let head = times.map(|t| world.head(t));
        let solids = [(&shapes[0], head), (&shapes[1], times.map(|t| world.ball(t)))];
        let colliders = solids.map(|(shape, [from, to])| ColliderFrame {
            shape,
            local: Pose::IDENTITY,
            from,
            to,
            friction: 0.3,
        });
        let air_velocity = DVec3::ZERO;
        let of = FrameInput {
            roots: head.into(),
            colliders: &colliders,
            gravity,
            air: Air::uniform(air_velocity),
            dt_secs: 1.0 / FPS,
            ..FrameInput::default()
        };
        let report = simulation
            .step_frame(&FrameInput { air: Air { field: Some(&wind.at(times[0])), ..of.air }, ..of })
            .unwrap();
        found.quarantined += report.quarantined_strands;
        found.deepest = found.deepest.max(report.max_penetration_m);
        found.fastest_head =
            found.fastest_head.max((head[1].translation - head[0].translation).length() * FPS);
        let part = (u64::from(frame) * u64::from(parts) / u64::from(frames)) as usize;
        if found.energies.len() <= part {
            found.energies.push(0.0);
        }
        let energy = energy(&simulation);
        assert!(energy.is_finite(), "frame {frame}");
        found.energies[part] = found.energies[part].max(energy);
        if u64::from(frame + 1) * u64::from(parts) / u64::from(frames) > part as u64 {
            found.resident.extend(resident_bytes());
            let megabytes = found.resident.last().map_or(0.0, |bytes| bytes / 1e6);
            println!("frame {}: energy {:.3} m²/s², {megabytes:.2} MB", frame + 1, found.energies[part]);
        }
    }
    println!(
        "{strands} strands, {frames} frames: {} strands put back, head up to {:.1} m/s, depth at most {:.2} mm",
        found.quarantined,
        found.fastest_head,
        found.deepest * 1e3
    );
    found
}

/// No strand was put back, and energy in the second half is no greater than in the first.
fn holds(found: &Found) {
    assert_eq!(found.quarantined, 0);
    assert!(found.fastest_head > 1.0, "it should be wild: {}", found.fastest_head);
    let (first, second) = found.energies.split_at(found.energies.len() / 2);
    let most = |energies: &[f64]| energies.iter().copied().fold(0.0, f64::max);
    // Cosines of seven periods do not reach the same peak in every part.
    assert!(most(second) < 1.5 * most(first), "{:?}", found.energies);
}

/// A pool with one thread per core. Work handed in from outside a pool costs more than the work
/// itself.
fn pool() -> rayon::ThreadPool {
    rayon::ThreadPoolBuilder::new().build().unwrap()
}

#[test]
fn ten_seconds_leave_hair_whole() {
    holds(&pool().install(|| run(200, 600, 4, 2.5, true)));
}

#[test]
#[ignore = "long: cargo xtask ci --nightly"]
fn long_ten_minutes_leave_hair_whole() {
    let found = pool().install(|| run(2000, 36_000, 10, 20.0, false));
    holds(&found);
    // Memory is what it was after the first minute.
    if let [warm, .., last] = &*found.resident {
        assert!(last / warm < 1.01, "{:?}", found.resident);
    }
}
