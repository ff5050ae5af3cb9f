//! Invariance under the scene's position, its size, the frame rate, and the other strands of the
//! groom.

use crate::rig::{DT, GRAVITY, LENGTH, Rig, Strand, Varied, helix, largest, shake, simds, tuft};
use forelock_core::lane::Simd;
use forelock_core::pose::Pose;
use forelock_core::simulation::Options;
use forelock_core::solver::AmsParams;
use forelock_core::strands::Snapshot;
use glam::{DQuat, DVec3};

/// A gentle nod and sway: under 1 g.
fn gentle(t: f64) -> Pose {
    let sway = 0.02 * (1.0 - (4.0 * t).cos());
    Pose::new(DQuat::from_rotation_z(0.3 * (1.0 - (3.0 * t).cos())), DVec3::new(sway, 0.0, 0.5 * sway))
}

#[test]
fn a_kilometre_away_it_moves_alike() {
    let away = Pose::new(DQuat::IDENTITY, DVec3::new(600.0, -640.0, 480.0));
    let options = Options { rest_gravity: GRAVITY, ..Options::default() };
    let mut worst = 0.0;
    for simd in simds() {
        let mut near =
            Rig::<f32>::with_options(&[helix(30)], &AmsParams::default(), &Options { simd, ..options });
        let far = Options { simd, rest_pose: away, ..options };
        let mut far = Rig::<f32>::with_options(&[helix(30)], &AmsParams::default(), &far);
        for frame in 1..=60 {
            let pose = gentle(f64::from(frame) * DT);
            near.step(pose);
            far.step(away.after(&pose));
            let back: Vec<DVec3> = far.positions().iter().map(|&x| x - away.translation).collect();
            worst = largest(&near.positions(), &back).max(worst);
        }
    }
    println!("1 km away, float32, 1 s: {:.1e} L (at most 1e-5)", worst / LENGTH);
    assert!(worst / LENGTH <= 1e-5, "{worst:e}");
}

#[test]
fn a_hundred_times_as_large_it_moves_a_hundred_times_as_far() {
    let scale = 100.0;
    let large: Strand = helix(30).iter().map(|p| p.map(|x| x * scale)).collect();
    let params = AmsParams { non_hookean: true, ..AmsParams::default() };
    let scaled = |k_angular| AmsParams { k_angular, ..params.clone() };
    let error = |k_angular: f64| {
        let options = Options { rest_gravity: GRAVITY * scale, ..Options::default() };
        let mut small = Rig::<f64>::new(&[helix(30)], &params, Simd::Auto);
        let mut large = Rig::<f64>::with_options(std::slice::from_ref(&large), &scaled(k_angular), &options);
        let mut worst = 0.0;
        for frame in 1..=60 {
            let pose = gentle(f64::from(frame) * DT);
            small.step(pose);
            large.step(Pose { translation: pose.translation * scale, ..pose });
            let back: Vec<DVec3> = large.positions().iter().map(|&x| x / scale).collect();
            worst = largest(&small.positions(), &back).max(worst);
        }
        worst / LENGTH
    };
    let found = error(params.k_angular * scale);
    println!("lengths, gravity and angular stiffness x 100: {found:.1e} L");
    assert!(found <= 1e-11, "{found:e}");
    assert!(error(params.k_angular) > 1e-6, "an angular stiffness that was not scaled shows");
}

/// Position at each tenth of a second of the gentle scene, at `fps` with `substeps`.
fn run_at(fps: u32, substeps: u32) -> Vec<DVec3> {
    let substep_secs = 1.0 / f64::from(fps * substeps);
    let params = AmsParams { substep_secs, ..AmsParams::default() };
    let mut rig = Rig::<f64>::new(&[helix(30)], &params, Simd::Auto);
    rig.dt = 1.0 / f64::from(fps);
    let mut path = Vec::new();
    for frame in 1..=2 * fps {
        rig.step(gentle(f64::from(frame) * rig.dt));
        if frame % (fps / 10) == 0 {
            path.extend(rig.positions());
        }
    }
    path
}

/// With the same substep, the frame rate only changes how often the head's pose is given and
/// lengths are restored. With the same number of substeps the substep doubles and halves too, a
/// first-order error.
#[test]
fn frame_rates_agree() {
    let reference = run_at(60, 4);
    for (fps, substeps, bound) in [(30, 8, 1e-3), (120, 2, 1e-3), (30, 4, 5e-3), (120, 4, 5e-3)] {
        let error = largest(&reference, &run_at(fps, substeps)) / LENGTH;
        println!("{fps} fps x {substeps} against 60 x 4: {error:.1e} L (at most {bound})");
        assert!(error <= bound, "{error}");
    }
}

fn strand_of(snapshot: &Snapshot<f32>, from: usize, n: usize) -> Vec<[u32; 7]> {
    let bits = |p: usize| {
        let (x, v) = (snapshot.positions[p], snapshot.velocities[p]);
        [x[0], x[1], x[2], v[0], v[1], v[2], snapshot.integrity[p]].map(f32::to_bits)
    };
    (from..from + n).map(bits).collect()
}

/// Bits of the marked strand after half a second, with `others` before and after it. Each groom has
/// strands at the far corners of one box, so that all have the same centre.
fn among(before: usize, after: usize, simd: Simd) -> Vec<[u32; 7]> {
    let corner = |sign: f64| -> Strand { vec![[sign; 3], [0.9 * sign; 3]] };
    let mut strands = vec![corner(1.0), corner(-1.0)];
    strands.extend(tuft(before, 30));
    strands.push(helix(30));
    strands.extend(tuft(after, 30));
    let params = AmsParams { non_hookean: true, ..AmsParams::default() };
    let mut rig = Rig::<f32>::new(&strands, &params, simd);
    rig.play(0.5, |t| shake(2.0, 2.0, t));
    strand_of(&rig.simulation.snapshot(), 4 + 30 * before, 30)
}

#[test]
fn neighbours_and_order_leave_a_strands_bits_alone() {
    for simd in simds() {
        let alone = among(0, 0, simd);
        for (before, after) in [(100, 0), (0, 100), (37, 63), (15, 0), (16, 1)] {
            assert_eq!(alone, among(before, after, simd), "{simd:?}, {before} before, {after} after");
        }
    }
}

#[test]
fn stiffness_a_strand_scales_every_spring_and_tie() {
    let options = Options { rest_gravity: GRAVITY, ..Options::default() };
    let plain = AmsParams::default();
    let scaled = |by: f64| AmsParams {
        k_edge: plain.k_edge * by,
        k_bend: plain.k_bend * by,
        k_torsion: plain.k_torsion * by,
        k_integrity: plain.k_integrity * by,
        k_angular: plain.k_angular * by,
        ..plain.clone()
    };
    let stiffness = [0.5f32, 1.0, 0.25];
    let strands = [helix(30), helix(30), helix(30)];
    let run = |mut rig: Rig<f32>| {
        rig.play(0.5, |t| shake(1.0, 2.0, t));
        rig.simulation.snapshot()
    };
    let mixed =
        run(Rig::varied(&strands, Varied { stiffness: Some(&stiffness), masses: None }, &plain, &options));
    for (s, &by) in stiffness.iter().enumerate() {
        let whole = run(Rig::with_options(&strands, &scaled(by.into()), &options));
        // Powers of two scale without rounding: the same bits.
        assert_eq!(strand_of(&mixed, 30 * s, 30), strand_of(&whole, 30 * s, 30), "stiffness {by}");
    }
    assert_ne!(strand_of(&mixed, 0, 30), strand_of(&mixed, 30, 30));
}

#[test]
fn lengths_from_2_to_1000_particles_go_together() {
    let counts = [2, 3, 4, 5, 7, 8, 16, 17, 31, 100, 257, 1000, 2, 3, 30];
    // A particle a centimetre, so that the longest is ten metres of curl.
    let curl = |n: usize| -> Strand {
        let point = |i: f64| [0.01 * (0.5 * i).cos(), -0.0087 * i, 0.01 * (0.5 * i).sin()];
        (0..n).map(|i| point(i as f64)).collect()
    };
    let strands = counts.map(curl);
    // Coordinates up to 5 m are rounded to 2.4e-7 m at each end of an edge of 1 cm.
    let rounding = 2.0 * 3f64.sqrt() * 2.4e-7 / 0.01;
    for simd in simds() {
        for clamped in [1, 2, 5] {
            let params = AmsParams { clamped, ..AmsParams::default() };
            let mut rig = Rig::<f32>::new(&strands, &params, simd);
            for frame in 1..=40 {
                let report = rig.step(shake(2.0, 2.0, f64::from(frame) * DT));
                assert_eq!(report.quarantined_strands, 0, "{simd:?}");
                let stretch = report.max_edge_stretch;
                assert!(stretch <= rounding, "{simd:?}: {stretch:e} for {rounding:e}");
            }
            assert!(rig.positions().iter().all(|x| x.is_finite()));
        }
    }
}
