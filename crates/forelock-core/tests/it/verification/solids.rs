//! Hair and solids: depth at a frame's end, friction, and the way out for hair that starts inside.

use crate::rig::{DT, Rig, bare, helix, real, shake, simds, tuft};
use forelock_core::body::{ColliderFrame, Shape};
use forelock_core::lane::Simd;
use forelock_core::pose::Pose;
use forelock_core::simulation::SimulationReal;
use forelock_core::solver::AmsParams;
use glam::{DQuat, DVec3};

fn on_head(shape: &Shape, local: Pose, from: Pose, to: Pose) -> ColliderFrame<'_> {
    ColliderFrame { shape, local, from, to, friction: 0.3 }
}

fn distance(shape: &Shape, place: Pose, x: DVec3) -> f64 {
    shape.sample(place.inverse().transform_point(x).to_array()).0
}

/// Solids beside or under the hanging tuft, clear of its clamped roots.
fn obstacles() -> Vec<(Shape, Pose)> {
    let at = |turn: f64, x: f64, y: f64, z: f64| Pose::new(DQuat::from_rotation_z(turn), DVec3::new(x, y, z));
    vec![
        (Shape::Sphere { radius: 0.1 }, at(0.0, 0.02, -0.2, 0.01)),
        (Shape::Capsule { half_length: 0.2, radius: 0.03 }, at(1.2, 0.0, -0.15, 0.0)),
        (Shape::Box { half_extents: DVec3::new(0.08, 0.05, 0.2) }, at(0.4, 0.02, -0.18, 0.0)),
        (Shape::Plane, at(-0.3, 0.0, -0.2, 0.0)),
        (Shape::HollowSphere { radius: 0.22 }, at(0.0, 0.0, -0.05, 0.0)),
    ]
}

#[test]
fn nothing_ends_a_frame_inside() {
    let params = AmsParams::default();
    let mut worst = f64::NEG_INFINITY;
    for (simd, (shape, local)) in simds().flat_map(|s| obstacles().into_iter().map(move |o| (s, o))) {
        let mut rig = Rig::<f32>::new(&tuft(9, 30), &params, simd);
        let mut touched = 0;
        for frame in 1..=150 {
            let to = shake(4.0, 2.0, f64::from(frame) * DT);
            let report = rig.step_among(to, &[on_head(&shape, local, rig.head, to)]);
            touched += report.touching;
            if frame <= 30 {
                continue; // Hair that starts inside must be pushed out by 0.2 m, at 1 m/s.
            }
            let place = to.after(&local);
            for (i, &x) in rig.positions().iter().enumerate().filter(|(i, _)| i % 30 >= 2) {
                let depth = params.skin_thickness - distance(&shape, place, x);
                assert!(depth <= 1e-5, "{simd:?} {shape:?}, frame {frame}, particle {i}: {depth:e}");
                worst = worst.max(depth);
            }
            assert!(report.max_penetration_m <= 1e-5, "{}", report.max_penetration_m);
        }
        assert!(touched > 100, "{shape:?}: {touched}");
    }
    println!("depth under the skin at a frame's end: {worst:.1e} m (at most 1e-5)");
}

/// Tangential speed of a particle after it hits a solid at 100 along the surface and 50 into it.
/// The solid moves at `carried`.
fn speed_after<T: SimulationReal>(mu: f64, simd: Simd, carried: DVec3) -> f64 {
    let params = AmsParams { substep_secs: DT, ..bare() };
    let mut rig = Rig::<T>::new(&[vec![[0.0, 2.0, 0.0], [0.0, 0.1, 0.0]]], &params, simd);
    rig.gravity = DVec3::ZERO;
    rig.edit(|snapshot| {
        snapshot.velocities[1] = (DVec3::new(60.0, -50.0, 80.0) + carried).to_array().map(real);
        snapshot.clearance[1] = real(0.1);
    });
    let (from, to) = (Pose::IDENTITY, Pose::new(DQuat::IDENTITY, carried * DT));
    let plane = ColliderFrame { shape: &Shape::Plane, local: Pose::IDENTITY, from, to, friction: mu };
    rig.step_among(Pose::IDENTITY, &[plane]);
    let v = rig.velocities()[1] - carried;
    assert!(v.y.abs() < 1e-4, "{v}");
    (v.x * v.x + v.z * v.z).sqrt()
}

#[test]
fn friction_is_coulombs() {
    for carried in [DVec3::ZERO, DVec3::new(3.0, 2.0, -1.0)] {
        for (mu, expected) in [(0.0, 100.0), (0.3, 85.0), (1.0, 50.0), (3.0, 0.0)] {
            let v = speed_after::<f64>(mu, Simd::Auto, carried);
            println!("friction {mu}, solid at {carried}: {v} after (expected {expected})");
            assert!((v - expected).abs() < 1e-10, "{mu}: {v}");
            for simd in simds() {
                let v = speed_after::<f32>(mu, simd, carried);
                assert!((v - expected).abs() < 1e-3, "{simd:?}, {mu}: {v}");
            }
        }
    }
}

/// A particle without other forces is pushed out at exactly the given speed, and stops on the skin.
#[test]
fn the_way_out_has_a_speed() {
    let (speed, radius, start) = (0.6, 0.1, 0.04);
    let params = AmsParams { depenetration_speed: speed, ..bare() };
    let strand = vec![[0.0, 1.0, 0.0], [0.0, start, 0.0]];
    let shape = Shape::Sphere { radius };
    let mut rig = Rig::<f64>::new(&[strand], &params, Simd::Auto);
    rig.gravity = DVec3::ZERO;
    let solid = on_head(&shape, Pose::IDENTITY, Pose::IDENTITY, Pose::IDENTITY);
    let skin = radius + params.skin_thickness;
    for frame in 1..=20 {
        rig.step_among(Pose::IDENTITY, &[solid]);
        let height = rig.positions()[1].y;
        let expected = (start + speed * DT * f64::from(frame)).min(skin);
        assert!((height - expected).abs() < 1e-12, "frame {frame}: {height} for {expected}");
    }
}

/// Whole hair with all its ties, spawned across a ball: it is pushed out, and no part of it becomes
/// fast.
#[test]
fn hair_spawned_inside_comes_out_gently() {
    let params = AmsParams::default();
    let shape = Shape::Sphere { radius: 0.08 };
    let local = Pose::new(DQuat::IDENTITY, DVec3::new(0.03, -0.15, 0.0));
    let mut rig = Rig::<f32>::new(&[helix(30)], &params, Simd::Auto);
    let depths = |rig: &Rig<f32>| -> Vec<f64> {
        rig.positions().iter().map(|&x| params.skin_thickness - distance(&shape, local, x)).collect()
    };
    let (mut before, mut fastest, mut quickest_out) = (depths(&rig), 0.0f64, 0.0f64);
    assert!(before.iter().any(|&d| d > 0.04));
    for _ in 0..120 {
        rig.step_among(Pose::IDENTITY, &[on_head(&shape, local, Pose::IDENTITY, Pose::IDENTITY)]);
        let now = depths(&rig);
        for (was, is) in before.iter().zip(&now).filter(|(was, _)| **was > 0.0) {
            quickest_out = quickest_out.max((was - is.max(0.0)) / DT);
        }
        fastest = rig.velocities().iter().map(|v| v.length()).fold(fastest, f64::max);
        before = now;
    }
    let deepest = before.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    println!("spawned inside: out at {quickest_out:.2} m/s at most, fastest particle {fastest:.2} m/s");
    assert!(deepest <= 1e-5, "{deepest}");
    // The push is bounded; its own ties may swing it out on top, but no faster than that again.
    assert!(fastest <= params.depenetration_speed, "{fastest}");
    assert!(quickest_out <= params.depenetration_speed + fastest, "{quickest_out}");
}

/// A ball presses hair to a wall at 1 m/s until a gap of 3 mm is left. Hair is in the gap or beside
/// it, in neither solid, for either order of the solids.
#[test]
fn between_two_solids_hair_is_in_neither() {
    let params = AmsParams::default();
    let (ball, wall) = (Shape::Sphere { radius: 0.06 }, Shape::Plane);
    // The wall's outside is +x.
    let upright =
        Pose::new(DQuat::from_rotation_z(-std::f64::consts::FRAC_PI_2), DVec3::new(-0.04, 0.0, 0.0));
    let turned = upright.transform_vector(DVec3::Y);
    assert!((turned - DVec3::X).length() < 1e-12, "{turned}");
    let ball_at = |frame: u32| {
        let x = (0.15 - DT * f64::from(frame)).max(upright.translation.x + 0.06 + 0.003);
        Pose::new(DQuat::IDENTITY, DVec3::new(x, -0.18, 0.0))
    };
    // Straight ones from a patch of 4 cm by 5 cm.
    let root = |s: u32| DVec3::new(0.01 * f64::from(s % 5) - 0.02, 0.0, 0.005 * f64::from(s / 5) - 0.025);
    let hang =
        |s: u32| (0..30).map(|i| (root(s) + DVec3::NEG_Y * (0.01 * f64::from(i))).to_array()).collect();
    let strands: Vec<Vec<[f64; 3]>> = (0..55).map(hang).collect();
    for wall_first in [true, false] {
        let mut rig = Rig::<f32>::new(&strands, &params, Simd::Auto);
        let (mut deepest, mut pressed) = (f64::NEG_INFINITY, 0);
        for frame in 0..40 {
            let (from, to) = (ball_at(frame), ball_at(frame + 1));
            let still = on_head(&wall, upright, Pose::IDENTITY, Pose::IDENTITY);
            let moving = on_head(&ball, Pose::IDENTITY, from, to);
            let solids = if wall_first { [still, moving] } else { [moving, still] };
            rig.step_among(Pose::IDENTITY, &solids);
            for &x in &rig.positions() {
                let [in_wall, in_ball] = [distance(&wall, upright, x), distance(&ball, to, x)];
                deepest = deepest.max(-in_wall.min(in_ball));
                pressed += usize::from(in_wall.max(in_ball) < 2.5e-3);
            }
        }
        println!("wall first {wall_first}: depth {deepest:.1e} m, {pressed} particles × frames touch both");
        assert!(deepest < 1e-5, "wall first {wall_first}: {deepest}");
        assert!(pressed > 20, "{pressed}");
    }
}
