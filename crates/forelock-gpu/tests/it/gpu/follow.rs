//! Follow the leader on a GPU against the same on the CPU.

#![expect(clippy::unwrap_used, reason = "a test fails where it cannot be set up")]

use crate::common::{
    self, little,
    rms::{rms, trimmed_rms},
    shaken::{self, GRAVITY, ROUNDED_STARTS, apart, error_of_strands, options, rounded},
};
use forelock_core::air::{Wind, WindField, WindParams};
use forelock_core::body::{ColliderFrame, Head, Sdf, Shape};
use forelock_core::frame::{Air, FrameInput, Roots};
use forelock_core::interaction::contact::ContactParams;
use forelock_core::interaction::grid::GridParams;
use forelock_core::interaction::sph::SphParams;
use forelock_core::pose::Pose;
use forelock_core::simulation::Simulation;
use forelock_core::solver::dftl::Schedule;
use forelock_core::solver::{AmsParams, DftlParams, MassSpringParams, Solver, XpbdParams};
use forelock_core::strands::{Snapshot, Strands};
use forelock_gpu::{Gpu, GpuSimulation};
use glam::{DQuat, DVec3};

const DT: f64 = 0.016;
/// The largest allowed ratio of a strand's distance from float64 to the CPU's own float32 distance,
/// and the distance over the strand's length that is always allowed.
const FACTOR: f64 = 3.0;
const FLOOR: f64 = 2e-6;

/// Curls two millimetres apart.
fn tuft(count: u32, particles: impl Fn(u32) -> u32) -> (Vec<[f32; 3]>, Vec<u32>) {
    shaken::tuft(count, particles, [0.002, 0.0])
}

fn head(step: u32) -> Pose {
    shaken::head(f64::from(step) * DT)
}

fn frame(number: u32) -> FrameInput<'static> {
    FrameInput {
        roots: Roots::Rigid([head(number), head(number + 1)]),
        gravity: GRAVITY,
        air: Air::uniform(DVec3::new(1.0, 0.0, -2.0)),
        dt_secs: DT,
        ..FrameInput::default()
    }
}

/// Solids on the head.
fn on_head<'a>(shapes: &'a [(Shape, DVec3)], number: u32) -> Vec<ColliderFrame<'a>> {
    let solid = |(shape, at): &'a (Shape, DVec3)| ColliderFrame {
        shape,
        local: Pose::new(DQuat::from_rotation_x(0.3), *at),
        from: head(number),
        to: head(number + 1),
        friction: 0.4,
    };
    shapes.iter().map(solid).collect()
}

/// The surroundings of a run and its length.
struct Among<'a> {
    solids: &'a [(Shape, DVec3)],
    wind: Option<&'a WindField>,
    steps: u32,
}

/// Distance from the float64 CPU after `steps`, over the strand's length, of the median strand or
/// after one step of the worst: of the GPU, and of the float32 CPU. After one step among solids the
/// latter is the worst of several starts that differ by roundings.
fn errors(gpu: &Gpu, strands: &Strands<'_, f32>, params: [&DftlParams; 2], among: Among<'_>) -> [f64; 2] {
    let Among { solids, wind, steps } = among;
    let exact: Vec<[f64; 3]> = strands.positions.iter().map(|x| x.map(f64::from)).collect();
    let exact = Strands { stiffness: strands.stiffness, ..Strands::new(&exact, strands.offsets) };
    let mut own = GpuSimulation::from_strands(gpu, strands, params[0], &options()).unwrap();
    let mut cpu = Simulation::from_strands(strands, params[1], &options()).unwrap();
    let mut truth = Simulation::<f64>::from_strands(&exact, params[1], &options()).unwrap();
    for number in 0..steps {
        let colliders = on_head(solids, number);
        let frame = FrameInput { colliders: &colliders, ..frame(number) };
        let frame = &FrameInput { air: Air { field: wind, ..frame.air }, ..frame };
        own.step_frame(frame).unwrap();
        truth.step_frame(frame).unwrap();
        let expected = cpu.step_frame(frame).unwrap();
        let report = own.report().unwrap();
        let (touching, of) = (f64::from(report.touching), f64::from(expected.touching));
        assert!((touching - of).abs() <= 10.0 + 0.25 * of, "{report:?}, {expected:?}");
        let depth = f64::from(report.max_penetration_m) - expected.max_penetration_m;
        assert!(depth.abs() < 3e-3 && report.quarantined_strands == 0, "{report:?}, {expected:?}");
        if params[0].recheck > 0 {
            assert!(report.max_edge_stretch < 2e-5 && report.max_edge_stretch_final < 2e-5, "{report:?}");
        }
        let stretch = f64::from(report.max_edge_stretch);
        assert!(
            (stretch - expected.max_edge_stretch).abs() < 1e-3 + 0.2 * stretch,
            "{report:?}, {expected:?}"
        );
    }
    let truth = truth.snapshot();
    let error = |found: &Snapshot<f32>| {
        let shift: [f64; 3] = std::array::from_fn(|c| truth.origin[c] - found.origin[c]);
        let shifted = |x: [f64; 3]| std::array::from_fn(|c| x[c] + shift[c]);
        let of_particle = |p: usize| {
            let places = apart(found.positions[p], shifted(truth.positions[p]))
                .max(apart(found.previous[p], shifted(truth.previous[p])));
            // Velocities hold the load of all the strand.
            places.max(0.1 * DT * apart(found.velocities[p], truth.velocities[p])) / 0.25
        };
        error_of_strands(strands.offsets, of_particle, steps)
    };
    let found = own.snapshot().unwrap();
    assert_eq!(found.origin, truth.origin);
    let mut of_cpu = error(&cpu.snapshot());
    if steps == 1 && !solids.is_empty() {
        for seed in 0..ROUNDED_STARTS {
            let starts = rounded(strands.positions, seed);
            let starts = Strands { stiffness: strands.stiffness, ..Strands::new(&starts, strands.offsets) };
            let mut cpu = Simulation::from_strands(&starts, params[1], &options()).unwrap();
            let colliders = on_head(solids, 0);
            let frame = FrameInput { colliders: &colliders, ..frame(0) };
            cpu.step_frame(&FrameInput { air: Air { field: wind, ..frame.air }, ..frame }).unwrap();
            of_cpu = of_cpu.max(error(&cpu.snapshot()));
        }
    }
    [error(&found), of_cpu]
}

fn is_close([gpu, cpu]: [f64; 2]) -> bool {
    gpu <= FACTOR * cpu + FLOOR
}

const SCHEDULES: [Schedule; 3] = [Schedule::Fused, Schedule::Strands, Schedule::Particles];

#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn any_count_of_strands_and_particles_in_every_schedule() {
    let gpu = common::gpu();
    for schedule in SCHEDULES {
        let params = DftlParams { schedule, ..DftlParams::default() };
        for (count, particles) in
            [(1, 30), (15, 9), (17, 9), (64, 12), (65, 12), (300, 25), (40, 2), (40, 3), (20, 150)]
        {
            for mixed in [false, true] {
                let (positions, offsets) =
                    tuft(count, |strand| particles + if mixed { strand % 7 } else { 0 });
                let strands = Strands::new(&positions, &offsets);
                let errors =
                    errors(&gpu, &strands, [&params; 2], Among { solids: &[], wind: None, steps: 4 });
                assert!(is_close(errors), "{count} × {particles}, mixed {mixed}, {schedule:?}: {errors:?}");
            }
        }
    }
}

/// Every parameter is felt as on the CPU, and one that is off is seen.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn every_parameter_is_felt() {
    let gpu = common::gpu();
    let (positions, offsets) = tuft(40, |_| 20);
    let stiffness: Vec<f32> = (0..40).map(|k| 0.2 * k as f32).collect();
    let strands = Strands { stiffness: Some(&stiffness), ..Strands::new(&positions, &offsets) };
    let base = DftlParams::default();
    let others = [
        DftlParams { shape_global: 0.1, ..base.clone() },
        DftlParams { shape_local: 0.4, ..base.clone() },
        DftlParams { tip_scale_global: 1.0, ..base.clone() },
        DftlParams { tip_scale_local: 1.0, ..base.clone() },
        DftlParams { damping: 0.5, ..base.clone() },
        DftlParams { sag_free: true, ..base.clone() },
        DftlParams { drag: 8.0, ..base.clone() },
        DftlParams { clamped: 3, ..base.clone() },
    ];
    for params in &others {
        let alike = errors(&gpu, &strands, [params; 2], Among { solids: &[], wind: None, steps: 8 });
        assert!(is_close(alike), "{params:?}: {alike:?}");
        let off = errors(&gpu, &strands, [params, &base], Among { solids: &[], wind: None, steps: 8 });
        assert!(!is_close(off) && off[0] > 1e-4, "{params:?} is not seen: {off:?}");
    }
}

#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn solids_are_met_as_on_the_cpu() {
    let gpu = common::gpu();
    let (positions, offsets) = tuft(120, |strand| 20 + strand % 3);
    let strands = Strands::new(&positions, &offsets);
    let field = Sdf::from_mesh(&Head::builtin().mesh, 48, 0.02).unwrap();
    let ball = Shape::Sphere { radius: 0.05 };
    let capsule = Shape::Capsule { radius: 0.03, half_length: 0.08 };
    let below = DVec3::new(0.03, -0.12, 0.02);
    let scenes: [&[(Shape, DVec3)]; 3] = [
        &[(ball.clone(), below)],
        &[(ball, below), (capsule, DVec3::new(0.06, -0.2, 0.0)), (Shape::Plane, DVec3::new(0.0, -0.24, 0.0))],
        &[(Shape::Sdf(std::sync::Arc::new(field)), DVec3::new(0.0, -0.16, 0.0))],
    ];
    for (number, solids) in scenes.into_iter().enumerate() {
        for (level_collisions, recheck, schedule) in [
            (false, 2, Schedule::Fused),
            (false, 2, Schedule::Particles),
            (true, 2, Schedule::Fused),
            (true, 0, Schedule::Fused),
            (true, 2, Schedule::Strands),
            (true, 2, Schedule::Particles),
        ] {
            let params = DftlParams { level_collisions, recheck, schedule, ..DftlParams::default() };
            for steps in [1, 12] {
                let errors = errors(&gpu, &strands, [&params; 2], Among { solids, wind: None, steps });
                let name = format!("levels {level_collisions}, recheck {recheck}, {schedule:?}");
                println!("scene {number}, {name}, {steps} steps: {errors:?}");
                // A strand that solids hold by a hair's breadth falls to either side.
                assert!(is_close(errors) || (steps > 1 && errors[0] < 1e-3), "{errors:?}");
            }
        }
    }
}

#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn a_wind_with_turbulence_blows_as_on_the_cpu() {
    let gpu = common::gpu();
    let (positions, offsets) = tuft(60, |_| 20);
    let strands = Strands::new(&positions, &offsets);
    let params = WindParams { velocity: DVec3::new(3.0, 0.0, 1.0), turbulence: 0.5, ..WindParams::default() };
    let wind = Wind::new(&params).unwrap().at(0.3);
    for schedule in SCHEDULES {
        let params = DftlParams { schedule, ..DftlParams::default() };
        let errors = errors(&gpu, &strands, [&params; 2], Among { solids: &[], wind: Some(&wind), steps: 8 });
        assert!(is_close(errors), "{schedule:?}: {errors:?}");
        let still = DftlParams { drag: 0.0, ..params.clone() };
        let off = self::errors(
            &gpu,
            &strands,
            [&params, &still],
            Among { solids: &[], wind: Some(&wind), steps: 8 },
        );
        assert!(off[0] > 1e-3, "{off:?}");
    }
}

/// Two runs, in one batch or many, from a snapshot: the same bits. All schedules share them as far
/// as a driver rounds alike.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn the_bits_are_the_same_each_time() {
    let gpu = common::gpu();
    let little = little::binding_little(&gpu, 1 << 18);
    let (positions, offsets) = tuft(400, |strand| 12 + strand % 2);
    let strands = Strands::new(&positions, &offsets);
    let solids = [(Shape::Sphere { radius: 0.05 }, DVec3::new(0.03, -0.12, 0.02))];
    for schedule in SCHEDULES {
        let params = DftlParams { schedule, ..DftlParams::default() };
        let run = |gpu: &Gpu, broken: Option<u32>| {
            let new = || GpuSimulation::from_strands(gpu, &strands, &params, &options()).unwrap();
            let mut own = new();
            for number in 0..10 {
                if broken == Some(number) {
                    let snapshot = own.snapshot().unwrap();
                    own = new();
                    own.restore(&snapshot).unwrap();
                }
                own.step_frame(&FrameInput { colliders: &on_head(&solids, number), ..frame(number) })
                    .unwrap();
            }
            own.state_hash().unwrap()
        };
        let whole = run(&gpu, None);
        assert_eq!([run(&gpu, None), run(&gpu, Some(6)), run(&little, Some(3))], [whole; 3], "{schedule:?}");
    }
}

/// A run continued from the CPU keeps the motion that drag acts on; a strand that is not finite is
/// reset.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn what_began_on_the_cpu_goes_on() {
    let gpu = common::gpu();
    let (positions, offsets) = tuft(33, |_| 12);
    let strands = Strands::new(&positions, &offsets);
    let mut cpu = Simulation::from_strands(&strands, &DftlParams::default(), &options()).unwrap();
    for number in 0..5 {
        cpu.step_frame(&frame(number)).unwrap();
    }
    let mut own = GpuSimulation::continuing(&gpu, &cpu).unwrap();
    assert_eq!(own.snapshot().unwrap(), cpu.snapshot());
    own.step_frame(&frame(5)).unwrap();
    cpu.step_frame(&frame(5)).unwrap();
    let far = |own: &mut GpuSimulation, cpu: &Simulation| {
        let (a, b) = (own.snapshot().unwrap().positions, cpu.snapshot().positions);
        a.iter()
            .zip(&b)
            .map(|(a, b)| (DVec3::from(a.map(f64::from)) - DVec3::from(b.map(f64::from))).length())
            .fold(0.0, f64::max)
    };
    assert!(far(&mut own, &cpu) < 1e-6);
    let mut sick = own.snapshot().unwrap();
    sick.previous[20 * 12 + 5][1] = f32::NAN;
    own.restore(&sick).unwrap();
    own.step_frame(&frame(6)).unwrap();
    assert_eq!(own.report().unwrap().quarantined_strands, 1);
    own.step_frame(&frame(7)).unwrap();
    assert_eq!(own.report().unwrap().quarantined_strands, 0);
    assert!(own.snapshot().unwrap().previous.iter().flatten().all(|x| x.is_finite()));
}

/// SPH forces are the CPU's, with either solver, in one batch or many, and do not depend on the
/// order of threads.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn smoothed_particles_push_as_on_the_cpu() {
    let gpu = common::gpu();
    let little = little::binding_little(&gpu, 1 << 19);
    let (positions, offsets) = tuft(260, |strand| 16 + strand % 3);
    let strands = Strands::new(&positions, &offsets);
    let (dftl, ams) = (DftlParams::default(), AmsParams { substep_secs: 1.0, ..AmsParams::default() });
    for (solver, own_strand, mutual) in [
        (Solver::from(&dftl), false, true),
        (Solver::from(&dftl), true, false),
        (Solver::from(&ams), false, true),
    ] {
        // So few that they fit where the strands' scratch does not.
        let params = SphParams { own_strand, mutual, pressure: 0.2, neighbours: 8, ..SphParams::default() };
        // From a state in motion, what one frame does with particles and without.
        let mut cpu = Simulation::from_strands(&strands, &solver, &options()).unwrap();
        (0..8).for_each(|number| assert_eq!(cpu.step_frame(&frame(number)).unwrap().quarantined_strands, 0));
        let start = cpu.snapshot();
        let on_cpu = |particles: Option<&SphParams>| {
            let mut cpu = Simulation::from_strands(&strands, &solver, &options()).unwrap();
            cpu.set_sph(particles).unwrap();
            cpu.restore(&start).unwrap();
            let report = cpu.step_frame(&frame(8)).unwrap();
            assert!(particles.is_none() || report.sph.densest > 1.0, "{report:?}");
            cpu.snapshot().positions
        };
        let on_gpu = |gpu: &Gpu| {
            let mut own = GpuSimulation::from_strands(gpu, &strands, &solver, &options()).unwrap();
            own.set_sph(Some(&params)).unwrap();
            own.restore(&start).unwrap();
            own.step_frame(&frame(8)).unwrap();
            own.snapshot().unwrap()
        };
        let (with, without) = (on_cpu(Some(&params)), on_cpu(None));
        let first = on_gpu(&gpu);
        let (off, pushed) = (rms(&first.positions, &with), rms(&with, &without));
        println!("{own_strand} {mutual}: pushed by {pushed:.2e} m, off by {off:.1e} m");
        // Beside a few roundings of positions.
        assert!(pushed > 1e-4 && off < 2e-3 * pushed + 1e-6, "{off} of {pushed}");
        assert!(on_gpu(&gpu) == first, "the order of threads");
        assert!(on_gpu(&little) == first, "batches");
    }
}

/// On the grid and in contacts, with a solid at the end of the frame, DFTL strands interact as on
/// the CPU, with the velocity of their motion.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn hair_meets_as_on_the_cpu() {
    let gpu = common::gpu();
    let (positions, offsets) = tuft(260, |strand| 16 + strand % 3);
    let strands = Strands::new(&positions, &offsets);
    let params = DftlParams::default();
    let grid = GridParams { tolerance: 1e-6, iterations: 80, resolution: 32, ..GridParams::default() };
    let contacts = ContactParams { slip: 0.5, ..ContactParams::default() };
    let solids = [(Shape::Sphere { radius: 0.05 }, DVec3::new(0.03, -0.12, 0.02))];
    let mut cpu = Simulation::from_strands(&strands, &params, &options()).unwrap();
    for number in 0..8 {
        cpu.step_frame(&FrameInput { colliders: &on_head(&solids, number), ..frame(number) }).unwrap();
    }
    let start = cpu.snapshot();
    let colliders = on_head(&solids, 8);
    let next = FrameInput { colliders: &colliders, ..frame(8) };
    for (meets, touches) in [(true, false), (false, true), (true, true)] {
        let (grid, contacts) = (meets.then_some(&grid), touches.then_some(&contacts));
        let on_cpu = |grid: Option<&GridParams>, contacts: Option<&ContactParams>| {
            let mut cpu = Simulation::from_strands(&strands, &params, &options()).unwrap();
            cpu.set_grid(grid).unwrap();
            cpu.set_contacts(contacts).unwrap();
            cpu.restore(&start).unwrap();
            let report = cpu.step_frame(&next).unwrap();
            (cpu.snapshot(), report)
        };
        let on_gpu = || {
            let mut own = GpuSimulation::from_strands(&gpu, &strands, &params, &options()).unwrap();
            own.set_grid(grid).unwrap();
            own.set_contacts(contacts).unwrap();
            own.restore(&start).unwrap();
            own.step_frame(&next).unwrap();
            let report = own.report().unwrap();
            (own.snapshot().unwrap(), report)
        };
        let ((with, expected), (without, _)) = (on_cpu(grid, contacts), on_cpu(None, None));
        let (own, report) = on_gpu();
        for (what, of) in [
            ("places", (&own.positions, &with.positions, &without.positions)),
            ("velocities", (&own.velocities, &with.velocities, &without.velocities)),
        ] {
            // An edge in a solid can turn either way, and rounding decides: the one particle in
            // twenty that is farthest off does not count.
            let (off, given) = (trimmed_rms(of.0, of.1, 0.05), rms(of.1, of.2));
            println!("grid {meets}, contacts {touches}, {what}: given {given:.2e}, off by {off:.1e}");
            assert!(given > 1e-5 && off < 1e-3 * given, "{what}: {off} of {given}");
        }
        let stretch = f64::from(report.max_edge_stretch) - expected.max_edge_stretch;
        assert!(stretch.abs() < 1e-5 && report.max_edge_stretch > 0.0, "{report:?}, {expected:?}");
        assert!(!(meets && touches) || on_gpu().0 == own, "the order of threads");
    }
}

/// The largest share of edges in a plate of half the thickness `half` that crosses hanging strands
/// at 2 m/s and stops, the outer fifth of its thickness aside; the particles that it let through,
/// and the largest stretch of an edge half a second later.
fn dragged(gpu: &Gpu, solver: &Solver<f32>, half: f64) -> (f64, usize, f64) {
    let root = |s: u32| [0.004 * (s % 11) as f32 - 0.02, 0.0, 0.005 * (s / 11) as f32 - 0.01];
    let strand = |s: u32| (0..30).map(move |i| [root(s)[0], -0.3 * i as f32 / 29.0, root(s)[2]]);
    let positions: Vec<[f32; 3]> = (0..55).flat_map(strand).collect();
    let offsets: Vec<u32> = (0..=55).map(|s| 30 * s).collect();
    let strands = Strands::new(&positions, &offsets);
    let mut own = GpuSimulation::from_strands(gpu, &strands, solver, &options()).unwrap();
    let half = DVec3::new(0.15, 0.25, half);
    let core = half - DVec3::splat(0.2 * half.z);
    let (shape, dt) = (Shape::Box { half_extents: half }, 1.0 / 60.0);
    let pose = |number: u32| {
        Pose::new(DQuat::IDENTITY, DVec3::new(0.0, -0.3, (2.0 * dt * f64::from(number)).min(0.2) - 0.065))
    };
    let chain = |own: &mut GpuSimulation| -> Vec<DVec3> {
        let snapshot = own.snapshot().unwrap();
        let origin = DVec3::from(snapshot.origin);
        snapshot.positions.iter().map(|x| DVec3::from(x.map(f64::from)) + origin).collect()
    };
    let rest = chain(&mut own);
    let particles = rest.len() / 55;
    let mut in_front = vec![false; rest.len()];
    let (mut cut, mut crossed, mut stretch) = (0.0f64, 0, 0.0);
    for number in 0..36 {
        let (from, to) = (pose(number), pose(number + 1));
        let plate = ColliderFrame { shape: &shape, local: Pose::IDENTITY, from, to, friction: 0.3 };
        let frame =
            FrameInput { colliders: &[plate], gravity: GRAVITY, dt_secs: dt, ..FrameInput::default() };
        own.step_frame(&frame).unwrap();
        let places: Vec<DVec3> = chain(&mut own).iter().map(|x| to.inverse().transform_point(*x)).collect();
        // The segment meets the box.
        let is_inside = |ends: &&[DVec3]| {
            let go = ends[1] - ends[0];
            let (p, q) = ((-core - ends[0]) / go, (core - ends[0]) / go);
            p.min(q).max_element().max(0.0) < p.max(q).min_element().min(1.0)
        };
        let edges = places.chunks(particles).flat_map(|strand| strand.windows(2));
        cut = cut.max(edges.filter(is_inside).count() as f64 / (places.len() - 55) as f64);
        for (x, before) in places.iter().zip(&mut in_front) {
            let is_deep = x.y < half.y - 0.03 - 2.0 * dt;
            crossed += usize::from(*before && is_deep && x.z < 0.0);
            *before = is_deep && x.z > 0.0;
        }
        let edges = places.chunks(particles).zip(rest.chunks(particles));
        let edges = edges.flat_map(|(a, b)| a.windows(2).zip(b.windows(2)));
        stretch = edges.map(|(a, b)| a[0].distance(a[1]) / b[0].distance(b[1]) - 1.0).fold(0.0, f64::max);
    }
    (cut, crossed, stretch)
}

/// No plate cuts through strands of any solver, as on the CPU.
#[test]
#[cfg_attr(not(gpu), ignore = "there is no GPU")]
fn plates_do_not_cut_through_taut_hair() {
    let gpu = common::gpu();
    let (ams, dftl) = (AmsParams::default(), DftlParams::default());
    let springs = MassSpringParams::default();
    for (name, solver) in [
        ("ams", (&ams).into()),
        ("dftl", (&dftl).into()),
        ("mass-spring", (&springs).into()),
        ("xpbd", (&XpbdParams::default()).into()),
    ] {
        for half in [0.001, 0.005] {
            let (cut, crossed, stretch) = dragged(&gpu, &solver, half);
            println!("{name}, {half} m: {cut:.1e} cut, {crossed} crossed, stretch {stretch:.1e}");
            assert!(cut <= 1e-3 && crossed == 0 && stretch < 0.05, "{name}: {cut}, {crossed}, {stretch}");
        }
    }
    let levels = DftlParams { level_collisions: true, ..dftl };
    let (cut, crossed, stretch) = dragged(&gpu, &(&levels).into(), 0.005);
    assert!(cut > 1e-3 || crossed > 0, "the check can fail: {cut}, {crossed}, {stretch}");
}
