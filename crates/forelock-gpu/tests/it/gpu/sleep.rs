//! Sleep on the device: all strands fall asleep together and wake on the causes of the CPU.

#![expect(clippy::unwrap_used, reason = "in a test a failure to build is a failure of the test")]

use crate::common;
use crate::common::shaken::{GRAVITY, tuft};
use forelock_core::air::WindField;
use forelock_core::body::{ColliderFrame, Shape};
use forelock_core::frame::{Air, FrameInput, FrameReport, Roots};
use forelock_core::groom::Groom;
use forelock_core::groom::edit::Source;
use forelock_core::interaction::contact::{CREEP_SECS, ContactParams};
use forelock_core::interaction::grid::GridParams;
use forelock_core::pose::Pose;
use forelock_core::simulation::{Options, Simulation, Teleport};
use forelock_core::simulator::{HostPositions, Simulator};
use forelock_core::solver::{AmsParams, DftlParams, Solver, XpbdParams};
use forelock_core::strands::{SLEEP_SECS, Snapshot as State};
use forelock_gpu::GpuSimulation;
use glam::{DVec3, Vec3};

/// A change of a simulation, and its name.
type Change<'a> = (&'static str, &'a dyn Fn(&mut dyn Simulator));

const DT: f64 = 1.0 / 60.0;
const STRANDS: u32 = 40;
const SPEED: f64 = 1e-3;

fn groom() -> Groom {
    let (positions, offsets) = tuft(STRANDS, |_| 8, [0.001, 0.01]);
    let strand = |ends: &[u32]| {
        positions[ends[0] as usize..ends[1] as usize].iter().map(|p| Vec3::from_array(*p)).collect::<Vec<_>>()
    };
    Groom::from_strands(offsets.windows(2).map(strand)).unwrap()
}

fn options(sleep_speed: f64) -> Options {
    Options { rest_gravity: GRAVITY, sleep_speed, ..Options::default() }
}

fn simulation(solver: &Solver<f32>, sleep_speed: f64) -> GpuSimulation {
    let mut simulation = GpuSimulation::new(&common::gpu(), &groom(), solver, &options(sleep_speed)).unwrap();
    simulation.time_stages(true);
    simulation
}

/// The largest distance between two vectors of the same number.
fn far(a: &[[f32; 3]], b: &[[f32; 3]]) -> f32 {
    a.iter().zip(b).map(|(a, b)| Vec3::from(*a).distance((*b).into())).fold(0.0, f32::max)
}

fn at(x: f64) -> Pose {
    Pose { translation: DVec3::X * x, ..Pose::IDENTITY }
}

fn still() -> FrameInput<'static> {
    FrameInput { gravity: GRAVITY, dt_secs: DT, ..FrameInput::default() }
}

fn step(simulator: &mut dyn Simulator, frame: &FrameInput<'_>) -> FrameReport {
    simulator.step(frame).unwrap()
}

/// Frames until everything sleeps, at most `most`.
fn frames_to_sleep(simulator: &mut dyn Simulator, most: u32) -> Option<u32> {
    (1..=most).find(|_| step(simulator, &still()).sleeping_strands == STRANDS)
}

/// After half a second in which the head moves by 5 cm and back.
fn moved(solver: &Solver<f32>, sleep_speed: f64) -> GpuSimulation {
    let mut simulation = simulation(solver, sleep_speed);
    let place = |frame: u32| at(0.025 * (1.0 - (f64::from(frame) / 30.0 * std::f64::consts::TAU).cos()));
    for frame in 0..30 {
        let roots = Roots::Rigid([place(frame), if frame == 29 { at(0.0) } else { place(frame + 1) }]);
        step(&mut simulation, &FrameInput { roots, ..still() });
    }
    simulation
}

#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn hair_falls_asleep_where_it_comes_to_rest() {
    // Damped enough to come to rest within the test.
    let rods = XpbdParams { drag: 8.0, ..XpbdParams::default() };
    for solver in
        [Solver::from(&AmsParams::default()), Solver::from(&DftlParams::default()), Solver::from(&rods)]
    {
        let mut sleeper = moved(&solver, SPEED);
        let frames = frames_to_sleep(&mut sleeper, 600).unwrap();
        assert!(frames > 62, "{frames}: it moved");
        let asleep = sleeper.snapshot().unwrap();
        // The frame that follows does nothing, not even on the device's clock.
        let report = step(&mut sleeper, &still());
        assert_eq!((report.sleeping_strands, report.device_secs), (STRANDS, None));
        assert_eq!(report.stages.iter().count(), 0);
        assert_eq!(sleeper.snapshot().unwrap(), asleep);
        let mut awake = moved(&solver, 0.0);
        assert_eq!(frames_to_sleep(&mut awake, frames + 300), None);
        let there = awake.snapshot().unwrap().positions;
        let away = far(&asleep.positions, &there);
        println!("{}: asleep after {frames} frames, {:.4} mm away", solver.name(), away * 1e3);
        assert!(away < 1e-4, "{away}");
    }
}

#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn each_cause_wakes() {
    let ams = Solver::from(&AmsParams::default());
    let mut own = simulation(&ams, SPEED);
    frames_to_sleep(&mut own, 70).unwrap();
    let state = own.snapshot().unwrap();
    let shape = Shape::Sphere { radius: 0.02 };
    let ball = |from: f64, to: f64| {
        let [from, to] =
            [from, to].map(|z| Pose { translation: DVec3::new(0.02, -0.1, z), ..Pose::IDENTITY });
        [ColliderFrame { shape: &shape, local: Pose::IDENTITY, from, to, friction: 0.3 }]
    };
    let (far, near) = (ball(3.0, 2.9), ball(0.5, 0.05));
    let wind = WindField { mean: DVec3::Z, ..WindField::default() };
    let frames = [
        ("nothing", still(), STRANDS),
        ("a collider far away", FrameInput { colliders: &far, ..still() }, STRANDS),
        ("a collider that comes near", FrameInput { colliders: &near, ..still() }, 0),
        ("the head moves", FrameInput { roots: Roots::Rigid([at(0.0), at(1e-5)]), ..still() }, 0),
        ("the head is elsewhere", FrameInput { roots: Roots::Rigid([at(1e-4); 2]), ..still() }, 0),
        ("gravity", FrameInput { gravity: 1.01 * GRAVITY, ..still() }, 0),
        ("air", FrameInput { air: Air::uniform(DVec3::X), ..still() }, 0),
        ("wind", FrameInput { air: Air { velocity: DVec3::ZERO, field: Some(&wind) }, ..still() }, 0),
    ];
    for (name, frame, expected) in frames {
        Simulator::restore(&mut own, &state).unwrap();
        assert_eq!(step(&mut own, &frame).sleeping_strands, expected, "{name}");
    }
    let sources: Vec<Source> = (0..STRANDS).map(|strand| Source { strand, fresh: false }).collect();
    let changes: [Change<'_>; 7] = [
        ("parameters", &|own| own.set_params(&ams).unwrap()),
        ("grid", &|own| {
            let grid = Some(GridParams::default());
            own.set_interactions(&forelock_core::interaction::Interactions { grid, ..Default::default() })
                .unwrap();
        }),
        ("no grid", &|own| own.set_interactions(&Default::default()).unwrap()),
        ("colliders", &|own| own.forget_solids().unwrap()),
        ("teleport", &|own| own.teleport(&at(0.0), &at(0.0), Teleport::CarryShape).unwrap()),
        ("speed", &|own| own.set_sleep_speed(2e-3)),
        ("edit", &|own| own.regroom(&groom(), &sources, &Pose::IDENTITY).unwrap()),
    ];
    for (name, change) in changes {
        Simulator::restore(&mut own, &state).unwrap();
        assert_eq!(step(&mut own, &still()).sleeping_strands, STRANDS);
        change(&mut own);
        assert_eq!(step(&mut own, &still()).sleeping_strands, 0, "{name}");
    }
}

/// A snapshot of hair that is about to sleep goes on bit for bit, and sleeping hair of the GPU
/// sleeps on the CPU.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn snapshots_hold_sleep() {
    let ams = Solver::from(&AmsParams::default());
    let mut whole = moved(&ams, SPEED);
    (0..90).for_each(|_| {
        step(&mut whole, &still());
    });
    let cut = whole.snapshot().unwrap();
    let mut second = simulation(&ams, SPEED);
    Simulator::restore(&mut second, &cut).unwrap();
    assert_eq!(second.snapshot().unwrap(), cut);
    let frames = frames_to_sleep(&mut whole, 600).unwrap();
    assert_eq!(frames_to_sleep(&mut second, 600), Some(frames));
    let asleep = whole.snapshot().unwrap();
    assert_eq!(second.state_hash().unwrap(), asleep.hash());
    let cpu = Simulation::new(&groom(), &ams, &options(SPEED)).unwrap();
    let mut cpu = HostPositions::new(cpu);
    cpu.restore(&asleep).unwrap();
    assert_eq!(step(&mut cpu, &still()).sleeping_strands, STRANDS);
    assert_eq!(cpu.snapshot().unwrap(), asleep);
}

/// Friction in still surroundings does on the device what it does on the CPU: it holds some strands
/// and slows the others down.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn friction_is_that_of_the_cpu() {
    for solver in [Solver::from(&AmsParams::default()), Solver::from(&DftlParams::default())] {
        let mut device = moved(&solver, SPEED);
        (0..60).for_each(|_| {
            step(&mut device, &still());
        });
        let from = device.snapshot().unwrap();
        let after = |calm_secs: f64| {
            let mut from = from.clone();
            from.sleep.as_mut().unwrap().calm_secs = calm_secs;
            let mut host = HostPositions::new(Simulation::new(&groom(), &solver, &options(SPEED)).unwrap());
            let mut device = simulation(&solver, SPEED);
            let simulators: [&mut dyn Simulator; 2] = [&mut host, &mut device];
            simulators.map(|own| {
                own.restore(&from).unwrap();
                step(own, &still());
                own.snapshot().unwrap()
            })
        };
        let free = after(0.0);
        let [host, device] = after(60.0);
        let [x, v] = [far(&host.positions, &device.positions), far(&host.velocities, &device.velocities)];
        let slowed = far(&host.velocities, &free[0].velocities);
        let per_strand = from.positions.len() / STRANDS as usize;
        let held = |own: &State<f32>| {
            let strands = own.positions.chunks(per_strand).zip(from.positions.chunks(per_strand));
            strands.filter(|(now, before)| far(now, before) == 0.0).count()
        };
        let counts = [&host, &device, &free[0], &free[1]].map(held);
        println!("{}: {x:.1e} m, {v:.1e} m/s apart, slowed by {slowed:.1e}, held {counts:?}", solver.name());
        assert!(x < 1e-6 && v < 1e-4, "{x} {v}");
        assert!(slowed > 100.0 * v, "{slowed}");
        assert_eq!([counts[0], counts[2], counts[3]], [counts[1], 0, 0]);
        assert!((1..STRANDS as usize).contains(&counts[0]), "{counts:?}");
    }
}

/// Friction between neighbours fades in still surroundings as it does on the CPU.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn friction_between_neighbours_fades_as_on_the_cpu() {
    let solver = Solver::from(&AmsParams::default());
    // No contact is resolved, so that friction alone acts.
    let with = |hold| ContactParams { hold, slip: 1000.0, ..ContactParams::default() };
    let mut from = moved(&solver, SPEED);
    step(&mut from, &still());
    let from = from.snapshot().unwrap();
    let after = |calm_secs: f64, contacts: &ContactParams| {
        let mut from = from.clone();
        from.sleep.as_mut().unwrap().calm_secs = calm_secs;
        let mut host = Simulation::new(&groom(), &solver, &options(SPEED)).unwrap();
        host.set_contacts(Some(contacts)).unwrap();
        let (mut host, mut device) = (HostPositions::new(host), simulation(&solver, SPEED));
        device.set_contacts(Some(contacts)).unwrap();
        let simulators: [&mut dyn Simulator; 2] = [&mut host, &mut device];
        simulators.map(|own| {
            own.restore(&from).unwrap();
            step(own, &still());
            own.snapshot().unwrap().positions
        })
    };
    let [free, _] = after(0.0, &with(0.0));
    let mut before = f32::INFINITY;
    for share in [0.0, 0.5, 0.9, 1.0] {
        let [host, device] = after(share * CREEP_SECS, &with(2.0));
        let [held, apart] = [far(&host, &free), far(&host, &device)];
        println!("after {share} of the time: held by {held:.1e} m, {apart:.1e} m apart");
        assert!(apart < 1e-7 + 1e-3 * held && held < 0.9 * before, "{held} {apart}");
        before = held;
    }
    assert_eq!(before, 0.0);
}

/// With contacts hair sleeps once friction between neighbours has faded, on the device as on the
/// CPU, and a move of the head begins that anew; friction does not move hair that is at rest.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn hair_with_contacts_sleeps_once_friction_has_faded() {
    let solver = Solver::from(&AmsParams::default());
    let contacts = ContactParams::default();
    let mut host = Simulation::new(&groom(), &solver, &options(SPEED)).unwrap();
    host.set_contacts(Some(&contacts)).unwrap();
    let (mut host, mut device) = (HostPositions::new(host), simulation(&solver, SPEED));
    device.set_contacts(Some(&contacts)).unwrap();
    let simulators: [&mut dyn Simulator; 2] = [&mut host, &mut device];
    let left = 1.5;
    let frames = simulators.map(|own| {
        step(own, &still());
        let mut from = own.snapshot().unwrap();
        from.sleep.as_mut().unwrap().calm_secs = CREEP_SECS - left;
        own.restore(&from).unwrap();
        assert_eq!(frames_to_sleep(own, 75), None);
        let now = own.snapshot().unwrap();
        // Longer stillness is not counted, so that snapshots restore it.
        let still_secs = now.sleep.unwrap().still_secs;
        assert!(still_secs.iter().all(|secs| *secs == SLEEP_SECS as f32), "{still_secs:?}");
        let away = far(&from.positions, &now.positions);
        let asleep = 75 + frames_to_sleep(own, 75).unwrap();
        let roots = [at(0.0), at(0.01)].into();
        assert_eq!(step(own, &FrameInput { roots, ..still() }).sleeping_strands, 0);
        for _ in 0..3 {
            step(own, &FrameInput { roots: [at(0.01); 2].into(), ..still() });
        }
        let calm_secs = own.snapshot().unwrap().sleep.unwrap().calm_secs;
        println!("asleep after {asleep} frames, {away:.1e} m from rest; {calm_secs:.3} s after the move");
        assert!(away < 1e-5 && (calm_secs - 3.0 * DT).abs() < 1e-6, "{away} {calm_secs}");
        asleep
    });
    let least = (left / DT) as u32;
    assert!(frames.iter().all(|frames| (least..least + 4).contains(frames)), "{frames:?}");
}
