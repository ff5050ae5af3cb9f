//! The accuracy that this project requires of the solver, one test per threshold. The thresholds of
//! the dense solve are tested in `system`, those of penetration and friction in `solids`.

use crate::rig::{DT, G, GRAVITY, LENGTH, Rig, helix, largest, shake, simds};
use forelock_core::lane::Simd;
use forelock_core::pose::Pose;
use forelock_core::simulation::Options;
use forelock_core::simulation::SimulationReal;
use forelock_core::solver::AmsParams;
use glam::{DQuat, DVec3};

fn default_rig<T: SimulationReal>(simd: Simd) -> Rig<T> {
    Rig::new(&[helix(30)], &AmsParams::default(), simd)
}

fn drift<T: SimulationReal>(simd: Simd, params: &AmsParams) -> f64 {
    let mut rig = Rig::<T>::new(&[helix(30)], params, simd);
    let start = rig.positions();
    let mut worst = 0.0;
    for _ in 0..120 {
        rig.step(Pose::IDENTITY);
        worst = largest(&start, &rig.positions()).max(worst);
    }
    worst / LENGTH
}

#[test]
fn a_groom_at_rest_does_not_drift() {
    let drift64 = drift::<f64>(Simd::Auto, &AmsParams::default());
    let drift32 = simds().map(|simd| drift::<f32>(simd, &AmsParams::default())).fold(0.0, f64::max);
    println!("drift at rest, 2 s: float64 {drift64:.1e} L (at most 1e-12), float32 {drift32:.1e} L (1e-6)");
    assert!(drift64 <= 1e-12, "{drift64:e}");
    assert!(drift32 <= 1e-6, "{drift32:e}");
    // Negative control: without the sag-free start the strand sags by more than 0.1 L.
    assert!(drift::<f64>(Simd::Auto, &AmsParams { sag_free: false, ..AmsParams::default() }) > 0.1);
}

#[test]
fn edges_keep_their_length_in_a_shake() {
    let mut worst = 0.0f64;
    for simd in simds() {
        let mut rig = default_rig::<f32>(simd);
        for frame in 1..=120 {
            worst = rig.step(shake(4.0, 2.0, f64::from(frame) * DT)).max_edge_stretch.max(worst);
            let x = rig.positions();
            let longest =
                x.windows(2).map(|w| w[0].distance(w[1]) / (LENGTH / 29.0) - 1.0).fold(0.0, f64::max);
            assert!(longest <= 1e-5, "{simd:?}, frame {frame}: {longest:e}, but the report says {worst:e}");
        }
    }
    println!("largest stretch after the length pass, 4 g: {worst:.1e} (at most 1e-5)");
    assert!(worst <= 1e-5, "{worst:e}");
}

/// Largest distance, over the strand's length L, between a run and the same run in a rotated world,
/// rotated back.
fn turned_error(turn: DQuat, gravity: DVec3) -> f64 {
    let world = Pose::new(turn, DVec3::ZERO);
    let options = Options { rest_pose: world, rest_gravity: turn * GRAVITY, ..Options::default() };
    let mut plain = default_rig::<f64>(Simd::Auto);
    let mut turned = Rig::<f64>::with_options(&[helix(30)], &AmsParams::default(), &options);
    plain.air = DVec3::new(1.0, 0.5, -2.0);
    turned.air = turn * plain.air;
    turned.gravity = gravity;
    let mut worst = 0.0;
    for frame in 1..=120 {
        let t = f64::from(frame) * DT;
        let pose = Pose { rotation: DQuat::from_rotation_z(0.5 * (5.0 * t).sin()), ..shake(4.0, 2.0, t) };
        plain.step(pose);
        turned.step(world.after(&pose));
        let back: Vec<DVec3> = turned.positions().iter().map(|&x| turn.conjugate() * x).collect();
        worst = largest(&plain.positions(), &back).max(worst);
    }
    worst / LENGTH
}

#[test]
fn a_turned_world_moves_alike() {
    let turn = DQuat::from_scaled_axis(DVec3::new(0.7, -1.1, 2.0));
    let error = turned_error(turn, turn * GRAVITY);
    println!("whole scene rotated, 2 s of a 4 g shake: {error:.1e} L (at most 1e-8)");
    assert!(error <= 1e-8, "{error:e}");
    assert!(turned_error(turn, GRAVITY) > 1e-2, "if gravity is not rotated too, the motion must differ");
}

/// Largest displacement relative to the head, over L, of a strand that moves with the head at
/// constant velocity, in a wind of `wind_share` times that velocity.
fn carried_error(wind_share: f64) -> f64 {
    let u = DVec3::new(10.0, -2.0, 3.0);
    let mut rig = default_rig::<f64>(Simd::Auto);
    rig.air = u * wind_share;
    rig.edit(|snapshot| snapshot.velocities.fill(u.to_array()));
    let start = rig.positions();
    let mut worst = 0.0;
    for frame in 1..=120 {
        let travel = u * (f64::from(frame) * DT);
        rig.step(Pose::new(DQuat::IDENTITY, travel));
        let back: Vec<DVec3> = rig.positions().iter().map(|&x| x - travel).collect();
        worst = largest(&start, &back).max(worst);
    }
    worst / LENGTH
}

#[test]
fn at_constant_velocity_with_the_wind_nothing_moves() {
    let error = carried_error(1.0);
    println!("constant velocity, the same for the wind: {error:.1e} L (at most 1e-7)");
    assert!(error <= 1e-7, "{error:e}");
    assert!(carried_error(0.99) > 1e-4, "a slower wind must move the strand");
}

/// Jitter (largest acceleration, in g) with the head at rest, and 8 s after the head was tilted by
/// 135° within half a second.
fn late_jitter<T: SimulationReal>(simd: Simd) -> [f64; 2] {
    let mut rig = default_rig::<T>(simd);
    rig.play(1.5, |_| Pose::IDENTITY);
    let at_rest = rig.jitter(0.5);
    let tilt = |t: f64| DQuat::from_rotation_z(0.75 * std::f64::consts::PI * (t / 0.5).min(1.0));
    rig.play(8.5, |t| Pose::new(tilt(t), DVec3::ZERO));
    [at_rest, rig.jitter(0.5)]
}

#[test]
fn hair_comes_to_rest() {
    let runs = std::iter::once(late_jitter::<f64>(Simd::Auto)).chain(simds().map(late_jitter::<f32>));
    let worst = runs.fold([0.0f64; 2], |m, j| [m[0].max(j[0]), m[1].max(j[1])]);
    println!("late jitter: at rest {:.1e} g, after a tilt {:.1e} g (at most 1e-3)", worst[0], worst[1]);
    assert!(worst[0] <= 1e-3 && worst[1] <= 1e-3, "{worst:?}");
}

/// Accelerations in g during a quarter of a second with the head at rest: root mean square over
/// particles and frames, and maximum.
fn unrest<T: SimulationReal>(rig: &mut Rig<T>) -> [f64; 2] {
    let (mut sum, mut count, mut largest) = (0.0, 0.0f64, 0.0f64);
    for _ in 0..15 {
        let before = rig.velocities();
        rig.step(rig.head);
        for (a, b) in rig.velocities().iter().zip(&before) {
            let over_g = (*a - *b).length() / DT / G;
            (sum, count, largest) = (sum + over_g * over_g, count + 1.0, largest.max(over_g));
        }
    }
    [(sum / count).sqrt(), largest]
}

/// [`unrest`] immediately after two seconds of a 4 g shake at 1 Hz, 2 s later and 3 s later.
fn after_shake<T: SimulationReal>(simd: Simd) -> [[f64; 2]; 3] {
    let mut rig = default_rig::<T>(simd);
    rig.play(2.0, |t| shake(4.0, 1.0, t));
    [0.0, 1.75, 0.75].map(|wait| {
        rig.play(wait, |_| Pose::IDENTITY);
        unrest(&mut rig)
    })
}

/// After 2 s only the slowest swing of the strand is left. Its amplitude decays by a factor of
/// about e^−1.2 per second: through drag, at half the drag rate, and through the numerical damping
/// of the implicit step.
#[test]
fn two_seconds_after_a_shake_it_is_calm() {
    let runs = std::iter::once(after_shake::<f64>(Simd::Auto)).chain(simds().map(after_shake::<f32>));
    for [soon, two, three] in runs {
        println!(
            "after a 4 g shake: {:.2} g; 2 s later {:.1e} g (at most 5e-2), largest {:.1e}; 3 s later {:.1e}",
            soon[0], two[0], two[1], three[1]
        );
        assert!(soon[0] > 0.2, "the shake must move the strand: {soon:?}");
        assert!(two[0] <= 5e-2, "{two:?}");
        assert!(three[1] <= 5e-2, "{three:?}");
    }
}

#[test]
fn every_number_of_substeps_stays_finite_at_5_g() {
    let mut fastest = 0.0f64;
    for simd in simds() {
        for substeps in 1..=10 {
            let params = AmsParams { substep_secs: DT / f64::from(substeps), ..AmsParams::default() };
            let mut rig = Rig::<f32>::new(&[helix(30)], &params, simd);
            for frame in 1..=120 {
                let report = rig.step(shake(5.0, 2.0, f64::from(frame) * DT));
                assert_eq!(report.quarantined_strands, 0, "{simd:?}, M = {substeps}, frame {frame}");
            }
            let speed = rig.velocities().iter().map(|v| v.length()).fold(0.0, f64::max);
            assert!(speed.is_finite() && rig.positions().iter().all(|x| x.is_finite()));
            fastest = fastest.max(speed);
        }
    }
    println!("M = 1 to 10 at 5 g: nothing non-finite, fastest particle at the end {fastest:.1} m/s");
    assert!(fastest < 50.0 * G.sqrt(), "{fastest}");
}
