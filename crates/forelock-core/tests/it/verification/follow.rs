//! DFTL against known results: exact lengths, the load in the velocities, a pendulum, shape,
//! friction, and strands between steps.

use crate::rig::{DT, G, GRAVITY, LENGTH, Rig, Strand, assert_one_hash, helix, largest, shake, tuft, vector};
use forelock_core::body::{ColliderFrame, Shape};
use forelock_core::frame::{FrameInput, Roots};
use forelock_core::groom::Groom;
use forelock_core::interaction::sph::SphParams;
use forelock_core::lane::Simd;
use forelock_core::pose::Pose;
use forelock_core::simulation::SimulationReal;
use forelock_core::simulation::{Options, Simulation, Teleport};
use forelock_core::solver::DftlParams;
use forelock_core::strands::Between;
use glam::{DQuat, DVec3, Vec3};
use std::f64::consts::TAU;

/// Lengths alone.
fn alone() -> DftlParams {
    DftlParams { shape_global: 0.0, shape_local: 0.0, drag: 0.0, ..DftlParams::default() }
}

/// A strand that hangs straight, of `n` particles a centimetre apart.
fn straight(n: usize) -> Strand {
    (0..n).map(|i| [0.0, -0.01 * i as f64, 0.0]).collect()
}

/// The largest difference of an edge from its rest length, over that length and over the strand's,
/// in a shake of 10 g against a ball.
fn stretch<T: SimulationReal>(params: &DftlParams) -> [f64; 2] {
    let strands = tuft(40, 30);
    let mut rig = Rig::<T>::new(&strands, params, Simd::Auto);
    rig.dt = params.step_secs;
    let ball = Shape::Sphere { radius: 0.06 };
    let local = Pose::new(DQuat::IDENTITY, DVec3::new(0.02, -0.15, 0.0));
    let (mut worst, mut touched) = ([0.0f64; 2], 0);
    for frame in 1..=120 {
        let to = shake(10.0, 3.0, f64::from(frame) * rig.dt);
        let solid = ColliderFrame { shape: &ball, local, from: rig.head, to, friction: 0.3 };
        touched += rig.step_among(to, &[solid]).touching;
        // Relative to the origin, as the state is: the world's coordinates would be rounded anew.
        let now = rig.simulation.snapshot().positions;
        for (strand, now) in strands.iter().zip(now.chunks(30)) {
            for (rest, now) in strand.windows(2).zip(now.windows(2)) {
                let rest = DVec3::from(rest[0]).distance(rest[1].into());
                let off = (vector(now[0]).distance(vector(now[1])) - rest).abs();
                worst = [worst[0].max(off / rest), worst[1].max(off / LENGTH)];
            }
        }
    }
    assert!(touched > 1000, "{touched} touches");
    worst
}

#[test]
fn edges_are_exact_in_a_shake_of_ten_g() {
    let params = DftlParams::default();
    let double = stretch::<f64>(&params);
    let single = stretch::<f32>(&params);
    println!(
        "edges off by {double:?} in float64, {single:?} in float32, of their length and of the strand's"
    );
    assert!(double[0] < 1e-12, "{double:?}");
    // A position stored in float32 within 0.4 m of the origin has a rounding error of 3e-8 m: 3e-6
    // of an edge of 1 cm.
    assert!(single[0] < 4e-6 && single[1] < 1e-6, "{single:?}");
    // With solids last, as the paper has it, edges stretch.
    let loose = stretch::<f64>(&DftlParams { level_collisions: true, recheck: 0, ..params });
    println!("with solids last {:.0} % of an edge", 100.0 * loose[0]);
    assert!(loose[0] > 0.05, "{loose:?}");
}

/// At rest Eq. (14) is v_i = s_d (v_{i+1} + h g): the velocities hold a geometric series of the
/// load.
#[test]
fn velocities_at_rest_hold_the_load() {
    let (n, damping) = (12, 0.9);
    let mut rig = Rig::<f64>::new(&[straight(n)], &DftlParams { damping, ..alone() }, Simd::Auto);
    rig.dt = 0.016;
    rig.play(12.0, |_| Pose::IDENTITY);
    let rest: Vec<DVec3> = straight(n).into_iter().map(DVec3::from).collect();
    assert!(largest(&rest, &rig.positions()) < 1e-15);
    let mut load = 0.0;
    for (i, v) in rig.velocities().into_iter().enumerate().rev() {
        let expected = if i == 0 { 0.0 } else { load };
        if i > 0 {
            assert!((v - DVec3::NEG_Y * expected).length() < 1e-12, "particle {i}: {v} {expected}");
        }
        load = damping * (load + rig.dt * G);
    }
}

/// Two particles are a pendulum of period 2π √(l/g) in small swings.
#[test]
fn an_edge_swings_as_a_pendulum() {
    let length = 0.25;
    let tilt: f64 = 0.05;
    let strand = vec![[0.0; 3], [length * tilt.sin(), -length * tilt.cos(), 0.0]];
    let mut rig = Rig::<f64>::new(&[strand], &alone(), Simd::Auto);
    rig.dt = 1e-3;
    let mut crossings = Vec::new();
    let mut before = rig.positions()[1].x;
    for step in 1..8000 {
        rig.step(Pose::IDENTITY);
        let x = rig.positions()[1].x;
        if before > 0.0 && x <= 0.0 {
            crossings.push(rig.dt * (f64::from(step) - x / (x - before)));
        }
        before = x;
    }
    let period = (crossings[5] - crossings[0]) / 5.0;
    let expected = TAU * (length / G).sqrt() * (1.0 + tilt * tilt / 16.0);
    println!("period {period:.5} s, {expected:.5} s expected");
    assert!((period / expected - 1.0).abs() < 2e-3, "{period} {expected}");
}

#[test]
fn shape_is_kept_by_as_much_as_is_asked_for() {
    let rest: Vec<DVec3> = helix(30).into_iter().map(DVec3::from).collect();
    let off = |params: &DftlParams| {
        let mut rig = Rig::<f64>::new(&[helix(30)], params, Simd::Auto);
        rig.dt = 0.016;
        rig.play(4.0, |_| Pose::IDENTITY);
        let apart = rest.iter().zip(rig.positions()).map(|(a, b)| a.distance(b));
        apart.sum::<f64>() / 30.0 / LENGTH
    };
    let none = off(&alone());
    let whole = DftlParams { tip_scale_global: 1.0, tip_scale_local: 1.0, ..DftlParams::default() };
    let weak = off(&whole);
    let strong = off(&DftlParams { shape_global: 0.5, shape_local: 0.5, ..whole.clone() });
    println!("from rest by {none:.3} L without shape, {weak:.3} L with some, {strong:.3} L with much");
    assert!(none > 1.02 * weak && weak > 2.0 * strong, "{none} {weak} {strong}");
    // What carries its weight stays where it was groomed.
    assert!(off(&DftlParams { sag_free: true, ..whole }) < 1e-12);
}

/// An edge that lies across a slope swings down along it, unless friction holds it.
#[test]
fn friction_holds_what_lies_on_a_slope() {
    let slope = 0.4f64;
    let turn = DQuat::from_rotation_x(slope);
    let plane = Shape::Plane;
    let moved = |friction: f64| {
        let params = DftlParams { skin_thickness: 0.0, ..alone() };
        let mut rig = Rig::<f64>::new(&[vec![[0.0; 3], [0.1, 0.0, 0.0]]], &params, Simd::Auto);
        rig.dt = 0.016;
        let local = Pose::new(turn, DVec3::ZERO);
        for _ in 0..60 {
            let still = Pose::IDENTITY;
            rig.step_among(
                still,
                &[ColliderFrame { shape: &plane, local, from: still, to: still, friction }],
            );
        }
        let at = rig.positions()[1];
        let height = (turn.inverse() * at).y;
        assert!(height.abs() < 1e-3, "it lies on the plane, {height} m over it");
        at.distance(DVec3::new(0.1, 0.0, 0.0))
    };
    let (slips, holds) = (moved(0.0), moved(1.5 * slope.tan()));
    println!("moved by {slips:.4} m without friction, by {holds:.1e} m with");
    assert!(slips > 0.05 && holds < 1e-4, "{slips} {holds}");
}

fn played(strands: usize, simd: Simd) -> Rig<f32> {
    let mut strands = tuft(strands, 12);
    if strands.len() > 8 {
        strands[3].truncate(5);
    }
    let mut rig = Rig::<f32>::new(&strands, &DftlParams::default(), simd);
    rig.simulation.set_sph(Some(&SphParams::default())).unwrap();
    rig.dt = 0.016;
    rig
}

fn play(rig: &mut Rig<f32>, frames: std::ops::Range<u32>) {
    let ball = Shape::Sphere { radius: 0.06 };
    let local = Pose::new(DQuat::IDENTITY, DVec3::new(0.02, -0.2, 0.0));
    for frame in frames {
        let to = shake(3.0, 2.0, f64::from(frame + 1) * rig.dt);
        rig.step_among(to, &[ColliderFrame { shape: &ball, local, from: rig.head, to, friction: 0.3 }]);
    }
}

#[test]
fn threads_widths_and_interruptions_leave_the_bits_alone() {
    for strands in [1, 7, 9, 17, 33] {
        assert_one_hash(|simd| {
            let mut rig = played(strands, simd);
            play(&mut rig, 0..16);
            let whole = rig.simulation.state_hash();
            let [mut first, mut second] = [(); 2].map(|()| played(strands, simd));
            play(&mut first, 0..7);
            second.simulation.restore(&first.simulation.snapshot()).unwrap();
            second.head = first.head;
            play(&mut second, 7..16);
            assert_eq!(second.simulation.state_hash(), whole, "{strands} strands");
            whole
        });
    }
}

#[test]
fn a_poisoned_strand_is_reset_alone() {
    let [mut clean, mut sick] =
        [(); 2].map(|()| Rig::<f32>::new(&tuft(33, 12), &DftlParams::default(), Simd::Auto));
    [&mut clean, &mut sick].into_iter().for_each(|rig| rig.play(0.2, |t| shake(2.0, 2.0, t)));
    sick.edit(|snapshot| snapshot.previous[20 * 12 + 5][0] = f32::NAN);
    for quarantined in [1, 0, 0] {
        assert_eq!(clean.step(Pose::IDENTITY).quarantined_strands, 0);
        assert_eq!(sick.step(Pose::IDENTITY).quarantined_strands, quarantined);
        let (a, b) = (clean.simulation.snapshot(), sick.simulation.snapshot());
        for p in (0..33 * 12).filter(|p| !(20 * 12..21 * 12).contains(p)) {
            assert_eq!((a.positions[p], a.velocities[p]), (b.positions[p], b.velocities[p]), "{p}");
        }
        assert!(b.previous.iter().flatten().all(|x| x.is_finite()));
    }
}

/// A head that jumps takes its hair along, with the motion that drag feels.
#[test]
fn hair_that_is_carried_moves_as_before() {
    let mut rig = Rig::<f64>::new(&[helix(30)], &DftlParams::default(), Simd::Auto);
    rig.play(0.4, |t| shake(2.0, 2.0, t));
    let motion = |rig: &Rig<f64>| -> Vec<DVec3> {
        let snapshot = rig.simulation.snapshot();
        snapshot.positions.iter().zip(&snapshot.previous).map(|(x, y)| vector(*x) - vector(*y)).collect()
    };
    let (from, before) = (rig.head, motion(&rig));
    let to = Pose::new(DQuat::from_rotation_z(1.0), DVec3::new(-900.0, 30.0, 400.0));
    rig.simulation.teleport(&from, &to, Teleport::CarryShapeAndVelocity);
    let turned: Vec<DVec3> = before.iter().map(|&v| to.after(&from.inverse()).transform_vector(v)).collect();
    assert!(largest(&turned, &motion(&rig)) < 1e-12 && largest(&before, &vec![DVec3::ZERO; 30]) > 1e-3);
    rig.simulation.teleport(&to, &from, Teleport::CarryShape);
    assert!(motion(&rig).iter().all(|v| *v == DVec3::ZERO));
}

/// Between two steps strands lie on the head, keep their lengths, and go from one state to the
/// other.
#[test]
fn strands_between_steps_are_strands() {
    let strand: Vec<Vec3> = helix(20).into_iter().map(|p| DVec3::from(p).as_vec3()).collect();
    let groom = Groom::from_strands([strand.clone()]).unwrap();
    let mut simulation = Simulation::new(&groom, &DftlParams::default(), &Options::default()).unwrap();
    let head = |step: i32| {
        Pose::new(DQuat::from_rotation_y(0.05 * f64::from(step * step)), DVec3::X * 0.01 * f64::from(step))
    };
    let mut last = Vec::new();
    for step in 0..12 {
        simulation.positions(&mut last);
        let poses = [head(step), head(step + 1)];
        let frame =
            FrameInput { roots: Roots::Rigid(poses), gravity: GRAVITY, dt_secs: DT, ..FrameInput::default() };
        simulation.step_frame(&frame).unwrap();
    }
    let (mut now, mut between) = (Vec::new(), Vec::new());
    simulation.positions(&mut now);
    let heads = [head(11), head(12)];
    let (state, model) = (simulation.state(), simulation.model());
    let shown = |share, now, out: &mut _| state.positions_between(model, &Between { share, heads, now }, out);
    let far = |a: &[Vec3], b: &[Vec3]| a.iter().zip(b).map(|(a, b)| a.distance(*b)).fold(0.0, f32::max);
    shown(0.0, heads[0], &mut between);
    assert!(far(&between, &last) < 1e-6);
    shown(1.0, heads[1], &mut between);
    assert_eq!(between, now);
    shown(0.999_999, heads[1], &mut between);
    assert!(far(&between, &now) < 1e-5 && far(&last, &now) > 1e-2);
    let middle = heads[0].interpolate(&heads[1], 0.5);
    shown(0.5, middle, &mut between);
    let root = middle.transform_point(strand[0].as_dvec3()).as_vec3();
    assert!(between[0].distance(root) < 1e-7);
    for (edge, rest) in between.windows(2).zip(strand.windows(2)) {
        assert!((edge[0].distance(edge[1]) / rest[0].distance(rest[1]) - 1.0).abs() < 1e-4);
    }
}
