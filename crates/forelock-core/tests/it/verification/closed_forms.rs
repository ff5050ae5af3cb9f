//! Motions that can be written down: fall, drag, pendulum, ties.

use crate::rig::{DT, G, Rig, bare, helix, largest};
use forelock_core::lane::Simd;
use forelock_core::pose::Pose;
use forelock_core::solver::AmsParams;
use forelock_core::solver::ams::Inextensibility;
use glam::DVec3;
use std::f64::consts::{PI, TAU};

/// Two particles, the second 1 m beside the first.
fn bar() -> Vec<[f64; 3]> {
    vec![[0.0; 3], [1.0, 0.0, 0.0]]
}

/// Depth fallen in `secs` with `substeps` a frame.
fn fall(substeps: u32, secs: f64) -> f64 {
    let mut rig = Rig::<f64>::new(
        &[helix(30)],
        &AmsParams { substep_secs: DT / f64::from(substeps), ..bare() },
        Simd::Auto,
    );
    let start = rig.positions();
    rig.play(secs, |_| Pose::IDENTITY);
    let fallen: Vec<f64> = start.iter().zip(rig.positions()).map(|(a, b)| a.y - b.y).collect();
    assert_eq!(fallen[0], 0.0, "the root is held");
    assert!(fallen[1..].iter().all(|d| (d - fallen[1]).abs() < 1e-12), "free particles fall alike");
    fallen[1]
}

#[test]
fn free_fall_is_exact_to_first_order() {
    let t = 1.0;
    for substeps in [1, 2, 4, 8] {
        let h = DT / f64::from(substeps);
        let error = fall(substeps, t) - 0.5 * G * t * t;
        // Backward Euler: x_n = g h² n (n + 1)/2.
        assert!((error - 0.5 * G * h * t).abs() < 1e-11, "M = {substeps}: {error}");
    }
}

#[test]
fn drag_decays_exponentially() {
    let (drag, secs, start) = (3.0, 0.5, DVec3::new(2.0, -1.0, 0.5));
    for substeps in [1, 4, 64] {
        let mut rig = Rig::<f64>::new(
            &[bar()],
            &AmsParams { drag, substep_secs: DT / f64::from(substeps), ..bare() },
            Simd::Auto,
        );
        (rig.gravity, rig.air) = (DVec3::ZERO, DVec3::new(1.0, 1.0, 1.0));
        let slip = start - rig.air;
        rig.edit(|snapshot| snapshot.velocities[1] = start.to_array());
        rig.play(secs, |_| Pose::IDENTITY);
        let kept = (rig.velocities()[1] - rig.air).dot(slip) / slip.dot(slip);
        let h = DT / f64::from(substeps);
        assert!((kept - (1.0 + h * drag).powf(-secs / h)).abs() < 1e-12, "M = {substeps}: {kept}");
        // e^{−ct} (1 + c² h t/2 + …)
        let exact = (-drag * secs).exp();
        assert!((kept / exact - 1.0).abs() < 0.6 * drag * drag * h * secs, "M = {substeps}: {kept}");
    }
}

/// Period of the oscillation of `value`, by zero crossings from the first to the last.
fn period(values: &[f64], dt: f64) -> f64 {
    let crossings: Vec<f64> = (1..values.len())
        .filter(|&i| (values[i - 1] < 0.0) != (values[i] < 0.0))
        .map(|i| i as f64 - values[i] / (values[i] - values[i - 1]))
        .collect();
    2.0 * dt * (crossings[crossings.len() - 1] - crossings[0]) / (crossings.len() - 1) as f64
}

/// With one particle clamped the root is a hinge: a point on an edge is the simple pendulum.
#[test]
fn a_hinge_swings_as_a_pendulum() {
    let amplitude = 0.2f64;
    let strand = vec![[0.0; 3], [amplitude.sin(), -amplitude.cos(), 0.0]];
    for inextensibility in [Inextensibility::Off, Inextensibility::Projection] {
        let params = AmsParams { k_edge: 1e6, substep_secs: DT / 20.0, inextensibility, ..bare() };
        let mut rig = Rig::<f64>::new(std::slice::from_ref(&strand), &params, Simd::Auto);
        let mut swing = Vec::new();
        for _ in 0..600 {
            rig.step(Pose::IDENTITY);
            swing.push(rig.positions()[1].x);
        }
        let (found, exact) = (period(&swing, DT), TAU / G.sqrt() * (1.0 + amplitude * amplitude / 16.0));
        println!("pendulum, {inextensibility:?}: period {found:.4} s (exact {exact:.4})");
        assert!((found / exact - 1.0).abs() < 0.01, "{found} for {exact}");
    }
}

/// Rate of decay and angular frequency of a particle on its integrity tie alone, per second.
fn ring(substeps: u32, k_integrity: f64) -> (f64, f64) {
    let params = AmsParams { k_integrity, substep_secs: DT / f64::from(substeps), sag_free: true, ..bare() };
    let mut rig = Rig::<f64>::new(&[bar()], &params, Simd::Auto);
    rig.edit(|snapshot| snapshot.positions[1][2] += 0.1);
    let mut x = Vec::new();
    for _ in 0..4 {
        x.push(rig.positions()[1].z);
        rig.step(Pose::IDENTITY);
    }
    // x_{n+2} = p x_{n+1} − q x_n, with p = 2 ρ cos φ and q = ρ² a frame.
    let determinant = x[1] * x[1] - x[0] * x[2];
    let p = (x[2] * x[1] - x[3] * x[0]) / determinant;
    let q = (x[2] * x[2] - x[3] * x[1]) / determinant;
    (-q.ln() / (2.0 * DT), (0.5 * p / q.sqrt()).acos() / DT)
}

#[test]
fn an_integrity_tie_rings_at_its_frequency() {
    for (substeps, printed) in [(1, 0.82), (4, 0.21), (10, 0.083)] {
        let (omega, h) = (10.0f64, DT / f64::from(substeps));
        let (damping, frequency) = ring(substeps, omega * omega);
        let expected = (1.0 + h * h * omega * omega).ln() / (2.0 * h);
        println!("tie, M = {substeps}: damping {damping:.4} s^-1, frequency {frequency:.4} rad/s");
        assert!((damping - expected).abs() < 1e-8, "{damping} for {expected}");
        assert!((damping / printed - 1.0).abs() < 0.02, "{damping} for {printed}");
        assert!((frequency - (h * omega).atan() / h).abs() < 1e-8, "{frequency}");
        assert!((frequency / omega - 1.0).abs() < h * h * omega * omega / 2.0, "{frequency}");
    }
    assert!(
        (ring(4, 121.0).1 / ring(4, 100.0).1 - 1.1).abs() < 1e-2,
        "twice 1.1 in stiffness is 1.1 in frequency"
    );
}

#[test]
fn without_preload_a_free_chain_sags_by_its_weight_over_the_tie() {
    for k_integrity in [30.0, 100.0, 1e4] {
        // Critical damping, so that it settles.
        let drag = 2.0 * f64::sqrt(k_integrity);
        let params = AmsParams { k_integrity, drag, ..bare() };
        let mut rig = Rig::<f64>::new(&[helix(30)], &params, Simd::Auto);
        let start = rig.positions();
        rig.play(8.0, |_| Pose::IDENTITY);
        let sag = G / k_integrity;
        let expected: Vec<DVec3> =
            start.iter().enumerate().map(|(i, &x)| if i == 0 { x } else { x - DVec3::Y * sag }).collect();
        let error = largest(&expected, &rig.positions());
        println!("sag without preload, tie {k_integrity}: {sag:.5} m to {error:.1e}");
        assert!(error < 1e-10, "{error:e}");
    }
}

/// The angular tie alone, in the plane: the outer particle of a hinge turns back as θ'' = −κ_α/l θ.
/// Its frequency is √(κ_α/l) for any angle, because the couple's moment on a rigid edge is κ_α θ
/// cos(θ/2).
#[test]
fn an_angular_tie_rings_at_its_frequency() {
    let (k_angular, angle) = (40.0, 0.05f64);
    let params = AmsParams {
        k_edge: 1e6,
        k_angular,
        angular: forelock_core::solver::ams::AngularForm::Edge,
        substep_secs: DT / 50.0,
        inextensibility: Inextensibility::Projection,
        ..bare()
    };
    let mut rig = Rig::<f64>::new(&[bar()], &params, Simd::Auto);
    rig.gravity = DVec3::ZERO;
    let centre = DVec3::from(rig.simulation.model().centre);
    rig.edit(|snapshot| {
        snapshot.positions[1] = (DVec3::new(angle.cos(), angle.sin(), 0.0) - centre).to_array()
    });
    let mut swing = Vec::new();
    for _ in 0..240 {
        rig.step(Pose::IDENTITY);
        swing.push(rig.positions()[1].y);
    }
    let (found, exact) = (period(&swing, DT), 2.0 * PI / f64::sqrt(k_angular));
    println!("angular tie: period {found:.4} s (exact {exact:.4})");
    assert!((found / exact - 1.0).abs() < 0.01, "{found} for {exact}");
}

#[test]
fn follow_the_leader_keeps_lengths() {
    let params = AmsParams { inextensibility: Inextensibility::FollowTheLeader, ..AmsParams::default() };
    let mut stretch = [0.0f64; 2];
    let mut double = Rig::<f64>::new(&[helix(30)], &params, Simd::Auto);
    let mut single = Rig::<f32>::new(&[helix(30)], &params, Simd::Auto);
    for frame in 1..=120 {
        let pose = crate::rig::shake(2.0, 2.0, f64::from(frame) * DT);
        stretch[0] = double.step(pose).max_edge_stretch.max(stretch[0]);
        stretch[1] = single.step(pose).max_edge_stretch.max(stretch[1]);
    }
    println!("stretch after follow the leader: float64 {:.1e}, float32 {:.1e}", stretch[0], stretch[1]);
    assert!(stretch[0] <= 1e-12 && stretch[1] <= 1e-5, "{stretch:?}");
    let free = AmsParams { inextensibility: Inextensibility::Off, ..params };
    let mut rig = Rig::<f64>::new(&[helix(30)], &free, Simd::Auto);
    assert!(rig.step(crate::rig::shake(2.0, 2.0, DT)).max_edge_stretch > 1e-9, "without it they stretch");
}
