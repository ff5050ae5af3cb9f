//! Masses of particles and accelerations in addition to gravity, against closed forms.

use crate::rig::{GRAVITY, Random, Rig, Strand, Varied, bare, helix, largest, tuft};
use forelock_core::frame::{Acceleration, FrameInput, Step};
use forelock_core::groom::Groom;
use forelock_core::lane::Simd;
use forelock_core::params::{ParamsError, SUBSTEP_SECS};
use forelock_core::pose::Pose;
use forelock_core::simulation::{BuildError, Options, RegroomError, Simulation};
use forelock_core::solver::ams::Inextensibility;
use forelock_core::solver::{AmsParams, DftlParams, MassSpringParams, Solver};
use forelock_core::strands::{MASS_RANGE, Masses, PackError, Strands};
use glam::{DQuat, DVec3, Vec3};

/// A straight strand of `n` particles 1 cm apart.
fn straight(n: usize) -> Strand {
    (0..n).map(|i| [0.0, -0.01 * i as f64, 0.0]).collect()
}

fn masses(n: usize) -> Vec<f32> {
    let mut random = Random(7);
    (0..n).map(|_| (random.number() * 2.0).exp() as f32).collect()
}

fn rig(strand: Strand, masses: &[f32], params: &AmsParams, rest_gravity: DVec3) -> Rig<f64> {
    let options = Options { rest_gravity, ..Options::default() };
    let varied = Varied { masses: Some(masses), ..Varied::default() };
    let mut rig = Rig::varied(&[strand], varied, params, &options);
    rig.gravity = GRAVITY;
    rig
}

/// Edge i of a chain that hangs at rest carries the particles below it: it is longer by Σ m g/κ.
#[test]
fn a_hanging_chain_stretches_by_the_weight_below() {
    let n = 8;
    let own = masses(n);
    let params = AmsParams { k_edge: 1e5, drag: 60.0, ..bare() };
    let mut rig = rig(straight(n), &own, &params, DVec3::ZERO);
    rig.play(20.0, |_| Pose::IDENTITY);
    let x = rig.positions();
    for i in 0..n - 1 {
        let below: f64 = own[i + 1..].iter().map(|&m| f64::from(m)).sum();
        let (stretch, expected) = (x[i].distance(x[i + 1]) - 0.01, below * 9.81 / 1e5);
        assert!((stretch / expected - 1.0).abs() < 1e-6, "edge {i}: {stretch:e} m, not {expected:e}");
    }
}

/// Free particles of any mass fall alike without air, and to a speed of m g/c in it.
#[test]
fn free_particles_fall_to_their_terminal_speed() {
    let n = 6;
    let own = masses(n);
    let params = AmsParams { drag: 12.0, ..bare() };
    let mut rig = rig(straight(n), &own, &params, DVec3::ZERO);
    rig.play(15.0, |_| Pose::IDENTITY);
    for (v, m) in rig.velocities().iter().zip(&own).skip(1) {
        let expected = -9.81 * f64::from(*m) / 12.0;
        assert!((v.y / expected - 1.0).abs() < 1e-3, "{m}: {} m/s, not {expected}", v.y);
    }
    let mut rig = self::rig(straight(n), &own, &bare(), DVec3::ZERO);
    rig.play(0.5, |_| Pose::IDENTITY);
    let v = rig.velocities();
    assert!(v[1..].iter().all(|v| (v.y + 9.81 * 0.5).abs() < 1e-9), "{v:?}");
}

/// A groom whose weight is compensated stays at rest, whatever its masses.
#[test]
fn compensated_weight_includes_masses() {
    let own = masses(30);
    for params in
        [AmsParams::default(), AmsParams { inextensibility: Inextensibility::Off, ..AmsParams::default() }]
    {
        let mut rig = rig(helix(30), &own, &params, GRAVITY);
        let before = rig.positions();
        rig.play(1.0, |_| Pose::IDENTITY);
        let moved = largest(&before, &rig.positions());
        assert!(moved < 1e-9, "{moved:e} m");
    }
    // The comparison can fail: hair that carries a unit mass too much sags.
    let mut heavier = rig(helix(30), &own, &AmsParams::default(), 0.9 * GRAVITY);
    let before = heavier.positions();
    heavier.play(1.0, |_| Pose::IDENTITY);
    assert!(largest(&before, &heavier.positions()) > 1e-4);
}

/// The length pass changes velocities by M⁻¹ Jᵀ λ and leaves J v = 0. These two determine it.
#[test]
fn the_length_pass_weights_by_mass() {
    let n = 20;
    let own = masses(n);
    let params = AmsParams { clamped: 1, k_edge: 1e4, ..AmsParams::default() };
    let mut rig = rig(helix(n), &own, &params, GRAVITY);
    let pose = |t: f64| Pose::new(DQuat::from_rotation_z(2.0 * t), DVec3::new(0.5 * t, 0.0, 0.0));
    rig.play(0.5, pose);
    let frame =
        FrameInput { roots: [pose(0.5), pose(0.52)].into(), gravity: GRAVITY, ..FrameInput::default() };
    let steps = rig.simulation.plan().steps().to_vec();
    let at = steps.iter().position(|own| matches!(own.step, Step::RestoreLengths { .. })).unwrap();
    rig.simulation.step_part(&frame, &steps[..at]).unwrap();
    let before = rig.velocities();
    rig.simulation.step_part(&frame, &steps[at..=at]).unwrap();
    let (x, v) = (rig.positions(), rig.velocities());
    // Follow the force along the strand from the tip: on each particle act λ of its two edges.
    let (mut force, mut largest_force) = (DVec3::ZERO, 0.0f64);
    for i in (1..n).rev() {
        force += (v[i] - before[i]) * f64::from(own[i]);
        let edge = (x[i] - x[i - 1]).normalize();
        assert!(force.cross(edge).length() < 1e-9, "edge {i}: {force}");
        assert!((v[i] - v[i - 1]).dot(edge).abs() < 1e-12);
        largest_force = largest_force.max(force.length());
    }
    assert!(largest_force > 1e-3, "the pass had nothing to do");
}

/// An acceleration a beside no gravity is gravity of a, for every solver; a field of one value is
/// the same as one value a particle.
#[test]
fn a_uniform_acceleration_is_gravity() {
    let solvers: [Solver<f64>; 3] = [
        (&AmsParams { sag_free: false, ..AmsParams::default() }).into(),
        (&MassSpringParams::default()).into(),
        (&DftlParams::default()).into(),
    ];
    let a = DVec3::new(2.0, -7.0, 4.0);
    for solver in solvers {
        let run = |gravity: DVec3, acceleration: Acceleration<'_>| {
            let options = Options { simd: Simd::Auto, ..Options::default() };
            let mut rig = Rig::<f64>::with_options(&tuft(3, 12), &solver, &options);
            let frame = FrameInput { gravity, acceleration, ..FrameInput::default() };
            for _ in 0..30 {
                rig.simulation.step_frame(&frame).unwrap();
            }
            rig.positions()
        };
        let gravity = run(a, Acceleration::None);
        let each = run(DVec3::ZERO, Acceleration::PerParticle(&[a.as_vec3(); 36]));
        let field = run(DVec3::ZERO, Acceleration::Field(&|_| a));
        let apart = largest(&gravity, &each);
        assert!(apart < 1e-9, "{}: {apart:e} m", solver.name());
        assert_eq!(each, field, "{}", solver.name());
        assert!(largest(&gravity, &run(DVec3::ZERO, Acceleration::None)) > 1e-2);
    }
}

/// A free particle in the field a = −ω² (x − c) swings about c.
#[test]
fn a_field_depends_on_the_place() {
    let mut rig = Rig::<f64>::with_options(&[straight(5)], &bare(), &Options::default());
    let (omega, centre) = (3.0, DVec3::new(0.02, -0.1, 0.01));
    let field = move |x: DVec3| (centre - x) * (omega * omega);
    let dt_secs = 1.0 / 2000.0;
    let frame = FrameInput { acceleration: Acceleration::Field(&field), dt_secs, ..FrameInput::default() };
    let start = rig.positions();
    for _ in 0..2000 {
        rig.simulation.step_frame(&frame).unwrap();
    }
    for (from, to) in start.iter().zip(rig.positions()).skip(1) {
        let expected = centre + (*from - centre) * f64::cos(omega);
        assert!(to.distance(expected) < 2e-3 * from.distance(centre), "{to} {expected}");
    }
    assert_eq!(rig.positions()[0], start[0], "the root is clamped");
}

/// Particles that the solver adds take what lies between their neighbours.
#[test]
fn virtual_particles_interpolate() {
    let own = [1.0, 2.0, 4.0];
    let options = Options::default();
    let varied = Varied { masses: Some(&own), ..Varied::default() };
    let rig = Rig::<f64>::varied(&[straight(3)], varied, &MassSpringParams::default(), &options);
    let all: Vec<f64> = rig.simulation.model().masses.iter().map(|row| row.0[0]).collect();
    assert_eq!(all, [1.0, 1.5, 2.0, 3.0, 4.0]);
}

#[test]
fn masses_from_widths_and_wrong_input() {
    let strand = (0..4).map(|i| Vec3::new(0.0, -0.01 * i as f32, 0.0)).collect::<Vec<_>>();
    let mut groom = Groom::from_strands([strand]).unwrap();
    let options = Options { masses: Masses::Widths, ..Options::default() };
    let build = |groom: &Groom| Simulation::new(groom, &AmsParams::default(), &options);
    assert_eq!(build(&groom).unwrap_err(), BuildError::Pack(PackError::NoWidths));
    groom.widths = Some(vec![2e-4, 2e-4, 1e-4, 0.0]);
    let simulation = build(&groom).unwrap();
    let all: Vec<f32> = simulation.model().masses.iter().map(|row| row.0[0]).collect();
    // Squares 4, 4, 1, 0 over their mean of 2.25; a tip of no width has the smallest mass.
    assert_eq!(all, [4.0 / 2.25, 4.0 / 2.25, 1.0 / 2.25, *MASS_RANGE.start()]);

    let refused = |masses: &[f32]| {
        let strands = Strands { masses: Some(masses), ..Strands::from(&groom) };
        Simulation::from_strands(&strands, &AmsParams::default(), &Options::default()).is_err()
    };
    assert!(refused(&[1.0; 3]) && refused(&[1.0, 1.0, 1.0, 0.0]) && refused(&[1.0, f32::NAN, 1.0, 1.0]));
    assert!(!refused(&[1.0; 4]));

    let mut simulation = build(&groom).unwrap();
    let acceleration = Acceleration::PerParticle(&[Vec3::ZERO; 3]);
    let error = simulation.step_frame(&FrameInput { acceleration, ..FrameInput::default() }).unwrap_err();
    assert_eq!(error, ParamsError::Count { name: "acceleration", found: 3, expected: 4, of: "particles" });
    // An edit keeps the unit of mass: particles that it does not change keep their masses.
    let source = forelock_core::groom::edit::Source { strand: 0, fresh: false };
    let mut thin = groom.clone();
    thin.widths = Some(vec![2e-4, 1e-4, 1e-4, 1e-4]);
    simulation.regroom(&thin, &[source], &options.rest_pose).unwrap();
    let all: Vec<f32> = simulation.model().masses.iter().map(|row| row.0[0]).collect();
    assert_eq!(all, [4.0, 1.0, 1.0, 1.0].map(|square| square / 2.25));
    // Masses given one by one are not known for an edited groom.
    let strands = Strands { masses: Some(&[1.0, 2.0, 1.0, 1.0]), ..Strands::from(&groom) };
    let mut given = Simulation::from_strands(&strands, &AmsParams::default(), &Options::default()).unwrap();
    let refused = given.regroom(&thin, &[source], &options.rest_pose);
    assert_eq!(refused, Err(RegroomError::Masses));
}

/// Light particles meet the limit of float32 earlier. The substep and the stiffness that the error
/// names are just enough.
#[test]
fn the_limit_of_float32_counts_the_lightest_particle() {
    let positions: Vec<[f32; 3]> = straight(4).iter().map(|p| p.map(|x| x as f32)).collect();
    let own = [1.0, 2.0, 0.25, 4.0];
    let dt_secs = 1.0 / 60.0;
    let step = |solver: Solver<f32>, masses: Option<&[f32]>| {
        let strands = Strands { masses, ..Strands::new(&positions, &[0, 4]) };
        let mut simulation = Simulation::from_strands(&strands, solver, &Options::default()).unwrap();
        simulation.step_frame(&FrameInput { dt_secs, ..FrameInput::default() }).map(|_| ())
    };
    let ams = |k_edge: f64, substep_secs: f64, masses: Option<&[f32]>| {
        step((&AmsParams { k_edge, substep_secs, ..AmsParams::default() }).into(), masses)
    };
    let error = ams(5e7, SUBSTEP_SECS, Some(&own)).unwrap_err();
    let ParamsError::TooStiff { name, value, substeps, dt_secs: dt, product, needed_secs, allowed } = error
    else {
        panic!("{error}");
    };
    assert_eq!((name, value, substeps, dt), ("k_edge", 5e7, 4, dt_secs));
    // h = 1/240 s: h² κ/m = 5e7/240²/0.25; √(1e3 · 0.25/5e7) s, which is 7.5 substeps;
    // 1e3 · 0.25 · 240².
    assert!((product / 3_472.222_222 - 1.0).abs() < 1e-9, "{product}");
    assert_eq!(needed_secs, Some(2.23e-3));
    assert!((allowed / 1.44e7 - 1.0).abs() < 1e-12, "{allowed}");
    ams(5e7, 2.23e-3, Some(&own)).unwrap();
    ams(5e7, dt_secs / 7.0, Some(&own)).unwrap_err();
    ams(allowed, SUBSTEP_SECS, Some(&own)).unwrap();
    ams(1.001 * allowed, SUBSTEP_SECS, Some(&own)).unwrap_err();
    ams(5e7, SUBSTEP_SECS, None).unwrap();
    // Mass-spring runs as AMS.
    let chain = MassSpringParams { k_edge: 5e7, ..MassSpringParams::default() };
    step((&chain).into(), None).unwrap();
    let error = step((&chain).into(), Some(&own)).unwrap_err();
    assert!(matches!(error, ParamsError::TooStiff { needed_secs: Some(2.23e-3), .. }), "{error}");
}
