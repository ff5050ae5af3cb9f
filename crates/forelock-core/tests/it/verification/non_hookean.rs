//! The non-Hookean curve of the integrity ties: its values, its smoothness, its memory.

use crate::rig::{DT, Rig, bare, real, simds};
use forelock_core::lane::Simd;
use forelock_core::pose::Pose;
use forelock_core::simulation::SimulationReal;
use forelock_core::solver::AmsParams;

fn params() -> AmsParams {
    AmsParams { k_integrity: 100.0, non_hookean: true, substep_secs: DT, ..bare() }
}

/// A tie pulled out to `e` strand lengths.
fn pulled<T: SimulationReal>(params: &AmsParams, simd: Simd, e: f64) -> Rig<T> {
    let mut rig = Rig::<T>::new(&[vec![[0.0; 3], [0.5, 0.0, 0.0]]], params, simd);
    pull(&mut rig, e);
    rig
}

/// Puts the particle `e` strand lengths from its ghost, at rest.
fn pull<T: SimulationReal>(rig: &mut Rig<T>, e: f64) {
    rig.edit(|snapshot| {
        snapshot.positions[1] = [0.25, 0.0, 0.5 * e].map(real);
        snapshot.velocities[1] = [0.0; 3].map(real);
    });
}

fn step<T: SimulationReal>(rig: &mut Rig<T>) -> f64 {
    rig.step(Pose::IDENTITY);
    rig.simulation.snapshot().integrity[1].to_f64().unwrap()
}

fn psi(e: f64) -> f64 {
    step(&mut pulled::<f64>(&params(), Simd::Auto, e))
}

#[test]
fn the_curve_has_its_values() {
    let expected =
        [(0.2, 1.0), (0.5, 1.0), (0.75, 11.0 / 12.0), (1.0, 0.75), (1.05, 0.375), (1.1, 0.0), (2.0, 0.0)];
    for (e, s) in expected {
        assert!((psi(e) - s).abs() < 1e-12, "{e}: {} for {s}", psi(e));
        for simd in simds() {
            let got = step(&mut pulled::<f32>(&params(), simd, e));
            assert!((got - s).abs() < 1e-5, "{simd:?}, {e}: {got} for {s}");
        }
    }
}

/// The tension ψ e is C¹ at the elastic limit, flat at the breaking point, and 1.5 times as strong
/// there.
#[test]
fn the_tension_is_smooth() {
    let tension = |e: f64| psi(e) * e;
    let slope = |a: f64, b: f64| (tension(b) - tension(a)) / (b - a);
    let d = 1e-5;
    assert!((slope(0.5 - d, 0.5) - 1.0).abs() < 1e-9);
    assert!((slope(0.5, 0.5 + d) - 1.0).abs() < 2.0 * d);
    assert!(slope(1.0 - d, 1.0).abs() < 2.0 * d);
    assert!((tension(1.0) / tension(0.5) - 1.5).abs() < 1e-12);
    assert!((tension(1.0 + d) / tension(1.0) - 1.0).abs() < 20.0 * d, "and does not jump as it breaks");
}

/// The force is that of the weakened tie: its stiffness is the secant s κ_I at the start of the
/// substep, integrated implicitly.
#[test]
fn a_damaged_tie_pulls_less() {
    for e in [0.3, 0.75, 1.05, 1.2] {
        let mut rig = pulled::<f64>(&params(), Simd::Auto, e);
        rig.gravity = glam::DVec3::ZERO;
        let s = step(&mut rig);
        let expected = -DT * s * 100.0 * 0.5 * e / (1.0 + DT * DT * s * 100.0);
        let v = rig.velocities()[1].z;
        assert!((v - expected).abs() < 1e-12, "{e}: {v} for {expected}");
    }
}

#[test]
fn damage_stays_without_healing_and_goes_with_it() {
    let damaged = psi(0.9);
    let mut forever = pulled::<f64>(&params(), Simd::Auto, 0.9);
    let tau = 0.5;
    let mut healing = pulled::<f64>(&AmsParams { healing_secs: tau, ..params() }, Simd::Auto, 0.9);
    assert_eq!([step(&mut forever), step(&mut healing)], [damaged; 2]);
    for n in 1..=60 {
        for rig in [&mut forever, &mut healing] {
            pull(rig, 0.1);
        }
        assert_eq!(step(&mut forever), damaged);
        let expected = 1.0 - (1.0 - damaged) * (1.0 - DT / tau).powi(n);
        let s = step(&mut healing);
        assert!((s - expected).abs() < 1e-12, "after {n}: {s} for {expected}");
    }
    // Beyond the healing limit nothing heals.
    let mut held = pulled::<f64>(&AmsParams { healing_secs: tau, ..params() }, Simd::Auto, 0.9);
    step(&mut held);
    pull(&mut held, 0.3);
    assert_eq!(step(&mut held), damaged);
}

/// The curve of `params` at a deflection of `e` lengths, from an intact tie.
fn at<T: SimulationReal>(rig: &mut Rig<T>, e: f64) -> f64 {
    pull(rig, e);
    rig.edit(|snapshot| snapshot.integrity.fill(T::one()));
    step(rig)
}

/// For any limits and widths: within 0 and 1, falling, continuous, and of a tension that is flat at
/// the breaking point.
#[test]
fn the_curve_holds_for_any_limits() {
    let mut state = 1u64;
    let mut random = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    for case in 0..1000 {
        let elastic_limit = if case % 10 == 0 { 0.0 } else { random() };
        let breaking_point = elastic_limit + 3.0 * random().powi(4) + 1e-3;
        let breaking_width = 1e-3 + random();
        let params = AmsParams { elastic_limit, breaking_point, breaking_width, ..params() };
        let mut rig = pulled::<f64>(&params, Simd::Auto, 0.0);
        let mut single = pulled::<f32>(&params, Simd::Auto, 0.0);
        let range = breaking_point - elastic_limit;
        let closed = |e: f64| {
            let over = (e - elastic_limit).max(0.0);
            let softened = |e: f64, over: f64| 1.0 - over * over / (2.0 * range * e.max(1e-12));
            let past = (e - breaking_point) / breaking_width;
            if past < 0.0 {
                softened(e, over)
            } else {
                (softened(breaking_point, range) * (1.0 - past)).max(0.0)
            }
        };
        let mut before = 1.0;
        for share in [0.1, 0.3, 0.5, 0.7, 0.9, 1.1] {
            let e = share * (breaking_point + breaking_width);
            let (s, wide) = (at(&mut single, e), at(&mut rig, e));
            assert!((0.0..=1.0).contains(&wide) && (0.0..=1.0).contains(&s), "{params:?} {e}: {wide} {s}");
            assert!((wide - closed(e)).abs() < 1e-12, "{params:?} {e}: {wide}");
            assert!((s - wide).abs() < 1e-3, "{params:?} {e}: {s} for {wide}");
            assert!(wide <= before, "{params:?}: rises to {wide} at {e}");
            before = wide;
        }
        // Continuous where its pieces meet, flat where the tension is largest.
        let d = 1e-6 * range.min(breaking_width);
        for e in [elastic_limit, breaking_point, breaking_point + breaking_width] {
            let jump = at(&mut rig, e + d) - at(&mut rig, (e - d).max(0.0));
            assert!(jump.abs() < 1e-5, "{params:?}: jumps by {jump} at {e}");
        }
        let tension = |rig: &mut Rig<f64>, e: f64| e * at(rig, e);
        let before_break = tension(&mut rig, breaking_point - d);
        let slope = (tension(&mut rig, breaking_point) - before_break) / d;
        assert!(slope.abs() < 1e-3, "{params:?}: {slope}");
    }
}
