//! The pass that limits how far edges stretch: where it acts and how far, what it leaves alone, and
//! what it does to momentum and energy.

use crate::rig::{DT, G, Random, Rig, Strand, assert_one_hash, bare, largest, shake, simds, tuft, vector};
use forelock_core::body::{ColliderFrame, Shape};
use forelock_core::frame::restore_lengths::AT_LIMIT;
use forelock_core::frame::{FrameInput, Step};
use forelock_core::lane::Simd;
use forelock_core::params::Inextensibility;
use forelock_core::pose::Pose;
use forelock_core::simulation::SimulationReal;
use forelock_core::solver::{AmsParams, MassSpringParams};
use glam::{DQuat, DVec3};

/// A strand that hangs straight, of `n` particles a centimetre apart.
fn straight(n: usize) -> Strand {
    (0..n).map(|i| [0.0, -0.01 * i as f64, 0.0]).collect()
}

/// Edge springs alone, of which the edges give way by at most `max_stretch`.
fn springs(max_stretch: f64) -> AmsParams {
    AmsParams { k_edge: 1e5, inextensibility: Inextensibility::Limit, max_stretch, ..bare() }
}

/// l/l₀ − 1 of the edges of `strands`.
fn stretches<T: SimulationReal>(rig: &Rig<T>, strands: &[Strand]) -> Vec<f64> {
    // Relative to the origin, as the state is.
    let now = rig.simulation.snapshot().positions;
    let mut first = 0;
    let mut found = Vec::new();
    for rest in strands {
        let now = &now[first..first + rest.len()];
        first += rest.len();
        found.extend(rest.windows(2).zip(now.windows(2)).map(|(rest, now)| {
            vector(now[0]).distance(vector(now[1])) / DVec3::from(rest[0]).distance(rest[1].into()) - 1.0
        }));
    }
    found
}

/// The stretches of a strand of 30 particles that hung from its root in frames of `dt` until it was
/// at rest, and how fast it still moves from frame to frame, m/s.
fn hung<T: SimulationReal>(max_stretch: f64, dt: f64) -> (Vec<f64>, f64) {
    let params = AmsParams { drag: 20.0, ..springs(max_stretch) };
    let mut rig = Rig::<T>::new(&[straight(30)], &params, Simd::Auto);
    rig.dt = dt;
    rig.play(8.0, |_| Pose::IDENTITY);
    let before = rig.positions();
    rig.step(Pose::IDENTITY);
    (stretches(&rig, &[straight(30)]), largest(&before, &rig.positions()) / dt)
}

/// Without a limit, edge j of n gives way by the weight of the n − j particles below it over its
/// stiffness: (n − j) g/(κ l). With a limit those that would give way farther end at the limit. The
/// others carry the same weight as before, and are stretched by as much, once frames are short:
/// from pass to pass hair falls by ½ g dt², and being lifted stretches the edges after the last one
/// at its limit.
#[test]
fn a_hanging_strand_is_stretched_to_the_limit_and_no_farther() {
    let limit = 0.15;
    let own: Vec<f64> = (0..29).map(|j| f64::from(29 - j) * G / (1e5 * 0.01)).collect();
    assert!(own[0] > 0.28 && own.iter().filter(|stretch| **stretch > limit).count() == 14);
    let error = |name: &str, (found, speed): (Vec<f64>, f64), rounding: f64| {
        let mut worst = 0.0f64;
        for (own, found) in own.iter().zip(&found) {
            assert!(*found < limit + rounding, "{name}: {found}");
            let is_at_limit = (1.0 + found) / (1.0 + limit) > AT_LIMIT - rounding;
            assert!(is_at_limit || *own < limit, "{name}: {found} for {own}");
            worst = worst.max((found - own.min(limit)).abs());
        }
        println!("{name}: off by {worst:.1e}, {speed:.1e} m/s");
        assert!(speed < 5e-3, "{name}: it moves at {speed} m/s");
        worst
    };
    let [long, short, shortest] = [1, 4, 16]
        .map(|parts| DT / f64::from(parts))
        .map(|dt| error("float64", hung::<f64>(limit, dt), 1e-9));
    assert!(long < 0.06 && short < 0.5 * long && shortest < 0.5 * short);
    assert!(error("float32", hung::<f32>(limit, DT), 2e-5) < 0.06);
    let (free, _) = hung::<f64>(10.0, DT);
    assert!(own.iter().zip(&free).all(|(own, found)| (own - found).abs() < 1e-6), "{free:?}");
}

/// Where no edge is at its limit the pass changes nothing, bit for bit.
#[test]
fn edges_within_the_limit_are_left_alone() {
    let hash = |inextensibility, max_stretch| {
        let params = MassSpringParams { inextensibility, max_stretch, ..MassSpringParams::default() };
        let mut rig = Rig::<f32>::new(&tuft(20, 25), &params, Simd::Auto);
        let most = (1..=60).map(|frame| rig.step(shake(2.0, 2.0, f64::from(frame) * DT)).max_edge_stretch);
        let most = most.fold(0.0, f64::max);
        (rig.simulation.state_hash(), most)
    };
    let (free, stretch) = hash(Inextensibility::Off, 0.0);
    assert!(stretch > 0.04, "they stretch: {stretch}");
    assert_eq!(hash(Inextensibility::Limit, 1.0).0, free);
    assert_ne!(hash(Inextensibility::Limit, 0.03).0, free, "the comparison can fail");
}

/// Hair of the baseline in a shake of 4 g against a ball: no edge is longer than its limit after
/// the pass, in any width and with any number of threads.
#[test]
fn no_edge_is_over_its_limit_in_a_shake() {
    let strands = tuft(20, 25);
    let params = MassSpringParams { virtual_particles: false, ..MassSpringParams::default() };
    let ball = Shape::Sphere { radius: 0.06 };
    let local = Pose::new(DQuat::IDENTITY, DVec3::new(0.02, -0.15, 0.0));
    let longest = |params: &MassSpringParams, simd, solids: bool| {
        let mut rig = Rig::<f32>::new(&strands, params, simd);
        let mut longest = 0.0f64;
        for frame in 1..=60 {
            let to = shake(4.0, 2.0, f64::from(frame) * DT);
            let solid = ColliderFrame { shape: &ball, local, from: rig.head, to, friction: 0.3 };
            rig.step_among(to, if solids { std::slice::from_ref(&solid) } else { &[] });
            longest = stretches(&rig, &strands).into_iter().fold(longest, f64::max);
        }
        longest
    };
    for simd in simds() {
        let free = longest(&params, simd, false);
        assert!(free < params.max_stretch + 1e-5, "{simd:?}: {free}");
    }
    let beside = longest(&params, Simd::Auto, true);
    println!("beside a ball {beside:.3}");
    assert!(beside < 0.05, "{beside}");
    let off = MassSpringParams { inextensibility: Inextensibility::Off, ..params.clone() };
    assert!(longest(&off, Simd::Auto, false) > 0.05, "without the pass they are");
    assert_one_hash(|simd| {
        let mut rig = Rig::<f32>::new(&strands, &params, simd);
        for frame in 1..=20 {
            let to = shake(4.0, 2.0, f64::from(frame) * DT);
            let solid = ColliderFrame { shape: &ball, local, from: rig.head, to, friction: 0.3 };
            rig.step_among(to, &[solid]);
        }
        rig.simulation.state_hash()
    });
}

/// A strand of 30 particles that is flung: random velocities of metres a second in a vacuum.
fn flung(params: &AmsParams) -> Rig<f64> {
    let mut rig = Rig::<f64>::new(&[straight(30)], params, Simd::Auto);
    let mut random = Random(5);
    rig.gravity = DVec3::ZERO;
    rig.edit(|snapshot| {
        for v in &mut snapshot.velocities[1..] {
            *v = (3.0 * random.vector() + DVec3::X * 5.0).to_array();
        }
    });
    rig
}

/// ½ Σ v², per mass.
fn kinetic(rig: &Rig<f64>) -> f64 {
    0.5 * rig.velocities().iter().map(|v| v.length_squared()).sum::<f64>()
}

/// The pass changes velocities by pulls along edges that are at their limit, so momentum is
/// conserved but for what the root takes, and only takes kinetic energy away.
#[test]
fn pulls_act_along_edges_at_their_limit_and_take_energy_away() {
    let params = springs(0.05);
    let mut rig = flung(&params);
    let steps = rig.simulation.plan().steps().to_vec();
    let at = steps.iter().position(|own| matches!(own.step, Step::RestoreLengths { .. })).unwrap();
    let frame = FrameInput { gravity: DVec3::ZERO, dt_secs: DT, ..FrameInput::default() };
    let (mut pulls, mut slack) = (0, 0);
    for _ in 0..120 {
        rig.simulation.step_part(&frame, &steps[..at]).unwrap();
        let (before, energy) = (rig.velocities(), kinetic(&rig));
        rig.simulation.step_part(&frame, &steps[at..]).unwrap();
        let (x, v) = (rig.positions(), rig.velocities());
        assert!(kinetic(&rig) <= energy * (1.0 + 1e-12), "{} of {energy}", kinetic(&rig));
        // From the tip, the force of each edge is what the particles beyond it have gained.
        let mut force = DVec3::ZERO;
        for i in (1..x.len()).rev() {
            force += v[i] - before[i];
            let edge = x[i] - x[i - 1];
            assert!(force.cross(edge.normalize()).length() < 1e-9, "edge {i}: {force}");
            if edge.length() < 0.01 * 1.05 * 0.9998 {
                assert!(force.length() < 1e-9, "edge {i} is slack: {force}");
                slack += 1;
            } else if force.length() > 1e-6 {
                pulls += 1;
            }
        }
    }
    assert!(pulls > 100 && slack > 100, "{pulls} {slack}");
}

/// The energy of a strand that is flung, springs included, does not grow from frame to frame.
#[test]
fn a_flung_strand_only_loses_energy() {
    let strand = [straight(30)];
    for (inextensibility, limit) in
        [(Inextensibility::Limit, 0.05), (Inextensibility::Limit, 0.0), (Inextensibility::Off, 0.0)]
    {
        let params = AmsParams { inextensibility, ..springs(limit) };
        let mut rig = flung(&params);
        let energy = |rig: &Rig<f64>| {
            let square: f64 = stretches(rig, &strand).iter().map(|s| (0.01 * s).powi(2)).sum();
            kinetic(rig) + 0.5 * 1e5 * square
        };
        let start = energy(&rig);
        let (mut last, mut rise) = (start, 0.0f64);
        for _ in 0..600 {
            rig.step(Pose::IDENTITY);
            let now = energy(&rig);
            rise = rise.max(now - last);
            last = now;
        }
        println!("{inextensibility:?} {limit}: {start:.1} to {last:.2} J/kg, rise {rise:.1e}");
        assert!(rise < 1e-3 * start && last < 0.5 * start, "{rise} {last} of {start}");
    }
}
