//! What may go wrong and is caught: poisoned strands, heads that jump, memory that grows.

use crate::rig::{DT, LENGTH, Rig, helix, largest, shake, simds, tuft};
use forelock_core::lane::Simd;
use forelock_core::pose::Pose;
use forelock_core::simulation::Teleport;
use forelock_core::solver::AmsParams;
use forelock_core::strands::Snapshot;
use glam::{DQuat, DVec3};

const N: usize = 12;

/// A number that is not finite goes into particle 5 of `strand`, in the array that `poison` picks.
fn poisoned(simd: Simd, strand: usize, poison: fn(&mut Snapshot<f32>, usize)) -> (Rig<f32>, Rig<f32>) {
    let [mut clean, mut sick] = [(); 2].map(|()| Rig::<f32>::new(&tuft(33, N), &AmsParams::default(), simd));
    for rig in [&mut clean, &mut sick] {
        rig.play(0.2, |t| shake(2.0, 2.0, t));
    }
    sick.edit(|snapshot| poison(snapshot, strand * N + 5));
    (clean, sick)
}

#[test]
fn a_poisoned_strand_is_reset_alone() {
    let poisons: [fn(&mut Snapshot<f32>, usize); 4] = [
        |s, p| s.positions[p][1] = f32::NAN,
        |s, p| s.velocities[p][0] = f32::INFINITY,
        |s, p| s.integrity[p] = f32::NAN,
        |s, p| s.positions[p] = [f32::MAX; 3],
    ];
    for simd in simds() {
        for (strand, poison) in [0, 7, 20, 32].into_iter().zip(poisons) {
            let (mut clean, mut sick) = poisoned(simd, strand, poison);
            let pose = Pose::new(DQuat::from_rotation_x(0.1), DVec3::new(0.01, 0.0, 0.0));
            assert_eq!(clean.step(pose).quarantined_strands, 0);
            assert_eq!(sick.step(pose).quarantined_strands, 1, "{simd:?}, strand {strand}");
            let rest: Vec<DVec3> =
                tuft(33, N)[strand].iter().map(|&p| pose.transform_point(p.into())).collect();
            let ours = strand * N..(strand + 1) * N;
            assert!(largest(&rest, &sick.positions()[ours.clone()]) < 1e-6, "back to its rest shape");
            assert!(sick.simulation.snapshot().integrity[ours.clone()].iter().all(|&s| s == 1.0));
            for _ in 0..10 {
                let (a, b) = (clean.simulation.snapshot(), sick.simulation.snapshot());
                for p in (0..33 * N).filter(|p| !ours.contains(p)) {
                    assert_eq!((a.positions[p], a.velocities[p]), (b.positions[p], b.velocities[p]), "{p}");
                }
                assert!(ours.clone().all(|p| b.positions[p].iter().all(|x| x.is_finite())));
                clean.step(pose);
                assert_eq!(sick.step(pose).quarantined_strands, 0, "cured");
            }
        }
    }
}

/// A strand in motion, teleported from where its head is: before, after, and the two poses.
fn jump(mode: Teleport) -> (Rig<f64>, [Vec<DVec3>; 2], Pose, Pose) {
    let mut rig = Rig::<f64>::new(&[helix(30)], &AmsParams::default(), Simd::Auto);
    rig.play(0.4, |t| shake(2.0, 2.0, t));
    let before = [rig.positions(), rig.velocities()];
    let to = Pose::new(DQuat::from_scaled_axis(DVec3::new(1.0, 2.0, -0.5)), DVec3::new(-900.0, 30.0, 400.0));
    let from = rig.head;
    rig.simulation.teleport(&from, &to, mode);
    rig.head = to;
    (rig, before, from, to)
}

#[test]
fn each_teleport_does_what_it_says() {
    let still = vec![DVec3::ZERO; 30];
    for mode in [Teleport::Reset, Teleport::CarryShape, Teleport::CarryShapeAndVelocity] {
        let (rig, [x, v], from, to) = jump(mode);
        let carry = to.after(&from.inverse());
        let rest = helix(30).iter().map(|&p| to.transform_point(p.into())).collect();
        let carried = x.iter().map(|&x| carry.transform_point(x)).collect();
        let turned = v.iter().map(|&v| carry.transform_vector(v)).collect();
        let (shape, motion): (Vec<DVec3>, Vec<DVec3>) = match mode {
            Teleport::Reset => (rest, still.clone()),
            Teleport::CarryShape => (carried, still.clone()),
            Teleport::CarryShapeAndVelocity => (carried, turned),
        };
        assert!(largest(&shape, &rig.positions()) < 1e-11, "{mode:?}");
        assert!(largest(&motion, &rig.velocities()) < 1e-12, "{mode:?}");
        assert!(largest(&still, &v) > 0.1, "it was in motion");
    }
}

#[test]
fn nothing_explodes_after_a_teleport() {
    for mode in [Teleport::Reset, Teleport::CarryShape, Teleport::CarryShapeAndVelocity] {
        let (mut rig, [_, v], ..) = jump(mode);
        let allowed = largest(&v, &vec![DVec3::ZERO; 30]) + 2.0;
        rig.gravity = rig.head.transform_vector(crate::rig::GRAVITY);
        for _ in 0..480 {
            let report = rig.step(rig.head);
            assert!(report.max_edge_stretch < 1e-12, "{mode:?}");
            let speed = largest(&rig.velocities(), &vec![DVec3::ZERO; 30]);
            assert!(speed < allowed, "{mode:?}: {speed} m/s");
        }
        let rest: Vec<DVec3> = helix(30).iter().map(|&p| rig.head.transform_point(p.into())).collect();
        let off = largest(&rest, &rig.positions()) / LENGTH;
        println!("8 s after a teleport, {mode:?}: {off:.1e} L from rest");
        assert!(off < 1e-2, "{mode:?}: {off}");
    }
}

#[test]
fn a_particle_takes_at_most_250_bytes() {
    let (strands, particles) = (10_000, 25);
    let mut rig = Rig::<f32>::new(&tuft(strands, particles), &AmsParams::default(), Simd::Auto);
    rig.step(shake(1.0, 1.0, DT));
    let memory = rig.simulation.memory();
    let total = (memory.model + memory.state + memory.workspace) as f64 / (strands * particles) as f64;
    println!("{total:.1} bytes a particle: {memory:?}");
    assert!(total <= 250.0, "{total}");
    assert!(total >= 12.0 * 4.0, "rest, lengths, positions and velocities alone take that");
}
